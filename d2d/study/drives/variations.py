"""Variations of a drive: in a sparse world, from a fixed start, always from the last velocity."""

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from d2d._types import Array
from d2d.radar import Drive, Track, estimate_ego_motion
from d2d.radar.simulation.world import World
from d2d.study.runs import stacked


def sparse(world: World, rng: np.random.Generator) -> World:
    """The world without movers and with a fifth of its points, at four times the strength."""
    kept = rng.random(len(world.kind)) < 0.2
    few = world.points[kept], 4.0 * world.strength[kept], world.kind[kept]
    return World(world.buildings, world.cars, *few)


def track_from(drive: Drive, start: ArrayLike, **options: Any) -> Track:
    """Estimate each pair on its own from ``start`` (3,); options of `estimate_ego_motion`."""
    estimates = stacked(
        [
            estimate_ego_motion(*pair, drive.mounting, initial=start, **options)
            for pair in pairwise(drive.scans)
        ]
    )
    times = drive.truth.times
    return Track(
        times[1:], np.diff(times), estimates.theta, estimates.covariance, estimates.converged
    )


def followed(drive: Drive, starts: ArrayLike | None = None, **options: Any) -> Array:
    """Velocities (n, 3), each pair started at the last velocity that was found, and only there.

    The first pair starts at the true velocity.  Given ``starts`` (n, 3), each pair starts there
    instead.  ``options`` are those of `d2d.radar.estimate_ego_motion`.
    """
    velocities = [drive.truth.theta[0]]
    for i, pair in enumerate(pairwise(drive.scans)):
        start = velocities[-1] if starts is None else np.asarray(starts)[i]
        estimate = estimate_ego_motion(*pair, drive.mounting, initial=start, **options)
        velocities.append(estimate.theta if estimate.converged else velocities[-1])
    return np.array(velocities[1:])
