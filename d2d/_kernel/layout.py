"""The layout of what the kernel works on: constants, rows of the scratch array, pairs."""

import math
import threading
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from d2d._kernel.compile import inlined, merged

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
FIXED_START, FIXED_SIZE, FIXED_SET, MOVING_START, MOVING_SIZE, FACTOR_START = range(6)

MIN_WEIGHT, MAX_WEIGHT = 1e-100, 1e100  # of a component, so that no sum over- or underflows
MAX_VARIANCE = 1e150  # m^2, so that no determinant of a sum of two covariances overflows
# A one-dimensional set is stored as a planar one with y = 0 and this variance along y, so that the
# density along y is exactly 1.
UNIT_DENSITY_VARIANCE = 1.0 / (2.0 * math.pi)
# Columns of the bounds of a fixed set, see `pairs.find_extremes`.
TOTAL_WEIGHT, MEAN_ROOT, LEAST_ROOT, LEAST_VARIANCE = range(4)
GATE = 36.0  # what is below exp(-GATE) = 2e-16 of something does not count beside it
# A sum that is computed relative to its nearest component must not lose that component to rounding,
# however far away it is.  So all passes compute the distance by one formula, the offset is a little
# larger than it, and exponents above MAX_EXPONENT are cut off.
ABOVE, MAX_EXPONENT = 1.0 + 1e-14, 200.0
LOG_2PI = math.log(2.0 * math.pi)

# The scratch array of a block of targets, one target to a vector lane.  Each row has LANES numbers,
# and a row's name is where it begins.  Four tables begin at INLIER, OUTLIER, FACTOR and TOTAL; each
# holds the logarithm of a density and its derivatives: the gradient G0, G1, G2 and the second
# derivatives A00 to A22, along t_x, t_y and phi.
LANES = 8
G0, G1, G2, A00, A01, A11, A02, A12, A22 = range(LANES, 10 * LANES, LANES)
INLIER, OUTLIER, FACTOR, TOTAL = range(0, 40 * LANES, 10 * LANES)
# In the end, with the measurement and the outliers in it: log q_k and its derivatives.
LOG_DENSITY = INLIER
GRADIENT = (INLIER + G0, INLIER + G1, INLIER + G2)
CURVATURE = tuple(
    INLIER + row for row in (A00, A01, A02, A01, A11, A12, A02, A12, A22)
)  # a full matrix, row by row
# The rotated mean and covariance of each target, whether it counts (the last block may be filled
# up), a maximum of logarithms, and the inlier component's share, with its sum over the blocks.
MX, MY, CXX, CXY, CYY, COUNTS, TOP, SHARE, SHARES = range(40 * LANES, 49 * LANES, LANES)
# What the search for its neighbours needs to know of a target (see neighbours.py).
CUT_OFF, LIMIT, SQUARE, DETERMINANT, NEAREST, WITHIN, NUMBER = range(49 * LANES, 56 * LANES, LANES)
PEAK, LARGEST, SMALLEST, OUTLIER_FLOOR = range(56 * LANES, 60 * LANES, LANES)
# The logarithm by which the weights of a sum over the components are raised, and the inverse of
# that sum, which makes shares of them: of the inlier density and of the outlier component.
OFFSET, TO_SHARE, OUTLIER_OFFSET, OUTLIER_TO_SHARE = range(60 * LANES, 64 * LANES, LANES)
# What the second pass of the propagation adds up for each target (see propagate.py).
SCALE, OUTLIER_SCALE, GAMMA = range(64 * LANES, 67 * LANES, LANES)
MEAN, CENTRED, MOVED = 67 * LANES, 70 * LANES, 73 * LANES
ONE_STEP = 79 * LANES  # a component that all targets of a block are paired with
POLYNOMIAL = 85 * LANES  # of one coordinate for each target, with its derivatives (see tiles.py)
TERMS = POLYNOMIAL  # of a step of the propagation
IS_TILED = 133 * LANES  # whether a block's outlier component is interpolated
SCRATCH = 134 * LANES

# The neighbours of a block of targets: where they were when their lists were made, how far they may
# move from there, and down to where their outlier component may sink; the lists' common length.
# Then follow copies of the components, STEP numbers for one of each target: the six of a packed set,
# and its INDEX.
AT_X, AT_Y, AT_COSINE, AT_SINE, REACH, SLACK, FLOOR, LEAST_SUM = range(0, 8 * LANES, LANES)
LENGTH, MEASURED, MARGIN = range(8 * LANES, 8 * LANES + 3)
PLACE = 9 * LANES
DENSE, NOT_FOUND = -1, -2  # lengths of lists: all components, and none found yet
INDEX = 6
STEP = 7 * LANES
CHUNK = 48  # components are marked in chunks, one bit each: a double holds 53 bits exactly

# Row of each second derivative with the two gradient rows that belong to it.
SECOND = (
    (A00, G0, G0),
    (A01, G0, G1),
    (A11, G1, G1),
    (A02, G0, G2),
    (A12, G1, G2),
    (A22, G2, G2),
)


@inlined
def lane_count(w):
    """LANES as a value that is known only at run time.

    The compiler unrolls loops whose length it knows, and vectorises the others.
    """
    return w.shape[0] // (SCRATCH // LANES)


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
    extremes: Any  # (4,) bounds of the fixed set, see `find_extremes`


class Setting(NamedTuple):
    """The motion, and the numbers of a pair, as the passes over its targets need them."""

    x: float
    y: float
    cosine: float
    sine: float
    chart: Any
    d2d: float
    planar: float
    gate: float  # what is below exp(-gate) of a target's density is left out of it


class Accuracy(NamedTuple):
    """How exact the steps of a descent are."""

    gate: float  # what is below exp(-gate) of a target's density is left out of it
    margin: float  # standard deviations by which targets may move before lists are found again


class Batch(NamedTuple):
    """The problems of one call: all sets one after the other, and which pairs each problem sums.

    Problem b is the sum over the pairs ``first[b]`` to ``first[b + 1]``.  They share its
    parameters: a motion, or a velocity that causes each pair's motion over its own interval.
    """

    fixed: Any  # (6 targets,) all fixed sets, one after the other, each (6, N)
    moving: Any  # (6 targets,) all moving sets
    orders: Any  # (targets,) of all moving sets, each counted from its own first
    extremes: Any  # (sets, 4) of the fixed sets, see `find_extremes`
    factors: Any  # (targets, 9) of all measurements, (0, 9) if there is none
    outlier: Any  # (6,)
    tiles: Any  # (tiles, TILE) of the outlier component of large fixed sets, see ``tiles.py``
    grids: Any  # (sets, 5): the first tile of each fixed set and its grid; no columns without tiles
    pairs: Any  # (pairs, 6) of int, see FIXED_START
    intervals: Any  # (pairs,) s
    first: Any  # (problems + 1,) of int
    d2d: float
    planar: float
    fusion: int
    in_twist: bool
    kind: int  # of the parameters: MOTION, ARC or CHORD
    prior: Any  # (3,) precisions of the parameters' prior, a Gaussian about zero


class Memory(NamedTuple):
    """The memory that one thread needs, see `own_memory`."""

    scratch: Any  # rows of the passes over the targets, see above
    places: Any  # (blocks, PLACE and more) the neighbours of each block of a problem's targets
    chosen: Any  # (2, targets of a fixed set) of int, for the search of neighbours
    rows: Any  # (17, 3) of the descent, see `work_in`


class Work(NamedTuple):
    """The memory of a descent."""

    memory: Any
    step: Any
    scale: Any
    trial: Any
    trial_gradient: Any
    trial_hessian: Any
    motion: Any  # of one of several pairs, with its gradient and Hessian
    gradient: Any
    hessian: Any
    vectors: Any  # (5, 3) of the trust region


@merged
def work_in(memory):
    """The memory of a descent, by name.

    One array takes less time on the way from Python than nine.
    """
    rows = memory.rows
    step, scale, trial, trial_gradient = rows[0], rows[1], rows[2], rows[3]
    motion, gradient = rows[4], rows[5]
    return Work(
        memory,
        step,
        scale,
        trial,
        trial_gradient,
        rows[6:9],
        motion,
        gradient,
        rows[9:12],
        rows[12:17],
    )


_OF_THREAD = threading.local()


def own_memory(blocks: int, targets: int) -> Memory:
    """The memory of the thread that calls, for so many blocks and targets of a fixed set.

    A list has room for all targets of a small set, and for every eighth of a large one; a longer
    list would not be faster than the sum over all.
    """
    memory: Memory
    if getattr(_OF_THREAD, "size", None) == (blocks, targets):
        memory = _OF_THREAD.memory
        return memory
    row = PLACE + min(targets, 64 + targets // 8) * STEP
    whole = getattr(_OF_THREAD, "whole", None)
    if whole is None or whole.places.size < blocks * row or whole.chosen.size < 2 * targets:
        chosen = np.empty(2 * targets, dtype=np.int64)
        places, scratch = _aligned(blocks * row), _aligned(SCRATCH)
        whole = _OF_THREAD.whole = Memory(scratch, places, chosen, np.empty((17, 3)))
    places = whole.places[: blocks * row].reshape(blocks, row)
    chosen = whole.chosen[: 2 * targets].reshape(2, targets)
    memory = _OF_THREAD.memory = whole._replace(places=places, chosen=chosen)
    _OF_THREAD.size = blocks, targets
    return memory


def _aligned(size: int) -> NDArray[np.float64]:
    """Memory that begins where a cache line does, so that no vector of lanes lies in two."""
    memory = np.empty(size + LANES)
    first = -memory.ctypes.data % (8 * LANES) // 8
    return memory[first : first + size]
