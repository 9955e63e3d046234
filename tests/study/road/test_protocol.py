"""The protocol of covariances: what is fitted where, what each model states, and what a cell is."""

from itertools import product

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d.radar import ErrorBudget, Mounting, Recording, simulate_drive, track
from d2d.study.road.drive import Drive
from d2d.study.road.models import (
    ABLATIONS,
    BUDGET,
    CAUSES,
    CONSTANTS,
    FEWEST,
    MODELS,
    WINDOW,
    Estimates,
    spread,
)
from d2d.study.road.protocol import (
    ALL,
    CELLS,
    LEVELS,
    PERIOD,
    QUIET,
    Cell,
    Found,
    changed,
    estimated,
    fit_others,
    followed,
    is_quiet,
    measure,
    protocol,
)
from d2d.study.road.protocol_tables import chart, section

SCALE = np.array([0.01, 0.02, 0.002])
AS_THEY_ARE = "inverse Hessian", "propagated noise", "stored budget"
FITTED = [name for name in MODELS if name not in AS_THEY_ARE]
MOUNTINGS = Mounting(3.5, 0.6, 0.4), Mounting(3.5, -0.6, -0.4)
ALONE = {"front": 0, "side": 1}
STATED = ErrorBudget(azimuth=0.002, doppler=0.02, scale=0.001, lag=0.02)


def matrices(rng: np.random.Generator, count: int, scale: np.ndarray = SCALE) -> np.ndarray:
    root = rng.standard_normal((count, 3, 5)) * scale[:, None]
    return root @ np.swapaxes(root, -1, -2)


def errors_of(rng: np.random.Generator, covariances: np.ndarray) -> np.ndarray:
    white = rng.standard_normal((len(covariances), 3, 1))
    return (np.linalg.cholesky(covariances) @ white)[..., 0]


def made_up(seed: int, truth: str = CONSTANTS, count: int = 400, **parameters) -> Estimates:
    """Estimates whose errors are what a model states with these parameters."""
    rng = np.random.default_rng(seed)
    hessian, noise = matrices(rng, count), matrices(rng, count, 2.0 * SCALE)
    carry, budget = matrices(rng, count, 0.5 * SCALE), matrices(rng, count)
    dependence = matrices(rng, count, 0.2 * SCALE)
    columns = rng.normal(0.0, 5.0, (count, len(CAUSES), 3, 1))
    effects = columns @ columns.swapaxes(2, 3)
    theta = rng.standard_normal((count, 3)) * SCALE
    times = 0.075 * np.arange(count)
    own = Estimates(
        times, theta, np.zeros((count, 3)), hessian, noise, carry, budget, dependence, effects
    )
    given = parameters or {"constants": 3.0 * SCALE}
    stated = MODELS[truth].covariances(given, own)
    return own._replace(errors=errors_of(rng, stated))


def simulated(duration: float = 6.0) -> Drive:
    """Two radars of one vehicle."""
    drives = [
        simulate_drive(np.random.default_rng(3), duration=duration, mounting=at) for at in MOUNTINGS
    ]
    own = [Recording(drive.scans, drive.mounting, drive.truth, STATED) for drive in drives]
    return Drive("simulated", own)


def flat(parameters: dict[str, np.ndarray]) -> np.ndarray:
    return np.concatenate([np.ravel(value) for value in parameters.values()])


# ---- What is fitted where


def test_the_drive_that_is_judged_takes_no_part_in_the_fit():
    """Breaks if a parameter knows anything of the drive that it is judged on."""
    drives = {name: made_up(seed, count=150) for seed, name in enumerate("abc")}
    before = fit_others(drives)
    for seed, name in enumerate("abc"):
        other = made_up(100 + seed, count=150)
        columns = {key: 5.0 * value for key, value in other._asdict().items() if key != "times"}
        after = fit_others(drives | {name: other._replace(**columns)})
        for model, drive in product(FITTED, drives):
            was, now = (flat(found[drive][model]) for found in (before, after))
            assert np.array_equal(was, now) == (drive == name), model
    assert not any(before["a"][model] for model in AS_THEY_ARE)


def test_nothing_is_fitted_in_another_cell():
    """Breaks if a model is allowed to see fewer sensors before it is judged with them."""
    cells = {
        ALL: {name: Found(made_up(seed), 1.0) for seed, name in enumerate("ab")},
        "front": {name: Found(made_up(seed + 5), 0.9) for seed, name in enumerate("ab")},
    }
    before, was = protocol(cells)
    worse = {
        name: found._replace(
            estimates=found.estimates._replace(errors=4.0 * found.estimates.errors)
        )
        for name, found in cells["front"].items()
    }
    after, now = protocol(cells | {"front": worse})
    assert all(
        np.array_equal(flat(before[name][model]), flat(after[name][model]))
        for name in "ab"
        for model in FITTED
    )
    own = (was["cell"] == "front") & was["model"].isin(FITTED)
    assert_allclose(now.loc[own, "ANEES"], 16.0 * was.loc[own, "ANEES"])


def test_what_is_stated_does_not_depend_on_errors_nor_on_later_estimates():
    """Breaks if a model looks at the reference, or at what comes later, while driving."""
    parameters = fit_others({name: made_up(seed) for seed, name in enumerate("ab")})["a"]
    own = made_up(7)
    later = own._replace(
        errors=own.errors[::-1],
        theta=np.where(own.times[:, None] > 15.0, 9.0 * own.theta, own.theta),
    )
    for name, model in MODELS.items():
        stated, other = (model.covariances(parameters[name], each) for each in (own, later))
        until = own.times <= 15.0
        assert_array_equal(stated[until], other[until], err_msg=name)
        assert np.linalg.eigvalsh(stated).min() > 0.0


# ---- The models


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("inverse Hessian × 1 factor", {"factors": np.array([7.0])}),
        ("inverse Hessian × 3 factors", {"factors": np.array([2.0, 9.0, 30.0])}),
        ("noise × 3 factors", {"factors": np.array([2.0, 0.5, 5.0])}),
        ("constant matrix", {"matrix": np.diag(SCALE**2) + 0.5 * np.outer(SCALE, SCALE)}),
        ("inverse Hessian + 3 constants", {"constants": 4.0 * SCALE}),
        (CONSTANTS, {"constants": 4.0 * SCALE}),
        (
            "inverse Hessian × 1 factor + 3 constants",
            {"factors": np.array([6.0]), "constants": 2.0 * SCALE},
        ),
        ("noise × 1 factor + 3 constants", {"factors": np.array([2.0]), "constants": 3.0 * SCALE}),
        (BUDGET, {"causes": np.array([0.003, 0.002, 0.004, 0.001])}),
    ],
)
def test_a_model_finds_what_errors_were_made_with(name, parameters):
    """Breaks if what is fitted is not what is stated, or is not the likeliest."""
    drives = [made_up(seed, name, 1000, **parameters) for seed in (0, 1)]
    found = {other: model.fit(drives) for other, model in MODELS.items()}
    for key, value in parameters.items():
        assert_allclose(found[name][key], value, rtol=0.15, atol=0.05 * np.abs(value).max())
    own = made_up(2, name, 1000, **parameters)
    rows = pd.DataFrame(measure(Found(own, 1.0), found, bounds=False)).set_index("model")
    assert rows.loc[name, "ANEES"] == pytest.approx(1.0, abs=0.1)
    assert_allclose(rows.loc[name, [*LEVELS]].to_numpy(float), [0.5, 0.95, 0.99], atol=0.04)
    assert rows.loc[name, "log score"] <= rows["log score"].min() + 0.02


def test_the_covariances_are_what_their_names_say():
    """Breaks if a factor multiplies the carry, or a model lacks it."""
    own = made_up(0, count=30)

    def stated(name, **parameters):
        return MODELS[name].covariances(parameters, own)

    hessian, noise, carry = own.hessian, own.noise, own.carry
    root = np.diag(np.sqrt([2.0, 3.0, 4.0]))
    assert_allclose(stated("inverse Hessian"), hessian + carry)
    assert_allclose(stated("propagated noise"), noise + carry)
    assert_allclose(
        stated("inverse Hessian × 1 factor", factors=np.array([5.0])), 5.0 * hessian + carry
    )
    for name, base in (("inverse Hessian × 3 factors", hessian), ("noise × 3 factors", noise)):
        given = np.array([2.0, 3.0, 4.0])
        assert_allclose(stated(name, factors=given), root @ base @ root + carry)
    added = np.diag([0.01, 0.04, 0.09])
    for name, base in (("inverse Hessian + 3 constants", hessian), (CONSTANTS, noise)):
        given = np.array([0.1, 0.2, 0.3])
        assert_allclose(stated(name, constants=given), base + carry + added)
    for name, base in (
        ("inverse Hessian × 1 factor + 3 constants", hessian),
        ("noise × 1 factor + 3 constants", noise),
    ):
        given = {"factors": np.array([7.0]), "constants": np.array([0.1, 0.2, 0.3])}
        assert_allclose(stated(name, **given), 7.0 * base + carry + added)
    assert_allclose(stated("stored budget"), own.budget)
    causes = np.array([0.1, 0.0, 0.2, 0.0])
    added = 0.01 * own.effects[:, 0] + 0.04 * own.effects[:, 2]
    assert_allclose(stated(BUDGET, causes=causes), noise + carry + own.dependence + added)
    for place, cause in enumerate(CAUSES):
        kept = ABLATIONS[f"without {cause}"].covariances({"causes": np.delete(causes, place)}, own)
        left = own.effects[:, place] * causes[place] ** 2
        assert_allclose(kept, stated(BUDGET, causes=causes) - left, atol=1e-15)
    kept = ABLATIONS["without neighbours"].covariances({"causes": causes}, own)
    assert_allclose(kept, stated(BUDGET, causes=causes) - own.dependence, atol=1e-15)
    assert_allclose(stated("constant matrix", matrix=np.diag(SCALE)), [np.diag(SCALE)] * 30)


def test_the_adaptive_matrix_follows_the_scatter_of_the_estimates():
    """Breaks if the power is not found, or the spread is not that of the last seconds."""
    rng = np.random.default_rng(4)
    drives = []
    for _ in range(3):
        factor = np.exp(rng.standard_normal(20)).repeat(100)[:, None]
        own = made_up(1, count=2000)
        drives.append(
            own._replace(
                theta=factor * rng.standard_normal((2000, 3)) * SCALE,
                errors=factor * rng.standard_normal((2000, 3)) * SCALE,
            )
        )
    model = MODELS["adaptive matrix"]
    found = model.fit(drives[:2])
    assert 0.7 < found["power"] < 1.1
    sigmas = np.sqrt(model.covariances(found, drives[2])[:, 0, 0])
    assert np.corrcoef(np.log(sigmas), np.log(np.abs(drives[2].errors[:, 0])))[0, 1] > 0.4
    even = made_up(1, "constant matrix", 2000, matrix=np.diag(SCALE**2))
    assert model.fit([even])["power"] < 0.2


def test_the_spread_after_a_gap_is_the_usual_one():
    """Breaks if an estimate is extrapolated over a gap, or a few innovations count."""
    own = made_up(0, count=60)
    times = own.times + np.where(np.arange(60) >= 30, 2.0 * WINDOW, 0.0)
    found = spread(own._replace(times=times), np.diag(SCALE**2))
    usual = found == 1.0
    begins = np.arange(60) % 30 < FEWEST + 1
    assert_array_equal(usual, begins)


# ---- The estimates of a cell


def test_the_estimates_are_those_of_the_public_track():
    """Breaks if the models are given other estimates than a user gets, or at another time."""
    drive = simulated(3.0)
    own, accepted = followed(drive.rounds, STATED)
    options = {"horizon": 0.3, "progress": False}
    empty, stored = (track(drive.recordings, budget=b, **options) for b in (ErrorBudget(), STATED))
    plain = track(drive.recordings, carry=False, **options)
    assert accepted.all()
    assert_array_equal(own.theta, empty.theta)
    assert_allclose(own.noise + own.carry, empty.covariance, rtol=1e-9)
    assert_allclose(own.budget, stored.covariance, rtol=1e-9)
    squares = [getattr(STATED, cause) ** 2 for cause in CAUSES]
    added = np.einsum("p,npij->nij", squares, own.effects)
    assert_allclose(own.noise + own.carry + own.dependence + added, own.budget, rtol=1e-9)
    assert_allclose(own.hessian, plain.covariance, rtol=0.1, atol=1e-6)  # at a nearby optimum
    assert np.linalg.eigvalsh(own.carry).min() > 0.0


def test_errors_are_those_against_the_reference():
    found = estimated(simulated(), Cell(), ALONE)
    parameters = fit_others(dict.fromkeys("ab", found.estimates))["a"]
    rows = pd.DataFrame(measure(found, parameters, bounds=False)).set_index("model")
    assert found.share == 1.0
    assert (rows["estimates"] == len(found.estimates.times)).all()
    assert 0.5 < rows.loc["propagated noise", "ANEES"] < 1.6


def test_a_cell_has_the_sensors_and_targets_that_it_says():
    """Breaks if a cell is judged with what it should do without."""
    drive = simulated(12.0)
    for name, place in ALONE.items():
        (only,) = changed(drive, CELLS[name], ALONE).recordings
        assert only.mounting == MOUNTINGS[place]
    thinned = changed(drive, CELLS["15 targets"], ALONE).recordings
    for own, few in zip(drive.recordings, thinned, strict=True):
        assert [len(scan) for scan in few.scans] == [min(15, len(scan)) for scan in own.scans]
        for whole, part in zip(own.scans, few.scans, strict=True):
            assert np.isin(part.range, whole.range).all()
    start = drive.rounds[0].time
    quiet = changed(drive, CELLS["silence"], ALONE).recordings
    for s, (own, less) in enumerate(zip(drive.recordings, quiet, strict=True)):
        gone = {scan.time for scan in own.scans} - {scan.time for scan in less.scans}
        assert gone
        assert is_quiet(np.array(sorted(gone)), start, s, 2).all()
    judged_ones = estimated(drive, CELLS["silence"], ALONE).estimates.times - start
    assert ((judged_ones % PERIOD) >= PERIOD - QUIET).all()


def test_one_sensor_is_off_at_a_time_and_each_in_turn():
    """Breaks if all are off, or one is never."""
    times = np.arange(0.0, 60.0, 0.1) + 3.0
    off = np.array([is_quiet(times, 3.0, s, 4) for s in range(4)])
    assert off.sum(axis=0).max() == 1
    assert_allclose(off.any(axis=0).mean(), QUIET / PERIOD, atol=0.02)
    assert_allclose(off.mean(axis=1), QUIET / PERIOD / 4, atol=0.02)


# ---- Tables


@pytest.mark.parametrize("count", [2, 5])
def test_the_tables_hold_every_model_in_every_cell(count):
    """Breaks if a cell is left out, two drives get an interval, or a page shows nan."""
    names = [f"drive {i}" for i in range(count)]
    cells = {
        cell: {name: Found(made_up(i, count=60), 1.0) for i, name in enumerate(names)}
        for cell in (ALL, "front", "side")
    }
    text = section("A data set", *protocol(cells), STATED)
    assert "nan" not in text
    for name in (*MODELS, *ABLATIONS, *cells, *names):
        assert name in text
    assert ("±" in text.split("\n\n")[1]) == (count > 2)
    assert ("[" in text.split("**")[6]) == (count == 2)


def test_a_drive_with_hardly_an_estimate_is_left_out():
    """Breaks if a cell's mean rests on three estimates."""
    cells = {
        ALL: {name: Found(made_up(i), 1.0) for i, name in enumerate("ab")},
        "side": {"a": Found(made_up(0, count=5), 0.1), "b": Found(made_up(1), 1.0)},
    }
    _, rows = protocol(cells)
    assert set(rows.loc[rows["cell"] == "side", "drive"]) == {"b"}


def test_the_chart_shows_every_drive_or_their_mean(tmp_path):
    """Breaks if a cell of the chart lacks a drive, or a data set its name."""
    found = {}
    for data_set, count in (("two", 2), ("three", 3)):
        drives = {f"drive {i}": Found(made_up(i, count=60), 1.0) for i in range(count)}
        _, found[data_set] = protocol(dict.fromkeys(CELLS, drives))
    chart(found, tmp_path / "chart.png")
    assert (tmp_path / "chart.png").stat().st_size > 10_000
