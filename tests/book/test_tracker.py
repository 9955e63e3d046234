"""The track of a log in a real browser is that of the command line on the same file, to 1e-6.

Breaks if a round, a limit, a part of the covariance or a column of the files differs.
Both get the same CSV file and the same options; what they write is compared, number by number.
`make test-engine` runs it without a built book.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from selenium import webdriver

from d2d.radar import ErrorBudget, Track, simulate_drive
from d2d.radar.cli import main
from d2d.radar.tracks.limits import VehicleLimits
from d2d.radar.tracks.rounds import MAX_INTERVAL
from tests.book import browser
from tests.book.logs import EXACT, SHARED, Case, assert_same_files

LABS = Path(__file__).resolve().parents[2] / "_static" / "labs"
SCRIPTS = ("engine.js", "tracker.js")
TRACK = """const [text, options] = arguments;
const log = tracker.readRows(new TextEncoder().encode(text).buffer, "log.csv");
const steps = tracker.track(log, {...tracker.DEFAULTS, ...options});
for (;;) {
  const {done, value} = steps.next();
  if (done) return {
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


def in_trouble() -> Case:
    """A clock that jumps, a wrong stamp, a gap, targets twice, a frozen sensor, few targets."""
    drive = simulate_drive(np.random.default_rng(3), duration=20.0)
    scans = [*drive.scans[:60], *drive.scans[75:]]
    scans[20] = scans[20][[*range(scans[20].size), *range(scans[20].size)]]
    scans[30] = replace(scans[29], time=scans[30].time)
    scans[40] = scans[40][:3]
    scans[50] = replace(scans[50], time=scans[50].time + 100.0)
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


CASES = {"trouble": in_trouble, "few targets": few_targets}


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
    got = page(TRACK, case.text, settings_of(case))
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
