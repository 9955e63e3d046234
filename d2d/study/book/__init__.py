"""Style, drawing, tables, animations and claims for all pages of the book."""
