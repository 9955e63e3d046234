"""The four textbook update rules for nonlinear least squares, and a driver that keeps the path.

With residuals f(x) of shape (m,), their Jacobian J (m, n) and the cost F = f'f / 2, the gradient is
J'f and the Hessian J'J + sum_i f_i d2f_i.  Each rule returns the step that is ADDED to x.  (The
thesis's section 5.1 subtracts the negative gradient, which climbs; and its table has H'f for the
curvature and no transpose in the last line.)
"""

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from d2d._checks import Array, finite, positive, scalar


class LeastSquares(Protocol):
    """A least-squares problem, as the update rules ask for it."""

    def residuals(self, x: Array) -> Array:
        """f(x) of shape (m,)."""

    def jacobian(self, x: Array) -> Array:
        """J(x) of shape (m, n)."""

    def curvature(self, x: Array) -> Array:
        """The Hessian's second part, sum_i f_i d2f_i, of shape (n, n): only Newton asks for it."""


Step = Callable[[LeastSquares, Array], Array]


def cost(problem: LeastSquares, x: Array) -> float:
    """F = f'f / 2."""
    f = problem.residuals(x)
    return float(0.5 * f @ f)


def gradient(problem: LeastSquares, x: Array) -> Array:
    """J'f."""
    return problem.jacobian(x).T @ problem.residuals(x)


def gradient_descent(rate: float) -> Step:
    """Step -alpha J'f with the fixed rate alpha."""
    alpha = float(positive("rate", scalar("rate", rate)))
    return lambda problem, x: -alpha * gradient(problem, x)


def newton(problem: LeastSquares, x: Array) -> Array:
    """Solve (J'J + sum_i f_i d2f_i) step = -J'f; heads for a saddle or a maximum just as well."""
    j = problem.jacobian(x)
    return _solve(j.T @ j + problem.curvature(x), -gradient(problem, x))


def gauss_newton(problem: LeastSquares, x: Array) -> Array:
    """Solve J'J step = -J'f: Newton without the residuals' own curvature."""
    j = problem.jacobian(x)
    return _solve(j.T @ j, -gradient(problem, x))


def levenberg_marquardt(problem: LeastSquares, x: Array, damping: float) -> Array:
    """Solve (J'J + lambda I) step = -J'f: a short gradient descent for large lambda."""
    j = problem.jacobian(x)
    return _solve(j.T @ j + damping * np.eye(len(x)), -gradient(problem, x))


def _solve(matrix: Array, right: Array) -> Array:
    return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)


class Path(NamedTuple):
    """Where an optimiser has been."""

    points: Array  # (iterations + 1, n), the start included
    costs: Array  # (iterations + 1,)
    evaluations: int  # of the residuals and their derivatives, rejected steps included
    converged: bool  # the last step was shorter than the tolerance


def descend(
    problem: LeastSquares,
    start: ArrayLike,
    step: Step,
    *,
    tolerance: float = 1e-8,
    most: int = 1000,
) -> Path:
    """Repeat x <- x + step(problem, x), without any safeguard, until the step is short.

    Parameters
    ----------
    problem : LeastSquares
    start : (n,) array
    step : callable
        ``gradient_descent(rate)``, ``newton`` or ``gauss_newton``.
    tolerance : float
        Of the largest entry of the step, below which x has converged.
    most : int
        Iterations.

    Returns
    -------
    Path
        ``converged`` is False also where x left the finite numbers, which ends the iteration.
    """
    points = [finite("start", start)]
    converged = False
    while not converged and len(points) <= most:
        with np.errstate(over="ignore", invalid="ignore"):
            move = step(problem, points[-1])
        if not np.isfinite(move).all():
            break
        points.append(points[-1] + move)
        converged = bool(np.abs(move).max() < tolerance)
    with np.errstate(over="ignore", invalid="ignore"):
        costs = np.array([cost(problem, x) for x in points])
    return Path(np.array(points), costs, len(points) - 1, converged)


def descend_damped(
    problem: LeastSquares,
    start: ArrayLike,
    *,
    damping: float = 1e-3,
    factor: float = 10.0,
    tolerance: float = 1e-8,
    most: int = 1000,
) -> Path:
    """Levenberg-Marquardt: lambda falls by ``factor`` after a step that helps, else it rises.

    A step that does not lower the cost is not taken (Marquardt 1963).  Parameters and result as
    in `descend`.
    """
    points = [finite("start", start)]
    costs = [cost(problem, points[0])]
    evaluations, converged = 0, False
    while not converged and evaluations < most:
        move = levenberg_marquardt(problem, points[-1], damping)
        evaluations += 1
        trial = points[-1] + move
        value = cost(problem, trial)
        converged = bool(np.abs(move).max() < tolerance)
        if value <= costs[-1]:
            points.append(trial)
            costs.append(value)
            damping /= factor
        else:
            damping *= factor
    return Path(np.array(points), np.array(costs), evaluations, converged)
