"""A scan of a Doppler radar, and the mounting of the sensor on the vehicle."""

from __future__ import annotations  # so that help() shows ArrayLike, not all that it is

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from d2d import rigid
from d2d._checks import (
    ANGLE,
    FINITE,
    METRES,
    NOT_NEGATIVE,
    POSITIVE,
    Bounded,
    Bounds,
    broadcast_batches,
    check_covariances,
    check_finite,
    check_instance,
    check_members,
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
_STEEPEST = 0.05  # cosine of the elevation beyond which a target shows no horizontal motion
_LONGEST = 1e7  # ratio of the axes of a covariance, beyond which it may round to a singular one
_LEAST = 1e-9  # of standard deviations, whose squares the cost can hold beside others

# What a scan's columns hold; a radar of a vehicle sees no target beyond 10 km.
BOUNDS = {
    "range": METRES._replace(above=0.0, most=1e4, hint="; are these millimetres or centimetres?"),
    "azimuth": ANGLE,
    "doppler": _SPEED,
    "sigma_range": METRES._replace(above=0.0, least=_LEAST, most=1e4),
    "sigma_azimuth": ANGLE._replace(above=0.0, least=_LEAST),
    "sigma_doppler": _SPEED._replace(above=0.0, least=_LEAST),
    "extent": NOT_NEGATIVE._replace(most=1e4),
    "elevation": ANGLE._replace(most=0.5 * np.pi * (1.0 + 1e-6)),
    "sigma_elevation": ANGLE._replace(least=0.0),
}
MEASURED = ("range", "azimuth", "doppler")  # of each target
SIGMAS = ("sigma_range", "sigma_azimuth", "sigma_doppler")
UPWARDS = ("elevation", "sigma_elevation")
ANGLES = ("azimuth", "sigma_azimuth", *UPWARDS)


@dataclass(frozen=True)
class Mounting(Bounded):
    """Pose of the sensor in the vehicle frame: x forward and y left in m, angles in rad.

    The yaw is the direction of the boresight, counter-clockwise from the x axis; a pitch is
    positive if the sensor looks down, a roll, applied before, if its left side is raised (REP 103).
    Raises a ``ValueError`` if x or y is beyond 100 m, or an angle beyond 2π.
    """

    x: float = number(0.0, _LEVER)
    y: float = number(0.0, _LEVER)
    yaw: float = number(0.0, ANGLE)
    pitch: float = number(0.0, ANGLE)
    roll: float = number(0.0, ANGLE)

    @property
    def pose(self) -> Array:
        """[x, y, yaw] as a rigid motion from the sensor frame to the vehicle frame."""
        return np.array([self.x, self.y, self.yaw])

    @property
    def flat(self) -> Mounting:
        """The mounting without pitch and roll, which belongs to scans that `level` gives."""
        return replace(self, pitch=0.0, roll=0.0)


@dataclass(frozen=True, eq=False)
class RadarScan(Frozen):
    """The targets of one scan in the sensor frame, with their standard deviations.

    The scan at ``time`` (s) has the arrays (K,) ``range`` in m, ``azimuth`` in rad,
    counter-clockwise from the boresight, and ``doppler`` in m/s, positive for receding targets; K
    may be 0.  The standard deviations ``sigma_range``, ``sigma_azimuth`` and ``sigma_doppler`` are
    numbers or arrays (K,) in the same units, and so is the ``extent`` in m, by which a target's
    reflection point scatters along each axis.  With an ``elevation`` (K,) in rad, positive upwards,
    range and Doppler velocity are along the inclined line of sight; the ``sigma_elevation`` in rad
    is by default that of the azimuth.

    Raises a ``ValueError`` if a range or standard deviation is not positive or so large or small
    that no covariance can hold it, an azimuth beyond 2π or an elevation beyond a right angle.

    Examples
    --------
    >>> from d2d.radar import RadarScan
    >>> scan = RadarScan(0.0, [14, 31], [0.3, 0], [-8.9, -9.3], 0.1, 0.01, 0.06)
    >>> scan[scan.range < 20.0].doppler
    array([-8.9])
    """

    time: float
    range: Array
    azimuth: Array
    doppler: Array
    sigma_range: Array
    sigma_azimuth: Array
    sigma_doppler: Array
    extent: Array
    elevation: Array
    sigma_elevation: Array

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
        *,
        elevation: ArrayLike | None = None,
        sigma_elevation: ArrayLike | None = None,
    ) -> None:
        self._keep("time", FINITE.number("time", time))
        if sigma_elevation is None:
            sigma_elevation = 0.0 if elevation is None else sigma_azimuth
        if elevation is None:
            elevation = np.zeros(np.shape(range))
        measured, sigmas = (range, azimuth, doppler), (sigma_range, sigma_azimuth, sigma_doppler)
        given = (*measured, *sigmas, extent, elevation, sigma_elevation)
        shape, like = "(K,)", ""
        for (name, bounds), values in zip(BOUNDS.items(), given, strict=True):
            array = bounds.array(name, values)
            if name not in (*MEASURED, "elevation") and array.shape in ((), (1,)):
                array = np.full(self.range.shape, array)
            check_shape(name, array, shape, like=like)
            self._keep(name, array)
            shape, like = str(self.range.shape), "range"
        if not _regular(self.range, self.sigma_range, self.sigma_azimuth, self.extent).all():
            raise ValueError(
                "sigma_range and range * sigma_azimuth must not differ by more than a factor of "
                f"{_LONGEST:g}"
            )

    @classmethod
    def from_cartesian(
        cls,
        time: float,
        x: ArrayLike,
        y: ArrayLike,
        z: ArrayLike | None = None,
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
        sigma_elevation: ArrayLike = 0.0,
    ) -> RadarScan:
        """The scan of a radar that reports positions, such as a list of objects or clusters.

        The positions x along the boresight, y to the left and, with elevations, z upwards are
        arrays (K,) in m in the sensor frame.  Targets have either radial velocities ``doppler``
        (K,), positive if they recede, or a ``velocity`` (K, 2), with z (K, 3), in m/s relative to
        the sensor, not compensated for its motion, of which the part along the sight counts.

        The variances of all given errors are added: of the standard deviations, as for `RadarScan`;
        of the ``covariance`` (K, D, D) or (D, D) of the position in m², along and across the line
        of sight; and of rounding, to multiples of ``grid`` (m) in positions and of ``step`` (m/s)
        in velocities; see `quantisation_sigma`.

        Raises a ``ValueError`` if a target is at, above or below the sensor, or there is no error
        of the range, the azimuth or the Doppler velocity.
        """
        ahead = check_finite("x", x, "(K,)")
        left = check_finite("y", y, str(ahead.shape), like="x")
        up = check_finite("z", z, str(ahead.shape), like="x") if z is not None else 0.0 * ahead
        across = np.hypot(ahead, left)
        if not (across > 0).all():
            raise ValueError("x and y must not both be zero, but a target is at the sensor")
        size, axes, distance = len(across), 2 if z is None else 3, np.hypot(across, up)
        sight = np.column_stack([ahead, left, up]) / distance[:, None]
        sideways = np.column_stack([-left, ahead, 0.0 * up]) / across[:, None]
        frame = np.stack([sight, sideways, np.cross(sight, sideways)])[..., :axes]
        if velocity is not None and doppler is None:
            vectors = check_finite("velocity", velocity, f"({size}, {axes})", like="x")
            doppler = np.einsum("ki,ki->k", vectors, frame[0])
        elif velocity is not None or doppler is None:
            raise ValueError("either doppler or velocity must be given, and not both")
        spread = np.zeros((size, axes, axes))
        if covariance is not None:
            given = check_covariances("covariance", covariance)
            check_shape("covariance", given, f"({size}, {axes}, {axes})", f"({axes}, {axes})")
            spread += given
        if grid is not None:
            spread += quantisation_sigma(grid, "grid") ** 2 * np.eye(axes)
        along, beside, above = np.einsum("dki,kij,dkj->dk", frame, spread, frame)
        rounding = 0.0 if step is None else quantisation_sigma(step, "step")
        raised = np.sqrt(_variance("sigma_elevation", sigma_elevation, size) + above / distance**2)
        return cls(
            time,
            distance,
            np.arctan2(left, ahead),
            doppler,
            np.sqrt(_variance("sigma_range", sigma_range, size) + along),
            np.sqrt(_variance("sigma_azimuth", sigma_azimuth, size) + beside / across**2),
            np.sqrt(_variance("sigma_doppler", sigma_doppler, size) + rounding**2),
            extent,
            elevation=None if z is None else np.arctan2(up, across),
            sigma_elevation=None if z is None or not raised.any() else raised,
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

    def within(
        self,
        range: tuple[float, float] | None = None,
        azimuth: tuple[float, float] | None = None,
        elevation: tuple[float, float] | None = None,
    ) -> RadarScan:
        """The scan with only the targets between two ranges (m), azimuths or elevations (rad)."""
        kept = np.ones(len(self), dtype=np.bool_)
        for name, gate in {"range": range, "azimuth": azimuth, "elevation": elevation}.items():
            if gate is not None:
                low, high = check_finite(name, gate, "(2,)")
                if not low < high:
                    raise ValueError(f"{name} must be a lower and a higher limit, but is {gate}")
                kept &= (getattr(self, name) >= low) & (getattr(self, name) <= high)
        return self if kept.all() else self[kept]

    __iter__ = None  # else Python would try the indices 0, 1, ... and stop at the first IndexError

    def point_set(self, mounting: Mounting) -> PointSet:
        """The targets as Gaussians in the vehicle frame (thesis eq. 7.1, 7.3 and 7.4).

        The extent is added.  Raises a ``ValueError`` if the scan is empty.
        """
        check_instance("mounting", mounting, Mounting)
        return _placed(*level(self, mounting))

    def doppler_measurement(
        self,
        mounting: Mounting,
        interval: float,
        *,
        of_twist: bool = True,
        ahead: Array | None = None,
    ) -> LinearMeasurement:
        """The Doppler velocities as a measurement of the motion over ``interval`` seconds.

        They are linear in the twist, ``interval`` times the body velocity; the azimuth's error
        enters through their derivative (thesis sec. 7.1).  If not ``of_twist``, the translation is
        v tau, as in the thesis.  The velocity at the scan is ``ahead`` (3,) of the interval's mean.
        """
        check_instance("mounting", mounting, Mounting)
        POSITIVE.number("interval", interval)
        scan, mounting = level(self, mounting)
        gain, slope = _gradients(*_direction(scan, mounting), mounting)
        value = scan.doppler if ahead is None else scan.doppler - gain @ ahead
        sigmas = scan.sigma_doppler, scan.sigma_azimuth
        return LinearMeasurement._made(value, *sigmas, gain / interval, slope / interval, of_twist)


def quantisation_sigma(step: float, name: str = "step") -> float:
    """Standard deviation of the error of a value that is rounded to multiples of ``step``.

    The error is uniform over a step, with the variance step² / 12, which adds to that of the
    measurement.  A ``ValueError`` calls the argument ``name``.
    """
    return float(_STEP.number(name, step) / np.sqrt(12.0))


def _variance(name: str, sigma: ArrayLike, size: int) -> Array:
    """Squares of standard deviations, which may be zero where other errors add to them."""
    array = NOT_NEGATIVE.array(name, sigma)
    if array.shape not in ((), (1,)):
        check_shape(name, array, f"({size},)", like="x")
    return array**2


def _regular(distance: Array, along: Array, angle: Array, extent: Array) -> NDArray[np.bool_]:
    """Mask (K,) of targets with errors (m, rad) whose covariance does not round to a singular."""
    ratio = np.hypot(distance * angle, extent) / np.hypot(along, extent)
    return np.asarray((ratio < _LONGEST) & (ratio > 1.0 / _LONGEST))


@lru_cache(maxsize=64)
def level(scan: RadarScan, mounting: Mounting) -> tuple[RadarScan, Mounting]:
    """The scan that a sensor with its axes in the plane would have taken, and its mounting.

    With w = R_y(pitch) R_x(roll) u, the direction of a target along axes of which x and y lie in
    the plane, and h = hypot(w_x, w_y), the plane sees it at the range h r, in the direction
    atan2(w_y, w_x), with the Doppler velocity V / h.  The errors of azimuth and elevation are
    propagated to first order.  Targets within 3° of the vertical or beyond `BOUNDS` are left out.
    """
    if not (mounting.pitch or mounting.roll or scan.elevation.any()):
        return scan, mounting
    tilts = [mounting.pitch, mounting.roll]
    (c, d), (s, t) = np.cos(tilts), np.sin(tilts)
    to_plane = np.array([c, s * t + 1.0j * d, s * d - 1.0j * t])  # x and y as a complex number
    sight = to_plane @ _sight(scan.azimuth, scan.elevation)
    seen = np.abs(sight) > _STEEPEST
    scan, sight = scan[seen], sight[seen]
    share = np.abs(sight)
    aside = np.cos(scan.elevation) * _sight(scan.azimuth + 0.5 * np.pi)
    above = _sight(scan.azimuth, scan.elevation + 0.5 * np.pi)
    # what a standard deviation of azimuth and elevation adds along and across the direction
    moved = to_plane @ np.stack([aside, above]) * [scan.sigma_azimuth, scan.sigma_elevation]
    moved *= sight.conj() / share
    of_share, of_direction = np.hypot(*moved.real), np.hypot(*moved.imag)
    columns = (
        scan.range * share,
        np.angle(sight),
        scan.doppler / share,
        np.hypot(scan.sigma_range * share, scan.range * of_share),
        of_direction / share,
        np.hypot(scan.sigma_doppler, scan.doppler * of_share / share) / share,
        scan.extent,
        *np.zeros((2, scan.size)),  # elevations
    )
    held = _regular(columns[0], columns[3], columns[4], scan.extent)
    for bounds, column in zip(BOUNDS.values(), columns, strict=True):
        held &= bounds.hold(column)
    return RadarScan._made(scan.time, *(each[held] for each in columns)), mounting.flat


def _sight(azimuth: Array, elevation: Array | float = 0.0) -> Array:
    """Unit vectors (3, K) in the sensor frame."""
    across = np.cos(elevation)
    up = np.sin(elevation) * np.ones_like(azimuth)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), up])


@lru_cache(maxsize=64)
def _placed(scan: RadarScan, mounting: Mounting) -> PointSet:
    """The scan's point set, cached because a drive uses it in several pairs."""
    polar = scan.range, scan.sigma_range, scan.sigma_azimuth
    return PointSet._of_polar(polar, _direction(scan, mounting), scan.extent, mounting.pose[:2])


@lru_cache(maxsize=64)
def _direction(scan: RadarScan, mounting: Mounting) -> tuple[Array, Array]:
    """Cosine and sine (K,) of the targets' azimuths in the vehicle frame."""
    angle = scan.azimuth + mounting.yaw
    return read_only(np.cos(angle), -1), read_only(np.sin(angle), -1)


def doppler_gradients(azimuth: Array, mounting: Mounting) -> tuple[Array, Array]:
    """dV/dθ and d²V/(dφ dθ), each (..., 3), of a static target at ``azimuth`` (...)."""
    angle = azimuth + mounting.yaw
    return _gradients(np.cos(angle), np.sin(angle), mounting)


def _gradients(cosine: Array, sine: Array, mounting: Mounting) -> tuple[Array, Array]:
    """The gradients for a direction in the vehicle frame, as `doppler_gradients`."""
    gain, slope = np.empty((2, *cosine.shape, 3))
    gain[..., 0], gain[..., 1] = -cosine, -sine
    gain[..., 2] = mounting.y * cosine - mounting.x * sine
    slope[..., 0], slope[..., 1] = sine, -cosine
    slope[..., 2] = -mounting.y * sine - mounting.x * cosine
    return gain, slope


def doppler_velocity(theta: ArrayLike, azimuth: ArrayLike, mounting: Mounting) -> Array:
    r"""Doppler velocities (..., K) in m/s of static targets, positive if they recede.

    :math:`-(v_x - \omega y_s) \cos(\phi+\alpha_s) - (v_y + \omega x_s) \sin(\phi+\alpha_s)` (thesis
    eq. 7.10; Barjenbruch et al. 2015), with ``theta`` (..., 3) = [v_x, v_y, omega] in m/s, m/s,
    rad/s of the vehicle, and the ``azimuth`` phi (..., K) in rad of the sensor.
    """
    check_instance("mounting", mounting, Mounting)
    motion = rigid.motion("theta", theta, 2)
    gain, _ = doppler_gradients(BOUNDS["azimuth"].array("azimuth", azimuth), mounting)
    check_shape("azimuth", gain[..., 0], "(..., K)")
    broadcast_batches("theta and azimuth", motion.shape[:-1], gain.shape[:-2])
    return np.asarray(np.einsum("...kp,...p->...k", gain, motion))


def over_ground_undone(
    scans: Sequence[RadarScan], theta: Array, mounting: Mounting
) -> list[RadarScan]:
    """Scans as measured, of a sensor that compensated its motion by velocities (n, 3) ``theta``."""
    scans = check_members("scans", scans, RadarScan)
    theta = check_finite("theta", theta, f"({len(scans)}, 3)", like="scans")
    return [
        replace(scan, doppler=scan.doppler + doppler_velocity(velocity, scan.azimuth, mounting))
        for scan, velocity in zip(scans, theta, strict=True)
    ]


def unfolded(
    scans: Sequence[RadarScan], theta: Array, mounting: Mounting, limit: float
) -> list[RadarScan]:
    """Unfold Doppler velocities from +-``limit`` (m/s), to the values nearest to static targets'.

    The velocities ``theta`` (n, 3) of the vehicle need not be exact: to within ``limit`` is enough.
    """
    POSITIVE.number("limit", limit)
    over_ground = over_ground_undone(scans, -check_finite("theta", theta), mounting)
    return [
        replace(scan, doppler=scan.doppler - 2.0 * limit * np.round(0.5 * own.doppler / limit))
        for scan, own in zip(scans, over_ground, strict=True)
    ]
