"""What the errors of one scan's targets do to an estimate, added up."""

import math

from d2d._kernel.compiling import compiled, entry
from d2d._kernel.elementary import exp


@compiled
def root_of(covariance):
    """Lower triangular root of a covariance (2, 2): xx, yx, yy."""
    xx = math.sqrt(covariance[0, 0])
    yx = covariance[1, 0] / xx
    return xx, yx, math.sqrt(max(covariance[1, 1] - yx * yx, 0.0))


@compiled
def add_outer(total, a, b, weight):
    """Add weight (a b' + b a') / 2 to the upper triangle of a matrix (3, 3)."""
    for i in range(3):
        for j in range(i, 3):
            total[i, j] += 0.5 * weight * (a[i] * b[j] + b[i] * a[j])


@entry
def add_errors(position, doppler, prediction, covariances, lever, sigmas, noise):
    """Add the covariance that the targets' own errors cause to the upper triangle of noise (3, 3).

    ``position`` (K, 3, 2), ``doppler`` and ``prediction`` (K, 3) are the influences of a target's
    position, Doppler velocity and azimuth in the prediction, ``lever`` (K, 2) is the derivative of
    its position in the azimuth, ``sigmas`` (2, K) are those of Doppler velocity and azimuth.  An
    azimuth's error turns the position and changes the prediction together.  ``position`` is
    multiplied by the root of the positions' covariances, in place.
    """
    for k in range(position.shape[0]):
        square = sigmas[1, k] * sigmas[1, k]
        turned = (
            position[k, 0, 0] * lever[k, 0] + position[k, 0, 1] * lever[k, 1],
            position[k, 1, 0] * lever[k, 0] + position[k, 1, 1] * lever[k, 1],
            position[k, 2, 0] * lever[k, 0] + position[k, 2, 1] * lever[k, 1],
        )
        xx, yx, yy = root_of(covariances[k])
        for i in range(3):
            x, y = position[k, i, 0], position[k, i, 1]
            position[k, i, 0], position[k, i, 1] = x * xx + y * yx, y * yy
        add_outer(noise, position[k, :, 0], position[k, :, 0], 1.0)
        add_outer(noise, position[k, :, 1], position[k, :, 1], 1.0)
        add_outer(noise, doppler[k], doppler[k], sigmas[0, k] * sigmas[0, k])
        add_outer(noise, prediction[k], prediction[k], square)
        add_outer(noise, prediction[k], turned, 2.0 * square)


@entry
def add_dependence(rooted, means, order, length, dependence):
    """Add what correlated neighbours cause beyond independent ones, in the upper triangle.

    ``rooted`` (K, 3, 2) are the influences of unit errors of the positions, which correlate by
    exp(-distance / length).  ``order`` sorts the means (K, 2) along x, so that only those within
    five lengths, where the correlation is 0.7 %, are looked at.
    """
    reach = 5.0 * length
    for a in range(order.shape[0]):
        k = order[a]
        x0 = x1 = x2 = y0 = y1 = y2 = 0.0  # what the neighbours of one target weigh
        for b in range(a + 1, order.shape[0]):
            j = order[b]
            dx, dy = means[j, 0] - means[k, 0], means[j, 1] - means[k, 1]
            if dx > reach:
                break
            square = dx * dx + dy * dy
            if square < reach * reach:
                weight = exp(-math.sqrt(square) / length)
                x0 += weight * rooted[j, 0, 0]
                x1 += weight * rooted[j, 1, 0]
                x2 += weight * rooted[j, 2, 0]
                y0 += weight * rooted[j, 0, 1]
                y1 += weight * rooted[j, 1, 1]
                y2 += weight * rooted[j, 2, 1]
        add_outer(dependence, rooted[k, :, 0], (x0, x1, x2), 2.0)
        add_outer(dependence, rooted[k, :, 1], (y0, y1, y2), 2.0)
