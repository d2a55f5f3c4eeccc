"""Run one notebook with papermill in a folder of its own; its files are handed back, not written.

The same function serves a thread of this process and a worker of a cluster: what goes in and what
comes out is plain data.
"""

from __future__ import annotations

import json
import os
import re
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from subprocess import DEVNULL
from typing import Any

from trexton.companion.executor import CLUSTER, PROCESSES, THREAD_VARIABLES
from trexton.vision.threads import usable_cores

__all__ = ["Done", "Job", "describe", "execute", "stop_all"]

_ANSI = re.compile(r"\x1b\[[0-9;]*m")


@dataclass(frozen=True)
class Job:
    """One notebook to run.

    Attributes
    ----------
    name, text, source : str
        Of the experiment; the MyST notebook; where it stands, for messages.
    parameters : dict
        What papermill sets, `out` among it: the folder that the reader sees.
    subfolder : str
        Where below `out` the results belong: the flight's name.
    records : dict of str to bytes
        Files below `out` that the notebook may read.
    folder : str
        Working folder; relative paths of flights are seen from there.
    threads : int or None
        Threads that the numerical libraries may take; None: the machine is this notebook's, and
        what it spreads runs in as many processes as there are processors.
    cluster : str
        Address for what the notebook spreads; empty: in place.
    """

    name: str
    text: str
    source: str
    parameters: Mapping[str, Any]
    subfolder: str
    records: Mapping[str, bytes]
    folder: str
    work: str
    threads: int | None = None
    cluster: str = ""

    def environment(self) -> dict[str, str]:
        """Of the kernel."""
        chosen = {
            "JUPYTER_PREFER_ENV_PATH": "1",
            "PYDEVD_DISABLE_FILE_VALIDATION": "1",
            CLUSTER: self.cluster,
            PROCESSES: str(usable_cores() if self.threads is None else 1),
        }
        if self.threads is not None:
            chosen |= dict.fromkeys(THREAD_VARIABLES, str(self.threads))
        return dict(os.environ) | chosen


@dataclass(frozen=True)
class Done:
    """What a run left: files by name, or a sentence and the partial notebook."""

    files: dict[str, bytes] = field(default_factory=dict)
    error: str | None = None
    partial: bytes | None = None
    seconds: float = 0.0


class _Running:
    """The kernels of this process, so that they can be ended together."""

    def __init__(self) -> None:
        self._kernels: set[Any] = set()
        self._lock = threading.Lock()

    def add(self, manager: Any) -> None:
        with self._lock:
            self._kernels.add(manager)

    def discard(self, manager: Any) -> None:
        with self._lock:
            self._kernels.discard(manager)

    def stop(self) -> None:
        with self._lock:
            managers = list(self._kernels)
        for manager in managers:
            process = getattr(manager.provisioner, "process", None)
            if process is not None and process.poll() is None:
                process.kill()


_running = _Running()


def stop_all() -> None:
    """End every kernel of this process, in the middle of a cell if need be."""
    _running.stop()


def execute(job: Job, report: Callable[[int, int], None] = lambda done, total: None) -> Done:
    """Run one notebook; ``report(done, total)`` is called before each cell."""
    from trexton.base.files import atomic_file

    # A worker may see the results as another user, or not at all: nothing of its own goes there.
    work = job.work if os.access(job.work, os.W_OK) else None
    started = time.monotonic()
    with tempfile.TemporaryDirectory(prefix=".work.", dir=work) as name:
        out = Path(name).resolve() / "out"
        (out / job.subfolder).mkdir(parents=True)
        for path, content in job.records.items():
            with atomic_file(out / path, "wb") as stream:
                stream.write(content)
        partial = Path(name) / "partial.ipynb"
        error = _papermill(job, out, partial, report)
        text = cleaned(partial, job.parameters, str(out)).encode() if partial.exists() else None
        seconds = time.monotonic() - started
        if error:
            error = error.replace(str(out), str(job.parameters["out"]))
            return Done(error=error, partial=text, seconds=seconds)
        files = {
            path.name: path.read_bytes()
            for path in sorted((out / job.subfolder).iterdir())
            if path.is_file() and re.match(rf"{re.escape(job.name)}[.-]", path.name)
        }
    if f"{job.name}.json" not in files:
        error = f"{job.source}: it left no {job.name}.json in its folder of results"
        return Done(error=error, partial=text, seconds=seconds)
    return Done(files | {f"{job.name}.ipynb": text or b""}, seconds=seconds)


def _papermill(
    job: Job, out: Path, partial: Path, report: Callable[[int, int], None]
) -> str | None:
    """Execute into `partial`; a sentence where that failed."""
    from trexton.companion.build.formats import jupytext  # first: see there

    import papermill  # isort: skip
    from papermill.exceptions import PapermillExecutionError

    original, given = partial.with_name("original.ipynb"), -1
    try:
        notebook = jupytext.reads(job.text, fmt="md:myst")
        tags = [cell.metadata.get("tags", []) for cell in notebook.cells]
        given = next((at for at, each in enumerate(tags) if "parameters" in each), given)
        jupytext.write(notebook, original)
        _register_engine()
        papermill.execute_notebook(
            original, partial, parameters={**job.parameters, "out": str(out)},
            engine_name="trexton", kernel_name="python3", progress_bar=False,
            report=report, environment=job.environment(), folder=job.folder,
        )  # fmt: skip
    except PapermillExecutionError as fault:
        return describe(job.source, fault, given)
    except Exception as fault:  # a kernel that died, a notebook that cannot be read: others go on
        return f"{job.source}: {type(fault).__name__}: {fault}"
    return None


def describe(source: str, fault: Any, given: int) -> str:
    """One sentence on a failing cell: which, where, and what it said.

    Counted as in the source: papermill put a cell of its own after number `given` (-1: first).
    """
    number = fault.cell_index + (fault.cell_index <= given)
    first = next((line for line in fault.source.splitlines() if line.strip()), "")
    message = _ANSI.sub("", fault.evalue).strip() or "no message"
    return f"{source}, cell {number} ({first.strip()!r} ...): {fault.ename}: {message}"


def cleaned(path: Path, parameters: Mapping[str, Any], work: str) -> str:
    """The executed notebook without what depends on this machine or its clock.

    The injected parameters are shown or hidden like the defaults that they replace, and name the
    folder that a reader asked for instead of the one that was worked in.
    """
    from trexton.companion.build.formats import nbformat

    from papermill.translators import PythonTranslator  # isort: skip

    text, shown = path.read_text("utf-8"), str(parameters["out"])
    for written in (str, PythonTranslator.translate):  # by a cell, and by papermill into one
        old, new = (json.dumps(written(each), ensure_ascii=False)[1:-1] for each in (work, shown))
        text = text.replace(old, new)
    notebook = nbformat.reads(text, as_version=4)
    tags: list[str] = next(
        (
            cell.metadata.tags
            for cell in notebook.cells
            if "parameters" in cell.metadata.get("tags", [])
        ),
        [],
    )
    for number, cell in enumerate(notebook.cells):
        cell["id"] = f"cell-{number}"  # else drawn anew at each run
        cell.metadata.pop("papermill", None)
        cell.metadata.pop("execution", None)
        if "injected-parameters" in cell.metadata.get("tags", []):
            cell.metadata["tags"] = [
                "injected-parameters",
                *(tag for tag in tags if tag != "parameters"),
            ]
    notebook.metadata.pop("papermill", None)
    notebook.metadata["trexton"] = {"parameters": dict(parameters)}
    return str(nbformat.writes(notebook)) + "\n"


def _register_engine() -> None:
    from papermill.clientwrap import PapermillNotebookClient
    from papermill.engines import Engine, papermill_engines
    from papermill.log import logger

    class KernelEngine(Engine):  # type: ignore[misc]
        """Papermill's own engine, with an environment, a word before each cell, and an end."""

        @classmethod
        def execute_managed_notebook(
            cls, nb_man: Any, kernel_name: str, *, report: Callable[[int, int], None],
            environment: dict[str, str], folder: str, **options: Any,
        ) -> Any:  # fmt: skip
            start = nb_man.cell_start

            def cell_start(cell: Any, cell_index: int | None = None, **others: Any) -> Any:
                report(cell_index or 0, len(nb_man.nb.cells))
                return start(cell, cell_index, **others)

            nb_man.cell_start = cell_start
            client = PapermillNotebookClient(nb_man, kernel_name=kernel_name, log=logger)
            manager = client.create_kernel_manager()
            _running.add(manager)
            try:
                return client.execute(env=environment, cwd=folder, stderr=DEVNULL)
            finally:
                _running.discard(manager)

    logger.disabled = True  # it warns of parameters that a notebook leaves at their defaults
    papermill_engines.register("trexton", KernelEngine)
