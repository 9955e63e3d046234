"""The protocol of covariances: what is fitted where, what each model states, and what a cell is."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d.radar import (
    Comparison,
    ErrorBudget,
    Mounting,
    Recording,
    SensorErrors,
    compare,
    simulate_drive,
)
from d2d.radar.evaluation.fit import BudgetFit
from d2d.radar.simulation.drive import CAR_SPEED
from d2d.study.road import protocol
from d2d.study.road.drive import HORIZON, Drive
from d2d.study.road.protocol import (
    ALL,
    BARE,
    CAUSES,
    CELLS,
    CONSTANT,
    EMPTY,
    FACTORS,
    FITTED,
    LEVELS,
    MODELS,
    PERIOD,
    QUIET,
    STORED,
    Cell,
    ProtocolResult,
    changed,
    compare_cell,
    fitted_budget,
    is_quiet,
    rows_of,
    unfiltered,
)
from d2d.study.road.protocol_tables import chart, section

SCALE = np.array([0.01, 0.02, 0.002])
MOUNTINGS = Mounting(3.5, 0.6, 0.4), Mounting(3.5, -0.6, -0.4)
ALONE = {"front": 0, "side": 1}
STATED = ErrorBudget(azimuth=0.002, doppler=0.02, scale=0.001, lag=0.02, neighbours=1.0)


def made_up(seed: int, wrong: float = 1.0, count: int = 400) -> Comparison:
    """Errors that are larger than stated, by a factor on the standard deviations."""
    rng = np.random.default_rng(seed)
    sigmas = SCALE * rng.uniform(0.5, 2.0, (count, 1))
    errors = wrong * sigmas * rng.standard_normal((count, 3))
    return Comparison(0.075 * np.arange(count), errors, sigmas[:, :, None] ** 2 * np.eye(3), 1, 1)


def tracks(seed: int, wrong: float = 1.0, count: int = 400) -> dict[str, Comparison]:
    return {name: made_up(seed, wrong, count) for name in (BARE, EMPTY, FITTED, STORED)}


def simulated(duration: float = 6.0, signs: tuple[float, float] = (0.0, 0.0)) -> Drive:
    """Two radars of one vehicle, with slow errors of these signs."""
    own, world = [], None
    for at, sign in zip(MOUNTINGS, signs, strict=True):
        rng = np.random.default_rng(3)
        errors = SensorErrors(azimuth=0.02 * sign, doppler=0.1 * sign)
        drive = simulate_drive(rng, duration, CAR_SPEED, mounting=at, world=world, errors=errors)
        world, truth = drive.world, drive.truth
        # a reference is never exact: of an acceleration of zero there is no effect of a lag
        known = replace(truth, theta=truth.theta + 1e-3 * rng.standard_normal(truth.theta.shape))
        own.append(Recording(drive.scans, drive.mounting, known, STATED))
    return Drive("simulated", own)


def test_the_drive_that_is_judged_takes_no_part_in_the_fit():
    """Breaks if a number knows the drive that it is judged on, or sees fewer sensors before."""

    def anees(**wrong: float):
        drives = {name: tracks(k, wrong.get(name, 1.0)) for k, name in enumerate("abc")}
        front = {
            name: tracks(5 + k, wrong.get(f"front_{name}", 1.0)) for k, name in enumerate("ab")
        }
        rows = rows_of({ALL: drives, "front": front})
        return rows.set_index(["cell", "drive", "model"])["ANEES"]

    plain, own, other = anees(), anees(a=3.0), anees(b=3.0)
    for model in (CONSTANT, FACTORS):
        assert own[ALL, "a", model] == pytest.approx(9.0 * plain[ALL, "a", model])
        assert other[ALL, "a", model] < 0.6 * plain[ALL, "a", model]
        assert other["front", "a", model] < 0.6 * plain["front", "a", model]
        assert anees(front_b=3.0)["front", "a", model] == plain["front", "a", model]


def test_factors_and_matrix_are_the_likeliest():
    """Breaks if what is stated is not what was fitted, or a measure is another's."""
    rows = rows_of({ALL: {name: tracks(k, 3.0, 2000) for k, name in enumerate("ab")}})
    own = rows[rows["drive"] == "a"].set_index("model")
    assert list(own.index) == [*MODELS]
    assert_allclose(own.loc[[CONSTANT, FACTORS], "ANEES"], 1.0, atol=0.12)
    assert own.loc[STORED, "ANEES"] == pytest.approx(9.0, rel=0.1)
    assert_allclose(own.loc[FACTORS, [*LEVELS]].to_numpy(float), [0.5, 0.95, 0.99], atol=0.03)
    assert own.loc[FACTORS, "log score"] < own.loc[[CONSTANT, STORED], "log score"].min()
    difference = own.loc[FACTORS, "log score"] - own.loc[STORED, "log score"]
    assert own.loc[FACTORS, "difference"] == pytest.approx(difference)
    assert own.loc[STORED, "difference"] == 0.0


def test_a_budget_is_fitted_to_the_input_of_a_filter():
    """Breaks if an effect is another's, or is not that of one standard deviation."""
    signs = product((1.0, -1.0), repeat=2)
    found = fitted_budget([unfiltered(simulated(20.0, each)) for each in signs], STATED).budget
    assert found.azimuth == pytest.approx(0.02, rel=0.2)
    assert found.doppler == pytest.approx(0.1, rel=0.2)
    assert found.neighbours == STATED.neighbours
    right = fitted_budget([unfiltered(simulated(20.0))], STATED).budget
    assert right.azimuth < 0.01
    assert right.doppler < 0.03


def test_the_estimates_are_those_of_the_public_track():
    """Breaks if the models are given other estimates than a user gets, or at another time."""
    drive = simulated()
    for budget in (None, STATED):
        found = compare_cell(drive, Cell(), ALONE, budget)
        options = {"horizon": HORIZON, "budget": budget}
        expected = compare(drive.track(**options), drive.reference)
        assert_array_equal(found.errors, expected.errors)
        assert_array_equal(found.covariances, expected.covariances)
        assert found.share == expected.converged


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
    times = compare_cell(drive, CELLS["silence"], ALONE, STATED).times - start
    assert ((times % PERIOD) >= PERIOD - QUIET).all()


@pytest.mark.parametrize("count", [2, 5])
def test_the_tables_hold_every_model_in_every_cell(count, tmp_path):
    """Breaks if a cell or drive is left out, two drives get an interval, or a page shows nan."""
    names = [f"drive {i}" for i in range(count)]
    few = {name: own for name, own in tracks(0).items() if name in (FITTED, STORED)}
    cells = {cell: dict.fromkeys(names, few) for cell in CELLS}
    cells[ALL] = {name: tracks(i, 1.5) for i, name in enumerate(names)}
    cells["side"] = cells["side"] | {names[0]: tracks(0, count=protocol.FEWEST - 1)}
    rows = rows_of(cells)
    assert names[0] not in set(rows.loc[rows["cell"] == "side", "drive"])
    budget = BudgetFit(STATED, CAUSES, np.ones(4), np.ones((2, 4)), 0.0, 10)
    text = section("A data set", ProtocolResult(dict.fromkeys(names, budget), rows), STATED)
    assert "nan" not in text
    for name in (*MODELS, *(cell.removesuffix(" targets") for cell in CELLS), *names):
        assert name in text
    assert ("±" in text.split("\n\n")[1]) == (count > 2)
    assert ("[" in text.split("**")[6]) == (count == 2)
    chart({"A data set": rows}, tmp_path / "chart.png")
    assert (tmp_path / "chart.png").stat().st_size > 10_000
