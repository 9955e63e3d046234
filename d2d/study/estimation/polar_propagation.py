"""Error propagation from range and azimuth, through everything that depends on them."""

import numpy as np

from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.point_set import PointSet
from d2d.problem import Estimate
from d2d.study.plane.scenarios import Scenario

STEP = 1e-3  # of the differences, in standard deviations


def propagate_from_polar(
    estimate: Estimate,
    fixed: PointSet,
    moving: PointSet,
    cost: RegistrationCost,
    scenario: Scenario,
) -> Array:
    """Covariances (..., 3, 3) from finite differences of the gradient in each range and azimuth.

    A target's reported covariance is computed at its measured position and changes with it.  These
    differences include that change; `d2d.propagate_covariance` does not.
    """
    sigmas = scenario.sigma_range, scenario.sigma_azimuth
    middle = np.zeros_like(estimate.covariance)
    for which in (0, 1):
        means = (fixed, moving)[which].means
        polar = np.hypot(means[..., 0], means[..., 1]), np.arctan2(means[..., 1], means[..., 0])
        for target in range(means.shape[-2]):
            for coordinate in (0, 1):
                gradients = []
                for sign in (STEP, -STEP):
                    changed = [polar[0].copy(), polar[1].copy()]
                    changed[coordinate][..., target] += sign * sigmas[coordinate]
                    sets = [fixed, moving]
                    sets[which] = PointSet.from_polar(changed[0], changed[1], *sigmas)
                    gradients.append(cost.derivatives(estimate.theta, *sets)[1])
                change = (gradients[0] - gradients[1]) / (2.0 * STEP)
                middle += change[..., :, None] * change[..., None, :]
    return np.asarray(estimate.covariance @ middle @ estimate.covariance)
