"""Claims of thesis section 4.4: an outlier on the line."""

from itertools import product

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
OVER_MANY = OVER.replace(str(DRAWS), str(MANY))
USUAL = 0.2, 10.0  # the fraction and the width (m) of thesis ch. 6
RIGHT_DRAWS = "share of draws with the highest peak at the true alignment"
UP_TO = "share of draws with all others up to"


@claim("outlier-fixed-summing", section="4.4", lines="729, 736", figure="outlier-fixed-cost")
def outlier_fixed_summing(ev: Evidence) -> None:
    """An outlier in the previous set introduces a fourth possibility for each target, and more
    local peaks of the sum.
    """
    before, after = survey_scene(SUMMING), survey_scene(SUMMING, "fixed")
    fixed, moving = scene("fixed")
    b_alone = PointSet(moving.means[:, :1], moving.covariances[:, :1])
    of_b = peaks(TRANSLATIONS, log_surface(LIKELIHOOD, TRANSLATIONS, fixed, b_alone))
    targets, outlier = fixed.means[:, :-1, 0], fixed.means[:, -1:, 0]
    apart = np.abs(outlier - targets).min(axis=-1) > SEPARATE * SIGMA
    four, more = of_b.number == 4, after.optima > before.optima
    possibility = ev.part("each target gets a fourth possibility", nearly_all)
    gets_more = ev.part("the sum gets more local peaks", nearly_all)
    of_four = "share of draws in which target B's surface has four peaks"
    possibility(of_four, share_of(four), under=share_of(four[apart]))
    maxima, if_apart = "share of draws with more local maxima", share_of(more[apart])
    gets_more.headline(
        f"{maxima} of the sum than without the outlier", share_of(more), under=if_apart
    )
    ev.headline(f"{maxima}, outlier apart from all targets", if_apart, nearly_all)
    ev("mean number of maxima without the outlier", mean_of(before.optima))
    ev("mean number of maxima with it", mean_of(after.optima))
    ev.conclude(
        "the outlier adds three pairs and up to three bumps. Nearer to a target than "
        f"{SEPARATE:.1f} standard deviations, the distance at which two equal bumps separate, the "
        "target's peak can take them in.",
        holds=f"The outlier stands more than {SEPARATE:.1f} standard deviations from every target.",
        over=OVER,
    )


@claim("outlier-fixed-likelihood", section="4.4", lines="729, 744", figure="outlier-fixed-cost")
def outlier_fixed_likelihood(ev: Evidence) -> None:
    """The likelihood is robust against an outlier in the previous set: its surface has only one
    global peak, at the correct translation.
    """
    before, after = survey_scene(LIKELIHOOD), survey_scene(LIKELIHOOD, "fixed")
    estimates = [register(*scene(where, 4000), LIKELIHOOD, [TRUTH]) for where in ("fixed", "")]
    both = estimates[0].converged & estimates[1].converged
    with_it, without = (estimate.theta[both] - TRUTH for estimate in estimates)
    ratio = rms_ratio(with_it, without)
    at_truth = ev.part("the global peak is right", nearly_all)
    only_one = ev.part("it is the only one", nearly_all)
    as_good = ev.part("the estimate is as good", RATIO.same)
    at_truth(RIGHT_DRAWS, share_of(is_right(after)))
    single = share_of(after.rival < TINY)
    only_one.headline("share of draws with one visible peak (no rival above 1 %)", single)
    as_good.headline("root mean square error with the outlier over that without", ratio)
    ev("mean number of maxima of the logarithm without the outlier", mean_of(before.optima))
    ev("mean number of maxima of the logarithm with it", mean_of(after.optima))
    ev.conclude(
        "every moving target still finds its own component, and the outlier's weight only scales "
        f"the product. The root mean square error changes by {ratio - 1:+.1%}, because some "
        "outliers happen to stand next to a target.",
        over=f"{OVER}; 4000 for the error",
    )


@claim("outlier-moving-summing", section="4.4", lines="763, 769", figure="outlier-moving-cost")
def outlier_moving_summing(ev: Evidence) -> None:
    """An outlier in the current set introduces more local peaks of the sum and gives one of them a
    value competitive to that of the global peak, which stays at the correct translation.
    """
    before, after = (survey_scene(SUMMING, where, MANY) for where in ("", "moving"))
    rivals, met = after.rival > COMPARABLE, _meets_where_others_meet()
    if_met = share_of(rivals[met])
    gets_more = ev.part("the sum gets more local peaks", nearly_all)
    competitive = ev.part("one of them is competitive", nearly_all)
    stays_right = ev.part("the global peak stays right", nearly_all)
    stays_right(RIGHT_DRAWS, share_of(is_right(after)))
    more = share_of(after.optima > before.optima)
    gets_more("share of draws with more local maxima than without the outlier", more)
    rival = "share of draws with a rival above half the highest"
    ev(f"{rival}, without it", share_of(before.rival > COMPARABLE))
    competitive.headline(f"{rival}, with it", share_of(rivals), under=if_met)
    ev.headline("the same where it meets a component as two others meet", if_met, nearly_all)
    ev.conclude(
        "a rival grows where the outlier meets a component within a standard deviation of where "
        f"two other targets meet, in {met.mean():.0%} of the draws.",
        holds="The outlier meets a component within a standard deviation of where two other "
        f"targets meet; in the other draws a rival is as high in {rivals[~met].mean():.0%}. There "
        f"are more peaks in {more:.0%} of all.",
        over=OVER_MANY,
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
    whole, at_truth = scene("moving", MANY), np.array([TRUTH])
    drop = decades_lost(LIKELIHOOD, at_truth, *whole, 1)
    fixed, moving = (points.means[..., 0] for points in whole)
    far = np.abs(moving[:, -1:] + TRUTH - fixed).min(axis=-1) > FAR * np.sqrt(2.0) * SIGMA
    before, after = (
        log_surface(LIKELIHOOD, TRANSLATIONS, *scene(where, MANY)).max(axis=-1) / np.log(10.0)
        for where in ("", "moving")
    )
    everywhere, if_far = before - after > VANISHED, share_of(drop[far] > VANISHED)
    vanishes = ev.part("it vanishes at the truth", nearly_all)
    dropped = "share of draws with a drop by more than 16 decades"
    vanishes.headline(f"{dropped} at the truth", share_of(drop > VANISHED), under=if_far)
    ev.headline("the same where the outlier is far from every component", if_far, nearly_all)
    ev(f"{dropped} everywhere", share_of(everywhere))
    ev("the same everywhere, outlier far from every component", share_of(everywhere[far]))
    ev("median number of decades that it costs at the truth", median_of(drop))
    underflows = LIKELIHOOD.value(at_truth, *whole) > 745.0  # exp(-745) does
    ev("share of draws in which the product is exactly zero", share_of(underflows))
    near = share_of(is_right(survey_scene(LIKELIHOOD, "moving", MANY)))
    ev(f"share of draws with the highest log-likelihood within {RIGHT:g} m of the truth", near)
    ev.conclude(
        f"an outlier that stands more than {FAR:g} standard deviations of a difference from every "
        f"component costs the density {VANISHED:.0f} decades at the truth and most often "
        f"everywhere. The logarithm keeps its highest maximum at the truth in {near:.0%} of all "
        "draws.",
        holds=f"The outlier stands more than {FAR:g} standard deviations of a difference from "
        "where each component comes to lie.",
        over=OVER_MANY,
    )


@claim("uniform-restores", section="4.4", lines="802", figure="blake-zisserman")
def uniform_restores(ev: Evidence) -> None:
    """With a uniform outlier component the likelihood has one global peak at the correct
    translation, and no local peak is comparable to it.
    """
    draws = survey_scene(UNIFORM, "moving")
    at_truth = ev.part("the global peak is right", nearly_all)
    none_comparable = ev.part("no other is comparable", nearly_all)
    at_truth.headline(RIGHT_DRAWS, share_of(is_right(draws)))
    comparable = share_of(draws.rival > COMPARABLE)
    none_comparable.headline(f"{UP_TO} half the highest", complement(comparable))
    ev(f"{UP_TO} 1 % of the highest", share_of(draws.rival <= TINY))
    ev.conclude(
        f"the logarithm, with c = {UNIFORM_DENSITY:g} per metre, has {draws.optima.mean():.1f} "
        "maxima on average, for the ten distances at which targets meet, and the median basin "
        f"around the truth is {np.median(draws.basin_width):.1f} m wide: the price of a robust "
        "cost is that it needs a good start.",
        over=OVER,
    )


@claim("uniform-not-a-density", section="4.4", lines="831", figure="blake-zisserman")
def uniform_not_a_density(ev: Evidence) -> None:
    """The uniform component violates "the gaussian assumption. Which is, the area under the curve
    does not equal to one"; the corrupted Gaussian does not.
    """
    kinds = {"uniform component": UNIFORM, "corrupted Gaussian": ROBUST}
    fixed, moving = (points[0] for points in scene(""))
    alone = PointSet(moving.means[:1], moving.covariances[:1])
    parts = "with the uniform component the area is not one", "with the corrupted Gaussian it is"
    for (name, cost), part in zip(kinds.items(), parts, strict=True):
        for length in (40.0, 400.0, 4000.0):
            t = TRUTH + 5.0 + np.arange(-0.5 * length, 0.5 * length, 0.03)
            area = float(np.exp(log_surface(cost, t, fixed, alone)).sum() * 0.03)
            if name == "uniform component" or length != 400.0:
                ev(f"area of one target's surface over {length:g} m, {name}", area)
        is_so = (abs(area - 1.0) <= 1e-3) == part.endswith("it is")
        ev.parts[part] = decide(supported=is_so, opposed=not is_so)
    credible = _credibility_with_outlier()
    for name, indices in zip(kinds, credible, strict=True):
        ev(f"I² of the inverse Hessian, {name} (dB)", inclination_of(indices))
    ev.headline("difference of the two I² (dB)", inclination_change(*credible))
    ev.conclude(
        "what the assumption is for, an inverse Hessian that is the covariance of the errors, does "
        "not tell the two apart. Over any bounded interval a surface divided by its area is a "
        "density with the same optimum and the same Hessian of the logarithm.",
        over="the first draw of the noise; for I² 4000 draws of it and of the outlier's place on "
        "the line, started at the truth and ending at it",
    )


def _credibility_with_outlier() -> list[Credibility]:
    """Credibility of both robust costs, uniform first, in the draws in which both are right."""
    estimates = [register(*scene("moving", 4000), cost, [TRUTH]) for cost in (UNIFORM, ROBUST)]
    right = [each.converged & (np.abs(each.theta[:, 0] - TRUTH) < RIGHT) for each in estimates]
    kept = np.all(right, axis=0)
    return [credibility(each.theta[kept] - TRUTH, each.covariance[kept]) for each in estimates]


@claim("corrupted-restores", section="4.4", lines="827", figure="corrupted-gaussian")
def corrupted_restores(ev: Evidence) -> None:
    """With the corrupted Gaussian all local peaks of the likelihood are tiny compared to the global
    peak.
    """
    draws = survey_scene(ROBUST, "moving")
    at_truth = ev.part("the global peak is right", nearly_all)
    all_tiny = ev.part("all others are tiny", nearly_all)
    at_truth.headline(RIGHT_DRAWS, share_of(is_right(draws)))
    ev(f"{UP_TO} half the highest", share_of(draws.rival <= COMPARABLE))
    tiny = all_tiny.headline(f"{UP_TO} 1 % of the highest", share_of(draws.rival < TINY))
    ev.conclude(
        f"a peak above {TINY:.0%} of the highest is where the outlier supports a meeting of two "
        f"other targets. The logarithm has {draws.optima.mean():.1f} maxima on average.",
        holds=f"In most draws: all other peaks are below {TINY:.0%} of the highest in {tiny:.0%}.",
        over=OVER,
    )


@claim("outlier-parameters-crucial", section="4.4", lines="827", figure="corrupted-map")
def outlier_parameters_crucial(ev: Evidence) -> None:
    """The parameters of the outlier component, its covariance and its share, are "very crucial" as
    they influence the surface.
    """
    surveys = {(a, b): survey_corrupted(a, b, MAP_DRAWS) for a in FRACTIONS for b in WIDTHS}
    usual = is_right(survey_corrupted(*USUAL, MAP_DRAWS))
    decide_it = ev.part("they decide where the optimum is", SHARE.larger)
    for widths, name, against in (
        (WIDTHS[2:], "3 m to 100 m", "the thesis's parameters, 3 m to 100 m"),
        (WIDTHS[:2], "1 m or less", "them, widths of 1 m or less"),
    ):
        right = [is_right(surveys[pair]) for pair in product(FRACTIONS, widths)]
        fewest = smallest(share_of, *((each,) for each in right))
        ev(f"minimum share of right optima, widths of {name}", fewest)
        lost = largest(share_difference, *((usual, each) for each in right))
        decide_it.headline(f"largest loss of right optima against {against}", lost)
    rival = "maximum share with a rival above half the highest, widths of 3 m to 100 m"
    for fractions, name in ((FRACTIONS[:-1], "fractions up to 0.5"), ([0.9], "fraction 0.9")):
        high = [surveys[pair].rival > COMPARABLE for pair in product(fractions, WIDTHS[2:])]
        ev(f"{rival}, {name}", largest(share_of, *((each,) for each in high)))
    ev.conclude(
        "components 3 m to 100 m wide keep the right optimum at all fractions, which only change "
        "the heights of the local peaks; with narrow ones an outlier's own peak can win.",
        holds="For components of about a metre or less, with which the share of draws with the "
        f"right optimum goes down to {fewest:.0%}.",
        over=f"{MAP_DRAWS} draws of the noise and of the outlier's place for each of "
        f"{len(surveys)} pairs of a fraction and a width; the thesis's are {USUAL[0]:g} and "
        f"{USUAL[1]:g} m",
    )
