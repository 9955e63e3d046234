"""RadarScan, Mounting and the Doppler model, and scans from positions and velocity vectors.

Positions are checked against complex numbers, Doppler velocities against the range of a static
point seen from a sensor that really moves, covariances against draws.
"""

import cmath
import pydoc
from contextlib import suppress
from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d.radar import ErrorBudget, Mounting, RadarScan, doppler_velocity, quantisation_sigma
from d2d.radar.scans.scan import doppler_gradients, unfolded
from tests.radar.scenes import AROUND, CORNER, arc, frame
from tests.strategies import central_difference

MOUNTINGS = (Mounting(), CORNER, AROUND[2])
ARGUMENTS = ("range", "azimuth", "doppler", "sigma_range", "sigma_azimuth", "sigma_doppler")


def random_scan(size: int = 7, seed: int = 0, time: float = 1.5) -> RadarScan:
    """Targets all around, each with standard deviations of its own."""
    rng = np.random.default_rng(seed)
    return RadarScan(
        time,
        rng.uniform(1.0, 60.0, size),
        rng.uniform(-np.pi, np.pi, size),
        rng.uniform(-30.0, 30.0, size),
        rng.uniform(0.05, 0.5, size),
        rng.uniform(0.002, 0.05, size),
        rng.uniform(0.02, 0.2, size),
    )


def good_arguments() -> dict[str, object]:
    """Of a scan of three targets."""
    return {
        "time": 0.0,
        "range": [5.0, 6.0, 7.0],
        "azimuth": [0.1, 0.2, 0.3],
        "doppler": [-1.0, 0.0, 1.0],
        "sigma_range": 0.15,
        "sigma_azimuth": [0.01, 0.02, 0.03],
        "sigma_doppler": [0.06],
    }


def vehicle_position(distance: float, azimuth: float, mounting: Mounting) -> complex:
    """Of a target, as a complex number in the vehicle frame."""
    return complex(mounting.x, mounting.y) + distance * cmath.exp(1j * (azimuth + mounting.yaw))


def test_point_set_is_polar_measurements_with_first_order_covariances():
    """Breaks if the columns of the Jacobian or the variances change places, or the mounting does
    not turn the covariances."""
    scan = random_scan()
    for mounting, k in product(MOUNTINGS, range(scan.size)):

        def place(polar, mounting=mounting):
            z = vehicle_position(*polar, mounting)
            return np.array([z.real, z.imag])

        points = scan.point_set(mounting)
        measured = np.array([scan.range[k], scan.azimuth[k]])
        jacobian = central_difference(place, measured, np.array([1e-3, 1e-3]))
        variances = np.diag([scan.sigma_range[k] ** 2, scan.sigma_azimuth[k] ** 2])
        expected = jacobian @ variances @ jacobian.T
        assert_allclose(points.means[k], place(measured), rtol=0, atol=1e-12)
        assert_allclose(points.covariances[k], expected, rtol=1e-9, atol=1e-12)
        assert_array_equal(points.weights, np.full(scan.size, 1.0 / scan.size))


def test_doppler_is_the_range_rate_of_a_static_point():
    """Breaks with any wrong sign or lever arm: the vehicle moves on the exact SE(2) arc."""
    start = frame(Mounting(-40.0, 7.0, 1.1))
    points = np.column_stack([np.random.default_rng(3).uniform(-80.0, 80.0, (9, 2)), np.ones(9)])
    straight, on_the_spot, slipping_bend = [20.0, 0.0, 0.0], [0.0, 0.0, 0.7], [12.0, -0.4, -0.5]
    for mounting, theta in product(MOUNTINGS, (straight, on_the_spot, slipping_bend)):

        def seen(time, mounting=mounting, theta=theta):
            local = np.linalg.solve(start @ arc(theta, time[0]) @ frame(mounting), points.T)
            return local[0] + 1j * local[1]

        azimuth = np.angle(seen([0.0]))
        rate = central_difference(lambda t, at=seen: np.abs(at(t)), np.zeros(1), np.array([1e-3]))
        found = doppler_velocity(theta, azimuth, mounting)
        assert_allclose(found, rate[:, 0], rtol=0, atol=1e-8)


def test_gradients_are_those_of_the_doppler_model():
    """Breaks if the gain is not dV/dtheta or the slope not its derivative in the azimuth."""
    theta, azimuth = np.array([11.0, -0.8, 0.4]), np.linspace(-3.0, 3.0, 8)
    for mounting in MOUNTINGS:
        gain, slope = doppler_gradients(azimuth, mounting)
        by_theta = central_difference(
            lambda t, m=mounting: doppler_velocity(t, azimuth, m), theta, np.full(3, 0.1)
        )
        assert_allclose(gain, by_theta, rtol=0, atol=1e-11)
        by_azimuth = central_difference(
            lambda shift, m=mounting: doppler_gradients(azimuth + shift[0], m)[0],
            np.zeros(1),
            np.ones(1) / 500,
        )
        assert_allclose(slope, by_azimuth[..., 0], rtol=0, atol=1e-10)


def test_doppler_velocity_broadcasts():
    """Breaks if batch axes are matched with the axis of the targets."""
    rng, mounting = np.random.default_rng(4), Mounting(1.0, 2.0, 0.3)
    for theta, azimuth, shape in (
        ((3,), (5,), (5,)),
        ((4, 3), (5,), (4, 5)),
        ((4, 3), (4, 5), (4, 5)),
        ((2, 1, 3), (4, 5), (2, 4, 5)),
        ((2, 3), (0,), (2, 0)),
    ):
        motions, angles = rng.uniform(-3, 3, theta), rng.uniform(-1, 1, azimuth)
        result = doppler_velocity(motions, angles, mounting)
        assert result.shape == shape
        motions = np.broadcast_to(motions, (*shape[:-1], 3))
        angles = np.broadcast_to(angles, shape)
        for index in np.ndindex(shape):
            alone = doppler_velocity(motions[index[:-1]], angles[index][None], mounting)
            assert result[index] == pytest.approx(alone[0], rel=1e-13)


def test_help_can_be_read():
    """Breaks if an argument is shown as all types that NumPy takes for an array."""
    text = pydoc.render_doc(RadarScan, renderer=pydoc.plaintext)
    assert max(map(len, text.splitlines())) < 500


def test_a_scan_may_be_empty():
    """Breaks if a radar that sees nothing ends a drive before it begins."""
    empty = RadarScan(2.0, [], [], [], 0.1, [], [0.06])
    assert (empty.size, empty.time) == (0, 2.0)
    assert all(getattr(empty, name).shape == (0,) for name in ARGUMENTS)
    assert random_scan()[:0].size == 0
    with pytest.raises(ValueError, match="range must not be empty"):
        empty.point_set(Mounting())
    none = RadarScan.from_cartesian(1.0, [], [], velocity=np.zeros((0, 2)), grid=0.2, step=0.25)
    assert len(none) == none.size == 0


def test_a_scan_that_is_accepted_has_a_point_set():
    """Breaks if a covariance that is singular in float64 is found only when a round needs it."""
    given, azimuth = [], np.linspace(-3.1, 3.1, 50)
    sigmas = 10.0 ** np.arange(-9.0, 0.1, 0.25)
    for *sigma, extent in product(sigmas, sigmas, (0.0, 1e-9, 1.0)):
        with suppress(ValueError):
            scan = RadarScan(0.0, 9.0 + 0.0 * azimuth, azimuth, azimuth, *sigma, 0.1, extent)
            given.append(scan)
    for scan in given:
        assert (np.linalg.det(scan.point_set(CORNER).covariances) > 0.0).all()
    assert len(given) > 1000


def test_indexing_selects_targets_with_all_that_is_known_of_them():
    scan = random_scan()
    mask = np.array([True, False, False, True, True, False, False])
    for index in (slice(2, 5), slice(None, None, -2), np.array([3, 0, 3]), mask, mask & ~mask):
        part = scan[index]
        assert part.time == scan.time
        for name in (*ARGUMENTS, "extent"):
            assert_array_equal(getattr(part, name), getattr(scan, name)[index])
    with pytest.raises(IndexError, match="not by a number"):
        scan[0]


# ---- Scans from positions

X, Y = np.array([10.0, -4.0, 0.0]), np.array([3.0, 20.0, -7.0])
RANGE, AZIMUTH = np.hypot(X, Y), np.arctan2(Y, X)
ERRORS = {"sigma_range": 0.1, "sigma_azimuth": 0.01, "sigma_doppler": 0.05}
DOPPLER = np.array([-5.0, 1.0, 0.0])


def test_a_scan_goes_to_positions_and_back():
    """Breaks if x and y change places, or sigmas are changed by the way."""
    scan = random_scan()
    x, y = scan.range * np.cos(scan.azimuth), scan.range * np.sin(scan.azimuth)
    sigmas = {name: getattr(scan, name) for name in ERRORS}
    back = RadarScan.from_cartesian(scan.time, x, y, doppler=scan.doppler, **sigmas)
    assert back.time == scan.time
    for name in ("range", "azimuth", "doppler", *ERRORS):
        assert_allclose(getattr(back, name), getattr(scan, name), rtol=1e-12, err_msg=name)


def test_a_velocity_is_projected_onto_the_line_of_sight():
    """Breaks if the speed or v_x is taken instead."""
    sight = np.stack([np.cos(AZIMUTH), np.sin(AZIMUTH)], axis=-1)
    across = np.stack([-sight[:, 1], sight[:, 0]], axis=-1)
    whole = DOPPLER[:, None] * sight
    along_x = np.array([[DOPPLER[0] / sight[0, 0], 0.0], [DOPPLER[1] / sight[1, 0], 0.0], whole[2]])
    for velocity in (whole, along_x, whole + np.array([[3.0], [-7.0], [9.0]]) * across):
        scan = RadarScan.from_cartesian(0.0, X, Y, velocity=velocity, **ERRORS)
        assert_allclose(scan.doppler, DOPPLER, atol=1e-12)


def test_a_covariance_is_projected_along_and_across():
    """Breaks if the axes are mixed up: against the scatter of 50 000 draws."""
    rng = np.random.default_rng(0)
    root = rng.normal(0.0, 0.05, (3, 2, 2))
    covariance = root @ root.swapaxes(-1, -2) + 1e-4 * np.eye(2)
    scan = RadarScan.from_cartesian(
        0.0, X, Y, doppler=DOPPLER, covariance=covariance, sigma_doppler=0.1
    )
    for k in range(3):
        draws = rng.multivariate_normal([X[k], Y[k]], covariance[k], 50_000)
        angle = np.arctan2(draws[:, 1], draws[:, 0])
        turned = (angle - AZIMUTH[k] + np.pi) % (2 * np.pi) - np.pi
        assert np.hypot(*draws.T).std() == pytest.approx(scan.sigma_range[k], rel=0.02)
        assert turned.std() == pytest.approx(scan.sigma_azimuth[k], rel=0.02)
    same = RadarScan.from_cartesian(
        0.0, X, Y, doppler=DOPPLER, covariance=covariance[1], sigma_doppler=0.1
    )
    assert same.sigma_range[1] == scan.sigma_range[1]


def test_errors_add_up():
    """Breaks if one source replaces another, or standard deviations are added instead."""
    covariance = 0.04 * np.eye(2)
    scan = RadarScan.from_cartesian(
        0.0, X, Y, doppler=DOPPLER, covariance=covariance, grid=0.6, step=0.5, **ERRORS
    )
    assert_allclose(scan.sigma_range**2, 0.1**2 + 0.04 + 0.03)
    assert_allclose(scan.sigma_azimuth**2, 0.01**2 + 0.07 / RANGE**2)
    assert_allclose(scan.sigma_doppler**2, 0.05**2 + 0.25 / 12)
    values = np.random.default_rng(1).uniform(-50.0, 50.0, 100_000)
    rounded = 0.2 * np.round(values / 0.2)
    assert (rounded - values).std() == pytest.approx(quantisation_sigma(0.2), rel=0.01)


# ---- What is refused, by name

THREE = [1.0, 2.0, 3.0]
OF_SCAN = [
    *((name, [1.0, bad, 1.0], "finite") for name in ARGUMENTS for bad in (np.nan, -np.inf)),
    *((name, [1.0, 0.0, 1.0], "positive") for name in ("range", *ARGUMENTS[3:])),
    *((name, np.ones((3, 1)), "have the shape") for name in ARGUMENTS),
    *((name, np.ones(4), "have the shape") for name in ARGUMENTS[1:]),
    *((name, 0.1, "have the shape") for name in ("azimuth", "doppler")),
    *(("time", np.nan, "be"), ("time", None, "be")),
    ("azimuth", [0.0, 45.0, 0.0], "be in radians .*, but holds 45; are these degrees"),
    ("range", [8e3, 25e3, 1.0], "be in m, at most 10000, but holds 25000; are these millim"),
    ("extent", -0.1, "be at least 0"),
    ("doppler", np.ma.masked_greater([0.0, 1.0, 99.0], 9.0), "not hold masked"),
]
OF_MOUNTING = [
    ("x", -3700.0, "be in m, at most 100, but is -3700; are these millimetres"),
    ("y", 870.0, "be in m, at most 100, but is 870; are these millimetres"),
    ("yaw", 90.0, "be in radians .*, but is 90; are these degrees"),
    *(("x", np.nan, "be finite"), ("y", [1.0, 2.0], "be a number"), ("yaw", "left", "be .* real")),
]
OF_BUDGET = [
    (name, value, "")
    for name in ("azimuth", "doppler", "scale", "lag", "neighbours", "v_x", "v_y", "omega")
    for value in (-0.1, np.nan, np.inf, 1e150, "a", [0.1, 0.2])
]
OF_DOPPLER = [
    *(("theta", [1.0, 2.0], "have the shape"), ("theta", [1.0, 2.0, np.nan], "be finite")),
    *(("azimuth", [np.inf], "be finite"), ("azimuth", 0.3, "have the shape")),
    ("mounting", None, "be a Mounting"),
    ("azimuth", [0.1, 88.0], "be in radians .* 88; are these degrees"),
]
OF_POSITIONS = [
    *(("y", X[:2], "have the shape"), ("y", [np.nan, 1.0, 2.0], "be finite")),
    *(("x", 1.0, "have the shape"), ("doppler", DOPPLER[:2], "have the shape")),
    *(("covariance", np.ones((3, 2)), "have the shape"), ("covariance", -np.eye(2), "be positive")),
    *(("grid", 0.0, "be positive"), ("grid", 1e300, "be"), ("step", [0.1], "be a number")),
    *(("step", 1e300, "be"), ("sigma_range", -0.1, "be at least 0")),
    *((f"sigma_{name}", 0.0, "be positive") for name in ("range", "doppler")),
    ("sigma_azimuth", np.ones(4), "have the shape"),
]
OF_SCANS = [
    *(("limit", 0.0, "be positive"), ("mounting", None, "be a Mounting")),
    *(("theta", np.zeros((3, 3)), "have the shape"), ("scans", None, "be a sequence")),
]
SCANS = {"scans": [random_scan()], "theta": [THREE], "mounting": Mounting(), "limit": 9.0}
POSITIONS = {"time": 0.0, "x": X, "y": Y, "doppler": DOPPLER, **ERRORS}
MOTION = {"theta": THREE, "azimuth": [0.0], "mounting": Mounting()}


@pytest.mark.parametrize(
    ("make", "good", "cases"),
    [
        (RadarScan, good_arguments(), OF_SCAN),
        (Mounting, {}, OF_MOUNTING),
        (ErrorBudget, {}, OF_BUDGET),
        (doppler_velocity, MOTION, OF_DOPPLER),
        (RadarScan.from_cartesian, POSITIONS, OF_POSITIONS),
        (unfolded, SCANS, OF_SCANS),
        (random_scan().point_set, {"mounting": Mounting()}, OF_SCANS[1:2]),
    ],
)
def test_bad_input_is_refused_by_name(make, good, cases):
    """Breaks if NumPy's words get through, one bad target poisons a sum, arrays are broadcast to
    another number of targets, or a sensor 3.7 km ahead of its vehicle is believed."""
    make(**good)
    for name, bad, says in cases:
        with pytest.raises(ValueError, match=f"^{name} must .*{says}"):
            make(**(good | {name: bad}))


def test_arguments_that_do_not_go_together_are_refused():
    """Breaks if one of them is dropped, or the message is einsum's own."""
    for change, says in (
        ({"x": [0.0, 1.0, 2.0], "y": [0.0, 1.0, 2.0]}, "x and y must not both be zero"),
        ({"doppler": None}, "either doppler or velocity"),
        ({"velocity": np.zeros((3, 2))}, "either doppler or velocity"),
        ({"doppler": None, "velocity": np.zeros(3)}, "velocity must have the shape"),
    ):
        with pytest.raises(ValueError, match=says):
            RadarScan.from_cartesian(**(POSITIONS | change))
    with pytest.raises(ValueError, match=r"^azimuth must have the shape"):
        RadarScan(**(good_arguments() | {"range": np.ones(4)}))
    with pytest.raises(ValueError, match="theta and azimuth do not broadcast"):
        doppler_velocity(np.zeros((4, 3)), np.zeros((3, 5)), Mounting())
    with pytest.raises(ValueError, match=r"^mounting must"):
        random_scan().doppler_measurement(None, 0.1)
    with pytest.raises(ValueError, match=r"^interval must"):
        random_scan().doppler_measurement(Mounting(), 0.0)
    with pytest.raises(ValueError, match="step must be positive"):
        quantisation_sigma(-1.0)
    assert Mounting(30, -30, -2 * np.pi).pose.tolist() == [30.0, -30.0, -2 * np.pi]
