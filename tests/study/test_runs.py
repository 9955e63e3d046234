"""Monte Carlo runs: the same results on any number of workers, and sweeps that can be killed."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import joblib
import numpy as np
import pytest

from d2d import ANNEALED, CorruptedGaussian, RegistrationCost, register, start_grid
from d2d.study import Condition, MonteCarlo, monte_carlo, runs, scenarios, sweep

LIKELIHOOD = RegistrationCost()
ROBUST = RegistrationCost(outlier=CorruptedGaussian(0.2, 100 * np.eye(2)))


def assert_identical(first: MonteCarlo, second: MonteCarlo) -> None:
    for name in ("errors", "covariances", "converged", "iterations"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


@pytest.fixture
def small_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs, "CHUNK", 40)


def test_equals_registering_the_draws_one_by_one() -> None:
    """A mix-up of truth, sign or order between draws and estimates would show."""
    result = monte_carlo(scenarios.OVERLAPPED, ROBUST, runs=20, seed=3)
    child = np.random.SeedSequence(3).spawn(1)[0]
    fixed, moving = scenarios.OVERLAPPED.sample(20, np.random.default_rng(child))
    truth = scenarios.OVERLAPPED.theta
    for run in range(20):
        estimate = register(fixed[run], moving[run], ROBUST, truth)
        np.testing.assert_array_equal(result.errors[run], estimate.theta - truth)
        np.testing.assert_array_equal(result.covariances[run], estimate.covariance)


def test_likelihood_is_credible_and_the_sum_is_not() -> None:
    """1000 runs of the overlapped scene from the truth, as the thesis ran them."""
    credible = monte_carlo(scenarios.OVERLAPPED, LIKELIHOOD).credibility
    summing = monte_carlo(scenarios.OVERLAPPED, RegistrationCost(fusion="summing")).credibility
    print(f"likelihood: ANEES {credible.anees:.3f} in {credible.bounds.round(3)}")
    print(f"summing: ANEES {summing.anees:.3f}, I2 {summing.inclination:.1f} dB")
    assert credible.consistent
    assert summing.inclination < -3.0


def test_workers_do_not_change_the_results(small_chunks: None) -> None:
    """Seeds belong to chunks, not to workers."""
    alone = monte_carlo(scenarios.OVERLAPPED, ROBUST, runs=150, seed=1)
    with joblib.parallel_config(backend="threading", n_jobs=2):
        assert_identical(alone, monte_carlo(scenarios.OVERLAPPED, ROBUST, runs=150, seed=1))
    other_seed = monte_carlo(scenarios.OVERLAPPED, ROBUST, runs=150, seed=2)
    assert (other_seed.errors != alone.errors).all()


def test_processes_do_not_change_the_results() -> None:
    """The chunk size is that of the package here: workers import it afresh."""
    alone = monte_carlo(scenarios.OVERLAPPED, ROBUST, runs=2300)
    assert_identical(alone, monte_carlo(scenarios.OVERLAPPED, ROBUST, runs=2300, n_jobs=2))


@pytest.mark.filterwarnings("default")  # distributed's own clean-up warns
def test_dask_cluster_gives_identical_results() -> None:
    """The same call, unchanged, on a real cluster of processes."""
    distributed = pytest.importorskip("distributed")
    alone = monte_carlo(scenarios.OVERLAPPED, ROBUST, runs=2300)
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster),
        joblib.parallel_config(backend="dask"),
    ):
        assert_identical(alone, monte_carlo(scenarios.OVERLAPPED, ROBUST, runs=2300))


def test_safe_starts_find_the_truth() -> None:
    """From zero, 5 m and 15 degrees off: the schedule and the grid succeed where zero fails."""
    angles = np.deg2rad([-20.0, 0.0, 20.0])
    at_truth = monte_carlo(scenarios.OVERLAPPED, ROBUST)

    def share(**start: object) -> float:
        found = monte_carlo(scenarios.OVERLAPPED, ROBUST, **start)  # type: ignore[arg-type]
        return float(np.isclose(found.errors, at_truth.errors, atol=1e-4).all(axis=-1).mean())

    plain = share(initial="zero")
    annealed = share(initial="zero", scales=ANNEALED)
    grid = share(initial=start_grid(6.0, 3.0, angles))
    print(f"from zero: plain {plain:.1%}, annealed {annealed:.1%}, multi-start {grid:.1%}")
    assert plain < 0.97
    assert annealed >= 0.999
    assert grid >= 0.999


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"runs": 0}, "runs"),
        ({"runs": 10.0}, "runs must be an integer"),
        ({"runs": "ten"}, "runs must be an integer"),
        ({"seed": -1}, "seed must be an integer"),
        ({"seed": 0.5}, "seed must be an integer"),
        ({"seed": None}, "seed must be an integer"),
        ({"cost": "d2d"}, "cost must be a RegistrationCost"),
        ({"scenario": None}, "scenario must be a Scene"),
        ({"scales": 2.0}, "scales must be a sequence"),
        ({"scales": "wide"}, "scales must be"),
        ({"scales": None}, "scales must be"),
        ({"initial": "here"}, "initial"),
        ({"initial": [0.0, 0.0]}, "initial"),
        ({"initial": np.zeros((2, 2, 3))}, "initial"),
        ({"scales": ()}, "scales"),
    ],
)
def test_bad_arguments_are_named(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=f"^{message}"):
        monte_carlo(**{"scenario": scenarios.OVERLAPPED, "cost": ROBUST, **arguments})


def test_a_schedule_may_be_any_sequence() -> None:
    """Breaks if a list or an array of scales is another condition than the tuple."""
    expected = monte_carlo(scenarios.OVERLAPPED, ROBUST, runs=5, scales=(2.0, 1.0))
    for scales in ([2, 1], np.array([2.0, 1.0])):
        found = monte_carlo(scenarios.OVERLAPPED, ROBUST, runs=5, scales=scales)
        assert_identical(found, expected)


def conditions() -> dict[str, Condition]:
    return {
        f"seed-{seed}": Condition(scenarios.OVERLAPPED, ROBUST, runs=90, seed=seed)
        for seed in range(4)
    }


def test_sweep_equals_monte_carlo_and_reads_back(tmp_path: Path, small_chunks: None) -> None:
    """Chunks of neighbouring conditions must not be mixed up."""
    first = sweep(conditions(), tmp_path)
    stamps = {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    again = sweep(conditions(), tmp_path)
    assert stamps == {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    for seed in range(4):
        alone = monte_carlo(scenarios.OVERLAPPED, ROBUST, runs=90, seed=seed)
        assert_identical(first[f"seed-{seed}"], alone)
        assert_identical(again[f"seed-{seed}"], alone)


def test_sweep_runs_a_changed_condition_again(tmp_path: Path) -> None:
    """A file of other parameters must not be taken for the result."""
    before = sweep({"one": Condition(scenarios.OVERLAPPED, ROBUST, runs=10)}, tmp_path)
    after = sweep({"one": Condition(scenarios.OVERLAPPED, LIKELIHOOD, runs=10)}, tmp_path)
    assert (before["one"].errors != after["one"].errors).all()


def test_sweep_names_a_foreign_file(tmp_path: Path) -> None:
    (tmp_path / "one.npz").write_bytes(b"not a result")
    with pytest.raises(ValueError, match=r"one\.npz"):
        sweep({"one": Condition(scenarios.OVERLAPPED, ROBUST, runs=10)}, tmp_path)


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The bytes of a result."""
    folder = tmp_path_factory.mktemp("sweep")
    sweep({"one": Condition(scenarios.OVERLAPPED, ROBUST, runs=10)}, folder)
    return (folder / "one.npz").read_bytes()


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.6, 0.9, 0.999])
def test_sweep_names_a_truncated_file(tmp_path: Path, stored: bytes, share: float) -> None:
    """Breaks if a full disk's remains end in zipfile's words, which do not say where."""
    (tmp_path / "one.npz").write_bytes(stored[: int(share * len(stored))])
    with pytest.raises(ValueError, match=r"one\.npz is not a complete result"):
        sweep({"one": Condition(scenarios.OVERLAPPED, ROBUST, runs=10)}, tmp_path)


def test_sweep_reads_a_damaged_file_as_it_was_or_names_it(tmp_path: Path, stored: bytes) -> None:
    """Breaks if a changed byte raises anything else, or gives other numbers."""
    condition = {"one": Condition(scenarios.OVERLAPPED, ROBUST, runs=10)}
    expected = sweep(condition, tmp_path / "whole")["one"]
    rng = np.random.default_rng(0)
    for _ in range(300):
        damaged = bytearray(stored)
        for place in rng.integers(len(stored), size=3):
            damaged[place] = rng.integers(256)
        (tmp_path / "one.npz").write_bytes(damaged)
        try:
            found = sweep(condition, tmp_path)["one"]
        except ValueError as error:
            assert "one.npz" in str(error)  # noqa: PT017
        else:
            assert_identical(found, expected)


def test_sweep_removes_what_a_killed_one_left(tmp_path: Path) -> None:
    """Breaks if half-written files pile up; other files in the folder are not touched."""
    for name in ("tmp0abc.part", "one.npz.part", "notes.txt"):
        (tmp_path / name).write_bytes(b"half")
    sweep({"one": Condition(scenarios.OVERLAPPED, ROBUST, runs=10)}, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["notes.txt", "one.npz"]


def test_a_result_is_written_anew_if_another_sweep_removes_its_part(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Breaks if a sweep that begins makes another one fail which shares its folder."""
    replace, calls = os.replace, []

    def interrupted(source: str, target: Path) -> None:
        calls.append(source)
        if len(calls) == 1:
            runs._remove_parts(tmp_path)
        replace(source, target)

    monkeypatch.setattr(runs.os, "replace", interrupted)
    result = sweep({"one": Condition(scenarios.OVERLAPPED, ROBUST, runs=10)}, tmp_path)
    assert len(calls) == 2
    monkeypatch.undo()
    again = sweep({"one": Condition(scenarios.OVERLAPPED, ROBUST, runs=10)}, tmp_path)
    assert_identical(result["one"], again["one"])


@pytest.mark.parametrize("name", ["../x", "/x", "a/b", "a\\b", "c:x", "", ".", "..", "x\0y", 7])
def test_sweep_writes_into_its_folder_only(tmp_path: Path, name: str) -> None:
    """Breaks if a name leads out of the folder, or into one that nobody made."""
    folder = tmp_path / "in" / "side"
    with pytest.raises(ValueError, match=r"^conditions must be keyed by plain file names"):
        sweep({name: Condition(scenarios.OVERLAPPED, ROBUST, runs=10)}, folder)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("bad", [None, [], {"one": None}], ids=str)
def test_sweep_names_what_is_no_condition(tmp_path: Path, bad: object) -> None:
    with pytest.raises(ValueError, match=r"^conditions"):
        sweep(bad, tmp_path)  # type: ignore[arg-type]


SLOW_SWEEP = """
import sys, time
from d2d import register
from d2d.study import Condition, runs, scenarios, sweep
from d2d import CorruptedGaussian, RegistrationCost
import numpy as np

def slow(*arguments):
    time.sleep(0.4)
    return register(*arguments)

runs.register = slow
cost = RegistrationCost(outlier=CorruptedGaussian(0.2, 100 * np.eye(2)))
sweep({f"seed-{s}": Condition(scenarios.OVERLAPPED, cost, runs=90, seed=s) for s in range(4)},
      sys.argv[1])
"""


def test_killed_sweep_resumes_without_loss(tmp_path: Path) -> None:
    """Killed in the middle, it leaves whole files only, and the next call does just the rest."""
    process = subprocess.Popen([sys.executable, "-c", SLOW_SWEEP, str(tmp_path)])
    deadline = time.monotonic() + 60.0
    while not list(tmp_path.glob("*.npz")) and time.monotonic() < deadline:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    kept = {path.name: path.stat().st_mtime_ns for path in tmp_path.glob("*.npz")}
    assert 1 <= len(kept) < 4
    results = sweep(conditions(), tmp_path)
    for seed in range(4):
        alone = monte_carlo(scenarios.OVERLAPPED, ROBUST, runs=90, seed=seed)
        assert_identical(results[f"seed-{seed}"], alone)
    for name, stamp in kept.items():
        assert (tmp_path / name).stat().st_mtime_ns == stamp
