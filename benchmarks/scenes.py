"""The scenes to register, the floor of the accuracy, and which estimates end at the truth."""

from dataclasses import dataclass, replace

import numpy as np

from d2d import PointSet, rigid
from d2d._types import Array
from d2d.study.plane.evaluation import distance_and_rotation, rms
from d2d.study.plane.scenarios import OVERLAPPED, Scenario, cartesian

# An estimate ends at the truth if its errors in translation and in rotation are within this many
# root mean square errors of the floor. One as good as the floor misses that less than once in a
# million runs.
AT_TRUTH = 5.0


@dataclass(frozen=True, eq=False)
class Draws:
    """Noisy scans of a scene: batches ``fixed`` and ``moving``, the true motion ``theta`` (3,)."""

    fixed: PointSet
    moving: PointSet
    theta: Array

    def __len__(self) -> int:
        return self.fixed.batch_shape[0]

    def __getitem__(self, runs: slice) -> "Draws":
        return Draws(self.fixed[runs], self.moving[runs], self.theta)


@dataclass(frozen=True)
class Accuracy:
    """RMSE in m and rad, ratio of the first to that of the floor, share of runs at the truth."""

    translation: float
    rotation: float
    over_floor: float
    at_truth: float


# Of each scene: the ranges of its targets in m, and the standard deviations in m and rad.
SCENES = {"dense": ((8.0, 60.0), 0.2, 0.03), "wide": ((3.0, 120.0), 0.15, 0.01)}


def random_layout(size: int, name: str) -> Scenario:
    """`OVERLAPPED` with targets uniform in azimuth within 40 degrees and in range.

    Those within a metre of the second place of the sensor, if any, are left out.
    """
    between, sigma_range, sigma_azimuth = SCENES[name]
    rng = np.random.default_rng([0, size])
    azimuth = np.deg2rad(rng.uniform(-40.0, 40.0, size))
    targets = cartesian(np.stack([azimuth, rng.uniform(*between, size)], axis=-1))
    noise = {"sigma_range": sigma_range, "sigma_azimuth": sigma_azimuth}
    seen = np.hypot(*rigid.transform_means(rigid.inverse(OVERLAPPED.theta), targets).T) > 1.0
    return replace(OVERLAPPED, name=f"{name} {size}", targets=targets[seen], **noise)


def scene(size: int, name: str = "dense") -> Scenario:
    """The eight targets of the study, or a random layout of another size."""
    eight = name == "dense" and size == len(OVERLAPPED.targets)
    return OVERLAPPED if eight else random_layout(size, name)


def draw(scenario: Scenario, runs: int, seed: int) -> Draws:
    """Independent noisy scans of a scene."""
    return Draws(*scenario.sample(runs, np.random.default_rng(seed)), scenario.theta)


def known_correspondences(draws: Draws) -> Array:
    """Motions (runs, 3) by least squares over the true pairs: the floor of the accuracy.

    Gauss-Newton on sum_k d_k' S_k^-1 d_k with d_k = R mu_k + t - mu_i(k) and S_k = R Sigma_k R' +
    Sigma_i(k), started at the truth. The weights S_k^-1 are updated in each iteration.
    """
    theta = np.tile(draws.theta, (len(draws), 1))
    for _ in range(20):
        moved = draws.moving.transformed(theta)
        residual = moved.means - draws.fixed.means
        precision = np.linalg.inv(moved.covariances + draws.fixed.covariances)
        x, y = np.moveaxis(moved.means - theta[:, None, :2], -1, 0)
        jacobian = np.zeros((*residual.shape, 3))
        jacobian[..., 0, 0] = jacobian[..., 1, 1] = 1.0
        jacobian[..., 0, 2], jacobian[..., 1, 2] = -y, x
        weighted = np.swapaxes(jacobian, -1, -2) @ precision
        hessian = (weighted @ jacobian).sum(axis=1)
        gradient = (weighted @ residual[..., None]).sum(axis=1)
        theta = theta - np.linalg.solve(hessian, gradient)[..., 0]
    return theta


def accuracy(estimates: Array, floor: Array, theta: Array, only_at_truth: bool) -> Accuracy:
    """Judge estimates (n, 3) of the first n runs by the floor's estimates (runs, 3) of all runs.

    The errors are those of all n runs, or only of those that end at the truth, and are compared
    with the errors of the floor in the same runs.
    """
    shift, turn = distance_and_rotation(estimates - theta)
    floor_shift, floor_turn = distance_and_rotation(floor - theta)
    near = (shift < AT_TRUTH * rms(floor_shift)) & (turn < AT_TRUTH * rms(floor_turn))
    judged = near if only_at_truth else np.ones_like(near)
    best = rms(floor_shift[: len(shift)][judged])
    return Accuracy(
        rms(shift[judged]), rms(turn[judged]), rms(shift[judged]) / best, float(near.mean())
    )


def transform(theta: Array) -> Array:
    """The planar motion as the (4, 4) matrix that libraries for point clouds take."""
    matrix = np.eye(4)
    matrix[:2, :2] = rigid.rotation(theta[2])
    matrix[:2, 3] = theta[:2]
    return matrix


def motion(matrix: Array) -> Array:
    """[t_x, t_y, phi] of a (4, 4) matrix."""
    return np.array([matrix[0, 3], matrix[1, 3], np.arctan2(matrix[1, 0], matrix[0, 0])])
