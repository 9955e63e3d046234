"""The double sum over targets and components: the inlier density and its derivatives.

Per pair of a moving target ``k`` and a component ``i``, with the rotated mean ``p = R mu_k`` and
the rotated covariance ``C = R Sigma_k R'``::

    d = p + t - mu_i      S = C + Sigma_i      B = S^-1      u = B d      N = N(0 | d, S)

Each target is paired only with the components near it, see ``neighbours.py``.
"""

import math

from d2d._kernel import layout, rows
from d2d._kernel.compile import compiled, inlined, vectorised
from d2d._kernel.elementary import exp, log
from d2d._kernel.layout import WEIGHT, XX, XY, YY, X, Y
from d2d._kernel.neighbours import difference
from d2d._kernel.rows import LANES, lane_count

TINY = 1e-300  # where each sum begins, so that the logarithm of an empty one is finite


@vectorised
def load_block(w, moving, order, setting, first):
    """Rotate the block's means and covariances; an incomplete block repeats its last target."""
    cosine, sine, d2d = setting.cosine, setting.sine, setting.d2d
    lanes = lane_count(w)
    cc, cs, ss = cosine * cosine, cosine * sine, sine * sine
    last = order.shape[0] - 1
    for k in range(lanes):
        j = order[min(first + k, last)]
        x, y = moving[X, j] + setting.lever_x, moving[Y, j] + setting.lever_y
        w[rows.MX + k] = cosine * x - sine * y
        w[rows.MY + k] = sine * x + cosine * y
        w[rows.OFFSET + k] = 0.0
        w[rows.COUNTS + k] = 1.0 if first + k <= last else 0.0
        sxx, sxy = moving[XX, j] * d2d, moving[XY, j] * d2d
        syy = moving[YY, j] * (d2d * setting.planar)
        w[rows.CXX + k] = cc * sxx - 2.0 * cs * sxy + ss * syy
        w[rows.CXY + k] = cs * (sxx - syy) + (cc - ss) * sxy
        w[rows.CYY + k] = ss * sxx + 2.0 * cs * sxy + cc * syy


@vectorised
def component_at(step, k, setting):
    """Mean, less the translation, and covariance of a target's component in a step."""
    x, y = step[X * LANES + k] - setting.x, step[Y * LANES + k] - setting.y
    return x, y, step[XX * LANES + k], step[XY * LANES + k], step[YY * LANES + k]


@vectorised
def add_step(w, step, setting):
    """Add one pair of each target: w_i N(0 | d_i, S_i) exp(OFFSET) and its derivatives.

    By the heat equation, dN/dS = N_dd / 2 (Price 1958), all derivatives follow from those along d,
    which are polynomials in u = B d times N.  The rotation turns S by C_phi = 2 M with
    M = [[-a, h], [h, a]], and so N by the operator K = sum_ij M_ij D_i D_j, with the derivative D
    along d.  Summed are 1, D, D D', K D and K^2; with k = u'Mu - tr(MB)::

        K N = k N       K D N = (2 BMu - k u) N
        K^2 N = (k^2 - 4 u'MBMu + 2 tr(MBMB)) N,  tr(MBMB) = tr(MB)^2 - 2 det(M) det(B)
    """
    at = rows.INLIER
    lanes = lane_count(w)
    for k in range(lanes):
        component = component_at(step, k, setting)
        dx, dy, sxx, sxy, syy, square, determinant = difference(w, k, component)
        a, h = w[rows.CXY + k], 0.5 * (w[rows.CXX + k] - w[rows.CYY + k])
        inverse = 1.0 / determinant
        half = 0.5 * square * inverse
        bxx, bxy, byy = syy * inverse, -sxy * inverse, sxx * inverse
        ux, uy = bxx * dx + bxy * dy, bxy * dx + byy * dy
        weight = step[WEIGHT * LANES + k] * math.sqrt(inverse)
        weight *= exp(min(w[rows.OFFSET + k] - half, layout.MAX_EXPONENT))
        mx, my = h * uy - a * ux, h * ux + a * uy  # M u
        trace = a * (byy - bxx) + 2.0 * h * bxy  # tr(M B)
        turned = ux * mx + uy * my - trace  # K
        bmx, bmy = bxx * mx + bxy * my, bxy * mx + byy * my  # B M u
        w[rows.INLIER + k] += weight
        w[rows.DISTANCE + k] += weight * half
        w[at + rows.G0 + k] -= weight * ux
        w[at + rows.G1 + k] -= weight * uy
        w[at + rows.A00 + k] += weight * (ux * ux - bxx)
        w[at + rows.A01 + k] += weight * (ux * uy - bxy)
        w[at + rows.A11 + k] += weight * (uy * uy - byy)
        w[at + rows.A02 + k] += weight * (2.0 * bmx - ux * turned)
        w[at + rows.A12 + k] += weight * (2.0 * bmy - uy * turned)
        w[at + rows.A22 + k] += weight * (
            turned * turned
            - 4.0 * (mx * bmx + my * bmy)
            + 2.0 * (trace * trace + 2.0 * (a * a + h * h) * inverse)
        )


@inlined
def repeat(step, fixed, i):
    """Repeat a component for all targets of a step."""
    for row in range(6):
        for k in range(LANES):
            step[row * LANES + k] = fixed[row, i]


@vectorised
def add_all(w, fixed, setting, lists):
    """Sum over all components, see `add_step`; in the place of lists, which have none then."""
    step = lists[rows.PLACE : rows.PLACE + 6 * LANES]
    for i in range(fixed.shape[1]):
        repeat(step, fixed, i)
        add_step(w, step, setting)


@inlined
def sum_inliers(w, fixed, setting, lists):
    """Sum over the neighbours at a block's ``lists``; whether these were enough."""
    for k in range(10 * LANES):
        w[rows.INLIER + k] = 0.0
    for k in range(LANES):
        w[rows.INLIER + k], w[rows.DISTANCE + k] = TINY, 0.0
    length = int(lists[rows.LENGTH])
    if length == rows.DENSE:
        add_all(w, fixed, setting, lists)
    for at in range(rows.PLACE, rows.PLACE + length * rows.STEP, rows.STEP):
        add_step(w, lists[at : at + rows.STEP], setting)
    complete = True
    for k in range(lane_count(w)):
        complete &= w[rows.INLIER + k] >= lists[rows.LEAST_SUM + k]
    return complete


@vectorised
def finish_inliers(w):
    """log sum_i w_i N(0 | d_i, S_i), its relative gradient and second derivatives.

    From the sums of `add_step`: d/dphi = d_phi . d + K with d_phi = (-y, x), d_phiphi = -(x, y) and
    M_phi = 2 [[-h, -a], [-a, h]].
    """
    at = rows.INLIER
    lanes = lane_count(w)
    for k in range(lanes):
        x, y = w[rows.MX + k], w[rows.MY + k]
        a, h = w[rows.CXY + k], 0.5 * (w[rows.CXX + k] - w[rows.CYY + k])
        r = w[rows.TO_SHARE + k] = 1.0 / w[rows.INLIER + k]
        w[rows.DISTANCE + k] *= r
        g0, g1 = r * w[at + rows.G0 + k], r * w[at + rows.G1 + k]
        a00, a01 = r * w[at + rows.A00 + k], r * w[at + rows.A01 + k]
        a11 = r * w[at + rows.A11 + k]
        k0, k1 = r * w[at + rows.A02 + k], r * w[at + rows.A12 + k]
        w[rows.INLIER + k] = log(w[rows.INLIER + k]) - w[rows.OFFSET + k] - layout.LOG_2PI
        w[at + rows.G0 + k] = g0
        w[at + rows.G1 + k] = g1
        w[at + rows.G2 + k] = x * g1 - y * g0 + a * (a11 - a00) + 2.0 * h * a01
        w[at + rows.A00 + k] = a00
        w[at + rows.A01 + k] = a01
        w[at + rows.A11 + k] = a11
        w[at + rows.A02 + k] = x * a01 - y * a00 + k0
        w[at + rows.A12 + k] = x * a11 - y * a01 + k1
        w[at + rows.A22 + k] = (
            y * y * a00
            - 2.0 * x * y * a01
            + x * x * a11
            + 2.0 * (x * k1 - y * k0)
            + r * w[at + rows.A22 + k]
            - x * g0
            - y * g1
            + 2.0 * h * (a11 - a00)
            - 4.0 * a * a01
        )


@compiled
def find_extremes(points, extremes):
    """Sum of the weights, mean and least det(Sigma_i)^(1/2), least variance, largest aspect."""
    total, mean, least, variance, count = 0.0, 0.0, math.inf, math.inf, points.shape[1]
    aspect = 1.0
    for i in range(count):
        xx, xy, yy = points[XX, i], points[XY, i], points[YY, i]
        determinant, half = xx * yy - xy * xy, 0.5 * (xx - yy)
        root = math.sqrt(determinant)
        total += points[WEIGHT, i]
        mean += root / count
        least = min(least, root)
        largest = 0.5 * (xx + yy) + math.sqrt(half * half + xy * xy)
        variance, aspect = min(variance, determinant / largest), max(aspect, largest / root)
    extremes[layout.TOTAL_WEIGHT], extremes[layout.MEAN_ROOT] = total, mean
    extremes[layout.LEAST_ROOT], extremes[layout.LEAST_VARIANCE] = least, variance
    extremes[layout.LARGEST_ASPECT] = aspect
