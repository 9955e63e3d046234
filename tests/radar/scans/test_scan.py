"""RadarScan, Mounting and the Doppler model.

Positions are checked against complex numbers, Doppler velocities against the range of a static
point seen from a sensor that really moves.
"""

from __future__ import annotations

import cmath
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import expm

from d2d import rigid
from d2d.radar import Mounting, RadarScan, doppler_velocity
from d2d.radar.scans.scan import doppler_gradients
from tests.strategies import central_difference

MOUNTINGS = [
    pytest.param(Mounting(), id="origin"),
    pytest.param(Mounting(3.86, 0.7, 0.436), id="front-left"),
    pytest.param(Mounting(-0.9, -0.873, -2.9), id="rear-right"),
]
MOTIONS = [
    pytest.param([20.0, 0.0, 0.0], id="straight"),
    pytest.param([0.0, 0.0, 0.7], id="on-the-spot"),
    pytest.param([12.0, -0.4, -0.5], id="slipping-bend"),
]
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


@pytest.mark.parametrize("mounting", MOUNTINGS)
def test_point_set_is_polar_measurements_with_first_order_covariances(mounting):
    """Breaks if the columns of the Jacobian or the variances change places, or the mounting does
    not turn the covariances."""
    scan = random_scan()
    points = scan.point_set(mounting)
    for k in range(scan.size):

        def place(polar):
            z = vehicle_position(*polar, mounting)
            return np.array([z.real, z.imag])

        measured = np.array([scan.range[k], scan.azimuth[k]])
        jacobian = central_difference(place, measured, np.array([1e-3, 1e-3]))
        variances = np.diag([scan.sigma_range[k] ** 2, scan.sigma_azimuth[k] ** 2])
        assert_allclose(points.means[k], place(measured), rtol=0, atol=1e-12)
        assert_allclose(
            points.covariances[k], jacobian @ variances @ jacobian.T, rtol=1e-9, atol=1e-12
        )
    assert_array_equal(points.weights, np.full(scan.size, 1.0 / scan.size))


def test_mounting_maps_the_sensor_frame_to_the_vehicle_frame():
    """Breaks if the pose is inverted, or y counts to the right."""
    ahead = RadarScan(0.0, [10.0], [0.0], [0.0], 0.1, 0.01, 0.06)
    on_the_left_looking_left = Mounting(3.0, 1.0, np.pi / 2)
    assert_allclose(ahead.point_set(on_the_left_looking_left).means, [[3.0, 11.0]], atol=1e-12)
    assert_array_equal(Mounting(3.0, 1.0, 0.5).pose, [3.0, 1.0, 0.5])
    assert_array_equal(Mounting().pose, np.zeros(3))


@pytest.mark.parametrize("name", ["x", "y", "yaw"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, [1.0, 2.0], "left"])
def test_mounting_refuses_what_is_not_a_number(name, bad):
    """Breaks if a bad mounting is found out only in a later product, or names nothing."""
    with pytest.raises(ValueError, match=f"^{name} must be"):
        Mounting(**{name: bad})


def homogeneous(x: float, y: float, yaw: float) -> np.ndarray:
    """Matrix (3, 3) of a pose."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, x], [s, c, y], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("mounting", MOUNTINGS)
@pytest.mark.parametrize("theta", MOTIONS)
def test_doppler_is_the_range_rate_of_a_static_point(theta, mounting):
    """Breaks with any wrong sign or lever arm: the vehicle moves on the exact SE(2) arc."""
    v_x, v_y, omega = theta
    generator = np.array([[0.0, -omega, v_x], [omega, 0.0, v_y], [0.0, 0.0, 0.0]])
    start, sensor = homogeneous(-40.0, 7.0, 1.1), homogeneous(*mounting.pose)
    points = np.random.default_rng(3).uniform(-80.0, 80.0, (9, 2))

    def seen(time):
        pose = start @ expm(time[0] * generator) @ sensor
        local = np.linalg.solve(pose, np.column_stack([points, np.ones(9)]).T)
        return local[0] + 1j * local[1]

    azimuth = np.angle(seen([0.0]))
    rate = central_difference(lambda t: np.abs(seen(t)), np.zeros(1), np.array([1e-3]))[:, 0]
    assert_allclose(doppler_velocity(theta, azimuth, mounting), rate, rtol=0, atol=1e-8)


def test_a_target_straight_ahead_of_a_forward_drive_comes_closer():
    """Breaks if Doppler above 0 no longer means receding."""
    assert_allclose(doppler_velocity([10.0, 0, 0], [0.0, np.pi], Mounting()), [-10.0, 10.0])


@pytest.mark.parametrize("mounting", MOUNTINGS)
def test_gradients_are_those_of_the_doppler_model(mounting):
    """Breaks if the gain is not dV/dtheta or the slope not its derivative in the azimuth."""
    theta, azimuth = np.array([11.0, -0.8, 0.4]), np.linspace(-3.0, 3.0, 8)
    gain, slope = doppler_gradients(azimuth, mounting)
    by_theta = central_difference(
        lambda t: doppler_velocity(t, azimuth, mounting), theta, np.full(3, 0.1)
    )
    assert_allclose(gain, by_theta, rtol=0, atol=1e-11)
    by_azimuth = central_difference(
        lambda shift: doppler_gradients(azimuth + shift[0], mounting)[0],
        np.zeros(1),
        np.ones(1) / 500,
    )
    assert_allclose(slope, by_azimuth[..., 0], rtol=0, atol=1e-10)


@pytest.mark.parametrize(
    ("theta", "azimuth", "shape"),
    [
        ((3,), (5,), (5,)),
        ((4, 3), (5,), (4, 5)),
        ((4, 3), (4, 5), (4, 5)),
        ((2, 1, 3), (4, 5), (2, 4, 5)),
    ],
)
def test_doppler_velocity_broadcasts(theta, azimuth, shape):
    """Breaks if batch axes are matched with the axis of the targets."""
    rng = np.random.default_rng(4)
    motions, angles = rng.uniform(-3, 3, theta), rng.uniform(-1, 1, azimuth)
    result = doppler_velocity(motions, angles, Mounting(1.0, 2.0, 0.3))
    assert result.shape == shape
    motions = np.broadcast_to(motions, (*shape[:-1], 3))
    angles = np.broadcast_to(angles, shape)
    for index in np.ndindex(shape):
        alone = doppler_velocity(motions[index[:-1]], angles[index][None], Mounting(1.0, 2.0, 0.3))
        assert result[index] == pytest.approx(alone[0], rel=1e-13)


@pytest.mark.parametrize(
    ("theta", "azimuth", "match"),
    [
        ([1.0, 2.0], [0.0], "^theta must have the shape"),
        (1.0, [0.0], "^theta must have the shape"),
        ([1.0, 2.0, np.nan], [0.0], "^theta must be finite"),
        ([1.0, 2.0, 3.0], [np.inf], "^azimuth must be finite"),
        (np.zeros((4, 3)), np.zeros((3, 5)), "theta and azimuth do not broadcast"),
    ],
)
def test_doppler_velocity_refuses(theta, azimuth, match):
    """Breaks if a wrong shape or nan is passed on to the sum."""
    with pytest.raises(ValueError, match=match):
        doppler_velocity(theta, azimuth, Mounting())


def test_doppler_velocity_names_the_azimuth_that_is_a_number():
    """Breaks if the message is einsum's own, which names no argument."""
    with pytest.raises(ValueError, match="azimuth"):
        doppler_velocity([1.0, 2.0, 3.0], 0.3, Mounting())


@pytest.mark.parametrize("of_twist", [True, False])
def test_doppler_measurement_predicts_the_doppler_of_a_motion(of_twist):
    """Breaks if the interval multiplies where it divides, or sigmas are mixed up."""
    scan, mounting, theta, tau = random_scan(), Mounting(3.86, 0.7, 0.436), [9.0, 0.3, -0.4], 0.07
    m = scan.doppler_measurement(mounting, tau, of_twist=of_twist)
    xi = tau * np.array(theta)
    assert_allclose(m.gain @ xi, doppler_velocity(theta, scan.azimuth, mounting), rtol=1e-12)
    h = 1e-4
    high, low = (doppler_velocity(theta, scan.azimuth + s, mounting) for s in (h, -h))
    assert_allclose(m.slope @ xi, (high - low) / (2 * h), rtol=1e-6, atol=1e-7)
    assert m.of_twist is of_twist
    assert_array_equal(m.value, scan.doppler)
    assert_array_equal(m.sigma, scan.sigma_doppler)
    assert_array_equal(m.sigma_input, scan.sigma_azimuth)


@pytest.mark.parametrize("name", ["range", "sigma_range", "sigma_azimuth", "sigma_doppler"])
@pytest.mark.parametrize("bad", [0.0, -1.0])
def test_scan_refuses_what_is_not_positive(name, bad):
    """Breaks if a range of zero, whose azimuth means nothing, or a zero sigma gets in."""
    arguments = good_arguments()
    arguments[name] = [1.0, bad, 1.0]
    with pytest.raises(ValueError, match=f"^{name} must be positive"):
        RadarScan(**arguments)


@pytest.mark.parametrize("name", ARGUMENTS)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_scan_refuses_what_is_not_finite(name, bad):
    """Breaks if one bad target poisons a whole sum."""
    arguments = good_arguments()
    arguments[name] = [1.0, bad, 1.0]
    with pytest.raises(ValueError, match=f"^{name} must be finite"):
        RadarScan(**arguments)


@pytest.mark.parametrize("bad", [np.nan, np.inf, [0.0, 1.0], "noon", None])
def test_scan_refuses_a_time_that_is_not_a_number(bad):
    """Breaks if scans are ordered by nan."""
    with pytest.raises(ValueError, match=r"^time must be"):
        RadarScan(**{**good_arguments(), "time": bad})


@pytest.mark.parametrize("name", ARGUMENTS)
@pytest.mark.parametrize("shape", [(2,), (4,), (3, 1), (1, 3)])
def test_scan_refuses_arrays_of_another_length(name, shape):
    """Breaks if arrays are silently broadcast to another number of targets."""
    expected = name if name != "range" or len(shape) == 2 else "azimuth"
    with pytest.raises(ValueError, match=f"^{expected} must have the shape"):
        RadarScan(**{**good_arguments(), name: np.ones(shape)})


@pytest.mark.parametrize("name", ["azimuth", "doppler"])
def test_one_measurement_does_not_stand_for_all_targets(name):
    """Breaks if, like a sigma, a measurement may be given once."""
    with pytest.raises(ValueError, match=f"^{name} must have the shape"):
        RadarScan(**{**good_arguments(), name: 0.1})


def test_sigmas_may_be_given_once_for_all_targets():
    """Breaks if a scalar or a single entry is not spread over the targets."""
    scan = RadarScan(**good_arguments())
    assert_array_equal(scan.sigma_range, [0.15] * 3)
    assert_array_equal(scan.sigma_doppler, [0.06] * 3)
    assert_array_equal(scan.sigma_azimuth, [0.01, 0.02, 0.03])


def test_a_scan_may_be_empty():
    """Breaks if a radar that sees nothing ends a drive before it begins."""
    empty = RadarScan(2.0, [], [], [], 0.1, [], [0.06])
    assert (empty.size, empty.time) == (0, 2.0)
    assert all(getattr(empty, name).shape == (0,) for name in ARGUMENTS)
    assert random_scan()[:0].size == 0
    with pytest.raises(ValueError, match="at least one target"):
        empty.point_set(Mounting())


@pytest.mark.parametrize("name", ARGUMENTS)
def test_a_scan_cannot_be_changed(name):
    """Breaks if arrays are shared with the caller's or may be written to."""
    arguments = {key: np.array(value) for key, value in good_arguments().items()}
    scan = RadarScan(**arguments)
    before = getattr(scan, name).copy()
    arguments[name][...] = 99.0
    assert_array_equal(getattr(scan, name), before)
    with pytest.raises(ValueError, match="read-only"):
        getattr(scan, name)[0] = 1.0
    with pytest.raises(FrozenInstanceError):
        setattr(scan, name, before)


@pytest.mark.parametrize(
    "index",
    [
        slice(2, 5),
        slice(None, None, -2),
        np.array([3, 0, 3]),
        np.array([True, False, False, True, True, False, False]),
        np.zeros(7, dtype=bool),
    ],
    ids=["slice", "backwards", "numbers", "mask", "none"],
)
def test_indexing_selects_targets_with_all_that_is_known_of_them(index):
    """Breaks if one of the columns is not indexed, or the time is lost."""
    scan = random_scan()
    part = scan[index]
    assert part.time == scan.time
    for name in ARGUMENTS:
        assert_array_equal(getattr(part, name), getattr(scan, name)[index])


def test_mounting_acts_on_a_point_set_as_a_rigid_motion():
    """Breaks if point_set applies anything but the mounting's pose."""
    scan, mounting = random_scan(), Mounting(3.86, -0.7, 1.2)
    at_origin = scan.point_set(Mounting())
    moved = rigid.transform_means(mounting.pose, at_origin.means)
    assert_allclose(scan.point_set(mounting).means, moved, rtol=0, atol=1e-12)


def test_ranges_in_millimetres_are_refused():
    """Breaks if targets 25 km away are registered, which half of all scans let pass."""
    far = np.array([8.0, 25.0])
    assert_array_equal(
        RadarScan(0.0, 100.0 * far, far / 25.0, far, 0.1, 0.01, 0.1).range, 100 * far
    )
    with pytest.raises(ValueError, match=r"^range must be in m, .* holds 25000; .* millimetres"):
        RadarScan(0.0, 1000.0 * far, far / 25.0, far, 0.1, 0.01, 0.1)


@pytest.mark.parametrize("name", ["x", "y"])
def test_a_mounting_in_millimetres_is_refused(name):
    """Breaks if a sensor 3.7 km ahead of its vehicle is believed."""
    with pytest.raises(ValueError, match=f"^{name} must be in m, .* millimetres"):
        Mounting(**{name: -3700.0})
    assert getattr(Mounting(**{name: 30.0}), name) == 30.0
