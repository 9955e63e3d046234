"""The minimum of a cost of three parameters, by Newton's method in a trust region."""

import math

import numpy as np

from d2d._kernel import layout
from d2d._kernel.compile import compiled, inlined
from d2d._kernel.cost import evaluate, pair_at
from d2d._kernel.layout import XX, YY, Accuracy, X, Y
from d2d._kernel.neighbours import forget_neighbours
from d2d._kernel.rows import LANES

# A pivot of the Hessian below this part of its diagonal counts as zero: a motion that the targets
# do not determine leaves pivots of rounding errors and of the residual gradient there.
SINGULAR = 1e-8
# A curvature below this part of the largest leaves its direction undetermined, if none is negative.
FLAT = 1e-6
NOISE = 1e-13  # error of a curvature, relative to the largest
ROUNDING = 2e-15  # error of a cost, relative to its size plus the number of targets
RESOLVED = 1e-8  # Newton decrement: 1e-4 standard deviations from the optimum

# With more than FEW components the first steps are rough: less of a target's density counts, so
# that it has half the neighbours.  They end where a step would lower the cost by less than NEAR,
# about 0.1 standard deviations from the optimum, or after MOST_ROUGH.  The sum, flat along valleys
# that little can turn, has none; nor has a problem with measurements, which takes few steps.
FEW, NEAR, MOST_ROUGH = 64, 1e-2, 8
# Of a large moving set, SAMPLE blocks of targets or some more, spread over all of it, are enough
# until a step lowers their cost by less than NEAR_SAMPLE: the truth is as near their own optimum.
SAMPLE, NEAR_SAMPLE = 20, 6.0
# Targets hardly move any more in the steps that follow rough ones.  1e-13 of a density is enough
# there: the lists would be a tenth longer otherwise.
ROUGH, EXACT, LAST = Accuracy(6.0, 1.0, 1), Accuracy(layout.GATE, 1.0, 1), Accuracy(30.0, 0.2, 1)


@inlined
def shifted_solve(h, g, shift, scale, step):
    """Solve (H + shift diag(scale)) step = -g by L D L'.

    Returns whether the matrix is positive definite, and -1/2 d(|step|^2)/d(shift) in the scaled
    norm, which the search for the shift needs.  A rotation of targets on one spot has a curvature
    of rounding errors only; so it must show beside that of the displacement which it causes.
    """
    d0 = h[0, 0] + shift * scale[0]
    d1 = h[1, 1] + shift * scale[1]
    d2 = h[2, 2] + shift * scale[2]
    floor0 = SINGULAR * abs(h[0, 0]) + NOISE * abs(h[1, 1])
    floor1 = SINGULAR * abs(h[1, 1]) + NOISE * abs(h[0, 0])
    floor2 = SINGULAR * (abs(h[2, 2]) + scale[2] * abs(h[0, 0] + h[1, 1]))
    if not d0 > floor0:
        return False, 0.0
    l10, l20 = h[1, 0] / d0, h[2, 0] / d0
    d1 -= l10 * h[1, 0]
    if not d1 > floor1:
        return False, 0.0
    e21 = h[2, 1] - l20 * h[1, 0]
    l21 = e21 / d1
    d2 -= l20 * h[2, 0] + l21 * e21
    if not d2 > floor2:
        return False, 0.0
    y0 = -g[0]
    y1 = -g[1] - l10 * y0
    y2 = -g[2] - l20 * y0 - l21 * y1
    s2 = y2 / d2
    s1 = y1 / d1 - l21 * s2
    s0 = y0 / d0 - l10 * s1 - l20 * s2
    step[0], step[1], step[2] = s0, s1, s2
    # the derivative is step' W (H + shift W)^-1 W step with W = diag(scale): the squared norm of
    # z = L^-1 W step, weighted by the inverse pivots
    z0 = scale[0] * s0
    z1 = scale[1] * s1 - l10 * z0
    z2 = scale[2] * s2 - l20 * z0 - l21 * z1
    return True, z0 * z0 / d0 + z1 * z1 / d1 + z2 * z2 / d2


@compiled
def invert(h, unit, column, inverse):
    """Inverse of a positive definite matrix, column by column; exactly symmetric."""
    unit[0] = unit[1] = unit[2] = 0.0
    for j in range(3):
        unit[j] = -1.0
        shifted_solve(h, unit, 0.0, unit, column)
        unit[j] = 0.0
        for i in range(j, 3):
            inverse[i, j] = inverse[j, i] = column[i]


@compiled
def decrease(h, g, step):
    """Decrease -g' step - step' H step / 2 of the quadratic model."""
    total = 0.0
    for i in range(3):
        row = g[i]
        for j in range(3):
            row += 0.5 * h[i, j] * step[j]
        total -= step[i] * row
    return total


@compiled
def inner_product(a, b, scale):
    """a' diag(scale) b."""
    return a[0] * scale[0] * b[0] + a[1] * scale[1] * b[1] + a[2] * scale[2] * b[2]


@compiled
def step_to_boundary(h, g, shift, scale, radius, vectors, step):
    """The hard case of an indefinite Hessian: the gradient misses its lowest eigenvector.

    Then the step ends within the radius, however close the shift comes to that eigenvalue.  Moving
    on along the eigenvector lowers the model further.  The nearly singular system amplifies it in
    any right-hand side, here in ``vectors[0]``, a generic direction.
    """
    direction, right, along = vectors[0], vectors[1], vectors[2]
    forward, backward = vectors[3], vectors[4]
    definite, _ = shifted_solve(h, g, 0.0, scale, along)
    norm = math.sqrt(inner_product(step, step, scale))
    if definite or norm >= 0.9 * radius:
        return
    for i in range(3):
        right[i] = direction[i] * math.sqrt(scale[i])
    solved, _ = shifted_solve(h, right, shift, scale, along)
    if not solved:
        return
    size = math.sqrt(inner_product(along, along, scale))
    along_step = inner_product(along, step, scale) / size
    root = math.sqrt(along_step * along_step + radius * radius - norm * norm)
    for i in range(3):
        forward[i] = step[i] + (root - along_step) / size * along[i]
        backward[i] = step[i] - (root + along_step) / size * along[i]
    best = forward if decrease(h, g, forward) > decrease(h, g, backward) else backward
    for i in range(3):
        step[i] = best[i]


@compiled
def trust_region_step(h, g, scale, radius, planar, vectors, step):
    """Minimise the quadratic model within the radius (Moré & Sorensen 1983); return its decrease.

    The shift of the Hessian is bracketed by Gershgorin circles and found by Newton's method on
    1/|step|.  A step length within a tenth of the radius is all that a trust region needs.
    """
    step[0] = step[1] = step[2] = 0.0
    norm_g = math.sqrt(g[0] * g[0] / scale[0] + g[1] * g[1] / scale[1] + g[2] * g[2] / scale[2])
    low, high = 0.0, 0.0
    for i in range(3):
        off = 0.0
        for j in range(3):
            if j != i:
                off += abs(h[i, j]) / math.sqrt(scale[i] * scale[j])
        diagonal = h[i, i] / scale[i]
        low = max(low, -diagonal)
        high = max(high, abs(diagonal) + off)
    high += norm_g / radius
    shift = 0.0 if low == 0.0 else low + 1e-3 * (high - low)
    for _ in range(60):
        definite, slope = shifted_solve(h, g, shift, scale, step)
        if not definite:
            low = shift
            shift = max(0.5 * (low + high), 1e-3 * high) if low == 0.0 else 0.5 * (low + high)
            continue
        norm = math.sqrt(inner_product(step, step, scale))
        if abs(norm - radius) <= 0.1 * radius or (norm < radius and shift == 0.0):
            break
        if norm > radius:
            low = shift
        else:
            high = shift
        if high - low <= 1e-10 * high:
            break
        newton = shift + (norm - radius) / radius * norm * norm / slope if slope > 0.0 else low
        shift = newton if low < newton < high else 0.5 * (low + high)
    if not definite:
        shifted_solve(h, g, high, scale, step)
    # generic, so that it is not orthogonal to the lowest eigenvector
    vectors[0, 0], vectors[0, 1], vectors[0, 2] = 1.0, 0.7 * planar, 0.4 * planar
    step_to_boundary(h, g, high, scale, radius, vectors, step)
    return decrease(h, g, step)


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
        x, y = moving[X, k] + pair.moving_centre[0], moving[Y, k] + pair.moving_centre[1]
        lever += (x * x + y * y) / moving.shape[1]
    scale[0] = scale[1] = 1.0
    scale[2] = max(lever, variance) if planar else 1.0
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
    """The Newton step, to ``work.step``, g' H^-1 g, and whether a direction is not determined.

    Then the step is the smallest: a shift that others hardly feel keeps it at zero along such a
    direction.  The decrement is infinite where a curvature is negative.
    """
    step, scale = work.step, work.scale
    definite, _ = shifted_solve(h, g, 0.0, scale, step)
    flat = False
    if not definite:
        shift = FLAT * max(max(h[0, 0], h[1, 1]), h[2, 2] / scale[2])
        flat, _ = shifted_solve(h, g, shift, scale, step)
    decrement = -(g[0] * step[0] + g[1] * step[1] + g[2] * step[2])
    return (decrement if definite or flat else np.inf), flat


@inlined
def moving_targets(batch, problem):
    """Number of moving targets in all pairs of a problem."""
    targets = 0
    for number in range(batch.first[problem], batch.first[problem + 1]):
        targets += batch.pairs[number, layout.MOVING_SIZE]
    return targets


@inlined
def minimise(batch, problem, theta, tolerance, max_iterations, work, g, h):
    """Newton's method in a trust region, in place.

    Returns value, convergence, iterations, sums of shares and distances, and whether undetermined.

    A step is accepted only if it lowers the cost; only the one after rough steps always is.
    Converged means that the Hessian is positive definite and the Newton decrement g' H^-1 g, the
    squared distance to the optimum in estimated standard deviations, is below the tolerance.

    Where the cost is large, its rounding exceeds what a step gains and cannot tell whether the step
    was good.  Then a step is accepted if it lowers the decrement, and one below RESOLVED is enough.
    """
    pair = pair_at(batch, batch.first[problem], 0.0 if batch.centred else 1.0)
    step, scale, trial = work.step, work.scale, work.trial
    radius = first_radius(pair, scale)
    if batch.kind != layout.MOTION:
        radius /= batch.intervals[batch.first[problem]]
    targets = moving_targets(batch, problem)
    for j in range(3):
        trial[j] = theta[j]
    forget_neighbours(work.memory.lists)
    plain = batch.fusion == layout.LIKELIHOOD and pair.factors.shape[0] == 0
    plain = plain and (batch.centred or batch.kind != layout.MOTION)  # valleys need exact steps
    rough = plain and pair.fixed.shape[1] > FEW and max_iterations > MOST_ROUGH + 1
    every = max(1, pair.moving.shape[1] // (SAMPLE * LANES)) if rough else 1
    accuracy = Accuracy(ROUGH.gate, ROUGH.margin, every) if rough else EXACT
    # the start is the first trial: a second call of `evaluate` would be compiled a second time
    value, shares, distances, flat = np.inf, 0.0, 0.0, False
    decrement, decrease, norm = np.inf, np.inf, np.inf
    for tried in range(max_iterations + 1):
        trial_value, trial_shares, trial_distances = evaluate(
            batch, problem, pair, trial, accuracy, work, work.trial_gradient, work.trial_hessian
        )
        gain = value - trial_value
        better = gain > 0.0 or tried == 0
        if not better and not rough and decrease <= ROUNDING * (abs(value) + targets):
            after, _ = newton_decrement(work, work.trial_gradient, work.trial_hessian)
            nearer = after < 0.25 * decrement < np.inf
            if decrement <= RESOLVED or not nearer:
                found = decrement <= RESOLVED
                return value, found and not flat, tried, shares, distances, found and flat
            better = True
        elif tried > 0:
            ratio = gain / decrease if decrease > 0.0 else -1.0
            if not ratio >= 0.25:
                radius = 0.25 * min(norm, radius)
            elif ratio > 0.75 and norm > 0.8 * radius:
                radius *= 2.0
        if better:
            value, shares, distances = trial_value, trial_shares, trial_distances
            accept_trial(work, theta, g, h)
        elif norm == 0.0:
            return value, False, tried, shares, distances, False
        if not math.isfinite(value):
            return value, False, tried, shares, distances, False
        decrement, flat = newton_decrement(work, g, h)
        if decrement <= tolerance and not rough:
            return value, not flat, tried, shares, distances, flat
        if tried == max_iterations:
            break
        norm = math.sqrt(inner_product(step, step, scale))
        if norm <= radius and decrement < np.inf:
            decrease = 0.5 * decrement
        else:
            decrease = trust_region_step(h, g, scale, radius, batch.planar, work.vectors, step)
            norm = math.sqrt(inner_product(step, step, scale))
        near = NEAR_SAMPLE if every > 1 else NEAR
        ends = rough and (decrease <= near or tried >= MOST_ROUGH)
        for j in range(3):  # a start near the optimum of the sample is kept
            trial[j] = theta[j] if ends and every > 1 and tried == 0 else theta[j] + step[j]
        if ends:
            value = np.inf  # the next cost is not to be compared with rough ones
            if every > 1:
                every, accuracy = 1, ROUGH
            else:
                rough, accuracy = False, LAST
                forget_neighbours(work.memory.lists)
    return value, False, max_iterations, shares, distances, False
