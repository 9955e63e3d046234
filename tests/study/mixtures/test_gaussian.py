"""Densities and fits against SciPy, NumPy and scikit-learn, EM against its own promise."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from sklearn.mixture import GaussianMixture as SklearnMixture

from d2d.baselines.gaussian_fit import raise_eigenvalues
from d2d.study.mixtures import gaussian
from d2d.study.mixtures.claims import random_observations
from d2d.study.mixtures.gaussian import GaussianMixture, fit_mixture
from tests.strategies import spd

SIGMA = np.array([[2.0, -0.6], [-0.6, 0.5]])
MIXTURE = GaussianMixture(
    np.array([0.3, 0.7]), np.array([[0.0, 0.0], [4.0, 1.0]]), np.stack([SIGMA, np.eye(2)])
)


def test_raised_eigenvalues_are_the_constrained_maximum():
    rng = np.random.default_rng(5)
    empirical, floor = np.diag([3.0, 0.01]), 0.2

    def log_likelihood(sigma):
        return -np.linalg.slogdet(sigma)[1] - np.trace(np.linalg.solve(sigma, empirical))

    raised = raise_eigenvalues(empirical, floor)
    assert_allclose(raised, np.diag([3.0, 0.2]), atol=1e-15)
    for _ in range(200):
        other = raised + 0.3 * rng.random() * spd(rng, 1, 2)[0]
        turned = raise_eigenvalues(other, floor)
        assert log_likelihood(turned) <= log_likelihood(raised) + 1e-12


def test_mixture_pdf_is_the_weighted_sum_and_integrates_to_one():
    x = np.random.default_rng(7).standard_normal((20, 2))
    parts = [
        w * stats.multivariate_normal(m, s).pdf(x)
        for w, m, s in zip(MIXTURE.weights, MIXTURE.means, MIXTURE.covariances, strict=True)
    ]
    assert_allclose(MIXTURE.pdf(x), sum(parts), rtol=1e-12)
    assert_allclose(MIXTURE.responsibilities(x), np.stack(parts, -1) / sum(parts)[:, None])
    axis = np.arange(-12.0, 12.0, 0.05)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1)
    assert MIXTURE.pdf(grid).sum() * 0.05**2 == pytest.approx(1.0, abs=1e-6)


def sklearn_at(mixture, **options):
    """scikit-learn's mixture with these parameters."""
    precisions = np.linalg.inv(mixture.covariances)
    return SklearnMixture(
        mixture.components,
        weights_init=mixture.weights,
        means_init=mixture.means,
        precisions_init=precisions,
        reg_covar=0.0,
        random_state=0,
        **options,
    )


@pytest.mark.parametrize("offset", [0.0, 5e5, 5e6, 1e7])
@pytest.mark.parametrize("scale", [1.0, 0.1, 1e-3])
def test_em_is_scikit_learns_at_the_origin(scale, offset):
    """The same start, without regularisation on either side: the same optimum.

    Breaks if the smallest variance follows the distance from the origin: map coordinates.
    """
    x = scale * MIXTURE.sample(400, np.random.default_rng(20))[0] + offset
    shift = x.mean(axis=0)
    start = gaussian.initial_mixture(x, 2, np.random.default_rng(21))
    fit = fit_mixture(x, 2, np.random.default_rng(21), tolerance=1e-13, max_iterations=5000)
    ours = fit.mixture
    centred = GaussianMixture(start.weights, start.means - shift, start.covariances)
    peer = sklearn_at(centred, tol=1e-13, max_iter=5000).fit(x - shift)
    rounding = 1e-15 * offset / scale
    assert_allclose(ours.weights, peer.weights_, atol=1e-5 + rounding)
    assert_allclose((ours.means - shift) / scale, peer.means_ / scale, atol=1e-4 + rounding)
    square = scale**2
    assert_allclose(ours.covariances / square, peer.covariances_ / square, atol=1e-4 + rounding)
    if not offset:
        assert fit.converged
        assert peer.converged_
        assert fit.log_likelihoods[-1] / len(x) == pytest.approx(peer.score(x - shift), abs=1e-9)


def test_no_component_shrinks_onto_one_observation():
    """Breaks if the likelihood is unbounded, or the floor is not the one that was asked for."""
    x = np.concatenate([np.random.default_rng(11).standard_normal((50, 2)), [[1e3, 1e3]]])
    for floor, expected in ((None, 1e-10 * x.var(axis=0).mean()), (1e-3, 1e-3)):
        options = {} if floor is None else {"floor": floor}
        fit = fit_mixture(x, 2, np.random.default_rng(0), **options)
        smallest = np.linalg.eigvalsh(fit.mixture.covariances).min()
        assert smallest == pytest.approx(expected)
        assert fit.converged


@pytest.mark.parametrize("equal_weights", [False, True])
def test_the_likelihood_never_falls(equal_weights):
    """Breaks if a step of EM is wrong, on sets of which four in five are degenerate."""
    for draw in range(25):
        rng = np.random.default_rng(draw)
        x, components = random_observations(rng, draw % 5)
        if draw % 5 == 3:
            x[:, 0] = 1.0  # a plane within the space: singular covariances
        fit = fit_mixture(
            x, components, rng, equal_weights=equal_weights, tolerance=1e-10, max_iterations=300
        )
        assert np.isfinite(fit.log_likelihoods).all()
        size = np.maximum(np.abs(fit.log_likelihoods), 1.0)
        assert (np.diff(fit.log_likelihoods) >= -1e-12 * size[1:]).all()
        assert len(fit.steps) == len(fit.log_likelihoods)
        assert fit.mixture is fit.steps[-1]
        assert fit.mixture.log_likelihood(x) == pytest.approx(fit.log_likelihoods[-1], rel=1e-12)
        assert np.linalg.eigvalsh(fit.mixture.covariances).min() > 0
        if equal_weights:
            assert_array_equal(fit.mixture.weights, np.full(components, 1.0 / components))


def test_em_recovers_unequal_weights_that_equal_ones_cannot():
    truth = GaussianMixture(np.array([0.15, 0.85]), MIXTURE.means, np.tile(np.eye(2), (2, 1, 1)))
    rng = np.random.default_rng(12)
    x, fresh = truth.sample(2000, rng)[0], truth.sample(20000, rng)[0]
    free = fit_mixture(x, 2, rng).mixture
    equal = fit_mixture(x, 2, rng, equal_weights=True).mixture
    assert np.sort(free.weights) == pytest.approx([0.15, 0.85], abs=0.03)
    assert free.log_likelihood(fresh) > equal.log_likelihood(fresh) + 100
