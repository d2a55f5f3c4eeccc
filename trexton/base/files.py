"""Nothing is half-written: every file and folder has a temporary name until it is whole. Offers
`atomic_file`, `write_file`, `atomic_folder`, checks before files are replaced, and `digest`."""

import glob
import hashlib
import json
import os
import re
import shutil
import stat
import tempfile
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np

from trexton.base.errors import FlightError, ParameterError, TrextonError

LARGEST = 2**30  # bytes of a text: more is a mistake, or meant to fill the memory
# A key of TOML in many parts: to parse it takes the square of them.
_LONG_KEY = r"""(?<![\w-])(([\w-]++|"(\\.|[^"\\\n])*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){30}"""


@contextmanager
def atomic_file(path: str | os.PathLike[str], mode: str = "w") -> Iterator[IO[Any]]:
    """Open a temporary file beside `path`; it is renamed to `path` if the block succeeds.

    It is deleted otherwise; an `OSError` of the disk names `path`. A link stays one: the file that
    it names is written.
    """
    path = _real(path) if Path(path).is_symlink() else Path(path)
    with naming(path):
        _check_regular(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        clean_leftovers(path)
        descriptor, temporary = tempfile.mkstemp(prefix=_prefix(path, "new"), dir=path.parent)
        text: dict[str, Any] = {} if "b" in mode else {"encoding": "utf-8", "newline": "\n"}
        try:
            with os.fdopen(descriptor, mode, **text) as stream:
                yield stream
            os.chmod(temporary, 0o644)
            os.replace(temporary, path)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise


def write_file(path: str | os.PathLike[str], content: str | bytes) -> None:
    """Write what there is at once, as by `atomic_file`."""
    with atomic_file(path, "wb" if isinstance(content, bytes) else "w") as stream:
        stream.write(content)


@contextmanager
def atomic_folder(path: str | os.PathLike[str], replace: bool = False) -> Iterator[Path]:
    """Yield a temporary folder beside `path`; it replaces `path` if the block succeeds.

    It vanishes otherwise. A folder that holds anything is replaced only if `replace`; see
    `check_replaceable`.
    """
    path = Path(path)
    clean_leftovers(path)
    check_replaceable(path, replace)
    with naming(path), work_folder(path) as temporary:
        folder = temporary / "new"
        folder.mkdir()
        yield folder
        put_in_place(folder, path)


@contextmanager
def work_folder(path: Path) -> Iterator[Path]:
    """A folder beside `path`, gone after the block; what killed runs left there goes first."""
    clean_leftovers(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=_prefix(path, "new"), dir=path.parent))
    try:
        yield temporary
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Errors of the disk name `path`, not a temporary file or nothing at all."""
    try:
        yield
    except OSError as error:
        if error.errno and (error.filename is None or f".{path.name}." in str(error.filename)):
            error.filename = str(path)
        raise


def check_not_read(path: str | os.PathLike[str], *read: str | os.PathLike[str]) -> None:
    """Refuse to write over what is read, into a folder that is read, or over one that holds it, by
    a `ParameterError`.
    """
    real = _real(path)
    for other in read:
        there = _real(other)
        inside = real.is_relative_to(there) or there.is_relative_to(real)
        if inside and (real.exists() or Path(other).is_file()):
            raise ParameterError(
                f"{path}: is read here ({other}) and would be written over: give another name"
            )


def check_writable(path: str | os.PathLike[str]) -> None:
    """Refuse a file that cannot be written, by a `ParameterError` before the work is lost."""
    path = Path(path)
    above = next(each for each in path.absolute().parents if each.exists())
    _check_regular(path)
    if not above.is_dir() or not os.access(above, os.W_OK):
        found = "may not be written to" if above.is_dir() else "is no folder"
        raise ParameterError(f"{path}: cannot be written, {above} {found}: give another name")


def _check_regular(path: Path) -> None:
    _real(path)
    if path.exists() and not path.is_file():
        raise ParameterError(f"{path}: is a folder, a device or a pipe: give the name of a file")


def _real(path: str | os.PathLike[str]) -> Path:
    """Where links lead; raises `ParameterError` where they never end."""
    real = Path(os.path.realpath(path))
    if any(each.is_symlink() for each in (real, *real.parents)):
        raise ParameterError(f"{path}: its links lead round in a circle: give another name")
    return real


def check_replaceable(path: Path, replace: bool) -> None:
    """Refuse to write a folder over where one stands, a link, a file, or, unless `replace`, a
    folder that holds something, by a `TrextonError`.
    """
    if _real(path) in (Path.cwd(), *Path.cwd().parents):
        raise TrextonError(f"{path}: cannot replace the folder you stand in: name a new folder")
    if path.is_symlink():
        raise TrextonError(f"{path}: is a link: name the folder itself, or a new one")
    if path.exists() and not path.is_dir():
        raise TrextonError(f"{path}: is a file, not a folder: name a new folder, or remove it")
    if path.exists() and not replace and any(path.iterdir()):
        raise TrextonError(f"{path}: is there already: name a new folder, or say --replace")


def put_in_place(new: Path, path: Path) -> None:
    """Move the folder `new` to `path`; what is there is moved aside first, and then removed."""
    if path.exists():
        old = Path(tempfile.mkdtemp(prefix=_prefix(path, "old"), dir=path.parent))
        os.replace(path, old / "was")
        os.replace(new, path)
        shutil.rmtree(old)
    else:
        os.replace(new, path)


def clean_leftovers(path: Path) -> None:
    """Remove what a run that was killed left beside `path`; put back what it had moved aside."""
    for left in path.parent.glob(f".{glob.escape(path.name)}.*-*.*"):
        kind, _, process = left.name[len(path.name) + 2 :].partition(".")[0].partition("-")
        if kind not in ("new", "old") or not process.isdecimal() or _alive(int(process)):
            continue
        if kind == "old" and (left / "was").exists() and not path.exists():
            os.replace(left / "was", path)
        if left.is_dir():
            shutil.rmtree(left, ignore_errors=True)
        else:
            left.unlink(missing_ok=True)


def _prefix(path: Path, kind: str) -> str:
    """Names the process: what a killed one left is told from what another is writing."""
    return f".{path.name}.{kind}-{os.getpid()}."


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except OSError as error:
        return not isinstance(error, ProcessLookupError)  # another person's lives
    return True


def canonical_json(value: object) -> str:
    """JSON with sorted keys and full float precision: equal values give equal bytes."""
    return json.dumps(value, sort_keys=True, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def digest(*parts: object) -> str:
    """SHA-256 (hex) of arrays, bytes, files (as `Path`) and JSON values; type and shape count."""
    total = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            head = f"array {part.dtype.str} {part.shape}"
            body = np.ascontiguousarray(part).tobytes()
        elif isinstance(part, bytes):
            head, body = "bytes", part
        elif isinstance(part, Path):
            head, body = "file", part.read_bytes()
        else:
            head, body = "json", canonical_json(part).encode()
        total.update(f"{head} {len(body)}\n".encode())
        total.update(body)
    return total.hexdigest()


def read_bytes(path: Path, most: int, what: str, error: type[TrextonError]) -> bytes:
    """The bytes of a regular file.

    Parameters
    ----------
    most : int
        Bytes that it may have.
    what : str
        What was expected, for the sentence.
    error : type
        What is raised where there is no such file, or it is a device, a pipe or too large.
    """
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise error(f"{path}: not a regular file: expected {what}")
        if status.st_size > most:
            raise error(f"{path}: {status.st_size:,} bytes: expected at most {most:,}")
        return path.read_bytes()
    except OSError as reason:
        raise error(f"{path}: cannot be read ({reason.strerror}): check the path") from None


def read_text(path: Path) -> str:
    """The text of a regular file in UTF-8, or in UTF-16 as its byte-order mark says, without it;
    raises `FlightError` where there is none, or it is a device or a pipe, too large, or no text.
    """
    data = read_bytes(path, LARGEST, "a text file", FlightError)
    try:
        return data.decode("utf-16" if data[:2] in (BOM_UTF16_LE, BOM_UTF16_BE) else "utf-8-sig")
    except UnicodeDecodeError as error:
        raise FlightError(f"{path}: not a text file ({error}): write it as UTF-8") from None


def read_toml(path: Path) -> dict[str, Any]:
    """What is in a TOML file; raises `FlightError` where it cannot be read."""
    import tomllib

    text = read_text(path)
    try:
        if re.search(_LONG_KEY, text):
            raise ValueError("a key has more than 30 parts")
        repr(content := tomllib.loads(text))  # what cannot be said is refused here
    except (ValueError, RecursionError) as error:  # TOML's own, or a number of too many digits
        raise FlightError(f"{path}: not valid TOML ({error}): correct it") from None
    return content
