"""The layout of what the kernel works on: constants, rows of the scratch array, pairs."""

import math
from typing import Any, NamedTuple

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

MIN_WEIGHT, MAX_WEIGHT = 1e-100, 1e100  # of a component, so that no sum over- or underflows
MAX_VARIANCE = 1e150  # m^2, so that no determinant of a sum of two covariances overflows
# A one-dimensional set is stored as a planar one with y = 0 and this variance along y, so that the
# density along y is exactly 1.
UNIT_DENSITY_VARIANCE = 1.0 / (2.0 * math.pi)
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
# up), its cut-off and limit (see pairs.py), an offset and a maximum of logarithms,
# and the inlier component's share, with its sum over the blocks.
MX, MY, CXX, CXY, CYY, COUNTS, CUT_OFF, LIMIT, OFFSET, TOP = range(40 * LANES, 50 * LANES, LANES)
SQUARE, DETERMINANT, WITHIN, SHARE, SHARES = range(50 * LANES, 55 * LANES, LANES)
# Behind these rows lie copies of the components within the cut-off, six rows for each step.  The
# search marks them in chunks, one bit each: a double holds 53 bits exactly.
CHUNK = 48
STEP = 6 * LANES
STEPS = SHARES + LANES
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
    gate: float  # half the squared distance at which a pair is negligible, see pairs.py
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
    gate: float
    log_peak: float
    log_spread: float
