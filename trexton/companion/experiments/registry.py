"""The experiments: one module each, declared once, and one line here.

A module ``trexton/companion/experiments/<name>.py`` declares what can be chosen and what is done::

    @dataclass(frozen=True)
    class Parameters(MapParameters):  # or SeedParameters, FilterParameters: what it needs
        trials: int = option(100, "independent trials of the filter", low=1)

    def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
        ...
        return parameters.record(train, test, values={"error_cm": error})

and the line here says what the engine must know: a title, what the flights must have, what it waits
for. Defaults, types and ranges stand in `Parameters` alone: the command line, the notebook, the
checks and the record take them from there. Frames are flown by
`trexton.companion.experiments.track.fly`; independent repeats and trials go through
`trexton.base.executor.spread`. The notebook ``notebooks/<name>.md`` begins with::

    given = notebook.given(name.Parameters, globals())
    record = name.run(given.train, given.test, given.parameters)
    page = notebook.Page(record, given)

An experiment that has written no notebook gets one from its module: the docstring as prose, the
pictures of ``FIGURES`` (name to a function of the record, its docstring the description) and, with
``claims=True`` here, its own ``CLAIMS``. So one file and one line are enough.

This registry only says what there is; nothing in it changes a result.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from types import ModuleType
from typing import NamedTuple, cast

from trexton.base.options import Options
from trexton.flights.flight import Flight

__all__ = ["EXPERIMENTS", "LEDGER", "NEEDS", "Experiment", "Need"]

LEDGER = "claims"


@dataclass(frozen=True)
class Experiment:
    """What the workflow must know of an experiment.

    Attributes
    ----------
    title : str
    needs : tuple of str
        What both flights must have: keys of `NEEDS`.
    after : tuple of str
        Experiments that run before it on the same flight, because it reads what they leave.
    cost_s : float
        About how long it takes; the longest start first.
    alone : bool
        It measures time: nothing runs beside it.
    every_flight : bool
        It runs once, after all flights, over all their records, and has no parameters.
    module : str
        Where `Parameters` and `run` are, if not in
        ``trexton.companion.experiments.registry.<name>``.
    claims : bool
        The module has ``CLAIMS``: tables as in ``data/paper/claims.toml``, of the experiment's own.
    """

    title: str
    needs: tuple[str, ...] = ()
    after: tuple[str, ...] = ()
    cost_s: float = 20.0
    alone: bool = False
    every_flight: bool = False
    module: str = ""
    claims: bool = False

    def load(self, name: str) -> ModuleType:
        """The module of the experiment `name`."""
        return import_module(self.module or f"trexton.companion.experiments.{name}")

    def parameters(self, name: str) -> type[Options]:
        """The class that declares the parameters of the experiment `name`."""
        if self.every_flight:
            return Options
        return cast(type[Options], self.load(name).Parameters)


class Need(NamedTuple):
    """What a flight may have: how to see it, what it is, the reason for a skip without it."""

    has: Callable[[Flight], bool]
    words: str
    lacking: str


NEEDS = {
    "images": Need(lambda flight: flight.has_images, "camera images", "has no images"),
    "positions": Need(
        lambda flight: flight.has_positions, "a position for every frame",
        "lacks positions in some frames",
    ),
    "floor": Need(
        lambda flight: flight.floor_file is not None, "a picture of the true floor",
        "has no picture of its true floor",
    ),
    "camera": Need(
        lambda flight: flight.camera is not None, "a calibrated camera", "has no calibrated camera"
    ),
}  # fmt: skip

_IMAGES = ("positions", "images")
_SURVEYED = ("positions", "images", "floor", "camera")

EXPERIMENTS: dict[str, Experiment] = {
    # The paper's, in its order, and what it leaves open.
    "overview": Experiment("The pipeline in one picture", needs=_IMAGES, cost_s=8),
    "texton_dictionary": Experiment("The texton dictionary", needs=_IMAGES, cost_s=12),
    "mosaic": Experiment("The map, stitched from the flight", needs=_IMAGES, cost_s=115),
    "homography_baseline": Experiment(
        "Baseline: homography", needs=_IMAGES, after=("mosaic", "mocap_training"), cost_s=130
    ),
    "mocap_training": Experiment(
        "Training on motion-capture positions", needs=("positions",), cost_s=40
    ),
    "homography_training": Experiment(
        "Training on homography positions",
        needs=_IMAGES,
        after=("mosaic", "homography_baseline", "mocap_training"),
        cost_s=115,
    ),
    "triggered_landing": Experiment("Triggered landing", needs=_SURVEYED, cost_s=90),
    "trade_off": Experiment("Speed against accuracy", needs=("positions",), cost_s=90, alone=True),
    "timing": Experiment("Time for one frame", needs=("positions",), alone=True, cost_s=17),
    "speed": Experiment("As fast as the machine allows", needs=_IMAGES, alone=True, cost_s=65),
    "map_loss": Experiment(
        "Which floors are suitable: the map loss", needs=("positions",), cost_s=20
    ),
    "kidnapping": Experiment("Carried away and found again", needs=("positions",), cost_s=65),
    "choices": Experiment(
        "What the open choices cost", needs=("positions",), after=("mocap_training",), cost_s=40
    ),
    # Beyond the paper.
    "beyond": Experiment(
        "Beyond the paper: a field instead of neighbours", needs=("positions",), cost_s=30
    ),
    "calibration": Experiment(
        "What the uncertainty is worth", needs=("positions",), after=("mocap_training",), cost_s=17
    ),
    "fused": Experiment(
        "Can the autopilot believe it?",
        needs=("positions",),
        after=("mocap_training",),
        cost_s=20,
    ),
    "fine": Experiment(
        "Coarse to fine: the image says where exactly",
        needs=_SURVEYED,
        after=("mosaic",),
        cost_s=47,
    ),
    "touchdown": Experiment("Landing that lands", needs=_SURVEYED, cost_s=60),
    "heading": Experiment("Any heading", needs=_IMAGES, cost_s=15),
    "light": Experiment("Other light", needs=_SURVEYED, cost_s=16),
    "aiding": Experiment("What the autopilot knows", needs=_SURVEYED, cost_s=40),
    "density": Experiment("How densely to survey", needs=_SURVEYED, cost_s=30),
    "suitability": Experiment("Which floors, from their pictures", needs=_SURVEYED, cost_s=36),
    "assessment": Experiment("Will it work here?", cost_s=14),
    LEDGER: Experiment("The ledger", every_flight=True),
}
