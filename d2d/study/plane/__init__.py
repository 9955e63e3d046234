"""The thesis's scenes in the plane and their evaluation (chapters 9 and 10)."""
