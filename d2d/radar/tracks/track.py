"""The motion along a drive, as `d2d.radar.track` gives it."""

from __future__ import annotations

import csv
import io
import os
import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from d2d import rigid
from d2d._checks import check_finite, check_path, check_real, check_shape, is_masked
from d2d._frozen import Frozen
from d2d._types import Array
from d2d.radar.files import atomic_write, reading
from d2d.radar.tracks.filter import MEMORY
from d2d.radar.tracks.path import ROUNDED, Displacement, Knots, chain, independent
from d2d.radar.tracks.plot import draw
from d2d.radar.tracks.support import Support, support_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

_REQUIRED = ("times", "intervals", "theta", "covariance", "converged")
_OPTIONAL = ("reasons", "targets", "inliers", "errors")
_TYPES = {"converged": np.bool_, "reasons": np.str_, "targets": np.int64}  # others are floats
# shapes of a row, if it is not a number
_ROW_SHAPES: dict[str, tuple[int, ...]] = {"theta": (3,), "covariance": (3, 3)}
# s, and relative to the time since the first estimate: stamps in logs are often rounded
_STAMP, _DRIFT = 0.01, 1e-5
_ROUNDING = 1e-6  # of covariances, relative to their standard deviations
_SHOWN_REASONS = 3
# A number in a reason, but not the exponent of a unit such as m/s^2.
NUMBER = re.compile(r"(?<![\^\w.])-?\d+(\.\d+)?")
_FORMAT = "d2d.radar.Track 2"  # of npz files
# The columns of a table; the last six are the upper triangle of the covariance.
_COLUMNS = (
    *("time", "interval", "v_x", "v_y", "omega", "converged", "var_v_x", "cov_v_x_v_y"),
    *("cov_v_x_omega", "var_v_y", "cov_v_y_omega", "var_omega"),
)


class Velocities(NamedTuple):
    """Velocities (m, 3) [v_x, v_y, omega] in m/s, m/s, rad/s at times (m,) in s.

    They and their covariances (m, 3, 3) are nan where not known.
    """

    times: Array
    theta: Array
    covariance: Array


@dataclass(frozen=True, eq=False)
class Track(Frozen):
    """The motion along a drive, one row for each scan (or round of scans) after the first.

    Its arrays are read-only; `dataclasses.replace` makes another one.  Where the clock of the
    sensors steps back, the time that has passed is not known: the interval is nan, a new one of the
    ``segments`` begins, and the path goes on from the pose before.  Only within a segment are times
    in order; `at`, `displacement` and `write_tum` need a track of one.  Raises a ``ValueError`` if
    shapes or types do not match, or fields contradict each other.

    Attributes
    ----------
    times : (n,) array, s
        Time of each current scan; with several sensors, the mean time of a round of them.
    intervals : (n,) array, s
        Time since the scan before; they add up to the differences of ``times``, to within 10 ms,
        and are nan where the clock steps back.
    theta : (n, 3) array
        Velocity [v_x, v_y, omega] in m/s, m/s, rad/s.  Where not converged, it is what may have
        become of the last converged one (of bare pairs, that one itself) or, before any has
        converged, the initial velocity or zero.
    covariance : (n, 3, 3) array
        Of ``theta``; nan where not converged.  Of bare pairs, the inverse Hessian.
    converged : (n,) array of bool
        Whether an optimum was found and accepted.
    reasons : (n,) array of str
        Why an estimate was not accepted; empty where it was.  This and the following are None if
        not known.
    targets : (n,) array of int
        Number of targets of the current scans.
    inliers : (n,) array
        Mean inlier probability of these targets; nan where there was nothing to estimate.
    errors : (n, 2, 6, 6 + k) array, or (n, 2, 7, 7 + k) with a gyro
        Of a filtered track, the errors of the state [v, a, b], velocity, acceleration and bias of
        the gyro, and of the k slow errors of the budget: the matrix by which they become the
        state's from one row to the next, and their covariance with the state.  Where an estimate
        was not accepted, it is that of a guess; the next accepted one refers to the last accepted.
    """

    times: Array
    intervals: Array
    theta: Array
    covariance: Array
    converged: NDArray[np.bool_]
    reasons: NDArray[np.str_] | None = None
    targets: NDArray[np.int64] | None = None
    inliers: Array | None = None
    errors: Array | None = None

    def __post_init__(self) -> None:
        count = np.size(self.times)
        for name in (*_REQUIRED, *_OPTIONAL):
            if getattr(self, name) is not None:
                self._keep(name, _rows(name, getattr(self, name), count))
        good = self.converged
        _check_times(self.times, self.intervals, good)
        for name in ("theta", "covariance"):
            if not np.isfinite(getattr(self, name)[good]).all():
                raise ValueError(f"{name} must be finite wherever converged is true")
        _check_covariances(self.covariance[good])
        if self.reasons is not None and ((self.reasons == "") != good).any():
            raise ValueError("reasons must be empty where converged is true, and only there")
        if self.targets is not None and (self.targets < 0).any():
            raise ValueError("targets must not be negative")
        if self.inliers is not None and ((self.inliers < 0.0) | (self.inliers > 1.0)).any():
            raise ValueError("inliers must be between 0 and 1, or nan")

    def __getitem__(self, rows: slice) -> Track:
        """The part of the track with these rows, which follow each other: ``track[100:200]``."""
        given: object = rows
        if not isinstance(given, slice) or given.step not in (None, 1):
            raise ValueError(f"a track must be sliced with a step of 1, but by {rows!r}")
        return replace(self, **{name: values[rows] for name, values in self._known().items()})

    def _known(self) -> dict[str, NDArray[Any]]:
        """The fields that are known, by their names."""
        fields = {name: getattr(self, name) for name in (*_REQUIRED, *_OPTIONAL)}
        return {name: values for name, values in fields.items() if values is not None}

    def __len__(self) -> int:
        """The number of estimates."""
        return len(self.times)

    @property
    def segments(self) -> list[Track]:
        """The parts of the track between which the clock steps back; mostly one, the whole.

        The rows at the steps, for which nothing can be estimated, are in none of them.
        """
        return [self[rows] for rows in self._segments()]

    def _segments(self) -> list[slice]:
        steps = np.flatnonzero(np.isnan(self.intervals)).tolist()
        spans = zip([0, *(step + 1 for step in steps)], [*steps, len(self)], strict=True)
        return [slice(*span) for span in spans if span[0] < span[1]]

    def poses(self, start: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
        """The path driven: (n + 1, 3) poses [x, y, yaw] in m, m, rad, beginning at ``start``.

        The first pose is an interval before the first estimate, the others are at ``times``.  The
        velocity is linear between accepted estimates, also over those that were not, and in the
        first interval; after the last one it is constant.
        """
        first = check_finite("start", start, "(3,)")
        twists = np.zeros((len(self), 3))
        for rows in self._segments():
            part = self[rows]
            nodes = np.append(part.times[0] - part.intervals[0], part.times)
            twists[rows] = part._knots().motions(nodes[:-1], nodes[1:])
        return chain(rigid.exponential(twists), first)

    def at(self, times: ArrayLike) -> Velocities:
        """The velocities at other times (m,) in s, by linear interpolation.

        They are nan outside the track's time span, next to an estimate that failed, and in gaps of
        more than twice the usual interval.  The covariance, linear too, bounds the interpolated
        error, however those of the two neighbours are correlated, but does not contain a change of
        the velocity between their times.  Raises a ``ValueError`` if the track is empty, or its
        clock steps back.
        """
        wanted = check_finite("times", times, "(m,)")
        before, after, weight, known = neighbours(self, wanted)
        theta, covariance = (
            np.where(known, (1.0 - weight) * each[before].T + weight * each[after].T, np.nan).T
            for each in (self.theta, self.covariance)
        )
        return Velocities(wanted, theta, covariance)

    def displacement(self, start: ArrayLike, end: ArrayLike) -> Displacement:
        """The motion of the vehicle from ``start`` to ``end`` (n,) in s, and its covariance.

        The covariances (n, 3, 3) follow from the ``errors`` of the filter: noise averages out, and
        errors that the budget states add up.  Of bare pairs, the errors are taken as independent,
        which states far too little over more than a second.  Motions and covariances are nan
        outside the track, and over more than two seconds without a scan.

        Examples
        --------
        >>> import numpy as np
        >>> from d2d.radar import ErrorBudget, simulate_drive, track
        >>> drive = simulate_drive(np.random.default_rng(0), duration=4.0)
        >>> driven = track(drive, budget=ErrorBudget(azimuth=np.deg2rad(0.2)))
        >>> ahead = driven.displacement([1.0, 1.0], [2.0, 3.0])
        >>> ahead.motion[:, 0].round(1)  # at 3.1 m/s
        array([3.1, 6.2])
        """
        _check_one_segment(self)
        begins = check_finite("start", start, "(n,)")
        ends = check_finite("end", end, str(begins.shape), like="start")
        if not (begins < ends).all():
            i = int(np.argmin(begins < ends))
            raise ValueError(
                f"end must be after start, but number {i} is {ends[i]:g} s and {begins[i]:g} s"
            )
        motion, covariance = np.full((len(begins), 3), np.nan), np.full((len(begins), 3, 3), np.nan)
        if len(self):
            knots = self._knots()
            for own in np.unique(begins):
                same = np.flatnonzero(begins == own)
                motion[same], covariance[same] = knots.displacement(float(own), ends[same])
        return Displacement(motion, covariance)

    def _knots(self) -> Knots:
        """The knots of the path; without an accepted estimate, the first velocity alone."""
        times, converged = self.times, self.converged
        errors = independent(self.covariance) if self.errors is None else self.errors
        begin, accepted = times[0] - self.intervals[0], times[converged]
        if not len(accepted):
            return Knots(np.array([begin]), self.theta[:1], errors[:1])
        after = np.searchsorted(accepted, times)
        ends = np.append(accepted, times[-1])[after]
        lost = ends - accepted[np.maximum(after - 1, 0)] > MEMORY
        used = converged | (lost & (times > accepted[0]))
        known, values = times[used], self.theta[used]
        begin = max(begin, known[0] - MEMORY)
        reach = float(known[0] - begin)
        later = min(int(np.searchsorted(known, known[0] + reach)), len(known) - 1)
        ratio = reach / float(known[later] - known[0]) if later else 0.0
        first = values[0] - ratio * (values[later] - values[0])
        errors = errors[used]
        errors[0, 0] = np.eye(*errors.shape[2:])  # the first two have one error
        errors = np.concatenate([errors[:1], errors])
        return Knots(np.append(begin, known), np.vstack([first, values]), errors)

    @property
    def guessed(self) -> NDArray[np.bool_]:
        """Mask (n,) of the poses in stretches without estimates; see `support`."""
        found = np.zeros(len(self), dtype=np.bool_)
        for begin, end in self.support.guessed:
            found |= (self.times > begin) & (self.times <= end)
        return found & ~self.converged

    @property
    def support(self) -> Support:
        """The share of the time with estimates in a row, and the stretches that are guessed."""
        return support_of(self.times, self.intervals, self.converged)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write all of the track to a file, from which `load` gives the same numbers bit by bit.

        A leading ``~`` of the path stands for the home folder.  An existing file is replaced once
        all is written.  Raises an ``OSError`` if that is not possible.
        """
        with atomic_write(check_path("path", path)) as file:
            np.savez_compressed(file, allow_pickle=False, format=np.array(_FORMAT), **self._known())

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Track:
        """The track that `save` wrote; a ``ValueError`` names a file that is not a complete one."""
        source = check_path("path", path)
        with (
            reading(source, "a complete file of Track.save"),
            source.open("rb") as raw,
            np.load(raw, allow_pickle=False) as file,
        ):
            fields: dict[str, Any] = {**file}
            if (mark := str(fields.pop("format"))) != _FORMAT:
                raise ValueError(f"it has the format {mark!r}, and this version reads {_FORMAT!r}")
            missing, other = {*_REQUIRED} - fields.keys(), fields.keys() - {*_REQUIRED, *_OPTIONAL}
            if missing or other:
                raise ValueError(f"it lacks {sorted(missing)}, and also holds {sorted(other)}")
            return cls(**fields)

    def write_tum(self, path: str | os.PathLike[str], start: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """Write the poses as a TUM trajectory file, one line "t x y z qx qy qz qw" per pose.

        `evo` and other tools read this format.  ``start`` is as for `poses`, ``path`` as for
        `save`.  Raises a ``ValueError`` if the track is empty, or its clock steps back.
        """
        poses = self.poses(start)
        _check_one_segment(self, empty=False)
        times = np.append(self.times[0] - self.intervals[0], self.times)
        x, y, yaw = poses.T
        zero = np.zeros_like(x)
        columns = [times, x, y, zero, zero, zero, np.sin(0.5 * yaw), np.cos(0.5 * yaw)]
        with atomic_write(check_path("path", path)) as file:
            np.savetxt(file, np.column_stack(columns), "%.9f")

    def write_velocities(self, path: str | os.PathLike[str]) -> None:
        """Write all of the track as a table in a CSV file, which pandas and spreadsheets read.

        The first line names the columns, those of `to_dataframe`: time and interval (s), v_x, v_y
        (m/s) and omega (rad/s), whether the estimate was ``converged`` and its pose is ``guessed``,
        the variances and covariances (var_v_x, cov_v_x_v_y, ...), and reasons, targets and inliers
        where known.  Where an estimate was not accepted, its (co)variances are ``nan`` and the
        velocity is the last one that was, or a guess.  The velocities are filtered: to another
        filter, give `FilterInput` instead.  The path is as for `save`.
        """
        columns = self._columns()
        with atomic_write(check_path("path", path)) as raw:
            file = io.TextIOWrapper(raw, encoding="utf-8", newline="")
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(columns)
            writer.writerows(zip(*(column.tolist() for column in columns.values()), strict=True))
            file.detach()

    def to_dataframe(self) -> DataFrame:
        """The estimates as a pandas table, one row for each; pandas must be installed.

        `write_velocities` says what its columns are.
        """
        import pandas

        return pandas.DataFrame(self._columns())

    def _columns(self) -> dict[str, NDArray[Any]]:
        """The columns (n,) of a table by their names."""
        entries = self.covariance[:, *np.triu_indices(3)].T
        columns = self.times, self.intervals, *self.theta.T, self.converged, *entries
        known = {n: v for n, v in self._known().items() if n in ("reasons", "targets", "inliers")}
        return dict(zip(_COLUMNS, columns, strict=True)) | {"guessed": self.guessed} | known

    def plot(self) -> Figure:
        """Draw the path, the velocities in a band of 3 sigma, the inlier share and the failures.

        With a budget, ellipses along the path hold the position, as seen from the start, with a
        probability of 95 % (`displacement`).  An inlier share that is not known is left out.
        Matplotlib must be installed.
        """
        return draw(self)

    def __repr__(self) -> str:
        """Number of estimates and share of those accepted; the arrays would fill the screen."""
        count = len(self.times)
        share = float(np.mean(self.converged)) if count else 0.0
        span = f" from {self.times[0]:.3f} s to {self.times[-1]:.3f} s" if count else ""
        return f"Track({count} estimates{span}, {share:.1%} converged)"

    def __str__(self) -> str:
        """Summary with the most frequent reasons of failure, and a first word if it is a guess."""
        if self.reasons is None:
            return repr(self)
        alike: dict[str, list[list[str]]] = {}  # the numbers of each reason, by its kind
        for reason in filter(None, self.reasons.tolist()):
            numbers = [found[0] for found in NUMBER.finditer(reason)]
            alike.setdefault(NUMBER.sub("...", reason), []).append(numbers)
        often = sorted(alike.items(), key=lambda entry: -len(entry[1]))[:_SHOWN_REASONS]
        lines = []
        for kind, rows in often:
            for column in zip(*rows, strict=True):
                ends = dict.fromkeys((min(column, key=float), max(column, key=float)))
                kind = kind.replace("...", " to ".join(ends), 1)
            lines.append(f"  {len(rows)} failed: {kind}")
        other = len(self) - int(self.converged.sum()) - sum(len(rows) for _, rows in often)
        lines += [f"  {other} failed otherwise"] * (other > 0)
        support = self.support
        first = [f"NOT SUPPORTED: {support}"] * (not support.enough)
        return "\n".join([*first, repr(self), *lines])


def _rows(name: str, value: Any, count: int) -> NDArray[Any]:
    """A copy of a field as an array of its type, with as many rows as the track has."""
    kind = _TYPES.get(name)
    array = check_real(name, value) if kind is None or is_masked(value) else np.array(value)
    if kind is not None and array.dtype.kind != np.dtype(kind).kind:
        raise ValueError(f"{name} must be an array of {kind.__name__}, but is of {array.dtype}")
    shape = (count, *_ROW_SHAPES.get(name, ()))
    if name == "errors":  # of any number of slow errors
        size = 7 if array.shape[2:3] == (7,) else 6
        shape = (count, 2, size, max((size, *array.shape[3:4])))
    check_shape(name, array, str(shape))
    return array


def _check_times(times: Array, intervals: Array, converged: NDArray[np.bool_]) -> None:
    step = np.isnan(intervals)
    if not (intervals[~step] > 0.0).all() or np.isinf(intervals).any() or converged[step].any():
        raise ValueError(
            "intervals must be finite and positive, or nan where the clock steps back and nothing "
            "is estimated"
        )
    passed = np.where(step[1:], 1.0, np.diff(times))
    if not (np.isfinite(times).all() and (passed > 0.0).all()):
        raise ValueError("times must be finite and strictly increasing")
    passed, added = (np.cumsum(np.where(step[1:], 0.0, each)) for each in (passed, intervals[1:]))
    wrong = np.abs(added - passed) > _STAMP + _DRIFT * passed
    if wrong.any():
        i = int(np.argmax(wrong))
        raise ValueError(
            f"intervals must add up to the differences of times, but from the first estimate to "
            f"number {i + 1} they add up to {added[i]:g} s where {passed[i]:g} s pass"
        )


def _check_one_segment(track: Track, empty: bool = True) -> None:
    if not (empty or len(track)):
        raise ValueError("the track must hold at least one estimate, but is empty")
    step = np.flatnonzero(np.isnan(track.intervals))
    if len(step):
        raise ValueError(
            f"the track must have one segment, but its clock steps back to {track.times[step[0]]:g}"
            f" s at estimate {step[0]}: take one of its segments"
        )


def _check_covariances(stated: Array) -> None:
    """Raise a ValueError unless matrices (m, 3, 3) are covariances."""
    sigmas = np.sqrt(np.clip(np.diagonal(stated, axis1=1, axis2=2), 0.0, None))
    scale = sigmas[:, :, None] * sigmas[:, None, :]
    if (np.abs(stated - stated.swapaxes(1, 2)) > _ROUNDING * scale).any():
        raise ValueError("covariance must be symmetric wherever converged is true")
    correlations = stated / np.maximum(scale, 1e-100)
    if (np.linalg.eigvalsh(correlations)[:, 0] < -_ROUNDING).any():
        raise ValueError("covariance must be positive semidefinite wherever converged is true")


def neighbours(
    track: Track, times: Array
) -> tuple[NDArray[np.intp], NDArray[np.intp], Array, NDArray[np.bool_]]:
    """The estimates of a track before and after each of ``times`` (m,), for linear interpolation.

    With these two (m,) come the weight of the second, and whether both were accepted and are not
    too far apart.  Both are the same where an estimate is at the time itself.
    """
    _check_one_segment(track, empty=False)
    last = len(track.times) - 1
    after = np.clip(np.searchsorted(track.times, times), 0, last)
    before = np.maximum(after - (track.times[after] != times), 0)  # the same at equal times
    gap = track.times[after] - track.times[before]
    distance = times - track.times[before]
    weight = np.divide(distance, gap, out=np.zeros_like(distance), where=gap > 0.0)
    inside = (track.times[before] <= times) & (times <= track.times[after])
    near = gap <= 2.0 * np.median(track.intervals) + ROUNDED
    good = track.converged[before] & track.converged[after]
    return before, after, weight, inside & near & good
