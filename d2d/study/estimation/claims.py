"""Claims of thesis sections 5.1 and 5.2: optimisers and covariances on the overlapped scene."""

import numpy as np
from scipy import stats

from d2d.study.book.claim import Evidence, claim, judge
from d2d.study.estimation.covariance_trials import (
    COSTS,
    CREDIBLE_INCLINATION,
    SEED,
    covariance_study,
    over_layouts,
    quadratic_ratio,
)
from d2d.study.estimation.descent import PairedTargets, run_all
from d2d.study.plane.measures import times_off
from d2d.study.plane.scenarios import OVERLAPPED

PROBLEMS = 6  # started at zero: each takes thousands of gradient descent steps
STARTS = 300  # of the second-order methods, within 5 m and 30 degrees of the truth


@claim(
    "second-order-faster",
    section="5.1",
    figure="optimizer-paths",
    telling=(
        "median iterations, gradient descent, from zero",
        "median iterations, Newton, from zero",
    ),
)
def second_order_faster() -> Evidence:
    """Newton, Gauss-Newton and Levenberg-Marquardt differ from gradient descent in how fast they
    reach the minimum.
    """
    fixed, moving = OVERLAPPED.sample(STARTS, np.random.default_rng(SEED))
    iterations: dict[str, list[int]] = {}
    arrived: dict[str, list[bool]] = {}
    rng = np.random.default_rng(SEED)
    for run in range(STARTS):
        problem = PairedTargets(fixed[run], moving[run])
        near = OVERLAPPED.theta + np.array([5.0, 5.0, np.deg2rad(30.0)]) * rng.uniform(-1, 1, 3)
        from_zero = run < PROBLEMS
        paths = run_all(problem, np.zeros(3) if from_zero else near, first_order=from_zero)
        best = min(paths.values(), key=lambda path: path.costs[-1]).costs[-1]
        for name, path in paths.items():
            same = path.converged and path.costs[-1] - best < 1e-3
            key = f"{name}, from zero" if from_zero else name
            iterations.setdefault(key, []).append(len(path.points) - 1)
            arrived.setdefault(key, []).append(same)
    medians = {key: float(np.median(each)) for key, each in iterations.items()}
    shares = {key: float(np.mean(each)) for key, each in arrived.items()}
    slow = medians["gradient descent, from zero"]
    fast = max(value for key, value in medians.items() if not key.startswith("gradient"))
    faster = slow > 10.0 * fast
    all_arrive = min(shares.values()) > 0.99
    newton = f"{shares['Newton']:.1%} of {len(arrived['Newton'])} starts near the truth"
    others = (
        f"Gauss-Newton from {shares['Gauss-Newton']:.1%} and Levenberg-Marquardt from "
        f"{shares['Levenberg-Marquardt']:.1%}"
    )
    return Evidence(
        judge(confirmed=faster and all_arrive, qualified=faster),
        f"gradient descent takes a median of {slow:.0f} iterations from zero, the other three take "
        f"{fast:.1f} at most. But without a safeguard Newton's method accepts any stationary "
        f"point: it reaches the minimum from {newton}, {others}.",
        {f"median iterations, {key}": value for key, value in medians.items()}
        | {f"share that reaches the minimum, {key}": value for key, value in shares.items()},
        holds="For methods whose step always points downhill. Newton's method without a safeguard "
        f"reaches the minimum from {newton}, {others}.",
    )


@claim(
    "fisher-suffices",
    section="5.2",
    figure="covariance-credibility",
    telling=(
        "ANEES of the inverse Hessian, likelihood",
        "ANEES of the inverse Hessian, summing",
    ),
)
def fisher_suffices() -> Evidence:
    """With the input noise in the cost the inverse Hessian suffices, and error propagation is not
    needed.
    """
    numbers: dict[str, float] = {}
    inverse, propagated = {}, {}
    for name in COSTS:
        study = covariance_study(name)
        hessian, spread = study.fisher_credibility, study.propagated_credibility
        inverse[name], propagated[name] = hessian.inclination, spread.inclination
        numbers |= {
            f"I2 of the inverse Hessian, {name} (dB)": hessian.inclination,
            f"ANEES of the inverse Hessian, {name}": hessian.anees,
            f"I2 of the propagated covariance, {name} (dB)": spread.inclination,
            f"ANEES of the propagated covariance, {name}": spread.anees,
        }
    layouts = over_layouts("likelihood")
    low, high = float(layouts.min()), float(layouts.max())
    numbers["lowest ANEES of the inverse Hessian on random layouts, likelihood"] = low
    numbers["highest ANEES of the inverse Hessian on random layouts, likelihood"] = high
    credible = {name: abs(value) < CREDIBLE_INCLINATION for name, value in inverse.items()}
    likely = credible["likelihood"] and credible["robust likelihood"]
    return Evidence(
        judge(confirmed=likely and credible["summing"], qualified=likely),
        "for the D2D likelihood of targets that stand apart I2 is "
        f"{inverse['likelihood']:+.2f} dB with the inverse Hessian and "
        f"{propagated['likelihood']:+.2f} dB with the propagated covariance, for the robust one "
        f"{inverse['robust likelihood']:+.2f} dB and {propagated['robust likelihood']:+.2f} dB. "
        "The sum has the noise in its cost too, and its inverse Hessian is "
        f"{times_off(inverse['summing'])}; that of P2D, whose cost has the noise of one set only, "
        f"is {times_off(inverse['P2D likelihood'])}, and propagation brings I2 to "
        f"{propagated['P2D likelihood']:+.2f} dB.",
        numbers,
        holds=f"For the D2D likelihood of targets that stand apart, whose I2 is "
        f"{inverse['likelihood']:+.2f} dB, and for the robust one with "
        f"{inverse['robust likelihood']:+.2f} dB; on {len(layouts)} random layouts the ANEES lies "
        f"between {low:.2f} and {high:.2f}.",
    )


@claim(
    "summing-not-gaussian",
    section="5.2",
    figure="covariance-credibility",
    telling=(
        "cost at 2 claimed deviations over its quadratic model, likelihood",
        "cost at 2 claimed deviations over its quadratic model, summing",
    ),
)
def summing_not_gaussian() -> Evidence:
    """The likelihood violates no Gaussian assumption, and the summing does."""
    numbers: dict[str, float] = {}
    kurtosis, distance, quadratic = {}, {}, {}
    passed: dict[str, int] = {}
    for name in ("likelihood", "summing"):
        study = covariance_study(name)
        nees = study.fisher_credibility.nees
        kurtosis[name] = float(np.abs(stats.kurtosis(study.errors)).max())
        distance[name] = float(stats.kstest(nees, "chi2", args=(3,)).statistic)
        quadratic[name] = quadratic_ratio(name, 2.0)
        numbers |= {
            f"largest excess kurtosis of the errors, {name}": kurtosis[name],
            f"largest distance of the NEES from chi-square, {name}": distance[name],
            f"cost at 2 claimed deviations over its quadratic model, {name}": quadratic[name],
        }
        tests = kurtosis[name] < 0.15, distance[name] < 0.02, abs(quadratic[name] - 1.0) < 0.1
        passed[name] = sum(tests)
    likely, summed = passed["likelihood"] == 3, passed["summing"] == 3
    return Evidence(
        judge(confirmed=likely and not summed, qualified=likely),
        "at two claimed standard deviations from the optimum the negative log-likelihood of "
        f"targets that stand apart is {quadratic['likelihood']:.2f} times its quadratic model, and "
        f"the sum's logarithm {quadratic['summing']:.2f} times. The errors have an excess kurtosis "
        f"of up to {kurtosis['likelihood']:.2f} with the likelihood and "
        f"{kurtosis['summing']:.2f} with the sum, and the distribution of the NEES differs from "
        f"chi-square by up to {distance['likelihood']:.3f} and {distance['summing']:.3f}.",
        numbers,
        holds=f"For the likelihood, which passes {passed['likelihood']} of the 3 tests of "
        "normality (quadratic cost, kurtosis of the errors, distribution of the NEES); the sum "
        f"passes {passed['summing']}.",
    )
