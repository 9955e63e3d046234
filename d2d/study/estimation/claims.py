"""Claims of thesis sections 5.1 and 5.2: optimisers and covariances on the overlapped scene."""

import numpy as np

from d2d.study.book.claim import (
    ANEES,
    DECIBELS,
    RATIO,
    SHARE,
    Evidence,
    claim,
    judge,
    larger,
    nearly_all,
    same,
)
from d2d.study.book.measured import (
    Measured,
    anees_of,
    geometric_mean_of,
    inclination_of,
    mean_of,
    median_of,
    share_of,
    telling,
)
from d2d.study.estimation.covariance_trials import (
    COSTS,
    RUNS,
    SEED,
    Shape,
    covariance_study,
    over_layouts,
    quadratic_ratios,
    shape_of,
)
from d2d.study.estimation.descent import (
    FIRST_ORDER,
    PairedTargets,
    ends_of,
    gradient_descents,
    run_second_order,
)
from d2d.study.plane.measures import times_off
from d2d.study.plane.scenarios import OVERLAPPED

STARTS = 300  # of the four methods, within 5 m and 30 degrees of the truth


@claim("second-order-faster", section="5.1", figure="optimizer-paths")
def second_order_faster() -> Evidence:
    """Newton, Gauss-Newton and Levenberg-Marquardt differ from gradient descent in how fast they
    reach the minimum.
    """
    fixed, moving = OVERLAPPED.sample(STARTS, np.random.default_rng(SEED))
    problems = [PairedTargets(fixed[run], moving[run]) for run in range(STARTS)]
    within = np.random.default_rng(SEED).uniform(-1, 1, (STARTS, 3))
    starts = OVERLAPPED.theta + np.array([5.0, 5.0, np.deg2rad(30.0)]) * within
    fast = list(map(run_second_order, problems, starts))
    ends = {FIRST_ORDER: gradient_descents(problems, starts)}
    ends |= {name: ends_of([each[name] for each in fast]) for name in fast[0]}
    lowest = np.min([each.cost for each in ends.values()], axis=0)
    arrived = {name: each.converged & (each.cost - lowest < 1e-3) for name, each in ends.items()}
    others = [name for name in ends if name != FIRST_ORDER]
    slowest = np.max([ends[name].iterations for name in others], axis=0)
    ratio = geometric_mean_of(ends[FIRST_ORDER].iterations / slowest)
    failed = ~np.all([arrived[name] for name in others], axis=0)
    rescued = int(arrived[FIRST_ORDER][failed].sum())
    shares = {name: share_of(each) for name, each in arrived.items()}
    medians = {name: median_of(each.iterations.astype(np.float64)) for name, each in ends.items()}
    faster = larger(ratio, RATIO)
    return Evidence(
        judge(confirmed=faster and all(map(nearly_all, shares.values())), qualified=faster),
        f"gradient descent takes a median of {medians[FIRST_ORDER]:.0f} iterations and the others "
        f"{max(value for name, value in medians.items() if name in others):.0f} at most, "
        f"{ratio:.0f} times fewer. All four reach the minimum from nearly every start within 5 m "
        f"and 30 degrees: gradient descent from {shares[FIRST_ORDER]:.0%}, Newton's method from "
        f"{shares['Newton']:.1%}, Gauss-Newton from {shares['Gauss-Newton']:.1%} and "
        f"Levenberg-Marquardt from {shares['Levenberg-Marquardt']:.1%}. Newton's method without a "
        "safeguard accepts any stationary point; gradient descent reaches the minimum from "
        f"{rescued} of the {failed.sum()} starts from which that happens.",
        {"ratio of the iterations, gradient descent / slowest of the others": telling(ratio)}
        | {f"median iterations, {name}": value for name, value in medians.items()}
        | {
            f"share that reaches the minimum, {name}": telling(value, name == "Newton")
            for name, value in shares.items()
        }
        | {
            "starts from which one of the three does not reach it": float(failed.sum()),
            "of these, starts from which gradient descent does": float(rescued),
        },
        holds="For the number of iterations; Newton's method without a safeguard reaches the "
        f"minimum from {shares['Newton']:.1%} of the starts.",
        over=f"{STARTS} draws of the noise with a start each",
    )


@claim("fisher-suffices", section="5.2", figure="covariance-credibility")
def fisher_suffices() -> Evidence:
    """With the input noise in the cost the inverse Hessian suffices, and error propagation is not
    needed.
    """
    numbers: dict[str, float] = {}
    inverse, propagated, credible = {}, {}, {}
    for name in COSTS:
        study = covariance_study(name)
        hessian, spread = study.fisher_credibility, study.propagated_credibility
        inverse[name], propagated[name] = inclination_of(hessian), inclination_of(spread)
        anees = anees_of(hessian)
        credible[name] = same(inverse[name], DECIBELS) and same(anees, ANEES)
        numbers |= {
            f"I2 of the inverse Hessian, {name} (dB)": inverse[name],
            f"ANEES of the inverse Hessian, {name}": telling(anees, name in ("likelihood", "sum")),
            f"I2 of the propagated covariance, {name} (dB)": propagated[name],
            f"ANEES of the propagated covariance, {name}": anees_of(spread),
        }
    layouts = over_layouts("likelihood")
    low, high, mean = min(layouts), max(layouts), mean_of(layouts)
    numbers["mean ANEES of the inverse Hessian on random layouts, likelihood"] = mean
    numbers["lowest ANEES of the inverse Hessian on random layouts, likelihood"] = low
    numbers["highest ANEES of the inverse Hessian on random layouts, likelihood"] = high
    likely = credible["likelihood"] and credible["robust likelihood"] and same(mean, ANEES)
    return Evidence(
        judge(confirmed=likely and credible["sum"], qualified=likely),
        "for the D2D likelihood of targets that stand apart I2 is "
        f"{inverse['likelihood']:+.2f} dB with the inverse Hessian and "
        f"{propagated['likelihood']:+.2f} dB with the propagated covariance, for the robust one "
        f"{inverse['robust likelihood']:+.2f} dB and {propagated['robust likelihood']:+.2f} dB. "
        "The sum has the noise in its cost too, and its inverse Hessian is "
        f"{times_off(inverse['sum'])}; that of P2D, whose cost has the noise of one set only, "
        f"is {times_off(inverse['P2D likelihood'])}, and propagation brings I2 to "
        f"{propagated['P2D likelihood']:+.2f} dB.",
        numbers,
        holds=f"For the D2D likelihood of targets that stand apart, whose I2 is "
        f"{inverse['likelihood']:+.2f} dB, and for the robust one with "
        f"{inverse['robust likelihood']:+.2f} dB; on {len(layouts)} random layouts the ANEES lies "
        f"between {low:.2f} and {high:.2f}.",
        over=f"{RUNS} draws of the noise of the overlapped scene, and 1000 on each of "
        f"{len(layouts)} random layouts, all started at the truth",
    )


@claim("summing-not-gaussian", section="5.2", figure="covariance-credibility")
def summing_not_gaussian() -> Evidence:
    """The likelihood violates no Gaussian assumption, and the summing does."""
    numbers: dict[str, float] = {}
    shape: dict[str, Shape] = {}
    quadratic: dict[str, Measured] = {}
    passed: dict[str, int] = {}
    for name in ("likelihood", "sum"):
        found = shape[name] = shape_of(covariance_study(name).errors)
        ratios = quadratic_ratios(name, 2.0)
        quadratic[name] = median_of(ratios)
        numbers |= {
            f"Mardia's kurtosis of the errors over that of a Gaussian, {name}": telling(
                found.kurtosis, name == "sum"
            ),
            f"root of Mardia's skewness of the errors, {name}": found.skewness,
            f"distance of their Mahalanobis distances from chi-square, {name}": found.distance,
            f"cost at 2 stated deviations over its quadratic model, {name}": telling(
                quadratic[name], name == "sum"
            ),
        }
        tests = (
            same(found.kurtosis, RATIO),
            found.distance.high < SHARE.high,
            same(quadratic[name], RATIO),
        )
        passed[name] = sum(tests)
    likely, summed = passed["likelihood"] == len(tests), passed["sum"] == len(tests)
    return Evidence(
        judge(confirmed=likely and not summed, qualified=likely or not summed),
        "at two stated standard deviations from the optimum the negative log-likelihood of "
        f"targets that stand apart is {quadratic['likelihood']:.2f} times its quadratic model, and "
        f"the sum's logarithm {quadratic['sum']:.2f} times. The errors, divided by the root of "
        f"their own covariance, have {shape['likelihood'].kurtosis:.2f} times the kurtosis of a "
        f"Gaussian with the likelihood and {shape['sum'].kurtosis:.2f} times with the sum; "
        "their Mahalanobis distances differ from chi-square by up to "
        f"{shape['likelihood'].distance:.3f} and {shape['sum'].distance:.3f}: the sum's "
        "errors have longer tails.",
        numbers,
        holds=f"For the likelihood, which passes {passed['likelihood']} of the {len(tests)} tests "
        "of shape (kurtosis and distances of the whitened errors, quadratic cost); the sum passes "
        f"{passed['sum']}.",
        over=f"{RUNS} draws of the noise of the overlapped scene, started at the truth; 500 for "
        "the cost",
    )
