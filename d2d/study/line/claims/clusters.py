"""Claims of thesis section 4.5: clusters on the line."""

from typing import NamedTuple

import numpy as np

from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.study.book.claim import (
    ANEES,
    RATIO,
    Evidence,
    claim,
    hardly_any,
    judge,
    most,
    nearly_all,
    same,
    smaller,
)
from d2d.study.book.measured import (
    Measured,
    bootstrapped,
    mean_of,
    median_of,
    rms_of,
    rms_ratio,
    share_of,
    telling,
)
from d2d.study.line.cluster_study import (
    ESTIMATES,
    NEAR,
    SEARCHED,
    SPACINGS,
    Spread,
    cluster_sweep,
    spread,
)
from d2d.study.line.outlier_study import LIKELIHOOD, SUMMING

TIGHT = 1.0  # standard deviations between neighbours, or less
OVER = (
    f"{ESTIMATES} draws of the noise for each of {len(SPACINGS)} spacings of the cluster on the "
    f"line, {SEARCHED} of them searched for maxima"
)


@claim("tight-cluster-certain", section="4.5", figure="cluster-tight-cost")
def tight_cluster_certain() -> Evidence:
    """Very close targets act as one and make the peak more certain."""
    likelihood, summing = _effect_of_tight_cluster(LIKELIHOOD), _effect_of_tight_cluster(SUMMING)
    several = max(share for at, share in _several(SUMMING).items() if at <= TIGHT)
    effects = {"the likelihood": likelihood, "the sum": summing}
    certain = [name for name, effect in effects.items() if smaller(effect.stated_ratio, RATIO)]
    more_accurate = smaller(likelihood.error_ratio, RATIO)
    return Evidence(
        judge(
            confirmed=len(certain) == 2 and hardly_any(several) and more_accurate,
            qualified=bool(certain) and more_accurate,
        ),
        f"the likelihood states a standard deviation of {likelihood.stated_without:.2f} sigma "
        f"without the cluster and up to {likelihood.stated:.2f} sigma with it (spacings up to "
        f"{TIGHT:g} sigma), at a root mean square error of {likelihood.error_without:.2f} and up "
        f"to {likelihood.error:.2f} sigma. The sum states {summing.stated_without:.2f} and up to "
        f"{summing.stated:.2f} sigma, at an error of {summing.error_without:.2f} and up to "
        f"{summing.error:.2f} sigma: its inverse curvature is that of an average target, which the "
        "cluster's own spread widens.",
        _numbers("likelihood", likelihood) | _numbers("sum", summing),
        holds=f"For {' and '.join(certain) or 'the error alone'}. With the cluster the sum's error "
        f"is up to {summing.error_ratio:.2f} times and its stated standard deviation up to "
        f"{summing.stated_ratio:.2f} times that without it.",
        over=OVER,
    )


class _Effect(NamedTuple):
    """What a tight cluster does to one cost: the maxima over its spacings, in sigma and as ratios.

    Each ratio is that to the three targets without a cluster.
    """

    stated_without: Measured
    stated: Measured
    stated_ratio: Measured
    error_without: Measured
    error: Measured
    error_ratio: Measured


def _effect_of_tight_cluster(cost: RegistrationCost) -> _Effect:
    without = spread(cost, None)
    tight = [spread(cost, spacing) for spacing in SPACINGS if spacing <= TIGHT]
    stated_ratio = max(
        bootstrapped(lambda a, b: np.median(a) / np.median(b), *_paired(each, without, "stated"))
        for each in tight
    )
    error_ratio = max(rms_ratio(*_paired(each, without, "errors")) for each in tight)
    return _Effect(
        median_of(without.stated),
        max(median_of(each.stated) for each in tight),
        stated_ratio,
        rms_of(without.errors),
        max(rms_of(each.errors) for each in tight),
        error_ratio,
    )


def _paired(over: Spread, under: Spread, field: str) -> tuple[Array, Array]:
    """That field of both, cut to the same number of draws; the draws are independent."""
    first, second = getattr(over, field), getattr(under, field)
    count = min(len(first), len(second))
    return first[:count], second[:count]


def _several(cost: RegistrationCost) -> dict[float, Measured]:
    """Share of draws with several maxima near the truth, by the spacing in sigma."""
    counts = dict(zip(SPACINGS, cluster_sweep(cost).maxima, strict=True))
    return {at: share_of(each > 1) for at, each in counts.items()}


def _numbers(name: str, effect: _Effect) -> dict[str, float]:
    within = f"spacings up to {TIGHT:g} sigma"
    return {
        f"stated standard deviation without the cluster, {name} (sigma)": effect.stated_without,
        f"maximum stated standard deviation with it, {within}, {name} (sigma)": effect.stated,
        f"ratio of the stated standard deviations, with / without, {name}": telling(
            effect.stated_ratio
        ),
        f"root mean square error without the cluster, {name} (sigma)": effect.error_without,
        f"maximum root mean square error with it, {within}, {name} (sigma)": effect.error,
        f"ratio of the root mean square errors, with / without, {name}": effect.error_ratio,
    }


@claim("loose-cluster-summing", section="4.5", figure="cluster-loose-cost")
def loose_cluster_summing() -> Evidence:
    """Close targets add local peaks beside the global one to the sum."""
    several = _several(SUMMING)
    several_if_loose = min(share for at, share in several.items() if 4.0 <= at <= 6.0)
    what = f"share of draws with several maxima within {NEAR:g} m"
    return Evidence(
        judge(confirmed=nearly_all(several_if_loose), qualified=most(several_if_loose)),
        "neighbours that meet each other's partners add peaks one and two spacings away, which "
        "without noise separate at a spacing of 2 sqrt(2) sigma. Several maxima lie within "
        f"{NEAR:g} m of the truth in {several[2.0]:.0%} of the draws at 2 sigma, in "
        f"{several[3.0]:.0%} at 3 sigma and in at least {several_if_loose:.1%} at 4 to 6 sigma.",
        {
            f"{what}, spacing 1 sigma": several[1.0],
            f"{what}, spacing 2 sigma": telling(several[2.0]),
            f"{what}, spacing 3 sigma": several[3.0],
            f"{what}, minimum over spacings of 4 to 6 sigma": telling(several_if_loose),
            f"mean number of maxima within {NEAR:g} m, spacing 5 sigma": mean_of(
                cluster_sweep(SUMMING).maxima[SPACINGS.index(5.0)]
            ),
        },
        holds="At spacings of 4 to 6 sigma, with several maxima in at least "
        f"{several_if_loose:.1%} of the draws; at 2 sigma there are several in {several[2.0]:.0%}.",
        over=OVER,
    )


@claim("loose-cluster-likelihood", section="4.5", figure="cluster-sweep")
def loose_cluster_likelihood() -> Evidence:
    """Close targets do not disturb the likelihood."""
    loose = [at for at in SPACINGS if 3.0 <= at <= 6.0]
    several = max(_several(LIKELIHOOD)[at] for at in loose)
    single = Measured(1.0 - several, 1.0 - several.high, 1.0 - several.low)
    anees = {at: mean_of(spread(LIKELIHOOD, at).nees) for at in SPACINGS}
    largest = max(anees[at] for at in loose)
    largest_outside = max(anees[at] for at in SPACINGS if at not in loose)
    error = max(rms_of(spread(LIKELIHOOD, at).errors) for at in SPACINGS)
    error_without = rms_of(spread(LIKELIHOOD, None).errors)
    return Evidence(
        judge(confirmed=nearly_all(single) and same(largest, ANEES), qualified=most(single)),
        f"between 3 and 6 sigma the likelihood has one maximum within {NEAR:g} m in at least "
        f"{single:.1%} of the draws, but noise can make a target side with the wrong neighbour, "
        f"which the inverse Hessian does not account for. The ANEES is up to {largest:.2f} there, "
        f"{anees[1.0]:.2f} at 1 sigma and {anees[10.0]:.2f} at 10 sigma.",
        {
            f"share of draws with one maximum within {NEAR:g} m, "
            "minimum over spacings of 3 to 6 sigma": telling(single),
            "ANEES at a spacing of 0": anees[0.0],
            "ANEES at a spacing of 1 sigma": anees[1.0],
            "ANEES at a spacing of 5 sigma": anees[5.0],
            "ANEES at a spacing of 10 sigma": anees[10.0],
            "maximum ANEES over spacings of 3 to 6 sigma": telling(largest),
            "maximum ANEES over all other spacings": largest_outside,
            "maximum root mean square error over all spacings (sigma)": error,
            "root mean square error without the cluster (sigma)": error_without,
        },
        holds=f"For the place of the peak, whose error is at most {error:.2f} sigma over all "
        f"spacings, {error_without:.2f} sigma without the cluster; for the covariance only "
        f"outside 3 to 6 sigma, where the ANEES is up to {largest_outside:.2f} instead of "
        f"{largest:.2f}.",
        over=OVER,
    )
