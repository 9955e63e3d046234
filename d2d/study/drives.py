"""How well a drive was estimated."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from d2d import rigid
from d2d._checks import Array, positive, scalar
from d2d.credibility import Credibility, credibility
from d2d.radar import (
    Drive,
    RadarScan,
    Reference,
    Track,
    doppler_velocity,
    estimate_ego_motion,
    inlier_probabilities,
)
from d2d.radar.covariance import propagate_ego_motion
from d2d.radar.world import Movers, Reflectors, World

NAMES = ("v_x", "v_y", "omega")
UNITS = ("m/s", "m/s", "deg/s")
IN_UNITS = np.array([1.0, 1.0, np.rad2deg(1.0)])


@dataclass(frozen=True, eq=False)
class DriveErrors:
    """Estimate minus reference of a track, where it converged and the reference is known.

    Attributes
    ----------
    times : (n,) array, s
    errors : (n, 3) array
        Of [v_x, v_y, omega] in m/s, m/s, rad/s.
    covariances : (n, 3, 3) array
        Estimated, in these units.
    share : float
        Of the track's pairs that are left: converged, and known.
    """

    times: Array
    errors: Array
    covariances: Array
    share: float

    @classmethod
    def of(cls, track: Track, reference: Reference) -> "DriveErrors":
        """Compare with a reference that is given at the times of all scans."""
        return cls.from_errors(track, track.theta - reference.theta[1:])

    @classmethod
    def from_errors(cls, track: Track, errors: Array) -> "DriveErrors":
        """Errors (n, 3) of all pairs; those without a reference are nan."""
        good = track.converged & np.isfinite(errors).all(axis=-1)
        return cls(track.times[good], errors[good], track.covariance[good], float(good.mean()))

    @property
    def rmse(self) -> Array:
        """Root mean square error (3,) in m/s, m/s and deg/s."""
        return np.asarray(np.sqrt(np.mean(self.errors**2, axis=0)) * IN_UNITS)

    @property
    def sigmas(self) -> Array:
        """Estimated standard deviations (n, 3) in m/s, m/s and deg/s."""
        return np.asarray(np.sqrt(np.diagonal(self.covariances, axis1=-2, axis2=-1)) * IN_UNITS)

    @property
    def credibility(self) -> Credibility:
        """Of the errors under their covariances."""
        return credibility(self.errors, self.covariances)

    def summary(self) -> str:
        """One line: RMSE, share converged, ANEES with its region, NCI and I^2."""
        judged = self.credibility
        rmse = "  ".join(
            f"{name} {value:.3f} {unit}"
            for name, value, unit in zip(NAMES, self.rmse, UNITS, strict=True)
        )
        return (
            f"RMSE {rmse}; usable {self.share:.1%}; ANEES {judged.anees:.2f} "
            f"[{judged.bounds[0]:.2f}, {judged.bounds[1]:.2f}], NCI {judged.nci:.1f} dB, "
            f"I2 {judged.inclination:+.1f} dB"
        )


@dataclass(frozen=True, eq=False)
class TargetWeights:
    """How far a track trusts every target of a simulated drive, its kind being known.

    Attributes
    ----------
    kind : (M,) array of str
        Of `d2d.radar.world.KINDS`.
    probability : (M,) array
        That the target is an inlier under the pair's estimate.
    own_speed : (M,) array, m/s
        The true Doppler velocity less that of a target that stands still; nan for clutter.
    """

    kind: NDArray[np.str_]
    probability: Array
    own_speed: Array

    @classmethod
    def of(cls, drive: Drive, driven: Track, *, doppler: bool = True) -> "TargetWeights":
        """Judge the current targets of all pairs of ``driven``, the track of the drive's scans.

        Pairs that did not converge are left out.
        """
        kinds, probabilities, speeds = [], [], []
        for i, (previous, current) in enumerate(pairwise(drive.scans)):
            if not driven.converged[i]:
                continue
            true, theta = drive.targets[i + 1], driven.theta[i]
            still = doppler_velocity(
                drive.truth.theta[i + 1], np.nan_to_num(true.azimuth), drive.mounting
            )
            kinds.append(true.kind)
            speeds.append(true.doppler - still)
            probabilities.append(
                inlier_probabilities(theta, previous, current, drive.mounting, doppler=doppler)
            )
        return cls(np.concatenate(kinds), np.concatenate(probabilities), np.concatenate(speeds))

    def rejected(self, chosen: NDArray[np.bool_]) -> float:
        """Share of the chosen targets (M,) that are rather outliers than inliers, nan of none."""
        return float((self.probability[chosen] < 0.5).mean()) if chosen.any() else float("nan")


def rejected_walkers(
    drive: Drive, driven: Track, speed: float, angles: Array, *, doppler: bool = True
) -> Array:
    """Share (A,) of targets that would be rejected if they walked.

    Targets that stand still, and that the scan before shows too, are given the Doppler velocity and
    the displacement of somebody who walks at ``speed`` in m/s, at each of the ``angles`` (A,) in
    rad to the line of sight, away from the sensor at 0.  Every tenth pair is looked at.
    """
    probabilities: list[list[Array]] = [[] for _ in angles]
    for i in range(0, len(drive.scans) - 1, 10):
        previous, current = drive.scans[i : i + 2]
        true = drive.targets[i + 1]
        chosen = np.isin(true.point, drive.targets[i].point) & (true.point >= 0)
        chosen &= true.kind != "moving"
        if not driven.converged[i] or not chosen.any():
            continue
        for k, angle in enumerate(angles):
            away, aside = speed * np.cos(angle), speed * np.sin(angle)
            walked = RadarScan(
                current.time,
                current.range + away * driven.intervals[i],
                current.azimuth + aside * driven.intervals[i] / current.range,
                current.doppler + away,
                current.sigma_range,
                current.sigma_azimuth,
                current.sigma_doppler,
            )
            pair = previous, walked, drive.mounting
            found = inlier_probabilities(driven.theta[i], *pair, doppler=doppler)
            probabilities[k].append(found[chosen])
    return np.array([(np.concatenate(each) < 0.5).mean() for each in probabilities])


def sparse(world: World, rng: np.random.Generator, share: float = 0.2) -> World:
    """The world with nobody about, and with a share of its reflection points, four times as strong.

    The points of a wall then lie farther apart than the sensor errs.
    """
    still = world.reflectors
    kept = rng.random(len(still.kind)) < share
    few = Reflectors(still.positions[kept], 4.0 * still.strength[kept], still.kind[kept])
    none = Movers(np.empty(0), np.empty(0), np.empty((0, 2)), np.empty(0))
    return World(world.buildings, world.cars, few, none)


def track_from(drive: Drive, start: ArrayLike, **options: Any) -> Track:
    """Estimate every pair of the drive's scans from the same ``start`` (3,), after no other pair.

    ``options`` are those of `d2d.radar.estimate_ego_motion`.
    """
    estimates = [
        estimate_ego_motion(previous, current, drive.mounting, initial=start, **options)
        for previous, current in pairwise(drive.scans)
    ]
    times = drive.truth.times
    return Track(
        times[1:],
        np.diff(times),
        np.array([each.theta for each in estimates]),
        np.array([each.covariance for each in estimates]),
        np.array([bool(each.converged) for each in estimates]),
    )


def propagated_covariances(
    drive: Drive, driven: Track, pairs: Sequence[int], *, shared_azimuth: bool
) -> Array:
    """Covariances (len(pairs), 3, 3) of a track with Doppler, by propagating the sensor's errors.

    One azimuth error moves a target's position and its Doppler velocity if ``shared_azimuth``; the
    cost takes two.
    """
    found = []
    for i in pairs:
        pair = drive.scans[i], drive.scans[i + 1], drive.mounting
        estimate = estimate_ego_motion(*pair, initial=driven.theta[i])
        found.append(propagate_ego_motion(estimate, *pair, shared_azimuth=shared_azimuth))
    return np.array(found)


@dataclass(frozen=True)
class Drift:
    """How far a path is off, by the measures of evo.

    Attributes
    ----------
    ape_translation, ape_rotation : float, m and deg
        Root mean square absolute pose error; the paths begin at the same pose and are not aligned.
    rpe_translation, rpe_rotation : float, m/m and deg/m
        Root mean square relative pose error over stretches of ``stretch`` metres, per metre.
    """

    ape_translation: float
    ape_rotation: float
    rpe_translation: float
    rpe_rotation: float

    @classmethod
    def of(cls, poses: ArrayLike, true: ArrayLike, stretch: float = 10.0) -> "Drift":
        """Compare poses (n, 3) with the true ones (n, 3), [x, y, yaw] in m, m, rad.

        Needs the package evo, which the book uses and `d2d` alone does not.

        Raises
        ------
        ValueError
            Naming the argument that does not fit.
        """
        from evo.core.metrics import (  # type: ignore[import-untyped]
            APE,
            RPE,
            PoseRelation,
            Unit,
        )

        length = float(positive("stretch", scalar("stretch", stretch)))
        paths = _evo_path("true", true), _evo_path("poses", poses)
        relations = PoseRelation.translation_part, PoseRelation.rotation_angle_deg
        measures: list[Any] = [APE(relation) for relation in relations]
        measures += [
            RPE(relation, delta=length, delta_unit=Unit.meters, all_pairs=True)
            for relation in relations
        ]
        found = []
        for measure, per in zip(measures, (1.0, 1.0, length, length), strict=True):
            measure.process_data(paths)
            found.append(float(np.sqrt(np.mean(np.square(measure.error)))) / per)
        return cls(*found)


def _evo_path(name: str, poses: ArrayLike) -> Any:
    from evo.core.trajectory import PosePath3D  # type: ignore[import-untyped]

    rows = rigid.motion(name, poses, 2)
    matrices = np.zeros((len(rows), 4, 4))
    matrices[:, :2, :2] = rigid.rotation(rows[:, 2])
    matrices[:, :2, 3] = rows[:, :2]
    matrices[:, [2, 3], [2, 3]] = 1.0
    return PosePath3D(poses_se3=list(matrices))
