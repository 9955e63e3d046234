"""Reader of binary point clouds in the PCD format of the Point Cloud Library."""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Version 0.7: a text header of lines "KEY value ...", which DATA ends, then the rows.
_END = re.compile(rb"^DATA[ \t]+(\w+)[ \t]*\r?\n", re.MULTILINE)
_KINDS = {"F": "f", "I": "i", "U": "u"}
_SIZES = {"F": (4, 8), "I": (1, 2, 4, 8), "U": (1, 2, 4, 8)}


def read_pcd(path: Path, fields: Iterable[str]) -> dict[str, NDArray[Any]]:
    """Columns of a binary PCD file, by name.

    Raises a ``ValueError`` that names the file if it is not a PCD file, is cut short, or lacks a
    column.
    """
    try:
        content = path.read_bytes()
        rows = _rows(content)
        missing = [field for field in fields if field not in (rows.dtype.names or ())]
        if missing:
            raise ValueError(f"it has no field {missing[0]!r}")
    except (OSError, ValueError) as error:
        raise ValueError(f"{path} is not a binary PCD file of a radar: {error}") from None
    return {field: np.ascontiguousarray(rows[field]) for field in fields}


def _rows(content: bytes) -> NDArray[Any]:
    end = _END.search(content)
    if end is None:
        raise ValueError("its header has no line DATA")
    if end[1] != b"binary":
        raise ValueError(f"its data are {end[1].decode()}, and only binary is read")
    header = {}
    for line in content[: end.start()].decode("ascii").splitlines():
        key, *values = line.split() or [""]
        header[key] = values
    for key in ("FIELDS", "SIZE", "TYPE", "POINTS"):
        if not header.get(key):
            raise ValueError(f"its header has no line {key}")
    layout = _layout(header)
    count = int(header["POINTS"][0])
    held = len(content) - end.end()
    if count < 0 or held < count * layout.itemsize:
        raise ValueError(
            f"its header announces {count} points of {layout.itemsize} bytes, but {held} bytes "
            "follow"
        )
    return np.frombuffer(content, layout, count, end.end())


def _layout(header: dict[str, list[str]]) -> np.dtype[Any]:
    names, kinds, sizes = header["FIELDS"], header["TYPE"], [int(s) for s in header["SIZE"]]
    counts = header.get("COUNT", ["1"] * len(names))
    if not len(names) == len(kinds) == len(sizes) == len(counts):
        raise ValueError("its header's lines FIELDS, SIZE, TYPE and COUNT differ in length")
    for name, kind, size, count in zip(names, kinds, sizes, counts, strict=True):
        if size not in _SIZES.get(kind, ()) or count != "1":
            raise ValueError(f"its field {name!r} is {count} times {kind} of {size} bytes")
    return np.dtype(
        [
            (name, f"<{_KINDS[kind]}{size}")
            for name, kind, size in zip(names, kinds, sizes, strict=True)
        ]
    )
