"""The corrupted Gaussian's density of a large set, as polynomials on tiles.

With one covariance S_o for all components their sum is a smooth field of the fixed set alone,
f(u) = sum_i w_i exp(-|u - u_i|^2 / 2) in coordinates u in which S_o is the identity.  Each square
tile of two standard deviations holds the polynomial through NODES x NODES Chebyshev nodes.

A tile states a bound of its error (see ARCHITECTURE.md); where that is above ACCURACY of the value,
or outside all tiles, the plain sum counts.
"""

import math
from functools import cache
from itertools import zip_longest
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from d2d._kernel import layout, rows
from d2d._kernel.compile import entry, inlined, vectorised
from d2d._kernel.elementary import exp
from d2d._kernel.layout import WEIGHT, X, Y
from d2d._kernel.rows import LANES, lane_count

NODES = 16
ACCURACY, LEAST = 1e-9, 1e-280  # of a value from tiles: `exp` ends at 1e-304
_ERROR = 3.73 * 1.09 / (math.sqrt(math.factorial(NODES)) * 2.0 ** (NODES - 1))
BOUND = NODES * NODES  # behind a tile's coefficients: the least value for which they are used
TILE = BOUND + LANES

BORDER = 0.1  # at least, by which the tiles reach beyond a set, in tiles
# Columns of a grid of tiles: number of tiles along both coordinates, and where the first begins.
COLUMNS, ROWS, LEFT, BOTTOM, FIRST_TILE = range(5)

_AT = np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES)
# From values at the nodes to coefficients of Chebyshev's polynomials, and from these to powers.
_FIT = np.linalg.inv(chebyshev.chebvander(_AT, NODES - 1))
_POWERS = np.array([*zip_longest(*map(chebyshev.cheb2poly, np.eye(NODES)), fillvalue=0.0)])


@inlined
def root_of(outlier):
    """The upper triangular U with the precision U' U: xx, xy, yy."""
    xx = math.sqrt(outlier[layout.PRECISION_XX])
    xy = outlier[layout.PRECISION_XY] / xx
    return xx, xy, math.sqrt(outlier[layout.PRECISION_YY] - xy * xy)


@vectorised
def sum_rows(powers, tile, v, nodes):
    """The polynomial of each power of u, at v, with first and half the second derivative."""
    for j in range(nodes):
        value = first = second = 0.0
        for n in range(NODES - 1, -1, -1):
            second = second * v + first
            first = first * v + value
            value = value * v + tile[n * NODES + j]
        powers[j] = value
        powers[NODES + j] = first
        powers[2 * NODES + j] = second


@vectorised
def sum_columns(w, root):
    """A field's value and derivatives at a block's positions, from what `sum_rows` leaves."""
    xx, xy, yy = root
    for k in range(lane_count(w)):
        at, u = rows.POLYNOMIAL + 3 * NODES * k, w[rows.WITHIN + k]
        f = fu = fuu = fv = fuv = fvv = 0.0
        for j in range(NODES - 1, -1, -1):
            fuu = fuu * u + fu
            fu = fu * u + f
            f = f * u + w[at + j]
            fuv = fuv * u + fv
            fv = fv * u + w[at + NODES + j]
            fvv = fvv * u + w[at + 2 * NODES + j]
        fuu, fvv = 2.0 * fuu, 2.0 * fvv
        w[rows.OUTLIER + k] = f
        w[rows.OUTLIER + rows.G0 + k] = xx * fu
        w[rows.OUTLIER + rows.G1 + k] = xy * fu + yy * fv
        w[rows.OUTLIER + rows.A00 + k] = xx * xx * fuu
        w[rows.OUTLIER + rows.A01 + k] = xx * (xy * fuu + yy * fuv)
        w[rows.OUTLIER + rows.A11 + k] = xy * (xy * fuu + 2.0 * yy * fuv) + yy * yy * fvv


@inlined
def interpolate(w, tiles, grid, root, setting):
    """A field's value and derivatives at the positions of a block, in the rows of OUTLIER.

    Returns whether all lie on the tiles, and are so large that the error does not matter.
    """
    xx, xy, yy = root
    width, height = int(grid[COLUMNS]), int(grid[ROWS])
    for k in range(LANES):
        x, y = w[rows.MX + k] + setting.x, w[rows.MY + k] + setting.y
        u, v = 0.5 * (xx * x + xy * y - grid[LEFT]), 0.5 * (yy * y - grid[BOTTOM])
        if not (0.0 <= u < width and 0.0 <= v < height):
            return False
        c, r = int(u), int(v)
        tile = tiles[r * width + c]
        w[rows.WITHIN + k], w[rows.NUMBER + k] = 2.0 * (u - c) - 1.0, tile[BOUND]
        begin = rows.POLYNOMIAL + 3 * NODES * k
        sum_rows(w[begin : begin + 3 * NODES], tile, 2.0 * (v - r) - 1.0, 2 * lane_count(w))
    sum_columns(w, root)
    enough = True
    for k in range(LANES):
        enough &= w[rows.OUTLIER + k] >= w[rows.NUMBER + k]
    return enough


@cache
def none_for(sets: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """No tiles (0, TILE) for so many sets, and their empty grids (B, 5)."""
    return np.empty((0, TILE)), np.zeros((sets, 5))


@entry
def fill_lines(places, weights, begin, nodes, inner, scale, lines):
    """Fill lines (tiles nodes, N) with w exp(scale u^2), u the distance beyond ``inner``."""
    for n in range(lines.shape[0]):
        at = begin + 1.0 + 2.0 * (n // nodes.shape[0]) + nodes[n % nodes.shape[0]]
        for i in range(places.shape[0]):
            u = max(abs(at - places[i]) - inner, 0.0)
            lines[n, i] = weights[i] * exp(scale * u * u)


def tiles_of(sets: NDArray[Any], outlier: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """The tiles (T, TILE) of some packed sets (B, 6, N), row by row, and their grids (B, 5).

    A set has none if they were more than half of its components: the plain sums take less then.
    """
    size, (xx, xy, yy) = sets.shape[-1], root_of(outlier)
    grids, filled = np.zeros((len(sets), 5)), [np.empty((0, TILE))]
    places = np.array([[xx, xy], [0.0, yy]]) @ sets[:, X : Y + 1]
    low, high = places.min(axis=-1), places.max(axis=-1)
    shape = np.ceil(0.5 * (high - low) + BORDER)
    corner = 0.5 * (low + high) - shape
    for b in np.flatnonzero(2 * shape.prod(axis=-1) <= size):
        (width, height), begins = shape[b].astype(int).tolist(), corner[b].tolist()
        grids[b] = width, height, *begins, sum(map(len, filled))
        factors = [np.empty((count * NODES, size)) for count in (width, height)]
        bounds = [np.empty((count, size)) for count in (width, height)]
        for line, weights in enumerate((np.ones(size), sets[b, WEIGHT])):
            own = places[b, line], weights, begins[line]
            fill_lines(*own, _AT, 0.0, -0.5, factors[line])
            fill_lines(*own, np.zeros(1), 1.0, -0.25, bounds[line])
        values = (factors[1] @ factors[0].T).reshape(height, NODES, width, NODES).swapaxes(1, 2)
        tiles = np.empty((height * width, TILE))
        tiles[:, :BOUND] = (_POWERS @ (_FIT @ values @ _FIT.T) @ _POWERS.T).reshape(-1, BOUND)
        tiles[:, BOUND] = np.maximum(_ERROR / ACCURACY * (bounds[1] @ bounds[0].T).ravel(), LEAST)
        filled.append(tiles)
    return np.concatenate(filled), grids
