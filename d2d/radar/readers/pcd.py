"""Reader of binary point clouds in the PCD format of the Point Cloud Library."""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from d2d.radar.readers.shared import bytes_of, reading

# Version 0.7: a text header of lines "KEY value ...", which DATA ends, then the rows.
_END = re.compile(rb"^DATA[ \t]+(\w+)[ \t]*\r?\n", re.MULTILINE)


def read_pcd(path: Path, fields: Iterable[str]) -> dict[str, NDArray[Any]]:
    """Columns of a binary PCD file, by name.

    Raises a ``ValueError`` that names the file if it is not a PCD file, is cut short, or lacks a
    column.
    """
    with reading(path, "a binary PCD file of a radar"):
        rows = _rows(bytes_of(path))
        missing = [field for field in fields if field not in (rows.dtype.names or ())]
        if missing:
            raise ValueError(f"it has no field {missing[0]!r}")
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
    if any(count != "1" for count in header.get("COUNT", [])):
        raise ValueError("it has a field of several values")
    columns = zip(header["FIELDS"], header["TYPE"], header["SIZE"], strict=True)
    layout = np.dtype([(name, f"<{kind.lower()}{size}") for name, kind, size in columns])
    if not header["POINTS"][0].isdigit():
        raise ValueError(f"its header announces {header['POINTS'][0]} points")
    count, held = int(header["POINTS"][0]), len(content) - end.end()
    if held < count * layout.itemsize:
        raise ValueError(
            f"its header announces {count} points of {layout.itemsize} bytes, but {held} bytes "
            "follow"
        )
    return np.frombuffer(content, layout, count, end.end())
