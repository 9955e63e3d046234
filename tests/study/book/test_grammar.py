"""One look for each cost, reference and set in every figure: what a reader learns once, holds."""

import json
import re
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.colors import to_hex
from matplotlib.lines import Line2D

from d2d.radar import compare, simulate_drive, track
from d2d.study import scenarios
from d2d.study.beyond import exhaustive
from d2d.study.beyond import figures as beyond_figures
from d2d.study.book import grammar
from d2d.study.drives import figures as drive_figures
from d2d.study.line import figures as line_figures
from d2d.study.line import outlier_study
from d2d.study.line.scene import NAMES, line_scene, with_outlier
from d2d.study.plane import evaluation
from d2d.study.plane import figures as plane_figures

ROOT = Path(__file__).resolve().parents[3]
COST_COLORS = {look.color.upper(): key for key, look in grammar.COSTS.items()}
WIDEST = 5.0  # inches: two thirds of that at 110 pixels an inch are 367 pixels
TRANSLATIONS = np.arange(-6.0, 10.0, 0.05)


def cost_of(label: str) -> str | None:
    text = label.lower()
    if "robust" in text:
        return "robust"
    if re.match(r"(\(\w\) )?sum", text):
        return "summing"
    return "likelihood" if re.match(r"(\(\w\) )?(plain |d2d )?likelihood", text) else None


def breaches(figure) -> list[str]:
    found = []
    for ax in figure.axes:
        found += [f"map with {mesh.get_cmap().name}" for mesh in ax.collections if _foreign(mesh)]
        for line in ax.lines:
            label, color = str(line.get_label()), to_hex(line.get_color()).upper()
            cost = cost_of(label)
            if cost is not None:
                found += _line_breaches(line, grammar.COSTS[cost], label)
            elif _takes_a_cost_color(line, ax, COST_COLORS.get(color)):
                found.append(f"{label!r} has the colour of {COST_COLORS[color]}")
            reference = any(word in label for word in ("truth", "odometry", "reference"))
            if reference and (color != "#000000" or line.get_linestyle() != "--"):
                found.append(f"{label!r} is no black dashed line")
    return found


ESTIMATES = ("estimate", "with Doppler", "four sensors, baseline 2")  # of the robust likelihood


def _title(ax) -> str:
    return ax.get_title("left") or ax.get_title()


def _takes_a_cost_color(line, ax, cost: str | None) -> bool:
    """Whether a line that a legend names has a cost's colour without standing for that cost."""
    label = str(line.get_label())
    named = not label.startswith("_") and label not in ESTIMATES
    return cost is not None and named and cost_of(_title(ax)) != cost


def _foreign(mesh) -> bool:
    own = (grammar.COST_MAP, grammar.DENSITY_MAP, grammar.SHARE_MAP)
    return isinstance(mesh, QuadMesh) and mesh.get_cmap().name not in own


def _line_breaches(line: Line2D, look, label: str) -> list[str]:
    found = []
    if to_hex(line.get_color()).upper() != look.color:
        found.append(f"{label!r} has the colour {to_hex(line.get_color())}")
    if line.get_marker() not in (look.marker, "x", "None", ".", None, ""):
        found.append(f"{label!r} has the marker {line.get_marker()}")
    pattern = line._unscaled_dash_pattern  # no public way to read a dash pattern
    allowed = [Line2D([], [], ls=ls)._unscaled_dash_pattern for ls in (look.line, grammar.DOTTED)]
    if line.get_linestyle() != "None" and pattern not in allowed:
        found.append(f"{label!r} has the line {pattern}")
    return found


def in_order(figure) -> bool:
    """Whether the costs that the titles of each row name come in the order of the grammar."""
    rows: dict[int, list[str]] = {}
    for ax in figure.axes:
        place = ax.get_subplotspec()
        title = _title(ax)
        if place is not None and cost_of(title) is not None:
            rows.setdefault(place.rowspan.start, []).append(cost_of(title))
    order = list(grammar.COSTS)
    return all(row == sorted(row, key=order.index) for row in rows.values())


def line_surfaces():
    """The targets and both fused surfaces of the scene on a line, and the robust one."""
    sets = with_outlier(np.random.default_rng(1), "moving", at=4.0)
    _, axes = plt.subplots(2, 4)
    line_figures.every_target(
        axes[0, 0], TRANSLATIONS, outlier_study.LIKELIHOOD, sets, (*NAMES, "O")
    )
    costs = (outlier_study.SUMMING, outlier_study.LIKELIHOOD, outlier_study.ROBUST)
    for column, cost in zip(axes[:, 1:].T, costs, strict=True):
        name = grammar.COSTS[grammar.cost_key(cost)].name
        line_figures.fused(column, TRANSLATIONS, cost, sets, name)


def sets_on_a_line():
    _, axes = plt.subplots(1, 2)
    fixed, moving = line_scene(np.random.default_rng(1))
    line_figures.both_sets(
        axes, (fixed, moving), (fixed.means[:, 0], moving.means[:, 0]), (NAMES, NAMES)
    )


def plane_scene():
    _, ax = plt.subplots()
    plane_figures.planar_scene(ax, scenarios.OUTLIERS, *plane_figures.one_draw(scenarios.OUTLIERS))


def sweep():
    """The factors of chapter 16, from the stored results."""
    _, axes = plt.subplots(4, 2)
    rows = exhaustive.read_table()
    beyond_figures.factor_panels(axes, rows, exhaustive.success, annealed=True)


def driven_path():
    _, ax = plt.subplots()
    poses = np.zeros((201, 3))
    drive_figures.track_lines(ax, poses, poses)


COSTS = tuple(evaluation.COSTS)
DRAWINGS = {
    "surfaces on a line": line_surfaces,
    "sets on a line": sets_on_a_line,
    "costs in the plane": lambda: plane_figures.cost_columns(
        scenarios.OUTLIERS, plane_figures.one_draw(scenarios.OUTLIERS), evaluation.COSTS
    ),
    "errors": lambda: plane_figures.error_panels(scenarios.OVERLAPPED, COSTS),
    "bounds": lambda: plane_figures.bounds_columns(scenarios.OVERLAPPED, COSTS),
    "credibility": lambda: plane_figures.credibility_columns(scenarios.OVERLAPPED, COSTS),
    "scene in the plane": plane_scene,
    "sweep": sweep,
    "path": driven_path,
    "key": grammar.key,
}


@pytest.mark.parametrize("name", DRAWINGS)
def test_a_figure_keeps_the_grammar(name):
    """Breaks if a cost changes its colour, marker, line or column, or anything else takes one."""
    DRAWINGS[name]()
    assert plt.get_fignums()
    for figure in map(plt.figure, plt.get_fignums()):
        assert breaches(figure) == []
        assert in_order(figure)


def test_a_breach_is_noticed():
    """Breaks if the check above passes whatever is drawn."""
    for label, style in {
        "sum": {"color": grammar.PURPLE, "ls": grammar.DASHED},
        "likelihood": {"color": grammar.COSTS["likelihood"].color, "marker": "s"},
        "robust likelihood": {"color": grammar.COSTS["robust"].color, "ls": "-"},
        "something else": {"color": grammar.COSTS["robust"].color},
        "truth": {"color": grammar.PURPLE, "ls": "--"},
    }.items():
        figure, ax = plt.subplots()
        ax.plot([0, 1], [0, 1], label=label, **style)
        assert breaches(figure), label


def test_a_wrong_order_is_noticed():
    figure, axes = plt.subplots(1, 2)
    axes[0].set_title("(a) robust likelihood")
    axes[1].set_title("(b) sum")
    assert not in_order(figure)


def test_low_cost_is_dark():
    """Breaks if a map is turned round: what a reader takes for a well would be a hill."""
    logs = -np.add.outer(np.linspace(-1, 1, 65) ** 2, np.linspace(-1, 1, 65) ** 2)
    figure, axes = plt.subplots(1, 2)
    plane_figures.cost_map(axes[0], plane_figures.NEAR_OFFSETS, logs)
    plane_figures.density_map(axes[1], plane_figures.NEAR_OFFSETS, logs, logs)
    for ax, name in zip(axes, ("viridis", "viridis_r"), strict=True):
        mesh = next(each for each in ax.collections if isinstance(each, QuadMesh))
        assert mesh.get_cmap().name == name
        values = np.asarray(mesh.get_array()).reshape(65, 65)
        at_truth, at_edge = (np.sum(mesh.to_rgba(values)[i, i, :3]) for i in (32, 0))
        assert at_truth < 0.5 * at_edge
    bars = [ax for ax in figure.axes if ax not in axes]
    assert all(bar.get_ylabel() or bar.get_xlabel() for bar in bars), "bar unlabelled"
    assert len(bars) == 2


def sources() -> list[tuple[str, str]]:
    """Drawing code outside the grammar: modules of the study, tools, cells of the notebooks."""
    paths = [*(ROOT / "d2d" / "study").rglob("*.py"), *(ROOT / "tools").glob("*.py")]
    found = [(path.name, path.read_text()) for path in paths if path.name != "grammar.py"]
    for path in sorted((ROOT / "chapters").glob("*.ipynb")):
        cells = json.loads(path.read_text())["cells"]
        code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
        found.append((path.name, "\n".join(code)))
    return found


def test_colours_of_costs_and_maps_come_from_the_grammar():
    """Breaks if a figure writes a cost's colour or a colour map by hand, where none checks it."""
    by_hand = {}
    for name, source in sources():
        found = [color for color in COST_COLORS if color in source.upper()]
        found += re.findall(r"cmap=\"\w+\"|[\"']C[0-9][\"']", source)
        found += re.findall(r"color=\"(?:tab:)?(?:blue|orange|green|red)\"", source)
        if found:
            by_hand[name] = found
    assert by_hand == {}


def test_figures_fit_a_phone():
    """Breaks if a figure grows wider than a phone shows, where panels and legends would be cut."""
    wide = {}
    for name, source in sources():
        if name.endswith(".ipynb") or "figures" in name:
            sizes = re.findall(r"figsize=\((\d+(?:\.\d+)?), ", source)
            sizes += re.findall(r"\bwidth=(\d\.\d+),\n\)", source)  # of a flow chart
            found = [size for size in sizes if float(size) > WIDEST]
            if found:
                wide[name] = found
    assert wide == {}


def test_lettering_can_be_read_on_a_phone():
    """Breaks if a label of a figure has less than 9 pt, nearly 9 px on a phone."""
    small = re.compile(r"(?:font|label)size=[0-8]\b")
    assert [name for name, source in sources() if small.search(source)] == []


MARKS = {"o": "circle", "^": "peak", "s": "square", "D": "diamond"}  # in the laboratories


@pytest.mark.parametrize("key", [*grammar.COSTS, *grammar.SETS])
def test_the_laboratories_have_the_colours_and_marks_of_the_figures(key):
    """Breaks if a cost or a set looks otherwise where one plays with it than in print."""
    look = (grammar.COSTS | grammar.SETS)[key]
    css, kit = ((ROOT / "_static" / "labs" / name).read_text() for name in ("labs.css", "kit.js"))
    assert f"--lab-{key}: {look.color.lower()};" in css
    assert re.search(rf'\n *{key}: {{ name: "[^"]+", mark: "{MARKS[look.marker]}"', kit)


def test_targets_have_the_marks_of_their_set():
    """Breaks if a figure draws F, M or an outlier as another one does not."""
    plane_scene()
    lines = {str(line.get_label()): line for line in plt.gca().lines}
    labels = "previous F", "current M", "far outlier"
    for label, name in zip(labels, grammar.SETS, strict=True):
        drawn, look = lines[label], grammar.SETS[name]
        assert (drawn.get_color(), drawn.get_marker()) == (look.color, look.marker)
        assert (drawn.get_markerfacecolor() == "none") == (name == "outlier")


def test_a_track_and_the_book_draw_an_estimate_alike():
    """Breaks if the picture of a track has a colour, line or marker of its own."""
    drive = simulate_drive(np.random.default_rng(0), duration=1.0)
    driven = track(drive)
    for figure in (driven.plot(), compare(driven, drive.truth).plot()):
        drawn = [line for ax in figure.axes for line in ax.lines if line.get_label() != "failed"]
        robust = grammar.COSTS["robust"]
        for line in drawn:
            color = to_hex(line.get_color()).upper()
            assert color in (robust.color, to_hex(grammar.TRUTH["color"]).upper())
            if color == robust.color:
                assert line.get_marker() in ("None", robust.marker)
            else:
                assert line.get_linestyle() == grammar.TRUTH["ls"]
