"""Optimisers on a registration problem with known pairs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from d2d import rigid
from d2d._types import Array
from d2d.point_set import PointSet
from d2d.study.estimation.optimisers import (
    Path,
    cost,
    descend,
    descend_damped,
    gauss_newton,
    gradient_descent,
    newton,
)
from d2d.study.plane.scenarios import OVERLAPPED

FIRST_ORDER = "gradient descent"
MAX_DESCENTS = 20_000
SHORT = 1e-8  # m, m, rad: a shorter step of gradient descent is its last


@dataclass(frozen=True, eq=False)
class PairedTargets:
    """Least squares of target k of ``moving`` against target k of ``fixed``.

    Residuals W_k (R mu_k + t - mu'_k), nonlinear in the rotation only, with W_k'W_k the inverse of
    the fixed target's covariance: the point-to-distribution likelihood of known pairs.
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

    @cached_property
    def quadratic(self) -> Array:
        """Q (5, 5): the cost is z'Q z / 2 with z = [cos phi, sin phi, t_x, t_y, 1]."""
        differences = np.zeros((self.moving.size, 2, 5))  # R mu + t - mu' as linear in z
        (x, y), there = self.moving.means.T, self.fixed.means
        differences[:, 0, 0], differences[:, 0, 1] = x, -y
        differences[:, 1, 0], differences[:, 1, 1] = y, x
        differences[:, 0, 2] = differences[:, 1, 3] = 1.0
        differences[..., 4] = -there
        rows = (self.roots @ differences).reshape(-1, 5)
        return np.asarray(rows.T @ rows)

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


def random_starts(runs: int, seed: int) -> tuple[list[PairedTargets], Array]:
    """Draws of the overlapped scene, and a start (runs, 3) within 5 m and 30 degrees for each."""
    fixed, moving = OVERLAPPED.sample(runs, np.random.default_rng(seed))
    within = np.random.default_rng(seed).uniform(-1, 1, (runs, 3))
    starts = OVERLAPPED.theta + np.array([5.0, 5.0, np.deg2rad(30.0)]) * within
    return [PairedTargets(fixed[run], moving[run]) for run in range(runs)], starts


def run_all(problem: PairedTargets, start: Array) -> dict[str, Path]:
    """Run gradient descent and the three methods of `run_second_order` from one start."""
    step = gradient_descent(_rate(problem, start))
    slow = descend(problem, start, step, tolerance=SHORT, max_iterations=MAX_DESCENTS)
    return {FIRST_ORDER: slow} | run_second_order(problem, start)


def run_second_order(problem: PairedTargets, start: Array) -> dict[str, Path]:
    """Run the three methods that need few iterations from one start."""
    return {
        "Newton": descend(problem, start, newton, max_iterations=100),
        "Gauss-Newton": descend(problem, start, gauss_newton, max_iterations=100),
        "Levenberg-Marquardt": descend_damped(problem, start, max_iterations=100),
    }


def newton_saddles(problems: Sequence[PairedTargets], starts: Array) -> int:
    """From how many of the starts (P, 3) Newton's method ends at a saddle of its problem."""
    saddles = 0
    for problem, start in zip(problems, starts, strict=True):
        end = descend(problem, start, newton, max_iterations=100).points[-1]
        j = problem.jacobian(end)
        curvatures = np.linalg.eigvalsh(j.T @ j + problem.curvature(end))
        saddles += int(curvatures[0] < 0.0 < curvatures[-1])
    return saddles


def _rate(problem: PairedTargets, start: Array) -> float:
    """Rate of gradient descent: half of 1 / lambda_max(J'J) at the start.

    The curvature grows on the way, and a longer step may overshoot the angle by whole turns.
    """
    j = problem.jacobian(start)
    return 0.5 / float(np.linalg.eigvalsh(j.T @ j)[-1])


class Ends(NamedTuple):
    """Where P paths ended."""

    cost: Array  # (P,)
    iterations: NDArray[np.int64]  # (P,)
    converged: NDArray[np.bool_]  # (P,)


def ends_of(paths: Sequence[Path]) -> Ends:
    """The ends of paths."""
    return Ends(
        np.array([path.costs[-1] for path in paths]),
        np.array([path.evaluations for path in paths]),
        np.array([path.converged for path in paths]),
    )


def gradient_descents(problems: Sequence[PairedTargets], starts: Array) -> Ends:
    """The gradient descent of `run_all` on P problems at once, from starts (P, 3).

    The cost is quadratic in z: an iteration takes one product with a matrix (5, 5).
    """
    quadratic = np.stack([problem.quadratic for problem in problems])
    pairs = zip(problems, starts, strict=True)
    rate = np.array([_rate(problem, start) for problem, start in pairs])[:, np.newaxis]
    x, iterations = np.array(starts), np.zeros(len(problems), np.int64)
    left = np.arange(len(problems))  # those that have not converged
    for iteration in range(1, MAX_DESCENTS + 1):
        t_x, t_y, angle = x[left].T
        cosine, sine = np.cos(angle), np.sin(angle)
        linear = np.stack([cosine, sine, t_x, t_y, np.ones_like(angle)], axis=-1)
        slope = (quadratic[left] @ linear[..., np.newaxis])[..., 0]
        turning = cosine * slope[:, 1] - sine * slope[:, 0]
        move = -rate[left] * np.stack([slope[:, 2], slope[:, 3], turning], axis=-1)
        x[left] += move
        iterations[left] = iteration
        left = left[~(np.abs(move).max(axis=-1) < SHORT)]  # one that is not finite stays
        if not left.size:
            break
    costs = np.array([cost(problem, end) for problem, end in zip(problems, x, strict=True)])
    return Ends(costs, iterations, ~np.isin(np.arange(len(problems)), left))


def profile(problem: PairedTargets, t_y: Array, angle: Array) -> Array:
    """Cost (A, Y) over translation t_y (Y,) and angle (A,), minimised over t_x in closed form."""
    y, phi = np.meshgrid(t_y, angle)
    theta = np.stack([np.zeros_like(y), y, phi], axis=-1)
    d = rigid.transform_means(theta, problem.moving.means) - problem.fixed.means
    b = np.linalg.inv(problem.fixed.covariances)
    best = -np.einsum("kx,...kx->...", b[:, 0], d) / b[:, 0, 0].sum()
    d[..., 0] += best[..., None]
    return np.asarray(0.5 * np.einsum("...kx,kxy,...ky->...", d, b, d))
