"""Jets: a density's logarithm, gradient and second derivatives, and their only algebra.

A jet of a density q has ten numbers: log q, then the gradient of q and its second derivatives, both
over q itself.  A product of densities, a mixture of them and a change of the parameters give a jet
again.  The tables of the scratch array hold a jet in every vector lane (see ``rows.py``).
"""

from d2d._kernel import layout, rows
from d2d._kernel.compile import inlined, vectorised
from d2d._kernel.elementary import exp, log
from d2d._kernel.rows import LANES, lane_count


@vectorised
def multiply(w):
    """Product of the inlier densities and those of the measurements, in place.

    (p f)'' / (p f) = p'' / p + p' f' / (p f) + f' p' / (p f) + f'' / f.
    """
    lanes = lane_count(w)
    for row, i, j in rows.SECOND:
        for k in range(lanes):
            fi, fj = w[rows.FACTOR + i + k], w[rows.FACTOR + j + k]
            gi, gj = w[rows.INLIER + i + k], w[rows.INLIER + j + k]
            w[rows.INLIER + row + k] += gi * fj + gj * fi + w[rows.FACTOR + row + k]
    for row in range(0, 4 * LANES, LANES):
        for k in range(lanes):
            w[rows.INLIER + row + k] += w[rows.FACTOR + row + k]


@vectorised
def mix(w, log_inlier_weight):
    """Mixture of the inlier densities and those of the outlier component, in place.

    The derivatives of a mixture over itself are those of its parts, weighted by their shares.  A
    share that vanishes beside the other is zero: otherwise its measurement would give a plateau the
    curvature of an optimum.
    """
    lanes = lane_count(w)
    for k in range(lanes):
        inlier, other = log_inlier_weight + w[rows.INLIER + k], w[rows.OUTLIER + k]
        gap = other - inlier
        ratio = exp(-abs(gap))  # of the smaller over the larger
        ratio = 0.0 if abs(gap) > layout.GATE else ratio
        larger = 1.0 / (1.0 + ratio)
        w[rows.SHARE + k] = ratio * larger if gap > 0.0 else larger
        w[rows.INLIER + k] = max(inlier, other) + log(1.0 + ratio)
    for row in range(rows.G0, rows.A22 + LANES, LANES):
        for k in range(lanes):
            share = w[rows.SHARE + k]
            other = (1.0 - share) * w[rows.OUTLIER + row + k]
            w[rows.INLIER + row + k] = share * w[rows.INLIER + row + k] + other


@vectorised
def add_shares(w):
    """Add the inliers' shares of a block, and how far its targets are from their components."""
    for k in range(lane_count(w)):
        share = w[rows.COUNTS + k] * w[rows.SHARE + k]
        w[rows.SHARES + k] += share
        w[rows.DISTANCES + k] += share * w[rows.DISTANCE + k]


@vectorised
def fuse_likelihood(w):
    """Product over the targets: add log q_k and its derivatives to the totals."""
    lanes = lane_count(w)
    for row, i, j in rows.SECOND:
        for k in range(lanes):
            curved = w[rows.INLIER + row + k] - w[rows.INLIER + i + k] * w[rows.INLIER + j + k]
            w[rows.TOTAL + row + k] += w[rows.COUNTS + k] * curved
    for row in range(0, 4 * LANES, LANES):
        for k in range(lanes):
            w[rows.TOTAL + row + k] += w[rows.COUNTS + k] * w[rows.INLIER + row + k]


@vectorised
def fuse_summing(w):
    """Sum over the targets: add q_k exp(-TOP) and its derivatives, TOP rising with the largest."""
    lanes = lane_count(w)
    for k in range(lanes):
        top = max(w[rows.TOP + k], w[rows.INLIER + k])
        keep = exp(w[rows.TOP + k] - top)
        own = w[rows.COUNTS + k] * exp(w[rows.INLIER + k] - top)
        w[rows.TOP + k] = top
        w[rows.TOTAL + k] = keep * w[rows.TOTAL + k] + own
        for row in range(rows.G0, rows.A22 + LANES, LANES):
            added = own * w[rows.INLIER + row + k]
            w[rows.TOTAL + row + k] = keep * w[rows.TOTAL + row + k] + added


@inlined
def through_chart(jet, chart):
    """Chain rule: derivatives in a chart's image become those in its coordinates.

    It holds for a jet, and for a value with its gradient and Hessian.
    """
    value, g0, g1, g2, h00, h01, h11, h02, h12, h22 = jet
    a, b, c, d, a1, b1 = chart.a, chart.b, chart.c, chart.d, chart.a1, chart.b1
    # H J, column by column
    m00, m10 = h00 * a - h01 * b, h01 * a - h11 * b
    m01, m11 = h00 * b + h01 * a, h01 * b + h11 * a
    m02, m12, m22 = h00 * c + h01 * d + h02, h01 * c + h11 * d + h12, h02 * c + h12 * d + h22
    f0, f1, f2 = gradient_through_chart(g0, g1, g2, chart)
    return (
        value,
        f0,
        f1,
        f2,
        a * m00 - b * m10,
        a * m01 - b * m11,
        b * m01 + a * m11,
        a * m02 - b * m12 + a1 * g0 - b1 * g1,
        b * m02 + a * m12 + b1 * g0 + a1 * g1,
        c * m02 + d * m12 + m22 + chart.e * g0 + chart.f * g1,
    )


@inlined
def gradient_through_chart(g0, g1, g2, chart):
    """The gradient's part of the chain rule."""
    return (
        chart.a * g0 - chart.b * g1,
        chart.b * g0 + chart.a * g1,
        chart.c * g0 + chart.d * g1 + g2,
    )
