"""What all pages of the book share: style, drawing, tables, animations, claims."""
