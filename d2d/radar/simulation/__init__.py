"""A simulated drive with a Doppler radar."""
