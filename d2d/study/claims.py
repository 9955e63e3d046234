"""Every claim of the thesis with the check that judges it: ``CLAIMS[id].check()``."""

from d2d.study.book.claim import Claim, Evidence, claims_of, judge
from d2d.study.book.ledger import PageClaims, page_claims
from d2d.study.book.record import read_record
from d2d.study.drives import claims as drives
from d2d.study.estimation import claims as estimation
from d2d.study.line.claims import clusters as line_clusters
from d2d.study.line.claims import outliers as line_outliers
from d2d.study.line.claims import surfaces
from d2d.study.mixtures import claims as mixtures
from d2d.study.plane.claims import clusters, combined, indices, outliers, overlapped
from d2d.study.point_sets import claims as point_sets

CHAPTERS_2_TO_5 = (mixtures, point_sets, surfaces, line_outliers, line_clusters, estimation)
CHAPTERS_6_AND_7 = (overlapped, outliers, clusters, combined, indices, drives)
CLAIMS: dict[str, Claim] = claims_of(CHAPTERS_2_TO_5 + CHAPTERS_6_AND_7)


def claims_on(page: str) -> PageClaims:
    """The claims that a page, such as "b_icp_and_the_ndt", settles, as on record; ends the page."""
    return page_claims(page, CLAIMS.values(), read_record())


__all__ = ["CLAIMS", "Claim", "Evidence", "claims_of", "claims_on", "judge"]
