"""The errors of a track against a reference, and whether its covariances agree with them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from d2d._checks import check_instance
from d2d._frozen import Frozen
from d2d._types import Array
from d2d.bootstrap import block_bootstrap, block_length
from d2d.credibility import Credibility, credibility
from d2d.radar.scans.reference import Reference
from d2d.radar.tracks.track import Track, neighbours
from d2d.scores import Whitened, crps, whiten, within

if TYPE_CHECKING:
    from collections.abc import Callable

    from pandas import DataFrame

NAMES = ("v_x", "v_y", "omega")
_HEAD = ["v_x (m/s)", "v_y (m/s)", "omega (deg/s)", "all"]  # of the table
IN_UNITS = np.array([1.0, 1.0, np.rad2deg(1.0)])

_CLOCKS, _OFF, _PAIRS = 30.0, 0.5, 30  # s of lags that are tried, s that are too late, estimates
_ALIKE = 0.1  # share of the variance that a reference with another clock or unit leaves
_FACTORS = 0.7, 1.4  # on a reference's speed and yaw rate


class Measures(NamedTuple):
    """The measures of a comparison, or the bounds (2, ...) of their confidence intervals.

    Directions are in the order v_x, v_y, omega, nan where the reference lacks one.  Whitened are
    the errors of v_x given v_y and omega, of v_y given omega, and of omega.
    """

    mean_error: Array  # (3,) in m/s, m/s, deg/s
    rmse: Array  # (3,) in the same units
    crps: Array  # (3,) in the same units: the mean of `d2d.crps`
    whitened_squares: Array  # (3,), means; ideally 1
    anees: Array  # their mean, see `d2d.credibility`
    log_scores: Array  # (3,), whose sum is the next
    log_score: Array  # mean negative log density in m/s, m/s, rad/s, see `d2d.log_score`
    coverages: Array  # (3, 3), shares of whitened errors within the central 50, 95 and 99 %
    coverage: Array  # (3,), shares of the errors within the ellipsoids of these levels


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Frozen):
    """The errors of a track's velocities and how well its covariances describe them.

    It prints as a `table`.  A direction that the reference lacks is nan, the others are judged.
    """

    times: Array  # (n,), s, of the estimates that are compared
    errors: Array  # (n, 3), of [v_x, v_y, omega] in m/s, m/s, rad/s
    covariances: Array  # (n, 3, 3), as stated
    share: float  # of the track's estimates that are compared
    converged: float  # share of the track's estimates

    def __post_init__(self) -> None:
        for name in ("times", "errors", "covariances"):
            self._keep(name, np.array(getattr(self, name)))

    @classmethod
    def from_errors(cls, track: Track, errors: Array, covariances: Array | None = None) -> Self:
        """The comparison of a track with errors (n, 3), nan if not known, and their covariances."""
        finite = np.isfinite(errors)
        known = finite.any(axis=0)
        good = track.converged & finite[:, known].all(axis=-1) & known.any()
        return cls(
            track.times[good],
            errors[good],
            (track.covariance if covariances is None else covariances)[good],
            float(good.sum() / max(len(good), 1)),
            float(track.converged.sum() / max(len(good), 1)),
        )

    @cached_property
    def _judged(self) -> tuple[NDArray[np.int_], Array, Array]:
        """The k directions that the reference has, errors (n, k) and covariances (n, k, k)."""
        known = np.flatnonzero(np.isfinite(self.errors).all(axis=0))
        return known, self.errors.take(known, axis=1), self.covariances[:, known[:, None], known]

    @property
    def rmse(self) -> Array:
        """Root mean square error (3,) in m/s, m/s and deg/s."""
        # not from `measures`, which fail if a covariance is singular
        return np.asarray(np.sqrt(np.mean(self.errors**2, axis=0)) * IN_UNITS)

    @property
    def sigmas(self) -> Array:
        """Stated standard deviations (n, 3) in m/s, m/s and deg/s."""
        return np.asarray(np.sqrt(np.diagonal(self.covariances, axis1=-2, axis2=-1)) * IN_UNITS)

    @property
    def credibility(self) -> Credibility:
        """NEES, ANEES, NCI and I²; the region of the ANEES assumes independent errors."""
        return credibility(*self._judged[1:])

    @cached_property
    def whitened(self) -> Whitened:
        """The whitened errors of the k directions that the reference has, see `Measures`."""
        known, errors, covariances = self._judged
        return whiten(errors, covariances, range(len(known))[::-1])

    @cached_property
    def measures(self) -> Measures:
        """All measures: means over the estimates, or roots of means."""
        return self._measures(partial(np.mean, axis=0))

    @cached_property
    def block(self) -> int:
        """Length of the bootstrap's blocks: the longest that the errors or the NEES need."""
        squares = (self.whitened.values**2).sum(axis=-1)
        return block_length(np.column_stack([self._judged[1], squares]))

    def intervals(self, confidence: float = 0.95) -> Measures:
        """Lower and upper bounds of all measures, by `d2d.block_bootstrap` with a fixed seed."""

        def bounds(terms: Array) -> Array:
            data, rng = [terms], np.random.default_rng(0)
            options: Any = {"confidence": confidence, "vectorized": True}
            return block_bootstrap(np.mean, data, self.block, rng, **options)

        return self._measures(bounds)

    def _measures(self, mean: Callable[[Array], Any]) -> Measures:
        """The measures, from means over the first axis of terms, or from bounds of such means."""
        white, (known, errors, covariances) = self.whitened, self._judged
        squares, logs = white.values**2, white.log_score

        def placed(terms: Array) -> Array:
            """Means of terms (n, ..., k) in the known directions, nan in the others."""
            found = mean(terms)
            whole = np.full((*found.shape[:-1], 3), np.nan)
            whole[..., known] = found
            return whole

        return Measures(
            mean_error=placed(errors) * IN_UNITS,
            rmse=np.sqrt(placed(errors**2)) * IN_UNITS,
            crps=placed(crps(errors * IN_UNITS[known], self.sigmas[:, known])),
            whitened_squares=placed(squares),
            anees=mean(squares.mean(axis=-1)),
            log_scores=placed(logs),
            log_score=mean(logs.sum(axis=-1)),
            coverages=np.swapaxes(placed(white.within().swapaxes(1, 2)), -1, -2),
            coverage=mean(within(errors, covariances)),
        )

    @property
    def table(self) -> DataFrame:
        """All measures as text, with their 95 % intervals below them; pandas must be installed."""
        import pandas

        def texts(form: str, *numbers: Array) -> list[str]:
            rows = zip(*numbers, strict=True)
            return [form.format(*row) if np.isfinite(row).all() else "" for row in rows]

        intervals = self.intervals()
        rows: list[tuple[str, ...]] = []
        for label, form, pick in _ROWS:
            rows.append((label, *texts(form, pick(self.measures))))
            rows.append(("", *texts(f"[{form},{form}]", *pick(intervals))))
        stated = np.sqrt(np.mean(self.sigmas**2, axis=0))
        rows.insert(4, ("stated sigma", *texts("{:.3f}", stated), ""))
        return pandas.DataFrame([row[1:] for row in rows], [row[0] for row in rows], _HEAD)

    def __repr__(self) -> str:
        low, high = self.credibility.bounds
        lines = [
            f"{len(self.times)} estimates compared, {self.share:.1%} of the track; "
            f"{self.converged:.1%} converged",
            "",
            *map(str.rstrip, self.table.to_string().splitlines()),
            "",
            f"ANEES {self.credibility.anees:.2f} (credible if independent: {low:.2f} to {high:.2f})"
            f", NCI {self.credibility.nci:.1f} dB, I2 {self.credibility.inclination:+.1f} dB.",
            "Whitened squares (ideally 1; all: ANEES), -log density (m/s, rad/s) and shares",
            "are of omega, of v_y given omega, of v_x given both, and of all three together.",
            f"[95 % intervals] from blocks of {self.block} estimates.",
        ]
        return "\n".join(lines)


def _row(directions: Array, together: ArrayLike = np.nan) -> Array:
    """Values (..., 3) of the three directions and (...) of all together, as (..., 4)."""
    beside = np.broadcast_to(np.asarray(together)[..., None], (*directions.shape[:-1], 1))
    return np.concatenate([directions, beside], axis=-1)


# The rows of the table: a label, the form of its numbers, and what they are.
_ROWS: list[tuple[str, str, Callable[[Measures], Array]]] = [
    ("RMSE", "{:.3f}", lambda m: _row(m.rmse)),
    ("mean error", "{:+.3f}", lambda m: _row(m.mean_error)),
    ("CRPS", "{:.3f}", lambda m: _row(m.crps)),
    ("whitened square", "{:.2f}", lambda m: _row(m.whitened_squares, m.anees)),
    ("-log density", "{:.2f}", lambda m: _row(m.log_scores, m.log_score)),
    ("within 50%", "{:.1%}", lambda m: _row(m.coverages[..., 0], m.coverage[..., 0])),
    ("within 95%", "{:.1%}", lambda m: _row(m.coverages[..., 1], m.coverage[..., 1])),
    ("within 99%", "{:.1%}", lambda m: _row(m.coverages[..., 2], m.coverage[..., 2])),
]


def compare(track: Track, reference: Reference) -> Comparison:
    """Compare the velocities of a track with a reference.

    Errors are estimate minus reference.  The reference is the truth of a simulation
    (``drive.truth``) or the measurement of another sensor (``recording.reference``), whose own
    errors are included.  Without one, see `compare_tracks` and `compare_halves`.

    It is interpolated linearly.  Estimates that did not converge, outside its time span, or where
    it is nan, are left out, and directions in which it is nan at all times are not compared.
    Raises a ``ValueError`` if fewer than four estimates are left, as with clocks that differ.

    Examples
    --------
    >>> import numpy as np
    >>> from d2d.radar import compare, simulate_drive, track
    >>> drive = simulate_drive(np.random.default_rng(0), duration=4.0)
    >>> found = compare(track(drive), drive.truth)
    >>> found.errors.shape, bool(found.rmse[0] < 0.05)
    ((40, 3), True)
    """
    check_instance("track", track, Track)
    check_instance("reference", reference, Reference)
    errors = track.theta - reference.at(track.times).theta
    return enough(Comparison.from_errors(track, errors), "track and reference have")


def check_reference(track: Track, reference: Reference) -> None:
    """Raise a ValueError if a reference has surely another clock, unit or sign than the track."""
    times, theta = track.times[track.converged], track.theta[track.converged]

    def both(axis: int, lag: float = 0.0) -> tuple[Array, Array]:
        """A velocity of the reference some time later, and the track's."""
        theirs = reference.at(times + lag).theta[:, axis]
        known = np.isfinite(theirs)
        return theirs[known], theta[known, axis]

    def unexplained(lag: float) -> float:
        """The share of a velocity's variance that a rising linear function of the other leaves."""
        theirs, own = both(axis, lag)
        if len(own) <= _PAIRS or not (np.ptp(own) and np.ptp(theirs)):
            return 1.0
        return 1.0 - max(float(np.corrcoef(theirs, own)[0, 1]), 0.0) ** 2

    for axis, name, hint in ((0, "speed", "km/h"), (2, "yaw rate", "deg/s, or clockwise")):
        theirs, own = both(axis)
        slope = float(theirs @ own) / max(float(theirs @ theirs), 1e-12)
        agreed = 1.0 - float(((own - slope * theirs) ** 2).sum() / (own @ own + 1e-12))
        if agreed > 1.0 - _ALIKE and not _FACTORS[0] < slope < _FACTORS[1] and len(own) > _PAIRS:
            raise ValueError(
                f"reference must have the track's {name}, but would have to be multiplied by "
                f"{slope:.3f}; is it in {hint}?"
            )
    axis, whose = (0, "speeds") if len(both(0)[0]) else (2, "yaw rates")
    span = min(0.5 * float(np.ptp(times)), _CLOCKS) if len(both(axis)[0]) > _PAIRS else 0.0
    rest, lag = min((unexplained(lag), lag) for lag in np.arange(-span, span + 0.1, 0.1).tolist())
    if rest < _ALIKE and unexplained(0.0) > 4.0 * rest and abs(lag) > _OFF:
        raise ValueError(
            f"reference must have the track's clock, but its {whose} are those of {lag:+.1f} s "
            "later"
        )


def enough(found: Comparison, whose: str) -> Comparison:
    """The comparison itself; a ``ValueError`` if it holds too few estimates to judge."""
    if len(found.times) < 4:
        raise ValueError(
            f"{whose} {len(found.times)} converged estimates at common times, but at least 4 are "
            "needed; are their clocks the same?"
        )
    return found


def compare_tracks(first: Track, second: Track) -> Comparison:
    """Compare two tracks of the same vehicle, from sensors that have no measurement in common.

    ``errors`` are first minus second, at the times of ``first``, and ``covariances`` the sums of
    both.  ``second`` is interpolated linearly, unless its estimates are more than twice the usual
    interval apart, with the covariance (1 − w)² Σᵢ + w² Σⱼ of independent errors.
    Raises a ``ValueError`` if fewer than four estimates can be compared, as with clocks that
    differ.
    """
    check_instance("first", first, Track)
    check_instance("second", second, Track)
    errors = first.theta - second.at(first.times).theta
    before, after, weight, _ = neighbours(second, first.times)
    late = weight[:, np.newaxis, np.newaxis]
    earlier, later = second.covariance[before], second.covariance[after]
    covariances = first.covariance + ((1.0 - late) ** 2 * earlier + late**2 * later)
    return enough(Comparison.from_errors(first, errors, covariances), "first and second have")
