"""A check of optimisers and of covariances must be able to come out otherwise."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from d2d.study.claims import CLAIMS
from d2d.study.estimation import claims as estimation


def paths(first_order: int, others: int, *, newton_arrives: bool):
    """In the place of `run_all`: so many iterations, and Newton at the minimum or elsewhere."""

    def run(problem, start, *, first_order: bool = True):
        found = {name: path(others) for name in ("Gauss-Newton", "Levenberg-Marquardt")}
        found["Newton"] = path(others, 0.0 if newton_arrives else 5.0)
        return found | ({"gradient descent": path(slow)} if first_order else {})

    slow = first_order
    return run


def path(iterations: int, cost: float = 0.0):
    """A path that ends at this cost."""
    return SimpleNamespace(points=np.zeros((iterations + 1, 3)), costs=[cost], converged=True)


@pytest.mark.parametrize(
    ("first_order", "others", "newton_arrives", "verdict"),
    [
        (5000, 6, True, "confirmed"),
        (5000, 6, False, "qualified"),
        (6, 6, True, "refuted"),
    ],
)
def test_optimisers_are_judged_by_speed_and_arrival(
    monkeypatch, first_order, others, newton_arrives, verdict
):
    """Breaks if starts from which gradient descent never ran decide, or none."""
    run = paths(first_order, others, newton_arrives=newton_arrives)
    monkeypatch.setattr(estimation, "run_all", run)
    assert CLAIMS["second-order-faster"].check().verdict == verdict


def test_the_shape_claim_is_refuted_if_sum_and_likelihood_change_places(monkeypatch):
    """Breaks if the names and not the errors decide."""
    other = {"likelihood": "sum", "sum": "likelihood"}
    for name in ("covariance_study", "quadratic_ratios"):
        real = getattr(estimation, name)
        monkeypatch.setattr(estimation, name, lambda of, *given, real=real: real(other[of], *given))
    assert CLAIMS["summing-not-gaussian"].check().verdict == "refuted"
