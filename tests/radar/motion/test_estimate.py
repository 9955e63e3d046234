"""Ego-motion between two scans, and from several pairs of scans.

The joint cost of thesis eq. 7.14 is written once more, target by target, as a function of the
velocity; nothing of the package takes part in it but the scans' numbers.
"""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from d2d import CorruptedGaussian, UniformOutlier
from d2d.radar import Mounting, RadarScan, estimate_ego_motion, inlier_probabilities
from d2d.radar.motion.model import DEFAULT_OUTLIER
from tests.radar.scenes import AROUND, CORNER, SIGMAS, arc, mountings, two_scans, velocities
from tests.strategies import log_normal, seeds

THETA = np.array([12.0, -0.5, 0.6])
OUTLIERS = (DEFAULT_OUTLIER, UniformOutlier(1e-3), None)
EITHER = (True, False)


def naive_targets(scan: RadarScan, mounting: Mounting) -> list[tuple[np.ndarray, np.ndarray]]:
    """Mean and covariance of each target in the vehicle frame."""
    found = []
    columns = scan.range, scan.azimuth, scan.sigma_range, scan.sigma_azimuth
    for r, phi, sr, sp in zip(*columns, strict=True):
        c, s = np.cos(phi + mounting.yaw), np.sin(phi + mounting.yaw)
        radial, across = np.array([c, s]), np.array([-s, c])
        mean = np.array([mounting.x, mounting.y]) + r * radial
        spread = sr**2 * np.outer(radial, radial) + (r * sp) ** 2 * np.outer(across, across)
        found.append((mean, spread))
    return found


def naive_cost(theta, previous, current, mounting, outlier, doppler, first_order) -> float:
    """-sum_k log((1 - alpha) inlier_k Doppler_k + alpha outlier_k / width), in the velocity theta.

    The width is that of an outlier's uniform Doppler density, 1 without Doppler velocities.
    """
    width = 4.0 if doppler else 1.0
    tau = current.time - previous.time
    v_x, v_y, omega = theta
    motion = arc([0.0, 0.0, omega], tau) if first_order else arc(theta, tau)
    turn, shift = motion[:2, :2], motion[:2, 2]
    if first_order:
        shift = tau * np.array([v_x, v_y])
    fixed, total = naive_targets(previous, mounting), 0.0
    for k, (mean, spread) in enumerate(naive_targets(current, mounting)):
        moved, turned = turn @ mean + shift, turn @ spread @ turn.T
        inlier = far = 0.0
        for center, own in fixed:
            inlier += np.exp(log_normal(moved - center, turned + own)) / len(fixed)
            if isinstance(outlier, CorruptedGaussian):
                far += np.exp(log_normal(moved - center, outlier.covariance)) / len(fixed)
        if doppler:
            angle = current.azimuth[k] + mounting.yaw
            u_x, u_y = v_x - omega * mounting.y, v_y + omega * mounting.x
            expected = -u_x * np.cos(angle) - u_y * np.sin(angle)
            slope = u_x * np.sin(angle) - u_y * np.cos(angle)
            sigma = np.hypot(current.sigma_doppler[k], slope * current.sigma_azimuth[k])
            gap = np.array([current.doppler[k] - expected])
            inlier *= np.exp(log_normal(gap, np.array([[sigma**2]])))
        if isinstance(outlier, CorruptedGaussian):
            total -= np.log((1.0 - outlier.fraction) * inlier + outlier.fraction * far / width)
        else:
            total -= np.log(inlier + (outlier.density / width if outlier else 0.0))
    return total


def derivative_along(function, direction, step=0.03) -> tuple[float, float]:
    """First and second derivative at 0, fourth-order differences."""
    far, near, here, ahead, beyond = (function(i * step * direction) for i in (-2, -1, 0, 1, 2))
    first = (far - 8.0 * near + 8.0 * ahead - beyond) / (12.0 * step)
    second = (-far + 16.0 * near - 30.0 * here + 16.0 * ahead - beyond) / (12.0 * step**2)
    return first, second


def assert_optimum_of(estimate, cost) -> None:
    """The estimate is at a minimum of ``cost``, with its value, Hessian and inverse Hessian."""
    root = np.linalg.cholesky(estimate.covariance)

    def shifted(offset):
        return cost(estimate.theta + root @ offset)

    assert estimate.value == pytest.approx(shifted(np.zeros(3)), rel=1e-10)
    axes = np.eye(3)
    slopes, curvatures = np.transpose([derivative_along(shifted, axis) for axis in axes])
    assert_allclose(slopes, 0.0, atol=1e-5)
    naive = np.diag(curvatures)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        mixed = derivative_along(shifted, axes[i] + axes[j])[1]
        naive[i, j] = naive[j, i] = 0.5 * (mixed - curvatures[i] - curvatures[j])
    assert_allclose(root.T @ estimate.hessian @ root, naive, rtol=0, atol=1e-5)
    assert_allclose(estimate.covariance @ estimate.hessian, np.eye(3), atol=1e-8)


@pytest.mark.parametrize("doppler", EITHER, ids=["doppler", "positions"])
@pytest.mark.parametrize("first_order", EITHER, ids=["first-order", "exact"])
def test_the_estimate_is_the_optimum_of_the_naive_joint_cost(doppler, first_order):
    """Breaks with any slip in the cost, or if gradient or Hessian are not those of the velocity."""
    options = {"doppler": doppler, "first_order": first_order}
    for mounting, outlier in product((Mounting(), CORNER, AROUND[2]), OUTLIERS):
        previous, current = two_scans(np.random.default_rng(21), THETA, mounting, size=7)
        if outlier is not None:  # one target that has moved, one that is new
            changed = current.doppler + np.array([0, 0, 4.0, 0, 0, 0, 0])
            distance = current.range + np.array([0, 0, 0, 0, 6.0, 0, 0])
            current = replace(current, range=distance, doppler=changed)
        pair = previous, current, mounting
        estimate = estimate_ego_motion(*pair, outlier=outlier, initial=THETA, **options)
        assert estimate.converged
        assert_optimum_of(
            estimate, lambda t, p=pair, o=outlier: naive_cost(t, *p, o, doppler, first_order)
        )


@given(seeds, velocities, mountings, st.booleans(), st.booleans())
def test_a_noise_free_motion_is_recovered(seed, theta, mounting, doppler, sharp):
    """Breaks if positions, Doppler velocities, mounting or interval do not fit together.

    Not exactly: neighbours pull, and covariances that differ in direction between the scans move
    the optimum, the less the smaller the sigmas are.
    """
    sigmas = (0.01, 1e-4, 0.01) if sharp else SIGMAS
    rng, start = np.random.default_rng(seed), theta + np.array([0.02, -0.02, 0.001])
    pair = (*two_scans(rng, theta, mounting, sigmas=sigmas, noisy=False), mounting)
    estimate = estimate_ego_motion(*pair, doppler=doppler, initial=start)
    assert estimate.converged
    deviations = np.sqrt(np.diag(estimate.covariance))
    assert (np.abs(estimate.theta - theta) < (0.01 if sharp else 1.5) * deviations).all()
    share = inlier_probabilities(estimate.theta, *pair, doppler=doppler)
    assert share.shape == (20,)
    assert share.min() > 0.8


def test_the_doppler_velocities_give_the_start():
    """Breaks if the default start is another velocity's, at a standstill or in reverse."""
    for theta in ([0.0, 0.0, 0.0], [8.0, 0.0, 0.0], [15.0, -0.4, 0.5], [-2.0, 0.1, -0.3]):
        pair = two_scans(np.random.default_rng(22), theta, noisy=False)
        for doppler in EITHER:
            estimate = estimate_ego_motion(*pair, CORNER, doppler=doppler)
            assert estimate.converged
            deviations = np.sqrt(np.diag(estimate.covariance))
            assert (np.abs(estimate.theta - theta) < 0.2 * deviations).all()


def test_scales_reach_the_optimum_from_a_far_start():
    """Breaks if the schedule is not handed on to the registration."""
    theta = np.array([40.0, 0.0, 0.0])
    previous, current = two_scans(np.random.default_rng(27), theta)
    options = {"doppler": False, "initial": np.zeros(3)}
    direct = estimate_ego_motion(previous, current, CORNER, **options)
    annealed = estimate_ego_motion(previous, current, CORNER, scales=(8, 4, 2, 1), **options)
    assert abs(direct.theta[0] - 40.0) > 10.0, "the start is too near to tell"
    assert abs(annealed.theta[0] - 40.0) < 3.0 * np.sqrt(annealed.covariance[0, 0])
    assert annealed.value < direct.value


def pairs_around(rng, theta, size=7):
    """A pair of scans of each sensor, over intervals of their own and not at the same times."""
    pairs = []
    for i, mounting in enumerate(AROUND):
        scans = two_scans(rng, theta, mounting, size=size, interval=0.07 + 0.02 * i)
        pairs.append((*(replace(scan, time=scan.time + 0.01 * i) for scan in scans), mounting))
    return pairs


def together(pairs, **options):
    """The estimate from pairs of scans, given one by one."""
    return estimate_ego_motion(*zip(*pairs, strict=True), **options)


def test_the_joint_estimate_is_the_optimum_of_the_sum_of_naive_costs():
    """Breaks if a pair's interval, mounting or chain rule is another's, or one is left out."""
    for doppler, outlier in product(EITHER, (DEFAULT_OUTLIER, None)):
        pairs = pairs_around(np.random.default_rng(60), THETA)
        if outlier is not None:  # one target that has moved
            previous, current, mounting = pairs[1]
            changed = current.doppler + np.array([0, 0, 4.0, 0, 0, 0, 0])
            pairs[1] = previous, replace(current, doppler=changed), mounting
        estimate = together(pairs, doppler=doppler, outlier=outlier, initial=THETA)
        assert estimate.converged

        def cost(theta, pairs=pairs, rest=(outlier, doppler, False)):
            return sum(naive_cost(theta, *pair, *rest) for pair in pairs)

        assert_optimum_of(estimate, cost)


def test_one_pair_in_a_sequence_is_that_pair():
    """Breaks if one pair and several take different ways: the results are equal bit by bit."""
    pair = (*two_scans(np.random.default_rng(61), THETA, size=30), CORNER)
    annealed = {"doppler": False, "initial": [11.5, 0.0, 0.5], "scales": (8.0, 4.0, 2.0, 1.0)}
    for options in ({}, {"doppler": False}, {"side_slip": 0.1}, annealed):
        alone = estimate_ego_motion(*pair, **options)
        listed = estimate_ego_motion(*(iter([each]) for each in pair), **options)
        assert alone.converged
        assert_array_equal(listed.theta, alone.theta)
        assert_array_equal(listed.covariance, alone.covariance)
        assert listed.value == alone.value


def test_joint_start_comes_from_all_sensors_doppler_velocities():
    """Breaks if the default start is zero, from where the positions find another optimum."""
    theta = np.array([40.0, 0.2, 0.4])
    pairs = pairs_around(np.random.default_rng(63), theta, size=40)
    estimate = together(pairs, doppler=False)
    assert estimate.converged
    assert (np.abs(estimate.theta - theta) < 4.0 * np.sqrt(np.diag(estimate.covariance))).all()
    from_zero = together(pairs, doppler=False, initial=np.zeros(3))
    assert np.abs(from_zero.theta - theta)[0] > 1.0, "the scene is too easy to tell starts apart"


def refusals() -> list[tuple[tuple, str]]:
    """Scans, or sequences of them, that cannot be registered."""
    before, after = two_scans(np.random.default_rng(28), [5.0, 0.0, 0.0])
    pairs = pairs_around(np.random.default_rng(66), THETA)
    previous, current, mounting = zip(*pairs, strict=True)
    empty = [*current[:2], current[2][:0]]
    return [
        ((before, replace(after, time=before.time), CORNER), "current must be later than previous"),
        ((after, before, CORNER), "current must be later than previous"),
        ((before[:0], after, CORNER), "previous holds no targets"),
        ((before, after[:0], CORNER), "current holds no targets"),
        ((before, "a scan", CORNER), "current must be a RadarScan, but is a str"),
        (([], [], []), "previous must hold at least one scan, but is empty"),
        ((previous, current[:2], mounting), "previous, current .* length, but have 3, 2 and 3"),
        ((previous, empty, mounting), r"current\[2\] holds no targets"),
        ((current, previous, mounting), r"current\[0\] must be later than previous\[0\]"),
        ((previous, mounting, current), r"current\[0\] must be a RadarScan, but is a Mounting"),
    ]


@pytest.mark.parametrize("case", range(10))
def test_scans_that_do_not_fit_are_refused_by_name(case):
    """Breaks if a zero interval divides, or the error does not say which scan."""
    wrong, said = refusals()[case]
    with pytest.raises(ValueError, match=f"^{said}"):
        estimate_ego_motion(*wrong)


def test_options_are_refused_by_name():
    """Breaks if several starts get through, whose covariances came out wrong in silence, or a prior
    without a width makes the cost nan."""
    pair = (*two_scans(np.random.default_rng(30), [5.0, 0, 0]), CORNER)
    for name, values in (
        ("initial", (1.0, [1.0, 2.0], [1.0, 2.0, np.nan], np.ones((1, 3)), np.ones((3, 3)), pair)),
        ("scales", ([], 1.0, [[1.0]], [0.0])),
        ("side_slip", (0.0, -0.1, 1e-200, 1e200, np.nan, "no", [0.1, 0.2])),
    ):
        for value in values:
            with pytest.raises(ValueError, match=f"^{name} must"):
                estimate_ego_motion(*pair, **{name: value})


@pytest.mark.parametrize("side_slip", [False, 0.05])
def test_what_is_known_of_the_side_slip_is_a_prior(side_slip):
    """Breaks if the prior is not in the cost, in its optimum or in its covariance."""
    pair = (*two_scans(np.random.default_rng(67), [8.0, 0.1, 0.2]), CORNER)
    precision = np.diag([0.0, (side_slip or 1e-3) ** -2, 0.0])
    free, bound = estimate_ego_motion(*pair), estimate_ego_motion(*pair, side_slip=side_slip)

    def cost(theta):
        own = naive_cost(theta, *pair, DEFAULT_OUTLIER, True, False)
        return own + 0.5 * theta @ precision @ theta

    assert_optimum_of(bound, cost)
    assert abs(bound.theta[1]) < abs(free.theta[1])
    assert bound.covariance[2, 2] < 0.7 * free.covariance[2, 2]
