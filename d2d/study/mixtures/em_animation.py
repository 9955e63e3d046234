"""Expectation maximisation step by step, as the frames of an animation."""

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import to_rgba_array
from matplotlib.figure import Figure

from d2d._types import Array
from d2d.point_set import PointSet
from d2d.study.book.drawing import ellipses
from d2d.study.book.grammar import BLACK, GREY, PURPLE, SKY, YELLOW
from d2d.study.book.style import label_planar_axes
from d2d.study.mixtures.gaussian import GaussianMixture

COLOURS = (PURPLE, YELLOW, SKY, GREY)


def em_frame(
    x: Array, steps: Sequence[GaussianMixture], log_likelihoods: Sequence[float], step: int
) -> Figure:
    """Draw one step of EM in the plane: data and components, and the log-likelihood below.

    The data ``x`` (N, 2) in m have the colours of their responsibilities; ellipses are of one and
    two standard deviations.
    """
    mixture = steps[step]
    figure, (plane, curve) = plt.subplots(2, 1, figsize=(5.5, 5.1), height_ratios=(4, 1))
    colours = COLOURS[: mixture.components]
    mean_colours = mixture.responsibilities(x) @ to_rgba_array(colours)[:, :3]
    plane.scatter(*x.T, s=10, c=np.clip(mean_colours, 0.0, 1.0))
    for sigmas in (1.0, 2.0):
        components = PointSet(mixture.means, mixture.covariances)
        ellipses(plane, components, sigmas, edgecolor=colours, linewidth=1.8)
    for mean, weight in zip(mixture.means, mixture.weights, strict=True):
        box = {"facecolor": "white", "edgecolor": "none", "pad": 1.0, "alpha": 0.9}
        centred = {"ha": "center", "va": "center", "fontweight": "bold"}
        plane.text(*mean, f"{weight:.2f}", bbox=box, **centred)
    reach = [2.1 * np.sqrt(np.diagonal(s.covariances, axis1=1, axis2=2)) for s in steps]
    ends = [s.means + k * each for s, each in zip(steps, reach, strict=True) for k in (-1, 1)]
    low, high = (extreme(np.concatenate([x, *ends]), axis=0) for extreme in (np.min, np.max))
    label_planar_axes(plane)
    plane.set(xlim=(low[0] - 0.2, high[0]), ylim=(low[1], high[1] + 0.2))
    curve.plot(log_likelihoods, color=BLACK)
    curve.plot(step, log_likelihoods[step], "o", color=BLACK, ms=7)
    curve.set(xlabel="step", ylabel="log-\nlikelihood", ymargin=0.2)
    return figure
