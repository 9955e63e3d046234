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
NOISE_RATIO = 4.0  # of the noisier set's standard deviation; the thesis gives no number
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
    three = ev.part("it has three peaks", nearly_all)
    where = ev.part("they are where B matches", nearly_all)
    three.headline("share of draws with exactly three peaks", share_of(has_three))
    in_place = share_of(off < MEAN.high * SIGMA)
    where.headline("share of draws with each of them where B meets a target", in_place)
    for number, column in enumerate(matches.T, start=1):
        ev(f"mean distance from B to target {number} of F (m)", mean_of(column))
    ev.conclude(
        "the peaks are where B meets the targets of F, to a third of a standard deviation. That "
        "these places are on average those of the thesis is no test: the scene was laid out by "
        "its three numbers.",
        over=OVER,
    )


@claim("d2d-lower", section="4.2", lines="617, 635", figure="targets-p2d-d2d")
def d2d_lower(ev: Evidence) -> None:
    """The cost values of D2D are lower than those of P2D."""
    p2d, d2d = _surfaces(P2D), _surfaces(D2D)
    p2d_of_b, d2d_of_b = (_surfaces(cost, of_b_alone=True).max(axis=-1) for cost in (P2D, D2D))
    highest = np.exp(d2d.max(axis=-1) - p2d.max(axis=-1))
    lower = ev("share of draws in which D2D's highest value is lower", share_of(highest < 1.0))
    ratio = median_of(highest)
    ev.headline("median ratio of the highest values, D2D / P2D", ratio, RATIO.smaller)
    of_b = median_of(np.exp(d2d_of_b - p2d_of_b))
    ev("median ratio of the highest values, target B alone", of_b)
    along = mean_of((d2d < p2d).mean(axis=-1))
    ev.headline("share of the t_x axis on which D2D is lower", along, nearly_all)
    at_peaks = in_every(nearly_all(lower), RATIO.smaller(ratio)) == "holds"
    everywhere = at_peaks and nearly_all(along) == "holds"
    ev.parts["its values are lower"] = decide(
        supported=everywhere, conditional=at_peaks, opposed=not at_peaks
    )
    ev.conclude(
        "adding equal covariances divides the height of each term by sqrt(2), and noise moves the "
        "terms of the sum apart, at the expense of P2D's narrower ones. The area stays the same, "
        f"so D2D must be higher elsewhere: it is lower on {along:.0%} of the t_x axis.",
        holds="At the peaks, not along the t_x axis.",
        over=OVER,
    )


@claim("equal-sigma-same", section="4.2", lines="639, 649", figure="overall-p2d-d2d")
def equal_sigma_same(ev: Evidence) -> None:
    """As long as all points have the same standard deviation, the surfaces of P2D and D2D "behave
    the same": one global peak at the correct alignment, and local peaks.
    """
    surveys = {"P2D": _survey(P2D), "D2D": _survey(D2D)}
    peak_is_right = ev.part("the global peak is right", nearly_all)
    has_local = ev.part("both have local peaks", nearly_all)
    behave_alike = ev.part("they behave the same", nearly_all)
    for name, each in surveys.items():
        add = peak_is_right.headline if name == "D2D" else peak_is_right
        right = share_of(is_right(each))
        add(f"share of draws with {name}'s highest peak at the true alignment", right)
        has_local(f"share of draws with local peaks besides, {name}", share_of(each.optima > 1))
        ev(f"mean number of peaks, {name}", mean_of(each.optima))
    alike = share_of(surveys["P2D"].optima == surveys["D2D"].optima)
    behave_alike.headline("share of draws with as many peaks in both", alike)
    ev.conclude(
        "P2D's terms have the width of one point's noise and are scattered by that of two, so its "
        f"peaks can split: the number of peaks is the same in {alike:.0%} of the draws.",
        holds="For the place of the highest peak and the presence of local ones, not for their "
        "number.",
        over=OVER,
    )


@claim("noisy-p2d-fails", section="4.2", lines="649–650", figure="overall-noisy")
def noisy_p2d_fails(ev: Evidence) -> None:
    """If the current set has the larger standard deviation, the surface of P2D "does not include a
    global peak", and that of D2D has only one global maximum.
    """
    surveys = {name: _survey(c, NOISE_RATIO * SIGMA) for name, c in (("P2D", P2D), ("D2D", D2D))}
    p2d, d2d = (share_of(is_right(s) & (s.rival < OUTSTANDING)) for s in surveys.values())
    has_none = ev.part("P2D has no global peak", nearly_all)
    has_one = ev.part("D2D has one", nearly_all)
    without = "share of draws without an outstanding peak at the truth, P2D"
    has_none.headline(without, complement(p2d))
    has_one.headline("share of draws with one, D2D", d2d)
    for name, each in surveys.items():
        right = share_of(is_right(each))
        ev(f"share of draws with {name}'s highest peak at the true alignment", right)
        ev(f"mean number of peaks, {name}", mean_of(each.optima))
    ev.conclude(
        f"with {NOISE_RATIO:g} times the noise in M, P2D expects less scatter than there is, so "
        "the common peak of its targets splits in some draws; in the others it still stands out, "
        f"with all others below {OUTSTANDING:.0%} of it.",
        holds=f"D2D has a global peak in {d2d:.0%} of the draws.",
        over=OVER,
    )


@claim("summing-local-peaks", section="4.3", lines="688", figure="summing-likelihood")
def summing_local_peaks(ev: Evidence) -> None:
    """The surface of the sum has one global maximum and many local maxima."""
    of_sum = _survey(D2D)
    maximum_is_right = ev.part("the global maximum is right", nearly_all)
    local = ev.part("there are many local ones", nearly_all)
    right = share_of(is_right(of_sum))
    maximum_is_right.headline("share of draws with the highest peak at the true alignment", right)
    local.headline("share of draws with three peaks or more", share_of(of_sum.optima >= 3))
    number = ev("mean number of peaks", mean_of(of_sum.optima))
    ev.conclude(
        "every pair of targets that meet adds a peak, at the scene's seven different distances: "
        f"the sum has {number:.1f} peaks on average.",
        over=OVER,
    )


@claim("likelihood-one-peak", section="4.3", lines="706, 713", figure="summing-likelihood")
def likelihood_one_peak(ev: Evidence) -> None:
    """The surface of the likelihood has only one maximum, at the correct translation."""
    of_product = _survey(LIKELIHOOD)
    only_one = ev.part("there is only one", nearly_all)
    at_truth = ev.part("it is at the truth", nearly_all)
    right = share_of(is_right(of_product))
    at_truth("share of draws with the highest peak at the true alignment", right)
    visible = share_of(of_product.rival < VISIBLE)
    ev.headline(
        "share of draws with one visible peak (above 1 % of the highest)", visible, nearly_all
    )
    one = share_of(of_product.optima == 1)
    only_one.headline("share of draws with one peak in the logarithm", one, under=visible)
    ev.conclude(
        "the logarithm, which an optimiser follows, keeps the local optima that the product makes "
        f"too small to see: it has a single maximum in {one:.0%} of the draws.",
        holds=f"For the density as plotted, not for its logarithm, with one in {one:.0%}.",
        over=OVER,
    )


@claim("summing-smoother", section="4.3", lines="719, 721", figure="summing-likelihood")
def summing_smoother(ev: Evidence) -> None:
    """The surface of the sum is smoother at its global maximum than that of the likelihood (though
    it has many local peaks).
    """
    of_sum, of_product = (
        (surfaces - surfaces.max(axis=-1, keepdims=True) > np.log(0.5)).sum(axis=-1)
        for surfaces in (_surfaces(D2D), _surfaces(LIKELIHOOD))
    )
    is_wider = ev.part("its peak is wider", nearly_all)
    wider = share_of(of_sum > of_product)
    is_wider.headline("share of draws in which the sum's half-height width is larger", wider)
    widths = "median ratio of the half-height widths, sum / likelihood"
    ratio = is_wider.headline(widths, median_of(of_sum / of_product), RATIO.larger)
    ev("mean number of peaks of the sum", mean_of(_survey(D2D).optima))
    ev("mean number of peaks of the log-likelihood", mean_of(_survey(LIKELIHOOD).optima))
    ev.conclude(
        f"the sum is {ratio:.2f} times as wide at half height (median): a product of three "
        "Gaussians is narrower than each of them by sqrt(3), and noise additionally spreads the "
        "terms of the sum. As the thesis says, it also has more peaks.",
        over=OVER,
    )
