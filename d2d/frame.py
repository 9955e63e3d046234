"""Planar sets far from the origin, as in map coordinates, shifted to their means to compute.

A rotation about an origin a million metres away moves a target by metres for each microradian: the
translation then all but follows from the rotation, and no Newton step can tell the two apart.
"""

from typing import NamedTuple

import numpy as np

from d2d import rigid
from d2d._types import Array
from d2d.measurement import LinearMeasurement
from d2d.point_set import PointSet


def is_far(fixed: PointSet, moving: PointSet, measurement: LinearMeasurement | None) -> bool:
    """Whether two sets are to be shifted; with a measurement, the origin is where it was made."""
    planar = fixed.dimension == moving.dimension == 2
    return planar and measurement is None and (fixed._any_far or moving._any_far)


class Frame(NamedTuple):
    """The origins a and b about which a fixed and a moving set are taken.

    With fixed targets m - a and moving targets m - b, the motion [t, phi] becomes
    [t + R(phi) b - a, phi].
    """

    a: Array  # (..., 2)
    b: Array  # (..., 2)

    @classmethod
    def of_far_sets(cls, fixed: PointSet, moving: PointSet) -> "Frame":
        """The means of two sets, or zero for those sets of a batch that are near the origin."""
        return cls(_origin_if_far(fixed), _origin_if_far(moving))

    def shifted(self, fixed: PointSet, moving: PointSet) -> tuple[PointSet, PointSet]:
        """The sets about their means."""
        return fixed.shifted(-self.a), moving.shifted(-self.b)

    def inward(self, theta: Array) -> Array:
        """The motions (..., 3) between the shifted sets."""
        return theta + self._shift(theta)

    def outward(self, theta: Array) -> Array:
        """The motions (..., 3) between the sets as they were given."""
        return theta - self._shift(theta)

    def covariance_inward(self, theta: Array, covariance: Array) -> Array:
        """The covariances (..., 3, 3) between the shifted sets."""
        return _between(self.slope(theta), covariance)

    def covariance_outward(self, theta: Array, covariance: Array) -> Array:
        """The covariances (..., 3, 3) between the sets as they were given."""
        return _between(2.0 * np.eye(3) - self.slope(theta), covariance)  # the inverse slope

    def _shift(self, theta: Array) -> Array:
        shift = self.turned(theta) - self.a
        return np.concatenate([shift, np.zeros((*shift.shape[:-1], 1))], axis=-1)

    def slope(self, theta: Array) -> Array:
        """Derivative (..., 3, 3) of the inner motions in the given ones."""
        turned = self.turned(theta)
        slope = np.zeros((*turned.shape[:-1], 3, 3)) + np.eye(3)
        slope[..., 0, 2], slope[..., 1, 2] = -turned[..., 1], turned[..., 0]
        return slope

    def turned(self, theta: Array) -> Array:
        """R b (..., 2)."""
        return np.asarray((rigid.rotation(theta[..., 2]) @ self.b[..., None])[..., 0])


def _origin_if_far(points: PointSet) -> Array:
    """The mean (..., 2) of each set that is far, else zero."""
    return np.where(points._layout.far[..., None], points.means.mean(axis=-2), 0.0)


def _between(slope: Array, covariance: Array) -> Array:
    """J C J', exactly symmetric."""
    moved = slope @ covariance @ np.swapaxes(slope, -1, -2)
    return np.asarray(0.5 * (moved + np.swapaxes(moved, -1, -2)))
