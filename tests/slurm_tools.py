"""A whole Slurm (munge, controller, one node) on loopback, in a folder of its own; needs root."""

from __future__ import annotations

import os
import secrets
import shutil
import socket
import subprocess
import time
from pathlib import Path

__all__ = ["LocalSlurm", "missing"]

_CONFIGURATION = """ClusterName=loopback
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CredType=cred/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerType=sched/builtin
MpiDefault=none
ReturnToService=2
NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} RealMemory=1000 State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


def missing() -> str:
    """Why it cannot be started here; empty if it can."""
    programs = [name for name in ("munged", "slurmctld", "slurmd", "sbatch") if not _find(name)]
    if programs:
        return f"{', '.join(programs)} not installed (Debian: slurm-wlm, munge)"
    return "" if os.getuid() == 0 else "Slurm's daemons need root"


def _find(name: str) -> str | None:
    return shutil.which(name, path=f"{os.environ['PATH']}:/usr/sbin:/sbin")


def _free_ports(count: int) -> list[int]:
    sockets = [socket.socket() for _ in range(count)]
    for one in sockets:
        one.bind(("127.0.0.1", 0))
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return ports


class LocalSlurm:
    """Started on entering, ended on leaving; ``SLURM_CONF`` names its configuration meanwhile."""

    def __init__(self, folder: Path, cpus: int = 2):
        self.folder, self.cpus = folder, min(cpus, os.cpu_count() or 1)
        self.processes: list[subprocess.Popen] = []

    def __enter__(self) -> LocalSlurm:
        folder, host = self.folder, socket.gethostname().split(".")[0]
        for name in ("state", "spool"):
            (folder / name).mkdir()
        key = folder / "munge.key"
        key.touch(mode=0o600)
        key.write_bytes(secrets.token_bytes(1024))
        conf = folder / "slurm.conf"
        ports = _free_ports(2)
        conf.write_text(
            _CONFIGURATION.format(host=host, ports=ports, folder=folder, cpus=self.cpus)
        )
        self._before = os.environ.get("SLURM_CONF")
        os.environ["SLURM_CONF"] = str(conf)
        try:
            files = {"key-file": key} | {
                name: folder / f"munge.{name.split('-')[0]}"
                for name in ("socket", "pid-file", "log-file", "seed-file")
            }
            options = [f"--{name}={path}" for name, path in files.items()]
            self._start("munged", "--foreground", "--force", *options)
            self._until(lambda: (folder / "munge.socket").exists())
            self._start("slurmctld", "-D", "-f", str(conf))
            self._start("slurmd", "-D", "-f", str(conf), "-N", host)
            self._until(lambda: "idle" in self._sinfo())
        except BaseException:
            self.__exit__()
            raise
        return self

    def _start(self, name: str, *words: str) -> None:
        with open(self.folder / f"{name}.log", "w") as log:
            self.processes.append(
                subprocess.Popen([_find(name), *words], stdout=log, stderr=subprocess.STDOUT)
            )

    def _sinfo(self) -> str:
        return subprocess.run(["sinfo", "-h", "-o", "%T"], capture_output=True, text=True).stdout

    def _until(self, condition) -> None:
        end = time.monotonic() + 60
        while not condition():
            if time.monotonic() > end or any(one.poll() is not None for one in self.processes):
                logs = "\n".join(p.read_text()[-1500:] for p in self.folder.glob("*.log"))
                raise AssertionError(f"Slurm did not start:\n{logs}")
            time.sleep(0.2)

    def __exit__(self, *_: object) -> None:
        for process in reversed(self.processes):
            process.terminate()
        for process in self.processes:
            try:
                process.wait(timeout=10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        if self._before is None:
            os.environ.pop("SLURM_CONF", None)
        else:
            os.environ["SLURM_CONF"] = self._before
