"""Every claim of the thesis with the check that judges it: ``CLAIMS[id].check()``."""

from d2d.study.book.claim import Claim, Evidence, claims_of, judge
from d2d.study.book.record import show
from d2d.study.drives import claims as drives
from d2d.study.estimation import claims as estimation
from d2d.study.line.claims import clusters as line_clusters
from d2d.study.line.claims import outliers as line_outliers
from d2d.study.line.claims import surfaces
from d2d.study.mixtures import claims as mixtures
from d2d.study.plane.claims import clusters, combined, indices, outliers, overlapped
from d2d.study.point_sets import claims as point_sets

CLAIMS: dict[str, Claim] = claims_of(
    (
        mixtures,
        point_sets,
        surfaces,
        line_outliers,
        line_clusters,
        estimation,
        overlapped,
        outliers,
        clusters,
        combined,
        indices,
        drives,
    )
)

__all__ = ["CLAIMS", "Claim", "Evidence", "claims_of", "judge", "show"]
