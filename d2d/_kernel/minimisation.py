"""The minimum of the cost that one or several pairs of sets share."""

import math
import threading
from typing import Any, NamedTuple

import numpy as np

from d2d._kernel.charts import exponential_chart, identity_chart, through_chart
from d2d._kernel.compiling import compiled, inlined, merged
from d2d._kernel.evaluation import evaluate_pair
from d2d._kernel.layout import (
    ARC,
    LANES,
    MOTION,
    SCRATCH,
    SHARES,
    XX,
    YY,
    Pair,
    X,
    Y,
)
from d2d._kernel.newton import inner_product, shifted_solve, trust_region_step
from d2d._kernel.pairs import GATE, bounds

ROUNDING = 2e-15  # error of a cost, relative to its size plus the number of targets
RESOLVED = 1e-8  # Newton decrement: 1e-4 standard deviations from the optimum

FIXED_START, FIXED_SIZE, FIXED_SET, MOVING_START, MOVING_SIZE, FACTOR_START = range(6)


class Batch(NamedTuple):
    """The problems of one call: all sets one after the other, and which pairs each problem sums.

    Problem b is the sum over the pairs ``first[b]`` to ``first[b + 1]``.  They share its
    parameters: a motion, or a velocity that causes each pair's motion over its own interval.
    """

    fixed: Any  # (6, targets) of all fixed sets, one set after the other
    moving: Any  # (6, targets) of all moving sets
    orders: Any  # (targets,) of all moving sets, each counted from its own first
    extremes: Any  # (sets, 3) of the fixed sets, see `find_extremes`
    factors: Any  # (targets, 9) of all measurements, (0, 9) if there is none
    outlier: Any  # (6,)
    pairs: Any  # (pairs, 6) of int, see FIXED_START ...; FACTOR_START is -1 without a measurement
    intervals: Any  # (pairs,) s
    first: Any  # (problems + 1,) of int
    d2d: float
    planar: float
    fusion: int
    in_twist: bool
    kind: int  # of the parameters: MOTION, ARC or CHORD
    prior: Any  # (3,) precisions of the parameters' prior, a Gaussian about zero
    gate: float = GATE  # see pairs.py


class Work(NamedTuple):
    """The memory that one thread needs, see `own_work`."""

    scratch: Any  # rows of the passes over the targets, see layout.py
    step: Any
    scale: Any
    trial: Any
    trial_gradient: Any
    trial_hessian: Any
    motion: Any  # of one of several pairs, with its gradient and Hessian
    gradient: Any
    hessian: Any
    vectors: Any  # (5, 3) of the trust region


_OF_THREAD = threading.local()


def own_work() -> Work:
    """The memory of the thread that calls, the same in every call."""
    if not hasattr(_OF_THREAD, "work"):
        _OF_THREAD.work = _make_work()
    work: Work = _OF_THREAD.work
    return work


def _make_work() -> Work:
    vectors, matrices = np.empty((6, 3)), np.empty((2, 3, 3))
    step, scale, trial, trial_gradient, motion, gradient = vectors
    return Work(
        np.empty(SCRATCH),
        step,
        scale,
        trial,
        trial_gradient,
        matrices[0],
        motion,
        gradient,
        matrices[1],
        np.empty((5, 3)),
    )


@compiled
def pair_at(batch, number):
    """One pair of the batch, bound."""
    row = batch.pairs[number]
    start, stop = row[MOVING_START], row[MOVING_START] + row[MOVING_SIZE]
    fixed = batch.fixed[:, row[FIXED_START] : row[FIXED_START] + row[FIXED_SIZE]]
    moving = batch.moving[:, start:stop]
    at, measured = row[FACTOR_START], row[MOVING_SIZE] if row[FACTOR_START] >= 0 else 0
    factors = batch.factors[at : at + measured]
    log_peak, log_spread = bounds(fixed, moving, batch.extremes[row[FIXED_SET]])
    return Pair(
        fixed,
        moving,
        batch.orders[start:stop],
        factors,
        batch.outlier,
        batch.d2d,
        batch.planar,
        batch.in_twist,
        batch.gate,
        log_peak,
        log_spread,
    )


@inlined
def motion_chart(batch, number, theta):
    """The motion of a pair at theta; if theta is a velocity, the exponential of its twist."""
    interval = batch.intervals[number]
    x, y, w = interval * theta[0], interval * theta[1], interval * theta[2]
    if batch.kind == ARC:
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


@merged
def evaluate(batch, problem, pair, theta, work, g, h):
    """Cost of a problem at theta, and the sum of its targets' inlier shares.

    The cost is the sum over the problem's pairs, of which ``pair`` is the first, and the prior's;
    its gradient goes to g (3), its Hessian to h (3, 3).
    """
    w, motion = work.scratch, work.motion
    for k in range(LANES):
        w[SHARES + k] = 0.0
    for j in range(3):
        g[j] = h[0, j] = h[1, j] = h[2, j] = 0.0
    value, shares = 0.0, 0.0
    first = batch.first[problem]
    for number in range(first, batch.first[problem + 1]):
        if number > first:
            pair = pair_at(batch, number)
        chart = motion_chart(batch, number, theta)
        motion[0], motion[1], motion[2] = chart.x, chart.y, chart.phi
        value += evaluate_pair(pair, motion, batch.fusion, w, work.gradient, work.hessian)
        add_derivatives(work, chart, batch.intervals[number], g, h)
    for j in range(3):
        weighted = batch.prior[j] * theta[j]
        value += 0.5 * weighted * theta[j]
        g[j] += weighted
        h[j, j] += batch.prior[j]
    for k in range(LANES):
        shares += w[SHARES + k]
    return value, shares


@compiled
def first_radius(pair, scale):
    """Three times the typical standard deviation of a pair: less than most basins of attraction.

    Fills the scale of the parameters: a rotation counts by the displacement that it causes.
    """
    fixed, moving, planar = pair.fixed, pair.moving, pair.planar
    variance = lever = 0.0
    for i in range(fixed.shape[1]):
        variance += (fixed[XX, i] + planar * fixed[YY, i]) / fixed.shape[1]
    for k in range(moving.shape[1]):
        variance += pair.d2d * (moving[XX, k] + planar * moving[YY, k]) / moving.shape[1]
        lever += (moving[X, k] ** 2 + moving[Y, k] ** 2) / moving.shape[1]
    scale[0] = scale[1] = 1.0
    scale[2] = lever if planar and lever > 0.0 else 1.0
    return 3.0 * math.sqrt(variance)


@inlined
def accept_trial(work, theta, g, h):
    """Make the trial the new parameters, with its gradient and Hessian."""
    for j in range(3):
        theta[j] = work.trial[j]
        g[j] = work.trial_gradient[j]
        for i in range(3):
            h[i, j] = work.trial_hessian[i, j]


@inlined
def newton_decrement(work, g, h):
    """The Newton step, to ``work.step``, and g' H^-1 g; infinite unless H is positive definite."""
    step = work.step
    definite, _ = shifted_solve(h, g, 0.0, work.scale, step)
    return -(g[0] * step[0] + g[1] * step[1] + g[2] * step[2]) if definite else np.inf


@merged
def minimise(batch, problem, theta, tolerance, max_iterations, work, g, h):
    """Newton's method in a trust region, in place; (value, converged, iterations, mean share).

    A step is accepted only if it lowers the cost, so the result is never worse than the start.
    Converged means that the Hessian is positive definite and the Newton decrement g' H^-1 g, the
    squared distance to the optimum in estimated standard deviations, is below the tolerance.

    A large cost is rounded by more than a step gains, so that it cannot tell whether the step was
    good.  Then a step is accepted if it lowers the decrement, and one below RESOLVED is enough.
    """
    pair = pair_at(batch, batch.first[problem])
    step, scale, trial = work.step, work.scale, work.trial
    radius = first_radius(pair, scale)
    if batch.kind != MOTION:
        radius /= batch.intervals[batch.first[problem]]
    targets = 0
    for number in range(batch.first[problem], batch.first[problem + 1]):
        targets += batch.pairs[number, MOVING_SIZE]
    for j in range(3):
        trial[j] = theta[j]
    # the start is the first trial: a second call of `evaluate` would be compiled a second time
    value, shares, decrement, decrease, norm = np.inf, 0.0, np.inf, np.inf, np.inf
    for tried in range(max_iterations + 1):
        trial_value, trial_shares = evaluate(
            batch, problem, pair, trial, work, work.trial_gradient, work.trial_hessian
        )
        gain = value - trial_value
        better = gain > 0.0 or tried == 0
        if not better and decrease <= ROUNDING * (abs(value) + targets):
            after = newton_decrement(work, work.trial_gradient, work.trial_hessian)
            nearer = after < 0.25 * decrement < np.inf
            if decrement <= RESOLVED or not nearer:
                return value, decrement <= RESOLVED, tried, shares / targets
            better = True
        elif tried > 0:
            ratio = gain / decrease if decrease > 0.0 else -1.0
            if not ratio >= 0.25:
                radius = 0.25 * min(norm, radius)
            elif ratio > 0.75 and norm > 0.8 * radius:
                radius *= 2.0
        if better:
            value, shares = trial_value, trial_shares
            accept_trial(work, theta, g, h)
        elif norm == 0.0:
            return value, False, tried, shares / targets
        if not math.isfinite(value):
            return value, False, tried, shares / targets
        decrement = newton_decrement(work, g, h)
        if decrement <= tolerance:
            return value, True, tried, shares / targets
        norm = math.sqrt(inner_product(step, step, scale))
        if norm <= radius and decrement < np.inf:
            decrease = 0.5 * decrement
        else:
            decrease = trust_region_step(h, g, scale, radius, batch.planar, work.vectors, step)
            norm = math.sqrt(inner_product(step, step, scale))
        for j in range(3):
            trial[j] = theta[j] + step[j]
    return value, False, max_iterations, shares / targets
