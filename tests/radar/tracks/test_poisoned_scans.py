"""One bad scan costs its own estimate, and never a later one nor the track."""

from contextlib import ExitStack
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from d2d.radar import ErrorBudget, Tracker, track
from tests.radar.scenes import STRAIGHT, in_order, named_sensors
from tests.radar.tracks.test_files import assert_same
from tests.radar.tracks.test_tracker import fed

HALF = slice(None, None, 2)
POISON = {
    "range": (1e-9, 1e-8, 1e-6, 1e-4, 9e3),
    "azimuth": (-6.0, 3.0),
    "doppler": (-9e3, 1e3, 1e6, 1e154, 1e308),
    "sigma_range": (1e-320, 1e-100, 1e-9, 1e-6, 1e3, 1e6, 1e160, 1e308),
    "sigma_azimuth": (1e-320, 1e-20, 1e-8, 1e-6, 6.0, 1e6, 1e30),
    "sigma_doppler": (1e-320, 1e-20, 1e-9, 1e-6, 9e3, 1e6, 1e160, 1e308),
    "extent": (1e-320, 1e-9, 50.0, 9e3, 1e160),
}
CASES = [(name, value) for name, values in POISON.items() for value in values]


def poisoned(scan, name, value, which):
    """The scan with a field set to a value; None if no scan can hold it."""
    changed = getattr(scan, name).copy()
    changed[which] = value
    try:
        return replace(scan, **{name: changed})
    except ValueError:
        return None


@cache
def drives():
    """Three sensors and one, with their tracks."""
    given = named_sensors(12), dict(list(named_sensors(12).items())[:1])
    return [(sensors, track(sensors, horizon=0.2)) for sensors in given]


@pytest.mark.parametrize("which", [HALF, slice(None)], ids=["half", "all"])
@pytest.mark.parametrize(("name", "value"), CASES)
def test_a_scan_with_absurd_numbers_is_refused_or_costs_what_rests_on_it(name, value, which):
    """Breaks if one scan raises in a round, spoils the estimates that it is not part of, or leaves
    a tracker that cannot go on; it is part of its own, and of that which is registered with it."""
    for sensors, whole in drives():
        scans, at = sensors["left"]
        for place in (0, 1, 6, 11):
            bad = poisoned(scans[place], name, value, which)
            if bad is None:
                return
            given = sensors | {"left": ([*scans[:place], bad, *scans[place + 1 :]], at)}
            tracker = Tracker({n: at for n, (_, at) in given.items()}, horizon=0.2)
            fed(tracker, given)
            found = tracker.track
            assert_same(found, track(given, horizon=0.2))
            own = np.isin(range(11), [place - 1, place + 1, *([0] if place < 2 else [])])
            assert found.converged[~own].all()
            assert_array_equal(found.theta[: max(place - 1, 0)], whole.theta[: max(place - 1, 0)])
            good = found.converged
            assert np.isfinite(found.covariance[good]).all()
            assert np.abs(found.theta[good] - STRAIGHT)[:, 0].max() < 0.3


@pytest.mark.parametrize(
    ("error", "reason"),
    [(np.linalg.LinAlgError, "a scan that cannot be used"), (ValueError, "an error")],
)
def test_what_no_bound_foresees_fails_that_estimate_alone(monkeypatch, error, reason):
    """Breaks if an error within a round ends a tracker or is carried into the next rounds, or a
    mistake of our own, say a wrong shape, passes for a scan that cannot be used."""

    def raising(*_arguments):
        raise error("no bound")

    sensors = named_sensors(12)
    without = track(sensors, budget=ErrorBudget())
    tracker = Tracker({n: at for n, (_, at) in sensors.items()})
    for i, (_, name, scan) in enumerate(in_order(sensors)):
        with monkeypatch.context() as patch, ExitStack() as stack:
            if i == 23:  # which completes the eighth round, of seven estimates
                patch.setattr("d2d.radar.tracks.estimator.apply_budget", raising)
                if error is ValueError:
                    stack.enter_context(pytest.raises(ValueError, match=r"^no bound"))
            tracker.add(name, scan)
    found = tracker.track
    assert found.reasons[6] == reason
    assert_array_equal(np.flatnonzero(~found.converged), [6])
    assert_array_equal(found.theta[:6], without.theta[:6])
    assert np.abs(found.theta[7:] - without.theta[7:]).max() < 0.05
