"""The cost of a motion, or of a velocity that several pairs of scans share, with derivatives.

Eight targets are evaluated at a time, one in each vector lane.  Everything stays in the log domain:
a target far from everything gives a large finite cost.
"""

import math

import numpy as np

from d2d._kernel import layout, rows
from d2d._kernel.charts import exponential_chart, identity_chart, logarithm_chart
from d2d._kernel.compile import compiled, inlined, vectorised
from d2d._kernel.densities import measurement_jets, outlier_jet
from d2d._kernel.elementary import log
from d2d._kernel.jets import (
    add_shares,
    fuse_likelihood,
    fuse_summing,
    mix,
    multiply,
    through_chart,
)
from d2d._kernel.layout import Pair, Setting
from d2d._kernel.neighbours import bound_pairs, find_neighbours, largest_shift
from d2d._kernel.pairs import finish_inliers, load_block, sum_inliers
from d2d._kernel.rows import LANES, lane_count
from d2d._kernel.tiles import COLUMNS, FIRST_TILE, ROWS

# How far the targets may move before their neighbours are looked for again: at most, as a multiple
# of the margin that was asked for.
MOST = 2.0


@inlined
def setting_of(pair, theta, gate):
    """A motion with the numbers of a pair, and how exact a target's density has to be."""
    return Setting(
        theta[0] - pair.fixed_centre[0],
        theta[1] - pair.fixed_centre[1],
        math.cos(theta[2]),
        math.sin(theta[2]),
        pair.moving_centre[0],
        pair.moving_centre[1],
        logarithm_chart(theta) if pair.in_twist else identity_chart(theta),
        pair.d2d,
        pair.planar,
        gate,
    )


@vectorised
def limit_pairs(w, outlier, factors, order, gate, first):
    """Set each target's LIMIT: the half squared distance beyond which no pair matters.

    Beyond it all its pairs together, with any measurement, vanish beside the outlier component,
    which may sink a little until the pairs are looked for again.
    """
    lanes, last = lane_count(w), order.shape[0] - 1
    for k in range(LANES):
        w[rows.LIMIT + k], w[rows.OUTLIER_FLOOR + k] = np.inf, -np.inf
    if outlier[layout.KIND] != layout.NO_OUTLIER:
        largest = gate + outlier[layout.LOG_INLIER_WEIGHT] - layout.LOG_2PI + 1.0
        for k in range(lanes):
            w[rows.OUTLIER_FLOOR + k] = w[rows.OUTLIER + k] - 1.0
            w[rows.LIMIT + k] = largest + log(w[rows.PEAK + k]) - w[rows.OUTLIER + k]
        if factors.shape[0] > 0:
            for k in range(LANES):
                variance = factors[order[min(first + k, last)], layout.VARIANCE]
                w[rows.LIMIT + k] -= 0.5 * (math.log(variance) + layout.LOG_2PI)
    for k in range(lanes):
        w[rows.LIMIT + k] = w[rows.LIMIT + k] if w[rows.COUNTS + k] > 0.0 else -np.inf


@inlined
def evaluate_block(memory, pair, setting, first, margin, lists):
    """log q_k, its gradient and q_k's second derivatives over q_k, of a block of targets.

    They are left in the rows of INLIER.  The block's neighbours at its ``lists`` are found again if
    they are not known, or if it has moved; they then hold within a ``margin``.
    """
    w, fixed, order = memory.scratch, pair.fixed, pair.order
    factors, outlier = pair.factors, pair.outlier
    load_block(w, pair.moving, order, setting, first)
    if factors.shape[0] > 0:
        measurement_jets(w, factors, order, setting.chart, first)
    outlier_jet(w, fixed, setting, outlier, pair.tiles, pair.grid)
    known, measured = False, False
    if lists[rows.LENGTH] != rows.NOT_FOUND:
        distance = largest_shift(w, lists, setting)
        known, measured = distance <= 1.0, lists[rows.MEASURED] > 0.0
        # the next step of a descent is likely to be shorter by half
        margin = min(max(0.5 * distance * lists[rows.MARGIN], margin), MOST * margin)
    for _ in range(3):  # with lists as they are, by what is expected, by what is measured
        if not known:
            bound_pairs(w, pair.extremes)
            limit_pairs(w, outlier, factors, order, setting.gate, first)
            find_neighbours(
                w, fixed, pair.extremes, setting, margin, measured, memory.candidates, lists
            )
        if sum_inliers(w, fixed, setting, lists):
            break
        known, measured = False, True
    finish_inliers(w)
    if factors.shape[0] > 0:
        multiply(w)
    if outlier[layout.KIND] != layout.NO_OUTLIER:
        mix(w, outlier[layout.LOG_INLIER_WEIGHT])
    else:
        for k in range(LANES):
            w[rows.SHARE + k] = 1.0


@inlined
def total(w, row):
    """Sum of a row of totals over the lanes."""
    added = 0.0
    for k in range(LANES):
        added += w[rows.TOTAL + row + k]
    return added


@inlined
def align_tops(w):
    """Make the totals of all lanes relative to the largest density; return its logarithm."""
    top = -np.inf
    for k in range(LANES):
        top = max(top, w[rows.TOP + k])
    for k in range(LANES):
        keep = math.exp(w[rows.TOP + k] - top)
        for row in range(0, 10 * LANES, LANES):
            w[rows.TOTAL + row + k] *= keep
    return top


@inlined
def evaluate_pair(pair, theta, fusion, accuracy, work, block):
    """Cost of one pair of sets at the motion theta; its derivatives to ``work``.

    The lists of its first block of targets have the number ``block``.
    """
    setting = setting_of(pair, theta, accuracy.gate)
    memory, g, h = work.memory, work.gradient, work.hessian
    w = memory.scratch
    for k in range(10 * LANES):
        w[rows.TOTAL + k] = 0.0
    for k in range(LANES):
        w[rows.TOP + k] = -np.inf
    last = memory.lists.shape[0] - 1
    for first in range(0, pair.moving.shape[1], accuracy.every * LANES):
        lists = memory.lists[min(block, last)]
        if block > last:  # they are those of another block
            lists[rows.LENGTH] = rows.NOT_FOUND
        block += accuracy.every
        evaluate_block(memory, pair, setting, first, accuracy.margin, lists)
        add_shares(w)
        if memory.stop[0] != 0.0:
            return np.nan
        if fusion == layout.LIKELIHOOD:
            fuse_likelihood(w)
        else:
            fuse_summing(w)
    top = align_tops(w) if fusion == layout.SUMMING else 0.0
    value = -total(w, 0)
    g0, g1, g2 = total(w, rows.G0), total(w, rows.G1), total(w, rows.G2)
    a00, a01, a11 = total(w, rows.A00), total(w, rows.A01), total(w, rows.A11)
    a02, a12, a22 = total(w, rows.A02), total(w, rows.A12), total(w, rows.A22)
    if fusion == layout.SUMMING:
        r = -1.0 / value
        value = -(top + math.log(-value))
        g0, g1, g2 = g0 * r, g1 * r, g2 * r
        a00, a01, a11 = a00 * r - g0 * g0, a01 * r - g0 * g1, a11 * r - g1 * g1
        a02, a12, a22 = a02 * r - g0 * g2, a12 * r - g1 * g2, a22 * r - g2 * g2
    if not pair.planar:
        # on a line there is no t_y and phi: no slope keeps the Newton step along them at zero
        g1 = g2 = a01 = a02 = a12 = 0.0
        a11 = a22 = a00
    g[0], g[1], g[2] = -g0, -g1, -g2
    h[0, 0], h[1, 1], h[2, 2] = -a00, -a11, -a22
    h[0, 1] = h[1, 0] = -a01
    h[0, 2] = h[2, 0] = -a02
    h[1, 2] = h[2, 1] = -a12
    return value


@compiled
def pair_at(batch, number, kept):
    """One pair of the batch, bound; ``kept`` is 0 if its motion is about the centres, else 1."""
    row = batch.pairs[number]
    fixed_centre = batch.fixed_centres[row[layout.FIXED_SET]]
    moving_centre = batch.moving_centres[row[layout.MOVING_SET]]
    start, stop = row[layout.MOVING_START], row[layout.MOVING_START] + row[layout.MOVING_SIZE]
    begin, size = 6 * row[layout.FIXED_START], row[layout.FIXED_SIZE]
    fixed = batch.fixed[begin : begin + 6 * size].reshape(6, size)
    moving = batch.moving[6 * start : 6 * stop].reshape(6, stop - start)
    at = row[layout.FACTOR_START]
    factors = batch.factors[at : at + row[layout.MOVING_SIZE]] if at >= 0 else batch.factors[:0]
    grid = batch.grids[row[layout.FIXED_SET]]
    tile, tiles = int(grid[FIRST_TILE]), int(grid[COLUMNS] * grid[ROWS])
    return Pair(
        fixed,
        moving,
        batch.orders[start:stop],
        factors,
        batch.outlier,
        batch.d2d,
        batch.planar,
        batch.tiles[tile : tile + tiles],
        grid,
        batch.in_twist,
        batch.extremes[row[layout.FIXED_SET]],
        (kept * fixed_centre[0], kept * fixed_centre[1]),
        (kept * moving_centre[0], kept * moving_centre[1]),
    )


@inlined
def motion_chart(batch, number, theta):
    """The motion of a pair at theta; if theta is a velocity, the exponential of its twist."""
    interval = batch.intervals[number]
    x, y, w = interval * theta[0], interval * theta[1], interval * theta[2]
    if batch.kind == layout.ARC:
        return exponential_chart(x, y, w)
    return identity_chart((x, y, w))


@inlined
def add_derivatives(work, chart, interval, g, h):
    """Add a pair's derivatives in theta, from those in its motion, which are in ``work``."""
    pg, ph = work.gradient, work.hessian
    terms = (0.0, pg[0], pg[1], pg[2], ph[0, 0], ph[0, 1], ph[1, 1], ph[0, 2], ph[1, 2], ph[2, 2])
    _, g0, g1, g2, h00, h01, h11, h02, h12, h22 = through_chart(terms, chart)
    square = interval * interval
    g[0] += interval * g0
    g[1] += interval * g1
    g[2] += interval * g2
    h[0, 0] += square * h00
    h[1, 1] += square * h11
    h[2, 2] += square * h22
    h[0, 1] += square * h01
    h[0, 2] += square * h02
    h[1, 2] += square * h12
    h[1, 0], h[2, 0], h[2, 1] = h[0, 1], h[0, 2], h[1, 2]


@inlined
def evaluate(batch, problem, pair, theta, accuracy, work, g, h):
    """Cost of a problem at theta, and the sums of its targets' inlier shares and distances.

    The cost is the sum over the problem's pairs, of which ``pair`` is the first, and the prior's;
    its gradient goes to g (3), its Hessian to h (3, 3).
    """
    w = work.memory.scratch
    for k in range(LANES):
        w[rows.SHARES + k] = w[rows.DISTANCES + k] = 0.0
    for j in range(3):
        g[j] = h[0, j] = h[1, j] = h[2, j] = 0.0
    # with a literal zero `evaluate_pair` would be compiled twice, for this and for a variable
    value, shares, distances, block = 0.0, 0.0, 0.0, np.int64(0)
    first = batch.first[problem]
    for number in range(first, batch.first[problem + 1]):
        if number > first:
            pair = pair_at(batch, number, 1.0)
        chart = motion_chart(batch, number, theta)
        motion = chart.x, chart.y, chart.phi
        value += evaluate_pair(pair, motion, batch.fusion, accuracy, work, block)
        block += (pair.moving.shape[1] + LANES - 1) // LANES
        add_derivatives(work, chart, batch.intervals[number], g, h)
    for j in range(3):
        weighted = batch.prior[j] * theta[j]
        value += 0.5 * weighted * theta[j]
        g[j] += weighted
        h[j, j] += batch.prior[j]
    for k in range(LANES):
        shares += w[rows.SHARES + k]
        distances += w[rows.DISTANCES + k]
    return value, shares, distances
