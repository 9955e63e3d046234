"""Simulated drives (chapter 7)."""
