"""The figures of the thesis, and where this book redraws each of them."""

from dataclasses import dataclass

PAGES = {
    "2": "02_gaussian_background",
    "2.3": "02a_mixtures",
    "3": "03_point_set_registration",
    "4.1": "04a_cost_surfaces_1d",
    "4.2": "04a_cost_surfaces_1d",
    "4.3": "04a_cost_surfaces_1d",
    "4.4": "04b_outliers_and_clusters_1d",
    "4.5": "04c_clusters_1d",
    "5": "05_estimation_and_covariance",
    "5.1": "05b_finding_the_optimum",
    "6": "06_credibility_2d",
    "6.3 outlier": "06c_outliers_and_clusters_2d",
    "6.3 cluster": "06c_outliers_and_clusters_2d",
    "6.3 all": "06d_start_and_layout",
    "6.4": "06d_start_and_layout",
    "7": "07_radar_ego_motion",
    "7.3": "07b_the_whole_drive",
}
"""The page on each chapter of the thesis, or on each section where two pages share a chapter.

Where two pages share a section, its scenes have a page of their own: "6.3 outlier" has the figures
and claims of section 6.3 whose ids begin with "outlier-".
"""


def page_of(section: str, id: str = "") -> str:
    """The page (a file of ``chapters/`` without its suffix) on a section of the thesis.

    ``id`` is that of a figure or of a claim of this section.  Raises ``ValueError`` if there is no
    page.
    """
    named = (f"{section} {id.split('-')[0]}", section, section.split(".")[0])
    page = next((PAGES[name] for name in named if name in PAGES), None)
    if page is None:
        raise ValueError(f"section: no page treats thesis section {section!r}")
    return page


@dataclass(frozen=True)
class ThesisFigure:
    """One figure of the thesis; ours is labelled ``fig-<id>``.

    Attributes
    ----------
    id : str
    number : str
        Number in the thesis, as its LaTeX source counts.
    section : str
        Section of the thesis; the chapter's number if the figure precedes its first section.
    shows : str
        What the figure shows, in our words.
    """

    id: str
    number: str
    section: str
    shows: str

    @property
    def page(self) -> str:
        """The page of the book that shows it."""
        return page_of(self.section, self.id)


FIGURES = (
    ThesisFigure(
        "uni-fit",
        "2.1",
        "2.1",
        "samples of one variable with the Gaussian fitted by maximum likelihood",
    ),
    ThesisFigure(
        "uni-parameters",
        "2.2",
        "2.1",
        "the density moves with the mean (a) and spreads with the standard deviation (b)",
    ),
    ThesisFigure(
        "multi-density",
        "2.3",
        "2.2",
        "2D samples with their marginals; the density from above; the density as a surface",
    ),
    ThesisFigure(
        "multi-covariance",
        "2.4",
        "2.2",
        "contours for four covariances: small and large without correlation; negative; positive",
    ),
    ThesisFigure(
        "gmm", "2.5", "2.3", "one Gaussian against two against their mixture on two-humped data"
    ),
    ThesisFigure("em-flow", "2.6", "2.3", "flow chart of EM"),
    ThesisFigure(
        "registration-problem",
        "3.1",
        "3",
        "fixed set F and moving set M and the motion T between them",
    ),
    ThesisFigure("icp-flow", "3.2", "3.1", "flow chart of ICP"),
    ThesisFigure(
        "ndt-scene", "3.3", "3.2", "a synthetic scan before (a) and after (b) a relative motion"
    ),
    ThesisFigure(
        "ndt-cells",
        "3.4",
        "3.2",
        "division into cells and one cell's Gaussian (a); the whole NDT (b)",
    ),
    ThesisFigure("ndt-p2d", "3.5", "3.2", "the previous NDT (a) and the current points on it (b)"),
    ThesisFigure("ndt-p2d-flow", "3.6", "3.2", "flow chart of point-to-distribution NDT"),
    ThesisFigure(
        "ndt-d2d", "3.7", "3.2", "NDT of the previous (a) and of the current point set (b)"
    ),
    ThesisFigure("ndt-d2d-flow", "3.8", "3.2", "flow chart of distribution-to-distribution NDT"),
    ThesisFigure(
        "scene-1d", "4.1", "4.1", "three targets A B C in F and M; circles true and stars noisy"
    ),
    ThesisFigure(
        "target-b",
        "4.2",
        "4.2",
        "aligning target B with F (a) and its cost surface with peaks at 2 and 10 and 12.2 (b)",
    ),
    ThesisFigure(
        "targets-p2d-d2d", "4.3", "4.2", "the cost surface of every target: P2D (a) and D2D (b)"
    ),
    ThesisFigure(
        "overall-p2d-d2d",
        "4.4",
        "4.2",
        "the overall surface with equal standard deviations: P2D (a) and D2D (b)",
    ),
    ThesisFigure("scene-1d-noisy", "4.5", "4.2", "the scene with a larger standard deviation in M"),
    ThesisFigure(
        "overall-noisy", "4.6", "4.2", "the overall surface of that scene: P2D (a) and D2D (b)"
    ),
    ThesisFigure("summing-likelihood", "4.7", "4.3", "all targets (a); sum (b); likelihood (c)"),
    ThesisFigure(
        "outlier-fixed", "4.8", "4.4", "an outlier in F: F (a); M (b); the targets' surfaces (c)"
    ),
    ThesisFigure(
        "outlier-fixed-cost", "4.9", "4.4", "its overall surface: sum (a) and likelihood (b)"
    ),
    ThesisFigure(
        "outlier-moving", "4.10", "4.4", "an outlier in M: F (a); M (b); the targets' surfaces (c)"
    ),
    ThesisFigure(
        "outlier-moving-cost",
        "4.11",
        "4.4",
        "its overall surface: sum (a); the likelihood, which vanishes (b)",
    ),
    ThesisFigure(
        "blake-zisserman",
        "4.12",
        "4.4",
        "uniform outlier component: the targets (a) and the likelihood (b)",
    ),
    ThesisFigure(
        "corrupted-gaussian",
        "4.13",
        "4.4",
        "corrupted Gaussian: the targets (a) and the likelihood (b)",
    ),
    ThesisFigure("cluster-tight", "4.14", "4.5", "a scene with very close targets"),
    ThesisFigure("cluster-loose", "4.15", "4.5", "a scene with close targets"),
    ThesisFigure(
        "cluster-tight-cost", "4.16", "4.5", "very close: targets (a); sum (b); likelihood (c)"
    ),
    ThesisFigure(
        "cluster-loose-cost", "4.17", "4.5", "close: targets (a); sum (b); likelihood (c)"
    ),
    ThesisFigure("gradient-descent", "5.1", "5.1", "gradient descent from x0 = 6 with step 0.2"),
    ThesisFigure(
        "optimizer-steps",
        "Table 5.1",
        "5.1",
        "the table of steps: gradient descent; Newton; Gauss-Newton; Levenberg-Marquardt",
    ),
    ThesisFigure(
        "propagation-linear", "5.2", "5.2", "error propagation through a line at x0 and x1"
    ),
    ThesisFigure(
        "propagation-nonlinear",
        "5.3",
        "5.2",
        "error propagation through a parabola by linearisation at x0",
    ),
    ThesisFigure(
        "implicit-circle",
        "5.4",
        "5.2",
        "the tangent of the unit circle by the implicit function theorem",
    ),
    ThesisFigure("evaluation-map", "6.1", "6", "the map of what is evaluated"),
    ThesisFigure("scene-2d", "6.2", "6.1", "the fully overlapped scene with 3-sigma ellipses"),
    ThesisFigure("overlap-map", "6.3", "6.3", "what the overlapped scene evaluates"),
    ThesisFigure("overlap-cost", "6.4", "6.3", "its cost surface: sum (a) and likelihood (b)"),
    ThesisFigure(
        "overlap-error",
        "6.5",
        "6.3",
        "estimation errors started at the truth (a b) and at zero (c d)",
    ),
    ThesisFigure(
        "overlap-covariance",
        "6.6",
        "6.3",
        "errors inside 3-sigma bounds: sum (a) and likelihood (b)",
    ),
    ThesisFigure(
        "overlap-credibility",
        "6.7",
        "6.3",
        "NEES and credibility ratio: sum (a); likelihood (b); with outlier component (c)",
    ),
    ThesisFigure("outlier-map", "6.8", "6.3", "what the outlier scene evaluates"),
    ThesisFigure("outlier-scene", "6.9", "6.3", "the scene with close and far outliers"),
    ThesisFigure(
        "outlier-cost",
        "6.10",
        "6.3",
        "its cost surface: sum (a); likelihood (b); robust likelihood (c)",
    ),
    ThesisFigure(
        "outlier-error", "6.11", "6.3", "its estimation errors in translation (a) and rotation (b)"
    ),
    ThesisFigure(
        "outlier-credibility",
        "6.12",
        "6.3",
        "its credibility: sum (a) and robust likelihood (b)",
    ),
    ThesisFigure("cluster-map", "6.13", "6.3", "what the clustered scene evaluates"),
    ThesisFigure("cluster-scene", "6.14", "6.3", "the clustered scene"),
    ThesisFigure(
        "cluster-cost",
        "6.15",
        "6.3",
        "cost surfaces with and without clusters for likelihood (a c) and sum (b d)",
    ),
    ThesisFigure("cluster-error", "6.16", "6.3", "its estimation errors"),
    ThesisFigure("all-map", "6.17", "6.3", "what the combined scene evaluates"),
    ThesisFigure(
        "all-scenes",
        "6.18",
        "6.3",
        "two combined scenes (a b) with the surfaces of the sum (c d) and likelihood (e f)",
    ),
    ThesisFigure(
        "frames",
        "7.1",
        "7",
        "vehicle and sensor frames with the offsets and the measured quantities",
    ),
    ThesisFigure(
        "scan",
        "7.2",
        "7",
        "one radar scan with 3-sigma ellipses and Doppler as dashed lines; a view of the scene",
    ),
    ThesisFigure("ego-flow", "7.3", "7.1", "flow chart of ego-motion estimation"),
    ThesisFigure(
        "platform",
        "7.4",
        "7.2",
        "the platform and its sensor (a drawing with the simulated sensor's specification)",
    ),
    ThesisFigure("trajectory-map", "7.5", "7.2", "the environment with the driven trajectory"),
    ThesisFigure(
        "ego-error",
        "7.6",
        "7.3",
        "estimation errors without Doppler (a); with Doppler (b); with annealed start (c)",
    ),
    ThesisFigure(
        "ego-covariance", "7.7", "7.3", "errors inside 3-sigma without (a) and with Doppler (b)"
    ),
    ThesisFigure(
        "ego-trajectory", "7.8", "7.3", "the integrated trajectory without (a) and with Doppler (b)"
    ),
)
