"""The normal distributions transform (NDT) of a planar scan, and registration with it.

A scan becomes a `PointSet` with one Gaussian per grid cell.  Both ways to register such sets are
then a `RegistrationCost` with ``fusion="summing"``.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from d2d import gaussian
from d2d._checks import check_count, check_finite, check_fraction, check_positive_scalar
from d2d._types import Array
from d2d.baselines.eigenvalues import raise_eigenvalues
from d2d.cost import RegistrationCost
from d2d.point_set import PointSet
from d2d.registration import Estimate, register

CELL_SIZE = 1.0  # m
MIN_POINTS = 3  # needed for a covariance in the plane (Biber & Strasser 2003, sec. III)
SMALLEST_RATIO = 1e-3  # of a cell's eigenvalues (Biber & Strasser 2003, sec. III)
FOUR_GRIDS = ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5))  # shifts in cells
_MAX_CELLS = 2**53  # from the origin: beyond it, float64 cannot represent every cell number
D2 = 0.05  # factor of the exponent in public implementations of D2D-NDT

P2D = RegistrationCost(metric="p2d", fusion="summing")
D2D = RegistrationCost(metric="d2d", fusion="summing")


def grid_cells(
    points: ArrayLike,
    size: float = CELL_SIZE,
    shift: Sequence[float] = (0.0, 0.0),
    *,
    min_points: int = MIN_POINTS,
    smallest_ratio: float = SMALLEST_RATIO,
) -> PointSet:
    """One Gaussian for every grid cell that contains enough points (thesis eq. 3.4, 3.5).

    Parameters
    ----------
    points : (N, 2) array, m
    size : float, m
        Side length of the square cells.
    shift : pair of float
        Shift of the grid's origin, in cells.
    min_points : int
        Cells with fewer points are left out; at least 2.
    smallest_ratio : float within (0, 1]
        The smaller eigenvalue of a cell's covariance is raised to at least this fraction of the
        larger, so that the covariance of collinear points is not singular.

    Returns
    -------
    PointSet
        Sorted by the cells' columns, then rows.  The weights sqrt(det(2 pi Sigma)) make each
        component peak at 1, like the score of Biber & Strasser.

    Raises
    ------
    ValueError
        If an argument is invalid, or no cell contains enough points; the message names the
        argument.
    """
    return _weighted(*_cells(_checked(points), size, shift, min_points, smallest_ratio))


def pooled_cells(
    points: ArrayLike,
    size: float = CELL_SIZE,
    shifts: Sequence[Sequence[float]] = FOUR_GRIDS,
    *,
    min_points: int = MIN_POINTS,
    smallest_ratio: float = SMALLEST_RATIO,
) -> PointSet:
    """The cells of several shifted grids together; every point counts in each grid.

    Four grids, shifted by half a cell, smooth the jumps of the score at the borders of the cells
    (Biber & Strasser 2003, sec. III).

    Parameters
    ----------
    points, size, min_points, smallest_ratio
        As for `grid_cells`.
    shifts : sequence of pairs
        Shift of each grid's origin, in cells.

    Returns
    -------
    PointSet
        The cells of all grids, grid by grid, weighted as by `grid_cells`.

    Raises
    ------
    ValueError
        If an argument is invalid, or no cell of a grid contains enough points; the message names
        the argument.
    """
    cloud = _checked(points)
    offsets = check_finite("shifts", shifts)
    if offsets.ndim != 2 or not len(offsets) or offsets.shape[1] != 2:
        raise ValueError(f"shifts must be one or more pairs, but has the shape {offsets.shape}")
    grids = [_cells(cloud, size, shift, min_points, smallest_ratio) for shift in offsets]
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
    """Register points with the NDT of the fixed ones (Biber & Strasser 2003; thesis eq. 3.6, 3.7).

    Maximises sum_k sum_i exp(-1/2 d_ki' Sigma_i^-1 d_ki) over the motion, d_ki = T(m_k) - mu_i, by
    Newton's method on its negative logarithm.  The sum is over all cells, whereas the paper takes
    only the cell that contains T(m_k); without that restriction the score is smooth, and its
    derivatives are exact.

    Parameters
    ----------
    fixed, moving : (N, 2) and (M, 2) arrays, m
    initial : (..., 3) array, m, m, rad, optional
        Where to start, or a batch of starts; zeros by default.
    size : float, m
        Side length of the square cells.
    shifts : sequence of pairs
        Shift of each grid's origin, in cells.

    Returns
    -------
    Estimate
        Its ``covariance`` is the inverse Hessian of the score's negative logarithm.  That is not
        the covariance of the error, because the score is not a likelihood.

    Raises
    ------
    ValueError
        If an argument is invalid; the message names it.
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
    """Register the NDT of the moving points with that of the fixed ones (Stoyanov et al. 2012).

    Maximises sum_k sum_i N(0 | d_ki, S_ki / d2), S_ki = R Sigma_k R' + Sigma_i: the inner product
    of the two mixtures, the only part of the L2 distance that depends on the motion.  A ``d2``
    below 1 widens all pairs by the same factor; public implementations use 0.05.  They also leave
    out the normalisation of the densities, which is kept here because it is part of the inner
    product.  Each scan has one grid, without shifts.

    Parameters
    ----------
    fixed, moving, initial, size
        As for `ndt_p2d`.
    d2 : float within (0, 1]
        Divisor of the variances.

    Returns
    -------
    Estimate
        As for `ndt_p2d`, its ``covariance`` is not that of the error.

    Raises
    ------
    ValueError
        If an argument is invalid; the message names it.
    """
    if check_fraction("d2", d2) == 0.0:
        raise ValueError("d2 must be positive, but is 0")
    sets = (
        grid_cells(_checked(cloud, name), size)
        for name, cloud in (("fixed", fixed), ("moving", moving))
    )
    target, source = (_equally_weighted(cells) for cells in sets)
    width = (1.0 / d2) ** 0.5
    return register(target.inflated(width), source.inflated(width), D2D, initial)


def bare_points(points: ArrayLike) -> PointSet:
    """Points (N, 2) as the moving set of a P2D cost, which ignores the moving covariances."""
    cloud = _checked(points)
    return PointSet(cloud, np.broadcast_to(np.eye(2), (len(cloud), 2, 2)))


def _cells(
    points: Array, size: float, shift: ArrayLike, min_points: int, smallest_ratio: float
) -> tuple[Array, Array]:
    side = check_positive_scalar("size", size)
    offset = check_finite("shift", shift)
    if offset.shape != (2,):
        raise ValueError(f"shift must be a pair, but has the shape {offset.shape}")
    if check_count("min_points", min_points) < 2:
        raise ValueError(f"min_points must be at least 2, but is {min_points}")
    if check_fraction("smallest_ratio", smallest_ratio) == 0.0:
        raise ValueError("smallest_ratio must be positive, but is 0")
    place = np.floor(points / side - offset)
    if np.abs(place).max() > _MAX_CELLS:
        raise ValueError(f"size must be larger for points so far from the origin, but is {side:g}")
    place = place.astype(np.int64)
    _, cell, counts = np.unique(place, axis=0, return_inverse=True, return_counts=True)
    member = cell.ravel() == np.arange(len(counts))[:, None]  # (cells, N)
    member = member[counts >= min_points]
    # leave out cells whose points all coincide: there is no eigenvalue to raise the other to
    fitted = [gaussian.fit(points[inside]) for inside in member]
    fitted = [(mean, sigma) for mean, sigma in fitted if np.trace(sigma) > 1e-18 * side**2]
    if not fitted:
        raise ValueError(
            f"points must include {min_points} or more in one cell of {side:g} m, not all at the "
            "same place"
        )
    means = np.stack([mean for mean, _ in fitted])
    covariances = np.stack([sigma for _, sigma in fitted])
    return means, raise_eigenvalues(covariances, smallest_ratio=smallest_ratio)


def _weighted(means: Array, covariances: Array) -> PointSet:
    return PointSet(means, covariances, 2.0 * np.pi * np.sqrt(np.linalg.det(covariances)))


def _equally_weighted(cells: PointSet) -> PointSet:
    return PointSet(cells.means, cells.covariances)


def _checked(points: ArrayLike, name: str = "points") -> Array:
    array = check_finite(name, points)
    if array.ndim != 2 or array.shape[1] != 2 or not array.size:
        raise ValueError(f"{name} must have the shape (N, 2) with N > 0, but has {array.shape}")
    return array
