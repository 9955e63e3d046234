"""Experiments that the thesis left to future work (chapter 11)."""
