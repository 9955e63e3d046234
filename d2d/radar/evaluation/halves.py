"""Covariances judged without a reference, by two independent estimates of the same motion."""

import warnings
from typing import Unpack

import numpy as np
import scipy
from numpy.typing import NDArray

from d2d._checks import check_choice, check_instance, check_positive_scalar
from d2d.radar.evaluation.compare import Comparison, enough
from d2d.radar.motion.estimate import estimate_ego_motion
from d2d.radar.motion.model import EstimationOptions
from d2d.radar.motion.pairs import ScanPair
from d2d.radar.scans.scan import RadarScan
from d2d.radar.tracks.intake import ScanWarning, usable
from d2d.radar.tracks.rounds import Sensors, named_sensors, rounds_of
from d2d.radar.tracks.track import Track, neighbours
from d2d.radar.tracks.tracker import track


def compare_tracks(first: Track, second: Track) -> Comparison:
    """Compare two tracks of the same vehicle with each other.

    If the tracks come from sensors that have no measurement in common, on the same clock, and both
    covariances are true, their differences have the sum of the covariances.  No reference is
    needed, so none adds errors of its own.  The comparison is at the times of ``first``: ``errors``
    are first minus second, ``covariances`` the sums, and ``converged`` is the share of ``first``.
    Raises a ``ValueError`` if fewer than four estimates can be compared, as with clocks that
    differ.

    Notes
    -----
    ``second`` is interpolated linearly between two successive converged estimates, unless they are
    more than twice the usual interval apart.  The interpolated covariance is that of a weighted
    mean of independent errors, ``(1 - w)^2 Sigma_i + w^2 Sigma_j``, which is too small for errors
    that change slowly.  Estimates at equal times are not affected.

    The difference contains the noise of both tracks and the biases of each sensor, which show as a
    mean whitened error that is not zero or changes slowly.  What the tracks have in common cancels,
    such as the lag of a common clock, so that credible differences do not prove credible estimates.
    """
    check_instance("first", first, Track)
    check_instance("second", second, Track)
    if not len(first.times):
        raise ValueError("first must hold at least one estimate, but is empty")
    errors = first.theta - second.at(first.times).theta
    before, after, weight, _ = neighbours(second, first.times)
    late = weight[:, np.newaxis, np.newaxis]
    covariances = first.covariance + (
        (1.0 - late) ** 2 * second.covariance[before] + late**2 * second.covariance[after]
    )
    found = Comparison.from_errors(first, errors, covariances)
    return enough(found, "first and second have")


def compare_halves(
    sensors: Sensors,
    rng: np.random.Generator,
    *,
    by: str = "target",
    distance: float = 2.0,
    baseline: int = 1,
    horizon: float | None = None,
    **options: Unpack[EstimationOptions],
) -> Comparison:
    """Estimate each motion twice, from each half of the targets, and compare the two.

    The targets of each *later* scan are divided at random.  Each half is registered with the whole
    scan before, so that every target keeps its counterpart.  Run it with both values of ``by``: the
    two ANEES distinguish standard deviations that are too small from errors that are correlated.

    In the comparison, ``errors`` are first half minus second, and ``covariances`` the sums of both.
    The halves start at the estimates from all targets, and ``converged`` is the share of these that
    converged.  Where one of the three fails, there is no comparison.  Raises a ``ValueError`` if
    fewer than four estimates can be compared, or an argument is invalid.

    Parameters
    ----------
    sensors, baseline, horizon, **options
        As for `track`.
    rng : numpy.random.Generator
    by : {"target", "object"}
        What goes to a half as a whole: each target, or each cluster of targets that a chain of
        steps of at most ``distance`` joins (single linkage).  In random order, each goes to the
        half that is smaller so far.
    distance : float, m
        Largest step within a cluster: longer than those within an object, and shorter than those
        between objects.

    Notes
    -----
    Errors that all targets of a sensor have in common (mounting, Doppler scale, clock), or all
    estimates (a motion that is not constant over the interval), cancel in the difference.  By
    target it shows whether the standard deviations of single targets are right.  By object, errors
    that the targets of an object share are in one half only and count with their full weight: by
    the factor between the two ANEES the covariances are too small because of the correlation.  A
    bias that depends on the azimuth, and traffic that is not rejected, show up there, too.

    Examples
    --------
    >>> import numpy as np
    >>> from d2d.radar import compare_halves, simulate_drive
    >>> drive = simulate_drive(np.random.default_rng(0), duration=4.0)
    >>> compare_halves(drive, np.random.default_rng(1), by="object").errors.shape
    (40, 3)
    """
    check_instance("rng", rng, np.random.Generator)
    check_choice("by", by, ("target", "object"))
    reach = check_positive_scalar("distance", distance)
    drives = list(usable(named_sensors(sensors)).values())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ScanWarning)  # the same once more
        whole = track(drives, baseline=baseline, horizon=horizon, carry=False, **options)
    errors, covariances = np.full_like(whole.theta, np.nan), np.full_like(whole.covariance, np.nan)
    for i, each in enumerate(rounds_of(drives, baseline, horizon)):
        if not whole.converged[i]:
            continue
        halves: tuple[list[ScanPair], list[ScanPair]] = [], []
        for previous, current, mounting in each.pairs:
            labels = np.arange(current.size) if by == "target" else _clusters(current, reach)
            first = _half(rng, labels)
            for pairs, chosen in zip(halves, (first, ~first), strict=True):
                if chosen.any():
                    pairs.append(ScanPair(previous, current[chosen], mounting))
        if not all(halves):
            continue
        one, two = (
            estimate_ego_motion(*zip(*pairs, strict=True), initial=whole.theta[i], **options)
            for pairs in halves
        )
        if one.converged and two.converged:
            errors[i], covariances[i] = one.theta - two.theta, one.covariance + two.covariance
    return enough(Comparison.from_errors(whole, errors, covariances), "the halves have")


def _clusters(scan: RadarScan, distance: float) -> NDArray[np.int_]:
    """Number (K,) of the single-linkage cluster of each target."""
    if scan.size < 2:
        return np.zeros(scan.size, dtype=np.int_)
    angle = np.asarray(scan.azimuth)
    points = scan.range[:, np.newaxis] * np.column_stack([np.cos(angle), np.sin(angle)])
    linkage = scipy.cluster.hierarchy.linkage(points, "single")
    found = scipy.cluster.hierarchy.fcluster(linkage, distance, "distance")
    return np.asarray(found, dtype=np.int_)


def _half(rng: np.random.Generator, labels: NDArray[np.int_]) -> NDArray[np.bool_]:
    """Mask (K,) of the first half's targets; targets with the same label stay together."""
    names, cluster, sizes = np.unique(labels, return_inverse=True, return_counts=True)
    first = np.zeros(len(names), dtype=np.bool_)
    lead = 0  # how many more targets the first half has than the second
    for name in rng.permutation(len(names)):
        first[name] = lead < 0 or (lead == 0 and rng.random() < 0.5)
        lead += int(sizes[name]) if first[name] else -int(sizes[name])
    return np.asarray(first[cluster])
