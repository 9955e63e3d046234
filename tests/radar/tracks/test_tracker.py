"""Tracks of simulated drives: what is estimated, what fails, and what stays in order then."""

import subprocess
import sys
import textwrap
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numba.core.registry import CPUDispatcher as Dispatcher
from numpy.testing import assert_allclose, assert_array_equal

from d2d._kernel import consensus, entries, errors, propagate
from d2d.radar import (
    ErrorBudget,
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
from d2d.scores import normalised_squares
from tests.radar.scenes import (
    AROUND,
    CORNER,
    STRAIGHT,
    accelerating,
    beginning,
    in_order,
    named_sensors,
    straight_scans,
    surround_scans,
)
from tests.radar.tracks.test_files import assert_same

ROOT = Path(__file__).parents[3]


def test_a_fast_drive_is_not_lost():
    """Breaks if the last velocity is the only start: 2 pairs in 100 then end elsewhere."""
    drive = simulate_drive(np.random.default_rng(0), 10.0, 20.0)
    # around the bends of a yard, faster than any car
    found = track(drive, baseline=1, limits=None)
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


def fed(tracker: Tracker, sensors) -> list[VelocityEstimate]:
    """What a tracker gives for the scans of named sensors in time order."""
    return added(tracker, in_order(sensors)) + tracker.finish()


def added(tracker: Tracker, order) -> list[VelocityEstimate]:
    """The same for scans in a given order, without the end."""
    return [each for _, name, scan in order for each in tracker.add(name, scan)]


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
        other = track(turned, budget=budget)
        assert_array_equal(other.converged, whole.converged)  # sums over sensors are rounded
        assert_allclose(other.theta, whole.theta, rtol=1e-9, atol=1e-12)
        assert_allclose(other.covariance, whole.covariance, rtol=1e-9, atol=1e-15)
        mixed = {
            name: ([scan[rng.permutation(scan.size)] for scan in own], at)
            for name, (own, at) in sensors.items()
        }
        shuffled = track(mixed, budget=budget)
        assert_array_equal(shuffled.converged, whole.converged)
        assert_allclose(shuffled.theta, whole.theta, rtol=0, atol=1e-6)


def test_scans_of_one_time_may_arrive_in_any_order():
    """Breaks if a network decides on the numbers."""
    rng = np.random.default_rng(4)
    sensors = named_sensors(8, shift=0.0)
    found = []
    for _ in range(3):
        tracker = Tracker({name: at for name, (_, at) in sensors.items()}, budget=ErrorBudget())
        for i in range(8):
            for name in rng.permutation([*sensors]).tolist():
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
        from tests.radar.scenes import named_sensors
        from tests.radar.tracks.test_tracker import fed, signatures
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
    tracker = Tracker({"front": at, "also": at})
    tracker.add("front", scans[0])
    with pytest.raises(ValueError, match=r"^'also' and 'front' must be different"):
        tracker.add("also", replace(scans[0]))  # one sensor under two names
    for mountings, options, said in (
        ([at], {}, "mountings must be a Mapping"),
        ({"front": (1.0, 2.0)}, {}, r"mountings\['front'\] must be a Mounting"),
        ({"front": at}, {"keep": 0}, "keep must be"),
        ({"front": at}, {"horizon": -1.0}, "horizon"),
        ({"front": at}, {"limits": 30.0}, "limits must be a VehicleLimits"),
        ({"front": at}, {"carry": 1}, "carry must be True or False"),
        ({"front": at}, {"carry": False, "budget": ErrorBudget()}, "budget must be None without"),
    ):
        with pytest.raises(ValueError, match=f"^{said}"):
            Tracker(mountings, **options)
    with pytest.raises(ValueError, match=r"^smooth must be False without carry"):
        track((scans, at), carry=False, smooth=True)
    with pytest.raises(TypeError, match=r"^unknown options: budgets"):
        track((scans, at), budgets=ErrorBudget())


def front_alone(sensors, **options) -> Track:
    return track(sensors[0], **options)


either_tracker = pytest.mark.parametrize(
    "driven_by", [front_alone, track], ids=["one-sensor", "three"]
)


def changed(sensors, change, which=slice(5, 6)):
    """The sensors with some scans of each replaced by ``change(scan)``."""
    return [
        (scans[: which.start] + [change(scan) for scan in scans[which]] + scans[which.stop :], at)
        for scans, at in sensors
    ]


def test_a_full_turn_between_two_scans_is_no_motion():
    """Breaks if times in ms of a 20 Hz radar, in which a drive is a circle each 50 s, converge."""
    drive = simulate_drive(np.random.default_rng(3), 2.0, sensor=Sensor(rate=20.0))
    late = [replace(scan, time=1000.0 * scan.time) for scan in drive.scans]
    driven = track((late, drive.mounting))
    assert str(driven).startswith("NOT SUPPORTED")
    assert not driven.converged.any()
    turns = [reason for reason in driven.reasons.tolist() if reason.startswith("a turn of 3")]
    assert len(turns) > 0.3 * len(driven.reasons)
    assert all(reason.endswith(" deg between scans") for reason in turns)


@either_tracker
def test_each_round_gives_an_estimate(driven_by):
    """Breaks if pairs of a round are lost, or its time is not the mean of its scans' times."""
    sensors = surround_scans()
    result = driven_by(sensors, baseline=1, carry=False)
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
@pytest.mark.parametrize("options", [{}, {"doppler": False}, {"baseline": 1, "carry": False}])
def test_scans_without_targets_are_marked_and_passed_over(driven_by, options):
    """Breaks if the drive ends there, or a prediction looks like an estimate."""
    result = driven_by(changed(surround_scans(), lambda scan: scan[:0]), **options)
    assert_array_equal(np.flatnonzero(~result.converged), [4])
    assert result.reasons[4] == "a scan without targets"
    assert np.isnan(result.covariance[4]).all()
    assert np.isnan(result.inliers[4])
    assert_allclose(result.theta[4], result.theta[3], atol=0.1)
    assert np.abs(result.theta - STRAIGHT)[:, 0].max() < 0.5
    assert np.isfinite(result.poses()).all()


@either_tracker
@pytest.mark.parametrize("still", [0, 5])
def test_a_scan_in_which_nearly_everything_moves_is_marked(driven_by, still):
    """Breaks if an optimum that rejects nearly all targets is taken for the motion, and carried on;
    five of each sensor that stand still would be enough for an optimum at the right place."""
    rng = np.random.default_rng(71)

    def astir(scan):
        moves = np.arange(scan.size) >= still
        away = rng.uniform(2.0, 40.0, scan.size)
        doppler = np.where(moves, rng.uniform(-60.0, 60.0, scan.size), scan.doppler)
        return replace(scan, range=scan.range + moves * away, doppler=doppler)

    result = driven_by(changed(surround_scans(), astir), baseline=1)
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
    usual = driven_by(surround_scans(), baseline=1)
    result = driven_by(changed(surround_scans(), few, slice(4, 7)), baseline=1)
    good = np.flatnonzero(result.converged)
    assert set(range(3)) | set(range(7, 11)) <= set(good)
    assert np.abs(result.theta[7:] - STRAIGHT)[:, 0].max() < 0.3
    assert normalised_squares(result.theta[good] - STRAIGHT, result.covariance[good]).max() < 30.0
    for i in set(good) & {4, 5}:
        assert np.trace(result.covariance[i]) > 4.0 * np.trace(usual.covariance[i])


@pytest.mark.parametrize(("targets", "accepted"), [(3, False), (5, True)])
def test_an_optimum_that_rests_on_three_targets_is_an_accident(targets, accepted):
    """Breaks if three numbers are taken from three targets, or many more are asked for."""
    scans, at = surround_scans()[0]
    sparse = [scan[:targets] if i in (5, 6) else scan for i, scan in enumerate(scans)]
    found = track((sparse, at), baseline=1, limits=None, outlier=None, initial=STRAIGHT)
    assert found.converged[5] == accepted
    assert found.reasons[5] == ("" if accepted else "an optimum that rests on 3.0 targets")


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
def test_a_standing_vehicle_stands(driven_by):
    """Breaks if a velocity of zero divides, or is taken for no estimate."""
    result = driven_by(surround_scans(theta=(0.0, 0.0, 0.0)))
    assert result.converged.all()
    assert np.abs(result.theta).max() < 0.1
    assert normalised_squares(result.theta, result.covariance).mean() < 6.0


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


def test_a_track_contains_its_budget():
    """Breaks if errors of the budget average out, or are learnt from what a vehicle does."""
    drive = simulate_drive(np.random.default_rng(1), duration=3.0)
    plain = track(drive)
    assert_same(track(drive, budget=ErrorBudget()), plain)
    found = track(drive, budget=ErrorBudget(azimuth=0.002, doppler=0.02, scale=0.001, lag=0.01))
    assert np.abs(found.theta - plain.theta).max() < 0.02
    assert not plain.errors[:, 1, :3, 6:].any()
    slow = found.errors[-10:, 1, 0, 6:]
    assert (np.linalg.norm(slow, axis=1) > 0.01).all()  # whatever came before
    assert_array_equal(found.converged, plain.converged)
    assert_array_equal(found.reasons, "")
    assert_array_equal(found.targets, [scan.size for scan in drive.scans[1:]])
    assert ((found.inliers > 0.1) & (found.inliers <= 1.0)).all()
    assert_array_equal(found.covariance, np.swapaxes(found.covariance, 1, 2))
    swaying = track(drive, budget=ErrorBudget(sway=0.01))
    assert np.abs(swaying.covariance - plain.covariance - np.diag([0.0, 0.0, 1e-4])).max() < 1e-12
    assert_array_equal(swaying.errors, plain.errors)  # it averages out along a path


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("missing", [[1, 2, 3], [9, 10, 11, 12]])
def test_a_failure_shows_no_acceleration(missing, smooth):
    """Breaks if the zero before the first estimate, or a held velocity, counts as driven."""
    ((scans, at),), truth = accelerating([10.0], [0.0], np.array([4.0, 0.0, 0.0]), [CORNER], end=2)
    seen = [scan[:0] if i in missing else scan for i, scan in enumerate(scans)]
    found = track((seen, at), budget=ErrorBudget(), smooth=smooth)
    good, speeds = found.converged, truth(found.times)[:, 0]
    assert 0 < good.sum() < len(found)
    assert np.abs(found.theta[:, 0] - speeds)[good].max() < 0.1
    for i in np.flatnonzero(~good):
        assert found.theta[i, 0] == pytest.approx(speeds[i] if good[:i].any() else 0.0, abs=0.4)


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
