"""Scenes on a line, where a cost surface can be seen whole (chapters 3 and 4)."""
