"""Densities of a block of targets: outliers, measurements, their mixture, and their fusion.

Each has a table of ten rows: the logarithm of the density, and its gradient and second derivatives
over the density itself.
"""

import math

import numpy as np

from d2d._kernel.compiling import inlined, vectorised
from d2d._kernel.elementary import exp, log
from d2d._kernel.layout import (
    A00,
    A01,
    A02,
    A11,
    A12,
    A22,
    COUNTS,
    FACTOR,
    G0,
    G1,
    G2,
    GAIN,
    INLIER,
    INPUT_VARIANCE,
    LANES,
    LOG_2PI,
    LOG_OUTLIER_WEIGHT,
    MX,
    MY,
    OFFSET,
    OUTLIER,
    PRECISION_XX,
    PRECISION_XY,
    PRECISION_YY,
    SECOND,
    SHARE,
    SHARES,
    SLOPE,
    TOP,
    TOTAL,
    VALUE,
    VARIANCE,
    WEIGHT,
    X,
    Y,
)
from d2d._kernel.pairs import ABOVE, GATE, MAX_EXPONENT, lane_count

VANISHING = 1e-180  # outlier sums below it are computed again, relative to the nearest component


@vectorised
def half_square(w, k, mean, precision):
    """d, and half of d' B d, of a target and a component's mean less the translation."""
    bxx, bxy, byy = precision
    dx, dy = w[MX + k] - mean[0], w[MY + k] - mean[1]
    return dx, dy, 0.5 * (bxx * dx * dx + 2.0 * bxy * dx * dy + byy * dy * dy)


@vectorised
def add_moments(w, fixed, setting, precision):
    """Sum the six moments, of 1, d and d d', of the weights w_i exp(OFFSET - d' B d / 2)."""
    lanes = lane_count(w)
    for k in range(6 * LANES):
        w[OUTLIER + k] = 0.0
    for i in range(fixed.shape[1]):
        mean, own = (fixed[X, i] - setting.x, fixed[Y, i] - setting.y), fixed[WEIGHT, i]
        for k in range(lanes):
            dx, dy, half = half_square(w, k, mean, precision)
            v = own * exp(min(w[OFFSET + k] - half, MAX_EXPONENT))
            w[OUTLIER + k] += v
            w[OUTLIER + G0 + k] += v * dx
            w[OUTLIER + G1 + k] += v * dy
            w[OUTLIER + G2 + k] += v * dx * dx
            w[OUTLIER + A00 + k] += v * dx * dy
            w[OUTLIER + A01 + k] += v * dy * dy


@vectorised
def sum_outliers(w, fixed, setting, outlier):
    """The corrupted Gaussian's component: sum_i w_i N(0 | d_i, S_o), one covariance for all pairs.

    Six moments of its weights are enough for all derivatives.
    """
    lanes = lane_count(w)
    precision = outlier[PRECISION_XX], outlier[PRECISION_XY], outlier[PRECISION_YY]
    for k in range(LANES):
        w[OFFSET + k] = 0.0
    for again in range(2):
        add_moments(w, fixed, setting, precision)
        vanishing = False
        for k in range(lanes):
            vanishing |= w[OUTLIER + k] < VANISHING
        if again or not vanishing:
            break
        for k in range(LANES):
            w[OFFSET + k] = np.inf
        for i in range(fixed.shape[1]):
            mean = fixed[X, i] - setting.x, fixed[Y, i] - setting.y
            for k in range(lanes):
                _, _, half = half_square(w, k, mean, precision)
                w[OFFSET + k] = min(w[OFFSET + k], ABOVE * half)
    finish_outliers(w, precision, outlier[LOG_OUTLIER_WEIGHT])


@vectorised
def finish_outliers(w, precision, log_weight):
    """From the moments to the logarithm and its derivatives.

    With E[u] and E[u u'] of u = B d, and d_phi = (-y, x).
    """
    lanes = lane_count(w)
    bxx, bxy, byy = precision
    for k in range(lanes):
        x, y, s = w[MX + k], w[MY + k], w[OUTLIER + k]
        r = 1.0 / s
        sx, sy = w[OUTLIER + G0 + k] * r, w[OUTLIER + G1 + k] * r
        sxx, sxy = w[OUTLIER + G2 + k] * r, w[OUTLIER + A00 + k] * r
        syy = w[OUTLIER + A01 + k] * r
        ux, uy = bxx * sx + bxy * sy, bxy * sx + byy * sy
        uxx = bxx * (bxx * sxx + bxy * sxy) + bxy * (bxx * sxy + bxy * syy)
        uxy = bxx * (bxy * sxx + byy * sxy) + bxy * (bxy * sxy + byy * syy)
        uyy = bxy * (bxy * sxx + byy * sxy) + byy * (bxy * sxy + byy * syy)
        bdx, bdy = bxy * x - bxx * y, byy * x - bxy * y  # B d_phi
        w[OUTLIER + k] = log_weight - w[OFFSET + k] + log(s)
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
def set_uniform(w, log_density):
    """The uniform outlier component: a constant, without derivatives."""
    for k in range(10 * LANES):
        w[OUTLIER + k] = 0.0
    for k in range(LANES):
        w[OUTLIER + k] = log_density


@inlined
def measurement_terms(factor, xi):
    """log N(z | h' xi, sigma^2 + q^2 (s' xi)^2) of one target, its gradient and Hessian."""
    h0, h1, h2 = factor[GAIN], factor[GAIN + 1], factor[GAIN + 2]
    s0, s1, s2 = factor[SLOPE], factor[SLOPE + 1], factor[SLOPE + 2]
    residual = factor[VALUE] - h0 * xi[0] - h1 * xi[1] - h2 * xi[2]
    slope = s0 * xi[0] + s1 * xi[1] + s2 * xi[2]
    variance = factor[VARIANCE] + factor[INPUT_VARIANCE] * slope * slope
    e = residual / variance
    dv = 2.0 * factor[INPUT_VARIANCE] * slope  # d variance / d xi = dv s
    first = 0.5 * (e * e - 1.0 / variance)
    hs = -e / variance * dv
    ss = first * 2.0 * factor[INPUT_VARIANCE] - (e * e - 0.5 / variance) / variance * dv * dv
    hh = -1.0 / variance
    return (
        -0.5 * (residual * e + math.log(variance) + LOG_2PI),
        e * h0 + first * dv * s0,
        e * h1 + first * dv * s1,
        e * h2 + first * dv * s2,
        hh * h0 * h0 + 2.0 * hs * h0 * s0 + ss * s0 * s0,
        hh * h0 * h1 + hs * (h0 * s1 + h1 * s0) + ss * s0 * s1,
        hh * h1 * h1 + 2.0 * hs * h1 * s1 + ss * s1 * s1,
        hh * h0 * h2 + hs * (h0 * s2 + h2 * s0) + ss * s0 * s2,
        hh * h1 * h2 + hs * (h1 * s2 + h2 * s1) + ss * s1 * s2,
        hh * h2 * h2 + 2.0 * hs * h2 * s2 + ss * s2 * s2,
    )


@vectorised
def multiply_measurements(w):
    """Multiply the inlier densities by those of the measurements.

    (p f)'' / (p f) = p'' / p + p' f' / (p f) + f' p' / (p f) + f'' / f.  The measurements' rows
    hold the second derivatives of log f, which are f'' / f - (f' / f)^2.
    """
    lanes = lane_count(w)
    for row, i, j in SECOND:
        for k in range(lanes):
            fi, fj = w[FACTOR + i + k], w[FACTOR + j + k]
            gi, gj = w[INLIER + i + k], w[INLIER + j + k]
            w[INLIER + row + k] += gi * fj + gj * fi + fi * fj + w[FACTOR + row + k]
    for row in range(0, 4 * LANES, LANES):
        for k in range(lanes):
            w[INLIER + row + k] += w[FACTOR + row + k]


@vectorised
def mix(w, log_inlier_weight):
    """Mix the inlier densities with those of the outlier component.

    The derivatives of a mixture over itself are those of its parts, weighted by their shares.  A
    share that vanishes beside the other is zero: otherwise its measurement would give a plateau the
    curvature of an optimum.
    """
    lanes = lane_count(w)
    for k in range(lanes):
        inlier, other = log_inlier_weight + w[INLIER + k], w[OUTLIER + k]
        gap = other - inlier
        ratio = exp(-abs(gap))  # of the smaller over the larger
        ratio = 0.0 if abs(gap) > GATE else ratio
        larger = 1.0 / (1.0 + ratio)
        w[SHARE + k] = ratio * larger if gap > 0.0 else larger
        w[SHARES + k] += w[COUNTS + k] * w[SHARE + k]
        w[INLIER + k] = max(inlier, other) + log(1.0 + ratio)
    for row in range(G0, A22 + LANES, LANES):
        for k in range(lanes):
            share = w[SHARE + k]
            w[INLIER + row + k] = share * w[INLIER + row + k] + (1.0 - share) * w[OUTLIER + row + k]


@vectorised
def fuse_likelihood(w):
    """Fuse by the likelihood: add log q_k and its derivatives to the totals."""
    lanes = lane_count(w)
    for row, i, j in SECOND:
        for k in range(lanes):
            curved = w[INLIER + row + k] - w[INLIER + i + k] * w[INLIER + j + k]
            w[TOTAL + row + k] += w[COUNTS + k] * curved
    for row in range(0, 4 * LANES, LANES):
        for k in range(lanes):
            w[TOTAL + row + k] += w[COUNTS + k] * w[INLIER + row + k]


@vectorised
def fuse_summing(w):
    """Fuse by the sum: add q_k exp(-TOP) and its derivatives, TOP rising with the largest."""
    lanes = lane_count(w)
    for k in range(lanes):
        top = max(w[TOP + k], w[INLIER + k])
        keep = exp(w[TOP + k] - top)
        own = w[COUNTS + k] * exp(w[INLIER + k] - top)
        w[TOP + k] = top
        w[TOTAL + k] = keep * w[TOTAL + k] + own
        for row in range(G0, A22 + LANES, LANES):
            w[TOTAL + row + k] = keep * w[TOTAL + row + k] + own * w[INLIER + row + k]
