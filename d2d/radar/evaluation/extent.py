"""How far the targets of extended objects scatter, by maximum likelihood from the scans alone."""

from collections.abc import Iterable
from typing import NamedTuple, Unpack

import numpy as np
import scipy

from d2d._checks import check_count, check_instance
from d2d._types import Array
from d2d.problem import Problem
from d2d.radar.evaluation.sandwich import covariance_of_sum, sqrt_standard_errors
from d2d.radar.motion.doppler import doppler_starts
from d2d.radar.motion.estimate import estimate_velocity
from d2d.radar.motion.model import EgoMotionModel, ModelOptions
from d2d.radar.motion.pairs import ScanPair, problem_of
from d2d.radar.scans.scan import Mounting, RadarScan
from d2d.radar.tracks.intake import usable
from d2d.radar.tracks.rounds import named_sensors

CANDIDATES = np.array([0.0, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2])  # m
_MIDDLE = 0.4  # m; the search at every extent starts at the velocity found with this one
_TOLERANCE = 1e-4  # m
_STEP, _SMALL = 0.1, 0.03  # of the variance and, in m, of an extent of zero, for derivatives
_SHORTEST_BLOCK = 4  # pairs


class ExtentEstimate(NamedTuple):
    """The extent of a recording's targets, see `estimate_extent`."""

    extent: float  # m, the standard deviation along each axis; 0 if the likelihood falls from there
    sigma: float  # m, its standard error; nan if there is none
    pairs: int  # of scans that were used
    targets: int  # in the current scans of these pairs


def estimate_extent(
    scans: Iterable[RadarScan],
    mounting: Mounting,
    *,
    baseline: int = 1,
    max_pairs: int | None = 50,
    **options: Unpack[ModelOptions],
) -> ExtentEstimate:
    """Estimate the extent of a sensor's targets (`RadarScan.extent`) by maximum likelihood.

    All targets get the one extent with which the registered pairs of scans are most likely.  No
    reference is needed, and the scans' own ``extent`` is not used.  The scans of a pair are
    ``baseline`` scans apart.  At most ``max_pairs`` are used, spread evenly over the recording;
    None uses all.  The other options are the fields of `EgoMotionModel`.

    Raises a ``ValueError`` if fewer than two pairs have targets in both scans, the likelihood still
    grows at the largest candidate (3.2 m), or an argument is invalid.

    Notes
    -----
    The extent equals the scatter of the points only if each target has one counterpart: where
    objects return one to eight targets it is 0.4 to 0.7 of it.  The likeliest extent does not
    always give the best velocities: on roads, where reflections slide along guard rails, a smaller
    one does.  The standard error comes from how much the slopes of the pairs' log-likelihoods in
    the variance differ (sandwich).

    Examples
    --------
    >>> import numpy as np
    >>> from d2d.radar import estimate_extent, simulate_drive
    >>> drive = simulate_drive(np.random.default_rng(0), duration=3.0)
    >>> found = estimate_extent(drive.scans, drive.mounting)
    >>> wider = [scan.with_extent(found.extent) for scan in drive.scans]
    """
    check_instance("mounting", mounting, Mounting)
    ((scans, mounting),) = usable(named_sensors((scans, mounting))).values()
    check_count("baseline", baseline)
    if max_pairs is not None:
        check_count("max_pairs", max_pairs, minimum=2)
    model = EgoMotionModel(**options)
    pairs = [
        ScanPair(previous, current, mounting)
        for previous, current in zip(scans, scans[baseline:], strict=False)
        if previous.size and current.size
    ]
    if len(pairs) < 2:
        raise ValueError(
            "scans must hold at least two pairs of scans with targets that are baseline = "
            f"{baseline} apart, but hold {len(pairs)}"
        )
    if max_pairs is not None and len(pairs) > max_pairs:
        spread = np.linspace(0, len(pairs) - 1, max_pairs).round().astype(int)
        pairs = [pairs[i] for i in spread]

    def log_likelihoods(extent: float) -> Array:
        """Of each pair at its best velocity."""
        optima = [
            estimate_velocity(_widened(pair, extent, model), start, (1.0,))
            for pair, start in zip(pairs, starts, strict=True)
        ]
        return -np.array([float(optimum.value) for optimum in optima])

    starts = [
        estimate_velocity(
            _widened(pair, _MIDDLE, model), doppler_starts([(pair.current, mounting)]), (1.0,)
        ).theta
        for pair in pairs
    ]
    curve = [log_likelihoods(extent).sum() for extent in CANDIDATES]
    best = int(np.argmax(curve))
    if best == len(curve) - 1:
        raise ValueError(
            f"scans have a likelihood that still grows at {CANDIDATES[-1]:g} m: positions of one "
            "scan do not fit those of the other"
        )
    extent = scipy.optimize.minimize_scalar(
        lambda extent: -log_likelihoods(extent).sum(),
        bounds=CANDIDATES[[max(best - 1, 0), best + 1]],
        method="bounded",
        options={"xatol": _TOLERANCE},
    )
    found = float(extent.x) if -extent.fun > curve[0] else 0.0
    # derivatives in the variance about the extent, to one side if it is zero
    step = max(_STEP * found**2, _SMALL**2)
    low = max(found**2 - step, 0.0)
    below, middle, above = (log_likelihoods(np.sqrt(low + k * step)) for k in range(3))
    slopes = (above - below) / (2.0 * step)
    curvature = (2.0 * middle - below - above).sum() / step**2
    # successive pairs may share a scan, which a few slopes do not show
    shortest = max(min(_SHORTEST_BLOCK, len(pairs) // 3), 1)
    ((variance,),), _ = covariance_of_sum(slopes[:, None], shortest)
    of_square = np.sqrt(variance) / curvature if curvature > 0.0 else np.nan
    sigma = float(sqrt_standard_errors(found, of_square))
    return ExtentEstimate(found, sigma, len(pairs), sum(pair.current.size for pair in pairs))


def _widened(pair: ScanPair, extent: float, model: EgoMotionModel) -> Problem:
    """The problem of a pair whose targets have an extent."""
    previous, current = (each.with_extent(extent) for each in (pair.previous, pair.current))
    return problem_of([ScanPair(previous, current, pair.mounting)], model)
