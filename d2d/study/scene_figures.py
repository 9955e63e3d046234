"""The figures that are drawn of every scene of chapter 6."""

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np

from d2d._checks import Array
from d2d.cost import RegistrationCost
from d2d.point_set import PointSet
from d2d.study import drawing
from d2d.study.evaluation import COSTS, distance_and_rotation, evaluated
from d2d.study.optima import rotation_profile, translation_surface
from d2d.study.scenarios import Scenario

OFFSETS: Array = np.linspace(-8.0, 8.0, 129)  # from the true translation, in m
ROTATIONS: Array = np.deg2rad(np.linspace(-40.0, 40.0, 321))
UNITS = np.array([1.0, 1.0, np.rad2deg(1.0)])
LABELS = (("m", "$t_x$"), ("m", "$t_y$"), ("deg", "φ"))


def one_draw(scenario: Scenario, seed: int = 1) -> tuple[PointSet, PointSet]:
    """One draw of the noise: the fixed and the moving set."""
    fixed, moving = scenario.sample(1, np.random.default_rng(seed))
    return fixed[0], moving[0]


def cost_columns(
    scenario: Scenario, sets: tuple[PointSet, PointSet], costs: Mapping[str, RegistrationCost]
) -> None:
    """A column for each cost: maps over the translation, profiles over the rotation."""
    _, axes = plt.subplots(
        4, len(costs), figsize=(2.6 * len(costs), 8.2), height_ratios=[2, 2, 1, 1], squeeze=False
    )
    for column, (name, cost) in zip(axes.T, costs.items(), strict=True):
        surface = translation_surface(cost, *sets, scenario.theta, OFFSETS)
        drawing.density_map(column[0], OFFSETS, surface, name)
        drawing.cost_map(column[1], OFFSETS, surface, "−log")
        profile = rotation_profile(cost, *sets, scenario.theta, ROTATIONS)
        drawing.rotation_profiles(column[2:], ROTATIONS, profile)
    for ax in axes[:, 1:].ravel():
        ax.set_ylabel("")
    for letter, ax in zip("abc", axes[0], strict=False):
        ax.set_title(f"({letter}) {ax.get_title()}")


def error_panels(scenario: Scenario, names: Sequence[str]) -> None:
    """Shares of the runs below an error, from the truth (above) and from zero (below)."""
    _, axes = plt.subplots(2, 2, sharey=True, figsize=(7.2, 4.8))
    for row, start in zip(axes, ("truth", "zero"), strict=True):
        parts = {
            name: distance_and_rotation(evaluated(scenario, COSTS[name], start).errors)
            for name in names
        }
        drawing.error_shares(row[0], {n: p[0] for n, p in parts.items()}, "m", f"from {start}")
        drawing.error_shares(
            row[1], {n: np.rad2deg(p[1]) for n, p in parts.items()}, "deg", f"from {start}"
        )
    axes[0, 0].legend(loc="upper left")
    drawing.letters(axes)


def bounds_columns(scenario: Scenario, names: Sequence[str]) -> None:
    """Errors of the first 200 runs over three reported standard deviations, a column a cost."""
    _, axes = plt.subplots(3, len(names), sharex=True, sharey="row", figsize=(7.4, 5.2))
    results = [evaluated(scenario, COSTS[name]) for name in names]
    sigmas = [np.sqrt(np.diagonal(r.covariances, axis1=1, axis2=2)) * UNITS for r in results]
    limits = 4.5 * np.max([np.nanmedian(s, axis=0) for s in sigmas], axis=0)
    for letter, column, name, result, sigma in zip(
        "abc", axes.T, names, results, sigmas, strict=False
    ):
        errors = result.errors[:200] * UNITS
        for k, ax in enumerate(column):
            ax.set_ylim(-limits[k], limits[k])
            drawing.error_bands(ax, np.arange(200.0), errors[:, k], sigma[:200, k], *LABELS[k])
        column[0].set_title(f"({letter}) {name}")
        column[2].set_xlabel("run")
    for ax in axes[:, 1:].ravel():
        ax.set_ylabel("")


def credibility_columns(scenario: Scenario, names: Sequence[str]) -> None:
    """NEES, NEES of the credible estimator and credibility ratio of every run, a column a cost."""
    _, axes = plt.subplots(3, len(names), sharex=True, sharey="row", figsize=(7.6, 5.6))
    for letter, column, name in zip("abc", axes.T, names, strict=False):
        result = evaluated(scenario, COSTS[name]).credibility
        drawing.credibility_panels(column, result, f"({letter}) {name}")
    for ax in axes[:, 1:].ravel():
        ax.set_ylabel("")


def credibility_line(scenario: Scenario, name: str) -> str:
    """The credibility of one cost from the truth, in a line."""
    c = evaluated(scenario, COSTS[name]).credibility
    return (
        f"{name:10}: ANEES {c.anees:6.3f} in [{c.bounds[0]:.3f}, {c.bounds[1]:.3f}] "
        f"{c.consistent!s:5}, NCI {c.nci:5.2f} dB, I2 {c.inclination:+6.2f} dB"
    )
