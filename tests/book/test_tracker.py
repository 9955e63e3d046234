"""The track of a log in a real browser is that of the command line on the same file, to 1e-6.

Breaks if a round, a limit, a part of the covariance or a column of the files differs.  Both get the
same CSV file and the same options; what they write is compared, number by number.  `make
test-engine` runs it without a built book.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from selenium import webdriver

from d2d.radar import Mounting, RadarScan, Track, simulate_drive
from d2d.radar.cli import main
from d2d.radar.scans.budget import ErrorBudget
from d2d.radar.tracks.limits import VehicleLimits
from d2d.radar.tracks.rounds import MAX_INTERVAL
from tests.book import browser

LABS = Path(__file__).resolve().parents[2] / "_static" / "labs"
PAGE = """<!doctype html><link rel="icon" href="data:,">
<script src="engine.js"></script><script src="tracker.js"></script>"""
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
SHARED = {"azimuth": 0.1, "doppler": 0.04, "scale": 0.002, "lag": 0.02, "neighbours": 1.0}
AHEAD, ASIDE = Mounting(0.4, 0.1, 0.1), Mounting(-0.3, 0.4, 1.5)
COLUMNS = ("range", "azimuth", "doppler", "sigma_range", "sigma_azimuth", "sigma_doppler")
EXACT = 1e-6


@pytest.fixture(scope="module")
def page(driver: webdriver.Chrome, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Runs a script with its arguments in a page that has loaded the engine and the tracker."""
    folder = tmp_path_factory.mktemp("tracker")
    for name in ("engine.js", "tracker.js"):
        (folder / name).write_bytes((LABS / name).read_bytes())
    (folder / "page.html").write_text(PAGE, encoding="utf-8")
    driver.set_script_timeout(300)
    with browser.serve(folder) as address:
        driver.get(f"{address}page.html")
        yield driver.execute_script
    driver.set_script_timeout(60)


class Case(NamedTuple):
    """A log, and the options of both programs: ``words`` of one, ``settings`` of the other."""

    sensors: dict[str, tuple[Sequence[RadarScan], Mounting]]
    words: Sequence[str] = ()
    settings: dict[str, Any] = {}  # noqa: RUF012 - nothing changes it


def example() -> Case:
    """The log that the command line writes itself."""
    drive = simulate_drive(np.random.default_rng(0), duration=60.0)
    return Case({"radar": (drive.scans, drive.mounting)})


def several(shift: float = 0.03) -> dict[str, tuple[Sequence[RadarScan], Mounting]]:
    """Two sensors of different rates on one vehicle, which do not run in step."""
    ahead = simulate_drive(np.random.default_rng(0), duration=20.0, mounting=AHEAD)
    aside = simulate_drive(np.random.default_rng(0), 20.0, mounting=ASIDE, world=ahead.world)
    late = [replace(scan, time=scan.time + shift) for scan in aside.scans]
    return {"ahead": (ahead.scans, AHEAD), "aside": (late[1::3] + late[2::3], ASIDE)}


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


def standing() -> Case:
    """No side slip at all, few targets and few scans."""
    drive = simulate_drive(np.random.default_rng(5), duration=3.0)
    few = [scan[:7] for scan in drive.scans]
    return Case({"7": (few, drive.mounting)}, ["--side-slip", "0"], {"sideSlip": 0.0})


CASES = {
    "example": example,
    "several": together,
    "budget": with_budget,
    "trouble": in_trouble,
    "few targets": standing,
}


def written(case: Case) -> str:
    """The log as text, each sensor's scans in the order given: `write_csv` would sort them."""
    lines = [",".join(["sensor", "time", *COLUMNS])]
    for sensor, (scans, _) in case.sensors.items():
        for scan in scans:
            columns = [getattr(scan, name).tolist() for name in COLUMNS]
            rows = zip(*columns, strict=True)
            lines += [",".join([sensor, repr(scan.time), *map(repr, row)]) for row in rows]
    return "\n".join(lines)


def tracked(page: Any, case: Case, folder: Path) -> tuple[Track, dict[str, Any]]:
    """What the command line wrote, and the texts of the browser beside it."""
    log = folder / "log.csv"
    log.write_text(written(case))
    words, mountings = [*case.words], {}
    for name, (_, at) in case.sensors.items():
        degrees = float(np.rad2deg(at.yaw))
        words += ["--mounting", name, f"{at.x!r}", f"{at.y!r}", f"{degrees!r}"]
        mountings[name] = {"x": at.x, "y": at.y, "yaw": degrees}
    quiet = ["--no-picture", "--no-progress", "--force", "--output", str(folder / "drive")]
    assert main(["track", "--csv", str(log), *words, *quiet]) == 0
    got = page(TRACK, log.read_text(), {"mountings": mountings, **case.settings})
    for name, end in (("tum", "drive.tum"), ("table", "drive_velocities.txt")):
        (folder / f"browser-{end}").write_text(got[name])
    return Track.load(folder / "drive.npz"), got


@pytest.mark.parametrize("name", CASES)
def test_the_browser_writes_what_the_command_line_writes(page: Any, name: str, tmp_path: Path):
    """Velocities to 1e-6 m/s and rad/s, covariances and their parts to 1e-6 of the sigmas."""
    expected, got = tracked(page, CASES[name](), tmp_path)
    assert got["reasons"] == expected.reasons.tolist()
    assert got["targets"] == expected.targets.tolist()
    unknown = [np.nan if each is None else each for each in got["inliers"]]
    np.testing.assert_allclose(unknown, expected.inliers, atol=EXACT)
    found = Track.read_velocities(tmp_path / "browser-drive_velocities.txt")
    np.testing.assert_array_equal(found.times, expected.times)
    np.testing.assert_array_equal(found.intervals, expected.intervals)
    np.testing.assert_allclose(found.theta, expected.theta, atol=EXACT)
    sigmas = np.sqrt(np.diagonal(expected.covariance, axis1=1, axis2=2))
    scale = sigmas[:, :, None] * sigmas[:, None, :]
    for own, other in zip(
        (found.covariance, *found.parts), (expected.covariance, *expected.parts), strict=True
    ):
        np.testing.assert_allclose(own / scale, other / scale, atol=EXACT)
    paths = [np.loadtxt(tmp_path / f"{who}drive.tum") for who in ("", "browser-")]
    np.testing.assert_allclose(*paths, atol=EXACT)


def test_the_tables_have_the_same_header(page: Any, tmp_path: Path):
    """Breaks if the command line cannot read the browser's table, or names a column otherwise."""
    tracked(page, standing(), tmp_path)
    own, other = (
        (tmp_path / f"{who}drive_velocities.txt").read_text().splitlines()
        for who in ("", "browser-")
    )
    assert [line for line in own if "#" in line] == [line for line in other if "#" in line]


def test_the_defaults_are_those_of_the_command_line(page: Any):
    own = page("return tracker.DEFAULTS")
    assert own["maxAcceleration"] == VehicleLimits().acceleration
    assert own["maxInterval"] == MAX_INTERVAL
    assert own["budget"] == {name: getattr(ErrorBudget(), name) for name in own["budget"]}
