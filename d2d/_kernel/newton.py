"""Newton's method in a trust region, for three parameters."""

import math

from d2d._kernel.compiling import compiled

# A pivot of the Hessian below this part of its diagonal counts as zero: a motion that the targets
# do not determine leaves pivots of rounding errors and of the residual gradient there.
SINGULAR = 1e-8


@compiled
def shifted_solve(h, g, shift, scale, step):
    """Solve (H + shift diag(scale)) step = -g by L D L'.

    Returns whether the matrix is positive definite, and -1/2 d(|step|^2)/d(shift) in the scaled
    norm, which the search for the shift needs.
    """
    d0 = h[0, 0] + shift * scale[0]
    d1 = h[1, 1] + shift * scale[1]
    d2 = h[2, 2] + shift * scale[2]
    floor0, floor1, floor2 = (
        SINGULAR * abs(h[0, 0]),
        SINGULAR * abs(h[1, 1]),
        SINGULAR * abs(h[2, 2]),
    )
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
    direction, right, along, forward, backward = (
        vectors[0],
        vectors[1],
        vectors[2],
        vectors[3],
        vectors[4],
    )
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
