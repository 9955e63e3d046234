"""The layout of what the kernel works on: constants, rows of the scratch array, pairs."""

import math
import threading
from typing import Any, NamedTuple

import numpy as np

from d2d._kernel.compile import inlined

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
GATE = 36.0  # what is below exp(-GATE) = 2e-16 of something does not count beside it
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
# up), its cut-off and limit (see pairs.py), a maximum of logarithms,
# and the inlier component's share, with its sum over the blocks.
MX, MY, CXX, CXY, CYY, COUNTS, CUT_OFF, LIMIT, TOP = range(40 * LANES, 49 * LANES, LANES)
SQUARE, DETERMINANT, WITHIN, SHARE, SHARES = range(49 * LANES, 54 * LANES, LANES)
# The logarithm by which the weights of a sum over the components are raised, and the inverse of
# that sum, which makes shares of them: of the inlier density and of the outlier component.
OFFSET, TO_SHARE, OUTLIER_OFFSET, OUTLIER_TO_SHARE = range(54 * LANES, 58 * LANES, LANES)
# What the second pass of the propagation adds up for each target (see propagate.py).
SCALE, OUTLIER_SCALE, GAMMA = range(58 * LANES, 61 * LANES, LANES)
MEAN, CENTRED, MOVED = 61 * LANES, 64 * LANES, 67 * LANES
# Behind these rows lie copies of the components within the cut-off, six rows for each step.  The
# search marks them in chunks, one bit each: a double holds 53 bits exactly.
CHUNK = 48
STEP = 6 * LANES
STEPS = MOVED + 6 * LANES
SCRATCH = STEPS + CHUNK * STEP

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
    in_twist: bool  # whether the measurements are linear in the twist
    log_peak: float  # bounds of the sums over the components, see `bounds`
    log_spread: float


class Setting(NamedTuple):
    """The motion, and the numbers of a pair, as the passes over its targets need them.

    Arrays are passed one by one instead: Numba counts the references to the arrays of a tuple
    at every use, which costs as much as a small problem.
    """

    x: float
    y: float
    cosine: float
    sine: float
    chart: Any
    d2d: float
    planar: float
    log_peak: float
    log_spread: float


class Batch(NamedTuple):
    """The problems of one call: all sets one after the other, and which pairs each problem sums.

    Problem b is the sum over the pairs ``first[b]`` to ``first[b + 1]``.  They share its
    parameters: a motion, or a velocity that causes each pair's motion over its own interval.
    """

    fixed: Any  # (6, targets) of all fixed sets, one set after the other
    moving: Any  # (6, targets) of all moving sets
    orders: Any  # (targets,) of all moving sets, each counted from its own first
    extremes: Any  # (sets, 3) of the fixed sets, see `find_extremes`
    factors: Any  # (targets, 9) of all measurements, (0, 9) if there is none
    outlier: Any  # (6,)
    pairs: Any  # (pairs, 6) of int, see FIXED_START
    intervals: Any  # (pairs,) s
    first: Any  # (problems + 1,) of int
    d2d: float
    planar: float
    fusion: int
    in_twist: bool
    kind: int  # of the parameters: MOTION, ARC or CHORD
    prior: Any  # (3,) precisions of the parameters' prior, a Gaussian about zero


class Work(NamedTuple):
    """The memory that one thread needs, see `own_work`."""

    scratch: Any  # rows of the passes over the targets, see above
    step: Any
    scale: Any
    trial: Any
    trial_gradient: Any
    trial_hessian: Any
    motion: Any  # of one of several pairs, with its gradient and Hessian
    gradient: Any
    hessian: Any
    vectors: Any  # (5, 3) of the trust region


_OF_THREAD = threading.local()


def own_work() -> Work:
    """The memory of the thread that calls, the same in every call."""
    if not hasattr(_OF_THREAD, "work"):
        _OF_THREAD.work = _make_work()
    work: Work = _OF_THREAD.work
    return work


def _make_work() -> Work:
    vectors, matrices = np.empty((6, 3)), np.empty((2, 3, 3))
    step, scale, trial, trial_gradient, motion, gradient = vectors
    return Work(
        np.empty(SCRATCH),
        step,
        scale,
        trial,
        trial_gradient,
        matrices[0],
        motion,
        gradient,
        matrices[1],
        np.empty((5, 3)),
    )
