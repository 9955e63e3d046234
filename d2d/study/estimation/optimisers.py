r"""The four textbook update rules for nonlinear least squares, and drivers that record the path.

With residuals f(x) of shape (m,), their Jacobian J (m, n) and the cost F = f'f / 2, the gradient is
:math:`J^{\mathsf T} f` and the Hessian :math:`J^{\mathsf T} J + \sum_i f_i \nabla^2 f_i`.  Each
rule returns the step that is added to x.  (Thesis sec. 5.1 subtracts the negative gradient, which
goes uphill; its table has H'f for the curvature and lacks a transpose in the last line.)
"""

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from d2d._types import Array

TOLERANCE = 1e-8  # of a step: a shorter one ends a path


class LeastSquares(Protocol):
    """A least-squares problem in the form that the update rules require."""

    def residuals(self, x: Array) -> Array:
        """f(x) of shape (m,)."""

    def jacobian(self, x: Array) -> Array:
        """J(x) of shape (m, n)."""

    def curvature(self, x: Array) -> Array:
        r"""The Hessian's part :math:`\sum_i f_i \nabla^2 f_i` (n, n), which only Newton uses."""


Step = Callable[[LeastSquares, Array], Array]


def cost(problem: LeastSquares, x: Array) -> float:
    """F = f'f / 2."""
    f = problem.residuals(x)
    return float(0.5 * f @ f)


def gradient(problem: LeastSquares, x: Array) -> Array:
    r"""The gradient :math:`J^{\mathsf T} f` of the cost."""
    return problem.jacobian(x).T @ problem.residuals(x)


def gradient_descent(rate: float) -> Step:
    r"""Step :math:`-\eta J^{\mathsf T} f` with a fixed rate :math:`\eta`."""
    return lambda problem, x: -rate * gradient(problem, x)


def newton(problem: LeastSquares, x: Array) -> Array:
    r"""Solve :math:`H \delta = -J^{\mathsf T} f`; may also converge to a saddle or a maximum."""
    j = problem.jacobian(x)
    return _solve(j.T @ j + problem.curvature(x), -gradient(problem, x))


def levenberg_marquardt(problem: LeastSquares, x: Array, damping: float) -> Array:
    r"""Solve :math:`(J^{\mathsf T} J + \lambda I)\, \delta = -J^{\mathsf T} f`."""
    j = problem.jacobian(x)
    return _solve(j.T @ j + damping * np.eye(len(x)), -gradient(problem, x))


def gauss_newton(problem: LeastSquares, x: Array) -> Array:
    r"""Solve :math:`J^{\mathsf T} J \delta = -J^{\mathsf T} f`, Newton without the second part."""
    return levenberg_marquardt(problem, x, 0.0)


def _solve(matrix: Array, right: Array) -> Array:
    return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)


class Path(NamedTuple):
    """The path of an optimiser."""

    points: Array  # (iterations + 1, n), the start included
    costs: Array  # (iterations + 1,)
    evaluations: int  # number of steps computed, rejected ones included
    converged: bool  # whether the last step was shorter than the tolerance


def descend(
    problem: LeastSquares,
    start: ArrayLike,
    step: Step,
    *,
    tolerance: float = TOLERANCE,
    max_iterations: int = 1000,
) -> Path:
    """Repeat x <- x + step(problem, x), without any safeguard, until the step is short.

    It has converged if the largest entry of the last step is below ``tolerance``.
    """
    points = [np.asarray(start, dtype=np.float64)]
    converged = False
    while not converged and len(points) <= max_iterations:
        with np.errstate(over="ignore", invalid="ignore"):
            move = step(problem, points[-1])
        if not np.isfinite(move).all():
            break
        points.append(points[-1] + move)
        converged = bool(np.abs(move).max() < tolerance)
    with np.errstate(over="ignore", invalid="ignore"):
        costs = np.array([cost(problem, x) for x in points])
    return Path(np.array(points), costs, len(points) - 1, converged)


def descend_damped(problem: LeastSquares, start: ArrayLike, *, max_iterations: int = 1000) -> Path:
    """Levenberg-Marquardt: lambda falls to a tenth after an accepted step, else it rises tenfold.

    A step that raises the cost is not taken (Marquardt 1963).  Else as `descend`.
    """
    damping, evaluations, converged = 1e-3, 0, False
    points = [np.asarray(start, dtype=np.float64)]
    costs = [cost(problem, points[0])]
    while not converged and evaluations < max_iterations:
        move = levenberg_marquardt(problem, points[-1], damping)
        evaluations += 1
        trial = points[-1] + move
        value = cost(problem, trial)
        converged = bool(np.abs(move).max() < TOLERANCE)
        accepted = value <= costs[-1]
        damping = damping / 10.0 if accepted else damping * 10.0
        if accepted:
            points.append(trial)
            costs.append(value)
    return Path(np.array(points), np.array(costs), evaluations, converged)
