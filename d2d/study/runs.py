"""Monte Carlo runs of a scenario, from one core to a cluster, and sweeps that survive being killed.

Every chunk of runs draws from a child of the condition's seed, so that the results do not depend on
how many workers there are, what kind they are, or where a sweep was interrupted.
"""

import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Literal

import joblib
import numpy as np
from numpy.typing import ArrayLike, NDArray
from tqdm import tqdm

from d2d import rigid
from d2d._checks import Array
from d2d.cost import RegistrationCost
from d2d.credibility import Credibility, credibility
from d2d.registration import multi_start, register
from d2d.study.scenarios import Scenario

CHUNK = 1000  # runs in one batched call: bounds the memory, and is what one worker does at a time

Initial = Literal["truth", "zero"] | ArrayLike


@dataclass(frozen=True, eq=False)
class MonteCarlo:
    """Estimates of all runs of one condition.

    Attributes
    ----------
    errors : (runs, P) array
        Estimate minus truth, in m, m, rad.
    covariances : (runs, P, P) array
        Inverse Hessians; nan where not converged.
    converged : (runs,) array of bool
    iterations : (runs,) array of int
    """

    errors: Array
    covariances: Array
    converged: NDArray[np.bool_]
    iterations: NDArray[np.int64]

    @property
    def rmse(self) -> Array:
        """Root mean square error (P,) of the converged runs."""
        return np.asarray(np.sqrt(np.mean(self.errors[self.converged] ** 2, axis=0)))

    @property
    def credibility(self) -> Credibility:
        """Of the converged runs."""
        return credibility(self.errors[self.converged], self.covariances[self.converged])


@dataclass(frozen=True, eq=False)
class Condition:
    """What one Monte Carlo evaluation runs: the arguments of `monte_carlo`."""

    scenario: Scenario
    cost: RegistrationCost
    runs: int = 1000
    seed: int = 0
    initial: Initial = "truth"
    scales: tuple[float, ...] = (1.0,)

    def __post_init__(self) -> None:
        if self.runs < 1:
            raise ValueError(f"runs must be at least 1, but is {self.runs}")
        self.starts()

    def starts(self) -> Array:
        """The start (P,), or several (S, P) of which the best optimum wins."""
        if isinstance(self.initial, str):
            if self.initial not in ("truth", "zero"):
                raise ValueError(
                    f"initial must be 'truth', 'zero' or an array, but is {self.initial!r}"
                )
            return self.scenario.theta * (self.initial == "truth")
        starts = rigid.motion("initial", self.initial, self.scenario.targets.shape[-1])
        if starts.ndim > 2:
            raise ValueError(f"initial must have the shape (P,) or (S, P), but has {starts.shape}")
        return starts

    def chunks(self) -> list[tuple[int, np.random.SeedSequence]]:
        """Number of runs and seed of each chunk."""
        sizes = [CHUNK] * (self.runs // CHUNK) + [self.runs % CHUNK] * (self.runs % CHUNK > 0)
        return list(zip(sizes, np.random.SeedSequence(self.seed).spawn(len(sizes)), strict=True))


def monte_carlo(
    scenario: Scenario,
    cost: RegistrationCost,
    runs: int = 1000,
    seed: int = 0,
    initial: Initial = "truth",
    n_jobs: int | None = None,
    *,
    scales: tuple[float, ...] = (1.0,),
) -> MonteCarlo:
    """Register many noisy draws of a scenario and compare with the truth.

    Parameters
    ----------
    scenario : Scenario
    cost : RegistrationCost
    runs : int
        Number of independent draws.
    seed : int
        The same seed gives the same results, whatever ``n_jobs`` and the backend.
    initial : "truth", "zero", (P,) array or (S, P) array
        Start of every run; of several starts the one with the lowest optimum wins.
    n_jobs : int, optional
        Worker processes; 1 unless given or set by ``joblib.parallel_config``, under whose backend
        (``"dask"``, say) the chunks run.
    scales : sequence of float
        Inflation schedule, see `d2d.register`.

    Returns
    -------
    MonteCarlo

    Raises
    ------
    ValueError
        Naming the argument that does not fit.
    """
    condition = Condition(scenario, cost, runs, seed, initial, tuple(scales))
    jobs = [(condition, size, child) for size, child in condition.chunks()]
    return _joined(list(_run_all(jobs, n_jobs)))


def sweep(
    conditions: Mapping[str, Condition], folder: str | os.PathLike[str], n_jobs: int | None = None
) -> dict[str, MonteCarlo]:
    """Run many conditions and keep each in a file of its own as soon as it is finished.

    Parameters
    ----------
    conditions : mapping of str to Condition
        By the name of their file, ``<folder>/<name>.npz``.
    folder : path
        Is made if need be. Conditions whose file is there, with the same parameters, are read and
        not run again: a sweep that was killed goes on where it was.
    n_jobs : int, optional
        See `monte_carlo`.

    Returns
    -------
    dict of str to MonteCarlo

    Raises
    ------
    ValueError
        A file that is there but is no result of `sweep`.
    """
    root = Path(folder)
    root.mkdir(parents=True, exist_ok=True)
    marks = {name: str(joblib.hash(condition)) for name, condition in conditions.items()}
    results = {}
    for name in conditions:
        stored = _stored(root / f"{name}.npz", marks[name])
        if stored is not None:
            results[name] = stored
    waiting = [
        (name, condition, size, child)
        for name, condition in conditions.items()
        if name not in results
        for size, child in condition.chunks()
    ]
    parts: list[MonteCarlo] = []
    finished = _run_all([job[1:] for job in waiting], n_jobs)
    for (name, condition, _, _), part in zip(waiting, finished, strict=True):
        parts.append(part)
        if len(parts) == len(condition.chunks()):
            results[name] = _joined(parts)
            _store(root / f"{name}.npz", marks[name], results[name])
            parts = []
    return {name: results[name] for name in conditions}


Job = tuple[Condition, int, np.random.SeedSequence]


def _run_all(jobs: list[Job], n_jobs: int | None) -> Iterator[MonteCarlo]:
    """Run the chunks in parallel; their results come in order, each as soon as it can."""
    parallel = joblib.Parallel(n_jobs=n_jobs, return_as="generator")
    finished: Iterable[MonteCarlo] = parallel(joblib.delayed(_run)(*job) for job in jobs)
    # only on a terminal, and only if it takes a while
    yield from tqdm(finished, total=len(jobs), unit="chunk", delay=2.0, disable=None)


def _run(condition: Condition, runs: int, seed: np.random.SeedSequence) -> MonteCarlo:
    fixed, moving = condition.scenario.sample(runs, np.random.default_rng(seed))
    starts = condition.starts()
    solve = register if starts.ndim == 1 else multi_start
    estimate = solve(fixed, moving, condition.cost, starts, condition.scales)
    return MonteCarlo(
        estimate.theta - condition.scenario.theta,
        estimate.covariance,
        estimate.converged,
        estimate.iterations,
    )


def _joined(parts: list[MonteCarlo]) -> MonteCarlo:
    return MonteCarlo(
        *(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(MonteCarlo))
    )


def _store(path: Path, mark: str, result: MonteCarlo) -> None:
    """Write beside the target and rename: a reader sees the whole file or none."""
    columns = {f.name: getattr(result, f.name) for f in fields(MonteCarlo)}
    handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            np.savez_compressed(file, mark=mark, **columns)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise


def _stored(path: Path, mark: str) -> MonteCarlo | None:
    if not path.exists():
        return None
    try:
        with np.load(path, allow_pickle=False) as file:
            if str(file["mark"]) != mark:
                return None  # of other parameters: run again and replace
            return MonteCarlo(*(file[f.name] for f in fields(MonteCarlo)))
    except (OSError, ValueError, KeyError, EOFError) as error:
        raise ValueError(f"{path} is no result of a sweep: {error}") from None
