"""The study: scenarios, Monte Carlo runs, claims with their checks, the drawing of the chapters.

The only part of the package that imports matplotlib.
"""

from d2d.study import scenarios
from d2d.study.claims import CLAIMS
from d2d.study.runs import Condition, MonteCarlo, monte_carlo, sweep

__all__ = ["CLAIMS", "Condition", "MonteCarlo", "monte_carlo", "scenarios", "sweep"]
