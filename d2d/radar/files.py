"""Files that replace others only when they are complete, one alone or several together."""

import os
import secrets
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
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

    All are written beside their places first, so that nothing changes if one cannot be.  The last
    file is removed first and comes last: while it is there, all are those of one call.
    """
    parts = {}
    with ExitStack() as stack:
        for path, content in contents.items():
            target = _target(path)
            if target.exists() and not target.is_file():
                raise OSError(f"{path} is a folder or a device, and cannot be replaced by a file")
            parts[target] = part = target.with_name(f".{secrets.token_hex(8)}.part")
            stack.callback(part.unlink, missing_ok=True)
            if content is not None:
                part.write_bytes(content)
        for target in reversed(parts):
            target.unlink(missing_ok=True)
        for target, part in parts.items():
            if part.exists():
                os.replace(part, target)


def _target(path: Path) -> Path:
    """The file that a path stands for, so that a link stays a link; its folder must exist."""
    target = Path(os.path.realpath(path))
    if not target.parent.is_dir():
        raise FileNotFoundError(f"{path} cannot be written: {target.parent} does not exist")
    return target
