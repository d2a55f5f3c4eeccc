"""The experiments by name, in the order of their pages; each is a module that declares itself.

A module ``trexton/companion/experiments/<name>.py`` holds all of an experiment but its prose:
``Parameters``, ``run``, ``finding``, figures and ``EXPERIMENT``; `_NAMES` here has its name.
Defaults, types and ranges stand in ``Parameters`` alone, and the notebook ``notebooks/<name>.md``
has the prose. Frames are flown by `trexton.companion.experiments.track.fly`, and independent
repeats go through `trexton.companion.executor.spread`. What the paper claims of it stands in
``data/paper/claims.toml``, what it claims itself in ``Experiment(claims=...)``. CONTRIBUTING.md
adds one step by step.

An experiment of one's own, outside this package, is the same module with its notebook ``<name>.md``
beside it; it is an entry point of the group ``trexton.experiments`` (name to module), or its module
is named in ``$TREXTON_PLUGINS``.
"""

import os
from collections.abc import Iterator, Mapping

from trexton.base.plugins import PLUGINS, addresses, resolve
from trexton.companion.experiments.declaration import Experiment

LEDGER = "claims"
_NAMES = (
    # The paper's, in its order, and what it leaves open.
    "texton_dictionary",
    "mosaic",
    "homography_baseline",
    "mocap_training",
    "homography_training",
    "triggered_landing",
    "trade_off",
    "timing",
    "map_loss",
    "kidnapping",
    "choices",
    # Beyond the paper.
    "beyond",
    "baselines",
    "senses",
    "uncertainty",
    "fine",
    "touchdown",
    "rooms",
    "aiding",
    "density",
    "suitability",
    "assessment",
)
MODULES = {name: f"trexton.companion.experiments.{name}" for name in _NAMES}


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
        if name not in self:
            raise KeyError(name)
        declared = resolve("experiments", name, self._table())
        return declared if isinstance(declared, Experiment) else declared.EXPERIMENT

    def __contains__(self, name: object) -> bool:
        return name in set(self)  # a mapping's own would import the module

    def __iter__(self) -> Iterator[str]:
        yield from addresses("experiments", self._table())
        yield LEDGER

    def __len__(self) -> int:
        return len(set(self))


_LEDGER = Experiment("The ledger")
EXPERIMENTS: Mapping[str, Experiment] = _Experiments()
