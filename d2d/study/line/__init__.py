"""Scenes on a line, where a cost surface can be seen whole (chapters 4a and 4b)."""
