"""The normal distributions transform (NDT) of a planar scan, and registration with it.

A scan becomes a `PointSet` with one Gaussian per grid cell.  Both ways to register such sets are
then a `RegistrationCost` with ``fusion="summing"``.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from d2d._checks import SCALE, check_count, check_finite, check_fraction
from d2d._types import Array
from d2d.baselines.gaussian_fit import fit, raise_eigenvalues
from d2d.baselines.icp import check_points
from d2d.cost import RegistrationCost
from d2d.point_set import PointSet
from d2d.problem import Estimate
from d2d.registration import register

CELL_SIZE = 1.0  # m
MIN_POINTS = 3  # needed for a covariance in the plane (Biber & Strasser 2003, sec. III)
SMALLEST_RATIO = 1e-3  # of a cell's eigenvalues (Biber & Strasser 2003, sec. III)
FOUR_GRIDS = ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5))  # shifts in cells
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
    r"""One Gaussian for every grid cell that contains enough points (thesis eq. 3.4, 3.5).

    The cells of the points (N, 2), squares of ``size`` m on a grid whose origin is shifted by so
    many cells, are sorted by columns, then rows.  Those with fewer than ``min_points`` are left
    out.  The smaller eigenvalue of a covariance is raised to at least ``smallest_ratio`` times the
    larger, so that the covariance of collinear points is not singular.  The weights
    :math:`\sqrt{\det(2\pi\Sigma)}` make each component peak at 1, like the score of Biber &
    Strasser.  Raises a ``ValueError`` if no cell contains enough points.
    """
    cells = _cells(check_points("points", points, 2), size, shift, min_points, smallest_ratio)
    return _peaking_at_one(*cells)


def pooled_cells(
    points: ArrayLike,
    size: float = CELL_SIZE,
    shifts: Sequence[Sequence[float]] = FOUR_GRIDS,
) -> PointSet:
    """The cells of several shifted grids, grid by grid; every point counts in each grid.

    Four grids, shifted by half a cell, smooth the jumps of the score at the borders of the cells
    (Biber & Strasser 2003, sec. III).  ``shifts`` are those of `grid_cells`, in cells; what is
    invalid raises a ``ValueError`` as it does there.
    """
    cloud, offsets = check_points("points", points, 2), check_points("shifts", shifts, 2)
    grids = [_cells(cloud, size, shift, MIN_POINTS, SMALLEST_RATIO) for shift in offsets]
    means, covariances = (np.concatenate(arrays) for arrays in zip(*grids, strict=True))
    return _peaking_at_one(means, covariances)


def ndt_p2d(
    fixed: ArrayLike,
    moving: ArrayLike,
    initial: ArrayLike | None = None,
    *,
    size: float = CELL_SIZE,
    shifts: Sequence[Sequence[float]] = FOUR_GRIDS,
) -> Estimate:
    r"""Register points with the NDT of the fixed ones (Biber & Strasser 2003; thesis eq. 3.6, 3.7).

    Maximises :math:`\sum_{ki} \exp(-\tfrac12 d_{ki}^{\mathsf T} \Sigma_i^{-1} d_{ki})` over the
    motion, :math:`d_{ki} = T(m_k) - \mu_i`, by Newton's method on its negative logarithm.  The
    paper takes only the cell that contains :math:`T(m_k)` instead of all; without that restriction
    the score is smooth, and its derivatives are exact.

    The points (N, 2) and (M, 2) are in m, ``size`` and ``shifts`` are those of `pooled_cells`, and
    the start or starts ``initial`` (..., 3) are zeros by default.  The ``covariance`` of the result
    is the inverse Hessian of the score's negative logarithm.  That is not the covariance of the
    error, because the score is not a likelihood.
    """
    cells = pooled_cells(check_points("fixed", fixed, 2), size, shifts)
    return register(cells, bare_points(check_points("moving", moving, 2)), P2D, initial)


def ndt_d2d(
    fixed: ArrayLike,
    moving: ArrayLike,
    initial: ArrayLike | None = None,
    *,
    size: float = CELL_SIZE,
    d2: float = D2,
) -> Estimate:
    r"""Register the NDT of the moving points with that of the fixed ones (Stoyanov et al. 2012).

    Maximises :math:`\sum_{ki} \mathcal N(0 \mid d_{ki}, S_{ki} / d_2)`,
    :math:`S_{ki} = R \Sigma_k R^{\mathsf T} + \Sigma_i`: the inner product of the two mixtures, the
    only part of the L2 distance that depends on the motion.  A ``d2`` below 1 widens all pairs by
    the same factor; public implementations use 0.05.  They also leave out the normalisation of the
    densities, which is a part of the inner product.  Each scan has one grid, without shifts.

    The other arguments are those of `ndt_p2d`; here, too, the ``covariance`` is not that of the
    error.
    """
    width = (1.0 / SCALE.number("d2", d2)) ** 0.5
    cells = (
        grid_cells(check_points(name, cloud, 2), size)
        for name, cloud in (("fixed", fixed), ("moving", moving))
    )
    target, source = (PointSet(each.means, each.covariances).inflated(width) for each in cells)
    return register(target, source, D2D, initial)


def bare_points(points: ArrayLike) -> PointSet:
    """Points (N, 2) as the moving set of a P2D cost, which ignores the moving covariances."""
    cloud = check_points("points", points, 2)
    return PointSet(cloud, np.broadcast_to(np.eye(2), (len(cloud), 2, 2)))


def _cells(
    points: Array, size: float, shift: ArrayLike, min_points: int, smallest_ratio: float
) -> tuple[Array, Array]:
    """Means and covariances of the points in each cell, without the cells that have too few."""
    side = SCALE.number("size", size)
    check_count("min_points", min_points)
    check_fraction("smallest_ratio", smallest_ratio)
    place = np.floor(points / side - check_finite("shift", shift, "(2,)"))
    if np.abs(place).max() > 2.0**62:
        raise ValueError(
            f"size must be larger: points up to {np.abs(points).max():g} m have no cell"
        )
    place = place.astype(np.int64)
    _, cell, counts = np.unique(place, axis=0, return_inverse=True, return_counts=True)
    means, covariances = [], []
    for number in np.flatnonzero(counts >= min_points):
        mean, covariance = fit(points[cell.ravel() == number])
        # leave out points that all coincide: there is no eigenvalue to raise the other to
        if np.trace(covariance) > 1e-18 * side**2:
            means.append(mean)
            covariances.append(covariance)
    if not means:
        raise ValueError(
            f"points must include {min_points} or more in one cell of {side:g} m, not all at the "
            "same place"
        )
    return np.stack(means), raise_eigenvalues(np.stack(covariances), smallest_ratio=smallest_ratio)


def _peaking_at_one(means: Array, covariances: Array) -> PointSet:
    """The cells, weighted so that each component peaks at 1."""
    return PointSet(means, covariances, 2.0 * np.pi * np.sqrt(np.linalg.det(covariances)))
