"""The notebook of an experiment that has written none: made from its module."""

from __future__ import annotations

import inspect
from types import ModuleType

from trexton.companion.experiments.registry import Experiment

__all__ = ["made_notebook"]

_HEAD = """---
jupytext:
  text_representation:
    extension: .md
    format_name: myst
kernelspec:
  display_name: Python 3
  language: python
  name: python3
---

# {title}

```{{code-cell}} ipython3
:tags: [parameters, remove-cell]

flight = "data/flights/sim-survey"
test_flight = "data/flights/sim-waypoints"  # None: the test split of the flight itself
out = "results-by-hand"
```

```{{code-cell}} ipython3
:tags: [remove-input]

import {module} as experiment
from trexton.companion.build import notebook

given = notebook.given(experiment.Parameters, globals())
record = experiment.run(given.train, given.test, given.parameters)
page = notebook.Page(record, given)
{first}
```

{prose}
"""
_CELL = """
```{{code-cell}} ipython3
:tags: [remove-input]

{code}
```
"""
_FIGURE = """
```{{code-cell}} ipython3
---
mystnb:
  image:
    alt: "{alt}"
tags: [remove-input]
---
page.show("{name}", experiment.FIGURES["{name}"](record))
```
"""


def made_notebook(name: str, experiment: Experiment) -> str:
    """MyST text from the module's docstring, ``FIGURES`` and ``CLAIMS``; empty without them.

    ``FIGURES`` maps a name to a function of the record, whose docstring describes the picture.
    """
    if experiment.every_flight:
        return ""
    module = experiment.load(name)
    if not hasattr(module, "FIGURES"):
        return ""
    shown = ["page.finding()"] if hasattr(module, "finding") else []
    shown += ["page.claims()"] if experiment.claims else []
    text = _HEAD.format(
        title=experiment.title,
        module=module.__name__,
        first=shown[0] if shown else "",
        prose=_prose(module),
    )
    for code in shown[1:]:
        text += _CELL.format(code=code)
    for figure, draw in module.FIGURES.items():
        alt = " ".join((inspect.getdoc(draw) or figure).split("\n\n")[0].split()).replace('"', "'")
        text += _FIGURE.format(name=figure, alt=alt)
    return text + "\n## Run it again\n" + _CELL.format(code="page.footer()")


def _prose(module: ModuleType) -> str:
    return inspect.getdoc(module) or ""
