"""The figures of the thesis, and where this book redraws each of them."""

import csv
from dataclasses import dataclass
from importlib.resources import files

PAGES = {
    "2": "02_gaussian_background",
    "3": "b_icp_and_the_ndt",
    "4": "04_cost_surfaces_1d",
    "4.4": "05_outliers_and_clusters_1d",
    "4.5": "05_outliers_and_clusters_1d",
    "5": "08_covariance",
    "5.1": "06_finding_the_optimum",
    "6": "09_credibility_2d",
    "6.3 outlier": "10_outliers_and_clusters_2d",
    "6.3 cluster": "10_outliers_and_clusters_2d",
    "6.3 all": "10_outliers_and_clusters_2d",
    "6.4": "10_outliers_and_clusters_2d",
    "7": "12_radar_ego_motion",
    "7.3": "13_the_whole_drive",
    **dict.fromkeys(
        ("overlap-map", "outlier-map", "cluster-map", "all-map"), "d_panels_and_readings"
    ),
    "scene-2d": "03_what_a_radar_gives_you",
    "cluster-sweep": "07_credibility",
    "em-starts": "a_em_in_detail",
}
"""The page on each chapter of the thesis, or on each section where two pages share a chapter.

Where two pages share a section, its scenes have a page of their own: "6.3 outlier" has the figures
and claims of section 6.3 whose ids begin with "outlier-".  Figures that stand elsewhere follow by
their ids.
"""


def page_of(section: str, id: str = "") -> str:
    """The page on a section of the thesis, with a figure or claim ``id``, else ``ValueError``."""
    named = (id, f"{section} {id.split('-')[0]}", section, section.split(".")[0])
    page = next((PAGES[name] for name in named if name in PAGES), None)
    if page is None:
        raise ValueError(f"section: no page treats thesis section {section!r}")
    return page


@dataclass(frozen=True)
class ThesisFigure:
    """One figure of the thesis; ours is labelled ``fig-<id>``."""

    id: str
    number: str  # that of the thesis's LaTeX source
    section: str  # the chapter's number if it precedes the first section
    shows: str  # in our words

    @property
    def page(self) -> str:
        """The page of the book that shows it."""
        return page_of(self.section, self.id)


_TABLE = (files("d2d.study.book") / "thesis_figures.csv").read_text(encoding="utf-8")
FIGURES = tuple(ThesisFigure(**row) for row in csv.DictReader(_TABLE.splitlines()))
