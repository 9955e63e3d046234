"""Claims of thesis section 6.3: outliers and clusters together."""

import numpy as np

from d2d.study.book.claim import Evidence, claim, judge
from d2d.study.plane.evaluation import (
    LIKELIHOOD,
    ROBUST,
    SUMMING,
    evaluated,
    over_layouts,
    rms,
)
from d2d.study.plane.measures import (
    BOTH,
    SAME_ERROR,
    counts_visible,
    errors_of,
    has_one_visible,
    mean_count_near,
    share_ending_at_truth,
    share_lowest_at_truth,
)
from d2d.study.plane.optima import local_minima
from d2d.study.plane.scenarios import OVERLAPPED


@claim(
    "all-likelihood-stable",
    section="6.3",
    figure="all-scenes",
    telling=(
        "RMSE, robust, A (m)",
        "RMSE, likelihood, A (m)",
    ),
)
def all_likelihood_stable() -> Evidence:
    """Outliers and clusters: the likelihood has one global minimum near the truth in both
    scenes.
    """
    numbers: dict[str, float] = {}
    right = {"likelihood": True, "robust": True}
    errors: dict[str, list[float]] = {"likelihood": [], "robust": []}
    overlapped = rms(errors_of(OVERLAPPED, LIKELIHOOD)[0])
    for name, cost in (("likelihood", LIKELIHOOD), ("robust", ROBUST)):
        for letter, scenario in BOTH.items():
            found = local_minima(scenario, cost)
            error, share = rms(errors_of(scenario, cost)[0]), share_lowest_at_truth(found)
            near = error < SAME_ERROR * overlapped
            right[name] &= has_one_visible(found) and share == 1.0 and near
            errors[name].append(error)
            numbers |= {
                f"share of 5 draws with the global minimum at the truth, {name}, {letter}": share,
                f"maximum number of visible minima in 5 draws, {name}, {letter}": float(
                    max(counts_visible(found))
                ),
                f"RMSE, {name}, {letter} (m)": error,
            }
    plain, robust = (f"{a:.2f} m in A and {b:.2f} m in B" for a, b in errors.values())
    return Evidence(
        judge(confirmed=all(right.values()), qualified=right["robust"]),
        f"with the outlier component the RMSE is {robust}, against {overlapped:.2f} m of the "
        "likelihood in the overlapped scene. Without it the outliers pull the optimum off: the "
        f"RMSE is {plain}.",
        numbers,
        holds=f"With the outlier component, with which the RMSE is {robust}.",
    )


@claim(
    "all-summing-unstable",
    section="6.3",
    figure="all-scenes",
    telling=(
        "share of runs from the truth that end there, A",
        "share of runs from the truth that end there, B",
    ),
)
def all_summing_unstable() -> Evidence:
    """Outliers and clusters: the sum behaves differently in the two scenes."""
    numbers: dict[str, float] = {}
    stays, returns, inclinations, minima = [], [], [], []
    for letter, scenario in BOTH.items():
        stays.append(share_ending_at_truth(scenario, SUMMING))
        returns.append(share_ending_at_truth(scenario, SUMMING, "zero"))
        inclinations.append(evaluated(scenario, SUMMING).credibility.inclination)
        minima.append(mean_count_near(local_minima(scenario, SUMMING)))
        numbers |= {
            f"share of runs from the truth that end there, {letter}": stays[-1],
            f"share of runs from zero that end at the truth, {letter}": returns[-1],
            f"RMSE, {letter} (m)": rms(errors_of(scenario, SUMMING)[0]),
            f"I2, {letter} (dB)": inclinations[-1],
            f"mean number of minima in 5 draws, {letter}": minima[-1],
        }
    spreads = {}
    for name, cost in (("summing", SUMMING), ("robust", ROBUST)):
        low, high = np.quantile(over_layouts("outliers and clusters", cost).rmse, [0.05, 0.95])
        spreads[name] = float(high / low)
        numbers[f"ratio of the 95 % to the 5 % quantile of the RMSE over 200 layouts, {name}"] = (
            spreads[name]
        )
    spread = (
        f"the 95% quantile of the sum's RMSE is {spreads['summing']:.2f} times its 5% quantile, "
        f"and that of the robust likelihood's {spreads['robust']:.2f} times"
    )
    return Evidence(
        judge(
            confirmed=min(stays) < 0.95,
            qualified=spreads["summing"] > 1.2 * spreads["robust"],
        ),
        f"of the runs from the truth {stays[0]:.1%} stay there in A and {stays[1]:.1%} in B, with "
        f"an I2 of {inclinations[0]:+.1f} dB and {inclinations[1]:+.1f} dB and a mean of "
        f"{minima[0]:.0f} and {minima[1]:.0f} minima; of those from zero {returns[0]:.1%} and "
        f"{returns[1]:.1%} end at the truth. Over 200 random layouts {spread}.",
        numbers,
        holds=f"For the size of its error: over 200 random layouts {spread}.",
    )
