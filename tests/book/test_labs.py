"""The laboratories in the built pages, by mouse, finger and keys, in both themes, at both widths.

Breaks if something can no longer be dragged, if what is shown is not what d2d computes, if the
page's address does not bring the view back, or if a laboratory needs more than the page's own
files. The numbers of the engine itself are tested in test_engine.py.
"""

import io
import json
import re
from collections.abc import Iterator
from contextlib import redirect_stdout
from functools import partial
from itertools import pairwise
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
WIDTHS = {"desk": browser.WIDE, "phone": browser.NARROW}


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
        "chapters/03_cost_surfaces_1d", "lab-line", "Target C of the cur", "t", "Let the ball roll"
    ),
    Laboratory(
        "chapters/04_outliers_and_clusters_1d", "lab-outlier", "Target O", "noise", "Next draw"
    ),
    Laboratory(
        "chapters/11_outliers_and_clusters_2d",
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
# All tests of a laboratory follow each other, so that those which only look share its page.
EACH_LAB = pytest.mark.parametrize(
    "lab",
    [pytest.param(lab, id=lab.id, marks=pytest.mark.xdist_group(lab.id)) for lab in LABS],
    scope="module",
)


# ---- What d2d makes of a laboratory's problem ---------------------------------------------------


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


# ---- Real events in the page --------------------------------------------------------------------


class Hand:
    """Opens a laboratory and works it with real events."""

    def __init__(self, driver: webdriver.Chrome, lab: Laboratory) -> None:
        self.driver, self.lab, self.it = driver, lab, f"labs.all['{lab.id}']"

    def open(self, address: str, width: int = browser.WIDE, theme: str = "light") -> None:
        """Load the page afresh."""
        browser.resize(self.driver, width)
        browser.prefer(self.driver, theme)
        self.driver.get("about:blank")
        browser.drain(self.driver)
        self.driver.get(address)
        browser.wait(self.driver, f"return Boolean(window.labs && {self.it}?.result)")
        browser.wait(self.driver, "return document.readyState === 'complete'")
        fold = f"{self.it}.element.closest('details')"
        self.driver.execute_script(f"if ({fold}) {fold}.open = true")

    def look(self, address: str, width: int = browser.WIDE) -> None:
        """Show the page as it opens; whoever calls this leaves the laboratory as it is."""
        if not self.driver.execute_script("return window.lookedAt === arguments[0]", self.lab.id):
            self.open(address, width)
            self.driver.execute_script("window.lookedAt = arguments[0]", self.lab.id)
        browser.resize(self.driver, width)

    def view(self, query: str) -> None:
        """Set the laboratory by the page's address, as a link of the text does."""
        script = """const [hash, done] = arguments;
          window.lookedAt = '';
          if (location.hash === hash) done();
          addEventListener('hashchange', () => done(), {once: true});
          location.hash = hash;"""
        self.driver.execute_async_script(script, f"#{self.lab.id}?{query}")

    def less_motion(self) -> None:
        """Set the system to less motion: what rolls is there at once."""
        feature = {"name": "prefers-reduced-motion", "value": "reduce"}
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})

    def complaints(self) -> list[str]:
        """What went wrong since the page was opened, but for the formulas."""
        found, *_ = browser.traffic(self.driver, self.driver.current_url)
        return [each for each in found if MATHJAX not in each]

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

    def tap(self, kind: str, element: WebElement) -> None:
        self.drag(kind, element, 0.0, 0.0)


MATHJAX = "mathjax"


@pytest.fixture
def hand(driver: webdriver.Chrome, lab: Laboratory) -> Iterator[Hand]:
    """A hand on a laboratory; the window and the colours are put back afterwards.

    Formulas are not set: a page takes seconds for them, and a laboratory has none.
    """
    driver.execute_cdp_cmd("Network.setBlockedURLs", {"urls": [f"*{MATHJAX}*"]})
    yield Hand(driver, lab)
    driver.execute_cdp_cmd("Network.setBlockedURLs", {"urls": []})
    browser.prefer(driver, "")
    driver.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": False})
    browser.resize(driver, browser.WIDE)


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
@pytest.mark.parametrize("theme", browser.THEMES)
@pytest.mark.parametrize("width", WIDTHS)
def test_by_mouse_finger_and_keys(
    lab: Laboratory, width: str, theme: str, hand: Hand, address: str
):
    """Each gesture changes the optimum, to what d2d gives; nothing complains or is fetched."""
    home = f"{address}{lab.page}.html"
    hand.open(home, WIDTHS[width], theme)
    touch = {"enabled": width == "phone", "maxTouchPoints": 1}
    hand.driver.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", touch)
    assert hand.driver.execute_script("return document.documentElement.dataset.theme") == theme
    begun = hand.driver.execute_script("return performance.now()")
    seen = [assert_agrees_with_python(hand)]
    if lab.handle:
        handle = hand.find(f"[aria-label^='{lab.handle}']")
        for gesture in (
            partial(hand.drag, "mouse", handle, 14.0, 9.0),
            partial(hand.drag, "finger", handle, 14.0, 9.0),
            partial(handle.send_keys, Keys.ARROW_RIGHT, Keys.ARROW_UP),
        ):
            state = hand.ask("lab.state")
            gesture()
            assert hand.ask("lab.state") != state
            seen.append(assert_agrees_with_python(hand))
        assert hand.driver.switch_to.active_element == handle
    if lab.slider:
        state = f"lab.state.{lab.slider}"
        value = hand.ask(state)
        hand.find(f"#{lab.id}-{lab.slider}").send_keys(Keys.ARROW_RIGHT)
        assert hand.ask(state) > value
        seen.append(assert_agrees_with_python(hand))
    state = hand.ask("JSON.stringify(lab.state)")
    pressed = hand.find(f".lab-button:nth-of-type({button(hand, lab.button)})")
    hand.tap("mouse", pressed)
    browser.wait(hand.driver, f"return JSON.stringify({hand.it}.state) !== {json.dumps(state)}")
    assert_agrees_with_python(hand)
    hand.tap("finger", pressed)
    assert_agrees_with_python(hand)
    if lab.handle and lab.id != "lab-live":  # there it is the start that moves, not a target
        moved = [np.abs(after - before).max() for before, after in pairwise(seen)]
        assert max(moved) > 1e-4
    # what the page itself asked for may arrive later
    asked = "performance.getEntriesByType('resource').filter(e => e.startTime > arguments[0])"
    assert [each["name"] for each in hand.driver.execute_script(f"return {asked}", begun)] == []
    assert hand.complaints() == []


def button(hand: Hand, label: str) -> int:
    """Which of the buttons beside it has this label, counted from 1."""
    script = """const [id, label] = arguments;
    const found = [...document.querySelectorAll(`#${id} button`)]
      .find((each) => each.textContent === label);
    return [...found.parentElement.children].filter((each) => each.tagName === 'BUTTON')
      .indexOf(found) + 1;"""
    return int(hand.driver.execute_script(script, hand.lab.id, label))


@EACH_LAB
def test_the_address_brings_the_view_back(lab: Laboratory, hand: Hand, address: str):
    """A view that is sent to somebody else is the same there."""
    home = f"{address}{lab.page}.html"
    hand.open(home)
    first = hand.ask("lab.state")
    if lab.handle:
        hand.drag("mouse", hand.find(f"[aria-label^='{lab.handle}']"), 20.0, 10.0)
    else:
        hand.find(f"#{lab.id}-{lab.slider}").send_keys(Keys.ARROW_RIGHT)
    state = hand.ask("lab.state")
    browser.wait(hand.driver, "return location.hash.includes('?')")
    shared = hand.driver.current_url
    hand.open(shared)
    again = hand.ask("lab.state")
    assert again.keys() == state.keys()
    for key, value in state.items():
        if isinstance(value, str):
            assert again[key] == value
        else:
            np.testing.assert_allclose(again[key], value, rtol=1e-6)
    assert state != first


@EACH_LAB
def test_it_works_from_a_folder(lab: Laboratory, hand: Hand, book: Path):
    """Breaks if a script cannot be loaded by a book that is opened from disk."""
    hand.open((book / f"{lab.page}.html").as_uri())
    assert_agrees_with_python(hand)


@EACH_LAB
def test_without_scripts_it_points_to_the_printed_figure(
    lab: Laboratory, driver: webdriver.Chrome, address: str
):
    driver.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": True})
    try:
        driver.get(f"{address}{lab.page}.html")
        fallback = driver.find_element(By.ID, lab.id)
        assert "needs JavaScript" in (fallback.get_attribute("textContent") or "")
        assert fallback.find_elements(By.CSS_SELECTOR, "a[href*='#fig-']")
    finally:
        driver.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": False})


@EACH_LAB
def test_controls_have_names_and_results_are_announced(lab: Laboratory, hand: Hand, address: str):
    """Breaks if a screen reader finds a control without a name, or hears no result."""
    hand.look(f"{address}{lab.page}.html")
    nameless = """[...lab.element.querySelectorAll('input, button, [tabindex="0"]')]
      .filter((each) => !each.getAttribute('aria-label') && !each.textContent.trim())
      .filter((each) => !each.labels?.length).length"""
    assert hand.ask(nameless) == 0
    browser.wait(
        hand.driver,
        f"return document.querySelector('#{lab.id} [aria-live=polite]').textContent.length > 20",
    )


@pytest.mark.parametrize("lab", [LABS[2]], ids=["lab-line"])
def test_reduced_motion_skips_the_animation(lab: Laboratory, hand: Hand, address: str):
    """Breaks if the ball still rolls for a reader whose system asks for less motion."""
    hand.less_motion()
    hand.driver.get("about:blank")
    hand.driver.get(f"{address}{lab.page}.html")
    browser.wait(hand.driver, f"return Boolean(window.labs && {hand.it}?.result)")
    hand.driver.execute_script("document.querySelector('#lab-line .lab-button').click()")
    shown = hand.ask("({t: lab.state.t, problem: lab.result.problem})")
    assert shown["t"] == pytest.approx(optimum(shown["problem"], [6.4]).item(), abs=1e-6)


@pytest.mark.parametrize("lab", [LABS[4]], ids=["lab-plane"])
def test_the_scene_is_that_of_the_study(lab: Laboratory, hand: Hand, address: str):
    """Breaks if the laboratories of the plane leave the scene that chapter 10 evaluates."""
    hand.open(f"{address}{lab.page}.html")
    scene = hand.ask("labs.SCENE")
    assert scene["polar"] == EIGHT_TARGETS.tolist()
    np.testing.assert_allclose(scene["theta"], OVERLAPPED.theta)
    assert scene["sigmaRange"] == OVERLAPPED.sigma_range
    assert scene["sigmaAzimuth"] == OVERLAPPED.sigma_azimuth


def only(index: int) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("lab", [LABS[index]], ids=[LABS[index].id])


LIVE, OUTLIER, PLANE = (only(index) for index in (1, 3, 4))
INSIDE = """(plot, x, y) => x >= plot.left && x <= plot.left + plot.w
  && y >= plot.top && y <= plot.top + plot.h"""
SWEEP = """(() => { const inside = %s, first = structuredClone(lab.state); let out = 0;
  for (const [x, y, turn] of [%s]) {
    Object.assign(lab.state, { x, y, turn }); lab.draw(); if (!(%s)) out++; }
  Object.assign(lab.state, first); lab.draw(); return out; })()"""
STARTS = ", ".join(
    f"[{x}, {y}, {t}]" for x in (-3, 4, 12) for y in (-8, 0, 7) for t in (-60, 0, 60)
)


@LIVE
def test_the_outlier_is_drawn_as_an_error(lab: Laboratory, hand: Hand, address: str):
    """Breaks if the error plot leaves out the rotation, which the outlier turns by 3.5 degrees."""
    away = """Math.abs(lab.plots[2].content.lastChild.getBBox().x
      + lab.plots[2].content.lastChild.getBBox().width / 2 - lab.plots[2].X(0))"""
    hand.open(f"{address}{lab.page}.html")
    before = hand.ask(away)
    hand.open(f"{address}{lab.page}.html#{lab.id}?outlier=1")
    assert hand.ask(away) > before + 20.0


@LIVE
def test_the_error_is_always_in_its_plot(lab: Laboratory, hand: Hand, address: str):
    hand.open(f"{address}{lab.page}.html")
    middle = """(() => { const p = lab.plots[2], b = p.content.lastChild.getBBox();
      return inside(p, b.x + b.width / 2, b.y + b.height / 2); })()"""
    for cost in ("summing", "likelihood", "robust"):
        hand.ask(f"lab.state.cost = '{cost}'")
        assert hand.ask(SWEEP % (INSIDE, STARTS, middle)) == 0, cost


@LIVE
def test_the_ring_stays_in_the_picture_and_says_degrees(lab: Laboratory, hand: Hand, address: str):
    hand.open(f"{address}{lab.page}.html")
    place = """(() => { const m = lab.plots[0].front.children[1].getCTM(), s = lab.plots[0].svg,
      k = s.getCTM().a; return inside(lab.plots[0], m.e / k, m.f / k); })()"""
    assert hand.ask(SWEEP % (INSIDE, STARTS, place)) == 0
    ring = hand.find("[aria-label$='turn it']")
    assert ring.get_attribute("aria-valuetext") == "0 degrees"


@OUTLIER
def test_the_ball_is_always_in_the_picture(lab: Laboratory, hand: Hand, address: str):
    hand.open(f"{address}{lab.page}.html")
    for cost in ("summing", "likelihood", "robust"):
        hand.view(f"cost={cost}")
        out = """(() => { const p = lab.plots[1]; let out = 0;
          for (let t = -12; t <= 16; t++) { lab.state.t = t; lab.draw();
            const y = Number(p.front.firstChild.getAttribute('transform').match(/[-0-9.]+/g)[1]);
            if (!(y >= p.top && y <= p.top + p.h)) out++; }
          return out; })()"""
        assert hand.ask(out) == 0, cost


@PLANE
def test_the_nearest_target_is_grabbed(lab: Laboratory, hand: Hand, address: str):
    """Breaks if a target of the current scan takes the drags of the previous scan's beside it."""
    hand.open(f"{address}{lab.page}.html")
    for letter, index in (("A", 0), ("D", 3), ("H", 7)):
        before = hand.ask("lab.state")
        hand.drag(
            "mouse", hand.find(f"[aria-label='Target {letter} of the previous scan F']"), 9, 5
        )
        after = hand.ask("lab.state")
        assert after["moving"] == before["moving"]
        assert after["fixed"][2 * index] > before["fixed"][2 * index]


@EACH_LAB
def test_sliders_are_as_wide_as_their_box(lab: Laboratory, hand: Hand, address: str):
    sizes = """[...lab.element.querySelectorAll('.lab-control:not([hidden])')].map((row) => {
      const box = row.querySelector('input').getBoundingClientRect();
      return [box.width / row.clientWidth, box.height]; })"""
    for width in (browser.WIDE, browser.NARROW, 320):
        hand.look(f"{address}{lab.page}.html", width)
        for share, height in hand.ask(sizes):
            assert height >= 24.0, width
            assert share > (0.95 if width < 700 else 0.2), width


@LIVE
def test_a_drag_ends_an_animation(lab: Laboratory, hand: Hand, address: str):
    """Breaks if the registration goes on pulling at a scan that somebody holds."""
    hand.open(f"{address}{lab.page}.html")
    handle = hand.find("[aria-label$='move it']")
    hand.ask("lab.animate(600, (share) => { lab.state.x = 50 * share; lab.update(); }) ?? 0")
    hand.drag("mouse", handle, 14.0, 9.0)
    in_next_picture = f"requestAnimationFrame(() => arguments[0]({hand.it}.state.x))"
    first, second = (hand.driver.execute_async_script(in_next_picture) for _ in range(2))
    assert first == second


NONSENSE = "cost=nonsense&fixed=1,x&moving=&draw=-1&alpha=9e99&%22=3"


@EACH_LAB
def test_any_address_is_survived(lab: Laboratory, hand: Hand, address: str):
    """Breaks if an address that nobody's laboratory wrote stops the script."""
    hand.open(f"{address}{lab.page}.html#{lab.id}?x=%")
    for query in (*("x=%", "cost=constructor", "runs=1.5", "t=900"), NONSENSE):
        hand.view(query)
        assert hand.ask("lab.element.querySelectorAll('svg').length") > 0
        assert hand.complaints() == []


@PLANE
def test_results_are_spoken_in_sentences(lab: Laboratory, hand: Hand, address: str):
    """Breaks if the cells of a table run together in the live region."""
    hand.look(f"{address}{lab.page}.html")
    spoken = f"document.querySelector('#{lab.id} [aria-live=polite]').textContent"
    browser.wait(hand.driver, f"return {spoken}.length > 20")
    assert ", rotation (°) " in hand.ask(spoken)


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
    Fact(
        "lab-gaussian", "px=-1&py=1.73", "lab.result.distance", "{:.1f} along the short one, where"
    ),
    Fact("lab-live", "cost=likelihood", OFF.format("[2, 0.5]"), "ends {:.2f} m off the truth"),
    Fact("lab-live", "outlier=1", f"Math.abs(10 - {TURN})", "The outlier turns it by {:.1f}°"),
    Fact("lab-live", "turn=-40", f"Math.abs(10 - {TURN})", "ends four metres and {:.0f}° off"),
)


@EACH_LAB
def test_the_text_says_what_is_seen(lab: Laboratory, hand: Hand, address: str):
    """Breaks if a number in the text beside a laboratory is not the one that it shows."""
    hand.look(f"{address}{lab.page}.html")
    for fact in (fact for fact in FACTS if fact.id == lab.id):
        hand.view(fact.view)
        if lab.id == "lab-credible":
            browser.wait(
                hand.driver, f"return {hand.it}.result.results.length >= {hand.it}.state.runs"
            )
        text = " ".join(hand.ask("lab.element.closest('section').textContent").split())
        sentence = fact.sentence.format(hand.ask(fact.number))
        assert sentence in text, sentence


# The longest that each laboratory can say, with the most controls.
WORST = {
    "lab-gaussian": "px=-1&py=1.73",
    "lab-live": "outlier=1",
    "lab-line": "cost=robust",
    "lab-outlier": "cost=robust",
    "lab-plane": f"cost=robust&{OUTLIERS}",
    "lab-doppler": "vx=6&vy=1.15",
    "lab-credible": "who=all&echoes=5",
}


@EACH_LAB
def test_picture_controls_and_verdict_share_a_screen(lab: Laboratory, hand: Hand, address: str):
    """Breaks if a reader has to scroll between what is moved and what is said of it.

    On a phone the table of numbers may be below; there is no room for it.
    """
    hand.look(f"{address}{lab.page}.html")
    for view in ("", WORST[lab.id]):
        if view:
            hand.view(view)
        for width, height in ((browser.WIDE, 900), (browser.NARROW, 850)):
            browser.resize(hand.driver, width)
            last = "lab.told" if width == browser.WIDE else "lab.told.querySelector('p')"
            top, bottom, header = hand.ask(
                f"[lab.element.getBoundingClientRect().top, {last}.getBoundingClientRect().bottom,"
                " document.querySelector('.bd-header-article').offsetHeight]"
            )
            assert bottom - top <= height - header, (view, width)


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
    hand.look(f"{address}{lab.page}.html", browser.NARROW)
    for view in PYTHON[lab.id]:
        if view:
            hand.view(view)
        hand.driver.execute_script("arguments[0].open = true", hand.find(".lab-python"))
        edges = "[lab.element, lab.element.querySelector('.lab-python pre')]"
        outer, inner = hand.ask(f"{edges}.map((each) => each.getBoundingClientRect().right)")
        assert inner < outer
        script = hand.ask("lab.element.querySelector('.lab-python pre').textContent")
        assert script.strip()
        printed = io.StringIO()
        with redirect_stdout(printed):
            exec(script, {})
        numbers = re.findall(r"-?\d+\.\d+", printed.getvalue())
        assert numbers
        if lab.id == "lab-credible":  # other noise
            browser.wait(hand.driver, f"return {hand.it}.result.results.length >= 1000")
            assert float(numbers[0]) == pytest.approx(hand.ask(ANEES), rel=0.1)
            continue
        if lab.id in ("lab-line", "lab-outlier"):
            hand.less_motion()
            roll = f".lab-button:nth-of-type({button(hand, 'Let the ball roll')})"
            hand.tap("mouse", hand.find(roll))
        told = hand.ask("lab.told.innerText").replace("−", "-")
        assert set(numbers) <= set(re.findall(r"-?\d+\.\d+", told)), view


@EACH_LAB
def test_the_link_is_copied(lab: Laboratory, hand: Hand, address: str):
    """Breaks if *Copy link* copies the view of a moment ago, or nothing."""
    hand.open(f"{address}{lab.page}.html#{lab.id}?{WORST[lab.id]}")
    script = """navigator.clipboard.writeText = async (link) => (window.copied = link);"""
    hand.driver.execute_script(script)
    hand.find(f".lab-button:nth-of-type({button(hand, 'Copy link')})").send_keys(Keys.ENTER)
    browser.wait(hand.driver, "return window.copied")
    copied = hand.driver.execute_script("return window.copied")
    state = hand.ask("lab.state")
    hand.open(copied)
    assert hand.ask("lab.state") == state


@EACH_LAB
def test_the_tasks_set_the_state(lab: Laboratory, hand: Hand, address: str):
    """Breaks if a link of the text no longer changes the laboratory, or scrolls elsewhere."""
    hand.open(f"{address}{lab.page}.html")
    links = f"[...document.querySelectorAll('article a[href^=\"#{lab.id}?\"]')]"
    count = hand.ask(f"{links}.length")
    assert count >= 3
    for index in range(count):
        wanted = hand.ask(f"{links}[{index}].getAttribute('href').split('?')[1]")
        hand.driver.execute_script(f"{links}[{index}].click()")
        hand.driver.execute_async_script("requestAnimationFrame(() => setTimeout(arguments[0]))")
        state = hand.ask("lab.state")
        for key, value in (part.split("=") for part in wanted.split("&")):
            shown = ",".join(map(str, state[key])) if isinstance(state[key], list) else state[key]
            assert str(shown).removesuffix(".0") == value
        top = f"{hand.it}.element.getBoundingClientRect().top"
        browser.wait(hand.driver, f"return {top} >= 0 && {top} < 200")  # the page scrolls smoothly


STOPS = "[...lab.element.querySelectorAll('.lab-handle')].filter((e) => e.tabIndex === 0)"


@EACH_LAB
def test_a_scan_is_one_stop_of_the_tab_key(lab: Laboratory, hand: Hand, address: str):
    """Breaks if a reader without a mouse must pass every target to reach the controls."""
    hand.look(f"{address}{lab.page}.html")
    expected = {"lab-live": 2, "lab-doppler": 1, "lab-credible": 0, "lab-gaussian": 4}.get(
        lab.id, 3
    )
    assert hand.ask(f"{STOPS}.length") == expected
    if expected != 3:
        return
    hand.driver.execute_script("window.lookedAt = ''")  # what follows changes it
    first = hand.find("[aria-label^='Target'][aria-label*='current']")
    first.send_keys(Keys.PAGE_DOWN)
    second = hand.driver.switch_to.active_element
    assert second != first
    assert "current" in (second.get_attribute("aria-label") or "")
    assert [first.get_attribute("tabindex"), second.get_attribute("tabindex")] == ["-1", "0"]
    state = hand.ask("lab.state.moving")
    second.send_keys(Keys.ARROW_RIGHT)
    assert hand.ask("lab.state.moving") != state
    second.send_keys(Keys.PAGE_UP)
    assert hand.driver.switch_to.active_element == first
    assert hand.ask(f"{STOPS}.length") == expected


@EACH_LAB
def test_on_paper_the_printed_figure_takes_its_place(lab: Laboratory, hand: Hand, address: str):
    """Breaks if a printed page has buttons that nobody can press, and no word on where to look."""
    hand.look(f"{address}{lab.page}.html")
    shown = """[...lab.element.children].filter((each) => each.checkVisibility())
      .map((each) => each.className)"""
    assert "lab-printed" not in hand.ask(shown)
    hand.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    try:
        assert hand.ask(shown) == ["lab-printed"]
        assert hand.ask("lab.element.querySelector('.lab-printed a[href*=\"#fig-\"]') !== null")
    finally:
        hand.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})


def test_a_page_in_the_dark_is_printed_in_the_light(driver: webdriver.Chrome, address: str):
    """Breaks if light words come on white paper, or the reader's own theme is lost."""
    browser.prefer(driver, "dark")
    driver.get(f"{address}chapters/02_gaussian_background.html")
    themes = driver.execute_script("""const now = () => document.documentElement.dataset.theme;
      const before = now(); dispatchEvent(new Event('beforeprint'));
      const printed = now(); dispatchEvent(new Event('afterprint'));
      return [before, printed, now()];""")
    browser.prefer(driver, "light")
    assert themes == ["dark", "light", "dark"]


def test_moving_pictures_are_dark_in_the_dark(driver: webdriver.Chrome, address: str):
    """Breaks if the drawing on white is not turned round, or stands on a white ground."""
    browser.prefer(driver, "dark")
    for page in ("02_gaussian_background", "06_finding_the_optimum", "f_more_from_the_road"):
        driver.get(f"{address}chapters/{page}.html")
        look = driver.execute_script("""const box = document.querySelector('[data-controls]');
          return [getComputedStyle(box.parentElement).filter,
            getComputedStyle(box.closest('.text_html')).backgroundColor];""")
        assert look == ["invert(1) hue-rotate(180deg)", "rgba(0, 0, 0, 0)"], page
    browser.prefer(driver, "light")


@EACH_LAB
def test_the_answer_shows_after_a_guess(lab: Laboratory, hand: Hand, address: str):
    """Breaks if the answer is given away, or if there is not exactly one that is right."""
    hand.look(f"{address}{lab.page}.html")
    guess = "document.querySelector('.lab-guess')"
    hand.driver.execute_script("window.lookedAt = ''")
    assert not hand.ask(f"{guess}.textContent.includes('Right. ')")
    assert hand.ask(f"{guess}.querySelector('[aria-live]').hidden")
    told = f"""[...{guess}.querySelectorAll('button')].map((each) => {{ each.click();
      return {guess}.querySelector('[aria-live]').textContent.trim().split('.')[0]; }})"""
    assert sorted(set(hand.ask(told))) == ["No", "Right"]
    assert hand.ask(told).count("Right") == 1
    assert hand.ask(f"{guess}.querySelector('a[href^=\"#{lab.id}?\"]').checkVisibility()")


@pytest.mark.parametrize("page", ["08_credibility", "why_is_my_covariance_too_small"])
def test_the_credible_laboratory_is_where_it_is_needed(
    page: str, driver: webdriver.Chrome, address: str
):
    """Breaks if its links do nothing there, or half the sigma does not leave 42 % inside."""
    hand = Hand(driver, LABS[-1]._replace(page=f"chapters/{page}"))
    hand.open(f"{address}{hand.lab.page}.html")
    link = "document.querySelector('a[href=\"#lab-credible?stated=0.5\"]')"
    hand.driver.execute_script(f"{link}.click()")
    browser.wait(driver, f"return {hand.it}.state.stated === 0.5")
    browser.wait(driver, f"return {hand.it}.result.results.length === 100")
    judged = hand.ask("lab.result.judged.nees.filter((each) => each < 7.8147).length")
    assert 30 <= judged <= 54  # of 100: three standard deviations about 42


@PLANE
def test_the_basin_is_where_starts_arrive(lab: Laboratory, hand: Hand, address: str):
    """Breaks if a yellow dot is a start from which d2d ends elsewhere, or the record is wrong."""
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
    for view, record in (("x=3&y=0", "Your record: 3.0 m"), ("x=-8&y=6", "Your record: 0.0 m")):
        hand.open(f"{address}{lab.page}.html#{lab.id}?cost=robust&{view}")
        assert record in hand.ask("lab.told.textContent")


@LIVE
def test_the_likelihood_is_fooled_and_the_robust_one_is_not(
    lab: Laboratory, hand: Hand, address: str
):
    """Breaks if the score is not the error in standard deviations, or the text promises another."""
    near = "outlier=1&ox=1&oy=-0.2"
    score = "Number(lab.told.textContent.match(/record: ([0-9]+[.][0-9])/)[1])"
    hand.open(f"{address}{lab.page}.html#{lab.id}?{near}")
    assert hand.ask(score) > 12.0
    hand.open(f"{address}{lab.page}.html#{lab.id}?{near}&cost=robust")
    assert hand.ask(score) < 3.0


def test_the_drive_and_its_counter_stand_in_the_first_screen(
    driver: webdriver.Chrome, address: str
):
    """Breaks if a first visitor presses the button and sees no error counted."""
    last = {browser.WIDE: "labs.all['lab-replay'].element.querySelector('input[type=range]')"}
    for width, height in ((browser.WIDE, 900), (browser.NARROW, 850)):
        browser.resize(driver, width)
        driver.get(f"{address}intro.html")
        browser.wait(driver, "return Boolean(window.labs?.all['lab-replay']?.result)")
        seen = last.get(width, "labs.all['lab-replay'].told")
        bottom = driver.execute_script(f"return {seen}.getBoundingClientRect().bottom + scrollY")
        assert bottom <= height, width
    browser.resize(driver, browser.WIDE)


def test_only_pages_with_a_laboratory_load_one(book: Path):
    """Breaks if every page loads every script again, as Jupyter Book does by itself."""
    scripts = {"lab-outlier": "line"}
    expected = {
        lab.page: {"engine", "kit", scripts.get(lab.id, lab.id.removeprefix("lab-"))}
        for lab in LABS
    }
    expected["chapters/08_credibility"] = {"engine", "kit", "credible"}
    expected["intro"] |= {"replay_data", "replay"}
    expected["chapters/why_is_my_covariance_too_small"] = {"engine", "kit", "credible", "doctor"}
    expected["chapters/your_own_radar"] = {"engine", "kit", "tracker", "findings", "log"}
    for page in [*expected, "chapters/notation", "chapters/01_motivation"]:
        text = (book / f"{page}.html").read_text(encoding="utf-8")
        loaded = {part.split(".js")[0] for part in text.split("_static/labs/")[1:] if ".js" in part}
        loaded = {name for name in loaded if "." not in name}
        assert loaded == expected.get(page, set())
