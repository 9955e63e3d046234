"""Files that replace others only when they are complete, one alone or several together."""

import os
import secrets
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO


@contextmanager
def atomic_write(path: Path) -> Iterator[IO[bytes]]:
    """Open a file to write to, which replaces ``path`` only when it is complete."""
    target = _target(path)
    if target.exists() and not target.is_file():  # a device or a pipe is written to, not replaced
        with target.open("wb") as file:
            yield file
        return
    part = target.with_name(f".{secrets.token_hex(8)}.part")
    try:
        with part.open("xb") as file:
            yield file
        os.replace(part, target)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def write_together(contents: Mapping[Path, bytes | None]) -> None:
    """Replace several files by contents that belong together; None removes a file.

    The last file is removed first and written last: while it is there, all are those of one call,
    wherever the program ends.  Nothing changes if one cannot be written.
    """
    targets = {path: _target(path) for path in contents}
    for path, target in targets.items():
        if target.exists() and not target.is_file():
            raise OSError(f"{path} is a folder or a device, and cannot be replaced by a file")
    parts = {
        targets[path]: targets[path].with_name(f".{secrets.token_hex(8)}.part")
        for path, content in contents.items()
        if content is not None
    }
    try:
        for path, target in targets.items():
            if target in parts:
                parts[target].write_bytes(contents[path] or b"")
        for target in reversed(targets.values()):
            target.unlink(missing_ok=True)
        for target, part in parts.items():
            os.replace(part, target)
    finally:
        for part in parts.values():
            part.unlink(missing_ok=True)


def _target(path: Path) -> Path:
    """The file that a path stands for, so that a link stays a link; its folder must exist."""
    target = Path(os.path.realpath(path))
    if not target.parent.is_dir():
        raise FileNotFoundError(f"{path} cannot be written: {target.parent} does not exist")
    return target
