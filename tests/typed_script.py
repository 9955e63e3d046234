"""What a user may write, with types: `test_typing.py` has mypy read it, and runs it."""

from typing import assert_type

import numpy as np
from numpy.typing import NDArray

from d2d import (
    ANNEALED,
    CorruptedGaussian,
    Credibility,
    Estimate,
    LinearMeasurement,
    PointSet,
    RegistrationCost,
    UniformOutlier,
    credibility,
    fisher_covariance,
    multi_start,
    propagate_covariance,
    register,
    start_grid,
)
from d2d.radar import (
    DopplerMotion,
    Drive,
    Mounting,
    RadarScan,
    Reference,
    Sensor,
    Track,
    Velocities,
    doppler_ego_motion,
    doppler_velocity,
    estimate_ego_motion,
    inlier_probabilities,
    load_csv,
    propagate_ego_motion,
    simulate_drive,
    track,
)

Array = NDArray[np.float64]

# ---- Point sets: lists, arrays of any kind, batches, and every way to choose from one

points = PointSet([[8.0, 1.0], [5.0, -3.0], [6.0, 4.0]], [0.04 * np.eye(2)] * 3, [1, 2, 3])
batch = PointSet(np.zeros((4, 3, 2), dtype=np.float32), np.tile(np.eye(2), (3, 1, 1)))
polar = PointSet.from_polar([5.0, 8.0], (0.1, -0.2), 0.2, sigma_azimuth=np.float64(0.01))
on_a_line = PointSet([[1], [2]], [[[1]], [[1]]])
wanted = batch.means[:, 0, 0] < 1.0
assert_type(batch[0], PointSet)
assert_type(batch[np.int64(1),], PointSet)
assert_type(batch[-1:], PointSet)
assert_type(batch[[True, False, True, False]], PointSet)
assert_type(batch[wanted], PointSet)
assert_type(batch[np.argmax(wanted)], PointSet)
assert_type(batch[np.newaxis, ..., :2], PointSet)
assert_type([each.size for each in batch], list[int])
assert_type(points.transformed([0.1, 0.2, 0.05]).inflated(2).means, Array)
points.shifted([1.0, 2.0])

# ---- Costs and registration

costs = [
    RegistrationCost(),
    RegistrationCost("p2d", "summing"),
    RegistrationCost(outlier=UniformOutlier(1)),
    RegistrationCost(outlier=CorruptedGaussian(0.2, [[100, 0], [0, 100]])),
]
RegistrationCost(outlier=CorruptedGaussian(0.2, 4.0)).value([0.0], on_a_line, on_a_line)
moved = points.transformed([0.1, -0.2, 0.02])
for cost in costs:
    estimate = register(points, moved, cost, [0, 0, 0], ANNEALED, threads=1)
    assert_type(estimate, Estimate)
    assert_type(cost.value(estimate.theta, points, moved), Array)
    assert_type(cost.inlier_probabilities([0.0, 0.0, 0.0], points, moved), Array)
estimate = register(points, moved, scales=[2, 1])
assert_type(propagate_covariance(estimate, points, moved, costs[0]), Array)
assert_type(fisher_covariance(estimate.hessian), Array)
measurement = LinearMeasurement([0.0, 0.0, 0.0], 1, 0, np.ones((3, 3)), np.ones((3, 3)))
best = multi_start(points, moved, None, start_grid(1, 1, [0.0]), measurement=measurement)
judged = credibility([[0.1], [0.0], [-0.2]], [[[0.01]]] * 3, confidence=0.9)
assert_type(judged, Credibility)

# ---- Radar

drive = simulate_drive(np.random.default_rng(0), 0.5, sensor=Sensor(clutter=0))
assert_type(drive, Drive)
mounting = Mounting(3, yaw=0.1)
scan = RadarScan(0, [5, 8, 9], [0.1, 0.2, 0.3], np.zeros(3), 0.1, [0.01, 0.01, 0.02], 0.1)
near = scan.range < 8.5
assert_type(scan[near], RadarScan)
assert_type(scan[~near & (scan.doppler > 0.0)], RadarScan)
assert_type(scan[[0, 1]], RadarScan)
assert_type(scan[np.argsort(scan.range)], RadarScan)
assert_type(scan[::2], RadarScan)
first, second = drive.scans[:2]
velocity = estimate_ego_motion(first, second, drive.mounting, initial=[5, 0, 0], outlier=None)
joint = estimate_ego_motion([first], [second], [drive.mounting], doppler=False)
assert_type(inlier_probabilities(velocity.theta, first, second, drive.mounting), Array)
propagate_ego_motion(joint, first, second, drive.mounting, doppler=False)
assert_type(doppler_velocity([5, 0, 0], [0.1, 0.2], mounting), Array)
assert_type(doppler_ego_motion((each, mounting) for each in drive.scans), DopplerMotion)
driven = track(drive, baseline=2, initial=(5, 0, 0), scales=[2, 1])
assert_type(driven, Track)
together = track([(drive.scans[::2], drive.mounting), (iter(drive.scans[1::2]), mounting)])
assert_type(together.poses([0, 0, 0]), Array)
track(((each for each in drive.scans), drive.mounting), max_interval=100)
reference = Reference(driven.times, driven.theta, driven.poses()[1:])
assert_type(reference.at([0.1, 0.2]), Reference)
assert_type(driven.at([0.1, 0.2]), Velocities)


def from_log(path: str) -> list[RadarScan]:
    """Checked by mypy, not run: the files are not there."""
    read = load_csv(path, degrees=True, sigma_range=np.float64(0.1))
    assert_type(Track.load(path), Track)
    return read["front"]
