"""Long compiled work, a slice at a time.

Python handles signals only between calls: a single call for a whole batch would react to Ctrl-C
only when the batch is done.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from threading import Event

_PAIRS = 400_000  # of a target and a component in a slice: some 10 ms of registrations


def run_in_slices(
    run: Callable[[int, int], None], count: int, pairs: int, threads: int = 1
) -> None:
    """Call ``run(first, last)`` until all problems from 0 to ``count`` are done, each once.

    It solves the problems from ``first`` to ``last``, which do not depend on each other, and each
    of which has that many ``pairs`` of a target and a component.  If the thread that waits for the
    ``threads`` is interrupted, they end after their present slice.
    """
    size = max(1, _PAIRS // pairs)
    if threads == 1 or count == 1:
        for first in range(0, count, size):
            run(first, min(first + size, count))
        return
    size = max(1, min(size, count // (4 * threads)))  # so small that all threads end together
    stopped = Event()

    def work(first: int) -> None:
        if not stopped.is_set():
            run(first, min(first + size, count))

    with ThreadPoolExecutor(threads) as pool:
        try:
            for _ in pool.map(work, range(0, count, size)):
                pass
        finally:
            stopped.set()
