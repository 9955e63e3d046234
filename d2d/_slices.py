"""Long compiled work, a slice at a time: Python reacts to Ctrl-C only between calls."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from d2d._kernel.layout import NEVER
from d2d._types import Array

_PAIRS = 400_000  # of a target and a component in a slice: some 10 ms of registrations
# A single problem of more pairs runs in a thread of its own: it can be told to stop, and its memory
# is released when the thread ends.
LARGE = 4_000_000


def run_in_slices(
    run: Callable[[int, int, Array], None], count: int, pairs: int, threads: int = 1
) -> None:
    """Call ``run(first, last, stop)`` until all problems from 0 to ``count`` are done, each once.

    Each problem has that many ``pairs`` of a target and a component.  If the thread that waits is
    interrupted, ``stop`` (1,) is set: the kernel ends soon, and no slice begins any more.
    """
    size = max(1, _PAIRS // pairs)
    if pairs <= LARGE and (threads == 1 or count == 1):
        for first in range(0, count, size):
            run(first, min(first + size, count), NEVER)
        return
    if threads > 1:
        size = max(1, min(size, count // (4 * threads)))  # so small that all threads end together
    stop = np.zeros(1)

    def work(first: int) -> None:
        if not stop[0]:
            run(first, min(first + size, count), stop)

    with ThreadPoolExecutor(threads) as pool:
        try:
            for _ in pool.map(work, range(0, count, size)):
                pass
        finally:
            stop[0] = 1.0
