"""Lists of the components near each target, which hold while the targets hardly move.

What they leave out and how long they hold is derived in ARCHITECTURE.md.
"""

import math

import numpy as np

from d2d._kernel import layout, rows
from d2d._kernel.compile import compiled, inlined, vectorised
from d2d._kernel.elementary import log, lowest_bit
from d2d._kernel.layout import WEIGHT, XX, XY, YY, X, Y
from d2d._kernel.rows import LANES, lane_count

CHUNK = 48  # components are marked in chunks, one bit each: a double holds 53 bits exactly
EXPECTED = 5.0  # half the squared distance of the nearest component is nearly always below
NEARLY = 4.0  # a limit that is hardly above what is expected is taken instead
FAR = 100.0  # beyond it sums are relative to the nearest component
TURNED = 0.25  # more than a rotation within the margin changes the logarithm of a determinant


@inlined
def forget_neighbours(near):
    """Mark all lists as not found yet."""
    for block in range(near.shape[0]):
        near[block, rows.LENGTH], near[block, rows.MEASURED] = rows.NOT_FOUND, 0.0


@vectorised
def component_of(fixed, i, setting):
    """Mean, less the translation, and covariance of a component."""
    x, y = fixed[X, i] - setting.x, fixed[Y, i] - setting.y
    return x, y, fixed[XX, i], fixed[XY, i], fixed[YY, i]


@vectorised
def difference(w, k, component):
    """d and S of a target and a component; d' adj(S) d and det(S), whose ratio is d' S^-1 d."""
    fx, fy, fxx, fxy, fyy = component
    dx, dy = w[rows.MX + k] - fx, w[rows.MY + k] - fy
    sxx, sxy, syy = w[rows.CXX + k] + fxx, w[rows.CXY + k] + fxy, w[rows.CYY + k] + fyy
    square = syy * dx * dx - 2.0 * sxy * dx * dy + sxx * dy * dy
    return dx, dy, sxx, sxy, syy, square, sxx * syy - sxy * sxy


@vectorised
def largest_shift(w, lists, setting):
    """Largest shift of a block's targets, relative to the one for which their lists hold."""
    dc, ds = setting.cosine - lists[rows.AT_COSINE], setting.sine - lists[rows.AT_SINE]
    chord, farthest, invalid = math.sqrt(dc * dc + ds * ds), 0.0, False
    for k in range(lane_count(w)):
        dx = w[rows.MX + k] + setting.x - lists[rows.AT_X + k]
        dy = w[rows.MY + k] + setting.y - lists[rows.AT_Y + k]
        distance = math.sqrt(dx * dx + dy * dy) + lists[rows.REACH + k] * chord
        slack = lists[rows.SLACK + k]
        farthest = max(farthest, distance / max(slack, 1e-300))
        invalid |= (slack <= 0.0) | (w[rows.OUTLIER + k] < lists[rows.FLOOR + k])
    return max(farthest, 2.0) if invalid else farthest


@vectorised
def bound_pairs(w, extremes):
    """Set what the search needs to know of the pairs of each target."""
    for k in range(lane_count(w)):
        xx, xy, yy = w[rows.CXX + k], w[rows.CXY + k], w[rows.CYY + k]
        half = 0.5 * (xx - yy)
        largest = 0.5 * (xx + yy) + math.sqrt(half * half + xy * xy)
        determinant = max(xx * yy - xy * xy, 0.0)
        w[rows.LARGEST + k] = largest
        w[rows.SMALLEST + k] = determinant / max(largest, 1e-300) + extremes[layout.LEAST_VARIANCE]
        w[rows.PEAK + k] = extremes[layout.TOTAL_WEIGHT] / (
            math.sqrt(determinant) + extremes[layout.LEAST_ROOT]
        )


@vectorised
def measure(w, fixed, setting, margin):
    """Set the cut-off of each target, and its OFFSET, by its nearest component.

    Distances d' adj(S) d / det(S) are compared by cross-multiplication, without a division.
    """
    lanes = lane_count(w)
    for k in range(lanes):
        w[rows.SQUARE + k], w[rows.DETERMINANT + k], w[rows.NEAREST + k] = 1.0, 0.0, 1.0
    for i in range(fixed.shape[1]):
        component, own = component_of(fixed, i, setting), fixed[WEIGHT, i]
        for k in range(lanes):
            _, _, _, _, _, square, determinant = difference(w, k, component)
            nearer = square * w[rows.DETERMINANT + k] < w[rows.SQUARE + k] * determinant
            w[rows.SQUARE + k] = square if nearer else w[rows.SQUARE + k]
            w[rows.DETERMINANT + k] = determinant if nearer else w[rows.DETERMINANT + k]
            w[rows.NEAREST + k] = own if nearer else w[rows.NEAREST + k]
    for k in range(lanes):
        half = 0.5 * w[rows.SQUARE + k] / w[rows.DETERMINANT + k]
        farther = math.sqrt(2.0 * half) + margin
        ratio = w[rows.PEAK + k] * math.sqrt(w[rows.DETERMINANT + k]) / w[rows.NEAREST + k]
        w[rows.CUT_OFF + k] = setting.gate + 0.5 * farther * farther + TURNED + log(ratio)
        w[rows.OFFSET + k] = layout.ABOVE * half if half > FAR else 0.0


@vectorised
def limit(w, setting, spread, margin, measured, lists):
    """Set the cut-off of each list, and note for what it holds.

    Without a nearest component, that is half a squared distance above which all pairs that are left
    out vanish beside a sum as large as is expected; LEAST_SUM is that sum.
    """
    expected, least = setting.gate + EXPECTED + math.log(spread), math.exp(-EXPECTED) / spread
    for k in range(lane_count(w)):
        most = w[rows.LIMIT + k]
        certain = measured | (most < expected + NEARLY)
        c = min(most, w[rows.CUT_OFF + k]) if certain else expected
        lists[rows.LEAST_SUM + k] = 0.0 if certain else least * w[rows.PEAK + k]
        root = math.sqrt(2.0 * max(c, 0.0))
        reach = root + margin
        w[rows.CUT_OFF + k] = reach * reach if c >= 0.0 else -1.0
        slack = margin * math.sqrt(w[rows.SMALLEST + k])
        # an offset holds here only
        lists[rows.SLACK + k] = slack if w[rows.OFFSET + k] == 0.0 else 0.0
        lists[rows.REACH + k] = root * math.sqrt(w[rows.LARGEST + k])
        lists[rows.FLOOR + k] = w[rows.OUTLIER_FLOOR + k]
        lists[rows.AT_X + k] = w[rows.MX + k] + setting.x
        lists[rows.AT_Y + k] = w[rows.MY + k] + setting.y
    lists[rows.AT_COSINE], lists[rows.AT_SINE] = setting.cosine, setting.sine


@inlined
def interval_of(w, cosine, sine):
    """A block's targets along an axis: from where to where, and the largest variance."""
    low, high, variance = np.inf, -np.inf, 0.0
    for k in range(LANES):
        position = cosine * w[rows.MX + k] + sine * w[rows.MY + k]
        low, high = min(low, position), max(high, position)
        own = cosine * cosine * w[rows.CXX + k] + sine * sine * w[rows.CYY + k]
        variance = max(variance, own + 2.0 * cosine * sine * w[rows.CXY + k])
    return low, high, variance


@vectorised
def overlap(interval, cut_off, position, variance):
    """Whether the ellipse of a component can reach a block along an axis."""
    low, high, largest = interval
    gap = max(max(low - position, position - high), 0.0)
    return gap * gap <= cut_off * (largest + variance)


@vectorised
def choose(w, fixed, setting, hits, candidates):
    """Components that may be within the cut-off of a target of the block; returns their number.

    Both are projected on the principal axes of the block's mean covariance.
    """
    xx = xy = yy = cut_off = 0.0
    for k in range(LANES):
        xx, xy, yy = xx + w[rows.CXX + k], xy + w[rows.CXY + k], yy + w[rows.CYY + k]
        cut_off = max(cut_off, w[rows.CUT_OFF + k])
    cut_off *= 1.0 + 1e-9  # rounding must not lose a component on the boundary
    half = 0.5 * (xx - yy)
    ratio = half / max(math.sqrt(half * half + xy * xy), 1e-300)  # the cosine of twice the angle
    c, s = math.sqrt(0.5 * (1.0 + ratio)), math.copysign(math.sqrt(0.5 * (1.0 - ratio)), xy)
    along, across = interval_of(w, c, s), interval_of(w, -s, c)
    cc, cs, ss = c * c, 2.0 * c * s, s * s
    for i in range(fixed.shape[1]):
        x, y, xx, xy, yy = component_of(fixed, i, setting)
        within = overlap(along, cut_off, c * x + s * y, cc * xx + cs * xy + ss * yy)
        within &= overlap(across, cut_off, c * y - s * x, ss * xx - cs * xy + cc * yy)
        hits[i] = 1 if within else 0
    number = 0
    for i in range(fixed.shape[1]):
        candidates[number] = i
        number += hits[i]
    return number


@vectorised
def mark_within(w, fixed, setting, candidates):
    """Mark by bits which of the candidates are within each target's list."""
    lanes = lane_count(w)
    for k in range(lanes):
        w[rows.WITHIN + k] = 0.0
    bit = 1.0
    for n in range(candidates.shape[0]):
        component = component_of(fixed, candidates[n], setting)
        for k in range(lanes):
            _, _, _, _, _, square, determinant = difference(w, k, component)
            w[rows.WITHIN + k] += bit if square <= w[rows.CUT_OFF + k] * determinant else 0.0
        bit *= 2.0


@inlined
def copy_within(w, fixed, candidates, lists, room):
    """Copy each target's marked components to its list; returns whether there was room."""
    for k in range(LANES):
        bits, number = int(w[rows.WITHIN + k]), int(w[rows.NUMBER + k])
        while bits != 0:
            if number == room:
                return False
            i = candidates[lowest_bit(bits)]
            at = rows.PLACE + number * rows.STEP + k
            for row in range(6):
                lists[at + row * LANES] = fixed[row, i]
            lists[at + rows.INDEX * LANES] = i
            bits &= bits - 1  # without the lowest one
            number += 1
        w[rows.NUMBER + k] = number
    return True


@inlined
def fill_up(w, fixed, lists):
    """Fill the shorter lists of a block up with a component of no weight; their common length."""
    length = 0
    for k in range(LANES):
        length = max(length, int(w[rows.NUMBER + k]))
    for k in range(LANES):
        for number in range(int(w[rows.NUMBER + k]), length):
            at = rows.PLACE + number * rows.STEP + k
            for row in (XX, XY, YY):
                lists[at + row * LANES] = fixed[row, 0]
            lists[at + X * LANES] = lists[rows.AT_X + k]
            lists[at + Y * LANES] = lists[rows.AT_Y + k]
            lists[at + WEIGHT * LANES] = 0.0
            lists[at + rows.INDEX * LANES] = -1.0
    return length


@compiled
def find_neighbours(w, fixed, extremes, setting, margin, measured, numbers, lists):
    """Find the lists of a block's targets, and note for what they hold.

    The cut-offs are what is to be expected, or ``measured``.  LIMIT is the half squared distance up
    to which pairs could matter to each target beside its outlier component, as long as that is not
    below OUTLIER_FLOOR.  ``numbers`` (2, N) is memory.
    """
    hits, candidates = numbers[0], numbers[1]
    lists[rows.MEASURED], lists[rows.MARGIN] = 1.0 if measured else 0.0, margin
    farthest = 0.0
    for k in range(LANES):
        w[rows.CUT_OFF + k] = np.inf
        farthest = max(farthest, w[rows.LIMIT + k])
    if measured and farthest > FAR:
        measure(w, fixed, setting, margin)
    spread = fixed.shape[1] * extremes[layout.MEAN_ROOT] / extremes[layout.LEAST_ROOT]
    limit(w, setting, spread, margin, measured, lists)
    for k in range(LANES):
        w[rows.NUMBER + k] = 0.0
    number = fixed.shape[1]
    if number > CHUNK:
        number = choose(w, fixed, setting, hits, candidates)
    else:
        for i in range(number):
            candidates[i] = i
    room = (lists.shape[0] - rows.PLACE) // rows.STEP
    for first in range(0, number, CHUNK):
        part = candidates[first : min(first + CHUNK, number)]
        mark_within(w, fixed, setting, part)
        if not copy_within(w, fixed, part, lists, room):
            lists[rows.LENGTH] = rows.DENSE
            return
    lists[rows.LENGTH] = fill_up(w, fixed, lists)
