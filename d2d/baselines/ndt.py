"""The normal distributions transform (NDT) of a planar scan, and registration on it.

A scan becomes the Gaussians of the cells of a grid, a `PointSet`; the two ways to register with it
are then `RegistrationCost` with ``fusion="summing"`` on such sets.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from d2d import gaussian
from d2d._checks import Array, count, finite, fraction, positive, scalar
from d2d.cost import RegistrationCost
from d2d.point_set import PointSet
from d2d.registration import Estimate, register

CELL_SIZE = 1.0  # m
FEWEST_POINTS = 3  # that determine a covariance in the plane (Biber & Strasser 2003, sec. III)
SMALLEST_RATIO = 1e-3  # of a cell's eigenvalues (Biber & Strasser 2003, sec. III)
FOUR_GRIDS = ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5))  # shifts in cells
_MOST_CELLS = 2**53  # from the origin: beyond, float64 skips whole cells
D2 = 0.05  # the factor of the exponent that public implementations of D2D-NDT use

P2D = RegistrationCost(metric="p2d", fusion="summing")
D2D = RegistrationCost(metric="d2d", fusion="summing")


def grid_cells(
    points: ArrayLike,
    size: float = CELL_SIZE,
    shift: Sequence[float] = (0.0, 0.0),
    *,
    fewest: int = FEWEST_POINTS,
    smallest_ratio: float = SMALLEST_RATIO,
) -> PointSet:
    """One Gaussian for every cell of a grid that holds enough points (thesis eq. 3.4, 3.5).

    Parameters
    ----------
    points : (N, 2) array, m
    size : float, m
        Side of the square cells.
    shift : pair of float
        Of the grid's origin, in cells.
    fewest : int
        Cells with fewer points are left out.
    smallest_ratio : float within (0, 1]
        The smaller eigenvalue of a cell's covariance is raised to this share of the larger, so
        that points on a line do not make it singular.

    Returns
    -------
    PointSet
        In the order of the cells' columns and rows. Weighted by sqrt(det(2 pi Sigma)): each
        component then peaks at 1, as the score of Biber & Strasser does.

    Raises
    ------
    ValueError
        Naming the argument; also if no cell holds enough points.
    """
    return _weighted(*_cells(_checked(points), size, shift, fewest, smallest_ratio))


def pooled_cells(
    points: ArrayLike,
    size: float = CELL_SIZE,
    shifts: Sequence[Sequence[float]] = FOUR_GRIDS,
    *,
    fewest: int = FEWEST_POINTS,
    smallest_ratio: float = SMALLEST_RATIO,
) -> PointSet:
    """The cells of several shifted grids together: every point counts in each of the grids.

    Four grids, shifted by half a cell, smooth the jumps of the score at the cells' borders
    (Biber & Strasser 2003, sec. III).

    Parameters
    ----------
    points, size, fewest, smallest_ratio
        As for `grid_cells`.
    shifts : sequence of pairs
        Of each grid's origin, in cells.

    Returns
    -------
    PointSet
        The cells of one grid after those of the other, weighted as by `grid_cells`.

    Raises
    ------
    ValueError
        Naming the argument; also if no cell of a grid holds enough points.
    """
    cloud = _checked(points)
    offsets = finite("shifts", shifts)
    if offsets.ndim != 2 or not len(offsets) or offsets.shape[1] != 2:
        raise ValueError(f"shifts must be one or more pairs, but has the shape {offsets.shape}")
    grids = [_cells(cloud, size, shift, fewest, smallest_ratio) for shift in offsets]
    return _weighted(
        np.concatenate([means for means, _ in grids]),
        np.concatenate([covariances for _, covariances in grids]),
    )


def ndt_p2d(
    fixed: ArrayLike,
    moving: ArrayLike,
    initial: ArrayLike | None = None,
    *,
    size: float = CELL_SIZE,
    shifts: Sequence[Sequence[float]] = FOUR_GRIDS,
) -> Estimate:
    """Register points to the NDT of the fixed ones (Biber & Strasser 2003; thesis eq. 3.6, 3.7).

    Maximises sum_k sum_i exp(-1/2 d_ki' Sigma_i^-1 d_ki) over the motion, d_ki = T(m_k) - mu_i, by
    Newton's method on its negative logarithm.  The sum goes over all cells, where the paper takes
    the cell that T(m_k) lies in: without that cut the score is smooth and has exact derivatives.

    Parameters
    ----------
    fixed, moving : (N, 2) and (M, 2) arrays, m
    initial : (..., 3) array, optional
        Where to start, m, m, rad; a batch runs as one. Zeros unless given.
    size : float, m
    shifts : sequence of pairs
        Of the grids, in cells.

    Returns
    -------
    Estimate
        Its ``covariance`` is the inverse Hessian of the score's logarithm, which is not the
        covariance of the error: the score is no likelihood.

    Raises
    ------
    ValueError
        Naming the argument that does not fit.
    """
    cells = pooled_cells(_checked(fixed, "fixed"), size, shifts)
    return register(cells, bare_points(_checked(moving, "moving")), P2D, initial)


def ndt_d2d(
    fixed: ArrayLike,
    moving: ArrayLike,
    initial: ArrayLike | None = None,
    *,
    size: float = CELL_SIZE,
    d2: float = D2,
) -> Estimate:
    """Register the NDT of the moving points to that of the fixed (Stoyanov et al. 2012).

    Maximises sum_k sum_i N(0 | d_ki, S_ki / d2), S_ki = R Sigma_k R' + Sigma_i: the inner product
    of the two mixtures, the only part of the L2 distance that the motion changes.  ``d2`` below 1
    widens every pair alike; public implementations take 0.05, and leave out the normalisation of
    the densities, which is kept here because it belongs to the inner product.  Each scan has a
    single grid of its own, without shifts.

    Parameters
    ----------
    fixed, moving, initial, size
        As for `ndt_p2d`.
    d2 : float within (0, 1]
        Variances are divided by it.

    Returns
    -------
    Estimate
        Its ``covariance`` is not that of the error, as with `ndt_p2d`.

    Raises
    ------
    ValueError
        Naming the argument that does not fit.
    """
    if fraction("d2", d2) == 0.0:
        raise ValueError("d2 must be positive, but is 0")
    sets = (
        grid_cells(_checked(cloud, name), size)
        for name, cloud in (("fixed", fixed), ("moving", moving))
    )
    target, source = (_equally_weighted(cells) for cells in sets)
    width = (1.0 / d2) ** 0.5
    return register(target.inflated(width), source.inflated(width), D2D, initial)


def bare_points(points: ArrayLike) -> PointSet:
    """Points (N, 2) as the moving set of a P2D cost, which never reads its covariances."""
    cloud = _checked(points)
    return PointSet(cloud, np.broadcast_to(np.eye(2), (len(cloud), 2, 2)))


def _cells(
    points: Array, size: float, shift: ArrayLike, fewest: int, smallest_ratio: float
) -> tuple[Array, Array]:
    side = float(positive("size", scalar("size", size)))
    offset = finite("shift", shift)
    if offset.shape != (2,):
        raise ValueError(f"shift must be a pair, but has the shape {offset.shape}")
    if count("fewest", fewest) < 2:
        raise ValueError(f"fewest must be at least 2, but is {fewest}")
    if fraction("smallest_ratio", smallest_ratio) == 0.0:
        raise ValueError("smallest_ratio must be positive, but is 0")
    place = np.floor(points / side - offset)
    if np.abs(place).max() > _MOST_CELLS:
        raise ValueError(f"size must not be so small beside the points' distance, but is {side:g}")
    place = place.astype(np.int64)
    _, cell, counts = np.unique(place, axis=0, return_inverse=True, return_counts=True)
    member = cell.ravel() == np.arange(len(counts))[:, None]  # (cells, N)
    member = member[counts >= fewest]
    # points that all coincide have no extent in any direction, and so no covariance to raise
    fitted = [gaussian.fit(points[inside]) for inside in member]
    fitted = [(mean, sigma) for mean, sigma in fitted if np.trace(sigma) > 1e-18 * side**2]
    if not fitted:
        raise ValueError(
            f"points must fill a cell of {side:g} m with {fewest} or more, but none has as many"
        )
    means = np.stack([mean for mean, _ in fitted])
    covariances = np.stack([sigma for _, sigma in fitted])
    return means, gaussian.raise_eigenvalues(covariances, smallest_ratio=smallest_ratio)


def _weighted(means: Array, covariances: Array) -> PointSet:
    return PointSet(means, covariances, 2.0 * np.pi * np.sqrt(np.linalg.det(covariances)))


def _equally_weighted(cells: PointSet) -> PointSet:
    return PointSet(cells.means, cells.covariances)


def _checked(points: ArrayLike, name: str = "points") -> Array:
    array = finite(name, points)
    if array.ndim != 2 or array.shape[1] != 2 or not array.size:
        raise ValueError(f"{name} must have the shape (N, 2) with N > 0, but has {array.shape}")
    return array
