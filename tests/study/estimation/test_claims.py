"""A check of optimisers and of covariances must be able to come out otherwise."""

from types import SimpleNamespace

import pytest

from d2d.study.claims import CLAIMS
from d2d.study.estimation import claims as estimation
from d2d.study.estimation.descent import ends_of


def path(iterations: int, cost: float = 0.0):
    """A path that ends at this cost."""
    return SimpleNamespace(costs=[cost], evaluations=iterations, converged=True)


@pytest.mark.parametrize(
    ("first_order", "others", "newton_arrives", "verdict"),
    [
        (5000, 6, True, "confirmed"),
        (5000, 6, False, "conditional"),
        (6, 6, True, "wrong in part"),
    ],
)
def test_optimisers_are_judged_by_speed_and_arrival(
    monkeypatch, first_order, others, newton_arrives, verdict
):
    """Breaks if the arrival of one method, or the ratio of the iterations, does not count."""
    found = {name: path(others) for name in ("Gauss-Newton", "Levenberg-Marquardt")}
    found["Newton"] = path(others, 0.0 if newton_arrives else 5.0)
    slow = ends_of([path(first_order)] * estimation.STARTS)
    monkeypatch.setattr(estimation, "run_second_order", lambda problem, start: found)
    monkeypatch.setattr(estimation, "gradient_descents", lambda problems, starts: slow)
    assert CLAIMS["second-order-faster"].check().verdict == verdict
