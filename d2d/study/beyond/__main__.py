"""Compute the table of the exhaustive evaluation: ``python -m d2d.study.beyond [--jobs 2]``.

joblib keeps the outcome of each condition, so that an interrupted sweep resumes where it stopped.
"""

import argparse

import joblib
from tqdm import tqdm

from d2d.study.beyond.exhaustive import TABLE, recompute, table_of, trials, write_table


def main() -> None:
    """Compute the table."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--jobs", type=int, default=2, help="worker processes")
    parser.add_argument("--folder", default="build/exhaustive", help="for the unfinished sweep")
    arguments = parser.parse_args()
    wanted = trials()
    kept = joblib.Memory(arguments.folder, verbose=0).cache(recompute)
    parallel = joblib.Parallel(arguments.jobs, return_as="generator")
    outcomes = parallel(joblib.delayed(kept)(trial) for trial in wanted)
    rows = table_of(wanted, list(tqdm(outcomes, total=len(wanted), disable=None)))
    write_table(TABLE, rows)
    print(f"{rows.runs.sum()} registrations in {len(rows)} conditions, written to {TABLE}")


if __name__ == "__main__":
    main()
