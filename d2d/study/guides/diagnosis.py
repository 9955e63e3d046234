"""How often `diagnose` is right: on logs without a fault, and on logs with one.

``python -m d2d.study.guides.diagnosis 200`` writes the tables of so many logs each.
"""

import sys
import warnings
from typing import NamedTuple

import numpy as np
import pandas as pd

from d2d.radar import ErrorBudget, Finding, Track, diagnose, track
from d2d.study.book.table import Table, table
from d2d.study.guides.logs import FAULTS, Log, Sensors, right_log
from d2d.study.results import results_path

RATES, TARGETS = (4.0, 10.0, 15.0, 20.0, 30.0), (8, 16, 30, 40, 80, 300)
_SHARES = (0.15, 0.2, 0.2, 0.2, 0.2, 0.05)  # of the logs that have so many targets
_GUESSED = "a stretch without estimates"  # true of a log, and not a fault


def drawn(number: int, fault: str) -> tuple[Log, np.random.Generator]:
    """The log of this number, of any vehicle, to put a fault into."""
    rng = np.random.default_rng([number, *fault.encode()])
    vehicles = FAULTS[fault].vehicles
    vehicle, rate = vehicles[number % len(vehicles)], float(rng.choice(RATES))
    radars, targets = int(rng.choice(FAULTS[fault].radars)), int(rng.choice(TARGETS, p=_SHARES))
    if fault == "times in whole seconds":  # whose scans are ten or thirty scans in one
        rate, targets = 10.0, min(targets, 16)
    duration = 15.0 if "clock" in fault else 10.0
    return right_log(rng, vehicle, radars, rate, targets, duration), rng


def track_and_diagnose(sensors: Sensors) -> tuple[Track | None, tuple[Finding, ...]]:
    """Return the track, None if an error refuses the log, and the findings."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        try:
            driven = track(sensors, budget=ErrorBudget())
        except ValueError as error:
            return None, (Finding(str(error), "", np.nan, "", True, ""),)
    found = diagnose(sensors, driven)
    return driven, tuple(each for each in found if each.symptom != _GUESSED)


class Judgement(NamedTuple):
    """Whether a log's fault is named, and whether the log is refused or blamed for another."""

    named: bool
    refused: bool  # no file is written
    wrong: bool
    surely: bool  # blamed for another fault, without doubt


def judge(number: int, fault: str) -> Judgement:
    """Judge the diagnosis of a log with a fault."""
    log, rng = drawn(number, fault)
    driven, found = track_and_diagnose(FAULTS[fault].put(rng, log))
    known = [f.symptom in FAULTS[fault].symptoms or "microseconds" in f.symptom for f in found]
    others = [f for f, right in zip(found, known, strict=True) if not right]
    refused = driven is None or not driven.support.enough or any(f.sure for f in found)
    return Judgement(any(known), refused, bool(others), any(f.sure for f in others))


def diagnosis_table() -> Table:
    """The stored shares, a row for each fault, beside those of the diagnosis before this one."""
    stored, before = (pd.read_csv(results_path(f"diagnosis{end}.csv")) for end in ("", "_before"))
    shared = ["named", "blamed", "surely"]
    rows = stored.merge(before[["fault", *shared]], on="fault", how="left")
    heads = [(name, "", ".0%") for name in (*stored.columns[2:], *shared)]
    groups = {"before": len(shared)}
    return table(rows.itertuples(index=False), ["fault", "logs", *heads], groups=groups)


if __name__ == "__main__":
    of_each = -(-int(sys.argv[1]) // (len(FAULTS) - 1))
    outcomes: dict[str, list[Judgement]] = {fault: [] for fault in FAULTS}
    for first in range(of_each):  # a table of fewer logs is there before the whole
        for fault, those in outcomes.items():
            share = len(FAULTS) - 1 if fault == "nothing" else 1
            those += [judge(first * share + i, fault) for i in range(share)]
        heads = ["named", "refused", "blamed", "surely"]
        rows = [(fault, len(own), *np.mean(own, axis=0)) for fault, own in outcomes.items()]
        table_of = pd.DataFrame(rows, columns=["fault", "logs", *heads]).round(4)
        table_of.to_csv(results_path("diagnosis.csv"), index=False)
        print(table_of.to_string(), flush=True)
