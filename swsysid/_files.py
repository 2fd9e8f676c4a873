"""Files that are written whole or not at all."""

from __future__ import annotations

import errno
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def written_beside(path: str | Path) -> Iterator[Path]:
    """A place beside `path` to write to; what is written moves to `path` at the end, in one step.

    After a full disk or an interruption the file that was at `path` is there as it was, and nothing
    else. A link is followed, permissions of a file that is replaced are kept, one that may not be
    written to stays, and what is no ordinary file, such as a pipe, is written to directly.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "notes.txt"
    >>> with written_beside(path) as draft:
    ...     _ = draft.write_text("all of it")
    >>> path.read_text(), len(list(path.parent.iterdir()))
    ('all of it', 1)
    """
    place = Path(os.path.realpath(path))
    if place.exists() and not place.is_file():
        yield place
        return
    if place.exists() and not os.access(place, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
    draft = place.with_name(f".swsysid-{secrets.token_hex(8)}{place.suffix}")
    try:
        yield draft
        _settle(draft, place)
    except OSError as error:
        if error.filename in (None, str(draft)):
            error.filename = str(path)
        raise
    finally:
        draft.unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> None:
    """Write a text in UTF-8, whole or not at all."""
    with written_beside(path) as draft:
        draft.write_text(text, encoding="utf-8")


def _settle(draft: Path, place: Path) -> None:
    """Move a file to its place when the disk has all of it."""
    with draft.open("r+b") as written:
        os.fsync(written.fileno())
    if place.exists():
        draft.chmod(place.stat().st_mode & 0o7777)
    os.replace(draft, place)
