"""A check of optimisers must be able to come out otherwise."""

from types import SimpleNamespace

from d2d.study.claims import CLAIMS
from d2d.study.estimation import claims as estimation
from d2d.study.estimation.descent import ends_of


def path(iterations: int, cost: float = 0.0):
    """A path that ends at this cost."""
    return SimpleNamespace(costs=[cost], evaluations=iterations, converged=True)


def test_each_optimiser_must_arrive(monkeypatch):
    """Breaks if the arrival of one method does not count."""
    found = {name: path(6) for name in ("Gauss-Newton", "Levenberg-Marquardt")}
    found["Newton"] = path(6, 5.0)
    slow = ends_of([path(5000)] * estimation.STARTS)
    monkeypatch.setattr(estimation, "run_second_order", lambda problem, start: found)
    monkeypatch.setattr(estimation, "gradient_descents", lambda problems, starts: slow)
    assert CLAIMS["second-order-faster"].check().verdict == "conditional"
