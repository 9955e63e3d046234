"""A cost bound to the pairs of point sets that it is evaluated and minimised for."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from d2d import _kernel, rigid
from d2d._checks import broadcast_batches
from d2d._lazy import lazy
from d2d._slices import run_in_slices
from d2d._types import Array
from d2d.frame import Frame, packed_about_origins
from d2d.measurement import LinearMeasurement
from d2d.point_set import PointSet

_NO_FACTORS = np.empty((0, 9))
_NO_PRIOR = np.zeros(3)


class Pair(NamedTuple):
    """Two point sets, a measurement of each moving target, and the time between the two.

    ``interval`` (s) counts only where the parameters are a velocity.
    """

    fixed: PointSet
    moving: PointSet
    measurement: LinearMeasurement | None = None
    interval: float = 1.0

    def inflated(self, scale: float) -> "Pair":
        """The pair with all standard deviations multiplied by ``scale``."""
        measurement = None if self.measurement is None else self.measurement.inflated(scale)
        return Pair(
            self.fixed.inflated(scale), self.moving.inflated(scale), measurement, self.interval
        )


class CostForm(NamedTuple):
    """A registration cost as the kernel reads it."""

    d2d: bool
    fusion: int
    outlier: Array  # (6,)


class Bound(NamedTuple):
    """A batch of problems at their parameters, in the layout that the kernel reads."""

    thetas: Array  # (B, 3)
    batch: _kernel.Batch
    shape: tuple[int, ...]  # of the batch
    frame: Frame | None = None  # of the thetas, if it is not the user's
    given: Array | None = None  # (B, 3) in the user's frame, if there is another

    def part(self, first: int, last: int) -> _kernel.Batch:
        """The problems from ``first`` to ``last``."""
        return self.batch._replace(first=self.batch.first[first : last + 1])


class CrossDerivatives(NamedTuple):
    """d2f / d theta d z, one block for each measured quantity."""

    fixed: Array  # (..., N, P, D): in the fixed means
    moving: Array  # (..., K, P, D): in the moving means
    measured: Array  # (..., K, P): in the measurement's values; zero without a measurement
    input: Array  # (..., K, P): in its inputs, through its predictions only; zero without one


@dataclass(frozen=True, eq=False)
class Problem:
    """A cost that one or several pairs of point sets share.

    The cost is the sum of those of the pairs; all have a measurement, or none.  The parameters are
    the motion (one pair), or a velocity [v_x, v_y, omega] that all pairs share: each is moved by
    the SE(2) exponential of its own interval times the velocity, or, to first order, by that
    product itself.

    Attributes
    ----------
    form : CostForm
    pairs : sequence of Pair
        One, which may be a batch, or several single ones.
    kind : int
        ``_kernel.MOTION``, ``ARC`` or ``CHORD``.
    prior : (3,) array
        Precisions of a Gaussian prior of the parameters about zero, whose negative logarithm is
        added, without its constant.
    """

    form: CostForm
    pairs: Sequence[Pair]
    kind: int = _kernel.MOTION
    prior: Array = field(default_factory=lambda: _NO_PRIOR)

    @property
    def parameters(self) -> int:
        """Number P of parameters."""
        return rigid.PARAMETERS[self.pairs[0].fixed.dimension]

    @property
    def size(self) -> int:
        """Number of pairs of a target and a component in one problem."""
        return sum(pair.fixed.size * pair.moving.size for pair in self.pairs)

    def inflated(self, scale: float) -> "Problem":
        """The problem with all standard deviations but the prior's multiplied by ``scale``."""
        if scale == 1.0:
            return self
        return replace(self, pairs=[pair.inflated(scale) for pair in self.pairs])

    def bind(self, theta: Array, name: str = "theta") -> Bound:
        """Lay the problem out for parameters (..., P), whose axes broadcast with the pair's.

        ``name`` is what the caller calls ``theta``.
        """
        batches, batch = self._layout
        shape = theta.shape[:-1]
        if any(batches):
            shape = broadcast_batches(f"{name}, fixed, moving and measurement", shape, *batches)
        thetas = np.zeros((*shape, 3))
        thetas[..., : self.parameters] = theta
        thetas = thetas.reshape(-1, 3)
        if shape:
            batch = self._repeated(batch, batches, shape)
        if not self._is_far:
            return Bound(thetas, batch, shape)
        fixed, moving, *_ = self.pairs[0]
        frame = Frame(_origins(fixed, shape), _origins(moving, shape))
        return Bound(frame.inward(thetas), batch, shape, frame, thetas)

    @lazy
    def _is_far(self) -> bool:
        """Whether sets lie so far from the origin that they are shifted to their means.

        Sets with a measurement, and those that share a velocity, are not: these depend on where
        the origin is.
        """
        fixed, moving, measurement, _ = self.pairs[0]
        apart = self.kind == _kernel.MOTION and measurement is None
        return apart and not (fixed._origins is None and moving._origins is None)

    @lazy
    def _layout(self) -> tuple[list[tuple[int, ...]], _kernel.Batch]:
        """The batch shapes of the sets of a single pair, and the layout of one problem."""
        rows, fixed_start, moving_start = [], 0, 0
        for number, (fixed, moving, measurement, _) in enumerate(self.pairs):
            factor_start = -1 if measurement is None else moving_start
            rows.append((fixed_start, fixed.size, number, moving_start, moving.size, factor_start))
            fixed_start, moving_start = fixed_start + fixed.size, moving_start + moving.size
        fixed, moving, measurement, _ = self.pairs[0]
        batches = [fixed.batch_shape, moving.batch_shape]
        batches.append(() if measurement is None else measurement.batch_shape)
        packed = packed_about_origins if self._is_far else _packed
        batch = _kernel.Batch(
            _joined([packed(pair.fixed) for pair in self.pairs], 1),
            _joined([packed(pair.moving) for pair in self.pairs], 1),
            _joined([pair.moving._order for pair in self.pairs], 0),
            _joined([pair.fixed._extremes for pair in self.pairs], 0),
            self._factors(),
            self.form.outlier,
            np.array(rows),
            np.array([pair.interval for pair in self.pairs]),
            np.array([0, len(self.pairs)]),
            float(self.form.d2d),
            float(fixed.dimension == 2),
            self.form.fusion,
            measurement is not None and measurement.of_twist,
            self.kind,
            self.prior,
        )
        return batches, batch

    def _factors(self) -> Array:
        """The packed measurements of all pairs, or of none."""
        packed = [pair.measurement._packed for pair in self.pairs if pair.measurement is not None]
        return _joined(packed, 0) if packed else _NO_FACTORS

    def _repeated(
        self,
        batch: _kernel.Batch,
        batches: list[tuple[int, ...]],
        shape: tuple[int, ...],
    ) -> _kernel.Batch:
        """The layout of a batch of problems, each with its own sets of a single pair's batches."""
        count = math.prod(shape)
        pairs = np.tile(batch.pairs, (count, 1))
        for column, (own, size) in enumerate(zip(batches, pairs[0, [1, 4, 4]], strict=True)):
            if own:
                which = members(own, shape)
                pairs[:, (0, 3, 5)[column]] = which * size
                if column == 0:
                    pairs[:, 2] = which
        return batch._replace(
            pairs=pairs,
            intervals=np.tile(batch.intervals, count),
            first=len(self.pairs) * np.arange(count + 1),
        )

    def derivatives(self, bound: Bound) -> tuple[Array, Array, Array]:
        """Value (B,), gradient (B, 3) and Hessian (B, 3, 3) of each bound problem."""
        count = len(bound.thetas)
        value, gradient, hessian = np.empty(count), np.empty((count, 3)), np.empty((count, 3, 3))
        work = _kernel.own_work()

        def run(first: int, last: int) -> None:
            own = (a[first:last] for a in (value, gradient, hessian))
            _kernel.evaluate_batch(bound.part(first, last), bound.thetas[first:last], work, *own)

        run_in_slices(run, count, self.size)
        if bound.frame is not None:
            gradient, hessian = bound.frame.derivatives(bound.thetas, gradient, hessian)
        return value, gradient, hessian

    def cross_derivatives(self, bound: Bound, begin: int, end: int) -> CrossDerivatives:
        """Derivatives of the gradients of some bound problems in all that is measured.

        They are those in the bound's own frame.  The batch axis counts the problems from ``begin``
        to ``end``; the targets are those of all pairs, one pair after the other.
        """
        p, dimension, count = self.parameters, self.pairs[0].fixed.dimension, end - begin
        fixed = sum(pair.fixed.size for pair in self.pairs)
        moving = sum(pair.moving.size for pair in self.pairs)
        cross = CrossDerivatives(
            np.empty((count, fixed, 3, 2)),
            np.empty((count, moving, 3, 2)),
            np.empty((count, moving, 3)),
            np.empty((count, moving, 3)),
        )
        work = _kernel.make_propagation_work(max(pair.fixed.size for pair in self.pairs))
        _kernel.cross_batch(bound.batch, bound.thetas, begin, work, *cross)
        return CrossDerivatives(
            cross.fixed[:, :, :p, :dimension],
            cross.moving[:, :, :p, :dimension],
            cross.measured[:, :, :p],
            cross.input[:, :, :p],
        )

    def log_densities(self, bound: Bound) -> Array:
        """log q_k (..., K) of every target of every pair, one pair after the other."""
        return self._of_targets(bound, (_kernel.LOG_DENSITY,))[..., 0, :]

    def inlier_shares(self, bound: Bound) -> Array:
        """Share (..., K) of the inlier component in each target's density."""
        if self.form.outlier[0] == _kernel.NO_OUTLIER:
            return np.ones((*bound.shape, sum(pair.moving.size for pair in self.pairs)))
        return self._of_targets(bound, (_kernel.SHARE,))[..., 0, :]

    def widening_slopes(self, bound: Bound) -> Array:
        """Derivatives (..., K) of each log q_k in a variance added to all targets, of either set.

        With variances v added along each axis, S = S_0 + 2 v I for every pair of targets.  By the
        heat equation dN / dS = N_dd / 2, so that dN / dv is the Laplacian of N in the translation:
        the slope is the inlier component's share times the Laplacian of the density of the position
        over itself.  The factor of the measurement does not depend on v.
        """
        outlier, pairs = self.form.outlier.copy(), bound.batch.pairs.copy()
        outlier[_kernel.KIND] = _kernel.NO_OUTLIER
        pairs[:, -1] = -1  # no measurements
        positions = bound._replace(batch=bound.batch._replace(outlier=outlier, pairs=pairs))
        second = self._of_targets(positions, (_kernel.CURVATURE[0], _kernel.CURVATURE[4]))
        return np.asarray(self.inlier_shares(bound) * second.sum(axis=-2))

    def scores(self, bound: Bound, begin: int, end: int) -> tuple[Array, Array]:
        """What each target adds to the gradient (C, K, P) and Hessian (C, K, P, P) of the cost.

        Of the bound problems from ``begin`` to ``end``; targets as in `cross_derivatives`.
        """
        first = bound.batch.first[begin : end + 1]
        part = Bound(bound.thetas[begin:end], bound.batch._replace(first=first), (end - begin,))
        rows = (_kernel.LOG_DENSITY, *_kernel.GRADIENT, *_kernel.CURVATURE)
        terms = np.swapaxes(self._of_targets(part, rows), 1, 2)
        gradients, hessians, start = [], [], 0
        for pair in self.pairs:
            own = terms[:, start : start + pair.moving.size]
            g, second = own[..., 1:4], own[..., 4:].reshape(*own.shape[:2], 3, 3)
            outer = g[..., :, None] * g[..., None, :]
            if self.form.fusion == _kernel.SUMMING:
                share = np.exp(own[..., 0] - own[..., 0].max(axis=1, keepdims=True))
                share /= share.sum(axis=1, keepdims=True)
                mean = (share[..., None] * g).sum(axis=1)[:, None]
                outer = 0.5 * (g[..., :, None] * mean[..., None, :])
                outer = outer + np.swapaxes(outer, -1, -2)
                g, second = share[..., None] * g, share[..., None, None] * second
                outer = share[..., None, None] * outer
            gradient, hessian = -g, outer - second
            if self.kind != _kernel.MOTION:
                gradient, hessian = self._in_velocity(part.thetas, pair, gradient, hessian)
            gradients.append(gradient)
            hessians.append(hessian)
            start += pair.moving.size
        p, gradient, hessian = self.parameters, np.hstack(gradients), np.hstack(hessians)
        if bound.frame is not None:
            count, targets = gradient.shape[:2]
            gradient, hessian = bound.frame.repeated(begin, end, targets).derivatives(
                np.repeat(part.thetas, targets, axis=0),
                gradient.reshape(-1, 3),
                hessian.reshape(-1, 3, 3),
            )
            gradient = gradient.reshape(count, targets, 3)
            hessian = hessian.reshape(count, targets, 3, 3)
        return gradient[..., :p], hessian[..., :p, :p]

    def _in_velocity(
        self, thetas: Array, pair: Pair, gradient: Array, hessian: Array
    ) -> tuple[Array, Array]:
        """Derivatives (B, K, ...) in a pair's motion become those in the velocity (B, 3)."""
        tau = pair.interval
        if self.kind == _kernel.CHORD:
            return tau * gradient, tau**2 * hessian
        _, first, second = rigid.exponential_derivatives(tau * thetas)
        bent = np.einsum("bki,biuv->bkuv", gradient, second)
        turned = np.swapaxes(first, -1, -2)[:, None] @ hessian @ first[:, None]
        return tau * (gradient @ first), tau**2 * (turned + bent)

    def _of_targets(self, bound: Bound, rows: tuple[int, ...]) -> Array:
        """Rows of the kernel's results for each target (..., rows, K)."""
        targets = sum(pair.moving.size for pair in self.pairs)
        values = np.empty((len(bound.thetas), len(rows), targets))
        work, numbers = _kernel.own_work(), np.array(rows)

        def run(first: int, last: int) -> None:
            thetas, own = bound.thetas[first:last], values[first:last]
            _kernel.target_batch(bound.part(first, last), thetas, numbers, work, own)

        run_in_slices(run, len(values), self.size)
        return values.reshape(*bound.shape, len(rows), targets)


def _packed(points: PointSet) -> Array:
    return points._packed


def _origins(points: PointSet, shape: tuple[int, ...]) -> Array:
    """The origin (B, 2) of the set that each problem of a batch takes."""
    origins = np.zeros((1, 2)) if points._origins is None else points._origins
    return origins[members(points.batch_shape, shape)] if len(origins) > 1 else origins


def members(own: tuple[int, ...], shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Which member of a batch of the shape ``own`` each problem of a batch takes, both flat."""
    return np.broadcast_to(np.arange(math.prod(own)).reshape(own), shape).ravel()


def check_pair(
    fixed: PointSet, moving: PointSet, measurement: LinearMeasurement | None = None
) -> Pair:
    """A pair whose parts fit together; a ``ValueError`` names the one that does not."""
    for name, points in (("fixed", fixed), ("moving", moving)):
        if not isinstance(points, PointSet):
            raise ValueError(f"{name} must be a PointSet, but is a {type(points).__name__}")
    if fixed.dimension != moving.dimension:
        raise ValueError(
            f"fixed and moving must have the same dimension, "
            f"but have {fixed.dimension} and {moving.dimension}"
        )
    if measurement is not None:
        _check_measurement(measurement, moving)
    return Pair(fixed, moving, measurement)


def _check_measurement(measurement: LinearMeasurement, moving: PointSet) -> None:
    if not isinstance(measurement, LinearMeasurement):
        raise ValueError(
            f"measurement must be a LinearMeasurement, but is a {type(measurement).__name__}"
        )
    parameters = rigid.PARAMETERS[moving.dimension]
    if (measurement.size, measurement.parameters) != (moving.size, parameters):
        raise ValueError(
            f"measurement must have {moving.size} targets and {parameters} parameters to "
            f"match moving, but has {measurement.size} and {measurement.parameters}"
        )


def _joined(arrays: list[NDArray[Any]], axis: int) -> NDArray[Any]:
    """The arrays one after the other, without a copy of a single one."""
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays, axis=axis)
