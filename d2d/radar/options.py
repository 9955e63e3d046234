"""The options that all ego-motion functions share."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypedDict

import numpy as np

from d2d import _kernel
from d2d._checks import check_flag, check_schedule
from d2d._lazy import Frozen
from d2d.cost import CorruptedGaussian, OutlierModel, RegistrationCost
from d2d.problem import CostForm, Pair, Problem

# thesis sec. 7.3: 20 % outliers, with a standard deviation of 10 m along both axes
DEFAULT_OUTLIER = CorruptedGaussian(0.2, 100.0 * np.eye(2))


class ModelOptions(TypedDict, total=False):
    """The fields of `EgoMotionModel`, as keywords."""

    doppler: bool
    outlier: OutlierModel | None
    first_order: bool


class EstimationOptions(ModelOptions, total=False):
    """The options of the model and of the search for the optimum."""

    scales: Sequence[float]


@dataclass(frozen=True)
class EgoMotionModel(Frozen):
    """The model behind the cost of a velocity.

    Its fields are keyword options of all functions that estimate an ego-motion, propagate its
    covariance or compute inlier probabilities.

    Attributes
    ----------
    doppler : bool
        Whether the cost includes the Doppler velocities.
    outlier : UniformOutlier, CorruptedGaussian or None
        By default the thesis's corrupted Gaussian, with alpha = 0.2 and variances of (10 m)^2.
    first_order : bool
        Whether the translation over the interval tau is v tau (thesis eq. 7.2) instead of that of
        the SE(2) exponential, by which a turning vehicle moves at constant velocity.

    Raises
    ------
    ValueError
        If an option is invalid; the message names it.
    """

    doppler: bool = True
    outlier: OutlierModel | None = DEFAULT_OUTLIER
    first_order: bool = False

    def __post_init__(self) -> None:
        check_flag("doppler", self.doppler)
        check_flag("first_order", self.first_order)
        self.form  # noqa: B018 - an outlier of another dimension is refused here

    @property
    def cost(self) -> RegistrationCost:
        """The cost of the motion between two scans."""
        return RegistrationCost(outlier=self.outlier)

    @cached_property
    def form(self) -> CostForm:
        """The cost as the kernel reads it."""
        return self.cost.form(2)

    def problem(self, pairs: Sequence[Pair]) -> Problem:
        """The cost of the velocity that pairs of scans share."""
        return Problem(self.form, pairs, _kernel.CHORD if self.first_order else _kernel.ARC)


def split_options(options: EstimationOptions) -> tuple[EgoMotionModel, tuple[float, ...]]:
    """The model and the inflation schedule that a function's keyword options specify."""
    keywords: dict[str, Any] = {**options}
    scales = check_schedule("scales", keywords.pop("scales", (1.0,)))
    return EgoMotionModel(**keywords), scales
