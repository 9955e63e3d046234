"""Readers of logs and data sets, in one table."""

from d2d.radar.readers import bag, csv_log, nuscenes, radarscenes

READERS = {
    each.name: each for each in (csv_log.READER, bag.READER, radarscenes.READER, nuscenes.READER)
}

# The table in the docs is this text.
__doc__ = """Readers of logs and data sets.

.. list-table::
   :header-rows: 1

   * - on the command line
     - what it is
     - in Python
""" + "".join(
    f"   * - ``--{each.name} {each.metavar}``\n"
    f"     - {each.about}\n"
    f"     - ``{each.load.__name__}``\n"
    for each in READERS.values()
)
