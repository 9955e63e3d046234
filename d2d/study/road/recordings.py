"""Logs as radars' software writes them, each tracked by one command, and a gyro beside a radar."""

from collections.abc import Mapping, Sequence
from itertools import pairwise, product
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from d2d import rigid
from d2d.radar import Gyro, Track, compare, simulate_drive, track
from d2d.radar.cli import REAL_OPTIONS, main
from d2d.study.plane.evaluation import rms
from d2d.study.road.displacements import drift
from d2d.study.road.drive import Source
from d2d.study.road.markdown import markdown, write_page

NOISE, BIAS = np.deg2rad([0.1, 0.5])  # of the gyro
LOGS = {  # the options that each needs; the first is real
    "Delphi ESR": REAL_OPTIONS,
    "simulated": "--columns x=y_m,y=-x_m,doppler=steps --scan-gap 0.01 --sigma-doppler 0.15 "
    "--mounting radar 0.4 0 0",
}
EPOCH = 1619075668.0  # s: zero of the times of the ESR's poses, by its log's clock
HEAD = ("log", "accepted", "RMSE of $v_x$, $v_y$ (m/s), ω (°/s)", "ANEES")
GYRO = ("front radar", "ω alone", "slip", "gyro", "both", "drift alone", "slip", "gyro", "both")
POSES = ("horizon", "distance", "turn", "turn is off by", "stated", "NEES / 3")


def write(sources: Mapping[str, Sequence[Source]]) -> None:
    """Write the table of the logs and, if RadarScenes is at hand, that of the gyro."""
    write_page("recordings.md", f"{__package__} recordings", [markdown(HEAD, log_lines())])
    if lines := gyro_lines(sources.get("RadarScenes", [])):
        write_page("recordings_gyro.md", f"{__package__} recordings", [markdown(GYRO, lines)])


def log_lines() -> list[list[str]]:
    """Track each log with one command: a line for each."""
    drive, lines, rows = simulate_drive(np.random.default_rng(0), 60.0), [], []
    for scan in drive.scans:
        x, y = scan.range * np.cos(scan.azimuth), scan.range * np.sin(scan.azimuth)
        stamps, steps = 1e9 * scan.time + 1e5 * np.arange(len(scan)), np.round(scan.doppler / 0.48)
        rows.append(np.stack([stamps, -y, x, 0.48 * steps]))
    with TemporaryDirectory() as folder:
        main(["example", "--real", log := f"{folder}/log.csv"])
        for name, options in LOGS.items():
            main(["track", "--csv", log, *options.split(), "--no-picture", "--output", folder])
            driven = Track.load(f"{folder}/track.npz")
            lines.append([name, f"{100 * driven.converged.mean():.1f} %", "no reference", ""])
            if options != REAL_OPTIONS:
                found = compare(driven, drive.truth)
                lines[-1][2] = ", ".join(f"{error:.3f}" for error in found.rmse)
                lines[-1][3] = f"{found.credibility.anees:.1f}"
            np.savetxt(log, np.hstack(rows).T, "%.12g", ",", header="t_ns,x_m,y_m,steps")
    return lines


def gyro_lines(sources: Sequence[Source]) -> list[list[str]]:
    """Track with a gyro beside each front radar of RadarScenes: a line for each radar."""
    lines = []
    for source in sources:
        whole, rng = source.load(), np.random.default_rng(0)
        times, first = np.unique(whole.reference.times, return_index=True)
        rates = whole.reference.theta[first, 2] + BIAS + NOISE * rng.standard_normal(len(times))
        known = np.isfinite(rates)
        gyro = Gyro(NOISE, np.deg2rad(1.0), times[known], rates[known])
        for side, one in zip(("right", "left"), whole.recordings[1:3], strict=True):
            ways = product((None, gyro), (True, 0.05))
            tracks = [track(one, budget=one.budget, gyro=g, side_slip=slip) for g, slip in ways]
            turns = [compare(driven, one.reference).rmse[2] for driven in tracks]
            drifts = [rms(drift(driven, one.reference)[:, 1]) for driven in tracks]
            cells = (f"{error:.2f}" for error in [*turns, *np.rad2deg(drifts)])
            lines.append([f"{whole.title}, {side}", *cells])
    return lines


def write_poses(folder: Path) -> None:
    """Judge displacements of the whole log of the ESR between the poses that are known."""
    poses = np.loadtxt(folder / "reference_poses.csv", delimiter=",") * [1, 1, 1, np.deg2rad(1.0)]
    (log,), lines = folder.glob("*.csv.gz"), []
    with TemporaryDirectory() as output:
        for horizon in ("0.3", "0.6", "1"):
            options = [*REAL_OPTIONS.split(), "--horizon", horizon, "--output", output, "--force"]
            main(["track", "--csv", str(log), *options, "--no-picture"])
            driven = Track.load(f"{output}/track.npz")
            for first, last in pairwise(poses):
                motion = rigid.compose(rigid.inverse(first[1:]), last[1:])
                found = driven.displacement([EPOCH + first[0]], [EPOCH + last[0]])
                error, covariance = found.motion[0] - motion, found.covariance[0]
                error[2] = np.arctan2(np.sin(error[2]), np.cos(error[2]))
                turns = np.rad2deg([motion[2], abs(error[2]), np.sqrt(covariance[2, 2])])
                cells = (f"{turn:.0f}°".replace("-", "−") for turn in turns)
                nees = error @ np.linalg.solve(covariance, error) / 3.0
                ends = f"{horizon} s", f"{np.hypot(*motion[:2]):.0f} m"
                lines.append([*ends, *cells, f"{nees:.1f}"])
    write_page("recordings_poses.md", f"{__package__} poses", [markdown(POSES, lines)])
