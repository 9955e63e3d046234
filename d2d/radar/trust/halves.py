"""Evidence about covariances without a reference: independent estimates of the same motion."""

from typing import Any, Unpack

import numpy as np
import scipy
from numpy.typing import NDArray

from d2d._checks import check_choice, check_instance, check_positive_scalar
from d2d._types import Array
from d2d.radar.motion.estimate import estimate_ego_motion
from d2d.radar.motion.model import EstimationOptions
from d2d.radar.motion.pairs import ScanPair
from d2d.radar.scans.scan import RadarScan
from d2d.radar.tracks.rounds import Sensors, check_sensors, round_pairs, rounds
from d2d.radar.tracks.track import Track, neighbours
from d2d.radar.tracks.tracking import track
from d2d.radar.trust.comparison import Comparison, enough


def compare_tracks(first: Track, second: Track) -> Comparison:
    """Compare two tracks of the same vehicle, each against the other.

    If the tracks come from different measurements and both covariances are true, the differences
    have the sum of the covariances.  No reference is needed, and none adds errors of its own.

    Parameters
    ----------
    first, second : Track
        From sensors that have no measurement in common, on the same clock.

    Returns
    -------
    Comparison
        At the times of ``first``: ``errors`` are first minus second, ``covariances`` the sums.
        ``converged`` is the share of ``first`` that converged.

    Raises
    ------
    ValueError
        If an argument is not a `Track`, or fewer than four estimates can be compared.

    Notes
    -----
    ``second`` is interpolated linearly between two successive converged estimates, unless they are
    more than twice the usual interval apart.  The interpolated covariance is that of a weighted
    mean of independent errors, ``(1 - w)^2 Sigma_i + w^2 Sigma_j``, which is too small for errors
    that change slowly; estimates at equal times are not affected.

    The difference contains the noise of both, the dependence of their targets, and biases of each
    sensor, such as those of its mounting; a mean whitened error that is not zero, or one that
    changes slowly, is a bias.  What both have in common cancels, such as the lag of a common clock
    or a motion that is not constant over the interval.  Credible differences do not prove credible
    estimates.  To tell noise and correlation apart without biases, see `compare_halves`.
    """
    check_instance("first", first, Track)
    check_instance("second", second, Track)
    if not len(first.times):
        raise ValueError("first must hold at least one estimate, but is empty")
    theta, covariance, good = _interpolated(second, first.times)
    good &= first.converged
    return enough(
        Comparison(
            first.times[good],
            (first.theta - theta)[good],
            first.covariance[good] + covariance[good],
            float(good.mean()),
            float(first.converged.mean()),
        ),
        "first and second have",
    )


def _interpolated(track: Track, times: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Velocities and covariances at other times, and where they are known."""
    before, after, weight, good = neighbours(track, times)
    own, other = 1.0 - weight[:, np.newaxis], weight[:, np.newaxis]
    theta = own * track.theta[before] + other * track.theta[after]
    own, other = own[..., np.newaxis] ** 2, other[..., np.newaxis] ** 2
    return theta, own * track.covariance[before] + other * track.covariance[after], good


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

    The targets of each *later* scan are divided at random; each half is registered with the whole
    scan before, so that every target keeps its counterpart.  Run it with both values of ``by``: the
    two ANEES distinguish standard deviations that are too small from errors that are correlated.

    Parameters
    ----------
    sensors : Recording, (scans, Mounting), or a sequence or mapping of them
        One sensor or several, as for `track`.
    rng : numpy.random.Generator
    by : {"target", "object"}
        What is assigned to a half as a whole: each target, or each cluster of targets.  Clusters
        are formed within one scan, by single linkage: two targets are of the same cluster if a
        chain of targets joins them in steps of at most ``distance``.  In random order, they go to
        the half that is smaller so far.
    distance : float, m
        Largest step between neighbours in a cluster; only used with ``by="object"``.  It should be
        longer than the steps within an object, and shorter than those between objects.
    baseline, horizon : int, or float in s
        How many scans, or how long, before its second scan the first one of a pair is; see `track`.
    **options
        ``doppler``, ``outlier``, ``doppler_width``, ``side_slip``, ``first_order`` and ``scales``,
        as for `estimate_ego_motion`.

    Returns
    -------
    Comparison
        ``errors`` are first half minus second, ``covariances`` the sums of theirs.  Where an
        estimate from all targets fails, or one from a half, there is no comparison; ``converged``
        is the share of the estimates from all targets that converged, at which the halves start.

    Raises
    ------
    ValueError
        If there are fewer than two rounds of scans, fewer than four estimates can be compared, or
        another argument is invalid; the message names the argument.

    Notes
    -----
    What is the same for all targets of a sensor (mounting, Doppler scale, clock) and what is the
    same for all estimates (a motion that is not constant over the interval) cancels in the
    difference.  What is left:

    - **By target** it shows whether the standard deviations of single targets are right.  The
      targets of an object are in both halves, so that their common error counts as if each had its
      own.
    - **By object**, a common error is in one half only, and counts with its full weight.  If all
      errors are independent, both ways give the same ANEES.  If the errors of an object's
      targets are correlated, the ANEES by object is larger: by that factor the covariances are too
      small because of the correlation.

    Objects also lie in different directions, and some move.  So a bias that depends on the azimuth,
    and traffic that is not rejected, also show up by object.

    Targets that share a counterpart in the scan before share its error, which makes the differences
    a little smaller than the covariances say.

    Examples
    --------
    >>> import numpy as np
    >>> from d2d.radar import compare_halves, simulate_drive
    >>> drive = simulate_drive(np.random.default_rng(0), duration=4.0)
    >>> for by in ("target", "object"):
    ...     halves = compare_halves(
    ...         [(drive.scans, drive.mounting)], np.random.default_rng(1), by=by
    ...     )
    ...     print(by, halves.errors.shape)
    target (40, 3)
    object (40, 3)
    """
    check_instance("rng", rng, np.random.Generator)
    check_choice("by", by, ("target", "object"))
    reach = check_positive_scalar("distance", distance)
    drives = check_sensors(sensors)
    whole = track(drives, baseline=baseline, horizon=horizon, **options)
    count = len(whole.times)
    errors, covariances = np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan)
    for i, group in enumerate(rounds(scans for scans, _ in drives)[1:]):
        if not whole.converged[i]:
            continue
        halves: tuple[list[ScanPair], list[ScanPair]] = [], []
        for previous, current, mounting in round_pairs(drives, group, baseline, horizon):
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
        errors[i], covariances[i] = one.theta - two.theta, one.covariance + two.covariance
    good = np.isfinite(covariances).all(axis=(1, 2))
    return enough(
        Comparison(
            whole.times[good],
            errors[good],
            covariances[good],
            float(good.mean()),
            float(whole.converged.mean()),
        ),
        "the halves have",
    )


def _clusters(scan: RadarScan, distance: float) -> NDArray[np.int_]:
    """Number (K,) of the single-linkage cluster of each target."""
    if scan.size < 2:
        return np.zeros(scan.size, dtype=np.int_)
    angle = np.asarray(scan.azimuth)
    points = scan.range[:, np.newaxis] * np.column_stack([np.cos(angle), np.sin(angle)])
    linkage = scipy.cluster.hierarchy.linkage(points, "single")
    found = scipy.cluster.hierarchy.fcluster(linkage, distance, "distance")
    return np.asarray(found, dtype=np.int_)


def _half(rng: np.random.Generator, labels: NDArray[np.int_]) -> NDArray[Any]:
    """Whether (K,) each target belongs to the first half; those of a label stay together."""
    names, cluster, sizes = np.unique(labels, return_inverse=True, return_counts=True)
    first = np.zeros(len(names), dtype=np.bool_)
    lead = 0  # targets that the first half has more than the second
    for name in rng.permutation(len(names)):
        first[name] = lead < 0 or (lead == 0 and rng.random() < 0.5)
        lead += int(sizes[name]) if first[name] else -int(sizes[name])
    return np.asarray(first[cluster])
