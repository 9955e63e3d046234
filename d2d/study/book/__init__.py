"""What all pages of the book share: style, drawing, flow charts, animations, claims."""
