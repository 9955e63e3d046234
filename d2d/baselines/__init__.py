"""Baselines of the study; the public ones, ICP and NDT, use no measured covariances."""

from d2d.baselines.icp import IcpResult, fit_rigid, icp, line_normals
from d2d.baselines.ndt import grid_cells, ndt_d2d, ndt_p2d, pooled_cells

__all__ = [
    "IcpResult",
    "fit_rigid",
    "grid_cells",
    "icp",
    "line_normals",
    "ndt_d2d",
    "ndt_p2d",
    "pooled_cells",
]
