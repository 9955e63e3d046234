"""How an optimum is found, and how certain it is (chapter 5)."""
