"""The thesis's scenes in the plane and their evaluation (chapters 10 and 11)."""
