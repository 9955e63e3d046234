"""Logs as comma-separated values: what is read, and how a bad line is named."""

import gzip
import os
import re

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d.radar import RadarScan, load_csv, simulate_drive, write_csv

ALL = {"sigma_range": 0.1, "sigma_azimuth": 0.01, "sigma_doppler": 0.05}
FIELDS = ("range", "azimuth", "doppler", "sigma_range", "sigma_azimuth", "sigma_doppler")
HEADER = "time,range,azimuth,doppler"


@pytest.fixture
def log(tmp_path):
    """Writes text to a file, and returns its path."""

    def write(text: str | bytes):
        path = tmp_path / "log.csv"
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        return path

    return write


def assert_same(one: list[RadarScan], other: list[RadarScan]) -> None:
    assert [scan.time for scan in one] == [scan.time for scan in other]
    for first, second in zip(one, other, strict=True):
        for name in FIELDS:
            assert_array_equal(getattr(first, name), getattr(second, name))


def test_scans_are_read_as_they_were_written(tmp_path):
    """Breaks if a digit is lost, targets change their scan, or sensors are mixed."""
    drives = {
        name: simulate_drive(np.random.default_rng(seed), duration=0.5).scans
        for seed, name in enumerate(("front", 'left, "new"', "3"))
    }
    write_csv(tmp_path / "log.csv", drives)
    read = load_csv(tmp_path / "log.csv")
    assert read.keys() == drives.keys()
    for name, scans in drives.items():
        assert_same(read[name], scans)
    assert os.listdir(tmp_path) == ["log.csv"]


def test_lines_of_a_scan_may_stand_anywhere(log):
    """Breaks if a scan ends where another sensor's line comes between, or times are unsorted."""
    path = log(
        "time,range,azimuth,doppler,sensor\n"
        "0.1,1,0,0,a\n0.1,2,0,0,b\n0.1,3,0,0,a\n\n# a note\n0.0,4,0,0,a\n0.10,5,0,0,b\n"
    )
    read = load_csv(path, **ALL)
    assert [(scan.time, scan.range.tolist()) for scan in read["a"]] == [
        (0.0, [4.0]),
        (0.1, [1.0, 3.0]),
    ]
    assert [(scan.time, scan.range.tolist()) for scan in read["b"]] == [(0.1, [2.0, 5.0])]


# One target at 0.5 s, 5 m, 0.5 rad, -1 m/s, as programs, radars and countries write it.
@pytest.mark.parametrize(
    ("text", "options"),
    [
        ("time;range;azimuth;doppler\n0,5;5;0,5;-1\n", {}),
        ("time\trange\tazimuth\tdoppler\r\n0.5\t5\t0.5\t-1\r\n", {}),
        ("\ufefftime,range,azimuth,doppler\n0.5,5,0.5,-1", {}),
        ("# time,range,azimuth,doppler\n0.5,5,0.5,-1\n", {}),
        ('\n# by hand\n"time","range","azimuth","doppler"\n"0,5","5","0.5","-1"\n', {}),
        ("rcs, Doppler ,azimuth,RANGE,time\nx,-1,0.5,5,0.5\n", {}),
        ("Time [ms],Range (cm),az_deg,v_r_kmh\n500,500,28.64788975654116,-3.6\n", {}),
        ("stamp,dist,phi,range_rate\n500,5,0.5,-1\n", {"time_unit": "ms"}),
        ("time,range,azimuth,doppler\n0.5,5,28.64788975654116,-1\n", {"degrees": True}),
        ("time,x,y,v\n0.5,4.387912809451864,2.397127693021015,-1\n", {"columns": {"doppler": "v"}}),
        (
            "a_ns,range,angle_rad,c_mps\n500000000,5,-0.5,1\n",
            {"columns": {"time": "a_ns", "azimuth": "-angle_rad", "doppler": "-c_mps"}},
        ),
        ("time,range,azimuth,doppler\n1970-01-01T01:00:00.5+01:00,5,0.5,-1\n", {}),
        ("time,range,azimuth,doppler\n1970-01-01 00:00:00.500,5,0.5,-1\n", {}),
        (gzip.compress(b"time,range,azimuth,doppler\n0.5,5,0.5,-1\n", mtime=0), {}),
        (f"{HEADER},snr\n0.5,5,0.5,-1,12\n0.5,6,0.5,-1,8\n", {"min_snr": 10.0}),
    ],
)
def test_logs_as_they_come(log, text, options):
    """Breaks if a way of writing, a name, a sign or a unit is not known."""
    (scan,) = load_csv(log(text), **ALL, **options)["radar"]
    found = np.array([scan.time, *scan.range, *scan.azimuth, *scan.doppler])
    assert_allclose(found, [0.5, 5.0, 0.5, -1.0], rtol=1e-12)


def test_standard_deviations_have_the_units_of_their_columns(log):
    """Breaks if one stays in degrees, or one that is given in rad is taken for degrees."""
    path = log(f"{HEADER},sigma_azimuth\n0,5,-90,0,2\n")
    rest = {name: ALL[name] for name in ("sigma_range", "sigma_doppler")}
    (scan,) = load_csv(path, degrees=True, **rest)["radar"]
    assert_allclose([*scan.azimuth, *scan.sigma_azimuth], np.deg2rad([-90.0, 2.0]), rtol=1e-15)
    (scan,) = load_csv(path, degrees=True, **ALL)["radar"]
    assert_array_equal(scan.sigma_azimuth, [0.01])


def test_usual_standard_deviations_are_taken_with_a_word(log):
    """Breaks if a default stands in that the user never saw, or instead of one that is stated."""
    some = {name: ALL[name] for name in ("sigma_range", "sigma_doppler")}
    with pytest.warns(UserWarning, match=r"log.csv has no sigma_azimuth: usual values are taken"):
        (scan,) = load_csv(log(f"{HEADER}\n0,5,0,0"), **some)["radar"]
    assert [*scan.sigma_range, *scan.sigma_azimuth] == [0.1, np.deg2rad(0.5)]


def test_targets_with_a_height(log):
    """Breaks if a third dimension is dropped, in whichever form it comes."""
    for text in (
        "time,range,azimuth,doppler,elevation\n0,5,0,1,0.1\n",
        f"time,range,azimuth,doppler,z\n0,5,0,1,{5 * np.sin(0.1)}\n",
        f"time,x,y,z,doppler\n0,{5 * np.cos(0.1)},0,{5 * np.sin(0.1)},1\n",
    ):
        (scan,) = load_csv(log(text), **ALL)["radar"]
        assert_allclose([*scan.range, *scan.elevation], [5.0, 0.1])


def test_steps_of_the_doppler_velocity_are_told(log):
    """Breaks if a usual sigma stands in for rounding that is larger than it, without a word."""
    doppler = 0.48 * np.round(np.random.default_rng(0).normal(0.0, 2.0, 500) / 0.48)
    lines = "".join(f"{k},5,0,{v:.2f}\n" for k, v in enumerate(doppler))
    with pytest.warns(UserWarning, match=r"steps of 0\.48 m/s, .*at least 0\.14$"):
        load_csv(log(f"{HEADER}\n{lines}"))


def test_a_parquet_file_is_read_as_its_text(tmp_path):
    """Breaks if a float loses a digit, or times in an index or as dates are not found."""
    pandas = pytest.importorskip("pandas", reason="reading Parquet needs pandas")
    pytest.importorskip("pyarrow", reason="reading Parquet needs pyarrow")
    scans = simulate_drive(np.random.default_rng(0), duration=0.5).scans
    columns = {name: np.concatenate([getattr(scan, name) for scan in scans]) for name in FIELDS}
    times = np.repeat([scan.time for scan in scans], [len(scan) for scan in scans])
    frame = pandas.DataFrame({"time": times} | columns)
    frame.to_parquet(tmp_path / "log.parquet")
    assert_same(load_csv(tmp_path / "log.parquet")["radar"], scans)
    frame["time"] = pandas.to_datetime(frame["time"].round(3), unit="s")
    frame.set_index("time").to_parquet(tmp_path / "log.parquet")
    found = load_csv(tmp_path / "log.parquet")["radar"]
    assert_allclose([scan.time for scan in found], [scan.time for scan in scans], atol=1e-3)


def test_targets_of_one_cycle_are_one_scan(log):
    """Breaks if targets with stamps of their own are scans of one target."""
    times = np.array([0.0, 0.004, 0.008, 0.05, 0.054, 0.1])
    lines = [f"{time},5,0,0,{frame}" for time, frame in zip(times, "aaabbc", strict=True)]
    path = log("\n".join([f"{HEADER},cycle", *lines]))
    for options in ({"scan_gap": 0.01}, {"columns": {"frame": "cycle"}}):
        scans = load_csv(path, **ALL, **options)["radar"]
        assert_allclose([scan.time for scan in scans], [0.004, 0.052, 0.1])
        assert [len(scan) for scan in scans] == [3, 2, 1]
    assert len(load_csv(path, **ALL)["radar"]) == 6


@pytest.mark.filterwarnings("ignore:.*the time steps back:UserWarning")
def test_a_step_back_in_time_begins_a_segment(log):
    """Breaks if runs of one logger are merged where stamps are equal, or the time after midnight
    comes before that of the evening."""
    for given, expected in (
        ([86398.0, 86399.0, 0.0, 1.0, 0.5], [86398.0, 86399.0, 0.0, 0.5, 1.0]),
        ([0.0, 1.5, 0.0, 1.5, 1.5], [0.0, 1.5, 0.0, 1.5]),
        ([2.0, 1.5, 3.0], [1.5, 2.0, 3.0]),
    ):
        lines = "".join(f"{time},5,0,0\n" for time in given)
        (scans,) = load_csv(log(f"{HEADER}\n{lines}"), **ALL).values()
        assert [scan.time for scan in scans] == expected
    with pytest.warns(UserWarning, match=r"log.csv: the time steps back 1 time"):
        load_csv(log(f"{HEADER}\n9,5,0,0\n0,5,0,0\n"), **ALL)


def test_lines_that_are_left_out_are_counted(log):
    """Breaks if data vanish without a word, or good lines with empty slots, words that are missing
    or words that are no numbers."""
    path = log(f"{HEADER}\n0,5,0,-1\n0,0,0,81.91\n0,,,\n0,1,nan,x\n0,1\n")
    with pytest.warns(UserWarning, match=r"4 of 5 lines are left out"):
        (scan,) = load_csv(path, **ALL, skip_invalid=True)["radar"]
    assert_array_equal([scan.range, scan.doppler], [[5.0], [-1.0]])


SKIP = "; skip_invalid (--skip-invalid) leaves such lines out"
LINES = (
    ("0,abc,0,0", f"range must be a number, but is 'abc'{SKIP}"),
    ("0,,0,0", "range must be a number, but is ''"),
    ("0,1_0,0,0", "range must be a number, but is '1_0'"),
    ("0,\u0661\u0662,0,0", "range must be a number, but is '\u0661\u0662'"),
    ("0,5,0", f"there must be 4 values as in the first line, but are 3{SKIP}"),
    ("0,5,0,0,", "there must be 4 values as in the first line, but are 5"),
    ("0,-5,0,0", "range must be positive, but is -5"),
    ("0,5,nan,0", f"azimuth must be finite, but holds nan or inf{SKIP}"),
    ("0,5,0,inf", "doppler must be finite"),
    ("nan,5,0,0", "time must be finite"),
    ("0,25e3,0,1", "range must be in m, at most 10000, but is 25000; are these millimetres"),
    ("0,5,45,0", "azimuth must be in radians (rad), at most 6.28319, but is 45; are these degrees"),
    ('0,5,"0,0', "unexpected end of data"),
    (b"0,5,0,\xff1", "doppler must be a number, but is '\u00ff1'"),
)


@pytest.mark.parametrize(("line", "said"), LINES, ids=[said[:30] for _, said in LINES])
def test_a_line_that_cannot_be_read_is_named(log, line, said):
    """Breaks if the user must look for it among a million lines."""
    good = b"0,5,0,0\n"
    bad = line if isinstance(line, bytes) else line.encode()
    path = log(HEADER.encode() + b"\n" + good + b"\n# note\n" + good + bad)
    with pytest.raises(ValueError, match=re.escape(f"{path}, line 6: {said}")):
        load_csv(path, **ALL)


WHOLE = f"{HEADER}\n0,5,0,0"


@pytest.mark.parametrize(
    ("text", "options", "said"),
    [
        ("", {}, "is empty: its first line must name the columns"),
        (f"{HEADER}\n\n", {}, "has no line with a target"),
        ("0,5,0,0\n", {}, "line 1: the first line must name the columns time, range, azimuth, dop"),
        (
            "time,range,theta,doppler\n",
            {},
            "doppler, but names 'time', 'range', 'theta', 'doppler'",
        ),
        (f"{HEADER},range\n", {}, "line 1: the column 'range' is named twice"),
        (f"{WHOLE}\n0,5,9,0\n0,-5,0,0", {}, "line 3: azimuth must be"),
        (f"{HEADER},sigma_range\n0,5,0,0,0", {"sigma_range": None}, "line 2: sigma_range must"),
        (f"{HEADER}\n0,5,400,0", {"degrees": True}, "azimuth must be in degrees, at most 360"),
        (f"{HEADER},sensor\n0,5,0,0, ", {}, "line 2: sensor must be a name or a number, but is em"),
        (WHOLE, {"sigma_range": 0.0}, "sigma_range must be positive"),
        (WHOLE, {"columns": {"time": "t0"}}, "columns t0, range, azimuth, dop"),
        (WHOLE, {"columns": {"length": "t0"}}, "columns must be one of time, r"),
        (WHOLE, {"columns": {"time": ""}}, "columns must name the column of time, as in time=COL"),
        ("time,x,y,doppler\n0,5,0,1\n1,0,0,1", {}, "line 3, where a scan begins: x and y must not"),
        (WHOLE, {"min_snr": 3.0}, "has no column snr, which min_snr needs"),
        (WHOLE, {"scan_gap": -1.0}, "scan_gap must be at least 0"),
        (f"time_ms{WHOLE[4:]}", {"time_unit": "ns"}, "time_ms is in ms, but is said to be in ns"),
        (b"\x1f\x8b123", {}, "is not a complete gzip file"),
        (gzip.compress(b"0" * 1_000_000, mtime=0), {}, "too many for its size"),
        (b"PAR1123", {}, "is not a Parquet file that pandas and pyarrow read"),
    ],
)
def test_a_log_or_an_option_that_is_not_right_is_refused(log, text, options, said):
    """Breaks if a wrong file is read, a default stands in that the user never saw, or the message
    does not say what is wrong."""
    with pytest.raises(ValueError, match=re.escape(said)):
        load_csv(log(text), **(ALL | options))


def test_only_scans_under_names_are_written(tmp_path):
    """Breaks if a name is lost, or two scans of a time become one, when they are read."""
    scan = RadarScan(0.0, [5.0], [0.0], [0.0], 0.1, 0.01, 0.1)
    names = ({bad: [scan]} for bad in ("", " front", "a\nb"))
    for sensors, said in (
        *((7, "sensors must be a Mapping"), ({7: [scan]}, "must be a str")),
        *(({"a": wrong}, "sensors['a']") for wrong in (7, [7], {"b": [scan]})),
        *((given, f"by names, but hold {next(iter(given))!r}") for given in names),
        ({"a": [scan, scan]}, "sensors['a'] must hold one scan of each time"),
    ):
        with pytest.raises(ValueError, match=re.escape(said)):
            write_csv(tmp_path / "log.csv", sensors)
    assert not list(tmp_path.iterdir())


def test_names_in_any_encoding_stay_apart(log):
    """Breaks if two sensors become one because their names are not in UTF-8."""
    rows = "sensor,time,range,azimuth,doppler\nv\u00f6rn,0,5,0,0\nh\u00e4rn,0,6,0,0\n"
    for encoding in ("utf-8", "utf-8-sig", "latin-1", "utf-16"):
        assert list(load_csv(log(rows.encode(encoding)), **ALL)) == ["v\u00f6rn", "h\u00e4rn"]
