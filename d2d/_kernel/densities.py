"""Densities of a block of targets beside that of the positions: outliers and measurements.

Each function leaves a jet in its table (see ``jets.py``).  An outlier model is a class that packs
itself (`d2d.cost`) and a jet here; where it depends on the components one by one, ``propagate.py``
needs its pairs as well.  A kind that is not known raises.
"""

import math

import numpy as np

from d2d._kernel import layout, rows
from d2d._kernel.compile import compiled, inlined, vectorised
from d2d._kernel.elementary import exp, log
from d2d._kernel.jets import through_chart
from d2d._kernel.layout import WEIGHT, X, Y
from d2d._kernel.rows import LANES, lane_count
from d2d._kernel.tiles import interpolate, root_of

VANISHING = 1e-180  # outlier sums below it are computed again, relative to the nearest component


@inlined
def precision_of(outlier):
    """The precision of the corrupted Gaussian: xx, xy, yy."""
    return outlier[layout.PRECISION_XX], outlier[layout.PRECISION_XY], outlier[layout.PRECISION_YY]


@vectorised
def half_square(w, k, mean, precision):
    """d, and half of d' B d, of a target and a component's mean less the translation."""
    bxx, bxy, byy = precision
    dx, dy = w[rows.MX + k] - mean[0], w[rows.MY + k] - mean[1]
    return dx, dy, 0.5 * (bxx * dx * dx + 2.0 * bxy * dx * dy + byy * dy * dy)


@vectorised
def add_moments(w, fixed, setting, precision):
    """Sum the six moments, of 1, d and d d', of the weights of the pairs."""
    at = rows.OUTLIER
    lanes = lane_count(w)
    for k in range(6 * LANES):
        w[rows.OUTLIER + k] = 0.0
    for i in range(fixed.shape[1]):
        mean, own = (fixed[X, i] - setting.x, fixed[Y, i] - setting.y), fixed[WEIGHT, i]
        for k in range(lanes):
            dx, dy, half = half_square(w, k, mean, precision)
            v = own * exp(min(w[rows.OUTLIER_OFFSET + k] - half, layout.MAX_EXPONENT))
            w[rows.OUTLIER + k] += v
            w[at + rows.G0 + k] += v * dx
            w[at + rows.G1 + k] += v * dy
            w[at + rows.G2 + k] += v * dx * dx
            w[at + rows.A00 + k] += v * dx * dy
            w[at + rows.A01 + k] += v * dy * dy


@vectorised
def sum_outliers(w, fixed, setting, precision):
    """sum_i w_i exp(-d_i' B d_i / 2 + OFFSET) of each target, and its derivatives over it.

    Six moments of the weights are enough for all derivatives.
    """
    at = rows.OUTLIER
    lanes = lane_count(w)
    for k in range(LANES):
        w[rows.OUTLIER_OFFSET + k] = 0.0
    for again in range(2):
        add_moments(w, fixed, setting, precision)
        vanishing = False
        for k in range(lanes):
            vanishing |= w[rows.OUTLIER + k] < VANISHING
        if again or not vanishing:
            break
        for k in range(LANES):
            w[rows.OUTLIER_OFFSET + k] = np.inf
        for i in range(fixed.shape[1]):
            mean = fixed[X, i] - setting.x, fixed[Y, i] - setting.y
            for k in range(lanes):
                _, _, half = half_square(w, k, mean, precision)
                w[rows.OUTLIER_OFFSET + k] = min(w[rows.OUTLIER_OFFSET + k], layout.ABOVE * half)
    bxx, bxy, byy = precision
    for k in range(lanes):
        r = 1.0 / w[rows.OUTLIER + k]
        sx, sy = w[at + rows.G0 + k] * r, w[at + rows.G1 + k] * r
        sxx, sxy = w[at + rows.G2 + k] * r, w[at + rows.A00 + k] * r
        syy = w[at + rows.A01 + k] * r
        # E[u] and E[u u'] with u = B d
        w[at + rows.G0 + k] = -(bxx * sx + bxy * sy)
        w[at + rows.G1 + k] = -(bxy * sx + byy * sy)
        w[at + rows.A00 + k] = bxx * (bxx * sxx + bxy * sxy) + bxy * (bxx * sxy + bxy * syy) - bxx
        w[at + rows.A01 + k] = bxx * (bxy * sxx + byy * sxy) + bxy * (bxy * sxy + byy * syy) - bxy
        w[at + rows.A11 + k] = bxy * (bxy * sxx + byy * sxy) + byy * (bxy * sxy + byy * syy) - byy


@vectorised
def to_logarithm(w, log_weight):
    """Turn a sum over the components into the logarithm of the density."""
    for k in range(lane_count(w)):
        s = w[rows.OUTLIER + k]
        w[rows.OUTLIER_TO_SHARE + k] = 1.0 / s
        w[rows.OUTLIER + k] = log_weight - w[rows.OUTLIER_OFFSET + k] + log(s)


@vectorised
def turn_outliers(w):
    """The derivatives along the rotation, d_phi = (-y, x)."""
    at = rows.OUTLIER
    for k in range(lane_count(w)):
        x, y = w[rows.MX + k], w[rows.MY + k]
        g0, g1 = w[at + rows.G0 + k], w[at + rows.G1 + k]
        a00, a01, a11 = w[at + rows.A00 + k], w[at + rows.A01 + k], w[at + rows.A11 + k]
        w[at + rows.G2 + k] = x * g1 - y * g0
        w[at + rows.A02 + k] = x * a01 - y * a00
        w[at + rows.A12 + k] = x * a11 - y * a01
        w[at + rows.A22 + k] = y * y * a00 - 2.0 * x * y * a01 + x * x * a11 - x * g0 - y * g1


@vectorised
def divide_by_value(w):
    """Divide a field's derivatives by its value."""
    for k in range(lane_count(w)):
        inverse = 1.0 / w[rows.OUTLIER + k]
        w[rows.OUTLIER_OFFSET + k] = 0.0
        for row in (rows.G0, rows.G1, rows.A00, rows.A01, rows.A11):
            w[rows.OUTLIER + row + k] *= inverse


@compiled
def corrupted_jet(w, fixed, setting, outlier, tiles, grid):
    """The corrupted Gaussian's component: sum_i w_i N(0 | d_i, S_o), one covariance for all pairs.

    From the tiles of a large set, or as the plain sum.
    """
    if tiles.shape[0] > 0 and interpolate(w, tiles, grid, root_of(outlier), setting):
        divide_by_value(w)
    else:
        sum_outliers(w, fixed, setting, precision_of(outlier))
    to_logarithm(w, outlier[layout.LOG_OUTLIER_WEIGHT])
    turn_outliers(w)


@inlined
def uniform_jet(w, log_density):
    """A constant density, without derivatives."""
    for k in range(10 * LANES):
        w[rows.OUTLIER + k] = 0.0
    for k in range(LANES):
        w[rows.OUTLIER + k] = log_density


@inlined
def outlier_jet(w, fixed, setting, outlier, tiles, grid):
    """The outlier component of any kind but none."""
    kind = outlier[layout.KIND]
    if kind == layout.CORRUPTED:
        corrupted_jet(w, fixed, setting, outlier, tiles, grid)
    elif kind == layout.UNIFORM:
        uniform_jet(w, outlier[layout.LOG_OUTLIER_WEIGHT])
    elif kind != layout.NO_OUTLIER:
        raise ValueError("the kernel does not know this kind of outlier component")


@inlined
def measurement_at(factor, xi):
    """Vectors h and s of one target's measurement N(z | h' xi, sigma^2 + q^2 (s' xi)^2).

    Then its residual z - h' xi, its slope s' xi and its variance.
    """
    h0, h1, h2 = factor[layout.GAIN], factor[layout.GAIN + 1], factor[layout.GAIN + 2]
    s0, s1, s2 = factor[layout.SLOPE], factor[layout.SLOPE + 1], factor[layout.SLOPE + 2]
    residual = factor[layout.VALUE] - h0 * xi[0] - h1 * xi[1] - h2 * xi[2]
    slope = s0 * xi[0] + s1 * xi[1] + s2 * xi[2]
    variance = factor[layout.VARIANCE] + factor[layout.INPUT_VARIANCE] * slope * slope
    return (h0, h1, h2), (s0, s1, s2), residual, slope, variance


@inlined
def measurement_jet(factor, xi):
    """The jet of one target's measurement in xi."""
    (h0, h1, h2), (s0, s1, s2), residual, slope, variance = measurement_at(factor, xi)
    e = residual / variance
    dv = 2.0 * factor[layout.INPUT_VARIANCE] * slope  # d variance / d xi = dv s
    first = 0.5 * (e * e - 1.0 / variance)
    # second derivatives of the logarithm along h h', h s' + s h' and s s'
    hh = -1.0 / variance
    hs = -e / variance * dv
    ss = first * 2.0 * factor[layout.INPUT_VARIANCE] - (e * e - 0.5 / variance) / variance * dv * dv
    g0, g1, g2 = e * h0 + first * dv * s0, e * h1 + first * dv * s1, e * h2 + first * dv * s2
    return (
        -0.5 * (residual * e + math.log(variance) + layout.LOG_2PI),
        g0,
        g1,
        g2,
        hh * h0 * h0 + 2.0 * hs * h0 * s0 + ss * s0 * s0 + g0 * g0,
        hh * h0 * h1 + hs * (h0 * s1 + h1 * s0) + ss * s0 * s1 + g0 * g1,
        hh * h1 * h1 + 2.0 * hs * h1 * s1 + ss * s1 * s1 + g1 * g1,
        hh * h0 * h2 + hs * (h0 * s2 + h2 * s0) + ss * s0 * s2 + g0 * g2,
        hh * h1 * h2 + hs * (h1 * s2 + h2 * s1) + ss * s1 * s2 + g1 * g2,
        hh * h2 * h2 + 2.0 * hs * h2 * s2 + ss * s2 * s2 + g2 * g2,
    )


@inlined
def measurement_jets(w, factors, order, chart, first):
    """The jets of a block's measurements, in the motion."""
    last = order.shape[0] - 1
    xi = chart.x, chart.y, chart.phi
    for k in range(lane_count(w)):
        jet = through_chart(measurement_jet(factors[order[min(first + k, last)]], xi), chart)
        for row in range(10):
            w[rows.FACTOR + row * LANES + k] = jet[row]
