"""Claims of thesis section 2.3: Gaussian mixtures and expectation maximisation."""

import numpy as np

from d2d._checks import Array
from d2d.gaussian import GaussianMixture, MixtureFit, fit_mixture
from d2d.study.claims.base import Claim, Evidence, Verdict

SETS = 100  # of random observations, for EM
DRAWS = 60  # of two-humped data, for each separation
OBSERVATIONS, HELD_OUT = 200, 2000
MANY, NEAR_HUMPS = 1000, 3.0
SEPARATIONS = (0.0, 2.5, 3.0, 3.5, 4.0)  # standard deviations; one hump up to 2
TWO_HUMPS = 2.0
ROUNDING = 1e-12  # of the log-likelihood, relative
TOLERANCE = 1e-5  # of EM, per observation: far below the gains that are compared


def two_humps(separation: float) -> GaussianMixture:
    """Two equal round Gaussians of standard deviation 1 in the plane.

    Their sum has two maxima if they are more than 2 standard deviations apart.
    """
    means = separation * np.array([[-0.5, 0.0], [0.5, 0.0]])
    return GaussianMixture(np.array([0.5, 0.5]), means, np.tile(np.eye(2), (2, 1, 1)))


def _two_against_one(
    separation: float, observations: int, rng: np.random.Generator
) -> tuple[float, float]:
    """Gain of two components over one: held-out log-likelihood per observation, and BIC."""
    truth = two_humps(separation)
    x, fresh = truth.sample(observations, rng)[0], truth.sample(HELD_OUT, rng)[0]
    one, two = (fit_mixture(x, k, rng, tolerance=TOLERANCE).mixture for k in (1, 2))
    held_out = (two.log_likelihood(fresh) - one.log_likelihood(fresh)) / HELD_OUT
    return held_out, one.bic(x) - two.bic(x)


def _gmm_better() -> Evidence:
    rng = np.random.default_rng(23)
    numbers: dict[str, float] = {}
    always: dict[float, float] = {}
    for separation in SEPARATIONS:
        gains = np.array([_two_against_one(separation, OBSERVATIONS, rng) for _ in range(DRAWS)])
        held_out, bic = (gains > 0).mean(axis=0)
        always[separation] = min(held_out, bic)
        where = f"at {separation:g} sigma"
        numbers[f"share of draws with two better on held-out data {where}"] = float(held_out)
        numbers[f"share of draws with two better by BIC {where}"] = float(bic)
        numbers[f"median gain per held-out observation {where}"] = float(np.median(gains[:, 0]))
    many = np.array([_two_against_one(NEAR_HUMPS, MANY, rng) for _ in range(DRAWS // 2)])
    numbers[f"share with two better by BIC at {NEAR_HUMPS:g} sigma, {MANY} observations"] = float(
        (many[:, 1] > 0).mean()
    )
    humped = [share for separation, share in always.items() if separation > TWO_HUMPS]
    clear = [separation for separation, share in always.items() if share >= 0.95]
    verdict: Verdict = (
        "confirmed" if min(humped) >= 0.95 else "qualified" if max(humped) >= 0.95 else "refuted"
    )
    return Evidence(
        verdict,
        f"with {OBSERVATIONS} observations two components are the better description from about "
        f"{min(clear, default=np.nan):g} standard deviations between the humps on; nearer ones "
        "need more observations than that to pay for six more parameters (in the plane).",
        numbers,
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


def _falls(fit: MixtureFit) -> int:
    """Number of steps that lower the log-likelihood by more than rounding does."""
    size = np.maximum(np.abs(fit.log_likelihoods[1:]), 1.0)
    return int((np.diff(fit.log_likelihoods) < -ROUNDING * size).sum())


def _em_monotone() -> Evidence:
    rng = np.random.default_rng(29)
    falls, falls_equal, converged, steps = [], [], [], []
    for draw in range(SETS):
        x, components = random_observations(rng, draw % 15)
        seed = int(rng.integers(2**32))
        fit, equal = (
            fit_mixture(
                x,
                components,
                np.random.default_rng(seed),
                equal_weights=equal,
                tolerance=1e-6,
                most_iterations=2000,
            )
            for equal in (False, True)
        )
        falls.append(_falls(fit))
        falls_equal.append(_falls(equal))
        converged.append(fit.converged)
        steps.append(len(fit.log_likelihoods) - 1)
    trapped = _share_of_poorer_optima(np.random.default_rng(31))
    monotone = sum(falls) == 0
    return Evidence(
        "confirmed" if monotone and all(converged) else "qualified" if monotone else "refuted",
        "no step lowers the likelihood by more than rounding, degenerate sets included; what is "
        "reached is a local maximum, which depends on the start.",
        {
            "sets": float(SETS),
            "steps in all": float(sum(steps)),
            "steps that lower the log-likelihood beyond rounding": float(sum(falls)),
            "the same with the weights kept equal, as in the thesis": float(sum(falls_equal)),
            "share of sets converged": float(np.mean(converged)),
            "median number of steps": float(np.median(steps)),
            "share of starts that end in a poorer maximum, three humps": trapped,
        },
    )


def _share_of_poorer_optima(rng: np.random.Generator, starts: int = 50) -> float:
    """Share of random starts that end more than 1 below the best log-likelihood found."""
    angles = 2.0 * np.pi * np.arange(3) / 3.0
    centres = 3.0 * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    truth = GaussianMixture(np.full(3, 1.0 / 3.0), centres, np.tile(np.eye(2), (3, 1, 1)))
    x, _ = truth.sample(OBSERVATIONS, rng)
    ends = np.array(
        [fit_mixture(x, 3, rng, tolerance=1e-6).log_likelihoods[-1] for _ in range(starts)]
    )
    return float((ends < ends.max() - 1.0).mean())


CLAIMS = (
    Claim(
        "gmm-better",
        "2.3",
        "Two Gaussians describe two-humped data better than one.",
        _gmm_better,
        "qualified",
        figure="gmm",
        telling=(
            "share of draws with two better by BIC at 3 sigma",
            "share of draws with two better by BIC at 3.5 sigma",
        ),
        holds="The humps are far enough apart for the number of observations: 3.5 standard "
        "deviations for 200 of them, 3 for 1000.",
    ),
    Claim(
        "em-monotone",
        "2.3",
        "EM repeats its two steps until it converges; each raises the likelihood.",
        _em_monotone,
        "confirmed",
        figure="em-starts",
        telling=(
            "steps in all",
            "steps that lower the log-likelihood beyond rounding",
        ),
    ),
)
