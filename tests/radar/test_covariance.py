"""The propagated covariance of an ego-motion estimate, one azimuth error in position and Doppler.

Two references owe nothing to the formulas: the optimum re-registered with one input changed, and
the scatter of estimates from a sensor that errs as a sensor does.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d import (
    CorruptedGaussian,
    LinearMeasurement,
    PointSet,
    RegistrationCost,
    UniformOutlier,
    register,
    rigid,
)
from d2d.radar import (
    Mounting,
    RadarScan,
    doppler_velocity,
    estimate_ego_motion,
    propagate_ego_motion,
)
from d2d.radar.motion.covariance import cross_range
from d2d.radar.motion.model import DEFAULT_OUTLIER
from d2d.radar.scans.scan import doppler_gradients

CORNER, FRONT = Mounting(3.86, 0.7, 0.436), Mounting(3.6, 0.0, 0.0)
SIGMAS = (0.15, np.deg2rad(1.0), 0.06)
INTERVAL = 0.1


def true_pair(theta, mounting=FRONT, size=30, sigmas=SIGMAS) -> tuple[RadarScan, RadarScan]:
    """Noise-free scans of static targets, always the same, 46 degrees to either side, 5 to 50 m."""
    rng = np.random.default_rng(0)
    distance, azimuth = 50.0 * np.sqrt(rng.uniform(0.01, 1.0, size)), rng.uniform(-0.8, 0.8, size)
    ahead = distance[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    to_first = rigid.compose(
        rigid.inverse(mounting.pose),
        rigid.compose(rigid.exponential(INTERVAL * np.asarray(theta)), mounting.pose),
    )
    scans = []
    for time, points in ((0.0, rigid.transform_means(to_first, ahead)), (INTERVAL, ahead)):
        angle = np.arctan2(points[:, 1], points[:, 0])
        doppler = doppler_velocity(theta, angle, mounting)
        scans.append(RadarScan(time, np.hypot(*points.T), angle, doppler, *sigmas))
    return scans[0], scans[1]


def with_errors(scan: RadarScan, errors) -> RadarScan:
    """The scan with errors (3, K) added to range, azimuth and Doppler velocity."""
    values = np.stack([scan.range, scan.azimuth, scan.doppler]) + errors
    return RadarScan(scan.time, *values, scan.sigma_range, scan.sigma_azimuth, scan.sigma_doppler)


def noisy(pair, rng, sigmas=SIGMAS) -> tuple[RadarScan, RadarScan]:
    """What a sensor measures of a true pair: each azimuth errs once."""
    scale = np.array(sigmas)[:, None]
    first, second = (with_errors(s, scale * rng.standard_normal((3, s.size))) for s in pair)
    return first, second


def held_optimum(pair, errors, doppler_error, start, mounting, outlier, first_order) -> np.ndarray:
    """The velocity that registers ``pair`` with ``errors`` (2, 3, K), what it reports held.

    Covariances and the slope of the Doppler velocity are those of ``pair``; ``doppler_error`` (K,)
    is the error of the azimuths that the Doppler velocities are predicted at.
    """
    previous, current = (with_errors(scan, by) for scan, by in zip(pair, errors, strict=True))
    gain = doppler_gradients(pair[1].azimuth + doppler_error, mounting)[0]
    slope = doppler_gradients(pair[1].azimuth, mounting)[1]
    sigmas = current.sigma_doppler, current.sigma_azimuth
    if isinstance(outlier, UniformOutlier):  # the outliers' Doppler density, 1 / 4 m/s
        outlier = UniformOutlier(outlier.density / 4.0)
    elif outlier is not None:  # the same ratio of the two weights
        alpha = outlier.fraction / (outlier.fraction + (1.0 - outlier.fraction) * 4.0)
        outlier = CorruptedGaussian(alpha, outlier.covariance)
    twist = INTERVAL * start
    found = register(
        PointSet(previous.point_set(mounting).means, pair[0].point_set(mounting).covariances),
        PointSet(current.point_set(mounting).means, pair[1].point_set(mounting).covariances),
        RegistrationCost(outlier=outlier),
        twist if first_order else rigid.exponential(twist),
        measurement=LinearMeasurement(
            current.doppler, *sigmas, gain / INTERVAL, slope / INTERVAL, not first_order
        ),
    )
    assert found.converged
    return (found.theta if first_order else rigid.logarithm(found.theta)) / INTERVAL


def by_differences(optimum, pair, shared: bool, step: float) -> np.ndarray:
    """Covariance (3, 3) from one re-registration to either side for every input of both scans.

    ``optimum(errors, doppler_error)`` is the velocity; ``step`` counts standard deviations.
    """
    total = np.zeros((3, 3))
    for scan in (0, 1):
        sigmas = pair[scan].sigma_range, pair[scan].sigma_azimuth, pair[scan].sigma_doppler
        for coordinate, target in np.ndindex(3, pair[scan].size):
            errors = np.zeros((2, 3, pair[0].size))
            errors[scan, coordinate, target] = step * sigmas[coordinate][target]
            azimuth_error = errors[1, 1] if shared else np.zeros(pair[1].size)
            ahead = optimum(errors, azimuth_error)
            change = (ahead - optimum(-errors, -azimuth_error)) / (2.0 * step)
            total += np.outer(change, change)
    if not shared:  # the Doppler velocity's azimuth errs on its own
        for target, sigma in enumerate(pair[1].sigma_azimuth):
            azimuth_error = np.zeros(pair[1].size)
            azimuth_error[target] = step * sigma
            still = np.zeros((2, 3, pair[0].size))
            change = optimum(still, azimuth_error) - optimum(still, -azimuth_error)
            total += np.outer(change, change) / (2.0 * step) ** 2
    return total


def ratios(actual, reported) -> np.ndarray:
    """Variances of ``actual`` where ``reported`` has 1, along their common axes, in rising order.

    Both covariances' strong correlations hide nothing: all are 1 only if the two are the same.
    """
    root = np.linalg.inv(np.linalg.cholesky(reported))
    return np.linalg.eigvalsh(root @ actual @ root.T)


def assert_same_covariance(actual, expected, tolerance) -> None:
    assert_allclose(ratios(actual, expected), 1.0, atol=tolerance)


@pytest.mark.parametrize("first_order", [False, True], ids=["exact", "first-order"])
@pytest.mark.parametrize(
    "outlier", [DEFAULT_OUTLIER, UniformOutlier(1e-3), None], ids=["corrupted", "uniform", "none"]
)
def test_shared_errors_propagate_as_differences_of_the_optimum(outlier, first_order):
    """Breaks if a derivative of the optimum is wrong in any range, azimuth or Doppler velocity.

    The scans are noisy, so that terms in the residuals count; what is reported is held.
    """
    theta = np.array([12.0, -0.5, 0.6])
    pair = noisy(true_pair(theta, CORNER, 10), np.random.default_rng(3))
    options = {"outlier": outlier, "first_order": first_order}
    estimate = estimate_ego_motion(*pair, CORNER, initial=theta, **options)
    assert estimate.converged
    covariance = propagate_ego_motion(estimate, *pair, CORNER, **options)

    def optimum(errors, azimuth_error):
        return held_optimum(
            pair, errors, azimuth_error, estimate.theta, CORNER, outlier, first_order
        )

    assert_same_covariance(covariance, by_differences(optimum, pair, True, 1e-3), 2e-5)
    mirrored = by_differences(lambda e, a: optimum(e, -a), pair, True, 1e-3)
    assert np.abs(ratios(covariance, mirrored) - 1.0).max() > 0.5


def test_whole_scans_registered_again_give_the_same():
    """Breaks if the covariance is not that of what `estimate_ego_motion` gives for changed scans.

    All that is computed at a measured point moves with it here, which propagation leaves out; where
    nothing errs yet, that is little.
    """
    theta = np.array([12.0, -0.5, 0.6])
    pair = true_pair(theta, CORNER, 10)
    estimate = estimate_ego_motion(*pair, CORNER, initial=theta)

    def optimum(errors, _):
        first, second = (with_errors(s, by) for s, by in zip(pair, errors, strict=True))
        return estimate_ego_motion(first, second, CORNER, initial=theta).theta

    covariance = propagate_ego_motion(estimate, *pair, CORNER)
    assert_same_covariance(covariance, by_differences(optimum, pair, True, 1e-2), 0.03)


@pytest.mark.parametrize("first_order", [False, True], ids=["exact", "first-order"])
def test_errors_apart_propagate_as_differences_of_the_optimum(first_order):
    """Breaks if an azimuth's two errors are correlated where they were said to be independent."""
    theta = np.array([12.0, -0.5, 0.6])
    pair = true_pair(theta, CORNER, 10)
    estimate = estimate_ego_motion(*pair, CORNER, initial=theta, first_order=first_order)
    covariance = propagate_ego_motion(
        estimate, *pair, CORNER, shared_azimuth=False, first_order=first_order
    )

    def optimum(errors, azimuth_error):
        return held_optimum(
            pair, errors, azimuth_error, estimate.theta, CORNER, DEFAULT_OUTLIER, first_order
        )

    # the logarithms of the variances leave residuals, and those second orders
    assert_same_covariance(covariance, by_differences(optimum, pair, False, 1e-3), 1e-3)


def test_estimates_scatter_as_the_shared_error_says():
    """Breaks if sharing has the wrong sign or size: 1500 noisy pairs at 12 m/s and 1 degree.

    With the sensor at the vehicle's origin the errors of v_y and omega are correlated by -0.55,
    which the cost knows nothing of.
    """
    theta, origin = np.array([12.0, 0.0, 0.3]), Mounting()
    rng, pair = np.random.default_rng(0), true_pair(theta, origin)
    scans = [noisy(pair, rng) for _ in range(1500)]
    options = {"outlier": None}
    estimates = [estimate_ego_motion(*scan, origin, initial=theta, **options) for scan in scans]
    assert all(estimate.converged for estimate in estimates)
    actual = np.cov(np.array([estimate.theta for estimate in estimates]).T)
    some = list(zip(estimates, scans, strict=True))[:100]
    shared, apart = (
        np.mean(
            [propagate_ego_motion(e, *s, origin, shared_azimuth=by, **options) for e, s in some],
            axis=0,
        )
        for by in (True, False)
    )

    def correlation(covariance):
        return covariance[1, 2] / np.sqrt(covariance[1, 1] * covariance[2, 2])

    assert_allclose(correlation(actual), -0.55, atol=0.04)
    assert_allclose(correlation(shared), correlation(actual), atol=0.05)
    assert abs(correlation(apart)) < 0.15
    assert abs(correlation(estimates[0].covariance)) < 0.15
    assert_allclose(ratios(actual, shared), 1.0, atol=0.1)
    assert ratios(actual, apart)[0] < 0.6
    assert ratios(actual, apart)[2] > 1.35


def test_at_a_standstill_there_is_nothing_to_share():
    """Breaks if the shared part does not vanish with the Doppler velocity's slope."""
    pair = true_pair(np.zeros(3))
    estimate = estimate_ego_motion(*pair, FRONT, initial=np.zeros(3))
    shared, apart = (
        propagate_ego_motion(estimate, *pair, FRONT, shared_azimuth=by) for by in (True, False)
    )
    assert_same_covariance(shared, apart, 1e-3)


def test_positions_alone_share_nothing():
    """Breaks if the option matters, or fails, without Doppler velocities."""
    theta = np.array([12.0, 0.0, 0.3])
    pair = noisy(true_pair(theta), np.random.default_rng(1))
    estimate = estimate_ego_motion(*pair, FRONT, initial=theta, doppler=False)
    both = [
        propagate_ego_motion(estimate, *pair, FRONT, doppler=False, shared_azimuth=by)
        for by in (True, False)
    ]
    assert_array_equal(*both)
    assert_same_covariance(both[0], estimate.covariance, 0.5)


def test_cross_range_is_the_slope_of_the_position():
    """Breaks if the mounting's yaw is left out, or the direction is turned."""
    scan = true_pair(np.zeros(3), CORNER, 7)[0]
    step = np.zeros((3, 7))
    step[1] = 1e-6
    ahead, behind = (with_errors(scan, by).point_set(CORNER).means for by in (step, -step))
    assert_allclose(cross_range(scan, CORNER), (ahead - behind) / 2e-6, rtol=1e-6, atol=1e-7)


def test_what_did_not_converge_has_no_covariance():
    """Breaks if a covariance is made up where there is no optimum."""
    theta = np.array([5.0, 0.0, 0.0])
    pair = true_pair(theta)
    estimate = estimate_ego_motion(*pair, FRONT, initial=theta)
    lost = replace(estimate, converged=np.bool_(False), covariance=np.full((3, 3), np.nan))
    assert np.isnan(propagate_ego_motion(lost, *pair, FRONT)).all()


def test_bad_input_is_refused_by_name():
    """Breaks if an argument that does not fit gives a number or an obscure error."""
    theta = np.array([5.0, 0.0, 0.0])
    previous, current = true_pair(theta)
    estimate = estimate_ego_motion(previous, current, FRONT, initial=theta)
    with pytest.raises(ValueError, match="estimate"):
        propagate_ego_motion(theta, previous, current, FRONT)
    with pytest.raises(ValueError, match="current"):
        propagate_ego_motion(estimate, current, previous, FRONT)
    with pytest.raises(ValueError, match="previous"):
        propagate_ego_motion(estimate, previous[:0], current, FRONT)
    three = replace(
        estimate,
        theta=np.tile(estimate.theta, (3, 1)),
        covariance=np.tile(estimate.covariance, (3, 1, 1)),
    )
    with pytest.raises(ValueError, match=r"^estimate must be of one velocity .* has \(3, 3\)"):
        propagate_ego_motion(three, previous, current, FRONT)


@pytest.mark.parametrize("options", [{"doppler": False}, {"slips": False}, {"first_order": True}])
def test_an_estimate_with_other_options_is_refused(options):
    """Breaks if options that were forgotten give the covariance of another estimate."""
    theta = np.array([12.0, 0.1, 0.3])
    pair = noisy(true_pair(theta), np.random.default_rng(2))
    estimate = estimate_ego_motion(*pair, FRONT, initial=theta, **options)
    assert np.isfinite(propagate_ego_motion(estimate, *pair, FRONT, **options)).all()
    with pytest.raises(ValueError, match=r"^estimate must be of the same sets or scans, cost"):
        propagate_ego_motion(estimate, *pair, FRONT)
    with pytest.raises(ValueError, match=r"^estimate must be of the same sets or scans, cost"):
        propagate_ego_motion(estimate, *pair, CORNER, **options)
