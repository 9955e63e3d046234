"""What the thesis prints beside what is right: each entry of chapters/errata.md, evaluated.

Equation numbers are the thesis's. A test breaks if the correction is not one, that is if what is
printed does as well.
"""

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import chi2

from d2d import (
    CorruptedGaussian,
    LinearMeasurement,
    RegistrationCost,
    UniformOutlier,
    credibility,
    register,
    rigid,
)
from d2d.baselines import fit_rigid
from d2d.radar import Mounting, RadarScan, doppler_velocity, inlier_probabilities
from d2d.radar.scans.scan import doppler_gradients
from d2d.study import CLAIMS, scenarios
from d2d.study.line.scene import FIXED_POSITIONS, TRUTH
from d2d.study.mixtures.gaussian import density
from tests.strategies import ROBUST

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "chapters" / "errata.md"
LIKELIHOOD = RegistrationCost("d2d", "likelihood")
SUMMING = RegistrationCost("d2d", "summing")


@pytest.fixture(scope="module")
def pair():
    """One draw of the overlapped scene, its true motion, and the likelihood's optimum."""
    fixed, moving = (each[0] for each in scenarios.OVERLAPPED.sample(1, np.random.default_rng(2)))
    theta = scenarios.OVERLAPPED.theta
    return fixed, moving, theta, register(fixed, moving, LIKELIHOOD, initial=theta)


def test_every_erratum_has_its_evidence():
    """Breaks if a row is stated without a check, or names a test or a claim that does not exist."""
    page = PAGE.read_text(encoding="utf-8")
    for row in re.findall(r"^\| (?!---|where).*", page, re.M):
        evidence = row.strip("|").split("|")[-1]
        kinds = r"`(\w+/)*test_\w+::test_|\{(doc|eq|numref)\}|caption|\{cite"
        assert re.search(kinds, evidence), row
        for id in re.findall(r"claims? `([a-z-]+)`", row):
            assert id in CLAIMS, id
        for module, test in re.findall(r"`((?:\w+/)*test_\w+)::(test_\w+)`", row):
            source = (ROOT / "tests" / f"{module}.py").read_text(encoding="utf-8")
            assert f"\ndef {test}(" in source, test


def test_the_sum_approximates_a_likelihood_only_under_a_dominating_outlier_component(pair):
    """Ch. 1 calls the sum an approximation of the likelihood: -log(c + q) ~ -log c - q / c."""
    fixed, moving, theta, _ = pair
    shifts = np.array([[0.0, 0.0, 0.0], [0.3, -0.2, 0.01], [3.0, 1.0, 0.2], [-6.0, 4.0, -0.4]])
    sums = LIKELIHOOD.target_densities(theta + shifts, fixed, moving).sum(axis=-1)
    for level, agrees in ((1e3, True), (1e-6, False)):
        cost = RegistrationCost(outlier=UniformOutlier(level)).value(theta + shifts, fixed, moving)
        limit = moving.size * -np.log(level) - sums / level
        assert np.allclose(cost - limit, 0.0, atol=1e-3 * np.ptp(sums / level)) == agrees


def test_all_pairs_do_not_determine_a_rotation():
    """Eq. 3.2 pairs every point with every other: the best motion is then any rotation at all."""
    rng = np.random.default_rng(3)
    fixed, moving = rng.standard_normal((5, 2)), rng.standard_normal((5, 2))

    def error(angle, every):
        turned = moving @ rigid.rotation(angle).T
        moved = turned + fixed.mean(axis=0) - turned.mean(axis=0)  # the best translation
        gaps = fixed[:, None] - moved if every else fixed - moved
        return np.square(gaps).sum()

    printed, ours = ([error(angle, e) for angle in (0.0, 1.0, 2.5)] for e in (True, False))
    assert np.ptp(printed) < 1e-12 * printed[0]
    best = error(fit_rigid(fixed, moving)[2], False)
    assert best < min(ours)


def test_the_mahalanobis_distance_is_another_order_than_the_density():
    """Sections 3.2 and 4.2 name the one and sum the other: they can prefer different components."""
    wide, narrow = np.array([[9.0]]), np.array([[0.04]])
    x, means = np.array([0.0]), (np.array([3.0]), np.array([0.3]))
    distances = [
        float((x - mean) @ np.linalg.inv(covariance) @ (x - mean))
        for mean, covariance in zip(means, (wide, narrow), strict=True)
    ]
    densities = [float(density(x, m, s)) for m, s in zip(means, (wide, narrow), strict=True)]
    assert distances[0] < distances[1]
    assert densities[0] < densities[1]


def test_the_moving_set_is_not_the_moved_fixed_one():
    """Section 4.1 has M = T(F); the peaks that it names, 2, 10 and 12.2 m, need F = T(M)."""
    reported = [2.0, 10.0, 12.2]
    for sign, agrees in ((1.0, False), (-1.0, True)):
        moving_b = FIXED_POSITIONS[0] + sign * TRUTH
        assert np.allclose(FIXED_POSITIONS - moving_b, reported) == agrees


def test_the_inner_product_is_no_distance():
    """Eq. 4.6: it is largest for equal densities; the distance vanishes there."""
    x = np.linspace(-12.0, 12.0, 4001)
    step = x[1] - x[0]

    def normal(difference, variance):
        return np.exp(-0.5 * difference**2 / variance) / np.sqrt(2 * np.pi * variance)

    printed, distances = [], []
    for shift in (0.0, 0.5, 2.0):
        p, q = normal(x, 0.3), normal(x - shift, 0.3)
        printed.append(normal(shift, 0.6))
        distances.append(2 * normal(0.0, 0.6) - 2 * normal(shift, 0.6))
        assert_allclose(printed[-1], (p * q).sum() * step, rtol=1e-10)
        assert_allclose(distances[-1], np.square(p - q).sum() * step, atol=1e-10)
    assert distances[0] == 0.0
    assert printed == sorted(printed, reverse=True)
    assert distances == sorted(distances)


def test_alpha_changes_its_meaning_between_the_chapters(pair):
    """Eq. 4.16 weighs the inliers with alpha, eq. 6.3 and 7.8 the outliers: 0.2 is then 0.8."""
    fixed, moving, theta, _ = pair
    models = [CorruptedGaussian(fraction, 100.0 * np.eye(2)) for fraction in (0.0, 0.2, 1.0)]
    costs = [RegistrationCost(outlier=model) for model in models]
    inlier, chapter_6, outlier = (c.target_densities(theta, fixed, moving) for c in costs)
    chapter_4 = 0.2 * inlier + 0.8 * outlier
    assert_allclose(chapter_6, 0.8 * inlier + 0.2 * outlier)
    assert (chapter_6 > 2.0 * chapter_4).any()


def test_a_density_is_maximised(pair):
    """Eq. 5.1, 6.5 and 7.9 have arg min of the density; its inverse Hessian is negative too."""
    fixed, moving, theta, estimate = pair

    def printed(at):
        return np.exp(-LIKELIHOOD.value(at, fixed, moving))

    assert printed(estimate.theta) > printed(theta) > printed(theta + np.array([2.0, 0.0, 0.0]))
    # at the optimum the Hessian of the density is -f times that of -log f
    _, gradient, hessian = LIKELIHOOD.derivatives(estimate.theta, fixed, moving)
    of_density = printed(estimate.theta) * (np.outer(gradient, gradient) - hessian)
    assert (np.linalg.eigvalsh(np.linalg.inv(of_density)) < 0.0).all()
    assert (np.linalg.eigvalsh(estimate.covariance) > 0.0).all()


def test_transposes_are_the_other_way_round():
    """Eq. 5.3, 5.9, below 5.21: f f' is a matrix; A A' x = A' b and G S G do not fit."""
    a, b = np.array([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0]]), np.array([1.0, 2.0, 2.5])
    x = np.linalg.solve(a.T @ a, a.T @ b)
    assert_allclose(x, np.linalg.lstsq(a, b, rcond=None)[0])
    f = (a @ x - b)[:, None]
    assert (0.5 * f @ f.T).shape == (3, 3)
    assert (0.5 * f.T @ f).shape == (1, 1)
    with pytest.raises(ValueError, match="matmul"):
        (a @ a.T) @ x
    mixed, sigma = np.ones((3, 32)), np.eye(32)
    assert (mixed @ sigma @ mixed.T).shape == (3, 3)
    with pytest.raises(ValueError, match="matmul"):
        mixed @ sigma @ mixed


def test_newtons_curvature_needs_a_hessian_for_each_residual():
    """Table 5.1 has H'f: for f = (x y, x + y, y^2) only the sum of f_i times Hessians is right."""
    x, y = 1.3, -0.7
    f = np.array([x * y, x + y, y**2])
    j = np.array([[y, x], [1.0, 1.0], [0.0, 2 * y]])
    hessians = np.array([[[0, 1], [1, 0]], [[0, 0], [0, 0]], [[0, 0], [0, 2]]], dtype=float)
    curvature = j.T @ j + np.einsum("i,ijk->jk", f, hessians)
    # F = (x^2 y^2 + (x + y)^2 + y^4) / 2
    expected = [[y**2 + 1, 2 * x * y + 1], [2 * x * y + 1, x**2 + 1 + 6 * y**2]]
    assert_allclose(curvature, expected)
    with pytest.raises(ValueError, match="matmul"):
        curvature.T @ f  # the Hessian of F, times f


def test_the_second_taylor_term_has_the_second_derivative():
    """Eq. 5.13 squares the first derivative: for 3 x^2 at 2 that is 144 instead of 6."""
    x0, x = 2.0, 2.1
    linear = 3 * x0**2 + 6 * x0 * (x - x0)
    assert linear + 0.5 * 6 * (x - x0) ** 2 == pytest.approx(3 * x**2)
    assert linear + 0.5 * (6 * x0) ** 2 * (x - x0) ** 2 != pytest.approx(3 * x**2, rel=0.05)


def test_one_squared_deviation_is_no_covariance():
    """Eq. 5.14 lacks the expectation: one outer product has rank one, whatever the noise."""
    rng = np.random.default_rng(4)
    g = np.array([[1.0, 2.0], [0.5, -1.0]])
    sigma = np.diag([0.04, 0.09])
    y = rng.multivariate_normal([0.0, 0.0], sigma, 20000) @ g.T
    assert np.linalg.matrix_rank(np.outer(y[0], y[0])) == 1
    assert_allclose(y.T @ y / len(y), g @ sigma @ g.T, atol=0.01)


def test_an_implicit_function_needs_an_invertible_derivative():
    """Theorem in 5.2 asks for a derivative unlike zero: this one is, and y is not determined."""

    def phi(x, y):
        return np.array([y[0] + y[1] - x, 2 * (y[0] + y[1] - x)])

    derivative = np.array([[1.0, 1.0], [2.0, 2.0]])
    assert (derivative != 0.0).all()
    assert np.linalg.matrix_rank(derivative) == 1
    for y in ([0.3, 0.7], [0.4, 0.6]):  # two solutions at the same x, and all between
        assert_allclose(phi(1.0, y), 0.0, atol=1e-15)


def test_an_inverse_hessian_is_a_covariance_only_of_a_log_likelihood(pair):
    """Section 5.2.2 asks for a quadratic cost only: half the cost has the same optimum."""
    fixed, moving, _, estimate = pair
    _, _, hessian = LIKELIHOOD.derivatives(estimate.theta, fixed, moving)
    assert_allclose(np.linalg.inv(0.5 * hessian), 2.0 * estimate.covariance, rtol=1e-6)


def test_the_nees_weighs_by_the_inverse():
    """Eq. 6.6 and 6.7: with the covariance itself it depends on the unit, and is 16 for sigma 2."""
    errors = 2.0 * np.random.default_rng(5).standard_normal((20000, 3))
    covariance = 4.0 * np.eye(3)
    printed = np.einsum("ni,ij,nj->n", errors, covariance, errors)
    ours = credibility(errors, covariance).nees
    assert_allclose(printed.mean() / 3, 16.0, rtol=0.03)
    assert_allclose(ours.mean() / 3, 1.0, rtol=0.03)
    assert len(range(len(errors) + 1)) != len(errors)  # i = 0 ... N is one term too many


def test_the_quantiles_bound_ninety_per_cent():
    """Section 6.2 takes 0.05 and 0.95 for a region of 95 %."""
    freedom = 3000
    printed, ours = chi2.ppf([0.05, 0.95], freedom), chi2.ppf([0.025, 0.975], freedom)
    assert_allclose(np.diff(chi2.cdf(printed, freedom)), 0.90)
    assert_allclose(np.diff(chi2.cdf(ours, freedom)), 0.95)
    assert_allclose(printed, [2873.7, 3128.5], atol=0.1)
    assert_allclose(ours, [2850.1, 3153.7], atol=0.1)


def test_single_runs_are_not_judged_by_the_bounds_of_the_sum():
    """Section 6.2 compares each NEES with l_1 and l_2: no run in a million exceeds even l_1."""
    lowest = chi2.ppf(0.025, 3000)
    assert chi2.sf(lowest, 3) < 1e-6
    assert_allclose(chi2.ppf([0.025, 0.975], 3), [0.216, 9.348], atol=1e-3)


def test_the_mean_square_about_the_truth_is_not_a_bias():
    """Eq. 6.9 calls each run's error a bias; the bias is their mean, and eq. 6.10 contains it."""
    errors = np.random.default_rng(6).normal([0.5, 0.0], 1.0, (5000, 2))
    square = errors.T @ errors / len(errors)
    bias = errors.mean(axis=0)
    assert_allclose(square, np.cov(errors.T, bias=True) + np.outer(bias, bias))
    assert_allclose(bias, [0.5, 0.0], atol=0.06)
    assert np.abs(errors).mean() > 10 * abs(bias[1])


def test_the_ratio_is_actual_over_estimated():
    """Eq. 6.11 beside its explanation: a covariance four times too large has the ratio 1/4."""
    errors = np.random.default_rng(7).standard_normal((4000, 3))
    actual = errors.T @ errors / len(errors)
    assert_allclose(credibility(errors, 4.0 * actual).ratio, 0.25)


def test_the_sum_has_less_curvature(pair):
    """Sections 6.3 and 6.4 explain its larger covariance by more curvature."""
    fixed, moving, theta, _ = pair
    likely, summed = (
        register(fixed, moving, cost, initial=theta).hessian for cost in (LIKELIHOOD, SUMMING)
    )
    assert (np.linalg.eigvalsh(likely - summed) > 0.0).all()
    assert np.linalg.det(likely) > 5.0**3 * np.linalg.det(summed)


def test_the_outlier_component_takes_curvature_away(pair):
    """Section 6.3 has it that the component adds curvature, and that this makes it pessimistic."""
    fixed, moving, theta, plain = pair
    hessian = register(fixed, moving, ROBUST, initial=theta).hessian
    assert np.linalg.det(hessian) < np.linalg.det(plain.hessian)


def test_the_nci_has_no_sign():
    """Section 6.3, l. 1337-1339, reads from the NCI which covariance is the more pessimistic."""
    errors = np.random.default_rng(8).standard_normal((1000, 3))
    found = [credibility(errors, np.tile(scale * np.eye(3), (1000, 1, 1))) for scale in (0.1, 10.0)]
    optimistic, pessimistic = found
    assert optimistic.nci == pytest.approx(pessimistic.nci, rel=0.05)
    assert optimistic.inclination > 9.0
    assert pessimistic.inclination < -9.0


def test_the_motion_is_no_motion_of_a_vehicle():
    """Section 6.1: 5 m and 15° in 0.2 s are 25 m/s at 75 °/s, 3.3 g across."""
    translation, turn = scenarios.OVERLAPPED.theta[0], scenarios.OVERLAPPED.theta[2]
    speed, rate = translation / 0.2, turn / 0.2
    assert speed == pytest.approx(25.0)
    assert np.rad2deg(rate) == pytest.approx(75.0)
    assert speed * rate / 9.81 == pytest.approx(3.34, abs=0.01)


def test_another_factor_adds_curvature(pair):
    """Section 7.3, l. 1716 and 1733: a joint factor makes the curvature less."""
    fixed, moving, theta, plain = pair
    along = np.tile([1.0, 0.0, 0.0], (moving.size, 1))
    speeds = LinearMeasurement(np.full(moving.size, theta[0]), 0.1, 0.0, along, 0.0 * along)
    joint = register(fixed, moving, LIKELIHOOD, initial=theta, measurement=speeds)
    assert np.linalg.det(joint.hessian) > 5.0 * np.linalg.det(plain.hessian)


def test_one_wide_gaussian_at_the_mean_is_narrower_than_the_mixture():
    """L. 1547: the outlier component is at the mean of the previous scan's targets."""
    fixed, moving = scenarios.OUTLIERS.true_sets
    moved = rigid.transform_means(scenarios.OUTLIERS.theta, moving)
    wide = ROBUST.outlier.covariance
    mixture = np.mean([density(moved, mean, wide) for mean in fixed], axis=0)
    ratio = mixture / density(moved, fixed.mean(axis=0), wide)
    assert ratio[:-1].min() == pytest.approx(0.55, abs=0.01)
    assert ratio[:-1].max() == pytest.approx(1.39, abs=0.01)
    assert ratio[-1] == pytest.approx(3.9, abs=0.05)  # the far outlier


def test_the_jacobians_columns_belong_to_range_and_azimuth():
    """Eq. 7.3 to 7.5: columns (azimuth, range, Doppler) against diag(sigma_r^2, sigma_phi^2)."""
    r, phi, sigma_r, sigma_phi = 30.0, 0.4, 0.15, np.deg2rad(1.0)
    by_range = np.array([np.cos(phi), np.sin(phi)])
    by_azimuth = r * np.array([-np.sin(phi), np.cos(phi)])
    polar = np.diag([sigma_r**2, sigma_phi**2])
    with pytest.raises(ValueError, match="matmul"):
        np.stack([by_azimuth, by_range, np.zeros(2)], axis=1) @ polar
    swapped = np.stack([by_azimuth, by_range], axis=1)
    wrong = np.sqrt(np.linalg.eigvalsh(swapped @ polar @ swapped.T))
    right = np.sqrt(np.linalg.eigvalsh(np.diag([sigma_r, r * sigma_phi]) ** 2))
    assert_allclose(right, [0.15, 0.524], atol=1e-3)
    assert_allclose(wrong, [0.01745, 4.5], atol=1e-3)  # m: a thirtieth of the range as its error
    scan = RadarScan(0.0, [r], [phi], [0.0], sigma_r, sigma_phi, 0.1)
    ours = scan.point_set(Mounting(0.0, 0.0, 0.0)).covariances[0]
    assert_allclose(np.sqrt(np.linalg.eigvalsh(ours)), right)


def test_v_tau_is_the_first_order_of_the_arc():
    """Eq. 7.2: what is left out is v omega tau^2 / 2 across, to first order."""
    v, omega, tau = 10.0, 0.5, 0.1
    arc = rigid.exponential(np.array([v, 0.0, omega]) * tau)
    assert_allclose(arc[:2] - [v * tau, 0.0], [0.0, v * omega * tau**2 / 2], atol=5e-4)
    assert arc[1] == pytest.approx(0.025, rel=1e-3)  # m


def test_the_outliers_lack_a_doppler_density():
    """Eq. 7.13 and 7.14: the share of the outliers depends on the unit of the Doppler velocity."""
    theta, mounting = np.array([10.0, 0.0, 0.1]), Mounting(3.0, 0.0, 0.0)
    rng, azimuth = np.random.default_rng(4), np.linspace(-0.6, 0.6, 9)
    doppler = doppler_velocity(theta, azimuth, mounting) + 0.1 * rng.standard_normal(9)
    scans = [
        RadarScan(t, np.linspace(10, 30, 9) - 10.0 * t, azimuth, doppler, 0.15, 0.01, 0.06)
        for t in (0.0, 0.1)
    ]

    def odds(**options):
        inside = inlier_probabilities(theta, *scans, mounting, **options)
        return (1.0 - inside) / inside

    # a density per m/s is 3.6 times that per km/h: as printed, the outliers weigh 3.6 times less
    printed = odds(doppler_width=1.0)
    assert_allclose(printed, 3.6 * odds(doppler_width=3.6), rtol=1e-9)
    # against outliers uniform over 40 m/s, the printed fraction of 0.2 acts like this one
    acts_like = CorruptedGaussian(0.2 * 40.0 / (0.2 * 40.0 + 0.8), 100.0 * np.eye(2))
    assert acts_like.fraction == pytest.approx(0.91, abs=0.005)
    assert_allclose(odds(outlier=acts_like, doppler_width=40.0), printed, rtol=1e-9)


def test_the_doppler_velocity_depends_on_the_azimuth_only():
    """Eq. 7.10 gives V the position m_k: at any range along one azimuth it is the same."""
    theta, mounting = np.array([8.0, 0.3, 0.2]), Mounting(1.0, 0.5, 0.3)
    scan = RadarScan(0.0, [5.0, 50.0], [0.4, 0.4], [0.0, 0.0], 0.1, 0.01, 0.1)
    positions = scan.point_set(mounting).means
    assert np.linalg.norm(positions[1] - positions[0]) > 40.0
    predicted = doppler_velocity(theta, scan.azimuth, mounting)
    assert predicted[0] == predicted[1]
    assert doppler_velocity(theta, [0.5], mounting)[0] != pytest.approx(predicted[0], rel=1e-3)


def test_position_and_doppler_share_the_error_of_the_azimuth():
    """Eq. 7.14 multiplies their densities as if independent; ahead they are, at the sides not."""
    theta, mounting = np.array([10.0, 0.0, 0.0]), Mounting(0.0, 0.0, 0.0)
    sigma_phi, sigma_v = np.deg2rad(1.0), 0.06
    rng = np.random.default_rng(8)
    for azimuth, expected in ((0.0, 0.0), (np.deg2rad(40.0), 0.62)):
        noise = sigma_phi * rng.standard_normal((2, 20000))
        truth = doppler_velocity(theta, [azimuth], mounting)
        measured = truth + sigma_v * rng.standard_normal(20000)
        residual = measured - doppler_velocity(theta, azimuth + noise[0], mounting)
        across = noise[0] - noise[1]  # per metre of range, moving less fixed
        found = np.corrcoef(across, residual)[0, 1]
        slope = float(doppler_gradients(np.array([azimuth]), mounting)[1][0] @ theta)
        # the Doppler's own noise, and the other scan's azimuth, are all that is not shared
        model = -slope * sigma_phi / np.hypot(sigma_v, slope * sigma_phi) / np.sqrt(2.0)
        assert_allclose(found, model, atol=0.02)
        assert_allclose(abs(found), expected, atol=0.03)
