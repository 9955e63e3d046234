"""The iterative closest point algorithm in the plane."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from d2d import rigid
from d2d._checks import (
    check_choice,
    check_count,
    check_finite,
    check_positive_scalar,
    check_shape,
)
from d2d._types import Array

Metric = Literal["point", "line"]


@dataclass(frozen=True, eq=False)
class IcpResult:
    """The result of ICP, for one start or a batch of starts, and the iterations on the way to it.

    Distances are those of the correspondences: to the nearest point, or to the line through it.
    """

    theta: Array  # (..., 3) m, m, rad: maps the moving set onto the fixed one
    rms: Array  # (...) m, root mean squared distance at the end
    converged: NDArray[np.bool_]  # (...), whether the last step was within the tolerance
    iterations: NDArray[np.int64]  # (...)
    thetas: Array  # (I + 1, ..., 3), at the start and after each iteration; constant once stopped
    rms_history: Array  # (I + 1, ...) m


def fit_rigid(fixed: ArrayLike, moving: ArrayLike) -> Array:
    r"""The rigid motion that minimises the squared distances between paired points.

    Minimises :math:`\sum_n \|R m_n + t - f_n\|^2` in closed form: with the singular value
    decomposition :math:`\sum_n m'_n f_n'^{\mathsf T} = U S V^{\mathsf T}` of centred points it is
    :math:`R = V \operatorname{diag}(1, \det(V U^{\mathsf T}))\, U^{\mathsf T}` (Arun et al. 1987;
    the determinant, from Umeyama 1991, excludes reflections).

    The points (..., N, 2) in m with the same index are paired; batch axes broadcast.  The motion
    (..., 3) in m, m, rad maps ``moving`` onto ``fixed``.
    """
    target, source = check_points("fixed", fixed), check_points("moving", moving)
    check_shape("moving", source, f"(..., {target.shape[-2]}, 2)", like="fixed")
    to, by = target.mean(axis=-2), source.mean(axis=-2)
    spread = np.swapaxes(source - by[..., None, :], -1, -2) @ (target - to[..., None, :])
    left, _, right = np.linalg.svd(spread)
    turn = np.swapaxes(left @ right, -1, -2)  # V U^T
    right[..., 1, :] *= np.sign(np.linalg.det(turn))[..., None]
    turn = np.swapaxes(left @ right, -1, -2)
    angle = np.arctan2(turn[..., 1, 0], turn[..., 0, 0])
    shift = to - np.einsum("...ij,...j->...i", rigid.rotation(angle), by)
    return np.concatenate([shift, angle[..., None]], axis=-1)


def line_normals(points: ArrayLike, neighbours: int = 5) -> Array:
    """Unit normals (N, 2) of the lines fitted to each point and its nearest neighbours.

    A normal is the eigenvector of the smallest eigenvalue of the covariance of a point and as many
    nearest ``neighbours``, fewer than N; its sign is arbitrary.
    """
    cloud = check_points("points", points, dimensions=2)
    if not 1 <= check_count("neighbours", neighbours) < len(cloud):
        raise ValueError(
            f"neighbours must lie within [1, {len(cloud) - 1}] for {len(cloud)} points, "
            f"but is {neighbours}"
        )
    _, index = scipy.spatial.cKDTree(cloud).query(cloud, neighbours + 1)
    centred = cloud[index] - cloud[index].mean(axis=1, keepdims=True)
    _, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", centred, centred))
    return np.asarray(vectors[:, :, 0])


def icp(
    fixed: ArrayLike,
    moving: ArrayLike,
    initial: ArrayLike | None = None,
    *,
    metric: Metric = "point",
    neighbours: int = 5,
    tolerance: float = 1e-6,
    max_iterations: int = 100,
) -> IcpResult:
    """Register two point sets by the iterative closest point algorithm (thesis sec. 3.1).

    Each iteration pairs every moving point with the nearest fixed one, fits the motion to the pairs
    and moves the points.  ``metric="point"`` minimises the distances between the paired points in
    closed form (Besl & McKay 1992).  ``metric="line"`` minimises the distances to the lines through
    the fixed points (Chen & Medioni 1992) by one Gauss-Newton step.  The latter is not guaranteed
    to converge: it stops, not converged, when it alternates between two pairings.  No pair is
    rejected, however far apart its points are.

    The sets (F, 2) and (M, 2) are in m, the start or starts ``initial`` (..., 3) in m, m, rad are
    zeros by default.  As many ``neighbours`` of each fixed point define its line.  The iteration
    has converged once a step moves no point by more than ``tolerance``, in m.
    """
    target = check_points("fixed", fixed, dimensions=2)
    source = check_points("moving", moving, dimensions=2)
    check_choice("metric", metric, ("point", "line"))
    check_positive_scalar("tolerance", tolerance)
    check_count("max_iterations", max_iterations, 0)
    start = np.zeros(3) if initial is None else rigid.start("initial", initial, 2)
    normals = line_normals(target, neighbours) if metric == "line" else None
    tree = scipy.spatial.cKDTree(target)
    theta = start.reshape(-1, 3)
    moved = rigid.transform_means(theta, source)
    paired, rms = _pair(tree, normals, moved)
    thetas, history = [theta], [rms]
    active, settled = np.ones(len(theta), dtype=np.bool_), np.zeros(len(theta), dtype=np.bool_)
    older = np.full_like(paired, -1)
    iterations = np.zeros(len(theta), dtype=np.int64)
    while active.any() and len(thetas) <= max_iterations:
        before, partner = moved[active], paired[active]
        if normals is None:
            step = fit_rigid(target[partner], before)
        else:
            step = _line_step(target[partner], normals[partner], before)
        after = rigid.transform_means(step, before)
        theta, rms = theta.copy(), rms.copy()
        theta[active] = rigid.compose(step, theta[active])
        moved[active] = after
        new, rms[active] = _pair(tree, normals, after)
        swaps = (new == older[active]).all(axis=-1) & (new != partner).any(axis=-1)
        paired[active], older[active] = new, partner
        iterations[active] += 1
        thetas.append(theta)
        history.append(rms)
        settled[active] = np.linalg.norm(after - before, axis=-1).max(axis=-1) <= tolerance
        active[active] = ~settled[active] & ~swaps
    shape = start.shape[:-1]
    return IcpResult(
        theta.reshape(start.shape),
        rms.reshape(shape),
        settled.reshape(shape),
        iterations.reshape(shape),
        np.stack(thetas).reshape(len(thetas), *start.shape),
        np.stack(history).reshape(len(thetas), *shape),
    )


def _pair(
    tree: "scipy.spatial.cKDTree", normals: Array | None, moved: Array
) -> tuple[NDArray[np.int64], Array]:
    """Nearest fixed point (B, M) of every moved point (B, M, 2), and the rms distance (B,)."""
    gap, paired = tree.query(moved)
    if normals is not None:
        gap = np.einsum("bmi,bmi->bm", moved - tree.data[paired], normals[paired])
    return paired, np.sqrt((gap**2).mean(axis=-1))


def _line_step(fixed: Array, normals: Array, moved: Array) -> Array:
    """The motion (B, 3) that minimises sum (n . (m + phi E m' + t - f))^2 over t and phi.

    m' is m about the mean of all, and E m' = (-m'_y, m'_x) the derivative of the rotation at zero.
    Where the lines leave a direction undetermined (a corridor), the solution has the smallest norm;
    a rotation counts by the displacement that it causes.
    """
    middle = moved.mean(axis=-2, keepdims=True)
    about = moved - middle
    lever = np.sqrt((about**2).sum(axis=-1).mean(axis=-1))[:, None, None] + 1e-300
    across = (normals[..., 1] * about[..., 0] - normals[..., 0] * about[..., 1])[..., None] / lever
    jacobian = np.concatenate([normals, across], axis=-1)
    residual = np.einsum("bmi,bmi->bm", normals, fixed - moved)
    normal_matrix = np.swapaxes(jacobian, -1, -2) @ jacobian
    right_side = np.einsum("bmp,bm->bp", jacobian, residual)
    solved = np.linalg.pinv(normal_matrix, hermitian=True) @ right_side[..., None]
    solved[:, 2:] /= lever
    return rigid.about(middle[:, 0], solved[..., 0])


def check_points(name: str, value: ArrayLike, dimensions: int | None = None) -> Array:
    """One or more finite points (..., N, 2); of one set only, if its array has two dimensions."""
    shape = "(N, 2)" if dimensions == 2 else "(..., N, 2)"
    return rigid.BOUNDS.array(name, check_finite(name, value, shape, empty=False))
