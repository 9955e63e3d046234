"""Faults that are put into a log by hand, and what is said of them; right logs, and silence."""

import warnings
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from d2d.radar import ErrorBudget, Mounting, RadarScan, diagnose, track
from d2d.study.guides.logs import FAULTS, VEHICLES, Log, right_log

DEGREE = np.deg2rad(1.0)
GUIDE = Path(__file__).resolve().parents[3] / "chapters" / "when_a_path_looks_wrong.ipynb"


@cache
def log(
    vehicle: str = "car",
    radars: int = 2,
    rate: float = 10.0,
    targets: int = 30,
    duration: float = 10.0,
) -> Log:
    """A log of ten seconds."""
    return right_log(np.random.default_rng(7), vehicle, radars, rate, targets, duration)


def findings(sensors, **options) -> tuple:
    """What the diagnosis of a log and its track finds, beside stretches without estimates."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        driven = track(sensors, budget=ErrorBudget(), **options)
    found = diagnose(sensors, driven)
    return tuple(each for each in found if each.symptom != "a stretch without estimates")


def faulty(name: str, of: Log | None = None) -> dict:
    """The sensors of a log with a fault."""
    return FAULTS[name].put(np.random.default_rng(1), of or log())


NAMED = [name for name in FAULTS if name != "nothing"]


@pytest.mark.parametrize("name", NAMED)
def test_each_fault_is_named_and_on_the_page(name):
    """Breaks if a fault passes in silence, or the reader does not find it."""
    symptoms = FAULTS[name].symptoms
    longer = {"times in ms": log("car", 2, 30.0), "clock 8 s late": log(duration=20.0)}
    found = {each.symptom for each in findings(faulty(name, longer.get(name, log())))}
    assert found & set(symptoms)
    assert all(f"*{symptom}*" in GUIDE.read_text(encoding="utf-8") for symptom in symptoms)


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_a_right_log_is_not_doubted(vehicle):
    """Breaks if a user of a right log is sent to look for a fault: also of few targets, of a lone
    radar, at rest amid traffic, and at a walking pace."""
    for radars, targets in ((1, 8), (1, 40), (4, 20)):
        assert findings(log(vehicle, radars, 10.0, targets).sensors) == ()


def test_a_clock_that_wraps_round_has_its_period():
    """Breaks if the period is an interval too short."""
    (found,) = findings(faulty("clock wraps", log("car", 1)))
    assert "wraps round every 4.290 s" in found.about


def test_a_fault_of_one_sensor_is_that_sensors():
    """Breaks if a joint estimate hides a sensor that the others outvote, or nobody reads why."""
    sensors = dict(log("car", 3).sensors)
    scans, at = sensors["r2"]
    sensors["r2"] = [replace(s, doppler=-s.doppler) for s in scans], at
    (found,) = (each for each in findings(sensors) if each.sure)
    assert str(found).startswith("r2: the path runs backwards (scans fit together better without")


@pytest.mark.parametrize("vehicle", ["indoor", "car"])
def test_a_turned_mounting_says_what_to_state(vehicle):
    """Breaks if the sign is turned, or a slow vehicle has no mounting."""
    (scans, at), *_ = log(vehicle, 1).sensors.values()
    (found,) = findings({"radar": (scans, replace(at, yaw=at.yaw + 5.0 * DEGREE))})
    assert found.symptom == "a mounting is turned"
    assert found.number == pytest.approx(5.0, abs=1.0)
    words = found.about.split("--mounting radar ")[1].split()
    assert float(words[2]) == pytest.approx(0.0, abs=1.0)


def test_all_mountings_turned_alike_are_one_finding():
    """Breaks if the vehicle's frame is not named as what may be turned."""
    turned = {
        name: (scans, replace(at, yaw=at.yaw + 4.0 * DEGREE))
        for name, (scans, at) in log("car", 3).sensors.items()
    }
    assert [each.sensor for each in findings(turned)] == [""]


@pytest.mark.parametrize("late", [0.3, -3.0])
def test_the_sensor_whose_clock_is_off_is_found(late):
    """Breaks if the wrong sensor is named, or the sign is wrong."""
    sensors = dict(log("car", 3).sensors)
    scans, at = sensors["r2"]
    sensors["r2"] = [replace(s, time=s.time + late) for s in scans], at
    (found,) = (each for each in findings(sensors) if each.unit == "s")
    assert (found.sensor, found.sure) == ("r2", True)
    assert found.number == pytest.approx(late, abs=0.1)


def test_azimuths_to_leave_out_are_named():
    """Breaks if the wrong side is left out, or a mounting is blamed."""
    (found,) = findings(faulty("azimuths distorted", log("car", 1, 20.0, 80)))
    above = float(found.about.split("above ")[1].split()[0])
    assert 8.0 < above < 20.0


def test_traffic_alone_is_no_wrong_unit():
    """Breaks if vehicles that drive along are taken for km/h, or for a turned mounting."""
    rng = np.random.default_rng(0)
    speed, ahead, left = (rng.uniform(*ends, 6) for ends in ((-2, 2), (15, 60), (-8, 8)))
    scans = []
    for time in np.arange(0.0, 20.0, 0.05):
        x = np.repeat(ahead + 2.0 * speed * np.sin(0.5 * time), 2) + np.tile([0.0, 1.5], 6)
        y, v_x = np.repeat(left, 2), np.repeat(speed * np.cos(0.5 * time), 2)
        measured = np.stack([np.hypot(x, y), np.arctan2(y, x), v_x * x / np.hypot(x, y)])
        measured += np.array([[0.1], [0.009], [0.06]]) * rng.standard_normal((3, 12))
        scans.append(RadarScan(time, *measured, 0.15, 0.009, 0.06))
    (found,) = findings((scans, Mounting(3.7)))
    assert found.symptom == "most targets move"


def test_a_stretch_without_estimates_has_its_times():
    """Breaks if a path that is guessed looks like any other."""
    ((scans, at),) = log("car", 1).sensors.values()
    left = [scan for scan in scans if not 3.0 < scan.time < 6.0], at
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        (found,) = diagnose(left, track(left))
    assert found.about.startswith("no estimate from 2.9 to 6.1 s; ")
    assert not found.sure


def test_sensors_that_contradict_each_other_are_told():
    """Breaks if two tracks of one vehicle may differ by any number of standard deviations, or files
    are written although they surely are of two drives."""
    sensors = log().sensors
    alone = {name: track(sensor) for name, sensor in sensors.items()}
    driven = track(sensors)
    assert diagnose(sensors, driven, alone) == ()
    for wrong in (7, [], {"r1": 7}):
        with pytest.raises(ValueError, match=r"^alone"):
            diagnose(sensors, driven, wrong)
    right = alone["r2"]
    for faster, sure in ((0.5, False), (4.0, True)):
        alone["r2"] = replace(right, theta=right.theta + np.array([faster, 0.0, 0.0]))
        (found,) = diagnose(sensors, driven, alone)
        assert (found.symptom, found.sensor) == ("sensors contradict each other", "r1 and r2")
        assert found.sure == sure, found.number


# Values on either side of a limit: the symptom, and whether it is found.
BESIDE_LIMITS = {
    "minutes": (lambda s: replace(s, time=s.time / 60.0), "times in another unit than s", True),
    "narrow": (lambda s: replace(s, azimuth=0.1 * s.azimuth), "azimuths in radians", False),
    "one target": (lambda s: s[:1], "several time stamps in a scan", False),
    "far": (lambda s: replace(s, range=s.range + 700.0), "ranges in cm", True),
    "precise": (lambda s: replace(s, sigma_azimuth=0.05 * DEGREE), "azimuth too small", False),
    "coarse": (lambda s: replace(s, sigma_azimuth=15.0 * DEGREE), "azimuth too large", True),
}


@pytest.mark.parametrize("case", BESIDE_LIMITS)
def test_limits_of_values(case):
    """Breaks if a limit is half or twice as large."""
    change, symptom, wrong = BESIDE_LIMITS[case]
    ((scans, at),) = log("car", 1).sensors.values()
    found = [each.symptom for each in findings(([change(scan) for scan in scans], at))]
    assert any(symptom in each for each in found) == wrong


def test_what_is_no_track_is_refused():
    """Breaks if a mistake is found late."""
    with pytest.raises(ValueError, match="driven must be a Track"):
        diagnose(log().sensors, "track")
