"""The experiments by name, in the order of their pages; each is a module that declares itself.

A module ``trexton/companion/experiments/<name>.py`` holds all of an experiment but its prose::

    @dataclass(frozen=True)
    class Parameters(MapParameters):  # or SeedParameters, FilterParameters: what it needs
        trials: int = option(100, "independent trials of the filter", low=1)


    def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
        ...
        return parameters.record(train, test, values={"error_cm": error})


    def finding(record: Record) -> str:  # the sentence at the top of its page
        return f"The filter has an error of {interval(record.values['error_cm'], 'cm')}."


    def errors(record: Record) -> Figure:  # as many figures and tables as the page shows
        with canvas() as (figure, axes):
            ...
        return figure


    EXPERIMENT = Experiment(
        "Title of the page", Parameters, run, finding, needs=IMAGES, cost_s=20
    )

and `MODULES` here has one line for it. Defaults, types and ranges stand in `Parameters` alone: the
command line, the notebook, the checks and the record take them from there. Frames are flown by
`trexton.companion.experiments.track.fly`; independent repeats and trials go through
`trexton.companion.executor.spread`. The notebook ``notebooks/<name>.md`` has the prose and begins
with::

    given = notebook.given(name.Parameters, globals())
    record = name.run(given.train, given.test, given.parameters)
    page = notebook.Page(record, given)

What the paper claims of it stands in ``data/paper/claims.toml``, what it claims itself in
``Experiment(claims=...)``. That makes three files at most: module, notebook, claims.

An experiment of one's own, outside this package, is the same module with its notebook ``<name>.md``
beside it; it is an entry point of the group ``trexton.experiments`` (name to module), or its module
is named in ``$TREXTON_PLUGINS``.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping

from trexton.base.plugins import PLUGINS, addresses, resolve
from trexton.companion.experiments.declaration import Experiment

__all__ = ["EXPERIMENTS", "LEDGER", "MODULES"]

LEDGER = "claims"
MODULES = {
    # The paper's, in its order, and what it leaves open.
    "overview": "trexton.companion.experiments.overview",
    "texton_dictionary": "trexton.companion.experiments.texton_dictionary",
    "mosaic": "trexton.companion.experiments.mosaic",
    "homography_baseline": "trexton.companion.experiments.homography_baseline",
    "mocap_training": "trexton.companion.experiments.mocap_training",
    "homography_training": "trexton.companion.experiments.homography_training",
    "triggered_landing": "trexton.companion.experiments.triggered_landing",
    "trade_off": "trexton.companion.experiments.trade_off",
    "timing": "trexton.companion.experiments.timing",
    "map_loss": "trexton.companion.experiments.map_loss",
    "kidnapping": "trexton.companion.experiments.kidnapping",
    "choices": "trexton.companion.experiments.choices",
    # Beyond the paper.
    "beyond": "trexton.companion.experiments.beyond",
    "baselines": "trexton.companion.experiments.baselines",
    "senses": "trexton.companion.experiments.senses",
    "uncertainty": "trexton.companion.experiments.uncertainty",
    "fine": "trexton.companion.experiments.fine",
    "touchdown": "trexton.companion.experiments.touchdown",
    "rooms": "trexton.companion.experiments.rooms",
    "aiding": "trexton.companion.experiments.aiding",
    "density": "trexton.companion.experiments.density",
    "suitability": "trexton.companion.experiments.suitability",
    "assessment": "trexton.companion.experiments.assessment",
}


class _Experiments(Mapping[str, Experiment]):
    """Name to experiment; a module is imported when its experiment is asked for."""

    def _table(self) -> dict[str, str]:
        """Module by name: this package's, then those that ``$TREXTON_PLUGINS`` names."""
        table = dict(MODULES)
        for module in filter(None, os.environ.get(PLUGINS, "").split(",")):
            if hasattr(resolve("experiments", module, {module: module}), "EXPERIMENT"):
                table.setdefault(module.rpartition(".")[2], module)
        return table

    def __getitem__(self, name: str) -> Experiment:
        if name == LEDGER:
            return _LEDGER
        if name not in set(self):
            raise KeyError(name)
        declared = resolve("experiments", name, self._table())
        return declared if isinstance(declared, Experiment) else declared.EXPERIMENT

    def __iter__(self) -> Iterator[str]:
        yield from addresses("experiments", self._table())
        yield LEDGER

    def __len__(self) -> int:
        return len(set(self))


_LEDGER = Experiment("The ledger")
EXPERIMENTS: Mapping[str, Experiment] = _Experiments()
