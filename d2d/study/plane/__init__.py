"""The thesis's scenes in the plane and their evaluation (chapters 6 and 6b)."""
