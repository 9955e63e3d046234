"""Error budgets: each term against re-estimation, their parts, and what they do to a track."""

import pickle
from dataclasses import fields, replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import sqrtm

from d2d import rigid
from d2d.radar import (
    EgoMotionModel,
    ErrorBudget,
    Mounting,
    RadarScan,
    VehicleLimits,
    doppler_velocity,
    estimate_joint_ego_motion,
    propagate_joint_ego_motion,
    simulate_drive,
    track,
    track_joint,
)
from d2d.radar.motion.covariance import apply_budget
from d2d.radar.motion.pairs import scan_pair
from d2d.radar.tracks.carry import accelerations
from d2d.radar.tracks.joint import joint_pairs
from d2d.radar.tracks.limits import State

MOUNTINGS = Mounting(3.6, 0.8, 0.6), Mounting(3.4, -0.8, -0.7)
THETA = np.array([8.0, 0.1, 0.2])
SIGMAS = 0.1, 0.005, 0.05
INTERVAL = 0.1


def scan_at(time: float, mounting: Mounting, points: np.ndarray, rng) -> RadarScan:
    """Points in the world (n, 2) as the sensor of a vehicle that began at the origin sees them."""
    pose = rigid.exponential(THETA * time)
    seen = rigid.transform_means(rigid.inverse(pose), points) - [mounting.x, mounting.y]
    azimuth = np.arctan2(seen[:, 1], seen[:, 0]) - mounting.yaw
    doppler = doppler_velocity(THETA, azimuth, mounting)
    noise = rng.standard_normal((3, len(points))) * np.array(SIGMAS)[:, None]
    return RadarScan(
        time, np.hypot(*seen.T) + noise[0], azimuth + noise[1], doppler + noise[2], *SIGMAS
    )


def sensors(seed: int = 0, scans: int = 2) -> list[tuple[list[RadarScan], Mounting]]:
    """Two sensors on a turning vehicle."""
    rng = np.random.default_rng(seed)
    made = []
    for mounting in MOUNTINGS:
        angle = rng.uniform(-0.8, 0.8, 25) + mounting.yaw
        distance = rng.uniform(8.0, 40.0, 25)
        points = np.stack([distance * np.cos(angle), distance * np.sin(angle)], axis=-1)
        times = INTERVAL * np.arange(scans)
        made.append(([scan_at(t, mounting, points, rng) for t in times], mounting))
    return made


SPEEDING = 4.0  # m/s^2


def speeding(time: float, rng) -> RadarScan:
    """Points as the first sensor of a vehicle sees them that speeds up from 5 m/s."""
    mounting = MOUNTINGS[0]
    ahead = 5.0 * time + 0.5 * SPEEDING * time**2
    grid = np.stack(np.meshgrid([8.0, 15.0, 23.0, 34.0], [-5.0, 2.0, 7.0, 13.0]), axis=-1)
    seen = grid.reshape(-1, 2) + np.sin(np.arange(32.0)).reshape(-1, 2) - [ahead, 0.0]
    seen -= [mounting.x, mounting.y]
    azimuth = np.arctan2(seen[:, 1], seen[:, 0]) - mounting.yaw
    doppler = doppler_velocity([5.0 + SPEEDING * time, 0.0, 0.0], azimuth, mounting)
    noise = rng.standard_normal((3, len(seen))) * 0.1 * np.array(SIGMAS)[:, None]
    return RadarScan(
        time, np.hypot(*seen.T) + noise[0], azimuth + noise[1], doppler + noise[2], *SIGMAS
    )


def applied(budget: ErrorBudget, drives=None, time: float = INTERVAL):
    """Estimate, parts and delay of the last round of two sensors."""
    drives = sensors() if drives is None else drives
    pairs = joint_pairs(drives, [(s, len(scans) - 1) for s, (scans, _) in enumerate(drives)])
    model = EgoMotionModel()
    problem = model.problem([scan_pair(*pair, model) for pair in pairs])
    estimate = estimate_joint_ego_motion(pairs, initial=THETA)
    assert estimate.converged
    return pairs, estimate, *apply_budget(problem, estimate, pairs, budget, time)


def moved_by(change, pairs) -> np.ndarray:
    """Derivative (3,) of the joint estimate when ``change(pair, step)`` changes pairs of scans."""
    step = 1e-5
    found = [
        estimate_joint_ego_motion([change(pair, by) for pair in pairs], initial=THETA).theta
        for by in (step, -step)
    ]
    return (found[0] - found[1]) / (2.0 * step)


def altered(scan: RadarScan, **changed) -> RadarScan:
    values = {field.name: getattr(scan, field.name) for field in fields(scan)}
    return RadarScan(**(values | changed))


def test_the_noise_is_the_propagated_covariance():
    """Breaks if the compiled sum differs from that over the influences in NumPy."""
    pairs, estimate, parts, _ = applied(ErrorBudget())
    assert_allclose(parts.noise, propagate_joint_ego_motion(estimate, pairs), rtol=1e-10)
    assert_array_equal(parts.dependence, 0.0)
    assert_array_equal(parts.systematic, 0.0)
    assert_allclose(parts.noise, parts.noise.T, rtol=1e-12)


def test_an_azimuth_bias_moves_the_estimate_as_the_budget_says():
    """Breaks if a sensor's bias is not that of both its scans, or sensors are not independent."""
    pairs, _, parts, _ = applied(ErrorBudget(azimuth=0.01))
    expected = np.zeros((3, 3))
    for mounting in MOUNTINGS:

        def change(pair, by, mounting=mounting):
            if pair[2] != mounting:
                return pair
            return (*(altered(scan, azimuth=scan.azimuth + by) for scan in pair[:2]), mounting)

        moved = moved_by(change, pairs)
        expected += 0.01**2 * np.outer(moved, moved)
    # covariances and gains depend a little on the azimuths, which propagation holds
    assert_allclose(np.diag(parts.systematic), np.diag(expected), rtol=0.05)


def test_a_doppler_error_moves_the_estimate_as_the_budget_says():
    """Breaks if it is not shared by the targets of one scan, or is shared by both sensors."""
    pairs, _, parts, _ = applied(ErrorBudget(doppler=0.03))
    expected = np.zeros((3, 3))
    for mounting in MOUNTINGS:

        def change(pair, by, mounting=mounting):
            if pair[2] != mounting:
                return pair
            return pair[0], altered(pair[1], doppler=pair[1].doppler + by), mounting

        moved = moved_by(change, pairs)
        expected += 0.03**2 * np.outer(moved, moved)
    assert_allclose(parts.systematic, expected, rtol=1e-4, atol=1e-9)


def test_a_scale_error_is_shared_by_all_sensors():
    """Breaks if each sensor has a scale of its own, or a target's own speed is not its weight."""
    pairs, _, parts, _ = applied(ErrorBudget(scale=0.002))

    def change(pair, by):
        return pair[0], altered(pair[1], doppler=(1.0 + by) * pair[1].doppler), pair[2]

    moved = moved_by(change, pairs)
    assert_allclose(parts.systematic, 0.002**2 * np.outer(moved, moved), rtol=1e-4, atol=1e-9)


def test_neighbours_share_what_their_distance_says():
    """Breaks if the dependence is not the double sum over pairs of targets of one scan."""
    length = 2.0
    pairs, estimate, parts, _ = applied(ErrorBudget(neighbours=length))
    model = EgoMotionModel()
    problem = model.problem([scan_pair(*pair, model) for pair in pairs])
    cross = problem.cross_derivatives(problem.bind(estimate.theta), 0, 1)
    expected, fixed, moving = np.zeros((3, 3)), 0, 0
    for pair in problem.pairs:
        for points, block in (
            (pair.fixed, cross.fixed[0, fixed : fixed + pair.fixed.size]),
            (pair.moving, cross.moving[0, moving : moving + pair.moving.size]),
        ):
            rooted = block @ np.array([sqrtm(covariance) for covariance in points.covariances])
            apart = np.linalg.norm(points.means[:, None] - points.means, axis=-1)
            alike = np.where(apart < 5.0 * length, np.exp(-apart / length), 0.0)
            np.fill_diagonal(alike, 0.0)
            expected += np.einsum("kl,kid,ljd->ij", alike, rooted, rooted)
        fixed, moving = fixed + pair.fixed.size, moving + pair.moving.size
    gain = estimate.covariance
    assert_allclose(parts.dependence, gain @ expected @ gain, rtol=1e-9)


def test_no_part_depends_on_the_axes_of_the_vehicle_frame():
    """Breaks if the errors of neighbours correlate along x and y more than along other axes."""
    angle = 0.7
    turn = np.eye(3)
    turn[:2, :2] = rigid.rotation(-angle)
    budget = ErrorBudget(azimuth=0.002, doppler=0.03, scale=0.002, neighbours=2.0)
    drive = simulate_drive(np.random.default_rng(8), duration=1.0)
    place = Mounting(3.6, 0.7, 0.4)
    x, y = turn[:2, :2] @ [place.x, place.y]
    found, turned = (
        track(drive.scans, mounting, budget=budget, limits=None)
        for mounting in (place, Mounting(x, y, place.yaw - angle))
    )
    assert found.converged.all()
    assert_allclose(turned.theta, found.theta @ turn.T, atol=1e-6)
    for own, other in zip(found.parts, turned.parts, strict=True):
        size = np.abs(own).max()
        assert_allclose(other, turn @ own @ turn.T, rtol=0, atol=1e-5 * size)


def test_the_delay_is_how_far_an_accelerating_vehicle_is_ahead():
    """Breaks if an estimate is not carried from the middle of the interval to its time."""
    drives = sensors()
    pairs, _, _, delay = applied(ErrorBudget(), drives)
    acceleration = np.array([2.0, 0.0, 0.5])

    def change(pair, by):
        """Doppler velocities of a vehicle that moves faster at the later scan than on average."""
        previous, current, mounting = pair
        angle = current.azimuth + mounting.yaw
        extra = 0.5 * INTERVAL * acceleration * by
        along = extra[0] - extra[2] * mounting.y, extra[1] + extra[2] * mounting.x
        change = -along[0] * np.cos(angle) - along[1] * np.sin(angle)
        return previous, altered(current, doppler=current.doppler + change), mounting

    # the mean velocity of the interval stays, so that its end is half an interval's gain ahead
    moved = moved_by(change, pairs)
    true = 0.5 * INTERVAL * acceleration
    assert_allclose(moved - delay @ acceleration, true, rtol=1e-3, atol=1e-6)


def test_accelerations_are_slopes_of_half_a_second_to_either_side():
    """Breaks if the window or the least squares differ from a fit at each time."""
    rng = np.random.default_rng(0)
    times = 1.6e9 + np.sort(rng.uniform(0.0, 6.0, 60))
    theta = rng.standard_normal((60, 3))
    found = accelerations(times, theta)
    for i, t in enumerate(times):
        near = np.abs(times - t) <= 0.5
        expected = np.polyfit(times[near] - t, theta[near], 1)[0] if near.sum() > 1 else 0.0
        assert_allclose(found[i], expected, rtol=1e-4, atol=1e-4)
    assert_array_equal(accelerations(np.array([1.0, 9.0]), np.ones((2, 3))), 0.0)
    assert accelerations(np.empty(0), np.empty((0, 3))).shape == (0, 3)


@pytest.mark.parametrize("origin", [0.0, 0.3, 1.6e9 + 0.7])
def test_the_origin_of_the_clock_does_not_decide_on_accelerations(origin):
    """Breaks if rounding decides whether estimates exactly half a second away count."""
    times = np.arange(40) * 0.1
    theta = np.random.default_rng(1).standard_normal((40, 3))
    expected = accelerations(times, theta)
    assert_allclose(accelerations(origin + times, theta), expected, rtol=1e-4, atol=1e-5)


def test_a_long_drive_at_constant_velocity_shows_no_acceleration():
    """Breaks if sums along the drive lose the digits that the slope of a few estimates needs."""
    rng = np.random.default_rng(1)
    times = np.cumsum(rng.uniform(0.2, 0.8, 40000))  # five and a half hours, many alone
    velocity = np.tile([30.0, 0.1, 0.02], (len(times), 1))
    assert_array_equal(accelerations(times, velocity), 0.0)


@pytest.mark.parametrize("missing", [[0, 1, 2], [8, 9, 10, 11]], ids=["at-first", "between"])
def test_a_failure_shows_no_acceleration(missing):
    """Breaks if the zero before the first estimate, or a held velocity, counts as driven."""
    empty = {i + 1 for i in missing}
    quick = ErrorBudget(lag=0.1)
    rng = np.random.default_rng(2)
    scans = [
        RadarScan(t, *np.empty((3, 0)), *SIGMAS) if i in empty else speeding(t, rng)
        for i, t in enumerate(0.1 * np.arange(20))
    ]
    found = track(scans, MOUNTINGS[0], budget=quick)
    good = found.converged
    assert good.any()
    assert not good.all()
    expected = (0.1 * SPEEDING) ** 2
    assert_allclose(found.parts.systematic[good, 0, 0], expected, rtol=0.3)
    for i in np.flatnonzero(~good):
        before = np.flatnonzero(good[:i])
        assert_array_equal(found.theta[i], found.theta[before[-1]] if before.size else 0.0)


def test_a_track_contains_its_budget():
    """Breaks if the covariance is not the sum of the parts, or the lag is not in it."""
    drive = simulate_drive(np.random.default_rng(1), duration=3.0)
    plain = track(drive.scans, drive.mounting)
    budget = ErrorBudget(azimuth=0.002, doppler=0.02, scale=0.001, neighbours=1.0)
    found = track(drive.scans, drive.mounting, budget=budget)
    assert plain.parts is None
    assert found.parts is not None
    assert_array_equal(found.covariance, found.parts.total)
    assert_array_equal(found.converged, plain.converged)
    assert_array_equal(found.reasons, "")
    assert_array_equal(found.targets, [scan.size for scan in drive.scans[1:]])
    assert ((found.inliers > 0.1) & (found.inliers <= 1.0)).all()
    late = track(drive.scans, drive.mounting, budget=replace(budget, lag=0.1))
    moved = 0.1 * accelerations(found.times, found.theta)
    assert_allclose(
        late.parts.systematic - found.parts.systematic,
        moved[:, :, None] * moved[:, None, :],
        atol=1e-12,
    )
    for each in (found.covariance, *found.parts):  # else a table of the upper triangle differs
        assert_array_equal(each, np.swapaxes(each, 1, 2))
    joint = track_joint([(drive.scans, drive.mounting)], budget=budget)
    assert_allclose(joint.covariance, found.covariance, rtol=1e-9)
    assert_allclose(joint.theta, found.theta, rtol=1e-9)


def test_failures_have_no_parts_and_a_reason():
    """Breaks if a failed estimate keeps a covariance, or nobody learns why it failed."""
    drive = simulate_drive(np.random.default_rng(1), duration=1.0)
    scans = [*drive.scans[:5], drive.scans[5][:0], *drive.scans[6:]]
    found = track(scans, drive.mounting, budget=ErrorBudget(azimuth=0.01))
    assert list(np.flatnonzero(~found.converged)) == [4, 5]
    assert set(found.reasons[4:6]) == {"a scan without targets"}
    assert np.isnan(found.covariance[4:6]).all()
    assert np.isnan(found.parts.systematic[4:6]).all()
    assert np.isnan(found.inliers[4:6]).all()


@pytest.mark.filterwarnings("ignore:overflow:RuntimeWarning")
def test_a_covariance_that_overflows_is_no_estimate():
    """Breaks if nan, which exceeds no limit, passes for plausible."""
    drive = simulate_drive(np.random.default_rng(1), duration=0.3)
    scans = [
        altered(scan, sigma_doppler=np.append(scan.sigma_doppler[1:], 1e160))
        for scan in drive.scans
    ]
    for limits in (None, VehicleLimits()):
        found = track(scans, drive.mounting, budget=ErrorBudget(), limits=limits)
        assert set(found.reasons) == {"a covariance that is not finite"}
        assert np.isnan(found.covariance).all()


@pytest.mark.parametrize("name", ["azimuth", "doppler", "scale", "lag", "neighbours"])
@pytest.mark.parametrize("value", [-0.1, np.nan, np.inf, 1e150, "a", [0.1, 0.2]])
def test_a_budget_of_no_standard_deviation_is_refused(name, value):
    """Breaks if a budget makes covariances nan or smaller."""
    with pytest.raises(ValueError, match=f"^{name} must"):
        ErrorBudget(**{name: value})


def test_a_budget_is_plain_data():
    """Breaks if a budget cannot be compared, hashed, or kept in a file."""
    budget = ErrorBudget(azimuth=0.001, source="data sheet")
    assert pickle.loads(pickle.dumps(budget)) == budget
    assert len({budget, ErrorBudget(azimuth=0.001, source="data sheet")}) == 1
    with pytest.raises(ValueError, match=r"^source must be a str"):
        ErrorBudget(source=3)


@pytest.mark.parametrize("name", ["budget", "limits"])
def test_what_is_no_budget_or_limit_is_named(name):
    """Breaks if the user gets Python's words about attributes after the drive is done."""
    drive = simulate_drive(np.random.default_rng(1), duration=0.2)
    for call in (
        lambda: track(drive.scans, drive.mounting, **{name: 0.1}),
        lambda: track_joint([(drive.scans, drive.mounting)], **{name: 0.1}),
    ):
        with pytest.raises(ValueError, match=f"^{name} must be a"):
            call()


def test_estimates_that_no_vehicle_follows_are_not_accepted():
    """Breaks if a limit is not applied, or the reason does not say which."""
    drive = simulate_drive(np.random.default_rng(2), duration=3.0)
    found = track(drive.scans, drive.mounting, limits=VehicleLimits(speed=0.5))
    refused = [text for text in found.reasons if text]
    assert refused
    assert all(text.startswith("a speed of") for text in refused)
    free = track(drive.scans, drive.mounting, limits=None)
    assert free.converged.all()
    assert_array_equal(free.theta, track(drive.scans, drive.mounting).theta)


@pytest.mark.parametrize(
    ("theta", "sigma", "reason"),
    [
        ([20.0, 0.0, 0.1], 0.1, ""),
        ([101.0, 0.0, 0.0], 0.1, "a speed of 101.0 m/s"),
        ([101.0, 0.0, 0.0], 1.0, "an acceleration of 810.0 m/s^2 along x"),
        ([20.0, 0.0, -3.5], 0.1, "a yaw rate of 200.5 deg/s"),
        ([26.0, 0.0, 0.0], 0.1, "an acceleration of 60.0 m/s^2 along x"),
        ([26.0, 0.0, 0.0], 0.8, ""),
        ([20.0, 0.0, 1.2], 0.1, "a yaw acceleration of 12.0 rad/s^2"),
    ],
)
def test_limits_count_beyond_three_standard_deviations(theta, sigma, reason):
    """Breaks if a limit is compared with another quantity, or without the uncertainty of both."""
    last = State(1.0, np.array([20.0, 0.0, 0.0]), 0.1**2 * np.eye(3))
    state = State(1.1, np.array(theta), sigma**2 * np.eye(3))
    assert VehicleLimits(uncertainty=np.inf).exceeded(state, last) == reason


def test_a_side_slip_counts_where_it_may_be_a_yaw_rate():
    """Breaks if a slip that is measured is refused, or one that is not is accepted."""
    theta = np.array([20.0, 1.1, -0.3])
    apart = np.diag([0.1, 0.3, 0.1]) ** 2
    torn = apart.copy()
    torn[1, 2] = torn[2, 1] = -0.95 * 0.3 * 0.1
    assert VehicleLimits().exceeded(State(0.0, theta, apart), None) == ""
    assert VehicleLimits().exceeded(State(0.0, theta, torn), None) == "a side slip of 1.10 m/s"
    assert State(0.0, theta, torn).yaw_rate_of_slip == pytest.approx(-0.95 * 0.1 / 0.3 * 1.1)
    assert VehicleLimits(slip=0.4).exceeded(State(0.0, theta, torn), None) == ""
    assert VehicleLimits().for_doppler(False).exceeded(State(0.0, theta, torn), None) == ""
    vague = State(0.0, np.array([20.0, 0.0, 0.0]), np.diag([0.1, 0.1, 0.2]) ** 2)
    assert VehicleLimits().exceeded(vague, None) == "a yaw rate with a sigma of 11.5 deg/s"


def test_a_jump_is_refused_until_the_vehicle_could_have_made_it():
    """Breaks if a wrong estimate starts the next ones, or a track never recovers."""
    limits = VehicleLimits(acceleration=5.0, yaw_acceleration=1.0)
    drive = simulate_drive(np.random.default_rng(2), duration=4.0)
    scans = list(drive.scans)
    # one scan of a vehicle that is 6 m/s faster
    angle = scans[20].azimuth + drive.mounting.yaw
    scans[20] = altered(scans[20], doppler=scans[20].doppler - 6.0 * np.cos(angle))
    found = track(scans, drive.mounting, limits=limits)
    assert found.reasons[19].startswith(("an acceleration", "an optimum", "no optimum"))
    assert found.converged[22:].all()


@pytest.mark.parametrize("name", [field.name for field in fields(VehicleLimits)])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, "fast"])
def test_a_limit_is_a_positive_number(name, value):
    """Breaks if a limit that is no limit accepts or refuses everything."""
    with pytest.raises(ValueError, match=f"^{name} must"):
        VehicleLimits(**{name: value})
    assert getattr(VehicleLimits(**{name: np.inf}), name) == np.inf


@pytest.mark.parametrize("slips", [False, 0.05])
def test_what_is_known_of_the_side_slip_is_a_prior(slips):
    """Breaks if the prior is not in the cost, in its optimum or in both covariances."""
    drives = sensors()
    pairs = joint_pairs(drives, [(0, 1)])
    sigma = slips or 1e-3
    free = estimate_joint_ego_motion(pairs, initial=THETA)
    bound = estimate_joint_ego_motion(pairs, initial=THETA, slips=slips)
    model = EgoMotionModel()
    problem = model.problem([scan_pair(*pair, model) for pair in pairs])
    value, gradient, hessian = problem.derivatives(problem.bind(bound.theta))
    precision = np.diag([0.0, sigma**-2, 0.0])
    assert_allclose(bound.value, value[0] + 0.5 * bound.theta @ precision @ bound.theta)
    assert_allclose(gradient[0] + precision @ bound.theta, 0.0, atol=1e-5 * sigma**-2)
    assert_allclose(np.linalg.inv(bound.covariance), hessian[0] + precision, rtol=1e-6, atol=1e-3)
    assert abs(bound.theta[1]) < abs(free.theta[1])
    assert bound.covariance[2, 2] < 0.7 * free.covariance[2, 2]
    propagated = propagate_joint_ego_motion(bound, pairs, slips=slips)
    assert propagated[1, 1] == pytest.approx(bound.covariance[1, 1], rel=0.3)


@pytest.mark.parametrize("slips", [0.0, -0.1, np.nan, "no", [0.1, 0.2]])
def test_a_side_slip_is_a_flag_or_a_standard_deviation(slips):
    """Breaks if a prior without a width makes the cost nan."""
    with pytest.raises(ValueError, match=r"^slips must"):
        EgoMotionModel(slips=slips)


def test_a_prior_cannot_be_edited():
    """Breaks if what a caller does to the array changes later problems of the same model."""
    model = EgoMotionModel(slips=0.1)
    model.prior[1] = 0.0
    assert model.prior[1] == pytest.approx(100.0)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("converged", lambda found: found.converged.astype(int)),
        ("intervals", lambda found: -found.intervals),
        ("intervals", lambda found: np.nan * found.intervals),
    ],
)
def test_a_track_is_made_of_what_it_says(name, change):
    """Breaks if integers choose rows where a mask is meant, or a path is driven backwards."""
    drive = simulate_drive(np.random.default_rng(1), duration=0.5)
    found = track(drive.scans, drive.mounting)
    with pytest.raises(ValueError, match=f"^{name} must be"):
        replace(found, **{name: change(found)})
