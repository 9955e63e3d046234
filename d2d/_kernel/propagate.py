"""How the gradient changes with every measured coordinate: what propagation of errors needs.

Every cost has the gradient ``f_theta = -sum_ki gamma_ki L_theta,ki`` with responsibilities gamma
that sum to one over a target's components (likelihood) or over all pairs (summing), and with the
mean gradient g over the same pairs::

    f_theta,z = -sum_ki gamma_ki (L_theta,z + (L_theta - g) L_z')

`d2d.dense.cross_derivatives` has it in NumPy.  The cost's own pass leaves g and the factors that
turn weights into responsibilities; a second pass over the pairs adds up f_theta,z.
"""

import math

import numpy as np

from d2d._kernel.compile import compiled, entry, inlined, merged, vectorised
from d2d._kernel.cost import align_tops, evaluate_block, motion_chart, pair_at, setting_of, total
from d2d._kernel.densities import half_square
from d2d._kernel.elementary import exp
from d2d._kernel.jets import fuse_summing, gradient_through_chart
from d2d._kernel.layout import (
    CENTRED,
    CORRUPTED,
    COUNTS,
    CXX,
    CXY,
    CYY,
    DENSE,
    FACTOR,
    G0,
    G1,
    G2,
    GAIN,
    GAMMA,
    INDEX,
    INLIER,
    INPUT_VARIANCE,
    KIND,
    LANES,
    LENGTH,
    MAX_EXPONENT,
    MEAN,
    MOVED,
    MX,
    MY,
    NOT_FOUND,
    NO_OUTLIER,
    OFFSET,
    OUTLIER_OFFSET,
    OUTLIER_SCALE,
    OUTLIER_TO_SHARE,
    PLACE,
    PRECISION_XX,
    PRECISION_XY,
    PRECISION_YY,
    SCALE,
    SHARE,
    SLOPE,
    STEP,
    SUMMING,
    TO_SHARE,
    TOP,
    TOTAL,
    UNIFORM,
    VALUE,
    VARIANCE,
    WEIGHT,
    X,
    Y,
    lane_count,
)
from d2d._kernel.neighbours import component_of, difference

ROWS = 6 * LANES  # of one component's cross derivatives, lane by lane


@vectorised
def cross_terms(gamma, centred, u, precision, v):
    """gamma (B [e_x, e_y, v] + u c')', row by row: what a pair adds to -f_theta,z of its mean.

    With u = B d, the gradient c of the pair's logarithm less the mean one, and v = E p - C_phi u.
    """
    bxx, bxy, byy = precision
    c0, c1, c2 = centred
    ux, uy = u
    return (
        gamma * (bxx + c0 * ux),
        gamma * (bxy + c0 * uy),
        gamma * (bxy + c1 * ux),
        gamma * (byy + c1 * uy),
        gamma * (bxx * v[0] + bxy * v[1] + c2 * ux),
        gamma * (bxy * v[0] + byy * v[1] + c2 * uy),
    )


@vectorised
def add_terms(w, k, own, terms, gamma, u):
    """Add a pair's terms to both of its means."""
    for row in range(6):
        own[row * LANES + k] -= terms[row]
        w[MOVED + row * LANES + k] += terms[row]
    w[MOVED + 4 * LANES + k] += gamma * u[1]  # d_phi = E p depends on the target's position
    w[MOVED + 5 * LANES + k] -= gamma * u[0]


@inlined
def add_inlier(w, k, fixed, i, setting, own):
    """Add the pair of a lane's target and a component, see `pairs.add_step`."""
    dx, dy, sxx, sxy, syy, square, determinant = difference(w, k, component_of(fixed, i, setting))
    x, y, inverse = w[MX + k], w[MY + k], 1.0 / determinant
    bxx, bxy, byy = syy * inverse, -sxy * inverse, sxx * inverse
    ux, uy = bxx * dx + bxy * dy, bxy * dx + byy * dy
    gamma = w[SCALE + k] * fixed[WEIGHT, i] * math.sqrt(inverse)
    gamma *= exp(min(w[OFFSET + k] - 0.5 * square * inverse, MAX_EXPONENT))
    a, h = -2.0 * w[CXY + k], w[CXX + k] - w[CYY + k]  # C_phi = [[a, h], [h, -a]]
    bent_x, bent_y = a * ux + h * uy, h * ux - a * uy
    turn = ux * (0.5 * bent_x + y) + uy * (0.5 * bent_y - x)
    turn -= 0.5 * (a * (bxx - byy) + 2.0 * h * bxy)
    centred = (
        w[FACTOR + G0 + k] - ux - w[MEAN + k],
        w[FACTOR + G1 + k] - uy - w[MEAN + LANES + k],
        w[FACTOR + G2 + k] + turn - w[MEAN + 2 * LANES + k],
    )
    terms = cross_terms(gamma, centred, (ux, uy), (bxx, bxy, byy), (-y - bent_x, x - bent_y))
    add_terms(w, k, own, terms, gamma, (ux, uy))
    w[GAMMA + k] += gamma
    for row in range(3):
        w[CENTRED + row * LANES + k] += gamma * centred[row]


@compiled
def add_inliers(w, fixed, setting, place, cross):
    """Add the pairs of a block's neighbours, which the first pass has left at its ``place``."""
    dense = place[LENGTH] == DENSE
    steps = fixed.shape[1] if dense else int(place[LENGTH])
    for k in range(LANES):
        if w[SCALE + k] > 0.0:
            for n in range(steps):
                i = n if dense else int(place[PLACE + n * STEP + INDEX * LANES + k])
                if i >= 0:
                    add_inlier(w, k, fixed, i, setting, cross[i * ROWS : (i + 1) * ROWS])


@vectorised
def add_corrupted(w, fixed, setting, outlier, cross):
    """Add the pairs of all targets and components in the corrupted Gaussian."""
    lanes = lane_count(w)
    precision = outlier[PRECISION_XX], outlier[PRECISION_XY], outlier[PRECISION_YY]
    bxx, bxy, byy = precision
    for i in range(fixed.shape[1]):
        own = cross[i * ROWS : (i + 1) * ROWS]
        mean, weight = (fixed[X, i] - setting.x, fixed[Y, i] - setting.y), fixed[WEIGHT, i]
        for k in range(lanes):
            dx, dy, half = half_square(w, k, mean, precision)
            gamma = w[OUTLIER_SCALE + k] * weight
            gamma *= exp(min(w[OUTLIER_OFFSET + k] - half, MAX_EXPONENT))
            ux, uy = bxx * dx + bxy * dy, bxy * dx + byy * dy
            x, y = w[MX + k], w[MY + k]
            centred = (
                -ux - w[MEAN + k],
                -uy - w[MEAN + LANES + k],
                y * ux - x * uy - w[MEAN + 2 * LANES + k],
            )
            terms = cross_terms(gamma, centred, (ux, uy), precision, (-y, x))
            add_terms(w, k, own, terms, gamma, (ux, uy))


@merged
def add_outliers(w, fixed, setting, outlier, cross):
    """Add the pairs of the outlier component, if it depends on the components one by one."""
    kind = outlier[KIND]
    if kind == CORRUPTED:
        add_corrupted(w, fixed, setting, outlier, cross)
    elif kind != NO_OUTLIER and kind != UNIFORM:
        raise ValueError("the kernel does not know this kind of outlier component")


@inlined
def prepare_targets(w, outlier, fusion, measured, top):
    """Set the scales and mean gradients of a block's targets, and all their sums to zero.

    ``top`` is the logarithm of the density that all targets share in the sum.
    """
    for k in range(LANES):
        scale = w[COUNTS + k]
        if fusion == SUMMING:
            scale *= math.exp(w[INLIER + k] - top)
        share = w[SHARE + k] if outlier[KIND] != NO_OUTLIER else 1.0
        w[SCALE + k] = scale * share * w[TO_SHARE + k]
        w[OUTLIER_SCALE + k] = scale * (1.0 - share) * w[OUTLIER_TO_SHARE + k]
        if fusion != SUMMING:
            for row in range(3):
                w[MEAN + row * LANES + k] = w[INLIER + G0 + row * LANES + k]
        if not measured:
            w[FACTOR + G0 + k] = w[FACTOR + G1 + k] = w[FACTOR + G2 + k] = 0.0
        w[GAMMA + k] = 0.0
        for row in range(3):
            w[CENTRED + row * LANES + k] = 0.0
        for row in range(6):
            w[MOVED + row * LANES + k] = 0.0


@compiled
def measurement_slopes(factor, chart):
    """What the two errors of a measurement change: the logarithm of its density and the gradient.

    By the measured value, and by the input through the prediction alone.
    """
    h0, h1, h2 = factor[GAIN], factor[GAIN + 1], factor[GAIN + 2]
    s0, s1, s2 = factor[SLOPE], factor[SLOPE + 1], factor[SLOPE + 2]
    residual = factor[VALUE] - h0 * chart.x - h1 * chart.y - h2 * chart.phi
    slope = s0 * chart.x + s1 * chart.y + s2 * chart.phi
    variance = factor[VARIANCE] + factor[INPUT_VARIANCE] * slope * slope
    e = residual / variance
    along = 2.0 * factor[INPUT_VARIANCE] * slope * e / variance
    v0, v1, v2 = h0 / variance + along * s0, h1 / variance + along * s1, h2 / variance + along * s2
    i0, i1, i2 = e * s0 - slope * v0, e * s1 - slope * v1, e * s2 - slope * v2
    by_value = gradient_through_chart(v0, v1, v2, chart)
    by_input = gradient_through_chart(i0, i1, i2, chart)
    return -e, by_value, slope * e, by_input


@merged
def cross_pair(pair, setting, fusion, memory, cross, own):
    """Cross derivatives of one pair of sets, of the gradient in the motion.

    With the sum, all targets share one density and one mean gradient, which a first round finds.
    """
    by_fixed, by_moving, by_value, by_input = own
    w, place = memory.scratch, memory.places[0]
    fixed, moving, order = pair.fixed, pair.moving, pair.order
    factors, outlier = pair.factors, pair.outlier
    measured, top = factors.shape[0] > 0, 0.0
    cross = cross[: fixed.shape[1] * ROWS]
    cross[:] = 0.0
    for k in range(10 * LANES):
        w[TOTAL + k] = 0.0
    for k in range(LANES):
        w[TOP + k] = -np.inf
    blocks = (moving.shape[1] + LANES - 1) // LANES
    rounds = 2 if fusion == SUMMING else 1
    for visit in range(rounds * blocks):
        first = visit % blocks * LANES
        place[LENGTH] = NOT_FOUND
        evaluate_block(memory, pair, setting, first, 0.0, place)
        if visit < (rounds - 1) * blocks:
            fuse_summing(w)
            if visit == blocks - 1:
                top, sums = align_tops(w), total(w, 0)
                top += math.log(sums)
                for row in range(3):
                    mean = total(w, G0 + row * LANES) / sums
                    for k in range(LANES):
                        w[MEAN + row * LANES + k] = mean
            continue
        prepare_targets(w, outlier, fusion, measured, top)
        add_inliers(w, fixed, setting, place, cross)
        add_outliers(w, fixed, setting, outlier, cross)
        for k in range(min(LANES, moving.shape[1] - first)):
            j = order[first + k]
            for i in range(3):
                x, y = w[MOVED + 2 * i * LANES + k], w[MOVED + (2 * i + 1) * LANES + k]
                # from the rotated mean to the mean itself
                by_moving[j, i, 0] = setting.cosine * x + setting.sine * y
                by_moving[j, i, 1] = setting.cosine * y - setting.sine * x
                by_value[j, i] = by_input[j, i] = 0.0
            if measured:
                in_value, by_v, in_input, by_i = measurement_slopes(factors[j], setting.chart)
                for i in range(3):
                    centred = w[CENTRED + i * LANES + k]
                    by_value[j, i] = -w[GAMMA + k] * by_v[i] - centred * in_value
                    by_input[j, i] = -w[GAMMA + k] * by_i[i] - centred * in_input
    for i in range(fixed.shape[1]):
        for row in range(6):
            added = 0.0
            for k in range(LANES):
                added += cross[i * ROWS + row * LANES + k]
            by_fixed[i, row // 2, row % 2] = added


@compiled
def scale_rows(rows, chart, interval):
    """Derivatives of the gradient in a motion become those of the gradient in its velocity."""
    g0, g1, g2 = gradient_through_chart(rows[0], rows[1], rows[2], chart)
    rows[0], rows[1], rows[2] = interval * g0, interval * g1, interval * g2


@entry
def cross_batch(batch, thetas, begin, memory, cross, by_fixed, by_moving, by_value, by_input):
    """Derivatives of the gradients of some problems, from ``begin`` on, in all that is measured.

    In the fixed and moving means (C, targets, 3, 2), in the measurements' values (C, targets, 3)
    and, through their predictions only, in their inputs (C, targets, 3); the targets of a problem's
    pairs one pair after the other.
    ``cross`` is memory, ROWS for each target of a fixed set.
    """
    for c in range(by_fixed.shape[0]):
        b, fixed_done, moving_done = begin + c, 0, 0
        for number in range(batch.first[b], batch.first[b + 1]):
            pair = pair_at(batch, number)
            chart = motion_chart(batch, number, thetas[b])
            setting = setting_of(pair, (chart.x, chart.y, chart.phi))
            n, m = pair.fixed.shape[1], pair.moving.shape[1]
            own_fixed = by_fixed[c, fixed_done : fixed_done + n]
            own_moving = by_moving[c, moving_done : moving_done + m]
            own_value = by_value[c, moving_done : moving_done + m]
            own_input = by_input[c, moving_done : moving_done + m]
            own = own_fixed, own_moving, own_value, own_input
            cross_pair(pair, setting, batch.fusion, memory, cross, own)
            interval = batch.intervals[number]
            for i in range(n):
                scale_rows(own_fixed[i, :, 0], chart, interval)
                scale_rows(own_fixed[i, :, 1], chart, interval)
            for j in range(m):
                scale_rows(own_moving[j, :, 0], chart, interval)
                scale_rows(own_moving[j, :, 1], chart, interval)
                scale_rows(own_value[j], chart, interval)
                scale_rows(own_input[j], chart, interval)
            fixed_done += n
            moving_done += m
