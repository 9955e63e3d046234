"""The motion along a drive."""
