"""The terms of the robust cost and its kernels, against the package's cost and differences."""

import numpy as np

from d2d import CorruptedGaussian, PointSet, RegistrationCost
from d2d.study.estimation.robust import kernels, line_terms
from d2d.study.line.scene import CORRUPTED, with_outlier

TRANSLATIONS = np.linspace(-3.0, 8.0, 101)


def test_the_terms_add_up_to_the_cost_and_its_derivatives():
    """Breaks if a term is missing, has the wrong sign or is counted twice."""
    sets = with_outlier(np.random.default_rng(1), "moving", at=4.0)
    terms = line_terms(TRANSLATIONS, *sets, CORRUPTED)
    cost = RegistrationCost(outlier=CORRUPTED)
    value, gradient, hessian = cost.derivatives(TRANSLATIONS[:, None], *sets)
    np.testing.assert_allclose(terms.value, value)
    np.testing.assert_allclose(terms.inliers + terms.outliers, gradient[:, 0], atol=1e-9)
    np.testing.assert_allclose(terms.curvature - terms.spread, hessian[:, 0, 0], atol=1e-8)
    assert (terms.curvature > 0).all()
    assert (terms.spread >= 0).all()


def test_influence_and_weight_follow_from_the_loss():
    """Breaks if the panels of a kernel do not belong together."""
    r = np.linspace(-6.0, 6.0, 2001)[1::2]  # without zero
    for loss, influence, weight in kernels(r, 0.01).values():
        np.testing.assert_allclose(np.gradient(loss, r)[1:-1], influence[1:-1], atol=1e-3)
        np.testing.assert_allclose(weight * r, influence, atol=1e-12)


def test_the_robust_kernel_is_the_cost_of_one_pair():
    """Breaks if the ratio of the heights is not that of the outlier component."""
    sigma, alpha, width = 0.2, 0.2, 1e4
    one = PointSet([[0.0]], [[[sigma**2]]])
    s = np.sqrt(2.0) * sigma
    r = np.linspace(0.0, 6.0, 13)
    cost = RegistrationCost(outlier=CorruptedGaussian(alpha, [[width**2]]))
    values = cost.value(r[:, None] * s, one, one)
    kernel = kernels(r, alpha * s / ((1.0 - alpha) * width))["robust"]
    np.testing.assert_allclose(values - values[0], kernel.loss, atol=1e-6)
