"""The track of a log in a real browser is that of the command line on the same file, to 1e-6.

Breaks if a round, a limit, a part of the covariance, a column of the files or a symptom differs.
Both get the same CSV file and the same options; what they write is compared, number by number.
`make test-engine` runs it without a built book.
"""

import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from selenium import webdriver

from d2d.radar import ErrorBudget, Mounting, Track, diagnose, simulate_drive, track
from d2d.radar.cli import main
from d2d.radar.tracks.finding import FindingWarning
from d2d.radar.tracks.limits import VehicleLimits
from d2d.radar.tracks.rounds import MAX_INTERVAL
from tests.book import browser
from tests.book.logs import EXACT, SHARED, Case, Sensors, assert_same_files, several

LABS = Path(__file__).resolve().parents[2] / "_static" / "labs"
SCRIPTS = ("engine.js", "tracker.js", "findings.js")
TRACK = """const [text, options, judged] = arguments;
const log = tracker.readRows(new TextEncoder().encode(text).buffer, "log.csv");
const steps = tracker.track(log, {...tracker.DEFAULTS, ...options});
for (;;) {
  const {done, value} = steps.next();
  if (done) return judged ? findings.diagnose(value) : {
    tum: tracker.tumOf(value.rows),
    table: tracker.tableOf(value.rows),
    reasons: value.rows.map((row) => row.reason),
    inliers: value.rows.map((row) => row.inliers),
    targets: value.rows.map((row) => row.targets),
  };
}"""


@pytest.fixture(scope="module")
def page(driver: webdriver.Chrome, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Runs a script with its arguments in a page that has loaded what a track needs."""
    folder = tmp_path_factory.mktemp("tracker")
    loaded = "".join(f'<script src="{name}"></script>' for name in SCRIPTS)
    for name in SCRIPTS:
        (folder / name).write_bytes((LABS / name).read_bytes())
    text = f'<!doctype html><link rel="icon" href="data:,">{loaded}'
    (folder / "page.html").write_text(text, encoding="utf-8")
    driver.set_script_timeout(300)
    with browser.serve(folder) as address:
        driver.get(f"{address}page.html")
        yield driver.execute_script
    driver.set_script_timeout(60)


def example() -> Case:
    """The log that the command line writes itself."""
    drive = simulate_drive(np.random.default_rng(0), duration=60.0)
    return Case({"radar": (drive.scans, drive.mounting)})


def together() -> Case:
    return Case(several())


def with_budget() -> Case:
    words = [word for name, value in SHARED.items() for word in (f"--budget-{name}", f"{value}")]
    settings = {"horizon": 0.3, "budget": SHARED}
    return Case(several(), [*words, "--horizon", "0.3"], settings)


def in_trouble() -> Case:
    """A clock that jumps, a gap, targets given twice, a frozen sensor, hardly any targets."""
    drive = simulate_drive(np.random.default_rng(3), duration=20.0)
    scans = [*drive.scans[:60], *drive.scans[75:]]
    scans[20] = scans[20][[*range(scans[20].size), *range(scans[20].size)]]
    scans[30] = replace(scans[29], time=scans[30].time)
    scans[40] = scans[40][:3]
    scans[100:] = [replace(scan, time=scan.time - 1000.0) for scan in scans[100:]]
    words = (
        "--baseline 2 --side-slip 0.05 --max-acceleration 3 --extent 0.05 --budget-lag 0.1 "
        "--sigma-range 0.2 --sigma-azimuth 0.6 --sigma-doppler 0.07"
    )
    settings = {
        "baseline": 2,
        "sideSlip": 0.05,
        "maxAcceleration": 3.0,
        "extent": 0.05,
        "sigmas": {"range": 0.2, "azimuth": 0.6, "doppler": 0.07},
        "budget": {**SHARED, **dict.fromkeys(SHARED, 0.0), "lag": 0.1},
    }
    return Case({"radar": (scans, drive.mounting)}, words.split(), settings)


def few_targets() -> Case:
    """No side slip at all, few targets and few scans."""
    drive = simulate_drive(np.random.default_rng(5), duration=3.0)
    few = [scan[:7] for scan in drive.scans]
    return Case({"7": (few, drive.mounting)}, ["--side-slip", "0"], {"sideSlip": 0.0})


CASES = {
    "example": example,
    "several": together,
    "budget": with_budget,
    "trouble": in_trouble,
    "few targets": few_targets,
}


def settings_of(case: Case) -> dict[str, Any]:
    """The options as the page takes them."""
    places = {
        name: dict(zip(("x", "y", "yaw"), at, strict=True)) for name, at in case.places.items()
    }
    return {"mountings": places, **case.settings}


@pytest.mark.parametrize("name", CASES)
def test_the_browser_writes_what_the_command_line_writes(page: Any, name: str, tmp_path: Path):
    case = CASES[name]()
    log, prefix = tmp_path / "log.csv", tmp_path / "drive"
    log.write_text(case.text)
    words = ["track", "--csv", str(log), "--output", str(prefix), *case.words]
    for sensor, at in case.places.items():
        words += ["--mounting", sensor, *map(repr, at)]
    assert main([*words, "--no-picture", "--no-progress", "--force"]) == 0
    got = page(TRACK, case.text, settings_of(case), False)
    (tmp_path / "browser.tum").write_text(got["tum"])
    (tmp_path / "browser_velocities.txt").write_text(got["table"])
    assert_same_files(prefix, tmp_path / "browser")
    expected = Track.load(tmp_path / "drive.npz")
    assert got["reasons"] == expected.reasons.tolist()
    assert got["targets"] == expected.targets.tolist()
    unknown = [np.nan if each is None else each for each in got["inliers"]]
    np.testing.assert_allclose(unknown, expected.inliers, atol=EXACT)


def test_the_defaults_are_those_of_the_command_line(page: Any):
    own = page("return tracker.DEFAULTS")
    assert own["maxAcceleration"] == VehicleLimits().acceleration
    assert own["maxInterval"] == MAX_INTERVAL
    assert own["budget"] == {name: getattr(ErrorBudget(), name) for name in own["budget"]}


# ---- Symptoms ------------------------------------------------------------------------------------


def changed(sensors: Sensors, name: str, **factors: float) -> Sensors:
    """The log with some columns of a sensor multiplied."""
    scans, at = sensors[name]
    wrong = [
        replace(scan, **{key: factor * getattr(scan, key) for key, factor in factors.items()})
        for scan in scans
    ]
    return {**sensors, name: (wrong, at)}


def alone(**factors: float) -> Sensors:
    """One sensor with some columns multiplied."""
    drive = simulate_drive(np.random.default_rng(1), duration=12.0, mounting=Mounting(0.4))
    return changed({"radar": (drive.scans, drive.mounting)}, "radar", **factors)


def at(sensors: Sensors, **places: Mounting) -> Sensors:
    """The log with other mountings."""
    return {name: (scans, places.get(name, own)) for name, (scans, own) in sensors.items()}


def folded() -> Sensors:
    """Doppler velocities beyond 4 m/s come out on the other side."""
    ((name, (scans, mounting)),) = alone(doppler=2.0).items()
    wrong = [replace(scan, doppler=(scan.doppler + 4.0) % 8.0 - 4.0) for scan in scans]
    return {name: (wrong, mounting)}


def to_the_side() -> Sensors:
    """A single radar far ahead of the axle that looks aside."""
    corner = Mounting(3.6, 0.4, 1.5)
    return {"left": (simulate_drive(np.random.default_rng(2), 12.0, mounting=corner).scans, corner)}


MISTAKES = {
    "none": lambda: alone(),
    "opposite sign": lambda: alone(doppler=-1.0),
    "km/h": lambda: alone(doppler=3.6),
    "at rest": lambda: alone(doppler=0.01),
    "cm": lambda: alone(range=100.0, sigma_range=100.0),
    "rad as degrees": lambda: alone(azimuth=np.pi / 180, sigma_azimuth=np.pi / 180),
    "folded": folded,
    "turned": lambda: at(alone(), radar=Mounting(0.4, 0.0, 0.1)),
    "backwards": lambda: at(alone(), radar=Mounting(0.4, 0.0, np.pi)),
    "to the side": to_the_side,
    "two": lambda: several(),
    "one turned of two": lambda: at(several(), aside=Mounting(-0.3, 0.4, 1.6)),
    "swapped": lambda: at(several(), ahead=several()["aside"][1], aside=several()["ahead"][1]),
    "clockwise": lambda: changed(several(), "aside", azimuth=-1.0),
    "late": lambda: several(60.0, 0.4),
}


CORRECT = ("none", "two")


@pytest.mark.parametrize("name", MISTAKES)
def test_symptoms_are_told_as_in_python(page: Any, name: str):
    """Breaks if a mistake is called by another name, or where Python sees none."""
    case = Case(MISTAKES[name]())
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", UserWarning)
        driven = track(case.sensors, budget=ErrorBudget(), progress=False)
    expected = [each.message.finding for each in said if isinstance(each.message, FindingWarning)]
    judged = diagnose(case.sensors, driven)
    got = page(TRACK, case.text, settings_of(case), True)
    plain = [each.sensor.removeprefix("sensors['").removesuffix("'].scans") for each in expected]
    names = [*plain, *(each.sensor for each in judged.findings)]
    assert [each["sensor"] for each in got["found"]] == names
    assert bool(names) == (name not in CORRECT)
    expected += judged.findings
    for key in ("symptom", "unit", "sure", "about"):
        assert [each[key] for each in got["found"]] == [getattr(each, key) for each in expected]
    numbers = [each["number"] for each in got["found"]]
    np.testing.assert_allclose(numbers, [each.number for each in expected], rtol=1e-5)
    shares = [np.nan if each is None else each for each in got["inliers"]]
    np.testing.assert_allclose(shares, [*judged.inliers.values()], atol=EXACT)
