"""The corrupted Gaussian's density of a large set, as polynomials on tiles.

With one covariance S_o for all components their sum is a smooth field of the fixed set alone,
f(u) = sum_i w_i exp(-|u - u_i|^2 / 2) in coordinates u in which S_o is the identity.  Where it is
asked for often, it is interpolated: each square tile of two standard deviations holds the
polynomial through NODES x NODES Chebyshev nodes, so that a value costs the same for any number of
components.

The nth derivative of exp(-u^2 / 2) is at most 1.09 (n!)^(1/2) exp(-u^2 / 4) (Cramér), so that an
interpolant along one coordinate errs by at most 1.09 exp(-u^2 / 4) / (n!^(1/2) 2^(n-1)) on a tile
of half width 1, here 7.3e-12, and one along both by 3.73 times as much (one plus the Lebesgue
constant).  A tile states its bound, the sum of these over the components at their distances from
the tile; where that is above ACCURACY of the value, or outside all tiles, the plain sum counts.
"""

import math
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from d2d._kernel import layout
from d2d._kernel.compile import entry, inlined, vectorised
from d2d._kernel.elementary import exp
from d2d._kernel.layout import (
    A00,
    A01,
    A11,
    G0,
    G1,
    LANES,
    MX,
    MY,
    OUTLIER,
    POLYNOMIAL,
    PRECISION_XX,
    PRECISION_XY,
    PRECISION_YY,
    WEIGHT,
    X,
    Y,
    lane_count,
)

NODES = 16
ACCURACY = 1e-9
_ERROR = 3.73 * 1.09 / (math.sqrt(math.factorial(NODES)) * 2.0 ** (NODES - 1))
BOUND = NODES * NODES  # behind a tile's coefficients: the least value for which they are used
TILE = BOUND + LANES
SOURCES = 8  # components that are added to a tile together

# Columns of a grid of tiles: number of tiles along both coordinates, and where the first begins.
COLUMNS, ROWS, LEFT, BOTTOM, FIRST_TILE = range(5)

_AT = np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES)
# From values at the nodes to the coefficients of a polynomial, lowest power first.
_FIT = 2.0 / NODES * np.cos(np.pi * np.outer(np.arange(NODES), np.arange(NODES) + 0.5) / NODES)
_FIT[0] *= 0.5
_POWERS = np.array(
    [
        np.pad(chebyshev.cheb2poly(np.eye(NODES)[n, : n + 1]), (0, NODES - 1 - n))
        for n in range(NODES)
    ]
)
_COEFFICIENTS = _POWERS.T @ _FIT
_TRANSPOSED = np.ascontiguousarray(_COEFFICIENTS.T)


@inlined
def root_of(outlier):
    """The upper triangular U with the precision U' U: xx, xy, yy."""
    xx = math.sqrt(outlier[PRECISION_XX])
    xy = outlier[PRECISION_XY] / xx
    return xx, xy, math.sqrt(outlier[PRECISION_YY] - xy * xy)


@entry
def lay_grid(points, outlier, grid):
    """Lay tiles over a set of components, with the margin that makes their number whole."""
    xx, xy, yy = root_of(outlier)
    low, high = np.inf, -np.inf
    bottom, top = np.inf, -np.inf
    for i in range(points.shape[1]):
        u, v = xx * points[X, i] + xy * points[Y, i], yy * points[Y, i]
        low, high = min(low, u), max(high, u)
        bottom, top = min(bottom, v), max(top, v)
    # at least a tenth of a standard deviation beyond the set
    grid[COLUMNS] = math.ceil(0.5 * (high - low) + 0.1)
    grid[ROWS] = math.ceil(0.5 * (top - bottom) + 0.1)
    grid[LEFT] = 0.5 * (low + high) - grid[COLUMNS]
    grid[BOTTOM] = 0.5 * (bottom + top) - grid[ROWS]


@vectorised
def place_sources(points, root, grid, first, across, along, nodes):
    """The factors of SOURCES components at the nodes of all columns and rows of tiles.

    Behind these lie the factors of their bounds.  ``nodes`` is NODES as a value that is known only
    at run time, see `lane_count`.
    """
    xx, xy, yy = root
    columns, rows = int(grid[COLUMNS]), int(grid[ROWS])
    for s in range(SOURCES):
        i = min(first + s, points.shape[1] - 1)
        weight = points[WEIGHT, i] if first + s < points.shape[1] else 0.0
        u, v = xx * points[X, i] + xy * points[Y, i], yy * points[Y, i]
        for c in range(columns):
            centre = grid[LEFT] + 2.0 * c + 1.0 - u
            for n in range(nodes):
                d = centre + _AT[n]
                across[s, c * NODES + n] = weight * exp(-0.5 * d * d)
            edge = max(abs(centre) - 1.0, 0.0)
            across[s, columns * NODES + c] = weight * math.exp(-0.25 * edge * edge)
        for r in range(rows):
            centre = grid[BOTTOM] + 2.0 * r + 1.0 - v
            for n in range(nodes):
                d = centre + _AT[n]
                along[s, r * NODES + n] = exp(-0.5 * d * d)
            edge = max(abs(centre) - 1.0, 0.0)
            along[s, rows * NODES + r] = math.exp(-0.25 * edge * edge)


@vectorised
def add_sources(tile, across, along, nodes):
    """Add SOURCES components to a tile's values at its nodes, row by row."""
    for b in range(nodes):
        for a in range(nodes):
            added = tile[b * NODES + a]
            for s in range(SOURCES):
                added += along[s, b] * across[s, a]
            tile[b * NODES + a] = added


@vectorised
def fit(tile, between, nodes):
    """From values at the nodes to coefficients of the powers of both coordinates."""
    for b in range(nodes):
        for a in range(nodes):
            total = 0.0
            for n in range(NODES):
                total += _COEFFICIENTS[b, n] * tile[n * NODES + a]
            between[b * NODES + a] = total
    for b in range(nodes):
        for a in range(nodes):
            total = 0.0
            for n in range(NODES):
                total += between[b * NODES + n] * _TRANSPOSED[n, a]
            tile[b * NODES + a] = total


@entry
def fill_tiles(points, outlier, grid, across, along, work, tiles):
    """Fill the tiles (rows * columns, TILE) of a grid; ``work`` is the scratch array."""
    root, nodes, between = root_of(outlier), 2 * lane_count(work), work[: NODES * NODES]
    columns, rows = int(grid[COLUMNS]), int(grid[ROWS])
    tiles[:] = 0.0
    for first in range(0, points.shape[1], SOURCES):
        place_sources(points, root, grid, first, across, along, nodes)
        for r in range(rows):
            own = along[:, r * NODES : (r + 1) * NODES]
            for c in range(columns):
                tile = tiles[r * columns + c]
                add_sources(tile, across[:, c * NODES : (c + 1) * NODES], own, nodes)
                for s in range(SOURCES):
                    bound = across[s, columns * NODES + c] * along[s, rows * NODES + r]
                    tile[BOUND] += _ERROR / ACCURACY * bound
    for t in range(tiles.shape[0]):
        fit(tiles[t], between, nodes)


@vectorised
def sum_rows(w, tile, v, nodes):
    """The polynomial of each power of u, at v, with first and half the second derivative."""
    for j in range(nodes):
        value = first = second = 0.0
        for n in range(NODES - 1, -1, -1):
            second = second * v + first
            first = first * v + value
            value = value * v + tile[n * NODES + j]
        w[POLYNOMIAL + j] = value
        w[POLYNOMIAL + NODES + j] = first
        w[POLYNOMIAL + 2 * NODES + j] = second


@inlined
def sum_columns(w, u):
    """f, its gradient and second derivatives at u, from what `sum_rows` leaves."""
    value = along_u = second_u = along_v = mixed = second_v = 0.0
    for j in range(NODES - 1, -1, -1):
        second_u = second_u * u + along_u
        along_u = along_u * u + value
        value = value * u + w[POLYNOMIAL + j]
        mixed = mixed * u + along_v
        along_v = along_v * u + w[POLYNOMIAL + NODES + j]
        second_v = second_v * u + w[POLYNOMIAL + 2 * NODES + j]
    return value, along_u, along_v, 2.0 * second_u, mixed, 2.0 * second_v


@inlined
def interpolate(w, tiles, grid, root, setting):
    """The field's value, and its derivatives over it, at a block's targets.

    Returns whether the tiles were enough; the rows are those of `densities.corrupted_jet`.
    """
    xx, xy, yy = root
    columns, rows = int(grid[COLUMNS]), int(grid[ROWS])
    for k in range(LANES):
        x, y = w[MX + k] + setting.x, w[MY + k] + setting.y
        u, v = 0.5 * (xx * x + xy * y - grid[LEFT]), 0.5 * (yy * y - grid[BOTTOM])
        if not (0.0 <= u < columns and 0.0 <= v < rows):
            return False
        c, r = int(u), int(v)
        tile = tiles[r * columns + c]
        sum_rows(w, tile, 2.0 * (v - r) - 1.0, 2 * lane_count(w))
        f, fu, fv, fuu, fuv, fvv = sum_columns(w, 2.0 * (u - c) - 1.0)
        if not f >= tile[BOUND]:
            return False
        inverse = 1.0 / f
        w[OUTLIER + k] = f
        w[OUTLIER + G0 + k] = xx * fu * inverse
        w[OUTLIER + G1 + k] = (xy * fu + yy * fv) * inverse
        w[OUTLIER + A00 + k] = xx * xx * fuu * inverse
        w[OUTLIER + A01 + k] = xx * (xy * fuu + yy * fuv) * inverse
        w[OUTLIER + A11 + k] = (xy * (xy * fuu + 2.0 * yy * fuv) + yy * yy * fvv) * inverse
    return True


def tiles_of(sets: NDArray[Any], outlier: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """The tiles (T, TILE) of some packed sets (B, 6, N), and their grids (B, 5).

    A set has none if more would be needed than it has components: the plain sum is faster then.
    """
    size = sets.shape[-1]
    grids, all_tiles, done = np.zeros((len(sets), 5)), [np.empty((0, TILE))], 0
    for points, grid in zip(sets, grids, strict=True):
        lay_grid(points, outlier, grid)
        columns, rows = grid[COLUMNS], grid[ROWS]
        if columns * rows > size:
            grid[:] = 0.0
            continue
        grid[FIRST_TILE] = done
        tiles = np.empty((int(columns * rows), TILE))
        across = np.empty((SOURCES, int(columns) * (NODES + 1)))
        along = np.empty((SOURCES, int(rows) * (NODES + 1)))
        fill_tiles(points, outlier, grid, across, along, layout.own_work(1, 1).scratch, tiles)
        all_tiles.append(tiles)
        done += len(tiles)
    return np.concatenate(all_tiles), grids
