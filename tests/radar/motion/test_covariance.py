"""The propagated covariance of an ego-motion estimate, from one pair of scans and from several.

Three references owe nothing to the formulas: the optimum registered again with measured values
changed, the gradient of the cost with them changed, and the scatter of estimates from a sensor
that errs as a sensor does.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import logm, sqrtm

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
    EgoMotionModel,
    ErrorBudget,
    Mounting,
    RadarScan,
    estimate_ego_motion,
    propagate_ego_motion,
)
from d2d.radar.motion.covariance import add_noise, apply_budget, influences
from d2d.radar.motion.estimate import estimate_velocity
from d2d.radar.motion.model import DEFAULT_OUTLIER
from d2d.radar.motion.pairs import ScanPair, problem_of
from d2d.radar.scans.scan import doppler_gradients
from tests.radar.scenes import CORNER, arc, frame, observe

THETA = np.array([12.0, -0.5, 0.6])
SIGMAS = (0.15, np.deg2rad(1.0), 0.06)
TIMES = (0.0, 0.1)
REAR = Mounting(-0.5, -0.8, 2.6)


def seen(rng=None, theta=THETA, mounting=CORNER, times=TIMES, size=10) -> list[RadarScan]:
    """Scans of static targets, always the same, 46 degrees to either side, 5 to 50 m away.

    They have noise if ``rng`` is given: each azimuth errs once.
    """
    draw = np.random.default_rng(int(100 * mounting.yaw) % 1000)
    distance, azimuth = 50.0 * np.sqrt(draw.uniform(0.01, 1.0, size)), draw.uniform(-0.8, 0.8, size)
    ahead = np.stack([distance * np.cos(azimuth), distance * np.sin(azimuth), np.ones(size)])
    points = (arc(theta, times[-1]) @ frame(mounting) @ ahead)[:2].T
    scans = []
    for time in times:
        noise = np.zeros((3, size)) if rng is None else rng.standard_normal((3, size))
        scans.append(observe(points, arc(theta, time), time, theta, mounting, noise, SIGMAS))
    return scans


def with_errors(scan: RadarScan, errors) -> RadarScan:
    """The scan with errors (3, K) added to range, azimuth and Doppler velocity."""
    values = np.stack([scan.range, scan.azimuth, scan.doppler]) + errors
    return RadarScan(scan.time, *values, scan.sigma_range, scan.sigma_azimuth, scan.sigma_doppler)


def one_error(shape, *place, size) -> np.ndarray:
    """Errors (shape) of which only one is not zero."""
    errors = np.zeros(shape)
    errors[place] = size
    return errors


def several(rng=None) -> dict[Mounting, list[RadarScan]]:
    """Three scans of each of two sensors, which do not run in step."""
    return {
        CORNER: seen(rng, times=np.array([0.0, 0.06, 0.13])),
        REAR: seen(rng, times=np.array([0.02, 0.08, 0.15]), mounting=REAR),
    }


def two_pairs(seed=0, size=25, times=TIMES) -> list[ScanPair]:
    """A pair of noisy scans of each of two sensors."""
    rng = np.random.default_rng(seed)
    return [ScanPair(*seen(rng, mounting=m, size=size, times=times), m) for m in (CORNER, REAR)]


def pairs_of(scans) -> list[ScanPair]:
    """All baselines of all sensors: each middle scan is a previous and a current one."""
    return [
        ScanPair(own[i], own[j], mounting)
        for mounting, own in scans.items()
        for i, j in ((0, 1), (1, 2), (0, 2))
    ]


def estimated(pairs, **options):
    found = estimate_ego_motion(*zip(*pairs, strict=True), initial=THETA, **options)
    assert found.converged
    return found


def propagated(estimate, pairs, **options) -> np.ndarray:
    return propagate_ego_motion(estimate, *zip(*pairs, strict=True), **options)


def slope(function, step) -> np.ndarray:
    """Derivative of ``function`` at zero, by a step to either side."""
    return (function(step) - function(-step)) / (2.0 * step)


def ratios(actual, reported) -> np.ndarray:
    """Variances of ``actual`` where ``reported`` has 1, along their common axes, in rising order.

    Both covariances' strong correlations hide nothing: all are 1 only if the two are the same.
    """
    root = np.linalg.inv(np.linalg.cholesky(reported))
    return np.linalg.eigvalsh(root @ actual @ root.T)


def held_optimum(pair, errors, doppler_error, outlier, first_order) -> np.ndarray:
    """The velocity that registers ``pair`` with ``errors`` (2, 3, K), what it reports held.

    Covariances and the slope of the Doppler velocity are those of ``pair``; ``doppler_error`` (K,)
    is the error of the azimuths that the Doppler velocities are predicted at.
    """
    previous, current = (with_errors(scan, by) for scan, by in zip(pair, errors, strict=True))
    gain = doppler_gradients(pair[1].azimuth + doppler_error, CORNER)[0]
    turned = doppler_gradients(pair[1].azimuth, CORNER)[1]
    if isinstance(outlier, UniformOutlier):  # the outliers' Doppler density, 1 / 4 m/s
        outlier = UniformOutlier(outlier.density / 4.0)
    elif outlier is not None:  # the same ratio of the two weights
        alpha = outlier.fraction / (outlier.fraction + (1.0 - outlier.fraction) * 4.0)
        outlier = CorruptedGaussian(alpha, outlier.covariance)
    interval = current.time - previous.time
    twist = interval * THETA
    fixed, moving = (
        PointSet(seen.point_set(CORNER).means, held.point_set(CORNER).covariances)
        for seen, held in ((previous, pair[0]), (current, pair[1]))
    )
    measured = current.doppler, current.sigma_doppler, current.sigma_azimuth
    measurement = LinearMeasurement(*measured, gain / interval, turned / interval, not first_order)
    cost = RegistrationCost(outlier=outlier)
    start = twist if first_order else rigid.exponential(twist)
    found = register(fixed, moving, cost, start, measurement=measurement)
    assert found.converged
    return (found.theta if first_order else rigid.logarithm(found.theta)) / interval


def by_differences(optimum, pair, shared: bool) -> np.ndarray:
    """Covariance (3, 3) from one registration to either side for every input of both scans.

    ``optimum(errors, doppler_error)`` is the velocity.
    """
    total, step, shape = np.zeros((3, 3)), 1e-3, (2, 3, pair[0].size)
    for place in np.ndindex(shape):
        error = one_error(shape, *place, size=SIGMAS[place[1]])
        own = error[1, 1] * shared
        moved = slope(lambda by, e=error, own=own: optimum(by * e, by * own), step)
        total += np.outer(moved, moved)
    for target in range(0 if shared else pair[1].size):  # the prediction's azimuth errs alone
        error = one_error(pair[1].size, target, size=SIGMAS[1])
        moved = slope(lambda by, e=error: optimum(np.zeros(shape), by * e), step)
        total += np.outer(moved, moved)
    return total


@pytest.mark.parametrize("first_order", [False, True], ids=["exact", "first-order"])
def test_errors_propagate_as_differences_of_the_optimum(first_order):
    """Breaks if a derivative of the optimum is wrong in any range, azimuth or Doppler velocity.

    What is reported is held.  With a shared azimuth the scans are noisy, so that terms in the
    residuals count; the logarithms of the variances leave residuals where azimuths err apart.
    """
    for outlier, shared, tolerance in (
        (DEFAULT_OUTLIER, True, 2e-5),
        (UniformOutlier(1e-3), True, 2e-5),
        (None, True, 2e-5),
        (DEFAULT_OUTLIER, False, 1e-3),
    ):
        pair = seen(np.random.default_rng(3) if shared else None)
        options = {"outlier": outlier, "first_order": first_order}
        estimate = estimate_ego_motion(*pair, CORNER, initial=THETA, **options)
        covariance = propagate_ego_motion(estimate, *pair, CORNER, shared_azimuth=shared, **options)

        def optimum(errors, azimuth_error, pair=pair, options=options):
            return held_optimum(pair, errors, azimuth_error, **options)

        expected = by_differences(optimum, pair, shared)
        assert_allclose(ratios(covariance, expected), 1.0, atol=tolerance)
        if shared and outlier is DEFAULT_OUTLIER:
            mirrored = by_differences(lambda e, a, of=optimum: of(e, -a), pair, True)
            assert np.abs(ratios(covariance, mirrored) - 1.0).max() > 0.5


def test_estimates_scatter_as_the_shared_error_says():
    """Breaks if sharing has the wrong sign or size: 1500 noisy pairs at 12 m/s and 1 degree.

    With the sensor at the vehicle's origin the errors of v_y and omega are correlated by -0.55,
    which the cost knows nothing of.
    """
    theta, origin = np.array([12.0, 0.0, 0.3]), Mounting()
    rng = np.random.default_rng(0)
    scans = [seen(rng, theta, origin, size=30) for _ in range(1500)]
    options = {"initial": theta, "outlier": None}
    estimates = [estimate_ego_motion(*pair, origin, **options) for pair in scans]
    assert all(estimate.converged for estimate in estimates)
    actual = np.cov(np.array([estimate.theta for estimate in estimates]).T)
    some = list(zip(estimates, scans, strict=True))[:100]

    def correlation(covariance):
        return covariance[1, 2] / np.sqrt(covariance[1, 1] * covariance[2, 2])

    def stated(shared):
        given = {"outlier": None, "shared_azimuth": shared}
        each = [propagate_ego_motion(e, *pair, origin, **given) for e, pair in some]
        return correlation(np.mean(each, axis=0))

    assert_allclose(correlation(actual), -0.55, atol=0.04)
    assert_allclose(stated(True), correlation(actual), atol=0.05)
    assert abs(stated(False)) < 0.15


def test_where_an_azimuth_turns_no_doppler_velocity_there_is_nothing_to_share():
    """Breaks if the shared part does not vanish at a standstill, or without Doppler velocities."""
    for theta, doppler, tolerance in ((np.zeros(3), True, 1e-3), (THETA, False, 0.0)):
        pair = (*seen(theta=theta), CORNER)
        estimate = estimate_ego_motion(*pair, initial=theta, doppler=doppler)
        shared, apart = (
            propagate_ego_motion(estimate, *pair, doppler=doppler, shared_azimuth=by)
            for by in (True, False)
        )
        assert_allclose(ratios(shared, apart), 1.0, atol=tolerance + 1e-12)
        assert_allclose(ratios(shared, estimate.covariance), 1.0, atol=0.5)


def test_it_is_how_the_optimum_of_whole_scans_moves():
    """Breaks if a scan's uses in several pairs are squared one by one, or one of them is lost.

    All that is computed at a measured point moves with it here, which propagation leaves out; where
    nothing errs yet, that is little.
    """
    scans = several()
    total = np.zeros((3, 3))
    for sensor, index, coordinate, target in np.ndindex(2, 3, 3, 10):
        mounting = list(scans)[sensor]
        error = one_error((3, 10), coordinate, target, size=SIGMAS[coordinate])

        def optimum(by, mounting=mounting, index=index, error=error):
            own = list(scans[mounting])
            own[index] = with_errors(own[index], by * error)
            return estimated(pairs_of(scans | {mounting: own})).theta

        moved = slope(optimum, 1e-2)
        total += np.outer(moved, moved)
    pairs = pairs_of(scans)
    estimate = estimated(pairs)
    assert_allclose(ratios(propagated(estimate, pairs), total), 1.0, atol=0.03)
    # scans with other contents are other scans, of which each use is squared on its own
    apart = [
        ScanPair(*(with_errors(scan, 1e-12 * i) for scan in pair[:2]), pair.mounting)
        for i, pair in enumerate(pairs)
    ]
    assert np.abs(ratios(propagated(estimate, apart), total) - 1.0).max() > 0.2
    two_errors = propagated(estimate, pairs, shared_azimuth=False)
    assert np.abs(ratios(two_errors, total) - 1.0).max() > 0.2


def test_the_same_pair_twice_tells_nothing_new():
    """Breaks if what is used twice counts as two measurements, as the inverse Hessian takes it."""
    previous, current = seen(np.random.default_rng(3))
    pair = ScanPair(previous, current, CORNER)
    copy = ScanPair(with_errors(previous, 0.0), with_errors(current, 0.0), CORNER)
    once, twice = estimated([pair]), estimated([pair, copy])
    assert_allclose(2.0 * twice.covariance, once.covariance, rtol=1e-6)
    alone = propagate_ego_motion(once, *pair)
    assert_allclose(propagated(twice, [pair, copy]), alone, rtol=1e-6)
    assert_array_equal(propagated(once, [pair]), alone)


def test_more_scatter_of_the_positions_is_none_of_the_azimuth():
    """Breaks if the share is taken from the positions' covariances, not the azimuth's sigma."""
    pairs = pairs_of(several(np.random.default_rng(4)))
    problem = problem_of(pairs, EgoMotionModel())
    found = influences(problem, problem.bind(estimated(pairs).theta), pairs)
    extended = found._replace(covariances=found.covariances + 0.09 * np.eye(2))
    more = np.einsum("kid,kjd->ij", found.position, found.position)
    noise = np.zeros((2, 3, 3))
    for total, each in zip(noise, (found, extended), strict=True):
        add_noise(each, True, total)
    assert_allclose(noise[1], noise[0] + 0.09 * more, rtol=1e-9)
    scans = [(pair.previous, pair.mounting) for pair in pairs]
    scans += [(pair.current, pair.mounting) for pair in pairs]
    stated = np.concatenate([scan.point_set(mounting).covariances for scan, mounting in scans])
    assert_array_equal(found.covariances, stated)


def test_what_is_no_optimum_gives_nothing_and_several_are_refused():
    """Breaks if a covariance is made up where there is no optimum, or of several velocities."""
    pair = (*seen(), CORNER)
    estimate = estimate_ego_motion(*pair, initial=THETA)
    lost = replace(estimate, converged=np.bool_(False), covariance=np.full((3, 3), np.nan))
    assert np.isnan(propagate_ego_motion(lost, *pair)).all()
    three = replace(
        estimate,
        theta=np.tile(estimate.theta, (3, 1)),
        covariance=np.tile(estimate.covariance, (3, 1, 1)),
    )
    with pytest.raises(ValueError, match=r"^estimate\.theta must have the shape \(3,\), but has"):
        propagate_ego_motion(three, *pair)


@pytest.mark.parametrize(
    "options", [{"doppler": False}, {"side_slip": False}, {"first_order": True}]
)
def test_an_estimate_with_other_options_is_refused(options):
    """Breaks if options that were forgotten give the covariance of another estimate."""
    pair = seen(np.random.default_rng(2), size=30)
    estimate = estimate_ego_motion(*pair, CORNER, initial=THETA, **options)
    assert np.isfinite(propagate_ego_motion(estimate, *pair, CORNER, **options)).all()
    for mounting, others in ((CORNER, {}), (Mounting(3.6), options)):
        with pytest.raises(ValueError, match=r"^estimate must be of the same sets or scans, cost"):
            propagate_ego_motion(estimate, *pair, mounting, **others)


NOTHING = ErrorBudget()


def applied(pairs, budget: ErrorBudget):
    """What a budget says of the velocity by two sensors."""
    estimate, time = estimated(pairs), pairs[0].current.time
    problem = problem_of(pairs, EgoMotionModel())
    return apply_budget(problem, estimate, pairs, budget, time, estimate.theta)


def moved_by(change, pairs, budget=NOTHING) -> np.ndarray:
    """Derivative (3,) of the joint velocity when ``change(pair, step)`` changes pairs of scans."""

    def velocity(by):
        changed = [change(pair, by) for pair in pairs]
        return estimated(changed).theta + applied(changed, budget).step

    return slope(velocity, 1e-5)


def turned(pair, by):
    """Azimuths of both scans with a bias."""
    both = (replace(scan, azimuth=scan.azimuth + by) for scan in pair[:2])
    return ScanPair(*both, pair.mounting)


def shifted(pair, by):
    """Doppler velocities of the current scan with an error in common."""
    return pair._replace(current=replace(pair.current, doppler=pair.current.doppler + by))


def scaled(pair, by):
    """Doppler velocities of the current scan with an error in proportion."""
    return shifted(pair, by * pair.current.doppler)


def test_a_budget_is_how_shared_errors_move_the_estimate():
    """Breaks if an error is shared by too few or too many scans or sensors, or weighed wrongly.

    Covariances and gains depend a little on the azimuths, which propagation holds.
    """
    pairs, each, all_of_them = two_pairs(), ((CORNER,), (REAR,)), ((CORNER, REAR),)
    nothing = applied(pairs, NOTHING)
    assert_allclose(nothing.white, propagated(estimated(pairs), pairs), rtol=1e-10)
    assert_array_equal(nothing.slow, 0.0)
    for change, groups, budget, sigma, rtol in (
        (turned, each, ErrorBudget(azimuth=0.01), 0.01, 0.05),
        (shifted, each, ErrorBudget(doppler=1e-6), 1e-6, 1e-4),
        (shifted, each, ErrorBudget(doppler=0.03), 0.03, 0.01),  # also weights depend on residuals
        (scaled, all_of_them, ErrorBudget(scale=0.002), 0.002, 1e-4),
    ):
        expected = np.zeros((3, 3))
        for sensors in groups:

            def of_sensors(pair, by, change=change, sensors=sensors):
                return change(pair, by) if pair.mounting in sensors else pair

            moved = moved_by(of_sensors, pairs, budget)
            expected += sigma**2 * np.outer(moved, moved)
        slow = applied(pairs, budget).slow
        found = slow @ slow.T
        assert_allclose(np.diag(found), np.diag(expected), rtol=rtol)
        assert_allclose(found, expected, rtol=rtol, atol=rtol * np.abs(expected).max())


def test_an_error_of_the_budget_moves_the_yaw_rate_less():
    """Breaks if Doppler velocities that share an error keep all their weight."""
    pairs = two_pairs()
    for change, budget in (
        (turned, ErrorBudget(azimuth=0.01)),
        (shifted, ErrorBudget(doppler=0.2)),
    ):

        def of_one(pair, by, change=change):
            return change(pair, by) if pair.mounting == REAR else pair

        assert abs(moved_by(of_one, pairs, budget)[2]) < 0.97 * abs(moved_by(of_one, pairs)[2])


def test_neighbours_share_what_their_distance_says():
    """Breaks if the dependence is not the double sum over pairs of targets of one scan."""
    found = []
    for length, pairs in ((2.0, two_pairs()), (200.0, two_pairs(3, 10))):
        expected = np.zeros((3, 3))
        estimate = estimated(pairs)
        problem = problem_of(pairs, EgoMotionModel())
        each = influences(problem, problem.bind(estimate.theta), pairs)
        scans = [pair.previous for pair in pairs] + [pair.current for pair in pairs]
        for i, (scan, pair) in enumerate(zip(scans, [*pairs, *pairs], strict=True)):
            own, means = slice(*each.edges[i : i + 2]), scan.point_set(pair.mounting).means
            position = estimate.covariance @ each.position[own]
            rooted = position @ np.array([sqrtm(cov) for cov in each.covariances[own]])
            apart = np.linalg.norm(means[:, None] - means, axis=-1)
            alike = np.where(apart < 5.0 * length, np.exp(-apart / length), 0.0)
            np.fill_diagonal(alike, 0.0)
            expected += np.einsum("kl,kid,ljd->ij", alike, rooted, rooted)
        alone, shared = (applied(pairs, ErrorBudget(neighbours=n)).white for n in (0.0, length))
        found.append(shared - alone)
        assert_allclose(found[-1], expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    assert found[0][1, 1] > 0.0 > found[1][1, 1]


def test_the_delay_is_how_far_an_accelerating_vehicle_is_ahead():
    """Breaks if an estimate is not carried from the middle of the interval to its time, or if a
    bend does not count, in which the mean velocity of an interval is not quite that in the middle.
    """
    interval, acceleration = 0.2, np.array([2.0, -0.4, 0.5])
    pairs = two_pairs(times=(0.0, interval))
    delay = applied(pairs, ErrorBudget()).delay
    pose, steps = np.eye(3), 2000
    for i in range(steps):
        late = ((i + 0.5) / steps - 0.5) * interval
        pose = pose @ arc(THETA + late * acceleration, interval / steps)
    twist = logm(pose) / interval
    mean = np.array([twist[0, 2], twist[1, 2], twist[1, 0]]) - THETA
    gained = 0.5 * interval * acceleration - mean

    def faster(pair, by):
        """Doppler velocities of a vehicle that is faster at the later scan than on average."""
        gain, _ = doppler_gradients(pair.current.azimuth, pair.mounting)
        return shifted(pair, by * gain @ gained)

    moved = moved_by(faster, pairs)
    assert_allclose(moved - delay @ acceleration, gained, rtol=1e-2, atol=5e-4)


def test_the_lead_is_how_far_a_known_acceleration_moves_the_estimate():
    """Breaks if what is taken off positions or Doppler velocities is not what is added again."""
    first, (*scans, rear) = two_pairs()
    later = (replace(scan, time=scan.time + 0.2) for scan in scans)
    pairs, acceleration = [first, ScanPair(*later, rear)], np.array([0.4, -0.2, 0.05])
    for model in (EgoMotionModel(), EgoMotionModel(doppler=False)):
        found = estimate_velocity(problem_of(pairs, model), THETA, (1.0,))
        start = found.theta
        told = problem_of(pairs, model), found, pairs, NOTHING, pairs[0].current.time, start

        def velocity(by, model=model, start=start):
            problem = problem_of(pairs, model, by * acceleration, start)
            return estimate_velocity(problem, start, (1.0,)).theta

        moved = slope(velocity, 1e-3)
        assert np.abs(moved).max() > 0.01
        assert_allclose(moved, apply_budget(*told).lead @ acceleration, rtol=0.02, atol=1e-3)


def test_large_scans_of_several_sizes_are_apart(monkeypatch):
    """Breaks if what a pair of larger scans leaves in memory counts for a smaller one."""

    def stated():
        mountings = CORNER, replace(CORNER, y=-CORNER.y)
        scans = [seen(mounting=m, size=n) for m, n in zip(mountings, (400, 200), strict=True)]
        for pair in scans:  # every third target moves on its own
            moves = 3.0 * (np.arange(pair[1].size) % 3 == 0)
            pair[1] = replace(pair[1], doppler=pair[1].doppler + moves)
        given = *zip(*scans, strict=True), mountings
        estimate = estimate_ego_motion(*given, initial=THETA)
        return propagate_ego_motion(estimate, *given)

    large = stated()
    monkeypatch.setattr("d2d.point_set._TILED", 10**9)
    plain = stated()
    size = np.sqrt(np.diag(plain))
    assert (np.abs(large - plain) <= 1e-6 * np.outer(size, size)).all()
