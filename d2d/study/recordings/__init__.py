"""Recorded drives (chapters 14 and 15)."""
