"""Claims of thesis section 6.3: outliers and clusters together."""

import numpy as np

from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.study.book.claim import (
    DECIBELS,
    RATIO,
    SHARE,
    Evidence,
    Finding,
    Margin,
    Rule,
    claim,
    nearly_all,
)
from d2d.study.book.measured import (
    Measured,
    bootstrapped,
    inclination_change,
    mean_of,
    rms_of,
    rms_ratio,
    share_difference,
    share_of,
)
from d2d.study.plane.evaluation import (
    BOTH,
    LIKELIHOOD,
    ROBUST,
    SEARCHED,
    STARTS,
    SUMMING,
    at_truth,
    error_ratio,
    errors_of,
    evaluated,
    over_layouts,
)
from d2d.study.plane.optima import local_minima
from d2d.study.plane.scenarios import OVERLAPPED

OF_BOTH = "1000 draws of the noise of each of the two scenes"
SPREADS = {"sum": SUMMING, "robust": ROBUST}


@claim("all-likelihood-stable", section="6.3", lines="1463", figure="all-scenes")
def all_likelihood_stable(ev: Evidence) -> None:
    """Outliers and clusters: in both scenes the likelihood (with the outlier component that
    outliers need) has only one global minimum, close to the truth.
    """
    is_right = ev.part("the global minimum is at the truth", nearly_all)
    only_one = ev.part("it is the only one", nearly_all)
    close = ev.part("the estimate is close", RATIO.no_larger)
    ev("RMSE, likelihood, overlapped (m)", rms_of(errors_of(OVERLAPPED, LIKELIHOOD)[0]))
    to_overlapped = "ratio of the RMSE to the likelihood's in the overlapped scene"
    for letter, scenario in BOTH.items():
        for name, cost in (("robust", ROBUST), ("likelihood", LIKELIHOOD)):
            ev(f"RMSE, {name}, {letter} (m)", rms_of(errors_of(scenario, cost)[0]))
            add = close if name == "robust" else ev
            ratio = error_ratio((scenario, cost), (OVERLAPPED, LIKELIHOOD))
            add(f"{to_overlapped}, {name}, {letter}", ratio)
        minima = local_minima(scenario, ROBUST, SEARCHED)
        right = share_of(minima.right)
        is_right(f"share of draws with the global minimum at the truth, {letter}", right)
        one = share_of(minima.visible == 1)
        only_one.headline(f"share of draws with one visible minimum, {letter}", one)
    ev.conclude(
        "without the outlier component the outliers pull the optimum off, to "
        f"{ratio:.1f} times the RMSE in B. With it, a second minimum has more than 1% of the "
        f"highest density in {1 - one:.0%} of the draws there.",
        holds=f"In A; in B the minimum is the only one in {one:.0%} of the draws.",
        over=f"{OF_BOTH}; for the minima {SEARCHED} of each",
    )


@claim("all-summing-unstable", section="6.3", lines="1463", figure="all-scenes")
def all_summing_unstable(ev: Evidence) -> None:
    """Outliers and clusters: the sum's surface behaves differently in the two scenes, and therefore
    its error does; the likelihood behaves almost the same.
    """
    a, b = BOTH.values()
    of_sum, of_sum_turn, of_robust, of_robust_turn = (
        rms_ratio(errors_of(a, cost)[part], errors_of(b, cost)[part])
        for cost in (SUMMING, ROBUST)
        for part in (0, 1)
    )
    stays, returns = (
        share_difference(*(at_truth(evaluated(s, SUMMING, start).errors) for s in (a, b)))
        for start in STARTS
    )
    minima = {name: local_minima(scenario, SUMMING, SEARCHED) for name, scenario in BOTH.items()}
    surface_differs = ev.part("the sum's surface differs", _differs(SHARE))
    error_differs = ev.part("its error differs", _differs(RATIO))
    same = ev.part("the likelihood's does not", RATIO.same)
    error_differs.judge(of_sum)
    ev.headline("ratio of the sum's RMSE, A / B", of_sum, RATIO.larger)
    ev("ratio of the sum's RMSE of the rotation, A / B", of_sum_turn)
    same.headline("ratio of the robust likelihood's RMSE, A / B", of_robust)
    ev("ratio of the robust likelihood's RMSE of the rotation, A / B", of_robust_turn)
    tilt = inclination_change(*(evaluated(s, SUMMING).credibility for s in (a, b)))
    surface_differs("difference of the sum's I², A - B (dB)", tilt, _differs(DECIBELS))
    lowest = share_difference(*(each.right for each in minima.values()))
    surface_differs("difference of the shares of global minima at the truth, A - B", lowest)
    surface_differs("difference of the shares from the truth that end there, A - B", stays)
    surface_differs("difference of the shares from zero that end at the truth, A - B", returns)
    for letter, each in minima.items():
        ev(f"mean number of minima near the truth, {letter}", mean_of(each.near))
    quantiles = "ratio of the 95 % to the 5 % quantile of the RMSE over 200 layouts"
    of_sum_there, of_robust_there = (
        ev(f"{quantiles}, {name}", _spread_of_layouts(cost)) for name, cost in SPREADS.items()
    )
    ev.conclude(
        f"the errors of both costs differ, the sum's by {of_sum:.2f} (95% interval "
        f"{of_sum.between('.2f')}), the robust likelihood's by {of_robust:.2f} "
        f"({of_robust.between('.2f')}). Over 200 random layouts the 95% quantile of the RMSE is "
        f"{of_sum_there:.2f} and {of_robust_there:.2f} times the 5% quantile: neither is less "
        "stable.",
        over=f"{OF_BOTH}, {SEARCHED} for the minima, and 100 on each of 200 random layouts",
    )


def _differs(margin: Margin) -> Rule:
    """Return the opposite of the rule that a number is the same."""
    opposite: dict[Finding, Finding] = {"holds": "fails", "fails": "holds"}
    same = margin.same
    return Rule(
        lambda number: opposite.get(same(number), "open"), lambda value: -same.margin_units(value)
    )


def _spread_of_layouts(cost: RegistrationCost) -> Measured:
    def ratio(errors: Array) -> float:
        low, high = np.quantile(errors, [0.05, 0.95])
        return float(high / low)

    return bootstrapped(ratio, over_layouts("outliers and clusters", cost).rmse)
