"""Has anything changed since a command was done? Names, sizes and times of files tell, unread."""

import json
import os
import sys
import sysconfig
from collections.abc import Collection, Sequence
from pathlib import Path

from trexton.base.cache import cache_folder, repository_root
from trexton.base.files import digest, write_file

_NOT_READ = ("results", "data/flights", "data/cache", "book/_build", "tests")  # of a clone


class Unchanged:
    """What a command found when it was last done, as long as it would find the same again.

    `asked` is what was asked for, as JSON; `read` and `made` are the files and folders that the
    command reads and leaves. The environment, and this package with what travels along, count too.
    """

    def __init__(self, note: Path, asked: object, read: Sequence[Path], made: Sequence[Path]):
        root = repository_root() or Path(__file__).parents[2]
        own = {name: value for name, value in os.environ.items() if name.startswith("TREXTON_")}
        installed = sorted(os.listdir(sysconfig.get_path("purelib")))  # names hold the versions
        apart = [*(root / name for name in _NOT_READ), cache_folder(), *made]
        files = [_files(path, apart) for path in (root, *read)]
        self.note, self.made = note, made
        self.inputs = digest(files, asked, own, installed, sys.version)

    def last(self) -> list[str] | None:
        """The sentences that were remembered; None where anything has changed since."""
        try:
            content = json.loads(self.note.read_text(encoding="utf-8"))
            same = content["inputs"] == self.inputs and content["made"] == self._left()
            return list(content["sentences"]) if same else None
        except (OSError, ValueError, LookupError, TypeError):
            return None

    def remember(self, sentences: Sequence[str]) -> None:
        """Note what was found, of the inputs that there were before."""
        content = {"inputs": self.inputs, "made": self._left(), "sentences": sentences}
        write_file(self.note, json.dumps(content))

    def _left(self) -> str:
        return digest([_files(path) for path in self.made])


def _files(root: Path, apart: Collection[Path] = ()) -> list[tuple[str, int, int]]:
    """Path, size and time of a file, or of each in a folder that is neither hidden nor `apart`."""
    kept, left_out = [root], {os.path.realpath(path) for path in apart}
    for folder, names, files in os.walk(os.path.realpath(root)):
        names[:] = sorted(n for n in names if os.path.join(folder, n) not in left_out)
        for each in (names, files):
            each[:] = [name for name in each if not name.startswith((".", "__pycache__"))]
        kept += [Path(folder, name) for name in sorted(files)]
    seen = {path: path.stat() for path in kept if path.is_file()}
    return [(str(path), about.st_size, about.st_mtime_ns) for path, about in seen.items()]
