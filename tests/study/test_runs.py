"""Monte Carlo runs: the same results on any number of workers."""

import joblib
import numpy as np
import pytest

from d2d import register
from d2d.study import MonteCarlo, monte_carlo, scenarios
from tests.strategies import ROBUST


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


@pytest.mark.filterwarnings("default")  # distributed's own clean-up warns
def test_processes_do_not_change_the_results() -> None:
    """Two workers, who import the package afresh, and unchanged on a real cluster of processes."""
    alone = monte_carlo(scenarios.OVERLAPPED, ROBUST, runs=2300)
    assert_identical(alone, monte_carlo(scenarios.OVERLAPPED, ROBUST, runs=2300, n_jobs=2))
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster),
        joblib.parallel_config(backend="dask"),
    ):
        assert_identical(alone, monte_carlo(scenarios.OVERLAPPED, ROBUST, runs=2300))


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
