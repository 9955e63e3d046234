"""Claims of thesis section 6.3: outliers."""

import numpy as np

from d2d._types import Array
from d2d.study.book.claim import Evidence, claim, judge
from d2d.study.plane.evaluation import (
    LIKELIHOOD,
    NOTICEABLE,
    ROBUST,
    SUMMING,
    evaluated,
    over_layouts,
    ratio_interval,
    rms,
    same_draws,
)
from d2d.study.plane.measures import (
    PESSIMISTIC,
    counts_visible,
    decades_to_second,
    errors_of,
    mean_count_near,
    ratios_in_decibels,
    share_ending_at_truth,
    share_lowest_at_truth,
    times_off,
)
from d2d.study.plane.optima import local_minima
from d2d.study.plane.scenarios import (
    LAYOUTS,
    OUTLIERS,
    OVERLAPPED,
    Scenario,
    random_scene,
)

VANISHED = -16.0  # decades: a density that double precision cannot add to that of a good fit


def _log10_density_at_truth(scenario: Scenario) -> Array:
    fixed, moving = same_draws(scenario)
    return np.asarray(-LIKELIHOOD.value(scenario.theta, fixed, moving) / np.log(10.0))


@claim(
    "outlier-likelihood-vanishes",
    section="6.3",
    figure="outlier-cost",
    telling=(
        "median log10 of the likelihood at the truth, with outliers",
        "ratio of the RMSE, with outliers / overlapped",
    ),
)
def outlier_likelihood_vanishes() -> Evidence:
    """Outliers: the plain likelihood vanishes."""
    outliers = _log10_density_at_truth(OUTLIERS)
    before, after = (
        float(np.median(_log10_density_at_truth(OVERLAPPED))),
        float(np.median(outliers)),
    )
    vanishing = float((outliers - before < VANISHED).mean())
    stays = share_ending_at_truth(OUTLIERS, LIKELIHOOD)
    lowest = share_lowest_at_truth(local_minima(OUTLIERS, LIKELIHOOD))
    ratio = rms(errors_of(OUTLIERS, LIKELIHOOD)[0]) / rms(errors_of(OVERLAPPED, LIKELIHOOD)[0])
    inclination = evaluated(OUTLIERS, LIKELIHOOD).credibility.inclination
    vanishes = vanishing >= 0.99
    leaves = stays < 0.01
    return Evidence(
        judge(confirmed=vanishes and leaves, qualified=vanishes),
        "at the true motion the outliers lower the median of the likelihood from "
        f"10^{before:.0f} to 10^{after:.0f}. Its logarithm does not vanish: {stays:.0%} of the "
        "descents from the truth end at an optimum within 1.5 m and 6 degrees of it, but with "
        f"{ratio:.1f} times the RMSE and with a covariance that is {times_off(inclination)}.",
        {
            "median log10 of the likelihood at the truth, overlapped": before,
            "median log10 of the likelihood at the truth, with outliers": after,
            "share of draws with a drop by more than 16 decades": vanishing,
            "share within 1.5 m and 6 deg of the truth, started there": stays,
            "share of 5 draws with the lowest minimum found there": lowest,
            "ratio of the RMSE, with outliers / overlapped": ratio,
            "I2 (dB)": inclination,
        },
        holds="As a number at the true motion, which drops by more than 16 decades in "
        f"{vanishing:.0%} of the draws. The logarithm keeps an optimum, pulled away by the "
        f"outliers ({ratio:.1f} times the RMSE) and with a covariance {times_off(inclination)}.",
    )


@claim(
    "outlier-robust-minimum",
    section="6.3",
    figure="outlier-cost",
    telling=(
        "share of 25 draws with the global minimum at the truth",
        "log10 of the second density over the first",
    ),
)
def outlier_robust_minimum() -> Evidence:
    """Outliers: the robust likelihood has one global minimum, at the truth."""
    found = local_minima(OUTLIERS, ROBUST)
    for seed in range(10):
        other = random_scene("outliers", LAYOUTS["outliers"], np.random.default_rng(seed))
        found = found + local_minima(other, ROBUST, draws=2)
    right = share_lowest_at_truth(found)
    single = float(np.mean([count == 1 for count in counts_visible(found)]))
    near = mean_count_near(found)
    return Evidence(
        judge(confirmed=right == 1.0 and single > 0.9, qualified=right > 0.9),
        f"in {right:.0%} of {len(found)} draws, of this scene and of ten random layouts, the "
        f"global minimum is at the truth, and in {single:.0%} no other has more than 1% of its "
        f"density; the negative logarithm has a mean of {near:.0f} local minima near the truth.",
        {
            "share of 25 draws with the global minimum at the truth": right,
            "share of them with no other above 1 % of its density": single,
            "mean number of minima within 10 m and 45 deg of the truth": near,
            "log10 of the second density over the first": decades_to_second(found),
        },
        holds=f"The global minimum is at the truth in {right:.0%} of the draws, and the only one "
        f"above 1% of the highest density in {single:.0%}.",
    )


@claim(
    "outlier-error",
    section="6.3",
    figure="outlier-error",
    telling=(
        "ratio of the RMSE, summing / robust",
        "upper bound of the 95 % interval",
    ),
)
def outlier_error() -> Evidence:
    """Outliers: the sum's error is larger than the robust likelihood's."""
    over, under = errors_of(OUTLIERS, SUMMING)[0], errors_of(OUTLIERS, ROBUST)[0]
    ratio = rms(over) / rms(under)
    low, high = ratio_interval(over, under)
    ratios = over_layouts("outliers", SUMMING).rmse / over_layouts("outliers", ROBUST).rmse
    larger = float((ratios > 1.0).mean())
    grown = rms(over) / rms(errors_of(OVERLAPPED, SUMMING)[0])
    grown_robust = rms(under) / rms(errors_of(OVERLAPPED, LIKELIHOOD)[0])
    return Evidence(
        judge(confirmed=low > 1.0 and larger > 0.95, qualified=low > 1.0),
        f"the ratio of the two RMSEs is {ratio:.2f} (95% interval {low:.2f} to {high:.2f}) and "
        f"exceeds one on {larger:.1%} of 200 random layouts. With the outliers the sum's RMSE is "
        f"{grown:.2f} times that in the overlapped scene, and the robust likelihood's "
        f"{grown_robust:.2f} times that of the plain likelihood there.",
        {
            "ratio of the RMSE, summing / robust": ratio,
            "lower bound of the 95 % interval": low,
            "upper bound of the 95 % interval": high,
            "share of 200 random layouts on which the sum's RMSE is the larger": larger,
            "ratio of the robust RMSE, with outliers / overlapped likelihood": grown_robust,
        },
        holds=f"In this scene, where the ratio of the RMSEs has a 95% interval of {low:.2f} to "
        f"{high:.2f}, and on {larger:.1%} of 200 random layouts.",
    )


@claim(
    "outlier-credibility",
    section="6.3",
    figure="outlier-credibility",
    telling=(
        "I2 of the sum (dB)",
        "I2 of the robust likelihood (dB)",
    ),
)
def outlier_credibility() -> Evidence:
    """Outliers: the sum stays pessimistic; the robust likelihood shows a pessimistic and an
    optimistic part.
    """
    summing = evaluated(OUTLIERS, SUMMING).credibility.inclination
    robust = ratios_in_decibels(OUTLIERS, ROBUST)
    below, above = _shares_beyond(robust)
    plain_below, plain_above = _shares_beyond(ratios_in_decibels(OVERLAPPED, LIKELIHOOD))
    over = over_layouts("outliers", ROBUST, layouts=50, runs=500)
    low, high = map(float, np.quantile(over.inclination, [0.05, 0.95]))
    typical = float((np.minimum(over.pessimistic, over.optimistic) > 0.05).mean())
    pessimistic = summing < PESSIMISTIC
    both = min(below, above) > 0.05
    return Evidence(
        judge(confirmed=pessimistic and both, qualified=pessimistic and typical > 0.5),
        f"the sum's I2 is {summing:+.1f} dB. Of the robust likelihood's runs {below:.1%} lie below "
        f"-0.3 dB and {above:.1%} above +0.3 dB, without outliers {plain_below:.1%} and "
        f"{plain_above:.1%} of the plain likelihood's; on {typical:.0%} of 50 random layouts more "
        f"than 5% lie on either side, with an I2 from {low:+.1f} dB to {high:+.1f} dB (5% and 95% "
        "quantiles).",
        {
            "I2 of the sum (dB)": summing,
            "I2 of the robust likelihood (dB)": float(robust.mean()),
            "ANEES of the robust likelihood": evaluated(OUTLIERS, ROBUST).credibility.anees,
            "share of its runs below -0.3 dB": below,
            "share of its runs above +0.3 dB": above,
            "share below -0.3 dB, overlapped likelihood": plain_below,
            "share above +0.3 dB, overlapped likelihood": plain_above,
            "share of 50 random layouts with more than 5 % on either side": typical,
            "5 % quantile of I2 over these layouts (dB)": low,
            "95 % quantile of I2 over these layouts (dB)": high,
        },
        holds=f"For the sum, whose I2 is {summing:+.1f} dB. For the two parts on {typical:.0%} of "
        f"50 random layouts, with an I2 from {low:+.1f} dB to {high:+.1f} dB, and without outliers "
        f"too ({plain_below:.1%} and {plain_above:.1%} of the runs).",
    )


def _shares_beyond(decibels: Array) -> tuple[float, float]:
    """Share of the runs below -0.3 dB, and above +0.3 dB."""
    return float((decibels < -NOTICEABLE).mean()), float((decibels > NOTICEABLE).mean())
