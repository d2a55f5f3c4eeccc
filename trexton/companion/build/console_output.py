"""Commands of a page, run as they are printed while the book is made, and shown with what they
say.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from trexton.base.errors import DataError
from trexton.base.files import atomic_file, canonical_json, digest
from trexton.base.progress import say
from trexton.base.records import software_versions
from trexton.companion.build.notebooks import read_content
from trexton.flights import Flight
from trexton.flights.exporters import export
from trexton.flights.frames import ImageFiles

__all__ = ["lay_recording", "with_output"]

_PACKAGE = Path(__file__).resolve().parent.parent.parent
_BLOCK = re.compile(r"^```bash\n(.*?)^```\n", re.M | re.S)
_PROGRAM = "import sys; from trexton.cli.main import main; sys.exit(main())"


def with_output(text: str, flight: Flight, kept: Path) -> str:
    """The page with what each of its shell blocks says below it, of blocks that say something.

    They run one after the other in an empty folder that holds ``my-recording``, a part of `flight`.

    Parameters
    ----------
    text : str
        Shell blocks hold lines that begin with ``trexton``.
    kept : Path
        File of what they said; believed as long as commands, flight and code are the same.

    Raises
    ------
    DataError
        A command failed.
    """
    blocks: list[str] = _BLOCK.findall(text)
    code = digest(*sorted(_PACKAGE.rglob("*.py")))  # a command may reach any of it
    key = digest(blocks, flight.data_hash, code, software_versions())
    before = read_content(kept) or {}
    said = before["said"] if before.get("key") == key else None
    if said is None:
        say("running the commands of a page")
        with TemporaryDirectory() as folder:
            lay_recording(flight, Path(folder) / "my-recording")
            said = [_run(block, Path(folder)) for block in blocks]
        with atomic_file(kept) as stream:
            stream.write(canonical_json({"key": key, "said": said}))
    each = iter(said)

    def shown(match: re.Match[str]) -> str:
        output = next(each)
        return match[0] + (f"\n```text\n{output}```\n" if output else "")

    return _BLOCK.sub(shown, text)


def _run(block: str, folder: Path) -> str:
    said = ""
    environment = os.environ | {"TREXTON_CACHE": str(folder / ".cache")}
    for line in block.replace("\\\n", " ").splitlines():
        program, *words = shlex.split(line)
        if program != "trexton":
            raise DataError(f"{line!r} in a page: expected a line that begins with trexton")
        done = subprocess.run(
            [sys.executable, "-c", _PROGRAM, *words], cwd=folder, env=environment, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
        )  # fmt: skip
        if done.returncode:
            raise DataError(f"{line!r} in a page ended with {done.returncode}:\n{done.stdout}")
        said += done.stdout
    return said


def lay_recording(flight: Flight, folder: Path, every: int = 3) -> None:
    """A recording as a person has it: images, and the list and the trajectory of the TUM data sets.

    Raises
    ------
    DataError
        The flight has no image files.
    """
    some = flight.select(slice(None, None, every))
    if not isinstance(some.frames, ImageFiles):
        raise DataError(f"{flight.name} has no image files: choose another flight for the page")
    (folder / "rgb").mkdir(parents=True)
    for file in some.frames.files:
        shutil.copyfile(file, folder / "rgb" / file.name)
    images = zip(some.time, some.frames.files, strict=True)
    lines = [f"{time:.9f} rgb/{file.name}\n" for time, file in images]
    (folder / "rgb.txt").write_text("".join(lines), encoding="utf-8")
    export(replace(some, height=None, attitude=None), "tum", folder / "groundtruth.txt")
