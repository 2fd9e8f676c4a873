"""How large a file may become when it is unpacked: a few kilobytes may be made to fill memory."""

from __future__ import annotations

import struct
import zipfile
import zlib
from pathlib import Path
from typing import BinaryIO

LARGEST = 4 * 2**30  # bytes: sixty million rows of eight numbers
_COMPRESSED = 15  # the type of an element in MATLAB's version 5


def check_size(unpacked: int) -> None:
    """ValueError for more than `LARGEST` bytes."""
    if unpacked > LARGEST:
        raise ValueError(
            f"it unpacks to more than {LARGEST / 2**30:g} GiB; keep fewer rows or channels in it."
        )


def read_bounded(file: BinaryIO) -> bytes:
    """The content of a file, packed or not."""
    content = file.read(LARGEST + 1)
    check_size(len(content))
    return content


def check_zip(path: Path) -> None:
    """The sizes that an archive declares, more than which is never unpacked."""
    if not zipfile.is_zipfile(path):
        return  # reading says what is wrong
    with zipfile.ZipFile(path) as archive:
        check_size(sum(one.file_size for one in archive.infolist()))


def check_matlab(path: Path) -> None:
    """The sizes that packed matrices of version 5 to 7 declare; those of 4 are not packed."""
    total = 0
    with path.open("rb") as file:
        order = {b"IM": "<", b"MI": ">"}.get(file.read(128)[126:])
        while order and len(tag := file.read(8)) == 8:
            kind, count = struct.unpack(f"{order}II", tag)
            start = file.tell()
            if kind == _COMPRESSED:
                inner = zlib.decompressobj().decompress(file.read(min(count, 1024)), 8)
                total += struct.unpack(f"{order}II", inner)[1] if len(inner) == 8 else 0
            file.seek(start + count)
    check_size(total)
