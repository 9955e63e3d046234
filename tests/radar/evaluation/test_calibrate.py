"""Clock, speed, slip and mountings from Doppler velocities alone.

The drives are made up: static targets in random directions, seen by sensors whose mountings are
turned, on a vehicle whose axle slips, beside an odometry that is late or early, too slow or fast.
"""

import re
import warnings
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d import rigid
from d2d.radar import (
    Mounting,
    RadarScan,
    Recording,
    Reference,
    SlipLaw,
    calibrate,
    doppler_velocity,
    load_nuscenes,
    load_radarscenes,
)
from d2d.radar.evaluation.calibration_model import CalibrationModel, ScanVelocities, covariance, fit

MOUNTINGS = (Mounting(3.8, 0.7, 0.5), Mounting(3.6, -0.9, -1.5))
YAW = np.deg2rad([0.8, -0.5])
SIGMAS = (0.1, 0.005, 0.05)
LAW = SlipLaw(ahead=0.4, compliance=0.005)
FACTOR = 1.02


def driven(times) -> np.ndarray:
    """v_x and omega (n, 2): bends to both sides, taken at different speeds."""
    times = np.asarray(times)
    v_x = 12.0 + 6.0 * np.sin(0.5 * times) + 1.5 * np.sin(1.7 * times)
    return np.column_stack([v_x, 0.2 * np.sin(0.9 * times) + 0.15 * np.sin(0.31 * times + 1.0)])


def steady(times) -> np.ndarray:
    """Bends at a constant speed."""
    return driven(times) * [0.0, 1.0] + [10.0, 0.0]


def straight(times) -> np.ndarray:
    return driven(times) * [1.0, 0.0]


def uniform(times) -> np.ndarray:
    """A circle at a constant speed."""
    return np.full((len(times), 2), [10.0, 0.2])


def drive(
    seed: int = 0,
    lag: float = 0.0,
    motion=driven,
    *,
    duration: float = 30.0,
    jitter: float = 0.0,
    law: SlipLaw = LAW,
    factor: float = FACTOR,
    scans: bool = True,
) -> list[Recording]:
    """Two sensors; ``jitter`` (m/s, and 0.1 rad/s) is that of the odometry, correlated over 0.5 s,
    whose v_y is not to be believed."""
    rng = np.random.default_rng(seed)
    stamps = np.arange(-1.0, duration + 1.0, 0.02)
    odometry = motion(stamps) / [factor, 1.0]
    noise = rng.standard_normal((len(stamps) + 24, 2))
    smooth = np.stack([np.convolve(column, np.ones(25) / 5.0, "valid") for column in noise.T], -1)
    odometry += jitter * smooth * [1.0, 0.1]
    theta = np.insert(odometry, 1, 99.0, axis=1)
    reference = Reference(stamps, theta, np.column_stack([stamps, stamps, 0.0 * stamps]))
    found = []
    for s, (mounting, yaw) in enumerate(zip(MOUNTINGS, YAW, strict=True)):
        times = np.arange(0.03 * s, duration, 0.1)
        v_x, omega = motion(times - lag).T
        true = np.column_stack([v_x, law.lateral(v_x, omega), omega])
        placed = Mounting(mounting.x, mounting.y, mounting.yaw + yaw)
        listed: list[RadarScan] = []
        for time, moved in zip(times, true, strict=True) if scans else ():
            azimuth = rng.uniform(-0.9, 0.9, 12)
            doppler = doppler_velocity(moved, azimuth, placed)
            noise = rng.standard_normal((2, 12)) * [[SIGMAS[1]], [SIGMAS[2]]]
            listed.append(
                RadarScan(time, np.full(12, 20.0), azimuth + noise[0], doppler + noise[1], *SIGMAS)
            )
        found.append(Recording(listed, mounting, reference))
    return found


TRUE = np.array([0.0, FACTOR, LAW.ahead, LAW.compliance, *YAW, 0.0])


def test_what_was_put_in_is_found():
    """Breaks if a parameter has the wrong sign or size, or the odometry's v_y is used."""
    for lag in (-0.27, 0.0, 0.13):
        found = calibrate(drive(1, lag, jitter=0.02))
        error = found.values - [lag, *TRUE[1:]]
        assert (np.abs(error) < 3.0 * found.sigmas).all()
        assert (found.sigmas < [0.005, 0.002, 0.1, 0.001, 0.003, 0.003, 0.005]).all()
        assert found.share > 0.99
        assert found.scans == 600
        for corrected, stated, yaw in zip(found.mountings, MOUNTINGS, found.yaw, strict=True):
            assert corrected == Mounting(stated.x, stated.y, stated.yaw + yaw)


def measured(rng, lag: float, duration: float) -> ScanVelocities:
    """What the scans of `drive` say, without the search for their static targets."""
    sensor = np.repeat([0, 1], round(10 * duration))
    time = 0.1 * (np.arange(len(sensor)) % round(10 * duration)) + 0.03 * sensor
    place = np.array([complex(m.x, m.y) for m in MOUNTINGS])[sensor]
    v_x, omega = driven(time - lag).T
    velocity = np.column_stack(
        [v_x - omega * place.imag, LAW.lateral(v_x, omega) + omega * place.real]
    )
    turned = np.einsum("kij,kj->ki", rigid.rotation(-YAW[sensor]), velocity)
    turned += 0.02 * rng.standard_normal(turned.shape)
    triangle = np.zeros((len(sensor), 3, 3))
    triangle[:, [0, 1], [0, 1]], triangle[:, :2, 2] = 50.0, 50.0 * turned
    return ScanVelocities(sensor, place, time, triangle, np.ones(len(sensor), dtype=np.int64))


def test_the_standard_deviations_are_those_of_the_errors():
    """Breaks if the correlation in time is left out: the errors are then several times as large."""
    ratios = []
    for seed in range(25):
        reference = drive(seed, jitter=0.06, duration=40.0, scans=False)[0].reference
        velocities = measured(np.random.default_rng(seed), 0.1, 40.0)
        model = CalibrationModel.of(velocities, [reference] * 2, (0, 2))
        found = fit(model, 0.06, 0.14)
        spread, block = covariance(model, found)
        truth = [0.1, FACTOR - 1.0, LAW.ahead, -LAW.compliance * FACTOR**2, *YAW, 0.0]
        error = found.parameters - truth
        ratios.append(error / np.sqrt(np.diag(spread)))
        assert block > 0.5
    size = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert 0.7 < np.sqrt(np.mean(np.square(ratios))) < 1.25
    assert (size > 0.4).all()
    assert (size < 1.6).all()


def test_a_wrong_clock_and_mounting_are_mended():
    """Breaks if what is handed back is corrected the other way round, v_y is not that of the law,
    unknown times are made up, or angles of a fit that has gone round are refused."""
    sensors = drive(2, 0.15)
    found = calibrate(sensors)
    aside = [
        replace(one, mounting=replace(one.mounting, yaw=one.mounting.yaw - 0.5 * np.pi))
        for one in sensors
    ]
    assert_allclose(calibrate(aside).yaw, found.yaw + 0.5 * np.pi, atol=1e-3)
    again = calibrate(
        [
            (recording.scans, mounting, found.reference(recording.reference))
            for recording, mounting in zip(sensors, found.mountings, strict=True)
        ]
    )
    assert again.lag == pytest.approx(0.0, abs=2e-3)
    assert again.speed_factor == pytest.approx(1.0, abs=1e-4)
    assert_allclose(again.yaw, 0.0, atol=1e-4)
    assert again.slip.compliance == pytest.approx(found.slip.compliance, abs=1e-4)
    reference = found.reference(sensors[0].reference)
    known = np.isfinite(reference.theta).all(axis=1)
    assert_array_equal(known, reference.times - found.lag >= reference.times[0])
    v_x, omega = driven(reference.times[known] - 0.15).T
    expected = np.column_stack([v_x, LAW.lateral(v_x, omega), omega])
    assert_allclose(reference.theta[known], expected, rtol=0, atol=0.03)
    assert_allclose(reference.poses[known, 0], reference.times[known] - found.lag)


def test_directions_that_change_slowly_are_stated():
    """Breaks if a budget's azimuth error cannot be told from a log, or noise is taken for it."""
    rng, slow = np.random.default_rng(3), 0.008
    steady = drive(3, duration=120.0)
    turned = []
    for recording in steady:
        errors = slow * rng.standard_normal(41)  # of three seconds each
        scans = [replace(x, azimuth=x.azimuth + errors[int(x.time / 3.0)]) for x in recording.scans]
        turned.append(replace(recording, scans=scans))
    found = calibrate(turned)
    assert_allclose(found.azimuth, slow, rtol=0.5)
    assert f"{np.rad2deg(found.azimuth[0]):.2f}" in str(found).splitlines()[-1]
    assert "azimuth of a budget" not in str(calibrate(steady))


def test_one_sensor_is_enough():
    """Breaks if a single recording is refused, or the wrong mounting is turned."""
    sensors = drive(4, 0.1, law=SlipLaw())
    found = calibrate(sensors[0])
    assert found.lag == pytest.approx(0.1, abs=0.01)
    assert found.yaw == pytest.approx(YAW[:1], abs=0.003)
    assert found.covariance.shape == (6, 6)


@pytest.mark.parametrize(
    "traffic",
    [{range(100, 120): 4.0}, {range(60): 40.0, range(200, 230): 3.0}],
    ids=["lorries", "fast and slow"],
)
def test_scans_that_follow_traffic_are_left_out(traffic):
    """Breaks if a column of lorries, which fills some scans, counts as the ground, or is only
    sought once: slow traffic shows when the fast one is left out."""
    sensors = drive(5, 0.1)
    scans = list(sensors[0].scans)
    for rows, speed in traffic.items():
        for i in rows:
            faster = scans[i].doppler + speed * np.cos(scans[i].azimuth)
            scans[i] = replace(scans[i], doppler=faster)
    clean, found = calibrate(sensors), calibrate([replace(sensors[0], scans=scans), sensors[1]])
    left = sum(map(len, traffic)) / 600
    assert found.share == pytest.approx(clean.share - left, abs=0.004)
    assert (np.abs(found.values - clean.values) < clean.sigmas).all()


def test_no_acceleration_tells_no_lag():
    """Breaks if the lowest point of a flat line is believed."""
    with pytest.warns(UserWarning, match="too little acceleration to find the lag"):
        found = calibrate(drive(7, 0.1, uniform))
    assert found.lag == 0.0
    assert np.isnan(found.sigmas[0])
    assert found.speed_factor == pytest.approx(FACTOR, abs=0.001)
    assert re.search(r"lag +\+0.00000 held", str(found))


def test_one_speed_in_all_bends_does_not_tell_axle_from_tyres():
    """Breaks if two parameters share one effect by chance."""
    found = calibrate(drive(8, 0.1, steady))
    assert found.slip.ahead == 0.0
    assert np.isnan(found.sigmas[2])
    assert found.slip.compliance == pytest.approx(0.005 - 0.4 / 100.0, abs=3e-4)
    assert re.search("axle .* held", str(found))
    given = calibrate(drive(8, 0.1, steady), ahead=0.4)
    assert given.slip.ahead == 0.4
    assert given.slip.compliance == pytest.approx(0.005, abs=3e-4)


def test_a_straight_drive_tells_no_slip():
    """Breaks if noise is given out as a slip law."""
    found = calibrate(drive(9, 0.1, straight))
    assert found.slip == SlipLaw()
    assert np.isnan(found.sigmas[2:4]).all()
    assert_allclose(found.yaw, YAW, atol=0.002)
    assert found.lag == pytest.approx(0.1, abs=0.01)


def test_what_cannot_be_calibrated_is_refused_by_name():
    """Breaks if a user gets a number, or an error that does not say what is wrong."""
    (first, _) = drive(14, duration=2.0)
    scans, mounting, reference = first.scans, first.mounting, first.reference
    entry, empty = (scans, mounting, reference), [scan[:0] for scan in scans]
    silent = [replace(scan, doppler=0.0 * scan.doppler) for scan in scans]
    still = replace(reference, theta=0.0 * reference.theta)
    gyro = replace(reference, theta=reference.theta * [np.nan, np.nan, 1.0])
    late = replace(reference, times=reference.times + 100.0)
    back = replace(reference, times=reference.times[::-1])
    for recordings, options, message in (
        ([], {}, "^recordings must hold at least one sensor"),
        ([entry[:2]], {}, r"^recordings\[0\] must be a tuple"),
        ([(scans[:1], *entry[1:])], {}, r"^recordings\[0\] must have at least two scans"),
        ([(empty, *entry[1:])], {}, r"^recordings\[0\] must have at least two scans"),
        ([(*entry[:2], still)], {}, r"^recordings\[0\] must have a moving vehicle"),
        ([(*entry[:2], gyro)], {}, r"^recordings\[0\] must have .* speeds and yaw rates"),
        ([(*entry[:2], late)], {}, "^the references of recordings must cover the times"),
        ([(*entry[:2], back)], {}, r"^recordings\[0\] must have a reference .* increasing"),
        ([entry, (scans[:5], MOUNTINGS[1], reference)], {}, "is one sensor given twice"),
        ([(silent, *entry[1:])], {}, "all of them are zero"),
        ([entry], {"max_lag": 0.0}, "^max_lag must"),
        ([entry], {"ahead": 1e300}, "^ahead must be in m, at most 100"),
        ([entry], {"ahead": np.nan}, "^ahead must be"),
        ([entry], {"max_lag": 5.0}, r"at a lag of -5.000 s; is max_lag longer than the drive"),
    ):
        with pytest.raises(ValueError, match=message):
            calibrate(recordings, **options)
    for name in ("ahead", "compliance"):
        with pytest.raises(ValueError, match=f"^{name} must be"):
            SlipLaw(**{name: np.nan})


@pytest.mark.parametrize("power", [-9, -5, -2, -1.31, 0, 1])
def test_sigmas_of_any_size_give_a_lag_within_its_error_or_a_refusal(power):
    """Breaks if sigmas that are far too small leave two targets of each scan, which fit anything,
    or the limit of the residuals doubles."""
    sensors = [
        replace(each, scans=[replace(s, sigma_doppler=10.0**power) for s in each.scans])
        for each in drive(3, 0.1)
    ]
    said = ""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # what cannot be told is held
            found = calibrate(sensors)
    except ValueError as error:
        said = str(error)
    if said:
        assert said.startswith("recordings must have Doppler velocities that their sigmas explain")
        assert power < -1.5
    else:
        assert not abs(found.lag - 0.1) > 4.0 * found.sigmas[0]


# Factors on a reference's velocities, s that it is late, and what is said.
WRONG = {
    "in km/h": ([3.6, 1.0, 1.0], 0.0, "are they in km/h"),
    "backwards": ([-1.0, 1.0, 1.0], 0.0, "is a radar mounted backwards"),
    "clockwise": ([1.0, 1.0, -1.0], 0.0, "another drive"),
    "8 s off": ([1.0, 1.0, 1.0], 8.0, "another drive or clock"),
    "0.62 s off": ([1.0, 1.0, 1.0], 0.62, "is at the bound of the search"),
    "0.42 s early": ([1.0, 1.0, 1.0], -0.42, "is at the bound of the search"),
}


@pytest.mark.parametrize("fault", WRONG)
def test_a_wrong_reference_gives_no_mounting(fault):
    """Breaks if a mounting that cannot be right is printed to be pasted."""
    factors, late, said = WRONG[fault]
    sensors = drive(3, 0.1)
    right = sensors[0].reference
    wrong = replace(right, times=right.times + late, theta=right.theta * factors)
    with pytest.raises(ValueError, match=said):
        calibrate([replace(each, reference=wrong) for each in sensors])


def test_a_bias_of_the_yaw_rate_is_found():
    """Breaks if a gyro's bias turns the mountings, or is left in the corrected reference."""
    sensors = drive(3, 0.1)
    theta = sensors[0].reference.theta + np.array([0.0, 0.0, np.deg2rad(0.8)])
    biased = [replace(r, reference=replace(r.reference, theta=theta)) for r in sensors]
    found = calibrate(biased)
    assert found.bias == pytest.approx(np.deg2rad(0.8), abs=3.0 * found.sigmas[-1])
    assert (np.abs(found.yaw - YAW) < 3.0 * found.sigmas[4:-1]).all()


@pytest.mark.radarscenes
def test_radarscenes_has_a_late_clock_and_no_other_large_error(radarscenes):
    """Breaks if the defaults of `load_radarscenes` are not what the data say."""
    sensors = [load_radarscenes(radarscenes, 105, s, time_offset=0.0) for s in (1, 2, 3, 4)]
    found = calibrate(sensors)
    assert found.lag == pytest.approx(0.12, abs=0.015)
    assert found.speed_factor == pytest.approx(1.0, abs=0.002)
    assert found.slip.ahead == pytest.approx(0.0, abs=3.0 * found.sigmas[2])
    assert found.slip.compliance == pytest.approx(0.0045, abs=3.0 * found.sigmas[3])
    assert np.abs(np.rad2deg(found.yaw)).max() < 0.25


@pytest.mark.nuscenes
def test_nuscenes_has_an_early_clock_and_a_slow_speedometer(nuscenes):
    """Breaks if a lag below zero is not found, or the defaults of `load_nuscenes` are wrong."""
    channels = ("FRONT", "FRONT_LEFT", "FRONT_RIGHT", "BACK_LEFT", "BACK_RIGHT")
    options = {"time_offset": 0.0, "speed_factor": 1.0}
    found = calibrate(
        [load_nuscenes(nuscenes, "scene-0103", f"RADAR_{name}", **options) for name in channels]
    )
    assert found.lag == pytest.approx(-0.03, abs=0.015)
    assert found.speed_factor == pytest.approx(1.0125, abs=0.004)
    assert found.slip.ahead == 0.0
