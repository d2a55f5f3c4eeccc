"""Run one notebook by papermill, in a kernel of its own.

Offers `execute`, and `stop_all`, which ends all kernels of this process.
"""

import json
import logging
import os
import re
from collections.abc import Mapping
from pathlib import Path
from subprocess import DEVNULL
from typing import Any

from trexton.companion.build.notebooks import Notebook
from trexton.companion.executor import PROCESSES, THREAD_VARIABLES
from trexton.vision.threads import usable_cores

_ANSI = re.compile(r"\x1b\[[0-9;]*m")
_kernels: set[Any] = set()  # of this process, so that they can be ended together


def stop_all() -> None:
    """End every kernel of this process, in the middle of a cell if need be."""
    for manager in list(_kernels):
        process = getattr(manager.provisioner, "process", None)
        if process is not None and process.poll() is None:
            process.kill()


def execute(
    source: Notebook, parameters: Mapping[str, Any], work: Path, threads: int | None
) -> tuple[str | None, str | None]:
    """The notebook as far as it was executed, and a sentence where that failed.

    Parameters
    ----------
    parameters : mapping
        What is set in it, `out` among it: the folder that the reader sees.
    work : path
        The folder that it writes to instead; the notebook itself is written beside it.
    threads : int or None
        Threads that the numerical libraries may take; None: the machine is this notebook's, and
        what it spreads runs in as many processes of one thread as there are processors.
    """
    import jupytext
    import nbformat
    import papermill
    from papermill.exceptions import PapermillExecutionError

    original, executed = work.with_name("given.ipynb"), work.with_name("run.ipynb")
    error, given = None, -1
    try:
        notebook = jupytext.reads(source.text, fmt="md:myst")
        tags = [cell.metadata.get("tags", []) for cell in notebook.cells]
        given = next((at for at, each in enumerate(tags) if "parameters" in each), given)
        jupytext.write(notebook, original)
        _register_engine()
        logging.getLogger("papermill").setLevel(logging.ERROR)  # parameters need no default
        papermill.execute_notebook(
            original,
            executed,
            parameters={**parameters, "out": str(work)},
            engine_name="trexton",
            kernel_name="python3",
            progress_bar=False,
            environment=_environment(threads),
            connection=str(work.with_name("kernel.json")),
        )
    except PapermillExecutionError as fault:
        # Counted as in the source: papermill put a cell of its own in after number `given`.
        number = fault.cell_index + (fault.cell_index <= given)
        first = next((line for line in fault.source.splitlines() if line.strip()), "")
        message = _ANSI.sub("", fault.evalue).strip() or "no message"
        where = f"{source.source}, cell {number} ({first.strip()!r} ...)"
        error = f"{where}: {fault.ename}: {message}".replace(str(work), str(parameters["out"]))
    except Exception as fault:  # a kernel that died, a notebook that cannot be read: others go on
        error = f"{source.source}: {type(fault).__name__}: {fault}"
    if not executed.exists():
        return None, error
    return _cleaned(nbformat.read(executed, as_version=4), parameters, str(work)), error


def _environment(threads: int | None) -> dict[str, str]:
    """Of a kernel. One that is alone shares its work among processes: their threads would wait for
    each other.
    """
    own = {"JUPYTER_PREFER_ENV_PATH": "1", "PYDEVD_DISABLE_FILE_VALIDATION": "1"}
    own |= {PROCESSES: str(usable_cores() if threads is None else 1)}
    return {**os.environ, **own, **dict.fromkeys(THREAD_VARIABLES, str(threads or 1))}


def _register_engine() -> None:
    from papermill.clientwrap import PapermillNotebookClient
    from papermill.engines import Engine, papermill_engines

    class KernelEngine(Engine):  # type: ignore[misc]
        """Papermill's own engine, with an environment and an end."""

        @classmethod
        def execute_managed_notebook(
            cls, nb_man: Any, kernel_name: str, *, environment: dict[str, str], **options: Any
        ) -> None:
            client = PapermillNotebookClient(nb_man, kernel_name=kernel_name)
            manager = client.create_kernel_manager()
            manager.connection_file = options["connection"]  # else in TMPDIR, and left there
            _kernels.add(manager)
            try:
                client.execute(env=environment, stderr=DEVNULL)
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
        for times in ("execution", "papermill"):
            cell.metadata.pop(times, None)
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
