"""Files whose errors name them, and that replace others only when they are complete."""

import os
import secrets
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
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
    """Replace several files of one folder by contents that belong together; None removes a file.

    The last file is removed first and written last: while it is there, all are those of one call,
    whenever the program ends.  Nothing changes if one cannot be written.  Two writers wait for each
    other.
    """
    targets = {path: _target(path) for path in contents}
    for path, target in targets.items():
        if target.exists() and not target.is_file():
            raise OSError(f"{path} is a folder or a device, and cannot be replaced by a file")
    if len(set(targets.values())) < len(targets):
        raise OSError(f"{', '.join(map(str, targets))} must be different files, but two are links")
    with _locked(next(iter(targets.values())).parent), ExitStack() as stack:
        places = [
            stack.enter_context(_aside(targets[path], content))
            for path, content in contents.items()
            if content is not None
        ]
        for target in reversed(targets.values()):
            target.unlink(missing_ok=True)
        for place in places:
            place()


def _target(path: Path) -> Path:
    """The file that a path stands for, so that a link stays a link; its folder must exist."""
    target = Path(os.path.realpath(path))
    if not target.parent.is_dir():
        raise FileNotFoundError(f"{path} cannot be written: {target.parent} does not exist")
    return target


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Wait until no other process writes files together in a folder."""
    with ExitStack() as stack:
        with suppress(ImportError, OSError):  # not on Windows, nor in all network folders
            import fcntl

            descriptor = os.open(folder, os.O_RDONLY)
            stack.callback(os.close, descriptor)  # which unlocks it
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield


@contextmanager
def _aside(target: Path, content: bytes) -> Iterator[Callable[[], None]]:
    """Write a file without a name, which leaves nothing behind; yield the function that names it.

    Where the system has no such files, it is written beside its place.
    """
    try:
        descriptor = os.open(target.parent, os.O_TMPFILE | os.O_WRONLY, 0o666)
    except (AttributeError, OSError):
        part = target.with_name(f".{target.name}.part")
        try:
            part.write_bytes(content)
            yield lambda: os.replace(part, target)
        finally:
            part.unlink(missing_ok=True)
    else:
        with open(descriptor, "wb") as file:
            file.write(content)
            file.flush()
            link = f"/proc/self/fd/{descriptor}"
            yield lambda: os.link(link, target, src_dir_fd=descriptor, follow_symlinks=True)


def brief(text: object, most: int = 300) -> str:
    """A text in one line, of which a part is left out if it has more than ``most`` characters."""
    line = " ".join(str(text).splitlines())
    return line if len(line) <= most else f"{line[: most - 40]} ... {line[-35:]}"


@contextmanager
def reading(path: Path, what: str) -> Iterator[None]:
    """Re-raise whatever goes wrong inside as a ValueError that says which file is not ``what``."""
    try:
        yield
    except Exception as error:  # damaged bytes raise errors of many libraries
        if isinstance(error, ValueError | FileNotFoundError | Warning) and str(path) in str(error):
            raise
        said = error if isinstance(error, ValueError | OSError) else repr(error)
        raise ValueError(f"{path} is not {what}: {brief(said)}") from None
