"""Optimisers on a registration problem with known pairs."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from d2d import rigid
from d2d._types import Array
from d2d.baselines.optimisers import (
    Path,
    descend,
    descend_damped,
    gauss_newton,
    gradient_descent,
    newton,
)
from d2d.point_set import PointSet

MAX_DESCENTS = 20_000


@dataclass(frozen=True, eq=False)
class PairedTargets:
    """Least squares of target k of ``moving`` against target k of ``fixed``.

    Residuals W_k (R mu_k + t - mu'_k) with W_k'W_k the inverse of the fixed target's covariance:
    the point-to-distribution likelihood of known pairs, up to a constant. They are linear in the
    cosine and sine of the rotation and in the translation.
    """

    fixed: PointSet
    moving: PointSet

    @cached_property
    def _rows(self) -> Array:
        """The residuals (2 K, 5) as a linear function of [cos phi, sin phi, t_x, t_y, 1]."""
        roots = np.linalg.inv(np.linalg.cholesky(self.fixed.covariances))
        blocks = np.zeros((self.moving.size, 2, 5))
        (x, y), (own_x, own_y) = self.moving.means.T, self.fixed.means.T
        blocks[:, 0, 0], blocks[:, 0, 1], blocks[:, 0, 2], blocks[:, 0, 4] = x, -y, 1.0, -own_x
        blocks[:, 1, 0], blocks[:, 1, 1], blocks[:, 1, 3], blocks[:, 1, 4] = y, x, 1.0, -own_y
        return np.asarray((roots @ blocks).reshape(-1, 5))

    def residuals(self, x: Array) -> Array:
        """Weighted differences (2 K,) at the motion x (3,)."""
        return np.asarray(self._rows @ (math.cos(x[2]), math.sin(x[2]), x[0], x[1], 1.0))

    def jacobian(self, x: Array) -> Array:
        """Derivatives (2 K, 3) of the residuals."""
        found = np.empty((len(self._rows), 3))
        found[:, :2] = self._rows[:, 2:4]
        found[:, 2] = self._rows[:, :2] @ (-math.sin(x[2]), math.cos(x[2]))
        return found

    def curvature(self, x: Array) -> Array:
        """sum_i f_i d2f_i (3, 3), zero but for the rotation, where d2(R mu)/d phi2 = -R mu."""
        second = self._rows[:, :2] @ (-math.cos(x[2]), -math.sin(x[2]))
        curved = np.zeros((3, 3))
        curved[2, 2] = self.residuals(x) @ second
        return curved


def run_all(problem: PairedTargets, start: Array, *, first_order: bool = True) -> dict[str, Path]:
    """Run the four optimisers from one start, or only the three fast ones without ``first_order``.

    The rate of gradient descent is half of 1 / lambda_max(J'J) at the start: the curvature grows
    on the way, and a longer step may overshoot the angle by whole turns.
    """
    j = problem.jacobian(start)
    rate = 0.5 / float(np.linalg.eigvalsh(j.T @ j)[-1])
    paths = {}
    if first_order:
        step = gradient_descent(rate)
        paths["gradient descent"] = descend(problem, start, step, max_iterations=MAX_DESCENTS)
    return paths | {
        "Newton": descend(problem, start, newton, max_iterations=100),
        "Gauss-Newton": descend(problem, start, gauss_newton, max_iterations=100),
        "Levenberg-Marquardt": descend_damped(problem, start, max_iterations=100),
    }


def profile(problem: PairedTargets, t_y: Array, angle: Array) -> Array:
    """Cost (A, Y) over translation t_y (Y,) and angle (A,), minimised over t_x in closed form."""
    y, phi = np.meshgrid(t_y, angle)
    theta = np.stack([np.zeros_like(y), y, phi], axis=-1)
    d = rigid.transform_means(theta, problem.moving.means) - problem.fixed.means
    b = np.linalg.inv(problem.fixed.covariances)
    best = -np.einsum("kx,...kx->...", b[:, 0], d) / b[:, 0, 0].sum()
    d[..., 0] += best[..., None]
    return np.asarray(0.5 * np.einsum("...kx,kxy,...ky->...", d, b, d))
