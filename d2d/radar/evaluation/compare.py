"""The errors of a track against a reference, and whether its covariances agree with them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
import scipy
from numpy.typing import NDArray

from d2d._checks import check_instance
from d2d._frozen import Frozen
from d2d._types import Array
from d2d.bootstrap import block_bootstrap, block_length
from d2d.credibility import Credibility, credibility
from d2d.radar.scans.reference import Reference
from d2d.radar.tracks.plot import COLOR, MARKER, REFERENCE
from d2d.radar.tracks.track import Track
from d2d.scores import Whitened, crps, whiten, within

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.figure import Figure
    from pandas import DataFrame

NAMES = ("v_x", "v_y", "omega")
UNITS = ("m/s", "m/s", "deg/s")
HEAD = [*map("{} ({})".format, NAMES, UNITS), "all"]  # of the table
IN_UNITS = np.array([1.0, 1.0, np.rad2deg(1.0)])

_CLOCKS, _OFF, _PAIRS = 30.0, 0.5, 30  # s of lags that are tried, s that are too late, estimates
_ALIKE = 0.1  # share of the variance that a reference with another clock or unit leaves
_FACTORS = 0.7, 1.4  # on a reference's speed and yaw rate


class Measures(NamedTuple):
    """The measures of a comparison, or the bounds of their confidence intervals.

    Directions are in the order v_x, v_y, omega, nan where the reference lacks one.  Bounds have a
    leading axis: lower, upper.

    ``mean_error``, ``rmse`` and ``crps`` (3,) are the mean, the root mean square and the continuous
    ranked probability score (`d2d.crps`) of the errors, in m/s, m/s, deg/s.

    ``whitened_squares`` (3,) are the mean squares of the whitened errors, v_x given v_y and omega,
    v_y given omega, and omega; ideally 1, and ``anees`` is their mean (`d2d.credibility`).
    ``log_score`` is the mean negative log density of the errors, in m/s, m/s, rad/s
    (`d2d.log_score`), and ``log_scores`` (3,) are the parts of the three.  ``coverages`` (3, 3) are
    the shares of the whitened errors, directions by levels, within the central 50, 95 and 99 %;
    ``coverage`` (3,) those of the errors within the ellipsoids.
    """

    mean_error: Array
    rmse: Array
    crps: Array
    whitened_squares: Array
    anees: Array
    log_scores: Array
    log_score: Array
    coverages: Array
    coverage: Array


@dataclass(frozen=True, eq=False)
class Comparison(Frozen):
    """The errors of a track's velocities and how well its covariances describe them.

    It prints as a `table`, also in a notebook.  The estimates that are compared are at ``times``
    (n,) in s.  ``errors`` (n, 3) are those of [v_x, v_y, omega] in m/s, m/s, rad/s, with the stated
    ``covariances`` (n, 3, 3).  A direction that the reference lacks is nan, and the others are
    judged.  ``share`` and ``converged`` are the shares of the track's estimates that are compared,
    and that converged.
    """

    times: Array
    errors: Array
    covariances: Array
    share: float
    converged: float

    def __post_init__(self) -> None:
        for name in ("times", "errors", "covariances"):
            self._keep(name, np.array(getattr(self, name)))

    @classmethod
    def from_errors(cls, track: Track, errors: Array, covariances: Array | None = None) -> Self:
        """The comparison of a track whose errors (n, 3) are known; nan where they are not.

        The covariances (n, 3, 3) of the errors are by default those of the track.
        """
        finite = np.isfinite(errors)
        known = finite.any(axis=0)
        good = track.converged & finite[:, known].all(axis=-1) & known.any()
        return cls(
            track.times[good],
            errors[good],
            (track.covariance if covariances is None else covariances)[good],
            float(good.mean()),
            float(track.converged.mean()),
        )

    @cached_property
    def _known(self) -> NDArray[np.int_]:
        """The k directions that the reference has."""
        return np.flatnonzero(np.isfinite(self.errors).all(axis=0))

    @cached_property
    def _judged(self) -> tuple[Array, Array]:
        """Errors (n, k) in these directions, and their covariances (n, k, k)."""
        known = self._known
        return self.errors.take(known, axis=1), self.covariances[:, known[:, None], known]

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
        """NEES, ANEES, NCI and I^2 of the covariances, given the errors.

        The region of the ANEES assumes independent errors, which a track seldom has.
        """
        return credibility(*self._judged)

    @cached_property
    def whitened(self) -> Whitened:
        """The whitened errors of omega, of v_y given omega, and of v_x given both.

        Without columns for directions that the reference lacks.
        """
        return whiten(*self._judged, range(len(self._known))[::-1])

    @cached_property
    def measures(self) -> Measures:
        """All measures: means over the estimates, or roots of means."""
        return self._measures(partial(np.mean, axis=0))

    @cached_property
    def block(self) -> int:
        """Length of the bootstrap's blocks: the longest that the errors or the NEES need."""
        squares = (self.whitened.values**2).sum(axis=-1)
        return block_length(np.column_stack([self._judged[0], squares]))

    def intervals(self, confidence: float = 0.95) -> Measures:
        """Lower and upper bounds of all measures, by the block bootstrap `d2d.block_bootstrap`.

        As many successive estimates are drawn together as `d2d.block_length` says, which cannot
        know of errors that change more slowly than the drive is long.  The seed is fixed, so that a
        comparison always prints the same.
        """

        def bounds(terms: Array) -> Array:
            mean, rng = partial(np.mean, axis=0), np.random.default_rng(0)
            return block_bootstrap(mean, [terms], self.block, rng, confidence=confidence)

        return self._measures(bounds)

    def _measures(self, mean: Callable[[Array], Any]) -> Measures:
        """The measures, from means over the first axis of terms, or from bounds of such means."""
        white, (errors, covariances) = self.whitened, self._judged
        squares, logs, units = white.values**2, white.log_score, IN_UNITS[self._known]

        def placed(terms: Array) -> Array:
            """Means of terms (n, k, ...) in the known directions, nan in the others."""
            found, axis = mean(terms), 1 - terms.ndim
            whole = np.full_like(found, np.nan, shape=(3, *np.moveaxis(found, axis, 0).shape[1:]))
            whole[self._known] = np.moveaxis(found, axis, 0)
            return np.moveaxis(whole, 0, axis)

        return Measures(
            mean_error=placed(errors) * IN_UNITS,
            rmse=np.sqrt(placed(errors**2)) * IN_UNITS,
            crps=placed(crps(errors * units, self.sigmas[:, self._known])),
            whitened_squares=placed(squares),
            anees=mean(squares.mean(axis=-1)),
            log_scores=placed(logs),
            log_score=mean(logs.sum(axis=-1)),
            coverages=placed(white.within()),
            coverage=mean(within(errors, covariances)),
        )

    @property
    def table(self) -> DataFrame:
        """All measures as text, with their 95 % intervals below them, as a data frame of pandas."""
        try:
            import pandas as pd
        except ModuleNotFoundError:
            raise ModuleNotFoundError(
                "a comparison prints by pandas, which is not installed: pip install pandas"
            ) from None
        intervals = self.intervals()
        rows: list[tuple[str, ...]] = []
        for label, form, pick in _ROWS:
            values, bounds = pick(self.measures), pick(intervals)
            texts = [form.format(value) if np.isfinite(value) else "" for value in values]
            ranges = [
                f"[{form}, {form}]".format(*pair) if np.isfinite(pair).all() else ""
                for pair in bounds.T
            ]
            gap = [""] * (len(HEAD) - len(values))
            rows += [(label, *texts, *gap), ("", *ranges, *gap)]
        stated = np.sqrt(np.mean(self.sigmas**2, axis=0))
        rows.insert(4, ("stated sigma", *map("{:.3f}".format, stated), ""))
        return pd.DataFrame([row[1:] for row in rows], [row[0] for row in rows], HEAD)

    def _notes(self) -> list[str]:
        judged = self.credibility
        low, high = judged.bounds
        return [
            f"ANEES {judged.anees:.2f} (credible if independent: {low:.2f} to {high:.2f}), "
            f"NCI {judged.nci:.1f} dB, I2 {judged.inclination:+.1f} dB.",
            "Whitened squares (ideally 1; all: ANEES), -log density (m/s, rad/s) and shares are of",
            "omega, of v_y given omega, of v_x given both, and of all three together.",
            f"[95 % intervals] from blocks of {self.block} estimates.",
        ]

    def _title(self) -> str:
        return (
            f"{len(self.times)} estimates compared, {self.share:.1%} of the track; "
            f"{self.converged:.1%} converged"
        )

    def __str__(self) -> str:
        rows = [row.rstrip() for row in self.table.to_string().splitlines()]
        return "\n".join([self._title(), "", *rows, "", *self._notes()])

    def _repr_html_(self) -> str:
        notes = "<br>".join(self._notes())
        return f"<p>{self._title()}</p>{self.table.to_html(border=0)}<p>{notes}</p>"

    def plot(self) -> Figure:
        """Draw the errors over time in a band of 3 sigma to either side, and below them the NEES.

        The NEES of a credible estimator lies between the dashed lines in 95 % of the cases.
        Matplotlib must be installed.
        """
        from matplotlib import pyplot as plt

        figure, axes = plt.subplots(4, sharex=True, figsize=(8.0, 8.0), layout="constrained")
        errors, sigmas = self.errors * IN_UNITS, self.sigmas
        for ax, name, unit, error, sigma in zip(
            axes[:3], NAMES, UNITS, errors.T, sigmas.T, strict=True
        ):
            band = {"step": "mid", "color": COLOR, "alpha": 0.25, "linewidth": 0.0}
            ax.fill_between(self.times, -3.0 * sigma, 3.0 * sigma, label="±3 sigma", **band)
            ax.plot(self.times, error, MARKER, ms=1.5, color=COLOR, label="error")
            ax.axhline(0.0, **REFERENCE)
            ax.set_ylabel(f"{name} ({unit})")
        axes[0].legend(loc="upper right", ncols=2)
        nees = (self.whitened.values**2).sum(axis=-1)
        axes[3].semilogy(self.times, nees, MARKER, ms=1.5, color=COLOR)
        for bound in scipy.special.chdtri(len(self._known), np.array([0.975, 0.025])):
            axes[3].axhline(bound, **REFERENCE)
        axes[3].set(ylabel="NEES", xlabel="time (s)")
        return figure


def _append(directions: Array, together: Array) -> Array:
    """Values (..., 3) of the three directions and (...) of all together, as (..., 4)."""
    return np.concatenate([directions, np.expand_dims(together, -1)], axis=-1)


# The rows of the table: a label, the form of its numbers, and what they are.
_ROWS: list[tuple[str, str, Callable[[Measures], Array]]] = [
    ("RMSE", "{:.3f}", lambda m: m.rmse),
    ("mean error", "{:+.3f}", lambda m: m.mean_error),
    ("CRPS", "{:.3f}", lambda m: m.crps),
    ("whitened square", "{:.2f}", lambda m: _append(m.whitened_squares, m.anees)),
    ("-log density", "{:.2f}", lambda m: _append(m.log_scores, m.log_score)),
    ("within 50%", "{:.1%}", lambda m: _append(m.coverages[..., 0], m.coverage[..., 0])),
    ("within 95%", "{:.1%}", lambda m: _append(m.coverages[..., 1], m.coverage[..., 1])),
    ("within 99%", "{:.1%}", lambda m: _append(m.coverages[..., 2], m.coverage[..., 2])),
]


def compare(track: Track, reference: Reference) -> Comparison:
    """Compare the velocities of a track with a reference.

    Errors are estimate minus reference.  The reference is the truth of a simulation
    (``drive.truth``) or the measurement of another sensor (``recording.reference``), whose own
    errors are included.  Without one, see `compare_tracks` and `compare_halves`.

    It is interpolated linearly to ``track.times``.  Estimates that did not converge, outside its
    time span, or where it is nan, are left out.  A direction in which it is nan at all times, as a
    gyro's speed, is not compared.

    Raises a ``ValueError`` if fewer than four estimates can be compared, as with clocks that
    differ.

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
    if not len(track.times):
        raise ValueError("track must hold at least one estimate, but is empty")
    first, last = reference.times[[0, -1]]
    if not ((track.times >= first) & (track.times <= last)).any():
        raise ValueError(
            f"reference must overlap the track in time, but extends from {first:g} s to {last:g} s "
            f"and the track from {track.times[0]:g} s to {track.times[-1]:g} s"
        )
    errors = track.theta - reference.at(track.times).theta
    return enough(Comparison.from_errors(track, errors), "track and reference have")


def check_reference(track: Track, reference: Reference) -> None:
    """Raise a ValueError if a reference is surely not what it should be: errors mean little then.

    It is if the track's velocities are, by linear regression, those of the reference at another
    time, or another multiple of its speed or yaw rate, and agree with it far better so.
    """
    good = track.converged
    times, theta = track.times[good], track.theta[good]

    def both(axis: int, lag: float = 0.0) -> tuple[Array, Array]:
        """A velocity of the reference some time later, and the track's."""
        theirs = reference.at(times + lag).theta[:, axis]
        known = np.isfinite(theirs)
        return theirs[known], theta[known, axis]

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
    lags = np.arange(-span, span + 0.1, 0.1).tolist()
    rest, lag = min((_unexplained(*both(axis, lag)), lag) for lag in lags)
    if rest < _ALIKE and _unexplained(*both(axis)) > 4.0 * rest and abs(lag) > _OFF:
        raise ValueError(
            f"reference must have the track's clock, but its {whose} are those of {lag:+.1f} s "
            "later"
        )


def _unexplained(theirs: Array, own: Array) -> float:
    """The share of a velocity's variance that a rising linear function of another leaves."""
    if len(own) <= _PAIRS or not (np.ptp(own) and np.ptp(theirs)):
        return 1.0
    return 1.0 - max(float(np.corrcoef(theirs, own)[0, 1]), 0.0) ** 2


def enough(found: Comparison, whose: str) -> Comparison:
    """The comparison itself; a ``ValueError`` if it holds too few estimates to judge."""
    if len(found.times) < 4:
        raise ValueError(
            f"{whose} {len(found.times)} converged estimates at common times, but at least 4 are "
            "needed; are their clocks the same?"
        )
    return found
