"""Gaussian densities and mixtures: evaluation, maximum likelihood, expectation maximisation."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from d2d._checks import check_covariances, check_finite
from d2d._frozen import Frozen
from d2d._types import Array
from d2d.baselines.gaussian_fit import fit as fit
from d2d.baselines.gaussian_fit import raise_eigenvalues

# Smallest variance of a fitted component, relative to the data's.  With a smaller one, the rounding
# of an oblique covariance lets the likelihood fall.
RELATIVE_FLOOR = 1e-10
_LEAST_VARIANCE = 1e-150  # of observations that are all zero; its square does not underflow


def log_density(x: ArrayLike, mean: ArrayLike, covariance: ArrayLike) -> Array:
    r""":math:`\log \mathcal N(x \mid \mu, \Sigma)` (thesis eq. 2.7, Bishop 2006, eq. 2.43).

    The arrays x and mean (..., D) and covariance (..., D, D) broadcast.
    """
    factor = np.linalg.cholesky(np.asarray(covariance, dtype=np.float64))
    # there are few factors and many points: invert each factor once
    whitened = (np.linalg.inv(factor) @ np.subtract(x, mean)[..., None])[..., 0]
    roots = math.sqrt(2.0 * math.pi) * np.diagonal(factor, axis1=-2, axis2=-1)
    return np.asarray(-0.5 * (whitened**2).sum(axis=-1) - np.log(roots).sum(axis=-1))


def density(x: ArrayLike, mean: ArrayLike, covariance: ArrayLike) -> Array:
    r""":math:`\mathcal N(x \mid \mu, \Sigma)` (...); arguments as for `log_density`."""
    return np.exp(log_density(x, mean, covariance))


@dataclass(frozen=True, eq=False)
class GaussianMixture(Frozen):
    r""":math:`p(x) = \sum_k w_k\, \mathcal N(x \mid \mu_k, \Sigma_k)` (Bishop 2006, eq. 9.7).

    Weights (K,) with the sum 1, means (K, D) and covariances (K, D, D).
    """

    weights: Array
    means: Array
    covariances: Array

    def __init__(self, weights: ArrayLike, means: ArrayLike, covariances: ArrayLike) -> None:
        self._keep("weights", check_finite("weights", weights))
        self._keep("means", check_finite("means", means))
        self._keep("covariances", check_covariances("covariances", covariances))

    @property
    def components(self) -> int:
        """Number K of components."""
        return len(self.weights)

    @property
    def parameters(self) -> int:
        """Number of free parameters of K − 1 weights, K means and K symmetric matrices."""
        k, d = self.means.shape
        return int(k - 1 + k * d + k * d * (d + 1) // 2)

    def log_components(self, x: ArrayLike) -> Array:
        r""":math:`\log w_k \mathcal N(x \mid \mu_k, \Sigma_k)` (..., K); −inf for a weight of 0."""
        with np.errstate(divide="ignore"):
            log_weights = np.log(self.weights)
        points = np.asarray(x)[..., None, :]
        return log_weights + log_density(points, self.means, self.covariances)

    def log_pdf(self, x: ArrayLike) -> Array:
        """log p(x) (...) at x (..., D)."""
        return np.asarray(np.logaddexp.reduce(self.log_components(x), axis=-1))

    def pdf(self, x: ArrayLike) -> Array:
        """p(x) (...) at x (..., D)."""
        return np.exp(self.log_pdf(x))

    def responsibilities(self, x: ArrayLike) -> Array:
        """:math:`z_k` (..., K), the probability that component k drew x (Bishop 2006, eq. 9.13)."""
        logs = self.log_components(x)
        return np.asarray(np.exp(logs - np.logaddexp.reduce(logs, axis=-1, keepdims=True)))

    def log_likelihood(self, x: ArrayLike) -> float:
        """Sum of log p over all observations x (..., N, D)."""
        return float(self.log_pdf(x).sum())

    def bic(self, x: ArrayLike) -> float:
        """Bayesian information criterion −2 log L + P log N of x (..., N, D); lower is better."""
        count = np.asarray(x)[..., 0].size
        return self.parameters * math.log(count) - 2.0 * self.log_likelihood(x)

    def sample(self, count: int, rng: np.random.Generator) -> tuple[Array, NDArray[np.int64]]:
        """Draws (count, D), and the component (count,) that each came from."""
        which = rng.choice(self.components, size=count, p=self.weights)
        factors = np.linalg.cholesky(self.covariances)
        noise = rng.standard_normal((count, self.means.shape[1]))
        return self.means[which] + np.einsum("nij,nj->ni", factors[which], noise), which


class MixtureFit(NamedTuple):
    """A fitted mixture, with those of all iterations, ``steps``, and their ``log_likelihoods``."""

    mixture: GaussianMixture
    log_likelihoods: Array
    converged: bool
    steps: tuple[GaussianMixture, ...]


def variance_floor(x: ArrayLike) -> float:
    r"""The smallest variance that `fit_mixture` gives a component of the observations x (N, D).

    :math:`(10^{-5} s)^2` with their root mean variance s, or what rounding leaves.  Without it a
    component could shrink onto one observation, without bound (Bishop 2006, sec. 9.2.1).
    """
    points = np.asarray(x, dtype=np.float64)
    rounding = 4.0 * np.finfo(np.float64).eps * np.abs(points).max()
    return float(max(RELATIVE_FLOOR * points.var(axis=0).mean(), rounding**2, _LEAST_VARIANCE))


def initial_mixture(
    x: ArrayLike, components: int, rng: np.random.Generator, *, floor: float | None = None
) -> GaussianMixture:
    """A start for `fit_mixture`: equal weights, means at observations, equal isotropic covariances.

    The variance is that of the data x (N, D) divided by K, or the ``floor``.  Means are seeded as
    in k-means++ (Arthur & Vassilvitskii 2007).  K may exceed N.
    """
    points = np.asarray(x, dtype=np.float64)
    floor = variance_floor(points) if floor is None else floor
    chosen = [int(rng.integers(len(points)))]
    while len(chosen) < components:
        gaps = points[:, None, :] - points[chosen]
        nearest = (gaps**2).sum(axis=-1).min(axis=1)
        total = nearest.sum()
        odds = nearest / total if total > 0 else None  # None: every observation is a mean already
        chosen.append(int(rng.choice(len(points), p=odds)))
    variance = max(float(points.var(axis=0).mean()) / components, floor)
    d = points.shape[1]
    return GaussianMixture(
        np.full(components, 1.0 / components),
        points[chosen],
        np.tile(variance * np.eye(d), (components, 1, 1)),
    )


def maximise(
    x: ArrayLike,
    responsibilities: ArrayLike,
    previous: GaussianMixture,
    *,
    floor: float,
    equal_weights: bool = False,
) -> GaussianMixture:
    """The M step: the mixture that maximises the likelihood, given responsibilities (N, K).

    Bishop 2006, eq. 9.24-9.26; with ``equal_weights`` the weights stay 1/K, as in thesis fig. 2.6.
    Eigenvalues below ``floor`` are raised to it, so that the likelihood still cannot fall.  A
    component without any responsibility stays as in ``previous``.
    """
    z, k = np.asarray(responsibilities), previous.components
    totals = z.sum(axis=0)
    means, covariances = previous.means.copy(), previous.covariances.copy()
    used = totals > 0
    means[used], raw = fit(x, z.T[used])
    covariances[used] = raise_eigenvalues(raw, floor)
    weights = np.full(k, 1.0 / k) if equal_weights else totals / totals.sum()
    return GaussianMixture(weights, means, covariances)


def fit_mixture(
    x: ArrayLike,
    components: int,
    rng: np.random.Generator,
    *,
    floor: float | None = None,
    equal_weights: bool = False,
    tolerance: float = 1e-8,
    max_iterations: int = 1000,
) -> MixtureFit:
    """Fit a mixture by expectation maximisation (Dempster, Laird & Rubin 1977; thesis sec. 2.3).

    The local maximum depends on the start, the `initial_mixture` that ``rng`` draws.  The x (N, D)
    may be few or equal; ``floor`` is by default the `variance_floor`.  With ``equal_weights`` the
    weights stay 1/K.  It ends when a step gains at most ``tolerance`` per observation.
    """
    points = np.asarray(x, dtype=np.float64)
    floor = variance_floor(points) if floor is None else floor
    least_gain = tolerance * len(points)
    steps, history = [initial_mixture(points, components, rng, floor=floor)], []
    while True:
        logs = steps[-1].log_components(points)  # the E step
        totals = np.logaddexp.reduce(logs, axis=-1, keepdims=True)
        history.append(float(totals.sum()))
        gain = history[-1] - history[-2] if len(history) > 1 else np.inf
        converged = gain <= least_gain
        if converged or len(history) > max_iterations:
            return MixtureFit(steps[-1], np.array(history), converged, tuple(steps))
        z = np.exp(logs - totals)
        steps.append(maximise(points, z, steps[-1], floor=floor, equal_weights=equal_weights))
