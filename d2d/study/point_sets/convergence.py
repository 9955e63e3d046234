"""How far off the initial guess of a scan registration may be."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from d2d import rigid
from d2d._types import Array
from d2d.baselines import icp, ndt_d2d, ndt_p2d
from d2d.cost import CorruptedGaussian, RegistrationCost
from d2d.problem import Estimate
from d2d.study.point_sets.room_scans import MOTION, RoomScan
from d2d.study.runs import THREADS, scheduled

MAX_DISTANCE, MAX_ROTATION = 4.0, np.deg2rad(90.0)  # m, rad: half a room, a quarter turn
NEAR_DISTANCE, NEAR_ROTATION = 0.25, np.deg2rad(5.0)  # a quarter of an NDT cell
CLOSE_DISTANCE, CLOSE_ROTATION = 0.2, np.deg2rad(3.0)  # several times any method's error

ROBUST = RegistrationCost(outlier=CorruptedGaussian(0.2, 100.0 * np.eye(2)))
SCALES = (16.0, 8.0, 4.0, 2.0, 1.0)
CELL_SIZES = (4.0, 2.0, 1.0)  # m: of an NDT from coarse to fine

Method = Callable[[RoomScan, RoomScan, Array], Array]
"""Takes the scan before, the scan after and starts (..., 3); returns motions (..., 3)."""


def _likelihood(*scales: float) -> Method:
    def run(before: RoomScan, after: RoomScan, starts: Array) -> Array:
        fixed, moving = before.targets(), after.targets()
        return scheduled(fixed, moving, ROBUST, starts, scales, threads=THREADS).theta

    return run


def ndt_coarse_to_fine(register_ndt: Callable[..., Estimate], *sizes: float) -> Method:
    """`ndt_p2d` or `ndt_d2d` with cells of each size (m) in turn, each from the last estimate."""

    def run(before: RoomScan, after: RoomScan, starts: Array) -> Array:
        for size in sizes:
            starts = register_ndt(before.points, after.points, starts, size=size).theta
        return starts

    return run


METHODS: dict[str, Method] = {
    "ICP, point to point": lambda f, m, s: icp(f.points, m.points, s).theta,
    "ICP, point to line": lambda f, m, s: icp(f.points, m.points, s, metric="line").theta,
    "NDT, P2D": lambda f, m, s: ndt_p2d(f.points, m.points, s).theta,
    "NDT, D2D": lambda f, m, s: ndt_d2d(f.points, m.points, s).theta,
    "robust likelihood": _likelihood(1.0),
    "robust, annealed": _likelihood(*SCALES),
}


def start_plane(distances: ArrayLike, rotations: ArrayLike, directions: int) -> Array:
    """Offsets (R, D, A, 3) in m and rad, at rotations (R,) and distances (D,), all around."""
    bearing = 2.0 * np.pi * (np.arange(directions) + 0.25) / directions
    turn, distance, angle = np.meshgrid(rotations, distances, bearing, indexing="ij")
    return np.stack([distance * np.cos(angle), distance * np.sin(angle), turn], axis=-1)


def draw_offsets(
    rng: np.random.Generator, count: int, max_distance: float, max_rotation: float
) -> Array:
    """Offsets (count, 3) with uniform distance, direction and rotation up to the maximum given."""
    distance, bearing = rng.uniform(0.0, max_distance, count), rng.uniform(0, 2 * np.pi, count)
    turn = rng.uniform(-max_rotation, max_rotation, count)
    return np.stack([distance * np.cos(bearing), distance * np.sin(bearing), turn], axis=-1)


def is_registered(theta: ArrayLike, truth: ArrayLike, tolerance: float = 1.0) -> NDArray[np.bool_]:
    """Whether motions (..., 3) end within 0.2 m and 3 degrees of the truth, times ``tolerance``."""
    millimetres, degrees = motion_errors(theta, truth)
    close: NDArray[np.bool_] = (millimetres < 1e3 * tolerance * CLOSE_DISTANCE) & (
        np.abs(degrees) < np.rad2deg(tolerance * CLOSE_ROTATION)
    )
    return close


def motion_errors(theta: ArrayLike, truth: ArrayLike = MOTION) -> tuple[Array, Array]:
    """Errors (...) of motions (..., 3): translation in mm, signed rotation in degrees."""
    error = rigid.compose(rigid.inverse(truth), theta)
    turn = np.angle(np.exp(1j * error[..., 2]))
    return 1e3 * np.hypot(error[..., 0], error[..., 1]), np.rad2deg(turn)
