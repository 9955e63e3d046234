"""Errors of an estimated drive: of the velocities, with their covariances, and of the path."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from d2d import rigid
from d2d._checks import check_positive, check_scalar
from d2d.radar import Comparison, Reference, Track, compare
from d2d.radar.comparison import IN_UNITS, NAMES, UNITS

__all__ = ["IN_UNITS", "NAMES", "UNITS", "Drift", "DriveErrors"]


class DriveErrors(Comparison):
    """A comparison with a reference as the chapters print it, on one line."""

    @classmethod
    def of(cls, track: Track, reference: Reference) -> "DriveErrors":
        """Compare with a reference, as `d2d.radar.compare` does."""
        compared = compare(track, reference)
        return cls(**{field.name: getattr(compared, field.name) for field in fields(compared)})

    def summary(self) -> str:
        """One line of text: RMSE, share of usable pairs, ANEES with its region, NCI and I^2."""
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


@dataclass(frozen=True)
class Drift:
    """Errors of a path, as the package evo measures them.

    Attributes
    ----------
    ape_translation, ape_rotation : float, m and deg
        Root mean square absolute pose error; the paths start at the same pose and are not aligned.
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

        Needs the package evo, which the book requires but `d2d` itself does not.

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

        length = float(check_positive("stretch", check_scalar("stretch", stretch)))
        paths = _evo_path("true", true), _evo_path("poses", poses)
        relations = PoseRelation.translation_part, PoseRelation.rotation_angle_deg
        measures: list[Any] = [APE(relation) for relation in relations]
        measures += [
            RPE(relation, delta=length, delta_unit=Unit.meters, all_pairs=True)
            for relation in relations
        ]
        errors = []
        for measure, per in zip(measures, (1.0, 1.0, length, length), strict=True):
            measure.process_data(paths)
            errors.append(float(np.sqrt(np.mean(np.square(measure.error)))) / per)
        return cls(*errors)


def _evo_path(name: str, poses: ArrayLike) -> Any:
    from evo.core.trajectory import PosePath3D  # type: ignore[import-untyped]

    planar = rigid.motion(name, poses, 2)
    matrices = np.zeros((len(planar), 4, 4))
    matrices[:, :2, :2] = rigid.rotation(planar[:, 2])
    matrices[:, :2, 3] = planar[:, :2]
    matrices[:, [2, 3], [2, 3]] = 1.0
    return PosePath3D(poses_se3=list(matrices))
