"""The progress bar of long tracks."""

import sys
from collections.abc import Iterable
from typing import TextIO

_DELAY = 2.0  # s, so that short tracks show no bar


def counted(count: int, progress: bool | None) -> Iterable[int]:
    """The numbers 0 to count - 1, with a progress bar on the standard error.

    True shows it at once, False never, and None after two seconds if that is a terminal and tqdm
    is installed.
    """
    steps = range(count)
    if progress is False or (progress is None and not _on_terminal()):
        return steps
    try:
        from tqdm import tqdm
    except ModuleNotFoundError:
        if progress is None:
            return steps
        raise ModuleNotFoundError(
            "progress=True needs tqdm, which is not installed: pip install tqdm"
        ) from None
    bar: Iterable[int] = tqdm(steps, unit="estimate", delay=0.0 if progress else _DELAY)
    return bar


def _on_terminal() -> bool:
    """Whether somebody may be watching; a program without a console has no standard error."""
    stream: TextIO | None = sys.stderr
    return stream is not None and stream.isatty()
