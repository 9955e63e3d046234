"""The D2D likelihood in vectorised NumPy, as one would write it for scipy's optimisers."""

import math

import numpy as np
from scipy.optimize import minimize

from d2d import CorruptedGaussian, PointSet
from d2d._types import Array


def log_sum_exp(logs: Array) -> tuple[Array, Array]:
    """log sum_i exp(logs_ki) of each row k, and the terms' shares of the sum."""
    top = logs.max(axis=1)
    terms = np.exp(logs - top[:, None])
    total = terms.sum(axis=1)
    return top + np.log(total), terms / total[:, None]


class NumpyCost:
    """-sum_k log q_k of two planar sets, without or with a corrupted Gaussian."""

    def __init__(
        self, fixed: PointSet, moving: PointSet, outlier: CorruptedGaussian | None = None
    ) -> None:
        self.fx, self.fy = fixed.means.T.copy()
        self.fxx, self.fxy, self.fyy = (fixed.covariances[:, i, j] for i, j in _ENTRIES)
        self.log_weight = np.log(fixed.weights)
        self.mx, self.my = moving.means.T.copy()
        self.mxx, self.mxy, self.myy = (moving.covariances[:, i, j] for i, j in _ENTRIES)
        self.outlier = outlier
        if outlier is not None:
            self.precision = np.linalg.inv(outlier.covariance)
            self.log_inlier = math.log1p(-outlier.fraction)
            self.log_outlier = math.log(outlier.fraction) + 0.5 * (
                np.linalg.slogdet(self.precision)[1] - 2.0 * math.log(2.0 * math.pi)
            )

    def value(self, theta: Array) -> float:
        """The cost at theta (3,)."""
        return self._evaluate(theta, False)[0]

    def value_and_gradient(self, theta: Array) -> tuple[float, Array]:
        """The cost and its gradient (3,) at theta (3,)."""
        return self._evaluate(theta, True)

    def _evaluate(self, theta: Array, with_gradient: bool) -> tuple[float, Array]:
        c, s = math.cos(theta[2]), math.sin(theta[2])
        x, y = c * self.mx - s * self.my, s * self.mx + c * self.my
        cxx = c * c * self.mxx - 2.0 * c * s * self.mxy + s * s * self.myy
        cxy = c * s * (self.mxx - self.myy) + (c * c - s * s) * self.mxy
        cyy = s * s * self.mxx + 2.0 * c * s * self.mxy + c * c * self.myy
        dx, dy = (x + theta[0])[:, None] - self.fx, (y + theta[1])[:, None] - self.fy
        sxx = cxx[:, None] + self.fxx
        sxy = cxy[:, None] + self.fxy
        syy = cyy[:, None] + self.fyy
        inverse = 1.0 / (sxx * syy - sxy * sxy)
        ux, uy = (syy * dx - sxy * dy) * inverse, (sxx * dy - sxy * dx) * inverse
        logs = self.log_weight + 0.5 * (np.log(inverse) - dx * ux - dy * uy)
        log_q, share = log_sum_exp(logs)
        log_q -= math.log(2.0 * math.pi)
        gradient = np.empty(0)
        if with_gradient:
            a, b = cxy[:, None], (cxx - cyy)[:, None]
            along = (
                y[:, None] * ux
                - x[:, None] * uy
                + a * (uy * uy - ux * ux)
                + b * ux * uy
                - (a * (sxx - syy) - b * sxy) * inverse
            )
            gradient = np.stack(
                [-(share * ux).sum(1), -(share * uy).sum(1), (share * along).sum(1)]
            )
        if self.outlier is not None:
            log_q, gradient = self._corrupt(log_q, gradient, dx, dy, x, y)
        return -float(log_q.sum()), -gradient.sum(axis=-1)

    def _corrupt(
        self, log_q: Array, gradient: Array, dx: Array, dy: Array, x: Array, y: Array
    ) -> tuple[Array, Array]:
        (bxx, bxy), (_, byy) = self.precision
        ux, uy = bxx * dx + bxy * dy, bxy * dx + byy * dy
        log_wide, share = log_sum_exp(self.log_weight - 0.5 * (dx * ux + dy * uy))
        log_in, log_out = self.log_inlier + log_q, self.log_outlier + log_wide
        mixed = np.logaddexp(log_in, log_out)
        if gradient.size:
            gx, gy = -(share * ux).sum(1), -(share * uy).sum(1)
            wide = np.stack([gx, gy, x * gy - y * gx])
            gradient = np.exp(log_in - mixed) * gradient + np.exp(log_out - mixed) * wide
        return mixed, gradient


_ENTRIES = ((0, 0), (0, 1), (1, 1))


def minimise(cost: NumpyCost, start: Array, method: str, with_gradient: bool) -> Array:
    """The motion (3,) that scipy's ``method`` finds."""
    function = cost.value_and_gradient if with_gradient else cost.value
    return np.asarray(minimize(function, start, jac=with_gradient or None, method=method).x)
