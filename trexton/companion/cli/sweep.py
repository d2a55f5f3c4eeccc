"""``trexton sweep PLAN``: an experiment over flights and settings. One command that can resume."""

import argparse
import sys
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

from trexton.base.errors import ParameterError
from trexton.companion.build.sweep import read_plan, sweep

_TLS = ("ca-file", "client.cert", "client.key")  # as Dask calls them


def add_arguments(parser: argparse.ArgumentParser) -> None:
    words = "experiment, flights and test_flight in TOML; of a table [set] all combinations are run"
    parser.add_argument("plan", metavar="PLAN", help=words)
    parser.add_argument("--out", required=True, metavar="DIR", help="where results go")
    parser.add_argument("--jobs", type=int, metavar="N", help="cells at once")
    words = "run on a Dask cluster, such as tls://HOST:8786, whose workers see the same folders"
    parser.add_argument("--cluster", metavar="ADDRESS", help=words)
    for name, held in (("ca", "authority"), ("cert", "certificate"), ("key", "private key")):
        parser.add_argument(f"--tls-{name}", metavar="PEM", help=f"{held}, for a tls:// address")


def run(arguments: argparse.Namespace) -> int:
    plan, out = read_plan(Path(arguments.plan)), Path(arguments.out)
    with _reaching_cluster(arguments):
        swept = sweep(plan, out, jobs=arguments.jobs, cluster=arguments.cluster)
    for name, reason in swept.failed.items():
        print(f"failed  {name}: {reason}", file=sys.stderr)
    print(", ".join(f"{count} {status}" for status, count in swept.counts.items() if count))
    if swept.rows:
        print(f"{out / 'sweep.csv'} and {out / 'sweep.json'}: {len(swept.rows)} rows")
    return int(bool(swept.failed))


def _reaching_cluster(arguments: argparse.Namespace) -> AbstractContextManager[object]:
    """Within the block a cluster is reached with the files of TLS that were named.

    Raises `ParameterError` where one is missing, or the address is none of TLS.
    """
    typed = (arguments.tls_ca, arguments.tls_cert, arguments.tls_key)
    named = {f"distributed.comm.tls.{key}": file for key, file in zip(_TLS, typed, strict=True)}
    if not any(typed):
        return nullcontext()
    if missing := [file for file in typed if file and not Path(file).is_file()]:
        raise ParameterError(f"{missing[0]}: no such file: give one of TLS, as PEM")
    if not (arguments.cluster or "").startswith("tls://"):
        raise ParameterError(
            f"files of TLS, but --cluster {arguments.cluster}: expected an address tls://HOST:PORT"
        )
    import dask
    import distributed  # noqa: F401  its defaults come first: leaving the block would drop them

    return dask.config.set(named)
