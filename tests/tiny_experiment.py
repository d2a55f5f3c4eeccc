"""The declaration of the tiny notebooks: three parameters."""

from __future__ import annotations

from dataclasses import dataclass

from trexton.base.options import Options, option


@dataclass(frozen=True)
class Parameters(Options):
    """What a tiny notebook can be told."""

    factor: int = option(2, "frames are counted so many times", low=-9)
    rate: float | None = option(0.5, "of nothing")
    label: str = option("a", "a word")
