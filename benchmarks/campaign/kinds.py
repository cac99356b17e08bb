"""Everything that happens to the plant: what strikes, and what ends it where it lasts."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
from collections.abc import Callable, Sequence
from random import Random
from typing import NamedTuple

import psycopg

from benchmarks.campaign.plant import HOSTS, WORKERS, Plant
from tests.support.processes import children, send, stop

Undo = Callable[[], None]


class Struck(NamedTuple):
    """What was hit, and how it ends; ``target`` is empty where there was nothing to hit at that moment."""

    target: str
    undo: Undo | None = None


Strike = Callable[[Plant, Random], Struck]


class Kind(NamedTuple):
    """A kind of fault: how often it comes beside the others, and for how many seconds it lasts."""

    strike: Strike
    weight: int = 1
    lasts_s: tuple[float, float] = (0.0, 0.0)


def _kill(names: Sequence[str], how: signal.Signals = signal.SIGKILL) -> Strike:
    def strike(plant: Plant, random: Random) -> Struck:
        name = random.choice(names)
        send([plant.pid(name)], how)
        return Struck(name)

    return strike


def _end_worker(how: signal.Signals) -> Strike:
    """Kill a worker, or tell it to stop; one that has not started yet is left to start."""

    def strike(plant: Plant, random: Random) -> Struck:
        up = [name for name in WORKERS if plant.pool_of(name)]
        return _kill(up, how)(plant, random) if up else Struck("")

    return strike


def _kill_pool_process(plant: Plant, random: Random) -> Struck:
    worker = random.choice(WORKERS)
    return _kill_one_of(plant.pool_of(worker), f"of {worker}", random)


def _kill_reader(plant: Plant, random: Random) -> Struck:
    """The process that decodes an upload, as the kernel does when memory is short."""
    return _kill_one_of(plant.readers(), "", random)


def _kill_database_process(plant: Plant, random: Random) -> Struck:
    """PostgreSQL takes every session down with it, and recovers from its log."""
    return _kill_one_of(children(plant.pid("postgres")), "", random)


def _kill_one_of(pids: Sequence[int], where: str, random: Random) -> Struck:
    if not pids:
        return Struck("")
    pid = random.choice(pids)
    send([pid], signal.SIGKILL)
    return Struck(f"{pid} {where}".strip())


def _freeze(names: Sequence[str], whole: bool = False) -> Strike:
    """Stop a process, or it and its children, and let it go on later, when others have taken what it held."""

    def strike(plant: Plant, random: Random) -> Struck:
        name = random.choice(names)
        pids = [plant.pid(name), *(children(plant.pid(name)) if whole else [])]
        send(pids, signal.SIGSTOP)
        return Struck(name, lambda: send(pids, signal.SIGCONT))

    return strike


def _freeze_pool_process(plant: Plant, random: Random) -> Struck:
    pids = [pid for worker in WORKERS for pid in plant.pool_of(worker)]
    if not pids:
        return Struck("")
    pid = random.choice(pids)
    send([pid], signal.SIGSTOP)
    return Struck(str(pid), lambda: send([pid], signal.SIGCONT))


def _empty_broker(plant: Plant, random: Random) -> Struck:
    with contextlib.suppress(Exception):  # it may be dead at this moment, which empties it too
        plant.broker.empty()
        return Struck("broker")
    return Struck("")


def _cut_connections(plant: Plant, random: Random) -> Struck:
    try:
        with psycopg.connect(f"host={plant.postgres.folder} user=postgres dbname=postgres", connect_timeout=2) as one:
            cut = one.execute(
                "SELECT count(pg_terminate_backend(pid)) FROM pg_stat_activity WHERE datname = 'campaign'"
            ).fetchone()
    except psycopg.OperationalError:
        return Struck("")
    return Struck(f"{cut[0] if cut else 0} connections")


def _store_away(plant: Plant, random: Random) -> Struck:
    """S3 hangs, or nobody may read or write the folder of the blobs."""
    if plant.s3:
        plant.s3.pause()
        return Struck("S3", plant.s3.resume)
    blobs = plant.folder / "blobs"
    blobs.chmod(0)
    return Struck("blobs", lambda: blobs.chmod(0o700))


def _fill_disk(plant: Plant, random: Random) -> Struck:
    filler = plant.folder / "filler"
    if filler.exists():
        return Struck("")
    descriptor = os.open(filler, os.O_WRONLY | os.O_CREAT)
    free = shutil.disk_usage(plant.folder).free
    try:
        os.posix_fallocate(descriptor, 0, free)
    except OSError:  # somebody wrote meanwhile; tmpfs gives back what it could not give whole
        with contextlib.suppress(OSError):
            os.posix_fallocate(descriptor, 0, max(free - (1 << 20), 1))
    finally:
        os.close(descriptor)
    return Struck(f"{free} bytes", lambda: filler.unlink(missing_ok=True))


def _second_sweeper(plant: Plant, random: Random) -> Struck:
    """Start another one, as happens by mistake."""
    sweeper = plant.launch("sweeper")
    return Struck("sweeper", lambda: stop(sweeper, signal.SIGKILL))


def _vanish(name: str) -> Strike:
    """A host's packets are lost, and nobody is told; later it is there again as it was."""

    def strike(plant: Plant, random: Random) -> Struck:
        host = plant.hosts[name]
        if host.vanished:
            return Struck("")
        host.vanish()
        return Struck(name, host.come_back)

    return strike


# Longer than a lease of the plant, which is 2 s.
_FROZEN_S = (2.5, 5.0)
# Some of it longer than a connection waits for a sign of life, which is 5 s.
_VANISHED_S = (3.0, 9.0)
# What happens to whole hosts, or to all that runs on them.
OF_HOSTS = frozenset(
    (
        *("api_killed", "worker_killed", "sweeper_killed", "broker_killed", "database_killed"),
        *("worker_frozen", "broker_frozen", "database_frozen", *(f"{name}_host_vanished" for name in HOSTS)),
    )
)
NEED_A_NETWORK = frozenset(f"{name}_host_vanished" for name in HOSTS)

KINDS: dict[str, Kind] = {
    "api_killed": Kind(_kill(["api"]), 2),
    "worker_killed": Kind(_end_worker(signal.SIGKILL), 2),
    "worker_told_to_stop": Kind(_end_worker(signal.SIGTERM)),
    "pool_process_killed": Kind(_kill_pool_process, 4),
    "reader_killed": Kind(_kill_reader),
    "sweeper_killed": Kind(_kill(["sweeper"])),
    "broker_killed": Kind(_kill(["broker"])),
    "broker_emptied": Kind(_empty_broker, 2),
    "database_killed": Kind(_kill(["postgres"])),
    "database_process_killed": Kind(_kill_database_process),
    "connections_cut": Kind(_cut_connections, 2),
    "api_frozen": Kind(_freeze(["api"]), 1, _FROZEN_S),
    "worker_frozen": Kind(_freeze(WORKERS, whole=True), 1, _FROZEN_S),
    "pool_process_frozen": Kind(_freeze_pool_process, 2, _FROZEN_S),
    "sweeper_frozen": Kind(_freeze(["sweeper"]), 1, _FROZEN_S),
    "broker_frozen": Kind(_freeze(["broker"]), 1, _FROZEN_S),
    "database_frozen": Kind(_freeze(["postgres"], whole=True), 1, _FROZEN_S),
    "store_away": Kind(_store_away, 2, (1.0, 6.0)),
    "disk_full": Kind(_fill_disk, 2, (1.0, 6.0)),
    "two_sweepers": Kind(_second_sweeper, 1, (2.0, 6.0)),
    **{f"{name}_host_vanished": Kind(_vanish(name), 1, _VANISHED_S) for name in HOSTS},
}
