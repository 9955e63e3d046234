"""Claims of thesis section 4.4: an outlier on the line."""

import numpy as np
from numpy.typing import NDArray

from d2d.credibility import Credibility, credibility
from d2d.point_set import PointSet
from d2d.registration import register
from d2d.study.book.claim import RATIO, SHARE, Evidence, claim, decide, nearly_all
from d2d.study.book.measured import (
    complement,
    inclination_change,
    inclination_of,
    largest,
    mean_of,
    median_of,
    rms_ratio,
    share_difference,
    share_of,
    smallest,
)
from d2d.study.line.claims.surfaces import is_right
from d2d.study.line.outlier_study import (
    COMPARABLE,
    DRAWS,
    FAR,
    FRACTIONS,
    LIKELIHOOD,
    MAP_DRAWS,
    RIGHT,
    ROBUST,
    SUMMING,
    TINY,
    TRANSLATIONS,
    UNIFORM,
    UNIFORM_DENSITY,
    VANISHED,
    WIDTHS,
    decades_lost,
    scene,
    survey_corrupted,
    survey_scene,
)
from d2d.study.line.scene import SIGMA, TRUTH
from d2d.study.line.surfaces import log_surface, peaks

OVER = f"{DRAWS} draws of the noise and of the outlier's place on the line"
SEPARATE = 2.0 * np.sqrt(2.0)  # standard deviations between two equal bumps with two maxima
MANY = 1000  # draws, a seventh of which meet the condition of the sum's rivals
USUAL = 0.2, 10.0  # the fraction and the width (m) of thesis ch. 6


@claim("outlier-fixed-summing", section="4.4", lines="729, 737", figure="outlier-fixed-cost")
def outlier_fixed_summing(ev: Evidence) -> None:
    """An outlier in the previous set introduces a fourth possibility for each target, and more
    local peaks of the sum.
    """
    before, after = survey_scene(SUMMING), survey_scene(SUMMING, "fixed")
    fixed, moving = scene("fixed")
    b_alone = PointSet(moving.means[:, :1], moving.covariances[:, :1])
    surfaces_of_b = log_surface(LIKELIHOOD, TRANSLATIONS, fixed, b_alone)
    has_four = peaks(TRANSLATIONS, surfaces_of_b).number == 4
    gains = after.optima > before.optima
    targets, outlier = fixed.means[:, :-1, 0], fixed.means[:, -1:, 0]
    apart = np.abs(outlier - targets).min(axis=-1) > SEPARATE * SIGMA
    four, four_if_apart = share_of(has_four), share_of(has_four[apart])
    more, more_if_apart = share_of(gains), share_of(gains[apart])
    possibility = ev.part("each target gets a fourth possibility", nearly_all)
    gets_more = ev.part("the sum gets more local peaks", nearly_all)
    peaks_of_b = "share of draws in which target B's surface has four peaks"
    possibility(peaks_of_b, four, under=four_if_apart)
    maxima = "share of draws with more local maxima"
    gets_more.headline(f"{maxima} of the sum than without the outlier", more, under=more_if_apart)
    ev.headline(f"{maxima}, outlier apart from all targets", more_if_apart, nearly_all)
    number_before = ev("mean number of maxima without the outlier", mean_of(before.optima))
    number = ev("mean number of maxima with it", mean_of(after.optima))
    ev.conclude(
        "the outlier adds three pairs and up to three bumps: target B's surface has four peaks in "
        f"{four:.0%} of the draws, and the sum has more maxima than without the outlier in "
        f"{more:.0%}, on average {number:.2f} instead of {number_before:.2f}. Where it stands more "
        f"than {SEPARATE:.1f} standard deviations from all targets, the distance at which two "
        f"equal bumps separate, it has in {more_if_apart:.0%}; nearer, a target's peak can take it "
        "in.",
        holds=f"The outlier stands more than {SEPARATE:.1f} standard deviations from every target, "
        f"where it adds a maximum in {more_if_apart:.0%} of the draws; it adds none in "
        f"{1 - more:.0%} of all.",
        over=OVER,
    )


@claim("outlier-fixed-likelihood", section="4.4", lines="729, 744", figure="outlier-fixed-cost")
def outlier_fixed_likelihood(ev: Evidence) -> None:
    """The likelihood is robust against an outlier in the previous set: its surface has only one
    global peak, at the correct translation.
    """
    before, after = survey_scene(LIKELIHOOD), survey_scene(LIKELIHOOD, "fixed")
    right, single = share_of(is_right(after)), share_of(after.rival < TINY)
    # the RMSEs of the estimates that start at the truth, same draws
    estimates = [register(*scene(where, 4000), LIKELIHOOD, [TRUTH]) for where in ("fixed", "")]
    both = estimates[0].converged & estimates[1].converged
    with_it, without = (estimate.theta[both] - TRUTH for estimate in estimates)
    ratio = rms_ratio(with_it, without)
    number, number_before = mean_of(after.optima), mean_of(before.optima)
    at_truth = ev.part("the global peak is right", nearly_all)
    only_one = ev.part("it is the only one", nearly_all)
    as_good = ev.part("the estimate is as good", RATIO.same)
    at_truth("share of draws with the highest peak at the true alignment", right)
    only_one.headline("share of draws with one visible peak (no rival above 1 %)", single)
    as_good.headline("root mean square error with the outlier over that without", ratio)
    ev("mean number of maxima of the logarithm without the outlier", number_before)
    ev("mean number of maxima of the logarithm with it", number)
    ev.conclude(
        "every moving target still finds its own component, and the outlier's weight only scales "
        f"the product: the highest peak is at the true alignment in {right:.0%} of the draws and "
        f"the only visible one in {single:.1%}. The logarithm has {number:.2f} maxima "
        f"on average instead of {number_before:.2f}, and the root mean square error changes "
        f"by {ratio - 1:+.1%}, because some outliers happen to stand next to a target.",
        over=f"{OVER}; 4000 for the error",
    )


@claim("outlier-moving-summing", section="4.4", lines="763, 769", figure="outlier-moving-cost")
def outlier_moving_summing(ev: Evidence) -> None:
    """An outlier in the current set introduces more local peaks of the sum and gives one of them a
    value competitive to that of the global peak, which stays at the correct translation.
    """
    before, after = (survey_scene(SUMMING, where, MANY) for where in ("", "moving"))
    right, more = share_of(is_right(after)), share_of(after.optima > before.optima)
    rivals, rivals_before = after.rival > COMPARABLE, before.rival > COMPARABLE
    met = _meets_where_others_meet()
    with_it, with_it_if_met, elsewhere = map(share_of, (rivals, rivals[met], rivals[~met]))
    gets_more = ev.part("the sum gets more local peaks", nearly_all)
    competitive = ev.part("one of them is competitive", nearly_all)
    stays_right = ev.part("the global peak stays right", nearly_all)
    stays_right("share of draws with the highest peak at the true alignment", right)
    gets_more("share of draws with more local maxima than without the outlier", more)
    rival = "share of draws with a rival above half the highest"
    ev(f"{rival}, without it", share_of(rivals_before))
    competitive.headline(f"{rival}, with it", with_it, under=with_it_if_met)
    as_others_meet = "the same where it meets a component as two others meet"
    ev.headline(as_others_meet, with_it_if_met, nearly_all)
    ev.conclude(
        f"a rival exceeds half the highest peak in {with_it:.0%} of the draws, "
        f"{rivals_before.mean():.0%} without the outlier: in {with_it_if_met:.0%} of those in "
        f"which the outlier meets a component within a standard deviation of where two other "
        f"targets meet ({met.mean():.0%} of all), which depends on where it stands. There are more "
        f"peaks in {more:.0%}, and the highest stays at the true alignment in {right:.0%}.",
        holds="The outlier meets a component within a standard deviation of where two other "
        f"targets meet; in the other draws a rival is as high in {elsewhere:.0%}. There are more "
        f"peaks in {more:.0%} of all.",
        over=OVER.replace(str(DRAWS), str(MANY)),
    )


def _meets_where_others_meet() -> NDArray[np.bool_]:
    """Whether the outlier in M meets a component where two other targets do, in each draw."""
    fixed, moving = (points.means[..., 0] for points in scene("moving", MANY))
    meetings = fixed[:, :, np.newaxis] - moving[:, np.newaxis]  # of target i of F and k of M
    others = meetings[..., :-1][:, ~np.eye(fixed.shape[1], dtype=bool)]
    gaps = np.abs(meetings[..., -1][..., np.newaxis] - others[:, np.newaxis])
    return np.asarray(gaps.min(axis=(1, 2)) < SIGMA)


@claim("outlier-moving-likelihood", section="4.4", lines="763, 769", figure="outlier-moving-cost")
def outlier_moving_likelihood(ev: Evidence) -> None:
    """An outlier in the current set makes the surface of the likelihood zero, because its own is
    zero at the correct translation.
    """
    whole = scene("moving", MANY)
    drop = decades_lost(LIKELIHOOD, np.array([TRUTH]), *whole, 1)
    fixed, moving = (points.means[..., 0] for points in whole)
    off = np.abs(moving[:, -1:] + TRUTH - fixed).min(axis=-1)
    far = off > FAR * np.sqrt(2.0) * SIGMA
    surfaces = [
        log_surface(LIKELIHOOD, TRANSLATIONS, *scene(each, MANY)) for each in ("", "moving")
    ]
    highest = -np.subtract(*(each.max(axis=-1) for each in surfaces[::-1])) / np.log(10.0)
    vanished, vanished_if_far = share_of(drop > VANISHED), share_of(drop[far] > VANISHED)
    everywhere, everywhere_if_far = (share_of(each > VANISHED) for each in (highest, highest[far]))
    zero = share_of(LIKELIHOOD.value(np.array([TRUTH]), *whole) > 745.0)  # exp(-745) underflows
    right = share_of(is_right(survey_scene(LIKELIHOOD, "moving", MANY)))
    near = f"within {RIGHT:g} m"
    vanishes = ev.part("it vanishes at the truth", nearly_all)
    dropped = "share of draws with a drop by more than 16 decades"
    vanishes.headline(f"{dropped} at the truth", vanished, under=vanished_if_far)
    far_off = "the same where the outlier is far from every component"
    ev.headline(far_off, vanished_if_far, nearly_all)
    ev(f"{dropped} everywhere", everywhere)
    ev("the same everywhere, outlier far from every component", everywhere_if_far)
    ev("median number of decades that it costs at the truth", median_of(drop))
    ev("share of draws in which the product is exactly zero", zero)
    ev(f"share of draws with the highest log-likelihood {near} of the truth", right)
    ev.conclude(
        f"the outlier costs more than {VANISHED:.0f} decades at the truth in {vanished:.0%} of the "
        f"draws (the median is {median_of(drop):.1f}), and in {vanished_if_far:.0%} of those in "
        f"which it stands more than {FAR:g} standard deviations of a difference from every "
        "component. The highest value anywhere falls by as much in "
        f"{everywhere:.0%} and {everywhere_if_far:.0%}. In floating point the product of four "
        f"densities is exactly zero in {zero:.0%}, and its logarithm keeps its highest maximum "
        f"{near} of the truth in {right:.0%}.",
        holds=f"The outlier stands more than {FAR:g} standard deviations of a difference from "
        f"where each component comes to lie; anywhere on the line it vanishes in {vanished:.0%} of "
        "the draws.",
        over=OVER.replace(str(DRAWS), str(MANY)),
    )


@claim("uniform-restores", section="4.4", lines="802", figure="blake-zisserman")
def uniform_restores(ev: Evidence) -> None:
    """With a uniform outlier component the likelihood has one global peak at the correct
    translation, and no local peak is comparable to it.
    """
    draws = survey_scene(UNIFORM, "moving")
    right, comparable = share_of(is_right(draws)), share_of(draws.rival > COMPARABLE)
    at_truth = ev.part("the global peak is right", nearly_all)
    none_comparable = ev.part("no other is comparable", nearly_all)
    at_truth.headline("share of draws with the highest peak at the true alignment", right)
    rivals = "share of draws with all others up to"
    none_comparable.headline(f"{rivals} half the highest", complement(comparable))
    ev(f"{rivals} 1 % of the highest", share_of(draws.rival <= TINY))
    ev.conclude(
        f"as a density, with c = {UNIFORM_DENSITY:g} per metre, it is highest at the true "
        f"alignment in {right:.0%} of the draws, and a rival exceeds half of that in "
        f"{comparable:.1%}. Its logarithm has {draws.optima.mean():.1f} maxima on average, for the "
        "ten distances at which targets meet, and the median basin around the truth is "
        f"{np.median(draws.basin_width):.1f} m wide: the price of a robust cost is that it needs a "
        "good start.",
        over=OVER,
    )


@claim("uniform-not-a-density", section="4.4", lines="831", figure="blake-zisserman")
def uniform_not_a_density(ev: Evidence) -> None:
    """The uniform component violates "the gaussian assumption. Which is, the area under the curve
    does not equal to one"; the corrupted Gaussian does not.
    """
    fixed, moving = (points[0] for points in scene(""))
    alone = PointSet(moving.means[:1], moving.covariances[:1])
    areas = {}
    for length in (40.0, 400.0, 4000.0):
        t = TRUTH + 5.0 + np.arange(-0.5 * length, 0.5 * length, 0.03)
        for name, cost in (("uniform", UNIFORM), ("corrupted", ROBUST)):
            areas[name, length] = float(np.exp(log_surface(cost, t, fixed, alone)).sum() * 0.03)
    is_one = {name: abs(areas[name, 4000.0] - 1.0) <= 1e-3 for name in ("uniform", "corrupted")}
    ev.parts["with the uniform component the area is not one"] = decide(
        supported=not is_one["uniform"], opposed=is_one["uniform"]
    )
    ev.parts["with the corrupted Gaussian it is"] = decide(
        supported=is_one["corrupted"], opposed=not is_one["corrupted"]
    )
    credible = _credibility_with_outlier()
    uniform, corrupted = map(inclination_of, credible)
    what = "area of one target's surface over"
    ev(f"{what} 40 m, uniform component", areas["uniform", 40.0])
    ev(f"{what} 400 m, uniform component", areas["uniform", 400.0])
    ev(f"{what} 4000 m, uniform component", areas["uniform", 4000.0])
    ev(f"{what} 40 m, corrupted Gaussian", areas["corrupted", 40.0])
    ev(f"{what} 4000 m, corrupted Gaussian", areas["corrupted", 4000.0])
    ev("I2 of the inverse Hessian, uniform component (dB)", uniform)
    ev("I2 of the inverse Hessian, corrupted Gaussian (dB)", corrupted)
    ev.headline("difference of the two I2 (dB)", inclination_change(*credible))
    ev.conclude(
        f"its area is {areas['uniform', 40.0]:.3g} over 40 m of the axis, "
        f"{areas['uniform', 400.0]:.3g} over 400 m and {areas['uniform', 4000.0]:.3g} over 4000 m; "
        f"that of the corrupted Gaussian is {areas['corrupted', 4000.0]:.3f} over 4000 m. What the "
        "assumption is for, an inverse Hessian that is the covariance of the errors, does not tell "
        f"the two apart: with an outlier in M, I2 is {uniform:+.2f} dB with the uniform component "
        f"and {corrupted:+.2f} dB with the corrupted Gaussian. Over any bounded interval a surface "
        "divided by its area is a density with the same optimum and the same Hessian of the "
        "logarithm.",
        over="the first draw of the noise; for I2 4000 draws of it and of the outlier's place on "
        "the line, started at the truth and ending at it",
    )


def _credibility_with_outlier() -> list[Credibility]:
    """Credibility of both robust costs with an outlier in M, in the draws in which both are right.

    The uniform component comes first.
    """
    estimates = [register(*scene("moving", 4000), cost, [TRUTH]) for cost in (UNIFORM, ROBUST)]
    right = [each.converged & (np.abs(each.theta[:, 0] - TRUTH) < RIGHT) for each in estimates]
    kept = np.all(right, axis=0)
    return [credibility(each.theta[kept] - TRUTH, each.covariance[kept]) for each in estimates]


@claim("corrupted-restores", section="4.4", lines="827", figure="corrupted-gaussian")
def corrupted_restores(ev: Evidence) -> None:
    """With the corrupted Gaussian all local peaks of the likelihood are tiny compared to the global
    peak.
    """
    corrupted, uniform = survey_scene(ROBUST, "moving"), survey_scene(UNIFORM, "moving")
    right, tiny = share_of(is_right(corrupted)), share_of(corrupted.rival < TINY)
    at_truth = ev.part("the global peak is right", nearly_all)
    all_tiny = ev.part("all others are tiny", nearly_all)
    at_truth.headline("share of draws with the highest peak at the true alignment", right)
    rivals = "share of draws with all others up to"
    ev(f"{rivals} half the highest", share_of(corrupted.rival <= COMPARABLE))
    all_tiny.headline(f"{rivals} 1 % of the highest", tiny)
    ev.conclude(
        f"the highest peak is at the true alignment in {right:.0%} of the draws, and all others "
        f"are below {TINY:.0%} of it in {tiny:.0%}; a higher one is where the outlier supports a "
        f"meeting of two other targets. The logarithm has {corrupted.optima.mean():.1f} maxima on "
        f"average, with the uniform component {uniform.optima.mean():.1f}.",
        holds=f"In most draws: all other peaks are below {TINY:.0%} of the highest in {tiny:.0%}.",
        over=OVER,
    )


@claim("outlier-parameters-crucial", section="4.4", lines="827", figure="corrupted-map")
def outlier_parameters_crucial(ev: Evidence) -> None:
    """The parameters of the outlier component, its covariance and its share, are "very crucial" as
    they influence the surface.
    """
    surveys = {(a, b): survey_corrupted(a, b, MAP_DRAWS) for a in FRACTIONS for b in WIDTHS}
    wide = [pair for pair in surveys if pair[1] >= 3.0]
    narrow = [pair for pair in surveys if pair not in wide]
    right_if_wide, right_if_narrow = (
        smallest(share_of, *((is_right(surveys[pair]),) for pair in pairs))
        for pairs in (wide, narrow)
    )
    usual = is_right(survey_corrupted(*USUAL, MAP_DRAWS))
    loss_if_wide, loss_if_narrow = (
        largest(share_difference, *((usual, is_right(surveys[pair])) for pair in pairs))
        for pairs in (wide, narrow)
    )
    rival_if_moderate, rival_if_extreme = (
        largest(share_of, *((surveys[pair].rival > COMPARABLE,) for pair in pairs))
        for pairs in (
            [pair for pair in wide if pair[0] <= 0.5],
            [pair for pair in wide if pair[0] > 0.5],
        )
    )
    fraction, width = USUAL
    decide_it = ev.part("they decide where the optimum is", SHARE.larger)
    ev("minimum share of right optima, widths of 3 m to 100 m", right_if_wide)
    ev("minimum share of right optima, widths of 1 m or less", right_if_narrow)
    loss = "largest loss of right optima against"
    decide_it.headline(f"{loss} the thesis's parameters, 3 m to 100 m", loss_if_wide)
    decide_it.headline(f"{loss} them, widths of 1 m or less", loss_if_narrow)
    rival = "maximum share with a rival above half the highest, widths of 3 m to 100 m"
    ev(f"{rival}, fractions up to 0.5", rival_if_moderate)
    ev(f"{rival}, fraction 0.9", rival_if_extreme)
    ev.conclude(
        f"over fractions from {FRACTIONS[0]:.1%} to {FRACTIONS[-1]:.0%}, the minimum share of "
        f"draws with the right optimum is {right_if_narrow:.0%} for components of 1 m or less and "
        f"{right_if_wide:.0%} for those 3 m to 100 m wide. The heights of the local peaks depend "
        "on the fraction: with the wide components a rival exceeds half the highest peak in up to "
        f"{rival_if_moderate:.1%} of the draws for fractions up to 0.5, and in up to "
        f"{rival_if_extreme:.1%} for 0.9.",
        holds="For components of about a metre or less, with which the share of draws with the "
        f"right optimum goes down to {right_if_narrow:.0%}; for those 3 m to 100 m wide its "
        f"minimum is {right_if_wide:.0%}.",
        over=f"{MAP_DRAWS} draws of the noise and of the outlier's place for each of "
        f"{len(surveys)} pairs of a fraction and a width; the thesis's are {fraction:g} and "
        f"{width:g} m",
    )
