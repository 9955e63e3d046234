"""Scans, and what comes with them: mountings, references, recordings, budgets."""
