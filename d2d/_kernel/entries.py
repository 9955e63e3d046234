"""The compiled entries: many problems in one call."""

import math

from d2d._kernel import layout, rows
from d2d._kernel.charts import centred_chart, exponential_chart, logarithm_chart, write_chart
from d2d._kernel.compile import compiled, entry
from d2d._kernel.cost import evaluate_block, motion_chart, pair_at, setting_of
from d2d._kernel.jets import through_chart
from d2d._kernel.layout import SINGULAR, WEIGHT, XX, XY, YY, X, Y, work_in
from d2d._kernel.newton import invert, minimise, moving_targets
from d2d._kernel.pairs import find_extremes
from d2d._kernel.rows import LANES

ROUNDED = 1e-14  # part of a variance that may be rounding
# Sizes of a set between it and the origin, beyond which no step can tell a rotation about the
# origin from a translation.  Nearer sets keep it: about their means, the descent from zero finds
# the truth of the thesis's scenes in 48 % of the runs instead of 91 % (robust likelihood).
FAR = 1e3


@entry
def are_good_targets(means, covariances, weights):
    """Whether targets (M, D), (M, D, D), (M,) are finite, with exactly symmetric, positive
    definite covariances and weights, all within the range that the sums allow.
    """
    d = means.shape[1]
    for k in range(means.shape[0]):
        good = abs(means[k, 0]) <= layout.MAX_LENGTH
        good = good and layout.MIN_WEIGHT <= weights[k] <= layout.MAX_WEIGHT
        xx = covariances[k, 0, 0]
        good = good and layout.MIN_VARIANCE <= xx <= layout.MAX_VARIANCE
        if d == 2:
            xy, yy = covariances[k, 0, 1], covariances[k, 1, 1]
            good = good and abs(means[k, 1]) <= layout.MAX_LENGTH
            good = good and layout.MIN_VARIANCE <= yy <= layout.MAX_VARIANCE
            good = good and xy == covariances[k, 1, 0] and xx * yy - xy * xy > SINGULAR * (xx * yy)
        if not good:
            return False
    return True


@entry
def place_polar_targets(polar, direction, extent, origin, means, covariances):
    """Fill means (M, 2) and covariances (M, 2, 2) of targets; whether all covariances are good.

    ``polar`` is range, sigma_range and sigma_azimuth, ``direction`` cosine and sine of the azimuth,
    all (M,), seen from the origin (2,); the variance of the extent (M,) is added along each axis.
    """
    r, sigma_r, sigma_phi = polar
    cosine, sine = direction
    good = True
    for k in range(r.shape[0]):
        c, s, added = cosine[k], sine[k], extent[k] * extent[k]
        across = r[k] * sigma_phi[k]
        radial, across = sigma_r[k] * sigma_r[k], across * across
        xx = radial * (c * c) + across * (s * s) + added
        xy = (radial - across) * c * s
        yy = radial * (s * s) + across * (c * c) + added
        good = good and min(xx, yy) >= layout.MIN_VARIANCE and max(xx, yy) <= layout.MAX_VARIANCE
        good = good and xx * yy - xy * xy > SINGULAR * (xx * yy) and r[k] <= layout.MAX_LENGTH
        means[k, 0], means[k, 1] = r[k] * c + origin[0], r[k] * s + origin[1]
        covariances[k, 0, 0], covariances[k, 1, 1] = xx, yy
        covariances[k, 0, 1] = covariances[k, 1, 0] = xy
    return good


@compiled
def middle_of(means, covariances):
    """The point (2,) about which targets (N, D) are computed: the origin, or their mean if it is
    more than FAR times the size of the set away.
    """
    size, last = means.shape[0], means.shape[1] - 1
    at_x, at_y = means[0, 0], means[0, last]
    x = y = spread = 0.0
    for k in range(size):
        dx, dy = means[k, 0] - at_x, means[k, last] - at_y
        x, y = x + dx / size, y + dy / size
        spread += (covariances[k, 0, 0] + covariances[k, last, last] + dx * dx + dy * dy) / size
    spread -= x * x + y * y
    x, y = at_x + x, last * (at_y + y)
    return (x, y) if x * x + y * y > FAR * FAR * spread else (0.0, 0.0)


@entry
def pack_targets(means, covariances, weights, packed, extremes, centres):
    """Pack sets (B, N, D), (B, N, D, D), (B, N) into (B, 6, N), with their means about centres.

    Fills also their bounds (B, 5), see `find_extremes`, and the centres (B, 2).
    """
    size, planar = means.shape[1], means.shape[2] == 2
    for b in range(means.shape[0]):
        points = packed[b]
        x, y = middle_of(means[b], covariances[b])
        centres[b, 0], centres[b, 1] = x, y
        for k in range(size):
            points[X, k], points[XX, k] = means[b, k, 0] - x, covariances[b, k, 0, 0]
            points[WEIGHT, k] = weights[b, k]
            if planar:
                points[Y, k] = means[b, k, 1] - y
                points[XY, k], points[YY, k] = covariances[b, k, 0, 1], covariances[b, k, 1, 1]
            else:
                points[Y, k] = points[XY, k] = 0.0
                points[YY, k] = layout.UNIT_DENSITY_VARIANCE
        find_extremes(points, extremes[b])


@entry
def order_targets(packed, counts, orders):
    """Order the targets of sets (B, 6, N) so that neighbours stand together, as rows (B, N).

    They are sorted into cells, strip by strip, every other strip from its end (counting sort).
    ``counts`` is memory of N + 8.
    """
    size = orders.shape[1]
    strips = 1 + int(math.sqrt(size / (2 * LANES)))
    cells = (size + 7) // strips
    for b in range(orders.shape[0]):
        x, y, order = packed[b, X], packed[b, Y], orders[b]
        left, right, bottom, top = math.inf, -math.inf, math.inf, -math.inf
        for k in range(size):
            left, right = min(left, x[k]), max(right, x[k])
            bottom, top = min(bottom, y[k]), max(top, y[k])
        across = strips * (1.0 - 1e-9) / max(right - left, 1e-300)
        along = cells * (1.0 - 1e-9) / max(top - bottom, 1e-300)
        counts[:] = 0
        for turn in range(2):
            for k in range(size):
                strip, row = int((x[k] - left) * across), int((y[k] - bottom) * along)
                cell = strip * cells + (row if strip % 2 == 0 else cells - 1 - row)
                if turn == 0:
                    counts[cell + 1] += 1
                else:
                    order[counts[cell]] = k
                    counts[cell] += 1
            if turn == 0:
                for cell in range(strips * cells):
                    counts[cell + 1] += counts[cell]


@entry
def target_batch(batch, thetas, wanted, memory, values):
    """Rows of the scratch array for every target of every problem (B, rows, targets), at its theta.

    LOG_DENSITY holds log q_k, GRADIENT its gradient in the motion, CURVATURE the second derivatives
    of q_k over q_k, and SHARE the inlier component's share in q_k.
    """
    w, lists = memory.scratch, memory.lists[0]
    for b in range(thetas.shape[0]):
        done = 0
        for number in range(batch.first[b], batch.first[b + 1]):
            pair = pair_at(batch, number, 1.0)
            chart = motion_chart(batch, number, thetas[b])
            setting = setting_of(pair, (chart.x, chart.y, chart.phi), layout.GATE)
            targets = pair.moving.shape[1]
            for first in range(0, targets, LANES):
                lists[rows.LENGTH] = rows.NOT_FOUND
                evaluate_block(memory, pair, setting, first, 0.0, lists)
                for k in range(min(LANES, targets - first)):
                    for r in range(wanted.shape[0]):
                        values[b, r, done + pair.order[first + k]] = w[wanted[r] + k]
            done += targets


@compiled
def wrap(theta):
    """Bring a rotation into (-pi, pi]; whether it was outside."""
    angle = theta[2]
    if -math.pi < angle <= math.pi or not math.isfinite(angle):
        return False
    theta[2] = angle - 2.0 * math.pi * math.ceil((angle - math.pi) / (2.0 * math.pi))
    theta[2] = min(max(theta[2], -math.pi * (1.0 - 1e-16)), math.pi)
    return True


@compiled
def bring_back(theta, a, b, g, h, covariance):
    """Bring a motion about the centres a and b back, with its derivatives and covariance."""
    back = centred_chart((0.0, 0.0, theta[2]), a, b)
    theta[0] -= back.x
    theta[1] -= back.y
    jet = (0.0, g[0], g[1], g[2], h[0, 0], h[0, 1], h[1, 1], h[0, 2], h[1, 2], h[2, 2])
    _, g[0], g[1], g[2], h00, h01, h11, h02, h12, h22 = through_chart(jet, back)
    h[0, 0], h[1, 1], h[2, 2] = h00, h11, h22
    h[0, 1] = h[1, 0] = h01
    h[0, 2] = h[2, 0] = h02
    h[1, 2] = h[2, 1] = h12
    for i in range(3):  # K C K' with the inverse Jacobian K = [[1, 0, -c], [0, 1, -d], [0, 0, 1]]
        covariance[0, i] -= back.c * covariance[2, i]
        covariance[1, i] -= back.d * covariance[2, i]
    for i in range(3):
        covariance[i, 0] -= back.c * covariance[i, 2]
        covariance[i, 1] -= back.d * covariance[i, 2]
    covariance[1, 0] = covariance[0, 1]


@compiled
def is_regular(c):
    """Whether double precision can tell a covariance (3, 3) from a singular one."""
    by_x, by_y = c[0, 2] / c[2, 2], c[1, 2] / c[2, 2]
    x, y, xy = c[0, 0] - by_x * c[0, 2], c[1, 1] - by_y * c[1, 2], c[0, 1] - by_x * c[1, 2]
    return x > ROUNDED * c[0, 0] and y > ROUNDED * c[1, 1] and y - xy * xy / x > ROUNDED * c[1, 1]


@entry
def minimise_batch(batch, tolerance, max_iterations, memory, optima):
    """Minimise every problem separately, from the thetas of ``optima``; whether any one failed.

    Without an iteration, these are the cost and its derivatives at the starts.
    A motion without measurements is sought about the centres of the sets, see `middle_of`.
    """
    thetas, numbers, gradient, hessian, covariance, iterations, good, undetermined = optima
    failed, work = False, work_in(memory)
    known, measured = batch.outlier[layout.KIND] != layout.NO_OUTLIER, batch.factors.shape[0] > 0
    for b in range(thetas.shape[0]):
        row = batch.pairs[batch.first[b]]
        a = batch.fixed_centres[row[layout.FIXED_SET]]
        c = batch.moving_centres[row[layout.MOVING_SET]]
        away = batch.centred and (a[0] != 0.0 or a[1] != 0.0 or c[0] != 0.0 or c[1] != 0.0)
        if away:
            chart = centred_chart((thetas[b, 0], thetas[b, 1], thetas[b, 2]), a, c)
            thetas[b, 0], thetas[b, 1] = chart.x, chart.y
        if max_iterations > 0 and batch.kind == layout.MOTION:
            wrap(thetas[b])
        x, y, angle, most = thetas[b, 0], thetas[b, 1], thetas[b, 2], max_iterations
        for _ in range(2):
            value, converged, tried, shares, distances, flat = minimise(
                batch, b, thetas[b], tolerance, most, work, gradient[b], hessian[b]
            )
            iterations[b] = tried if most == max_iterations else iterations[b] + tried
            if most == 0 or batch.kind != layout.MOTION or not (wrap(thetas[b]) and measured):
                break
            # To a measurement another turn is another motion: back to the start, not converged.
            thetas[b, 0], thetas[b, 1], thetas[b, 2], most = x, y, angle, 0
        if converged:
            invert(hessian[b], work.step, work.trial, covariance[b])
        freedom = (1.0 + batch.planar) * shares - (1.0 + 2.0 * batch.planar)
        numbers[b, 0], numbers[b, 3] = value, freedom
        numbers[b, 1] = shares / moving_targets(batch, b) if known else math.nan
        numbers[b, 2] = 2.0 * distances / freedom if freedom > 0.0 else math.nan
        if away:
            bring_back(thetas[b], a, c, gradient[b], hessian[b], covariance[b])
            converged = converged and (batch.planar == 0.0 or is_regular(covariance[b]))
        if not converged:
            covariance[b, :, :], failed = math.nan, True
        good[b], undetermined[b] = converged, flat
    return failed


@entry
def chart_batch(points, inverse, image, first, second):
    """The exponentials of twists (B, 3), or the logarithms of motions, with their derivatives."""
    for b in range(points.shape[0]):
        if inverse:
            chart = logarithm_chart(points[b])
        else:
            chart = exponential_chart(points[b, 0], points[b, 1], points[b, 2])
        write_chart(chart, image[b], first[b], second[b])
