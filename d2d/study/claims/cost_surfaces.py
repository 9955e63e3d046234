"""Claims of thesis sections 4.2 and 4.3: metrics and fusions on the one-dimensional scene."""

from collections.abc import Callable

import numpy as np

from d2d._checks import Array
from d2d.cost import RegistrationCost
from d2d.point_set import PointSet
from d2d.study.claims.base import Claim, Evidence
from d2d.study.line_scene import FIXED_POSITIONS, SIGMA, TRUTH, line_scene
from d2d.study.surfaces import Peaks, basin, log_surface, peaks

DRAWS = 1000
TRANSLATIONS = np.arange(-12.0, 16.0, 0.02)  # m
VISIBLE = np.log(0.01)  # a peak below 1 % of the highest cannot be seen in a plot of the density
NOISE_RATIO = 4.0  # the thesis's noisier set: its standard deviation over the other's
RIGHT = 1.1  # m: half way from the true alignment to the next one, at which two other targets meet
OUTSTANDING = np.log(0.8)  # no other peak reaches 80 % of a peak that stands out

P2D, D2D = RegistrationCost("p2d", "summing"), RegistrationCost("d2d", "summing")
LIKELIHOOD = RegistrationCost("d2d", "likelihood")


def _first_target(moving: PointSet) -> PointSet:
    """Target B of each draw, alone."""
    return PointSet(moving.means[:, :1], moving.covariances[:, :1])


def _scene_surfaces(cost: RegistrationCost, sigma_moving: float = SIGMA) -> Array:
    """Logarithm (draws, T) of the overall surface for each of the seeded draws."""
    fixed, moving = line_scene(np.random.default_rng(42), sigma_moving=sigma_moving, draws=(DRAWS,))
    return log_surface(cost, TRANSLATIONS, fixed, moving)


def _scene_peaks(cost: RegistrationCost, sigma_moving: float = SIGMA) -> list[Peaks]:
    """Their peaks."""
    return [peaks(TRANSLATIONS, surface) for surface in _scene_surfaces(cost, sigma_moving)]


def _basin_width(cost: RegistrationCost, sigma_moving: float = SIGMA) -> float:
    """Median width (m) of the basin of attraction that holds the true alignment."""
    surfaces = _scene_surfaces(cost, sigma_moving)
    edges = np.array([basin(TRANSLATIONS, surface, TRUTH)[1:] for surface in surfaces])
    return float(np.median(edges[:, 1] - edges[:, 0]))


def _share(found: list[Peaks], condition: Callable[[Peaks], bool]) -> float:
    return float(np.mean([condition(each) for each in found]))


def _count(found: list[Peaks], floor: float = -np.inf) -> Array:
    return np.array([np.sum(each.log_heights > floor) for each in found])


def _right(found: Peaks) -> bool:
    """Whether the highest peak is that of the true alignment."""
    return bool(abs(found.positions[0] - TRUTH) < RIGHT)


def _three_peaks() -> Evidence:
    fixed, moving = line_scene(np.random.default_rng(42), draws=(DRAWS,))
    surfaces = log_surface(RegistrationCost("p2d"), TRANSLATIONS, fixed, _first_target(moving))
    found = [peaks(TRANSLATIONS, surface) for surface in surfaces]
    three = [np.sort(each.positions) for each in found if len(each.positions) == 3]
    share = len(three) / DRAWS
    if share < 0.5:
        return Evidence("refuted", "B meets other components.", {"share with three peaks": share})
    places = np.array(three)
    expected = TRUTH + FIXED_POSITIONS
    spread = places.std(axis=0)
    offset = np.abs(places.mean(axis=0) - expected).max()
    holds = share > 0.99 and offset < 3.0 * spread.max() / np.sqrt(len(three)) + 0.02
    return Evidence(
        "confirmed" if holds else "refuted",
        "target B meets the three components of F one after the other; a single draw moves each "
        "peak by the noise of both points.",
        {
            "share of draws with exactly three peaks": share,
            "mean position of the first peak (m)": places[:, 0].mean(),
            "mean position of the second peak (m)": places[:, 1].mean(),
            "mean position of the third peak (m)": places[:, 2].mean(),
            "standard deviation of a peak's position (m)": spread.mean(),
        },
    )


def _d2d_lower() -> Evidence:
    fixed, moving = line_scene(np.random.default_rng(42), draws=(DRAWS,))
    p2d = log_surface(P2D, TRANSLATIONS, fixed, moving)
    d2d = log_surface(D2D, TRANSLATIONS, fixed, moving)
    highest = np.exp(d2d.max(axis=-1) - p2d.max(axis=-1))
    alone = _first_target(moving)
    single = [log_surface(cost, TRANSLATIONS, fixed, alone).max(axis=-1) for cost in (D2D, P2D)]
    lower = float((highest < 1.0).mean())
    along = float((d2d < p2d).mean())
    return Evidence(
        "confirmed" if along > 0.99 else "qualified" if lower > 0.99 else "refuted",
        "it holds for the height of a peak, which adding the covariances divides by sqrt(2) where "
        "they are equal; the area stays, so that beside the peaks D2D is the higher one. The "
        "sum of three targets loses less: noise moves their terms apart, which costs P2D's "
        "narrower ones more height.",
        {
            "share of draws in which D2D's highest value is the lower": lower,
            "median ratio of the highest values, D2D / P2D": float(np.median(highest)),
            "the same, target B alone": float(np.median(np.exp(single[0] - single[1]))),
            "share of the t_x axis on which D2D is the lower": along,
        },
    )


def _equal_sigma_same() -> Evidence:
    p2d, d2d = _scene_peaks(P2D), _scene_peaks(D2D)
    right_p2d, right_d2d = _share(p2d, _right), _share(d2d, _right)
    several = float(min((_count(p2d) > 1).mean(), (_count(d2d) > 1).mean()))
    same = float(np.mean(_count(p2d) == _count(d2d)))
    holds = min(right_p2d, right_d2d, several) > 0.99
    return Evidence(
        "confirmed" if holds and same > 0.95 else "qualified" if holds else "refuted",
        "both are highest at the true alignment and have local peaks elsewhere, but they are not "
        "the same: P2D's terms have the width of one point's noise and lie apart by that of two, "
        "so that its peaks split more often.",
        {
            "share of draws with P2D's highest peak at the true alignment": right_p2d,
            "share of draws with D2D's highest peak at the true alignment": right_d2d,
            "share of draws with as many peaks in both": same,
            "mean number of peaks, P2D": float(_count(p2d).mean()),
            "mean number of peaks, D2D": float(_count(d2d).mean()),
        },
    )


def _noisy_p2d_fails() -> Evidence:
    sigma = NOISE_RATIO * SIGMA
    p2d, d2d = _scene_peaks(P2D, sigma), _scene_peaks(D2D, sigma)

    def stands_out(found: Peaks) -> bool:
        return _right(found) and bool((found.log_heights[1:] < OUTSTANDING).all())

    alone_p2d, alone_d2d = _share(p2d, stands_out), _share(d2d, stands_out)
    error = np.sqrt((alone_p2d * (1 - alone_p2d) + alone_d2d * (1 - alone_d2d)) / DRAWS)
    return Evidence(
        "confirmed"
        if alone_p2d < 0.05 and alone_d2d > 0.95
        else "qualified"
        if alone_d2d - alone_p2d > 3.0 * error
        else "refuted",
        "with four times the noise in M the difference is one of degree: D2D keeps a peak that "
        "stands out at the true alignment more often than P2D, but not always, and P2D often does.",
        {
            "share of draws with P2D's highest peak at the true alignment": _share(p2d, _right),
            "share of draws with D2D's highest peak at the true alignment": _share(d2d, _right),
            "share in which it also stands out (rivals below 0.8), P2D": alone_p2d,
            "share in which it also stands out (rivals below 0.8), D2D": alone_d2d,
            "mean number of peaks, P2D": float(_count(p2d).mean()),
            "mean number of peaks, D2D": float(_count(d2d).mean()),
            "median width of the basin around the true alignment, P2D (m)": _basin_width(
                P2D, sigma
            ),
            "median width of the basin around the true alignment, D2D (m)": _basin_width(
                D2D, sigma
            ),
        },
    )


def _summing_local_peaks() -> Evidence:
    found = _scene_peaks(D2D)
    right = _share(found, _right)
    many = _share(found, lambda f: len(f.positions) >= 3)
    seconds = np.array([each.log_heights[1] for each in found if len(each.positions) > 1])
    return Evidence(
        "confirmed"
        if right > 0.99 and many > 0.99
        else "qualified"
        if right > 0.5 and many > 0.5
        else "refuted",
        "every pair of targets that meet adds a peak, at the scene's seven different distances.",
        {
            "share of draws with the highest peak at the true alignment": right,
            "mean number of peaks": float(_count(found).mean()),
            "median height of the second peak over the first": float(np.exp(np.median(seconds)))
            if len(seconds)
            else 0.0,
            "median width of the basin around the true alignment (m)": _basin_width(D2D),
        },
    )


def _likelihood_one_peak() -> Evidence:
    found = _scene_peaks(LIKELIHOOD)
    right = _share(found, _right)
    visible, all_peaks = _count(found, VISIBLE), _count(found)
    one_visible, one = float((visible == 1).mean()), float((all_peaks == 1).mean())
    seconds = [each.log_heights[1] for each in found if len(each.positions) > 1]
    return Evidence(
        "confirmed"
        if min(right, one) > 0.99
        else "qualified"
        if min(right, one_visible) > 0.99
        else "refuted",
        "it holds for the density as one plots it; its logarithm, which an optimiser follows, "
        "keeps the local optima that the product makes too small to see.",
        {
            "share of draws with the highest peak at the true alignment": right,
            "share of draws with one visible peak (above 1 % of the highest)": one_visible,
            "share of draws with one peak in the logarithm": one,
            "mean number of peaks in the logarithm": float(all_peaks.mean()),
            "median log10 of the second peak over the first": float(
                np.median(seconds) / np.log(10)
            ),
            "median width of the basin around the true alignment (m)": _basin_width(LIKELIHOOD),
        },
    )


def _summing_smoother() -> Evidence:
    fixed, moving = line_scene(np.random.default_rng(42), draws=(DRAWS,))
    widths, counts = {}, {}
    for cost in (D2D, LIKELIHOOD):
        surface = log_surface(cost, TRANSLATIONS, fixed, moving)
        half = surface - surface.max(axis=-1, keepdims=True) > np.log(0.5)
        widths[cost.fusion] = half.sum(axis=-1) * np.diff(TRANSLATIONS)[0]
        counts[cost.fusion] = np.mean([len(peaks(TRANSLATIONS, s).positions) for s in surface])
    wider = float((widths["summing"] > widths["likelihood"]).mean())
    ratio = float(np.median(widths["summing"] / widths["likelihood"]))
    fewer = counts["summing"] <= counts["likelihood"]
    return Evidence(
        "confirmed" if wider > 0.99 and fewer else "qualified" if wider > 0.99 else "refuted",
        "the sum's peak at the truth is the wider: a product of three Gaussians is narrower than "
        "each by sqrt(3), and the noise spreads the terms of the sum on top; but wider is not "
        "smoother, for the sum has the more optima of the two.",
        {
            "share of draws in which the sum's half-height width is the larger": wider,
            "median ratio of the half-height widths, sum / likelihood": ratio,
            "mean number of peaks of the sum": float(counts["summing"]),
            "mean number of peaks of the log-likelihood": float(counts["likelihood"]),
        },
    )


CLAIMS = (
    Claim(
        "b-three-peaks",
        "4.2",
        "The cost surface of target B has three peaks, at t_x = 2, 10 and 12.2 m.",
        _three_peaks,
        "confirmed",
        figure="target-b",
        telling=(
            "share of draws with exactly three peaks",
            "mean position of the third peak (m)",
        ),
    ),
    Claim(
        "d2d-lower",
        "4.2",
        "The cost values of D2D are lower than those of P2D.",
        _d2d_lower,
        "qualified",
        figure="targets-p2d-d2d",
        telling=(
            "median ratio of the highest values, D2D / P2D",
            "share of the t_x axis on which D2D is the lower",
        ),
        holds="At the peaks. Beside them D2D is the higher one.",
    ),
    Claim(
        "equal-sigma-same",
        "4.2",
        "With equal standard deviations P2D and D2D behave alike: one global peak at the true "
        "alignment, and local ones.",
        _equal_sigma_same,
        "qualified",
        figure="overall-p2d-d2d",
        telling=(
            "share of draws with D2D's highest peak at the true alignment",
            "share of draws with as many peaks in both",
        ),
        holds="For the place of the highest peak, not for the number of peaks.",
    ),
    Claim(
        "noisy-p2d-fails",
        "4.2",
        "With a noisier current set P2D has no global peak, while D2D keeps one.",
        _noisy_p2d_fails,
        "qualified",
        figure="overall-noisy",
        telling=(
            "share in which it also stands out (rivals below 0.8), P2D",
            "share in which it also stands out (rivals below 0.8), D2D",
        ),
        holds="In the draws in which the noise splits P2D's common peak, about a third.",
    ),
    Claim(
        "summing-local-peaks",
        "4.3",
        "The summing surface has one global maximum and many local ones.",
        _summing_local_peaks,
        "confirmed",
        figure="summing-likelihood",
        telling=(
            "share of draws with the highest peak at the true alignment",
            "mean number of peaks",
        ),
    ),
    Claim(
        "likelihood-one-peak",
        "4.3",
        "The likelihood surface has a single maximum.",
        _likelihood_one_peak,
        "qualified",
        figure="summing-likelihood",
        telling=(
            "share of draws with one visible peak (above 1 % of the highest)",
            "share of draws with one peak in the logarithm",
        ),
        holds="For the density as one plots it, not for its logarithm.",
    ),
    Claim(
        "summing-smoother",
        "4.3",
        "The summing surface is smoother than the likelihood surface.",
        _summing_smoother,
        "qualified",
        figure="summing-likelihood",
        telling=(
            "median ratio of the half-height widths, sum / likelihood",
            "mean number of peaks of the sum",
        ),
        holds="If smoother means a wider peak at the truth; the sum has the more optima.",
    ),
)
