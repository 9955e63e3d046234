"""Tables and drawings of the covariances on the road."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from d2d.study.book.grammar import BLACK, COVARIANCES, TRUTH, covariance_marks


def score_table(judged: Mapping[str, Mapping[str, Any]]) -> str:
    """ANEES, share in the 95 % region, whitened squares, log score: a row for each model."""
    wide = max(len(name) for models in judged.values() for name in models)
    lines = [
        f"{'':12} {'covariance':{wide}} {'ANEES':>5} {'inside':>6} "
        f"{'v_x':>5} {'v_y':>5} {'omega':>5} {'log':>6}"
    ]
    for where, models in judged.items():
        for name, found in models.items():
            v_x, v_y, omega = found["whitened"]
            lines.append(
                f"{where:12} {name:{wide}} {found['anees']:5.2f} {found['inside']:6.0%} "
                f"{v_x:5.2f} {v_y:5.2f} {omega:5.2f} {found['log_score']:6.2f}"
            )
    return "\n".join(lines)


def error_table(judged: Mapping[str, Mapping[str, Any]], model: str = "noise and budget") -> str:
    """RMSE and mean errors of one model's estimates, a row for each drive."""
    lines = [f"{'':12} {'RMSE m/s, m/s, deg/s':>22}   {'mean error':>22}   estimates"]
    for where, models in judged.items():
        found = models[model]
        rmse = " ".join(f"{value:6.3f}" for value in found["rmse"])
        mean = " ".join(f"{value:+6.3f}" for value in found["mean"])
        lines.append(f"{where:12} {rmse:>22}   {mean:>22}   {found['estimates']:9}")
    return "\n".join(lines)


def draw_scores(judged: Mapping[str, Mapping[str, Any]]) -> Figure:
    """ANEES with its interval, and the share inside the 95 % region, of every model and drive."""
    figure, axes = plt.subplots(1, 2, sharey=True, figsize=(5.0, 1.2 + 0.66 * len(judged)))
    places = np.arange(len(judged))[::-1]
    for k, name in enumerate(COVARIANCES):
        offset = 0.3 - 0.15 * k
        found = [models[name] for models in judged.values()]
        anees = np.array([each["anees"] for each in found])
        spread = np.abs(np.array([each["anees_interval"] for each in found]).T - anees)
        marks = covariance_marks(name) | {"ms": 6}
        axes[0].errorbar(anees, places + offset, xerr=spread, elinewidth=1.2, **marks)
        inside = [100.0 * each["inside"] for each in found]
        axes[1].plot(inside, places + offset, **marks)
    axes[0].set_xscale("log")
    axes[0].axvline(1.0, **TRUTH)
    axes[1].axvline(95.0, **TRUTH)
    axes[0].set(xlabel="ANEES", yticks=places, yticklabels=list(judged))
    axes[1].set(xlabel="in the 95 % region (%)", xlim=(0, 102))
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return figure


def draw_extents(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Error of the yaw rate and ANEES of omega against the extent that the targets are given."""
    figure, axes = plt.subplots(1, 2, figsize=(5.0, 2.7))
    extent = [row["extent"] for row in rows]
    axes[0].plot(extent, [row["inverse Hessian"]["rmse"][2] for row in rows], "o-", color=BLACK)
    axes[0].set(xlabel="extent (m)", ylabel="RMSE of ω (deg/s)", ylim=(0, None))
    for entry, name in (("inverse Hessian", "inverse Hessian"), ("propagated", "propagated noise")):
        omega = [row[entry]["whitened"][2] for row in rows]
        axes[1].plot(extent, omega, **covariance_marks(name) | {"ls": COVARIANCES[name].line})
    axes[1].axhline(1.0, **TRUTH)
    axes[1].set(xlabel="extent (m)", ylabel="mean square of ω's error / σ²", yscale="log")
    axes[1].legend()
    return figure
