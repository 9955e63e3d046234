"""A track beside a reference: errors, and whether the covariances are true to them."""

from __future__ import annotations

import html
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np
import scipy

from d2d._checks import check_instance
from d2d._lazy import Frozen, lazy
from d2d._types import Array
from d2d.bootstrap import block_bootstrap, block_length
from d2d.credibility import Credibility, credibility
from d2d.radar.looks import COLOR, MARKER, REFERENCE
from d2d.radar.scans.reference import Reference
from d2d.radar.tracks.track import Track
from d2d.scores import LEVELS, Whitened, crps, whiten, within

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NAMES = ("v_x", "v_y", "omega")
UNITS = ("m/s", "m/s", "deg/s")
IN_UNITS = np.array([1.0, 1.0, np.rad2deg(1.0)])
# omega first, then v_y given omega, then v_x given both
ORDER = (2, 1, 0)


class Measures(NamedTuple):
    """What a comparison measures, or the bounds of its confidence intervals.

    Directions are in the order v_x, v_y, omega.  Of intervals, each array has a leading axis of
    length 2, the lower and upper bounds.

    Attributes
    ----------
    mean_error : (3,) array
        In m/s, m/s, deg/s.
    rmse : (3,) array
        Root mean square error, in the same units.
    crps : (3,) array
        Mean continuous ranked probability score, in the same units; see `d2d.crps`.
    whitened_squares : (3,) array
        Mean squares of the whitened errors: of v_x given v_y and omega, of v_y given omega, and of
        omega; ideally 1.
    anees : float
        Average normalised estimation error squared, the mean of the three; see `d2d.credibility`.
    log_scores : (3,) array
        Mean parts of the three in ``log_score``.
    log_score : float
        Mean negative log density of the errors, in m/s, m/s, rad/s; see `d2d.log_score`.
    coverages : (3, 3) array
        Shares of the whitened errors, directions by levels, within the central 50, 95 and 99 %.
    coverage : (3,) array
        Shares of the errors within the ellipsoids of 50, 95 and 99 %.
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
    """The errors of a track's velocities, and what they say about its covariances.

    Printed, it is a table; in a notebook it is shown as one.

    Attributes
    ----------
    times : (n,) array, s
        Times of the estimates that are compared.
    errors : (n, 3) array
        Errors of [v_x, v_y, omega] in m/s, m/s, rad/s.
    covariances : (n, 3, 3) array
        Their stated covariances, in the same units.
    share : float
        Share of the track's estimates that are compared.
    converged : float
        Share of the track's estimates that converged.
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
    def from_errors(cls, track: Track, errors: Array) -> Self:
        """The comparison of a track whose errors (n, 3) are known, nan where there is none.

        Estimates that did not converge are left out, whatever their errors.
        """
        good = track.converged & np.isfinite(errors).all(axis=-1)
        return cls(
            track.times[good],
            errors[good],
            track.covariance[good],
            float(good.mean()),
            float(track.converged.mean()),
        )

    @property
    def rmse(self) -> Array:
        """Root mean square error (3,) in m/s, m/s and deg/s."""
        # of the errors alone: it is known where a covariance is singular too
        return np.asarray(np.sqrt(np.mean(self.errors**2, axis=0)) * IN_UNITS)

    @property
    def sigmas(self) -> Array:
        """Stated standard deviations (n, 3) in m/s, m/s and deg/s."""
        return np.asarray(np.sqrt(np.diagonal(self.covariances, axis1=-2, axis2=-1)) * IN_UNITS)

    @property
    def credibility(self) -> Credibility:
        """NEES, ANEES, NCI and I^2 of the covariances, given the errors.

        The region of the ANEES is that for independent errors; those of a track mostly are not.
        """
        return credibility(self.errors, self.covariances)

    @lazy
    def whitened(self) -> Whitened:
        """The errors taken apart into omega, v_y given omega, and v_x given both."""
        return whiten(self.errors, self.covariances, ORDER)

    @lazy
    def measures(self) -> Measures:
        """All measures, each the mean over the estimates or its root."""
        return _measures(self._columns.mean(axis=0))

    @lazy
    def block(self) -> int:
        """Length of a block of the bootstrap, the most that an error or the NEES needs."""
        squares = (self.whitened.values**2).sum(axis=-1)
        return block_length(np.column_stack([self.errors, squares]))

    def intervals(
        self,
        confidence: float = 0.95,
        *,
        block: int | None = None,
        rng: np.random.Generator | None = None,
        resamples: int = 1000,
    ) -> Measures:
        """Confidence intervals of all measures, by a block bootstrap.

        Parameters
        ----------
        confidence : float
            Probability content of each interval, within (0, 1).
        block : int, optional
            Number of successive estimates that are drawn together, by default `block`, by the
            rule of `d2d.block_length`.  It cannot know of errors that are slower than the drive
            is long.
        rng : numpy.random.Generator, optional
            By default one with a fixed seed, so that a comparison is always printed alike.
        resamples : int
            Number of drawings.

        Returns
        -------
        Measures
            Lower and upper bounds along a leading axis.

        Raises
        ------
        ValueError
            If an argument is out of range; the message names it.
        """
        bounds = block_bootstrap(
            lambda rows: rows.mean(axis=0),
            [self._columns],
            self.block if block is None else block,
            np.random.default_rng(0) if rng is None else rng,
            confidence=confidence,
            resamples=resamples,
        )
        return _measures(bounds)

    @lazy
    def _columns(self) -> Array:
        """What all measures are the means of (n, 29), in the order of `Measures`."""
        count, white = len(self.errors), self.whitened
        squares = white.values**2
        return np.column_stack(
            [
                self.errors,
                self.errors**2,
                crps(self.errors * IN_UNITS, self.sigmas),
                squares,
                squares.mean(axis=-1),
                white.log_score,
                white.log_score.sum(axis=-1),
                white.within().reshape(count, -1),
                within(self.errors, self.covariances),
            ]
        )

    @lazy
    def _printed_intervals(self) -> Measures:
        return self.intervals()

    def _rows(self) -> list[tuple[str, list[str]]]:
        """The table: a label and a cell for each direction and for all together."""
        found, bounds = self.measures, self._printed_intervals
        rows: list[tuple[str, list[str]]] = []

        def add(label: str, values: Array, intervals: Array, form: Callable[[float], str]) -> None:
            cells = [form(value) for value in values]
            ranges = [f"[{form(low)}, {form(high)}]" for low, high in intervals.T]
            gap = [""] * (4 - len(cells))
            rows.extend([(label, cells + gap), ("", ranges + gap)])

        add("RMSE", found.rmse, bounds.rmse, "{:.3f}".format)
        add("mean error", found.mean_error, bounds.mean_error, "{:+.3f}".format)
        stated = np.sqrt(np.mean(self.sigmas**2, axis=0))
        rows.append(("stated sigma", [*map("{:.3f}".format, stated), ""]))
        add("CRPS", found.crps, bounds.crps, "{:.3f}".format)
        squares = np.append(found.whitened_squares, found.anees)
        bound = np.column_stack([bounds.whitened_squares, bounds.anees])
        add("whitened square", squares, bound, "{:.2f}".format)
        scores = np.append(found.log_scores, found.log_score)
        bound = np.column_stack([bounds.log_scores, bounds.log_score])
        add("-log density", scores, bound, "{:.2f}".format)
        for i, level in enumerate(LEVELS):
            shares = np.append(found.coverages[:, i], found.coverage[i])
            bound = np.column_stack([bounds.coverages[:, :, i], bounds.coverage[:, i]])
            add(f"within {level:.0%}", 100.0 * shares, 100.0 * bound, "{:.1f}%".format)
        return rows

    def _notes(self) -> list[str]:
        """What stands below the table."""
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
        head = ("", [f"{n} ({u})" for n, u in zip(NAMES, UNITS, strict=True)] + ["all"])
        rows = [head, *self._rows()]
        first = max(len(label) for label, _ in rows)
        widths = [max(len(cells[i]) for _, cells in rows) for i in range(4)]
        lines = [
            "  ".join([label.ljust(first), *map(str.rjust, cells, widths)]).rstrip()
            for label, cells in rows
        ]
        return "\n".join([self._title(), "", *lines, "", *self._notes()])

    def _repr_html_(self) -> str:
        head = "".join(
            f"<th>{name}</th>"
            for name in ("", *map("{} ({})".format, NAMES, UNITS), "all")  # no markup in them
        )
        body = "".join(
            f"<tr><th>{html.escape(label)}</th>"
            + "".join(f"<td>{html.escape(cell)}</td>" for cell in cells)
            + "</tr>"
            for label, cells in self._rows()
        )
        notes = "<br>".join(map(html.escape, self._notes()))
        return (
            f"<table><caption>{html.escape(self._title())}</caption>"
            f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table><p>{notes}</p>"
        )

    def plot(self) -> Figure:
        """Draw the errors over time in a band of 3 sigma to either side, and below them the NEES.

        Returns
        -------
        matplotlib.figure.Figure
            In the last picture, the dashed lines hold 95 % of the values of a credible estimator.

        Raises
        ------
        ModuleNotFoundError
            If matplotlib, which `d2d` itself does not need, is not installed.
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
        for bound in scipy.special.chdtri(3, np.array([0.975, 0.025])):
            axes[3].axhline(bound, **REFERENCE)
        axes[3].set(ylabel="NEES", xlabel="time (s)")
        return figure


def _measures(columns: Array) -> Measures:
    """Means (..., 29) of the columns, or bounds of them, as measures."""
    widths = np.cumsum([3, 3, 3, 3, 1, 3, 1, 9])
    error, square, score, white, anees, logs, log, inside, ellipsoid = np.split(
        columns, widths, axis=-1
    )
    return Measures(
        error * IN_UNITS,
        np.sqrt(square) * IN_UNITS,
        score,
        white,
        anees[..., 0],
        logs,
        log[..., 0],
        inside.reshape(*inside.shape[:-1], 3, len(LEVELS)),
        ellipsoid,
    )


def compare(track: Track, reference: Reference) -> Comparison:
    """Compare the velocities of a track with a reference.

    Parameters
    ----------
    track : Track
        Of one sensor or several, with any baseline.  Estimates that did not converge are left out.
    reference : Reference
        The truth of a simulation (``drive.truth``), or what another sensor measured
        (``recording.reference``), at any times of the same clock.  Estimates where it is nan or
        outside its time span are left out.

    Returns
    -------
    Comparison
        Errors are estimate minus reference.

    Raises
    ------
    ValueError
        If an argument is of the wrong type, or fewer than four estimates can be compared.

    Notes
    -----
    The reference is interpolated linearly to the time of each estimate, ``track.times``, which is
    that of the *later* scan of its pair (of several sensors, the mean time of the round's later
    scans).  An estimate is a velocity between two scans: its Doppler velocities are those at the
    later scan, but its positions tell the mean velocity over the interval.  Where the vehicle
    accelerates, what positions tell lags by half an interval, which is half the baseline times the
    time between scans; that part counts as an error here, because a user of the track takes the
    velocity at its time.

    The errors contain those of the reference itself.  Without a reference, see `compare_tracks` and
    `compare_halves`.

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
    errors = track.theta - reference.at(track.times).theta
    first, last = reference.times[[0, -1]]
    if not ((track.times >= first) & (track.times <= last)).any():
        raise ValueError(
            f"reference must overlap the track in time, but extends from {first:g} s to {last:g} s "
            f"and the track from {track.times[0]:g} s to {track.times[-1]:g} s"
        )
    return enough(Comparison.from_errors(track, errors), "track and reference have")


def enough(found: Comparison, whose: str) -> Comparison:
    """The comparison itself, if there is anything to judge in it."""
    if len(found.times) < 4:
        raise ValueError(
            f"{whose} {len(found.times)} converged estimates at common times, but at least 4 are "
            "needed; are their clocks the same?"
        )
    return found
