"""Mistakes with a log, each put in by hand, and what is said of them."""

import warnings
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from d2d.radar import ErrorBudget, FindingWarning, Mounting, Sensor, diagnose, simulate_drive, track
from d2d.radar.simulation.drive import CAR_SPEED
from tests.radar.scenes import CORNER, beginning, surround_scans

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


def frozen() -> dict:
    """The log with a sensor that gives one scan again and again from its twelfth on."""
    scans, at = log()["rear"]
    again = [replace(scans[11], time=scan.time) for scan in scans[12:]]
    return {**log(), "rear": ([*scans[:12], *again], at)}


def one_by_one() -> dict:
    """The front radar with a time of its own for each target."""
    scans, at = log()["front"]
    stamped = [replace(s[[i]], time=s.time + 1e-4 * i) for s in scans[:20] for i in range(10)]
    return {"front": (stamped, at)}


def told(sensors, **options) -> dict[str, tuple[str, ...]]:
    """The symptoms that are told, of the log and by `track`, with their sensors."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", UserWarning)
        driven = track(sensors, budget=ErrorBudget(), **options)
    found = [each.message.finding for each in said if isinstance(each.message, FindingWarning)]
    spaced = {name: options[name] for name in options if name == "horizon"}
    found += diagnose(sensors, driven, **spaced).findings
    return {
        each.symptom: tuple(other.sensor for other in found if other.symptom == each.symptom)
        for each in found
    }


def sure_of(sensors, **options) -> dict[str, bool]:
    """Whether each symptom that the track of a log shows is surely one."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        driven = track(sensors, **options)
    return {each.symptom: each.sure for each in diagnose(sensors, driven, **options).findings}


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
    "a gap": (lambda: without(1.0, 3.0), ("",)),
    "the clock jumps": (
        lambda: changed(lambda s: replace(s, time=(s.time + 86398.0) % 86400.0)),
        tuple(f"sensors['{name}'].scans" for name in NAMES),
    ),
    "a scan is repeated": (frozen, ("sensors['rear'].scans",)),
    "targets are given twice": (
        lambda: changed(lambda s: s[np.repeat(np.arange(s.size), 2)], "rear"),
        ("sensors['rear'].scans",),
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


def test_positions_say_whether_a_vehicle_may_drive_backwards():
    """Breaks if a wrong sign passes for a vehicle that reverses, or a turned radar is refused."""
    flipped = alone(lambda s: replace(s, doppler=-s.doppler))
    behind = {"front": (beginning().scans, replace(CORNER, yaw=CORNER.yaw + np.pi))}
    for sensors, wrong in ((flipped, True), (behind, False)):
        assert sure_of(sensors, horizon=0.3)["the vehicle drives backwards"] == wrong


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


def test_numbers_and_units_of_a_diagnosis():
    """Breaks if an angle is in rad, its sign is turned, or sensors change places."""
    sensors = turned(3.0, "side")
    found = diagnose(sensors, track(sensors))
    assert list(found.headings) == list(found.inliers) == list(NAMES)
    assert found.headings["side"] == pytest.approx(3.0, abs=0.4)
    assert abs(found.headings["front"]) < 0.4
    finding = found.findings[0]
    assert finding.number == found.headings["side"]
    assert (finding.unit, finding.sure) == ("deg", False)
    assert str(finding).startswith("side: a mounting is turned (")
    assert 0.4 < found.inliers["front"] <= 1.0


def test_what_is_no_track_of_the_sensors_is_refused():
    """Breaks if shares are computed at velocities of other rounds."""
    driven = track(log())
    for wrong, said in ((driven[:5], "but has 5"), ("track", "driven must be a Track")):
        with pytest.raises(ValueError, match=said):
            diagnose(log(), wrong)


def test_a_log_of_rare_scans_is_diagnosed():
    """Breaks if `track` may be told that scans are far apart, and `diagnose` refuses them."""
    rare = changed(lambda scan: replace(scan, time=700.0 * scan.time))
    driven = track(rare, max_interval=100.0)
    assert set(diagnose(rare, driven, max_interval=100.0).inliers) == set(NAMES)
    with pytest.raises(ValueError, match="max_interval = 60 apart"):
        diagnose(rare, driven)
