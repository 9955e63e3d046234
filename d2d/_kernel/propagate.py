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
    A00,
    A01,
    A11,
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
    GATE,
    INDEX,
    INLIER,
    INPUT_VARIANCE,
    IS_TILED,
    KIND,
    LANES,
    LENGTH,
    MAX_EXPONENT,
    MEAN,
    MOVED,
    MX,
    MY,
    NO_OUTLIER,
    NOT_FOUND,
    OFFSET,
    ONE_STEP,
    OUTLIER,
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
    TERMS,
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
from d2d._kernel.neighbours import difference
from d2d._kernel.pairs import component_at, repeat
from d2d._kernel.tiles import fill, interpolate, root_of

ROWS = 6 * LANES  # of one component's cross derivatives, lane by lane
FIELDS = 6  # see `add_fields`
FEWEST_A_TILE = 50.0  # components, for which the fields take less time than the plain sum


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
def inlier_terms(w, step, setting):
    """The terms of one pair of each target, see `pairs.add_step`; adds them to the targets' own."""
    for k in range(lane_count(w)):
        dx, dy, sxx, sxy, syy, square, determinant = difference(
            w, k, component_at(step, k, setting)
        )
        x, y, inverse = w[MX + k], w[MY + k], 1.0 / determinant
        bxx, bxy, byy = syy * inverse, -sxy * inverse, sxx * inverse
        ux, uy = bxx * dx + bxy * dy, bxy * dx + byy * dy
        gamma = w[SCALE + k] * step[WEIGHT * LANES + k] * math.sqrt(inverse)
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
        for row in range(6):
            w[TERMS + row * LANES + k] = terms[row]
            w[MOVED + row * LANES + k] += terms[row]
        w[MOVED + 4 * LANES + k] += gamma * uy  # d_phi = E p depends on the target's position
        w[MOVED + 5 * LANES + k] -= gamma * ux
        w[GAMMA + k] += gamma
        for row in range(3):
            w[CENTRED + row * LANES + k] += gamma * centred[row]


@compiled
def add_inliers(w, fixed, setting, place, cross):
    """Add the pairs of a block's neighbours, which the first pass has left at its ``place``."""
    dense = place[LENGTH] == DENSE
    step = w[ONE_STEP : ONE_STEP + 6 * LANES]
    for n in range(fixed.shape[1] if dense else int(place[LENGTH])):
        at = PLACE + n * STEP
        if dense:
            repeat(step, fixed, n)
            inlier_terms(w, step, setting)
        else:
            inlier_terms(w, place[at : at + STEP], setting)
        for k in range(LANES):
            i = n if dense else int(place[at + INDEX * LANES + k])
            for row in range(6 if i >= 0 else 0):
                cross[i * ROWS + row * LANES + k] -= w[TERMS + row * LANES + k]


@vectorised
def move_outliers(w):
    """Add what the pairs of the corrupted Gaussian mean for their targets.

    It follows from their derivatives in the motion: those in the position are the same.
    """
    for k in range(lane_count(w)):
        x, y, s = w[MX + k], w[MY + k], w[OUTLIER_SCALE + k] / w[OUTLIER_TO_SHARE + k]
        m0, m1, m2 = w[MEAN + k], w[MEAN + LANES + k], w[MEAN + 2 * LANES + k]
        g0, g1 = w[OUTLIER + G0 + k], w[OUTLIER + G1 + k]
        a00, a01, a11 = w[OUTLIER + A00 + k], w[OUTLIER + A01 + k], w[OUTLIER + A11 + k]
        w[MOVED + k] += s * (m0 * g0 - a00)
        w[MOVED + LANES + k] += s * (m0 * g1 - a01)
        w[MOVED + 2 * LANES + k] += s * (m1 * g0 - a01)
        w[MOVED + 3 * LANES + k] += s * (m1 * g1 - a11)
        w[MOVED + 4 * LANES + k] += s * (m2 * g0 + y * a00 - x * a01 - g1)
        w[MOVED + 5 * LANES + k] += s * (m2 * g1 + y * a01 - x * a11 + g0)


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
            for row in range(6):
                own[row * LANES + k] -= terms[row]


@inlined
def collect_outliers(w, root, setting, first, places, weights):
    """Note a block's targets as components of the fields of `add_fields`."""
    xx, xy, yy = root
    for k in range(min(LANES, places.shape[1] - first)):
        x, y = w[MX + k] + setting.x, w[MY + k] + setting.y
        places[0, first + k], places[1, first + k] = xx * x + xy * y, yy * y
        scale = w[OUTLIER_SCALE + k] if w[IS_TILED] > 0.0 else 0.0
        weights[0, first + k] = scale
        for row in range(3):
            weights[1 + row, first + k] = scale * w[MEAN + row * LANES + k]
        weights[4, first + k], weights[5, first + k] = scale * w[MX + k], scale * w[MY + k]


@compiled
def add_fields(w, pair, setting, fields, by_fixed):
    """Add what the pairs of the corrupted Gaussian mean for the components of a large set.

    Summed over the targets, the terms of a component are derivatives of fields at its place, in
    which the targets are the components: F with their scales s_k as weights, M_j with s_k times
    the mean gradient, and P_x, P_y with s_k times the position.  With H the second derivatives::

        sum_k terms = -H F - grad M_j (j = 0, 1),  row x of H P_y - row y of H P_x - grad M_2
    """
    places, weights, factors, tiles = fields
    fixed, root = pair.fixed, root_of(pair.outlier)
    count = pair.tiles.shape[0]
    fill(places, weights, pair.grid, factors, w, tiles[: FIELDS * count])
    for first in range(0, fixed.shape[1], LANES):
        last = fixed.shape[1] - 1
        for k in range(LANES):
            i = min(first + k, last)
            w[MX + k], w[MY + k] = fixed[X, i] - setting.x, fixed[Y, i] - setting.y
        for field in range(FIELDS):
            own = tiles[field * count : (field + 1) * count]
            interpolate(w, own, pair.grid, root, setting)
            for k in range(min(LANES, fixed.shape[1] - first)):
                weight, total = fixed[WEIGHT, first + k], by_fixed[first + k]
                gx, gy = weight * w[OUTLIER + G0 + k], weight * w[OUTLIER + G1 + k]
                hxx, hxy = weight * w[OUTLIER + A00 + k], weight * w[OUTLIER + A01 + k]
                hyy = weight * w[OUTLIER + A11 + k]
                if field == 0:
                    total[0, 0] += hxx
                    total[0, 1] += hxy
                    total[1, 0] += hxy
                    total[1, 1] += hyy
                elif field < 4:
                    total[field - 1, 0] += gx
                    total[field - 1, 1] += gy
                elif field == 4:
                    total[2, 0] += hxy
                    total[2, 1] += hyy
                else:
                    total[2, 0] -= hxx
                    total[2, 1] -= hxy


@inlined
def depends_on_components(outlier):
    """Whether the outlier component depends on single components; an unknown kind raises."""
    kind = outlier[KIND]
    if kind != NO_OUTLIER and kind != UNIFORM and kind != CORRUPTED:
        raise ValueError("the kernel does not know this kind of outlier component")
    return kind == CORRUPTED


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
def cross_pair(pair, setting, fusion, memory, cross, fields, own):
    """Cross derivatives of one pair of sets, of the gradient in the motion.

    With the sum, all targets share one density and one mean gradient, which a first round finds.
    """
    by_fixed, by_moving, by_value, by_input = own
    w, place = memory.scratch, memory.places[0]
    fixed, moving, order = pair.fixed, pair.moving, pair.order
    factors, outlier = pair.factors, pair.outlier
    measured, top = factors.shape[0] > 0, 0.0
    corrupted = depends_on_components(outlier)
    fields_pay = fixed.shape[1] > FEWEST_A_TILE * pair.tiles.shape[0] > 0
    # of a larger pair of the same problem there may be more in memory
    places, weights = fields[0][:, : moving.shape[1]], fields[1][:, : moving.shape[1]]
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
        if corrupted:
            move_outliers(w)
            if not fields_pay or w[IS_TILED] == 0.0:
                add_corrupted(w, fixed, setting, outlier, cross)
            if fields_pay:
                collect_outliers(w, root_of(outlier), setting, first, places, weights)
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
    if corrupted and fields_pay:
        add_fields(w, pair, setting, (places, weights, fields[2], fields[3]), by_fixed)


@compiled
def scale_rows(rows, chart, interval):
    """Derivatives of the gradient in a motion become those of the gradient in its velocity."""
    g0, g1, g2 = gradient_through_chart(rows[0], rows[1], rows[2], chart)
    rows[0], rows[1], rows[2] = interval * g0, interval * g1, interval * g2


@entry
def cross_batch(batch, thetas, begin, memory, cross, fields, derivatives):
    """Derivatives of the gradients of some problems, from ``begin`` on, in all that is measured.

    In the fixed and moving means (C, targets, 3, 2), in the measurements' values (C, targets, 3)
    and, through their predictions only, in their inputs (C, targets, 3); the targets of a problem's
    pairs one pair after the other.
    ``cross`` is memory, ROWS for each target of a fixed set, ``fields`` that of `add_fields`.
    """
    by_fixed, by_moving, by_value, by_input = derivatives
    for c in range(by_fixed.shape[0]):
        b, fixed_done, moving_done = begin + c, 0, 0
        for number in range(batch.first[b], batch.first[b + 1]):
            pair = pair_at(batch, number)
            chart = motion_chart(batch, number, thetas[b])
            setting = setting_of(pair, (chart.x, chart.y, chart.phi), GATE)
            n, m = pair.fixed.shape[1], pair.moving.shape[1]
            own_fixed = by_fixed[c, fixed_done : fixed_done + n]
            own_moving = by_moving[c, moving_done : moving_done + m]
            own_value = by_value[c, moving_done : moving_done + m]
            own_input = by_input[c, moving_done : moving_done + m]
            own = own_fixed, own_moving, own_value, own_input
            cross_pair(pair, setting, batch.fusion, memory, cross, fields, own)
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
