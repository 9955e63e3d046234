"""Rejected targets of a drive, by the object that they belong to."""

from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from d2d._types import Array
from d2d.radar import Drive, Track, inlier_probabilities


class TargetWeights(NamedTuple):
    """How far a track trusts each target of a simulated drive, whose true kind is known."""

    kind: NDArray[np.str_]  # (M,) one of `d2d.radar.simulation.world.KINDS`
    probability: Array  # (M,) that the target is an inlier under the pair's estimate

    @classmethod
    def of(cls, drive: Drive, driven: Track, *, doppler: bool = True) -> "TargetWeights":
        """Weigh the targets of each converged pair's current scan; ``driven`` tracks the drive."""
        kinds, probabilities = [], []
        for i, (previous, current) in enumerate(pairwise(drive.scans)):
            if not driven.converged[i]:
                continue
            pair = previous, current, drive.mounting
            kinds.append(drive.targets[i + 1].kind)
            probabilities.append(inlier_probabilities(driven.theta[i], *pair, doppler=doppler))
        return cls(np.concatenate(kinds), np.concatenate(probabilities))

    def rejected(self, chosen: NDArray[np.bool_]) -> float:
        """Share of chosen targets (M,) that are more likely outliers; nan without any."""
        return float((self.probability[chosen] < 0.5).mean()) if chosen.any() else float("nan")


def walkers_by_pair(
    drive: Drive, driven: Track, speed: float, angles: Array, *, doppler: bool = True
) -> list[NDArray[np.bool_]]:
    """Whether targets would be rejected if they walked, (A, n) for every tenth pair that is used.

    Static targets that the previous scan shows, too, get the Doppler velocity and the displacement
    of a walker with ``speed`` (m/s) at ``angles`` (A,) in rad to the line of sight; 0 is away.
    """
    rejected = []
    for i in range(0, len(drive.scans) - 1, 10):
        previous, current = drive.scans[i : i + 2]
        true = drive.targets[i + 1]
        chosen = np.isin(true.point, drive.targets[i].point) & (true.point >= 0)
        chosen &= true.kind != "moving"
        if not driven.converged[i] or not chosen.any():
            continue
        at_angle = []
        for angle in angles:
            away, aside = speed * np.cos(angle), speed * np.sin(angle)
            walked = replace(
                current,
                range=current.range + away * driven.intervals[i],
                azimuth=current.azimuth + aside * driven.intervals[i] / current.range,
                doppler=current.doppler + away,
            )
            pair = previous, walked, drive.mounting
            judged = inlier_probabilities(driven.theta[i], *pair, doppler=doppler)
            at_angle.append(judged[chosen] < 0.5)
        rejected.append(np.array(at_angle))
    return rejected


def rejected_walkers(
    drive: Drive, driven: Track, speed: float, angles: Array, *, doppler: bool = True
) -> Array:
    """Share (A,) of the targets of `walkers_by_pair` that would be rejected."""
    rejected = walkers_by_pair(drive, driven, speed, angles, doppler=doppler)
    return np.asarray(np.concatenate(rejected, axis=1).mean(axis=1))
