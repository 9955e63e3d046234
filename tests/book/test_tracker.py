"""The track of a log in a real browser has the numbers that d2d has for the same log.

One table of logs, each with what d2d makes of it; one of logs that are refused; and the laboratory
itself, by hand, from a folder and from a server.  No built book is needed.
"""

import re
import shlex
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas
import pytest
from selenium import webdriver
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from d2d.radar import ErrorBudget, Mounting, RadarScan, Track, load_csv, simulate_drive, track
from d2d.radar.cli import main
from d2d.radar.readers.table import USUAL
from tests.book import browser, test_labs
from tools import laboratories

LABS = Path(__file__).resolve().parents[2] / "_static" / "labs"
SCRIPTS = ("engine", "kit", *laboratories.NEEDED["log"], "log")
PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>A log</title>
<link rel="icon" href="data:,"><link rel="stylesheet" href="labs.css">{scripts}
<body><div class="lab" data-lab="log" data-symptoms="when.html">It needs JavaScript.</div></html>"""
SIGMAS = ("sigma_range", "sigma_azimuth", "sigma_doppler")
COLUMNS = ("range", "azimuth", "doppler", *SIGMAS)
BUDGET = {"azimuth": 0.1, "doppler": 0.04, "scale": 0.002, "lag": 0.02, "neighbours": 1.0}
EXACT = 1e-6
TRACK = """const [text, settings] = arguments;
const log = tracker.readLog(text, "log.csv");
const steps = tracker.track(log, {...tracker.DEFAULTS, ...settings});
for (;;) {
  const {done, value} = steps.next();
  const {rows} = value ?? {};
  if (done) return {...value, poses: tracker.posesOf(rows), support: tracker.supportOf(rows)};
}"""

Sensors = dict[str, tuple[Sequence[RadarScan], Mounting]]


class Log(NamedTuple):
    """The sensors of a log, and the settings of the page."""

    sensors: Sensors
    budget: dict[str, float] = {}  # noqa: RUF012 - nothing changes it
    sigmas: dict[str, float] = {}  # noqa: RUF012
    """Of all targets, in place of the columns; in m, degrees and m/s."""

    @property
    def mountings(self) -> dict[str, dict[str, float]]:
        """The mountings in m, m, degrees."""
        return {
            name: {"x": at.x, "y": at.y, "yaw": float(np.rad2deg(at.yaw))}
            for name, (_, at) in self.sensors.items()
        }

    @property
    def text(self) -> str:
        """The CSV file, its lines in the order of time."""
        columns = [name for name in COLUMNS if name not in self.sigmas]
        scans = [(scan.time, name, scan) for name, (own, _) in self.sensors.items() for scan in own]
        lines = [",".join(["sensor", "time", *columns])]
        for time, sensor, scan in sorted(scans, key=lambda scan: scan[:2]):
            rows = np.column_stack([getattr(scan, name) for name in columns]).tolist()
            lines += [",".join([sensor, repr(time), *map(repr, row)]) for row in rows]
        return "\n".join(lines)


def one(duration: float = 4.0, seed: int = 1) -> Sensors:
    drive = simulate_drive(np.random.default_rng(seed), duration)
    return {"radar": (drive.scans, drive.mounting)}


def chosen(change: Callable[[list[RadarScan]], list[RadarScan]], *given: Any) -> Sensors:
    """One radar's log with other scans."""
    ((scans, mounting),) = one(*given).values()
    return {"radar": (change(list(scans)), mounting)}


def changed(change: Callable[[RadarScan], RadarScan]) -> Sensors:
    """One radar's log in which one scan is another."""
    return chosen(lambda scans: [*scans[:15], change(scans[15]), *scans[16:]])


def four(duration: float = 4.0) -> Sensors:
    """Four radars of different rates on one vehicle, which do not run in step."""
    mountings = {
        "front": Mounting(0.4, 0.1, 0.1),
        "left": Mounting(-0.3, 0.4, 1.5),
        "right": Mounting(-0.3, -0.4, -1.4),
        "rear": Mounting(-0.5, 0.0, 3.1),
    }
    sensors: Sensors = {}
    world = None
    for number, (name, at) in enumerate(mountings.items()):
        rng = np.random.default_rng(0)
        drive = simulate_drive(rng, duration, mounting=at, world=world)
        world = drive.world
        scans = [replace(scan, time=scan.time + 0.02 * number) for scan in drive.scans]
        kept = [scan for k, scan in enumerate(scans) if number < 2 or k % (number + 1)]
        sensors[name] = (kept, at)
    return sensors


FEW = (*range(14), 24, 25, 26, 40)  # scans in which a radar sees little
LOGS: dict[str, Callable[[], Log]] = {
    "one radar": lambda: Log(one()),
    "one radar with a budget": lambda: Log(one(), BUDGET),
    "four radars": lambda: Log(four()),
    "four radars with a budget": lambda: Log(four(), BUDGET),
    # of 0.4 s, over which the next scan is paired, of 0.6 s, and of 1.6 s
    "gaps": lambda: Log(chosen(lambda s: [*s[:15], *s[18:25], *s[30:35], *s[50:]], 6.0)),
    "a gap before one scan": lambda: Log(chosen(lambda scans: [*scans[:40], scans[-1]], 6.0)),
    "refused at first": lambda: Log(
        chosen(lambda scans: [s[:3] if k in FEW else s for k, s in enumerate(scans)], 6.0)
    ),
    "refused in all": lambda: Log(chosen(lambda scans: [scan[:3] for scan in scans], 1.0)),
    "a repeated scan": lambda: Log(
        chosen(lambda s: [*s[:15], replace(s[14], time=s[15].time), *s[16:]])
    ),
    "targets twice": lambda: Log(changed(lambda scan: scan[[*range(scan.size)] * 2])),
    "a scan with three targets": lambda: Log(changed(lambda scan: scan[:3])),
    "a scan of something else": lambda: Log(
        changed(lambda scan: replace(scan, azimuth=-scan.azimuth, doppler=-scan.doppler))
    ),
    "few targets": lambda: Log(chosen(lambda scans: [scan[:7] for scan in scans], 3.0, 5)),
    "no standard deviations": lambda: Log(
        one(), BUDGET, {"sigma_range": 0.2, "sigma_azimuth": 0.6, "sigma_doppler": 0.07}
    ),
}
LEFT_OUT = ("a gap before one scan", "a repeated scan", "targets twice")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the page and its scripts."""
    folder = tmp_path_factory.mktemp("log")
    for file in LABS.iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
    (folder / "example.js").write_text(laboratories.example_script(), encoding="utf-8")
    scripts = "".join(f'<script defer src="{name}.js"></script>' for name in SCRIPTS)
    (folder / "page.html").write_text(PAGE.format(scripts=scripts), encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def site(folder: Path, driver: webdriver.Chrome) -> Iterator[str]:
    driver.set_script_timeout(300)
    with browser.serve(folder) as address:
        yield f"{address}page.html"
    driver.set_script_timeout(60)


@pytest.mark.filterwarnings("ignore")  # d2d says what it leaves out
@pytest.mark.parametrize("name", LOGS)
def test_numbers_are_those_of_d2d(driver: webdriver.Chrome, site: str, name: str, tmp_path: Path):
    """Rounds, refusals, velocities, covariances and the path, to a millionth."""
    log, file = LOGS[name](), tmp_path / "log.csv"
    file.write_text(log.text)
    angles = ("sigma_azimuth", "azimuth")
    sigmas, shared = (
        {key: np.deg2rad(value) if key in angles else value for key, value in given.items()}
        for given in (log.sigmas, log.budget)
    )
    sensors = {key: (own, log.sensors[key][1]) for key, own in load_csv(file, **sigmas).items()}
    expected = track(sensors, budget=ErrorBudget(**shared))
    driver.get(site)
    settings = {"mountings": log.mountings, "sigmas": log.sigmas}
    if log.budget:
        settings["budget"] = log.budget
    shown = driver.execute_script(TRACK, log.text, settings)
    rows = {key: [row[key] for row in shown["rows"]] for key in shown["rows"][0]}
    assert rows["reason"] == expected.reasons.tolist()
    assert rows["targets"] == expected.targets.tolist()
    np.testing.assert_array_equal(rows["time"], expected.times)
    np.testing.assert_array_equal(rows["interval"], expected.intervals)
    np.testing.assert_allclose(rows["theta"], expected.theta, atol=EXACT)
    np.testing.assert_allclose(known(rows["inliers"]), expected.inliers, atol=EXACT)
    sigma = np.sqrt(np.diagonal(expected.covariance, axis1=1, axis2=2))
    scale = sigma[:, :, None] * sigma[:, None, :]
    covariance = known(rows["covariance"])
    np.testing.assert_allclose(covariance / scale, expected.covariance / scale, atol=EXACT)
    np.testing.assert_allclose(shown["poses"], expected.poses(), atol=EXACT)
    assert shown["support"] == pytest.approx(expected.support.share, abs=EXACT)
    assert ["left out" in doubt for doubt in shown["doubts"]] == [True] * LEFT_OUT.count(name)


def known(values: Any) -> Any:
    """An array of what JavaScript gave, in which nan is null."""
    return np.array(values, dtype=float)


def wrong(line: int, column: int, word: str) -> str:
    """A log with one cell that is wrong."""
    rows = [line.split(",") for line in Log(one(1.0)).text.splitlines()]
    rows[line - 1][column] = word
    return "\n".join(map(",".join, rows))


def scaled(column: int, factor: float) -> str:
    """A log with a column in another unit."""
    head, *rows = [line.split(",") for line in Log(one(1.0)).text.splitlines()]
    for row in rows:
        row[column] = repr(factor * float(row[column]))
    return "\n".join(map(",".join, [head, *rows]))


REFUSED = {
    "nothing": ("", "log.csv is empty"),
    "other columns": ("a,b\n1,2", "log.csv, line 1: .* columns time, range, azimuth, doppler"),
    "no target": ("time,range,azimuth,doppler\n", "log.csv has no line with a target"),
    "a short line": ("time,range,azimuth,doppler\n1,2,3", "line 2: .* 4 values .* are 3"),
    "no name": (wrong(7, 0, " "), "line 7: sensor .* is empty"),
    "a word": (wrong(5, 3, "left"), "line 5: azimuth must be a number.*'left'"),
    "a negative range": (wrong(6, 2, "-3"), "line 6: range must be positive, but is -3"),
    "nan": (wrong(9, 4, "nan"), "line 9: doppler must be finite"),
    "no uncertainty": (wrong(4, 5, "0"), "line 4: sigma_range must be positive"),
    "a decimal comma": (
        wrong(4, 2, "@").replace(",", ";").replace("@", "7,25"),
        "line 4: range must be a number, with a decimal point, but is '7,25'",
    ),
    "decimal commas": ("time,range,azimuth,doppler\n0,1,7,25,0,1,2,5", "line 2: .* are 8"),
    "degrees": (scaled(3, 180.0 / np.pi), "azimuth must be in radians.*--degrees"),
    "milliseconds": (scaled(1, 1e3), "are these nano-, milli- or microseconds"),
    "millimetres": (scaled(2, 1e3), "range must be in m.*are these millimetres"),
    "a step back": (wrong(9, 1, "-2"), r"line 9: the time of radar steps back .*command line"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_wrong_with_a_log_is_named(driver: webdriver.Chrome, site: str, name: str):
    """Breaks if a reader is not told which line and which column to mend."""
    text, complaint = REFUSED[name]
    driver.get(site)
    script = "try { tracker.readLog(arguments[0], 'log.csv') } catch (e) { return e.message }"
    assert re.search(complaint, driver.execute_script(script, text))


def mistaken(mounting: float = 0.0, **factors: float) -> Log:
    """A radar whose columns are multiplied, or whose yaw is stated wrongly by an angle in rad."""
    ((scans, at),) = one().values()
    own = [
        replace(scan, **{name: factor * getattr(scan, name) for name, factor in factors.items()})
        for scan in scans
    ]
    return Log({"radar": (own, replace(at, yaw=at.yaw + mounting))})


DOUBTS = {
    "centimetres": (lambda: mistaken(range=100.0), "centimetres"),
    "opposite sign": (lambda: mistaken(doppler=-1.0), "backwards"),
    "a mounting that is turned": (lambda: mistaken(mounting=1.0), "from straight ahead"),
    "too precise": (lambda: mistaken(sigma_azimuth=np.pi / 180.0), "radians"),
    "too coarse": (lambda: mistaken(sigma_azimuth=180.0 / np.pi), "degrees"),
    "a time for each target": (
        lambda: Log(chosen(lambda scans: [scan[:1] for scan in scans])),
        "the same time",
    ),
}


@pytest.mark.parametrize("name", DOUBTS)
def test_what_the_text_of_a_log_shows_is_said(driver: webdriver.Chrome, site: str, name: str):
    log, word = DOUBTS[name]
    driver.get(site)
    shown = driver.execute_script(TRACK, log().text, {"mountings": log().mountings})
    assert [word in doubt for doubt in shown["doubts"]] == [True]


class Hand(test_labs.Hand):
    """Works the laboratory as a reader does."""

    def __init__(self, driver: webdriver.Chrome, folder: Path) -> None:
        super().__init__(driver, test_labs.Laboratory("", "lab-log", "", "", ""))
        self.folder = folder

    def open(self, address: str) -> None:
        """Load the page afresh."""
        self.driver.get("about:blank")
        browser.drain(self.driver)
        self.driver.get(address)
        browser.wait(self.driver, "return Boolean(window.labs?.all['lab-log'])")

    def text(self, selector: str) -> str:
        return " ".join(self.find(selector).text.split())

    def press(self, label: str) -> None:
        """Press a button with the keyboard."""
        self.button(label).send_keys(Keys.ENTER)

    def choose(self, log: Log, name: str = "log.csv") -> None:
        (self.folder / name).write_text(log.text)
        self.find("input[type=file]").send_keys(str(self.folder / name))
        self.fill(log, name)

    def fill(self, log: Log, name: str) -> None:
        """Type where the sensors sit and what else the file does not say, once it is read."""
        self.wait(f"lab.element.querySelector('[role=status]').textContent.startsWith('{name}: ')")
        if log.budget:
            self.find("form summary").send_keys(Keys.ENTER)
        places = [value for at in log.mountings.values() for value in at.values()]
        inputs = self.driver.find_elements(By.CSS_SELECTOR, "#lab-log form input")
        values = [*places, *log.sigmas.values(), *log.budget.values()]
        for field, value in zip(inputs, values, strict=False):
            field.clear()
            field.send_keys(repr(value))

    def wait(self, condition: str) -> None:
        browser.wait(self.driver, f"const lab = labs.all['lab-log']; return {condition}", 120)

    def estimate(self) -> None:
        self.press("Estimate the track")
        self.wait("Boolean(lab.result)")

    def save(self, name: str) -> Path:
        """Press a button and wait for its file."""
        file = self.folder / "saved" / name
        self.press(f"Save {name}")
        for _ in range(100):
            if file.exists():
                break
            self.driver.execute_async_script("setTimeout(arguments[0], 100)")
        return file


@pytest.fixture
def hand(driver: webdriver.Chrome, tmp_path: Path, site: str) -> Hand:
    """A hand on the served page; what it saves is in a folder of its own."""
    allowed = {"behavior": "allow", "downloadPath": str(tmp_path / "saved")}
    driver.execute_cdp_cmd("Browser.setDownloadBehavior", allowed)
    browser.resize(driver, browser.WIDE)
    hand = Hand(driver, tmp_path)
    hand.open(site)
    return hand


def assert_saved_as_the_command_says(hand: Hand) -> None:
    """The command that the page shows gives the same path and velocities."""
    command = hand.text(".lab-report .lab-command").removeprefix("python -m d2d.radar ")
    words = shlex.split(command)
    place = words.index("--csv") + 1
    words[place] = str(hand.folder / words[place])
    quiet = ["--no-picture", "--no-progress", "--force", "--output", str(hand.folder / "drive")]
    assert main([*words, *quiet]) == 0
    paths = [np.loadtxt(file) for file in (hand.save("track.tum"), hand.folder / "drive.tum")]
    np.testing.assert_allclose(*paths, atol=EXACT)
    saved = pandas.read_csv(hand.save("track.csv"))
    expected = Track.load(hand.folder / "drive.npz").to_dataframe()
    np.testing.assert_array_equal(saved["converged"], expected["converged"])
    for name in ("v_x", "v_y", "omega"):
        np.testing.assert_allclose(saved[name], expected[name], atol=EXACT)
    for name in expected.columns[6:12]:
        np.testing.assert_allclose(saved[name], expected[name], rtol=1e-5, atol=1e-12)


@pytest.mark.parametrize("place", ["folder", "server"])
def test_the_example_is_that_of_the_command_line(hand: Hand, folder: Path, place: str):
    """Breaks if a page that is opened from a folder cannot make a worker or load the example."""
    if place == "folder":
        hand.open((folder / "page.html").as_uri())
    hand.press("Load the example")
    hand.wait("Boolean(lab.result)")
    assert main(["example", str(hand.folder / "example.csv")]) == 0
    assert_saved_as_the_command_says(hand)
    complaints, *_ = browser.traffic(hand.driver, hand.driver.current_url)
    assert complaints == []


def test_every_field_reaches_the_numbers(hand: Hand):
    sigmas = {"sigma_range": 0.2, "sigma_azimuth": 0.6, "sigma_doppler": 0.07}
    hand.choose(Log(four(2.0), BUDGET, sigmas))
    hand.estimate()
    assert_saved_as_the_command_says(hand)


def test_a_wrong_sign_is_mended_by_a_button(hand: Hand):
    """Breaks if the cure leaves the doubt, or the command that is shown does not have it."""
    hand.choose(mistaken(doppler=-1.0))
    hand.estimate()
    assert "backwards" in hand.text(".lab-doubt")
    hand.press("Flip the sign and run again")
    hand.wait("lab.result?.doubts.length === 0")
    assert "good" in hand.find(".lab-verdict").get_attribute("class")
    assert_saved_as_the_command_says(hand)


def test_a_radar_is_dragged_to_its_place(hand: Hand):
    """Breaks if the picture of the vehicle and the fields do not say the same."""
    log = Log(one(1.0), {}, {"sigma_range": 0.2, "sigma_azimuth": 0.6, "sigma_doppler": 0.07})
    hand.choose(log)
    x, _, yaw, *sigmas = hand.driver.find_elements(By.CSS_SELECTOR, "#lab-log form input")
    before = [float(field.get_attribute("value") or "0") for field in (x, yaw)]
    hand.find("[aria-label='The radar radar']").send_keys(Keys.ARROW_RIGHT)
    hand.find("[aria-label='The direction of radar']").send_keys(Keys.ARROW_UP)
    after = [float(field.get_attribute("value") or "0") for field in (x, yaw)]
    assert after[0] == pytest.approx(before[0] + 0.05)
    assert after[1] > before[1]
    hand.press("Use typical values")
    shown = [float(field.get_attribute("value") or "0") for field in sigmas[:3]]
    usual = USUAL | {"sigma_azimuth": np.rad2deg(USUAL["sigma_azimuth"])}
    assert shown == pytest.approx([usual[name] for name in SIGMAS])


DROP = """const [text, name] = arguments, carried = new DataTransfer();
carried.items.add(new File([text], name));
document.querySelector(".lab-drop").dispatchEvent(
  new DragEvent("drop", {dataTransfer: carried, bubbles: true, cancelable: true}));"""


def test_a_log_is_dropped_and_nothing_leaves(hand: Hand):
    """Breaks if anything is asked for after the page has loaded."""
    begun = hand.driver.execute_script("return performance.now()")
    log = Log(one(1.0))
    hand.driver.execute_script(DROP, log.text, "dropped.csv")
    hand.fill(log, "dropped.csv")
    hand.estimate()
    asked = """return performance.getEntriesByType('resource')
      .filter((each) => each.startTime > arguments[0] && !each.name.startsWith('blob:'))
      .map((each) => each.name);"""
    assert hand.driver.execute_script(asked, begun) == []
