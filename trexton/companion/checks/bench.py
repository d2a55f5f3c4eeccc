"""Speed of every stage, measured against yardsticks of the same run, interleaved in one process."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from importlib import import_module
from typing import TYPE_CHECKING

from trexton.base.errors import ParameterError
from trexton.base.progress import say
from trexton.companion.checks.timing import Row, table

if TYPE_CHECKING:  # loaded when measured; named here for whoever follows imports, as the cache does
    from trexton.companion.checks import bench_estimation as estimation  # noqa: F401

__all__ = ["Row", "STAGES", "measure", "table"]

# name: (module, function(scene, quick) -> rows)
STAGES = {
    "full": ("bench_images", "full_histogram"),
    "sampled": ("bench_images", "sampled"),
    "neighbors": ("bench_estimation", "neighbors"),
    "filter": ("bench_estimation", "filter_step"),
    "frame": ("bench_estimation", "whole_frame"),
    "homography": ("bench_images", "homography"),
    "simulator": ("bench_images", "simulator"),
    "start": ("bench_processes", "start"),
    "onboard": ("bench_processes", "onboard"),
    "growth": ("bench_estimation", "growth"),
}


def measure(
    stages: Iterable[str] | None = None, *, quick: bool = False, seed: int = 1
) -> Iterator[Row]:
    """Measure stages one after another; all of them take about two minutes.

    Parameters
    ----------
    stages : iterable of str or None
        Keys of `STAGES`; None is all.
    quick : bool
        Fewer repeats and smaller sizes: about twenty seconds.
    seed : int
        Of the frames and the map that are worked on.

    Raises
    ------
    ParameterError
        A stage is unknown, or a yardstick's package is missing.
    """
    from trexton.companion.checks.scene import Scene

    stages = list(STAGES) if stages is None else list(stages)
    for name in stages:
        if name not in STAGES:
            raise ParameterError(f"stage {name!r} is unknown: the stages are {', '.join(STAGES)}")
    scene = Scene(seed)
    for name in stages:
        say(f"bench: {name}")
        module, function = STAGES[name]
        try:
            yield from getattr(import_module(f"trexton.companion.checks.{module}"), function)(
                scene, quick
            )
        except ModuleNotFoundError as error:
            raise ParameterError(
                f"stage {name!r} needs {error.name}, which is not installed: pip install "
                "trexton[book]"
            ) from None
