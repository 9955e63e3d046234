"""The covariance of an ego-motion estimate by propagation of the sensor's errors."""

from dataclasses import replace

import numpy as np

from d2d import rigid
from d2d._checks import Array, flag, instance
from d2d.cost import OutlierModel, RegistrationCost
from d2d.covariance import propagate_covariance
from d2d.radar.ego_motion import DEFAULT_OUTLIER
from d2d.radar.pair import Pair
from d2d.radar.scan import Mounting, RadarScan
from d2d.registration import Estimate


def propagate_ego_motion(
    estimate: Estimate,
    previous: RadarScan,
    current: RadarScan,
    mounting: Mounting,
    *,
    shared_azimuth: bool = True,
    doppler: bool = True,
    outlier: OutlierModel | None = DEFAULT_OUTLIER,
    first_order: bool = False,
) -> Array:
    """Covariance of an ego-motion estimate by propagating range, azimuth and Doppler errors.

    A target's azimuth error turns its position about the sensor and changes the Doppler velocity
    predicted for it.  The joint cost (thesis eq. 7.13) takes the two for independent.

    Parameters
    ----------
    estimate : Estimate
        Of `estimate_ego_motion` with the same scans, mounting and options: one, no batch.
    previous, current, mounting, doppler, outlier, first_order
        As there.
    shared_azimuth : bool
        Whether one azimuth error of each current target enters both, as in a sensor, instead of two
        independent ones, as in the cost.  Without ``doppler`` there is nothing to share.

    Returns
    -------
    (3, 3) array
        Of [v_x, v_y, omega] in m/s, m/s, rad/s; nan where the estimate did not converge.

    Raises
    ------
    ValueError
        Naming the argument, as `estimate_ego_motion` and `d2d.propagate_covariance`.

    Notes
    -----
    Sharing correlates the errors of the sensor's transverse velocity and of omega; it matters as
    far as the Doppler velocity's error from the azimuth, ``sigma_azimuth |dV / d azimuth|``, is not
    small beside sigma_doppler.  Half of omega's error is the previous scan's, which shares nothing,
    so that the effect is bounded at any speed.  It changes the shape of the covariance more than
    its size: the average NEES hardly shows it, the noncredibility index does.
    """
    pair = Pair.of(previous, current, mounting, doppler, first_order)
    shared = flag("shared_azimuth", shared_azimuth) and doppler
    instance("estimate", estimate, Estimate)
    if np.shape(estimate.theta) != (3,):
        raise ValueError(
            f"estimate must be of one velocity (3,), but its theta has {np.shape(estimate.theta)}"
        )
    motion = pair.motion(rigid.motion("estimate", estimate.theta, 2))
    twist_by_motion = np.eye(3) if first_order else rigid.logarithm_jacobian(motion)
    jacobian: Array = twist_by_motion / pair.interval  # d velocity / d motion
    back = np.linalg.inv(jacobian)
    covariance = propagate_covariance(
        replace(estimate, theta=motion, covariance=back @ estimate.covariance @ back.T),
        pair.fixed,
        pair.moving,
        RegistrationCost(outlier=outlier),
        measurement=pair.measurement,
        position_slope=cross_range(current, mounting) if shared else None,
    )
    propagated: Array = jacobian @ covariance @ jacobian.T
    return propagated


def cross_range(scan: RadarScan, mounting: Mounting) -> Array:
    """Slope (K, 2) of each target's position in the vehicle frame in its azimuth, in m/rad."""
    angle = scan.azimuth + mounting.yaw
    return np.asarray(scan.range[:, None] * np.stack([-np.sin(angle), np.cos(angle)], axis=-1))
