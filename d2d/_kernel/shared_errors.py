"""What the errors of one scan's targets do to an estimate, added up."""

import math

from d2d._kernel.compiling import compiled, entry, inlined, vectorised
from d2d._kernel.elementary import exp

REACH = 5.0  # correlation lengths, at which the correlation is 0.7 %


@compiled
def root_of(covariance):
    """Symmetric root of a covariance (2, 2): xx, xy, yy.

    It turns with the axes, so that errors of two targets correlate alike along any of them.
    """
    xx, xy, yy = covariance[0, 0], covariance[0, 1], covariance[1, 1]
    product = math.sqrt(max(xx * yy - xy * xy, 0.0))  # of the two standard deviations
    total = math.sqrt(xx + yy + 2.0 * product)
    return (xx + product) / total, xy / total, (yy + product) / total


@compiled
def add_outer(total, a, b, weight):
    """Add weight (a b' + b a') / 2 to the upper triangle of a matrix (3, 3)."""
    for i in range(3):
        for j in range(i, 3):
            total[i, j] += 0.5 * weight * (a[i] * b[j] + b[i] * a[j])


@inlined
def add_row(total, a, weight):
    """Add weight times a vector to another (3,)."""
    for i in range(3):
        total[i] += weight * a[i]


@entry
def add_errors(position, in_velocity, covariances, polar, velocity, noise, shared):
    """Add what the errors of one scan's targets do to the gradient.

    ``position`` (K, 3, 2) and ``in_velocity``, two (K, 3), are its derivatives in a target's
    position, Doppler velocity and azimuth in the prediction of that; the two may be empty.
    ``polar`` is the range with cosine and sine of the azimuth, ``velocity`` the Doppler velocity
    with its standard deviation and the azimuth's.  An azimuth's error turns the position and
    changes the prediction together.

    The covariance that the targets' own errors cause goes to the upper triangle of noise (3, 3).
    An azimuth error, a Doppler error and a Doppler scale error that all share change the gradient
    by the rows of ``shared`` (3, 3).  ``position`` is multiplied by the root of the positions'
    covariances, in place.
    """
    doppler, prediction = in_velocity
    distance, cosine, sine = polar
    value, sigma_doppler, sigma_azimuth = velocity
    for k in range(position.shape[0]):
        x, y = -distance[k] * sine[k], distance[k] * cosine[k]
        turned = (
            position[k, 0, 0] * x + position[k, 0, 1] * y,
            position[k, 1, 0] * x + position[k, 1, 1] * y,
            position[k, 2, 0] * x + position[k, 2, 1] * y,
        )
        add_row(shared[0], turned, 1.0)
        xx, xy, yy = root_of(covariances[k])
        for i in range(3):
            x, y = position[k, i, 0], position[k, i, 1]
            position[k, i, 0], position[k, i, 1] = x * xx + y * xy, x * xy + y * yy
        add_outer(noise, position[k, :, 0], position[k, :, 0], 1.0)
        add_outer(noise, position[k, :, 1], position[k, :, 1], 1.0)
        if k < doppler.shape[0]:
            square = sigma_azimuth[k] * sigma_azimuth[k]
            add_outer(noise, doppler[k], doppler[k], sigma_doppler[k] * sigma_doppler[k])
            add_outer(noise, prediction[k], prediction[k], square)
            add_outer(noise, prediction[k], turned, 2.0 * square)
            add_row(shared[0], prediction[k], 1.0)
            add_row(shared[1], doppler[k], 1.0)
            add_row(shared[2], doppler[k], value[k])


@vectorised
def weigh_neighbours(x, y, length, weights):
    """How strongly the errors of targets correlate with those of the first of them.

    Those farther than REACH lengths away do not count.
    """
    scale = 1.0 / length
    for b in range(1, weights.shape[0]):
        dx, dy = x[b] - x[0], y[b] - y[0]
        distance = math.sqrt(dx * dx + dy * dy) * scale
        weight = exp(-distance)
        weights[b] = weight if distance < REACH else 0.0


@entry
def add_dependence(rooted, means, order, length, rows, dependence):
    """Add what correlated neighbours cause beyond independent ones, in the upper triangle.

    ``rooted`` (K, 3, 2) are the influences of unit errors of the positions, which correlate by
    exp(-distance / length).  ``order`` sorts the means (K, 2) along x, so that only those near
    enough along x are looked at.  ``rows`` (9, K) is memory.
    """
    count, end = order.shape[0], 0
    for a in range(count):
        k = order[a]
        rows[0, a], rows[1, a] = means[k, 0], means[k, 1]
        for i in range(3):
            rows[3 + i, a], rows[6 + i, a] = rooted[k, i, 0], rooted[k, i, 1]
    for a in range(count):
        while end < count and rows[0, end] - rows[0, a] < REACH * length:
            end += 1
        weigh_neighbours(rows[0, a:end], rows[1, a:end], length, rows[2, a:end])
        x0 = x1 = x2 = y0 = y1 = y2 = 0.0  # what the neighbours of one target weigh
        for b in range(a + 1, end):
            weight = rows[2, b]
            x0 += weight * rows[3, b]
            x1 += weight * rows[4, b]
            x2 += weight * rows[5, b]
            y0 += weight * rows[6, b]
            y1 += weight * rows[7, b]
            y2 += weight * rows[8, b]
        add_outer(dependence, rows[3:6, a], (x0, x1, x2), 2.0)
        add_outer(dependence, rows[6:9, a], (y0, y1, y2), 2.0)
