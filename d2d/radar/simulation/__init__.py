"""A simulated drive with a Doppler radar: the street, the sensor, and what is wrong with it."""
