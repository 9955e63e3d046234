"""Claims of thesis section 4.5: clusters on the line."""

from typing import NamedTuple

import numpy as np

from d2d._types import Array
from d2d.cost import RegistrationCost
from d2d.study.book.claim import RATIO, Evidence, Part, claim, nearly_all
from d2d.study.book.measured import (
    Measured,
    bootstrapped,
    complement,
    largest,
    mean_of,
    median_of,
    rms_of,
    rms_ratio,
    share_of,
    smallest,
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

TIGHT = 1.0  # standard deviations between neighbours, or less: "very closed"
LOOSE = tuple(at for at in SPACINGS if 3.0 <= at <= 6.0)  # "closed": their peaks stand apart
WITHIN, APART = f"spacings up to {TIGHT:g} sigma", "spacings of 3 to 6 sigma"
OVER = (
    f"{ESTIMATES} draws of the noise for each of {len(SPACINGS)} spacings of the cluster on the "
    f"line, {SEARCHED} of them searched for maxima"
)


@claim("tight-cluster-certain", section="4.5", lines="853, 860", figure="cluster-tight-cost")
def tight_cluster_certain(ev: Evidence) -> None:
    """Very close targets act as one component with a big impact; the global peak of the sum and of
    the likelihood "gets more certain about the motion state".
    """
    likelihood, summing = _effect_of_tight_cluster(LIKELIHOOD), _effect_of_tight_cluster(SUMMING)
    one = _single(SUMMING, *(at for at in SPACINGS if at <= TIGHT))
    act_as_one = ev.part("they act as one", nearly_all)
    likelihood_more_certain = ev.part("the likelihood gets more certain", RATIO.smaller)
    sum_more_certain = ev.part("the sum gets more certain", RATIO.smaller)
    act_as_one(f"minimum share of draws with one maximum within {NEAR:g} m, {WITHIN}, sum", one)
    _add_effect(ev, likelihood_more_certain, "likelihood", likelihood)
    _add_effect(ev, sum_more_certain, "sum", summing)
    ev.conclude(
        f"the likelihood states a standard deviation of {likelihood.stated_without:.2f} sigma "
        f"without the cluster and up to {likelihood.stated:.2f} sigma with it ({WITHIN}), at a "
        f"root mean square error of {likelihood.error_without:.2f} and up to "
        f"{likelihood.error:.2f} sigma. The sum states {summing.stated_without:.2f} and up to "
        f"{summing.stated:.2f} sigma, at an error of {summing.error_without:.2f} and up to "
        f"{summing.error:.2f} sigma: its inverse curvature is that of an average target, which the "
        "cluster's own spread widens.",
        holds=f"In most draws: the sum has one maximum there in {one:.1%} or more. The errors of "
        "both become smaller, the sum's too, only its stated standard deviation is up to "
        f"{summing.stated_ratio:.2f} times that without the cluster.",
        over=OVER,
    )


class _Effect(NamedTuple):
    """Effect of a tight cluster on one cost: maxima over its spacings, in sigma and as ratios.

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
    return _Effect(
        median_of(without.stated),
        largest(median_of, *((each.stated,) for each in tight)),
        largest(_ratio_of_medians, *(_paired(each, without, "stated") for each in tight)),
        rms_of(without.errors),
        largest(rms_of, *((each.errors,) for each in tight)),
        largest(rms_ratio, *(_paired(each, without, "errors") for each in tight)),
    )


def _ratio_of_medians(over: Array, under: Array, *, comparisons: int = 1) -> Measured:
    return bootstrapped(
        lambda a, b: np.median(a) / np.median(b), over, under, comparisons=comparisons
    )


def _paired(over: Spread, under: Spread, field: str) -> tuple[Array, Array]:
    """Return a field of both, cut to the same number of draws; the draws are independent."""
    first, second = getattr(over, field), getattr(under, field)
    count = min(len(first), len(second))
    return first[:count], second[:count]


def _single(cost: RegistrationCost, *spacings: float) -> Measured:
    """Smallest share of draws with one maximum near the truth, over spacings in sigma."""
    return smallest(share_of, *((_maxima(cost, at) == 1,) for at in spacings))


def _add_effect(ev: Evidence, more_certain: Part, name: str, effect: _Effect) -> None:
    """Add the numbers of a tight cluster's effect on one cost, of which one judges the part."""
    with_it = f"with it, {WITHIN}, {name} (sigma)"
    ev(f"stated standard deviation without the cluster, {name} (sigma)", effect.stated_without)
    ev(f"maximum stated standard deviation {with_it}", effect.stated)
    ratio = "maximum ratio of the stated standard deviations, with / without"
    more_certain.headline(f"{ratio}, {name}", effect.stated_ratio)
    ev(f"root mean square error without the cluster, {name} (sigma)", effect.error_without)
    ev(f"maximum root mean square error {with_it}", effect.error)
    ratio = "maximum ratio of the root mean square errors, with / without"
    ev(f"{ratio}, {name}", effect.error_ratio)


@claim("loose-cluster-summing", section="4.5", lines="853, 870", figure="cluster-loose-cost")
def loose_cluster_summing(ev: Evidence) -> None:
    """Close targets that do not quite overlap add local peaks near the global one to the sum."""
    several = {at: complement(_single(SUMMING, at)) for at in SPACINGS}
    if_loose, if_apart = (
        smallest(share_of, *((_maxima(SUMMING, at) > 1,) for at in spacings))
        for spacings in (LOOSE, LOOSE[1:])
    )
    what = f"share of draws with several maxima within {NEAR:g} m"
    gets_peaks = ev.part("the sum gets local peaks", nearly_all)
    ev(f"{what}, spacing 1 sigma", several[1.0])
    ev(f"{what}, spacing 2 sigma", several[2.0])
    gets_peaks.headline(f"{what}, minimum over {APART}", if_loose, under=if_apart)
    ev.headline(f"{what}, minimum over spacings of 4 to 6 sigma", if_apart, nearly_all)
    ev(f"mean number of maxima within {NEAR:g} m, spacing 5 sigma", mean_of(_maxima(SUMMING, 5.0)))
    ev.conclude(
        "neighbours that meet each other's partners add peaks one and two spacings away, which "
        "without noise separate at a spacing of 3.7 sigma. Several maxima lie within "
        f"{NEAR:g} m of the truth in {several[2.0]:.0%} of the draws at 2 sigma, in "
        f"{several[3.0]:.0%} at 3 sigma and in at least {if_apart:.1%} at 4 to 6 sigma.",
        holds=f"At spacings of 4 to 6 sigma, with several maxima in at least {if_apart:.1%} of the "
        f"draws; at 3 sigma there are several in {several[3.0]:.0%}.",
        over=OVER,
    )


def _maxima(cost: RegistrationCost, spacing: float) -> Array:
    """Number of maxima near the truth in each draw, at a spacing in sigma."""
    return np.asarray(cluster_sweep(cost).maxima[SPACINGS.index(spacing)])


@claim("loose-cluster-likelihood", section="4.5", lines="853, 870", figure="cluster-sweep")
def loose_cluster_likelihood(ev: Evidence) -> None:
    """Close targets that do not quite overlap do not influence the likelihood."""
    single = _single(LIKELIHOOD, *LOOSE)
    without = spread(LIKELIHOOD, None)
    ratio = largest(
        rms_ratio, *(_paired(spread(LIKELIHOOD, at), without, "errors") for at in LOOSE)
    )
    anees = {at: mean_of(spread(LIKELIHOOD, at).nees) for at in SPACINGS}
    highest, highest_outside = (
        largest(mean_of, *((spread(LIKELIHOOD, at).nees,) for at in spacings))
        for spacings in (LOOSE, [at for at in SPACINGS if at not in LOOSE])
    )
    keeps_one = ev.part("it keeps one peak", nearly_all)
    no_larger = ev.part("its error does not grow", RATIO.no_larger)
    keeps_one.headline(
        f"share of draws with one maximum within {NEAR:g} m, minimum over {APART}", single
    )
    no_larger.headline(
        f"maximum ratio of the root mean square errors, with / without, {APART}", ratio
    )
    ev("ANEES at a spacing of 0", anees[0.0])
    for spacing in (1.0, 5.0, 10.0):
        ev(f"ANEES at a spacing of {spacing:g} sigma", anees[spacing])
    ev(f"maximum ANEES over {APART}", highest)
    ev("maximum ANEES over all other spacings", highest_outside)
    ev("root mean square error without the cluster (sigma)", rms_of(without.errors))
    ev.conclude(
        f"between 3 and 6 sigma the likelihood has one maximum within {NEAR:g} m in at least "
        f"{single:.1%} of the draws, and its error is at most {ratio:.2f} times that without the "
        "cluster. Noise can make a target side with the wrong neighbour, which the inverse "
        f"Hessian does not account for: the ANEES is up to {highest:.2f} there, {anees[1.0]:.2f} "
        f"at 1 sigma and {anees[10.0]:.2f} at 10 sigma.",
        holds=f"For the error, which is at most {ratio:.2f} times that without the cluster; there "
        f"is one maximum in at least {single:.1%} of the draws.",
        over=OVER,
    )
