"""Every drive that the roots of data sets hold, evaluated by one call: a row of a table each.

python -m benchmarks.every_drive ROOT ... --out rows.csv [--jobs N] [--dask ADDRESS]

A root is the folder of a data set in its official layout, RadarScenes or nuScenes.  Each drive is
tracked with all radars and its data set's budget, and compared with its reference.  A row is
appended as soon as its drive is done, and drives that have a row are skipped: the same command goes
on where it was stopped.  Where a drive cannot be judged, its row has only the reason; without the
row, the next call tries again.

On a cluster (pip install 'd2d[dask]'), in this folder on all machines, with the roots at the same
places:

PYTHONPATH=. dask scheduler
PYTHONPATH=. dask worker ADDRESS --nworkers N --nthreads 1    (on each machine)
python -m benchmarks.every_drive ROOT ... --out rows.csv --dask ADDRESS
"""

import argparse
import csv
import time
import warnings
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import joblib
from tqdm import tqdm

from benchmarks.protocol import LOADERS
from benchmarks.road import HORIZON, Drive
from benchmarks.run import in_one_thread
from d2d.radar import compare, track
from d2d.study.recordings.road import scenes, scores, sequences

DIRECTIONS = "v_x", "v_y", "omega"  # in m/s, m/s, deg/s
BY_DIRECTION = "rmse", "mean", "whitened"
FIELDS = (
    *("data set", "drive", "radars", "rounds", "driven", "converged", "estimates"),
    *(f"{measure} {direction}" for measure in BY_DIRECTION for direction in DIRECTIONS),
    *("anees", "anees low", "anees high", "inside", "log_score", "took", "reason"),
)
Task = tuple[str, Path, str]  # data set, root, name of the drive
Row = dict[str, Any]


def drives_of(roots: Sequence[Path]) -> list[Task]:
    """All drives of the roots; one that several roots hold is that of the first."""
    found: dict[tuple[str, str], Task] = {}
    for root in roots:
        own = [("RadarScenes", *each) for each in sequences([root])]
        own += [("nuScenes", *each) for each in scenes([root])]
        if not own:
            raise ValueError(f"{root} holds no drive of RadarScenes or nuScenes")
        for task in own:
            found.setdefault((task[0], task[2]), task)
    return list(found.values())


def judged(drive: Drive) -> Row:
    """What is measured of a drive; times in s."""
    own = drive.recordings
    driven = track(own, horizon=HORIZON, budget=own[0].budget)
    found = compare(driven, drive.reference)
    measured = scores(found)
    low, high = measured.pop("anees_interval")
    for measure in BY_DIRECTION:
        values = measured.pop(measure)
        measured |= {f"{measure} {d}": v for d, v in zip(DIRECTIONS, values, strict=True)}
    return measured | {
        "radars": len(own),
        "rounds": len(driven.times),
        "driven": float(driven.times[-1] - driven.times[0]),
        "converged": found.converged,
        "anees low": low,
        "anees high": high,
    }


def row_of(data_set: str, root: Path, name: str) -> Row:
    """The row of a drive, numbers with five digits."""
    begin = time.perf_counter()
    try:
        row = judged(LOADERS[data_set](root, name))
    except Exception as error:  # whatever it is, one drive must not end the run of hundreds
        row = {"reason": " ".join(f"{type(error).__name__}: {error}".split())}
    row |= {"took": time.perf_counter() - begin}
    rounded = {k: f"{v:.5g}" if isinstance(v, float) else v for k, v in row.items()}
    return {"data set": data_set, "drive": name, **rounded}


def have_rows(path: Path) -> set[tuple[str, str]]:
    """Data set and name of the drives in a file, without a last line that a stop has cut."""
    if not path.exists():
        return set()
    text = path.read_text(encoding="utf-8")
    whole = text[: text.rfind("\n") + 1]
    table = csv.DictReader(whole.splitlines())
    if whole and tuple(table.fieldnames or ()) != FIELDS:
        raise ValueError(f"{path} is a file of other columns; give another with --out")
    if whole != text:
        path.write_text(whole, encoding="utf-8")
    return {(row["data set"], row["drive"]) for row in table}


def evaluate(tasks: Sequence[Task], path: Path) -> None:
    """Append the rows that are missing, by whatever backend of joblib is set."""
    known = have_rows(path)
    missing = [task for task in tasks if (task[0], task[2]) not in known]
    rows = joblib.Parallel(return_as="generator_unordered")(
        joblib.delayed(row_of)(*task) for task in missing
    )
    with path.open("a", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, FIELDS, lineterminator="\n")
        if not file.tell():
            table.writeheader()
        for row in tqdm(rows, total=len(tasks), initial=len(tasks) - len(missing), unit="drive"):
            table.writerow(row)
            file.flush()


def main() -> None:
    """Evaluate the drives that have no row yet."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("roots", type=Path, nargs="+", metavar="ROOT")
    parser.add_argument("--out", type=Path, required=True, help="the table, a CSV file")
    parser.add_argument("--jobs", type=int, default=1, help="processes on this machine")
    parser.add_argument("--dask", metavar="ADDRESS", help="of the scheduler of a cluster")
    arguments = parser.parse_args()
    in_one_thread()
    warnings.simplefilter("ignore")
    with ExitStack() as stack:
        if arguments.dask:
            from dask.distributed import Client

            stack.enter_context(Client(arguments.dask))
            stack.enter_context(joblib.parallel_config(backend="dask"))
        else:
            stack.enter_context(joblib.parallel_config(n_jobs=arguments.jobs))
        evaluate(drives_of(arguments.roots), arguments.out)


if __name__ == "__main__":
    # by its own name: processes elsewhere cannot find the functions of `__main__`
    from benchmarks import every_drive as by_name

    by_name.main()
