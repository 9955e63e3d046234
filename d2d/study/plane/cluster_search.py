"""A search for clusters that shift the sum's global minimum."""

from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache

import numpy as np

from d2d import rigid
from d2d._types import Array
from d2d.registration import register
from d2d.study.plane.evaluation import SUMMING, at_truth
from d2d.study.plane.scenarios import Layout, Scenario, random_scene
from d2d.study.runs import THREADS

DRAWS = 5  # of the noise in every scene
TURNS = np.deg2rad(np.arange(-45.0, 45.1, 7.5))


@dataclass(frozen=True)
class ClusterKind:
    """Clusters among targets at random places."""

    targets: int  # before some of them become clusters
    clusters: int  # how many of them do
    companions: int  # targets added to each
    radius: float  # m, of the disc over which companions are spread evenly

    def __str__(self) -> str:
        lone = self.targets - self.clusters
        which = "one cluster" if self.clusters == 1 else f"{self.clusters} clusters"
        size = self.companions + 1
        return f"{which} of {size} targets within {self.radius:g} m among {lone} others"


KINDS = tuple(
    ClusterKind(targets, 1, companions, radius)
    for targets in (3, 5, 8)
    for companions in (4, 16, 32)
    for radius in (0.1, 0.5, 1.5)
) + tuple(ClusterKind(8, 2, companions, radius) for companions in (4, 16) for radius in (0.5, 1.5))


@cache
def shares_wrong(kind: ClusterKind, scenes: int, first: int = 0) -> Array:
    """Share (scenes,) of draws with a lower minimum than at the truth; seeds from ``first``."""
    with ThreadPoolExecutor(THREADS) as pool:
        return np.array(
            list(pool.map(lambda s: _share_wrong(kind, s), range(first, first + scenes)))
        )


def _share_wrong(kind: ClusterKind, seed: int) -> float:
    """Share of the draws of one scene with a lower minimum than at the truth.

    Descents start there, and turned about the first cluster, which low minima keep in place.
    """
    rng = np.random.default_rng(seed)
    layout = Layout(clusters=kind.clusters, companions=kind.companions, cluster_radius=kind.radius)
    scenario = random_scene("clusters", layout, rng, kind.targets)
    centre = scenario.targets[kind.targets : kind.targets + kind.companions].mean(axis=0)
    fixed, moving = scenario.sample(DRAWS, rng)
    starts = turned_about(scenario, centre, TURNS)[:, np.newaxis]
    estimates = register(fixed, moving, SUMMING, starts)
    lowest = np.where(estimates.converged, estimates.value, np.inf).argmin(axis=0)
    errors = estimates.theta[lowest, np.arange(DRAWS)] - scenario.theta
    return float(1.0 - at_truth(errors).mean())


def turned_about(scenario: Scenario, centre: Array, turns: Array) -> Array:
    """Motions (T, 3) that take a point where the true one takes it, but turned by angles (T,).

    ``centre`` (2,) is that point in the frame of the previous scan, in m.
    """
    before = rigid.transform_means(rigid.inverse(scenario.theta), centre[np.newaxis])[0]
    angles = scenario.theta[2] + turns
    shifts = centre - rigid.rotation(angles) @ before
    return np.concatenate([shifts, angles[:, np.newaxis]], axis=-1)


def worst(
    kinds: Iterable[ClusterKind], scenes: int
) -> tuple[ClusterKind, Mapping[ClusterKind, float]]:
    """The kind with the largest share of wrong minima, and the shares of all."""
    shares = {kind: float(shares_wrong(kind, scenes).mean()) for kind in kinds}
    return max(shares, key=lambda kind: shares[kind]), shares
