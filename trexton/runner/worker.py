"""The process that runs notebooks: one job a line on stdin, progress and results as lines on stdout.

It ends when stdin closes, in the middle of a notebook too: whoever kills the runner leaves no kernel behind.
"""

from __future__ import annotations

import json
import os
import queue
import re
import signal
import sys
import threading
import time
from pathlib import Path

__all__ = ["execute", "serve"]

_ANSI = re.compile(r"\x1b\[[0-9;]*m")


def execute(job: dict, report) -> dict:
    """Run one notebook with papermill; returns ``{"error": sentence or None, "seconds": float}``.

    `job` names `notebook`, `output`, `failed` (where partial output is kept) and `parameters`;
    ``report(done, total)`` is called before each cell.
    """
    import jupytext
    import papermill
    from papermill.exceptions import PapermillExecutionError

    from trexton.files import atomic_file

    source, output, failed = Path(job["notebook"]), Path(job["output"]), Path(job["failed"])
    started, partial = time.monotonic(), output.with_name(f".{output.stem}.partial.ipynb")
    original = output.with_name(f".{output.stem}.original.ipynb")
    output.parent.mkdir(parents=True, exist_ok=True)
    error = f"{source}: interrupted"
    try:
        jupytext.write(jupytext.read(source), original)
        _register_engine(report)
        papermill.execute_notebook(
            original,
            partial,
            parameters=job["parameters"],
            engine_name="trexton",
            kernel_name="python3",
            progress_bar=False,
        )
        error = None
    except PapermillExecutionError as fault:
        error = describe(source, fault)
    except (
        Exception
    ) as fault:  # a kernel that died, a notebook that cannot be read: the others go on
        error = f"{source}: {type(fault).__name__}: {fault}"
    finally:
        if partial.exists():
            text = cleaned(partial, job["parameters"])
            with atomic_file(failed if error else output) as stream:
                stream.write(text)
        for leftover in (partial, original):
            leftover.unlink(missing_ok=True)
    return {"error": error, "seconds": time.monotonic() - started}


def describe(source: Path, fault) -> str:
    """One sentence on a failing cell: which, where, and what it said."""
    first = next((line for line in fault.source.splitlines() if line.strip()), "")
    message = _ANSI.sub("", fault.evalue).strip() or "no message"
    return (
        f"{source}, cell {fault.cell_index + 1} ({first.strip()!r} ...): {fault.ename}: {message}"
    )


def cleaned(path: Path, parameters: dict) -> str:
    """The executed notebook without what depends on this machine or its clock.

    The injected parameters are shown or hidden like the defaults that they replace.
    """
    import nbformat

    notebook = nbformat.read(path, as_version=4)
    tags = next(
        (
            cell.metadata.tags
            for cell in notebook.cells
            if "parameters" in cell.metadata.get("tags", [])
        ),
        [],
    )
    for cell in notebook.cells:
        cell.metadata.pop("papermill", None)
        cell.metadata.pop("execution", None)
        if "injected-parameters" in cell.metadata.get("tags", []):
            cell.metadata["tags"] = [
                "injected-parameters",
                *(tag for tag in tags if tag != "parameters"),
            ]
    notebook.metadata.pop("papermill", None)
    notebook.metadata["trexton"] = {"parameters": parameters}
    return nbformat.writes(notebook) + "\n"


def _register_engine(report) -> None:
    from papermill.engines import NBClientEngine, papermill_engines

    class Engine(NBClientEngine):
        """Papermill's own engine, with a word before each cell."""

        @classmethod
        def execute_managed_notebook(cls, manager, kernel_name, **options):
            start = manager.cell_start

            def cell_start(cell, cell_index=None, **others):
                report(cell_index, len(manager.nb.cells))
                return start(cell, cell_index, **others)

            manager.cell_start = cell_start
            return super().execute_managed_notebook(manager, kernel_name, **options)

    papermill_engines.register("trexton", Engine)


def serve() -> None:
    """Read jobs until stdin closes."""
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # whatever a library prints must not be taken for an answer
    jobs: queue.Queue = queue.Queue()
    busy = threading.Event()

    def read() -> None:
        for line in sys.stdin:
            jobs.put(json.loads(line))
        jobs.put(None)
        if busy.is_set():
            os.kill(os.getpid(), signal.SIGTERM)  # leaves the notebook, which shuts its kernel down
            threading.Event().wait(5)
            os._exit(1)

    threading.Thread(target=read, daemon=True).start()
    while (job := jobs.get()) is not None:
        busy.set()
        result = execute(
            job, lambda done, total: print(json.dumps({"done": done, "total": total}), file=answers)
        )
        busy.clear()
        print(json.dumps(result), file=answers)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the runner, which closes stdin
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    serve()
