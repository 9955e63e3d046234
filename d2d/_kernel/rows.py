"""Rows of the scratch array of a block of targets, and of the lists of its neighbours."""

from d2d._kernel.compile import inlined

# Each row has LANES numbers, one for each target, and a row's name is where it begins.  Four tables
# begin at INLIER, OUTLIER, FACTOR and TOTAL; each holds the logarithm of a density and its
# derivatives: the gradient G0, G1, G2 and the second derivatives A00 to A22, along t_x, t_y, phi.
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
POLYNOMIAL = 79 * LANES  # of one coordinate for each target, with its derivatives (see tiles.py)
TERMS = POLYNOMIAL  # of a step of the propagation
# The mean half squared distance of each target from its components, in their standard deviations,
# and its sum over the blocks, weighted by the shares.
DISTANCE, DISTANCES = 127 * LANES, 128 * LANES
SCRATCH = 129 * LANES

# The neighbours of a block of targets: where they were when their lists were made, how far they may
# move from there, and down to where their outlier component may sink; the lists' common length.
# Copies of the components follow, STEP numbers for one of each target: the six rows of a packed
# set, and its INDEX.
AT_X, AT_Y, AT_COSINE, AT_SINE, REACH, SLACK, FLOOR, LEAST_SUM = range(0, 8 * LANES, LANES)
LENGTH, MEASURED, MARGIN = range(8 * LANES, 8 * LANES + 3)
PLACE = 9 * LANES
DENSE, NOT_FOUND = -1, -2  # lengths of lists: all components, and none found yet
INDEX = 6
STEP = 7 * LANES

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
