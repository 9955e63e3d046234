"""The laboratories in the built pages: their numbers are those of d2d, and pointer and keys work.

The numbers of the engine itself are tested in test_engine.py, those of a log in test_tracker.py.
"""

import io
import json
import re
from collections.abc import Iterator
from contextlib import redirect_stdout
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from selenium import webdriver
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement

from d2d import CorruptedGaussian, PointSet, RegistrationCost
from d2d._kernel import layout
from d2d.measurement import LinearMeasurement
from d2d.problem import Pair, Problem
from d2d.registration import anneal
from d2d.study.plane.scenarios import EIGHT_TARGETS, OVERLAPPED
from tests.book import browser

Array = NDArray[np.float64]


class Laboratory(NamedTuple):
    """Where a laboratory is, and what in it can be dragged, slid and pressed."""

    page: str
    id: str
    handle: str
    """Begin of the label of something to drag; empty if there is nothing."""
    slider: str
    button: str


LABS = (
    Laboratory("chapters/02_gaussian_background", "lab-gaussian", "The point", "", "Other draws"),
    Laboratory("intro", "lab-live", "The current scan: move", "", "Register from here"),
    Laboratory(
        "chapters/04_cost_surfaces_1d", "lab-line", "Target C of the cur", "t", "Let the ball roll"
    ),
    Laboratory(
        "chapters/05_outliers_and_clusters_1d", "lab-outlier", "Target O", "noise", "Next draw"
    ),
    Laboratory(
        "chapters/10_outliers_and_clusters_2d",
        "lab-plane",
        "Target F of the cur",
        "turn",
        "Add an outlier",
    ),
    Laboratory(
        "chapters/12_radar_ego_motion", "lab-doppler", "The mover", "vx", "Go to the estimate"
    ),
    Laboratory(
        "chapters/15_true_covariance", "lab-credible", "", "stated", "100 more registrations"
    ),
)
EACH_LAB = pytest.mark.parametrize(
    "lab",
    [pytest.param(lab, id=lab.id, marks=pytest.mark.xdist_group(lab.id)) for lab in LABS],
    scope="module",
)


def only(index: int) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("lab", [LABS[index]], ids=[LABS[index].id])


LINE, PLANE = only(2), only(4)


def optimum(problem: dict[str, Any], start: list[float]) -> Array:
    """Where d2d ends from the same start."""
    line = bool(problem.get("line"))
    own = [slice(0, 1), slice(0, 1)] if line else [slice(0, 2), slice(0, 2)]
    fixed, moving = (point_set(problem[name], line) for name in ("fixed", "moving"))
    model = problem["outlier"]
    if model is not None:
        s = np.array([[model["xx"], model["xy"]], [model["xy"], model["yy"]]])
        model = CorruptedGaussian(model["fraction"], s[tuple(own)])
    form = RegistrationCost(fusion=problem["fusion"], outlier=model).form(1 if line else 2)
    interval = problem.get("interval")
    measurement = None
    if interval is not None and "doppler" in problem["moving"][0]:
        measurement = doppler(problem, interval)
        outlier = form.outlier.copy()
        outlier[layout.LOG_OUTLIER_WEIGHT] -= np.log(problem["dopplerWidth"])
        form = form._replace(outlier=outlier)
    kind = layout.MOTION if interval is None else layout.ARC
    bound = Problem(form, [Pair(fixed, moving, measurement, interval or 1.0)], kind)
    return anneal(bound, np.array(start[: 1 if line else 3])).theta


def point_set(rows: list[dict[str, Any]], line: bool) -> PointSet:
    """Targets of the engine; one that counts several times is repeated."""
    rows = [row for row in rows for _ in range(row.get("count", 1))]
    if line:
        return PointSet([[row["x"]] for row in rows], [[[row["xx"]]] for row in rows])
    means = [[row["x"], row["y"]] for row in rows]
    return PointSet(means, [[[r["xx"], r["xy"]], [r["xy"], r["yy"]]] for r in rows])


def doppler(problem: dict[str, Any], interval: float) -> LinearMeasurement:
    """The Doppler velocities as d2d takes them, of the twist over the interval."""
    rows = [row["doppler"] for row in problem["moving"]]
    of = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    sigmas = np.sqrt(of["variance"]), np.sqrt(of["inputVariance"])
    return LinearMeasurement(
        of["value"], *sigmas, of["gain"] / interval, of["slope"] / interval, of_twist=True
    )


class Hand:
    """Opens a laboratory and works it with real events."""

    def __init__(self, driver: webdriver.Chrome, lab: Laboratory) -> None:
        self.driver, self.lab, self.it = driver, lab, f"labs.all['{lab.id}']"

    def open(self, address: str) -> None:
        """Load the page afresh."""
        browser.resize(self.driver, browser.WIDE)
        self.driver.get("about:blank")
        browser.drain(self.driver)
        self.driver.get(address)
        browser.wait(self.driver, f"return Boolean(window.labs && {self.it}?.result)")
        browser.wait(self.driver, "return document.readyState === 'complete'")
        # a picture that is loaded while one points moves what is below it
        hide = "document.body.insertAdjacentHTML('beforeend', '<style>article img {display: none}')"
        self.driver.execute_script(hide)
        fold = f"{self.it}.element.closest('details')"
        self.driver.execute_script(f"if ({fold}) {fold}.open = true")

    def view(self, query: str) -> None:
        """Set the laboratory by the page's address, as a link of the text does."""
        script = """const [hash, done] = arguments;
          if (location.hash === hash) done();
          addEventListener('hashchange', () => done(), {once: true});
          location.hash = hash;"""
        self.driver.execute_async_script(script, f"#{self.lab.id}?{query}")

    def less_motion(self) -> None:
        """Set the system to less motion: what rolls is there at once."""
        feature = {"name": "prefers-reduced-motion", "value": "reduce"}
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})

    def ask(self, expression: str) -> Any:
        """Something of the laboratory, once it is drawn, for the window's new size, too."""
        script = """const [id, done] = arguments, lab = labs.all[id];
        const rest = () => (lab.waiting ? requestAnimationFrame(rest) : done(JSON.stringify(%s)));
        requestAnimationFrame(() => requestAnimationFrame(rest));"""
        return json.loads(self.driver.execute_async_script(script % expression, self.lab.id))

    def find(self, selector: str) -> WebElement:
        """An element of the laboratory, scrolled to the middle of the window."""
        found = self.driver.find_element(By.CSS_SELECTOR, f"#{self.lab.id} {selector}")
        self.driver.execute_script(
            "arguments[0].scrollIntoView({block: 'center', behavior: 'instant'})", found
        )
        return found

    def middle(self, element: WebElement) -> tuple[float, float]:
        """The middle of an element in the window, px."""
        box = "const b = arguments[0].getBoundingClientRect();"
        x, y = self.driver.execute_script(
            f"{box} return [b.x + b.width / 2, b.y + b.height / 2]", element
        )
        return x, y

    def drag(self, kind: str, element: WebElement, dx: float, dy: float) -> None:
        """Drag by some pixels, with the mouse or with a finger."""
        grip = element.find_elements(By.CSS_SELECTOR, ".lab-reach") or [element]
        x, y = self.middle(grip[0])
        for share, event in ((0.0, "down"), (0.5, "move"), (1.0, "move"), (1.0, "up")):
            self.point(kind, event, x + share * dx, y + share * dy)

    def point(self, kind: str, event: str, x: float, y: float) -> None:
        if kind == "mouse":
            names = {"down": "mousePressed", "move": "mouseMoved", "up": "mouseReleased"}
            pressed = {"button": "left", "buttons": 1, "clickCount": 1}
            self.driver.execute_cdp_cmd(
                "Input.dispatchMouseEvent", {"type": names[event], "x": x, "y": y, **pressed}
            )
        else:
            names = {"down": "touchStart", "move": "touchMove", "up": "touchEnd"}
            points = [] if event == "up" else [{"x": x, "y": y}]
            self.driver.execute_cdp_cmd(
                "Input.dispatchTouchEvent", {"type": names[event], "touchPoints": points}
            )

    def button(self, label: str) -> WebElement:
        script = """return [...document.querySelectorAll(`#${arguments[0]} button`)]
          .find((each) => each.textContent === arguments[1]);"""
        found: WebElement = self.driver.execute_script(script, self.lab.id, label)
        return found


@pytest.fixture
def hand(driver: webdriver.Chrome, lab: Laboratory) -> Iterator[Hand]:
    yield Hand(driver, lab)
    browser.prefer(driver, "")


def assert_agrees_with_python(hand: Hand) -> Array:
    """What the laboratory shows is what d2d finds; returns it."""
    if hand.lab.id == "lab-credible":
        shown = hand.ask("lab.result.results.slice(0, 3)")
        theta = np.array([run["theta"] for run in shown])
        start = [5.0, 0.0, np.deg2rad(15.0)]
        expected = np.array([optimum(run["problem"], start) for run in shown])
    elif hand.lab.id == "lab-gaussian":
        shown = hand.ask("({...lab.result, ...lab.state})")
        xx, xy, yy = shown["covariance"]
        away = np.array([shown["px"] - shown["mx"], shown["py"] - shown["my"]])
        theta = np.array([shown["distance"]])
        expected = np.sqrt([away @ np.linalg.solve([[xx, xy], [xy, yy]], away)])
    elif hand.lab.id in ("lab-line", "lab-outlier"):
        shown = hand.ask("({...lab.result})")
        theta, start = np.array([shown["lowest"]]), [shown["lowest"] + 0.02]
        expected = optimum(shown["problem"], start)
    else:
        shown = hand.ask("lab.result")
        theta = np.array(shown["found"]["theta"])
        expected = optimum(shown["problem"], shown["start"])
    np.testing.assert_allclose(theta, expected, atol=1e-8)
    return theta


@EACH_LAB
def test_pointer_and_keys_change_it_to_what_d2d_gives(lab: Laboratory, hand: Hand, address: str):
    """By mouse, finger and keys; nothing complains, and nothing is fetched after the page.

    The page does not scroll away under a finger on a handle, and does so beside the handles.
    """
    hand.open(f"{address}{lab.page}.html")
    begun = hand.driver.execute_script("return performance.now()")
    assert_agrees_with_python(hand)
    if lab.handle:
        handle = hand.find(f"[aria-label^='{lab.handle}']")
        hand.driver.execute_script("arguments[0].onpointercancel = console.error", handle)
        for gesture in (
            partial(hand.drag, "mouse", handle, 14.0, 9.0),
            partial(hand.drag, "finger", handle, -40.0, -25.0),
            partial(handle.send_keys, Keys.ARROW_RIGHT, Keys.ARROW_UP),
        ):
            state = hand.ask("lab.state")
            gesture()
            assert hand.ask("lab.state") != state
            assert_agrees_with_python(hand)
        beside = hand.find(".lab-axes text:last-child")
        top = hand.ask("scrollY")
        hand.drag("finger", beside, 0.0, -60.0)
        browser.wait(hand.driver, f"return scrollY > {top}")
    if lab.slider:
        state = f"lab.state.{lab.slider}"
        value = hand.ask(state)
        hand.find(f"#{lab.id}-{lab.slider}").send_keys(Keys.ARROW_RIGHT)
        assert hand.ask(state) > value
        assert_agrees_with_python(hand)
    state = hand.ask("JSON.stringify(lab.state)")
    hand.button(lab.button).send_keys(Keys.ENTER)
    browser.wait(hand.driver, f"return JSON.stringify({hand.it}.state) !== {json.dumps(state)}")
    assert_agrees_with_python(hand)
    # what the page itself asked for may arrive later
    asked = """performance.getEntriesByType('resource')
      .filter(e => e.startTime > arguments[0] && !e.name.includes('/_images/'))"""
    assert [each["name"] for each in hand.driver.execute_script(f"return {asked}", begun)] == []
    complaints, *_ = browser.traffic(hand.driver, hand.driver.current_url)
    assert complaints == []


@PLANE
def test_it_works_from_a_folder(lab: Laboratory, hand: Hand, book: Path):
    """Breaks if a script cannot be loaded by a book that is opened from disk."""
    hand.open((book / f"{lab.page}.html").as_uri())
    assert_agrees_with_python(hand)


@LINE
def test_reduced_motion_skips_the_animation(lab: Laboratory, hand: Hand, address: str):
    """Breaks if the ball still rolls for a reader whose system asks for less motion."""
    hand.less_motion()
    hand.open(f"{address}{lab.page}.html")
    hand.button(lab.button).click()
    shown = hand.ask("({t: lab.state.t, problem: lab.result.problem})")
    assert shown["t"] == pytest.approx(optimum(shown["problem"], [6.4]).item(), abs=1e-6)


NONSENSE = (
    "x=%",
    "cost=constructor",
    "runs=1.5",
    "t=900",
    "cost=no&fixed=1,x&moving=&draw=-1&%22=3",
)


@EACH_LAB
def test_the_address_brings_the_view_back(lab: Laboratory, hand: Hand, address: str):
    """A view that is sent to somebody else is the same there; any address is survived."""
    hand.open(f"{address}{lab.page}.html")
    first = hand.ask("lab.state")
    if lab.handle:
        hand.drag("mouse", hand.find(f"[aria-label^='{lab.handle}']"), 20.0, 10.0)
    else:
        hand.find(f"#{lab.id}-{lab.slider}").send_keys(Keys.ARROW_RIGHT)
    state = hand.ask("lab.state")
    assert state != first
    browser.wait(hand.driver, f"return location.href.endsWith({hand.it}.address())")
    hand.open(hand.driver.current_url)
    again = hand.ask("lab.state")
    for key, value in state.items():
        assert again[key] == (value if isinstance(value, str) else pytest.approx(value, rel=1e-6))
    for query in NONSENSE:
        hand.view(query)
        assert hand.ask("lab.element.querySelectorAll('svg').length") > 0
    assert_agrees_with_python(hand)


@EACH_LAB
def test_the_result_waits_for_a_guess(lab: Laboratory, hand: Hand, address: str):
    """Breaks if the outcome is told before one acts, a step does not follow the guess, or there is
    not exactly one answer that is right.
    """
    hand.open(f"{address}{lab.page}.html")
    guess = "document.querySelector('.lab-guess')"
    step = "lab.element.querySelector('.lab-leaf:not([hidden])')"
    assert hand.ask("lab.told.innerText") == ""
    assert hand.ask(f"Boolean({step}.querySelector('.lab-guess'))")
    assert hand.ask(f"{guess}.querySelector('[aria-live]').hidden")
    hand.find(".lab-guess button").send_keys(Keys.ENTER)
    assert hand.ask("lab.told.innerText") != ""
    hand.find("[aria-label='Next step']").send_keys(Keys.ENTER)
    assert hand.ask(f"{step}.querySelector('details > summary').textContent").startswith("What you")
    told = f"""[...{guess}.querySelectorAll('button')].map((each) => {{ each.click();
      return {guess}.querySelector('[aria-live]').textContent.trim().split('.')[0]; }})"""
    assert sorted(hand.ask(told))[-2:] == ["No", "Right"]


@PLANE
def test_the_scene_is_that_of_the_study(lab: Laboratory, hand: Hand, address: str):
    """Breaks if the laboratories of the plane leave the scene that chapter 9 evaluates."""
    hand.open(f"{address}{lab.page}.html")
    scene = hand.ask("labs.SCENE")
    assert scene["polar"] == EIGHT_TARGETS.tolist()
    np.testing.assert_allclose(scene["theta"], OVERLAPPED.theta)
    assert scene["sigmaRange"] == OVERLAPPED.sigma_range
    assert scene["sigmaAzimuth"] == OVERLAPPED.sigma_azimuth


class Fact(NamedTuple):
    """A number in the text beside a laboratory, and the view that shows it."""

    id: str
    view: str
    number: str
    """What the laboratory computes."""
    sentence: str
    """The words that the text has around it."""


LOWEST, ANEES = "lab.result.lowest", "lab.result.judged.anees"
OFF = "Math.hypot(...[0, 1].map((i) => lab.result.found.theta[i] - {}[i]))"
TURN = "lab.result.found.theta[2] * 180 / Math.PI"
SPREAD = "Math.sqrt(lab.result.found.covariance[{0}][{0}])"
YAW_SPREAD = f"{SPREAD.format(2)} * 180 / Math.PI"
NEES = (
    "d2d.nees(lab.result.found.theta.map((t, i) => t - labs.SCENE.theta[i]),"
    " lab.result.found.covariance)"
)
AGREEING = "Number(lab.told.textContent.match(/[0-9]+/)[0])"
ROLLED = "d2d.register(lab.result.problem, [6.4, 0, 0]).theta[0]"
WITHOUT_C = "cost=robust&moving=-2.2,6.14,9.27"
OUTLIERS = (
    "moving=10.82,0.17,16.33,5.27,26.64,4.03,18.01,-3.21,26.64,-8.19,3.8,-10.3,13.37,-15.45,"
    "20.03,-17.66,16.8,-10.7,10.39,11.71"
)
FACTS = (
    Fact("lab-line", "cost=summing", ROLLED, "takes the ball to {:.1f} m"),
    Fact("lab-line", WITHOUT_C, LOWEST, "stay at {:.1f} m with A and B"),
    Fact("lab-line", "cost=summing", LOWEST, "and not to {:.2f} m"),
    Fact("lab-outlier", "cost=likelihood", LOWEST, "deepest valley is at {:.1f} m"),
    Fact("lab-outlier", "cost=summing", LOWEST, "The sum is at {:.2f} m"),
    Fact("lab-outlier", "cost=robust&width=0.3", LOWEST, "pulls the valley to {:.1f} m"),
    Fact("lab-outlier", "cost=robust", LOWEST, "the three others agree on {:.2f} m"),
    Fact("lab-outlier", "cost=robust", LOWEST, "the valley is back at {:.1f} m"),
    Fact("lab-plane", "cost=summing", OFF.format("[5, 0]"), "the sum ends {:.0f} m off"),
    Fact("lab-plane", OUTLIERS, f"15 - {TURN}", "likelihood is turned by {:.1f}°"),
    Fact("lab-plane", OUTLIERS, YAW_SPREAD, "deviation of {:.1f}°"),
    Fact("lab-plane", OUTLIERS, NEES, "its NEES is {:.0f}"),
    Fact("lab-doppler", "vx=6&vy=1.15", AGREEING, "all {:.0f} static targets agree"),
    Fact("lab-doppler", "vx=6&vy=1.15", YAW_SPREAD, "the yaw rate is known to {:.1f} °/s"),
    Fact("lab-doppler", "vx=6&use=positions", SPREAD.format(0), "uncertain by {:.1f} m/s"),
    Fact("lab-credible", "who=all&echoes=5", ANEES, "ANEES is close to {:.0f}"),
    Fact("lab-credible", "who=one&echoes=5", ANEES, "D alone it is about {:.0f}"),
    Fact("lab-credible", "bias=0.2", ANEES, "m the ANEES is about {:.0f}"),
    Fact("lab-gaussian", "px=1.73&py=1", "lab.result.distance", "It is {:.1f} along the long axis"),
    Fact("lab-gaussian", "px=-1&py=1.73", "lab.result.distance", "{:.1f} along the short one"),
    Fact(
        "lab-live", "cost=likelihood", OFF.format("[2, 0.5]"), "ends {:.2f} m from the true motion"
    ),
    Fact("lab-live", "outlier=1", f"Math.abs(10 - {TURN})", "turns the estimate by {:.1f}°"),
    Fact("lab-live", "turn=-40", f"Math.abs(10 - {TURN})", "ends four metres and {:.0f}° off"),
)


@EACH_LAB
def test_the_text_says_what_is_seen(lab: Laboratory, hand: Hand, address: str):
    """Breaks if a link of the text shows another view than it says, or a number in the text is not
    the one that the laboratory shows.
    """
    hand.open(f"{address}{lab.page}.html")
    queries = f"""[...document.querySelectorAll('article a[href^="#{lab.id}?"]')]
      .map((link) => link.getAttribute('href').split('?')[1])"""
    for query in hand.ask(queries):
        hand.view(query)
        state = hand.ask("lab.state")
        for key, value in (part.split("=") for part in query.split("&")):
            shown = ",".join(map(str, state[key])) if isinstance(state[key], list) else state[key]
            assert str(shown).removesuffix(".0") == value
    for fact in (fact for fact in FACTS if fact.id == lab.id):
        hand.view(fact.view)
        if lab.id == "lab-credible":
            browser.wait(
                hand.driver, f"return {hand.it}.result.results.length >= {hand.it}.state.runs"
            )
        text = " ".join(hand.ask("lab.element.closest('section').textContent").split())
        sentence = fact.sentence.format(hand.ask(fact.number))
        assert sentence in text, sentence


PYTHON = {  # views whose scripts are run
    "lab-gaussian": ("", "mx=0.4&my=-0.3&long=1.2&short=0.7&turn=100&px=2.1&py=0.2"),
    "lab-live": ("", "outlier=1&cost=robust&turn=-40", "cost=summing&x=1"),
    "lab-line": ("", "cost=robust&t=9.4", "cost=likelihood&noise=0.4"),
    "lab-outlier": ("", "cost=robust&width=0.3&alpha=0.5"),
    "lab-plane": (
        "",
        f"cost=robust&{OUTLIERS}&anneal=1",
        "cost=robust&inflate=3&alpha=0.4&width=5",
    ),
    "lab-doppler": ("vx=6&vy=1.15", "vx=6&use=positions", "vx=5&drive=1&py=4&speed=3&heading=90"),
    "lab-credible": ("runs=1000", "cost=robust&who=all&echoes=4&bias=0.3&stated=1.5&runs=1000"),
}


@EACH_LAB
def test_the_python_shown_gives_the_numbers_shown(lab: Laboratory, hand: Hand, address: str):
    """Runs what *Show as Python* prints; each number that it prints is one that the page shows."""
    hand.open(f"{address}{lab.page}.html")
    for view in PYTHON[lab.id]:
        if view:
            hand.view(view)
        hand.driver.execute_script("arguments[0].open = true", hand.find(".lab-fold:has(pre)"))
        script = hand.ask("lab.element.querySelector('.lab-fold pre').textContent")
        printed = io.StringIO()
        with redirect_stdout(printed):
            exec(script, {})
        numbers = re.findall(r"-?\d+\.\d+", printed.getvalue())
        assert numbers
        if lab.id == "lab-credible":  # other noise
            browser.wait(hand.driver, f"return {hand.it}.result.results.length >= 1000")
            assert float(numbers[0]) == pytest.approx(hand.ask(ANEES), rel=0.1)
            continue
        if lab.id in ("lab-line", "lab-outlier", "lab-live"):
            hand.less_motion()
            roll = "Let the ball roll" if lab.id == "lab-outlier" else lab.button
            hand.button(roll).send_keys(Keys.ENTER)
        told = hand.ask("lab.told.innerText + lab.numbers.innerText").replace("−", "-")
        assert set(numbers) <= set(re.findall(r"-?\d+\.\d+", told)), view


@PLANE
def test_the_basin_is_where_starts_arrive(lab: Laboratory, hand: Hand, address: str):
    """Breaks if a white dot is a start from which d2d ends elsewhere, or the record is wrong."""
    hand.open(f"{address}{lab.page}.html#{lab.id}?cost=robust&basin=1")
    dots = hand.ask("""(() => { const p = lab.plots[1];
      return [...p.content.querySelectorAll('.lab-basin')].map((dot) => {
        const [x, y] = dot.getAttribute('d').match(/[-0-9.]+/g).map(Number);
        return [p.x[0] + ((x + 3 - p.left) / p.w) * (p.x[1] - p.x[0]),
          p.y[0] + ((p.top + p.h - y - 3) / p.h) * (p.y[1] - p.y[0])]; }); })()""")
    problem = hand.ask("lab.result.problem")
    truth = [5.0, 0.0, np.deg2rad(15.0)]
    aim = optimum(problem, truth)
    cells = np.linspace(-9.6, 9.6, 25)
    for x, y in np.random.default_rng(0).choice(cells, (40, 2)):
        found = optimum(problem, [truth[0] + x, truth[1] + y, truth[2]])
        arrives = bool(np.abs(found - aim).max() < 1e-3)
        assert arrives == bool(np.isclose(dots, [x, y], atol=1e-6).all(axis=1).any()), (x, y)
