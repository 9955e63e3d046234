"""Claims of thesis section 6.4: the indices of credibility."""

import numpy as np
from numpy.typing import NDArray

from d2d._types import Array
from d2d.study.book.claim import SHARE, Evidence, claim
from d2d.study.book.measured import bootstrapped, complement
from d2d.study.plane.evaluation import COSTS, LayoutStudy, over_layouts
from d2d.study.plane.scenarios import LAYOUTS

LAYOUTS_OF_A_KIND, RUNS = 50, 200
REGION = 0.95  # probability content of the regions that an estimate claims


def conditions() -> list[LayoutStudy]:
    """Every cost on random layouts of every kind of scene."""
    return [
        over_layouts(kind, cost, layouts=LAYOUTS_OF_A_KIND, runs=RUNS)
        for kind in LAYOUTS
        for cost in COSTS.values()
    ]


def recognised(index: Array, dangerous: NDArray[np.bool_]) -> float:
    """Share of conditions (N,) that the best limit on an index, upper or lower, sorts right."""
    kinds = np.sort(index[dangerous]), np.sort(index[~dangerous])
    low, harmless = (
        np.searchsorted(each, index, side="right") / max(len(each), 1) for each in kinds
    )
    return 0.5 + 0.5 * float(np.abs(low - harmless).max())


@claim("nci-not-enough", section="6.4", lines="1467", figure="overlap-credibility")
def nci_not_enough(ev: Evidence) -> None:
    """The NCI is not enough to evaluate the estimation, especially if the true covariance is
    unknown.
    """
    studies = conditions()
    nci, inclination, coverage = (
        np.stack([getattr(each, name) for each in studies], axis=-1)
        for name in ("nci", "inclination", "coverage")
    )
    dangerous = coverage < REGION - SHARE.high

    def best(index: Array, wrong: NDArray[np.bool_]) -> float:
        return recognised(index.ravel(), wrong.ravel())

    def median_where(index: Array, chosen: NDArray[np.bool_]) -> float:
        return float(np.median(index[chosen]))

    product = np.array([name != "summing" for _ in LAYOUTS for name in COSTS])
    by_nci = bootstrapped(best, nci, dangerous)
    of_product = bootstrapped(best, nci[:, product], dangerous[:, product])
    misses = ev.part("it does not recognise all", SHARE.larger)
    misses.headline("share not recognised by the NCI", complement(by_nci))
    misses.headline("share not recognised by the NCI, without the sum", complement(of_product))
    ev("share recognised by I²", bootstrapped(best, inclination, dangerous))
    ev("share of conditions that are dangerous", bootstrapped(np.mean, dangerous))
    ev("median NCI of the dangerous (dB)", bootstrapped(median_where, nci, dangerous))
    ev("median NCI of the others (dB)", bootstrapped(median_where, nci, ~dangerous))
    ev.conclude(
        f"of {dangerous.size} conditions those are dangerous whose 95% regions contain less than "
        f"{REGION - SHARE.high:.0%} of the errors. The best limit on the NCI sorts {by_nci:.0%} of "
        f"both kinds rightly (guessing {0.5:.0%}): the NCI has no sign, and the sum's harmless "
        "regions, too large, have one as high as regions that are too small. Either index needs "
        "the true errors.",
        holds="Where covariances occur that are too large, as the sum's are, beside such that are "
        f"too small; without the sum the NCI sorts {of_product:.0%} rightly.",
        over=f"{len(studies)} conditions, three costs in four kinds of scene, each on "
        f"{LAYOUTS_OF_A_KIND} random layouts with {RUNS} draws",
    )
