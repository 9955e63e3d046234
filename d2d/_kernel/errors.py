"""Effect of the errors of the targets of one set on the gradient, added up."""

import math

from d2d._kernel.compile import compiled, entry, vectorised
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
def add_symmetric(total, a, b):
    """Add a b' + b a' to a matrix (3, 3)."""
    for i in range(3):
        for j in range(3):
            total[i, j] += a[i] * b[j] + b[i] * a[j]


@entry
def add_positions(position, covariances, noise):
    """Add f_z Sigma_z f_z' of each target's own position error to noise.

    For B problems, with the derivatives f_z in the ``position`` (B, K, 3, 2) of each target and the
    ``covariances`` (B, K, 2, 2); noise is (B, 3, 3).
    """
    for b in range(position.shape[0]):
        for k in range(position.shape[1]):
            row, own = position[b, k], covariances[b, k]
            xx, xy, yy = own[0, 0], own[0, 1], own[1, 1]
            for i in range(3):
                x, y = row[i, 0] * xx + row[i, 1] * xy, row[i, 0] * xy + row[i, 1] * yy
                for j in range(3):
                    noise[b, i, j] += x * row[j, 0] + y * row[j, 1]


@vectorised
def weigh_neighbours(x, y, length, weights):
    """Correlations of targets' errors with those of the first one, zero beyond REACH lengths."""
    scale = 1.0 / length
    for b in range(1, weights.shape[0]):
        dx, dy = x[b] - x[0], y[b] - y[0]
        distance = math.sqrt(dx * dx + dy * dy) * scale
        weight = exp(-distance)
        weights[b] = weight if distance < REACH else 0.0


@entry
def add_dependence(position, covariances, means, ends, order, length, rows, dependence):
    """Add the covariance due to correlated neighbours, beyond that of independent errors.

    The errors of the positions of K targets, seen along the axes of their own covariances,
    correlate by exp(-distance / length) within a scan, whose targets end before ``ends`` (K,).
    ``position`` (K, 3, 2) and ``covariances`` (K, 2, 2) are those of `add_positions`.  ``order``
    sorts each scan along x, of the means (K, 2), so that only those near enough along x are looked
    at.  ``rows`` (9, K) is memory.
    """
    count, end = order.shape[0], 0
    for a in range(count):
        k = order[a]
        rows[0, a], rows[1, a] = means[k, 0], means[k, 1]
        xx, xy, yy = root_of(covariances[k])
        for i in range(3):
            x, y = position[k, i, 0], position[k, i, 1]
            rows[3 + i, a], rows[6 + i, a] = x * xx + y * xy, x * xy + y * yy
    for a in range(count):
        while end < ends[a] and rows[0, end] - rows[0, a] < REACH * length:
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
        add_symmetric(dependence, rows[3:6, a], (x0, x1, x2))
        add_symmetric(dependence, rows[6:9, a], (y0, y1, y2))
