"""Draw the picture that heads the README and the book: `python tools/draw_overview.py`."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from d2d import CorruptedGaussian, RegistrationCost
from d2d.radar import simulate_drive, track
from d2d.study import drawing

TARGET = Path(__file__).resolve().parents[1] / "_static" / "overview.png"


def main() -> None:
    """Draw a scan, the cost of registering it, and the path of a whole drive."""
    drawing.use_style()
    drive = simulate_drive(np.random.default_rng(7), duration=120.0, speed=2.0)
    previous, current = drive.scans[99], drive.scans[100]
    fixed, moving = previous.point_set(drive.mounting), current.point_set(drive.mounting)
    cost = RegistrationCost(outlier=CorruptedGaussian(0.2, 100 * np.eye(2)))
    offset = np.linspace(-6.0, 6.0, 161)
    grid = np.stack([*np.meshgrid(offset, offset), np.zeros((161, 161))], axis=-1)

    figure, axes = plt.subplots(1, 3, figsize=(11, 3.6))
    drawing.radar_scan(axes[0], current, drive.mounting)
    drawing.planar_axes(axes[0], "one scan")
    contours = axes[1].contourf(offset, offset, cost.value(grid, fixed, moving), 24)
    figure.colorbar(contours, ax=axes[1], label="−log likelihood")
    drawing.planar_axes(axes[1], "cost of a translation")
    axes[1].set(xlabel="$t_x$ (m)", ylabel="$t_y$ (m)")
    poses = track(drive.scans, drive.mounting).poses(drive.truth.poses[0])
    drawing.path(axes[2], poses, color=drawing.BLUE, label="estimate")
    axes[2].plot(*drive.truth.poses[:, :2].T, "--", color=drawing.ORANGE, label="truth")
    drawing.planar_axes(axes[2], "the path")
    axes[2].legend()
    figure.savefig(TARGET, dpi=130, metadata={"Software": None})


if __name__ == "__main__":
    main()
