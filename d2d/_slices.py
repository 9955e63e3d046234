"""Long compiled work, a slice at a time.

Python handles signals only between calls: a single call for a whole batch would react to Ctrl-C
only when the batch is done.
"""

from collections.abc import Callable
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from threading import Event, Lock
from time import perf_counter

_SECONDS = 0.05  # that a slice should take
_MAX_THREADS = 256
_FIRST = 100_000  # pairs of a target and a component in the first one: a few milliseconds


def run_in_slices(
    run: Callable[[int, int], None], count: int, pairs: int, threads: int = 1
) -> None:
    """Call ``run(first, last)`` until all problems from 0 to ``count`` are done, each once.

    It solves the problems from ``first`` to ``last``, which do not depend on each other.  The
    number of ``pairs`` of a target and a component in a problem is for a guess of how long it
    takes.  If the thread that waits for the ``threads`` is interrupted, they end after their
    present slice.
    """
    size, threads = max(1, _FIRST // pairs), min(threads, max(1, count), _MAX_THREADS)
    if count == 1 or (count <= size and threads == 1):
        run(0, count)
        return
    lock, stopped, done = Lock(), Event(), 0

    def work() -> None:
        nonlocal done
        own = size
        while not stopped.is_set():
            with lock:
                first, left = done, count - done
                if not left:
                    return
                # towards the end, slices so small that all threads end together
                share = left if threads == 1 else max(1, left // (2 * threads))
                last = done = first + min(own, share)
            begin = perf_counter()
            run(first, last)
            taken = max(perf_counter() - begin, 1e-6)
            own = max(1, min(4 * own, int((last - first) * _SECONDS / taken)))

    if threads == 1:
        work()
        return
    with ThreadPoolExecutor(threads) as pool:
        try:
            workers = [pool.submit(work) for _ in range(threads)]
            wait(workers, return_when=FIRST_EXCEPTION)
        finally:
            stopped.set()
    for worker in workers:
        worker.result()
