"""The path of a vehicle from its velocities at known times, and how certain it is.

Between two estimates the velocity xi is taken as linear.  Over an interval h the vehicle then moves
by exp(Omega), with the first two terms of the Magnus expansion,

    Omega = h / 2 (xi_a + xi_b) + h^2 / 12 [xi_a, xi_b],

where [., .] is the bracket of SE(2) (Magnus 1954; Iserles et al. 2000).  For a velocity that is not
linear the error is of third order.
"""

from typing import NamedTuple

import numpy as np

from d2d import rigid
from d2d._types import Array
from d2d.radar.tracks.filter import MEMORY, PERSISTENCE

ROUNDED = 1e-6  # s, of times since 1970


class Displacement(NamedTuple):
    """Motions over n spans of time, each in the vehicle frame at its start."""

    motion: Array  # (n, 3) x and y in m, yaw in rad
    covariance: Array  # (n, 3, 3)


class Knots(NamedTuple):
    """The m velocities between which that of the path is linear, and their errors.

    They are the accepted ones and, where none was for longer than the filter remembers, the
    guesses.  The first, an interval before the first estimate, is extrapolated from that and one
    that is at least as much later.
    """

    times: Array  # (m,) s
    theta: Array  # (m, 3)
    errors: Array  # (m, 2, n, n + k), as `Track.errors`

    def motions(self, times: Array) -> Array:
        """The twists Omega (n - 1, 3) between times (n,), none of which has a knot in between.

        Beyond the knots the velocity is that of the nearest one.
        """
        velocity = np.column_stack([np.interp(times, self.times, v) for v in self.theta.T])
        a, b, passed = velocity[:-1], velocity[1:], np.diff(times)[:, None]
        bracket = np.cross(a, b) * [1.0, 1.0, 0.0]
        return np.asarray(0.5 * passed * (a + b) + passed**2 / 12.0 * bracket)

    def displacement(self, start: float, ends: Array) -> Displacement:
        """The motions (n, 3) from a time to later ones, and their covariances; nan if unknown.

        The error of the pose, along the axes at the start, depends on those of the velocities at
        the knots before and after, with which it has the covariances ``behind`` and, that of all
        of the state and of the slow errors, ``ahead``.
        """
        found = Displacement(np.full((len(ends), 3), np.nan), np.full((len(ends), 3, 3), np.nan))
        i = max(int(np.searchsorted(self.times, start, side="right")) - 1, 0)
        if start < self.times[0] - ROUNDED or len(self.times) < 2:
            return found
        last = min(int(np.searchsorted(self.times, ends.max())), len(self.times) - 1)
        nodes = np.unique(np.concatenate([[start], self.times[i + 1 : last], ends]))
        nodes = nodes[nodes <= self.times[-1] + ROUNDED]
        if len(nodes) < 2:
            return found
        moves, slopes, _ = rigid.exponential_derivatives(self.motions(nodes))
        poses = chain(moves, np.zeros(3))
        turned = rigid.rotation(poses[:-1, 2])
        slopes[:, :2] = turned @ slopes[:, :2]
        slopes *= 0.5 * np.diff(nodes)[:, None, None]
        longest = max(MEMORY, 2.5 * float(np.median(np.diff(self.times))))
        total, behind = np.zeros((3, 3)), np.zeros((3, 3))
        ahead, i = np.zeros(self.errors.shape[2:])[:3], i - 1
        for n, time in enumerate(nodes[1:]):
            if n == 0 or (i + 2 < len(self.times) and nodes[n] >= self.times[i + 1]):
                i += 1
                passed = self.times[i + 1] - self.times[i]
                if passed > longest:
                    break
                behind, ahead = ahead[:, :3], self._carried(ahead, i)
                own, later = self.errors[i, 1, :3], self.errors[i + 1, 1, :3]
                both = self._carried(own, i)
            share = (nodes[n] + time - 2.0 * self.times[i]) / passed
            move = np.eye(3)
            move[:2, 2] = poses[n, 1] - poses[n + 1, 1], poses[n + 1, 0] - poses[n, 0]
            # by the errors of the pose and of the velocities at the knots before and after
            step = np.hstack([move, (2.0 - share) * slopes[n], share * slopes[n]])
            with_before = np.vstack([behind, own[:, :3], both[:, :3].T])
            with_after = np.vstack([ahead, both, later])
            with_pose = np.vstack([total, behind.T, ahead[:, :3].T])
            joint = np.hstack([with_pose, with_before, with_after[:, :3]])
            total, behind, ahead = step @ joint @ step.T, step @ with_before, step @ with_after
            found.motion[ends == time] = poses[n + 1]
            found.covariance[ends == time] = 0.5 * (total + total.T)
        return found

    def _carried(self, covariance: Array, i: int) -> Array:
        """The covariance (3, n + k) with state and slow errors at knot i, at the next one."""
        transition = self.errors[i + 1, 0]
        kept = np.exp((self.times[i] - self.times[i + 1]) / PERSISTENCE)
        return np.hstack([covariance @ transition.T, kept * covariance[:, len(transition) :]])


def independent(covariances: Array) -> Array:
    """Errors of velocities with the covariances (n, 3, 3) that do not depend on each other."""
    errors = np.zeros((len(covariances), 2, 6, 6))
    errors[:, 1, :3, :3] = covariances
    return errors


def chain(moves: Array, start: Array) -> Array:
    """The poses (n + 1, 3) [x, y, yaw] after each of the motions (n, 3), beginning at ``start``."""
    yaw = start[2] + np.append(0.0, np.cumsum(moves[:, 2]))
    moved = np.einsum("nij,nj->ni", rigid.rotation(yaw[:-1]), moves[:, :2])
    position = start[:2] + np.concatenate([np.zeros((1, 2)), np.cumsum(moved, axis=0)])
    return np.column_stack([position, yaw])
