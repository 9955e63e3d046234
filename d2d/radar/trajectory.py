"""The motion along a drive, as `d2d.radar.track` and `d2d.radar.track_joint` give it."""

import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from d2d import rigid
from d2d._checks import check_finite, check_path
from d2d._types import Array
from d2d.radar.budget import CovarianceParts


@dataclass(frozen=True, eq=False)
class Track:
    """The motion along a drive, one row for each scan (or round of scans) after the first.

    Attributes
    ----------
    times : (n,) array, s
        Time of each current scan.
    intervals : (n,) array, s
        Time since the scan before.
    theta : (n, 3) array
        Velocity [v_x, v_y, omega] in m/s, m/s, rad/s.  Where not converged, it is the last
        converged one or, before any has converged, the initial velocity or zero.
    covariance : (n, 3, 3) array
        Covariance of ``theta``; nan where not converged.  Without a budget, the inverse Hessian;
        with one, the sum of the ``parts``.
    converged : (n,) array of bool
        Whether an optimum was found and accepted.
    reasons : (n,) array of str
        Why an estimate was not accepted; empty where it was.  This and the following are None if
        not known.
    targets : (n,) array of int
        Number of targets of the current scans.
    inliers : (n,) array
        Mean inlier probability of these targets; nan where there was nothing to estimate.
    parts : CovarianceParts or None
        The parts of the covariance, nan where not converged; None without a budget.
    """

    times: Array
    intervals: Array
    theta: Array
    covariance: Array
    converged: NDArray[np.bool_]
    reasons: NDArray[np.str_] | None = None
    targets: NDArray[np.int64] | None = None
    inliers: Array | None = None
    parts: CovarianceParts | None = None

    def poses(self, start: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
        """The path driven: (n + 1, 3) poses [x, y, yaw] in m, m, rad, beginning at ``start``.

        Pose i + 1 is pose i followed by the motion of pair i, exp(tau theta).
        """
        return integrate(self.theta, self.intervals, start)

    def write_tum(self, path: str | os.PathLike[str], start: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """Write the poses as a TUM trajectory file, one line "t x y z qx qy qz qw" per pose.

        `evo` and other tools read this format; t is in s, and the vehicle stays in the plane z = 0.

        Parameters
        ----------
        path : path
            Path of the file; an existing file is overwritten, and a leading ``~`` is replaced by
            the home folder.
        start : (3,) array, m, m, rad
            The first pose, as for `poses`.

        Raises
        ------
        ValueError
            If ``path`` is not a path or ``start`` is not a pose; the message names the argument.
        OSError
            If the file cannot be written.
        """
        x, y, yaw = self.poses(start).T
        first = self.times[:1] - self.intervals[:1]
        zero = np.zeros_like(x)
        turn = np.sin(0.5 * yaw), np.cos(0.5 * yaw)
        columns = [np.concatenate([first, self.times]), x, y, zero, zero, zero, *turn]
        np.savetxt(check_path("path", path), np.column_stack(columns), "%.9f")


def integrate(theta: ArrayLike, intervals: ArrayLike, start: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """Chain the motions at theta (n, 3) over intervals (n,) to poses (n + 1, 3) [x, y, yaw]."""
    velocities, times = rigid.motion("theta", theta, 2), check_finite("intervals", intervals)
    if velocities.ndim != 2 or times.shape != velocities.shape[:1]:
        raise ValueError(
            f"theta and intervals must have the shapes (n, 3) and (n,), but have "
            f"{velocities.shape} and {times.shape}"
        )
    twists = velocities * times[:, np.newaxis]
    steps = rigid.exponential(twists)
    first = rigid.motion("start", start, 2)
    if first.shape != (3,):
        raise ValueError(f"start must have the shape (3,), but has {first.shape}")
    yaw = first[2] + np.concatenate([[0.0], np.cumsum(steps[:, 2])])
    moved = np.einsum("nij,nj->ni", rigid.rotation(yaw[:-1]), steps[:, :2])
    position = first[:2] + np.concatenate([np.zeros((1, 2)), np.cumsum(moved, axis=0)])
    return np.column_stack([position, yaw])
