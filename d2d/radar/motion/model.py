"""The options that all ego-motion functions share."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypedDict

import numpy as np

from d2d._checks import Bounds, check_flag, check_positive_scalar, check_schedule
from d2d._frozen import Frozen
from d2d._kernel import layout
from d2d.cost import CorruptedGaussian, OutlierModel, RegistrationCost
from d2d.problem import CostForm, Pair, Problem

# m/s: most targets without a partner stand still, and their Doppler velocities scatter about those
# of the inliers.  With all velocities that traffic can have, 40 m/s, the errors of v_x and omega
# on the road are larger by a few percent (chapter 15).
DEFAULT_DOPPLER_WIDTH = 4.0
_NO_SIDE_SLIP = 1e-3  # m/s, the standard deviation of v_y where it is stated to be zero
# m/s, whose inverse squares the cost can hold beside its other terms
_SIDE_SLIP = Bounds(least=1e-6, most=1e6)
# thesis sec. 7.3: 20 % outliers, with a standard deviation of 10 m along both axes
DEFAULT_OUTLIER = CorruptedGaussian(0.2, 100.0 * np.eye(2))


class ModelOptions(TypedDict, total=False):
    """The fields of `EgoMotionModel`, as keywords."""

    doppler: bool
    outlier: OutlierModel | None
    doppler_width: float
    side_slip: bool | float
    first_order: bool


class EstimationOptions(ModelOptions, total=False):
    """The options of the model and of the search for the optimum."""

    scales: Sequence[float]


@dataclass(frozen=True)
class EgoMotionModel(Frozen):
    """The model behind the cost of a velocity; its fields are the options of all that use it.

    Attributes
    ----------
    doppler : bool
        Whether the cost includes the Doppler velocities.
    outlier : UniformOutlier, CorruptedGaussian or None
        By default the thesis's corrupted Gaussian, with α = 0.2 and variances of (10 m)².
    doppler_width : float, m/s
        An outlier's Doppler velocity is taken as uniform over an interval of this width, by which
        the outlier component's density is divided.  The thesis leaves this out of eq. 7.14, which
        is a width of 1 m/s.
    side_slip : bool or float, m/s
        Whether the vehicle's origin may move sideways.  False says that v_y is zero, a number is
        the standard deviation of v_y about zero.  A single sensor gains most: it determines
        v_y + omega x_s well, but the two separately only poorly.
    first_order : bool
        Whether the translation over the interval tau is v tau (thesis eq. 7.2) instead of that of
        the SE(2) exponential, by which a turning vehicle moves at constant velocity.
    """

    doppler: bool = True
    outlier: OutlierModel | None = DEFAULT_OUTLIER
    doppler_width: float = DEFAULT_DOPPLER_WIDTH
    side_slip: bool | float = True
    first_order: bool = False

    def __post_init__(self) -> None:
        check_flag("doppler", self.doppler)
        check_flag("first_order", self.first_order)
        if not isinstance(self.side_slip, bool | np.bool_):
            _SIDE_SLIP.number("side_slip", self.side_slip)
        check_positive_scalar("doppler_width", self.doppler_width)
        self.form  # noqa: B018 - an outlier of another dimension is refused here

    @cached_property
    def form(self) -> CostForm:
        """The cost as the kernel reads it, with the outliers' Doppler density."""
        form = RegistrationCost(outlier=self.outlier).form(2)
        if not self.doppler or self.outlier is None:
            return form
        outlier = form.outlier.copy()
        outlier[layout.LOG_OUTLIER_WEIGHT] -= math.log(self.doppler_width)
        return form._replace(outlier=outlier)

    def problem(self, pairs: Sequence[Pair]) -> Problem:
        """The cost of the velocity that pairs of scans share."""
        kind = layout.CHORD if self.first_order else layout.ARC
        slip = self.side_slip
        if isinstance(slip, bool | np.bool_):
            slip = math.inf if slip else _NO_SIDE_SLIP
        precisions = np.array([0.0, 1.0 / float(slip) ** 2, 0.0])  # of the prior of the velocity
        return Problem(self.form, pairs, kind, precisions)


def split_options(options: EstimationOptions) -> tuple[EgoMotionModel, tuple[float, ...]]:
    """The model and the inflation schedule that a function's keyword options specify."""
    keywords: dict[str, Any] = {**options}
    scales = check_schedule("scales", keywords.pop("scales", (1.0,)))
    return EgoMotionModel(**keywords), scales
