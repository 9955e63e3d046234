"""Errors of an estimated drive: of the velocities, with their covariances, and of the path."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from d2d import rigid
from d2d._checks import check_positive_scalar
from d2d.radar import Comparison, Reference, Track, compare
from d2d.radar.trust.comparison import IN_UNITS, NAMES, UNITS
from d2d.study.book.table import Column, Table, table

__all__ = ["IN_UNITS", "NAMES", "UNITS", "Drift", "DriveErrors", "errors_table"]


class DriveErrors(Comparison):
    """A comparison with a reference; see `errors_table` for how the chapters print it."""

    @classmethod
    def of(cls, track: Track, reference: Reference) -> "DriveErrors":
        """Compare with a reference, as `d2d.radar.compare` does."""
        compared = compare(track, reference)
        return cls(**{field.name: getattr(compared, field.name) for field in fields(compared)})


def errors_table(found: Mapping[str, DriveErrors], caption: str) -> Table:
    """What the chapters print of each comparison: errors, usable estimates and credibility.

    The ANEES stands with its 95 % interval by a block bootstrap, since errors along a drive are
    correlated; it is credible if 1 lies inside.
    """
    rows = {
        name: (
            *each.rmse,
            each.share,
            each.measures.anees,
            "{:.2f} to {:.2f}".format(*each.intervals().anees),
            each.credibility.nci,
            each.credibility.inclination,
        )
        for name, each in found.items()
    }
    columns: list[Column] = [
        "",
        *((name, unit, ".3f") for name, unit in zip(NAMES, UNITS, strict=True)),
        ("usable", "", ".1%"),
        ("ANEES", "", ".2f"),
        "95 % interval",
        ("NCI", "dB", ".1f"),
        ("I²", "dB", "+.1f"),
    ]
    return table(rows, columns, caption)


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

        length = check_positive_scalar("stretch", stretch)
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
