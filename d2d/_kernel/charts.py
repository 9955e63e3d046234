"""Coordinates of a motion of the plane: itself, its twist, or the velocity that causes it.

A chart maps three coordinates to three others, with the Jacobian [[a, b, c], [-b, a, d], [0, 0, 1]]
and the second derivatives that both SE(2) maps have.  `d2d.rigid` is their public face.
"""

import math
from typing import NamedTuple

from d2d._kernel.compile import compiled, inlined

# Below these angles (rad) the closed forms cancel, and the series are exact to rounding.
SERIES, LOGARITHM_SERIES = 0.3, 0.05
# The coefficients i^k / (k + 1)! of the exponential's series, the highest first.
_MEAN = [1j**k / math.factorial(k + 1) for k in range(12, -1, -1)]
EVEN, ODD = tuple(c.real for c in _MEAN), tuple(c.imag for c in _MEAN)


class Chart(NamedTuple):
    """The image (x, y, phi) of a point, and the derivatives there.

    ``a1`` and ``b1`` are those of ``a`` and ``b`` along the third coordinate, ``(e, f)`` the second
    derivative of (x, y) along it.
    """

    x: float
    y: float
    phi: float
    a: float
    b: float
    c: float
    d: float
    a1: float
    b1: float
    e: float
    f: float


@inlined
def identity_chart(theta):
    """The motion's own parameters."""
    return Chart(theta[0], theta[1], theta[2], 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@inlined
def centred_chart(theta, a, b):
    """The motion between two sets taken about their centres a and b: [t + R b - a, phi]."""
    cosine, sine = math.cos(theta[2]), math.sin(theta[2])
    x, y = cosine * b[0] - sine * b[1], sine * b[0] + cosine * b[1]
    return Chart(
        theta[0] + (x - a[0]), theta[1] + (y - a[1]), theta[2], 1.0, 0.0, -y, x, 0.0, 0.0, -x, -y
    )


@inlined
def logarithm_chart(theta):
    """The twist of a motion: (a x + b y, a y - b x, phi) with b = phi / 2 and a = b cot b."""
    x, y, phi = theta[0], theta[1], theta[2]
    beta = 0.5 * phi
    if abs(phi) < LOGARITHM_SERIES:
        s = phi * phi
        a = 1.0 - s * (1.0 / 12.0 + s * (1.0 / 720.0 + s / 30240.0))
        a1 = -phi * (1.0 / 6.0 + s * (1.0 / 180.0 + s / 5040.0))
        a2 = -(1.0 / 6.0 + s * (1.0 / 60.0 + s / 1008.0))
    else:
        sine, tangent = math.sin(beta), math.tan(beta)
        a = beta / tangent
        a1 = 0.5 * (1.0 / tangent - beta / (sine * sine))
        a2 = 0.5 * (a - 1.0) / (sine * sine)
    c, d = a1 * x + 0.5 * y, a1 * y - 0.5 * x
    return Chart(a * x + beta * y, a * y - beta * x, phi, a, beta, c, d, a1, 0.5, a2 * x, a2 * y)


@compiled
def exponential_chart(x, y, w):
    """The motion of a twist, E(w) (x + iy) and w, with the plane's vectors as complex numbers.

    E(w) = (exp(iw) - 1) / (iw) is the mean direction while turning by w: ``p + iq`` below, with its
    derivatives ``p1 + i q1`` and ``p2 + i q2``.
    """
    p, q, p1, q1, p2, q2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if abs(w) < SERIES:  # sum_k (iw)^k / (k + 1)!, by Horner's rule
        for k in range(len(EVEN)):
            p2, q2 = p2 * w + 2.0 * p1, q2 * w + 2.0 * q1
            p1, q1 = p1 * w + p, q1 * w + q
            p, q = p * w + EVEN[k], q * w + ODD[k]
    else:
        cosine, sine = math.cos(w), math.sin(w)
        p, q = sine / w, (1.0 - cosine) / w
        p1, q1 = (cosine - p) / w, (sine - q) / w
        p2, q2 = (-sine - 2.0 * p1) / w, (cosine - 2.0 * q1) / w
    c, d, e, f = p1 * x - q1 * y, p1 * y + q1 * x, p2 * x - q2 * y, p2 * y + q2 * x
    return Chart(p * x - q * y, p * y + q * x, w, p, -q, c, d, p1, -q1, e, f)


@compiled
def write_chart(chart, image, first, second):
    """Write the image (3), its first (3, 3) and its second derivatives (3, 3, 3)."""
    image[0], image[1], image[2] = chart.x, chart.y, chart.phi
    first[0, 0], first[0, 1], first[0, 2] = chart.a, chart.b, chart.c
    first[1, 0], first[1, 1], first[1, 2] = -chart.b, chart.a, chart.d
    first[2, 0], first[2, 1], first[2, 2] = 0.0, 0.0, 1.0
    second[:, :, :] = 0.0
    second[0, 0, 2] = second[0, 2, 0] = second[1, 1, 2] = second[1, 2, 1] = chart.a1
    second[0, 1, 2] = second[0, 2, 1] = chart.b1
    second[1, 0, 2] = second[1, 2, 0] = -chart.b1
    second[0, 2, 2], second[1, 2, 2] = chart.e, chart.f
