"""Files that are damaged: every error is a ValueError of a line that names the file.

One good file of each kind is damaged key by key, byte by byte, and by a table of what a file may
claim.  Where a damage does no harm, the recording is that of the good file.
"""

import json
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from d2d.radar import Recording, load_csv, load_radarscenes, load_reference
from tests.radar.readers import test_nuscenes as nuscenes
from tests.radar.readers import test_radarscenes as radarscenes

GONE = object()
ODD = (
    *(GONE, None, True, "", "1_0", "01", "noon", -1, 0.5, 1e300, 10**400, float("nan")),
    *([], {}, [[1]], [1, 2], {"a": 1}, "/etc/passwd", "../../there", "a\nb", "long" * 100_000),
)
LONGEST = 1000  # characters of a message, with its paths


def places(content: Any, place: tuple = ()) -> Iterator[tuple]:
    """The places of all members of JSON, of lists only those of the first row."""
    members = content.items() if isinstance(content, dict) else enumerate(content[:1])
    for key, member in members:
        yield *place, key
        if isinstance(member, dict | list):
            yield from places(member, (*place, key))


def changed(content: Any, place: tuple, value: Any) -> Any:
    """A copy of JSON with another value at a place, or without it."""
    copy = json.loads(json.dumps(content))
    holder = copy
    for key in place[:-1]:
        holder = holder[key]
    if value is GONE:
        del holder[place[-1]]
    else:
        holder[place[-1]] = value
    return copy


def assert_harmless(load: Callable[[], Any], path: Path) -> str:
    """The message of the refusal, if there is one; it names the file or the folder in a line."""
    try:
        load()
    except (ValueError, FileNotFoundError) as error:
        said = str(error)
    else:
        return ""
    assert type(said) is str
    assert "\n" not in said
    assert len(said) < LONGEST
    return said


DATA_SETS: dict[str, tuple[Callable, Callable[[Path], Recording], tuple[str, ...]]] = {
    "radarscenes": (
        lambda folder: radarscenes.write_dataset(folder / "RadarScenes"),
        lambda root: load_radarscenes(root, 7, 3),
        (radarscenes.SCENES, radarscenes.MOUNTINGS),
    ),
    "nuscenes": (
        nuscenes.write_dataset,
        nuscenes.load,
        (
            *(f"v1.0-mini/{name}.json" for name in nuscenes.tables() if name != "ego_pose"),
            "can_bus/scene-0001_pose.json",
        ),
    ),
}
FILES = [(name, file) for name, (*_, files) in DATA_SETS.items() for file in files]


@pytest.mark.parametrize(("name", "file"), FILES, ids=[Path(file).stem for _, file in FILES])
def test_each_key_of_a_list_or_table(tmp_path, name, file):
    """Breaks if a KeyError, TypeError or OverflowError gets through, a file outside is read, or a
    number that is none is taken."""
    write, load, _ = DATA_SETS[name]
    root = write(tmp_path)
    path = root / file
    good = json.loads(path.read_text())
    expected = load(root)
    for place in places(good):
        for value in ODD:
            path.write_text(json.dumps(changed(good, place, value)))
            said = assert_harmless(lambda: load(root), path)
            if said:
                assert str(root) in said or said.startswith(("scene must", "channel must"))
            elif value is not GONE and value != -1 and value != 0.5:  # numbers may be numbers
                found = load(root)
                assert len(found.scans) in (len(expected.scans), len(expected.scans) - 1)
    for whole in ("", "{", "3", "null", "[1]", "[{}]", "{}", '[{"token": 3}]', "\xff"):
        path.write_text(whole, encoding="latin-1")
        said = assert_harmless(lambda: load(root), path)
        assert str(root) in said or said.startswith(("scene must", "channel must"))
    path.unlink()
    path.mkdir()
    if file != "can_bus/scene-0001_pose.json":
        assert str(path) in assert_harmless(lambda: load(root), path)


NEEDED = {
    "radarscenes": (
        *("data", "data/sequence_7", radarscenes.H5, radarscenes.SCENES),
        radarscenes.MOUNTINGS,
    ),
    "nuscenes": (*DATA_SETS["nuscenes"][2][:-1], "samples/RADAR_FRONT"),
}


@pytest.mark.parametrize("name", DATA_SETS)
def test_what_is_missing_is_named_with_its_path(tmp_path, name):
    """Breaks if the error comes from open() or h5py, or names another file than the missing one."""
    write, load, _ = DATA_SETS[name]
    root = write(tmp_path)
    for gone in NEEDED[name]:
        (root / gone).rename(tmp_path / "elsewhere")
        with pytest.raises(FileNotFoundError, match="does not exist; it should be ") as caught:
            load(root)
        assert str(caught.value).startswith(str(root / gone))
        (tmp_path / "elsewhere").rename(root / gone)


def linked(file: h5py.File, other: Path) -> None:
    file["radar_data"] = h5py.ExternalLink(str(other), "radar_data")


def virtual(file: h5py.File, other: Path) -> None:
    with h5py.File(other) as source:
        dataset = source["radar_data"]
        layout = h5py.VirtualLayout(dataset.shape, dataset.dtype)
        layout[:] = h5py.VirtualSource(dataset)
    file.create_virtual_dataset("radar_data", layout)


def stored_outside(file: h5py.File, other: Path) -> None:
    size = radarscenes.TARGETS.nbytes
    (other.parent / "raw").write_bytes(radarscenes.TARGETS.tobytes())
    file.create_dataset(
        "radar_data",
        radarscenes.TARGETS.shape,
        radarscenes.TARGETS.dtype,
        external=[(str(other.parent / "raw"), 0, size)],
    )


def claims(rows: int) -> Callable[[h5py.File, Path], None]:
    def write(file: h5py.File, other: Path) -> None:
        kind = radarscenes.TARGETS.dtype
        file.create_dataset("radar_data", (rows,), kind, chunks=(1000,), compression="gzip")

    return write


@pytest.mark.parametrize(
    ("write", "said"),
    [
        *((linked, "not in another one"), (virtual, "not in another one")),
        *((stored_outside, "not in another one"), (claims(10**12), "too many for its file")),
        (claims(40_000_000), "too many for its file"),
        (lambda file, other: file.create_group("radar_data"), "is not a RadarScenes radar file"),
    ],
)
def test_tables_that_are_elsewhere_or_claim_too_much(tmp_path, write, said):
    """Breaks if another file is read, or gigabytes are taken for a file of some kB."""
    root = radarscenes.write_dataset(tmp_path / "RadarScenes", like_the_original=True)
    path = root / radarscenes.H5
    other = path.rename(tmp_path / "other.h5")
    with h5py.File(path, "w") as file:
        file.create_dataset("odometry", data=radarscenes.ODOMETRY)
        write(file, other)
    found = assert_harmless(lambda: load_radarscenes(root, 7, 3), path)
    assert str(path) in found
    assert said in found


@pytest.mark.parametrize("place", ["/etc", "../there", "a/../../there"])
def test_a_sequence_is_a_folder_of_the_data_set(tmp_path, place):
    """Breaks if another folder is read."""
    root = radarscenes.write_dataset(tmp_path / "RadarScenes")
    with pytest.raises(ValueError, match="is not a name inside"):
        load_radarscenes(root, place, 3)


TEXTS: dict[str, tuple[str, Callable[[Path], Any]]] = {
    "log": (
        "time,sensor,range,azimuth,doppler\n0.1,a,5.5,0.1,-1\n0.1,a,6,0.2,-1\n0.2,b,5,0.1,-1\n",
        lambda path: load_csv(path, sigma_range=0.1, sigma_azimuth=0.01, sigma_doppler=0.1),
    ),
    "odometry": ("time,speed,yaw_rate\n0,5,0.1\n0.1,5.5,0.2\n0.2,6,0.1\n", load_reference),
    "trajectory": (
        "".join(f"{0.1 * i:.1f} {i} 0 0 0 0 0 1\n" for i in range(9)),
        load_reference,
    ),
}


@pytest.mark.parametrize("kind", TEXTS)
def test_each_byte_of_a_text(tmp_path, kind):
    """Breaks if an error is Python's own, or a line that is no number is one."""
    text, load = TEXTS[kind]
    path, rng = tmp_path / "file.txt", np.random.default_rng(0)
    path.write_text(text)
    load(path)
    pieces = (b"", b"\0", b"\xff", b'"', b"\n", b",", b"_", b"e9", b"nan", b"-", b"9" * 400)
    raw = text.encode()
    for place in range(len(raw)):
        for piece in (pieces[i] for i in rng.choice(len(pieces), 3, replace=False)):
            path.write_bytes(raw[:place] + piece + raw[place + 1 :])
            said = assert_harmless(lambda: load(path), path)
            assert not said or str(path) in said
    path.write_bytes(b"x" * 40_000_000 + b"," + raw)
    assert str(path) in assert_harmless(lambda: load(path), path)


@pytest.mark.parametrize("kind", TEXTS)
def test_a_device_or_a_folder_is_no_file(tmp_path, kind):
    """Breaks if a program reads /dev/zero until the memory is full."""
    _, load = TEXTS[kind]
    for path in (Path("/dev/zero"), tmp_path):
        with pytest.raises(ValueError, match=f"^{path} is a folder or a device"):
            load(path)


def test_a_quaternion_of_zero_is_no_direction_and_a_small_one_is(tmp_path):
    """Breaks if squares of small numbers make a direction of their own."""
    path = tmp_path / "path.tum"
    rows = "".join(f"{0.1 * i:.1f} 0 {i} 0 0 0 1e-200 1e-200\n" for i in range(9))
    path.write_text(rows)
    assert np.allclose(load_reference(path).theta[:, :2], [10.0, 0.0])
    root = nuscenes.write_dataset(tmp_path)
    nuscenes.change(root, "calibrated_sensor", {"rotation": [0, 0, 0, 0]})
    with pytest.raises(ValueError, match=r"calibrated_sensor\.json .*quaternion must not be zero"):
        nuscenes.load(root)


BAD = (
    *(("strongest", 0), ("time_offset", np.nan), ("time_offset", 110.0), ("sigma_range", -0.1)),
    *(("sigma_doppler", np.nan), ("sigma_azimuth", -0.1), ("extent", -0.1)),
)
ONLY_NUSCENES = (("speed_factor", 0.0), ("prediction_time", 37.0))


@pytest.mark.parametrize("name", DATA_SETS)
def test_options_out_of_range_are_refused_by_name(tmp_path, name):
    """Breaks if nothing is kept of every scan, or nan gets into the scans or the reference."""
    root = DATA_SETS[name][0](tmp_path)
    load = nuscenes.load if name == "nuscenes" else partial(load_radarscenes, sequence=7, sensor=3)
    for option, bad in (*BAD, *(ONLY_NUSCENES if name == "nuscenes" else (("sensor", "3"),))):
        with pytest.raises(ValueError, match=f"^{option} must"):
            load(root, **{option: bad})
