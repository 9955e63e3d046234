"""Two scans of one sensor as a registration problem in terms of the vehicle's velocity."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from d2d import rigid
from d2d._checks import check_instance
from d2d._types import Array
from d2d.measurement import LinearMeasurement
from d2d.point_set import PointSet
from d2d.radar.options import EgoMotionModel
from d2d.radar.scan import Mounting, RadarScan

_SERIES = 0.3  # rad; below it the closed form suffers from cancellation and a series is used
_TERMS = 12  # truncation error below 4e-15 even in the second derivative
_MEAN = [1j**k / math.factorial(k + 1) for k in range(_TERMS, -1, -1)]
_SLOPE = [complex(c) for c in np.polyder(_MEAN)]
_BEND = [complex(c) for c in np.polyder(_MEAN, 2)]


class Pair(NamedTuple):
    """Two scans of one sensor, ``interval`` seconds apart, in the vehicle frame."""

    fixed: PointSet
    moving: PointSet
    measurement: LinearMeasurement | None
    interval: float
    model: EgoMotionModel

    @classmethod
    def of(
        cls, previous: RadarScan, current: RadarScan, mounting: Mounting, model: EgoMotionModel
    ) -> "Pair":
        """Set up the problem; for arguments and errors see `d2d.radar.estimate_ego_motion`."""
        for name, scan in (("previous", previous), ("current", current)):
            check_instance(name, scan, RadarScan)
        interval = current.time - previous.time
        if not interval > 0:
            raise ValueError(
                f"current must be later than previous, but is at {current.time:.6f} s after "
                f"{previous.time:.6f} s"
            )
        for name, scan in (("previous", previous), ("current", current)):
            if not scan.size:
                raise ValueError(f"{name} holds no targets")
        measurement = current.doppler_measurement(
            mounting, interval, of_twist=not model.first_order
        )
        return cls(
            previous.point_set(mounting),
            current.point_set(mounting),
            measurement if model.doppler else None,
            interval,
            model,
        )

    def motion(self, theta: Array) -> Array:
        """The motion (..., 3) over the interval at the velocity theta (..., 3)."""
        twist = theta * self.interval
        return twist if self.model.first_order else rigid.exponential(twist)

    def inflated(self, scale: float) -> "Pair":
        """The problem with all standard deviations multiplied by ``scale``."""
        measurement = None if self.measurement is None else self.measurement.inflated(scale)
        return self._replace(
            fixed=self.fixed.inflated(scale),
            moving=self.moving.inflated(scale),
            measurement=measurement,
        )

    def inlier_probabilities(self, theta: Array) -> Array:
        """Probability (..., K) that each target of the current scan is an inlier."""
        return self.model.cost.inlier_probabilities(
            self.motion(theta), self.fixed, self.moving, measurement=self.measurement
        )

    def derivatives(self, theta: Array) -> tuple[float, Array, Array]:
        """Cost with exact gradient (3,) and Hessian (3, 3) in the velocity theta (3,).

        By the chain rule through m(theta) = exp(interval theta), they are J'g and
        J'HJ + sum_c g_c d^2 m_c / dtheta^2, where J = dm/dtheta, and g and H are the cost's
        gradient and Hessian in the motion.
        """
        value, gradient, hessian = self.model.cost.derivatives(
            self.motion(theta), self.fixed, self.moving, measurement=self.measurement
        )
        if self.model.first_order:
            first, second = np.eye(3), np.zeros((3, 3, 3))
        else:
            first, second = exponential_derivatives(theta * self.interval)
        first, second = first * self.interval, second * self.interval**2
        curved = np.einsum("c,cij->ij", gradient, second)
        return float(value), gradient @ first, first.T @ hessian @ first + curved


def exponential_derivatives(twist: ArrayLike) -> tuple[Array, Array]:
    """First (3, 3) and second (3, 3, 3) derivatives of `d2d.rigid.exponential` at ``twist`` (3,).

    With vectors of the plane as complex numbers, the translation is E(w) v, where
    E(w) = (exp(iw) - 1) / (iw) is the mean direction while turning by w.
    """
    x, y, w = np.asarray(twist, dtype=np.float64)
    v = complex(x, y)
    mean, slope, bend = _mean_direction(float(w))
    columns = np.array([mean, 1j * mean, slope * v])  # d t / d(v_x, v_y, w)
    first = np.array([columns.real, columns.imag, [0.0, 0.0, 1.0]])
    mixed = np.zeros((3, 3), dtype=complex)
    mixed[0, 2] = mixed[2, 0] = slope
    mixed[1, 2] = mixed[2, 1] = 1j * slope
    mixed[2, 2] = bend * v
    return first, np.stack([mixed.real, mixed.imag, np.zeros((3, 3))])


def _mean_direction(w: float) -> tuple[complex, complex, complex]:
    """E(w) = (exp(iw) - 1) / (iw) with its first two derivatives."""
    if abs(w) < _SERIES:  # sum_k (iw)^k / (k + 1)!
        return _horner(_MEAN, w), _horner(_SLOPE, w), _horner(_BEND, w)
    turned = np.exp(1j * w)
    mean = (turned - 1.0) / (1j * w)
    slope = (turned - mean) / w
    return mean, slope, (1j * turned - 2.0 * slope) / w


def _horner(coefficients: list[complex], w: float) -> complex:
    """Evaluate a polynomial, highest coefficient first; ten times as fast as NumPy's."""
    value = 0j
    for coefficient in coefficients:
        value = value * w + coefficient
    return value
