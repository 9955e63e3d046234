"""Every drive that folders of data sets hold, evaluated by one call: a row of a table each.

Each drive is tracked with all radars and its data set's budget, and compared with its reference.
Where a drive cannot be judged, its row has only the reason.
"""

import sys
from collections.abc import Mapping, Sequence
from typing import Any

import joblib
import pandas as pd
from tqdm import tqdm

from d2d.radar import compare
from d2d.study.road.drive import HORIZON, Source
from d2d.study.road.scores import scores

PARTS = {3: ("v_x", "v_y", "omega"), 2: ("low", "high")}  # of a score, by their number


def row_of(source: Source) -> dict[str, Any]:
    """The row of a drive: its length in s, and the scores of its estimates."""
    row: dict[str, Any] = {"data set": source.data_set, "drive": source.name, "reason": ""}
    try:
        drive = source.load()
        driven = drive.track(horizon=HORIZON, budget=drive.budget)
        found = compare(driven, drive.reference)
    except Exception as error:  # whatever it is, one drive must not end the run of hundreds
        return row | {"reason": " ".join(f"{type(error).__name__}: {error}".split())}
    row |= {"radars": len(drive.recordings), "rounds": len(driven.times)}
    row |= {"seconds": float(driven.times[-1] - driven.times[0]), "converged": found.converged}
    for name, value in scores(found).items():
        if isinstance(value, list):
            row |= {f"{name} {k}": v for k, v in zip(PARTS[len(value)], value, strict=True)}
        else:
            row[name] = value
    return row


def table_of(sources: Sequence[Source]) -> pd.DataFrame:
    """The rows of all drives, by whatever backend of joblib is set."""
    rows = joblib.Parallel(return_as="generator")(joblib.delayed(row_of)(own) for own in sources)
    return pd.DataFrame(tqdm(rows, total=len(sources), unit="drive"))


def write(sources: Mapping[str, Sequence[Source]]) -> None:
    """Print the table as CSV."""
    table = table_of([source for drives in sources.values() for source in drives])
    table.to_csv(sys.stdout, index=False, float_format="%.5g")
