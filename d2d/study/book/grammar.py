"""The one look that each cost, reference and set of targets has in every figure of the book.

- A cost is known by its colour, its marker and its line; `COSTS` lists them in the order of the
  columns of a figure.  A dotted line is P2D, whatever the cost.
- The truth, or the reference that stands in for it, is a black dashed line; in a map it is a
  white cross.
- A target of the fixed set F is a grey circle, one of the moving set M a purple triangle; an amber
  ring marks an outlier.  A scan of many points has its dots in its set's colour.  `SETS` lists
  them; `_static/labs/kit.js` and `labs.css` say the same for the laboratories.
- A start is pink.
- In every map of a cost, or of the density that it belongs to, low cost is dark.

No other artist has the colour of a cost.
"""

from typing import Any, NamedTuple

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import Stroke

from d2d.cost import RegistrationCost
from d2d.radar.tracks import plot as looks

# Okabe & Ito's palette, which colour-blind readers can tell apart.  These three are the costs';
# every estimate of a drive is the robust likelihood's, so that its look is that of a track.
_VERMILLION, _BLUE, _GREEN = "#D55E00", "#0072B2", looks.COLOR
# For all else: the rest of that palette, yellow and sky as dark as 3:1 on white; darker hues.
BLACK, GREY, PURPLE, OCHRE = "#000000", "#595959", "#8E3B7E", "#9A6A00"
PINK, YELLOW, SKY = "#CC79A7", "#C98500", "#3D9AD1"
OTHERS = (PURPLE, YELLOW, SKY, PINK, GREY)

FIXED, MOVING, OUTLIER, START = GREY, PURPLE, YELLOW, PINK
TRUTH: dict[str, Any] = {**looks.REFERENCE, "zorder": 1.5}

COST_MAP, DENSITY_MAP = "viridis", "viridis_r"  # low cost, and so high density, is dark
SHARE_MAP = "cividis"  # of shares, where bright is more


class Look(NamedTuple):
    """How something is drawn: its name, colour, marker and line."""

    name: str
    color: str
    marker: str
    line: Any

    @property
    def marks(self) -> dict[str, Any]:
        """Style of marks without a line between them."""
        return {"color": self.color, "marker": self.marker, "ls": "none", "label": self.name}


DASHED, DOTTED, DASH_DOTTED = (0, (5, 1.2)), (0, (1, 0.9)), looks.LINE
COSTS = {
    "summing": Look("sum", _VERMILLION, "s", DASHED),
    "likelihood": Look("likelihood", _BLUE, "D", "-"),
    "robust": Look("robust likelihood", _GREEN, looks.MARKER, DASH_DOTTED),
}
"""The look of each cost, by its name in the code, in the order of the columns of a figure."""

SETS = {
    "fixed": Look("fixed set F", FIXED, "o", "-"),
    "moving": Look("moving set M", MOVING, "^", "-"),
    "outlier": Look("outlier", OUTLIER, "o", "-"),
}
"""The look of the targets of each set; an outlier has a ring in addition."""

COVARIANCES = {
    "inverse Hessian": Look("inverse Hessian", BLACK, "P", "-"),
    "propagated noise": Look("propagated noise", "#00687A", "^", "--"),
    "noise and budget": Look("noise and budget", "#B8255F", "*", "-"),
}
"""The look of each covariance of one and the same estimate: hues that nothing else has."""


def cost_key(cost: RegistrationCost) -> str:
    """The key in `COSTS` of a cost with any metric."""
    if cost.fusion == "summing":
        return "summing"
    return "likelihood" if cost.outlier is None else "robust"


def cost_line(key: str, metric: str = "d2d", label: str | None = None) -> dict[str, Any]:
    """Style of a curve of a cost; ``label`` replaces the name of the cost."""
    look = COSTS[key]
    line = DOTTED if metric == "p2d" else look.line
    return {"color": look.color, "ls": line, "label": look.name if label is None else label}


def set_marks(name: str) -> dict[str, Any]:
    """Style of the targets of a set, without a line between them."""
    ring = {"mfc": "none", "ms": 13, "mew": 1.8} if name == "outlier" else {"ms": 5}
    return SETS[name].marks | ring


def mark_truth(ax: Axes, x: float = 0.0, y: float = 0.0, size: float = 9.0) -> None:
    """The truth in a map: a white cross with a black edge, visible on dark and bright ground."""
    (cross,) = ax.plot(x, y, "+", color="white", ms=size, mew=1.4)
    cross.set_path_effects([Stroke(linewidth=3.0, foreground=BLACK), Stroke(linewidth=1.4)])


def key() -> Figure:
    """The key to all figures: costs, metrics, covariances, truth, sets, start and maps."""
    figure, axes = plt.subplots(1, 2, figsize=(5.5, 2.8), width_ratios=(1.0, 1.15))
    finding = "Costs, covariances, sets and maps look the same in all figures"
    figure.suptitle(finding, x=0.01, ha="left")
    p2d = Look("dotted: P2D", COSTS["summing"].color, "", DOTTED)
    lines = [
        Line2D([], [], color=look.color, marker=look.marker, ls=look.line, label=look.name)
        for look in (*COSTS.values(), p2d, *COVARIANCES.values())
    ]
    rest = [
        Line2D([], [], **TRUTH, label="truth, reference"),
        *(Line2D([], [], **set_marks(name)) for name in SETS),
        Line2D([], [], color=START, marker="v", ls="none", label="start"),
    ]
    for ax, handles in zip(axes, (lines, rest), strict=True):
        ax.axis("off")
        ax.legend(handles=handles, loc="upper left", handlelength=3.2, borderaxespad=0.0)
    for left, name, ends in (
        (0.06, COST_MAP, ("low cost", "high cost")),
        (0.56, SHARE_MAP, ("share 0", "share 1")),
    ):
        bar = figure.add_axes((left, 0.11, 0.36, 0.065), in_layout=False)
        bar.imshow([[k / 255 for k in range(256)]], cmap=name, aspect="auto")
        bar.set(xticks=[0, 255], xticklabels=ends, yticks=[])
        bar.grid(False)
        if name == COST_MAP:
            mark_truth(bar, 20.0)
    return figure
