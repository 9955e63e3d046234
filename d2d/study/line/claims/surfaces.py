"""Claims of thesis sections 4.2 and 4.3: metrics and fusions on the one-dimensional scene."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.point_set import PointSet
from d2d.study.book.claim import (
    MEAN,
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
)
from d2d.study.book.measured import (
    bootstrapped,
    mean_of,
    median_of,
    share_difference,
    share_of,
    telling,
)
from d2d.study.line.outlier_study import RIGHT
from d2d.study.line.scene import FIXED_POSITIONS, SIGMA, TRUTH, line_scene
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


def is_right(found: Survey) -> NDArray[np.bool_]:
    """Whether the highest peak of each draw is that of the true alignment."""
    return np.asarray(np.abs(found.highest - TRUTH) < RIGHT)


def _outstanding(found: Survey) -> NDArray[np.bool_]:
    """Whether that peak also stands out from all others."""
    return np.asarray(is_right(found) & (found.rival < OUTSTANDING))


def _rivals(found: Survey) -> Array:
    """Height of the second peak over the first, in the draws that have one; tiny if none has."""
    several = found.optima > 1
    return np.maximum(found.rival[several] if several.any() else found.rival, 1e-300)


@claim("b-three-peaks", section="4.2", figure="target-b")
def b_three_peaks() -> Evidence:
    """The cost surface of target B has three peaks, at t_x = 2, 10 and 12.2 m."""
    of_b = peaks(TRANSLATIONS, _surfaces(P2D, of_b_alone=True))
    has_three = of_b.number == 3
    share = share_of(has_three)
    if share < 0.5:
        return Evidence(
            "refuted",
            f"target B meets other components: {share:.0%} of the draws have exactly three peaks.",
            {"share of draws with exactly three peaks": telling(share)},
            over=OVER,
        )
    positions = np.sort(of_b.positions[has_three, :3])
    mean, spread = [mean_of(column) for column in positions.T], positions.std(axis=0)
    scatter = bootstrapped(lambda drawn: drawn.std(axis=0).mean(), positions)
    in_place = all(
        same(found.plus(-true), MEAN.times(deviation))
        for found, true, deviation in zip(mean, TRUTH + FIXED_POSITIONS, spread, strict=True)
    )
    return Evidence(
        judge(confirmed=nearly_all(share) and in_place),
        "target B meets the three components of F one after the other: "
        f"{share:.0%} of the draws have exactly three peaks, on average at {mean[0]:.2f}, "
        f"{mean[1]:.2f} and {mean[2]:.2f} m. A single draw moves each peak by the noise of both "
        f"points, with a standard deviation of {scatter:.2f} m.",
        {
            "share of draws with exactly three peaks": telling(share),
            "mean position of the first peak (m)": mean[0],
            "mean position of the second peak (m)": mean[1],
            "mean position of the third peak (m)": telling(mean[2]),
            "standard deviation of a peak's position (m)": scatter,
        },
        over=OVER,
    )


@claim("d2d-lower", section="4.2", figure="targets-p2d-d2d")
def d2d_lower() -> Evidence:
    """The cost values of D2D are lower than those of P2D."""
    p2d, d2d = _surfaces(P2D), _surfaces(D2D)
    highest = np.exp(d2d.max(axis=-1) - p2d.max(axis=-1))
    p2d_of_b, d2d_of_b = (_surfaces(cost, of_b_alone=True).max(axis=-1) for cost in (P2D, D2D))
    peak_is_lower = share_of(highest < 1.0)
    along = mean_of((d2d < p2d).mean(axis=-1))
    ratio, ratio_of_b = median_of(highest), median_of(np.exp(d2d_of_b - p2d_of_b))
    return Evidence(
        judge(
            confirmed=nearly_all(along),
            qualified=nearly_all(peak_is_lower) and smaller(ratio, RATIO),
        ),
        f"D2D's highest value is lower in {peak_is_lower:.0%} of the draws, since adding equal "
        "covariances divides the height of each term by sqrt(2); the median ratio is "
        f"{ratio_of_b:.2f} for target B alone and {ratio:.2f} for the sum of three targets, where "
        "noise also moves the terms apart, at the expense of P2D's narrower ones. The area stays "
        f"the same, so D2D must be higher elsewhere: it is lower on {along:.0%} of the t_x axis.",
        {
            "share of draws in which D2D's highest value is lower": peak_is_lower,
            "median ratio of the highest values, D2D / P2D": telling(ratio),
            "median ratio of the highest values, target B alone": ratio_of_b,
            "share of the t_x axis on which D2D is lower": telling(along),
        },
        holds=f"At the highest peak, which is lower in {peak_is_lower:.0%} of the draws; along the "
        f"t_x axis D2D is lower on {along:.0%}.",
        over=OVER,
    )


@claim("equal-sigma-same", section="4.2", figure="overall-p2d-d2d")
def equal_sigma_same() -> Evidence:
    """With equal standard deviations P2D and D2D behave alike: one global peak at the true
    alignment, and local ones.
    """
    p2d, d2d = _survey(P2D), _survey(D2D)
    right_p2d, right_d2d = (share_of(is_right(found)) for found in (p2d, d2d))
    local_p2d, local_d2d = (share_of(found.optima > 1) for found in (p2d, d2d))
    alike = share_of(p2d.optima == d2d.optima)
    number_p2d, number_d2d = mean_of(p2d.optima), mean_of(d2d.optima)
    global_and_local = all(map(nearly_all, (right_p2d, right_d2d, local_p2d, local_d2d)))
    return Evidence(
        judge(confirmed=global_and_local and nearly_all(alike), qualified=global_and_local),
        f"the highest peak is at the true alignment in {right_p2d:.0%} of the draws with P2D and "
        f"in {right_d2d:.0%} with D2D, with local ones besides in {local_p2d:.0%} and "
        f"{local_d2d:.0%}; the number of peaks is the same in {alike:.0%}. P2D's terms have the "
        "width of one point's noise and are scattered by that of two, so its peaks can split: it "
        f"has {number_p2d:.2f} on average, D2D {number_d2d:.2f}.",
        {
            "share of draws with P2D's highest peak at the true alignment": right_p2d,
            "share of draws with D2D's highest peak at the true alignment": telling(right_d2d),
            "share of draws with local peaks besides, P2D": local_p2d,
            "share of draws with local peaks besides, D2D": local_d2d,
            "share of draws with as many peaks in both": telling(alike),
            "mean number of peaks, P2D": number_p2d,
            "mean number of peaks, D2D": number_d2d,
        },
        holds="For the place of the highest peak and the presence of local ones; the number of "
        f"peaks is the same in {alike:.0%} of the draws.",
        over=OVER,
    )


@claim("noisy-p2d-fails", section="4.2", figure="overall-noisy")
def noisy_p2d_fails() -> Evidence:
    """With a noisier current set P2D has no global peak, while D2D keeps one."""
    sigma = NOISE_RATIO * SIGMA
    p2d, d2d = _survey(P2D, sigma), _survey(D2D, sigma)
    clear_p2d, clear_d2d = (share_of(_outstanding(found)) for found in (p2d, d2d))
    lead = share_difference(_outstanding(d2d), _outstanding(p2d))
    return Evidence(
        judge(
            confirmed=hardly_any(clear_p2d) and nearly_all(clear_d2d),
            qualified=larger(lead, SHARE),
        ),
        f"with {NOISE_RATIO:g} times the noise in M, the highest peak is at the true alignment and "
        f"all others are below {OUTSTANDING:.0%} of it in {clear_d2d:.0%} of the draws "
        f"with D2D and in {clear_p2d:.0%} with P2D. P2D expects less scatter than there is, so the "
        "common peak of its targets can split.",
        {
            "share of draws with P2D's highest peak at the true alignment": share_of(is_right(p2d)),
            "share of draws with D2D's highest peak at the true alignment": share_of(is_right(d2d)),
            "share of draws with all other peaks below 80 % of the true one, P2D": telling(
                clear_p2d
            ),
            "share of draws with all other peaks below 80 % of the true one, D2D": telling(
                clear_d2d
            ),
            "difference of these shares": lead,
            "mean number of peaks, P2D": mean_of(p2d.optima),
            "mean number of peaks, D2D": mean_of(d2d.optima),
            "median width of the basin around the true alignment, P2D (m)": median_of(
                p2d.basin_width
            ),
            "median width of the basin around the true alignment, D2D (m)": median_of(
                d2d.basin_width
            ),
        },
        holds=f"In the {1 - clear_p2d:.0%} of the draws in which P2D has no outstanding peak at "
        f"the true alignment; D2D has none in {1 - clear_d2d:.0%}.",
        over=OVER,
    )


@claim("summing-local-peaks", section="4.3", figure="summing-likelihood")
def summing_local_peaks() -> Evidence:
    """The summing surface has one global maximum and many local ones."""
    found = _survey(D2D)
    right = share_of(is_right(found))
    many = share_of(found.optima >= 3)
    number = mean_of(found.optima)
    return Evidence(
        judge(
            confirmed=nearly_all(right) and nearly_all(many), qualified=most(right) and most(many)
        ),
        "every pair of targets that meet adds a peak, at the scene's seven different distances: "
        f"the sum has {number:.1f} peaks on average, and the highest is at the true "
        f"alignment in {right:.0%} of the draws.",
        {
            "share of draws with the highest peak at the true alignment": telling(right),
            "mean number of peaks": telling(number),
            "share of draws with three peaks or more": many,
            "median height of the second peak over the first": median_of(_rivals(found)),
            "median width of the basin around the true alignment (m)": median_of(found.basin_width),
        },
        holds=f"In the draws with the highest peak at the true alignment ({right:.0%}) and with "
        f"three peaks or more ({many:.0%}).",
        over=OVER,
    )


@claim("likelihood-one-peak", section="4.3", figure="summing-likelihood")
def likelihood_one_peak() -> Evidence:
    """The likelihood surface has a single maximum."""
    found = _survey(LIKELIHOOD)
    right = share_of(is_right(found))
    one_visible = share_of(found.rival < VISIBLE)
    one = share_of(found.optima == 1)
    return Evidence(
        judge(
            confirmed=nearly_all(right) and nearly_all(one),
            qualified=nearly_all(right) and nearly_all(one_visible),
        ),
        f"the density has a single visible peak (one above {VISIBLE:.0%} of the highest) "
        f"in {one_visible:.0%} of the draws, and the highest is at the true alignment in "
        f"{right:.0%}. The logarithm, which an optimiser follows, keeps the local optima that the "
        f"product makes too small to see: it has a single maximum in {one:.0%}.",
        {
            "share of draws with the highest peak at the true alignment": right,
            "share of draws with one visible peak (above 1 % of the highest)": telling(one_visible),
            "share of draws with one peak in the logarithm": telling(one),
            "mean number of peaks in the logarithm": mean_of(found.optima),
            "median log10 of the second peak over the first": median_of(np.log10(_rivals(found))),
            "median width of the basin around the true alignment (m)": median_of(found.basin_width),
        },
        holds=f"For the density as plotted, with one visible peak in {one_visible:.0%} of the "
        f"draws; the logarithm has a single maximum in {one:.0%}.",
        over=OVER,
    )


@claim("summing-smoother", section="4.3", figure="summing-likelihood")
def summing_smoother() -> Evidence:
    """The summing surface is smoother than the likelihood surface."""
    width_of_sum, width_of_product = (
        (surfaces - surfaces.max(axis=-1, keepdims=True) > np.log(0.5)).sum(axis=-1)
        for surfaces in (_surfaces(D2D), _surfaces(LIKELIHOOD))
    )
    sum_found, product_found = _survey(D2D), _survey(LIKELIHOOD)
    peaks_of_sum, peaks_of_product = mean_of(sum_found.optima), mean_of(product_found.optima)
    no_more = share_of(sum_found.optima <= product_found.optima)
    wider = share_of(width_of_sum > width_of_product)
    ratio = median_of(width_of_sum / width_of_product)
    is_wider = nearly_all(wider) and larger(ratio, RATIO)
    return Evidence(
        judge(confirmed=is_wider and nearly_all(no_more), qualified=is_wider),
        f"the sum is wider at half height in {wider:.0%} of the draws, by a median factor of "
        f"{ratio:.2f}: a product of three Gaussians is narrower than each of them by sqrt(3), and "
        "noise additionally spreads the terms of the sum. Width is not smoothness, though: the sum "
        f"has {peaks_of_sum:.2f} peaks on average, the log-likelihood {peaks_of_product:.2f}.",
        {
            "share of draws in which the sum's half-height width is larger": wider,
            "median ratio of the half-height widths, sum / likelihood": telling(ratio),
            "mean number of peaks of the sum": telling(peaks_of_sum),
            "mean number of peaks of the log-likelihood": peaks_of_product,
            "share of draws in which the sum has no more peaks": no_more,
        },
        holds="If smoother means a wider peak at the truth, not fewer optima: the sum has "
        f"{peaks_of_sum:.2f} on average, the log-likelihood {peaks_of_product:.2f}.",
        over=OVER,
    )
