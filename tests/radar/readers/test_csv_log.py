"""Logs as comma-separated values: what is read, and how a bad line is named."""

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


def test_columns_may_come_in_any_order_among_others(log):
    """Breaks if places are fixed, or case and spaces of names matter."""
    path = log(
        "rcs, Doppler ,azimuth,SENSOR,range,time,sigma_doppler,sigma_azimuth,sigma_range\n"
        "x,-4.5,0.25,front,12,3.5,0.0625,0.5,0.125\n"
    )
    (scan,) = load_csv(path)["front"]
    expected = {"time": 3.5, "range": 12.0, "azimuth": 0.25, "doppler": -4.5}
    expected |= {"sigma_range": 0.125, "sigma_azimuth": 0.5, "sigma_doppler": 0.0625}
    for name, value in expected.items():
        assert_array_equal(np.ravel(getattr(scan, name)), [value])


def test_lines_of_a_scan_may_stand_anywhere(log):
    """Breaks if a scan ends where another sensor's line comes between, or time goes back."""
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


def test_angles_may_be_in_degrees(log):
    """Breaks if a standard deviation stays in degrees, or one in rad is taken for degrees."""
    path = log(f"{HEADER},sigma_azimuth\n0,5,-90,0,2\n")
    rest = {name: ALL[name] for name in ("sigma_range", "sigma_doppler")}
    (scan,) = load_csv(path, degrees=True, **rest)["radar"]
    assert_allclose([*scan.azimuth, *scan.sigma_azimuth], np.deg2rad([-90.0, 2.0]), rtol=1e-15)
    (scan,) = load_csv(path, degrees=True, **ALL)["radar"]
    assert_array_equal(scan.sigma_azimuth, [0.01])


def test_what_programs_write_is_read(log):
    """Breaks if a spreadsheet's or NumPy's way of writing is not known."""
    for text in (
        "time;range;azimuth;doppler\n0;5;0.5;-1\n",
        "time\trange\tazimuth\tdoppler\r\n0\t5\t0.5\t-1\r\n",
        "\ufefftime,range,azimuth,doppler\n0,5,0.5,-1",
        "# time,range,azimuth,doppler\n0,5,0.5,-1\n",
        '\n# made by hand\n"time","range","azimuth","doppler"\n"0","5","0.5","-1"\n',
    ):
        (scan,) = load_csv(log(text), **ALL)["radar"]
        assert [*scan.range, *scan.azimuth, *scan.doppler] == [5.0, 0.5, -1.0]


def test_a_line_that_cannot_be_read_is_named(log):
    """Breaks if the user must look for it among a million lines."""
    for line, said in (
        ("0,abc,0,0", "range must be a number, but is 'abc'"),
        ("0,,0,0", "range must be a number, but is ''"),
        ("0,1_0,0,0", "range must be a number, but is '1_0'"),
        ("0,\u0661\u0662,0,0", "range must be a number, but is '\u0661\u0662'"),
        ("0,5,0", "there must be 4 values as in the first line, but are 3"),
        ("0,5,0,0,", "there must be 4 values as in the first line, but are 5"),
        ("0,-5,0,0", "range must be positive, but is -5"),
        ("0,5,nan,0", "azimuth must be finite"),
        ("0,5,0,inf", "doppler must be finite"),
        ("nan,5,0,0", "time must be finite"),
        ("0,25e3,0,1", "range must be in m, at most 10000, but is 25000; are these millimetres"),
        (
            "0,5,45,0",
            "azimuth must be in radians (rad), at most 6.28319, but is 45; are these degrees (deg",
        ),
        ('0,5,"0,0', "unexpected end of data"),
        (b"0,5,0,\xff1", "doppler must be a number, but is '\u00ff1'"),
    ):
        good = b"0,5,0,0\n"
        bad = line if isinstance(line, bytes) else line.encode()
        path = log(HEADER.encode() + b"\n" + good + b"\n# note\n" + good + bad)
        with pytest.raises(ValueError, match=f"{re.escape(f'{path}, line 6: {said}')}"):
            load_csv(path, **ALL)


def test_other_columns_and_the_first_of_several_bad_lines_are_named(log):
    """Breaks if the line is another's, or an optional column is not looked at."""
    sigmas = {"sigma_azimuth": 0.1, "sigma_doppler": 0.1}
    for text, options, said in (
        (f"{HEADER}\n0,5,0,0\n0,5,9,0\n0,-5,0,0", ALL, "3: azimuth must be"),
        (f"{HEADER},sigma_range\n0,5,0,0,0", sigmas, "2: sigma_range must be positive, but is 0"),
        (f"{HEADER}\n0,5,400,0", {"degrees": True} | ALL, "2: azimuth must be in degrees, .* 400"),
        (f"{HEADER},sensor\n0,5,0,0, ", ALL, "2: sensor must be a name .* but is empty"),
    ):
        with pytest.raises(ValueError, match=f"line {said}"):
            load_csv(log(text), **options)


def test_a_file_that_is_no_log_is_refused(log):
    for text, said in (
        ("", "is empty: its first line must name the columns"),
        (f"{HEADER}\n\n", "has no line with a target"),
        ("0,5,0,0\n", "line 1: the first line must name the columns time, range, azimuth, doppler"),
        ("time,range,phi,doppler\n", "doppler, but names 'time', 'range', 'phi', 'doppler'"),
        (f"{HEADER},range\n", "line 1: the column 'range' is named twice"),
    ):
        with pytest.raises(ValueError, match=re.escape(said)):
            load_csv(log(text), **ALL)


def test_standard_deviations_must_come_from_somewhere(log):
    """Breaks if a default stands in that the user never saw."""
    some = {name: ALL[name] for name in ("sigma_range", "sigma_doppler")}
    with pytest.raises(ValueError, match=r"no column sigma_azimuth,.* line: --sigma-azimuth\)"):
        load_csv(log(f"{HEADER}\n0,5,0,0"), **some)
    with pytest.raises(ValueError, match=r"column sigma_range, sigma_azimuth, sigma_doppler, so"):
        load_csv(log(f"{HEADER}\n0,5,0,0"))
    with pytest.raises(ValueError, match=r"^sigma_range must be positive"):
        load_csv(log(f"{HEADER}\n0,5,0,0"), **(ALL | {"sigma_range": 0.0}))


def test_only_scans_under_names_are_written(tmp_path):
    """Breaks if a name is lost, or two scans of a time become one, when they are read."""
    scan = RadarScan(0.0, [5.0], [0.0], [0.0], 0.1, 0.01, 0.1)
    names = ({bad: [scan]} for bad in ("", " front", "a\nb"))
    for sensors, said in (
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


def test_a_clock_that_steps_back_once_keeps_its_order(log):
    """Breaks if the time after midnight is put before that of the evening, or lines in any order
    are no longer sorted."""
    for given, expected in (
        ([86398.0, 86399.0, 0.0, 1.0, 0.5], [86398.0, 86399.0, 0.0, 0.5, 1.0]),
        ([5.0, 1.0, 9.0, 3.0], [1.0, 3.0, 5.0, 9.0]),
        ([2.0, 1.5, 3.0], [1.5, 2.0, 3.0]),
    ):
        lines = "".join(f"{time},5,0,0\n" for time in given)
        (scans,) = load_csv(log(f"{HEADER}\n{lines}".encode()), **ALL).values()
        assert [scan.time for scan in scans] == expected
