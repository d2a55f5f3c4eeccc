"""Has anything changed since a command was done? Names, sizes and times of files show it."""

import json
import os
import sysconfig
from collections.abc import Sequence
from pathlib import Path

from trexton.base.cache import cache_folder, repository_root
from trexton.base.files import digest, write_file
from trexton.base.plugins import PLUGINS

MADE = ("data/flights", "results", "book/_build")  # by a book, in its clone
_OF_TOOLS = {"distutils-precedence.pth", "a1_coverage.pth", "_virtualenv.pth"}


class Unchanged:
    """What a command found when it was last done, as long as it would find the same again.

    `asked` is what was asked for, as JSON; `read` and `made` are the files and folders that the
    command reads and leaves. The environment, and this package with what travels along, count too.
    """

    def __init__(self, note: Path, asked: object, read: Sequence[Path], made: Sequence[Path]):
        root = repository_root() or Path(__file__).parents[2]
        own = {name: value for name, value in os.environ.items() if name.startswith("TREXTON_")}
        installed = sorted(os.listdir(sysconfig.get_path("purelib")))  # names hold versions
        apart = [*(root / name for name in (*MADE, "data/cache", "tests")), cache_folder(), *made]
        self.note, self.made = note, made
        environment = [own, installed, sysconfig.get_config_var("py_version")]
        self.inputs = digest(_files((root, *read), apart), asked, environment)
        # A person's own code, which is edited in place, is not watched: any run may find another.
        places = {name for name in installed if name.endswith(".pth") and "trexton" not in name}
        self.watched = not (own.get(PLUGINS) or places - _OF_TOOLS)

    def last(self) -> list[str] | None:
        """The sentences that were remembered; None where anything may have changed since."""
        try:
            content = json.loads(self.note.read_text(encoding="utf-8"))
            same = content["inputs"] == self.inputs and content["made"] == digest(_files(self.made))
            return list(content["sentences"]) if same and self.watched else None
        except (OSError, ValueError, LookupError, TypeError):
            return None

    def remember(self, sentences: Sequence[str]) -> None:
        """Note what was found, of the inputs that there were before."""
        known = {"inputs": self.inputs, "made": digest(_files(self.made)), "sentences": sentences}
        write_file(self.note, json.dumps(known))


def _files(places: Sequence[Path], apart: Sequence[Path] = ()) -> list[tuple[str, int, int, int]]:
    """Path, size and times of files, and of those in folders, neither hidden nor `apart`."""
    kept, passed = list(places), {os.path.realpath(path) for path in apart}
    for place in places:
        for folder, names, files in os.walk(place, followlinks=True):
            names[:] = sorted(name for name in names if not name.startswith((".", "__pycache__")))
            if (real := os.path.realpath(folder)) in passed:  # or links would lead in a circle
                names.clear()
                continue
            passed.add(real)
            kept += [Path(real, name) for name in sorted(files) if not name.startswith(".")]
    seen = {path: path.stat() for path in kept if path.is_file()}  # a copy may keep its st_mtime
    return [(str(p), s.st_size, s.st_mtime_ns, s.st_ctime_ns) for p, s in seen.items()]
