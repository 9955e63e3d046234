"""Scans as lines of JSON in, estimates as lines of JSON out."""

import io
import json
import shlex
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d.radar import ErrorBudget, Gyro, Tracker, simulate_drive
from d2d.radar.cli import main

DRIVE = simulate_drive(np.random.default_rng(0), duration=1.0)
LISTS = ("range", "azimuth", "doppler", "sigma_range", "sigma_azimuth", "sigma_doppler")
CALL = ("live", "--mounting", "front", "0.4", "0", "0")


def lines(scans=DRIVE.scans, **changed) -> list[str]:
    """Scans as lines of JSON, with members that are changed, or None to leave them out."""
    found = []
    for scan in scans:
        entry = {"sensor": "front", "time": scan.time}
        entry |= {name: getattr(scan, name).tolist() for name in LISTS} | changed
        found.append(json.dumps({name: v for name, v in entry.items() if v is not None}))
    return found


@pytest.fixture
def run(monkeypatch, capsys):
    """What the command says to lines, on both outputs."""

    def call(given: list[str], *options: str) -> tuple[list[dict], list[str]]:
        text = io.BytesIO(("\n".join(given) + "\n").encode())
        monkeypatch.setattr("sys.stdin", io.TextIOWrapper(text, encoding="ascii"))
        assert main([*CALL, *options]) == 0
        said = capsys.readouterr()
        return [json.loads(line) for line in said.out.splitlines()], said.err.splitlines()

    return call


def expected() -> list:
    """The estimates of the same scans in Python."""
    tracker = Tracker({"front": DRIVE.mounting}, budget=ErrorBudget())
    found = [each for scan in DRIVE.scans for each in tracker.add("front", scan)]
    return found + tracker.finish()


def test_lines_give_the_numbers_of_a_tracker(run):
    """Breaks if an option is lost, digits are, or the last estimates never come."""
    found, said = run(lines())
    wanted = expected()
    assert said == []
    assert [each["time"] for each in found] == [each.time for each in wanted]
    for one, other in zip(found, wanted, strict=True):
        assert one["converged"] == other.converged
        assert one["reason"] == other.reason
        assert one["theta"] == other.theta.tolist()
        if other.converged:
            assert_array_equal(one["covariance"], other.covariance)
            assert_array_equal(one["filter_input"]["white"], other.filter_input.white)


def test_the_pose_is_that_of_the_track(run):
    """Breaks if the path of a service is another one than that of its log."""
    found, _ = run(lines())
    tracker = Tracker({"front": DRIVE.mounting}, budget=ErrorBudget())
    for scan in DRIVE.scans:
        tracker.add("front", scan)
    wanted = tracker.track.poses()[1:]
    assert_allclose([each["pose"] for each in found], wanted, atol=5e-3)


def test_a_stream_of_which_little_is_accepted_is_told_once(run):
    """Breaks if a service goes on in silence although times are in ms, or doubts a right one."""
    drive = simulate_drive(np.random.default_rng(0), duration=11.0)
    for unit, told in ((1e3, 1), (1.0, 0)):
        found, said = run(lines([replace(scan, time=unit * scan.time) for scan in drive.scans]))
        assert len(found) > 100
        assert len(said) == told
        assert all("only 0 of the last 50 estimates were accepted" in line for line in said)


def test_lines_of_a_gyro(run):
    """Breaks if yaw rates are taken for scans, or change nothing."""
    rates = [
        json.dumps({"time": t, "yaw_rate": w})
        for t, w in zip(DRIVE.truth.times, DRIVE.truth.theta[:, 2], strict=True)
    ]
    both = [line for pair in zip(rates, lines(), strict=True) for line in pair]
    found, said = run(both, "--gyro-sigma", "0.1")
    tracker = Tracker({"front": DRIVE.mounting}, budget=ErrorBudget(), gyro=Gyro(np.deg2rad(0.1)))
    wanted = []
    for scan, rate in zip(DRIVE.scans, DRIVE.truth.theta[:, 2], strict=True):
        tracker.add_gyro([scan.time], [rate])
        wanted += tracker.add("front", scan)
    assert said == []
    assert [each["theta"] for each in found[: len(wanted)]] == [w.theta.tolist() for w in wanted]
    _, said = run(['{"time": 0, "yaw_rate": 30}'], "--gyro-sigma", "0.1")
    assert "yaw_rates must be in rad/s, at most 6.28319" in said[0]
    _, said = run([rates[0], *lines()])
    assert said[0].startswith("python -m d2d.radar: line 1: gyro must be given")


def test_targets_with_a_height_and_gates(run):
    """Breaks if a third dimension or a gate is dropped."""
    flat, _ = run(lines(), "--azimuth", "-20", "30")
    raised = []
    for scan in DRIVE.scans:
        low = scan.within(azimuth=np.deg2rad([-20.0, 30.0]))
        entry = {name: getattr(low, name).tolist() for name in LISTS}
        entry["range"] = (low.range / np.cos(0.3)).tolist()
        entry["doppler"] = (low.doppler * np.cos(0.3)).tolist()
        upwards = {"elevation": [0.3] * len(low), "sigma_elevation": 0.0}
        raised.append(json.dumps({"sensor": "front", "time": scan.time} | entry | upwards))
    found, _ = run(raised)
    assert_allclose([e["theta"] for e in found], [e["theta"] for e in flat], atol=0.1)


def test_angles_in_degrees_and_sigmas_for_all(run):
    """Breaks if degrees stay degrees, in lists or options, or an option does not count instead of
    what the lines hold."""
    degrees = [json.loads(line) for line in lines(sigma_azimuth=None, sigma_range=9.0)]
    radians = [json.loads(line) for line in lines(sigma_azimuth=np.deg2rad(0.5), sigma_range=0.1)]
    for one, other in zip(degrees, radians, strict=True):
        one["azimuth"] = np.rad2deg(one["azimuth"]).tolist()
        other["azimuth"] = np.deg2rad(one["azimuth"]).tolist()
    options = ("--degrees", "--sigma-azimuth", "0.5", "--sigma-range", "0.1")
    found, said = run([json.dumps(entry) for entry in degrees], *options)
    same, _ = run([json.dumps(entry) for entry in radians])
    assert said == []
    assert found
    assert found == same


def test_the_first_line_may_begin_with_a_byte_order_mark(run):
    """Breaks if the first line of an editor's file is lost."""
    first, *rest = lines()
    found, said = run(["\ufeff" + first, *rest])
    assert said == []
    assert len(found) == len(expected())


def test_a_closed_input_is_named(monkeypatch, capsys):
    """Breaks if a service that is started without an input gives a traceback."""
    monkeypatch.setattr("sys.stdin", None)
    assert main(CALL) == 1
    said = capsys.readouterr().err
    assert "error: live needs the standard input and output, but one of them is closed" in said


PROGRAM = [sys.executable, "-m", "d2d.radar", *CALL]
FULL = Path("/dev/full")  # every write to it fails


@pytest.mark.skipif(not FULL.exists(), reason="there is no device that is full")
@pytest.mark.parametrize("closed", [True, False])
def test_a_complaint_that_cannot_be_written_is_dropped(closed):
    """Breaks if a service ends with its log, or its complaints are taken for estimates."""
    if closed and np.__version__ < "2.1":
        pytest.skip("NumPy 2.0 cannot be imported without a standard error")
    good = lines()
    given = "\n".join([good[0], "{", "null", *good[1:]])
    command = shlex.join(PROGRAM) + (" 2>&-" if closed else f" 2>{FULL}")
    done = subprocess.run(command, shell=True, input=given, capture_output=True, text=True)
    assert done.returncode == 0
    assert [json.loads(line)["theta"] for line in done.stdout.splitlines()] == [
        each.theta.tolist() for each in expected()
    ]


@pytest.mark.skipif(not FULL.exists(), reason="there is no device that is full")
@pytest.mark.parametrize("output", [">&-", f">{FULL}", "| head -c 0"])
def test_an_output_that_cannot_be_written_ends_the_program(output):
    """Breaks if a service goes on without anybody who hears it, and says that all is well."""
    command = f"{shlex.join(PROGRAM)} {output}; exit ${{PIPESTATUS[0]}}"
    given = "\n".join(lines())
    done = subprocess.run(["bash", "-c", command], input=given, capture_output=True, text=True)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr


def test_odd_lines_are_named_and_the_next_one_is_read(run):
    """Breaks if one wrong message ends a service, or estimates change."""
    good = lines()
    odd = {
        "{": "Expecting property name",
        "[1, 2]": "a scan must be an object of JSON, but is [1, 2]",
        "null": "a scan must be an object of JSON, but is null",
        '{"sensor": "front"}': "a scan must have time, range, azimuth, doppler, sigma_range",
        good[0].replace('"front"', '"rear"'): "sensor must be one of 'front', but is 'rear'",
        good[0].replace('"time": ', '"time": NaN, "was": '): "time must be finite",
        good[0].replace('"time": ', '"time": 1e999, "was": '): "time must be finite",
        good[0].replace('"time": ', f'"time": {10**400}, "was": '): "time must be",
        good[0].replace('"time": ', '"time": true, "was": '): "time must be a number, but is true",
        good[0].replace('"time": ', '"time": 1e18, "was": '): "time must be in seconds (s), at mo",
        good[0].replace('"time": ', '"time": -1e300, "was": '): "time must be in seconds (s), at",
        good[0].replace('"range": [', '"range": ["a", '): "range must be an array of real numbers",
        '{"yaw_rate": 0.1}': "a yaw rate must have a time",
        "[" * 100_000: "",
        good[0].replace('"front"', f'"{"long" * 100_000}"'): "sensor must be one of 'front', but",
    }
    found, said = run([good[0], "", *odd, *good[1:]])
    assert [each["theta"] for each in found] == [each.theta.tolist() for each in expected()]
    assert len(said) == len(odd)
    assert max(map(len, said)) < 1100
    for number, (line, words) in enumerate(zip(said, odd.values(), strict=True), start=3):
        assert line.startswith(f"python -m d2d.radar: line {number}: {words}"), line


@pytest.mark.parametrize("wrong", ["{}", "null", "[{}]", str(10**400), '"left"', "[[0.1]]"])
@pytest.mark.parametrize("name", ["azimuth", "sigma_azimuth"])
def test_odd_angles_in_degrees_are_named(run, name, wrong):
    """Breaks if a value that is no angle ends the service while it is turned into radians."""
    good = lines(
        azimuth=[], range=[], doppler=[], sigma_azimuth=0.5, sigma_range=1, sigma_doppler=1
    )
    odd = json.loads(good[2]) | {name: json.loads(wrong)}
    found, said = run([*good[:2], json.dumps(odd), *good[3:]], "--degrees")
    assert len(found) == len(good) - 2
    assert len(said) == 1
    assert all(line.startswith(f"python -m d2d.radar: line 3: {name} must") for line in said)


def test_what_is_not_known_is_null(run):
    """Breaks if a line is not JSON because it holds nan."""
    found, _ = run(
        lines(range=[], azimuth=[], doppler=[], sigma_range=[], sigma_azimuth=[], sigma_doppler=[])
    )
    assert {each["converged"] for each in found} == {False}
    assert found[0]["covariance"] is None
    assert found[0]["inliers"] is None
    assert found[0]["reason"] == "a scan without targets"
