"""The path of a vehicle from its velocities at known times, and how certain it is.

Between two estimates the velocity xi is taken as linear.  Over an interval h the vehicle then moves
by exp(Omega), with the first two terms of the Magnus expansion,

    Omega = h / 2 (xi_a + xi_b) + h^2 / 12 [xi_a, xi_b],

where [., .] is the bracket of SE(2) (Magnus 1954; Iserles et al. 2000).  For a velocity that is not
linear the error is of third order.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from d2d import rigid
from d2d._checks import check_finite
from d2d._types import Array

# s, over which errors that all targets share stay about the same: those of v_x on a RadarScenes
# drive correlate by 0.54 after 7.5 s.  With it, the mean NEES of displacements, over 3, is 0.4 to
# 2.9 on two RadarScenes drives over 1 to 30 s and 0.06 to 1.9 on five nuScenes scenes over 1 to
# 10 s, where independent errors would give 5 to 63.
PERSISTENCE = 15.0
_ROUNDED = 1e-6  # s, of times since 1970
_GAP, _CYCLES = 1.0, 2.5  # s, and usual intervals, without an accepted estimate: a gap


class Displacement(NamedTuple):
    """Motions over n spans of time, each in the vehicle frame at its start."""

    motion: Array  # (n, 3) x and y in m, yaw in rad
    covariance: Array  # (n, 3, 3)


class Knots(NamedTuple):
    """The m - 1 accepted velocities of a track, and one before them; linear in between.

    The track begins an interval before its first estimate.  The velocity there is extrapolated from
    the first estimate and a later one, at least as far away, but over no longer than a gap.
    """

    times: Array  # (m,) s
    theta: Array  # (m, 3)
    later: int  # the knot from which, beside the first estimate, the velocity is extrapolated
    ratio: float  # by how many times the difference of the two
    gap: float  # s without an accepted estimate, over which a displacement is not known

    @classmethod
    def of(
        cls, times: Array, intervals: Array, theta: Array, converged: NDArray[np.bool_]
    ) -> "Knots":
        """From the fields of a track; without an accepted estimate, its first velocity alone."""
        begin, gap = times[0] - intervals[0], max(_GAP, _CYCLES * float(np.median(intervals)))
        known, values = times[converged], theta[converged]
        if not len(known):
            return cls(np.array([begin]), theta[:1], 0, 0.0, gap)
        begin = max(begin, known[0] - gap)
        reach = float(known[0] - begin)
        later = min(int(np.searchsorted(known, known[0] + reach)), len(known) - 1)
        ratio = reach / float(known[later] - known[0]) if later else 0.0
        first = values[0] - ratio * (values[later] - values[0])
        return cls(np.append(begin, known), np.vstack([first, values]), later + 1, ratio, gap)

    def motions(self, times: Array) -> Array:
        """The twists Omega (n - 1, 3) between times (n,), none of which has a knot in between.

        Beyond the knots the velocity is that of the nearest one.
        """
        velocity = np.column_stack([np.interp(times, self.times, v) for v in self.theta.T])
        a, b, passed = velocity[:-1], velocity[1:], np.diff(times)[:, None]
        bracket = np.zeros_like(a)
        bracket[:, 0] = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
        bracket[:, 1] = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
        return np.asarray(0.5 * passed * (a + b) + passed**2 / 12.0 * bracket)

    def displacement(self, start: float, end: float, white: Array, slow: Array) -> Displacement:
        """The motion (3,) from a time to a later one, and its covariance (3, 3); nan if unknown.

        The errors of the estimates are independent of each other with the covariances ``white``
        (m - 1, 3, 3), and slow ones with the roots ``slow`` (m - 1, 3, 3).
        """
        first = max(int(np.searchsorted(self.times, start, side="right")) - 1, 0)
        last = int(np.searchsorted(self.times, end, side="left"))
        outside = start < self.times[0] - _ROUNDED or last >= len(self.times)
        if outside or (np.diff(self.times[first : last + 1]) > self.gap).any():
            return Displacement(np.full(3, np.nan), np.full((3, 3), np.nan))
        nodes = np.array([start, *self.times[first + 1 : last], end])
        motion, effects = _with_effects(np.diff(nodes), self.motions(nodes))
        used = np.arange(first, max(last, 0 if first else self.later) + 1)
        of_knots = np.zeros((len(used), 3, 3))
        of_knots[1 : last - first] = effects[1:-1]
        for effect, time, before in ((effects[0], start, first), (effects[-1], end, last - 1)):
            share = (time - self.times[before]) / (self.times[before + 1] - self.times[before])
            of_knots[before - first] += (1.0 - share) * effect
            of_knots[before - first + 1] += share * effect
        if not first:  # which is extrapolated
            of_knots[1] += (1.0 + self.ratio) * of_knots[0]
            of_knots[self.later] -= self.ratio * of_knots[0]
            used, of_knots = used[1:], of_knots[1:]
        noise = of_knots @ white[used - 1] @ of_knots.swapaxes(-1, -2)
        added = _persistent(of_knots @ slow[used - 1], np.diff(self.times[used]))
        return Displacement(motion, noise.sum(axis=0) + added)


def _with_effects(passed: Array, twists: Array) -> tuple[Array, Array]:
    """The motion (3,) by twists (n, 3) over times (n,), and its derivatives in the velocities.

    Those (n + 1, 3, 3) are of the motion along the axes at the start, in the velocities before,
    between and after the twists, of which each twist is the mean times the time.
    """
    moves, slopes, _ = rigid.exponential_derivatives(twists)
    poses = chain(moves, np.zeros(3))
    back = rigid.rotation(-moves[:, 2])
    slopes[:, :2] = back @ slopes[:, :2]  # along the axes after the move
    effects = np.zeros((len(passed) + 1, 3, 3))
    ahead = poses[-1, :2] - poses[1:, :2]
    moved = np.zeros_like(slopes)
    moved[:, :2] = rigid.rotation(poses[1:, 2]) @ slopes[:, :2]
    moved[:, 0] -= ahead[:, 1, None] * slopes[:, 2]
    moved[:, 1] += ahead[:, 0, None] * slopes[:, 2]
    moved[:, 2] = slopes[:, 2]
    moved *= 0.5 * passed[:, None, None]
    effects[:-1] += moved
    effects[1:] += moved
    return poses[-1], effects


def _persistent(effects: Array, passed: Array) -> Array:
    """Covariance (3, 3) of the sum of effects (n, 3, 3) of errors that decay over PERSISTENCE.

    They are renewed as fast (a first-order Gauss-Markov process), over times (n - 1,) in between.
    """
    total, so_far = np.zeros((3, 3)), np.zeros((3, 3))
    for effect, kept in zip(effects, np.exp(-np.append(0.0, passed) / PERSISTENCE), strict=True):
        so_far = kept * so_far
        both = so_far @ effect.T
        total += both + both.T + effect @ effect.T
        so_far = so_far + effect
    return total


def roots(matrices: Array) -> Array:
    """Symmetric roots (n, 3, 3) of covariances, which need not be of full rank."""
    values, vectors = np.linalg.eigh(matrices)
    scaled = vectors * np.sqrt(np.clip(values, 0.0, None))[:, None, :]
    return np.asarray(scaled @ np.swapaxes(vectors, -1, -2))


def integrate(theta: ArrayLike, intervals: ArrayLike, start: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """Chain motions at constant velocities (n, 3), each over its interval, to poses (n + 1, 3).

    So the mean velocities of successive pairs of scans make a path.  Velocities at known times do
    not: `Track.poses` is for these.
    """
    velocities = check_finite("theta", theta, "(n, 3)")
    times = check_finite("intervals", intervals, f"({len(velocities)},)", like="theta")
    return chain(
        rigid.exponential(velocities * times[:, None]), check_finite("start", start, "(3,)")
    )


def chain(moves: Array, start: Array) -> Array:
    """The poses (n + 1, 3) [x, y, yaw] after each of the motions (n, 3), beginning at ``start``."""
    yaw = start[2] + np.append(0.0, np.cumsum(moves[:, 2]))
    moved = np.einsum("nij,nj->ni", rigid.rotation(yaw[:-1]), moves[:, :2])
    position = start[:2] + np.concatenate([np.zeros((1, 2)), np.cumsum(moved, axis=0)])
    return np.column_stack([position, yaw])
