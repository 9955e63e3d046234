"""The registration cost: a metric, a fusion and an outlier model, with exact derivatives."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from d2d import rigid
from d2d._checks import (
    Bounds,
    check_choice,
    check_covariances,
    check_finite,
    check_fraction,
    check_positive_scalar,
    check_shape,
)
from d2d._frozen import Frozen
from d2d._kernel import layout, rows
from d2d._types import Array
from d2d.measurement import LinearMeasurement
from d2d.point_set import PointSet
from d2d.problem import Bound, CostForm, Problem, check_pair

Metric = Literal["d2d", "p2d"]
Fusion = Literal["likelihood", "summing"]

_NO_OUTLIER = np.array([layout.NO_OUTLIER, 0.0, -np.inf, 0.0, 0.0, 0.0])
_VARIANCE = Bounds(least=layout.MIN_VARIANCE, most=layout.MAX_VARIANCE)
_FUSIONS = {"likelihood": layout.LIKELIHOOD, "summing": layout.SUMMING}


@dataclass(frozen=True)
class UniformOutlier(Frozen):
    """A constant added to each target's density, :math:`q_k + c` (Blake-Zisserman, thesis 4.14).

    The sum is not a probability density of the target's position: its integral diverges.

    The constant ``density`` c, a positive number, is in 1/m (1D) or 1/m² (2D).
    """

    density: float
    _dimension: ClassVar[int | None] = None  # of the sets: any

    def __post_init__(self) -> None:
        object.__setattr__(self, "density", check_positive_scalar("density", self.density))

    @cached_property
    def _packed(self) -> Array:
        return np.array([layout.UNIFORM, 0.0, math.log(self.density), 0.0, 0.0, 0.0])


@dataclass(frozen=True, eq=False)
class CorruptedGaussian(Frozen):
    r"""A wide Gaussian at every component (Hartley & Zisserman, Multiple View Geometry, app. 6).

    .. math:: (1 - \alpha)\, q_k + \alpha \sum_i w_i\, \mathcal N(T(\mu_k) \mid \mu_i, S_o)

    The ``fraction`` of outliers :math:`\alpha` is within [0, 1] (thesis eq. 6.3; inliers in 4.16),
    the ``covariance`` :math:`S_o` (D, D) in m² positive definite; in 1D, a number is a variance.
    """

    fraction: float
    covariance: Array

    def __init__(self, fraction: float, covariance: ArrayLike) -> None:
        self._keep("fraction", check_fraction("fraction", fraction))
        given = check_finite("covariance", covariance)
        matrix = check_covariances("covariance", np.atleast_2d(given))
        check_shape("covariance", matrix, "(1, 1)", "(2, 2)")
        _VARIANCE.array("covariance", np.diagonal(matrix))
        self._keep("covariance", matrix)

    @property
    def _dimension(self) -> int:
        return len(self.covariance)

    @cached_property
    def _packed(self) -> Array:
        dimension = self._dimension
        precision = np.zeros((2, 2))
        precision[:dimension, :dimension] = np.linalg.inv(self.covariance)
        norm = 0.5 * np.linalg.slogdet(2.0 * math.pi * self.covariance)[1]
        with np.errstate(divide="ignore"):  # a fraction of 0 or 1: one component has zero weight
            inlier, outlier = np.log1p(-self.fraction), np.log(self.fraction) - norm
        return np.array(
            [layout.CORRUPTED, inlier, outlier, precision[0, 0], precision[0, 1], precision[1, 1]]
        )


OutlierModel = UniformOutlier | CorruptedGaussian
_MODELS = ", ".join(model.__name__ for model in get_args(OutlierModel))


@dataclass(frozen=True)
class RegistrationCost:
    r"""The cost that is minimised over the motion: a metric, a fusion and an outlier model.

    All methods take the motion ``theta`` (..., P), [t_x] in m or [t_x, t_y, phi_z] in m, m, rad;
    the point sets ``fixed`` with N components and ``moving`` with K targets; and a
    `LinearMeasurement` of each target.  Their batch axes broadcast.

    Parameters
    ----------
    metric : "d2d" or "p2d"
        Distribution to distribution, :math:`S_{ki} = R \Sigma_k R^{\mathsf T} + \Sigma_i` (Stoyanov
        2012, thesis eq. 4.7), or point to it, :math:`S_{ki} = \Sigma_i` (Biber 2003, eq. 4.4).
    fusion : "likelihood" or "summing"
        The value is :math:`-\sum_k \log q_k` (thesis eq. 4.10) or :math:`-\log \sum_k q_k` (eq.
        4.8; its logarithm keeps the optimum and makes the Hessian independent of the unit).
    outlier : UniformOutlier, CorruptedGaussian or None
        The outlier component of each target's density.

    Examples
    --------
    >>> import numpy as np
    >>> from d2d import CorruptedGaussian, PointSet, RegistrationCost
    >>> cost = RegistrationCost(outlier=CorruptedGaussian(0.2, 100 * np.eye(2)))
    >>> targets = PointSet([[0.0, 5.0], [8.0, 1.0]], [0.04 * np.eye(2)] * 2)
    >>> float(cost.value([0.0, 0.0, 0.0], targets, targets).round(3))
    0.456
    """

    metric: Metric = "d2d"
    fusion: Fusion = "likelihood"
    outlier: OutlierModel | None = None

    def __post_init__(self) -> None:
        check_choice("metric", self.metric, get_args(Metric))
        check_choice("fusion", self.fusion, _FUSIONS)
        if not isinstance(self.outlier, OutlierModel | None):
            raise ValueError(f"outlier must be None or one of {_MODELS}, but is {self.outlier!r}")

    def target_densities(
        self,
        theta: ArrayLike,
        fixed: PointSet,
        moving: PointSet,
        *,
        measurement: LinearMeasurement | None = None,
    ) -> Array:
        """Density :math:`q_k` (..., K) of each moving target, in 1/m (1D) or 1/m² (2D).

        The outlier component is included.  With a measurement, the unit is also divided by that of
        the measurement.
        """
        problem, bound = self._bound(theta, fixed, moving, measurement)
        return np.exp(problem.of_targets(bound, (rows.LOG_DENSITY,))[..., 0, :])

    def inlier_probabilities(
        self,
        theta: ArrayLike,
        fixed: PointSet,
        moving: PointSet,
        *,
        measurement: LinearMeasurement | None = None,
    ) -> Array:
        """Share (..., K) of the inlier component in each target's density, within [0, 1].

        The posterior probability that the target is an inlier (Bishop 2006, sec. 9.3); 1 without an
        outlier model.  With `UniformOutlier`, which is not normalised, it is a mere weight.
        """
        problem, bound = self._bound(theta, fixed, moving, measurement)
        return problem.inlier_shares(bound)

    def value(
        self,
        theta: ArrayLike,
        fixed: PointSet,
        moving: PointSet,
        *,
        measurement: LinearMeasurement | None = None,
    ) -> Array:
        """Value (...) of the cost, a negative logarithm; finite however far apart the sets are."""
        return self.derivatives(theta, fixed, moving, measurement=measurement)[0]

    def derivatives(
        self,
        theta: ArrayLike,
        fixed: PointSet,
        moving: PointSet,
        *,
        measurement: LinearMeasurement | None = None,
    ) -> tuple[Array, Array, Array]:
        """The cost (...) with its exact gradient (..., P) and Hessian (..., P, P), in one pass."""
        problem, bound = self._bound(theta, fixed, moving, measurement)
        return problem.derivatives(bound)

    def problem(
        self,
        fixed: PointSet,
        moving: PointSet,
        measurement: LinearMeasurement | None = None,
    ) -> Problem:
        """The cost of the motion between two sets, bound to them."""
        pair = check_pair(fixed, moving, measurement)
        return Problem(self.form(fixed.dimension), [pair])

    def form(self, dimension: int) -> CostForm:
        """The cost as the kernel reads it, for sets of this dimension."""
        outlier = _NO_OUTLIER if self.outlier is None else self.outlier._packed
        size = None if self.outlier is None else self.outlier._dimension
        if size not in (None, dimension):
            raise ValueError(
                f"the outlier covariance must be {dimension} x {dimension} to match the point "
                f"sets, but is {size} x {size}"
            )
        return CostForm(self.metric == "d2d", _FUSIONS[self.fusion], outlier)

    def _bound(
        self,
        theta: ArrayLike,
        fixed: PointSet,
        moving: PointSet,
        measurement: LinearMeasurement | None,
    ) -> tuple[Problem, Bound]:
        problem = self.problem(fixed, moving, measurement)
        return problem, problem.bind(rigid.motion("theta", theta, fixed.dimension))
