"""Monte Carlo runs of a scenario, on one core or a cluster, and sweeps that can be interrupted.

Every chunk of runs draws from its own child of the condition's seed, so the results depend neither
on the number and kind of workers nor on where a sweep was interrupted.
"""

import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal, Protocol, runtime_checkable

import joblib
import numpy as np
from numpy.typing import ArrayLike, NDArray
from tqdm import tqdm

from d2d import rigid
from d2d._checks import check_count, check_instance, check_path, check_schedule
from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.credibility import Credibility, credibility
from d2d.point_set import PointSet
from d2d.registration import multi_start, register

THREADS = os.cpu_count() or 1  # the kernel releases the GIL; no result depends on their number
CHUNK = 1000  # runs in one batched call, a worker's unit of work; bounds the memory


@runtime_checkable
class Scene(Protocol):
    """What `monte_carlo` can run: a true motion, and noisy scans before and after it."""

    @property
    def theta(self) -> Array:
        """True motion (P,), [t_x] or [t_x, t_y, phi_z] in m, m, rad."""

    def sample(self, runs: int, rng: np.random.Generator) -> tuple[PointSet, PointSet]:
        """Draw the fixed and the moving set, of batch shape (runs,)."""


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
        """Credibility of the covariances of the converged runs."""
        return credibility(self.errors[self.converged], self.covariances[self.converged])


@dataclass(frozen=True, eq=False)
class Condition:
    """One Monte Carlo evaluation: the arguments of `monte_carlo`."""

    scenario: Scene
    cost: RegistrationCost
    runs: int = 1000
    seed: int = 0
    initial: Initial = "truth"
    scales: Sequence[float] = (1.0,)

    def __post_init__(self) -> None:
        check_instance("scenario", self.scenario, Scene)
        check_instance("cost", self.cost, RegistrationCost)
        check_count("runs", self.runs)
        check_count("seed", self.seed, minimum=0)
        object.__setattr__(self, "scales", check_schedule("scales", self.scales))
        self.starts()

    def starts(self) -> Array:
        """The start (P,), or several (S, P), of which the lowest optimum is kept."""
        if isinstance(self.initial, str):
            if self.initial not in ("truth", "zero"):
                raise ValueError(
                    f"initial must be 'truth', 'zero' or an array, but is {self.initial!r}"
                )
            return self.scenario.theta * (self.initial == "truth")
        starts = rigid.motion("initial", self.initial, 1 if len(self.scenario.theta) == 1 else 2)
        if starts.ndim > 2:
            raise ValueError(f"initial must have the shape (P,) or (S, P), but has {starts.shape}")
        return starts

    def chunks(self) -> list[tuple[int, np.random.SeedSequence]]:
        """Number of runs and seed of each chunk."""
        sizes = [CHUNK] * (self.runs // CHUNK) + [self.runs % CHUNK] * (self.runs % CHUNK > 0)
        return list(zip(sizes, np.random.SeedSequence(self.seed).spawn(len(sizes)), strict=True))


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

    Parameters
    ----------
    scenario : Scene
        For example a `d2d.study.plane.scenarios.Scenario`.
    cost : RegistrationCost
    runs : int
        Number of independent draws.
    seed : int
        The same seed gives the same results, whatever ``n_jobs`` and the backend.
    initial : "truth", "zero", (P,) array or (S, P) array
        Start of every run; with several starts, the lowest optimum is kept.
    n_jobs : int, optional
        Number of worker processes; 1 unless given or set by ``joblib.parallel_config``, whose
        backend (for example ``"dask"``) then runs the chunks.
    scales : sequence of positive numbers
        Inflation schedule, see `d2d.register`.

    Returns
    -------
    MonteCarlo

    Raises
    ------
    ValueError
        Naming the argument that does not fit.
    """
    condition = Condition(scenario, cost, runs, seed, initial, scales)
    jobs = [(condition, size, child) for size, child in condition.chunks()]
    return _joined(list(_run_all(jobs, n_jobs)))


def sweep(
    conditions: Mapping[str, Condition], folder: str | os.PathLike[str], n_jobs: int | None = None
) -> dict[str, MonteCarlo]:
    """Run many conditions, and store each result in its own file as soon as it is finished.

    Parameters
    ----------
    conditions : mapping of str to Condition
        Keyed by the name of the result's file, ``<folder>/<name>.npz``: a plain file name, without
        folders.
    folder : path
        Created if it does not exist. A condition whose file exists and has the same parameters is
        read, not run again: an interrupted sweep resumes where it stopped. Half-written files
        ``*.part``, which a killed sweep leaves in the folder, are removed.
    n_jobs : int, optional
        See `monte_carlo`.

    Returns
    -------
    dict of str to MonteCarlo

    Raises
    ------
    ValueError
        If a file exists that is not a complete result of `sweep`, or an argument is invalid; the
        message names the file or the argument.
    """
    _check_conditions(conditions)
    root = check_path("folder", folder)
    root.mkdir(parents=True, exist_ok=True)
    _remove_parts(root)
    fingerprints = {name: str(joblib.hash(condition)) for name, condition in conditions.items()}
    results = {}
    for name in conditions:
        stored = _stored(root / f"{name}.npz", fingerprints[name])
        if stored is not None:
            results[name] = stored
    pending = [
        (name, condition, size, child)
        for name, condition in conditions.items()
        if name not in results
        for size, child in condition.chunks()
    ]
    parts: list[MonteCarlo] = []
    finished = _run_all([job[1:] for job in pending], n_jobs)
    for (name, condition, _, _), part in zip(pending, finished, strict=True):
        parts.append(part)
        if len(parts) == len(condition.chunks()):
            results[name] = _joined(parts)
            _store(root / f"{name}.npz", fingerprints[name], results[name])
            parts = []
    return {name: results[name] for name in conditions}


def _check_conditions(conditions: Mapping[Any, Any]) -> None:
    check_instance("conditions", conditions, Mapping)
    for name, condition in conditions.items():
        plain = isinstance(name, str) and name not in ("", ".", "..") and name.isprintable()
        if not plain or set(name) & set("/\\:"):
            raise ValueError(
                f"conditions must be keyed by plain file names, without folders, but hold {name!r}"
            )
        check_instance(f"conditions[{name!r}]", condition, Condition)


def _remove_parts(folder: Path) -> None:
    """Remove the half-written files of killed sweeps; a running sweep writes its part again."""
    for part in folder.glob("*.part"):
        with suppress(OSError):  # gone already, a folder, or in use where that forbids it
            part.unlink()


Job = tuple[Condition, int, np.random.SeedSequence]


def _run_all(jobs: list[Job], n_jobs: int | None) -> Iterator[MonteCarlo]:
    """Run the chunks in parallel and yield their results in order, each as soon as it is ready."""
    parallel = joblib.Parallel(n_jobs=n_jobs, return_as="generator")
    finished: Iterable[MonteCarlo] = parallel(joblib.delayed(_run)(*job) for job in jobs)
    # the progress bar appears only on a terminal, and only if the runs take a while
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


def _store(path: Path, fingerprint: str, result: MonteCarlo) -> None:
    """Write to a temporary file and rename it, so that a reader sees a complete file or none."""
    columns = {f.name: getattr(result, f.name) for f in fields(MonteCarlo)}
    while True:
        handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".part")
        try:
            with os.fdopen(handle, "wb") as file:
                np.savez_compressed(file, mark=fingerprint, **columns)
            with suppress(FileNotFoundError):  # a sweep that began just now removed it: write anew
                os.replace(temporary, path)
                return
        except BaseException:
            with suppress(FileNotFoundError):
                os.unlink(temporary)
            raise


def _stored(path: Path, fingerprint: str) -> MonteCarlo | None:
    if not path.exists():
        return None
    try:
        # opened here, because NumPy leaves a damaged file open
        with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
            if str(file["mark"]) != fingerprint:
                return None  # other parameters: run again and replace the file
            return MonteCarlo(*(file[f.name] for f in fields(MonteCarlo)))
    except Exception as error:  # damaged bytes raise errors of zipfile, zlib or NumPy
        raise ValueError(
            f"{path} is not a complete result of a sweep ({error}); remove it to run this again"
        ) from None
