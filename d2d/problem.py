"""A cost bound to the pairs of point sets that it is evaluated and minimised for."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from d2d import rigid
from d2d._checks import broadcast_batches, check_instance
from d2d._kernel import entries, layout, propagate, rows, tiles
from d2d._kernel.newton import FLAT
from d2d._slices import run_in_slices
from d2d._types import Array
from d2d.measurement import LinearMeasurement
from d2d.point_set import PointSet

TOLERANCE = 1e-14  # of the Newton decrement: 1e-7 standard deviations from the optimum
MAX_ITERATIONS = 200
_TINY = 1e-6  # part of a direction that counts as zero


class Pair(NamedTuple):
    """Two point sets, a measurement of each moving target, and the time between the two.

    A motion does not depend on the ``interval`` (s), a velocity does.
    """

    fixed: PointSet
    moving: PointSet
    measurement: LinearMeasurement | None = None
    interval: float = 1.0

    @property
    def batch_shapes(self) -> list[tuple[int, ...]]:
        """Batch shapes of both sets and of the measurement."""
        measured = () if self.measurement is None else self.measurement.batch_shape
        return [self.fixed.batch_shape, self.moving.batch_shape, measured]

    def inflated(self, scale: float) -> "Pair":
        """The pair with all standard deviations multiplied by ``scale``."""
        measurement = None if self.measurement is None else self.measurement.inflated(scale)
        fixed, moving = self.fixed.inflated(scale), self.moving.inflated(scale)
        return Pair(fixed, moving, measurement, self.interval)


class CostForm(NamedTuple):
    """A registration cost as the kernel reads it."""

    d2d: bool
    fusion: int
    outlier: Array  # (6,)


class Bound(NamedTuple):
    """A batch of problems at their parameters, in the layout that the kernel reads."""

    thetas: Array  # (B, 3)
    batch: layout.Batch
    shape: tuple[int, ...]  # of the batch

    def part(self, first: int, last: int) -> layout.Batch:
        """The problems from ``first`` to ``last``."""
        return self.batch._replace(first=self.batch.first[first : last + 1])

    def only(self, which: NDArray[np.bool_]) -> "Bound":
        """The selected problems, each of which has a single pair."""
        pairs, intervals = self.batch.pairs[which], self.batch.intervals[which]
        first = np.arange(len(pairs) + 1)
        batch = self.batch._replace(pairs=pairs, intervals=intervals, first=first)
        return Bound(self.thetas[which], batch, (len(pairs),))


@dataclass(frozen=True, eq=False, repr=False)
class Estimate:
    """The optimum of a registration cost, or a batch of optima.

    Attributes
    ----------
    theta : (..., P) array
        Motion parameters: [t_x] or [t_x, t_y, phi_z] in m, m, rad.
    covariance : (..., P, P) array
        Inverse Hessian; nan where not ``converged``, but for what is ``undetermined``.
    value, gradient, hessian : (...), (..., P), (..., P, P) arrays
        The cost and its derivatives at ``theta``.
    converged : (...) array of bool
        Whether ``theta`` is a local optimum, where the Hessian is positive definite and the Newton
        step vanishes.  It may be the wrong optimum; see `register`.
    iterations : (...) array of int
        Number of Newton steps tried, over all scales.
    inliers : (...) array
        Mean `RegistrationCost.inlier_probabilities` at ``theta``; nan without an outlier model.  A
        low one reveals a wrong optimum, but a high one does not show that it is right: walls that
        slide along each other, or a row that is one post off, match nearly as well.
    fit : (...) array
        Mean squared distance of the inliers from the components that they match, in the standard
        deviations that the sets state, over its expectation: about 1 where the D2D likelihood
        holds, above `fit_region` where targets have no counterpart, the optimum is wrong or the
        standard deviations are too small, below it where they are too large or components overlap.
    freedom : (...) array
        Degrees of freedom of ``fit``.
    undetermined : (...) array of bool
        Whether the targets leave a direction of the motion undetermined, such as the one along a
        corridor or the rotation of a ring.  ``theta`` is then at an optimum across it, as near the
        start as possible along it, and not ``converged``; ``covariance`` is infinite along it and
        states the variances across it.  Where only the rotation about the middle of the sets is
        undetermined, the translation has the variance that turning them by any angle gives it.
    """

    theta: Array
    covariance: Array
    value: Array
    gradient: Array
    hessian: Array
    converged: NDArray[np.bool_]
    iterations: NDArray[np.int64]
    inliers: Array = field(default_factory=lambda: np.array(np.nan))
    fit: Array = field(default_factory=lambda: np.array(np.nan))
    freedom: Array = field(default_factory=lambda: np.array(np.nan))
    undetermined: NDArray[np.bool_] = field(default_factory=lambda: np.array(False))

    @property
    def fit_region(self) -> Array:
        """Bounds (..., 2) of ``fit``, within which it lies with 95 % if the model is right."""
        tails = scipy.special.chdtri(np.asarray(self.freedom)[..., None], np.array([0.975, 0.025]))
        return np.asarray(tails / np.asarray(self.freedom)[..., None])

    def __repr__(self) -> str:
        shape = self.theta.shape[:-1]
        if shape:
            share = f"{np.count_nonzero(self.converged)} of {self.converged.size} converged"
            return f"Estimate(batch of {shape}, {share})"
        sigmas = np.sqrt(np.abs(np.diagonal(self.covariance)))
        given = ", ".join(
            f"{x:.6g} ± {s:.2g}" for x, s in zip(self.theta.tolist(), sigmas.tolist(), strict=True)
        )
        state = "converged" if self.converged else "not converged"
        state += ", undetermined" if self.undetermined else ""
        return (
            f"Estimate(theta = [{given}], {state} in {self.iterations} iterations, "
            f"value {self.value:.6g}, inliers {self.inliers:.2g}, fit {self.fit:.3g})"
        )


def where(chosen: NDArray[np.bool_], one: Estimate, other: Estimate) -> Estimate:
    """The estimates of one batch where ``chosen`` (...), of another elsewhere."""
    merged = {}
    for name, value in vars(one).items():
        mask = chosen.reshape(chosen.shape + (1,) * (value.ndim - chosen.ndim))
        merged[name] = np.where(mask, value, getattr(other, name))
    return Estimate(**merged)


class CrossDerivatives(NamedTuple):
    """d2f / d theta d z, one block for each measured quantity, and the inliers' shares."""

    fixed: Array  # (..., N, P, D): in the fixed means
    moving: Array  # (..., K, P, D): in the moving means
    measured: Array  # (..., K, P): in the measurement's values; zero without a measurement
    input: Array  # (..., K, P): in its inputs, through its predictions only; zero without one
    share: Array  # (..., K): of the inlier component in each target's density


@dataclass(frozen=True, eq=False)
class Problem:
    """The sum of the costs of one or several pairs of point sets, all measured or none.

    The parameters are the motion (one pair), or a velocity [v_x, v_y, omega] that all pairs share:
    each is moved by the SE(2) exponential of its own interval times the velocity, or, to first
    order, by that product itself.  The negative logarithm of a Gaussian prior of the parameters
    about zero is added, without its constant.
    """

    form: CostForm
    pairs: Sequence[Pair]  # one, which may be a batch, or several single ones
    kind: int = layout.MOTION  # or ARC or CHORD
    prior: Array = field(default_factory=lambda: np.zeros(3))  # precisions

    @property
    def parameters(self) -> int:
        """Number P of parameters."""
        return rigid.PARAMETERS[self.pairs[0].fixed.dimension]

    @property
    def targets(self) -> int:
        """Number of moving targets in one problem."""
        return sum(pair.moving.size for pair in self.pairs)

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
        if shape:
            batch = self._repeated(batch, batches, shape)
        return Bound(thetas.reshape(-1, 3), batch, shape)

    @cached_property
    def _layout(self) -> tuple[list[tuple[int, ...]], layout.Batch]:
        """The batch shapes of the sets of a single pair, and the layout of one problem."""
        first, measurement = self.pairs[0], self.pairs[0].measurement
        fixed = map(_joined, zip(*[pair.fixed._layout for pair in self.pairs], strict=True))
        moving = map(_joined, zip(*[pair.moving._layout for pair in self.pairs], strict=True))
        fixed_targets, extremes, fixed_centres = fixed
        moving_targets, _, moving_centres = moving
        factors = [pair.measurement._packed for pair in self.pairs if pair.measurement is not None]
        sizes = tuple([(pair.fixed.size, pair.moving.size) for pair in self.pairs])
        batch = layout.Batch(
            fixed_targets,
            moving_targets,
            fixed_centres,
            moving_centres,
            _joined([pair.moving._order for pair in self.pairs]),
            extremes,
            _joined(factors) if factors else np.empty((0, 9)),
            self.form.outlier,
            *self._tiles(),
            *_table(sizes, bool(factors)),
            np.array([pair.interval for pair in self.pairs]),
            self.prior,
            float(self.form.d2d),
            float(first.fixed.dimension == 2),
            self.form.fusion,
            measurement is not None and measurement.of_twist,
            self.kind == layout.MOTION and measurement is None,
            self.kind,
        )
        return first.batch_shapes, batch

    def _tiles(self) -> tuple[Array, Array]:
        """The tiles of the outlier components of all fixed sets, and a grid for each set."""
        if self.form.outlier[layout.KIND] != layout.CORRUPTED:
            sets = sum(math.prod(pair.fixed.batch_shape) for pair in self.pairs)
            return tiles.none_for(sets)
        parts = [pair.fixed._tiles(self.form.outlier) for pair in self.pairs]
        if len(parts) == 1:
            return parts[0]
        grids = np.concatenate([grid for _, grid in parts])
        grids[1:, tiles.FIRST_TILE] += np.cumsum([len(own) for own, _ in parts[:-1]])
        return np.concatenate([own for own, _ in parts]), grids

    def _memory(self, stop: Array, steps: bool = False) -> layout.Memory:
        """The memory of this thread; lists are kept if several ``steps`` are to use them."""
        blocks = sum(-(-pair.moving.size // rows.LANES) for pair in self.pairs) if steps else 1
        memory = layout.own_memory(blocks, max(pair.fixed.size for pair in self.pairs))
        return memory if stop is layout.NEVER else memory._replace(stop=stop)

    def _repeated(
        self,
        batch: layout.Batch,
        batches: list[tuple[int, ...]],
        shape: tuple[int, ...],
    ) -> layout.Batch:
        """The layout of a batch of problems, each with its own sets of a single pair's batches."""
        count = math.prod(shape)
        pairs = np.tile(batch.pairs, (count, 1))
        columns = (
            (layout.FIXED_START, layout.FIXED_SIZE, layout.FIXED_SET),
            (layout.MOVING_START, layout.MOVING_SIZE, layout.MOVING_SET),
            (layout.FACTOR_START, layout.MOVING_SIZE, layout.FACTOR_START),
        )
        for (start, size, number), own in zip(columns, batches, strict=True):
            if own:
                pairs[:, number] = which = flat_index(own, shape)
                pairs[:, start] = which * batch.pairs[0, size]
        return batch._replace(
            pairs=pairs,
            intervals=np.tile(batch.intervals, count),
            first=len(self.pairs) * np.arange(count + 1),
        )

    def about_means(self, bound: Bound) -> tuple[Bound, Array]:
        """The motions between the sets about their means, which must not be measured.

        With the derivative (..., P, P) of the given motions in these.
        """
        batch, p, thetas = bound.batch, self.parameters, bound.thetas.copy()
        (fixed, moving, *_), pairs = self.pairs[0], batch.pairs
        packed = (points._layout.packed.reshape(-1, 6, points.size) for points in (fixed, moving))
        to, by = (each[:, :2].mean(axis=-1) for each in packed)  # from the centres
        a = (batch.fixed_centres + to)[pairs[:, layout.FIXED_SET]]
        b = (batch.moving_centres + by)[pairs[:, layout.MOVING_SET]]
        turned = (rigid.rotation(thetas[:, 2]) @ b[..., None])[..., 0]
        thetas[:, :2] += turned - a
        slope = np.tile(np.eye(3), (len(thetas), 1, 1))
        slope[:, 0, 2], slope[:, 1, 2] = turned[:, 1], -turned[:, 0]
        batch = batch._replace(fixed_centres=-to, moving_centres=-by, centred=False)
        return Bound(thetas, batch, bound.shape), slope[:, :p, :p].reshape(*bound.shape, p, p)

    def minimise(self, bound: Bound, threads: int = 1) -> Estimate:
        """The optimum of each bound problem near its parameters."""
        p, shape = self.parameters, bound.shape
        optima, failed = self._descend(bound, threads)
        if failed and self.kind == layout.MOTION and p == 3:
            self._find_valleys(optima, bound, threads)
        thetas, numbers, gradient, hessian, covariance, iterations, good, undetermined = optima
        value, inliers, fit, freedom = numbers.T
        estimate = object.__new__(Estimate)  # a frozen dataclass sets one attribute at a time
        estimate.__dict__.update(
            theta=thetas[:, :p].reshape(*shape, p),
            covariance=covariance[:, :p, :p].reshape(*shape, p, p),
            value=value.reshape(shape),
            gradient=gradient[:, :p].reshape(*shape, p),
            hessian=hessian[:, :p, :p].reshape(*shape, p, p),
            converged=good.reshape(shape),
            iterations=iterations.reshape(shape),
            inliers=inliers.reshape(shape),
            fit=fit.reshape(shape),
            freedom=freedom.reshape(shape),
            undetermined=undetermined.reshape(shape),
        )
        return estimate

    def derivatives(self, bound: Bound) -> tuple[Array, Array, Array]:
        """Value (...), gradient (..., P) and Hessian (..., P, P) of each bound problem."""
        (_, numbers, gradient, hessian, *_), _ = self._descend(bound, max_iterations=0)
        p, shape = self.parameters, bound.shape
        return (
            numbers[:, 0].reshape(shape),
            gradient[:, :p].reshape(*shape, p),
            hessian[:, :p, :p].reshape(*shape, p, p),
        )

    def _descend(
        self, bound: Bound, threads: int = 1, *, max_iterations: int = MAX_ITERATIONS
    ) -> tuple[layout.Optima, bool]:
        """The optima near the bound parameters, and whether one was not found.

        Without an iteration, the cost and its derivatives at the parameters.
        """
        count, failed = len(bound.thetas), False
        optima = layout.Optima(
            bound.thetas.copy(),
            np.empty((count, 4)),
            np.empty((count, 3)),
            np.empty((count, 3, 3)),
            np.empty((count, 3, 3)),
            np.empty(count, np.int64),
            np.empty(count, np.bool_),
            np.empty(count, np.bool_),
        )

        def run(first: int, last: int, stop: Array) -> None:
            nonlocal failed
            part, own = bound.batch, optima
            if last - first < count:
                part, own = bound.part(first, last), optima.part(first, last)
            memory = self._memory(stop, max_iterations > 0)
            failed |= entries.minimise_batch(part, TOLERANCE, max_iterations, memory, own)

        run_in_slices(run, count, self.size, threads)
        return optima, failed

    def _find_valleys(self, optima: layout.Optima, bound: Bound, threads: int) -> None:
        """State which directions are undetermined where there was no optimum.

        Without a measurement, the descent is tried once more about the means of the sets: there it
        shows which these are, and the smallest step keeps to where it is along them.
        """
        flat = optima.undetermined
        if self.pairs[0].measurement is None:
            lost = bound.only(~optima.converged)
            centred, _ = self._descend(self.about_means(lost)[0], threads)
            outer = centred.thetas.copy()
            outer[:, :2] = 0.0
            shift = self.about_means(lost._replace(thetas=outer))[0].thetas
            outer[:, :2] = (centred.thetas - shift)[:, :2]
            back, _ = self._descend(lost._replace(thetas=outer), max_iterations=0)
            flat[~optima.converged] = centred.undetermined
            back = back._replace(iterations=centred.iterations, undetermined=centred.undetermined)
            for ours, theirs in zip(optima, back, strict=True):
                ours[flat] = theirs[centred.undetermined]
            optima.converged[flat] = False
        if flat.any():
            optima.covariance[flat] = self._across(bound._replace(thetas=optima.thetas).only(flat))

    def _across(self, bound: Bound) -> Array:
        """Covariances (B, 3, 3) of optima, infinite along what the targets do not determine.

        That is every direction in which the curvature is below FLAT of the largest, once a rotation
        counts by the displacement that it causes.  A rotation about the middle of the set alone,
        of any angle, moves the origin only so far: the translation's variance stays finite.
        """
        moving, outward = self.pairs[0].moving, np.eye(3)
        if self.pairs[0].measurement is None:
            bound, outward = self.about_means(bound)
        packed = moving._layout.packed.reshape(-1, 6, moving.size)
        places = packed[:, :2] + bound.batch.moving_centres[:, :, None]
        spread = packed[:, layout.XX] + packed[:, layout.YY]
        lever = ((places**2).sum(axis=1) + spread).mean(axis=-1)
        unit = np.ones((len(bound.thetas), 3, 1))
        unit[:, 2, 0] = 1.0 / np.sqrt(lever[bound.batch.pairs[:, layout.MOVING_SET]])
        hessian = self._descend(bound, max_iterations=0)[0].hessian
        values, axes = np.linalg.eigh(hessian * unit * np.swapaxes(unit, 1, 2))
        known = values[:, None] > FLAT * values[:, None, -1:]
        turning = ~known & (np.abs(axes[:, :2]) < _TINY).all(axis=1, keepdims=True)
        axes = outward @ (unit * axes)
        weights = np.where(known, 1.0 / np.where(known, values[:, None], 1.0), 0.0)
        turn = np.where(turning, axes / np.where(turning, axes[:, 2:], 1.0), 0.0)
        finite = (axes * weights) @ np.swapaxes(axes, 1, 2)
        finite += math.pi**2 / 3.0 * turn @ np.swapaxes(turn, 1, 2)  # of an angle within pi
        along = np.where(known, 0.0, axes / unit)
        along[np.abs(along) < _TINY * np.abs(along).max(axis=1, keepdims=True)] = 0.0
        free = along @ np.swapaxes(along, 1, 2)
        shifts = np.where(turning, 0.0, along)[:, :2]
        free[:, :2, :2] = shifts @ np.swapaxes(shifts, 1, 2)
        return np.asarray(np.where(free == 0.0, finite, np.copysign(np.inf, free)))

    def cross_derivatives(self, bound: Bound, begin: int = 0, end: int = 1) -> CrossDerivatives:
        """Derivatives of the gradients of some bound problems in all that is measured.

        The batch axis counts the problems from ``begin`` to ``end``; the targets are those of all
        pairs, one pair after the other.  Of sets on a line, only the first coordinates count.
        """
        count, targets = end - begin, self.targets
        fixed = sum(pair.fixed.size for pair in self.pairs)
        shapes = (fixed, 3, 2), (targets, 3, 2), (targets, 3), (targets, 3), (targets,)
        cross = CrossDerivatives(*(np.empty((count, *shape)) for shape in shapes))

        def run(first: int, last: int, stop: Array) -> None:
            terms = np.empty(max(pair.fixed.size for pair in self.pairs) * propagate.ROWS)
            own, memory = tuple(each[first:last] for each in cross), self._memory(stop)
            propagate.cross_batch(bound.batch, bound.thetas, begin + first, memory, terms, own)

        run_in_slices(run, count, self.size)
        return cross

    def inlier_shares(self, bound: Bound) -> Array:
        """Share (..., K) of the inlier component in each target's density."""
        return self.of_targets(bound, (rows.SHARE,))[..., 0, :]

    def of_targets(self, bound: Bound, wanted: tuple[int, ...]) -> Array:
        """Rows of the kernel's scratch array for each target (..., rows, K)."""
        values = np.empty((len(bound.thetas), len(wanted), self.targets))
        numbers = np.array(wanted)

        def run(first: int, last: int, stop: Array) -> None:
            thetas, own, memory = bound.thetas[first:last], values[first:last], self._memory(stop)
            entries.target_batch(bound.part(first, last), thetas, numbers, memory, own)

        run_in_slices(run, len(values), self.size)
        return values.reshape(*bound.shape, len(wanted), self.targets)


@lru_cache(maxsize=64)
def _table(
    sizes: tuple[tuple[int, int], ...], measured: bool
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The table of the pairs of one problem, from their numbers of targets, and where it ends."""
    pairs, fixed_start, moving_start = [], 0, 0
    for number, (fixed, moving) in enumerate(sizes):
        factor_start = moving_start if measured else -1
        pairs.append((fixed_start, fixed, number, moving_start, moving, number, factor_start))
        fixed_start, moving_start = fixed_start + fixed, moving_start + moving
    return np.array(pairs), np.array([0, len(pairs)])


def flat_index(own: tuple[int, ...], shape: tuple[int, ...]) -> NDArray[np.int64]:
    """For each problem of a batch, its flat index into a batch of the shape ``own``."""
    return np.broadcast_to(np.arange(math.prod(own)).reshape(own), shape).ravel()


def check_pair(
    fixed: PointSet, moving: PointSet, measurement: LinearMeasurement | None = None
) -> Pair:
    """A pair whose parts fit together; a ``ValueError`` names the one that does not."""
    check_instance("fixed", fixed, PointSet)
    check_instance("moving", moving, PointSet)
    if fixed.dimension != moving.dimension:
        raise ValueError(
            f"fixed and moving must have the same dimension, "
            f"but have {fixed.dimension} and {moving.dimension}"
        )
    if measurement is None:
        return Pair(fixed, moving)
    check_instance("measurement", measurement, LinearMeasurement)
    parameters = rigid.PARAMETERS[moving.dimension]
    if (measurement.size, measurement.parameters) != (moving.size, parameters):
        raise ValueError(
            f"measurement must have {moving.size} targets and {parameters} parameters to "
            f"match moving, but has {measurement.size} and {measurement.parameters}"
        )
    return Pair(fixed, moving, measurement)


def _joined(arrays: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """The arrays one after the other, without a copy of a single one."""
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays)
