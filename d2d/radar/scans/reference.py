"""Reference motion of a vehicle, and recordings that hold one beside their scans."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from d2d import rigid
from d2d._checks import POSITIVE, SECONDS, Bounded, check_finite, check_real, check_shape, number
from d2d._frozen import Frozen
from d2d._types import Array
from d2d.radar.scans.budget import ErrorBudget
from d2d.radar.scans.scan import Mounting, RadarScan

_HALF_WIDTH = SECONDS._replace(above=0.0, most=60.0)  # s
_ROUNDING = 1e-6  # s, of times since 1970
_MIN_POSES = 5  # of a parabola: two more than it has coefficients


@dataclass(frozen=True, eq=False)
class Reference(Frozen):
    """The motion at the time of each scan: the truth of a simulation, or from another sensor.

    At the ``times`` (n,) in s, ``theta`` (n, 3) is the velocity [v_x, v_y, omega] of the vehicle
    frame's origin along its axes, in m/s, m/s, rad/s, and ``poses`` (n, 3) the pose [x, y, yaw] in
    the world, in m, m, rad; yaw may wrap.  Both are nan where they are not known.
    """

    times: Array
    theta: Array
    poses: Array

    def __post_init__(self) -> None:
        self._keep("times", check_finite("times", self.times, "(n,)"))
        for name in ("theta", "poses"):
            values = check_real(name, getattr(self, name))
            check_shape(name, values, f"({len(self.times)}, 3)", like="times")
            self._keep(name, values)

    @classmethod
    def from_poses(
        cls, stamps: ArrayLike, poses: ArrayLike, times: ArrayLike, *, half_width: float = 0.2
    ) -> "Reference":
        """The motion at ``times`` from poses alone, such as those of a localisation.

        Value and slope of a parabola (Savitzky-Golay), fitted to the poses (n, 3) at ``stamps``
        (n,) in s, strictly increasing, within ``half_width`` (s) of a time.  They are nan where
        poses are missing before or after the time, or fewer than five are within reach.
        """
        known = check_finite("stamps", stamps, "(n,)")
        wanted = check_finite("times", times, "(n,)")
        placed = check_finite("poses", poses, f"({len(known)}, 3)", like="stamps")
        if not (np.diff(known) > 0).all():
            raise ValueError("stamps must be strictly increasing, but are not")
        reach = _HALF_WIDTH.number("half_width", half_width)
        placed = np.column_stack([placed[:, :2], np.unwrap(placed[:, 2])])
        value, slope = np.full((2, len(wanted), 3), np.nan)
        # rounding must not decide whether poses that are half_width away are in reach
        first = np.searchsorted(known, wanted - reach - _ROUNDING)
        last = np.searchsorted(known, wanted + reach + _ROUNDING, side="right")
        for i, (low, high) in enumerate(zip(first, last, strict=True)):
            if high - low < _MIN_POSES or not known[low] <= wanted[i] <= known[high - 1]:
                continue
            powers = np.vander((known[low:high] - wanted[i]) / reach, 3)
            origin = placed[low]  # coordinates in a map are large, displacements in reach small
            fit = np.linalg.lstsq(powers, placed[low:high] - origin, rcond=None)[0]
            value[i], slope[i] = fit[2] + origin, fit[1] / reach
        turned = rigid.rotation(-value[:, 2]) @ slope[:, :2, None]
        return cls(wanted, np.column_stack([turned[..., 0], slope[:, 2]]), value)

    def at(self, times: ArrayLike, *, max_gap: float = 1.0) -> "Reference":
        """The motion at other times (m,) in s, by linear interpolation.

        It is nan outside the reference's time span, and in gaps longer than ``max_gap`` (s).
        Raises a ``ValueError`` if the reference's own times are out of order.
        """
        wanted = check_finite("times", times, "(n,)")
        POSITIVE.number("max_gap", max_gap)
        if not len(self.times) or (np.diff(self.times) < 0.0).any():
            raise ValueError("the reference must have times, in order, to be interpolated")
        after = np.clip(np.searchsorted(self.times, wanted), 0, len(self.times) - 1)
        before = np.maximum(after - (self.times[after] != wanted), 0)
        hole = self.times[after] - self.times[before] > max_gap + _ROUNDING
        rows = np.column_stack([self.theta, self.poses])
        known = np.isfinite(rows[:, 5])
        rows[known, 5] = np.unwrap(rows[known, 5])  # half way from pi to -pi is not zero
        found = [np.interp(wanted, self.times, c, left=np.nan, right=np.nan) for c in rows.T]
        theta, poses = np.where(hole, np.nan, found).reshape(2, 3, -1).swapaxes(1, 2).copy()
        return Reference(wanted, theta, poses)


@dataclass(frozen=True, eq=False)
class Recording:
    """One sensor's scans of a drive, its mounting, and the motion according to other sensors.

    The reference is at the scans' times, nan where it is not known; the budget is for `track`.
    """

    scans: list[RadarScan]
    mounting: Mounting
    reference: Reference
    budget: ErrorBudget | None = None


@dataclass(frozen=True)
class SlipLaw(Bounded):
    r"""The lateral velocity in a steady bend, :math:`v_y = (ahead - compliance\, v_x^2)\, \omega`.

    The rear axle, which the vehicle frame's origin is ``ahead`` of (m), slips by the angle
    -``compliance`` (s²/m) v_x omega (linear single-track model: Riekert & Schunck 1940).
    """

    ahead: float = number(0.0)
    compliance: float = number(0.0)

    def lateral(self, forward: ArrayLike, yaw_rate: ArrayLike) -> Array:
        """v_y (...) in m/s of v_x (...) in m/s and omega (...) in rad/s."""
        v_x, omega = np.asarray(forward), np.asarray(yaw_rate)
        return np.asarray((self.ahead - self.compliance * v_x**2) * omega)
