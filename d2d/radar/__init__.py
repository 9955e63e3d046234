"""Ego-motion of a vehicle from automotive Doppler radar."""

from d2d.radar.evaluation.calibrate import Calibration, calibrate
from d2d.radar.evaluation.compare import Comparison, Measures, compare, compare_tracks
from d2d.radar.evaluation.diagnose import Finding, diagnose
from d2d.radar.evaluation.fit import BudgetFit, fit_budget
from d2d.radar.evaluation.halves import compare_halves
from d2d.radar.motion.covariance import propagate_ego_motion
from d2d.radar.motion.doppler import DopplerMotion, doppler_ego_motion, sensor_velocity
from d2d.radar.motion.estimate import estimate_ego_motion, inlier_probabilities
from d2d.radar.motion.model import EgoMotionModel
from d2d.radar.readers.bag import load_bag, write_bag
from d2d.radar.readers.csv_log import load_csv, write_csv
from d2d.radar.readers.nuscenes import load_nuscenes
from d2d.radar.readers.odometry import load_reference
from d2d.radar.readers.radarscenes import load_radarscenes
from d2d.radar.scans.budget import ErrorBudget
from d2d.radar.scans.reference import Recording, Reference, SlipLaw
from d2d.radar.scans.scan import (
    Mounting,
    RadarScan,
    doppler_velocity,
    over_ground_undone,
    quantisation_sigma,
    unfolded,
)
from d2d.radar.simulation.drive import Drive, Sensor, SensorErrors, simulate_drive
from d2d.radar.simulation.world import World, build_world
from d2d.radar.tracks.estimator import VelocityEstimate
from d2d.radar.tracks.filter_input import FilterInput
from d2d.radar.tracks.gyro import Gyro
from d2d.radar.tracks.intake import ScanWarning
from d2d.radar.tracks.limits import VehicleLimits
from d2d.radar.tracks.path import Displacement
from d2d.radar.tracks.track import Track, Velocities
from d2d.radar.tracks.tracker import Tracker, track

__all__ = [
    "BudgetFit",
    "Calibration",
    "Comparison",
    "Displacement",
    "DopplerMotion",
    "Drive",
    "EgoMotionModel",
    "ErrorBudget",
    "FilterInput",
    "Finding",
    "Gyro",
    "Measures",
    "Mounting",
    "RadarScan",
    "Recording",
    "Reference",
    "ScanWarning",
    "Sensor",
    "SensorErrors",
    "SlipLaw",
    "Track",
    "Tracker",
    "VehicleLimits",
    "Velocities",
    "VelocityEstimate",
    "World",
    "build_world",
    "calibrate",
    "compare",
    "compare_halves",
    "compare_tracks",
    "diagnose",
    "doppler_ego_motion",
    "doppler_velocity",
    "estimate_ego_motion",
    "fit_budget",
    "inlier_probabilities",
    "load_bag",
    "load_csv",
    "load_nuscenes",
    "load_radarscenes",
    "load_reference",
    "over_ground_undone",
    "propagate_ego_motion",
    "quantisation_sigma",
    "sensor_velocity",
    "simulate_drive",
    "track",
    "unfolded",
    "write_bag",
    "write_csv",
]
