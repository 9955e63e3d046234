"""Claims of thesis section 6.3: the overlapped scene."""

import numpy as np

from d2d.registration import ANNEALED
from d2d.study.book.claim import Evidence, claim, judge
from d2d.study.plane.evaluation import (
    LIKELIHOOD,
    NOTICEABLE,
    ROBUST,
    SUMMING,
    at_truth,
    evaluated,
    over_layouts,
    ratio_interval,
    rms,
)
from d2d.study.plane.measures import (
    PESSIMISTIC,
    SAME_ERROR,
    counts_visible,
    decades_to_second,
    errors_of,
    has_one_visible,
    mean_count_near,
    ratios_in_decibels,
    share_ending_at_truth,
    times_off,
)
from d2d.study.plane.optima import local_minima
from d2d.study.plane.scenarios import OVERLAPPED
from d2d.study.plane.thesis_readings import unweighted_outlier
from d2d.study.runs import monte_carlo


@claim(
    "overlap-local-minima",
    section="6.3",
    figure="overlap-cost",
    telling=(
        "minimum number in a draw above 1 % of the highest density, summing",
        "mean number of minima there, likelihood",
    ),
)
def overlap_local_minima() -> Evidence:
    """Overlapped: the summing cost has many local minima and the likelihood one minimum."""
    summing, likelihood = local_minima(OVERLAPPED, SUMMING), local_minima(OVERLAPPED, LIKELIHOOD)
    visible, visible_likelihood = min(counts_visible(summing)), max(counts_visible(likelihood))
    near, lower = mean_count_near(likelihood), decades_to_second(likelihood)
    many = visible >= 10
    single = max(each.near for each in likelihood) == 1
    return Evidence(
        judge(confirmed=many and single, qualified=many and has_one_visible(likelihood)),
        f"the density, as one plots it, has at least {visible} optima above 1% of the highest for "
        f"the sum and at most {visible_likelihood} for the likelihood, in each of five draws. The "
        "negative logarithm, which an optimiser descends, has a mean of "
        f"{near:.0f} local minima near the truth for the likelihood too, but the second lowest has "
        f"only 10^{lower:.0f} of the highest density.",
        {
            "mean number of minima within 10 m and 45 deg of the truth, summing": mean_count_near(
                summing
            ),
            "mean number of minima there, likelihood": near,
            "minimum number in a draw above 1 % of the highest density, summing": visible,
            "maximum number in a draw above 1 % of the highest density, likelihood": (
                visible_likelihood
            ),
            "log10 of the second density over the first, summing": decades_to_second(summing),
            "log10 of the second density over the first, likelihood": lower,
        },
        holds="For the density as one plots it, where the number of the likelihood's optima above "
        f"1% of the highest is at most {visible_likelihood}; its logarithm has a mean of "
        f"{near:.0f} local optima near the truth, the second highest {-lower:.0f} decades lower.",
    )


@claim(
    "overlap-error",
    section="6.3",
    figure="overlap-error",
    telling=(
        "ratio of the RMSE of the translation, summing / likelihood",
        "ratio of the RMSE of the rotation, summing / likelihood",
    ),
)
def overlap_error() -> Evidence:
    """Overlapped: the likelihood's estimation error is smaller than the sum's."""
    numbers, ratio, lower = {}, {}, {}
    parts = zip(errors_of(OVERLAPPED, SUMMING), errors_of(OVERLAPPED, LIKELIHOOD), strict=True)
    for name, (over, under) in zip(("translation", "rotation"), parts, strict=True):
        ratio[name] = rms(over) / rms(under)
        lower[name], upper = ratio_interval(over, under)
        numbers[f"ratio of the RMSE of the {name}, summing / likelihood"] = ratio[name]
        numbers[f"lower bound of the 95 % interval, {name}"] = lower[name]
        numbers[f"upper bound of the 95 % interval, {name}"] = upper
    ratios = over_layouts("overlapped", SUMMING).rmse / over_layouts("overlapped", LIKELIHOOD).rmse
    larger = float((ratios > 1.0).mean())
    numbers["share of 200 random layouts on which the sum's RMSE is the larger"] = larger
    numbers["median ratio over the layouts, translation"] = float(np.median(ratios))
    holds_here = min(lower.values()) > 1.0
    return Evidence(
        judge(confirmed=holds_here and larger > 0.95, qualified=holds_here),
        f"the sum's RMSE is {ratio['translation']:.2f} times the likelihood's in translation and "
        f"{ratio['rotation']:.2f} times in rotation, and the larger one on {larger:.0%} of 200 "
        "random layouts. The sum weights a target by how well it happens to fit, the likelihood "
        "by its covariance.",
        numbers,
        holds="In this scene, where the lower bounds of the 95% intervals of the ratios are "
        f"{lower['translation']:.2f} (translation) and {lower['rotation']:.2f} (rotation), and on "
        f"{larger:.0%} of 200 random layouts.",
    )


@claim(
    "overlap-initial-guess",
    section="6.3",
    figure="overlap-error",
    telling=(
        "share of runs from zero that end at the truth, summing",
        "share of runs from zero that end at the truth, likelihood",
    ),
)
def overlap_initial_guess() -> Evidence:
    """Overlapped: a start at zero hurts the sum and not the likelihood."""
    costs = {"summing": SUMMING, "likelihood": LIKELIHOOD}
    zero, annealed = {}, {}
    for name, cost in costs.items():
        zero[name] = share_ending_at_truth(OVERLAPPED, cost, "zero")
        inflated = monte_carlo(OVERLAPPED, cost, initial="zero", scales=ANNEALED)
        annealed[name] = float(at_truth(inflated.errors).mean())
    stays = share_ending_at_truth(OVERLAPPED, SUMMING)
    over = over_layouts("overlapped", LIKELIHOOD, "zero").share
    median, low = float(np.median(over)), float(np.quantile(over, 0.05))
    hurts = stays - zero["summing"] > 0.5
    unharmed = zero["likelihood"] > 0.99
    better = zero["likelihood"] - zero["summing"] > 0.5
    return Evidence(
        judge(confirmed=hurts and unharmed, qualified=hurts and better),
        f"from zero {zero['summing']:.1%} of the sum's runs end at the truth and "
        f"{zero['likelihood']:.1%} of the likelihood's; over 200 random layouts the likelihood's "
        f"share has a median of {median:.0%} and a 5% quantile of {low:.0%}. With standard "
        f"deviations inflated tenfold and stepped down, {annealed['likelihood']:.1%} of the "
        f"likelihood's runs and {annealed['summing']:.1%} of the sum's end there.",
        {
            "share of runs from the truth that end there, summing": stays,
            "share of runs from zero that end at the truth, summing": zero["summing"],
            "share of runs from zero that end at the truth, likelihood": zero["likelihood"],
            "share of annealed runs from zero that end at the truth, summing": annealed["summing"],
            "share of annealed runs from zero that end at the truth, likelihood": annealed[
                "likelihood"
            ],
            "median share over 200 random layouts, likelihood": median,
            "5 % quantile over the layouts, likelihood": low,
        },
        holds=f"For {zero['likelihood']:.0%} of the likelihood's runs in this scene, and on random "
        f"layouts for a median of {median:.0%} (5% quantile {low:.0%}). With annealed standard "
        f"deviations {annealed['summing']:.0%} of the sum's runs from zero and "
        f"{annealed['likelihood']:.0%} of the likelihood's end at the truth.",
    )


@claim(
    "overlap-summing-pessimistic",
    section="6.3",
    figure="overlap-covariance",
    telling=(
        "ANEES",
        "I2 (dB)",
    ),
)
def overlap_summing_pessimistic() -> Evidence:
    """Overlapped: the sum's covariance is larger than its error (pessimistic)."""
    found = evaluated(OVERLAPPED, SUMMING).credibility
    over = over_layouts("overlapped", SUMMING).inclination
    high = float(np.quantile(over, 0.95))
    holds_here = found.inclination < PESSIMISTIC
    return Evidence(
        judge(confirmed=holds_here and high < PESSIMISTIC, qualified=holds_here),
        f"with {len(OVERLAPPED.targets)} targets the covariance is {times_off(found.inclination)} "
        f"here, and {times_off(high)} at the 95% quantile of I2 over 200 random layouts. The "
        "Hessian of -log sum_k q_k is an average over the targets where that of -sum_k log q_k is "
        "a total, so that with K targets the covariance is of the order of K times too large (9K/8 "
        "for many equal ones).",
        {
            "I2 (dB)": found.inclination,
            "ANEES": found.anees,
            "95 % quantile of I2 over 200 random layouts (dB)": high,
        },
        holds=f"In this scene, where I2 is {found.inclination:+.1f} dB; its 95% quantile over 200 "
        f"random layouts is {high:+.1f} dB.",
    )


@claim(
    "overlap-likelihood-credible",
    section="6.3",
    figure="overlap-credibility",
    telling=(
        "ANEES",
        "I2 (dB)",
    ),
)
def overlap_likelihood_credible() -> Evidence:
    """Overlapped: the likelihood is credible, its NEES near that of the credible estimator."""
    found = evaluated(OVERLAPPED, LIKELIHOOD).credibility
    low, high = map(float, found.bounds)
    median = float(np.median(over_layouts("overlapped", LIKELIHOOD).inclination))
    holds_here = found.consistent and abs(found.inclination) < NOTICEABLE
    centred = abs(median) < NOTICEABLE
    return Evidence(
        judge(confirmed=holds_here and centred, qualified=holds_here),
        "the inverse Hessian of a negative log-likelihood estimates the covariance of its errors: "
        f"the ANEES is {found.anees:.3f} (95% region {low:.3f} to {high:.3f}), "
        f"and I2 is {found.inclination:+.2f} dB here and {median:+.2f} dB in the median over 200 "
        "random layouts.",
        {
            "ANEES": found.anees,
            "lower bound of the 95 % region": low,
            "upper bound of the 95 % region": high,
            "NCI (dB)": found.nci,
            "I2 (dB)": found.inclination,
            "median of I2 over 200 random layouts (dB)": median,
        },
        holds=f"In this scene, where I2 is {found.inclination:+.2f} dB; its median over 200 random "
        f"layouts is {median:+.2f} dB.",
    )


@claim(
    "overlap-outlier-component",
    section="6.3",
    figure="overlap-credibility",
    telling=(
        "ratio of the RMSE with the component / without",
        "I2 with the component (dB)",
    ),
)
def overlap_outlier_component() -> Evidence:
    """The outlier component leaves the error and makes the covariance more pessimistic."""
    robust, plain = errors_of(OVERLAPPED, ROBUST)[0], errors_of(OVERLAPPED, LIKELIHOOD)[0]
    ratio = rms(robust) / rms(plain)
    low, high = ratio_interval(robust, plain)
    before = ratios_in_decibels(OVERLAPPED, LIKELIHOOD)
    after = ratios_in_decibels(OVERLAPPED, ROBUST)
    change = after - before
    spread = float(1.96 * change.std() / np.sqrt(len(change)))
    unweighted = unweighted_outlier(len(OVERLAPPED.targets))
    printed = evaluated(OVERLAPPED, unweighted).credibility.inclination
    same = low > 1.0 / SAME_ERROR and high < SAME_ERROR
    more = change.mean() + spread < 0.0
    return Evidence(
        judge(confirmed=same and more, qualified=same),
        f"the RMSE becomes {ratio:.2f} times what it is without the component, and I2 changes from "
        f"{before.mean():+.2f} dB to {after.mean():+.2f} dB with the mixture's weights in the "
        f"component and to {printed:+.2f} dB without them, as the thesis prints it. The component "
        "takes curvature away; the thesis says that it adds curvature.",
        {
            "ratio of the RMSE with the component / without": ratio,
            "I2 without the component (dB)": float(before.mean()),
            "I2 with the component (dB)": float(after.mean()),
            "95 % half-width of the difference, same draws (dB)": spread,
            "I2 with the unweighted component (dB)": printed,
        },
        holds=f"For the error, whose ratio has a 95% interval of {low:.2f} to {high:.2f}; I2 "
        f"changes by {change.mean():+.2f} dB, give or take {spread:.2f} dB.",
    )
