"""Checks of the fields of a track, and the arrays that it keeps of them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from d2d._checks import check_instance, check_real
from d2d._types import Array
from d2d.radar.scans.budget import CovarianceParts

REQUIRED = ("times", "intervals", "theta", "covariance", "converged")
_SHAPES: dict[str, tuple[int, ...]] = {"theta": (3,), "covariance": (3, 3)}  # of a row; else ()
# s, and relative to the time since the first estimate: stamps in logs are often rounded
_STAMP, _DRIFT = 0.01, 1e-5
_ROUNDING = 1e-6  # of covariances, relative to their standard deviations
_KINDS = {"converged": ("b", "bool"), "reasons": ("U", "str"), "targets": ("iu", "int")}


def check_track(fields: dict[str, Any]) -> dict[str, Any]:
    """Copies of the fields of a `Track`, as arrays, each checked to be what the class says.

    Raises a ``ValueError`` that names the field.
    """
    given = {name: value for name, value in fields.items() if name in REQUIRED or value is not None}
    parts = given.pop("parts", None)
    arrays = {name: _array(name, value) for name, value in given.items()}
    count = len(arrays["times"]) if arrays["times"].ndim else 0
    for name, array in arrays.items():
        _check_shape(name, array, (count, *_SHAPES.get(name, ())))
    _check_times(arrays["times"], arrays["intervals"])
    good = arrays["converged"]
    for name in ("theta", "covariance"):
        if not np.isfinite(arrays[name][good]).all():
            raise ValueError(f"{name} must be finite wherever converged is true")
    _check_covariance(arrays["covariance"][good])
    _check_counts(arrays)
    kept = _parts(parts, count)
    if kept is not None:
        _check_sum(kept.total[good], arrays["covariance"][good])
    return arrays | {"parts": kept}


def _array(name: str, value: Any) -> NDArray[Any]:
    """A copy as an array of the type that the field has."""
    if name not in _KINDS:
        return check_real(name, value)
    kinds, wanted = _KINDS[name]
    array = np.array(value)
    if np.ma.is_masked(value) or (array.size and array.dtype.kind not in kinds):
        raise ValueError(f"{name} must be an array of {wanted}, without masked entries")
    return array.astype({"b": np.bool_, "U": np.str_, "iu": np.int64}[kinds], copy=False)


def _check_shape(name: str, array: NDArray[Any], shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise ValueError(f"{name} must have the shape {shape}, but has {array.shape}")


def _parts(parts: Any, count: int) -> CovarianceParts | None:
    if parts is None:
        return None
    check_instance("parts", parts, CovarianceParts)
    arrays = {name: check_real(f"parts.{name}", part) for name, part in parts._asdict().items()}
    for name, array in arrays.items():
        _check_shape(f"parts.{name}", array, (count, 3, 3))
    return CovarianceParts(**arrays)


def _check_times(times: Array, intervals: Array) -> None:
    if not (np.isfinite(intervals).all() and (intervals > 0.0).all()):
        raise ValueError("intervals must be finite and positive")
    if not (np.isfinite(times).all() and (np.diff(times) > 0.0).all()):
        raise ValueError("times must be finite and strictly increasing")
    added = np.cumsum(intervals[1:])
    passed = times[1:] - times[:1]
    wrong = np.abs(added - passed) > _STAMP + _DRIFT * passed
    if wrong.any():
        i = int(np.argmax(wrong))
        raise ValueError(
            f"intervals must add up to the differences of times, but from the first estimate to "
            f"number {i + 1} they add up to {added[i]:g} s where {passed[i]:g} s pass"
        )


def _check_counts(arrays: dict[str, NDArray[Any]]) -> None:
    """Raise a ValueError unless numbers of targets and shares of inliers, if known, can be such."""
    if (arrays.get("targets", np.zeros(0)) < 0).any():
        raise ValueError("targets must not be negative")
    shares = arrays.get("inliers", np.zeros(0))
    if not (np.isnan(shares) | ((shares >= 0.0) & (shares <= 1.0 + _ROUNDING))).all():
        raise ValueError("inliers must lie within [0, 1], or be nan")


def _check_sum(total: Array, stated: Array) -> None:
    """Raise a ValueError unless the parts (m, 3, 3) add up to the covariance."""
    sigmas = np.sqrt(np.diagonal(stated, axis1=1, axis2=2))
    allowed = _ROUNDING * sigmas[:, :, None] * sigmas[:, None, :]
    if not (np.abs(total - stated) <= allowed).all():
        raise ValueError("parts must add up to covariance wherever converged is true")


def _check_covariance(stated: Array) -> None:
    """Raise a ValueError unless finite matrices (m, 3, 3) are covariances, to within rounding."""
    sigmas = np.sqrt(np.clip(np.diagonal(stated, axis1=1, axis2=2), 0.0, None))
    scale = sigmas[:, :, None] * sigmas[:, None, :]
    if (np.abs(stated - stated.swapaxes(1, 2)) > _ROUNDING * scale).any():
        raise ValueError("covariance must be symmetric wherever converged is true")
    if (np.abs(stated) > (1.0 + _ROUNDING) * scale).any():
        raise ValueError(
            "covariance must have variances that are not negative, and correlations between "
            "-1 and 1, wherever converged is true"
        )
    correlations = np.divide(stated, scale, out=np.zeros_like(stated), where=scale > 0.0)
    if (np.linalg.eigvalsh(correlations) < -_ROUNDING).any():
        raise ValueError("covariance must be positive semidefinite wherever converged is true")
