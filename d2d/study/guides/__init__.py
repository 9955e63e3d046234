"""Guides for readers with a radar or a registration of their own; see "Your own radar"."""
