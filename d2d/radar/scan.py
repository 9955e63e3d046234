"""A scan of a Doppler radar, and the mounting of the sensor on the vehicle."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from d2d import rigid
from d2d._checks import (
    broadcast_batches,
    check_angle,
    check_finite,
    check_instance,
    check_positive,
    check_scalar,
)
from d2d._lazy import Frozen
from d2d._types import Array, Selection
from d2d.measurement import LinearMeasurement
from d2d.point_set import PointSet


@dataclass(frozen=True)
class Mounting:
    """Pose of the sensor in the vehicle frame (x forward, y left).

    Parameters
    ----------
    x, y : float, m
    yaw : float, rad
        Direction of the boresight, counter-clockwise from the x axis, within -2 pi and 2 pi.

    Raises
    ------
    ValueError
        If an argument is not a finite number, or the yaw is in degrees; the message names it.
    """

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def __post_init__(self) -> None:
        for name in ("x", "y", "yaw"):
            object.__setattr__(self, name, check_scalar(name, getattr(self, name)))
        check_angle("yaw", self.yaw)

    @property
    def pose(self) -> Array:
        """[x, y, yaw] as a rigid motion from the sensor frame to the vehicle frame."""
        return np.array([self.x, self.y, self.yaw])


@dataclass(frozen=True, eq=False)
class RadarScan(Frozen):
    """The targets of one scan in the sensor frame, with their standard deviations.

    Parameters
    ----------
    time : float, s
    range, azimuth, doppler : (K,) arrays in m, rad, m/s
        The azimuth is measured counter-clockwise from the boresight, within -2 pi and 2 pi; the
        Doppler velocity is positive for receding targets.  K may be 0.
    sigma_range, sigma_azimuth, sigma_doppler : numbers or (K,) arrays in the same units
        Standard deviations, positive.

    Raises
    ------
    ValueError
        If an argument is not finite, not positive or has the wrong shape, or azimuths are in
        degrees; the message names it.
    """

    time: float
    range: Array
    azimuth: Array
    doppler: Array
    sigma_range: Array
    sigma_azimuth: Array
    sigma_doppler: Array

    def __init__(
        self,
        time: float,
        range: ArrayLike,
        azimuth: ArrayLike,
        doppler: ArrayLike,
        sigma_range: ArrayLike,
        sigma_azimuth: ArrayLike,
        sigma_doppler: ArrayLike,
    ) -> None:
        self._keep("time", check_scalar("time", time))
        arrays = {
            "range": check_positive("range", range),
            "azimuth": check_angle("azimuth", azimuth),
            "doppler": check_finite("doppler", doppler),
            "sigma_range": check_positive("sigma_range", sigma_range),
            "sigma_azimuth": check_positive("sigma_azimuth", sigma_azimuth),
            "sigma_doppler": check_positive("sigma_doppler", sigma_doppler),
        }
        shape = arrays["range"].shape
        if len(shape) != 1:
            raise ValueError(f"range must have the shape (K,), but has {shape}")
        for name, array in arrays.items():
            if array.shape != shape and not (
                name.startswith("sigma") and array.shape in ((), (1,))
            ):
                raise ValueError(
                    f"{name} must have the shape {shape} to match range, but has {array.shape}"
                )
            self._keep(name, np.broadcast_to(array, shape))

    @property
    def size(self) -> int:
        """Number K of targets."""
        return len(self.range)

    def __getitem__(self, index: Selection) -> "RadarScan":
        """The scan with only some of its targets, selected by a slice, a mask or a list of indices.

        Raises an ``IndexError`` for a single number, or if the index is out of range.
        """
        which: Any = index  # NumPy's own types do not take so many kinds at once
        if np.ndim(self.range[which]) != 1:
            raise IndexError("a scan is indexed by a slice, a mask or a list, not by a number")
        return RadarScan(
            self.time,
            self.range[which],
            self.azimuth[which],
            self.doppler[which],
            self.sigma_range[which],
            self.sigma_azimuth[which],
            self.sigma_doppler[which],
        )

    __iter__ = None  # else Python would try the indices 0, 1, ... and stop at the first IndexError

    def point_set(self, mounting: Mounting) -> PointSet:
        """The targets as Gaussians in the vehicle frame (thesis eq. 7.1, 7.3 and 7.4).

        Raises a ``ValueError`` if the scan is empty or ``mounting`` is not a `Mounting`.
        """
        check_instance("mounting", mounting, Mounting)
        return _placed(self, mounting)

    def doppler_measurement(
        self, mounting: Mounting, interval: float, *, of_twist: bool = True
    ) -> LinearMeasurement:
        """The Doppler velocities as a measurement of the motion over ``interval`` seconds.

        The Doppler velocity V is linear in the body velocity theta = [v_x, v_y, omega], and thus in
        the twist ``interval * theta``.  The azimuth's error enters through the derivative of V in
        the azimuth (thesis sec. 7.1).  If ``of_twist`` is False, the translation is taken as v tau,
        as in the thesis.

        Raises a ``ValueError`` if ``mounting`` is not a `Mounting` or ``interval`` not a positive
        number.
        """
        interval = float(check_positive("interval", check_scalar("interval", interval)))
        gain, slope = doppler_gradients(self.azimuth, mounting)
        sigmas = self.sigma_doppler, self.sigma_azimuth
        return LinearMeasurement._of(
            self.doppler,
            *sigmas,
            gain / interval,
            slope / interval,
            of_twist,
        )


@lru_cache(maxsize=64)
def _placed(scan: RadarScan, mounting: Mounting) -> PointSet:
    """The scan's point set; the latest are cached, because a drive uses each in several pairs."""
    azimuth = scan.azimuth + mounting.yaw
    targets = PointSet._of_polar(scan.range, azimuth, scan.sigma_range, scan.sigma_azimuth)
    return targets.shifted(mounting.pose[:2])


def doppler_gradients(azimuth: ArrayLike, mounting: Mounting) -> tuple[Array, Array]:
    """dV/dtheta and d^2V/(dphi dtheta), each (..., 3), of a static target at ``azimuth`` (...)."""
    check_instance("mounting", mounting, Mounting)
    angle = check_angle("azimuth", azimuth) + mounting.yaw
    cosine, sine = np.cos(angle), np.sin(angle)
    gain, slope = np.empty((*angle.shape, 3)), np.empty((*angle.shape, 3))
    gain[..., 0], gain[..., 1] = -cosine, -sine
    gain[..., 2] = mounting.y * cosine - mounting.x * sine
    slope[..., 0], slope[..., 1] = sine, -cosine
    slope[..., 2] = -mounting.y * sine - mounting.x * cosine
    return gain, slope


def doppler_velocity(theta: ArrayLike, azimuth: ArrayLike, mounting: Mounting) -> Array:
    """Doppler velocity of static targets seen from a moving vehicle.

    Parameters
    ----------
    theta : (..., 3) array
        Velocity [v_x, v_y, omega] of the vehicle in m/s, m/s, rad/s.
    azimuth : (..., K) array, rad
        Azimuth of the targets in the sensor frame, within -2 pi and 2 pi.
    mounting : Mounting

    Returns
    -------
    (..., K) array, m/s, positive for receding targets
        V = -(v_x - omega y_s) cos(phi + alpha_s) - (v_y + omega x_s) sin(phi + alpha_s)
        (thesis eq. 7.10; Barjenbruch et al. 2015).

    Raises
    ------
    ValueError
        If a shape is wrong, a value is not finite, or ``mounting`` is not a `Mounting`; the message
        names the argument.
    """
    motion = rigid.motion("theta", theta, 2)
    gain, _ = doppler_gradients(azimuth, mounting)
    if gain.ndim < 2:
        raise ValueError("azimuth must have the shape (..., K), but is a number")
    broadcast_batches("theta and azimuth", motion.shape[:-1], gain.shape[:-2])
    return np.asarray(np.einsum("...kp,...p->...k", gain, motion))
