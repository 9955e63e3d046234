"""Claims of thesis section 6.3: outliers."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from d2d import rigid
from d2d._types import Array
from d2d.study.book.claim import DECIBELS, RATIO, Evidence, claim, in_some, nearly_all
from d2d.study.book.measured import (
    anees_of,
    geometric_mean_of,
    inclination_change,
    mean_of,
    median_of,
    quantile_of,
    share_of,
    share_over,
)
from d2d.study.line.outlier_study import FAR, VANISHED, decades_lost
from d2d.study.plane.evaluation import (
    LIKELIHOOD,
    NOTICEABLE,
    OVER_LAYOUTS,
    ROBUST,
    SEARCHED,
    SUMMING,
    THOUSAND,
    error_ratio,
    error_ratio_of_layouts,
    evaluated,
    inclination,
    over_layouts,
    random_layout,
    ratios_in_decibels,
    same_draws,
    share_ending_at_truth,
    times_off,
)
from d2d.study.plane.optima import local_minima
from d2d.study.plane.scenarios import OUTLIERS, OVERLAPPED, Scenario

MORE = 4000  # draws for a difference of two I²
LAYOUTS = 200  # random layouts on which it is only evaluated, 10 draws on each


class _Loss(NamedTuple):
    """Cost of the outliers of M to the likelihood at the truth, in each draw."""

    decades: Array
    far: NDArray[np.bool_]  # whether one is far from every component


def _loss(scenario: Scenario, draws: int) -> _Loss:
    fixed, moving = same_draws(scenario, draws)
    count = len(scenario.outliers_moving)
    moved = rigid.transform_means(scenario.theta, moving.means)
    turned = rigid.transform_covariances(scenario.theta, moving.covariances)
    apart = moved[:, -count:, np.newaxis] - fixed.means[:, np.newaxis]
    both = turned[:, -count:, np.newaxis] + fixed.covariances[:, np.newaxis]
    squares = np.einsum("...i,...i", apart, np.linalg.solve(both, apart[..., np.newaxis])[..., 0])
    far = (squares.min(axis=-1) > FAR**2).any(axis=-1)
    return _Loss(decades_lost(LIKELIHOOD, scenario.theta, fixed, moving, count), far)


@claim("outlier-likelihood-vanishes", section="6.3", lines="1372, 1378", figure="outlier-cost")
def outlier_likelihood_vanishes(ev: Evidence) -> None:
    """Outliers: the surface of the plain likelihood gets zero."""
    here = _loss(OUTLIERS, 1000)
    others = [_loss(random_layout("outliers", seed), 10) for seed in range(LAYOUTS)]
    before, after = (
        local_minima(scenario, LIKELIHOOD, SEARCHED).highest / np.log(10.0)
        for scenario in (OVERLAPPED, OUTLIERS)
    )
    lost = here.decades > VANISHED
    on_layouts = share_over([(each.decades > VANISHED).mean() for each in others], 10)
    on_layouts_if_far = share_over(
        [(each.decades > VANISHED)[each.far].mean() for each in others if each.far.any()], 10
    )
    dropped = "share of draws with a drop by more than 16 decades"
    vanishes = ev.part("it vanishes at the truth", nearly_all)
    ev("median number of decades that the outliers cost at the truth", median_of(here.decades))
    vanishes.headline(f"{dropped} at the truth", share_of(lost), under=share_of(lost[here.far]))
    vanishes.headline(f"the same on {LAYOUTS} random layouts", on_layouts, under=on_layouts_if_far)
    ev("the same on layouts where an outlier is far from every component", on_layouts_if_far)
    ev(f"{dropped} everywhere", share_of(np.median(before) - after > VANISHED))
    ev("median log10 of the highest likelihood, overlapped", median_of(before))
    ev("median log10 of the highest likelihood, with outliers", median_of(after))
    stays = share_ending_at_truth(OUTLIERS, LIKELIHOOD)
    ev("share within 1.5 m and 6 deg of the truth, started there", stays)
    ratio = error_ratio((OUTLIERS, LIKELIHOOD), (OVERLAPPED, LIKELIHOOD))
    ev("ratio of the RMSE, with outliers / overlapped", ratio)
    tilt = ev("I² (dB)", inclination(OUTLIERS, LIKELIHOOD))
    ev.conclude(
        "the density vanishes unless each outlier happens to meet one of the previous set. The "
        f"logarithm keeps an optimum near the truth, but with {ratio:.1f} times the RMSE and with "
        f"a covariance that is {times_off(tilt)}.",
        holds=f"An outlier of the current set stands more than {FAR:g} standard deviations of a "
        "difference from every component.",
        over=f"{THOUSAND}, 10 on each of {LAYOUTS} random layouts; the highest value in "
        f"{SEARCHED} draws, by descents from 847 starts",
    )


@claim("outlier-robust-minimum", section="6.3", lines="1372, 1378", figure="outlier-cost")
def outlier_robust_minimum(ev: Evidence) -> None:
    """Outliers: with the outlier component the likelihood has only one global minimum, at the
    truth.
    """
    minima = local_minima(OUTLIERS, ROBUST, SEARCHED)
    others = [local_minima(random_layout("outliers", seed), ROBUST, 1) for seed in range(SEARCHED)]
    at_truth = ev.part("it is at the truth", nearly_all)
    only_one = ev.part("it is the only one", nearly_all)
    at_truth.headline("share of draws with the global minimum at the truth", share_of(minima.right))
    single = share_of(minima.visible == 1)
    only_one.headline("share of draws with no other above 1 % of its density", single)
    draws = "share of draws on random layouts"
    right_of_layouts = share_over([each.right for each in others], 1)
    at_truth(f"{draws} with the global minimum at the truth", right_of_layouts)
    single_of_layouts = share_over([each.visible == 1 for each in others], 1)
    only_one(f"{draws} with no other above 1 %", single_of_layouts)
    near = ev("mean number of minima within 10 m and 45 deg of the truth", mean_of(minima.near))
    ev("log10 of the second density over the first", minima.decades_to_second)
    ev.conclude(
        f"the negative logarithm has a mean of {near:.0f} local minima near the truth, but no "
        "other has more than 1% of the highest density.",
        over=f"{SEARCHED} draws of the noise of this scene and one on each of {SEARCHED} random "
        "layouts, 847 descents in each",
    )


@claim("outlier-error", section="6.3", lines="1378", figure="outlier-error")
def outlier_error(ev: Evidence) -> None:
    """Outliers: the sum's error is greater than that of the likelihood with the outlier
    component.
    """
    conditions = (OUTLIERS, SUMMING), (OUTLIERS, ROBUST)
    ratios = error_ratio_of_layouts(*conditions)
    greater = ev.part("the sum's error is greater", RATIO.larger)
    greater.headline("ratio of the RMSE, sum / robust", error_ratio(*conditions))
    larger = "share of 200 random layouts on which the sum's RMSE is the larger"
    greater.headline(larger, share_of(ratios > 1.0), nearly_all)
    greater("mean ratio over the layouts", geometric_mean_of(ratios))
    grown = error_ratio((OUTLIERS, SUMMING), (OVERLAPPED, SUMMING))
    ev("ratio of the sum's RMSE, with outliers / overlapped", grown)
    grown_robust = error_ratio((OUTLIERS, ROBUST), (OVERLAPPED, LIKELIHOOD))
    ev("ratio of the robust RMSE, with outliers / overlapped likelihood", grown_robust)
    ev.conclude(
        f"with the outliers the sum's RMSE is {grown:.2f} times that in the overlapped scene, and "
        f"the robust likelihood's {grown_robust:.2f} times that of the plain likelihood there: the "
        "outliers add little to either, and the sum's error was the larger one without them.",
        over=OVER_LAYOUTS,
    )


@claim("outlier-credibility", section="6.3", lines="1380", figure="outlier-credibility")
def outlier_credibility(ev: Evidence) -> None:
    """Outliers: the sum's credibility, pessimistic, is almost the same as in the overlapped scene;
    the likelihood with the outlier component has a pessimistic and an optimistic part.
    """
    robust = ratios_in_decibels(OUTLIERS, ROBUST)
    plain = ratios_in_decibels(OVERLAPPED, LIKELIHOOD)
    over = over_layouts("outliers", ROBUST, layouts=50, runs=500)
    is_pessimistic = ev.part("the sum is pessimistic", DECIBELS.smaller)
    is_pessimistic.headline("I² of the sum (dB)", inclination(OUTLIERS, SUMMING))
    stays = ev.part("it is so as without outliers", DECIBELS.same)
    pessimistic = ev.part("the likelihood has a pessimistic part", in_some)
    optimistic = ev.part("it has an optimistic part", in_some)
    change = inclination_change(
        *(evaluated(scene, SUMMING, runs=MORE).credibility for scene in (OUTLIERS, OVERLAPPED))
    )
    stays("change of the sum's I², outliers - overlapped (dB)", change)
    ev("I² of the robust likelihood (dB)", inclination(OUTLIERS, ROBUST))
    ev("ANEES of the robust likelihood", anees_of(evaluated(OUTLIERS, ROBUST).credibility))
    pessimistic("share of its runs below -0.3 dB", share_of(robust < -NOTICEABLE))
    optimistic.headline("share of its runs above +0.3 dB", share_of(robust > NOTICEABLE))
    below = ev("share below -0.3 dB, overlapped likelihood", share_of(plain < -NOTICEABLE))
    above = ev("share above +0.3 dB, overlapped likelihood", share_of(plain > NOTICEABLE))
    pessimistic("mean share below -0.3 dB over 50 random layouts", mean_of(over.pessimistic))
    optimistic("mean share above +0.3 dB over 50 random layouts", mean_of(over.optimistic))
    for percent in (5, 95):
        quantile = quantile_of(over.inclination, percent / 100.0)
        ev(f"{percent} % quantile of I² over these layouts (dB)", quantile)
    ev.conclude(
        "estimated covariances scatter about the right one, so that some of both parts is seen "
        f"without outliers, too: {below:.1%} of the runs lie below -{NOTICEABLE:g} dB and "
        f"{above:.1%} above +{NOTICEABLE:g} dB.",
        holds="The robust likelihood has both parts over random layouts, not in this scene.",
        over=f"{THOUSAND}, {MORE} for the change of the sum's I², and 500 on each of 50 random "
        "layouts",
    )
