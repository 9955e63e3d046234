"""Ego-motion between two scans of one sensor, or from several such pairs at once."""

from collections.abc import Iterable, Sequence
from typing import Unpack

from numpy.typing import ArrayLike

from d2d import rigid
from d2d._checks import check_finite
from d2d._types import Array
from d2d.problem import Estimate, Problem
from d2d.radar.motion.doppler import doppler_starts
from d2d.radar.motion.model import EgoMotionModel, EstimationOptions, ModelOptions, split_options
from d2d.radar.motion.pairs import problem_of, scan_pairs
from d2d.radar.scans.scan import Mounting, RadarScan
from d2d.registration import anneal, best_of


def estimate_ego_motion(
    previous: RadarScan | Iterable[RadarScan],
    current: RadarScan | Iterable[RadarScan],
    mounting: Mounting | Iterable[Mounting],
    *,
    initial: ArrayLike | None = None,
    **options: Unpack[EstimationOptions],
) -> Estimate:
    r"""The vehicle's velocity between two scans of one sensor, or that of several pairs of scans.

    Registers the current scan with the previous one by the D2D likelihood.  With ``doppler``, each
    target's inlier density is multiplied by the density of its Doppler velocity before the outlier
    component is added, :math:`\prod_k ((1 - \alpha)\, q_k p_k + \alpha\, o_k)` (thesis eq. 7.14).
    Several pairs, of several sensors or over several baselines, have one velocity: the sum of their
    costs is minimised.  The velocity is assumed constant from the first scan to the last, so that
    over the interval tau of a pair the vehicle moves by exp(tau theta).

    The estimate's theta is [v_x, v_y, omega] in m/s, m/s, rad/s.  ``converged`` means that it is an
    optimum, possibly one that rejects nearly all targets: `inlier_probabilities` shows this, and
    `track` checks it.

    Raises a ``ValueError`` if scans are out of time order or have no targets, sequences differ in
    length, or ``initial`` is invalid.

    Parameters
    ----------
    previous, current : RadarScan
        Two scans in time order; or sequences, which hold one scan for each pair.
    mounting : Mounting
        Pose of the sensor in the vehicle frame; or a sequence with that of each pair.
    initial : (3,) array, optional
        Start [v_x, v_y, omega].  By default, the velocity that `doppler_ego_motion` finds from all
        current scans (even if ``doppler`` is False).  If they do not determine all of it, as those
        of a single sensor, the velocity of each gives two starts, one without rotation and, if it
        is ahead of or behind the origin, one without side slip; the lowest optimum wins.
    **options
        The fields of `EgoMotionModel`, and ``scales=(1.0,)``, the inflation schedule of all
        standard deviations, as for `d2d.register`.
    """
    model, scales = split_options(options)
    pairs = scan_pairs(previous, current, mounting)
    if initial is None:
        start = doppler_starts([(pair.current, pair.mounting) for pair in pairs])
    else:
        start = check_finite("initial", initial, "(3,)")
    return estimate_velocity(problem_of(pairs, model), start, scales)


def estimate_velocity(problem: Problem, start: Array, scales: Sequence[float]) -> Estimate:
    """The best optimum from one velocity (3,), or from several (S, 3)."""
    found = anneal(problem, start, scales)
    return found if start.ndim == 1 else best_of(found)


def inlier_probabilities(
    theta: ArrayLike,
    previous: RadarScan,
    current: RadarScan,
    mounting: Mounting,
    **options: Unpack[ModelOptions],
) -> Array:
    """Probability (..., K) that each target of the current scan is an inlier at ``theta`` (..., 3).

    The other arguments and the errors raised are those of `estimate_ego_motion`.  Targets that move
    on their own, or that have no counterpart in the previous scan, get low probabilities.
    """
    model = EgoMotionModel(**options)
    problem = problem_of(scan_pairs(previous, current, mounting), model)
    return problem.inlier_shares(problem.bind(rigid.motion("theta", theta, 2)))
