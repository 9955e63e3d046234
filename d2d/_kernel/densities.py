"""Densities of a block of targets beside that of the positions: outliers and measurements.

Each function leaves a jet in its table (see ``jets.py``).  An outlier model is a class that packs
itself (`d2d.cost`) and a jet here; where it depends on the components one by one, ``propagate.py``
needs its pairs as well.  A kind that is not known raises.
"""

import math

import numpy as np

from d2d._kernel.compile import inlined, merged, vectorised
from d2d._kernel.elementary import exp, log
from d2d._kernel.jets import through_chart
from d2d._kernel.layout import (
    A00,
    A01,
    A02,
    A11,
    A12,
    A22,
    CORRUPTED,
    FACTOR,
    G0,
    G1,
    G2,
    GAIN,
    INPUT_VARIANCE,
    KIND,
    LANES,
    LOG_2PI,
    LOG_OUTLIER_WEIGHT,
    MX,
    MY,
    NO_OUTLIER,
    OUTLIER,
    OUTLIER_OFFSET,
    OUTLIER_TO_SHARE,
    PRECISION_XX,
    PRECISION_XY,
    PRECISION_YY,
    SLOPE,
    UNIFORM,
    VALUE,
    VARIANCE,
    WEIGHT,
    X,
    Y,
    lane_count,
)
from d2d._kernel.pairs import ABOVE, MAX_EXPONENT

VANISHING = 1e-180  # outlier sums below it are computed again, relative to the nearest component


@vectorised
def half_square(w, k, mean, precision):
    """d, and half of d' B d, of a target and a component's mean less the translation."""
    bxx, bxy, byy = precision
    dx, dy = w[MX + k] - mean[0], w[MY + k] - mean[1]
    return dx, dy, 0.5 * (bxx * dx * dx + 2.0 * bxy * dx * dy + byy * dy * dy)


@vectorised
def add_moments(w, fixed, setting, precision):
    """Sum the six moments, of 1, d and d d', of the weights of the pairs."""
    lanes = lane_count(w)
    for k in range(6 * LANES):
        w[OUTLIER + k] = 0.0
    for i in range(fixed.shape[1]):
        mean, own = (fixed[X, i] - setting.x, fixed[Y, i] - setting.y), fixed[WEIGHT, i]
        for k in range(lanes):
            dx, dy, half = half_square(w, k, mean, precision)
            v = own * exp(min(w[OUTLIER_OFFSET + k] - half, MAX_EXPONENT))
            w[OUTLIER + k] += v
            w[OUTLIER + G0 + k] += v * dx
            w[OUTLIER + G1 + k] += v * dy
            w[OUTLIER + G2 + k] += v * dx * dx
            w[OUTLIER + A00 + k] += v * dx * dy
            w[OUTLIER + A01 + k] += v * dy * dy


@vectorised
def corrupted_jet(w, fixed, setting, outlier):
    """The corrupted Gaussian's component: sum_i w_i N(0 | d_i, S_o), one covariance for all pairs.

    Six moments of its weights are enough for all derivatives.
    """
    lanes = lane_count(w)
    precision = outlier[PRECISION_XX], outlier[PRECISION_XY], outlier[PRECISION_YY]
    for k in range(LANES):
        w[OUTLIER_OFFSET + k] = 0.0
    for again in range(2):
        add_moments(w, fixed, setting, precision)
        vanishing = False
        for k in range(lanes):
            vanishing |= w[OUTLIER + k] < VANISHING
        if again or not vanishing:
            break
        for k in range(LANES):
            w[OUTLIER_OFFSET + k] = np.inf
        for i in range(fixed.shape[1]):
            mean = fixed[X, i] - setting.x, fixed[Y, i] - setting.y
            for k in range(lanes):
                _, _, half = half_square(w, k, mean, precision)
                w[OUTLIER_OFFSET + k] = min(w[OUTLIER_OFFSET + k], ABOVE * half)
    finish_outliers(w, precision, outlier[LOG_OUTLIER_WEIGHT])


@vectorised
def finish_outliers(w, precision, log_weight):
    """From the moments to the logarithm and its derivatives.

    These need E[u] and E[u u'] with u = B d, and d_phi = (-y, x).
    """
    lanes = lane_count(w)
    bxx, bxy, byy = precision
    for k in range(lanes):
        x, y, s = w[MX + k], w[MY + k], w[OUTLIER + k]
        r = w[OUTLIER_TO_SHARE + k] = 1.0 / s
        sx, sy = w[OUTLIER + G0 + k] * r, w[OUTLIER + G1 + k] * r
        sxx, sxy = w[OUTLIER + G2 + k] * r, w[OUTLIER + A00 + k] * r
        syy = w[OUTLIER + A01 + k] * r
        ux, uy = bxx * sx + bxy * sy, bxy * sx + byy * sy
        uxx = bxx * (bxx * sxx + bxy * sxy) + bxy * (bxx * sxy + bxy * syy)
        uxy = bxx * (bxy * sxx + byy * sxy) + bxy * (bxy * sxy + byy * syy)
        uyy = bxy * (bxy * sxx + byy * sxy) + byy * (bxy * sxy + byy * syy)
        bdx, bdy = bxy * x - bxx * y, byy * x - bxy * y  # B d_phi
        w[OUTLIER + k] = log_weight - w[OUTLIER_OFFSET + k] + log(s)
        w[OUTLIER + G0 + k] = -ux
        w[OUTLIER + G1 + k] = -uy
        w[OUTLIER + G2 + k] = y * ux - x * uy
        w[OUTLIER + A00 + k] = uxx - bxx
        w[OUTLIER + A01 + k] = uxy - bxy
        w[OUTLIER + A11 + k] = uyy - byy
        w[OUTLIER + A02 + k] = x * uxy - y * uxx - bdx
        w[OUTLIER + A12 + k] = x * uyy - y * uxy - bdy
        w[OUTLIER + A22 + k] = (
            y * y * uxx - 2.0 * x * y * uxy + x * x * uyy + y * bdx - x * bdy + x * ux + y * uy
        )


@inlined
def uniform_jet(w, log_density):
    """A constant density, without derivatives."""
    for k in range(10 * LANES):
        w[OUTLIER + k] = 0.0
    for k in range(LANES):
        w[OUTLIER + k] = log_density


@merged
def outlier_jet(w, fixed, setting, outlier):
    """The outlier component of any kind but none."""
    kind = outlier[KIND]
    if kind == CORRUPTED:
        corrupted_jet(w, fixed, setting, outlier)
    elif kind == UNIFORM:
        uniform_jet(w, outlier[LOG_OUTLIER_WEIGHT])
    elif kind != NO_OUTLIER:
        raise ValueError("the kernel does not know this kind of outlier component")


@inlined
def measurement_jet(factor, xi):
    """The jet of N(z | h' xi, sigma^2 + q^2 (s' xi)^2), one target's measurement, in xi."""
    h0, h1, h2 = factor[GAIN], factor[GAIN + 1], factor[GAIN + 2]
    s0, s1, s2 = factor[SLOPE], factor[SLOPE + 1], factor[SLOPE + 2]
    residual = factor[VALUE] - h0 * xi[0] - h1 * xi[1] - h2 * xi[2]
    slope = s0 * xi[0] + s1 * xi[1] + s2 * xi[2]
    variance = factor[VARIANCE] + factor[INPUT_VARIANCE] * slope * slope
    e = residual / variance
    dv = 2.0 * factor[INPUT_VARIANCE] * slope  # d variance / d xi = dv s
    first = 0.5 * (e * e - 1.0 / variance)
    # second derivatives of the logarithm along h h', h s' + s h' and s s'
    hh = -1.0 / variance
    hs = -e / variance * dv
    ss = first * 2.0 * factor[INPUT_VARIANCE] - (e * e - 0.5 / variance) / variance * dv * dv
    g0, g1, g2 = e * h0 + first * dv * s0, e * h1 + first * dv * s1, e * h2 + first * dv * s2
    return (
        -0.5 * (residual * e + math.log(variance) + LOG_2PI),
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
            w[FACTOR + row * LANES + k] = jet[row]
