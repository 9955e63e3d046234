"""Claims of thesis section 4.5: clusters on the line."""

from typing import NamedTuple

import numpy as np

from d2d.cost import RegistrationCost
from d2d.study.book.claim import Evidence, claim, judge
from d2d.study.line.cluster_study import ESTIMATES, NEAR, SPACINGS, cluster_sweep, without_cluster
from d2d.study.line.outlier_study import LIKELIHOOD, SUMMING

TIGHT = 1.0  # standard deviations between neighbours, or less


@claim(
    "tight-cluster-certain",
    section="4.5",
    figure="cluster-tight-cost",
    telling=(
        "claimed standard deviation without the cluster, likelihood (sigma)",
        "maximum claimed standard deviation with it, spacings up to 1 sigma, likelihood (sigma)",
    ),
)
def tight_cluster_certain() -> Evidence:
    """Very close targets act as one and make the peak more certain."""
    likelihood, summing = _effect_of_tight_cluster(LIKELIHOOD), _effect_of_tight_cluster(SUMMING)
    several = cluster_sweep(SUMMING).several[np.array(SPACINGS) <= TIGHT].max()
    more_certain = likelihood.more_certain and summing.more_certain
    acts_as_one = several < 0.05
    certain = [
        name
        for name, effect in (("the likelihood", likelihood), ("the sum", summing))
        if effect.more_certain
    ]
    return Evidence(
        judge(
            confirmed=more_certain and acts_as_one and likelihood.more_accurate,
            qualified=likelihood.more_accurate,
        ),
        f"the likelihood claims a standard deviation of {likelihood.claimed_without:.2f} sigma "
        f"without the cluster and up to {likelihood.claimed:.2f} sigma with it (spacings up to "
        f"{TIGHT:g} sigma), at a root mean square error of {likelihood.error_without:.2f} and up "
        f"to {likelihood.error:.2f} sigma. The sum claims {summing.claimed_without:.2f} and up to "
        f"{summing.claimed:.2f} sigma, at an error of {summing.error_without:.2f} and up to "
        f"{summing.error:.2f} sigma: its inverse curvature is that of an average target, which the "
        "cluster's own spread widens.",
        _numbers("likelihood", likelihood) | _numbers("sum", summing),
        holds=f"For {' and '.join(certain) or 'the error alone'}. With the cluster the sum's error "
        f"is up to {summing.error / summing.error_without:.2f} times and its claimed standard "
        f"deviation up to {summing.claimed / summing.claimed_without:.2f} times that without it.",
    )


class _Effect(NamedTuple):
    """What a tight cluster does to one cost, in sigma: without it, and the maximum with it."""

    claimed_without: float
    claimed: float
    error_without: float
    error: float

    @property
    def more_certain(self) -> bool:
        return self.claimed < self.claimed_without

    @property
    def more_accurate(self) -> bool:
        return self.error < self.error_without


def _effect_of_tight_cluster(cost: RegistrationCost) -> _Effect:
    sweep, (claimed, error) = cluster_sweep(cost), without_cluster(cost)
    tight = np.array(SPACINGS) <= TIGHT
    return _Effect(
        claimed, float(sweep.claimed[tight].max()), error, float(sweep.actual[tight].max())
    )


def _numbers(name: str, effect: _Effect) -> dict[str, float]:
    within = f"spacings up to {TIGHT:g} sigma"
    return {
        f"claimed standard deviation without the cluster, {name} (sigma)": effect.claimed_without,
        f"maximum claimed standard deviation with it, {within}, {name} (sigma)": effect.claimed,
        f"root mean square error without the cluster, {name} (sigma)": effect.error_without,
        f"maximum root mean square error with it, {within}, {name} (sigma)": effect.error,
    }


@claim(
    "loose-cluster-summing",
    section="4.5",
    figure="cluster-loose-cost",
    telling=(
        "share of draws with several maxima within 1.75 m, spacing 2 sigma",
        "share of draws with several maxima within 1.75 m, minimum over spacings of 4 to 6 sigma",
    ),
)
def loose_cluster_summing() -> Evidence:
    """Close targets add local peaks beside the global one to the sum."""
    sweep = cluster_sweep(SUMMING)
    spacing = np.array(SPACINGS)
    several = dict(zip(SPACINGS, map(float, sweep.several), strict=True))
    near = dict(zip(SPACINGS, map(float, sweep.near), strict=True))
    loose = (spacing >= 4.0) & (spacing <= 6.0)
    several_if_loose = float(sweep.several[loose].min())
    what = f"share of draws with several maxima within {NEAR:g} m"
    return Evidence(
        judge(confirmed=several_if_loose > 0.95, qualified=several_if_loose > 0.5),
        "neighbours that meet each other's partners add peaks one and two spacings away, which "
        "without noise separate at a spacing of 2 sqrt(2) sigma. Several maxima lie within "
        f"{NEAR:g} m of the truth in {several[2.0]:.0%} of the draws at 2 sigma, in "
        f"{several[3.0]:.0%} at 3 sigma and in at least {several_if_loose:.1%} at 4 to 6 sigma.",
        {
            f"{what}, spacing 1 sigma": several[1.0],
            f"{what}, spacing 2 sigma": several[2.0],
            f"{what}, spacing 3 sigma": several[3.0],
            f"{what}, minimum over spacings of 4 to 6 sigma": several_if_loose,
            f"mean number of maxima within {NEAR:g} m, spacing 5 sigma": near[5.0],
        },
        holds="At spacings of 4 to 6 sigma, with several maxima in at least "
        f"{several_if_loose:.1%} of the draws; at 2 sigma there are several in {several[2.0]:.0%}.",
    )


@claim(
    "loose-cluster-likelihood",
    section="4.5",
    figure="cluster-sweep",
    telling=(
        "share of draws with one maximum within 1.75 m, minimum over spacings of 3 to 6 sigma",
        "maximum ANEES over spacings of 3 to 6 sigma",
    ),
)
def loose_cluster_likelihood() -> Evidence:
    """Close targets do not disturb the likelihood."""
    sweep = cluster_sweep(LIKELIHOOD)
    spacing = np.array(SPACINGS)
    anees = dict(zip(SPACINGS, map(float, sweep.anees), strict=True))
    loose = (spacing >= 3.0) & (spacing <= 6.0)
    single = 1.0 - float(sweep.several[loose].max())
    largest, largest_outside = sweep.anees[loose].max(), sweep.anees[~loose].max()
    credible = 1.0 + 3.0 * np.sqrt(2.0 / ESTIMATES)  # three standard errors above an ideal ANEES
    return Evidence(
        judge(confirmed=single > 0.95 and largest < credible, qualified=single > 0.75),
        f"between 3 and 6 sigma the likelihood has one maximum within {NEAR:g} m in at least "
        f"{single:.1%} of the draws, but noise can make a target side with the wrong neighbour, "
        f"which the inverse Hessian does not account for. The ANEES is up to {largest:.2f} there, "
        f"{anees[1.0]:.2f} at 1 sigma and {anees[10.0]:.2f} at 10 sigma.",
        {
            f"share of draws with one maximum within {NEAR:g} m, "
            "minimum over spacings of 3 to 6 sigma": single,
            "ANEES at a spacing of 0": anees[0.0],
            "ANEES at a spacing of 1 sigma": anees[1.0],
            "ANEES at a spacing of 5 sigma": anees[5.0],
            "ANEES at a spacing of 10 sigma": anees[10.0],
            "maximum ANEES over spacings of 3 to 6 sigma": float(largest),
        },
        holds="For the place of the peak, whose error is at most "
        f"{sweep.actual.max():.2f} sigma over all spacings, "
        f"{without_cluster(LIKELIHOOD)[1]:.2f} sigma without the cluster; for the covariance only "
        f"outside 3 to 6 sigma, where the ANEES is up to {largest_outside:.2f} instead of "
        f"{largest:.2f}.",
    )
