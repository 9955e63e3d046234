"""The comparison on real drives: that a registration gets what helps it, and how it is judged."""

import numpy as np

from benchmarks.road import by_doppler, by_points, outcome, run
from d2d import register
from d2d.radar import Mounting, Recording, simulate_drive
from d2d.study.road.drive import Drive
from tests.strategies import ROBUST

MOUNTINGS = Mounting(3.5, 0.6, 0.4), Mounting(3.5, -0.6, -0.4)


def simulated(duration: float) -> Drive:
    drives = [simulate_drive(np.random.default_rng(3), duration, mounting=at) for at in MOUNTINGS]
    return Drive("", [Recording(each.scans, each.mounting, each.truth) for each in drives])


def test_merged_static_points_of_two_radars_give_the_velocity():
    """Wrong mountings, or moving targets among the points, would show as metres a second."""
    drive = simulated(3.0)

    def robust(fixed, moving, start):
        return register(fixed, moving, ROBUST, start).theta

    for method in (by_doppler(True), by_points(robust)):
        errors = outcome(drive, *run(method, drive.rounds)).errors
        assert (np.sqrt(np.mean(errors**2, axis=0)) < [0.2, 0.3, np.deg2rad(2.0)]).all()
