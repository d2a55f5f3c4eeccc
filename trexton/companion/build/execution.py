"""Run one notebook in a folder of its own; its files are handed back, not written.

The same function serves a thread of this process and a worker of a cluster: what goes in and what
comes out is plain data.
"""

from __future__ import annotations

import json
import logging
import os
import re
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from subprocess import DEVNULL
from typing import Any

from trexton.companion.executor import PROCESSES, THREAD_VARIABLES
from trexton.vision.threads import usable_cores

__all__ = ["Done", "Job", "execute", "stop_all"]

_ANSI = re.compile(r"\x1b\[[0-9;]*m")
_kernels: set[Any] = set()  # of this process, so that they can be ended together


@dataclass(frozen=True)
class Job:
    """One notebook to run.

    Attributes
    ----------
    name, text, source : str
        Of the experiment; the MyST notebook; where it stands, for messages.
    parameters : dict
        What is set in it, `out` among it: the folder that the reader sees.
    subfolder : str
        Where below `out` the results belong: the flight's name.
    records : dict of str to bytes
        Files below `out` that the notebook may read.
    folder, work : str
        Working folder, from which relative paths of flights are seen; where the files lie that it
        makes.
    threads : int or None
        Threads that the numerical libraries may take; None: the machine is this notebook's, and
        what it spreads runs in as many processes as there are processors.
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

    def environment(self) -> dict[str, str]:
        """Of the kernel."""
        chosen = {
            "JUPYTER_PREFER_ENV_PATH": "1",
            "PYDEVD_DISABLE_FILE_VALIDATION": "1",
            PROCESSES: str(usable_cores() if self.threads is None else 1),
        }
        if self.threads is not None:
            chosen |= dict.fromkeys(THREAD_VARIABLES, str(self.threads))
        return {**os.environ, **chosen}


@dataclass(frozen=True)
class Done:
    """What a run left: files by name, or a sentence and the partial notebook."""

    files: dict[str, bytes] = field(default_factory=dict)
    error: str | None = None
    partial: bytes | None = None


def stop_all() -> None:
    """End every kernel of this process, in the middle of a cell if need be."""
    for manager in list(_kernels):
        process = getattr(manager.provisioner, "process", None)
        if process is not None and process.poll() is None:
            process.kill()


def execute(job: Job) -> Done:
    """Run one notebook."""
    with tempfile.TemporaryDirectory(prefix=".work.", dir=job.work) as name:
        out = Path(name).resolve() / "out"
        (out / job.subfolder).mkdir(parents=True)
        for path, content in job.records.items():
            (out / path).parent.mkdir(parents=True, exist_ok=True)
            (out / path).write_bytes(content)
        notebook, error = _papermill(job, Path(name), str(out))
        text = None if notebook is None else _cleaned(notebook, job.parameters, str(out)).encode()
        if error:
            return Done(error=error.replace(str(out), str(job.parameters["out"])), partial=text)
        files = {
            path.name: path.read_bytes()
            for path in sorted((out / job.subfolder).iterdir())
            if path.is_file() and re.match(rf"{re.escape(job.name)}[.-]", path.name)
        }
    if f"{job.name}.json" not in files:
        error = f"{job.source}: it left no {job.name}.json in its folder of results"
        return Done(error=error, partial=text)
    return Done(files | {f"{job.name}.ipynb": text or b""})


def _papermill(job: Job, folder: Path, out: str) -> tuple[Any, str | None]:
    """The notebook as far as it was executed, and a sentence where that failed."""
    import jupytext
    import nbformat
    import papermill
    from papermill.exceptions import PapermillExecutionError

    original, executed, error, given = folder / "given.ipynb", folder / "run.ipynb", None, -1
    try:
        notebook = jupytext.reads(job.text, fmt="md:myst")
        tags = [cell.metadata.get("tags", []) for cell in notebook.cells]
        given = next((at for at, each in enumerate(tags) if "parameters" in each), given)
        jupytext.write(notebook, original)
        _register_engine()
        logging.getLogger("papermill").setLevel(logging.ERROR)  # parameters need no default
        papermill.execute_notebook(
            original, executed, parameters={**job.parameters, "out": out}, engine_name="trexton",
            kernel_name="python3", progress_bar=False, job=job,
        )  # fmt: skip
    except PapermillExecutionError as fault:
        # Counted as in the source: papermill put a cell of its own in after number `given`.
        number = fault.cell_index + (fault.cell_index <= given)
        first = next((line for line in fault.source.splitlines() if line.strip()), "")
        message = _ANSI.sub("", fault.evalue).strip() or "no message"
        where = f"{job.source}, cell {number} ({first.strip()!r} ...)"
        error = f"{where}: {fault.ename}: {message}"
    except Exception as fault:  # a kernel that died, a notebook that cannot be read: others go on
        error = f"{job.source}: {type(fault).__name__}: {fault}"
    return nbformat.read(executed, as_version=4) if executed.exists() else None, error


def _register_engine() -> None:
    from papermill.clientwrap import PapermillNotebookClient
    from papermill.engines import Engine, papermill_engines

    class KernelEngine(Engine):  # type: ignore[misc]
        """Papermill's own engine, with an environment and an end."""

        @classmethod
        def execute_managed_notebook(
            cls, nb_man: Any, kernel_name: str, *, job: Job, **options: Any
        ) -> None:
            client = PapermillNotebookClient(nb_man, kernel_name=kernel_name)
            manager = client.create_kernel_manager()
            _kernels.add(manager)
            try:
                client.execute(env=job.environment(), cwd=job.folder, stderr=DEVNULL)
            finally:
                _kernels.discard(manager)

    papermill_engines.register("trexton", KernelEngine)


def _cleaned(notebook: Any, parameters: Mapping[str, Any], work: str) -> str:
    """The executed notebook without what depends on this machine or its clock.

    The injected parameters are shown or hidden like the defaults that they replace, and name the
    folder that a reader asked for instead of the one that was worked in.
    """
    import nbformat
    from papermill.translators import PythonTranslator

    notebook.metadata.pop("papermill", None)
    notebook.metadata.get("jupytext", {}).pop("text_representation", None)
    notebook.metadata["trexton"] = {"parameters": dict(parameters)}
    tags: list[str] = []
    for number, cell in enumerate(notebook.cells):
        cell["id"] = f"cell-{number}"  # else drawn anew at each run
        cell.metadata.pop("execution", None)
        own = cell.metadata.get("tags", [])
        if "parameters" in own:
            tags = [tag for tag in own if tag != "parameters"]
        elif "injected-parameters" in own:
            cell.metadata["tags"] = ["injected-parameters", *tags]
    text, shown = str(nbformat.writes(notebook)), str(parameters["out"])
    for written in (str, PythonTranslator.translate):  # by a cell, and by papermill into one
        old, new = (json.dumps(written(each), ensure_ascii=False)[1:-1] for each in (work, shown))
        text = text.replace(old, new)
    return text + "\n"
