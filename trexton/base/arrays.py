"""Files of named arrays, read without trust: sizes first, then one array after another.

Offers `read_arrays`, and what a damaged file makes NumPy and zip raise.
"""

import io
import os
import tokenize
import zipfile
import zlib
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZIP_STORED

import numpy as np

from trexton.base.errors import DataError

MOST_BYTES = 2**31
MOST_UNPACKED = 2**26  # of a small file; of a large one so many times its size:
MOST_TIMES = 16
MOST_LIST = 2**16  # bytes of the list of names: a map of every part has fewer than 4,000
# What a damaged file makes NumPy, zip and JSON raise.
DAMAGE = (
    OSError, ValueError, LookupError, EOFError, TypeError, AttributeError, OverflowError,
    MemoryError, RuntimeError, SyntaxError, tokenize.TokenError, zipfile.BadZipFile, zlib.error,
)  # fmt: skip


def read_arrays(path: str | os.PathLike[str]) -> dict[str, np.ndarray]:
    """The named arrays of a ``.npz`` file that NumPy wrote.

    Raises
    ------
    DataError
        It is no regular file, too large, or would unpack to far more than it holds.
    OSError, ValueError, zipfile.BadZipFile
        It is missing or damaged.
    """
    if Path(path).exists() and not Path(path).is_file():
        raise DataError("not a regular file: give a file of arrays (.npz)")
    size = os.stat(path).st_size
    if size > MOST_BYTES:
        raise DataError(f"{size} bytes: expected at most {MOST_BYTES}")
    arrays = {}
    with open(path, "rb") as stream:
        stream.seek(-min(size, 42), os.SEEK_END)
        end = stream.read()
        # Its length stands at the end, unless there is a second end for files above 2 GB.
        if end[-22:-18] != b"PK\5\6" or end[:4] == b"PK\6\7":
            raise zipfile.BadZipFile("it does not end as trexton writes it")
        if (length := int.from_bytes(end[-10:-6], "little")) > MOST_LIST:
            raise DataError(f"{length} bytes that name arrays: expected at most {MOST_LIST}")
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
        # Each has bytes of its own: those that share them were not written by this library.
        total, packed = sum(m.file_size for m in members), sum(m.compress_size for m in members)
        kinds = {member.compress_type for member in members} - {ZIP_STORED, ZIP_DEFLATED}
        if kinds or packed > size or total > max(MOST_UNPACKED, MOST_TIMES * size):
            raise DataError(
                f"its arrays would unpack to {total} bytes in a file of {size}: "
                "expected them as trexton writes them"
            )
        if len({member.filename for member in members}) < len(members):
            raise DataError("two arrays have one name: copy or make it again")
        for member in members:
            name = member.filename.removesuffix(".npy")
            content = io.BytesIO(archive.read(member))  # all of it: so its checksum is compared
            arrays[name] = np.lib.format.read_array(content, allow_pickle=False)
    return arrays
