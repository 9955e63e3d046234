"""Ego-motion of a vehicle from automotive Doppler radar."""

from d2d.radar.budget import CovarianceParts, ErrorBudget
from d2d.radar.calibration import Calibration, calibrate
from d2d.radar.comparison import Comparison, Measures, compare
from d2d.radar.covariance import propagate_ego_motion, propagate_joint_ego_motion
from d2d.radar.csv_log import load_csv, write_csv
from d2d.radar.doppler import DopplerMotion, doppler_ego_motion, sensor_velocity
from d2d.radar.ego_motion import estimate_ego_motion, inlier_probabilities
from d2d.radar.evidence import compare_halves, compare_tracks
from d2d.radar.extent import ExtentEstimate, estimate_extent
from d2d.radar.joint import estimate_joint_ego_motion, track_joint
from d2d.radar.nuscenes import load_nuscenes
from d2d.radar.options import EgoMotionModel
from d2d.radar.plausibility import VehicleLimits
from d2d.radar.radarscenes import load_radarscenes
from d2d.radar.recording import Recording
from d2d.radar.reference import Reference
from d2d.radar.scan import Mounting, RadarScan, doppler_velocity, quantisation_sigma
from d2d.radar.sensor_errors import SensorErrors
from d2d.radar.simulation import Drive, Sensor, TrueTargets, simulate_drive
from d2d.radar.slip import SlipLaw
from d2d.radar.track import track
from d2d.radar.trajectory import Track, Velocities
from d2d.radar.world import World, build_world

__all__ = [
    "Calibration",
    "Comparison",
    "CovarianceParts",
    "DopplerMotion",
    "Drive",
    "EgoMotionModel",
    "ErrorBudget",
    "ExtentEstimate",
    "Measures",
    "Mounting",
    "RadarScan",
    "Recording",
    "Reference",
    "Sensor",
    "SensorErrors",
    "SlipLaw",
    "Track",
    "TrueTargets",
    "VehicleLimits",
    "Velocities",
    "World",
    "build_world",
    "calibrate",
    "compare",
    "compare_halves",
    "compare_tracks",
    "doppler_ego_motion",
    "doppler_velocity",
    "estimate_ego_motion",
    "estimate_extent",
    "estimate_joint_ego_motion",
    "inlier_probabilities",
    "load_csv",
    "load_nuscenes",
    "load_radarscenes",
    "propagate_ego_motion",
    "propagate_joint_ego_motion",
    "quantisation_sigma",
    "sensor_velocity",
    "simulate_drive",
    "track",
    "track_joint",
    "write_csv",
]
