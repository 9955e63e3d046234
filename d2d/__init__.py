"""Robust registration of sets of Gaussian targets.

An invalid argument, also of `d2d.radar`, raises a ``ValueError`` that names it and says what was
expected and what given.
"""

from d2d.bootstrap import block_bootstrap, block_length
from d2d.cost import CorruptedGaussian, RegistrationCost, UniformOutlier
from d2d.covariance import fisher_covariance, propagate_covariance
from d2d.credibility import Credibility, credibility
from d2d.measurement import LinearMeasurement
from d2d.point_set import PointSet
from d2d.problem import Estimate
from d2d.registration import ANNEALED, multi_start, register, start_grid
from d2d.sandwich import sandwich_covariance
from d2d.scores import Whitened, coverage, crps, log_score, whiten

__version__ = "0.2.0"

__all__ = [
    "ANNEALED",
    "CorruptedGaussian",
    "Credibility",
    "Estimate",
    "LinearMeasurement",
    "PointSet",
    "RegistrationCost",
    "UniformOutlier",
    "Whitened",
    "block_bootstrap",
    "block_length",
    "coverage",
    "credibility",
    "crps",
    "fisher_covariance",
    "log_score",
    "multi_start",
    "propagate_covariance",
    "register",
    "sandwich_covariance",
    "start_grid",
    "whiten",
]
