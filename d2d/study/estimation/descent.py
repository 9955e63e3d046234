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
    the point-to-distribution likelihood of known pairs, up to a constant. They are nonlinear in
    the rotation only.
    """

    fixed: PointSet
    moving: PointSet

    @cached_property
    def roots(self) -> Array:
        """W_k (K, 2, 2)."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.fixed.covariances)), np.float64)

    def _turned(self, x: Array) -> Array:
        cosine, sine = math.cos(x[2]), math.sin(x[2])
        return np.asarray(self.moving.means @ np.array([[cosine, sine], [-sine, cosine]]))

    def residuals(self, x: Array) -> Array:
        """Weighted differences (2 K,) at the motion x (3,)."""
        d = self._turned(x) + x[:2] - self.fixed.means
        return np.asarray((self.roots @ d[..., None]).ravel())

    def jacobian(self, x: Array) -> Array:
        """Derivatives (2 K, 3) of the residuals: W_k [I, E p_k]."""
        px, py = self._turned(x).T
        blocks = np.zeros((len(px), 2, 3))
        blocks[:, 0, 0] = blocks[:, 1, 1] = 1.0
        blocks[:, 0, 2], blocks[:, 1, 2] = -py, px
        return np.asarray((self.roots @ blocks).reshape(-1, 3))

    def curvature(self, x: Array) -> Array:
        """sum_i f_i d2f_i (3, 3), zero but for the rotation, where d2(R mu)/d phi2 = -R mu."""
        second = -(self.roots @ self._turned(x)[..., None]).ravel()
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
