"""The covariance of an ego-motion estimate, propagated from the sensor's errors."""

from dataclasses import replace
from typing import Unpack

import numpy as np

from d2d import rigid
from d2d._checks import check_flag, check_instance
from d2d._types import Array
from d2d.covariance import propagate_covariance
from d2d.radar.options import EgoMotionModel, ModelOptions
from d2d.radar.scan import Mounting, RadarScan
from d2d.radar.scan_pair import scan_pair
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
        ``doppler``, ``outlier`` and ``first_order``, as for `estimate_ego_motion`.

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
    pair = scan_pair(previous, current, mounting, model)
    shared = check_flag("shared_azimuth", shared_azimuth) and model.doppler
    check_instance("estimate", estimate, Estimate)
    if np.shape(estimate.theta) != (3,):
        raise ValueError(
            "estimate must be of one velocity with the shape (3,), but its theta has "
            f"{np.shape(estimate.theta)}"
        )
    twist = pair.interval * rigid.motion("estimate", estimate.theta, 2)
    motion = twist if model.first_order else rigid.exponential(twist)
    twist_by_motion = np.eye(3) if model.first_order else rigid.logarithm_jacobian(motion)
    jacobian: Array = twist_by_motion / pair.interval  # d velocity / d motion
    back = np.linalg.inv(jacobian)
    covariance = propagate_covariance(
        replace(estimate, theta=motion, covariance=back @ estimate.covariance @ back.T),
        pair.fixed,
        pair.moving,
        model.cost,
        measurement=pair.measurement,
        position_slope=cross_range(current, mounting) if shared else None,
    )
    propagated: Array = jacobian @ covariance @ jacobian.T
    return propagated


def cross_range(scan: RadarScan, mounting: Mounting) -> Array:
    """Derivative (K, 2) of each target's position in its azimuth, in m/rad in the vehicle frame."""
    angle = scan.azimuth + mounting.yaw
    return np.asarray(scan.range[:, None] * np.stack([-np.sin(angle), np.cos(angle)], axis=-1))
