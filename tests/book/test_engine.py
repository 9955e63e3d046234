"""The engine of the laboratories computes what d2d computes, in a real browser.

Python draws the problems and solves them; the page is handed the problems only.  Breaks if a sign,
a term of a derivative, a weight or a step of the search differs.  `make test-engine` runs it
without a built book.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import scipy
from numpy.typing import ArrayLike, NDArray
from selenium import webdriver

from d2d import ANNEALED, CorruptedGaussian, PointSet, RegistrationCost, register
from d2d.cost import OutlierModel
from d2d.radar import EgoMotionModel, estimate_ego_motion, simulate_drive
from d2d.radar.motion.pairs import ScanPair, problem_of
from d2d.study import scenarios
from d2d.study.line.scene import line_scene
from tests.book import browser

ENGINE = Path(__file__).resolve().parents[2] / "_static" / "labs" / "engine.js"
EXACT = 1e-9
PAGE = """<!doctype html><link rel="icon" href="data:,">
<script src="engine.js"></script>"""
Array = NDArray[np.float64]
OUTLIERS: dict[str, OutlierModel | None] = {
    "none": None,
    "corrupted": CorruptedGaussian(0.2, [[100.0, 0.0], [0.0, 100.0]]),
    "oblique": CorruptedGaussian(0.35, [[30.0, 8.0], [8.0, 12.0]]),
}


class Case(NamedTuple):
    """A problem as the engine reads it, a start, and what d2d makes of both."""

    problem: dict[str, Any]
    start: Array
    value: float
    gradient: Array
    hessian: Array
    theta: Array
    covariance: Array
    shares: Array
    iterations: int


@pytest.fixture(scope="module")
def page(driver: webdriver.Chrome, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Runs a script with its arguments in a page that has loaded nothing but the engine."""
    folder = tmp_path_factory.mktemp("engine")
    (folder / "engine.js").write_bytes(ENGINE.read_bytes())
    (folder / "page.html").write_text(PAGE, encoding="utf-8")
    with browser.serve(folder) as address:
        driver.get(f"{address}page.html")
        yield driver.execute_script


def targets(points: PointSet) -> list[dict[str, Any]]:
    """The set as the engine reads it; a line's has no second coordinate."""
    if points.dimension == 1:
        rows = zip(points.means[:, 0], points.covariances[:, 0, 0], strict=True)
        return [{"x": x, "y": 0.0, "xx": xx, "xy": 0.0, "yy": 0.0} for x, xx in rows]
    return [
        {"x": x, "y": y, "xx": s[0, 0], "xy": s[0, 1], "yy": s[1, 1]}
        for (x, y), s in zip(points.means, points.covariances, strict=True)
    ]


def outlier(model: OutlierModel | None) -> dict[str, float] | None:
    if model is None:
        return None
    s = np.zeros((2, 2))
    s[: len(model.covariance), : len(model.covariance)] = model.covariance
    return {"fraction": model.fraction, "xx": s[0, 0], "xy": s[0, 1], "yy": s[1, 1]}


def padded(array: ArrayLike, unit: float = 0.0) -> Array:
    """Derivatives of a line's problem as the engine gives them, in three parameters."""
    given = np.asarray(array)
    if given.shape[-1] == 3:
        return given
    full = unit * np.eye(3) if given.ndim == 2 else np.zeros(3)
    full[(0,) * given.ndim] = given.item()
    return full


def case_of(fixed: PointSet, moving: PointSet, cost: RegistrationCost, start: ArrayLike) -> Case:
    """A registration: derivatives at its start, and the optimum."""
    value, gradient, hessian = cost.derivatives(start, fixed, moving)
    found = register(fixed, moving, cost, start)
    problem = {
        "fixed": targets(fixed),
        "moving": targets(moving),
        "fusion": cost.fusion,
        "outlier": outlier(cost.outlier),
        "line": fixed.dimension == 1,
    }
    shares = cost.inlier_probabilities(start, fixed, moving)
    return Case(
        problem,
        padded(start),
        float(value),
        padded(gradient),
        padded(hessian, 1.0),
        padded(found.theta),
        padded(found.covariance, 1.0),
        shares,
        int(found.iterations),
    )


def one_draw(seed: int) -> list[PointSet]:
    """Both sets of the outlier scene."""
    sets = scenarios.OUTLIERS.sample(1, np.random.default_rng(seed))
    return [PointSet(each.means[0], each.covariances[0]) for each in sets]


def planar_case(name: str, fusion: Any, off: float) -> Case:
    """A draw of the outlier scene, started off the truth."""
    fixed, moving = one_draw(len(name))
    at = scenarios.OUTLIERS.theta + off * np.array([1.0, -0.7, 0.15])
    return case_of(fixed, moving, RegistrationCost("d2d", fusion, OUTLIERS[name]), at)


def line_case(name: str, fusion: Any) -> Case:
    """The scene on a line, with a wide outlier component or none."""
    fixed, moving = line_scene(np.random.default_rng(3))
    model = {"none": None, "corrupted": CorruptedGaussian(0.2, [[100.0]])}[name]
    return case_of(fixed, moving, RegistrationCost("d2d", fusion, model), [2.4])


def doppler_case(start: ArrayLike) -> Case:
    """A pair of scans of a simulated drive, in a bend."""
    drive = simulate_drive(np.random.default_rng(7), duration=30.0)
    previous, current = (scan[:20] for scan in drive.scans[-2:])
    model = EgoMotionModel()
    problem = problem_of([ScanPair(previous, current, drive.mounting)], model)
    (pair,) = problem.pairs
    at = np.asarray(start)
    bound = problem.bind(at)
    value, gradient, hessian = problem.derivatives(bound)
    found = estimate_ego_motion(previous, current, drive.mounting, initial=at)
    rows = targets(pair.moving)
    measured = current.doppler, current.azimuth, current.sigma_doppler, current.sigma_azimuth
    for row, own in zip(rows, zip(*measured, strict=True), strict=True):
        row["measured"] = own
    described = {
        "fixed": targets(pair.fixed),
        "moving": rows,
        "fusion": "likelihood",
        "outlier": outlier(model.outlier),
        "interval": pair.interval,
        "dopplerWidth": model.doppler_width,
        "mounting": {"x": drive.mounting.x, "y": drive.mounting.y, "yaw": drive.mounting.yaw},
    }
    return Case(
        described,
        at,
        value.item(),
        gradient,
        hessian,
        found.theta,
        found.covariance,
        problem.inlier_shares(bound),
        int(found.iterations),
    )


CASES = {
    **{
        f"{fusion}-{name}": lambda n=name, f=fusion: planar_case(n, f, 0.4)
        for fusion in ("likelihood", "summing")
        for name in OUTLIERS
    },
    **{
        f"line-{fusion}-{name}": lambda n=name, f=fusion: line_case(n, f)
        for fusion in ("likelihood", "summing")
        for name in ("none", "corrupted")
    },
    **{
        f"far-{off}-{name}": lambda n=name, o=off: planar_case(n, "likelihood", o)
        for off in (2.0, 6.0, -4.0)
        for name in OUTLIERS
    },
    "doppler": lambda: doppler_case([1.9, 0.05, 0.02]),
    "doppler-far": lambda: doppler_case([1.0, 0.3, 0.4]),
}

EVALUATE = """
const [problem, start] = arguments;
for (const target of problem.moving) {
  const own = target.measured;
  if (own) target.doppler = d2d.dopplerMeasurement(...own, problem.mounting);
}
const found = d2d.register(problem, start);
const {value, gradient, hessian, shares} = d2d.evaluate(problem, start);
return {value, gradient, hessian, shares, theta: found.theta, covariance: found.covariance,
        converged: found.converged, iterations: found.iterations};
"""


def assert_agrees(got: dict[str, Any], case: Case, fields: tuple[str, ...]) -> None:
    """What the page computed is what d2d did."""
    for field in fields:
        expected = np.asarray(getattr(case, field))
        off = np.abs(np.array(got[field]) - expected).max()
        assert off <= EXACT * max(1.0, np.abs(expected).max()), f"{field} is {off:.2e} off"


@pytest.mark.parametrize("name", CASES)
def test_the_engine_equals_d2d(page: Any, name: str):
    """Value, gradient, Hessian and inlier probabilities, to 1e-9; the optimum to 1e-6 sigma.

    A descent ends where rounding hides what a step gains, some 4e-7 sigma from the optimum.
    """
    case = CASES[name]()
    got = page(EVALUATE, case.problem, case.start.tolist())
    assert got["converged"]
    assert got["iterations"] == pytest.approx(case.iterations, abs=2)
    assert_agrees(got, case, ("value", "gradient", "hessian", "shares"))
    sigma = np.sqrt(np.diag(case.covariance))
    assert (np.abs(got["theta"] - case.theta) <= 1e-6 * sigma).all()
    assert (np.abs(got["covariance"] - case.covariance) <= 1e-6 * np.outer(sigma, sigma)).all()


def test_the_surface_is_the_cost(page: Any):
    """The fast surface of a map equals the cost, cell by cell, for every outlier model."""
    xs, ys, turn = [3.0, 4.5, 6.0], [-2.0, 0.5], 0.2
    for name in OUTLIERS:
        for fusion in ("likelihood", "summing"):
            case = planar_case(name, fusion, 0.4)
            got = page("return [...d2d.surface(...arguments)]", case.problem, xs, ys, turn)
            expected = [
                page("return d2d.evaluate(...arguments).value", case.problem, [x, y, turn])
                for y in ys
                for x in xs
            ]
            np.testing.assert_allclose(got, expected, rtol=1e-11)


@pytest.mark.parametrize("fusion", ["likelihood", "summing"])
def test_a_count_stands_for_equal_targets(page: Any, fusion: Any):
    """Breaks if a target that counts three times is not what three equal targets are to d2d."""
    fixed, moving = one_draw(1)
    times = np.where(np.arange(fixed.size) == 2, 3, 1)
    every = [
        PointSet(each.means.repeat(times, axis=0), each.covariances.repeat(times, axis=0))
        for each in (fixed, moving)
    ]
    at = scenarios.OUTLIERS.theta + 0.3
    case = case_of(*every, RegistrationCost("d2d", fusion, OUTLIERS["corrupted"]), at)
    counted = [
        [{**row, "count": int(n)} for row, n in zip(targets(each), times, strict=True)]
        for each in (fixed, moving)
    ]
    problem = {**case.problem, "fixed": counted[0], "moving": counted[1]}
    got = page(EVALUATE, problem, at.tolist())
    assert_agrees(got, case, ("value", "gradient", "hessian", "theta", "covariance"))
    alone = page("return [...d2d.surface(...arguments)]", problem, [at[0]], [at[1]], at[2])
    assert alone[0] == pytest.approx(case.value, rel=1e-11)


def test_annealing_ends_where_that_of_d2d_does(page: Any):
    """Breaks if standard deviations are inflated otherwise."""
    case = planar_case("corrupted", "likelihood", 0.4)
    cost = RegistrationCost(outlier=OUTLIERS["corrupted"])
    expected = register(*one_draw(len("corrupted")), cost, scales=ANNEALED)
    got = page("return d2d.register(arguments[0], [0, 0, 0], d2d.ANNEALED)", case.problem)
    np.testing.assert_allclose(got["theta"], expected.theta, atol=EXACT)
    np.testing.assert_allclose(got["covariance"], expected.covariance, atol=EXACT)


def test_polar_measurements_have_the_covariances_of_d2d(page: Any):
    expected = targets(PointSet.from_polar([20.0], [0.7], 0.2, 0.03))[0]
    got = page("return d2d.fromPolar(20, 0.7, 0.2, 0.03)")
    assert got == pytest.approx(expected, rel=1e-12)


def test_chi_square_is_that_of_scipy(page: Any):
    """Breaks if series and continued fraction do not meet, or many degrees lose digits."""
    for n in (1, 2, 3, 6, 30, 900, 300_000):
        shares = [1e-4, 0.025, 0.5, 0.95, 0.975, 0.99, 1.0 - 1e-6]
        quantiles = [
            page("return d2d.chiSquareQuantile(...arguments)", share, n) for share in shares
        ]
        expected = scipy.stats.chi2.ppf(shares, n)
        np.testing.assert_allclose(quantiles, expected, rtol=EXACT, err_msg=f"{n}")
        below = [page("return d2d.lowerGamma(...arguments)", n / 2, x / 2) for x in expected]
        np.testing.assert_allclose(below, shares, rtol=EXACT, err_msg=f"{n}")
        density = [page("return d2d.chiSquareDensity(...arguments)", x, n) for x in expected]
        np.testing.assert_allclose(density, scipy.stats.chi2.pdf(expected, n), rtol=1e-8)
