"""A Kalman filter fed by radars on real drives, and whether it is as certain as it may be.

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

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from d2d._types import Array
from d2d.radar import ErrorBudget, Tracker, VelocityEstimate
from d2d.radar.tracks.acceleration import JERK, UNKNOWN
from d2d.radar.tracks.path import PERSISTENCE
from d2d.scores import normalised_squares
from d2d.study.drives.fusion import (
    FILTERS,
    GATE,
    REGION,
    SETTLED,
    Filter,
    Motion,
    slow_errors,
    take,
)
from d2d.study.road.drive import HORIZON, Drive, Source
from d2d.study.road.markdown import markdown, write_page

# The vehicle of `track`: of random walks, whose accelerations are as usual after a long time.
CAR = Motion(np.sqrt(np.diag(UNKNOWN)), 2.0 * np.diag(UNKNOWN) / np.diag(JERK))
HEAD = (
    *("drive", "filter", "NIS", "beyond", "NEES", "inside"),
    *("v_x, m/s", "v_y, m/s", "ω, °/s"),
)


class Filtered(NamedTuple):
    """Output of a filter at the n times of a drive, and its errors (n, 3), nan where unknown."""

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
    """The estimates of a tracker that is given all scans of a drive in time order."""
    mountings = {str(s): own.mounting for s, own in enumerate(drive.recordings)}
    tracker = Tracker(mountings, horizon=HORIZON, carry=budget is not None, budget=budget)
    found = [each for entry in drive.in_time_order() for each in tracker.add(*entry)]
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
    squares, states, covariances = (np.array(column) for column in zip(*rows, strict=True))
    late = np.array([each.time for each in given]) > given[0].time + SETTLED
    return Filtered(squares[late], (states - truth)[late], covariances[late])


def lines(drive: Drive) -> Iterator[tuple[str, ...]]:
    """The lines of the table of a drive."""
    plain, budgeted = (estimates(drive, budget) for budget in (None, drive.budget))
    for name, given in zip(FILTERS, (plain, budgeted, budgeted), strict=True):
        as_states = name == FILTERS[-1]
        yield drive.title, name, *filtered(drive, given, as_states).cells()


def write(sources: Mapping[str, Sequence[Source]]) -> None:
    """Filter the drives at hand and write the table into the book's results."""
    listed = [source for drives in sources.values() for source in drives]
    rows = [cells for source in listed for cells in lines(source.load())]
    write_page("road_filter.md", "d2d.study.road fusion", [markdown(HEAD, rows, 2)])
