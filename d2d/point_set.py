"""Sets of points whose positions have Gaussian errors."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from d2d import rigid
from d2d._checks import (
    ANGLE,
    SCALE,
    Bounds,
    broadcast_batches,
    check_covariances,
    check_positive,
    check_real,
    check_shape,
)
from d2d._frozen import Frozen
from d2d._kernel import entries, layout, tiles
from d2d._kernel.compile import read_only
from d2d._types import Array, Index

_TILED = 64  # targets, from which on the tiles of a corrupted Gaussian pay
_VARIANCE = Bounds(most=layout.MAX_VARIANCE, unit="in m^2, ")
_LEAST_VARIANCE = Bounds(least=layout.MIN_VARIANCE)
_POSITION = Bounds(most=layout.MAX_LENGTH, unit="in m, ")
_WEIGHT = Bounds(above=0.0, least=layout.MIN_WEIGHT, most=layout.MAX_WEIGHT)


class _Layout(NamedTuple):
    """Sets as the kernel reads them, and what it needs to know of them before it begins."""

    packed: Array  # one set after the other, each with a row a quantity
    extremes: Array  # (B, 5) bounds, see `d2d._kernel.pairs.find_extremes`
    centres: Array  # (B, 2) the middles of the sets, about which they are packed


@dataclass(frozen=True, eq=False, repr=False)
class PointSet(Frozen):
    r"""Gaussian targets :math:`\mathcal N(\mu_k, \Sigma_k)` with weights, or a batch of such sets.

    Leading axes are batch axes and broadcast against each other.

    Parameters
    ----------
    means : (..., N, D) array, m
        Positions, at most 1e40 m; D is 1 or 2 and N at least 1.
    covariances : (..., N, D, D) array, m²
        Symmetric positive definite, variances between 1e-80 and 1e80 m²; or (D, D) for all.
    weights : (..., N) array, optional
        Mixture weights between 1e-100 and 1e100; 1/N each by default.  Only those of the fixed set
        are used, without normalisation.
    """

    means: Array
    covariances: Array
    weights: Array

    def __init__(
        self, means: ArrayLike, covariances: ArrayLike, weights: ArrayLike | None = None
    ) -> None:
        means = check_real("means", means)
        check_shape("means", means, "(..., N, 1)", "(..., N, 2)", empty=False)
        count, dimension = means.shape[-2:]
        covariances = check_real("covariances", covariances)
        if covariances.shape == (dimension, dimension):
            covariances = np.tile(covariances, (*means.shape[:-1], 1, 1))
        given = np.full(count, 1.0 / count) if weights is None else check_real("weights", weights)
        # one compiled pass checks everything; the single checks only find what failed there
        if not (
            covariances.shape == (*means.shape, dimension)
            and given.shape == means.shape[-2:-1]
            and entries.are_good_targets(
                means.reshape(-1, dimension),
                covariances.reshape(-1, dimension, dimension),
                given if means.ndim == 2 else np.tile(given, means.size // (count * dimension)),
            )
        ):
            _POSITION.array("means", means)
            covariances = _VARIANCE.array("covariances", covariances)
            covariances = check_covariances("covariances", covariances)
            shape = f"(..., {count}, {dimension}, {dimension})"
            check_shape("covariances", covariances, shape, like="means", empty=False)
            _LEAST_VARIANCE.array("covariances", np.diagonal(covariances, axis1=-2, axis2=-1))
            _WEIGHT.array("weights", given)
            check_shape("weights", given, f"(..., {count})", like="means", empty=False)
        self._fill(means, covariances, given)

    def _fill(self, means: Array, covariances: Array, weights: Array) -> None:
        """Store arrays that are known to be good, broadcast to one batch shape."""
        shapes = means.shape[:-2], covariances.shape[:-3], weights.shape[:-1]
        batch = shapes[0]
        if not batch == shapes[1] == shapes[2]:
            batch = broadcast_batches("means, covariances and weights", *shapes)
        for name, array, axes in (
            ("means", means, 2),
            ("covariances", covariances, 3),
            ("weights", weights, 1),
        ):
            shape = batch + array.shape[-axes:]
            self._keep(name, array if array.shape == shape else np.broadcast_to(array, shape))

    @classmethod
    def _of(cls, means: Array, covariances: Array, weights: Array) -> "PointSet":
        """A set made of arrays that are known to be valid."""
        points = cls.__new__(cls)
        points._fill(means, covariances, weights)
        return points

    @classmethod
    def from_polar(
        cls,
        range: ArrayLike,
        azimuth: ArrayLike,
        sigma_range: ArrayLike,
        sigma_azimuth: ArrayLike,
    ) -> "PointSet":
        r"""Targets measured in polar coordinates, with first-order covariances.

        These are :math:`J \operatorname{diag}(\sigma_r^2, \sigma_\phi^2)\, J^{\mathsf T}` with the
        derivative J of a position by its range and azimuth (thesis eq. 7.3, 7.4; columns swapped).

        The ranges (..., N) in m are positive, the azimuths (..., N) in rad are measured
        counter-clockwise from the x axis, within −2π and 2π.  Their standard deviations are
        positive and broadcast to (..., N).  Targets more than 150 times as long as wide make the
        covariance of a rotation too small, see `propagate_covariance`.
        """
        r, phi = check_positive("range", range), ANGLE.array("azimuth", azimuth)
        sr = check_positive("sigma_range", sigma_range)
        sp = check_positive("sigma_azimuth", sigma_azimuth)
        check_shape("range", r, "(..., N)")
        shape = broadcast_batches(
            "range, azimuth, sigma_range and sigma_azimuth", r.shape, phi.shape, sr.shape, sp.shape
        )
        r, phi, sr, sp = (np.broadcast_to(each, shape) for each in (r, phi, sr, sp))
        return cls._of_polar((r, sr, sp), (np.cos(phi), np.sin(phi)), np.zeros(shape), np.zeros(2))

    @classmethod
    def _of_polar(
        cls,
        polar: tuple[Array, Array, Array],
        direction: tuple[Array, Array],
        extent: Array,
        origin: Array,
    ) -> "PointSet":
        """A set made of range, sigma_range and sigma_azimuth, all (..., N) and known to be good.

        ``direction`` is cosine and sine of the azimuth, seen from the origin (2,); the variance of
        the extent (..., N) is added along each axis.
        """
        shape = extent.shape
        check_shape("range", extent, "(..., N)", empty=False)
        means, covariances = np.empty((*shape, 2)), np.empty((*shape, 2, 2))
        if not entries.place_polar_targets(
            tuple(read_only(each, -1) for each in polar),
            tuple(read_only(each, -1) for each in direction),
            read_only(extent, -1),
            read_only(origin, 2),
            means.reshape(-1, 2),
            covariances.reshape(-1, 2, 2),
        ):
            raise ValueError(
                "sigma_range and range * sigma_azimuth differ so much that the covariance is "
                "singular in floating point, or are out of its range"
            )
        return cls._of(means, covariances, np.full(shape[-1], 1.0 / shape[-1]))

    @property
    def size(self) -> int:
        """Number N of targets."""
        return int(self.means.shape[-2])

    @property
    def dimension(self) -> int:
        """Dimension D of the space."""
        return int(self.means.shape[-1])

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """Shape of the leading axes, () for one set."""
        return self.means.shape[:-2]

    def __getitem__(self, index: Index) -> "PointSet":
        """Select sets of a batch; the index applies to the batch axes only.

        Raises an ``IndexError`` if this is not a batch or the index is out of range.
        """
        if not self.batch_shape:
            raise IndexError("this point set has no batch axes")
        sets = np.arange(math.prod(self.batch_shape)).reshape(self.batch_shape)
        which: Any = index  # NumPy's own types do not take so many kinds at once
        try:
            chosen = sets[which]
        except IndexError as error:
            raise IndexError(f"invalid index for the batch {self.batch_shape}: {error}") from None
        return PointSet._of(
            self.means.reshape(-1, self.size, self.dimension)[chosen],
            self.covariances.reshape(-1, self.size, self.dimension, self.dimension)[chosen],
            self.weights.reshape(-1, self.size)[chosen],
        )

    def __iter__(self) -> Iterator["PointSet"]:
        """Iterate over the first batch axis; raises a ``TypeError`` if this is not a batch."""
        if not self.batch_shape:
            raise TypeError("this point set has no batch axes to iterate over")
        return map(self.__getitem__, range(self.batch_shape[0]))

    def __repr__(self) -> str:
        batch = f"batch of {self.batch_shape}, " if self.batch_shape else ""
        if not self.means.size:
            return f"PointSet({batch}{self.size} targets)"
        places = self.means.reshape(-1, self.dimension)
        low, high = places.min(axis=0), places.max(axis=0)
        within = " x ".join(f"[{a:.4g}, {b:.4g}]" for a, b in zip(low, high, strict=True))
        sigmas = np.sqrt(np.diagonal(self.covariances, axis1=-2, axis2=-1))
        return (
            f"PointSet({batch}{self.size} targets within {within} m, "
            f"sigma {sigmas.min():.3g} to {sigmas.max():.3g} m)"
        )

    def transformed(self, theta: ArrayLike) -> "PointSet":
        r"""Sets moved by theta (..., P): :math:`R \mu_k + t`, :math:`R \Sigma_k R^{\mathsf T}`."""
        return PointSet._of(
            rigid.transform_means(theta, self.means),
            rigid.transform_covariances(theta, self.covariances),
            self.weights,
        )

    def shifted(self, translation: ArrayLike) -> "PointSet":
        """The sets moved by translations (..., D)."""
        step = _POSITION.array("translation", translation)
        check_shape("translation", step, f"(..., {self.dimension})")
        broadcast_batches("translation and means", step.shape[:-1], self.batch_shape)
        return PointSet._of(self.means + step[..., None, :], self.covariances, self.weights)

    def inflated(self, scale: float) -> "PointSet":
        """The set with all standard deviations multiplied by ``scale``, from 1e-50 to 1e50."""
        scale = SCALE.number("scale", scale)
        inflated = PointSet._of(self.means, self.covariances * scale**2, self.weights)
        inflated.__dict__["_fields"] = self._fields  # which do not depend on the covariances
        return inflated

    @cached_property
    def _layout(self) -> _Layout:
        size, dimension = self.means.shape[-2:]
        means = read_only(self.means, -1, size, dimension)
        covariances = read_only(self.covariances, -1, size, dimension, dimension)
        weights = read_only(self.weights, -1, size)
        count = len(means)
        packed = np.empty((count, 6, size))
        extremes = np.empty((count, 5))
        centres = np.empty((count, 2))
        entries.pack_targets(means, covariances, weights, packed, extremes, centres)
        return _Layout(packed.ravel(), extremes, centres)

    def _tiles(self, outlier: Array) -> tuple[Array, Array]:
        """Tiles and grids of a corrupted Gaussian's component, see `d2d._kernel.tiles`."""
        if self.size < _TILED or self.dimension == 1:
            return tiles.none_for(math.prod(self.batch_shape))
        key = outlier[layout.PRECISION_XX :].tobytes()
        if key not in self._fields:
            sets = self._layout.packed.reshape(-1, 6, self.size)
            self._fields[key] = tiles.tiles_of(sets, outlier)
        return self._fields[key]

    @cached_property
    def _fields(self) -> dict[bytes, tuple[Array, Array]]:
        """The tiles of all components asked for so far."""
        return {}

    @cached_property
    def _order(self) -> NDArray[np.int64]:
        """(B N,) order in which the kernel takes the targets of each set, see `order_targets`."""
        sets = self._layout.packed.reshape(-1, 6, self.size)
        order = np.empty((len(sets), self.size), dtype=np.int64)
        entries.order_targets(sets, np.empty(self.size + 8, dtype=np.int64), order)
        return order.ravel()
