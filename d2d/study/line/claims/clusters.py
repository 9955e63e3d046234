"""Claims of thesis section 4.5: clusters on the line."""

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
    act_as_one = ev.part("they act as one", nearly_all)
    likelihood_more_certain = ev.part("the likelihood gets more certain", RATIO.smaller)
    sum_more_certain = ev.part("the sum gets more certain", RATIO.smaller)
    one = _single(SUMMING, *(at for at in SPACINGS if at <= TIGHT))
    act_as_one(f"minimum share of draws with one maximum within {NEAR:g} m, {WITHIN}, sum", one)
    _add_effect(ev, likelihood_more_certain, "likelihood", LIKELIHOOD)
    grown = _add_effect(ev, sum_more_certain, "sum", SUMMING)
    ev.conclude(
        "the errors of both become smaller. The inverse curvature of the sum is that of an average "
        f"target, which the cluster's own spread widens, to {grown:.2f} times that without it.",
        holds=f"In most draws: the sum has one maximum there in {one:.1%} or more.",
        over=OVER,
    )


def _add_effect(ev: Evidence, more_certain: Part, name: str, cost: RegistrationCost) -> Measured:
    """Add what a tight cluster changes with one cost; return the ratio that judges the part."""
    without = spread(cost, None)
    tight = [spread(cost, spacing) for spacing in SPACINGS if spacing <= TIGHT]
    with_it, ratio = f"with it, {WITHIN}, {name} (sigma)", f"with / without, {name}"
    stated, error = "stated standard deviation", "root mean square error"
    ev(f"{stated} without the cluster, {name} (sigma)", median_of(without.stated))
    widest = largest(median_of, *((each.stated,) for each in tight))
    ev(f"maximum {stated} {with_it}", widest)
    ratios = largest(_ratio_of_medians, *(_paired(each, without, "stated") for each in tight))
    more_certain.headline(f"maximum ratio of the {stated}s, {ratio}", ratios)
    ev(f"{error} without the cluster, {name} (sigma)", rms_of(without.errors))
    ev(f"maximum {error} {with_it}", largest(rms_of, *((each.errors,) for each in tight)))
    of_errors = largest(rms_ratio, *(_paired(each, without, "errors") for each in tight))
    ev(f"maximum ratio of the {error}s, {ratio}", of_errors)
    return ratios


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


def _maxima(cost: RegistrationCost, spacing: float) -> Array:
    """Number of maxima near the truth in each draw, at a spacing in sigma."""
    return np.asarray(cluster_sweep(cost).maxima[SPACINGS.index(spacing)])


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
    for spacing in (1.0, 2.0):
        ev(f"{what}, spacing {spacing:g} sigma", several[spacing])
    gets_peaks.headline(f"{what}, minimum over {APART}", if_loose, under=if_apart)
    ev.headline(f"{what}, minimum over spacings of 4 to 6 sigma", if_apart, nearly_all)
    ev(f"mean number of maxima within {NEAR:g} m, spacing 5 sigma", mean_of(_maxima(SUMMING, 5.0)))
    ev.conclude(
        "neighbours that meet each other's partners add peaks one and two spacings away, which "
        "without noise separate at a spacing of 3.7 sigma.",
        holds=f"At spacings of 4 to 6 sigma; at 3 sigma there are several in {several[3.0]:.0%}.",
        over=OVER,
    )


@claim("loose-cluster-likelihood", section="4.5", lines="853, 870", figure="cluster-sweep")
def loose_cluster_likelihood(ev: Evidence) -> None:
    """Close targets that do not quite overlap do not influence the likelihood."""
    without = spread(LIKELIHOOD, None)
    nees = {at: spread(LIKELIHOOD, at).nees for at in SPACINGS}
    keeps_one = ev.part("it keeps one peak", nearly_all)
    no_larger = ev.part("its error does not grow", RATIO.no_larger)
    single = _single(LIKELIHOOD, *LOOSE)
    keeps_one.headline(
        f"share of draws with one maximum within {NEAR:g} m, minimum over {APART}", single
    )
    no_larger.headline(
        f"maximum ratio of the root mean square errors, with / without, {APART}",
        largest(rms_ratio, *(_paired(spread(LIKELIHOOD, at), without, "errors") for at in LOOSE)),
    )
    for spacing, unit in ((0.0, ""), (1.0, " sigma"), (5.0, " sigma"), (10.0, " sigma")):
        ev(f"ANEES at a spacing of {spacing:g}{unit}", mean_of(nees[spacing]))
    highest = largest(mean_of, *((nees[at],) for at in LOOSE))
    ev(f"maximum ANEES over {APART}", highest)
    others = ((nees[at],) for at in SPACINGS if at not in LOOSE)
    ev("maximum ANEES over all other spacings", largest(mean_of, *others))
    ev("root mean square error without the cluster (sigma)", rms_of(without.errors))
    ev.conclude(
        "noise can make a target side with the wrong neighbour, which the inverse Hessian does not "
        f"account for: the ANEES is up to {highest:.2f}.",
        holds=f"For the error; there is one maximum in at least {single:.1%} of the draws.",
        over=OVER,
    )
