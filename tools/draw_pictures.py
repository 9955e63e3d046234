"""Draw the pictures of the README and the book's first pages: `python tools/draw_pictures.py`."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from d2d import ANNEALED, CorruptedGaussian, RegistrationCost, rigid
from d2d.radar import simulate_drive, track
from d2d.study import monte_carlo, scenarios
from d2d.study.book import drawing, grammar, style
from d2d.study.drives.errors import DriveErrors
from d2d.study.plane.evaluation import COSTS, at_truth
from d2d.study.recordings.estimates import estimates_path, read_estimates

DPI = 110  # as in the chapters; 5 inches fit a phone
STATIC = Path(__file__).resolve().parents[1] / "_static"
ROBUST = COSTS["robust"]


def overview() -> Figure:
    """A scan, the cost of registering it, and the path of a whole drive."""
    drive = simulate_drive(np.random.default_rng(7), duration=130.0)
    previous, current = drive.scans[99], drive.scans[100]
    fixed, moving = previous.point_set(drive.mounting), current.point_set(drive.mounting)
    before, after = drive.truth.poses[99:101]
    motion = rigid.compose(rigid.inverse(before), after)
    cost = RegistrationCost(outlier=CorruptedGaussian(0.2, 100 * np.eye(2)))
    offset = np.linspace(-6.0, 6.0, 161)
    grid = np.stack([*np.meshgrid(offset, offset), np.zeros((161, 161))], axis=-1)

    figure, panels = plt.subplot_mosaic("ab;cc", figsize=(5.0, 5.2), height_ratios=(1, 1.1))
    axes = [panels[name] for name in "abc"]
    drawing.radar_scan(axes[0], current, drive.mounting)
    style.label_planar_axes(axes[0], "one scan")
    contours = axes[1].contourf(
        offset, offset, cost.value(grid, fixed, moving), 24, cmap=grammar.COST_MAP
    )
    grammar.mark_truth(axes[1], *motion[:2])
    bar = figure.colorbar(contours, ax=axes[1], label="−log density", location="bottom")
    bar.set_ticks([150, 250, 350])
    style.label_planar_axes(axes[1], "cost of a translation")
    axes[1].set(xlabel="$t_x$ (m)", ylabel="$t_y$ (m)")
    poses = track(drive.scans, drive.mounting).poses(drive.truth.poses[0])
    drawing.path(axes[2], poses, **grammar.cost_line("robust", label="estimate"))
    drawing.path(axes[2], drive.truth.poses, **grammar.TRUTH, label="truth")
    style.label_planar_axes(axes[2], "the path")
    axes[2].legend(loc="center left", bbox_to_anchor=(1.02, 0.5))
    return figure


def start() -> Figure:
    """Share of runs that find the truth from zero, without a schedule and with two schedules."""
    schedules = {"plain": (1.0,), "scales 4, 2, 1": (4.0, 2.0, 1.0), "scales 10 … 1": ANNEALED}
    figure, ax = plt.subplots(figsize=(5.0, 3.0))
    for i, (name, scales) in enumerate(schedules.items()):
        shares = [
            at_truth(monte_carlo(scene, ROBUST, initial="zero", scales=scales).errors).mean()
            for scene in scenarios.ALL
        ]
        color = (grammar.GREY, grammar.YELLOW, grammar.COSTS["robust"].color)[i]
        bars = ax.bar(np.arange(5) + 0.28 * (i - 1), shares, 0.26, color=color, label=name)
        ax.bar_label(bars, [f"{100 * share:.0f}" for share in shares], fontsize=8)
    names = [scene.name.replace("outliers and clusters", "both,") for scene in scenarios.ALL]
    ax.set_xticks(np.arange(5), names)
    ax.set_ylabel("share at the truth")
    ax.set_ylim(0, 1.1)
    figure.legend(loc="outside upper center", ncols=3)
    return figure


def summing() -> Figure:
    """The errors of the three costs in every scene, and how credible their covariances are."""
    figure, axes = plt.subplots(1, 2, figsize=(5.0, 2.8), sharey=True)
    rows = np.arange(5)[::-1]
    for name, shift in zip(grammar.COSTS, (0.22, 0.0, -0.22), strict=True):
        marks, heights = grammar.cost_marks(name), rows + shift
        results = [monte_carlo(scene, COSTS[name]) for scene in scenarios.ALL]
        errors = [np.sqrt(np.mean(np.sum(run.errors[:, :2] ** 2, axis=1))) for run in results]
        axes[0].plot(errors, heights, **marks)
        axes[1].plot([run.credibility.anees for run in results], heights, **marks)
    names = [scene.name.replace("outliers and clusters", "both,") for scene in scenarios.ALL]
    axes[0].set_yticks(rows, names)
    axes[0].set_xlabel("RMSE (m)")
    axes[0].set_xlim(0, None)
    axes[1].axvline(1.0, **grammar.TRUTH)
    axes[1].set_xscale("log")
    axes[1].set_xlabel("ANEES, 1 is credible")
    style.letter_panels(axes)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


def road() -> Figure:
    """Errors of v_x and bands of three standard deviations, simulated and on a road."""
    drive = simulate_drive(np.random.default_rng(7), duration=30.0)
    simulated = DriveErrors.of(track(drive.scans, drive.mounting), drive.truth)
    recorded = read_estimates(estimates_path(105))["sensor 3"].judged
    figure, axes = plt.subplots(1, 2, figsize=(5.0, 2.6))
    for ax, judged, name in zip(
        axes, (simulated, recorded), ("simulated drive", "RadarScenes"), strict=True
    ):
        drawing.error_bands(
            ax, judged.times, judged.errors[:, 0], judged.sigmas[:, 0], "m/s", "$v_x$"
        )
        ax.set_title(f"{name}:\nANEES {judged.credibility.anees:.1f}")
        ax.set_xlabel("time (s)")
    return figure


def main() -> None:
    """Draw all pictures and save them."""
    style.use_style()
    for name, draw in (
        ("overview", overview),
        ("finding-start", start),
        ("finding-sum", summing),
        ("finding-road", road),
        ("figure-key", grammar.key),
    ):
        figure = draw()
        figure.savefig(STATIC / f"{name}.png", dpi=DPI, metadata={"Software": None})
        plt.close(figure)


if __name__ == "__main__":
    main()
