"""Errors of an estimated drive: of the velocities, with their covariances, and of the path."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from d2d import rigid
from d2d.radar import Comparison
from d2d.radar.evaluation.compare import IN_UNITS, NAMES
from d2d.study.book.table import Column, Table, table

__all__ = ["IN_UNITS", "NAMES", "UNITS", "Drift", "errors_table"]

UNITS = ("m/s", "m/s", "°/s")  # of IN_UNITS, as figures and tables print them


def errors_table(comparisons: Mapping[str, Comparison], caption: str) -> Table:
    """Table of each comparison: errors, usable estimates and credibility.

    The interval of the ANEES is by a block bootstrap, since errors along a drive are correlated.
    """
    rows = {
        name: (
            *comparison.rmse,
            comparison.share,
            comparison.measures.anees,
            "{:.2f} to {:.2f}".format(*comparison.intervals().anees),
        )
        for name, comparison in comparisons.items()
    }
    columns: list[Column] = [
        "",
        *((name, unit, ".3f") for name, unit in zip(NAMES, UNITS, strict=True)),
        ("usable", "", ".1%"),
        ("ANEES", "", ".2f"),
        "95 % interval",
    ]
    return table(rows, columns, caption)


class Drift(NamedTuple):
    """Root mean square errors of a path, not aligned (APE), and per metre over stretches (RPE)."""

    ape_translation: float  # m
    ape_rotation: float  # deg
    rpe_translation: float  # m/m
    rpe_rotation: float  # deg/m

    @classmethod
    def of(cls, poses: ArrayLike, true: ArrayLike, stretch: float = 10.0) -> "Drift":
        """Compare poses (n, 3) with the true ones, by the package evo; ``stretch`` in m."""
        from evo.core.metrics import APE, RPE, PoseRelation, Unit  # type: ignore[import-untyped]

        paths = _evo_path(true), _evo_path(poses)
        relations = PoseRelation.translation_part, PoseRelation.rotation_angle_deg
        measures: list[Any] = [APE(relation) for relation in relations]
        measures += [
            RPE(relation, delta=stretch, delta_unit=Unit.meters, all_pairs=True)
            for relation in relations
        ]
        errors = []
        for measure, per in zip(measures, (1.0, 1.0, stretch, stretch), strict=True):
            measure.process_data(paths)
            errors.append(float(np.sqrt(np.mean(np.square(measure.error)))) / per)
        return cls(*errors)


def _evo_path(poses: ArrayLike) -> Any:
    from evo.core.trajectory import PosePath3D  # type: ignore[import-untyped]

    planar = np.asarray(poses, dtype=np.float64)
    matrices = np.zeros((len(planar), 4, 4))
    matrices[:, :2, :2] = rigid.rotation(planar[:, 2])
    matrices[:, :2, 3] = planar[:, :2]
    matrices[:, [2, 3], [2, 3]] = 1.0
    return PosePath3D(poses_se3=list(matrices))
