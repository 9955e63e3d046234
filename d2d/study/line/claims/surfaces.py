"""Claims of thesis sections 4.2 and 4.3: metrics and fusions on the one-dimensional scene."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.point_set import PointSet
from d2d.study.book.claim import MEAN, RATIO, Evidence, claim, decide, in_every, nearly_all
from d2d.study.book.measured import complement, mean_of, median_of, share_of
from d2d.study.line.outlier_study import RIGHT
from d2d.study.line.scene import SIGMA, TRUTH, line_scene
from d2d.study.line.surfaces import Survey, log_surface, peaks, survey

DRAWS = 1000
OVER = f"{DRAWS} draws of the noise of the thesis's scene on a line"
TRANSLATIONS = np.arange(-12.0, 16.0, 0.02)  # m
VISIBLE = 0.01  # a peak below 1 % of the highest cannot be seen in a plot of the density
NOISE_RATIO = 4.0  # the thesis's noisier set: its standard deviation over the other's
OUTSTANDING = 0.8  # no other peak reaches 80 % of a peak that stands out

P2D, D2D = RegistrationCost("p2d", "summing"), RegistrationCost("d2d", "summing")
LIKELIHOOD = RegistrationCost("d2d", "likelihood")


def _surfaces(
    cost: RegistrationCost, sigma_moving: float = SIGMA, *, of_b_alone: bool = False
) -> Array:
    """Logarithm (draws, T) of the surface of all targets, or of B alone, in the seeded draws."""
    return surfaces_of_scene(line_scene, DRAWS, cost, sigma_moving, of_b_alone)


@lru_cache(maxsize=8)  # all that the claims ask for; 11 MB each
def surfaces_of_scene(
    scene: Callable[..., tuple[PointSet, PointSet]],
    draws: int,
    cost: RegistrationCost,
    sigma_moving: float,
    of_b_alone: bool,
) -> Array:
    """Each surface is computed once for every scene, number of draws and cost."""
    fixed, moving = scene(np.random.default_rng(42), sigma_moving=sigma_moving, draws=(draws,))
    if of_b_alone:
        moving = PointSet(moving.means[:, :1], moving.covariances[:, :1])
    return np.ascontiguousarray(log_surface(cost, TRANSLATIONS, fixed, moving))


def _survey(cost: RegistrationCost, sigma_moving: float = SIGMA) -> Survey:
    return survey(TRANSLATIONS, _surfaces(cost, sigma_moving), TRUTH)


def is_right(survey_of_draws: Survey) -> NDArray[np.bool_]:
    """Whether the highest peak of each draw is that of the true alignment."""
    return survey_of_draws.right(TRUTH, RIGHT)


@claim("b-three-peaks", section="4.2", lines="599", figure="target-b")
def b_three_peaks(ev: Evidence) -> None:
    """The cost surface of target B includes three possibilities: it peaks where B matches B, A and
    C of the previous scan, at t_x = 2, 10 and 12.2 m.
    """
    of_b = peaks(TRANSLATIONS, _surfaces(P2D, of_b_alone=True))
    fixed, moving = line_scene(np.random.default_rng(42), draws=(DRAWS,))
    matches = np.sort(fixed.means[..., 0] - moving.means[:, :1, 0], axis=-1)
    has_three = of_b.number == matches.shape[1]
    off = np.full(DRAWS, np.inf)
    peaks_of_b = np.sort(of_b.positions[has_three, : matches.shape[1]], axis=-1)
    off[has_three] = np.abs(peaks_of_b - matches[has_three]).max(axis=-1)
    share, in_place = share_of(of_b.number == 3), share_of(off < MEAN.high * SIGMA)
    three = ev.part("it has three peaks", nearly_all)
    where = ev.part("they are where B matches", nearly_all)
    three.headline("share of draws with exactly three peaks", share)
    where.headline("share of draws with each of them where B meets a target", in_place)
    mean = [
        ev(f"mean distance from B to target {number + 1} of F (m)", mean_of(column))
        for number, column in enumerate(matches.T)
    ]
    ev.conclude(
        f"{share:.0%} of the draws have exactly three peaks, and in {in_place:.0%} each of them is "
        "where B meets a target of F, to a third of a standard deviation. That these places are "
        f"on average {', '.join(f'{each:.2f}' for each in mean)} m is no test: the scene was laid "
        "out by the three numbers of the thesis.",
        over=OVER,
    )


@claim("d2d-lower", section="4.2", lines="617, 635", figure="targets-p2d-d2d")
def d2d_lower(ev: Evidence) -> None:
    """The cost values of D2D are lower than those of P2D."""
    p2d, d2d = _surfaces(P2D), _surfaces(D2D)
    highest = np.exp(d2d.max(axis=-1) - p2d.max(axis=-1))
    p2d_of_b, d2d_of_b = (_surfaces(cost, of_b_alone=True).max(axis=-1) for cost in (P2D, D2D))
    peak_is_lower = share_of(highest < 1.0)
    along = mean_of((d2d < p2d).mean(axis=-1))
    ratio, ratio_of_b = median_of(highest), median_of(np.exp(d2d_of_b - p2d_of_b))
    at_peaks = in_every(nearly_all(peak_is_lower), RATIO.smaller(ratio)) == "holds"
    everywhere = at_peaks and nearly_all(along) == "holds"
    ev.parts["its values are lower"] = decide(
        supported=everywhere, conditional=at_peaks, opposed=not at_peaks
    )
    ev("share of draws in which D2D's highest value is lower", peak_is_lower)
    ev.headline("median ratio of the highest values, D2D / P2D", ratio, RATIO.smaller)
    ev("median ratio of the highest values, target B alone", ratio_of_b)
    ev.headline("share of the t_x axis on which D2D is lower", along, nearly_all)
    ev.conclude(
        f"D2D's highest value is lower in {peak_is_lower:.0%} of the draws, since adding equal "
        "covariances divides the height of each term by sqrt(2); the median ratio is "
        f"{ratio_of_b:.2f} for target B alone and {ratio:.2f} for the sum of three targets, where "
        "noise also moves the terms apart, at the expense of P2D's narrower ones. The area stays "
        f"the same, so D2D must be higher elsewhere: it is lower on {along:.0%} of the t_x axis.",
        holds=f"At the peaks, of which the highest is lower in {peak_is_lower:.0%} of the draws; "
        f"along the t_x axis D2D is lower on {along:.0%}.",
        over=OVER,
    )


@claim("equal-sigma-same", section="4.2", lines="639, 649", figure="overall-p2d-d2d")
def equal_sigma_same(ev: Evidence) -> None:
    """As long as all points have the same standard deviation, the surfaces of P2D and D2D "behave
    the same": one global peak at the correct alignment, and local peaks.
    """
    p2d, d2d = _survey(P2D), _survey(D2D)
    right_p2d, right_d2d = (share_of(is_right(each)) for each in (p2d, d2d))
    local_p2d, local_d2d = (share_of(each.optima > 1) for each in (p2d, d2d))
    alike = share_of(p2d.optima == d2d.optima)
    peak_is_right = ev.part("the global peak is right", nearly_all)
    has_local = ev.part("both have local peaks", nearly_all)
    behave_alike = ev.part("they behave the same", nearly_all)
    peak_is_right("share of draws with P2D's highest peak at the true alignment", right_p2d)
    peak_is_right.headline(
        "share of draws with D2D's highest peak at the true alignment", right_d2d
    )
    has_local("share of draws with local peaks besides, P2D", local_p2d)
    has_local("share of draws with local peaks besides, D2D", local_d2d)
    behave_alike.headline("share of draws with as many peaks in both", alike)
    number_p2d = ev("mean number of peaks, P2D", mean_of(p2d.optima))
    number_d2d = ev("mean number of peaks, D2D", mean_of(d2d.optima))
    ev.conclude(
        f"the highest peak is at the true alignment in {right_p2d:.0%} of the draws with P2D and "
        f"in {right_d2d:.0%} with D2D, with local ones besides in {local_p2d:.0%} and "
        f"{local_d2d:.0%}; the number of peaks is the same in {alike:.0%}. P2D's terms have the "
        "width of one point's noise and are scattered by that of two, so its peaks can split: it "
        f"has {number_p2d:.2f} on average, D2D {number_d2d:.2f}.",
        holds="For the place of the highest peak and the presence of local ones; the number of "
        f"peaks is the same in {alike:.0%} of the draws.",
        over=OVER,
    )


@claim("noisy-p2d-fails", section="4.2", lines="649–650", figure="overall-noisy")
def noisy_p2d_fails(ev: Evidence) -> None:
    """If the current set has the larger standard deviation, the surface of P2D "does not include a
    global peak", and that of D2D has only one global maximum.
    """
    sigma = NOISE_RATIO * SIGMA
    p2d, d2d = _survey(P2D, sigma), _survey(D2D, sigma)
    clear_p2d, clear_d2d = (
        share_of(is_right(each) & (each.rival < OUTSTANDING)) for each in (p2d, d2d)
    )
    without = complement(clear_p2d)
    has_none = ev.part("P2D has no global peak", nearly_all)
    has_one = ev.part("D2D has one", nearly_all)
    has_none.headline("share of draws without an outstanding peak at the truth, P2D", without)
    has_one.headline("share of draws with one, D2D", clear_d2d)
    surveys = {"P2D": p2d, "D2D": d2d}
    for name, each in surveys.items():
        right = share_of(is_right(each))
        ev(f"share of draws with {name}'s highest peak at the true alignment", right)
    for name, each in surveys.items():
        ev(f"mean number of peaks, {name}", mean_of(each.optima))
    ev.conclude(
        f"with {NOISE_RATIO:g} times the noise in M, P2D still has a peak at the true alignment "
        f"that stands out, with all others below {OUTSTANDING:.0%} of it, in {clear_p2d:.0%} of "
        f"the draws; D2D has one in {clear_d2d:.0%}. P2D expects less scatter than there is, so "
        "the common peak of its targets splits in some draws.",
        holds=f"D2D has a global peak in {clear_d2d:.0%} of the draws.",
        over=OVER,
    )


@claim("summing-local-peaks", section="4.3", lines="688", figure="summing-likelihood")
def summing_local_peaks(ev: Evidence) -> None:
    """The surface of the sum has one global maximum and many local maxima."""
    survey_of_sum = _survey(D2D)
    right = share_of(is_right(survey_of_sum))
    maximum_is_right = ev.part("the global maximum is right", nearly_all)
    local = ev.part("there are many local ones", nearly_all)
    maximum_is_right.headline("share of draws with the highest peak at the true alignment", right)
    local.headline("share of draws with three peaks or more", share_of(survey_of_sum.optima >= 3))
    number = ev("mean number of peaks", mean_of(survey_of_sum.optima))
    ev.conclude(
        "every pair of targets that meet adds a peak, at the scene's seven different distances: "
        f"the sum has {number:.1f} peaks on average, and the highest is at the true "
        f"alignment in {right:.0%} of the draws.",
        over=OVER,
    )


@claim("likelihood-one-peak", section="4.3", lines="706, 713", figure="summing-likelihood")
def likelihood_one_peak(ev: Evidence) -> None:
    """The surface of the likelihood has only one maximum, at the correct translation."""
    survey_of_product = _survey(LIKELIHOOD)
    right = share_of(is_right(survey_of_product))
    one_visible = share_of(survey_of_product.rival < VISIBLE)
    one = share_of(survey_of_product.optima == 1)
    only_one = ev.part("there is only one", nearly_all)
    at_truth = ev.part("it is at the truth", nearly_all)
    at_truth("share of draws with the highest peak at the true alignment", right)
    visible = "share of draws with one visible peak (above 1 % of the highest)"
    ev.headline(visible, one_visible, nearly_all)
    only_one.headline("share of draws with one peak in the logarithm", one, under=one_visible)
    ev.conclude(
        f"the density has a single visible peak (one above {VISIBLE:.0%} of the highest) "
        f"in {one_visible:.0%} of the draws, and the highest is at the true alignment in "
        f"{right:.0%}. The logarithm, which an optimiser follows, keeps the local optima that the "
        f"product makes too small to see: it has a single maximum in {one:.0%}.",
        holds=f"For the density as plotted, with one visible peak in {one_visible:.0%} of the "
        f"draws; the logarithm has a single maximum in {one:.0%}.",
        over=OVER,
    )


@claim("summing-smoother", section="4.3", lines="719, 721", figure="summing-likelihood")
def summing_smoother(ev: Evidence) -> None:
    """The surface of the sum is smoother at its global maximum than that of the likelihood (though
    it has many local peaks).
    """
    width_of_sum, width_of_product = (
        (surfaces - surfaces.max(axis=-1, keepdims=True) > np.log(0.5)).sum(axis=-1)
        for surfaces in (_surfaces(D2D), _surfaces(LIKELIHOOD))
    )
    wider = share_of(width_of_sum > width_of_product)
    ratio = median_of(width_of_sum / width_of_product)
    peaks_of_sum, peaks_of_product = (mean_of(_survey(cost).optima) for cost in (D2D, LIKELIHOOD))
    is_wider = ev.part("its peak is wider", nearly_all)
    is_wider.headline("share of draws in which the sum's half-height width is larger", wider)
    widths = "median ratio of the half-height widths, sum / likelihood"
    is_wider.headline(widths, ratio, RATIO.larger)
    ev("mean number of peaks of the sum", peaks_of_sum)
    ev("mean number of peaks of the log-likelihood", peaks_of_product)
    ev.conclude(
        f"the sum is wider at half height in {wider:.0%} of the draws, by a median factor of "
        f"{ratio:.2f}: a product of three Gaussians is narrower than each of them by sqrt(3), and "
        "noise additionally spreads the terms of the sum. As the thesis says, it also has more "
        f"peaks, {peaks_of_sum:.2f} on average, the log-likelihood {peaks_of_product:.2f}.",
        over=OVER,
    )
