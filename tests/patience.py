"""Waiting for what another thread or process does: patient, for the machine may be busy."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

__all__ = ["alive", "eventually"]


def eventually(true: Callable[[], Any], patience: float = 120.0) -> Any:
    """What it returns once that is true; False where it never becomes so. A file that is looked for
    may come and go, as one that is only tried."""
    end = time.monotonic() + patience
    while time.monotonic() < end:
        with suppress(FileNotFoundError):
            if found := true():
                return found
        time.sleep(0.005)
    return False


def alive(process: int) -> bool:
    """Whether a process still runs: one that has ended and was not waited for does not."""
    try:
        return "Z" not in Path(f"/proc/{process}/stat").read_text().split(")")[1][:3]
    except (FileNotFoundError, ProcessLookupError):
        return False
