"""What readers and writers share: checks for files, JSON, complete files, strong targets."""

import json
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def existing(folder: Path, name: str, what: str) -> Path:
    """The path of a file or folder; raises a FileNotFoundError that says ``what`` it should be."""
    path = folder / name
    if not os.path.exists(path):  # Path.exists() raises an error if the name is too long
        raise FileNotFoundError(f"{path} does not exist; it should be {what}")
    return path


def read_json(path: Path) -> Any:
    """The content of a JSON file; raises a ValueError that names the file."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, OSError, RecursionError) as error:
        raise ValueError(f"{path} is not a JSON file: {error}") from None


def strongest_targets(cross_section: ArrayLike, count: int | None) -> NDArray[np.intp]:
    """Indices of the ``count`` targets that reflect most, in their order; of all, if None."""
    values = np.asarray(cross_section)
    if count is None or len(values) <= count:
        return np.arange(len(values))
    return np.sort(np.argsort(-values, kind="stable")[:count])


@contextmanager
def written_whole(path: Path) -> Iterator[IO[bytes]]:
    """A file to write to, which replaces ``path`` only when it is complete."""
    target = Path(os.path.realpath(path))  # a link stays a link
    if not target.parent.is_dir():
        raise FileNotFoundError(f"{path} cannot be written: {target.parent} does not exist")
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
