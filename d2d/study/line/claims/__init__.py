"""The claims on scenes on a line."""
