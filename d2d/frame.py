"""Point sets far from the origin, as in map coordinates, shifted to their means to compute.

A rotation about an origin a million metres away moves a target by metres for each microradian: the
translation then all but follows from the rotation, and no Newton step can tell the two apart.
"""

from typing import NamedTuple

import numpy as np

from d2d import rigid
from d2d._types import Array
from d2d.point_set import PointSet


def packed_about_origins(points: PointSet) -> Array:
    """The packed sets (6, B N), those far from the origin with coordinates about their means."""
    if points._origins is None:
        return points._packed
    packed = points._packed.copy()
    packed[:2] -= np.repeat(points._origins, points.size, axis=0).T
    return packed


def about_mean(points: PointSet) -> tuple[PointSet, Array]:
    """Planar sets with coordinates about their means, and these means (..., 2)."""
    origins = points.means.mean(axis=-2)
    means = points.means - origins[..., np.newaxis, :]
    return PointSet._of(means, points.covariances, points.weights), origins


class Frame(NamedTuple):
    """The origins of the sets of each problem of a batch, in the user's coordinates.

    With fixed targets m - a and moving targets m - b, the motion [t, phi] becomes
    [t + R(phi) b - a, phi].
    """

    fixed: Array  # (B, 2), or (1, 2) if all problems share it
    moving: Array  # (B, 2) or (1, 2)

    def repeated(self, begin: int, end: int, times: int) -> "Frame":
        """The origins of some problems, each that many times; one that all share stays one."""
        return Frame(*(e if len(e) == 1 else np.repeat(e[begin:end], times, axis=0) for e in self))

    def inward(self, thetas: Array) -> Array:
        """The motions (B, 3) between the sets about their origins."""
        inner = thetas.copy()
        inner[:, :2] += self._turned(thetas) - self.fixed
        return inner

    def outward(self, thetas: Array) -> Array:
        """The motions (B, 3) in the user's coordinates."""
        outer = thetas.copy()
        outer[:, :2] -= self._turned(thetas) - self.fixed
        return outer

    def derivatives(self, thetas: Array, gradient: Array, hessian: Array) -> tuple[Array, Array]:
        """Gradient (B, 3) and Hessian (B, 3, 3) in the user's coordinates, by the chain rule."""
        slope = self.slope(thetas)
        across = np.swapaxes(slope, -1, -2)
        bent = across @ hessian @ slope
        bent[:, 2, 2] -= np.einsum("bi,bi->b", self._turned(thetas), gradient[:, :2])
        return (across @ gradient[..., None])[..., 0], bent

    def covariance(self, thetas: Array, covariance: Array) -> Array:
        """Covariance (B, P, P) in the user's coordinates of one about the origins."""
        return _between(2.0 * np.eye(3) - self.slope(thetas), covariance)

    def inner_covariance(self, thetas: Array, covariance: Array) -> Array:
        """Covariance (B, P, P) about the origins of one in the user's coordinates."""
        return _between(self.slope(thetas), covariance)

    def slope(self, thetas: Array) -> Array:
        """Derivative (B, 3, 3) of the inner motions in the user's; its inverse is 2 - itself."""
        turned = self._turned(thetas)
        slope = np.tile(np.eye(3), (len(thetas), 1, 1))
        slope[:, 0, 2], slope[:, 1, 2] = -turned[:, 1], turned[:, 0]
        return slope

    def _turned(self, thetas: Array) -> Array:
        """R b (B, 2)."""
        return np.asarray((rigid.rotation(thetas[:, 2]) @ self.moving[..., None])[..., 0])


def _between(slope: Array, covariance: Array) -> Array:
    """J C J', exactly symmetric; on a line, of the one parameter that counts."""
    p = covariance.shape[-1]
    slope = slope[:, :p, :p]
    moved = slope @ covariance @ np.swapaxes(slope, -1, -2)
    return np.asarray(0.5 * (moved + np.swapaxes(moved, -1, -2)))
