"""Files written together: all or none, whatever stands in the way or ends the program."""

import itertools
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from d2d.radar.files import write_together

NAMES = ("a.png", "a.tum", "a.csv", "a.npz")  # the last one is there only beside the others


def contents(folder: Path, text: str) -> dict[Path, bytes | None]:
    return {folder / name: text.encode() for name in NAMES}


def held(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir()}


class Stop(BaseException):
    """Ends a program at a call."""


CALLS = ("open", "link", "unlink", "replace")


@pytest.mark.parametrize("unnamed", [True, False], ids=["unnamed", "named"])
def test_an_end_at_any_call_leaves_no_mixture(tmp_path, monkeypatch, unnamed):
    """Breaks if a program that ends between two calls leaves files of two runs, or hidden ones."""
    if not unnamed:
        monkeypatch.delattr(os, "O_TMPFILE", raising=False)
    for stop in itertools.count():
        folder = tmp_path / str(stop)
        folder.mkdir()
        write_together(contents(folder, "old"))
        calls = itertools.count()

        def counted(call, calls=calls, stop=stop):
            def wrapper(*arguments, **options):
                if next(calls) == stop:
                    raise Stop
                return call(*arguments, **options)

            return wrapper

        with monkeypatch.context() as patch:
            for name in CALLS:
                patch.setattr(os, name, counted(getattr(os, name)))
            try:
                write_together(contents(folder, "new"))
            except Stop:
                ended = False
            else:
                ended = True
        left = held(folder)
        assert left.keys() <= set(NAMES)
        assert len(set(left.values())) <= 1
        assert left.keys() == set(NAMES) or NAMES[-1] not in left
        if ended:
            assert set(left.values()) == {"new"}
            break
    assert stop > 8


def test_a_folder_in_the_way_changes_nothing(tmp_path):
    """Breaks if the files before it are overwritten."""
    write_together(contents(tmp_path, "old"))
    for name in NAMES:
        path = tmp_path / name
        path.unlink()
        path.mkdir()
        with pytest.raises(OSError, match=f"{name} is a folder"):
            write_together(contents(tmp_path, "new"))
        path.rmdir()
        path.write_text("old")
    assert held(tmp_path) == dict.fromkeys(NAMES, "old")


def test_links_stay_links_and_what_is_not_written_goes(tmp_path):
    """Breaks if a link is replaced by a file, or a picture of another run stays."""
    (tmp_path / "there").mkdir()
    (tmp_path / "a.npz").symlink_to("there/whole.npz")
    write_together(contents(tmp_path, "old"))
    write_together({**contents(tmp_path, "new"), tmp_path / "a.png": None})
    assert (tmp_path / "a.npz").is_symlink()
    assert (tmp_path / "there" / "whole.npz").read_text() == "new"
    assert not (tmp_path / "a.png").exists()
    (tmp_path / "a.tum").unlink()
    (tmp_path / "a.tum").symlink_to("a.csv")
    with pytest.raises(OSError, match="must be different files"):
        write_together(contents(tmp_path, "other"))


WRITER = """
import sys
from pathlib import Path
from d2d.radar.files import write_together
names = [Path(sys.argv[1]) / name for name in sys.argv[3:]]
print(flush=True)
while True:
    write_together({name: sys.argv[2].encode() * 1000 for name in names})
"""


def test_two_writers_do_not_mix(tmp_path):
    """Breaks if a reader finds the whole track of one run beside files of another."""
    command = [sys.executable, "-c", WRITER, str(tmp_path)]
    for _ in range(3):
        writers = [
            subprocess.Popen([*command, text, *NAMES], stdout=subprocess.PIPE) for text in "xy"
        ]
        for writer in writers:
            assert writer.stdout is not None
            writer.stdout.readline()  # it has begun
        for writer in writers:
            writer.send_signal(signal.SIGKILL)
            writer.communicate()
        left = held(tmp_path)
        assert left.keys() <= set(NAMES)
        assert NAMES[-1] not in left or (left.keys() == set(NAMES) and len(set(left.values())) == 1)
