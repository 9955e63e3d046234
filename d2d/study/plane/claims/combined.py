"""Claims of thesis section 6.3: outliers and clusters together."""

import numpy as np
from numpy.typing import NDArray

from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.study.book.claim import (
    DECIBELS,
    RATIO,
    SHARE,
    Evidence,
    Margin,
    claim,
    judge,
    larger,
    nearly_all,
    smaller,
)
from d2d.study.book.measured import (
    Measured,
    bootstrapped,
    inclination_change,
    rms_of,
    rms_ratio,
    share_difference,
    telling,
)
from d2d.study.plane.evaluation import (
    LIKELIHOOD,
    ROBUST,
    SUMMING,
    Start,
    at_truth,
    evaluated,
    over_layouts,
)
from d2d.study.plane.measures import (
    BOTH,
    SEARCHED,
    STARTS,
    error_ratio,
    errors_of,
    mean_count_near,
    share_lowest_at_truth,
    share_one_visible,
)
from d2d.study.plane.optima import local_minima
from d2d.study.plane.scenarios import OVERLAPPED, Scenario

OF_BOTH = "1000 draws of the noise of each of the two scenes"
SPREADS = {"sum": SUMMING, "robust": ROBUST}


@claim("all-likelihood-stable", section="6.3", figure="all-scenes")
def all_likelihood_stable() -> Evidence:
    """Outliers and clusters: the likelihood has one global minimum near the truth in both
    scenes.
    """
    overlapped = rms_of(errors_of(OVERLAPPED, LIKELIHOOD)[0])
    numbers: dict[str, float] = {"RMSE, likelihood, overlapped (m)": overlapped}
    right = {"likelihood": True, "robust": True}
    alone = {"likelihood": True, "robust": True}
    errors: dict[str, list[Measured]] = {"likelihood": [], "robust": []}
    # what refutes shows in few draws, what confirms needs many
    draws = {"likelihood": 5, "robust": SEARCHED}
    for name, cost in (("likelihood", LIKELIHOOD), ("robust", ROBUST)):
        for letter, scenario in BOTH.items():
            found = local_minima(scenario, cost, draws[name])
            share, single = share_lowest_at_truth(found), share_one_visible(found)
            ratio = error_ratio((scenario, cost), (OVERLAPPED, LIKELIHOOD))
            near = ratio.high < RATIO.high
            right[name] &= nearly_all(share) and near
            alone[name] &= nearly_all(single)
            error = rms_of(errors_of(scenario, cost)[0])
            errors[name].append(error)
            numbers |= {
                f"share of draws with the global minimum at the truth, {name}, {letter}": share,
                f"share of draws with one visible minimum, {name}, {letter}": single,
                f"RMSE, {name}, {letter} (m)": error,
                "ratio of the RMSE to the likelihood's in the overlapped scene, "
                f"{name}, {letter}": telling(ratio, letter == "A"),
            }
    plain, robust = (f"{a:.2f} m in A and {b:.2f} m in B" for a, b in errors.values())
    return Evidence(
        judge(confirmed=all(right.values()) and all(alone.values()), qualified=right["robust"]),
        f"with the outlier component the RMSE is {robust}, against {overlapped:.2f} m of the "
        "likelihood in the overlapped scene. Without it the outliers pull the optimum off: the "
        f"RMSE is {plain}.",
        numbers,
        holds=f"With the outlier component, with which the RMSE is {robust}.",
        over=f"{OF_BOTH}; for the minima {draws['robust']} of each with the component and "
        f"{draws['likelihood']} without",
    )


@claim("all-summing-unstable", section="6.3", figure="all-scenes")
def all_summing_unstable() -> Evidence:
    """Outliers and clusters: the sum behaves differently in the two scenes."""
    a, b = BOTH.values()
    error = {
        name: rms_ratio(errors_of(a, cost)[part], errors_of(b, cost)[part])
        for name, cost, part in (
            ("sum", SUMMING, 0),
            ("sum, rotation", SUMMING, 1),
            ("robust", ROBUST, 0),
        )
    }
    stays, returns = (
        share_difference(_ends(a, SUMMING, start), _ends(b, SUMMING, start)) for start in STARTS
    )
    tilt = inclination_change(*(evaluated(s, SUMMING).credibility for s in (a, b)))
    minima = [mean_count_near(local_minima(scenario, SUMMING)) for scenario in (a, b)]
    differs = {
        "the RMSE": _differs(error["sum"], RATIO),
        "the RMSE of the rotation": _differs(error["sum, rotation"], RATIO),
        "I2": _differs(tilt, DECIBELS),
        "the share of runs from the truth that stay there": _differs(stays, SHARE),
        "the share of runs from zero that arrive": _differs(returns, SHARE),
    }
    differing = [name for name, beyond in differs.items() if beyond]
    spreads = {name: _spread_of_layouts(cost) for name, cost in SPREADS.items()}
    spread = (
        f"the 95% quantile of the sum's RMSE is {spreads['sum']:.2f} times its 5% quantile, "
        f"and that of the robust likelihood's {spreads['robust']:.2f} times"
    )
    numbers = {
        "ratio of the sum's RMSE, A / B": telling(error["sum"]),
        "ratio of the sum's RMSE of the rotation, A / B": error["sum, rotation"],
        "ratio of the robust likelihood's RMSE, A / B": error["robust"],
        "difference of the sum's I2, A - B (dB)": telling(tilt),
        "difference of the shares from the truth that end there, A - B": stays,
        "difference of the shares from zero that end at the truth, A - B": returns,
        "mean number of minima in 5 draws, A": minima[0],
        "mean number of minima in 5 draws, B": minima[1],
    } | {
        f"ratio of the 95 % to the 5 % quantile of the RMSE over 200 layouts, {name}": each
        for name, each in spreads.items()
    }
    return Evidence(
        judge(confirmed=all(differs.values()), qualified=any(differs.values())),
        f"the sum's RMSE in A is {error['sum']:.2f} times that in B (95% interval "
        f"{error['sum'].between('.2f')}), the robust likelihood's {error['robust']:.2f} times "
        f"({error['robust'].between('.2f')}). The sum's I2 differs by {tilt:+.2f} dB "
        f"({tilt.between('+.2f')}), the share of runs from the truth that stay there by "
        f"{100 * stays:+.1f} percentage points and that of runs from zero that arrive by "
        f"{100 * returns:+.1f}; there are {minima[0]:.0f} and {minima[1]:.0f} minima near the "
        f"truth. Over 200 random layouts {spread}.",
        numbers,
        holds=f"Of the {len(differs)} measures, these differ by more than their margin: "
        f"{', '.join(differing) or 'none'}. The RMSE of the robust likelihood is "
        f"{error['robust']:.2f} times as large in A as in B.",
        over=f"{OF_BOTH}, and 100 on each of 200 random layouts",
    )


def _differs(number: Measured, margin: Margin) -> bool:
    return larger(number, margin) or smaller(number, margin)


def _ends(scenario: Scenario, cost: RegistrationCost, start: Start) -> NDArray[np.bool_]:
    return at_truth(evaluated(scenario, cost, start).errors)


def _spread_of_layouts(cost: RegistrationCost) -> Measured:
    def ratio(errors: Array) -> float:
        low, high = np.quantile(errors, [0.05, 0.95])
        return float(high / low)

    return bootstrapped(ratio, over_layouts("outliers and clusters", cost).rmse)
