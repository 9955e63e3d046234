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
from d2d.radar.scans.reference import Recording, Reference, SlipLaw
from d2d.radar.scans.scan import Mounting, RadarScan
from d2d.radar.tracks.rounds import check_distinct

_POWERS = (0, 2)  # of v_x in the slip law
_LAG, _AHEAD, _COMPLIANCE, _BIAS = 0, 2, 3, -1  # places among the parameters
# A drive does not determine a parameter whose standard deviation is larger than this.
_LIMITS = {_LAG: 0.1, _BIAS: np.deg2rad(0.3), _AHEAD: 0.3, _COMPLIANCE: 0.01}  # s, rad/s, m, s^2/m
_DEGREES = np.rad2deg(1.0)
_SEARCHED = SECONDS._replace(least=1e-6, most=1e4)
_AT_BOUND = 1e-3  # s
_SLOW = 1.0  # s: a filter averages what is faster
_SURE = 3.0  # standard deviations beyond a limit
_MAX_SELECTIONS = 10  # of scans that are not grossly off
_MIN_SPEED = 0.5  # m/s
_AHEAD_BOUND = METRES._replace(most=100.0)  # m
# Standard deviations that residuals may have.  They have 0.9 on RadarScenes, 3 where five vehicles
# ahead are all that is seen, and with sigmas far too small 6 and more, where two targets of each
# scan are left, which fit anything.
_UNEXPLAINED = 2.0
_FACTORS = 0.8, 1.25  # on the reference's speed; km/h are 0.278 and mph 0.447
_PLACES = -2.0, 8.0  # m, how far the origin may be ahead of the rear axle, of a truck or bus

SensorLog = tuple[Iterable[RadarScan], Mounting, Reference]


@dataclass(frozen=True, eq=False)
class Calibration:
    """The corrections of a reference and of the mountings; prints as a table.

    The radars' time stamps are late by ``lag`` (s), early if it is negative: a scan at t shows the
    motion that the reference gives for t - lag.  The reference's v_x is to be multiplied by
    ``speed_factor``; ``slip`` gives the lateral velocity.  ``yaw`` (S,) in rad is to be added to
    the mounting angle of each sensor, as it is in ``mountings``, and ``bias`` (rad/s) to be taken
    off the reference's yaw rate.  ``covariance`` (5 + S, 5 + S) is that of [lag, speed_factor,
    slip.ahead, slip.compliance, yaw, bias], nan for parameters that were held instead of fitted.

    ``rms`` is the root mean square of the static targets' Doppler residuals over their standard
    deviations.  ``scans`` is the number of scans with targets, and ``share`` the share of them that
    was used; the others have no reference or are grossly off.  ``duration`` (s) is the length of
    the recordings, ``block`` (s) that of the blocks from which the covariance comes.
    """

    lag: float
    speed_factor: float
    slip: SlipLaw
    yaw: Array
    bias: float
    covariance: Array
    mountings: list[Mounting]
    rms: float
    share: float
    scans: int
    duration: float
    block: float

    @property
    def values(self) -> Array:
        """The parameters (5 + S,), in the order of ``covariance``."""
        slip = self.slip.ahead, self.slip.compliance
        return np.array([self.lag, self.speed_factor, *slip, *self.yaw, self.bias])

    @property
    def sigmas(self) -> Array:
        """Standard deviations (5 + S,), in the order of ``covariance``; nan where not fitted."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def azimuth(self) -> Array:
        """Standard deviations (S,) in rad of the sensors' directions over a block.

        Those of ``yaw`` are of the mean over all blocks.  If a block is longer than a second, this
        is a slow error, as `ErrorBudget.azimuth`: of a lone radar larger than of one of several.
        """
        return np.asarray(
            self.sigmas[_BIAS - len(self.yaw) : _BIAS] * np.sqrt(self.duration / self.block)
        )

    def reference(self, reference: Reference) -> Reference:
        """The reference as the radars see it, at its times; nan where shifted times leave it.

        Lag, factor and bias are applied, and v_y is given by the slip law.  The poses are shifted.
        """
        check_instance("reference", reference, Reference)
        moved = reference.at(reference.times - self.lag)
        v_x, omega = self.speed_factor * moved.theta[:, 0], moved.theta[:, 2] - self.bias
        theta = np.column_stack([v_x, self.slip.lateral(v_x, omega), omega])
        return Reference(reference.times, theta, moved.poses)

    def __str__(self) -> str:
        sensors = range(1, len(self.yaw) + 1)
        rows = [
            ("lag", 1.0, "s"),
            ("speed factor", 1.0, ""),
            ("ahead of the rear axle", 1.0, "m"),
            ("compliance", 1.0, "s^2/m"),
            *((f"yaw of sensor {s} of {len(self.yaw)}", _DEGREES, "deg") for s in sensors),
            ("bias of the yaw rate", _DEGREES, "deg/s"),
        ]
        lines = [
            f"{self.scans} scans over {self.duration:.1f} s, {self.share:.1%} of them used; "
            f"Doppler residuals {self.rms:.2f} sigma",
            "",
        ]
        for (name, unit, text), value, sigma in zip(rows, self.values, self.sigmas, strict=True):
            error = f"+- {sigma * unit:.5f}" if np.isfinite(sigma) else "held"
            lines.append(f"{name:22}  {value * unit:+10.5f} {error:11} {text}".rstrip())
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
    mounting.  No registration is needed.

    Raises a ``ValueError`` if an argument is invalid, or the best fit cannot be true: residuals of
    more than two standard deviations, a lag at a bound of the search, a speed that is wrong by more
    than a quarter, as in km/h, an axle more than 2 m ahead of the origin or 8 m behind it, as with
    yaw rates that count clockwise, or a mounting turned by more than half a turn.  Warns if the
    drive has too little acceleration to determine the lag, which is then held at zero.

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

    Notes
    -----
    The covariance is that of a circular block bootstrap over time, in closed form, because the
    reference's errors last, enlarged by what a fit uses up; it does not contain what varies more
    slowly than the recording is long.  A scan is left out if its sensor's velocity deviates from
    the reference, in standard deviations, by more than five times the median of that sensor.

    ``ahead`` and ``compliance`` can be told apart only if bends are driven at different speeds.
    The bias is held at zero if its standard deviation exceeds 0.3 deg/s, then ``ahead`` if its own
    exceeds 0.3 m, and then ``compliance`` too if its own still exceeds 0.01 s^2/m.

    Examples
    --------
    >>> import numpy as np
    >>> from d2d.radar import Reference, calibrate, simulate_drive
    >>> drive = simulate_drive(np.random.default_rng(0), duration=20.0)
    >>> late = Reference(drive.truth.times - 0.2, drive.truth.theta, drive.truth.poses)
    >>> found = calibrate([(drive.scans, drive.mounting, late)])
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
    _check_residuals(found)
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
    lag, speed, offset, square, *yaw, bias = found.parameters.tolist()
    unit = np.ones(len(spread))
    unit[_COMPLIANCE] = -1.0 / (1.0 + speed) ** 2  # the fit multiplies the reference's v_x^2
    _check(found, np.sqrt(spread[_AHEAD, _AHEAD]), bool(model.free[_LAG]), bound)
    return Calibration(
        lag=lag,
        speed_factor=1.0 + speed,
        slip=SlipLaw(offset, square * unit[_COMPLIANCE]),
        yaw=np.array(yaw),
        bias=bias,
        covariance=spread * np.outer(unit, unit),
        mountings=[
            replace(mounting, yaw=float(np.fmod(mounting.yaw + angle, 2.0 * np.pi)))
            for (_, mounting, _), angle in zip(logs, yaw, strict=True)
        ],
        rms=_check_residuals(found),
        share=float(found.known.mean()),
        scans=len(velocities.time),
        duration=float(np.ptp(velocities.time)),
        block=block,
    )


def _check_residuals(found: Fit) -> float:
    """The residuals' root mean square; a ValueError if it is far above one."""
    rms = float(np.sqrt(found.mean_square))
    if not rms < _UNEXPLAINED:
        raise ValueError(
            "recordings must have Doppler velocities that their sigmas explain, but residuals are "
            f"{rms:.1f} standard deviations; are sigma_doppler and sigma_azimuth too small, or is "
            f"the reference that of another drive or clock (best lag {found.lag:+.2f} s)?"
        )
    return rms


def _check(found: Fit, sigma_ahead: float, searched: bool, bound: float) -> None:
    """Raise a ValueError if the best fit cannot be true: nothing may be stated by it."""
    lag, speed, ahead, _, *yaw, _ = found.parameters
    margin = _SURE * float(np.nan_to_num(sigma_ahead))
    said = ""
    if searched and abs(lag) > bound - _AT_BOUND:
        said = (
            f"clocks that differ by less than max_lag, but the best lag, {lag:+.3f} s, is at the "
            "bound of the search; is the reference that of another drive?"
        )
    elif not _FACTORS[0] < 1.0 + speed < _FACTORS[1]:
        hint = "are they in km/h" if speed > -1.0 else "is a radar mounted backwards"
        said = (
            f"a reference with speeds in m/s, but they would have to be multiplied by "
            f"{1.0 + speed:.3f}; {hint}?"
        )
    elif not _PLACES[0] - margin < ahead < _PLACES[1] + margin:
        said = (
            f"mountings relative to an origin near the rear axle, but it would be {ahead:.1f} m "
            "ahead of it; does the reference's yaw rate count clockwise?"
        )
    elif max(map(abs, yaw)) > np.pi:
        said = f"mountings near their places, but one is turned by {np.rad2deg(max(yaw)):.0f} deg"
    if said:
        raise ValueError(f"recordings must have {said}")


def _logs(recordings: Recording | Iterable[Recording | SensorLog]) -> list[SensorLog]:
    if isinstance(recordings, Recording):
        recordings = [recordings]
    rows = [
        (entry.scans, entry.mounting, entry.reference) if isinstance(entry, Recording) else entry
        for entry in check_members("recordings", recordings, object)
    ]
    logs: list[SensorLog] = []
    for s, (scans, mounting, reference) in enumerate(
        check_rows("recordings", rows, Iterable, Mounting, Reference)
    ):
        name = f"recordings[{s}]"
        listed = check_members(f"the scans of {name}", scans, RadarScan)
        if len({scan.time for scan in listed if scan.size}) < 2:
            raise ValueError(f"{name} must have at least two scans with targets")
        if not any(scan.doppler.any() for scan in listed):
            raise ValueError(f"{name} must have Doppler velocities, but all of them are zero")
        if len(reference.times) < 2 or not (np.diff(reference.times) > 0).all():
            raise ValueError(f"{name} must have a reference with at least two times, increasing")
        if np.isnan(reference.theta[:, [0, 2]]).any(axis=1).all():
            raise ValueError(
                f"{name} must have a reference with speeds and yaw rates, not only one"
            )
        if not (np.abs(reference.theta[:, 0]) > _MIN_SPEED).any():
            raise ValueError(f"{name} must be of a moving vehicle, but its reference stands still")
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
