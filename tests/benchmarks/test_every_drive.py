"""Every drive of a root has its row, once, however often a run is stopped and wherever it runs."""

import csv
from pathlib import Path

import joblib
import pytest

from benchmarks import every_drive
from tests.benchmarks.simulated_roots import write_nuscenes, write_radarscenes


def rows_in(path: Path) -> dict[str, dict[str, str]]:
    """The rows by drive; none may be there twice."""
    rows = list(csv.DictReader(path.read_text().splitlines()))
    found = {row["drive"]: row for row in rows}
    assert len(found) == len(rows)
    return found


@pytest.fixture(scope="module")
def roots(tmp_path_factory) -> list[Path]:
    """Two sequences and two scenes; the second scene lacks the scans of a radar."""
    folder = tmp_path_factory.mktemp("roots")
    write_radarscenes(folder / "RadarScenes", 2, 2.0)
    write_nuscenes(folder / "nuScenes", 2, 2.0)
    for scan in (folder / "nuScenes" / "samples" / "RADAR_FRONT").glob("scene-0002_*"):
        scan.unlink()
    return [folder / "RadarScenes", folder / "nuScenes"]


@pytest.fixture(scope="module")
def whole(roots, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("table") / "rows.csv"
    every_drive.evaluate(every_drive.drives_of(roots), path)
    return path


def test_each_drive_has_a_row_with_its_errors_or_the_reason(whole):
    """Breaks if a drive is missed, an estimate is compared with another drive, or what cannot be
    read ends the run or looks like a result."""
    rows = rows_in(whole)
    assert set(rows) == {"1", "2", "scene-0001", "scene-0002"}
    for name in ("1", "2", "scene-0001"):
        assert rows[name]["reason"] == ""
        assert float(rows[name]["rmse v_x"]) < 0.3
        assert float(rows[name]["rmse omega"]) < 5.0
        assert int(rows[name]["estimates"]) >= 10
    assert int(rows["1"]["radars"]) == 4
    assert int(rows["scene-0001"]["radars"]) == 5
    assert "FileNotFoundError" in rows["scene-0002"]["reason"]
    assert rows["scene-0002"]["anees"] == ""


def test_a_stopped_run_goes_on(whole, roots, tmp_path, monkeypatch):
    """Breaks if a drive is evaluated again, or the row that was cut stays."""
    lines = whole.read_text().splitlines(keepends=True)
    path = tmp_path / "rows.csv"
    path.write_text("".join(lines[:3]) + lines[3][:40])
    done = {line.split(",")[1] for line in lines[1:3]}
    judged, asked = every_drive.row_of, []

    def noted(*task):
        asked.append(task[2])
        return judged(*task)

    monkeypatch.setattr(every_drive, "row_of", noted)
    tasks = every_drive.drives_of(roots)
    every_drive.evaluate(tasks, path)
    assert set(asked) == set(rows_in(whole)) - done
    assert_same(rows_in(path), rows_in(whole))
    every_drive.evaluate(tasks, path)
    assert len(asked) == 2


def assert_same(found: dict[str, dict[str, str]], expected: dict[str, dict[str, str]]) -> None:
    """All but the time that it took."""
    untimed = [
        {name: row | {"took": ""} for name, row in rows.items()} for rows in (found, expected)
    ]
    assert untimed[0] == untimed[1]


def test_a_drive_of_two_roots_is_evaluated_once(roots, tmp_path):
    """Breaks if a second root's excerpt of the same sequence counts as another drive."""
    write_radarscenes(tmp_path / "excerpt", 3, 0.5)
    tasks = every_drive.drives_of([roots[0], tmp_path / "excerpt"])
    assert tasks[:2] == [("RadarScenes", roots[0], name) for name in ("1", "2")]
    assert tasks[2:] == [("RadarScenes", tmp_path / "excerpt", "3")]


def test_what_is_no_root_or_no_table_of_this_kind_is_refused(roots, tmp_path):
    """Breaks if a wrong folder gives an empty table, or another file is overwritten."""
    with pytest.raises(ValueError, match="holds no drive"):
        every_drive.drives_of([roots[0], tmp_path])
    other = tmp_path / "other.csv"
    other.write_text("a,b\n1,2\n3")
    with pytest.raises(ValueError, match="other columns"):
        every_drive.evaluate([], other)
    assert other.read_text() == "a,b\n1,2\n3"


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # distributed's own clean-up warns
def test_a_dask_cluster_gives_the_same_rows(whole, roots, tmp_path):
    """The same call, unchanged, on a real cluster of processes."""
    distributed = pytest.importorskip("distributed")
    path = tmp_path / "rows.csv"
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster),
        joblib.parallel_config(backend="dask"),
    ):
        every_drive.evaluate(every_drive.drives_of(roots), path)
    assert_same(rows_in(path), rows_in(whole))
