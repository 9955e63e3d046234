"""The compiled entries: many problems in one call."""

import math

from d2d._kernel.charts import exponential_chart, logarithm_chart, write_chart
from d2d._kernel.compiling import entry
from d2d._kernel.evaluation import evaluate_block, setting_of
from d2d._kernel.layout import LANES, MAX_VARIANCE, MAX_WEIGHT, MIN_WEIGHT
from d2d._kernel.minimisation import evaluate, minimise, motion_chart, pair_at
from d2d._kernel.newton import invert
from d2d._kernel.pairs import find_extremes, find_origin


@entry
def are_good_targets(means, covariances, weights):
    """Whether targets (M, D), (M, D, D), (M,) are finite, with exactly symmetric, positive
    definite covariances and weights, all within the range that the sums allow.
    """
    d = means.shape[1]
    for k in range(means.shape[0]):
        good = math.isfinite(means[k, 0]) and MIN_WEIGHT <= weights[k] <= MAX_WEIGHT
        xx = covariances[k, 0, 0]
        good = good and 0.0 < xx <= MAX_VARIANCE
        if d == 2:
            xy, yy = covariances[k, 0, 1], covariances[k, 1, 1]
            good = good and math.isfinite(means[k, 1]) and 0.0 < yy <= MAX_VARIANCE
            good = good and xy == covariances[k, 1, 0] and 0.0 < xx * yy - xy * xy < math.inf
        if not good:
            return False
    return True


@entry
def survey_batch(packed, planar, extremes, origins):
    """Fill the bounds (B, 3) and origins (B, 2) of sets (6, B N) of equal size; whether any is far.

    See `find_extremes` and `find_origin`.
    """
    size, far = packed.shape[1] // extremes.shape[0], False
    for b in range(extremes.shape[0]):
        points = packed[:, b * size : (b + 1) * size]
        find_extremes(points, extremes[b])
        far |= find_origin(points, planar, origins[b])
    return far


@entry
def evaluate_batch(batch, thetas, work, value, gradient, hessian):
    """Cost (B,), gradient (B, 3) and Hessian (B, 3, 3) of every problem at its theta."""
    for b in range(thetas.shape[0]):
        pair = pair_at(batch, batch.first[b])
        value[b], _ = evaluate(batch, b, pair, thetas[b], work, gradient[b], hessian[b])


@entry
def target_batch(batch, thetas, rows, work, values):
    """Rows of the scratch array for every target of every problem (B, rows, targets), at its theta.

    LOG_DENSITY holds log q_k, GRADIENT its gradient in the motion, CURVATURE the second derivatives
    of q_k over q_k, and SHARE the inlier component's share in q_k.
    """
    w = work.scratch
    for b in range(thetas.shape[0]):
        done = 0
        for number in range(batch.first[b], batch.first[b + 1]):
            pair = pair_at(batch, number)
            chart = motion_chart(batch, number, thetas[b])
            setting = setting_of(pair, (chart.x, chart.y, chart.phi))
            fixed, moving, order = pair.fixed, pair.moving, pair.order
            factors, outlier = pair.factors, pair.outlier
            targets = moving.shape[1]
            for first in range(0, targets, LANES):
                evaluate_block(w, fixed, moving, order, factors, outlier, setting, first)
                for k in range(min(LANES, targets - first)):
                    for r in range(rows.shape[0]):
                        values[b, r, done + order[first + k]] = w[rows[r] + k]
            done += targets


@entry
def minimise_batch(batch, thetas, tolerance, max_iterations, work, results):
    """Minimise every problem separately; ``thetas`` holds the starts, then the optima."""
    value, gradient, hessian, covariance, converged, iterations, shares = results
    for b in range(thetas.shape[0]):
        value[b], converged[b], iterations[b], shares[b] = minimise(
            batch, b, thetas[b], tolerance, max_iterations, work, gradient[b], hessian[b]
        )
        if converged[b]:
            invert(hessian[b], work.step, work.trial, covariance[b])


@entry
def chart_batch(points, inverse, image, first, second):
    """The exponentials of twists (B, 3), or the logarithms of motions, with their derivatives."""
    for b in range(points.shape[0]):
        if inverse:
            chart = logarithm_chart(points[b])
        else:
            chart = exponential_chart(points[b, 0], points[b, 1], points[b, 2])
        write_chart(chart, image[b], first[b], second[b])
