"""Optimisers at work on one registration problem with known pairs (chapter 5)."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from d2d import rigid
from d2d._checks import Array
from d2d.baselines.optimisers import (
    Path,
    descend,
    descend_damped,
    gauss_newton,
    gradient_descent,
    newton,
)
from d2d.point_set import PointSet
from d2d.study.drawing import BLUE, GREEN, ORANGE, PINK

COLOURS = {
    "gradient descent": ORANGE,
    "Newton": PINK,
    "Gauss-Newton": BLUE,
    "Levenberg-Marquardt": GREEN,
}
MOST_DESCENTS = 20_000
WIDTH, HEIGHT, MARGIN = 620.0, 420.0, 56.0  # of a frame, in SVG units


@dataclass(frozen=True, eq=False)
class PairedTargets:
    """Least squares of target k of ``moving`` against target k of ``fixed``.

    Residuals W_k (R mu_k + t - mu'_k) with W_k'W_k the inverse of the fixed target's covariance:
    the point-to-distribution likelihood of known pairs, up to a constant. Nonlinear in the
    rotation only.
    """

    fixed: PointSet
    moving: PointSet

    @cached_property
    def roots(self) -> Array:
        """W_k (K, 2, 2)."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.fixed.covariances)), np.float64)

    def _turned(self, x: Array) -> Array:
        return np.asarray(self.moving.means @ rigid.rotation(x[2]).T)

    def residuals(self, x: Array) -> Array:
        """Weighted differences (2 K,) at the motion x (3,)."""
        d = self._turned(x) + x[:2] - self.fixed.means
        return np.asarray((self.roots @ d[..., None]).ravel())

    def jacobian(self, x: Array) -> Array:
        """Their derivatives (2 K, 3): W_k [I, E p_k]."""
        px, py = self._turned(x).T
        each = np.zeros((len(px), 2, 3))
        each[:, 0, 0] = each[:, 1, 1] = 1.0
        each[:, 0, 2], each[:, 1, 2] = -py, px
        return np.asarray((self.roots @ each).reshape(-1, 3))

    def curvature(self, x: Array) -> Array:
        """sum_i f_i d2f_i (3, 3): only the rotation has any, d2(R mu)/d phi2 = -R mu."""
        second = -(self.roots @ self._turned(x)[..., None]).ravel()
        curved = np.zeros((3, 3))
        curved[2, 2] = self.residuals(x) @ second
        return curved


def run_all(problem: PairedTargets, start: Array, *, first_order: bool = True) -> dict[str, Path]:
    """The four optimisers from one start, or without ``first_order`` the three that are fast.

    The rate of gradient descent is half of 1 / lambda_max(J'J) at the start: the curvature grows
    on the way, and a longer step may overshoot the angle by whole circles.
    """
    j = problem.jacobian(start)
    rate = 0.5 / float(np.linalg.eigvalsh(j.T @ j)[-1])
    paths = {}
    if first_order:
        step = gradient_descent(rate)
        paths["gradient descent"] = descend(problem, start, step, most=MOST_DESCENTS)
    return paths | {
        "Newton": descend(problem, start, newton, most=100),
        "Gauss-Newton": descend(problem, start, gauss_newton, most=100),
        "Levenberg-Marquardt": descend_damped(problem, start, most=100),
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


def draw_paths(ax: Axes, problem: PairedTargets, paths: Mapping[str, Path]) -> None:
    """The paths over the profiled cost in the plane of t_y and phi."""
    t_y, angle = _window(paths)
    cost = profile(problem, t_y, angle)
    levels = cost.min() + np.geomspace(1.0, float(np.ptp(cost)), 14)
    ax.contour(t_y, np.rad2deg(angle), cost, levels, colors="0.7", linewidths=0.7)
    for name, path in paths.items():
        where = path.points[:, 1], np.rad2deg(path.points[:, 2])
        ax.plot(*where, ".-", color=COLOURS[name], label=name, ms=5, lw=1.2)
    ax.set(xlabel="$t_y$ (m)", ylabel="$φ_z$ (degrees)")


def frame(problem: PairedTargets, paths: Mapping[str, Path], iteration: int) -> str:
    """SVG of the paths up to an iteration, over contours of the profiled cost.

    Coordinates are rounded to a tenth, so that every machine draws the same.
    """
    t_y, angle = _window(paths)
    parts = [
        f'<svg viewBox="0 0 {WIDTH:.0f} {HEIGHT:.0f}" xmlns="http://www.w3.org/2000/svg" '
        f'role="img" aria-label="Optimiser paths after {iteration} iterations" '
        'style="width:100%;font:15px sans-serif" fill="#111">'
    ]

    def place(points: Array) -> Array:
        x = (points[:, 0] - t_y[0]) / (t_y[-1] - t_y[0])
        y = (points[:, 1] - angle[0]) / (angle[-1] - angle[0])
        return np.stack(
            [MARGIN + x * (WIDTH - 2 * MARGIN), HEIGHT - MARGIN - y * (HEIGHT - 2 * MARGIN)], -1
        )

    for line in _contours(problem, t_y, angle):
        parts.append(_polyline(place(line), "#999", 1.0))
    for row, (name, path) in enumerate(paths.items()):
        points = place(path.points[: iteration + 1, 1:])
        parts.append(_polyline(points, COLOURS[name], 2.2))
        x, y = points[-1]
        parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{7 - row}" fill="{COLOURS[name]}"/>')
        done = " (arrived)" if path.converged and iteration >= len(path.points) - 1 else ""
        parts.append(
            f'<text x="{WIDTH - MARGIN - 4:.0f}" y="{22 + 19 * row}" text-anchor="end" '
            f'fill="{COLOURS[name]}">{name}{done}</text>'
        )
    parts.append(
        f'<text x="{0.5 * WIDTH:.0f}" y="{HEIGHT - 14:.0f}" text-anchor="middle">'
        f"t_y from {t_y[0]:.1f} to {t_y[-1]:.1f} m; upwards the angle from "
        f"{np.rad2deg(angle[0]):.1f}° to {np.rad2deg(angle[-1]):.1f}°</text></svg>"
    )
    return "\n".join(parts)


def _window(paths: Mapping[str, Path]) -> tuple[Array, Array]:
    ends = np.concatenate([path.points[:, 1:] for path in paths.values()])
    low, high = ends.min(axis=0), ends.max(axis=0)
    low, high = low - 0.15 * (high - low), high + 0.15 * (high - low)
    return np.linspace(low[0], high[0], 81), np.linspace(low[1], high[1], 81)


def _contours(problem: PairedTargets, t_y: Array, angle: Array) -> list[Array]:
    cost = profile(problem, t_y, angle)
    levels = cost.min() + np.geomspace(1.0, float(np.ptp(cost)), 14)
    figure, ax = plt.subplots()
    lines = ax.contour(t_y, angle, cost, levels).allsegs
    plt.close(figure)
    return [line[::2] for level in lines for line in level if len(line) > 4]


def _polyline(points: Array, colour: str, width: float) -> str:
    where = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f'<polyline points="{where}" fill="none" stroke="{colour}" stroke-width="{width}"/>'
