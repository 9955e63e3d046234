"""Interleaved timing."""

import gc
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from d2d._types import Array


@dataclass(frozen=True)
class Method:
    """One way to register, which is measured in one row of the table."""

    name: str
    start: str  # "truth", "off" or "zero"
    cost: str
    solve: Callable[[int], Any]  # registers the first n runs; this is what is timed
    motions: Callable[[Any], Array]  # from its result to the motions (n, 3) found; not timed
    runs: int  # for the accuracy
    timed: int  # in each round


def one_by_one(
    name: str,
    start: str,
    cost: str,
    register: Callable[[int], Any],
    read: Callable[[Any], Array],
    effort: tuple[int, int],
) -> Method:
    """A method that registers run after run, each in a call of its own, and reads each motion."""
    return Method(
        name,
        start,
        cost,
        lambda runs: [register(run) for run in range(runs)],
        lambda results: np.array([read(result) for result in results]),
        *effort,
    )


def once(method: Method) -> tuple[float, float]:
    """Elapsed and processor seconds per registration, in one pass over the timed runs."""
    begin, busy = time.perf_counter(), time.process_time()
    method.solve(method.timed)
    busy, elapsed = time.process_time() - busy, time.perf_counter() - begin
    return elapsed / method.timed, busy / method.timed


def interleaved(methods: Sequence[Method], rounds: int) -> Array:
    """Elapsed and processor seconds (methods, rounds, 2): each round times every method once.

    Whatever slows the machine for a while then slows all methods, and the best rounds of all
    methods come from the same undisturbed moments.
    """
    seconds = np.empty((len(methods), rounds, 2))
    gc.collect()
    gc.disable()
    try:
        for number in range(rounds):
            for row, method in enumerate(methods):
                seconds[row, number] = once(method)
    finally:
        gc.enable()
    return seconds
