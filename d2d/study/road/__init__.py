"""Recorded drives: chapters 14 and 15 and pages F, G and H."""
