"""Scenes on a line, where a cost surface can be seen whole (chapters 4 and 5)."""
