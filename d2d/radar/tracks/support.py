"""How much of a path rests on estimates that were accepted in a row."""

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from d2d._types import Array

_ROW = 3  # estimates: of a wrong log, up to one in three is accepted, seldom three in succession
_BRIDGED = 1.0, 2.5  # s, and usual intervals, for which a velocity can be interpolated
_ENOUGH = 1.0 / 3.0  # wrong logs are supported for up to a tenth of their time, right ones for half


class Support(NamedTuple):
    """The share of a track's time with estimates in a row, and the stretches without (s)."""

    share: float
    guessed: list[tuple[float, float]]

    @property
    def enough(self) -> bool:
        """Whether the path rests on estimates, rather than on accidents between guesses."""
        return self.share >= _ENOUGH

    def __str__(self) -> str:
        return f"estimates were accepted in a row for {self.share:.0%} of the time"


def support_of(times: Array, intervals: Array, converged: NDArray[np.bool_]) -> Support:
    """The support of estimates at ``times`` (n,), each so long after the one before it.

    An estimate supports the path if it is one of three or more that were accepted in succession
    (of fewer, if there are no more).  Stretches of up to a second, or two and a half usual
    intervals if these are longer, are bridged; longer ones are guessed.
    """
    guessed: list[tuple[float, float]] = []
    total = 0.0
    for rows in np.split(np.arange(len(times)), np.flatnonzero(np.isnan(intervals))):
        if not len(rows):
            continue
        first = times[rows[0]] - np.nan_to_num(intervals[rows[0]])
        total += times[rows[-1]] - first
        usual = float(np.median(np.diff(times[rows], prepend=first)))
        longest = max(_BRIDGED[0], _BRIDGED[1] * usual)
        in_a_row = np.ones(min(_ROW, len(rows)))
        good = times[rows][scipy.ndimage.binary_opening(converged[rows], in_a_row)]
        known = np.concatenate([[first], good, times[rows[-1:]]])
        long = np.flatnonzero(np.diff(known) > longest)
        guessed += [(float(known[i]), float(known[i + 1])) for i in long]
    missing = sum(end - begin for begin, end in guessed)
    share = 1.0 - missing / total if total else float(converged.any())
    return Support(share, guessed)
