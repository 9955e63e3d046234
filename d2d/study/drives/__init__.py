"""Simulated drives (chapters 12 and 13)."""
