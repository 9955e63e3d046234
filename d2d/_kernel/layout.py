"""The layout of what the kernel works on: constants, and what is passed from Python."""

import math
import threading
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from d2d._kernel import rows
from d2d._kernel.compile import inlined
from d2d._kernel.rows import LANES

X, Y, XX, XY, YY, WEIGHT = range(6)  # rows of a packed point set
VALUE, VARIANCE, INPUT_VARIANCE, GAIN, SLOPE = 0, 1, 2, 3, 6  # columns of a packed measurement
# An outlier component as the kernel reads it: its kind, the logarithms of the inliers' weight and
# of its own (normalisation included), and the precision of the corrupted Gaussian.
KIND, LOG_INLIER_WEIGHT, LOG_OUTLIER_WEIGHT, PRECISION_XX, PRECISION_XY, PRECISION_YY = range(6)
NO_OUTLIER, UNIFORM, CORRUPTED = range(3)
LIKELIHOOD, SUMMING = range(2)
# What the parameters of a problem are: the motion itself, or the velocity that all its pairs share,
# which causes a motion along an arc (the SE(2) exponential) or, to first order, along a chord.
MOTION, ARC, CHORD = range(3)

# Columns of the table of a batch's pairs; FACTOR_START is -1 without a measurement.
FIXED_START, FIXED_SIZE, FIXED_SET, MOVING_START, MOVING_SIZE, MOVING_SET, FACTOR_START = range(7)

MIN_WEIGHT, MAX_WEIGHT = 1e-100, 1e100  # of a component, so that no sum over- or underflows
# Beyond these bounds squares and products of a cost's terms over- or underflow.
MAX_LENGTH, MIN_VARIANCE, MAX_VARIANCE = 1e40, 1e-80, 1e80  # m, m^2
SINGULAR = 1e-14  # determinant of correlations, up to which a covariance may be singular
# A set on a line is stored with y = 0 and this variance, so that its density along y is exactly 1.
UNIT_DENSITY_VARIANCE = 1.0 / (2.0 * math.pi)
# Columns of the bounds of a fixed set, see `pairs.find_extremes`.
TOTAL_WEIGHT, MEAN_ROOT, LEAST_ROOT, LEAST_VARIANCE, LARGEST_ASPECT = range(5)
GATE = 36.0  # what is below exp(-GATE) = 2e-16 of something does not count beside it
# A sum that is computed relative to its nearest component must not lose that component to rounding,
# however far away it is.  So all passes compute the distance by one formula, the offset is a little
# larger than it, and exponents above MAX_EXPONENT are cut off.
ABOVE, MAX_EXPONENT = 1.0 + 1e-14, 200.0
LOG_2PI = math.log(2.0 * math.pi)


class Pair(NamedTuple):
    """Two point sets bound to a cost: what one evaluation needs beside the motion."""

    fixed: Any  # (6, N)
    moving: Any  # (6, K)
    order: Any  # (K,) the order in which the targets are processed
    factors: Any  # (K, 9) measurements, or (0, 9)
    outlier: Any  # (6,)
    d2d: float  # 1.0 if the moving covariances count, else 0.0
    planar: float  # 1.0 in the plane, 0.0 on a line
    tiles: Any  # of the outlier component, see ``tiles.py``; none where the plain sum is as fast
    grid: Any  # (5,) of the tiles
    in_twist: bool  # whether the measurements are linear in the twist
    extremes: Any  # (5,) bounds of the fixed set, see `find_extremes`
    fixed_centre: Any  # (2,) from which the fixed means are counted; zero where the motion is, too
    moving_centre: Any  # (2,)


class Setting(NamedTuple):
    """The motion, and the numbers of a pair, as the passes over its targets need them."""

    x: float  # translation, to the centre of the fixed set
    y: float
    cosine: float
    sine: float
    lever_x: float  # centre of the moving set, from the origin about which it turns
    lever_y: float
    chart: Any
    d2d: float
    planar: float
    gate: float  # what is below exp(-gate) of a target's density is left out of it


class Accuracy(NamedTuple):
    """Accuracy of the steps of a descent."""

    gate: float  # what is below exp(-gate) of a target's density is left out of it
    margin: float  # standard deviations by which targets may move before lists are found again
    every: int  # every second or n-th block of targets counts


class Batch(NamedTuple):
    """The problems of one call: all sets one after the other, and which pairs each problem sums.

    Problem b is the sum over the pairs ``first[b]`` to ``first[b + 1]``.  They share its
    parameters: a motion, or a velocity that causes each pair's motion over its own interval.
    """

    fixed: Any  # (6 targets,) all fixed sets, one after the other, each (6, N), about their centres
    moving: Any  # (6 targets,) all moving sets, about their centres
    fixed_centres: Any  # (sets, 2)
    moving_centres: Any  # (sets, 2)
    orders: Any  # (targets,) of all moving sets, each counted from its own first
    extremes: Any  # (sets, 5) of the fixed sets, see `find_extremes`
    factors: Any  # (targets, 9) of all measurements, (0, 9) if there is none
    outlier: Any  # (6,)
    tiles: Any  # (tiles, TILE) of the outlier component of large fixed sets, see ``tiles.py``
    grids: Any  # (sets, 5): the first tile of each fixed set and its grid; no columns without tiles
    pairs: Any  # (pairs, 7) of int, see FIXED_START
    first: Any  # (problems + 1,) of int
    intervals: Any  # (pairs,) s
    prior: Any  # (3,) precisions of the parameters' prior, a Gaussian about zero
    d2d: float
    planar: float
    fusion: int
    in_twist: bool
    centred: bool  # whether the descent is about the centres of the sets, see `minimise_batch`
    kind: int  # of the parameters: MOTION, ARC or CHORD


class Optima(NamedTuple):
    """The optima of B problems; thetas holds the starts first."""

    thetas: Any  # (B, 3)
    numbers: Any  # (B, 4) value, share of inliers, fit and its degrees of freedom
    gradient: Any  # (B, 3)
    hessian: Any  # (B, 3, 3)
    covariance: Any  # (B, 3, 3)
    iterations: Any  # (B,) of int
    converged: Any  # (B,) of bool
    undetermined: Any  # (B,) of bool

    def part(self, first: int, last: int) -> "Optima":
        """The problems from ``first`` to ``last``."""
        return Optima(*(array[first:last] for array in self))


class Memory(NamedTuple):
    """The memory that one thread needs, see `own_memory`."""

    scratch: Any  # of the passes over the targets, see `rows`
    lists: Any  # (blocks, PLACE and more) the neighbours of each block of a problem's targets
    candidates: Any  # (2, targets of a fixed set) of int, for the search of neighbours
    descent: Any  # (16, 3) of the descent, see `work_in`
    stop: Any  # (1,) not zero once a caller has been interrupted: evaluations end, with nan


class Work(NamedTuple):
    """The memory of a descent."""

    memory: Any
    step: Any
    scale: Any
    trial: Any
    trial_gradient: Any
    trial_hessian: Any
    gradient: Any  # of one of several pairs
    hessian: Any
    vectors: Any  # (5, 3) of the trust region


@inlined
def work_in(memory):
    """The memory of a descent, by name.

    One array takes less time on the way from Python than nine.
    """
    d = memory.descent
    return Work(memory, d[0], d[1], d[2], d[3], d[4:7], d[7], d[8:11], d[11:16])


LONGEST = 1000  # targets in a list
MOST_LISTS = 16_000_000  # numbers: 128 MB
NEVER = np.zeros(1)  # a call that is not interrupted
_OF_THREAD = threading.local()


def own_memory(blocks: int, targets: int) -> Memory:
    """The memory of the thread that calls, for so many blocks and targets of a fixed set.

    A list has room for all targets of a small set, and for every eighth of a large one; a longer
    list would not be faster than the sum over all.  All lists together take at most MOST_LISTS:
    blocks beyond share the last ones, which are found anew in each step.
    """
    memory: Memory
    if getattr(_OF_THREAD, "size", None) == (blocks, targets):
        memory = _OF_THREAD.memory
        return memory
    row = rows.PLACE + min(targets, 64 + targets // 8, LONGEST) * rows.STEP
    blocks = max(1, min(blocks, MOST_LISTS // row))
    whole = getattr(_OF_THREAD, "whole", None)
    if whole is None or whole.lists.size < blocks * row or whole.candidates.size < 2 * targets:
        candidates = np.empty(2 * targets, dtype=np.int64)
        lists, scratch = _aligned(blocks * row), _aligned(rows.SCRATCH)
        whole = Memory(scratch, lists, candidates, np.empty((16, 3)), NEVER)
        _OF_THREAD.whole = whole
    lists = whole.lists[: blocks * row].reshape(blocks, row)
    candidates = whole.candidates[: 2 * targets].reshape(2, targets)
    memory = _OF_THREAD.memory = whole._replace(lists=lists, candidates=candidates)
    _OF_THREAD.size = blocks, targets
    return memory


def _aligned(size: int) -> NDArray[np.float64]:
    """Memory that begins where a cache line does, so that no vector of lanes lies in two."""
    memory = np.empty(size + LANES)
    first = -memory.ctypes.data % (8 * LANES) // 8
    return memory[first : first + size]
