"""The command line: from a log or a data set to files, or to a message that helps."""

import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import d2d
from d2d.radar import (
    ErrorBudget,
    Gyro,
    Mounting,
    Track,
    VehicleLimits,
    load_radarscenes,
    simulate_drive,
    track,
    write_csv,
)
from d2d.radar.cli import main
from d2d.radar.evaluation.sensor_motion import residuals_of
from d2d.radar.readers import READERS

DEGREE = np.deg2rad(1.0)
SIDE = Mounting(0.3, 0.2, 60.0 * DEGREE)
DRIVE = simulate_drive(np.random.default_rng(0), duration=1.5)
FROM_SIDE = simulate_drive(np.random.default_rng(0), duration=1.5, mounting=SIDE)
FRONT = ("--mounting", "front", "0.4", "0", "0")
BOTH = (*FRONT, "--mounting", "side", "0.3", "0.2", "60")


@pytest.fixture
def log(tmp_path) -> Path:
    """A folder of its own with the log of the front radar."""
    write_csv(tmp_path / "log.csv", {"front": DRIVE.scans})
    return tmp_path / "log.csv"


def tracked(log: Path, *options: str, mounting=FRONT) -> list[str]:
    """The arguments by which a log becomes files ``drive`` beside it."""
    output = str(log.parent / "drive")
    return ["track", "--csv", str(log), *mounting, "--output", output, *options]


def result(log: Path, *options: str, mounting=FRONT) -> Track:
    """The track that the program writes, without a picture."""
    assert main(tracked(log, "--no-picture", *options, mounting=mounting)) == 0
    return Track.load(log.parent / "drive.npz")


def written(folder: Path, prefix: str) -> list[str]:
    return sorted(name for name in os.listdir(folder) if name.startswith(prefix))


FILES = [".npz", ".png", ".tum", "_velocities.csv"]


def test_a_log_becomes_a_path_with_covariances(log, capsys):
    """Breaks if the files hold another track than Python would give, or one is missing."""
    assert main(tracked(log)) == 0
    assert written(log.parent, "drive") == [f"drive{end}" for end in FILES]
    expected = track(DRIVE, budget=ErrorBudget())
    found = Track.load(log.parent / "drive.npz")
    assert_array_equal(found.theta, expected.theta)
    assert_array_equal(found.covariance, expected.covariance)
    table = np.genfromtxt(log.parent / "drive_velocities.csv", delimiter=",", names=True)
    assert_array_equal(table["v_x"], expected.theta[:, 0])
    poses = np.loadtxt(log.parent / "drive.tum")
    assert_allclose(poses[:, 1:3], expected.poses()[:, :2], atol=1e-8)
    assert (log.parent / "drive.png").read_bytes().startswith(b"\x89PNG")
    said = capsys.readouterr()
    assert str(expected) in said.out
    assert f"wrote {log.parent / 'drive.tum'}" in said.out
    assert said.err == ""


def test_a_folder_that_is_not_there_is_made(log):
    """Breaks if the user must make it first, or files get no name in it."""
    output = f"{log.parent}/new/"
    assert main(["track", "--csv", str(log), *FRONT, "--output", output, "--no-picture"]) == 0
    assert written(log.parent / "new", "") == ["track.npz", "track.tum", "track_velocities.csv"]


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("", {"limits": VehicleLimits(), "side_slip": True, "budget": ErrorBudget()}),
        (
            "--baseline 2 --no-budget --budget-lag 0.02",
            {"baseline": 2, "budget": ErrorBudget(lag=0.02)},
        ),
        ("--horizon 0.3 --side-slip 0", {"horizon": 0.3, "side_slip": False}),
        (
            "--budget-azimuth 0.2 --budget-doppler 0.03 --budget-scale 0.001 --budget-lag 0.02 "
            "--budget-neighbours 1.5 --side-slip 0.05",
            {"budget": ErrorBudget(np.deg2rad(0.2), 0.03, 0.001, 0.02, 1.5), "side_slip": 0.05},
        ),
        ("--vehicle train", {"limits": VehicleLimits(150.0, 0.3, 4.0, 0.3)}),
        (
            "--vehicle omni --max-speed inf",
            {"limits": VehicleLimits(np.inf, 6, 12, 15, 0.3, 0.4, np.inf)},
        ),
        (
            "--max-yaw-rate 90 --max-yaw-rate-of-slip 6",
            {"limits": VehicleLimits(yaw_rate=90 * DEGREE, yaw_rate_of_slip=6 * DEGREE)},
        ),
    ],
)
def test_options_reach_the_estimate(log, monkeypatch, given, expected):
    """Breaks if one is dropped or goes to another, 0 is taken for "unknown", or degrees stay."""
    seen = {}

    def stop(sensors, **options):
        seen.update(options)
        assert {scan.extent.max() for scan in sensors["front"][0]} == {0.1}
        raise ValueError

    monkeypatch.setattr("d2d.radar.cli.track", stop)
    assert main(tracked(log, "--extent", "0.1", *given.split())) == 1
    assert {name: seen[name] for name in expected} == expected


@pytest.mark.filterwarnings("ignore:.*steps back:UserWarning")
def test_runs_of_one_logger_are_files_of_their_own(log, capsys):
    """Breaks if runs whose clocks begin anew are merged, or none of them is written."""
    lines = log.read_text().splitlines()
    log.write_text("\n".join([*lines, *lines[1:]]))
    assert main(tracked(log, "--no-picture", "--force")) == 0
    assert len(written(log.parent, "drive")) == 6
    one, other = (Track.load(log.parent / f"drive_{number}.npz") for number in (1, 2))
    assert_array_equal(one.times[1:], other.times[1:])
    assert_array_equal(one.theta, track(DRIVE, budget=ErrorBudget()).theta[: len(one)])


def test_a_gyro_reaches_the_estimate(log, capsys):
    """Breaks if its file is not read, or a sigma in degrees stays so."""
    truth = DRIVE.truth
    rates = truth.theta[:, 2] + np.deg2rad(0.5)
    file = log.parent / "gyro.csv"
    table = np.column_stack([truth.times, np.rad2deg(rates)])
    np.savetxt(file, table, "%.12g", ",", header="time,yaw_rate_deg")
    found = result(log, "--gyro", str(file), "--gyro-sigma", "0.2", "--gyro-bias", "2")
    gyro = Gyro(0.2 * DEGREE, 2.0 * DEGREE, truth.times, rates)
    expected = track(DRIVE, budget=ErrorBudget(), gyro=gyro)
    assert_allclose(found.theta, expected.theta, atol=1e-9)
    without = track(DRIVE, budget=ErrorBudget()).theta
    errors = [np.std(theta[:, 2] - truth.theta[1:, 2]) for theta in (found.theta, without)]
    assert errors[0] < errors[1]
    for option in ("--gyro-bias", "--gyro-topic"):
        assert "need --gyro FILE" in failed(tracked(log, option, "1"), capsys)
    assert "is no bag" in failed(tracked(log, "--gyro", str(file), "--gyro-topic", "/imu"), capsys)
    table[:, 1] = 60.0 * np.sin(5.0 * table[:, 0])
    np.savetxt(file, table, "%.12g", ",", header="time,yaw_rate_deg")
    assert main(tracked(log, "--gyro", str(file))) == 3
    assert capsys.readouterr().out.count("the gyro contradicts the radars") == 1  # the wrong one


def test_a_report_is_one_page(log, capsys):
    """Breaks if the page needs another file, or a finding, a figure or a setting is missing."""
    page = log.parent / "drive.html"
    result(
        log, "--report", str(page), "--side-slip", "0.05", "--force", mounting=(*FRONT[:4], "25")
    )
    text = page.read_text(encoding="utf-8")
    assert "a mounting is turned" in text
    assert len(re.findall('src="data:image/png;base64', text)) == 2
    assert "--side-slip 0.05" in text
    assert not re.search(r'(src|href)="(?!data:)|<script', text)


def test_residuals_show_where_azimuths_are_distorted():
    """Breaks if a residual is of another target, or its sign is the other."""
    bent = [
        replace(scan, doppler=scan.doppler + np.where(scan.azimuth > 0.3, 0.2, 0.0))
        for scan in DRIVE.scans
    ]
    azimuth, residual = residuals_of((bent, DRIVE.mounting), track(DRIVE))
    assert np.median(residual[azimuth > 0.3]) == pytest.approx(0.2, abs=0.03)
    assert np.median(residual[azimuth < 0.2]) == pytest.approx(0.0, abs=0.03)


def test_the_version_is_that_of_the_package(capsys):
    with pytest.raises(SystemExit) as left:
        main(["--version"])
    assert left.value.code == 0
    assert capsys.readouterr().out == f"d2d {d2d.__version__}\n"


RAW = ["--columns", "time=t_ns,azimuth=-angle", "--scan-gap", "0.01", "--skip-invalid"]
STATED = ["--degrees", "--sigma-range", "0.125", "--sigma-doppler", "0.0625"]
STATED += ["--sigma-azimuth", "0.5"]
GATED = ["--range", "2", "30", "--azimuth", "-30", "20", "--min-snr", "5"]


def test_a_raw_log_in_two_files_is_one_command(tmp_path, capsys):
    """Breaks if stamps per target, slots that are empty, signs, units or gates need a script."""
    sides = {"front": DRIVE, "side": FROM_SIDE}
    for name, drive in sides.items():
        rows = [
            (f"{1e9 * scan.time + 1e5 * k:.0f}", *target, 9 - 8 * (k % 2))
            for scan in drive.scans
            for k, target in enumerate(
                zip(scan.range, -np.rad2deg(scan.azimuth), scan.doppler, strict=True)
            )
        ]
        lines = ["t_ns,range,angle,doppler,snr", "0,0,0,81.9,0"]
        lines += [",".join(map(str, row)) for row in rows]
        (tmp_path / f"{name}.csv").write_text("\n".join(lines))
    sources = [f"--csv={name}={tmp_path}/{name}.csv" for name in sides]
    options = [*BOTH, *RAW, *STATED, *GATED, "--no-picture"]
    main(["track", *sources, *options, "--output", f"{tmp_path}/drive"])
    assert "1 of" in capsys.readouterr().err
    sensors = []
    for drive in sides.values():
        scans = []
        for scan in drive.scans:
            strong = scan[::2].within((2.0, 30.0), (-30.0 * DEGREE, 20.0 * DEGREE))
            time = scan.time + 1e-4 * np.median(np.arange(0, len(scan), 2))
            sigmas = {"sigma_range": 0.125, "sigma_azimuth": 0.5 * DEGREE, "sigma_doppler": 0.0625}
            scans.append(replace(strong, time=time, **sigmas))
        sensors.append((scans, drive.mounting))
    expected = track(sensors, budget=ErrorBudget())
    found = Track.load(tmp_path / "drive.npz")
    assert_allclose(found.theta, expected.theta, atol=1e-6)


# ---- Messages


def failed(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """What is said when the program ends with status 1."""
    assert main(arguments) == 1
    said = capsys.readouterr().err
    assert said.startswith("python -m d2d.radar: error: ")
    return said.removeprefix("python -m d2d.radar: error: ").strip()


def test_a_line_that_cannot_be_read_is_named_and_nothing_written(log, capsys):
    """Breaks if there is a traceback, or files of half a drive."""
    lines = log.read_text(encoding="utf-8").splitlines()
    lines[6] = lines[6].replace("front", "front,")
    log.write_text("\n".join(lines), encoding="utf-8")
    output = log.parent / "new" / "drive"
    said = failed(["track", "--csv", str(log), *FRONT, "--output", str(output)], capsys)
    wrong = f"{log}, line 7: there must be 8 values as in the first line, but are 9"
    assert said == f"{wrong}; skip_invalid (--skip-invalid) leaves such lines out"
    assert os.listdir(log.parent) == ["log.csv"]


def test_missing_files_and_wrong_values_are_named(log, capsys):
    """Breaks if there is a traceback, or the message does not say what is wrong."""
    scenes = ["track", "--radarscenes", str(log.parent), "--sequence", "105", "--sensor", "1"]
    left, turned = (("--mounting", "front", "0", "0", yaw) for yaw in ("left", "900"))
    for arguments, said in (
        (["track", "--csv", f"{log}x", *FRONT], "No such file"),
        (tracked(log, "--baseline", "0"), "baseline must be"),
        (tracked(log, "--budget-lag", "-1"), "lag must be at least 0, but is -1"),
        (tracked(log, "--max-acceleration", "-1"), "acceleration must be positive"),
        (tracked(log, "--side-slip", "-0.1"), "side_slip must be"),
        (tracked(log, "--side-slip", "nan"), "side_slip must be"),
        (tracked(log, "--budget-azimuth", "-1"), "azimuth must be at least 0"),
        (tracked(log, "--budget-azimuth", "400"), "azimuth must be in radians (rad), at most 6.28"),
        (scenes, "should be the folder `data`"),
        ([*scenes, "2", "1"], "1 is given twice"),
        (
            tracked(log, mounting=("--mounting", "radar", "0", "0", "0")),
            "are front, but --mounting names radar",
        ),
        (tracked(log, mounting=BOTH), "are front, but --mounting names front, side"),
        (tracked(log, *FRONT), "front is given twice"),
        (
            tracked(log, mounting=left),
            "--mounting front 0 0 left: each of X, Y and YAW must be a number",
        ),
        (tracked(log, mounting=turned), "--mounting front 0 0 900: yaw must be"),
    ):
        assert said in failed(arguments, capsys)


def test_where_nothing_can_be_written_is_known_before_the_work(log, capsys, monkeypatch):
    """Breaks if a long drive is estimated and then lost."""

    def never(*_arguments, **_options):
        raise AssertionError

    monkeypatch.setattr("d2d.radar.cli.track", never)
    call = ["track", "--csv", str(log), *FRONT, "--output"]
    assert "is not a writable folder" in failed([*call, f"{log}/drive"], capsys)


def test_all_files_are_written_or_none(log, capsys, monkeypatch):
    """Breaks if an error in the last one leaves the others behind, or Ctrl-C a traceback."""
    for error, status, said in (
        (OSError("no space left"), 1, "error: no space left"),
        (KeyboardInterrupt(), 130, "interrupted, nothing was written"),
    ):

        def full(*_arguments, error=error):
            raise error

        monkeypatch.setattr(Track, "save", full)
        assert main(tracked(log)) == status
        assert said in capsys.readouterr().err
        assert os.listdir(log.parent) == ["log.csv"]


def test_without_matplotlib_there_is_no_picture(log, capsys, monkeypatch):
    """Breaks if another file is missing too, nobody is told, or an old picture stays."""
    (log.parent / "drive.png").write_text("old")
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert main(tracked(log)) == 0
    assert "no picture" in capsys.readouterr().err
    assert written(log.parent, "drive") == [f"drive{end}" for end in FILES if end != ".png"]


def test_arguments_that_do_not_fit_are_refused(capsys):
    """Breaks if an option has no effect and nobody is told."""
    for arguments, said in (
        (["track"], "one of the arguments --csv"),
        (["track", "--csv", "log.csv"], "--csv needs --mounting"),
        (["track", "--radarscenes", "R", "--sequence", "1"], "--radarscenes needs --sensor"),
        (["track", "--nuscenes", "R", "--channel", "F"], "--nuscenes needs --scene"),
        (
            ["track", "--nuscenes", "R", "--scene", "s", "--channel", "F", "--degrees"],
            "--degrees belongs to --csv",
        ),
        (["track", "--csv", "l", *FRONT, "--sensor", "1"], "--sensor belongs to --radarscenes"),
        (["fly"], "invalid choice: 'fly'"),
    ):
        with pytest.raises(SystemExit) as left:
            main(arguments)
        assert left.value.code == 2
        assert said in capsys.readouterr().err


_OF_TARGETS = "mounting sigma-range sigma-azimuth sigma-doppler min-snr degrees"
READER_OPTIONS = {
    "csv": f"{_OF_TARGETS} columns time-unit scan-gap skip-invalid",
    "bag": f"{_OF_TARGETS} topic base-frame bag-stamps",
    "radarscenes": "sequence sensor",
    "nuscenes": "scene channel",
}


def test_the_help_names_all_readers_and_stays_readable(capsys):
    """Breaks if a reader that is added to the table cannot be used from the command line."""
    with pytest.raises(SystemExit) as left:
        main(["track", "--help"])
    assert left.value.code == 0
    said = capsys.readouterr().out
    for name, reader in READERS.items():
        assert re.search(rf"--{name} {reader.metavar} +{reader.about}", said)
        assert all(f"--{option} " in said for option in READER_OPTIONS[name].split())
    assert max(map(len, said.splitlines())) <= 110


# ---- What is told of a track, and the other commands


def test_what_speaks_for_a_track_is_printed(tmp_path, capsys):
    """Breaks if a sensor is left out, or a fault has not its name and sensor."""
    log = tmp_path / "log.csv"
    write_csv(log, {"front": DRIVE.scans, "side": FROM_SIDE.scans})
    result(log, mounting=BOTH)
    found = capsys.readouterr().out
    assert re.search(r"ANEES of the differences between front and side .*: \d+\.\d", found)
    assert "what looks wrong" not in found
    turned = (*FRONT, "--mounting", "side", "0.3", "0.2", "66")
    result(log, mounting=turned)
    assert re.search(r"  side: a mounting is turned \(.* [+]\d\.\d deg", capsys.readouterr().out)


def test_what_is_surely_wrong_is_not_written(log, capsys):
    """Breaks if a user goes on with files of nonsense, or cannot have them at all."""
    write_csv(log, {"front": DRIVE.scans, "side": FROM_SIDE.scans})
    turned = (*FRONT, "--mounting", "side", "0.3", "0.2", "85")
    assert main(tracked(log, "--no-picture", mounting=turned)) == 3
    assert "nothing was written: " in capsys.readouterr().err
    assert os.listdir(log.parent) == ["log.csv"]
    result(log, "--force", mounting=turned)


def test_a_track_without_an_estimate_is_no_success(tmp_path, capsys):
    """Breaks if a file full of nan passes for a result, or scans that --max-interval allows are
    refused as milliseconds."""
    rare = [replace(scan, time=700.0 * scan.time) for scan in DRIVE.scans]
    write_csv(tmp_path / "log.csv", {"front": rare})
    assert main(tracked(tmp_path / "log.csv", "--max-interval", "100")) == 3
    assert main(tracked(tmp_path / "log.csv")) == 1
    first, second = capsys.readouterr().err.splitlines()
    assert first.startswith("python -m d2d.radar: nothing was written: ")
    assert "apart" not in first
    assert "at most max_interval = 60 apart" in second
    assert os.listdir(tmp_path) == ["log.csv"]


def test_messages_name_the_sensors_of_the_log(tmp_path, capsys):
    """Breaks if a user must know what a sensor is called inside."""
    twice = [scan[np.repeat(np.arange(scan.size), 2)] for scan in DRIVE.scans]
    write_csv(tmp_path / "log.csv", {"front": twice, "side": FROM_SIDE.scans})
    result(tmp_path / "log.csv", mounting=BOTH)
    said = capsys.readouterr()
    assert said.err.startswith("python -m d2d.radar: warning: front has targets twice")


def odometry(path: Path, late: float = 0.0) -> str:
    """A file with the true speed and yaw rate of the drive, on a clock that is ahead."""
    long = simulate_drive(np.random.default_rng(0), duration=20.0)
    write_csv(path / "log.csv", {"front": long.scans})
    truth = long.truth
    columns = [truth.times - late, truth.theta[:, 0], truth.theta[:, 2]]
    file = str(path / "odometry.csv")
    np.savetxt(file, np.column_stack(columns), "%.9g", ",", header="time,speed,yaw_rate")
    return file


def test_calibrate_finds_angle_and_lag_and_prints_the_mounting(tmp_path, capsys):
    """Breaks if the odometry is not used, or what is printed cannot be given to `track`."""
    call = ["calibrate", "--csv", str(tmp_path / "log.csv"), "--odometry", odometry(tmp_path, 0.2)]
    assert main([*call, "--mounting", "front", "0.4", "0", "3"]) == 0
    said = capsys.readouterr().out
    assert float(re.search(r"lag +([+-][\d.]+)", said)[1]) == pytest.approx(0.2, abs=0.02)
    word, name, *place = said.splitlines()[-1].split()
    assert (word, name) == ("--mounting", "front")
    assert_allclose([float(number) for number in place], [0.4, 0.0, 0.0], atol=0.2)
    assert "the columns time, speed or time, yaw_rate" in failed(
        [*call[:3], "--odometry", call[2], "--mounting", "front", "0", "0", "0"], capsys
    )


def test_compare_prints_the_errors_of_a_written_track(tmp_path, capsys):
    """Breaks if the file of a track, or the lag, is not taken."""
    reference = odometry(tmp_path, 0.2)
    result(tmp_path / "log.csv")
    capsys.readouterr()
    found = {}
    for lag in ("0.2", "0"):
        assert main(["compare", f"{tmp_path}/drive.npz", reference, "--lag", lag]) == 0
        said = capsys.readouterr().out
        assert "it is compared with zero" in said
        found[lag] = re.search(r"RMSE +(\S+) +\S+ +(\S+)", said).groups()
    assert float(found["0.2"][1]) < float(found["0"][1])
    gyro = tmp_path / "gyro.csv"
    np.savetxt(
        gyro, np.loadtxt(reference, delimiter=",")[:, [0, 2]], "%.9g", ",", header="time,yaw_rate"
    )
    assert main(["compare", f"{tmp_path}/drive.npz", str(gyro), "--lag", "0.2"]) == 0
    said = capsys.readouterr().out
    assert "has no speed, which is not compared" in said
    assert re.search(r"RMSE +(\S+)", said)[1] == found["0.2"][1]
    poses = main(["compare", f"{tmp_path}/drive.npz", f"{tmp_path}/drive.tum"])
    assert poses == 0
    assert "compared with zero" not in capsys.readouterr().out


# ---- As a program, and on real data


def test_the_program_writes_an_example_that_it_can_read(tmp_path):
    """Breaks if `python -m d2d.radar` does not run, or the command that it names fails."""
    run = {"cwd": tmp_path, "capture_output": True, "text": True, "check": True}
    program = [sys.executable, "-m", "d2d.radar"]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).resolve().parents[2])}
    done = subprocess.run([*program, "example", "log.csv"], env=environment, **run)
    named = done.stdout.splitlines()[-1].split()
    assert named[:4] == ["python", "-m", "d2d.radar", "track"]
    done = subprocess.run([*program, *named[3:], "--no-picture"], env=environment, **run)
    assert written(tmp_path, "track") == ["track.npz", "track.tum", "track_velocities.csv"]
    assert done.stderr == ""
    driven = Track.load(tmp_path / "track.npz")
    assert driven.converged.mean() > 0.95
    assert driven.poses()[-1, 1] == pytest.approx(70.0, abs=5.0)  # m, seen in its picture


@pytest.mark.filterwarnings("ignore:.*(lines are left out|usual values are taken):UserWarning")
def test_a_real_radar_from_its_raw_log(tmp_path, capsys):
    """Breaks if the example is not there, or a log in its maker's form is no longer one command."""
    raw = str(tmp_path / "esr.csv.gz")
    assert main(["example", "--real", raw]) == 0
    named = capsys.readouterr().out.splitlines()[-1].split()[3:]
    assert main([*named, "--no-picture", "--output", f"{tmp_path}/drive"]) == 0
    assert "what looks wrong" not in capsys.readouterr().out
    driven = Track.load(tmp_path / "drive.npz")
    assert driven.converged.mean() > 0.98
    start, end = 1619075668.0 + np.array([[39.574], [48.379]])  # poses of the car's lidar
    motion = driven.displacement(start, end).motion[0]
    assert_allclose(motion[:2], [41.3, 36.3], atol=10.0)  # objects are tracked, and lag behind
    assert 0.7 < motion[2] / np.deg2rad(65.2) < 1.0


@pytest.mark.radarscenes
def test_radarscenes_from_the_command_line(tmp_path, radarscenes):
    """Breaks if a sensor is left out or the data set's own numbers are replaced."""
    call = ["track", "--radarscenes", str(radarscenes), "--sequence", "105", "--sensor", "3", "1"]
    assert main([*call, "--no-picture", "--no-budget", "--output", str(tmp_path / "drive")]) == 0
    recordings = [load_radarscenes(radarscenes, 105, sensor) for sensor in (3, 1)]
    expected = track(recordings)
    assert_array_equal(Track.load(tmp_path / "drive.npz").theta, expected.theta)


@pytest.mark.nuscenes
def test_nuscenes_from_the_command_line(tmp_path, nuscenes):
    """Breaks if the scene or the channel does not arrive at the reader."""
    call = ["track", "--nuscenes", str(nuscenes), "--scene", "scene-0061"]
    call += ["--channel", "RADAR_FRONT", "--no-picture", "--output", str(tmp_path / "drive")]
    assert main(call) == 0
    assert Track.load(tmp_path / "drive.npz").converged.mean() > 0.9
