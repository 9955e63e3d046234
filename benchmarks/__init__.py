"""Speed and accuracy compared with what a user might pick instead: ``make bench``."""
