"""The compiled kernel: the cost, its derivatives and its minimum, for many problems in one call."""
