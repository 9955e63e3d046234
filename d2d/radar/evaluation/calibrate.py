"""Clock, speed, side slip and mounting angles, found from Doppler velocities alone."""

import warnings
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from d2d._checks import METRES, SECONDS, check_instance, check_members, check_rows
from d2d._types import Array
from d2d.radar.evaluation.calibration_model import (
    CalibrationModel,
    Fit,
    agreeing,
    covariance,
    fit,
    scan_velocities,
)
from d2d.radar.evaluation.sensor_motion import wrapped
from d2d.radar.scans.reference import Recording, Reference, SlipLaw
from d2d.radar.scans.scan import Mounting, RadarScan
from d2d.radar.tracks.rounds import check_distinct

_POWERS = (0, 2)  # of v_x in the slip law
_LAG, _AHEAD, _COMPLIANCE, _BIAS = 0, 2, 3, -1  # places among the parameters
# A drive does not determine a parameter whose standard deviation is larger than this.
_LIMITS = {_LAG: 0.1, _BIAS: np.deg2rad(0.3), _AHEAD: 0.3, _COMPLIANCE: 0.01}  # s, rad/s, m, s^2/m
_SEARCHED = SECONDS._replace(least=1e-6, most=1e4)
_AT_BOUND = 1e-3  # s
_SLOW = 1.0  # s: a filter averages what is faster
_SURE = 3.0  # standard deviations beyond a limit
_MAX_SELECTIONS = 10  # of scans that are not grossly off
_MIN_SPEED = 0.5  # m/s
_AHEAD_BOUND = METRES._replace(most=100.0)  # m
_UNEXPLAINED = 2.0  # standard deviations; residuals have 0.9 on RadarScenes, 3 in mere traffic
_FACTORS = 0.8, 1.25  # on the reference's speed; km/h are 0.278 and mph 0.447
_PLACES = -2.0, 8.0  # m, how far the origin may be ahead of the rear axle, of a truck or bus

SensorLog = tuple[Iterable[RadarScan], Mounting, Reference]


@dataclass(frozen=True, eq=False)
class Calibration:
    """The corrections of a reference and of the mountings of S sensors; prints as a table.

    A scan at t shows the motion that the reference gives for t − lag, with its v_x times
    ``speed_factor``, its yaw rate less ``bias``, and the lateral velocity of ``slip``.
    """

    lag: float  # s, by which the radars' time stamps are late; early if negative
    speed_factor: float
    slip: SlipLaw
    yaw: Array  # (S,), rad, added to the angles of the mountings
    bias: float  # rad/s
    covariance: Array  # (5 + S, 5 + S) of `values`, nan for what was held instead of fitted
    mountings: list[Mounting]  # with the angles corrected
    rms: float  # of the static targets' Doppler residuals over their standard deviations
    share: float  # of the scans, without those that have no reference or are grossly off
    scans: int  # with targets
    duration: float  # s, of the recordings
    block: float  # s, of the blocks from which the covariance comes

    @property
    def values(self) -> Array:
        """[lag, speed_factor, slip.ahead, slip.compliance, yaw, bias] (5 + S,)."""
        slip = self.slip.ahead, self.slip.compliance
        return np.array([self.lag, self.speed_factor, *slip, *self.yaw, self.bias])

    @property
    def sigmas(self) -> Array:
        """Standard deviations (5 + S,) of `values`; nan where not fitted."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def azimuth(self) -> Array:
        """Standard deviations (S,) in rad of the sensors' directions over a block."""
        sigmas = self.sigmas[_BIAS - len(self.yaw) : _BIAS]
        return np.asarray(sigmas * np.sqrt(self.duration / self.block))

    def reference(self, reference: Reference) -> Reference:
        """The reference as the radars see it, poses included; nan where shifted times leave it."""
        check_instance("reference", reference, Reference)
        moved = reference.at(reference.times - self.lag)
        v_x, omega = self.speed_factor * moved.theta[:, 0], moved.theta[:, 2] - self.bias
        theta = np.column_stack([v_x, self.slip.lateral(v_x, omega), omega])
        return Reference(reference.times, theta, moved.poses)

    def __str__(self) -> str:
        yaws = [f"yaw of sensor {s + 1} of {len(self.yaw)}" for s in range(len(self.yaw))]
        rows = {"lag": "s", "speed factor": "", "ahead of the rear axle": "m"}
        rows |= {"compliance": "s^2/m"} | dict.fromkeys(yaws, "deg")
        rows["bias of the yaw rate"] = "deg/s"
        units = [np.rad2deg(1.0) if text.startswith("deg") else 1.0 for text in rows.values()]
        numbers = zip(rows.items(), units * self.values, units * self.sigmas, strict=True)
        lines = [
            f"{self.scans} scans over {self.duration:.1f} s, {self.share:.1%} of them used; "
            f"Doppler residuals {self.rms:.2f} sigma",
            "",
        ]
        for (name, text), value, sigma in numbers:
            error = f"+- {sigma:.5f}" if np.isfinite(sigma) else "held"
            lines.append(f"{name:22}  {value:+10.5f} {error:11} {text}".rstrip())
        lines += ["", f"Standard deviations from blocks of {self.block:.1f} s."]
        if self.block > _SLOW:
            each = ", ".join(f"{azimuth:.2f}" for azimuth in np.rad2deg(self.azimuth))
            lines.append(f"For as long, directions are off by {each} deg: azimuth of a budget.")
        return "\n".join(lines)


def calibrate(
    recordings: Recording | Iterable[Recording | SensorLog],
    *,
    max_lag: float = 0.5,
    ahead: float | None = None,
) -> Calibration:
    """Find the clock, speed, side slip and mounting angles that fit the Doppler velocities best.

    The static targets of each scan, found as in `doppler_ego_motion`, show the velocity of their
    sensor.  It is compared with the one that the reference's v_x and omega give, corrected by a
    lag, a factor on v_x, a bias of omega, the side slip of `SlipLaw`, and an angle added to each
    mounting.  Raises a ``ValueError`` if an argument is invalid, or the best fit cannot be true, as
    with residuals of more than two standard deviations, or a lag at a bound of the search.  Warns
    if the drive has too little acceleration to determine the lag, which is then held at zero.

    Parameters
    ----------
    recordings : Recording, or iterable of Recording or (scans, mounting, reference)
        One entry for each sensor of a vehicle, all on the same clock.  Only the times, v_x and
        omega of the references are used.  They should be uncorrected:
        ``load_radarscenes(..., time_offset=0)``,
        ``load_nuscenes(..., time_offset=0, speed_factor=1)``.
    max_lag : float, s
        The lag is searched for from -max_lag to max_lag.
    ahead : float, m, optional
        How far the vehicle frame's origin lies ahead of the rear axle.  By default it is fitted.

    Examples
    --------
    >>> import numpy as np
    >>> from d2d.radar import Reference, calibrate, simulate_drive
    >>> run = simulate_drive(np.random.default_rng(0), duration=20.0)
    >>> late = Reference(run.truth.times - 0.2, run.truth.theta, run.truth.poses)
    >>> found = calibrate([(run.scans, run.mounting, late)])
    >>> bool(abs(found.lag - 0.2) < 3.0 * found.sigmas[0])
    True
    """
    logs = _logs(recordings)
    bound = _SEARCHED.number("max_lag", max_lag)
    velocities = scan_velocities((scans, mounting) for scans, mounting, _ in logs)
    model = CalibrationModel.of(velocities, [reference for *_, reference in logs], _POWERS)
    if ahead is not None:
        model.start[_AHEAD] = _AHEAD_BOUND.number("ahead", ahead)
        model.free[_AHEAD] = False
    model.free[_BIAS] = False  # until scans that follow traffic are left out
    model, _ = _selected(model, bound)
    model.free[_BIAS] = True
    model, found = _selected(model, bound)
    _check(found)
    spread, block = covariance(model, found)
    for place, limit in _LIMITS.items():
        if not spread[place, place] > limit**2:  # nan if it is held already
            continue
        if place == _LAG:
            warnings.warn(
                "the drive has too little acceleration to find the lag, which is held at 0 s",
                stacklevel=2,
            )
        model.free[place] = False
        model, found = _selected(model, bound)
        spread, block = covariance(model, found)
    lag, speed, offset, square, *turns, bias = found.parameters.tolist()
    yaw = wrapped(turns)  # a fit may have gone round several times
    unit = np.ones(len(spread))
    unit[_COMPLIANCE] = -1.0 / (1.0 + speed) ** 2  # the fit multiplies the reference's v_x^2
    margin = _SURE * float(np.nan_to_num(np.sqrt(spread[_AHEAD, _AHEAD])))
    _check(found, bound if model.free[_LAG] else np.inf, margin)
    return Calibration(
        lag=lag,
        speed_factor=1.0 + speed,
        slip=SlipLaw(offset, square * unit[_COMPLIANCE]),
        yaw=yaw,
        bias=bias,
        covariance=spread * np.outer(unit, unit),
        mountings=[
            replace(mounting, yaw=float(np.fmod(mounting.yaw + angle, 2.0 * np.pi)))
            for (_, mounting, _), angle in zip(logs, yaw, strict=True)
        ],
        rms=float(np.sqrt(found.mean_square)),
        share=float(found.known.mean()),
        scans=len(velocities.time),
        duration=float(np.ptp(velocities.time)),
        block=block,
    )


def _check(found: Fit, bound: float = np.inf, margin: float = np.nan) -> None:
    """Raise a ValueError if a fit cannot be true; without a margin (m), by its residuals."""
    (lag, speed, ahead, *_), rms = found.parameters, np.sqrt(found.mean_square)
    said = ""
    if not rms < _UNEXPLAINED:
        said = (
            f"Doppler velocities that their sigmas explain, but residuals are {rms:.1f} standard "
            "deviations; are sigma_doppler and sigma_azimuth too small, or is the reference that "
            f"of another drive or clock (best lag {lag:+.2f} s)?"
        )
    elif np.isnan(margin):
        return
    elif abs(lag) > bound - _AT_BOUND:
        said = (
            f"clocks within max_lag, but the best lag, {lag:+.3f} s, is at the bound of the search"
        )
    elif not _FACTORS[0] < 1.0 + speed < _FACTORS[1]:
        hint = "are they in km/h" if speed > -1.0 else "is a radar mounted backwards"
        said = f"speeds in m/s, but the reference's have a factor of {1.0 + speed:.3f}; {hint}?"
    elif not _PLACES[0] - margin < ahead < _PLACES[1] + margin:
        said = (
            f"the rear axle near the origin, not {ahead:.1f} m behind; is the yaw rate clockwise?"
        )
    if said:
        raise ValueError(f"recordings must have {said}")


def _logs(recordings: Recording | Iterable[Recording | SensorLog]) -> list[SensorLog]:
    given = [recordings] if isinstance(recordings, Recording) else recordings
    rows = [
        (entry.scans, entry.mounting, entry.reference) if isinstance(entry, Recording) else entry
        for entry in check_members("recordings", given, object)
    ]
    logs: list[SensorLog] = []
    for scans, mounting, reference in check_rows("recordings", rows, Iterable, Mounting, Reference):
        name = f"recordings[{len(logs)}]"
        listed = check_members(f"the scans of {name}", scans, RadarScan)
        speed, rate = reference.theta[:, 0], reference.theta[:, 2]
        needed = {
            "at least two scans with targets": len({s.time for s in listed if s.size}) > 1,
            "Doppler velocities, but all of them are zero": any(s.doppler.any() for s in listed),
            "a reference with at least two times, increasing": len(speed) > 1
            and (np.diff(reference.times) > 0.0).all(),
            "a reference with speeds and yaw rates, not only one": np.isfinite(speed + rate).any(),
            "a moving vehicle, but its reference stands still": (np.abs(speed) > _MIN_SPEED).any(),
        }
        for what, there in needed.items():
            if not there:
                raise ValueError(f"{name} must have {what}")
        logs.append((listed, mounting, reference))
    if not logs:
        raise ValueError("recordings must hold at least one sensor, but is empty")
    check_distinct({f"recordings[{s}]": scans for s, (scans, *_) in enumerate(logs)})
    return logs


def _selected(model: CalibrationModel, bound: float) -> tuple[CalibrationModel, Fit]:
    """Alternate fitting and gating until the set of scans is stable."""
    found = fit(model, -bound, bound)
    for _ in range(_MAX_SELECTIONS):
        used = agreeing(model, found)
        if (used == model.used).all():
            break
        model = replace(model, used=used)
        found = fit(model, -bound, bound)
    return model, found
