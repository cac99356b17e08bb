"""``python -m benchmarks.campaign``: the campaign as a command; it ends with one line of JSON."""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from random import Random, SystemRandom

from benchmarks.campaign.campaign import Campaign, Size
from benchmarks.campaign.isolation import let_modes_bind_children, small_file_system
from tests.support.networks import Network, why_not

_MIB = 1024 * 1024
_DISK_BYTES = 768 * _MIB
_SCALE_S = 600.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run it. Returns 0 where every promise was kept, else 1."""
    options = _options(arguments)
    print(f"seed {options.seed}, {options.seconds:g} s", file=sys.stderr, flush=True)
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="apexcal-faults-", ignore_cleanup_errors=True) as folder:
        root = Path(folder)
        data, logs = root / "data", root / "logs"
        data.mkdir()
        logs.mkdir()
        own_disk = small_file_system(data, _DISK_BYTES)
        network = _network()
        if options.hosts and network is None:
            return 1
        let_modes_bind_children()
        campaign = Campaign(
            data,
            logs,
            Random(options.seed),
            size_of(options.seconds),
            own_disk=own_disk,
            s3=options.hosts or options.store == "s3",
            network=network,
            of_hosts=options.hosts,
        )
        try:
            findings = campaign.run()
        finally:
            campaign.close()
            if options.keep_logs:
                _keep(logs, options.keep_logs)
    for name, sentences in findings.by_kind().items():
        for sentence in sentences:
            print(f"{name}: {sentence}", file=sys.stderr)
    counts = {name: len(sentences) for name, sentences in findings.by_kind().items()}
    seconds = round(time.monotonic() - began, 1)
    print(json.dumps({**campaign.facts(), **counts, "seconds": seconds, "seed": options.seed}))
    return 1 if any(counts.values()) else 0


def _network() -> Network | None:
    """Hosts for the campaign, where they can be made."""
    reason = why_not()
    if reason:
        print(f"no host vanishes in this campaign: {reason}", file=sys.stderr, flush=True)
        return None
    return Network()


def size_of(seconds: float) -> Size:
    """200 calibrations, 20 uploads and 1,000 marks in ten minutes or more; fewer in less."""
    share = min(seconds / _SCALE_S, 1.0)
    return Size(
        seconds=seconds,
        fault_every_s=2.5 if seconds >= 60 else 1.2,
        calibrations=max(round(200 * share), 6),
        uploads=max(round(20 * share), 2),
        marks=max(round(1000 * share), 20),
        walks=2 if seconds >= 60 else 1,
    )


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.campaign", description=__doc__)
    parser.add_argument("--seconds", type=float, default=_SCALE_S, help="how long faults strike")
    parser.add_argument("--seed", type=int, default=None, help="of the schedule; another one each time by default")
    parser.add_argument("--store", choices=("folder", "s3"), default="folder", help="where blobs are")
    parser.add_argument("--hosts", action="store_true", help="the faults of hosts alone, on seven of them, with S3")
    parser.add_argument("--keep-logs", type=Path, default=None, metavar="DIR", help="copy the processes' logs there")
    options = parser.parse_args(arguments)
    if options.seed is None:
        options.seed = SystemRandom().randrange(10**6)
    return options


def _keep(logs: Path, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for log in logs.glob("*.log"):
        (folder / log.name).write_bytes(log.read_bytes())


if __name__ == "__main__":
    sys.exit(main())
