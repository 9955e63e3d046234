"""A scan of a Doppler radar, and the mounting of the sensor on the vehicle."""

from __future__ import annotations  # so that help() shows ArrayLike, not all that it is

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from d2d import rigid
from d2d._checks import (
    ANGLE,
    METRES,
    NOT_NEGATIVE,
    POSITIVE,
    Bounded,
    Bounds,
    broadcast_batches,
    check_covariances,
    check_finite,
    check_positive_scalar,
    check_scalar,
    check_shape,
    number,
)
from d2d._frozen import Frozen
from d2d._kernel.compile import read_only
from d2d._types import Array, Selection
from d2d.measurement import LinearMeasurement
from d2d.point_set import PointSet

_LEVER = METRES._replace(most=100.0)  # m, from the vehicle's origin
_STEP = POSITIVE._replace(most=1e50)  # its square is finite

_SPEED = Bounds(most=1e4, unit="in m/s, ", hint="; are these millimetres per second?")
_LEAST = 1e-9  # of standard deviations, whose squares the cost can hold beside others
_LONGEST = 1e9  # ratio of the axes of a target's covariance, beyond which it is singular in float64

# What a scan's columns hold; a radar of a vehicle sees no target beyond 10 km.
BOUNDS = {
    "range": METRES._replace(above=0.0, most=1e4, hint="; are these millimetres or centimetres?"),
    "azimuth": ANGLE,
    "doppler": _SPEED,
    "sigma_range": METRES._replace(above=0.0, least=_LEAST, most=1e4),
    "sigma_azimuth": ANGLE._replace(above=0.0, least=_LEAST),
    "sigma_doppler": _SPEED._replace(above=0.0, least=_LEAST),
    "extent": NOT_NEGATIVE._replace(most=1e4),
}
MEASURED = ("range", "azimuth", "doppler")  # of each target; one of the others may stand for all
SIGMAS = ("sigma_range", "sigma_azimuth", "sigma_doppler")


@dataclass(frozen=True)
class Mounting(Bounded):
    """Pose of the sensor in the vehicle frame: x forward and y left in m, yaw in rad.

    The yaw is the direction of the boresight, counter-clockwise from the x axis.  Raises a
    ``ValueError`` if a number is not finite, x or y is beyond 100 m, or the yaw beyond 2 pi.
    """

    x: float = number(0.0, _LEVER)
    y: float = number(0.0, _LEVER)
    yaw: float = number(0.0, ANGLE)

    @property
    def pose(self) -> Array:
        """[x, y, yaw] as a rigid motion from the sensor frame to the vehicle frame."""
        return np.array([self.x, self.y, self.yaw])


@dataclass(frozen=True, eq=False)
class RadarScan(Frozen):
    """The targets of one scan in the sensor frame, with their standard deviations.

    The scan at ``time`` (s) has the arrays (K,) ``range`` in m, ``azimuth`` in rad, measured
    counter-clockwise from the boresight, and ``doppler`` in m/s, positive for receding targets; K
    may be 0.  The standard deviations ``sigma_range``, ``sigma_azimuth`` and ``sigma_doppler`` are
    numbers or arrays (K,) in the same units.  The ``extent``, too, a number or an array (K,) in m,
    is a standard deviation along each axis: how far a target's reflection point lies from the point
    that the other scans see, because each scan sees different points of an object.  It is zero for
    point targets; see `estimate_extent`.

    Raises a ``ValueError`` if a range or standard deviation is not positive or so large or small
    that no covariance can hold it, a range beyond 10 km or an azimuth beyond 2 pi.

    Examples
    --------
    >>> from d2d.radar import RadarScan
    >>> scan = RadarScan(12.05, [14.2, 31.0], [-0.31, 0.02], [-8.92, -9.3], 0.15, 0.009, 0.06)
    >>> scan
    RadarScan(time=12.050000 s, 2 targets)
    >>> scan[scan.range < 20.0].doppler
    array([-8.92])
    """

    time: float
    range: Array
    azimuth: Array
    doppler: Array
    sigma_range: Array
    sigma_azimuth: Array
    sigma_doppler: Array
    extent: Array

    def __init__(
        self,
        time: float,
        range: ArrayLike,
        azimuth: ArrayLike,
        doppler: ArrayLike,
        sigma_range: ArrayLike,
        sigma_azimuth: ArrayLike,
        sigma_doppler: ArrayLike,
        extent: ArrayLike = 0.0,
    ) -> None:
        self._keep("time", check_scalar("time", time))
        given = (range, azimuth, doppler, sigma_range, sigma_azimuth, sigma_doppler, extent)
        arrays = {
            name: bounds.array(name, values)
            for (name, bounds), values in zip(BOUNDS.items(), given, strict=True)
        }
        shape = arrays["range"].shape
        check_shape("range", arrays["range"], "(K,)")
        for name, array in arrays.items():
            once = name not in MEASURED and array.shape in ((), (1,))
            if not once:
                check_shape(name, array, str(shape), like="range")
            self._keep(name, np.full(shape, array) if once else array)
        across = np.hypot(self.range * self.sigma_azimuth, self.extent)
        along = np.hypot(self.sigma_range, self.extent)
        longest = np.maximum(across, along) > _LONGEST * np.minimum(across, along)
        if longest.any():
            i = int(np.argmax(longest))
            raise ValueError(
                "sigma_range and range * sigma_azimuth must not differ by more than a factor of "
                f"{_LONGEST:g}, but are {along[i]:g} m and {across[i]:g} m at target {i}"
            )

    @classmethod
    def from_cartesian(
        cls,
        time: float,
        x: ArrayLike,
        y: ArrayLike,
        *,
        doppler: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        covariance: ArrayLike | None = None,
        grid: float | None = None,
        sigma_range: ArrayLike = 0.0,
        sigma_azimuth: ArrayLike = 0.0,
        sigma_doppler: ArrayLike = 0.0,
        step: float | None = None,
        extent: ArrayLike = 0.0,
    ) -> RadarScan:
        """The scan of a radar that reports positions, such as a list of objects or clusters.

        The targets have the positions x along the boresight and y to the left, (K,) arrays in m in
        the sensor frame.  They have either the radial velocities ``doppler``, (K,) in m/s, positive
        for receding targets, or a ``velocity``, (K, 2) in m/s, relative to the sensor and not
        compensated for its own motion.  This is projected onto the line of sight: a Doppler radar
        measures nothing else.  ``time`` and ``extent`` are as for `RadarScan`.

        The variances of all errors that are given are added: those of the standard deviations
        ``sigma_range``, ``sigma_azimuth`` and ``sigma_doppler``, numbers or (K,) arrays in m, rad,
        m/s; the ``covariance`` of the position, (K, 2, 2) or (2, 2) in m^2; and those of rounding.
        ``grid`` (m) is the spacing of the values to which x and y are rounded, and ``step`` (m/s)
        that of the Doppler velocity or each component of the velocity; see `quantisation_sigma`.

        A scan stores one standard deviation along the line of sight and one across it, so a
        covariance is projected onto both directions, and the correlation between them is dropped.
        Raises a ``ValueError`` if a target is at the sensor's position, or there is no error of the
        range, the azimuth or the Doppler velocity.
        """
        ahead = check_finite("x", x, "(K,)")
        left = check_finite("y", y, str(ahead.shape), like="x")
        distance = np.hypot(ahead, left)
        if not (distance > 0).all():
            raise ValueError("x and y must not both be zero, but a target is at the sensor")
        size = len(distance)
        sight = np.stack([ahead, left], axis=-1) / distance[:, None]
        sideways = np.stack([-sight[:, 1], sight[:, 0]], axis=-1)
        spread = _position_covariances(covariance, grid, size)
        along, beside = (np.einsum("ki,kij,kj->k", d, spread, d) for d in (sight, sideways))
        rounding = 0.0 if step is None else quantisation_sigma(step, "step")
        return cls(
            time,
            distance,
            np.arctan2(left, ahead),
            _radial(doppler, velocity, sight),
            np.sqrt(_variance("sigma_range", sigma_range, size) + along),
            np.sqrt(_variance("sigma_azimuth", sigma_azimuth, size) + beside / distance**2),
            np.sqrt(_variance("sigma_doppler", sigma_doppler, size) + rounding**2),
            extent,
        )

    @property
    def size(self) -> int:
        """Number K of targets."""
        return len(self.range)

    def __len__(self) -> int:
        return len(self.range)

    def __repr__(self) -> str:
        return f"RadarScan(time={self.time:.6f} s, {len(self)} targets)"

    def __getitem__(self, index: Selection) -> RadarScan:
        """The scan with only those targets that a slice, a mask or a list of indices selects."""
        which: Any = index  # NumPy's own types do not take so many kinds at once
        if np.ndim(self.range[which]) != 1:
            raise IndexError("a scan is indexed by a slice, a mask or a list, not by a number")
        columns = (np.ascontiguousarray(getattr(self, name)[which]) for name in BOUNDS)
        return RadarScan._made(self.time, *columns)

    def with_extent(self, extent: ArrayLike) -> RadarScan:
        """The scan with another ``extent``, a number or (K,) array in m."""
        return replace(self, extent=extent)  # type: ignore[arg-type] # what __init__ takes

    __iter__ = None  # else Python would try the indices 0, 1, ... and stop at the first IndexError

    def point_set(self, mounting: Mounting) -> PointSet:
        """The targets as Gaussians in the vehicle frame (thesis eq. 7.1, 7.3 and 7.4).

        The variance of the extent is added.  Raises a ``ValueError`` if the scan is empty.
        """
        return _placed(self, mounting)

    def doppler_measurement(
        self,
        mounting: Mounting,
        interval: float,
        *,
        of_twist: bool = True,
        ahead: Array | None = None,
    ) -> LinearMeasurement:
        """The Doppler velocities as a measurement of the motion over ``interval`` seconds.

        The Doppler velocity V is linear in the body velocity theta = [v_x, v_y, omega], and thus in
        the twist ``interval * theta``.  The azimuth's error enters through the derivative of V in
        the azimuth (thesis sec. 7.1).  If ``of_twist`` is False, the translation is taken as v tau,
        as in the thesis.  If it is known how far the velocity at the scan is ``ahead`` (3,) of the
        mean over the interval, that is taken off.
        """
        check_positive_scalar("interval", interval)
        gain, slope = doppler_gradients(self.azimuth, mounting)
        return LinearMeasurement._made(
            self.doppler if ahead is None else self.doppler - gain @ ahead,
            self.sigma_doppler,
            self.sigma_azimuth,
            gain / interval,
            slope / interval,
            of_twist,
        )


def quantisation_sigma(step: float, name: str = "step") -> float:
    """Standard deviation of the error of a value that is rounded to multiples of ``step``.

    The error is uniform over one step, so that the variance is step^2 / 12.  It adds to that of the
    measurement: ``np.hypot(sigma, quantisation_sigma(step))``.  Where the noise is much smaller
    than the step, rounding is not independent from one value to the next.  Errors call the argument
    ``name``.
    """
    return float(_STEP.number(name, step) / np.sqrt(12.0))


def _position_covariances(covariance: ArrayLike | None, grid: float | None, size: int) -> Array:
    """Covariances (K, 2, 2) of positions: those given, and the rounding's."""
    total = np.zeros((size, 2, 2))
    if covariance is not None:
        given = check_covariances("covariance", covariance)
        check_shape("covariance", given, f"({size}, 2, 2)", "(2, 2)")
        total += given
    if grid is not None:
        total += quantisation_sigma(grid, "grid") ** 2 * np.eye(2)
    return total


def _radial(doppler: ArrayLike | None, velocity: ArrayLike | None, sight: Array) -> Array:
    """The Doppler velocities (K,), or velocities (K, 2) projected onto the line of sight."""
    if doppler is not None and velocity is None:
        return check_finite("doppler", doppler)
    if doppler is not None or velocity is None:
        raise ValueError("either doppler or velocity must be given, and not both")
    vectors = check_finite("velocity", velocity, str(sight.shape), like="x")
    return np.asarray(np.einsum("ki,ki->k", vectors, sight))


def _variance(name: str, sigma: ArrayLike, size: int) -> Array:
    """Squares of standard deviations, which may be zero where other errors add to them."""
    array = NOT_NEGATIVE.array(name, sigma)
    if array.shape not in ((), (1,)):
        check_shape(name, array, f"({size},)", like="x")
    return array**2


@lru_cache(maxsize=64)
def _placed(scan: RadarScan, mounting: Mounting) -> PointSet:
    """The scan's point set; the latest are cached, because a drive uses each in several pairs."""
    polar = scan.range, scan.sigma_range, scan.sigma_azimuth
    origin = np.array([mounting.x, mounting.y])
    return PointSet._of_polar(polar, directions(scan, mounting), scan.extent, origin)


def directions(scan: RadarScan, mounting: Mounting) -> tuple[Array, Array]:
    """Cosine and sine (K,) of each target's azimuth in the vehicle frame."""
    angle = scan.azimuth + mounting.yaw
    return read_only(np.cos(angle), -1), read_only(np.sin(angle), -1)


@lru_cache(maxsize=64)
def cross_range(scan: RadarScan, mounting: Mounting) -> Array:
    """Derivative (K, 2) of each target's position in its azimuth, in m/rad in the vehicle frame."""
    means = _placed(scan, mounting).means
    slope = np.empty((scan.size, 2))
    slope[:, 0], slope[:, 1] = mounting.y - means[:, 1], means[:, 0] - mounting.x
    return read_only(slope, -1, 2)


def doppler_gradients(azimuth: Array, mounting: Mounting) -> tuple[Array, Array]:
    """dV/dtheta and d^2V/(dphi dtheta), each (..., 3), of a static target at ``azimuth`` (...)."""
    angle = azimuth + mounting.yaw
    cosine, sine = np.cos(angle), np.sin(angle)
    gain, slope = np.empty((*cosine.shape, 3)), np.empty((*cosine.shape, 3))
    gain[..., 0], gain[..., 1] = -cosine, -sine
    gain[..., 2] = mounting.y * cosine - mounting.x * sine
    slope[..., 0], slope[..., 1] = sine, -cosine
    slope[..., 2] = -mounting.y * sine - mounting.x * cosine
    return gain, slope


def doppler_velocity(theta: ArrayLike, azimuth: ArrayLike, mounting: Mounting) -> Array:
    """Doppler velocities (..., K) in m/s of static targets, positive if they recede.

    V = -(v_x - omega y_s) cos(phi + alpha_s) - (v_y + omega x_s) sin(phi + alpha_s) (thesis
    eq. 7.10; Barjenbruch et al. 2015).  ``theta`` (..., 3) is the vehicle's velocity
    [v_x, v_y, omega] in m/s, m/s, rad/s, and ``azimuth`` (..., K) in rad is in the sensor frame.
    """
    motion = rigid.motion("theta", theta, 2)
    gain, _ = doppler_gradients(BOUNDS["azimuth"].array("azimuth", azimuth), mounting)
    check_shape("azimuth", gain[..., 0], "(..., K)")
    broadcast_batches("theta and azimuth", motion.shape[:-1], gain.shape[:-2])
    return np.asarray(np.einsum("...kp,...p->...k", gain, motion))
