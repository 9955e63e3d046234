"""Effect of an outlier on the cost surfaces of the scene on a line."""

from functools import cache
from itertools import product

import numpy as np

from d2d._types import Array
from d2d.cost import CorruptedGaussian, RegistrationCost, UniformOutlier
from d2d.point_set import PointSet
from d2d.study.line.scene import CORRUPTED, TRUTH, line_scene, with_outlier
from d2d.study.line.surfaces import Survey, log_surface, survey

DRAWS = 400  # the standard error of a share is 2.5 % or less
MAP_DRAWS = 120  # for each pair of parameters
TRANSLATIONS = np.arange(-16.0, 20.0, 0.03)  # m
SEED = 42
RIGHT = 1.1  # m: half way from the true alignment to the next distance at which targets meet
COMPARABLE, TINY = 0.5, 0.01  # of the highest peak
VANISHED = 16.0  # decades: what double precision cannot add to the value without outliers
FAR = 9.0  # standard deviations of a difference: a density that costs more than those decades
SUMMING = RegistrationCost(fusion="summing")
LIKELIHOOD = RegistrationCost()
# A fifth of outliers spread evenly over 25 m, beside four fifths of inliers: 0.2 / (0.8 * 25 m).
UNIFORM_DENSITY = 0.01  # 1/m
UNIFORM = RegistrationCost(outlier=UniformOutlier(UNIFORM_DENSITY))
ROBUST = RegistrationCost(outlier=CORRUPTED)
FRACTIONS = (0.001, 0.05, 0.2, 0.5, 0.9)
WIDTHS = (0.3, 1.0, 3.0, 10.0, 100.0)  # m


@cache
def scene(where: str = "", draws: int = DRAWS) -> tuple[PointSet, PointSet]:
    """Draws with a randomly placed outlier in that set, or with none: the same noise for all."""
    rng = np.random.default_rng(SEED)
    if where:
        return with_outlier(rng, where, draws=(draws,))
    return line_scene(rng, draws=(draws,))


@cache
def survey_scene(cost: RegistrationCost, where: str = "", draws: int = DRAWS) -> Survey:
    """The fused surfaces of those draws."""
    return survey(TRANSLATIONS, log_surface(cost, TRANSLATIONS, *scene(where, draws)), TRUTH)


def survey_corrupted(fraction: float, width: float, draws: int) -> Survey:
    """A corrupted Gaussian of that fraction and width (m), with a randomly placed outlier in M."""
    outlier = CorruptedGaussian(fraction, np.array([[width**2]]))
    return survey_scene(RegistrationCost(outlier=outlier), "moving", draws)


@cache
def outlier_map() -> tuple[Array, Array, Array]:
    """Corrupted Gaussians of each fraction and width (m), with a randomly placed outlier in M.

    Shares (FRACTIONS, WIDTHS) of draws that are right, or have a rival, and median basin (m).
    """
    shape = len(FRACTIONS), len(WIDTHS)
    surveys = [survey_corrupted(*pair, MAP_DRAWS) for pair in product(FRACTIONS, WIDTHS)]
    right = [each.right(TRUTH, RIGHT).mean() for each in surveys]
    comparable = [np.mean(each.rival > COMPARABLE) for each in surveys]
    basin = [np.median(each.basin_width) for each in surveys]
    return np.reshape(right, shape), np.reshape(comparable, shape), np.reshape(basin, shape)


def decades_lost(
    cost: RegistrationCost, theta: Array, fixed: PointSet, moving: PointSet, outliers: int
) -> Array:
    """Decades (...) that the last targets of ``moving`` cost the fused density at the motion."""
    without = PointSet(moving.means[..., :-outliers, :], moving.covariances[..., :-outliers, :, :])
    lost = cost.value(theta, fixed, moving) - cost.value(theta, fixed, without)
    return np.asarray(lost / np.log(10.0))
