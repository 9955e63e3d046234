"""The compiled kernel: the cost, its derivatives and its minimum, for many problems in one call.

- ``layout``: constants, the rows of the scratch array, what a pass over the targets needs
- ``compiling``: how functions are compiled and kept
- ``elementary``: exponential and logarithm that vectorise
- ``pairs``: the double sum over targets and components
- ``densities``: outliers, measurements, their mixture, their fusion
- ``charts``: a motion, its twist, the velocity that causes it
- ``evaluation``: the cost of one pair of sets with its derivatives
- ``newton``: steps in a trust region
- ``minimisation``: sums of pairs, and their minimum
- ``batches``: the compiled entries
- ``consensus``: the velocity that most Doppler velocities agree with
- ``shared_errors``: what the errors of a scan's targets do together
- ``responsibilities``, ``propagation``: how the gradient changes with every measured coordinate
"""

from d2d._kernel.batches import (
    are_good_targets,
    chart_batch,
    evaluate_batch,
    minimise_batch,
    pack_targets,
    place_polar_targets,
    target_batch,
)
from d2d._kernel.compiling import read_only
from d2d._kernel.consensus import find_consensus
from d2d._kernel.layout import (
    ARC,
    CHORD,
    CORRUPTED,
    CURVATURE,
    GAIN,
    GRADIENT,
    INPUT_VARIANCE,
    KIND,
    LIKELIHOOD,
    LOG_DENSITY,
    LOG_OUTLIER_WEIGHT,
    MAX_VARIANCE,
    MAX_WEIGHT,
    MIN_WEIGHT,
    MOTION,
    NO_OUTLIER,
    SHARE,
    SLOPE,
    SUMMING,
    UNIFORM,
    UNIT_DENSITY_VARIANCE,
    VALUE,
    VARIANCE,
    WEIGHT,
    XX,
    XY,
    YY,
    X,
    Y,
)
from d2d._kernel.minimisation import Batch, own_work
from d2d._kernel.newton import SINGULAR
from d2d._kernel.propagation import cross_batch, make_propagation_work
from d2d._kernel.shared_errors import add_dependence, add_errors

__all__ = [
    "ARC",
    "CHORD",
    "CORRUPTED",
    "CURVATURE",
    "GAIN",
    "GRADIENT",
    "INPUT_VARIANCE",
    "KIND",
    "LIKELIHOOD",
    "LOG_DENSITY",
    "LOG_OUTLIER_WEIGHT",
    "MAX_VARIANCE",
    "MAX_WEIGHT",
    "MIN_WEIGHT",
    "MOTION",
    "NO_OUTLIER",
    "SHARE",
    "SINGULAR",
    "SLOPE",
    "SUMMING",
    "UNIFORM",
    "UNIT_DENSITY_VARIANCE",
    "VALUE",
    "VARIANCE",
    "WEIGHT",
    "XX",
    "XY",
    "YY",
    "Batch",
    "X",
    "Y",
    "add_dependence",
    "add_errors",
    "are_good_targets",
    "chart_batch",
    "cross_batch",
    "evaluate_batch",
    "find_consensus",
    "make_propagation_work",
    "minimise_batch",
    "own_work",
    "pack_targets",
    "place_polar_targets",
    "read_only",
    "target_batch",
]
