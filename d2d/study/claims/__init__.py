"""Every claim of the thesis with the check that judges it: ``CLAIMS[id].check()``."""

from d2d.study.claims import (
    cost_surfaces,
    credibility,
    estimation,
    gaussian,
    outliers,
    point_sets,
    radar,
)
from d2d.study.claims.base import Claim, Evidence, Verdict, show

CLAIMS: dict[str, Claim] = {
    claim.id: claim
    for claim in (
        *gaussian.CLAIMS,
        *point_sets.CLAIMS,
        *cost_surfaces.CLAIMS,
        *outliers.CLAIMS,
        *estimation.CLAIMS,
        *credibility.CLAIMS,
        *radar.CLAIMS,
    )
}

__all__ = ["CLAIMS", "Claim", "Evidence", "Verdict", "show"]
