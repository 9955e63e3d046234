"""How far a vehicle has moved between two times, and how certain that is."""

from typing import NamedTuple

import numpy as np

from d2d import rigid
from d2d._types import Array

# s, over which errors that all targets share stay about the same: those of v_x on a RadarScenes
# drive correlate by 0.54 after 7.5 s.  With it, the mean NEES of displacements, over 3, is 0.4 to
# 2.9 on two RadarScenes drives over 1 to 30 s and 0.06 to 1.9 on five nuScenes scenes over 1 to
# 10 s, where independent errors would give 5 to 63.
PERSISTENCE = 15.0
_GAP, _CYCLES = 1.0, 2.5  # s, and usual intervals, without an accepted estimate: a gap


class Displacement(NamedTuple):
    """Motions over n spans of time, each in the vehicle frame at its start."""

    motion: Array  # (n, 3) x and y in m, yaw in rad
    covariance: Array  # (n, 3, 3)


class Driven(NamedTuple):
    """The n accepted estimates of a track, each the velocity since the one before."""

    begins: Array  # (n,) s
    ends: Array  # (n,) s
    theta: Array  # (n, 3)
    white: Array  # (n, 3, 3) covariance of what is independent from one estimate to the next
    slow: Array  # (n, 3, 3) roots of the covariance of what persists
    gap: float  # s without an accepted estimate, over which the motion is not known

    @classmethod
    def of(
        cls,
        intervals: Array,
        start: float,
        times: Array,
        theta: Array,
        white: Array,
        systematic: Array,
    ) -> "Driven":
        """With the intervals of all estimates, and the time at which the first of them begins."""
        begins = np.concatenate([[start], times])[:-1]
        gap = max(_GAP, _CYCLES * float(np.median(intervals))) if len(intervals) else _GAP
        return cls(begins, times, theta, white, _roots(systematic), gap)

    def displacement(self, start: Array, end: Array) -> Displacement:
        """See `Track.displacement`; the times (n,) are known to be good."""
        found = [self.between(*span) for span in zip(start.tolist(), end.tolist(), strict=True)]
        motions = np.array([motion for motion, _ in found]).reshape(-1, 3)
        return Displacement(motions, np.array([own for _, own in found]).reshape(-1, 3, 3))

    def between(self, start: float, end: float) -> tuple[Array, Array]:
        """The motion (3,) from a time to a later one, and its covariance (3, 3); nan if unknown.

        The error of the motion so far, in the vehicle frame, and the slow errors in units of their
        standard deviations are one Gaussian of six components.  The slow ones decay over
        PERSISTENCE and are renewed as fast (a first-order Gauss-Markov process).
        """
        first = int(np.searchsorted(self.ends, start, side="right"))
        last = int(np.searchsorted(self.ends, end, side="left"))
        spans = slice(first, last + 1)
        begins, ends = self.begins[spans].copy(), self.ends[spans].copy()
        inside = last < len(self.ends) and start >= self.begins[0]
        if not inside or (ends - begins > self.gap).any():
            return np.full(3, np.nan), np.full((3, 3), np.nan)
        begins[0], ends[-1] = start, end
        pose, joint = np.zeros(3), np.diag([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
        for i, interval in enumerate((ends - begins).tolist(), start=first):
            move, slopes, _ = rigid.exponential_derivatives(interval * self.theta[i])
            back = np.eye(3)
            back[:2, :2] = rigid.rotation(-move[2])
            carried = back.copy()
            carried[:2, 2] = back[:2, :2] @ [-move[1], move[0]]
            given = interval * back @ slopes
            kept = np.exp(-interval / PERSISTENCE)
            step = np.block([[carried, given @ self.slow[i]], [np.zeros((3, 3)), kept * np.eye(3)]])
            joint = step @ joint @ step.T
            joint[:3, :3] += given @ self.white[i] @ given.T
            joint[3:, 3:] += (1.0 - kept**2) * np.eye(3)
            pose = rigid.compose(pose, move)
        turned = np.eye(3)
        turned[:2, :2] = rigid.rotation(pose[2])
        return pose, turned @ joint[:3, :3] @ turned.T


def _roots(matrices: Array) -> Array:
    """Symmetric roots (n, 3, 3) of covariances, which need not be of full rank."""
    values, vectors = np.linalg.eigh(matrices)
    scaled = vectors * np.sqrt(np.clip(values, 0.0, None))[:, None, :]
    return np.asarray(scaled @ np.swapaxes(vectors, -1, -2))
