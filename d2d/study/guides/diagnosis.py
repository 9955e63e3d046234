"""How often `diagnose` is right: on logs without a fault, and on logs with one.

``python -m d2d.study.guides.diagnosis 200`` writes the tables of so many logs each.
"""

import sys
import warnings

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
    return right_log(rng, vehicle, radars, rate, targets, 15.0), rng


def told(sensors: Sensors) -> tuple[Track | None, tuple[Finding, ...]]:
    """The track, None where the log is refused by an error, and what is found."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        try:
            driven = track(sensors, budget=ErrorBudget())
        except ValueError as error:
            return None, (Finding(str(error), "", np.nan, "", True, ""),)
    found = diagnose(sensors, driven)
    return driven, tuple(each for each in found if each.symptom != _GUESSED)


def judged(fault: str, count: int) -> dict[str, object]:
    """The shares of logs with a fault that are named, refused, and blamed for something else."""
    named, refused, wrong, sure = np.zeros((4, count))
    for i in range(count):
        log, rng = drawn(i, fault)
        driven, found = told(FAULTS[fault].put(rng, log))
        known = [f.symptom in FAULTS[fault].symptoms or "microseconds" in f.symptom for f in found]
        refused[i] = driven is None or not driven.support.enough or any(f.sure for f in found)
        named[i], wrong[i] = any(known), not all(known)
        sure[i] = any(f.sure and not right for f, right in zip(found, known, strict=True))
    return {
        "fault": fault,
        "logs": count,
        "named": named.mean(),
        "refused": refused.mean(),
        "something else": wrong.mean(),
        "surely": sure.mean(),
    }


def diagnosis_table() -> Table:
    """The stored shares, a row for each fault, beside those of the diagnosis before this one."""
    stored, before = (pd.read_csv(results_path(f"diagnosis{end}.csv")) for end in ("", "_before"))
    heads = [(name, "", ".0%") for name in stored.columns[2:]]
    rows = stored.merge(
        before[["fault", "named", "something else", "surely"]], on="fault", how="left"
    )
    heads += [(f"before: {name}", "", ".0%") for name in ("named", "something else", "surely")]
    return table(rows.itertuples(index=False), ["fault", "logs", *heads])


if __name__ == "__main__":
    total = int(sys.argv[1])
    each = -(-total // (len(FAULTS) - 1))
    rows = []
    for name in FAULTS:
        rows.append(judged(name, total if name == "nothing" else each))
        print(rows[-1], flush=True)
        pd.DataFrame(rows).round(4).to_csv(results_path("diagnosis.csv"), index=False)
