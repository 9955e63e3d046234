"""Ego-motion on real drives: peers, Doppler velocities alone, and d2d, on the same rounds of scans.

python -m benchmarks.road [--radarscenes ROOT ...] [--nuscenes ROOT ...]

writes tables for each data set into the book's page; without roots it does nothing.

What registers points only gets what helps it: the static targets of all sensors, which the Doppler
velocities tell from moving ones, merged in the vehicle frame at the mean time of the scans, and the
motion by the Doppler velocities as its start.  It then returns the mean velocity since the earlier
scans, some 0.3 s before.  Each library has the radius with which its yaw rate is best on every
tenth round of the first drive.
"""

import argparse
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from benchmarks import peers
from benchmarks.report import table
from benchmarks.run import in_one_thread, without_chatter
from benchmarks.scenes import Draws
from d2d import PointSet, credibility, rigid
from d2d.baselines import ndt_p2d
from d2d.radar import (
    ErrorBudget,
    Mounting,
    RadarScan,
    Recording,
    Reference,
    Track,
    doppler_ego_motion,
    track,
)
from d2d.radar.tracks.rounds import Round, rounds_of
from d2d.radar.tracks.track import integrate
from d2d.study.recordings.road import (
    joint_reference,
    load_scene,
    load_sequence,
    scenes,
    sequences,
)
from d2d.study.results import results_path

Array = NDArray[np.float64]
View = tuple[RadarScan, Mounting]
Velocity = tuple[Array, Array]  # (3,) and its covariance (3, 3), nan where none is stated

HORIZON = 0.3  # s
LENGTH = 100.0  # m, over which the drift is measured
CELLS = (1.0, 2.0, 4.0)  # m, of the NDT
SPANS = (1.0, 5.0, 10.0, 30.0, 60.0)  # s, over which displacements are judged
FEWEST = 6  # spans, for a row
PILOT = 10  # rounds, of which one is used to choose a radius
NOT_STATED = np.full((3, 3), np.nan)


@dataclass(frozen=True)
class Drive:
    """A recording of several sensors, its rounds and its reference."""

    name: str
    recordings: list[Recording]
    rounds: list[Round]
    reference: Reference

    @classmethod
    def of(cls, name: str, recordings: list[Recording]) -> "Drive":
        sensors = [(list(own.scans), own.mounting) for own in recordings]
        return cls(name, recordings, rounds_of(sensors, 1, HORIZON), joint_reference(recordings))


@dataclass
class Row:
    """A method's errors (n, 3), covariances, drifts (m, 2), and seconds for each round."""

    name: str
    errors: list[Array] = field(default_factory=list)
    covariances: list[Array] = field(default_factory=list)
    drifts: list[Array] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)

    def add(self, drive: Drive, thetas: Array, covariances: Array, seconds: float) -> None:
        """Take a drive's velocities (n, 3); where one is nan, the last one is held for the path."""
        at = drive.reference.at([each.time for each in drive.rounds])
        errors = thetas - at.theta
        known = np.isfinite(errors).all(axis=1)
        self.errors.append(errors[known])
        self.covariances.append(covariances[known])
        intervals = np.array([each.interval for each in drive.rounds])
        self.drifts.append(drift(held(thetas), intervals, at.poses))
        self.seconds.append(seconds / len(drive.rounds))

    def cells(self) -> tuple[str, ...]:
        """The cells of the table."""
        errors, covariances = np.concatenate(self.errors), np.concatenate(self.covariances)
        rmse = np.sqrt(np.mean(errors**2, axis=0)) * [1.0, 1.0, np.rad2deg(1.0)]
        along, turned = np.sqrt(np.mean(np.concatenate(self.drifts) ** 2, axis=0))
        stated = np.isfinite(covariances).all(axis=(1, 2))
        stated &= np.linalg.det(np.nan_to_num(covariances)) > 0.0
        # a yaw rate of one sensor alone, or a side slip that is set to zero, has no covariance
        enough = stated.sum() > 0.5 * len(stated)
        anees = credibility(errors[stated], covariances[stated]).anees if enough else None
        return (
            self.name,
            *(f"{value:.3f}" for value in rmse),
            f"{along:.2f}",
            f"{np.rad2deg(turned):.2f}",
            "" if anees is None else f"{anees:.1f}",
            f"{1e3 * np.mean(self.seconds):.1f}",
        )


HEAD = ("method", "v_x, m/s", "v_y, m/s", "ω, °/s", "drift, m", "drift, °", "ANEES", "ms")


def held(thetas: Array) -> Array:
    """Velocities (n, 3), nan replaced by the last finite one, at first by zero."""
    good = np.isfinite(thetas).all(axis=1)
    last = np.maximum.accumulate(np.where(good, np.arange(len(thetas)), -1))
    return np.where((last >= 0)[:, None], thetas[np.maximum(last, 0)], 0.0)


def drift(thetas: Array, intervals: Array, poses: Array) -> Array:
    """Errors (m, 2) in m and rad of displacements over LENGTH metres of the reference's path."""
    path = integrate(thetas, intervals)[1:]
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    passed = np.concatenate([[0.0], np.cumsum(np.nan_to_num(steps))])
    starts = np.flatnonzero(passed <= passed[-1] - LENGTH)
    ends = np.searchsorted(passed, passed[starts] + LENGTH)
    ours, true = (rigid.compose(rigid.inverse(each[starts]), each[ends]) for each in (path, poses))
    turn = (ours[:, 2] - true[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
    errors = np.column_stack([np.hypot(*(ours - true)[:, :2].T), turn])
    return errors[np.isfinite(errors).all(axis=1)]


def static_points(views: Sequence[View], time: float) -> tuple[PointSet, Array]:
    """The static targets of all views in the vehicle frame at a time, and the Doppler velocity."""
    found = doppler_ego_motion(views)
    means, covariances = [], []
    for (scan, mounting), inliers in zip(views, found.inliers, strict=True):
        if inliers.any():
            # what the vehicle sees at the scan's time, seen from where it is at the common time
            moved = rigid.exponential((scan.time - time) * found.theta)
            points = scan[inliers].point_set(mounting).transformed(moved)
            means.append(points.means)
            covariances.append(points.covariances)
    return PointSet(np.concatenate(means), np.concatenate(covariances)), found.theta


def registered(current: Round, register: Callable[[PointSet, PointSet, Array], Array]) -> Velocity:
    """The velocity by a registration of a round's merged static points with earlier ones."""
    now = float(np.mean([pair.current.time for pair in current.pairs]))
    before = float(np.mean([pair.previous.time for pair in current.pairs]))
    fixed, _ = static_points([(p.previous, p.mounting) for p in current.pairs], before)
    moving, theta = static_points([(p.current, p.mounting) for p in current.pairs], now)
    interval = now - before
    motion = register(fixed, moving, rigid.exponential(interval * theta))
    return rigid.logarithm(motion) / interval, NOT_STATED


def by_doppler(side_slip: bool) -> Callable[[Round], Velocity]:
    """Weighted least squares of the Doppler velocities (Kellner et al. 2013, 2014)."""

    def velocity(current: Round) -> Velocity:
        views = [(pair.current, pair.mounting) for pair in current.pairs]
        found = doppler_ego_motion(views, side_slip=side_slip)
        return found.theta, found.covariance

    return velocity


def by_points(
    register: Callable[[PointSet, PointSet, Array], Array],
) -> Callable[[Round], Velocity]:
    """The velocity by what registers two sets from a start."""
    return lambda current: registered(current, register)


def by_peer(peer: peers.Peer, library: Any, setting: Any) -> Callable[[Round], Velocity]:
    """A library's registration with one setting."""

    def register(fixed: PointSet, moving: PointSet, start: Array) -> Array:
        batches = (PointSet(s.means[None], s.covariances[None]) for s in (fixed, moving))
        solve, read = peer.adapter(library, Draws(*batches, start), start, setting)
        return read(solve(0))

    return by_points(register)


def by_ndt(size: float) -> Callable[[Round], Velocity]:
    """The NDT of `d2d.baselines`, P2D, with cells of one size."""
    return by_points(
        lambda fixed, moving, start: ndt_p2d(fixed.means, moving.means, start, size=size).theta
    )


def run(method: Callable[[Round], Velocity], rounds: Sequence[Round]) -> tuple[Array, Array, float]:
    """Velocities (n, 3), covariances (n, 3, 3), nan where there is none, and processor seconds."""
    thetas, covariances = np.full((len(rounds), 3), np.nan), np.full((len(rounds), 3, 3), np.nan)
    begin = time.process_time()
    for i, current in enumerate(rounds):
        if current.pairs:
            try:
                thetas[i], covariances[i] = method(current)
            except ValueError:  # too few points for the method
                continue
    return thetas, covariances, time.process_time() - begin


def registrations() -> Iterator[tuple[str, dict[str, Callable[[Round], Velocity]]]]:
    """The NDT and the fast peers that are installed, each with its settings."""
    yield "NDT, P2D", {f"cells of {size:g} m": by_ndt(size) for size in CELLS}
    for peer in peers.PEERS:
        library, _ = peers.load(peer.module)
        if library is not None and peer.fast:
            name = peer.name.replace("true covariances", "our covariances")
            yield name, {f"{each:g} m": by_peer(peer, library, each) for each in peer.settings}


def best_registrations(drive: Drive) -> Iterator[tuple[str, Callable[[Round], Velocity]]]:
    """Each with the setting whose yaw rate is best on a part of a drive."""
    some = drive.rounds[::PILOT]
    truth = drive.reference.at([each.time for each in some]).theta[:, 2]

    def mean_square(method: Callable[[Round], Velocity]) -> float:
        return float(np.nanmean((run(method, some)[0][:, 2] - truth) ** 2))

    for name, settings in registrations():
        best = min(settings, key=lambda setting: mean_square(settings[setting]))
        yield f"{name}, {best}", settings[best]


def ours(drive: Drive, budget: ErrorBudget | None) -> tuple[Array, Array, float]:
    """The track of all sensors; nan where an estimate is refused."""
    begin = time.process_time()
    driven = track(drive.recordings, horizon=HORIZON, budget=budget)
    seconds = time.process_time() - begin
    good = driven.converged[:, None]
    covariances = np.where(good[..., None], driven.covariance, np.nan)
    return np.where(good, driven.theta, np.nan), covariances, seconds


def judged(drives: Sequence[Drive]) -> list[Row]:
    """Every method on every drive of a data set."""
    methods = {
        "Doppler velocities alone": by_doppler(True),
        "Doppler velocities alone, v_y = 0": by_doppler(False),
        **dict(best_registrations(drives[0])),
    }
    rows = []
    for name, method in methods.items():
        rows.append(Row(name))
        for drive in drives:
            rows[-1].add(drive, *run(method, drive.rounds))
        print(*rows[-1].cells(), sep=" | ", flush=True)
    for name, with_budget in (("d2d, inverse Hessian", False), ("d2d, with its budget", True)):
        rows.append(Row(name))
        for drive in drives:
            rows[-1].add(drive, *ours(drive, drive.recordings[0].budget if with_budget else None))
        print(*rows[-1].cells(), sep=" | ", flush=True)
    return rows


def radarscenes(root: Path, sequence: str) -> Drive:
    """A sequence, all sensors."""
    return Drive.of(f"sequence {sequence}", load_sequence(root, sequence))


def nuscenes(root: Path, scene: str) -> Drive:
    """A scene, all radars."""
    return Drive.of(scene, load_scene(root, scene))


def displacements(driven: Sequence[tuple[Drive, Track]], span: float) -> tuple[Array, Array]:
    """Errors (n, 3) of the displacements over spans that overlap by half, and their covariances."""
    errors, covariances = [], []
    for drive, own in driven:
        starts = np.arange(own.times[0], own.times[-1] - span, 0.5 * span)
        ends = [drive.reference.at(times).poses for times in (starts, starts + span)]
        judged = np.isfinite(ends).all(axis=(0, 2))
        starts, (begin, end) = starts[judged], np.array(ends)[:, judged]
        found = own.displacement(starts, starts + span)
        off = found.motion - rigid.compose(rigid.inverse(begin), end)
        off[:, 2] = (off[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
        errors.append(off)
        covariances.append(found.covariance)
    off, stated = np.concatenate(errors), np.concatenate(covariances)
    known = np.isfinite(off).all(axis=1) & np.isfinite(stated).all(axis=(1, 2))
    return off[known], stated[known]


def by_its_velocities(reference: Reference) -> Reference:
    """The reference with the path that its velocities make, from which its own sometimes departs.

    In the first seconds of RadarScenes 105 its path slides aside by 0.4 m/s.
    """
    known = np.isfinite(reference.theta).all(axis=1)
    times, theta = reference.times[known], reference.theta[known]
    return Reference(times, theta, integrate(0.5 * (theta[1:] + theta[:-1]), np.diff(times)))


def displacement_rows(drives: Sequence[Drive]) -> Iterator[tuple[str, ...]]:
    """For each span of which there are enough: its errors, and how they fit the covariance."""
    driven = [
        (each, track(each.recordings, horizon=HORIZON, budget=each.recordings[0].budget))
        for each in drives
    ]
    smooth = [
        (replace(drive, reference=by_its_velocities(drive.reference)), own) for drive, own in driven
    ]
    for span in SPANS:
        errors, covariances = displacements(driven, span)
        if len(errors) < FEWEST:
            return
        judged = credibility(errors, covariances)
        away = np.sqrt(np.mean(np.sum(errors[:, :2] ** 2, axis=1)))
        turned = np.rad2deg(np.sqrt(np.mean(errors[:, 2] ** 2)))
        inside = np.mean(judged.nees < chdtri(3, 0.05))
        yield (
            f"{span:g} s",
            str(len(errors)),
            f"{away:.2f}",
            f"{turned:.2f}",
            f"{judged.anees:.2f}",
            by_drive([displacements([each], span) for each in driven]),
            by_drive([displacements([each], span) for each in smooth]),
            f"{inside:.0%}",
        )


def by_drive(drives: Sequence[tuple[Array, Array]]) -> str:
    """The ANEES of each drive: both of two, the least and the largest of more."""
    found = [credibility(*each).anees for each in drives if len(each[0]) >= FEWEST // 2]
    if len(found) <= 2:
        return " / ".join(f"{anees:.2f}" for anees in found) or "–"
    return f"{min(found):.2f} to {max(found):.2f}"


SPAN_HEAD = (
    *("over", "spans", "error, m", "error, °", "ANEES"),
    *("by drive", "against its velocities", "inside 95 %"),
)


def caption(title: str, drives: Sequence[Drive]) -> str:
    """What a table is about."""
    driven = sum(len(drive.rounds) for drive in drives)
    names = ", ".join(drive.name for drive in drives)
    return f"**{title}** ({names}; {driven} rounds of {len(drives[0].recordings)} radars)"


def section(title: str, drives: Sequence[Drive]) -> str:
    """The table of a data set."""
    rows = [row.cells() for row in judged(drives)]
    return f"{caption(title, drives)}\n\n{table(HEAD, rows, 1)}"


def span_section(title: str, drives: Sequence[Drive]) -> str:
    """The table of a data set's displacements."""
    return f"{caption(title, drives)}\n\n{table(SPAN_HEAD, [*displacement_rows(drives)], 1)}"


def write(name: str, parts: Sequence[str]) -> None:
    """Write what the book's page includes."""
    head = "<!-- Written by `python -m benchmarks.road`. -->"
    results_path(name).write_text("\n\n".join([head, *parts, ""]), encoding="utf-8")


def main() -> None:
    """Judge every method on the drives at hand and write the tables into the book."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name in ("radarscenes", "nuscenes"):
        parser.add_argument(f"--{name}", type=Path, nargs="*", default=[])
    arguments = parser.parse_args()
    in_one_thread()
    warnings.simplefilter("ignore")
    without_chatter()
    drives = {}
    if arguments.radarscenes:
        drives["RadarScenes"] = [radarscenes(*at) for at in sequences(arguments.radarscenes)]
    if arguments.nuscenes:
        drives["nuScenes"] = [nuscenes(*at) for at in scenes(arguments.nuscenes)]
    if drives:
        write("road_displacements.md", [span_section(*each) for each in drives.items()])
        write("road_peers.md", [section(*each) for each in drives.items()])


if __name__ == "__main__":
    main()
