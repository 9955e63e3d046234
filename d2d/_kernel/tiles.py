"""The corrupted Gaussian's density of a large set, as polynomials on tiles.

With one covariance S_o for all components their sum is a smooth field of the fixed set alone,
f(u) = sum_i w_i exp(-|u - u_i|^2 / 2) in coordinates u in which S_o is the identity.  Each square
tile of two standard deviations holds the polynomial through NODES x NODES Chebyshev nodes, so that
a value costs the same for any number of components.

The nth derivative of exp(-u^2 / 2) is at most 1.09 (n!)^(1/2) exp(-u^2 / 4) (Cramér), so that an
interpolant along one coordinate errs by at most 1.09 exp(-u^2 / 4) / (n!^(1/2) 2^(n-1)) on a tile
of half width 1, here 7.3e-12, and one along both by 3.73 times as much (one plus the Lebesgue
constant).  A tile states its bound, the sum of these over the components at their distances from
the tile; where that is above ACCURACY of the value, or outside all tiles, the plain sum counts.
"""

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from d2d._kernel import layout, rows
from d2d._kernel.compile import inlined, vectorised
from d2d._kernel.layout import WEIGHT, X, Y
from d2d._kernel.rows import LANES, lane_count

NODES = 16
ACCURACY = 1e-9
_ERROR = 3.73 * 1.09 / (math.sqrt(math.factorial(NODES)) * 2.0 ** (NODES - 1))
BOUND = NODES * NODES  # behind a tile's coefficients: the least value for which they are used
TILE = BOUND + LANES

BORDER = 0.1  # at least, by which the tiles reach beyond a set, in tiles
# Columns of a grid of tiles: number of tiles along both coordinates, and where the first begins.
COLUMNS, ROWS, LEFT, BOTTOM, FIRST_TILE = range(5)

_AT = np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES)
# From values at the nodes to the coefficients of a polynomial, lowest power first.
_FIT = 2.0 / NODES * np.cos(np.pi * np.outer(np.arange(NODES), np.arange(NODES) + 0.5) / NODES)
_FIT[0] *= 0.5
_COEFFICIENTS = np.transpose([chebyshev.cheb2poly(column) for column in _FIT.T])


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


def tiles_of(sets: NDArray[Any], outlier: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """The tiles (T, TILE) of some packed sets (B, 6, N), and their grids (B, 5).

    A set has none if they were more than half of its components: the plain sums take less then.
    """
    size, (xx, xy, yy) = sets.shape[-1], root_of(outlier)
    grids, filled = np.zeros((len(sets), 5)), [np.empty((0, TILE))]
    places = np.stack([xx * sets[:, X] + xy * sets[:, Y], yy * sets[:, Y]], axis=1)
    low, high = places.min(axis=-1), places.max(axis=-1)
    shape = np.ceil(0.5 * (high - low) + BORDER)
    corner = 0.5 * (low + high) - shape
    for b in np.flatnonzero(2 * shape.prod(axis=-1) <= size):
        grids[b] = *shape[b], *corner[b], sum(map(len, filled))
        filled.append(_filled(places[b], sets[b, WEIGHT], shape[b].astype(int), corner[b]))
    return np.concatenate(filled), grids


def _filled(
    places: NDArray[Any], weights: NDArray[Any], shape: NDArray[Any], corner: NDArray[Any]
) -> NDArray[Any]:
    """The tiles (T, TILE) of one set with components at ``places`` (2, N), row by row."""
    factors, bounds = [], []
    for line, count, begin in zip(places, shape, corner, strict=True):
        away = begin + 1.0 + 2.0 * np.arange(count)[:, None] - line  # of the tiles' centres
        factor = away[:, None] + _AT[:, None]
        factor *= factor  # in place: new memory would take longer than the numbers
        factor *= -0.5
        factors.append((_COEFFICIENTS @ np.exp(factor, out=factor)).reshape(-1, len(weights)))
        bounds.append(np.exp(-0.25 * np.clip(np.abs(away) - 1.0, 0.0, None) ** 2))
    across, along = factors  # (tiles NODES, N)
    along *= weights
    values = (along @ across.T).reshape(shape[1], NODES, shape[0], NODES)
    tiles = np.empty((int(shape.prod()), TILE))
    tiles[:, :BOUND] = values.swapaxes(1, 2).reshape(-1, BOUND)
    tiles[:, BOUND] = _ERROR / ACCURACY * ((bounds[1] * weights) @ bounds[0].T).ravel()
    return tiles
