"""Displacements along recorded drives, judged against the path of the reference."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from scipy.special import chdtri

from d2d import credibility, rigid
from d2d._types import Array
from d2d.radar import Reference, Track
from d2d.radar.tracks.path import chain
from d2d.study.road.drive import HORIZON, Drive, Source
from d2d.study.road.markdown import markdown, write_page

SPANS = (1.0, 5.0, 10.0, 30.0, 60.0)  # s, over which displacements are judged
FEWEST = 4  # spans, for a row; the NEES of fewer says nothing
LENGTH = 100.0  # m, over which the drift is measured
STEP = 1e-3  # s: at 2 m/s^2 and 0.5 rad/s a path of 30 s is summed to 0.1 mm
HEAD = (
    *("over", "spans", "error, m", "error, °", "ANEES"),
    *("by drive", "against its velocities", "inside 95 %"),
)


def drift(driven: Track, reference: Reference) -> Array:
    """Errors (m, 2) in m and rad of displacements over LENGTH metres of the reference's path."""
    path, poses = driven.poses()[1:], reference.at(driven.times).poses
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    passed = np.concatenate([[0.0], np.cumsum(np.nan_to_num(steps))])
    starts = np.flatnonzero(passed <= passed[-1] - LENGTH)
    ends = np.searchsorted(passed, passed[starts] + LENGTH)
    known = np.asarray(np.isfinite(poses).all(axis=1))
    both = known[starts] & known[ends]
    starts, ends = starts[both], ends[both]
    ours, true = (rigid.compose(rigid.inverse(each[starts]), each[ends]) for each in (path, poses))
    off = difference(ours, true)
    return np.column_stack([np.hypot(*off[:, :2].T), off[:, 2]])


def difference(motions: Array, others: Array) -> Array:
    """Difference (n, 3) of motions, its angle in [-pi, pi)."""
    off = motions - others
    off[:, 2] = (off[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
    return off


def span_errors(driven: Track, reference: Reference, span: float) -> tuple[Array, Array]:
    """Errors (n, 3) of displacements over spans that overlap by half, and their covariances."""
    starts = np.arange(driven.times[0], driven.times[-1] - span, 0.5 * span)
    ends = [reference.at(times).poses for times in (starts, starts + span)]
    judged = np.isfinite(ends).all(axis=(0, 2))
    starts, (begin, end) = starts[judged], np.array(ends)[:, judged]
    found = driven.displacement(starts, starts + span)
    errors = difference(found.motion, rigid.compose(rigid.inverse(begin), end))
    known = np.isfinite(errors).all(axis=1) & np.isfinite(found.covariance).all(axis=(1, 2))
    return errors[known], found.covariance[known]


def by_its_velocities(reference: Reference) -> Reference:
    """The reference with the path that its velocities make, from which its own sometimes departs.

    Linear in between, they are summed in the world in steps of `STEP`, unlike a track's.
    """
    known = np.isfinite(reference.theta).all(axis=1)
    times, theta = reference.times[known], reference.theta[known]
    fine = np.linspace(times[0], times[-1], 1 + int(np.ceil((times[-1] - times[0]) / STEP)))
    velocities = np.column_stack([np.interp(fine, times, column) for column in theta.T])
    means = 0.5 * (velocities[1:] + velocities[:-1])
    poses = chain(rigid.exponential(np.diff(fine)[:, None] * means), np.zeros(3))
    return Reference(fine, velocities, poses)


def lines(tracks: Sequence[Track], references: Sequence[Reference]) -> Iterator[tuple[str, ...]]:
    """For each span of which there are enough: its errors, and how they fit the covariance."""
    smooth = [by_its_velocities(reference) for reference in references]
    for span in SPANS:
        each = [span_errors(*pair, span) for pair in zip(tracks, references, strict=True)]
        errors, covariances = (np.concatenate(column) for column in zip(*each, strict=True))
        if len(errors) < FEWEST:
            return
        judged = credibility(errors, covariances)
        yield (
            f"{span:g} s",
            str(len(errors)),
            f"{np.sqrt(np.mean(np.sum(errors[:, :2] ** 2, axis=1))):.2f}",
            f"{np.rad2deg(np.sqrt(np.mean(errors[:, 2] ** 2))):.2f}",
            f"{judged.anees:.2f}",
            by_drive(each),
            by_drive([span_errors(*pair, span) for pair in zip(tracks, smooth, strict=True)]),
            f"{np.mean(judged.nees < chdtri(3, 0.05)):.0%}",
        )


def by_drive(drives: Sequence[tuple[Array, Array]]) -> str:
    """The ANEES of each drive: both of two, the least and the largest of more."""
    found = [credibility(*each).anees for each in drives if len(each[0]) >= FEWEST]
    if len(found) <= 2:
        return " / ".join(f"{anees:.2f}" for anees in found) or "–"
    return f"{min(found):.2f} to {max(found):.2f}"


def caption(data_set: str, drives: Sequence[Drive]) -> str:
    """The data set of a table, its drives and how many rounds they have."""
    rounds = sum(len(drive.rounds) for drive in drives)
    titles = ", ".join(drive.title for drive in drives)
    return f"**{data_set}** ({titles}; {rounds} rounds of {len(drives[0].recordings)} radars)"


def write(sources: Mapping[str, Sequence[Source]]) -> None:
    """Judge displacements on the drives at hand and write the tables into the book."""
    parts = []
    for data_set, listed in sources.items():
        drives = [source.load() for source in listed]
        tracks = [drive.track(horizon=HORIZON, budget=drive.budget) for drive in drives]
        references = [drive.reference for drive in drives]
        each = zip(tracks, references, strict=True)
        along, turned = np.sqrt(np.mean(np.concatenate([drift(*d) for d in each]) ** 2, axis=0))
        drifted = f"Drift over {LENGTH:g} m: {along:.2f} m and {np.rad2deg(turned):.2f}° (RMS)."
        parts += [caption(data_set, drives), markdown(HEAD, [*lines(tracks, references)]), drifted]
    write_page("road_displacements.md", "d2d.study.road displacements", parts)
