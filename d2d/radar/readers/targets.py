"""Scans of the targets in logs: which are used, and with which standard deviations."""

import math
import warnings
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from d2d._checks import FINITE
from d2d._types import Array
from d2d.radar.scans.scan import MEASURED, RadarScan

Mask = NDArray[np.bool_]

# Between those that RadarScenes, nuScenes and the thesis's radar have.
_USUAL = {"sigma_range": 0.15, "sigma_azimuth": math.radians(0.5), "sigma_doppler": 0.06}


def valid(columns: Mapping[str, Array]) -> Mask:
    """Mask of the targets that have all numbers, and a place that is not the sensor's."""
    away = (
        columns["range"] > 0.0 if "range" in columns else (columns["x"] != 0) | (columns["y"] != 0)
    )
    return np.asarray(away & np.isfinite(np.stack([*columns.values()])).all(axis=0))


def select(
    where: str,
    what: str,
    columns: Mapping[str, Array],
    kept: Mask,
    sigmas: Mapping[str, float],
    min_snr: float | None,
) -> tuple[dict[str, Array], Mask]:
    """The columns with the standard deviations of all targets, and a mask of the targets to use.

    They are those of the ``kept`` ones that have the least SNR.  A warning counts the others.
    """
    lost, used = int((~kept).sum()), kept
    if lost:
        warnings.warn(
            f"{where}: {lost} of {len(kept)} {what} are left out, because a number is missing or "
            "not finite, or the range is not positive",
            stacklevel=3,
        )
    if min_snr is not None:
        if "snr" not in columns:
            raise ValueError(f"{where} has no column snr, which min_snr needs")
        used = kept & (columns["snr"] >= FINITE.number("min_snr", min_snr))
    stated = {**sigmas, **usual_sigmas(where, columns.keys() | sigmas, columns["doppler"][kept])}
    return {**columns, **{name: np.full(len(kept), s) for name, s in stated.items()}}, used


def usual_sigmas(
    where: object, known: Collection[str], doppler: Array | tuple[()] = ()
) -> dict[str, float]:
    """Standard deviations that stand in for those that are not known, with a warning if any do.

    It also tells of Doppler velocities that are rounded to steps for which its own is too small.
    """
    taken = sorted(_USUAL.keys() - known)
    distinct = np.unique(np.round(doppler, 6))
    step = np.diff(distinct).min() if 1 < len(distinct) < len(doppler) / 10 else 0.0
    sigma = step / math.sqrt(12.0)
    rounded = (
        f"; Doppler velocities come in steps of {step:.3g} m/s, so that --sigma-doppler must be at "
        f"least {sigma:.2g}"
    )
    if taken:
        warnings.warn(
            f"{where} has no {', '.join(taken)}: usual values are taken out of 0.15 m, 0.5 deg, "
            "0.06 m/s; --sigma-range, --sigma-azimuth and --sigma-doppler state those of your "
            "radar, on which the covariances rest"
            f"{rounded if 'sigma_doppler' in taken and sigma > _USUAL['sigma_doppler'] else ''}",
            stacklevel=4,
        )
    return {name: _USUAL[name] for name in taken}


def scan_of(time: float, columns: Mapping[str, Any]) -> RadarScan:
    """The scan of targets that have range and azimuth, or else x and y, and perhaps a height."""
    errors: dict[str, Any] = {n: c for n, c in columns.items() if n.startswith("sigma_")}
    if not {"range", "azimuth"} <= columns.keys():
        place = columns["x"], columns["y"], columns.get("z")
        return RadarScan.from_cartesian(time, *place, doppler=columns["doppler"], **errors)
    elevation = columns.get("elevation")
    if elevation is None and "z" in columns:
        elevation = np.arcsin(np.clip(columns["z"] / columns["range"], -1.0, 1.0))
    measured = (columns[name] for name in MEASURED)
    return RadarScan(time, *measured, **errors, elevation=elevation)
