"""Claims of thesis section 4.4: an outlier on the line."""

import numpy as np

from d2d.cost import RegistrationCost
from d2d.credibility import Credibility, credibility
from d2d.point_set import PointSet
from d2d.registration import register
from d2d.study.book.claim import (
    DECIBELS,
    RATIO,
    SHARE,
    Evidence,
    claim,
    hardly_any,
    judge,
    larger,
    most,
    nearly_all,
    same,
    smaller,
    some,
)
from d2d.study.book.measured import (
    inclination_change,
    inclination_of,
    mean_of,
    median_of,
    rms_ratio,
    share_difference,
    share_of,
    telling,
)
from d2d.study.line.claims.surfaces import is_right
from d2d.study.line.outlier_study import (
    COMPARABLE,
    DRAWS,
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
    WIDTHS,
    scene,
    survey_corrupted,
    survey_scene,
)
from d2d.study.line.scene import SIGMA, TRUTH
from d2d.study.line.surfaces import Survey, log_surface, peaks

OVER = f"{DRAWS} draws of the noise and of the outlier's place on the line"
SEPARATE = 2.0 * np.sqrt(2.0)  # standard deviations between two equal bumps with two maxima
VANISHED = 16.0  # decades: what double precision cannot add to the value without the outlier


@claim("outlier-fixed-summing", section="4.4", figure="outlier-fixed-cost")
def outlier_fixed_summing() -> Evidence:
    """An outlier in F adds a possibility to every target and local peaks to the sum."""
    before, after = survey_scene(SUMMING), survey_scene(SUMMING, "fixed")
    fixed, moving = scene("fixed")
    b_alone = PointSet(moving.means[:, :1], moving.covariances[:, :1])
    surfaces_of_b = log_surface(LIKELIHOOD, TRANSLATIONS, fixed, b_alone)
    four = share_of(peaks(TRANSLATIONS, surfaces_of_b).number == 4)
    gains = after.optima > before.optima
    targets, outlier = fixed.means[:, :-1, 0], fixed.means[:, -1:, 0]
    apart = np.abs(outlier - targets).min(axis=-1) > SEPARATE * SIGMA
    more, more_if_apart = share_of(gains), share_of(gains[apart])
    number, number_before = mean_of(after.optima), mean_of(before.optima)
    return Evidence(
        judge(confirmed=nearly_all(four) and nearly_all(more), qualified=most(more)),
        "the outlier adds three pairs and up to three bumps: target B's surface has four peaks in "
        f"{four:.0%} of the draws, and the sum has more maxima than without the outlier in "
        f"{more:.0%}, on average {number:.2f} instead of {number_before:.2f}. Where it stands more "
        f"than {SEPARATE:.1f} standard deviations from all targets, the distance at which two "
        f"equal bumps separate, it has in {more_if_apart:.0%}; nearer, a target's peak can take it "
        "in.",
        {
            "share of draws in which target B's surface has four peaks": four,
            "share of draws with more local maxima of the sum than without the outlier": more,
            "share of draws with more local maxima, outlier apart from all targets": more_if_apart,
            "mean number of maxima without the outlier": telling(number_before),
            "mean number of maxima with it": telling(number),
            "share of draws with a rival above half the highest, without the outlier": share_of(
                before.rival > COMPARABLE
            ),
            "share of draws with a rival above half the highest, with it": share_of(
                after.rival > COMPARABLE
            ),
        },
        holds=f"The outlier stands more than {SEPARATE:.1f} standard deviations from every target, "
        f"where it adds a maximum in {more_if_apart:.0%} of the draws; it adds none in "
        f"{1 - more:.0%} of all.",
        over=OVER,
    )


@claim("outlier-fixed-likelihood", section="4.4", figure="outlier-fixed-cost")
def outlier_fixed_likelihood() -> Evidence:
    """The likelihood is robust against an outlier in F."""
    before, after = survey_scene(LIKELIHOOD), survey_scene(LIKELIHOOD, "fixed")
    right, single = share_of(is_right(after)), share_of(after.rival < TINY)
    # the RMSEs of the estimates that start at the truth, same draws
    estimates = [register(*scene(where, 4000), LIKELIHOOD, [TRUTH]) for where in ("fixed", "")]
    both = estimates[0].converged & estimates[1].converged
    with_it, without = (estimate.theta[both] - TRUTH for estimate in estimates)
    ratio = rms_ratio(with_it, without)
    number, number_before = mean_of(after.optima), mean_of(before.optima)
    return Evidence(
        judge(
            confirmed=nearly_all(right) and nearly_all(single) and same(ratio, RATIO),
            qualified=nearly_all(right),
        ),
        "every moving target still finds its own component, and the outlier's weight only scales "
        f"the product: the highest peak is at the true alignment in {right:.0%} of the draws and "
        f"the only visible one in {single:.1%}. The logarithm has {number:.2f} maxima "
        f"on average instead of {number_before:.2f}, and the root mean square error changes "
        f"by {ratio - 1:+.1%}, because some outliers happen to stand next to a target.",
        {
            "share of draws with the highest peak at the true alignment": telling(right),
            "share of draws with one visible peak (no rival above 1 %)": single,
            "root mean square error with the outlier over that without": telling(ratio),
            "mean number of maxima of the logarithm without the outlier": number_before,
            "mean number of maxima of the logarithm with it": number,
        },
        holds=f"For the place of the highest peak, right in {right:.0%} of the draws; a rival is "
        f"visible in {1 - single:.1%}, and the error changes by {ratio - 1:+.1%}.",
        over=f"{OVER}; 4000 for the error",
    )


@claim("outlier-moving-summing", section="4.4", figure="outlier-moving-cost")
def outlier_moving_summing() -> Evidence:
    """An outlier in M gives the sum a competitive local peak, but the global one stays right."""
    before, after = survey_scene(SUMMING), survey_scene(SUMMING, "moving")
    right = share_of(is_right(after))
    with_it, without = share_of(after.rival > COMPARABLE), share_of(before.rival > COMPARABLE)
    added = share_difference(after.rival > COMPARABLE, before.rival > COMPARABLE)
    return Evidence(
        judge(
            confirmed=nearly_all(right) and nearly_all(with_it),
            qualified=nearly_all(right) and larger(added, SHARE),
        ),
        f"a rival exceeds half the highest peak in {with_it:.0%} of the draws, {without:.0%} "
        "without the outlier: it does where the outlier meets a component just when another pair "
        "of targets meets, which depends on where the outlier stands. The highest peak stays at "
        f"the true alignment in {right:.0%} of the draws; in the others a rival wins.",
        {
            "share of draws with the highest peak at the true alignment": telling(right),
            "share of draws with a rival above half the highest, without the outlier": without,
            "share of draws with a rival above half the highest, with the outlier": telling(
                with_it
            ),
            "difference of these shares": added,
            "median height of the rival with it": median_of(after.rival),
            "mean number of maxima with it": mean_of(after.optima),
            "median width of the basin around the true alignment (m)": median_of(after.basin_width),
        },
        holds="The outlier meets a component where another pair of targets meets; the global peak "
        f"stays right in {right:.0%} of all draws.",
        over=OVER,
    )


@claim("outlier-moving-likelihood", section="4.4", figure="outlier-moving-cost")
def outlier_moving_likelihood() -> Evidence:
    """An outlier in M makes the likelihood zero at the true alignment."""
    before, after = (
        -LIKELIHOOD.value(np.array([TRUTH]), *scene(where)) for where in ("", "moving")
    )
    drop = (before - after) / np.log(10.0)
    decades = median_of(drop)
    invisible, vanished = share_of(drop > 6.0), share_of(drop > VANISHED)
    zero = share_of(np.exp(after) == 0.0)
    found = survey_scene(LIKELIHOOD, "moving")
    right, limit = share_of(is_right(found)), 3.0 * SIGMA
    near = f"within {RIGHT:g} m"
    return Evidence(
        judge(confirmed=nearly_all(vanished), qualified=some(invisible)),
        "the outlier costs more than six decades, too many for the rest to be visible on a plot, "
        f"in {invisible:.0%} of the draws and more than {VANISHED:.0f} in {vanished:.0%} (the "
        f"median is {decades:.1f}), unless it "
        "stands near where a component comes to lie. In floating point the product of four "
        f"densities is exactly zero in {zero:.0%}, and its logarithm keeps its highest maximum "
        f"{near} of the truth in {right:.0%}.",
        {
            "share of draws in which the outlier costs more than six decades": telling(invisible),
            f"share of draws in which it costs more than {VANISHED:.0f}": telling(vanished),
            "median number of decades that it costs": decades,
            "share of draws in which the product is exactly zero": zero,
            f"share of draws with the highest log-likelihood {near} of the truth": right,
            f"share of draws in which an ascent from the truth stays within {limit:g} m": share_of(
                np.abs(found.ascent - TRUTH) < limit
            ),
        },
        holds="For the eye, on a plot of the density, where the outlier costs more than six "
        f"decades ({invisible:.0%} of the draws); it costs more than {VANISHED:.0f} in "
        f"{vanished:.0%}, and the number is exactly zero in {zero:.0%}.",
        over=OVER,
    )


def _numbers_with_outlier_in_m(found: Survey, limit: float) -> dict[str, float]:
    """The numbers of a survey of a robust cost; the rivals above a limit are telling."""
    comparable, tiny = (share_of(found.rival > each) for each in (COMPARABLE, TINY))
    return {
        "share of draws with the highest peak at the true alignment": telling(
            share_of(is_right(found))
        ),
        "share of draws with a rival above half the highest": telling(
            comparable, limit == COMPARABLE
        ),
        "share of draws with a rival above 1 % of the highest": telling(tiny, limit == TINY),
        "median height of the rival": median_of(found.rival),
        "mean number of maxima of the logarithm": mean_of(found.optima),
        "median width of the basin around the true alignment (m)": median_of(found.basin_width),
    }


@claim("uniform-restores", section="4.4", figure="blake-zisserman")
def uniform_restores() -> Evidence:
    """A uniform outlier component restores the likelihood's one global peak, without a comparable
    local one.
    """
    found = survey_scene(UNIFORM, "moving")
    right, comparable = share_of(is_right(found)), share_of(found.rival > COMPARABLE)
    return Evidence(
        judge(confirmed=nearly_all(right) and hardly_any(comparable), qualified=most(right)),
        f"as a density, with c = {UNIFORM_DENSITY:g} per metre, it is highest at the true "
        f"alignment in {right:.0%} of the draws, and a rival exceeds half of that in "
        f"{comparable:.1%}. Its logarithm has {found.optima.mean():.1f} maxima on average, for the "
        "ten distances at which targets meet, and the median basin around the truth is "
        f"{np.median(found.basin_width):.1f} m wide: the price of a robust cost is that it needs a "
        "good start.",
        _numbers_with_outlier_in_m(found, COMPARABLE),
        holds=f"For the place of the highest peak, right in {right:.0%} of the draws; a rival "
        f"exceeds half of it in {comparable:.1%}.",
        over=OVER,
    )


@claim("uniform-not-a-density", section="4.4", figure="blake-zisserman")
def uniform_not_a_density() -> Evidence:
    """The uniform component breaks the Gaussian assumption, the area is not one; the corrupted
    Gaussian does not.
    """
    fixed, moving = (points[0] for points in scene(""))
    alone = PointSet(moving.means[:1], moving.covariances[:1])
    areas = {}
    for length in (40.0, 400.0, 4000.0):
        t = TRUTH + 5.0 + np.arange(-0.5 * length, 0.5 * length, 0.03)
        for name, cost in (("uniform", UNIFORM), ("corrupted", ROBUST)):
            areas[name, length] = float(np.exp(log_surface(cost, t, fixed, alone)).sum() * 0.03)
    added = UNIFORM_DENSITY * (4000.0 - 400.0)
    diverges = abs(areas["uniform", 4000.0] - areas["uniform", 400.0] - added) < 0.1
    finite = abs(areas["corrupted", 4000.0] - 1.0) < 1e-3
    credible = _credibility_with_outlier(UNIFORM), _credibility_with_outlier(ROBUST)
    uniform, corrupted = map(inclination_of, credible)
    change = inclination_change(*credible)
    matters = larger(change, DECIBELS) or smaller(change, DECIBELS)
    what = "area of one target's surface over"
    return Evidence(
        judge(
            confirmed=diverges and finite and matters,
            qualified=diverges and finite,
        ),
        f"its area is {areas['uniform', 40.0]:.3g} over 40 m of the axis, "
        f"{areas['uniform', 400.0]:.3g} over 400 m and {areas['uniform', 4000.0]:.3g} over 4000 m; "
        f"that of the corrupted Gaussian is {areas['corrupted', 4000.0]:.3f} over 4000 m. What the "
        "assumption is for, an inverse Hessian that is the covariance of the errors, does not tell "
        f"the two apart: with an outlier in M, I2 is {uniform:+.2f} dB with the uniform component "
        f"and {corrupted:+.2f} dB with the corrupted Gaussian. Over any bounded interval a surface "
        "divided by its area is a density with the same optimum and the same Hessian of the "
        "logarithm.",
        {
            f"{what} 40 m, uniform component": areas["uniform", 40.0],
            f"{what} 400 m, uniform component": areas["uniform", 400.0],
            f"{what} 4000 m, uniform component": areas["uniform", 4000.0],
            f"{what} 40 m, corrupted Gaussian": areas["corrupted", 40.0],
            f"{what} 4000 m, corrupted Gaussian": areas["corrupted", 4000.0],
            "I2 of the inverse Hessian, uniform component (dB)": telling(uniform),
            "I2 of the inverse Hessian, corrupted Gaussian (dB)": corrupted,
            "difference of the two I2 (dB)": telling(change),
        },
        holds="For the area over an unbounded axis. For the covariance of the estimate it makes "
        f"{'no' if same(change, DECIBELS) else 'an uncertain'} difference: I2 is "
        f"{uniform:+.2f} dB, and that with the corrupted Gaussian is {corrupted:+.2f} dB.",
        over="4000 draws of the noise and of the outlier's place on the line, started at the "
        "truth and ending at it",
    )


def _credibility_with_outlier(cost: RegistrationCost) -> Credibility:
    """Credibility with an outlier in M, in the draws in which both robust costs end at the truth.

    Both costs are judged over the same draws.
    """
    found = {each: register(*scene("moving", 4000), each, [TRUTH]) for each in (UNIFORM, ROBUST)}
    errors = {each: estimate.theta - TRUTH for each, estimate in found.items()}
    kept = np.all(
        [
            estimate.converged & (np.abs(errors[each][:, 0]) < RIGHT)
            for each, estimate in found.items()
        ],
        axis=0,
    )
    return credibility(errors[cost][kept], found[cost].covariance[kept])


@claim("corrupted-restores", section="4.4", figure="corrupted-gaussian")
def corrupted_restores() -> Evidence:
    """The corrupted Gaussian restores one global peak, and all local peaks are tiny."""
    found, uniform = survey_scene(ROBUST, "moving"), survey_scene(UNIFORM, "moving")
    right, tiny = share_of(is_right(found)), share_of(found.rival < TINY)
    return Evidence(
        judge(confirmed=nearly_all(right) and nearly_all(tiny), qualified=nearly_all(right)),
        f"the highest peak is at the true alignment in {right:.0%} of the draws, and all others "
        f"are below {TINY:.0%} of it in {tiny:.0%}; a higher one is where the outlier supports a "
        f"meeting of two other targets. The logarithm has {found.optima.mean():.1f} maxima on "
        f"average, with the uniform component {uniform.optima.mean():.1f}.",
        _numbers_with_outlier_in_m(found, TINY),
        holds="The outlier does not support a meeting of two other targets; all other peaks are "
        f"below {TINY:.0%} of the highest in {tiny:.0%} of the draws.",
        over=OVER,
    )


@claim("outlier-parameters-crucial", section="4.4", figure="corrupted-map")
def outlier_parameters_crucial() -> Evidence:
    """The parameters of the outlier component are crucial to the surface."""
    surveys = {(a, b): survey_corrupted(a, b, MAP_DRAWS) for a in FRACTIONS for b in WIDTHS}
    right = {pair: share_of(is_right(found)) for pair, found in surveys.items()}
    rival = {pair: share_of(found.rival > COMPARABLE) for pair, found in surveys.items()}
    basin = {pair: median_of(found.basin_width) for pair, found in surveys.items()}
    wide = [(fraction, width) for fraction, width in surveys if width >= 3.0]
    right_if_wide = min(right[pair] for pair in wide)
    right_if_narrow = min(right[pair] for pair in surveys if pair not in wide)
    highest = max(right.values())
    rival_if_moderate = max(rival[pair] for pair in wide if pair[0] <= 0.5)
    rival_if_extreme = max(rival[pair] for pair in wide if pair[0] > 0.5)
    moves_if_wide, moves_at_all = (
        lowest.high < highest.low - SHARE.high for lowest in (right_if_wide, right_if_narrow)
    )
    return Evidence(
        judge(confirmed=moves_if_wide and moves_at_all, qualified=moves_at_all),
        f"over fractions from {FRACTIONS[0]:.1%} to {FRACTIONS[-1]:.0%}, the minimum share of "
        f"draws with the right optimum is {right_if_narrow:.0%} for components of 1 m or less and "
        f"{right_if_wide:.0%} for those 3 m to 100 m wide. The heights of the local peaks depend "
        "on the fraction: with the wide components a rival exceeds half the highest peak in up to "
        f"{rival_if_moderate:.1%} of the draws for fractions up to 0.5, and in up to "
        f"{rival_if_extreme:.1%} for 0.9.",
        {
            "minimum share of right optima, widths of 3 m to 100 m": telling(right_if_wide),
            "minimum share of right optima, widths of 1 m or less": telling(right_if_narrow),
            "maximum share with a rival above half the highest, widths of 3 m to 100 m, "
            "fractions up to 0.5": rival_if_moderate,
            "maximum share with a rival above half the highest, widths of 3 m to 100 m, "
            "fraction 0.9": rival_if_extreme,
            "minimum of the median basin (m)": min(basin.values()),
            "median basin at width 1 m and fraction 0.5 (m)": basin[0.5, 1.0],
        },
        holds="For components of about a metre or less, with which the share of draws with the "
        f"right optimum goes down to {right_if_narrow:.0%}; for those 3 m to 100 m wide its "
        f"minimum is {right_if_wide:.0%}.",
        over=f"{MAP_DRAWS} draws of the noise and of the outlier's place for each of "
        f"{len(surveys)} pairs of a fraction and a width",
    )
