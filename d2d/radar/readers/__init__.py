"""Readers of logs and data sets."""

from d2d.radar.readers import csv_log, nuscenes, radarscenes

READERS = {each.name: each for each in (csv_log.READER, radarscenes.READER, nuscenes.READER)}
"""All readers; the command line, the table in the docs and the tests of data sets go by it."""
