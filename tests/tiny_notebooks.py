"""Notebooks small enough for tests of the workflow."""

from __future__ import annotations

from pathlib import Path

import jupytext

HEAD = """---
jupytext:
  text_representation:
    extension: .md
    format_name: myst
kernelspec:
  display_name: Python 3
  language: python
  name: python3
---

# A tiny experiment

```{code-cell} ipython3
:tags: [parameters, remove-cell]

%s
```

```{code-cell} ipython3
%s
```
"""

PARAMETERS = """flight = ""
test_flight = None
out = "results"
factor, rate, label = 2, 0.5, "a"
"""

# Counts its runs in a file beside the notebook, so that a test can tell reuse from repetition.
BODY = """import json
from pathlib import Path
from trexton.flights.folder import read_flight

data = read_flight(flight)
folder = Path(out) / data.name
folder.mkdir(parents=True, exist_ok=True)
record = {"values": {"frames": factor * len(data), "label": label}, "timings": {}}
(folder / "NAME.json").write_text(json.dumps(record))
(folder / "NAME-chart.svg").write_text("<svg/>")
with open("HERE/NAME.runs", "a") as runs:
    runs.write("x")
"""

FAILING = "fresh = 1 / 0  # the fault\n"


def write_notebook(folder: Path, name: str, body: str = BODY, parameters: str = PARAMETERS) -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / f"{name}.md"
    path.write_text(HEAD % (parameters, body.replace("NAME", name).replace("HERE", str(folder))))
    return path


def run_here(source, parameters, work, threads):
    """What `execution.execute` does, the cells run in this process."""
    cells = [
        cell.source
        for cell in jupytext.reads(source.text, "md:myst").cells
        if cell.cell_type == "code"
    ]
    names = {}
    try:
        exec(cells[0], names)
        names |= {**parameters, "out": str(work)}
        exec("\n".join(cells[1:]), names)
    except Exception as error:
        return "partial", repr(error)
    return "executed", None
