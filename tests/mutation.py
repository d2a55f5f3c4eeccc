"""Mutation of the core: a fault is put into a module, and one of its tests must notice.

``make mutation`` draws mutants of each of `CORE` from the operators of Cosmic Ray. It runs the
tests of that module against each, in a copy of the package and a forked process. It prints those
that no test noticed, and the share of the others.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# module: the files of tests that must notice, the quick ones first
CORE = {
    "companion/experiments/metrics": ["companion/experiments/test_metrics.py"],
    "localization/filters": ["localization/test_filters.py", "localization/test_particle_parts.py"],
    "localization/neighbors": ["localization/test_neighbors.py", "localization/test_localizer.py"],
    "field/likelihood": ["field/test_likelihood.py", "field/test_tracks.py"],
    "vision/textons": ["vision/test_textons.py", "vision/test_histograms.py"],
}
LIMIT_S = 600  # of one mutant: a loop that no longer ends counts as noticed


def _without_annotations(source: str) -> str:
    """The program as it runs: annotations are never evaluated."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        for name in ("annotation", "returns"):
            if getattr(node, name, None) is not None:
                setattr(node, name, ast.Constant(None))
    return ast.dump(tree)


def mutants(source: str) -> Iterator[tuple[int, str]]:
    """Line and source of each change that Cosmic Ray knows and that changes the program."""
    import cosmic_ray.plugins
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.mutating import mutate_code

    whole = _without_annotations(source)
    for name in cosmic_ray.plugins.operator_names():
        kind = cosmic_ray.plugins.get_operator(name)
        if kind.arguments():
            continue
        places = [
            start
            for node in ast_nodes(get_ast(source))
            for start, _ in kind().mutation_positions(node)
        ]
        for occurrence, (line, _) in enumerate(places):
            changed = mutate_code(source, kind(), occurrence)
            with suppress(SyntaxError):  # of a mutant that is no program
                if changed is not None and _without_annotations(changed) != whole:
                    yield line, changed


def noticed(folder: Path, tests: list[str]) -> bool:
    """Whether the tests fail in `folder`, by a process of its own that inherits what is loaded."""
    child = os.fork()
    if not child:
        os.setsid()
        os.chdir(folder)
        with open(folder / "said", "w") as said:
            for stream in (1, 2):
                os.dup2(said.fileno(), stream)
        sys.path[:0] = [str(folder), str(folder / "tests")]
        import pytest

        words = ["-x", "-q", "-p", "no:randomly", "-p", "no:cacheprovider", "-m", "not slow"]
        os._exit(int(pytest.main([*words, *(f"tests/{test}" for test in tests)])))
    end = time.monotonic() + LIMIT_S
    while True:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return status != 0
        if time.monotonic() > end:
            os.killpg(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return True
        time.sleep(0.02)


def score(name: str, count: int, seed: int) -> tuple[int, int]:
    """How many of so many mutants of a module were noticed, and how many there were."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for part in ROOT.glob("[!.]*"):
            if part.name in ("trexton", "tests"):
                shutil.copytree(part, folder / part.name)
            else:
                (folder / part.name).symlink_to(part)
        module = folder / "trexton" / f"{name}.py"
        source = module.read_text("utf-8")
        if noticed(folder, CORE[name]):
            raise SystemExit(f"{(folder / 'said').read_text()}{name}: its tests fail as it is")
        every = list(mutants(source))
        chosen = random.Random(seed).sample(every, min(count, len(every)))
        killed = 0
        for line, changed in chosen:
            module.write_text(changed, "utf-8")
            if noticed(folder, CORE[name]):
                killed += 1
                continue
            pairs = zip(source.splitlines(), changed.splitlines(), strict=False)
            old, new = next((pair for pair in pairs if pair[0] != pair[1]), ("", ""))
            print(f"{name}:{line} not noticed\n  - {old.strip()}\n  + {new.strip()}", flush=True)
        print(f"{name}: {killed} of {len(chosen)} (of {len(every)}) noticed", flush=True)
        return killed, len(chosen)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("modules", nargs="*", default=list(CORE), help="of the core")
    parser.add_argument("--count", type=int, default=60, help="mutants of each, drawn by the seed")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--least", type=float, default=0.8, help="share that must be noticed")
    given = parser.parse_args()
    sys.path.append(str(ROOT / ".venv" / "mutation"))  # after the environment: the lock's own win
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENCV_FOR_THREADS_NUM": "1"}
    for library in ("cv2", "numba", "scipy.spatial", "scipy.optimize", "pytest", "hypothesis"):
        __import__(library)  # once for all mutants
    scores = [score(name, given.count, given.seed) for name in given.modules]
    killed, tried = map(sum, zip(*scores, strict=True))
    print(f"{killed} of {tried} noticed: {killed / tried:.0%}")
    return int(killed < given.least * tried)


if __name__ == "__main__":
    sys.exit(main())
