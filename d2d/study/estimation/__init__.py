"""How an optimum is found, and how certain it is (chapters 6 and 8)."""
