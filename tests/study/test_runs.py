"""Monte Carlo runs: the same results on any number of workers."""

import joblib
import numpy as np
import pytest

from d2d import ANNEALED, CorruptedGaussian, RegistrationCost, register, start_grid
from d2d.study import MonteCarlo, monte_carlo, runs, scenarios

ROBUST = RegistrationCost(outlier=CorruptedGaussian(0.2, 100 * np.eye(2)))


def assert_identical(first: MonteCarlo, second: MonteCarlo) -> None:
    for name in ("errors", "covariances", "converged", "iterations"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


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


def test_workers_do_not_change_the_results(monkeypatch: pytest.MonkeyPatch) -> None:
    """Seeds belong to chunks, not to workers."""
    monkeypatch.setattr(runs, "CHUNK", 40)
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


def test_bad_arguments_are_named() -> None:
    for arguments, message in (
        ({"runs": 0}, "runs must be an integer"),
        ({"seed": None}, "seed must be an integer"),
        ({"initial": np.zeros((2, 2, 3))}, "initial must have the shape"),
        ({"scales": 2.0}, "scales must be a sequence"),
        ({"initial": "here"}, "initial must be 'truth', 'zero' or an array"),
        ({"initial": [0.0, 0.0]}, "initial must have the shape"),
    ):
        with pytest.raises(ValueError, match=f"^{message}"):
            monte_carlo(**{"scenario": scenarios.OVERLAPPED, "cost": ROBUST, **arguments})
