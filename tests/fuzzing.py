"""Damaged and hostile input for everything that reads a file: no crash, no hang, no flood of
memory.

A target (`fuzz_targets`) takes bytes, puts them where a person's file would be, and reads it; only
a `TrextonError` may come out. The suite spends seconds on it; ``python tests/fuzzing.py --minutes
10`` goes on for longer, each input in a limit of two seconds and 500 MB, and keeps what broke a
target in ``tests/fuzz_corpus``, which the suite then tries first.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import json
import os
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import warnings
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from fuzz_targets import targets

from trexton.base.errors import TrextonError
from trexton.base.progress import set_quiet

CORPUS = Path(__file__).parent / "fuzz_corpus"
SECONDS, MEGABYTES = 2, 500
TRIED = "tried:"  # begins the name of a file with what is being tried
# What a careless or a hostile hand puts into text.
TOKENS = (
    b"1e300", b"-1e300", b"nan", b"inf", b"-0", b"", b"9" * 400, b"1_000", b"0x10", b"\x00",
    b"\xff\xfe", b"\xef\xbb\xbf", b"'", b'"', b'"""', b",", b";", b"\t", b"\n\n", b"\r", b"[",
    b"[" * 5000, b"{", b"]", b"=", b"../../../etc/passwd", b"/dev/zero", b"true", b"null",
    b"2026-01-01", b"#", b"%s", "é".encode(),
)  # fmt: skip


def mutate(data: bytes, rng: np.random.Generator) -> bytes:
    """One to four changes: bytes flipped, cut, doubled, moved, or a token put in.

    In a file of arrays mostly one array changes, goes, comes twice or takes another's name, and the
    file around it stays sound: what checksums would catch is not all that can be wrong.
    """
    if data[:2] == b"PK" and rng.random() < 0.7:
        return _with_another_array(data, rng)
    for _ in range(int(rng.integers(1, 5))):
        place, end = sorted(int(each) for each in rng.integers(0, len(data) + 1, 2))
        end = min(end, place + 64)
        kind = rng.integers(5)
        if kind == 0 and data:
            flipped = bytearray(data)
            flipped[min(place, len(data) - 1)] ^= 1 << int(rng.integers(8))
            data = bytes(flipped)
        elif kind == 1:
            data = data[:place] + data[end:]
        elif kind == 2:
            data = data[:end] + data[place:end] * int(rng.integers(1, 4)) + data[end:]
        elif kind == 3:
            data = data[:place] if rng.integers(4) == 0 else data[place:] + data[:place]
        else:
            token = TOKENS[int(rng.integers(len(TOKENS)))]
            data = data[:place] + token + data[end if rng.integers(2) else place :]
    return data


def _with_another_array(data: bytes, rng: np.random.Generator) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(stream, "w") as new:
        names = old.namelist()
        chosen, other = (str(each) for each in rng.choice(names, 2))
        kind = rng.integers(5)
        for name in names:
            content = old.read(name)
            if name != chosen:
                new.writestr(name, content)
            elif kind == 0:
                new.writestr(other, content)
            elif kind == 1:
                new.writestr(name, mutate(content, rng))
            elif kind in (2, 3):  # the header of the array stays, its values do not
                start = 10 + int.from_bytes(content[8:10], "little")
                values = bytearray(content[start:])
                for _ in range(3):
                    if values:
                        at = int(rng.integers(len(values)))
                        values[at : at + 8] = rng.bytes(len(values[at : at + 8]))
                if name.startswith("header"):
                    values = bytearray(mutate(content[start:], rng)[: len(values)])
                    values += b" " * (len(content) - start - len(values))
                new.writestr(name, content[:start] + bytes(values))
    return stream.getvalue()


def attempt(target: Callable[[bytes], object], data: bytes) -> str | None:
    """What is wrong with how a target took `data`; None if it read it, or refused it in a
    sentence.
    """
    try:
        target(data)
    except TrextonError as error:
        text = str(error)
        return f"more than a line: {text[:200]!r}" if "\n" in text.strip() else None
    except Exception as error:
        return f"{type(error).__name__}: {str(error)[:200]}"
    return None


def _too_slow(*_: object) -> None:
    raise TimeoutError(f"more than {SECONDS} s")


def _kept(name: str, data: bytes) -> str:
    return f"{name.replace(' ', '-')}-{hashlib.sha256(data).hexdigest()[:12]}"


def search(
    seconds: float, seed: int, folder: Path, corpus: Path | None = None, names: Sequence[str] = ()
) -> list[str]:
    """Try mutations of all targets (those of `names`) in turn; what broke, one line each, kept in
    `corpus`.
    """
    rng, broken = np.random.default_rng(seed), []
    entries = [each for each in targets(folder).items() if not names or each[0] in names]
    resource.setrlimit(resource.RLIMIT_DATA, (3 * 2**30, 3 * 2**30))
    for alarm in (signal.SIGALRM, signal.SIGPROF):
        signal.signal(alarm, _too_slow)
    until, tried = time.monotonic() + seconds, 0
    while time.monotonic() < until:
        name, (target, seeds) = entries[tried % len(entries)]
        tried += 1
        data = mutate(seeds[int(rng.integers(len(seeds)))], rng)
        if corpus:
            for stale in folder.glob(f"{TRIED}*"):
                stale.unlink()
            (folder / f"{TRIED}{_kept(name, data)}").write_bytes(data)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        try:
            # Of the processor, which a busy machine cannot hurry; and of waiting, which costs none.
            signal.setitimer(signal.ITIMER_PROF, SECONDS)
            signal.setitimer(signal.ITIMER_REAL, 20 * SECONDS)
            fault = attempt(target, data)
        except TimeoutError as error:  # just after it had ended
            fault = str(error)
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
            signal.setitimer(signal.ITIMER_REAL, 0)
        grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
        if fault is None and grown > MEGABYTES:
            fault = f"{grown:.0f} MB"
        if fault:
            line = f"{name}: {re.sub(r'[0-9]+', '#', fault)[:160]}"
            if corpus and line not in broken:
                (corpus / _kept(name, data)).write_bytes(data)
            broken.append(line)
    print(json.dumps({"tried": tried, "broken": len(broken)}))
    return broken


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="TARGET", help="of these only")
    parser.add_argument("--minutes", type=float, default=10, help="how long (10)")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    set_quiet(True)
    warnings.simplefilter("ignore")
    CORPUS.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as temporary:
        # What ends the process outright is kept by the one that outlives it.
        process = os.fork()
        if not process:
            found = search(60 * chosen.minutes, chosen.seed, Path(temporary), CORPUS, chosen.names)
            print("\n".join(sorted(set(found))), flush=True)
            os._exit(bool(found))
        status = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
        if status < 0:
            for path in Path(temporary).glob(f"{TRIED}*"):
                shutil.move(path, CORPUS / path.name.removeprefix(TRIED))
                print(f"{path.name.removeprefix(TRIED)}: {signal.Signals(-status).name}")
    sys.exit(bool(status))
