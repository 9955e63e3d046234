"""Gaussian densities and mixtures: evaluation, maximum likelihood, expectation maximisation."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import chi2

from d2d._checks import Array, broadcast, covariance_matrices, finite, flag, fraction

RELATIVE_FLOOR = 1e-6  # of the data's mean variance: the smallest variance of a fitted component


def log_density(x: ArrayLike, mean: ArrayLike, covariance: ArrayLike) -> Array:
    """log N(x | mu, Sigma), the logarithm of thesis eq. 2.7 (Bishop 2006, eq. 2.43).

    Parameters
    ----------
    x, mean : (..., D) arrays
        Broadcast against each other.
    covariance : (..., D, D) array, the square of their unit
        Symmetric positive definite; batch axes broadcast.

    Returns
    -------
    (...) array

    Raises
    ------
    ValueError
        Naming the argument that does not fit.
    """
    points, centre = _vectors("x", x), _vectors("mean", mean)
    sigma = covariance_matrices("covariance", covariance)
    d = sigma.shape[-1]
    for name, array in (("x", points), ("mean", centre)):
        if array.shape[-1] != d:
            raise ValueError(
                f"{name} must have the shape (..., {d}) to match covariance, but has {array.shape}"
            )
    broadcast("x, mean and covariance", points.shape[:-1], centre.shape[:-1], sigma.shape[:-2])
    factor = np.linalg.cholesky(sigma)
    # the few small factors are inverted once, for all points
    whitened = np.einsum("...ij,...j->...i", np.linalg.inv(factor), points - centre)
    log_root = np.log(np.diagonal(factor, axis1=-2, axis2=-1)).sum(axis=-1)
    squared = (whitened**2).sum(axis=-1)
    return np.asarray(-0.5 * (squared + d * math.log(2.0 * math.pi)) - log_root)


def density(x: ArrayLike, mean: ArrayLike, covariance: ArrayLike) -> Array:
    """N(x | mu, Sigma) (...); the arguments are those of `log_density`."""
    return np.exp(log_density(x, mean, covariance))


def fit(x: ArrayLike, weights: ArrayLike | None = None) -> tuple[Array, Array]:
    """The mean (..., D) and covariance (..., D, D) of greatest likelihood (thesis eq. 2.5, 2.6).

    Parameters
    ----------
    x : (..., N, D) array
        Observations.
    weights : (..., N) array, optional
        Of the observations: zero or more, with a positive sum; equal unless given.

    Returns
    -------
    mean, covariance : arrays
        The covariance is divided by the sum of the weights, not by N - 1: it is biased low by
        the factor (N - 1) / N, and singular where the observations span less than D dimensions.

    Raises
    ------
    ValueError
        Naming the argument: an empty set, nan or inf, a negative weight.
    """
    points = _observations(x)
    w = np.ones(points.shape[-2]) if weights is None else finite("weights", weights)
    if w.shape[-1:] != points.shape[-2:-1]:
        raise ValueError(
            f"weights must have the shape (..., {points.shape[-2]}) to match x, but has {w.shape}"
        )
    total = w.sum(axis=-1, keepdims=True)
    if (w < 0).any() or not (total > 0).all():
        raise ValueError("weights must not be negative and must have a positive sum")
    broadcast("x and weights", points.shape[:-2], w.shape[:-1])
    share = w / total
    mean = np.einsum("...n,...nd->...d", share, points)
    centred = points - mean[..., None, :]
    return mean, np.einsum("...n,...ni,...nj->...ij", share, centred, centred)


def raise_eigenvalues(
    matrices: ArrayLike, floor: ArrayLike = 0.0, smallest_ratio: float = 0.0
) -> Array:
    """Symmetric matrices (..., D, D) without eigenvalues below a floor: those are raised to it.

    The floor is ``floor`` (...), or ``smallest_ratio`` of each matrix's largest eigenvalue if that
    is more.  Of all covariances with no eigenvalue below ``floor``, the one returned for an
    empirical covariance S has the greatest likelihood: -log|Sigma| - tr(Sigma^-1 S) is largest
    with the eigenvectors of S, and along each, -log s - lambda / s rises up to s = lambda.
    """
    given = finite("matrices", matrices)
    values, vectors = np.linalg.eigh(given)
    least = np.maximum(np.asarray(floor)[..., None], smallest_ratio * values[..., -1:])
    raised = (vectors * np.maximum(values, least)[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    symmetric = 0.5 * (raised + np.swapaxes(raised, -1, -2))
    kept = np.asarray((values >= least).all(axis=-1))
    return np.where(kept[..., None, None], given, symmetric)


class Ellipse(NamedTuple):
    """An ellipse in the plane: semi-axes (..., 2), the longer first, and its angle (...) in rad.

    The angle of the longer axis counts counter-clockwise from the x axis, within (-pi/2, pi/2].
    """

    center: Array
    semi_axes: Array
    angle: Array


def confidence_ellipse(mean: ArrayLike, covariance: ArrayLike, confidence: float = 0.95) -> Ellipse:
    """The smallest region that holds ``confidence`` of a planar Gaussian's probability.

    The squared Mahalanobis distance of a draw is chi-square distributed with two degrees of
    freedom, so the ellipse's semi-axes are sqrt(chi2 quantile x eigenvalue); one, two and three
    standard deviations hold 39 %, 86 % and 99 %.

    Parameters
    ----------
    mean : (..., 2) array
    covariance : (..., 2, 2) array
    confidence : float within [0, 1)

    Raises
    ------
    ValueError
        Naming the argument that does not fit.
    """
    centre, sigma = _vectors("mean", mean), covariance_matrices("covariance", covariance)
    if centre.shape[-1] != 2 or sigma.shape[-1] != 2:
        raise ValueError(
            f"mean and covariance must be those of a plane, but have the shapes "
            f"{centre.shape} and {sigma.shape}"
        )
    if fraction("confidence", confidence) == 1.0:
        raise ValueError("confidence must be less than 1: no ellipse holds everything")
    variances, axes = np.linalg.eigh(sigma)
    scale = math.sqrt(chi2.ppf(confidence, df=2))
    longer = axes[..., :, 1]
    angle = np.arctan2(longer[..., 1], longer[..., 0])
    angle = np.where(angle > 0.5 * np.pi, angle - np.pi, angle)
    angle = np.where(angle <= -0.5 * np.pi, angle + np.pi, angle)
    return Ellipse(centre, scale * np.sqrt(variances[..., ::-1]), angle)


@dataclass(frozen=True, eq=False)
class GaussianMixture:
    """p(x) = sum_k w_k N(x | mu_k, Sigma_k) (thesis eq. 2.8, Bishop 2006, eq. 9.7).

    Parameters
    ----------
    weights : (K,) array
        Zero or more, with the sum 1.
    means : (K, D) array
    covariances : (K, D, D) array
        Symmetric positive definite.

    Raises
    ------
    ValueError
        Naming the argument that does not fit.
    """

    weights: Array
    means: Array
    covariances: Array

    def __post_init__(self) -> None:
        weights, means = finite("weights", self.weights), finite("means", self.means)
        covariances = covariance_matrices("covariances", self.covariances)
        if means.ndim != 2 or not means.size:
            raise ValueError(f"means must have the shape (K, D), but has {means.shape}")
        k, d = means.shape
        for name, array, shape in (
            ("weights", weights, (k,)),
            ("covariances", covariances, (k, d, d)),
        ):
            if array.shape != shape:
                raise ValueError(
                    f"{name} must have the shape {shape} to match means, but has {array.shape}"
                )
        if (weights < 0).any() or abs(weights.sum() - 1.0) > 1e-9:
            raise ValueError(
                f"weights must not be negative and have the sum 1, but are {weights.tolist()}"
            )
        for name, array in (("weights", weights), ("means", means), ("covariances", covariances)):
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def components(self) -> int:
        """Number K of components."""
        return len(self.weights)

    @property
    def parameters(self) -> int:
        """Number of free parameters, of K - 1 weights, K means and K symmetric matrices."""
        k, d = self.means.shape
        return int(k - 1 + k * d + k * d * (d + 1) // 2)

    def log_components(self, x: ArrayLike) -> Array:
        """log w_k N(x | mu_k, Sigma_k) (..., K) at x (..., D); -inf for a weight of zero."""
        points = _vectors("x", x)
        if points.shape[-1] != self.means.shape[1]:
            raise ValueError(
                f"x must have the shape (..., {self.means.shape[1]}), but has {points.shape}"
            )
        with np.errstate(divide="ignore"):
            log_weights = np.log(self.weights)
        return log_weights + log_density(points[..., None, :], self.means, self.covariances)

    def log_pdf(self, x: ArrayLike) -> Array:
        """log p(x) (...) at x (..., D)."""
        return np.asarray(np.logaddexp.reduce(self.log_components(x), axis=-1))

    def pdf(self, x: ArrayLike) -> Array:
        """p(x) (...) at x (..., D)."""
        return np.exp(self.log_pdf(x))

    def responsibilities(self, x: ArrayLike) -> Array:
        """z_k (..., K), the probability that component k drew x (Bishop 2006, eq. 9.13)."""
        logs = self.log_components(x)
        return np.asarray(np.exp(logs - np.logaddexp.reduce(logs, axis=-1, keepdims=True)))

    def log_likelihood(self, x: ArrayLike) -> float:
        """Sum of log p over the observations x (N, D)."""
        return float(self.log_pdf(_observations(x)).sum())

    def bic(self, x: ArrayLike) -> float:
        """Schwarz's criterion -2 log L + P log N at x (N, D); the smaller, the better."""
        points = _observations(x)
        return self.parameters * math.log(len(points)) - 2.0 * self.log_likelihood(points)

    def sample(self, count: int, rng: np.random.Generator) -> tuple[Array, NDArray[np.int64]]:
        """Draws (count, D), and the component (count,) each came from."""
        if count < 1:
            raise ValueError(f"count must be at least 1, but is {count}")
        which = rng.choice(self.components, size=count, p=self.weights)
        factors = np.linalg.cholesky(self.covariances)
        noise = rng.standard_normal((count, self.means.shape[1]))
        return self.means[which] + np.einsum("nij,nj->ni", factors[which], noise), which


class MixtureFit(NamedTuple):
    """The outcome of expectation maximisation.

    ``steps`` are the mixtures on the way, the initial one first and ``mixture`` last, and
    ``log_likelihoods`` theirs.
    """

    mixture: GaussianMixture
    log_likelihoods: Array
    converged: bool
    steps: tuple[GaussianMixture, ...]


def variance_floor(x: ArrayLike) -> float:
    """The smallest variance that `fit_mixture` gives a component of the observations x (N, D).

    A millionth of their mean variance; where all are equal, what rounding leaves of their size.
    Without a floor the likelihood is unbounded: one component can shrink onto one observation
    (Bishop 2006, sec. 9.2.1).
    """
    points = _observations(x)
    spread = points.var(axis=0).mean()
    size = max(1.0, float(np.abs(points).max()))
    return max(RELATIVE_FLOOR * float(spread), 1e-12 * size**2)


def initial_mixture(
    x: ArrayLike, components: int, rng: np.random.Generator, *, floor: float | None = None
) -> GaussianMixture:
    """Equal weights, means among the observations, and the variance of all data around each.

    The means are seeded as in k-means++ (Arthur & Vassilvitskii 2007): each further one is drawn
    with a probability proportional to its squared distance from the nearest one so far.

    Parameters
    ----------
    x : (N, D) array
    components : int
        K, at least 1; may exceed N.
    rng : numpy.random.Generator
    floor : float, optional
        Smallest variance, `variance_floor` unless given.
    """
    points = _observations(x)
    if components < 1:
        raise ValueError(f"components must be at least 1, but is {components}")
    floor = _floor(points, floor)
    chosen = [int(rng.integers(len(points)))]
    while len(chosen) < components:
        gaps = points[:, None, :] - points[chosen]
        nearest = (gaps**2).sum(axis=-1).min(axis=1)
        total = nearest.sum()
        odds = nearest / total if total > 0 else None  # every observation is taken already
        chosen.append(int(rng.choice(len(points), p=odds)))
    variance = max(float(points.var(axis=0).mean()) / components, floor)
    d = points.shape[1]
    return GaussianMixture(
        np.full(components, 1.0 / components),
        points[chosen],
        np.tile(variance * np.eye(d), (components, 1, 1)),
    )


def expect(x: ArrayLike, mixture: GaussianMixture) -> tuple[Array, float]:
    """The E step: responsibilities (N, K) of the observations x (N, D), and log-likelihood."""
    logs = mixture.log_components(_observations(x))
    totals = np.logaddexp.reduce(logs, axis=-1, keepdims=True)
    return np.exp(logs - totals), float(totals.sum())


def maximise(
    x: ArrayLike,
    responsibilities: ArrayLike,
    previous: GaussianMixture,
    *,
    floor: float,
    equal_weights: bool = False,
) -> GaussianMixture:
    """The M step: the mixture that the responsibilities (N, K) make most likely.

    Weighted mean and covariance of each component, and the mean responsibility as its weight
    (Bishop 2006, eq. 9.24-9.26).  With ``equal_weights`` the weights stay 1/K, as in thesis
    fig. 2.6.  Eigenvalues below ``floor`` are raised to it, which is the maximum under that
    constraint (`raise_eigenvalues`): the likelihood still cannot fall.  A component that no
    observation belongs to keeps its mean and covariance from ``previous``.
    """
    points, z = _observations(x), finite("responsibilities", responsibilities)
    n, k = len(points), previous.components
    if z.shape != (n, k):
        raise ValueError(f"responsibilities must have the shape {(n, k)}, but has {z.shape}")
    totals = z.sum(axis=0)
    means, covariances = previous.means.copy(), previous.covariances.copy()
    used = totals > 0
    means[used], raw = fit(points, z.T[used])
    covariances[used] = raise_eigenvalues(raw, floor)
    equal = flag("equal_weights", equal_weights)
    weights = np.full(k, 1.0 / k) if equal else totals / totals.sum()
    return GaussianMixture(weights, means, covariances)


def fit_mixture(
    x: ArrayLike,
    components: int,
    rng: np.random.Generator,
    *,
    initial: GaussianMixture | None = None,
    floor: float | None = None,
    equal_weights: bool = False,
    tolerance: float = 1e-8,
    most_iterations: int = 1000,
) -> MixtureFit:
    """Fit a mixture by expectation maximisation (Dempster, Laird & Rubin 1977; thesis sec. 2.3).

    Parameters
    ----------
    x : (N, D) array
        Observations; may be fewer than ``components``, or all equal.
    components : int
        K.
    rng : numpy.random.Generator
        Draws the initial means, unless ``initial`` is given.
    initial : GaussianMixture, optional
        Where to start; its covariances are raised to the floor.
    floor : float, optional
        Smallest variance of a component, `variance_floor` unless given.
    equal_weights : bool
        Keep the weights at 1/K instead of estimating them.
    tolerance : float
        Stop once a step gains less log-likelihood than this per observation.
    most_iterations : int

    Returns
    -------
    MixtureFit
        A local maximum: which one depends on the start.

    Raises
    ------
    ValueError
        Naming the argument that does not fit.
    """
    points = _observations(x)
    floor = _floor(points, floor)
    start = initial_mixture(points, components, rng, floor=floor) if initial is None else initial
    if start.components != components:
        raise ValueError(f"initial must have {components} components, but has {start.components}")
    start = GaussianMixture(start.weights, start.means, raise_eigenvalues(start.covariances, floor))
    steps, history = [start], []
    while True:
        responsibilities, log_likelihood = expect(points, steps[-1])
        history.append(log_likelihood)
        gain = history[-1] - history[-2] if len(history) > 1 else np.inf
        converged = gain <= tolerance * len(points)
        if converged or len(history) > most_iterations:
            return MixtureFit(steps[-1], np.array(history), converged, tuple(steps))
        steps.append(
            maximise(points, responsibilities, steps[-1], floor=floor, equal_weights=equal_weights)
        )


def _floor(points: Array, floor: float | None) -> float:
    value = variance_floor(points) if floor is None else float(floor)
    if not (math.isfinite(value) and value > 0):
        raise ValueError(f"floor must be positive, but is {value:g}")
    return value


def _vectors(name: str, value: ArrayLike) -> Array:
    array = finite(name, value)
    if array.ndim == 0:
        raise ValueError(f"{name} must have the shape (..., D), but is a number")
    return array


def _observations(x: ArrayLike) -> Array:
    points = finite("x", x)
    if points.ndim < 2 or not points.size:
        raise ValueError(f"x must have the shape (..., N, D) with N > 0, but has {points.shape}")
    return points
