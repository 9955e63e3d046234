"""The covariance of an ego-motion estimate, propagated from the sensor's errors."""

from collections.abc import Iterable, Sequence
from typing import Unpack

import numpy as np

from d2d import rigid
from d2d._checks import check_flag, check_instance
from d2d._types import Array
from d2d.covariance import check_estimate
from d2d.problem import Problem
from d2d.radar.motion.influence import View, distinct_views, influences, noise_covariance
from d2d.radar.motion.model import EgoMotionModel, ModelOptions
from d2d.radar.motion.pairs import ScanPair, scan_pair, scan_pairs
from d2d.radar.scans.scan import Mounting, RadarScan
from d2d.registration import Estimate


def propagate_ego_motion(
    estimate: Estimate,
    previous: RadarScan,
    current: RadarScan,
    mounting: Mounting,
    *,
    shared_azimuth: bool = True,
    **options: Unpack[ModelOptions],
) -> Array:
    """Covariance of an ego-motion estimate by propagating range, azimuth and Doppler errors.

    A target's azimuth error both rotates its position about the sensor and changes its predicted
    Doppler velocity.  The joint cost (thesis eq. 7.14) treats the two effects as independent.

    Parameters
    ----------
    estimate : Estimate
        A single result of `estimate_ego_motion` with the same scans, mounting and options.
    previous, current, mounting
        As for `estimate_ego_motion`.
    shared_azimuth : bool
        Whether a single azimuth error of each current target causes both effects, as in a real
        sensor, instead of two independent errors, as in the cost.  Without ``doppler`` it has no
        effect.
    **options
        ``doppler``, ``outlier``, ``doppler_width``, ``side_slip`` and ``first_order``, as for
        `estimate_ego_motion`.

    Returns
    -------
    (3, 3) array
        Covariance of [v_x, v_y, omega] in m/s, m/s, rad/s; nan if the estimate did not converge.

    Raises
    ------
    ValueError
        If an argument is invalid, as in `estimate_ego_motion` and `d2d.propagate_covariance`; the
        message names it.

    Notes
    -----
    A shared azimuth error correlates the errors of the sensor's transverse velocity and of omega.
    This matters if the Doppler error caused by the azimuth, ``sigma_azimuth |dV / d azimuth|``, is
    not small compared with sigma_doppler.  Half of omega's error comes from the previous scan,
    which shares nothing, so the effect is bounded at any speed.  It changes the shape of the
    covariance more than its size: it hardly affects the average NEES, but it does affect the
    noncredibility index.
    """
    model = EgoMotionModel(**options)
    pairs = scan_pairs(previous, current, mounting)
    problem = model.problem([scan_pair(*pair, model) for pair in pairs])
    views = [(previous, mounting), (current, mounting)]
    return _propagated(estimate, problem, views, [(0, 1)], shared_azimuth)


def propagate_joint_ego_motion(
    estimate: Estimate,
    pairs: Iterable[ScanPair],
    *,
    shared_azimuth: bool = True,
    **options: Unpack[ModelOptions],
) -> Array:
    """Covariance of a joint ego-motion estimate by propagating range, azimuth and Doppler errors.

    A scan can be in several pairs: of several baselines, or as the current scan of one and the
    previous scan of another.  Its errors are the same in all of them, so their effects are added up
    before they are squared.  The inverse Hessian treats the pairs as independent.

    Parameters
    ----------
    estimate : Estimate
        A result of `estimate_ego_motion` with the same pairs and options.
    pairs : iterable of (previous, current, mounting)
        As for `estimate_ego_motion`.  Scans with the same content and mounting are the same
        scan.
    shared_azimuth, **options
        As for `propagate_ego_motion`.

    Returns
    -------
    (3, 3) array
        Covariance of [v_x, v_y, omega] in m/s, m/s, rad/s; nan if the estimate did not converge.

    Raises
    ------
    ValueError
        If an argument is invalid, as in `estimate_ego_motion` and `propagate_ego_motion`; the
        message names it.
    """
    given = [ScanPair(*pair) for pair in pairs]
    pairs = scan_pairs(
        [pair.previous for pair in given],
        [pair.current for pair in given],
        [pair.mounting for pair in given],
    )
    model = EgoMotionModel(**options)
    problem = model.problem([scan_pair(*pair, model) for pair in pairs])
    return _propagated(estimate, problem, *distinct_views(pairs), shared_azimuth)


def _propagated(
    estimate: Estimate,
    problem: Problem,
    views: Sequence[View],
    sides: Sequence[tuple[int, int]],
    shared_azimuth: bool,
) -> Array:
    check_flag("shared_azimuth", shared_azimuth)
    check_instance("estimate", estimate, Estimate)
    if np.shape(estimate.theta) != (3,):
        raise ValueError(
            "estimate must be of one velocity with the shape (3,), but its theta has "
            f"{np.shape(estimate.theta)}"
        )
    bound = problem.bind(rigid.motion("estimate", estimate.theta, 2))
    check_estimate(estimate, problem, bound)
    found = influences(problem, estimate, views, sides)
    prior = estimate.covariance @ np.diag(problem.prior) @ estimate.covariance
    return noise_covariance(found, shared_azimuth=shared_azimuth) + prior
