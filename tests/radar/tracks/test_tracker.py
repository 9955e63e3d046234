"""Tracks of simulated drives: what is estimated, what fails, and what stays in order then."""

import subprocess
import sys
import textwrap
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numba.core.registry import CPUDispatcher as Dispatcher
from numpy.testing import assert_allclose, assert_array_equal

from d2d import UniformOutlier
from d2d._kernel import consensus, entries, errors, propagate
from d2d.radar import (
    ErrorBudget,
    Mounting,
    Reference,
    Sensor,
    Track,
    Tracker,
    VehicleLimits,
    VelocityEstimate,
    estimate_ego_motion,
    simulate_drive,
    track,
)
from d2d.radar.tracks import tracker
from d2d.scores import normalised_squares
from tests.radar.scenes import (
    AROUND,
    CORNER,
    STRAIGHT,
    accelerating,
    arc,
    beginning,
    observe,
    straight_scans,
    surround_scans,
)
from tests.radar.tracks.test_files import assert_same

ROOT = Path(__file__).parents[3]


def test_a_fast_drive_is_not_lost():
    """Breaks if the last velocity is the only start: 2 pairs in 100 then end elsewhere."""
    drive = simulate_drive(np.random.default_rng(0), 10.0, 20.0)
    found = track(drive, limits=None)  # around the bends of a yard, faster than any car
    assert found.converged.all()
    assert (np.abs(found.theta - drive.truth.theta[1:])[:, 0] < 0.5).all()


def test_each_pair_starts_at_the_last_velocity():
    """Breaks if each scan starts from its own Doppler velocities, which are nonsense here, or the
    start that a user gives is dropped."""
    scans = straight_scans()
    nonsense = [replace(scan, doppler=np.full(scan.size, -25.0)) for scan in scans]
    good_start = track((scans[:2] + nonsense[2:], CORNER), doppler=False)
    given = track((nonsense, CORNER), doppler=False, initial=STRAIGHT)
    for result in (good_start, given):
        assert result.converged.all()
        assert np.abs(result.theta - STRAIGHT)[:, 0].max() < 0.6
    lost = track((nonsense, CORNER), doppler=False).theta[0]
    assert abs(lost[0] - 12.0) > 2.0, "the Doppler start is too good to tell"


def test_a_scan_of_another_place_does_not_lose_the_drive():
    """Breaks if an estimate that did not converge becomes the start of the next pair."""
    scans = straight_scans()
    scans[5] = replace(scans[5], range=scans[5].range + 5000.0)
    result = track((scans, CORNER), doppler=False, outlier=UniformOutlier(1e-3))
    assert_array_equal(np.flatnonzero(~result.converged), [4, 5])
    assert_array_equal(result.theta[4:6], result.theta[[3, 3]])
    assert np.abs(result.theta - STRAIGHT)[:, 0].max() < 0.6


# ---- scan by scan


NAMES = ("left", "right", "rear")


def fed(tracker: Tracker, sensors) -> list[VelocityEstimate]:
    """What a tracker gives for the scans of named sensors in time order."""
    return added(tracker, in_order(sensors)) + tracker.finish()


def in_order(sensors):
    """Times, names and scans as they are measured."""
    return sorted((scan.time, name, scan) for name, (scans, _) in sensors.items() for scan in scans)


def added(tracker: Tracker, order) -> list[VelocityEstimate]:
    """The same for scans in a given order, without the end."""
    return [each for _, name, scan in order for each in tracker.add(name, scan)]


def named_sensors(count=30):
    return dict(zip(NAMES, surround_scans(count), strict=True))


@pytest.mark.parametrize(
    "options",
    [
        {"horizon": None},
        {"horizon": None, "baseline": 3, "budget": ErrorBudget()},
        {"horizon": 0.3, "budget": ErrorBudget(azimuth=0.002, lag=0.02, neighbours=1.0)},
        {"horizon": 0.3, "doppler": False, "initial": STRAIGHT},
    ],
    ids=["plain", "baseline", "budget", "positions"],
)
def test_scan_by_scan_gives_the_same_bits_as_the_whole_log(options):
    """Breaks if an estimate uses what is later, or a log takes another path."""
    sensors = named_sensors()
    scans, at = sensors["right"]
    sensors["right"] = [*scans[:7], scans[7][:0], *scans[9:]], at
    tracker = Tracker({name: at for name, (_, at) in sensors.items()}, **options)
    given = fed(tracker, sensors)
    whole = track(sensors, **options)
    assert_same(tracker.track, whole)
    assert_array_equal([each.time for each in given], whole.times)
    assert_array_equal([each.theta for each in given], whole.theta)
    assert [each.reason for each in given] == whole.reasons.tolist()
    assert [each.converged for each in given] == whole.converged.tolist()


def test_neither_sensors_nor_targets_depend_on_their_order():
    """Breaks if the sensor that is named first decides, or the target that is measured first."""
    rng, budget = np.random.default_rng(9), ErrorBudget(azimuth=0.001)
    for size in (4, 200):
        sensors = {
            name: ([s[:size] for s in own], at) for name, (own, at) in named_sensors(8).items()
        }
        whole = track(sensors, budget=budget)
        turned = {name: sensors[name] for name in ("rear", "left", "right")}
        assert_same(track(turned, budget=budget), whole)
        mixed = {
            name: ([scan[rng.permutation(scan.size)] for scan in own], at)
            for name, (own, at) in sensors.items()
        }
        shuffled = track(mixed, budget=budget)
        assert_array_equal(shuffled.converged, whole.converged)
        assert_allclose(shuffled.theta, whole.theta, rtol=0, atol=1e-6)


def test_scans_may_come_a_little_out_of_order():
    """Breaks if a scan that is late runs time backwards, which no track can hold."""
    sensors = named_sensors(20)
    tracker = Tracker({name: at for name, (_, at) in sensors.items()})
    order = in_order(sensors)
    order[30], order[31] = order[31], order[30]  # of one round
    late = order.pop(32)
    del order[34]  # the next one of that sensor is lost
    order.insert(36, late)
    with pytest.warns(UserWarning, match=r"^'rear' has a scan at 1\.026 s .* left out") as said:
        added(tracker, order)
    assert len(said) == 1
    found = tracker.track
    assert found.converged.all()
    assert (np.diff(found.times) > 0.0).all()
    assert np.abs(found.theta - STRAIGHT).max() < 0.3


@pytest.mark.parametrize("seconds", [50.0, 1.5, -3.0])
@pytest.mark.parametrize("last", [13, 20, 30])
def test_one_wrong_clock_does_not_lose_the_others(last, seconds):
    """Breaks if the scans of all other sensors are late after one stamp, or for ever, or if the
    sensors whose clocks go on are blamed."""
    sensors = named_sensors(30)
    scans, _ = sensors["left"]
    jumped = [replace(scan, time=scan.time + seconds) for scan in scans[12:last]]
    tracker = Tracker({name: at for name, (_, at) in sensors.items()})
    order = in_order(sensors)
    for right, wrong in zip(scans[12:last], jumped, strict=True):
        order[order.index((right.time, "left", right))] = (right.time, "left", wrong)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        added(tracker, order)
    what = "'left' has one scan at" if last == 13 else "the clock of 'left' jumps by"
    assert all(str(each.message).startswith(what) for each in said)
    assert len(said) == (2 if last == 20 else 1)  # back again
    assert tracker.track.times[-1] < 3.0
    late = tracker.track[15:]
    assert late.converged.all()
    assert np.median(late.targets) > 2.5 * np.mean([scan.size for scan in scans])
    assert np.abs(late.theta - STRAIGHT).max() < 0.3


def test_a_clock_that_jumps_at_once_does_not_lose_the_others():
    """Breaks if a sensor must have shown its cycle before its clock may be set."""
    sensors = named_sensors(20)
    scans, _ = sensors["left"]
    jumped = [scans[0], *(replace(scan, time=scan.time - 5.0) for scan in scans[1:])]
    tracker = Tracker({name: at for name, (_, at) in sensors.items()})
    wrong = {id(scan): other for scan, other in zip(scans, jumped, strict=True)}
    order = [(time, name, wrong.get(id(scan), scan)) for time, name, scan in in_order(sensors)]
    with pytest.warns(UserWarning, match=r"^the clock of 'left' jumps by -4\.9") as said:
        added(tracker, order)
    assert len(said) == 1
    assert np.median(tracker.track.targets[5:]) > 2.5 * np.mean([scan.size for scan in scans])
    assert np.abs(tracker.track.theta[5:] - STRAIGHT).max() < 0.3


@pytest.mark.filterwarnings("ignore::d2d.radar.FindingWarning")
def test_a_sensor_that_is_silent_after_a_wrong_stamp_is_not_waited_for():
    """Breaks if all others wait for its next scan again and again."""
    sensors = named_sensors(40)
    scans, at = sensors["left"]
    last = replace(scans[10], time=scans[10].time - 50.0)
    sensors["left"] = [*scans[:10], last], at
    tracker = Tracker({name: at for name, (_, at) in sensors.items()})
    delays = []
    for time, name, scan in sorted(in_order(sensors), key=lambda each: each[0] % 50.0):
        delays += [time - estimate.time for estimate in tracker.add(name, scan)]
    assert max(delays[-10:]) < 0.2


def with_common_gap() -> dict:
    """All sensors pause for three seconds."""
    times = np.concatenate([0.1 * np.arange(12), 4.0 + 0.1 * np.arange(12)])
    return dict(zip(NAMES, surround_scans(times=times), strict=True))


def over_midnight() -> dict:
    """All clocks jump back by a day."""
    return {
        name: ([replace(s, time=(s.time + 86398.95) % 86400.0) for s in own], at)
        for name, (own, at) in named_sensors(24).items()
    }


def with_wrong_stamp() -> dict:
    """One scan of one sensor has the time of a minute later."""
    sensors = named_sensors(24)
    scans = sensors["rear"][0]
    scans[12] = replace(scans[12], time=scans[12].time + 60.0)
    return sensors


def test_one_clock_that_jumps_ahead_in_a_log_is_told():
    """Breaks if a sensor that pauses while others go on is passed over, or a gap of all is told."""
    sensors = named_sensors(40)
    scans, at = sensors["rear"]
    for seconds, told in ((2.0, r"2\.1"), (0.5, r"0\.6")):
        jumped = [*scans[:20], *(replace(scan, time=scan.time + seconds) for scan in scans[20:])]
        with pytest.warns(UserWarning, match=rf"'rear'.* or its clock jumps, by {told}\d* s at"):
            track(sensors | {"rear": (jumped, at)}, horizon=0.3)
    for quiet in (sensors, with_common_gap()):
        track(quiet, horizon=0.3)  # warnings are errors


@pytest.mark.parametrize("trouble", [with_common_gap, over_midnight, with_wrong_stamp])
@pytest.mark.filterwarnings("ignore::d2d.radar.FindingWarning")
def test_scan_by_scan_gives_the_same_bits_whatever_the_clocks_do(trouble):
    """Breaks if a scan whose time waits for the next one comes too late for its round."""
    sensors, measured = trouble(), named_sensors(24)
    if trouble is with_common_gap:
        measured = sensors
    tracker = Tracker({name: at for name, (_, at) in sensors.items()})
    arrival = sorted(
        (scan.time, name, i) for name, (own, _) in measured.items() for i, scan in enumerate(own)
    )
    for _, name, i in arrival:
        tracker.add(name, sensors[name][0][i])
    tracker.finish()
    assert tracker.track.converged.mean() > 0.9
    assert_same(tracker.track, track(sensors, horizon=0.3))


def test_scans_of_one_time_may_arrive_in_any_order():
    """Breaks if a network decides on the numbers."""
    rng = np.random.default_rng(4)
    sensors = dict(zip(NAMES, surround_scans(8, shift=0.0), strict=True))
    found = []
    for _ in range(3):
        tracker = Tracker({name: at for name, (_, at) in sensors.items()}, budget=ErrorBudget())
        for i in range(8):
            for name in rng.permutation(NAMES).tolist():
                tracker.add(name, sensors[name][0][i])
        found.append(tracker.track)
    assert_same(found[1], found[0])
    assert_same(found[2], found[0])


def test_times_may_count_from_1970():
    """Breaks if rounding of 0.2 us decides which scans make a pair, or what is a gap."""
    since, options = 1.7e9, {"horizon": 0.3, "budget": ErrorBudget()}
    sensors = surround_scans(20)
    late = [([replace(s, time=s.time + since) for s in own], at) for own, at in sensors]
    near, far = track(sensors, **options), track(late, **options)
    assert far.converged.all()
    assert_allclose(far.theta, near.theta, atol=1e-4)
    between = 0.5 * (far.times[1:] + far.times[:-1])
    assert np.isfinite(far.at(between).theta).all()
    reference = Reference(far.times, far.theta, far.theta)
    assert np.isfinite(reference.at(between, max_gap=0.1).theta).all()


def signatures() -> dict[str, int]:
    """How many times each entry of the kernel has been compiled."""
    found = {}
    for module in (entries, errors, consensus, propagate):
        for name, value in vars(module).items():
            if isinstance(value, Dispatcher):
                found[f"{module.__name__}.{name}"] = len(value.overloads)
    return found


def test_no_scan_waits_for_a_compiler():
    """Breaks if a tracker is made without a function that it will need, in another process too."""
    script = textwrap.dedent(
        """
        from d2d.radar import ErrorBudget, Tracker
        from tests.radar.tracks.test_tracker import fed, named_sensors, signatures
        sensors = named_sensors(8)
        scans, at = sensors["rear"]
        sensors["rear"] = [scan[: 3 * i] for i, scan in enumerate(scans)], at
        budget = {"budget": ErrorBudget(neighbours=1.0)}
        for options in (budget, {"outlier": None}, {"doppler": False}):
            tracker = Tracker({name: at for name, (_, at) in sensors.items()}, **options)
            ready = signatures()
            assert sum(ready.values()) > 3, ready
            fed(tracker, sensors)
            now = signatures()
            assert now == ready, {k: (ready[k], v) for k, v in now.items() if v != ready[k]}
        """
    )
    subprocess.run([sys.executable, "-W", "ignore", "-c", script], check=True, cwd=ROOT)


def test_a_tracker_keeps_what_it_needs_and_no_more():
    """Breaks if a service that runs for days fills the memory, or the first estimates are kept."""
    drive = beginning(30)
    tracker = Tracker({"front": drive.mounting}, keep=5, budget=ErrorBudget())
    assert len(tracker.track) == 0
    given = fed(tracker, {"front": (drive.scans, drive.mounting)})
    assert len(given) == 29
    assert_array_equal(tracker.track.times, [each.time for each in given[-5:]])
    assert tracker.finish() == []


def test_a_tracker_refuses_what_is_no_scan_of_its_sensors():
    """Breaks if a slip of the pen is tracked, or the error does not say what is wrong."""
    scans, at = surround_scans(3)[0]
    tracker = Tracker({"front": at})
    tracker.add("front", scans[1])
    for name, scan, said in (
        ("rear", scans[2], "sensor must be one of 'front', but is 'rear'"),
        ("front", scans[0], r"'front' must be in strictly increasing time, but a scan is at 0\.00"),
    ):
        with pytest.raises(ValueError, match=f"^{said}"):
            tracker.add(name, scan)
    assert len(tracker.add("front", scans[2])) == 1
    for mountings, options, said in (
        ([at], {}, "mountings must be a mapping"),
        ({"front": (1.0, 2.0)}, {}, r"mountings\['front'\] must be a Mounting"),
        ({"front": at}, {"keep": 0}, "keep must be"),
        ({"front": at}, {"horizon": -1.0}, "horizon"),
    ):
        with pytest.raises(ValueError, match=f"^{said}"):
            Tracker(mountings, **options)


def test_a_tracker_refuses_one_sensor_under_two_names():
    """Breaks if a slip of the pen halves the covariance."""
    scans, at = surround_scans(2)[0]
    tracker = Tracker({"front": at, "also": at})
    tracker.add("front", scans[0])
    with pytest.raises(ValueError, match=r"^'also' and 'front' must be different"):
        tracker.add("also", replace(scans[0]))


def test_a_tracker_says_what_a_whole_drive_contradicts():
    """Breaks if only a log is looked at for a wrong sign of the Doppler velocities."""
    drive = beginning(40)
    wrong = [replace(scan, doppler=-scan.doppler) for scan in drive.scans]
    tracker = Tracker({"front": drive.mounting})
    with pytest.warns(UserWarning, match="contradict each other"):
        fed(tracker, {"front": (wrong, drive.mounting)})


# ---- one sensor or several


def front_alone(sensors, **options) -> Track:
    return track(sensors[0], **options)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"baseline": 2, "budget": ErrorBudget()},
        {"horizon": 0.3, "side_slip": 0.05, "budget": ErrorBudget(azimuth=0.002, lag=0.02)},
        {"doppler": False, "limits": None},
    ],
    ids=["plain", "baseline", "budget", "positions"],
)
def test_one_sensor_is_the_smallest_number_of_several(options):
    """Breaks if one sensor takes another path than several: a second, blind one changes no bit."""
    scans, mounting = surround_scans(20)[0]
    scans[7], scans[12] = scans[7][:0], scans[12][:2]
    blind = [scan[:0] for scan in scans], Mounting(-1.0, 0.5, 3.0)
    alone = track((scans, mounting), **options)
    for sensors in ([(scans, mounting)], [(scans, mounting), blind], [blind, (scans, mounting)]):
        assert_same(track(sensors, **options), alone)


either_tracker = pytest.mark.parametrize(
    "driven_by", [front_alone, track], ids=["one-sensor", "three"]
)


def changed(sensors, change, which=slice(5, 6)):
    """The sensors with some scans of each replaced by ``change(scan)``."""
    return [
        (scans[: which.start] + [change(scan) for scan in scans[which]] + scans[which.stop :], at)
        for scans, at in sensors
    ]


@either_tracker
def test_a_horizon_is_the_baseline_nearest_to_it(driven_by):
    """Breaks if another scan is taken, or if rounding decides between two that are equally near."""
    sensors = surround_scans(12)
    for horizon, baseline in ((0.3, 3), (0.26, 3), (0.05, 1), (0.35, 3)):
        found = driven_by(sensors, horizon=horizon)
        assert_array_equal(found.theta, driven_by(sensors, baseline=baseline).theta)


def test_a_full_turn_between_two_scans_is_no_motion():
    """Breaks if times in ms of a 20 Hz radar, in which a drive is a circle each 50 s, converge."""
    drive = simulate_drive(np.random.default_rng(3), 2.0, sensor=Sensor(rate=20.0))
    late = [replace(scan, time=1000.0 * scan.time) for scan in drive.scans]
    driven = track((late, drive.mounting))
    assert str(driven).endswith("or is its mounting another?")
    assert not driven.converged.any()
    turns = [reason for reason in driven.reasons.tolist() if reason.startswith("a turn of 3")]
    assert len(turns) > 0.3 * len(driven.reasons)
    assert all(reason.endswith(" deg between scans") for reason in turns)


@either_tracker
def test_each_round_gives_an_estimate(driven_by):
    """Breaks if pairs of a round are lost, or its time is not the mean of its scans' times."""
    sensors = surround_scans()
    result = driven_by(sensors)
    used = sensors[:1] if driven_by is front_alone else sensors
    expected = np.mean([[scan.time for scan in scans] for scans, _ in used], axis=0)
    assert_allclose(result.times, expected[1:], atol=1e-12)
    assert_allclose(result.intervals, 0.1, atol=1e-12)
    assert result.converged.all()
    for i in (0, 6, 10):
        previous, current = ([scans[j] for scans, _ in used] for j in (i, i + 1))
        places = [mounting for _, mounting in used]
        alone = estimate_ego_motion(previous, current, places, initial=STRAIGHT)
        assert_allclose(result.theta[i], alone.theta, rtol=0, atol=1e-5)
        assert_allclose(result.covariance[i], alone.covariance, rtol=1e-4)


@either_tracker
@pytest.mark.parametrize("options", [{}, {"doppler": False}, {"budget": ErrorBudget(azimuth=0.01)}])
def test_scans_without_targets_are_marked_and_passed_over(driven_by, options):
    """Breaks if the drive ends there, or a prediction looks like an estimate."""
    result = driven_by(changed(surround_scans(), lambda scan: scan[:0]), **options)
    assert_array_equal(np.flatnonzero(~result.converged), [4, 5])
    assert set(result.reasons[4:6]) == {"a scan without targets"}
    assert np.isnan(result.covariance[4:6]).all()
    assert np.isnan(result.inliers[4:6]).all()
    if "budget" in options:
        assert np.isnan(result.parts.systematic[4:6]).all()
    assert_array_equal(result.theta[4:6], result.theta[[3, 3]])
    whole = driven_by(surround_scans(), **options)
    if "budget" not in options:  # whose acceleration is known less well after a gap
        assert_allclose(result.theta[6:], whole.theta[6:], rtol=0, atol=1e-4)
    assert np.isfinite(result.poses()).all()


@either_tracker
@pytest.mark.parametrize("still", [0, 5])
def test_a_scan_in_which_nearly_everything_moves_is_marked(driven_by, still):
    """Breaks if an optimum that rejects nearly all targets is taken for the motion, and carried on.

    Five of each sensor that stand still would be enough for an optimum at the right place.
    """
    rng = np.random.default_rng(71)

    def astir(scan):
        moves = np.arange(scan.size) >= still
        away = rng.uniform(2.0, 40.0, scan.size)
        doppler = np.where(moves, rng.uniform(-60.0, 60.0, scan.size), scan.doppler)
        return replace(scan, range=scan.range + moves * away, doppler=doppler)

    result = driven_by(changed(surround_scans(), astir))
    assert not result.converged[4]
    if still:
        assert result.reasons[4].startswith("an optimum that rejects 9")
    assert result.converged[6:].all()
    assert np.abs(result.theta - STRAIGHT)[:, 0].max() < 0.5


def bundle(scan):
    """Six targets in one direction."""
    near = np.argsort(np.abs(scan.azimuth - 0.1))[:6]
    return scan[np.sort(near)]


@either_tracker
@pytest.mark.parametrize("few", [bundle, lambda scan: scan[:1]], ids=["bundle", "one target"])
def test_few_targets_leave_uncertain_what_they_do_not_show(driven_by, few):
    """Breaks if what is not observable is given with a small covariance, or ends the drive."""
    usual = driven_by(surround_scans())
    result = driven_by(changed(surround_scans(), few, slice(4, 7)))
    good = np.flatnonzero(result.converged)
    assert set(range(3)) | set(range(7, 11)) <= set(good)
    assert np.abs(result.theta[7:] - STRAIGHT)[:, 0].max() < 0.3
    assert normalised_squares(result.theta[good] - STRAIGHT, result.covariance[good]).max() < 30.0
    for i in set(good) & {4, 5}:
        assert np.trace(result.covariance[i]) > 4.0 * np.trace(usual.covariance[i])


def test_a_sensor_that_fails_leaves_the_track_to_the_others():
    """Breaks if one empty or missing scan loses the round, or a blind sensor the drive."""
    sensors = surround_scans()
    scans, mounting = sensors[1]
    blind = [scan[:0] for scan in scans]
    for other in (blind, scans[:3] + scans[7:], scans[:4] + blind[4:]):
        result = track([sensors[0], (other, mounting), sensors[2]])
        assert result.converged.all()
        assert len(result.times) == 11
        assert np.abs(result.theta - STRAIGHT).max() < 0.1


@either_tracker
def test_a_gap_of_two_seconds_does_not_lose_the_drive(driven_by):
    """Breaks if the interval of the gap is taken for the usual one, or the end is not found."""
    times = [0.0, 0.1, 0.2, 0.3, 2.3, 2.4, 2.5, 2.6]
    result = driven_by(surround_scans(times=times))
    assert_allclose(result.intervals[3], 2.0, atol=1e-9)
    assert result.converged[[0, 1, 2, 4, 5, 6]].all()
    assert np.abs(result.theta - STRAIGHT)[:, 0].max() < 0.3
    position = result.poses()[-1, :2] - arc(STRAIGHT, 2.6)[:2, 2]
    assert np.hypot(*position) < 2.0


@either_tracker
def test_a_standing_vehicle_stands(driven_by):
    """Breaks if a velocity of zero divides, or is taken for no estimate."""
    result = driven_by(surround_scans(theta=(0.0, 0.0, 0.0)))
    assert result.converged.all()
    assert np.abs(result.theta).max() < 0.1
    errors = result.theta
    nees = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(result.covariance), errors)
    assert nees.mean() < 6.0


@pytest.mark.parametrize("gap", [0.5, 1.0, 2.0, 3.0])
def test_what_is_accepted_after_a_gap_in_a_bend_is_as_sure_as_it_says(gap):
    """Breaks if a pair or a round has scans from both sides of a gap.

    Of ten estimates the largest square of three dimensions is 10 or so; with pairs across the gap,
    and estimates carried by a slope, it was 77 to 16 000.
    """
    begin, acceleration = 1.45, np.array([1.0, 0.0, 0.1])
    sensors, truth = accelerating(
        [10.0] * 3, [0.0, 0.03, 0.06], acceleration, AROUND, noise=1.0, end=2.5 + gap
    )
    seen = [([s for s in own if not begin < s.time < begin + gap], at) for own, at in sensors]
    found = track(seen, horizon=0.3, budget=ErrorBudget())
    after = found.times > begin
    good = after & found.converged
    assert good.sum() > 0.85 * after.sum()
    errors = (found.theta - truth(found.times))[good]
    assert normalised_squares(errors, found.covariance[good]).max() < 40.0


def test_scans_that_repeat_an_earlier_one_are_not_believed():
    """Breaks if a frozen sensor, or a message that comes twice, gives a velocity."""
    drive = simulate_drive(np.random.default_rng(3), duration=1.5)
    scans = list(drive.scans)
    scans[7] = replace(scans[6], time=scans[7].time)
    with pytest.warns(UserWarning, match=r"^scans repeats its scan at 0\.700 s"):
        reasons = track((scans, drive.mounting)).reasons
    assert np.flatnonzero(reasons == "a scan that repeats an earlier one").tolist() == [6]
    frozen = [replace(scans[0], time=scan.time) for scan in scans]
    with pytest.warns(UserWarning, match="repeats its scan"):
        assert not track((frozen, drive.mounting)).converged.any()
    still = [replace(scan, doppler=0.0 * scan.doppler) for scan in frozen]  # of a coarse radar
    standing = track((still, drive.mounting))
    assert standing.converged.all()
    assert_allclose(standing.theta, 0.0, atol=1e-3)


@pytest.mark.parametrize("horizon", [None, 0.3])
def test_a_frozen_sensor_is_named_and_the_others_go_on(horizon):
    """Breaks if one sensor discards the rounds of all, or what it repeats counts as measured."""
    sensors = named_sensors(20)
    scans, at = sensors["right"]
    sensors["right"] = [*scans[:8], *(replace(scans[7], time=s.time) for s in scans[8:])], at
    with pytest.warns(UserWarning, match="repeats its scan") as said:
        found = track(sensors, horizon=horizon)
    assert [str(each.message).split()[0] for each in said] == ["sensors['right'].scans"]
    assert found.converged.all()
    size = [sum(own[k].size for own in (sensors["left"][0], sensors["rear"][0])) for k in (10, 19)]
    assert_array_equal(found.targets[[9, 18]], size)
    assert np.abs(found.theta - STRAIGHT).max() < 0.3
    tracker = Tracker({name: at for name, (_, at) in sensors.items()}, horizon=horizon)
    with pytest.warns(UserWarning, match=r"^'right' repeats its scan at 0\.813 s"):
        fed(tracker, sensors)
    assert_same(tracker.track, found)


# ---- budget and limits


def test_a_track_contains_its_budget():
    """Breaks if the covariance is not the sum of the parts, or the lag is not in it."""
    drive = simulate_drive(np.random.default_rng(1), duration=3.0)
    plain = track(drive)
    budget = ErrorBudget(azimuth=0.002, doppler=0.02, scale=0.001, neighbours=1.0)
    found = track(drive, budget=budget)
    assert plain.parts is None
    assert found.parts is not None
    assert_array_equal(found.covariance, found.parts.total)
    assert_array_equal(found.converged, plain.converged)
    assert_array_equal(found.reasons, "")
    assert_array_equal(found.targets, [scan.size for scan in drive.scans[1:]])
    assert ((found.inliers > 0.1) & (found.inliers <= 1.0)).all()
    late = track(drive, budget=replace(budget, lag=0.1))
    added = late.parts.systematic - found.parts.systematic
    assert (np.abs(np.linalg.eigvalsh(added)[:, :2]) < 1e-12).all()  # along the acceleration
    assert added[:, 0, 0].max() > 1e-4
    assert_allclose(late.parts.noise, found.parts.noise, atol=1e-12)
    for each in (found.covariance, *found.parts):  # else a table of the upper triangle differs
        assert_array_equal(each, np.swapaxes(each, 1, 2))


def test_a_failure_shows_no_acceleration():
    """Breaks if the zero before the first estimate, or a held velocity, counts as driven."""
    acceleration, rng = 4.0, np.random.default_rng(2)
    points = rng.uniform([5.0, -20.0], [60.0, 20.0], (40, 2))
    whole = []
    for time in 0.1 * np.arange(20):
        pose = arc([1.0, 0.0, 0.0], 5.0 * time + 0.5 * acceleration * time**2)
        theta, noise = [5.0 + acceleration * time, 0.0, 0.0], 0.1 * rng.standard_normal((3, 40))
        whole.append(observe(points, pose, time, theta, CORNER, noise, (0.1, 0.005, 0.05)))
    for missing in ([1, 2, 3], [9, 10, 11, 12]):
        scans = [scan[:0] if i in missing else scan for i, scan in enumerate(whole)]
        for smooth in (False, True):
            found = track((scans, CORNER), budget=ErrorBudget(), smooth=smooth)
            good = found.converged
            assert good.any()
            assert not good.all()
            expected = 5.0 + acceleration * found.times[good]
            assert np.abs(found.theta[good, 0] - expected).max() < 0.1
            for i in np.flatnonzero(~good):
                before = np.flatnonzero(good[:i])
                assert_array_equal(found.theta[i], found.theta[before[-1]] if before.size else 0.0)


@pytest.mark.filterwarnings("ignore:overflow:RuntimeWarning")
def test_a_covariance_that_overflows_is_no_estimate():
    """Breaks if nan, which exceeds no limit, passes for plausible."""
    drive = simulate_drive(np.random.default_rng(1), duration=0.3)
    scans = [
        replace(scan, sigma_doppler=np.append(scan.sigma_doppler[1:], 1e160))
        for scan in drive.scans
    ]
    for limits in (None, VehicleLimits()):
        found = track((scans, drive.mounting), budget=ErrorBudget(), limits=limits)
        assert set(found.reasons) == {"a covariance that is not finite"}
        assert np.isnan(found.covariance).all()


def test_a_jump_is_refused_until_the_vehicle_could_have_made_it():
    """Breaks if a wrong estimate starts the next ones, or a track never recovers."""
    limits = VehicleLimits(acceleration=5.0, yaw_acceleration=1.0)
    drive = simulate_drive(np.random.default_rng(2), duration=4.0)
    scans = list(drive.scans)
    # one scan of a vehicle that is 6 m/s faster
    angle = scans[20].azimuth + drive.mounting.yaw
    scans[20] = replace(scans[20], doppler=scans[20].doppler - 6.0 * np.cos(angle))
    found = track((scans, drive.mounting), limits=limits)
    assert found.reasons[19].startswith(("an acceleration", "an optimum", "no optimum"))
    assert found.converged[22:].all()


# ---- progress


def test_a_bar_is_shown_only_if_wanted(capsys):
    """Breaks if tests and notebooks fill with bars, or the bar counts something else."""
    drive = simulate_drive(np.random.default_rng(0), duration=0.4)
    for silent in (None, False):
        track(drive, progress=silent)
        assert capsys.readouterr() == ("", "")
    shown = track(drive, progress=True)
    said = capsys.readouterr()
    assert said.out == ""
    assert "4/4" in said.err
    assert_same(shown, track(drive, progress=False))


def test_without_tqdm_only_a_bar_that_was_asked_for_is_missed(monkeypatch):
    """Breaks if a track on a terminal needs what the package does not."""
    monkeypatch.setitem(sys.modules, "tqdm", None)
    monkeypatch.setattr(tracker, "_on_terminal", lambda: True)
    assert list(tracker._counted(3, None)) == [0, 1, 2]
    with pytest.raises(
        ModuleNotFoundError, match=r"^progress=True needs tqdm, .* pip install tqdm"
    ):
        tracker._counted(3, True)
