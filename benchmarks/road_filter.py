"""A Kalman filter fed by radars on real drives: is it as certain as it may be?

python -m benchmarks.road_filter [--radarscenes ROOT ...] [--nuscenes ROOT ...]

writes a table into the book's results; without roots it does nothing.

The filter has a vehicle's velocity, its acceleration and the slow errors of the budget as states,
and no other sensor.  It gets each estimate of a `Tracker` in one of three ways: the inverse
Hessian as white noise, the budget's whole covariance as white noise, or the `FilterInput`.
Nothing is fitted: vehicle and budget are those that `track` and the readers have, and slow errors
stay as long as `Track.displacement` assumes.

NIS and NEES are divided by three, and 95 % of the NEES should be inside.  The NEES is against the
odometry, whose own errors count, too.  No estimate is rejected, but the table says how many
innovations are beyond the 99.9 % that a filter might reject: where a vehicle turns in faster than
its model allows, a gate would shut the radar out.
"""

import argparse
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import table
from benchmarks.road import HORIZON, Drive, nuscenes, radarscenes
from benchmarks.run import in_one_thread
from d2d.radar import ErrorBudget, Tracker, VelocityEstimate
from d2d.radar.tracks.acceleration import JERK, UNKNOWN
from d2d.radar.tracks.path import PERSISTENCE
from d2d.scores import normalised_squares
from d2d.study.drives.fusion import GATE, REGION, SETTLED, Filter, Motion, slow_errors, take
from d2d.study.recordings.road import scenes, sequences
from d2d.study.results import results_path

Array = NDArray[np.float64]
# The vehicle of `track`: of random walks, whose accelerations are as usual after a long time.
CAR = Motion(np.sqrt(np.diag(UNKNOWN)), 2.0 * np.diag(UNKNOWN) / np.diag(JERK))
WAYS = ("inverse Hessian", "budget as white noise", "budget, slow errors as states")
HEAD = (
    *("drive", "filter", "NIS", "beyond", "NEES", "inside"),
    *("v_x, m/s", "v_y, m/s", "ω, °/s"),
)


class Filtered(NamedTuple):
    """What a filter says at the n times of a drive, and the errors (n, 3), nan where unknown."""

    nis: Array  # (n,), nan without an estimate
    errors: Array
    covariances: Array  # (n, 3, 3)

    def cells(self) -> tuple[str, ...]:
        """The numbers of a line of the table."""
        nis = self.nis[np.isfinite(self.nis)]
        known = np.isfinite(self.errors).all(axis=1)
        errors = self.errors[known]
        nees = normalised_squares(errors, self.covariances[known])
        rmse = np.sqrt(np.mean(errors**2, axis=0)) * [1.0, 1.0, np.rad2deg(1.0)]
        return (
            f"{nis.mean() / 3.0:.2f}",
            f"{np.mean(nis >= GATE):.1%}",
            f"{nees.mean() / 3.0:.2f}",
            f"{np.mean(nees < REGION):.0%}",
            *(f"{value:.3f}" for value in rmse),
        )


def estimates(drive: Drive, budget: ErrorBudget | None) -> list[VelocityEstimate]:
    """What a tracker gives for all scans of a drive in time order."""
    mountings = {str(s): own.mounting for s, own in enumerate(drive.recordings)}
    tracker = Tracker(mountings, horizon=HORIZON, budget=budget)
    scans = [(str(s), scan) for s, own in enumerate(drive.recordings) for scan in own.scans]
    scans.sort(key=lambda entry: entry[1].time)
    found = [each for entry in scans for each in tracker.add(*entry)]
    return found + tracker.finish()


def filtered(drive: Drive, given: Sequence[VelocityEstimate], as_states: bool) -> Filtered:
    """A filter from the first accepted estimate on, judged once it has settled."""
    first = next(i for i, each in enumerate(given) if each.converged)
    given = given[first:]
    errors = slow_errors(given) if as_states else 0
    own = Filter(float(given[0].theta[0]), CAR, errors, PERSISTENCE)
    truth = drive.reference.at([each.time for each in given]).theta
    rows = []
    for each in given:
        own.predict(each.interval)
        nis = np.nan
        if as_states and each.filter_input is not None:
            nis = take(own, each.filter_input)
        elif not as_states and each.converged:
            nis = own.update(each.theta - own.state[:3], np.eye(3), each.covariance)
        rows.append((nis, own.state[:3], own.covariance[:3, :3]))
    nis, states, covariances = (np.array(column) for column in zip(*rows, strict=True))
    late = np.array([each.time for each in given]) > given[0].time + SETTLED
    return Filtered(nis[late], (states - truth)[late], covariances[late])


def lines(drive: Drive) -> Iterator[tuple[str, ...]]:
    """The lines of the table of a drive."""
    plain = estimates(drive, None)
    budgeted = estimates(drive, drive.recordings[0].budget)
    for name, given, as_states in zip(
        WAYS, (plain, budgeted, budgeted), (False, False, True), strict=True
    ):
        cells = (drive.name, name, *filtered(drive, given, as_states).cells())
        print(*cells, sep=" | ", flush=True)
        yield cells


def main() -> None:
    """Filter the drives at hand and write the table into the book's results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name in ("radarscenes", "nuscenes"):
        parser.add_argument(f"--{name}", type=Path, nargs="*", default=[])
    arguments = parser.parse_args()
    in_one_thread()
    warnings.simplefilter("ignore")
    drives = [radarscenes(*at) for at in sequences(arguments.radarscenes)]
    drives += [nuscenes(*at) for at in scenes(arguments.nuscenes)]
    if drives:
        rows = [cells for drive in drives for cells in lines(drive)]
        head = "<!-- Written by `python -m benchmarks.road_filter`. -->"
        text = f"{head}\n\n{table(HEAD, rows, 2)}\n"
        results_path("road_filter.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
