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
    """Two equal round Gaussians of standard deviation 1; two maxima if more than 2 apart."""
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
    """Data with two humps are a situation in which one Gaussian is "not optimal" and two represent
    the observations better.
    """
    rng = np.random.default_rng(23)
    two_better = ev.part("two represent two humps better", nearly_all)
    least = np.inf  # separation from which on both criteria prefer two in most draws
    for separation in SEPARATIONS:
        gains = np.array([_gain_of_two(separation, OBSERVATIONS, rng) for _ in range(DRAWS)])
        held_out, by_bic = map(share_of, (gains > 0).T)
        both = smallest(share_of, *zip((gains > 0).T))  # by the stricter of the two criteria
        least = min(least, separation) if most(both) else np.inf
        if separation > TWO_HUMPS:
            two_better.judge(both)
        apart = f"humps {separation:g} sigma apart"
        ev(f"share of draws with two better on held-out data, {apart}", held_out)
        name = f"share of draws with two better by BIC, {apart}"
        if separation in (3.0, 3.5):
            ev.headline(name, by_bic, nearly_all)
        else:
            ev(name, by_bic)
    gains = np.array([_gain_of_two(NEAR_HUMPS, MANY, rng) for _ in range(DRAWS // 2)])
    near = f"humps {NEAR_HUMPS:g} sigma apart, {MANY} observations"
    of_many = ev(f"share of draws with two better by BIC, {near}", share_of(gains[:, 1] > 0))
    ev.conclude(
        "BIC charges two components for six more parameters, so it needs more observations or "
        "humps farther apart to prefer them.",
        holds="The humps are far enough apart for the number of observations: with "
        f"{OBSERVATIONS} of them two components are better in most draws from a separation of "
        f"{least:g} standard deviations on, and with {MANY} BIC prefers two in {of_many:.0%} of "
        f"the draws at a separation of {NEAR_HUMPS:g}.",
        over=f"{DRAWS} draws of {OBSERVATIONS} observations for each separation, and "
        f"{DRAWS // 2} of {MANY}",
    )


def random_observations(rng: np.random.Generator, kind: int) -> tuple[Array, int]:
    """Observations (N, D) and a number of components; every fifth set is degenerate.

    Kinds 0 to 2 are fewer observations than components, equal observations, one far outlier.
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


@claim("em-monotone", section="2.3", lines="268, 293", figure="em-starts")
def em_monotone(ev: Evidence) -> None:
    """EM, in the thesis without weights of the components, iterates between its two steps "until it
    is converged".
    """
    rng = np.random.default_rng(29)
    fits: dict[bool, list[MixtureFit]] = {True: [], False: []}  # as printed; with weights
    for draw in range(SETS):
        x, components = random_observations(rng, draw % 15)
        seed = int(rng.integers(2**32))
        for equal_weights, fitted in fits.items():
            fitted.append(
                fit_mixture(
                    x,
                    components,
                    np.random.default_rng(seed),
                    equal_weights=equal_weights,
                    tolerance=1e-6,
                    max_iterations=MAX_STEPS,
                )
            )
    converges = ev.part("it converges", nearly_all)
    ev("number of sets", float(SETS))
    for printed, words in ((True, "as printed"), (False, "with weights")):
        converged = share_of([fit.converged for fit in fits[printed]])
        add = converges.headline if printed else ev
        add(f"share of sets converged, {words}", converged)
        steps = np.array([len(fit.log_likelihoods) - 1 for fit in fits[printed]])
        if printed:
            ev("median number of steps, as printed", median_of(steps))
        ev(f"number of steps of all sets, {words}", float(steps.sum()))
        falling = "of them that lower the log-likelihood" if printed else "of these that lower it"
        ev(f"number {falling} beyond rounding", float(sum(map(_count_falls, fits[printed]))))
    poorer = _share_of_poorer_maxima(np.random.default_rng(31))
    ev("share of starts that end in a poorer maximum, three humps", poorer)
    ev.conclude(
        "hardly any step lowers the likelihood. EM ends in a local maximum, which depends on the "
        f"start: on data with three humps, {poorer:.0%} of the starts end in a poorer one "
        "than the best found.",
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
