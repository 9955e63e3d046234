"""Ego-motion on real drives: peers, Doppler velocities alone, and d2d, on the same rounds of scans.

python -m benchmarks.road FOLDER ...

writes a table for each data set, RadarScenes or nuScenes, into the book's page.

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
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from benchmarks import peers
from benchmarks.run import in_one_thread, without_chatter
from benchmarks.scenes import Draws
from d2d import PointSet, credibility, rigid
from d2d._types import Array
from d2d.baselines import ndt_p2d
from d2d.radar import Mounting, RadarScan, Track, doppler_ego_motion
from d2d.radar.tracks.rounds import Round
from d2d.study.road.displacements import caption, drift
from d2d.study.road.drive import HORIZON, Drive, find_drives
from d2d.study.road.markdown import markdown, write_page

Velocity = tuple[Array, Array]  # (3,) and its covariance (3, 3), nan where none is stated
Register = Callable[[PointSet, PointSet, Array], Array]
Method = Callable[[Round], Velocity]

CELLS = (1.0, 2.0, 4.0)  # m, of the NDT
PILOT = 10  # rounds, of which one is used to choose a radius
NOT_STATED = np.full((3, 3), np.nan)
HEAD = ("method", "$v_x$, m/s", "$v_y$, m/s", "ω, °/s", "drift, m", "drift, °", "ANEES", "ms")


class Outcome(NamedTuple):
    """A method's errors (n, 3) on a drive, covariances, drifts (m, 2), and seconds a round."""

    errors: Array
    covariances: Array
    drifts: Array
    seconds: float


def outcome(
    drive: Drive, thetas: Array, covariances: Array, seconds: float, age: float = 0.0
) -> Outcome:
    """Compare velocities (n, 3), nan where there is none, and their path with those of a drive.

    The path takes the velocities as those at an ``age`` (s) before the times of the rounds.
    """
    times, intervals = (
        np.array([getattr(each, name) for each in drive.rounds]) for name in ("time", "interval")
    )
    errors = thetas - drive.reference.at(times).theta
    known, good = (np.isfinite(each).all(axis=1) for each in (errors, thetas))
    held = pd.DataFrame(thetas).ffill().fillna(0.0).to_numpy()
    unit = np.tile(np.eye(3), (len(times), 1, 1))  # a path needs no true covariances
    drifts = drift(Track(times - age, intervals, held, unit, good), drive.reference)
    return Outcome(errors[known], covariances[known], drifts, seconds / len(drive.rounds))


def cells(name: str, outcomes: Sequence[Outcome]) -> tuple[str, ...]:
    """The line of a method in the table."""
    errors = np.concatenate([each.errors for each in outcomes])
    covariances = np.concatenate([each.covariances for each in outcomes])
    rmse = np.sqrt(np.mean(errors**2, axis=0)) * [1.0, 1.0, np.rad2deg(1.0)]
    drifts = np.concatenate([each.drifts for each in outcomes])
    along, turned = np.sqrt(np.mean(drifts**2, axis=0))
    stated = np.isfinite(covariances).all(axis=(1, 2))
    stated &= np.linalg.det(np.nan_to_num(covariances)) > 0.0
    # a yaw rate of one sensor alone, or a side slip that is set to zero, has no covariance
    enough = stated.sum() > 0.5 * len(stated)
    anees = f"{credibility(errors[stated], covariances[stated]).anees:.1f}" if enough else ""
    numbers = (f"{along:.2f}", f"{np.rad2deg(turned):.2f}", anees)
    seconds = np.mean([each.seconds for each in outcomes])
    return (name, *(f"{value:.3f}" for value in rmse), *numbers, f"{1e3 * seconds:.1f}")


def static_points(
    views: Sequence[tuple[RadarScan, Mounting]], time: float
) -> tuple[PointSet, Array]:
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


def by_points(register: Register) -> Method:
    """The velocity by a registration of a round's merged static points with earlier ones."""

    def velocity(current: Round) -> Velocity:
        now = float(np.mean([pair.current.time for pair in current.pairs]))
        before = float(np.mean([pair.previous.time for pair in current.pairs]))
        fixed, _ = static_points([(p.previous, p.mounting) for p in current.pairs], before)
        moving, theta = static_points([(p.current, p.mounting) for p in current.pairs], now)
        interval = now - before
        motion = register(fixed, moving, rigid.exponential(interval * theta))
        return rigid.logarithm(motion) / interval, NOT_STATED

    return velocity


def by_doppler(side_slip: bool) -> Method:
    """Weighted least squares of the Doppler velocities (Kellner et al. 2013, 2014)."""

    def velocity(current: Round) -> Velocity:
        views = [(pair.current, pair.mounting) for pair in current.pairs]
        found = doppler_ego_motion(views, side_slip=side_slip)
        return found.theta, found.covariance

    return velocity


def by_peer(peer: peers.Peer, library: Any, setting: Any) -> Method:
    """A library's registration with one setting."""

    def register(fixed: PointSet, moving: PointSet, start: Array) -> Array:
        batches = (PointSet(s.means[None], s.covariances[None]) for s in (fixed, moving))
        solve, read = peer.adapter(library, Draws(*batches, start), start, setting)
        return read(solve(0))

    return by_points(register)


def by_ndt(size: float) -> Method:
    """The NDT of `d2d.baselines`, P2D, with cells of one size."""
    return by_points(
        lambda fixed, moving, start: ndt_p2d(fixed.means, moving.means, start, size=size).theta
    )


def run(method: Method, rounds: Sequence[Round]) -> tuple[Array, Array, float]:
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


def registrations() -> Iterator[tuple[str, dict[str, Method]]]:
    """The NDT and the fast peers that are installed, each with its settings."""
    yield "NDT, P2D", {f"cells of {size:g} m": by_ndt(size) for size in CELLS}
    for peer in peers.PEERS:
        library, _ = peers.load(peer.module)
        if library is not None and peer.fast:
            name = peer.name.replace("true covariances", "our covariances")
            yield name, {f"{each:g} m": by_peer(peer, library, each) for each in peer.settings}


def best_registrations(drive: Drive) -> Iterator[tuple[str, Method]]:
    """Each with the setting whose yaw rate is best on a part of a drive."""
    some = drive.rounds[::PILOT]
    truth = drive.reference.at([each.time for each in some]).theta[:, 2]

    def mean_square(method: Method) -> float:
        return float(np.nanmean((run(method, some)[0][:, 2] - truth) ** 2))

    for name, settings in registrations():
        best = min(settings, key=lambda setting: mean_square(settings[setting]))
        yield f"{name}, {best}", settings[best]


def ours(drive: Drive, **options: Any) -> tuple[Array, Array, float]:
    """The track of all sensors; nan where an estimate is refused."""
    begin = time.process_time()
    driven = drive.track(horizon=HORIZON, **options)
    seconds = time.process_time() - begin
    good = driven.converged[:, None]
    covariances = np.where(good[..., None], driven.covariance, np.nan)
    return np.where(good, driven.theta, np.nan), covariances, seconds


def lines(drives: Sequence[Drive]) -> Iterator[tuple[str, ...]]:
    """The line of every method on the drives of a data set."""
    for name, side_slip in (("", True), (", $v_y = 0$", False)):
        found = [outcome(d, *run(by_doppler(side_slip), d.rounds)) for d in drives]
        yield cells(f"Doppler velocities alone{name}", found)
    for name, method in best_registrations(drives[0]):
        # the mean velocity over the horizon is that in its middle
        found = [outcome(d, *run(method, d.rounds), age=0.5 * HORIZON) for d in drives]
        yield cells(name, found)
    yield cells("d2d, bare pairs", [outcome(d, *ours(d, carry=False)) for d in drives])
    yield cells("d2d, by default", [outcome(d, *ours(d, carry=True)) for d in drives])
    yield cells("d2d, with its budget", [outcome(d, *ours(d, budget=d.budget)) for d in drives])


def main() -> None:
    """Compare every method on the drives at hand and write the tables into the book."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", type=Path, nargs="*", metavar="FOLDER")
    arguments = parser.parse_args()
    in_one_thread()
    warnings.simplefilter("ignore")
    without_chatter()
    parts = []
    for data_set, sources in find_drives(arguments.folders).items():
        drives = [source.load() for source in sources]
        parts += [caption(data_set, drives), markdown(HEAD, [*lines(drives)])]
    if parts:
        write_page("road_peers.md", "benchmarks.road", parts)


if __name__ == "__main__":
    main()
