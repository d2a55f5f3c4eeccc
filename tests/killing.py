"""Commands that are killed outright: every file whole or absent, the next run cleans up and
finishes, nobody is left running.

``python tests/killing.py --kills 100`` kills each command at so many random moments, mostly on top
of what earlier kills left; ``--steps`` kills it before every single thing it does on the disk. The
suite does the latter for the commands that take milliseconds.
"""

from __future__ import annotations

import argparse
import hashlib
import http.server
import json
import os
import shutil
import signal
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import cv2
import numpy as np

MARK = "TREXTON_KILLED"  # in the environment of whatever a command starts
PATIENCE_S = 300
STEPS = {"open", "os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.chmod"}


@dataclass(frozen=True)
class Case:
    """A command, in two varieties whose results differ; `out` is what they write."""

    words: tuple[str, ...]
    varieties: tuple[tuple[str, ...], tuple[str, ...]]
    out: str = "out"
    gathers: str = ""  # where what the other left may stay


SEEDS = ("--seed", "1"), ("--seed", "2")
NEIGHBORS = ("neighbors=2",), ("neighbors=3",)
RUN = ("run", "plain", "--only", "mocap_training", "--out", "out")
PLANS = ("two.toml",), ("three.toml",)
SMALL = ("--set", "particles=10", "repeats=2")
CASES = {
    "simulate": Case(
        ("simulate", "--out", "out", "--frames", "3", "--floor", "room/floor.png", "--replace"),
        SEEDS,
    ),
    "train": Case(
        ("train", "room", "-o", "map.npz", "--textons", "3", "--set", "measurement.neighbors=2"),
        SEEDS,
        "map.npz",
    ),
    "fetch": Case(("data", "fetch", "thing", "--out", "out"), ((), ())),
    "import": Case(
        ("import", "csv", "table.csv", "--out", "out", "--replace"),
        (("--split", "0.5"), ("--split", "0.4")),
    ),
    "export": Case((*"export room tum --out t.tum --replace".split(),), ((), ()), "t.tum"),
    "run": Case((*RUN, "--no-book", *SMALL), NEIGHBORS),
    "sweep": Case(("sweep", "--out", "out"), PLANS, gathers="out/cells/"),
    "suitability": Case(
        ("suitability", "room/floor.png", "--width", "4", "--frames", "40", "--test-frames", "20",
         "--out", "out"),
        SEEDS,
    ),
    "book": Case((*RUN, *SMALL), NEIGHBORS),
    # It writes nothing: whatever is there must stay as it was.
    "tune": Case(("tune", "long", "--trials", "3", "--methods", "paper"), SEEDS, ""),
    "report": Case(
        ("report", "plain", "--no-book", "--out", "out"),
        (("--methods", "paper"), ("--methods", "paper field")),
    ),
}  # fmt: skip
QUICK = ("simulate", "train", "fetch", "import", "export")


def prepare(folder: Path) -> None:
    """What the commands read."""
    from small_room import histogram_flight, picture_flight

    from trexton.flights.writing import write_flight

    seen = picture_flight(folder / "pictures", "room", 16)
    write_flight(replace(seen, split={"train": (100, 109), "test": (110, 115)}), folder / "room")
    plain = histogram_flight("plain", 60)
    write_flight(replace(plain, split={"train": (0, 39), "test": (40, 59)}), folder / "plain")
    write_flight(histogram_flight("long", 120), folder / "long")
    rows = "".join(f"{i},{i},{i % 3},pictures/{100 + i:04d}.png\n" for i in range(2))
    for i in range(2):
        grey = np.full((24, 32, 3), 50 * i, np.uint8)
        cv2.imwrite(str(folder / "pictures" / f"{100 + i:04d}.png"), grey)
    (folder / "table.csv").write_text("t,x,y,image\n" + rows)
    plan = (
        'experiment = "mocap_training"\nflights = ["plain"]\n[set]\nparticles = 10\nrepeats = 2\n'
    )
    for name, neighbors in (("two", 2), ("three", 3)):
        (folder / f"{name}.toml").write_text(f"{plan}neighbors = {neighbors}\n")


def offer(data: bytes) -> str:
    """The address of a server that hands out `data` slowly."""

    class Slow(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            for start in range(0, len(data), 1 << 12):
                try:
                    self.wfile.write(data[start : start + (1 << 12)])
                except OSError:
                    return  # whoever asked was killed
                time.sleep(0.003)

        def log_message(self, *_: object) -> None:
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Slow)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return f"http://127.0.0.1:{server.server_port}/thing"


class Grave:
    """Starts commands in `work`, kills them, and looks at what is left."""

    def __init__(self, work: Path, seed: int = 0) -> None:
        self.work, self.rng = work, np.random.default_rng(seed)
        self.token = f"{os.getpid()}-{time.monotonic_ns()}"
        self.faults: list[str] = []
        self.log = work.parent / f"{work.name}.log"
        self.modules = work.parent / f"{work.name}.modules"

    def start(self, words: tuple[str, ...], step: int | None = None) -> int:
        """The process of a command; with `step`, it kills itself before that step on the disk."""
        sys.stdout.flush()
        process = os.fork()
        if process:
            return process
        status = 1
        try:
            os.setsid()
            os.chdir(self.work)
            log = os.open(self.log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            for stream in (1, 2):
                os.dup2(log, stream)
            os.environ |= {MARK: self.token, "TREXTON_CACHE": str(self.work / "cache")}
            os.environ["TMPDIR"] = tempfile.tempdir = str(self.work / "tmp")
            os.makedirs(tempfile.tempdir, exist_ok=True)
            if step is not None:
                sys.addaudithook(self._counting(step))
            from trexton.cli.main import main

            status = main(list(words))
            sys.stdout.flush()
            self.modules.write_text("\n".join(sorted(sys.modules)))
        finally:
            os._exit(status)

    def warm(self) -> None:
        """Import what the last command did: the next are forked from here, and start at once."""
        for name in self.modules.read_text().split():
            with suppress(Exception):
                import_module(name)

    def _counting(self, last: int) -> Callable[[str, tuple[Any, ...]], None]:
        steps, writes = 0, os.O_WRONLY | os.O_RDWR | os.O_CREAT

        def hook(event: str, arguments: tuple[Any, ...]) -> None:
            nonlocal steps
            if steps == last or event not in STEPS or isinstance(arguments[0], int):
                return
            flags = arguments[2] or 0 if event == "open" else writes
            path = os.path.abspath(os.fsdecode(arguments[0]))
            if not flags & writes or not path.startswith(str(self.work)):
                return
            for opened in (False, True) if event == "open" else (False,):
                steps += 1  # before it, and after a file was opened and nothing written yet
                if steps == last:
                    if opened:
                        os.open(path, flags, 0o600)
                    os.kill(os.getpid(), signal.SIGKILL)

        return hook

    def whole_run(self, words: tuple[str, ...]) -> float:
        """Seconds until it ended; a fault unless it ended well."""
        started = time.monotonic()
        process = self.start(words)
        while os.waitpid(process, os.WNOHANG) == (0, 0):
            if time.monotonic() - started > PATIENCE_S:
                os.kill(process, signal.SIGKILL)
                os.waitpid(process, 0)
                self.fault("did not finish")
                break
            time.sleep(0.002)
        else:
            said = self.log.read_text(errors="replace").strip().splitlines()
            if said and said[-1].startswith(f"trexton {words[0]}:"):
                self.fault(f"did not finish: {said[-1]}")
        return time.monotonic() - started

    def fault(self, text: str) -> None:
        self.faults.append(text)
        print(f"  {text}", file=sys.stderr, flush=True)

    def strike(self, process: int) -> None:
        """Kill it outright, mostly; now and then ask it to end, and with all that it started."""
        number = signal.SIGKILL if self.rng.random() < 0.7 else signal.SIGTERM
        with suppress(ProcessLookupError):
            (os.killpg if self.rng.random() < 0.5 else os.kill)(process, number)

    def bury(self, process: int) -> bool:
        """Whether the process was killed; a fault if what it had started goes on."""
        _, status = os.waitpid(process, 0)
        killed = os.WIFSIGNALED(status) or os.WEXITSTATUS(status) == 128 + signal.SIGTERM
        until = time.monotonic() + 30
        while left := self.left_running():
            if time.monotonic() > until:
                self.fault(f"{len(left)} processes go on")
                for each in left:
                    os.kill(each, signal.SIGKILL)
            time.sleep(0.05)
        return killed

    def left_running(self) -> list[int]:
        """Processes that carry this mark."""
        found, mark = [], f"{MARK}={self.token}".encode()
        for entry in Path("/proc").iterdir():
            try:
                if entry.name.isdigit() and mark in (entry / "environ").read_bytes():
                    found.append(int(entry.name))
            except OSError:
                pass
        return found

    def contents(self, out: str) -> dict[str, str]:
        """What stands at `out`, file by file, by a digest without times and commits."""
        place = self.work / out
        files = [place] if place.is_file() else sorted(place.rglob("*"))
        return {
            path.relative_to(self.work).as_posix(): _digest(path)
            for path in files
            if path.is_file() and not (_HIDDEN & set(path.parts)) and ".new-" not in str(path)
        }

    def everything(self) -> set[str]:
        """All files and folders that are here, the engine's own and temporary ones among them."""
        return {path.relative_to(self.work).as_posix() for path in self.work.rglob("*")}


_HIDDEN = {".engine", ".book.stamp"}  # what was built last, times and all


def _digest(path: Path) -> str:
    data = path.read_bytes()
    try:
        if path.suffix in (".json", ".ipynb"):
            content = json.loads(data)
            content.pop("timings", None)
            for made in (content, content.get("provenance", {})):
                made.pop("commit", None)  # somebody may commit beside this
            data = json.dumps(content, sort_keys=True).encode()
    except (ValueError, AttributeError) as error:
        return f"damaged: {error}"
    if "book" in path.parts and path.suffix in (".html", ".svg"):  # may tell times, random names
        end = data.rstrip()[-7:]
        return f"{path.suffix} that ends" if end in (b"</html>", b"\n</svg>") else "cut"
    return hashlib.sha256(data).hexdigest()


def kill(
    name: str, folder: Path, kills: int, *, steps: bool = False, seed: int = 0
) -> tuple[int, list[str]]:
    """Kill the command `name`; how many times, and what was wrong then, one line each.

    With `steps` it is killed before everything it does on the disk, and `kills` is the most.
    """
    case, work = CASES[name], folder / name
    work.mkdir()
    prepare(work)
    inputs = folder / f"{name}.inputs"
    shutil.copytree(work, inputs)
    grave = Grave(work, seed)
    varieties = [(*case.words, *each) for each in case.varieties]
    seconds, whole, known = [], [], set()
    for words in varieties:
        seconds.append(grave.whole_run(words))
        if not grave.faults:
            grave.warm()
        whole.append(grave.contents(case.out))
        known |= grave.everything()
    good = folder / f"{name}.good"
    shutil.copytree(work, good)
    if grave.faults or not all(whole):
        return 0, grave.faults or ["nothing was written"]

    gathered = [{path for path in each if path.startswith(case.gathers)} for each in whole]
    others = [gathered[1] - gathered[0], gathered[0]] if case.gathers else [set(), set()]

    def own(which: int, found: dict[str, str]) -> dict[str, str]:
        return {path: digest for path, digest in found.items() if path not in others[which]}

    def look(which: int, finish: bool) -> None:
        for path, digest in grave.contents(case.out).items():
            if path.endswith(".failed.ipynb"):  # of a cell that was ended; gone after the next run
                continue
            if digest not in (whole[0].get(path), whole[1].get(path)):
                grave.fault(f"{path} is neither the old nor the new one ({digest[:20]})")
        if finish:
            grave.whole_run(varieties[which])
            found, meant = own(which, grave.contents(case.out)), own(which, whole[which])
            for path in sorted(found.keys() | meant.keys()):
                if found.get(path) != meant.get(path):
                    was, now = (each.get(path, "absent")[:20] for each in (meant, found))
                    grave.fault(f"the next run has another result: {path} {was} -> {now}")
            for left in sorted(grave.everything() - known):
                grave.fault(f"left: {left}")

    done = 0
    if steps:
        for start, which in ((inputs, 0), (good, 0)):  # the good one holds the other's result
            for step in range(1, kills + 1):
                _restore(start, work)
                if not grave.bury(grave.start(varieties[which], step)):
                    break
                done += 1
                look(which, True)
        return done, grave.faults
    for attempt in range(3 * kills):
        if grave.rng.random() < 0.5:
            _restore(good if grave.rng.random() < 0.5 else inputs, work)
        process = grave.start(varieties[attempt % 2])
        until = time.monotonic() + grave.rng.uniform(0, 1.1 * seconds[1])
        ended = partial(os.waitid, os.P_PID, process, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        while time.monotonic() < until and ended() is None:
            time.sleep(0.002)
        grave.strike(process)
        killed = grave.bury(process)
        done += killed
        if attempt % 10 == 9:
            said = f"{name}: killed {done} times so far, {len(grave.faults)} faults"
            print(said, file=sys.stderr, flush=True)
        look(attempt % 2, killed and grave.rng.random() < 0.4)
        if done == kills:
            break
    return done, grave.faults


def _restore(source: Path, work: Path) -> None:
    shutil.rmtree(work)
    shutil.copytree(source, work)


def serve_thing() -> None:
    """A public file of one's own, fetched from a server of one's own."""
    from trexton.flights import registry

    data = np.random.default_rng(0).bytes(200_000)
    file = {"key": "thing.bin", "url": offer(data), "sha256": hashlib.sha256(data).hexdigest()}
    entry = {"title": "thing", "licence": "none", "files": [file]}
    registry.registry = partial(dict, thing=entry)  # type: ignore[assignment]
    os.environ.pop("TREXTON_DATA", None)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="COMMAND", help=f"any of {', '.join(CASES)}")
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--steps", action="store_true", help="before every step on the disk")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    serve_thing()
    status = 0
    for name in chosen.names or CASES:
        with tempfile.TemporaryDirectory() as folder:
            started = time.monotonic()
            count, faults = kill(
                name, Path(folder).resolve(), chosen.kills, steps=chosen.steps, seed=chosen.seed
            )
        status |= bool(faults) or not count
        took = time.monotonic() - started
        print(f"{name}: killed {count} times, {len(faults)} faults, {took:.0f} s", flush=True)
        for fault, times in Counter(faults).most_common(12):
            print(f"  {times} x {fault}", flush=True)
    return status


if __name__ == "__main__":
    sys.exit(main())
