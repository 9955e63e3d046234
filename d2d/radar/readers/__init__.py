"""Readers of logs and data sets, in one table."""

from d2d.radar.readers import bag, csv_log, nuscenes, radarscenes

READERS = {
    each.name: each for each in (csv_log.READER, bag.READER, radarscenes.READER, nuscenes.READER)
}
