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
    overlapped = rms_of(errors_of(OVERLAPPED, LIKELIHOOD)[0])
    is_right = ev.part("the global minimum is at the truth", nearly_all)
    only_one = ev.part("it is the only one", nearly_all)
    close = ev.part("the estimate is close", RATIO.no_larger)
    ev("RMSE, likelihood, overlapped (m)", overlapped)
    ones: dict[str, Measured] = {}
    errors: dict[str, list[Measured]] = {"robust": [], "likelihood": []}
    for name, cost in (("robust", ROBUST), ("likelihood", LIKELIHOOD)):
        for letter, scenario in BOTH.items():
            error = rms_of(errors_of(scenario, cost)[0])
            ratio = error_ratio((scenario, cost), (OVERLAPPED, LIKELIHOOD))
            errors[name].append(ev(f"RMSE, {name}, {letter} (m)", error))
            to_overlapped = "ratio of the RMSE to the likelihood's in the overlapped scene"
            ev(f"{to_overlapped}, {name}, {letter}", ratio)
            if name != "robust":
                continue
            close.judge(ratio)
            minima = local_minima(scenario, cost, SEARCHED)
            at_truth = f"share of draws with the global minimum at the truth, {letter}"
            is_right(at_truth, share_of(minima.right))
            ones[letter] = only_one.headline(
                f"share of draws with one visible minimum, {letter}", share_of(minima.visible == 1)
            )
    plain, robust = (
        f"{a:.2f} m in A and {b:.2f} m in B" for a, b in (errors["likelihood"], errors["robust"])
    )
    seen = f"{1 - ones['A']:.0%} (A) and {1 - ones['B']:.0%} (B)"
    ev.conclude(
        f"with the outlier component the RMSE is {robust}, against {overlapped:.2f} m of the "
        "likelihood in the overlapped scene. Without it the outliers pull the optimum off: the "
        f"RMSE is {plain}. In {seen} of the draws a second minimum has more than 1% of the highest "
        "density.",
        holds=f"For the place of the minimum; a second one can be seen in {seen} of the draws. "
        f"Without the outlier component the RMSE is {plain}.",
        over=f"{OF_BOTH}; for the minima {SEARCHED} of each",
    )


@claim("all-summing-unstable", section="6.3", lines="1463", figure="all-scenes")
def all_summing_unstable(ev: Evidence) -> None:
    """Outliers and clusters: the sum's surface behaves differently in the two scenes, and therefore
    its error does; the likelihood behaves almost the same.
    """
    a, b = BOTH.values()
    error = {
        name: rms_ratio(errors_of(a, cost)[part], errors_of(b, cost)[part])
        for name, cost, part in (
            ("sum", SUMMING, 0),
            ("sum, rotation", SUMMING, 1),
            ("robust", ROBUST, 0),
            ("robust, rotation", ROBUST, 1),
        )
    }
    stays, returns = (
        share_difference(*(at_truth(evaluated(s, SUMMING, start).errors) for s in (a, b)))
        for start in STARTS
    )
    tilt = inclination_change(*(evaluated(s, SUMMING).credibility for s in (a, b)))
    minima = [local_minima(scenario, SUMMING, SEARCHED) for scenario in (a, b)]
    lowest = share_difference(*(each.right for each in minima))
    spreads = {name: _spread_of_layouts(cost) for name, cost in SPREADS.items()}
    spread = (
        f"the 95% quantile of the sum's RMSE is {spreads['sum']:.2f} times its 5% quantile, "
        f"and that of the robust likelihood's {spreads['robust']:.2f} times"
    )
    surface_differs = ev.part("the sum's surface differs", _differs(SHARE))
    error_differs = ev.part("its error differs", _differs(RATIO))
    same = ev.part("the likelihood's does not", RATIO.same)
    error_differs.judge(error["sum"])
    ev.headline("ratio of the sum's RMSE, A / B", error["sum"], RATIO.larger)
    ev("ratio of the sum's RMSE of the rotation, A / B", error["sum, rotation"])
    same.headline("ratio of the robust likelihood's RMSE, A / B", error["robust"])
    ev("ratio of the robust likelihood's RMSE of the rotation, A / B", error["robust, rotation"])
    surface_differs("difference of the sum's I2, A - B (dB)", tilt, _differs(DECIBELS))
    surface_differs("difference of the shares of global minima at the truth, A - B", lowest)
    surface_differs("difference of the shares from the truth that end there, A - B", stays)
    surface_differs("difference of the shares from zero that end at the truth, A - B", returns)
    for letter, each in zip(BOTH, minima, strict=True):
        ev(f"mean number of minima near the truth, {letter}", mean_of(each.near))
    quantiles = "ratio of the 95 % to the 5 % quantile of the RMSE over 200 layouts"
    for name, ratio in spreads.items():
        ev(f"{quantiles}, {name}", ratio)
    ev.conclude(
        f"the sum's RMSE in A is {error['sum']:.2f} times that in B (95% interval "
        f"{error['sum'].between('.2f')}), and the robust likelihood's, {error['robust']:.2f} times "
        f"({error['robust'].between('.2f')}), differs as well. The sum's surface behaves the same: "
        f"its I2 differs by {tilt:+.2f} dB ({tilt.between('+.2f')}), the share of runs from the "
        f"truth that stay there by {100 * stays:+.1f} percentage points and that of runs from zero "
        f"that arrive by {100 * returns:+.1f}, and its global minimum is at the truth as often "
        f"({100 * lowest:+.1f}). Over 200 random layouts {spread}: neither is less stable.",
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
