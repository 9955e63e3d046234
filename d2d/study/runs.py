"""Monte Carlo runs of a scenario, the same with any number and kind of workers."""

import os
from collections.abc import Sequence
from dataclasses import fields
from typing import Literal, NamedTuple, Protocol

import joblib
import numpy as np
from numpy.typing import ArrayLike, NDArray
from tqdm import tqdm

from d2d import rigid
from d2d._checks import check_count, check_schedule, check_shape
from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.credibility import Credibility, credibility
from d2d.point_set import PointSet
from d2d.problem import Estimate
from d2d.registration import anneal, multi_start

THREADS = os.cpu_count() or 1  # the kernel releases the GIL; no result depends on their number
CHUNK = 1000  # runs in one batched call, a worker's unit of work; bounds the memory


class Scene(Protocol):
    """A true motion and noisy scans before and after it, for `monte_carlo`."""

    @property
    def theta(self) -> Array:
        """True motion (P,), [t_x] or [t_x, t_y, phi_z] in m, m, rad."""

    def sample(self, runs: int, rng: np.random.Generator) -> tuple[PointSet, PointSet]:
        """Draw the fixed and the moving set, of batch shape (runs,)."""


Initial = Literal["truth", "zero"] | ArrayLike


class MonteCarlo(NamedTuple):
    """Estimates of all runs of one condition."""

    errors: Array  # (runs, P), estimate minus truth, in m, m, rad
    covariances: Array  # (runs, P, P), inverse Hessians; nan where not converged
    converged: NDArray[np.bool_]  # (runs,)
    iterations: NDArray[np.int64]  # (runs,)

    @classmethod
    def of(cls, estimates: Estimate, theta: Array) -> "MonteCarlo":
        """Estimates (runs,) of the motion ``theta`` (P,)."""
        return cls(
            estimates.theta - theta, estimates.covariance, estimates.converged, estimates.iterations
        )

    @property
    def rmse(self) -> Array:
        """Root mean square error (P,) of the converged runs."""
        return np.asarray(np.sqrt(np.mean(self.errors[self.converged] ** 2, axis=0)))

    @property
    def credibility(self) -> Credibility:
        """Credibility of the covariances of the converged runs."""
        return credibility(self.errors[self.converged], self.covariances[self.converged])


class StatedCovariances(NamedTuple):
    """Errors of estimates, and several covariances that are stated for them."""

    errors: Array  # (n, P)
    covariances: dict[str, Array]  # (n, P, P) each, by name

    def credibility(self, name: str) -> Credibility:
        """Credibility of one of the covariances."""
        return credibility(self.errors, self.covariances[name])


def stacked(estimates: Sequence[Estimate]) -> Estimate:
    """Single estimates (N) as a batch (N,)."""
    return Estimate(
        *(np.array([getattr(estimate, f.name) for estimate in estimates]) for f in fields(Estimate))
    )


def credibility_of(
    estimate: Estimate, theta: ArrayLike, covariance: Array | None = None
) -> Credibility:
    """Credibility of converged estimates (N,) of ``theta`` (3,), perhaps with other covariances."""
    stated = estimate.covariance if covariance is None else covariance
    good = np.isfinite(stated).all(axis=(1, 2))
    return credibility((estimate.theta - np.asarray(theta))[good], stated[good])


def monte_carlo(
    scenario: Scene,
    cost: RegistrationCost,
    runs: int = 1000,
    seed: int = 0,
    initial: Initial = "truth",
    n_jobs: int | None = None,
    *,
    scales: Sequence[float] = (1.0,),
) -> MonteCarlo:
    """Register many noisy draws of a scenario and compare with the truth.

    Every run starts at ``initial``: "truth", "zero", (P,), or several starts (S, P), of which the
    lowest optimum is kept; ``scales`` is an inflation schedule by itself, see `scheduled`.  The
    ``n_jobs`` are worker processes, 1 unless given or set by ``joblib.parallel_config``.
    """
    full, rest = divmod(check_count("runs", runs), CHUNK)
    sizes = [CHUNK] * full + [rest] * (rest > 0)
    seeds = np.random.SeedSequence(check_count("seed", seed, minimum=0)).spawn(len(sizes))
    starts = _starts(scenario, initial)
    finished = joblib.Parallel(n_jobs=n_jobs, return_as="generator")(
        joblib.delayed(_run)(scenario, cost, size, child, starts, scales)
        for size, child in zip(sizes, seeds, strict=True)
    )
    # the progress bar appears only on a terminal, and only if the runs take a while
    parts = list(tqdm(finished, total=len(sizes), unit="chunk", delay=2.0, disable=None))
    return MonteCarlo(*map(np.concatenate, zip(*parts, strict=True)))


def _starts(scenario: Scene, initial: Initial) -> Array:
    if isinstance(initial, str):
        if initial not in ("truth", "zero"):
            raise ValueError(f"initial must be 'truth', 'zero' or an array, but is {initial!r}")
        return scenario.theta * (initial == "truth")
    starts = rigid.motion("initial", initial, 1 if len(scenario.theta) == 1 else 2)
    check_shape("initial", starts, "(P,)", "(S, P)")
    return starts


def scheduled(
    fixed: PointSet,
    moving: PointSet,
    cost: RegistrationCost,
    initial: Array,
    scales: Sequence[float],
    threads: int = 1,
) -> Estimate:
    """Follow an inflation schedule, without the plain descent that `d2d.register` tries as well."""
    return anneal(cost.problem(fixed, moving), initial, check_schedule("scales", scales), threads)


def _run(
    scenario: Scene,
    cost: RegistrationCost,
    runs: int,
    seed: np.random.SeedSequence,
    starts: Array,
    scales: Sequence[float],
) -> MonteCarlo:
    fixed, moving = scenario.sample(runs, np.random.default_rng(seed))
    solve = scheduled if starts.ndim == 1 else multi_start
    return MonteCarlo.of(solve(fixed, moving, cost, starts, scales), scenario.theta)
