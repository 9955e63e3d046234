"""Mistakes with a log, each put in by hand, and what is said of them."""

import warnings
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from d2d.radar import (
    Drive,
    ErrorBudget,
    Mounting,
    RadarScan,
    Sensor,
    diagnose,
    doppler_velocity,
    simulate_drive,
    track,
)
from d2d.radar.simulation.drive import CAR_SPEED
from tests.radar.scenes import AROUND, CORNER, accelerating, beginning, observe, surround_scans

DEGREE = np.deg2rad(1.0)
GUIDE = Path(__file__).resolve().parents[3] / "chapters" / "when_a_path_looks_wrong.ipynb"
NAMES = ("front", "side", "rear")


@cache
def log() -> dict:
    """Four seconds of a car in a bend, with three radars that look around it."""
    return dict(zip(NAMES, surround_scans(40), strict=True))


def changed(change, *names: str) -> dict:
    """The log with each scan of the sensors, or of all, changed."""
    return {
        name: ([change(s) for s in scans] if name in (names or NAMES) else scans, mounting)
        for name, (scans, mounting) in log().items()
    }


def alone(change) -> dict:
    """The log of a single radar, whose targets are not as accurate, with each scan changed."""
    return {"front": ([change(scan) for scan in beginning().scans], CORNER)}


def turned(degrees: float, *names: str) -> dict:
    """The log with the mountings of the sensors, or of all, turned."""
    return {
        name: (scans, replace(at, yaw=at.yaw + degrees * DEGREE * (name in (names or NAMES))))
        for name, (scans, at) in log().items()
    }


def swapped() -> dict:
    """The log with two sensors taken for each other."""
    (front, at), (side, beside), rear = log().values()
    return dict(zip(NAMES, ((front, beside), (side, at), rear), strict=True))


def folded(limit: float) -> dict:
    """The log of radars that measure Doppler velocities up to a limit."""
    return changed(lambda s: replace(s, doppler=(s.doppler + limit) % (2 * limit) - limit))


def without(first: float, last: float) -> dict:
    """The log without the scans between two times."""
    return {
        name: ([s for s in scans if not first < s.time < last], at)
        for name, (scans, at) in log().items()
    }


def one_by_one() -> dict:
    """The front radar with a time of its own for each target."""
    scans, at = log()["front"]
    stamped = [replace(s[[i]], time=s.time + 1e-4 * i) for s in scans[:20] for i in range(10)]
    return {"front": (stamped, at)}


def findings(sensors, **options):
    """What the diagnosis of a log and its track finds."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        driven = track(sensors, budget=ErrorBudget(), **options)
    return diagnose(sensors, driven)


def told(sensors, **options) -> dict[str, tuple[str, ...]]:
    """The symptoms that are found, with their sensors."""
    found = findings(sensors, **options)
    return {
        each.symptom: tuple(other.sensor for other in found if other.symptom == each.symptom)
        for each in found
    }


def sure_of(sensors, **options) -> dict[str, bool]:
    """Whether each symptom that is found is surely one."""
    return {each.symptom: each.sure for each in findings(sensors, **options)}


FAULTS = {
    "azimuths in radians, read as degrees": (
        lambda: changed(lambda s: replace(s, azimuth=s.azimuth * DEGREE)),
        NAMES,
    ),
    "azimuths count clockwise": (
        lambda: changed(lambda s: replace(s, azimuth=-s.azimuth)),
        ("",),
    ),
    "a mounting is turned": (lambda: turned(3.0, "side"), ("side",)),
    "sensors are swapped": (swapped, ("front and side",)),
    "yaw of the mountings in radians": (
        lambda: {n: (s, replace(at, yaw=at.yaw * DEGREE)) for n, (s, at) in log().items()},
        ("",),
    ),
    "ranges in feet": (lambda: alone(lambda s: replace(s, range=s.range / 0.3048)), ("",)),
    "ranges in cm": (lambda: changed(lambda s: replace(s, range=100.0 * s.range)), NAMES),
    "Doppler velocities are folded": (lambda: folded(8.0), NAMES),
    "standard deviation of the azimuth too small": (
        lambda: changed(lambda s: replace(s, sigma_azimuth=s.sigma_azimuth * DEGREE)),
        NAMES,
    ),
    "standard deviation of the azimuth too large": (
        lambda: alone(lambda s: replace(s, sigma_azimuth=0.0 * s.azimuth + 0.3)),
        ("front",),
    ),
    "one time stamp for each target": (one_by_one, ("front",)),
    "a gap": (lambda: without(1.0, 2.6), ("",)),
    "the clock jumps": (
        lambda: changed(lambda s: replace(s, time=(s.time + 86398.0) % 86400.0)),
        ("",),
    ),
    "Doppler velocities in km/h": (
        lambda: alone(lambda s: replace(s, doppler=3.6 * s.doppler)),
        ("",),
    ),
    "the path runs backwards": (
        lambda: alone(lambda s: replace(s, doppler=-s.doppler)),
        ("",),
    ),
}


@pytest.mark.parametrize("symptom", FAULTS)
def test_each_fault_is_told_by_its_name(symptom):
    """Breaks if a fault passes in silence, or the wrong sensor is blamed."""
    fault, sensors = FAULTS[symptom]
    assert told(fault(), horizon=0.3)[symptom] == sensors
    assert f"*{symptom}*" in GUIDE.read_text(encoding="utf-8")


def test_a_correct_log_is_not_doubted():
    """Breaks if a user of a correct log is sent to look for a fault."""
    assert told(log()) == {}
    assert told(log(), horizon=0.3) == {}
    assert told(alone(lambda scan: scan)) == {}


def test_all_mountings_turned_alike_are_one_finding():
    """Breaks if the vehicle's frame is not named as what may be turned."""
    assert told(turned(4.0))["a mounting is turned"] == ("",)


def test_a_fault_of_one_sensor_is_that_sensors():
    """Breaks if a joint estimate hides a sensor that the others outvote."""
    wrong = changed(lambda s: replace(s, azimuth=-s.azimuth), "front")
    found = told(wrong)
    assert found["azimuths count clockwise"] == ("front",)
    assert found["few targets fit"] == ("front",)


def test_a_vehicle_may_drive_backwards_but_a_sign_is_wrong():
    """Breaks if a wrong sign passes for a vehicle that reverses, or a turned radar is refused."""
    flipped = alone(lambda s: replace(s, doppler=-s.doppler))
    behind = {"front": (beginning().scans, replace(CORNER, yaw=CORNER.yaw + np.pi))}
    assert sure_of(flipped, horizon=0.3)["the path runs backwards"]
    assert sure_of(behind, horizon=0.3) == {"the vehicle drives backwards": False}


def test_a_standard_deviation_that_is_too_small_is_surely_wrong_if_few_targets_fit():
    """Breaks if radians taken for degrees give files as if the rest were right."""
    wrong = alone(lambda s: replace(s, sigma_azimuth=s.sigma_azimuth * DEGREE))
    assert sure_of(wrong)["standard deviation of the azimuth too small"]


def test_one_radar_to_the_side_is_told_that_it_needs_help():
    """Breaks if the remedy for a lone side radar is not offered, or still is when it is taken."""
    place, sensor = Mounting(3.0, 0.8, 90.0 * DEGREE), Sensor(max_targets=16, quantised=False)
    rng = np.random.default_rng(5)
    drive = simulate_drive(rng, 4.0, CAR_SPEED, mounting=place, sensor=sensor)
    aside = {"side": (drive.scans, place)}
    assert told(aside)["one radar to the side"] == ("side",)
    assert "one radar to the side" not in told(aside, side_slip=0.02)


def test_what_is_no_track_is_refused():
    """Breaks if a mistake is found late."""
    with pytest.raises(ValueError, match="driven must be a Track"):
        diagnose(log(), "track")


def test_a_small_turn_of_a_mounting_is_found():
    """Breaks if mountings must be turned by more than real ones are, an angle is in rad, or its
    sign is turned."""
    straight = dict(zip(NAMES, surround_scans(40, [12.0, 0.0, 0.02]), strict=True))
    scans, at = straight["side"]
    sensors = straight | {"side": (scans, replace(at, yaw=at.yaw + 2.2 * DEGREE))}
    (finding,) = (each for each in findings(sensors) if each.unit == "deg")
    assert (finding.sensor, finding.sure) == ("side", False)
    assert finding.number == pytest.approx(2.2, abs=0.3)
    assert str(finding).startswith("side: a mounting is turned (")


# Values on either side of a limit: the symptom, and whether it is found.
BESIDE_LIMITS = {
    "narrow": (lambda s: replace(s, azimuth=0.1 * s.azimuth), "azimuths in radians", False),
    "far": (lambda s: replace(s, range=s.range + 700.0), "ranges in cm", True),
    "precise": (lambda s: replace(s, sigma_azimuth=0.05 * DEGREE), "azimuth too small", False),
    "coarse": (lambda s: replace(s, sigma_azimuth=15.0 * DEGREE), "azimuth too large", True),
}


@pytest.mark.parametrize("case", BESIDE_LIMITS)
def test_limits_of_values(case):
    """Breaks if a limit is half or twice as large."""
    change, symptom, wrong = BESIDE_LIMITS[case]
    found = told(alone(change))
    assert any(symptom in each for each in found) == wrong


FOUR = (*AROUND, Mounting(-0.9, 0.87, 2.9))


@pytest.mark.parametrize("speed", [2.5, CAR_SPEED], ids=["robot", "car"])
@pytest.mark.parametrize("places", [[CORNER], [Mounting(3.5)], FOUR], ids=["corner", "front", "4"])
def test_right_logs_are_not_doubted(speed, places):
    """Breaks if more than one right log in some tens has a finding, or any a sure one."""
    found = []
    for seed in range(8 if len(places) == 1 else 3):
        sensor = Sensor(max_targets=(12, 30, 60)[seed % 3])
        log = {}
        for number, mounting in enumerate(places):
            rng = np.random.default_rng(seed)  # of the same drive
            drive = simulate_drive(rng, 5.0, speed, mounting=mounting, sensor=sensor)
            log[str(number)] = drive.scans, mounting
        found.append(findings(log, horizon=0.3))
    assert not any(finding.sure for each in found for finding in each)
    assert sum(map(bool, found)) <= 1


# ---- Doppler velocities that positions contradict


def still() -> tuple:
    """A vehicle at rest."""
    rng, first = np.random.default_rng(4), beginning().scans[0]
    drawn = rng.standard_normal((20, 2, first.size)) * [[0.05], [0.01]]
    scans = [
        replace(first, time=0.1 * i, doppler=doppler, azimuth=first.azimuth + angle)
        for i, (doppler, angle) in enumerate(drawn)
    ]
    return scans, CORNER


def rail() -> tuple:
    """A guardrail beside the road, whose reflections travel with the vehicle."""
    rng, mounting = np.random.default_rng(7), Mounting(2.0, -0.8, -1.5)
    azimuth = np.linspace(-0.7, 0.7, 40)
    doppler = doppler_velocity([15.0, 0.0, 0.0], azimuth, mounting)
    noise = 0.05 * rng.standard_normal((20, 2, 40))
    scans = [
        RadarScan(0.1 * i, 6.0 / np.cos(azimuth) + r, azimuth, doppler + v, 0.1, 0.01, 0.05)
        for i, (r, v) in enumerate(noise)
    ]
    return scans, mounting


def rare(acceleration: float) -> tuple:
    """One scan a second of a car that changes its speed: positions show the mean velocity."""
    driven = np.array([acceleration, 0.0, 0.0])
    (sensor,), _ = accelerating([1.0], [0.0], driven, [CORNER], noise=1.0, end=6.0)
    return sensor


@pytest.mark.parametrize(
    "sensors",
    [still, lambda: {"right": rail()}, lambda: rare(2.0), lambda: rare(-2.0)],
    ids=["still", "rail", "speeds up", "slows down"],
)
def test_what_looks_like_a_contradiction_is_none(sensors):
    """Breaks if what travels with the vehicle, or a mean velocity, is another velocity."""
    assert told(sensors(), limits=None).keys() <= {"one radar to the side"}


def without_own_motion(drive: Drive) -> list[RadarScan]:
    """The scans of a radar that subtracts its own motion from the Doppler velocities."""
    own = zip(drive.scans, drive.truth.theta, strict=True)
    return [
        replace(scan, doppler=scan.doppler - doppler_velocity(theta, scan.azimuth, drive.mounting))
        for scan, theta in own
    ]


@pytest.mark.parametrize("speed", [0.6, 2.5, 15.0])
def test_doppler_velocities_that_show_no_motion_are_found(speed):
    """Breaks if a moving vehicle gets a track at rest without a word; at 0.6 m/s, if the positions
    must speak against it by twice as much."""
    sensor = Sensor(max_targets=20)
    drive = simulate_drive(np.random.default_rng(5), 4.0, speed, sensor=sensor)
    empty = [replace(scan, doppler=np.zeros(scan.size)) for scan in drive.scans]
    for scans in (without_own_motion(drive), empty):
        assert sure_of((scans, drive.mounting))["the vehicle hardly moves"]


# ---- Clocks


def changing(seed: int, late: float, end: float = 7.0, speed=lambda t: 12 + 1.5 * np.sin(1.5 * t)):
    """Three sensors of a vehicle that speeds up and slows down; the clock of "side" is late."""
    rng, step = np.random.default_rng(seed), 1e-3
    speeds = speed(step * np.arange(round(end / step) + 2))
    driven = np.concatenate([[0.0], np.cumsum(step * speeds)])
    points = rng.uniform([-30.0, -40.0], [130.0, 40.0], (500, 2))
    points = points[np.abs(points[:, 1]) > 4.0]
    sensors = {}
    for number, (name, mounting) in enumerate(zip(NAMES, AROUND, strict=True)):
        scans = []
        for ticks in range(20 * number, round(end / step), 77):
            pose, theta = np.eye(3), np.array([speeds[ticks], 0.0, 0.0])
            pose[0, 2] = driven[ticks]
            noise = rng.standard_normal((3, len(points)))
            time = ticks * step + late * (name == "side")
            full = observe(points, pose, time, theta, mounting, noise, (0.1, 0.005, 0.06))
            scans.append(full[(np.abs(full.azimuth) < 0.8) & (full.range < 50.0)])
        sensors[name] = scans, mounting
    return sensors


@pytest.mark.parametrize("late", [0.3, -0.3, 0.1])  # a tenth is barely found
def test_the_sensor_whose_clock_is_off_is_found(late):
    """Breaks if the wrong sensor is named, or the sign is wrong."""
    (finding,) = findings(changing(1, late), horizon=0.3)
    assert (finding.symptom, finding.sensor) == ("the clock of a sensor is off", "side")
    assert finding.number == pytest.approx(late, abs=0.05)
    assert finding.sure == (abs(late) > 0.2)


@pytest.mark.parametrize("name", ["front", "side"])
def test_a_turned_mounting_is_no_late_clock(name):
    """Breaks if what grows with the speed is taken for what the acceleration does: while a vehicle
    sets off, both fall."""
    sensors = changing(1, 0.0, 8.0, lambda t: np.minimum(2.0 + 2.5 * t, 14.0))
    scans, at = sensors[name]
    sensors[name] = scans, replace(at, yaw=at.yaw - 5.0 * DEGREE)
    found = told(sensors, horizon=0.3)
    assert found.pop("a mounting is turned") == (name,)
    assert found.keys() <= {"few targets fit"}
