"""Gaussian mixtures and expectation maximisation (chapter 2)."""
