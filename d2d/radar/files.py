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
    whenever the program ends.
    """
    targets = [_target(path) for path in contents]
    for path, target in zip(contents, targets, strict=True):
        if target.exists() and not target.is_file():
            raise OSError(f"{path} is a folder or a device, and cannot be replaced by a file")
    for target in reversed(targets):
        target.unlink(missing_ok=True)
    for target, content in zip(targets, contents.values(), strict=True):
        if content is not None:
            with atomic_write(target) as file:
                file.write(content)


def _target(path: Path) -> Path:
    """The file that a path stands for, so that a link stays a link; its folder must exist."""
    target = Path(os.path.realpath(path))
    if not target.parent.is_dir():
        raise FileNotFoundError(f"{path} cannot be written: {target.parent} does not exist")
    return target
