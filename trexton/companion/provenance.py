"""What made a result: its code, the commit, the versions and the machine. Offers `made_by` and
`machine` for records, and `kept_results`, those of longer runs that are kept with the code, with
the `stale_note` of one that other code made.
"""

import os
import platform
import subprocess
from collections.abc import Mapping
from functools import cache
from html import escape
from pathlib import Path
from typing import Any

from trexton.base.cache import code_hashes, repository_root
from trexton.base.files import digest
from trexton.base.records import software_versions

_DRAWS = ("experiments.style", "wording", "claims.page")


@cache
def made_by(*modules: str) -> dict[str, Any]:
    """What to know of a result of `modules`: versions, a hash of all their code, and in a clone the
    commit. What only draws does not count: a figure may change, and the result stays.
    """
    made: dict[str, Any] = {"versions": software_versions()}
    drawn = {f"trexton.companion.{name}" for name in _DRAWS}
    hashes = {k: v for each in modules for k, v in code_hashes(each).items() if k not in drawn}
    made["code"] = digest(hashes)
    if root := repository_root():
        ask = ["git", "-C", str(root), "rev-parse", "HEAD"]
        try:
            said = subprocess.run(ask, capture_output=True, text=True, check=True)
            made["commit"] = said.stdout.strip()
        except (OSError, subprocess.CalledProcessError):
            pass  # an archive of the code, or no git
    return made


def stale_note(name: str, made: Mapping[str, Any], *modules: str) -> str:
    """What a page says of a kept result that other code made than stands here; empty of others."""
    if made.get("code") == made_by(*modules)["code"]:
        return ""
    at = f"commit {made['commit'][:12]}" if "commit" in made else "a commit it does not name"
    return (
        f'<p class="stale">The kept result {escape(name)} was made by other code, at {at}. '
        "<code>make full</code> renews it.</p>"
    )


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
