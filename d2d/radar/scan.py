"""One scan of a Doppler radar and where the sensor sits on the vehicle."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from d2d import rigid
from d2d._checks import Array, broadcast, finite, instance, positive, scalar
from d2d.measurement import LinearMeasurement
from d2d.point_set import PointSet


@dataclass(frozen=True)
class Mounting:
    """Pose of the sensor in the vehicle frame (x forward, y left).

    Parameters
    ----------
    x, y : float, m
    yaw : float, rad
        Of the boresight, counter-clockwise from the x axis.

    Raises
    ------
    ValueError
        Naming the argument that is not a finite number.
    """

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def __post_init__(self) -> None:
        for name in ("x", "y", "yaw"):
            object.__setattr__(self, name, scalar(name, getattr(self, name)))

    @property
    def pose(self) -> Array:
        """[x, y, yaw] as a rigid motion from the sensor frame to the vehicle frame."""
        return np.array([self.x, self.y, self.yaw])


@dataclass(frozen=True, eq=False)
class RadarScan:
    """The targets of one scan in the sensor frame, with their standard deviations.

    Parameters
    ----------
    time : float, s
    range, azimuth, doppler : (K,) arrays in m, rad, m/s
        Azimuth 0 is the boresight, counter-clockwise positive; Doppler above 0 recedes. K may be 0.
    sigma_range, sigma_azimuth, sigma_doppler : arrays that broadcast to (K,)
        Positive standard deviations in the same units.

    Raises
    ------
    ValueError
        Naming the argument that is not finite, not positive or not of K entries.
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
        object.__setattr__(self, "time", scalar("time", time))
        arrays = {
            "range": positive("range", range),
            "azimuth": finite("azimuth", azimuth),
            "doppler": finite("doppler", doppler),
            "sigma_range": positive("sigma_range", sigma_range),
            "sigma_azimuth": positive("sigma_azimuth", sigma_azimuth),
            "sigma_doppler": positive("sigma_doppler", sigma_doppler),
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
            view = np.broadcast_to(array, shape)
            view.flags.writeable = False
            object.__setattr__(self, name, view)

    @property
    def size(self) -> int:
        """Number K of targets."""
        return len(self.range)

    def __getitem__(self, index: slice | Array) -> "RadarScan":
        """The scan with only some of its targets, by a slice, a mask or a list of indices.

        Raises ``IndexError`` for a number, or an index that does not fit the targets.
        """
        if np.ndim(self.range[index]) != 1:
            raise IndexError("a scan is indexed by a slice, a mask or a list, not by a number")
        return RadarScan(
            self.time,
            self.range[index],
            self.azimuth[index],
            self.doppler[index],
            self.sigma_range[index],
            self.sigma_azimuth[index],
            self.sigma_doppler[index],
        )

    __iter__ = None  # or Python would try the indices 0, 1, ... and end at the first IndexError

    def point_set(self, mounting: Mounting) -> PointSet:
        """The targets as Gaussians in the vehicle frame (thesis eq. 7.1 and 7.3).

        Raises ``ValueError`` if the scan is empty or ``mounting`` is none.
        """
        instance("mounting", mounting, Mounting)
        return _placed(self, mounting)

    def doppler_measurement(
        self, mounting: Mounting, interval: float, *, of_twist: bool = True
    ) -> LinearMeasurement:
        """The Doppler velocities as a measurement of the motion over ``interval`` seconds.

        V is linear in the body velocity theta = [v_x, v_y, omega], and so in the twist
        ``interval * theta``; its slope in the azimuth carries the azimuth's error into it (thesis
        sec. 7.1).  Not ``of_twist``, v tau stands for the translation, as in the thesis.

        Raises ``ValueError`` naming the argument that is no `Mounting` or no positive number.
        """
        interval = float(positive("interval", scalar("interval", interval)))
        gain, slope = doppler_gradients(self.azimuth, mounting)
        return LinearMeasurement(
            self.doppler,
            self.sigma_doppler,
            self.sigma_azimuth,
            gain / interval,
            slope / interval,
            of_twist,
        )


@lru_cache(maxsize=64)
def _placed(scan: RadarScan, mounting: Mounting) -> PointSet:
    """The scan's point set; the latest are kept, since in a drive each serves several pairs."""
    targets = PointSet.from_polar(scan.range, scan.azimuth, scan.sigma_range, scan.sigma_azimuth)
    return targets.transformed(mounting.pose)


def doppler_gradients(azimuth: ArrayLike, mounting: Mounting) -> tuple[Array, Array]:
    """dV/dtheta and d^2V/(dphi dtheta), each (..., 3), of a static target at ``azimuth`` (...)."""
    instance("mounting", mounting, Mounting)
    angle = finite("azimuth", azimuth) + mounting.yaw
    cosine, sine = np.cos(angle), np.sin(angle)
    gain = np.stack([-cosine, -sine, mounting.y * cosine - mounting.x * sine], axis=-1)
    slope = np.stack([sine, -cosine, -mounting.y * sine - mounting.x * cosine], axis=-1)
    return gain, slope


def doppler_velocity(theta: ArrayLike, azimuth: ArrayLike, mounting: Mounting) -> Array:
    """Doppler velocity of static targets seen from a moving vehicle.

    Parameters
    ----------
    theta : (..., 3) array
        [v_x, v_y, omega] in m/s, m/s, rad/s.
    azimuth : (..., K) array, rad
        In the sensor frame.
    mounting : Mounting

    Returns
    -------
    (..., K) array, m/s, above 0 receding
        V = -(v_x - omega y_s) cos(phi + alpha_s) - (v_y + omega x_s) sin(phi + alpha_s)
        (thesis eq. 7.10; Barjenbruch et al. 2015).

    Raises
    ------
    ValueError
        If theta has no last axis of 3, an argument is not finite, or ``mounting`` is no `Mounting`.
    """
    motion = rigid.motion("theta", theta, 2)
    gain, _ = doppler_gradients(azimuth, mounting)
    if gain.ndim < 2:
        raise ValueError("azimuth must have the shape (..., K), but is a number")
    broadcast("theta and azimuth", motion.shape[:-1], gain.shape[:-2])
    return np.asarray(np.einsum("...kp,...p->...k", gain, motion))
