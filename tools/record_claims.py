"""Record the evidence of all claims, or of some: `python tools/record_claims.py [id ...]`."""

import sys
import time

from d2d.study import CLAIMS
from d2d.study.book.record import RECORD, read_record, write_record


def main(names: list[str]) -> None:
    """Run the checks and write the record; claims not checked now keep their evidence."""
    unknown = [name for name in names if name not in CLAIMS]
    if unknown:
        sys.exit(f"No claim has the id {unknown[0]!r}.")
    stored = read_record() if RECORD.exists() else {}
    fresh = {}
    for name in names or CLAIMS:
        begin = time.perf_counter()
        fresh[name] = CLAIMS[name].check()
        print(f"{time.perf_counter() - begin:5.1f} s  {fresh[name].verdict:13}  {name}", flush=True)
    merged = stored | fresh
    write_record(RECORD, {name: merged[name] for name in CLAIMS if name in merged})


if __name__ == "__main__":
    main(sys.argv[1:])
