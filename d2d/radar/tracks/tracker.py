"""Ego-motion scan by scan, or over the whole log of a drive."""

from collections import deque
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from importlib.util import find_spec
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike

from d2d._checks import check_count, check_finite, check_flag, check_instance, check_mapping
from d2d.radar.motion.model import EstimationOptions, split_options
from d2d.radar.scans.budget import ErrorBudget
from d2d.radar.scans.scan import Mounting, RadarScan, level
from d2d.radar.tracks.estimator import OdometryEstimator, VelocityEstimate
from d2d.radar.tracks.filter import smooth_twice
from d2d.radar.tracks.gyro import Gyro, GyroRates
from d2d.radar.tracks.intake import ScanGate, usable
from d2d.radar.tracks.limits import VehicleLimits
from d2d.radar.tracks.rounds import (
    MAX_INTERVAL,
    Round,
    Rounds,
    Sensors,
    check_clocks,
    check_distinct,
    named_sensors,
    rounds_of,
)
from d2d.radar.tracks.track import Track

DEFAULT_LIMITS = VehicleLimits()
_BAR_DELAY = 2.0  # s, so that short tracks show no progress bar


class TrackOptions(EstimationOptions, total=False):
    """The options that `track` and `Tracker` share; `track` says what they are."""

    horizon: float | None
    baseline: int | None
    carry: bool
    initial: ArrayLike | None
    budget: ErrorBudget | None
    gyro: Gyro | None
    limits: VehicleLimits | None


def track(
    sensors: Sensors,
    *,
    smooth: bool = False,
    max_interval: float = MAX_INTERVAL,
    progress: bool | None = None,
    **options: Unpack[TrackOptions],
) -> Track:
    """Ego-motion over a whole drive from one sensor, or from several that need not be synchronised.

    The numbers are those of a `Tracker` that gets the scans of all sensors in time order: nothing
    that an estimate uses is later than its round, unless ``smooth`` is true.  A round holds at most
    one scan of each sensor; each after the first gives one estimate, at the mean time of its scans.
    An estimate that fails is marked as not converged, with the reason, and the track goes on.  The
    page of `d2d.radar` says when a round ends, what is left out, with a `ScanWarning`, and when an
    estimate fails.  If the clocks of all sensors step back, see `Track.segments`.

    Raises a ``ValueError`` if something is not a sensor, two have a scan in common, scans are out
    of time order or usually too far apart, the times of a sensor or gyro do not overlap with the
    others' or only its clock steps back, there are fewer than two rounds, or an argument is wrong.

    Parameters
    ----------
    sensors : Recording, (scans, Mounting), or a sequence or mapping of them
        Each with its scans in strictly increasing time; a simulated `Drive` will do, too.
    smooth : bool
        Whether the velocities rest on all estimates, also the later ones, instead of those before.
    max_interval : float, s
        Longest usual time between two scans of a sensor, which times in milliseconds exceed.
    progress : bool, optional
        Whether tqdm shows a bar; by default after two seconds, in a terminal with tqdm installed.
    horizon : float, s, optional
        Each scan is registered with the one of its sensor whose time is nearest to this long
        before, by default 0.3 s; or with the first one.
    baseline : int, optional
        The same as a number of scans, instead of a horizon.
    carry : bool
        Whether a Kalman filter of velocity and acceleration takes each estimate to the time of its
        round, by default; it considers the errors of the ``budget``, but does not learn them
        (Schmidt 1966).  False gives the bare pairs of `estimate_ego_motion`, which lag behind,
        without ``budget``, ``gyro`` or ``smooth``.
    initial : (3,) array, optional
        Start [v_x, v_y, omega] of the first estimate.
    budget : ErrorBudget, optional
        Errors that the targets of a sensor share, of the same standard deviations for each.
    gyro : Gyro, optional
        The yaw rates of a gyro, and how sure they are.
    limits : VehicleLimits, optional
        What the vehicle can do, by default a car; None accepts any motion.
    **options
        As for `estimate_ego_motion`.

    Examples
    --------
    >>> import numpy as np
    >>> from d2d.radar import simulate_drive, track
    >>> drive = simulate_drive(np.random.default_rng(0), duration=2.0)
    >>> driven = track(drive)  # or track((drive.scans, drive.mounting))
    >>> bool(driven.converged.all()), driven.theta.shape
    (True, (20, 3))
    >>> float(driven.poses()[-1, 0].round(1))  # m ahead
    6.2
    """
    drives = named_sensors(sensors, max_interval)
    estimator = _estimator(len(drives), options)
    if check_flag("smooth", smooth):
        if estimator.budget is None:
            raise ValueError("smooth must be False without carry, which it improves")
        estimator.records = []
    drives = usable(drives)
    check_clocks({name: scans for name, (scans, _) in drives.items()})
    groups = rounds_of([*drives.values()], options.get("baseline"), options.get("horizon"))
    if not groups:
        raise ValueError(
            "sensors must have at least two rounds of scans (of one sensor: two scans), but have "
            f"{int(any(scans for scans, _ in drives.values()))}"
        )
    rows = [estimator.step(each) for each in _counted(groups, progress)]
    if estimator.rates is not None and estimator.rates.used < 0.1 * len(rows):  # of no use
        raise ValueError(
            f"gyro must have yaw rates just before the scans, but only {estimator.rates.used} of "
            f"{len(rows)} rounds have one; is its clock another, or in another unit?"
        )
    if estimator.records:
        beliefs = iter(smooth_twice(estimator.records))
        rows = [estimator.filtered(row, next(beliefs)) if row.converged else row for row in rows]
    return track_of(rows)


class Tracker:
    """The motion of a vehicle scan by scan, as its sensors measure.  One is for one thread.

    It compiles what it needs when it is made, for up to a minute the first time on a machine and
    for a fifth of a second later; `gc.freeze` then spares a service full garbage collections, of
    80 ms.  It keeps the estimates; a service that runs for days takes them from `add` and says how
    many to ``keep``.

    Raises a ``ValueError`` if an argument is invalid.  Warns of the scans that it leaves out, as
    `track` does; ``logging.captureWarnings(True)`` sends warnings to the logger "py.warnings".

    Parameters
    ----------
    mountings : mapping of str to Mounting
        The sensors of the vehicle by name.
    keep : int, optional
        How many of the latest estimates ``track`` holds; by default all, about 2 kB each.
    **options
        As for `track`, from ``horizon`` on, which gives the same numbers bit for bit for the same
        scans in time order.

    Examples
    --------
    >>> import numpy as np
    >>> from d2d.radar import Tracker, simulate_drive
    >>> drive = simulate_drive(np.random.default_rng(0), duration=2.0)
    >>> tracker = Tracker({"front": drive.mounting})
    >>> for scan in drive.scans:
    ...     for estimate in tracker.add("front", scan):
    ...         v_x, v_y, omega = estimate.theta  # at estimate.time
    >>> tracker.track
    Track(20 estimates from 0.100 s to 2.000 s, 100.0% converged)
    """

    def __init__(
        self,
        mountings: Mapping[str, Mounting],
        *,
        keep: int | None = None,
        **options: Unpack[TrackOptions],
    ) -> None:
        if not check_mapping("mountings", mountings, Mounting):
            raise ValueError("mountings must hold at least one sensor, but is empty")
        if keep is not None:
            check_count("keep", keep)
        self._mountings = [*mountings.values()]
        self._numbers = {name: number for number, name in enumerate(mountings)}
        flat = [mounting.flat for mounting in self._mountings]
        self._rounds = Rounds(flat, options.get("baseline"), options.get("horizon"))
        self._gate = ScanGate([repr(name) for name in mountings], self._rounds)
        self._estimator = _estimator(len(flat), options)
        self._estimates: deque[VelocityEstimate] = deque(maxlen=keep)
        compile_for(self._estimator)

    def add(self, sensor: str, scan: RadarScan) -> list[VelocityEstimate]:
        """Take the next scan of a sensor; returns the estimates that it completes, often none.

        Scans may come a little out of order between sensors; one that is older than the last
        estimate is left out, with a warning.  A scan whose time is out of step waits for the next
        one, of any sensor.  If the clocks of all step back, so do the times of the estimates.

        Raises a ``ValueError`` if the sensor is unknown, ``scan`` is not a `RadarScan`, or not
        later than the sensor's scan before.
        """
        number = self._numbers.get(sensor)
        if number is None:
            known = ", ".join(map(repr, self._numbers))
            raise ValueError(f"sensor must be one of {known}, but is {sensor!r}")
        check_instance("scan", scan, RadarScan)
        scan, _ = level(scan, self._mountings[number])
        names = [*map(repr, self._numbers)]
        together = {names[other]: [own] for other, own in self._rounds.open.items()}
        check_distinct({names[number]: [scan], **together})
        return self._estimated(self._gate.push(number, scan)[1])

    def add_gyro(self, times: ArrayLike, yaw_rates: ArrayLike) -> None:
        """Take the next yaw rates (n,) in rad/s of the gyro, at their times (n,) in s.

        An estimate uses those until its own time that come before the scan which completes it.
        Raises a ``ValueError`` without a ``gyro``, or if times do not increase.
        """
        if self._estimator.rates is None:
            raise ValueError("gyro must be given to the Tracker (live: --gyro-sigma) first")
        self._estimator.rates.add(times, yaw_rates)

    def finish(self) -> list[VelocityEstimate]:
        """The estimate of the last round, which then ends."""
        return self._estimated(self._gate.finish())

    @property
    def track(self) -> Track:
        """The estimates so far."""
        return track_of(self._estimates)

    def _estimated(self, rounds: Iterable[Round]) -> list[VelocityEstimate]:
        estimates = []
        for each in rounds:
            try:
                estimates.append(self._estimator.step(each))
            except Exception:  # our mistake; the track goes on all the same
                self._estimates += [*estimates, self._estimator.failed(each, "an error")]
                raise
        self._estimates += estimates
        return estimates


def _estimator(sensors: int, options: TrackOptions) -> OdometryEstimator:
    """An estimator for this number of sensors, from options that are checked here."""
    unknown = options.keys() - TrackOptions.__annotations__.keys()
    if unknown:
        raise TypeError(f"unknown options: {', '.join(sorted(unknown))}")
    left = options.copy()
    left.pop("horizon", None)  # of the rounds
    left.pop("baseline", None)
    carry, initial = check_flag("carry", left.pop("carry", True)), left.pop("initial", None)
    budget, gyro = left.pop("budget", None), left.pop("gyro", None)
    limits = left.pop("limits", DEFAULT_LIMITS)
    check_instance("limits", limits, VehicleLimits, optional=True)
    for name, value, kind in (("budget", budget, ErrorBudget), ("gyro", gyro, Gyro)):
        check_instance(name, value, kind, optional=True)
        if value is not None and not carry:
            raise ValueError(f"{name} must be None without carry: bare pairs are not filtered")
    model, scales = split_options(left)
    if limits is not None and not model.doppler:
        # all components are determined poorly, and a side slip says nothing about omega
        free = dict.fromkeys(("yaw_rate_of_slip", "uncertainty", "speed_uncertainty"), np.inf)
        limits = replace(limits, **free)
    return OdometryEstimator(
        model,
        scales,
        None if initial is None else check_finite("initial", initial, "(3,)"),
        (budget or ErrorBudget()) if carry else None,
        limits,
        sensors,
        rates=None if gyro is None else GyroRates(gyro),
    )


def track_of(estimates: Collection[VelocityEstimate]) -> Track:
    """The estimates as the rows of a track."""
    count = len(estimates)
    times, intervals, theta, covariance, reasons, targets, inliers, _, errors = (
        zip(*estimates, strict=True) if estimates else [()] * len(VelocityEstimate._fields)
    )
    known = np.array(reasons, dtype=np.str_)
    unknown = next((np.full_like(each, np.nan) for each in errors if each is not None), None)
    return Track(
        np.array(times),
        np.array(intervals),
        np.array(theta).reshape(count, 3),
        np.array(covariance).reshape(count, 3, 3),
        known == "",
        known,
        np.array(targets, dtype=np.int64),
        np.array(inliers),
        None if unknown is None else np.array([unknown if e is None else e for e in errors]),
    )


def compile_for(estimator: OdometryEstimator) -> None:
    """Run what an estimator will run on a few made-up scans, so that all of it is compiled."""
    angles = np.linspace(-0.6, 0.6, 64)  # so many that the outlier component has tiles
    distances, along = 20.0 + 3.0 * np.cos(9.0 * angles), np.cos(angles)
    scans = [
        RadarScan(time, distances - time * along, angles, -along, 0.1, 0.01, 0.1)
        for time in (0.0, 0.1, 0.2)
    ]
    budget = None if estimator.budget is None else ErrorBudget(neighbours=1.0)
    for mountings in ([Mounting(1.0)], [Mounting(1.0), Mounting(-1.0, 0.5, 3.0)]):
        count, model, scales = len(mountings), estimator.model, estimator.scales
        tried = OdometryEstimator(model, scales, None, budget, None, count)
        for each in rounds_of([(scans, mounting) for mounting in mountings]):
            tried.step(each)


def _counted(rounds: list[Round], progress: bool | None) -> Iterable[Round]:
    """The rounds, with the progress bar that `track` describes."""
    if progress is False or (progress is None and not find_spec("tqdm")):
        return rounds
    from tqdm import tqdm

    # None hides it where there is no terminal
    hidden, delay = (False, 0.0) if progress else (None, _BAR_DELAY)
    bar: Iterable[Round] = tqdm(rounds, unit="estimate", disable=hidden, delay=delay)
    return bar
