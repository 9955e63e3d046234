"""Claims of thesis section 2.3: Gaussian mixtures and expectation maximisation."""

import numpy as np

from d2d._types import Array
from d2d.study.book.claim import Evidence, claim, most, nearly_all
from d2d.study.book.measured import Measured, median_of, share_of, smallest
from d2d.study.mixtures.gaussian import GaussianMixture, MixtureFit, fit_mixture

SETS = 100  # of random observations, for EM
STARTS = 50  # of EM, on one set with three humps
DRAWS = 80  # of two-humped data, for each separation
OBSERVATIONS, HELD_OUT = 200, 2000
MANY, NEAR_HUMPS = 1000, 3.0
SEPARATIONS = (0.0, 2.5, 3.0, 3.5, 4.0)  # standard deviations; one hump up to 2
TWO_HUMPS = 2.0
ROUNDING = 1e-12  # of the log-likelihood, relative
TOLERANCE = 1e-5  # of EM, per observation: far below the gains that are compared
MAX_STEPS = 2000  # of EM


def two_humps(separation: float) -> GaussianMixture:
    """Two equal round Gaussians of standard deviation 1 in the plane.

    Their sum has two maxima if they are more than 2 standard deviations apart.
    """
    means = separation * np.array([[-0.5, 0.0], [0.5, 0.0]])
    return GaussianMixture(np.array([0.5, 0.5]), means, np.tile(np.eye(2), (2, 1, 1)))


def _gain_of_two(
    separation: float, observations: int, rng: np.random.Generator
) -> tuple[float, float]:
    """Gain of two components over one: held-out log-likelihood per observation, and BIC."""
    truth = two_humps(separation)
    x, fresh = truth.sample(observations, rng)[0], truth.sample(HELD_OUT, rng)[0]
    one, two = (fit_mixture(x, k, rng, tolerance=TOLERANCE).mixture for k in (1, 2))
    held_out = (two.log_likelihood(fresh) - one.log_likelihood(fresh)) / HELD_OUT
    return held_out, one.bic(x) - two.bic(x)


@claim("gmm-better", section="2.3", lines="251, 264", figure="gmm")
def gmm_better(ev: Evidence) -> None:
    """In some situations, such as data with two humps, one Gaussian is "not optimal" and two
    represent the observations better.
    """
    rng = np.random.default_rng(23)
    two_better = ev.part("two represent two humps better", nearly_all)
    better: dict[float, Measured] = {}  # share of draws, by the stricter of the two criteria
    by_bic: dict[float, Measured] = {}
    for separation in SEPARATIONS:
        gains = np.array([_gain_of_two(separation, OBSERVATIONS, rng) for _ in range(DRAWS)])
        held_out, by_bic[separation] = map(share_of, (gains > 0).T)
        better[separation] = smallest(share_of, *zip((gains > 0).T))
        if separation > TWO_HUMPS:
            two_better.judge(better[separation])
        apart = f"humps {separation:g} sigma apart"
        ev(f"share of draws with two better on held-out data, {apart}", held_out)
        name = f"share of draws with two better by BIC, {apart}"
        if separation in (3.0, 3.5):
            ev.headline(name, by_bic[separation], nearly_all)
        else:
            ev(name, by_bic[separation])
    gains = np.array([_gain_of_two(NEAR_HUMPS, MANY, rng) for _ in range(DRAWS // 2)])
    by_bic_of_many = ev(
        f"share of draws with two better by BIC, humps {NEAR_HUMPS:g} sigma apart, "
        f"{MANY} observations",
        share_of(gains[:, 1] > 0),
    )
    mostly_better = [
        separation
        for separation in SEPARATIONS
        if all(most(better[wider]) for wider in SEPARATIONS if wider >= separation)
    ]
    mostly = (
        f"if the humps are {mostly_better[0]:g} standard deviations apart or more"
        if mostly_better
        else f"at no separation up to {SEPARATIONS[-1]:g} standard deviations"
    )
    ev.conclude(
        f"with {OBSERVATIONS} observations, two components are better on held-out data and by BIC "
        f"in most draws {mostly}. At {NEAR_HUMPS:g} standard "
        "deviations BIC, which charges them for six more parameters, prefers them in "
        f"{by_bic[NEAR_HUMPS]:.0%} of the draws with {OBSERVATIONS} observations and in "
        f"{by_bic_of_many:.0%} with {MANY}.",
        holds="The humps are far enough apart for the number of observations: with "
        f"{OBSERVATIONS} of them two components are better in most draws {mostly}, and with {MANY} "
        f"BIC prefers two in {by_bic_of_many:.0%} of the draws at a separation of {NEAR_HUMPS:g}.",
        over=f"{DRAWS} draws of {OBSERVATIONS} observations for each separation, and "
        f"{DRAWS // 2} of {MANY}",
    )


def random_observations(rng: np.random.Generator, kind: int) -> tuple[Array, int]:
    """Observations (N, D) and a number of components; every fifth set is degenerate.

    Kinds 0 to 2 are fewer observations than components, equal observations, one far outlier; all
    others are draws of random mixtures.
    """
    components, dimension = int(rng.integers(1, 6)), int(rng.integers(1, 4))
    if kind == 0:
        return rng.standard_normal((3, dimension)), 5
    if kind == 1:
        return np.tile(rng.standard_normal(dimension), (20, 1)), components
    scale = 10.0 ** rng.uniform(-3.0, 3.0)
    centres = scale * rng.uniform(0.0, 6.0) * rng.standard_normal((components, dimension))
    count = int(rng.integers(20, 200))
    x = centres[rng.integers(components, size=count)] + scale * rng.standard_normal(
        (count, dimension)
    )
    if kind == 2:
        x[0] += 1e4 * scale
    return x, components


def _count_falls(fit: MixtureFit) -> int:
    """Number of steps that lower the log-likelihood by more than rounding does."""
    size = np.maximum(np.abs(fit.log_likelihoods[1:]), 1.0)
    return int((np.diff(fit.log_likelihoods) < -ROUNDING * size).sum())


@claim("em-monotone", section="2.3", lines="268, 294", figure="em-starts")
def em_monotone(ev: Evidence) -> None:
    """EM, in the thesis without weights of the components, iterates between its two steps "until it
    is converged".
    """
    rng = np.random.default_rng(29)
    fits: list[tuple[MixtureFit, MixtureFit]] = []
    for draw in range(SETS):
        x, components = random_observations(rng, draw % 15)
        seed = int(rng.integers(2**32))
        fit, fit_if_equal = (
            fit_mixture(
                x,
                components,
                np.random.default_rng(seed),
                equal_weights=equal,
                tolerance=1e-6,
                max_iterations=MAX_STEPS,
            )
            for equal in (False, True)
        )
        fits.append((fit, fit_if_equal))
    weighted, equal = (
        share_of([fit.converged for fit in kind]) for kind in zip(*fits, strict=True)
    )
    falls, falls_if_equal = (sum(map(_count_falls, kind)) for kind in zip(*fits, strict=True))
    steps = np.array([[len(fit.log_likelihoods) - 1 for fit in pair] for pair in fits])
    poorer = _share_of_poorer_maxima(np.random.default_rng(31))
    converges = ev.part("it converges", nearly_all)
    ev("number of sets", float(SETS))
    converges.headline("share of sets converged, as printed", equal)
    ev("share of sets converged, with weights", weighted)
    ev("median number of steps, as printed", median_of(steps[:, 1]))
    ev("number of steps of all sets, as printed", float(steps[:, 1].sum()))
    ev("number of them that lower the log-likelihood beyond rounding", float(falls_if_equal))
    ev("number of steps of all sets, with weights", float(steps[:, 0].sum()))
    ev("number of these that lower it beyond rounding", float(falls))
    ev("share of starts that end in a poorer maximum, three humps", poorer)
    ev.conclude(
        f"as the thesis prints it, EM converges on {equal:.0%} of {SETS} random sets, a fifth of "
        f"them degenerate, and with weights of the components on {weighted:.0%}. "
        f"{falls_if_equal} and {falls} of the {steps[:, 1].sum()} and {steps[:, 0].sum()} steps "
        "lower the likelihood by more than rounding. EM ends in a local maximum, which depends on "
        f"the start: on data with three humps, {poorer:.0%} of the starts end in a poorer one than "
        "the best found.",
        over=f"{SETS} random sets of observations, every fifth degenerate, and {STARTS} starts on "
        "one set with three humps",
    )


def _share_of_poorer_maxima(rng: np.random.Generator) -> Measured:
    """Share of random starts that end more than 1 below the best log-likelihood found."""
    angles = 2.0 * np.pi * np.arange(3) / 3.0
    centres = 3.0 * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    truth = GaussianMixture(np.full(3, 1.0 / 3.0), centres, np.tile(np.eye(2), (3, 1, 1)))
    x, _ = truth.sample(OBSERVATIONS, rng)
    ends = np.array(
        [fit_mixture(x, 3, rng, tolerance=1e-6).log_likelihoods[-1] for _ in range(STARTS)]
    )
    return share_of(ends < ends.max() - 1.0)
