"""Whether the positions of a drive's targets contradict their Doppler velocities.

A flipped sign, a wrong unit, or velocities that are already compensated for the ego-motion still
give an optimum: Doppler velocities are so precise that the positions hardly influence the speed.
The positions alone then fit another velocity clearly better.

This can happen with correct data, too.  The reflections of a guardrail beside the road travel with
the vehicle, so that the positions seem to be at rest.  Therefore the search covers only velocities
that differ from the estimate by more than the speed itself, and those that a known mistake gives.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Generic, TypeVar

import numpy as np

from d2d._types import Array
from d2d.problem import Problem
from d2d.radar.tracks.finding import Finding, warn_of
from d2d.registration import ANNEALED, anneal

T = TypeVar("T")

# The thresholds were chosen by hand and tried on 15 recordings: four radars of RadarScenes, eight
# of nuScenes, three simulated ones, each as it is, with the opposite sign, in km/h and with zeros.
# Of correct recordings, at most 10 % of the intervals contradict in one direction.  Of wrong ones,
# 52 % or more do if the radar looks ahead, and 3 to 78 % if it looks aside, so that half of them
# must.  With 0.5 or 10 nats instead of 3, or a margin of 0.1 or 2 m/s, radars that look ahead stay
# at 52 % or more; with less than 3 nats, correct recordings rise to 29 %.
_SAMPLE = 20  # intervals at most
FEW = 5  # after which the search ends if at most one of them contradicts
_TELLING = 3.0  # nats by which another velocity must fit the positions better
_SLOW = 2.0  # m/s, below which the multiples of a velocity are too close to tell apart
_MARGIN = 0.5  # m/s
_ACCELERATING = 5.0  # m/s^2, as hard as a car is driven
# Distances from a velocity, as fractions of the speed; rest is 1 away from the estimate.
_BEYOND_REST, _AT_OPPOSITE, _AT_SLOWER, _AT_FEET = 1.15, 0.5, 0.15, 0.3
# What the velocity is multiplied by if a mistake is undone.
_OPPOSITE, _SLOWER, _FASTER, _MUCH_FASTER = np.array(
    [[-1.0, -1.0, 1.0], [1.0 / 3.6, 1.0 / 3.6, 1.0], [3.6, 3.6, 1.0], [10.0, 10.0, 10.0]]
)
_FEET = np.array([1.0 / 0.3048, 1.0 / 0.3048, 1.0])
_QUESTIONS = {
    "the opposite velocity": "Are the Doppler velocities positive for receding targets, and the "
    "azimuths counter-clockwise?",
    "a 3.6 times slower one": "Are the Doppler velocities in m/s, not in km/h?",
    "a faster one": "Are the Doppler velocities those that the sensor measured, not compensated "
    "for the ego-motion?",
    "a 3.3 times faster one": "Are the ranges in m, not in feet?",
}
_SYMPTOMS = {
    "the opposite velocity": "the path runs backwards",
    "a 3.6 times slower one": "Doppler velocities in km/h",
    "a faster one": "the vehicle hardly moves",
    "a 3.3 times faster one": "ranges in feet",
}
_OTHERS = "Azimuths in degrees, times in another unit than s and a wrong mounting look the same."


class EvenSample(Generic[T]):
    """At least `_SAMPLE` of a growing number of members, if there are so many, evenly spread."""

    def __init__(self) -> None:
        self.chosen: list[T] = []
        self._count, self._step = 0, 1

    def add(self, member: T) -> None:
        """Take the next member, or pass it over."""
        if self._count % self._step == 0:
            self.chosen.append(member)
        self._count += 1
        if len(self.chosen) >= 2 * _SAMPLE:
            self.chosen, self._step = self.chosen[::2], 2 * self._step


def warn_of_contradiction(theta: Array, problem: Callable[[int], Problem]) -> None:
    """Warn if in most intervals the positions alone fit another velocity clearly better.

    ``theta`` (n, 3) holds the accepted velocities, and ``problem(i)`` is the problem of row i.
    """
    if len(theta) < FEW:
        return
    count = min(_SAMPLE, len(theta))
    spread = np.linspace(0, len(theta) - 1, count).astype(int)
    step = count // FEW
    compared = 0
    against: list[tuple[str, Array]] = []
    for i in np.concatenate([spread[first::step] for first in range(step)]):
        if compared == FEW and len(against) < 2:
            return
        compared += 1
        against += _contradiction(problem(int(i)), theta[i])
    if not against:
        return
    kinds = [kind for kind, _ in against]
    kind = max(_QUESTIONS, key=kinds.count)
    headings = np.array([heading for _, heading in against])
    # a fit by chance has a random direction, and must not hide what most say
    alike = headings[[each == kind for each in kinds]]
    most = max(float(np.hypot(*some.sum(axis=0))) for some in (headings, alike))
    if 2.0 * most > compared:
        told = (
            f"in {len(against)} of {compared} intervals the positions fit another velocity better, "
            f"mostly {kind}"
        )
        warn_of(
            Finding(_SYMPTOMS[kind], "", len(against) / compared, "share", True, told),
            f"Doppler velocities and positions contradict each other: {told}.  "
            f"{_QUESTIONS[kind]}  {_OTHERS}",
        )


def _contradiction(problem: Problem, theta: Array) -> list[tuple[str, Array]]:
    """What the positions fit better than a velocity (3,), and its direction (2,); else nothing."""
    alone = replace(problem, pairs=[pair._replace(measurement=None) for pair in problem.pairs])
    speed = float(np.hypot(*theta[:2]))
    known = (_OPPOSITE, _SLOWER, _FASTER, _MUCH_FASTER, _FEET)
    tried = theta * np.array([np.ones(3), np.zeros(3), *known])
    stated, rest, *values = alone.derivatives(alone.bind(tried))[0]
    other = anneal(alone, tried[2 + int(np.argmin(values))])
    if speed < _SLOW:
        searched = anneal(alone, np.zeros(3), ANNEALED)
        other = min(other, searched, key=lambda each: float(each.value))
    if not (other.converged and stated - other.value > _TELLING):
        return []
    # positions fit the mean velocity, from which one at the later scan differs by an acceleration
    gained = 0.5 * _ACCELERATING * max(pair.interval for pair in problem.pairs)
    mean = anneal(alone, theta, ANNEALED)
    alike = np.hypot(*(mean.theta - theta)[:2]) < gained
    if mean.converged and alike and mean.value - other.value <= _TELLING:
        return []

    def away(multiple: Array) -> float:
        return float(np.hypot(*(other.theta - multiple * theta)[:2]))

    heading = other.theta[:2] / max(float(np.hypot(*other.theta[:2])), 1e-9)
    if speed > _SLOW and away(_FEET) < _AT_FEET * _FEET[0] * speed:
        return [("a 3.3 times faster one", heading)]
    if away(np.ones(3)) > _BEYOND_REST * speed + _MARGIN:
        opposite = away(_OPPOSITE) < _AT_OPPOSITE * speed
        return [("the opposite velocity" if opposite else "a faster one", heading)]
    if speed > _SLOW and away(_SLOWER) < _AT_SLOWER * speed and rest - other.value > _TELLING:
        return [("a 3.6 times slower one", heading)]
    return []
