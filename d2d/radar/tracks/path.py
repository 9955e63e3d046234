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

    def motions(self, begins: Array, ends: Array) -> Array:
        """The twists Omega (n, 3) from times (n,) to others, without a knot in between.

        Beyond the knots the velocity is that of the nearest one.
        """
        a, b = np.stack([np.interp([begins, ends], self.times, v) for v in self.theta.T], axis=-1)
        passed = (ends - begins)[:, None]
        bracket = np.cross(a, b) * [1.0, 1.0, 0.0]
        return np.asarray(0.5 * passed * (a + b) + passed**2 / 12.0 * bracket)

    def displacement(self, start: float, ends: Array) -> Displacement:
        """The motions (n, 3) from a time to later ones, and their covariances; nan if unknown.

        They are those from knot to knot, and from the last knot before an end to the end.  The
        error of the pose, along the axes at the start, depends on those of the velocities at the
        knots before and after, with which it has the covariances ``behind`` and, that of all of the
        state and of the slow errors, ``ahead``.
        """
        found = Displacement(np.full((len(ends), 3), np.nan), np.full((len(ends), 3, 3), np.nan))
        if start < self.times[0] - ROUNDED or len(self.times) < 2:
            return found
        passed, last = np.diff(self.times), len(self.times) - 1
        i = min(max(int(np.searchsorted(self.times, start, side="right")) - 1, 0), last - 1)
        silences = np.flatnonzero(passed[i:] > max(MEMORY, 2.5 * float(np.median(passed))))
        last = int(np.append(i + silences, last)[0])
        known = np.flatnonzero(ends <= self.times[last] + ROUNDED)
        if not len(known):
            return found
        # the knots before the steps to the ends, then before those from knot to knot
        before = np.minimum(np.searchsorted(self.times, ends[known]) - 1, last - 1).clip(min=i)
        through = np.arange(i, before.max())
        before = np.append(before, through)
        begins = np.where(before == i, start, self.times[before])
        stops = np.append(ends[known], self.times[through + 1])
        moves, slopes, _ = rigid.exponential_derivatives(self.motions(begins, stops))
        at = chain(moves[len(known) :], np.zeros(3))[before - i]
        poses = rigid.compose(at, moves)
        slopes[:, :2] = rigid.rotation(at[:, 2]) @ slopes[:, :2]
        slopes *= 0.5 * (stops - begins)[:, None, None]
        share = ((begins + stops - 2.0 * self.times[before]) / passed[before])[:, None, None]
        turned = np.tile(np.eye(3), (len(at), 1, 1))
        turned[:, 0, 2], turned[:, 1, 2] = at[:, 1] - poses[:, 1], poses[:, 0] - at[:, 0]
        # by the errors of the pose and of the velocities at the knots before and after
        steps = np.concatenate([turned, (2.0 - share) * slopes, share * slopes], axis=2)
        total, ahead = np.zeros((3, 3)), np.zeros(self.errors.shape[2:])[:3]
        covariances, order = np.empty_like(turned), np.argsort(before, kind="stable")
        for n, own in enumerate(np.split(order, np.cumsum(np.bincount(before - i))[:-1]), start=i):
            behind, ahead = ahead[:, :3], self._carried(ahead, n)
            first, second = self.errors[n : n + 2, 1, :3]
            both = self._carried(first, n)
            with_before = np.vstack([behind, first[:, :3], both[:, :3].T])
            with_after = np.vstack([ahead, both, second])
            with_pose = np.vstack([total, behind.T, ahead[:, :3].T])
            joint = np.hstack([with_pose, with_before, with_after[:, :3]])
            covariances[own] = steps[own] @ joint @ steps[own].swapaxes(1, 2)
            total, ahead = covariances[own[-1]], steps[own[-1]] @ with_after  # at the next knot
        found.motion[known] = poses[: len(known)]
        found.covariance[known] = 0.5 * (covariances + covariances.swapaxes(1, 2))[: len(known)]
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
