"""Recorded drives (chapter 8)."""
