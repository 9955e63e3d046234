"""What the thesis left to future work (chapter 16)."""
