"""What made a result: its code, the commit, the versions and the machine. Offers `made_by` and
`machine` for records, and `kept_results`, those of longer runs that are kept with the code.
"""

import os
import platform
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

from trexton.base.cache import code_hashes, repository_root
from trexton.base.files import digest
from trexton.base.records import software_versions

_DRAWS = ("experiments.style", "wording", "claims.page")


@cache
def made_by(module: str) -> dict[str, Any]:
    """What to know of a result of `module`: versions, a hash of all its code, and in a clone the
    commit. What only draws does not count: a figure may change, and the result stays.
    """
    made: dict[str, Any] = {"versions": software_versions()}
    drawn = {f"trexton.companion.{name}" for name in _DRAWS}
    made["code"] = digest({k: v for k, v in code_hashes(module).items() if k not in drawn})
    if root := repository_root():
        ask = ["git", "-C", str(root), "rev-parse", "HEAD"]
        try:
            said = subprocess.run(ask, capture_output=True, text=True, check=True)
            made["commit"] = said.stdout.strip()
        except (OSError, subprocess.CalledProcessError):
            pass  # an archive of the code, or no git
    return made


def machine() -> dict[str, Any]:
    """What the figures depend on: processor, how many of them, how busy they are."""
    model = platform.processor() or platform.machine()
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as stream:
            names = (
                line.split(":", 1)[1].strip() for line in stream if line.startswith("model name")
            )
            model = next(names, model)
    except OSError:
        pass
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return {
        "processor": model,
        "processors": os.cpu_count(),
        "load": load,
        "system": platform.platform(),
    }


def kept_results() -> list[Path]:
    """``data/reference/*.json`` of the clone: results of longer runs, kept with the code."""
    root = repository_root()
    return sorted((root / "data" / "reference").glob("*.json")) if root else []
