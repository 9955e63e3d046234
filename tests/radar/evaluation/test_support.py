"""Paths that rest on too few estimates in a row, and what is then said and written."""

import numpy as np
import pytest

from d2d.radar.tracks.support import support_of


def accepted(share: float, seconds: float, rate: float) -> tuple:
    """Estimates of which a share is accepted, independently of each other."""
    rng, count = np.random.default_rng(0), round(seconds * rate)
    times = np.arange(1, count + 1) / rate
    return times, np.full(count, 1.0 / rate), rng.random(count) < share


@pytest.mark.parametrize("rate", [4.0, 10.0, 30.0])
@pytest.mark.parametrize(
    ("share", "enough"), [(0.0, False), (0.07, False), (0.2, False), (0.8, True), (1.0, True)]
)
def test_accidents_do_not_support_a_path(share, enough, rate):
    """Breaks if single accepted estimates are taken for a path, or a few failures for none."""
    assert support_of(*accepted(share, 60.0, rate)).enough == enough


def test_a_stretch_without_estimates_has_its_times():
    """Breaks if an accident within a stretch hides it, or a short one is told."""
    times, intervals, good = accepted(1.0, 60.0, 10.0)
    good[140:344], good[[200, 300]] = False, True
    good[500:505] = False
    support = support_of(times, intervals, good)
    assert support.guessed == [(pytest.approx(14.0), pytest.approx(34.5))]
    assert support.share == pytest.approx(1.0 - 20.5 / 60.0)
    assert support.enough


def test_a_clock_that_steps_back_ends_a_row():
    """Breaks if time that has passed twice is a stretch without estimates."""
    times, intervals, good = accepted(1.0, 10.0, 10.0)
    twice = np.concatenate([times, times]), np.concatenate([intervals] * 2), np.tile(good, 2)
    twice[1][100] = np.nan
    twice[2][100] = False
    assert support_of(*twice).guessed == []
