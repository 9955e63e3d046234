"""The rows of the table: every way to register the draws of one scene from one start."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from benchmarks import numpy_cost, peers
from benchmarks.scenes import Draws
from benchmarks.timing import Method, one_by_one
from d2d import (
    ANNEALED,
    CorruptedGaussian,
    PointSet,
    RegistrationCost,
    multi_start,
    propagate_covariance,
    register,
    start_grid,
)
from d2d._types import Array

OUTLIER = CorruptedGaussian(0.2, 100.0 * np.eye(2))
COSTS = {"likelihood": None, "robust": OUTLIER}
# What a prediction from the scans before may be off: 0.4 m and 0.6 degrees.
OFFSET = np.array([0.4 / np.sqrt(2.0), 0.4 / np.sqrt(2.0), np.deg2rad(0.6)])
# Around zero, as wide as the motion may be; the true motion is not on the grid.
GRID = start_grid(6.0, 6.0, np.deg2rad([-20.0, -10.0, 0.0, 10.0, 20.0]))

BATCH = "d2d, batch"
BATCH_2 = "d2d, batch, 2 threads"
BATCH_ARRAYS = "d2d, batch, from arrays"
ONE = "d2d, one per call"
ONE_ARRAYS = f"{ONE}, from arrays"
ONE_PROPAGATED = f"{ONE}, covariance propagated"
SCHEDULE = "d2d, batch, ANNEALED"
STARTS = f"d2d, batch, best of {len(GRID)} starts"
BFGS = "NumPy, BFGS"


@dataclass(frozen=True)
class Effort:
    """Number of runs for the accuracy and number timed, for fast and for slow methods."""

    runs: int
    timed: int
    slow_runs: int
    slow_timed: int
    pilot: int

    @property
    def fast(self) -> tuple[int, int]:
        """The numbers of a fast method."""
        return self.runs, self.timed

    @property
    def slow(self) -> tuple[int, int]:
        """The numbers of a slow method."""
        return self.slow_runs, self.slow_timed


def initial_motion(theta: Array, start: str) -> Array:
    """Where registrations begin whose true motion is theta (3,)."""
    return {"truth": theta, "off": theta + OFFSET, "zero": np.zeros(3)}[start]


def one_per_call(
    draws: Draws, pilot: Draws, start: str, effort: Effort, chosen: Sequence[peers.Peer]
) -> Iterator[Method]:
    """The methods that register one pair of scans a call: d2d and the chosen peers.

    A peer that is not installed is left out.
    """
    initial = initial_motion(draws.theta, start)
    yield from _single(draws, start, initial, effort)
    yield from _peers(draws, pilot, start, initial, effort, chosen)


def others(draws: Draws, start: str, effort: Effort) -> Iterator[Method]:
    """Batches of d2d, and NumPy with SciPy."""
    initial = initial_motion(draws.theta, start)
    yield from _batches(draws, start, initial, effort)
    yield from _scipy(draws, start, initial, effort)


def _arrays(points: PointSet, index: Any) -> tuple[Array, Array]:
    return points.means[index].copy(), points.covariances[index].copy()


def _single(draws: Draws, start: str, initial: Array, effort: Effort) -> Iterator[Method]:
    fixed, moving = ([s[i] for i in range(effort.runs)] for s in (draws.fixed, draws.moving))
    arrays = [(_arrays(draws.fixed, i), _arrays(draws.moving, i)) for i in range(effort.runs)]
    for cost_name, outlier in COSTS.items():
        cost = RegistrationCost(outlier=outlier)

        def prepared(run: int, cost: Any = cost) -> Any:
            return register(fixed[run], moving[run], cost, initial)

        def propagated(run: int, cost: Any = cost) -> Any:
            estimate = register(fixed[run], moving[run], cost, initial)
            propagate_covariance(estimate, fixed[run], moving[run], cost)
            return estimate

        def anew(run: int, cost: Any = cost) -> Any:
            first, second = arrays[run]
            return register(PointSet(*first), PointSet(*second), cost, initial)

        ways = {ONE: prepared, ONE_PROPAGATED: propagated}
        if start != "zero":
            ways[ONE_ARRAYS] = anew
        for name, solve in ways.items():
            yield one_by_one(name, start, cost_name, solve, lambda found: found.theta, effort.fast)


def _batches(draws: Draws, start: str, initial: Array, effort: Effort) -> Iterator[Method]:
    batches = {n: draws[:n] for n in {effort.runs, effort.timed}}

    def method(name: str, cost: str, solve: Any, timed: int = effort.timed) -> Method:
        return Method(name, start, cost, solve, lambda result: result.theta, effort.runs, timed)

    for cost_name, outlier in COSTS.items():
        cost = RegistrationCost(outlier=outlier)

        def batch(
            n: int, cost: Any = cost, threads: int = 1, scales: Any = (1.0,), grid: Any = None
        ) -> Any:
            part = batches[n]
            if grid is None:
                return register(part.fixed, part.moving, cost, initial, scales, threads=threads)
            return multi_start(part.fixed, part.moving, cost, grid, scales, threads=threads)

        yield method(BATCH, cost_name, batch)
        yield method(BATCH_2, cost_name, lambda n, b=batch: b(n, threads=2))
        if start == "zero":
            yield method(SCHEDULE, cost_name, lambda n, b=batch: b(n, scales=ANNEALED))
            timed_starts = max(1, effort.timed // 10)
            batches[timed_starts] = draws[:timed_starts]
            yield method(STARTS, cost_name, lambda n, b=batch: b(n, grid=GRID), timed_starts)
        elif outlier is None:
            whole = {
                n: (_arrays(p.fixed, slice(None)), _arrays(p.moving, slice(None)))
                for n, p in batches.items()
            }

            def anew(n: int, whole: Any = whole) -> Any:
                first, second = whole[n]
                return register(PointSet(*first), PointSet(*second), None, initial)

            yield method(BATCH_ARRAYS, cost_name, anew)


def _peers(
    draws: Draws,
    pilot: Draws,
    start: str,
    initial: Array,
    effort: Effort,
    chosen: Sequence[peers.Peer],
) -> Iterator[Method]:
    for peer in chosen:
        library, _ = peers.load(peer.module)
        if library is None:
            continue
        trial = pilot if peer.fast else pilot[: max(5, len(pilot) // 4)]
        setting = peers.best_setting(peer, library, trial, initial)
        label = "default" if setting is None else f"{setting:g}"
        solve, read = peer.adapter(library, draws, initial, setting)
        name = f"{peer.name} ({peer.unit}: {label})"
        own = effort.fast if peer.fast else effort.slow
        yield one_by_one(name, start, "its own", solve, read, own)
        if peer.from_arrays and start != "zero":
            singles = [draws[i : i + 1] for i in range(effort.runs)]

            def anew(
                run: int, adapter: Any = peer.adapter, bound: Any = (library, setting, singles)
            ) -> Any:
                module, value, scans = bound
                return adapter(module, scans[run], initial, value)[0](0)

            name = f"{peer.name}, from arrays"
            yield one_by_one(name, start, "its own", anew, read, effort.fast)


def _scipy(draws: Draws, start: str, initial: Array, effort: Effort) -> Iterator[Method]:
    pairs = [(draws.fixed[i], draws.moving[i]) for i in range(effort.slow_runs)]

    def minimised(name: str, cost: str, costs: Any, method: str, gradient: bool) -> Method:
        def solve(run: int) -> Array:
            return numpy_cost.minimise(costs[run], initial, method, gradient)

        return one_by_one(name, start, cost, solve, np.asarray, effort.slow)

    for cost_name, outlier in COSTS.items():
        costs = [numpy_cost.NumpyCost(*pair, outlier) for pair in pairs]
        for method, gradient in product(("BFGS", "L-BFGS-B"), (False, True)):
            name = f"NumPy, {method}" + (", exact gradient" if gradient else "")
            yield minimised(name, cost_name, costs, method, gradient)
