"""Libraries that a user could pick instead, each at its best settings.

Each adapter takes noisy scans, a start (3,) and one setting, builds whatever the library can reuse
(clouds, covariances, search trees, voxel maps; not timed), and returns two functions: one
registers the run of a given number, the other reads the motion (3,) from what the first returned
(not timed either).  The setting used is the one that does best on other draws of the scene.  The
libraries work in three dimensions; the targets lie in the plane z = 0.
"""

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.scenes import Draws, accuracy, known_correspondences, motion, transform
from d2d import PointSet, rigid
from d2d._types import Array

Solver = tuple[Callable[[int], Any], Callable[[Any], Array]]

RADII = (1.0, 2.0, 3.0, 5.0, 8.0, 12.0)  # m, for correspondences
MAX_ITERATIONS = 50
THICKNESS = 1e-2  # m^2, variance along z, where nothing moves


@dataclass(frozen=True)
class Peer:
    """One method of a library: its module, the settings to choose from, its adapter."""

    name: str
    module: str
    unit: str  # of the setting
    settings: tuple[Any, ...]
    adapter: Callable[[Any, Draws, Array, Any], Solver]
    fast: bool  # compiled, and so given as many runs as the kernel
    from_arrays: bool = False  # also timed with all it could reuse built anew each time


def in_space(positions: Array) -> Array:
    """Planar points (..., 2) as points (..., 3) in the plane z = 0."""
    return np.concatenate([positions, np.zeros((*positions.shape[:-1], 1))], axis=-1)


def spatial_covariances(covariances: Array) -> Array:
    """Planar covariances (..., 2, 2) as covariances (..., 3, 3)."""
    full = np.zeros((*covariances.shape[:-2], 3, 3))
    full[..., :2, :2] = covariances
    full[..., 2, 2] = THICKNESS
    return full


def _open3d_clouds(o3d: Any, points: PointSet, with_covariances: bool) -> list[Any]:
    vectors = o3d.utility.Vector3dVector
    clouds = [o3d.geometry.PointCloud(vectors(means)) for means in in_space(points.means)]
    if with_covariances:
        for cloud, matrices in zip(clouds, spatial_covariances(points.covariances), strict=True):
            cloud.covariances = o3d.utility.Matrix3dVector(matrices)
    return clouds


def _open3d(generalised: bool) -> Callable[[Any, Draws, Array, float], Solver]:
    def adapter(o3d: Any, draws: Draws, start: Array, radius: float) -> Solver:
        fixed, moving = (
            _open3d_clouds(o3d, points, generalised) for points in (draws.fixed, draws.moving)
        )
        library = o3d.pipelines.registration
        criteria = library.ICPConvergenceCriteria(max_iteration=MAX_ITERATIONS)
        begin = transform(start)
        if generalised:
            register = library.registration_generalized_icp
            kind = library.TransformationEstimationForGeneralizedICP()
        else:
            register = library.registration_icp
            kind = library.TransformationEstimationPointToPoint()
        return (
            lambda run: register(moving[run], fixed[run], radius, begin, kind, criteria),
            lambda result: motion(result.transformation),
        )

    return adapter


def _small_gicp(kind: str) -> Callable[[Any, Draws, Array, float], Solver]:
    def adapter(library: Any, draws: Draws, start: Array, radius: float) -> Solver:
        fixed = [library.PointCloud(means) for means in in_space(draws.fixed.means)]
        moving = [library.PointCloud(means) for means in in_space(draws.moving.means)]
        trees = [library.KdTree(cloud) for cloud in fixed]
        if kind == "GICP":
            for cloud in fixed + moving:
                library.estimate_covariances(cloud, library.KdTree(cloud), min(10, cloud.size()))
        begin = transform(start)
        return (
            lambda run: library.align(
                fixed[run],
                moving[run],
                trees[run],
                begin,
                registration_type=kind,
                max_correspondence_distance=radius,
                max_iterations=MAX_ITERATIONS,
            ),
            lambda result: motion(result.T_target_source),
        )

    return adapter


def _kiss_icp(library: Any, draws: Draws, start: Array, radius: float) -> Solver:
    mapping = importlib.import_module("kiss_icp.mapping")
    registration = importlib.import_module("kiss_icp.registration").Registration(
        max_num_iterations=MAX_ITERATIONS, convergence_criterion=1e-4, max_num_threads=1
    )
    maps = []
    for means in in_space(draws.fixed.means):
        # many points per voxel: the map must not thin the targets out
        voxels = mapping.VoxelHashMap(radius, 1000.0, 10**6)
        voxels.add_points(means)
        maps.append(voxels)
    moving = list(in_space(draws.moving.means))
    begin = transform(start)
    return (
        lambda run: registration.align_points_to_map(
            moving[run], maps[run], begin, radius, radius / 3.0
        ),
        motion,
    )


def _probreg(library: Any, draws: Draws, start: Array, tolerance: float) -> Solver:
    cpd = importlib.import_module("probreg.cpd")
    fixed, moving = list(in_space(draws.fixed.means)), list(in_space(draws.moving.means))
    matrix = transform(start)
    begin = {"rot": matrix[:3, :3], "t": matrix[:3, 3]}

    def solve(run: int) -> Any:
        return cpd.registration_cpd(
            moving[run],
            fixed[run],
            update_scale=False,
            maxiter=2 * MAX_ITERATIONS,
            tol=tolerance,
            tf_init_params=dict(begin),
        )

    def read(result: Any) -> Array:
        rigid_motion = result.transformation
        return motion(np.block([[rigid_motion.rot, rigid_motion.t[:, None]], [np.eye(4)[3:]]]))

    return solve, read


def _pycpd(library: Any, draws: Draws, start: Array, variance: float | None) -> Solver:
    fixed, moving = list(draws.fixed.means), list(draws.moving.means)
    # pycpd rotates row vectors: its R is the transpose
    turn, shift = rigid.rotation(start[2]).T, start[None, :2].copy()

    def solve(run: int) -> Any:
        registration = library.RigidRegistration(
            X=fixed[run], Y=moving[run], R=turn, t=shift, sigma2=variance
        )
        registration.register(None)
        return registration

    return solve, lambda result: np.array(
        [*result.t.ravel(), np.arctan2(result.R[0, 1], result.R[0, 0])]
    )


_RADIUS = ("radius in m", RADII)
PEERS = (
    Peer("open3d ICP", "open3d", *_RADIUS, _open3d(False), True, True),
    Peer("open3d GICP, true covariances", "open3d", *_RADIUS, _open3d(True), True),
    Peer("small_gicp ICP", "small_gicp", *_RADIUS, _small_gicp("ICP"), True, True),
    Peer("small_gicp GICP, own covariances", "small_gicp", *_RADIUS, _small_gicp("GICP"), True),
    Peer("kiss-icp", "kiss_icp", *_RADIUS, _kiss_icp, True),
    Peer("probreg CPD", "probreg", "tolerance", (1e-3, 1e-5), _probreg, False),
    Peer("pycpd CPD", "pycpd", "variance in m²", (None, 0.5, 2.0, 8.0), _pycpd, False),
)


def load(module: str) -> tuple[Any, str]:
    """The module and an empty string, or None and the reason why it is missing."""
    try:
        return importlib.import_module(module), ""
    except ImportError as error:
        return None, str(error)


def best_setting(peer: Peer, library: Any, pilot: Draws, start: Array) -> Any:
    """The setting with the most pilot runs at the truth, and among equals the smallest error."""
    floor = known_correspondences(pilot)

    def rank(setting: Any) -> tuple[float, float]:
        solve, read = peer.adapter(library, pilot, start, setting)
        estimates = np.array([read(solve(run)) for run in range(len(pilot))])
        judged = accuracy(estimates, floor, pilot.theta, only_at_truth=False)
        return -judged.at_truth, judged.translation

    return min(peer.settings, key=rank)
