"""Draw the pictures of the README and the book's first pages: `python tools/draw_pictures.py`."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from d2d import ANNEALED
from d2d.scores import within
from d2d.study import monte_carlo, scenarios
from d2d.study.book import drawing, grammar, style
from d2d.study.plane.evaluation import COSTS, at_truth, distance_and_rotation, rms
from d2d.study.plane.tables import short_name
from d2d.study.road.scores import read_scores

DPI = 122  # of the page; 5.5 inches fit a phone, which has two pixels or more for each
TILE = (2.6, 2.0)  # inches: three beside each other on the first pages
STATIC = Path(__file__).resolve().parents[1] / "_static"
SCENES = [short_name(scene.name) for scene in scenarios.ALL]
ROWS = np.arange(len(SCENES))[::-1]


def share_from_zero(scene: scenarios.Scenario, scales: tuple[float, ...]) -> float:
    """Share of the runs with the robust likelihood that reach the truth from zero."""
    runs = monte_carlo(scene, COSTS["robust"], initial="zero", scales=scales)
    return float(at_truth(runs.errors).mean())


def start() -> Figure:
    """Share of runs that find the truth from zero, without a schedule and with two schedules."""
    schedules = {"plain": (1.0,), "scales 4, 2, 1": (4.0, 2.0, 1.0), "scales 10 … 1": ANNEALED}
    figure, ax = plt.subplots(figsize=(5.5, 4.2))
    for i, (name, scales) in enumerate(schedules.items()):
        shares = [100 * share_from_zero(scene, scales) for scene in scenarios.ALL]
        color = (grammar.GREY, grammar.YELLOW, grammar.COSTS["robust"].color)[i]
        heights = ROWS + 0.26 * (1 - i)
        ax.plot(shares, heights, "vPo"[i], color=color, label=name)
        for share, height in zip(shares, heights, strict=True):
            drawing.label(ax, (share, height), f"{share:.0f}", color, (5, -3))
    ax.set_yticks(ROWS, SCENES)
    ax.set(xlabel="runs at the truth (%)", xlim=(-2, 108), xticks=range(0, 101, 25))
    figure.legend(loc="outside lower center", ncols=3, labelcolor="linecolor")
    style.headline(figure, "Only the long schedule brings every run to the truth")
    return figure


def summing() -> Figure:
    """The errors of the three costs in every scene, and how credible their covariances are."""
    figure, axes = plt.subplots(1, 2, figsize=(5.5, 3.6), sharey=True)
    for name, shift in zip(grammar.COSTS, (0.22, 0.0, -0.22), strict=True):
        marks, heights = grammar.COSTS[name].marks, ROWS + shift
        results = [monte_carlo(scene, COSTS[name]) for scene in scenarios.ALL]
        errors = [rms(distance_and_rotation(run.errors)[0]) for run in results]
        axes[0].plot(errors, heights, **marks)
        axes[1].plot([run.credibility.anees for run in results], heights, **marks)
    axes[0].set(xlabel="RMSE (m)", xlim=(0, None), title="error", yticks=ROWS, yticklabels=SCENES)
    axes[1].axvline(1.0, **grammar.TRUTH)
    axes[1].set(xscale="log", xlabel="ANEES", title="variance: ← too large, too small →")
    style.write_out_ticks(axes[1].xaxis, (0.1, 1, 10, 100))
    handles = axes[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=3, labelcolor="linecolor")
    style.headline(figure, "Only the robust likelihood is right in every scene")
    style.letter_panels(axes)
    return figure


def _bars(
    shares: dict[str, float], colors: list[str], label: str = "in the 95 % region", aim: int = 95
) -> Figure:
    """A bar for each share, with its number, below the per cent that is wanted."""
    figure, ax = plt.subplots(figsize=TILE)
    bars = ax.bar(list(shares), 100.0 * np.array([*shares.values()]), 0.6, color=colors)
    ax.bar_label(bars, fmt="%.0f %%", padding=4, bbox={"color": "white", "pad": 1}, zorder=3)
    ax.axhline(aim, **grammar.TRUTH)
    ticks = [0, 50, aim]
    ax.set(ylim=(0, 115), yticks=ticks, yticklabels=[f"{n} %" for n in ticks], ylabel=label)
    return figure


def start_tile() -> Figure:
    """How many runs from zero find the truth, plain and annealed, in the scene with outliers."""
    schedules = {"plain": (1.0,), "blurred first,\nthen sharpened": ANNEALED}
    shares = {name: share_from_zero(scenarios.OUTLIERS, s) for name, s in schedules.items()}
    return _bars(shares, [grammar.GREY, grammar.COSTS["robust"].color], "runs at the truth", 100)


def sum_tile() -> Figure:
    """How many errors lie in the 95 % region of each cost, in the scene with outliers."""
    runs = [monte_carlo(scenarios.OUTLIERS, COSTS[name]) for name in grammar.COSTS]
    inside = [float(within(run.errors, run.covariances, 0.95).mean()) for run in runs]
    words = ("sum:\ntoo wide", "likelihood:\ntoo narrow", "robust:\nright")
    shares = dict(zip(words, inside, strict=True))
    return _bars(shares, [look.color for look in grammar.COSTS.values()])


def road_tile() -> Figure:
    """The share of the errors of four radars on RadarScenes that lie in the 95 % region."""
    found = read_scores()["radarscenes"]["baseline 4"]["105"]  # 0.3 s between the scans of a pair
    names = {"inverse\nHessian": "inverse Hessian", "with error\nbudget": "noise and budget"}
    shares = {words: found[name]["inside"] for words, name in names.items()}
    return _bars(shares, [grammar.COVARIANCES[name].color for name in names.values()])


def main() -> None:
    """Draw all pictures and save them."""
    style.use_style()
    pictures = {"finding-start": start, "finding-sum": summing, "figure-key": grammar.key}
    pictures |= {"tile-start": start_tile, "tile-sum": sum_tile, "tile-road": road_tile}
    for name, draw in pictures.items():
        dpi = 3 * DPI if name.startswith("tile") else 2 * DPI
        figure = draw()
        figure.savefig(STATIC / f"{name}.png", dpi=dpi, metadata={"Software": None})
        plt.close(figure)


if __name__ == "__main__":
    main()
