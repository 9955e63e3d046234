"""Covariances judged without a reference, by two halves of the targets."""

import warnings
from typing import Unpack

import numpy as np
import scipy
from numpy.typing import NDArray

from d2d._checks import check_choice, check_instance
from d2d.radar.evaluation.compare import Comparison, enough
from d2d.radar.motion.estimate import estimate_ego_motion
from d2d.radar.motion.model import EstimationOptions
from d2d.radar.motion.pairs import ScanPair
from d2d.radar.tracks.intake import ScanWarning, usable
from d2d.radar.tracks.rounds import Sensors, named_sensors, rounds_of
from d2d.radar.tracks.tracker import track

_WITHIN = 2.0  # m, from a target of an object to the next


def compare_halves(
    sensors: Sensors,
    rng: np.random.Generator,
    *,
    by: str = "target",
    baseline: int = 1,
    **options: Unpack[EstimationOptions],
) -> Comparison:
    """Estimate each motion twice, from each half of the targets, and compare the two.

    The targets of each *later* scan are divided at random, and each half is registered with the
    whole scan before.  In the comparison, ``errors`` are first half minus second, ``covariances``
    the sums of both, and ``converged`` is the share of the estimates from all targets, at which the
    halves start.  Raises a ``ValueError`` if fewer than four estimates can be compared, or an
    argument is invalid.

    Parameters
    ----------
    sensors, baseline, **options
        As for `track`.
    rng : numpy.random.Generator
    by : {"target", "object"}
        What goes to a half as a whole: each target, or all that steps of at most 2 m join.

    Examples
    --------
    >>> import numpy as np
    >>> from d2d.radar import compare_halves, simulate_drive
    >>> rng = np.random.default_rng(0)
    >>> compare_halves(simulate_drive(rng, 4.0), rng, by="object").errors.shape
    (40, 3)
    """
    check_instance("rng", rng, np.random.Generator)
    check_choice("by", by, ("target", "object"))
    drives = list(usable(named_sensors(sensors)).values())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ScanWarning)  # the same once more
        whole = track(drives, baseline=baseline, carry=False, **options)
    errors, covariances = np.full_like(whole.theta, np.nan), np.full_like(whole.covariance, np.nan)
    for i, each in enumerate(rounds_of(drives, baseline)):
        halves: tuple[list[ScanPair], list[ScanPair]] = [], []
        for pair in each.pairs if whole.converged[i] else ():
            labels = np.arange(pair.current.size)
            if by == "object" and len(labels) > 1:
                points = pair.current.point_set(pair.mounting).means
                cluster = scipy.cluster.hierarchy.fclusterdata
                labels = cluster(points, _WITHIN, criterion="distance", method="single")
            first = _half(rng, labels)
            for pairs, chosen in zip(halves, (first, ~first), strict=True):
                if chosen.any():
                    pairs.append(pair._replace(current=pair.current[chosen]))
        if not all(halves):
            continue
        one, two = (
            estimate_ego_motion(*zip(*pairs, strict=True), initial=whole.theta[i], **options)
            for pairs in halves
        )
        if one.converged and two.converged:
            errors[i], covariances[i] = one.theta - two.theta, one.covariance + two.covariance
    return enough(Comparison.from_errors(whole, errors, covariances), "the halves have")


def _half(rng: np.random.Generator, labels: NDArray[np.int_]) -> NDArray[np.bool_]:
    """Mask (K,) of the first half; in random order, each label goes to the smaller half so far."""
    first, lead = np.zeros(len(labels), dtype=np.bool_), 0
    for label in rng.permutation(np.unique(labels)):
        own = labels == label
        chosen = lead < 0 or (lead == 0 and rng.random() < 0.5)
        first |= own & chosen
        lead += int(own.sum()) if chosen else -int(own.sum())
    return first
