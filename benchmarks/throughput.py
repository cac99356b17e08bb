"""Processor seconds in which a recording is read and searched for vertices.

A minute of a simulated VLP-16 that looks all round, as a capture of its packets, and a camera of 1280 x 720 at 15 Hz
as JPEG files. Ingestion runs as the product runs it, in a limited child, its start included; between its rounds the
same capture is decoded by velodyne-decoder alone, likewise in a process of its own. Detectors run over the first half
of the ingested LiDAR, after they have compiled.
"""

from __future__ import annotations

import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Final

import numpy as np

from apexcal.documents.detectors import DETECTORS
from apexcal.documents.simulation import SimulationOptions
from benchmarks.packets import packet_rig, write_capture
from workers.readers.limited import ingest_limited
from workers.readers.normalised.sensor_files import SweepFile
from workers.simulation.background import paint_background
from workers.simulation.render import Renderer, encode_jpeg
from workers.simulation.rig import START_NS
from workers.simulation.simulate import WALKER_REGION
from workers.vertices.detectors import detect_range
from workers.vertices.region import Region

_ROUNDS: Final = 3
_PAINTED: Final = 20
_WARM_SWEEPS: Final = 20
_BARE: Final = (
    "import sys, velodyne_decoder as v\n"
    "config = v.Config(model=v.Model.VLP16)\n"
    "print(sum(len(points) for _, points in v.read_pcap(sys.argv[1], config, as_pcl_structs=True)))\n"
)


def measure(seconds: float, seed: int) -> dict[str, float]:
    """The figures of a recording of that many seconds, at least 10."""
    with tempfile.TemporaryDirectory() as folder:
        source, out = Path(folder) / "recording", Path(folder) / "normalised"
        _write(source, SimulationOptions(seconds=seconds, seed=seed, sector_deg=180.0))
        figures = _ingestion(source, out)
        return figures | _detection(out / "lidar.sweeps")


def _write(folder: Path, options: SimulationOptions) -> None:
    """The recording; of its frames the first are painted, and then come again and again."""
    rig = packet_rig(options)
    (folder / "images" / "front").mkdir(parents=True)
    write_capture(rig, folder / "lidar.pcap")
    mounted = rig.cameras[0]
    renderer = Renderer(mounted.camera, rig.scene, paint_background(mounted.camera, rig.scene, options.seed))
    poses = rig.walk.poses((mounted.times_ns - START_NS).astype(np.float64) * 1e-9)
    painted = [encode_jpeg(renderer.frame(poses, index)) for index in range(_PAINTED)]
    lines = ["file,stamp_ns"]
    for number, stamp_ns in enumerate(mounted.stamps_ns.tolist()):
        lines.append(f"images/front/{number:06d}.jpg,{stamp_ns}")
        (folder / f"images/front/{number:06d}.jpg").write_bytes(painted[number % _PAINTED])
    (folder / "timestamps.csv").write_text("\n".join(lines) + "\n")


def _children_s() -> float:
    """Processor seconds of the children that have ended."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def _ingestion(source: Path, out: Path) -> dict[str, float]:
    cpu: list[float] = []
    bare: list[float] = []
    for _ in range(_ROUNDS):
        shutil.rmtree(out, ignore_errors=True)
        used = _children_s()
        ingest_limited(source, out, {"cameras": ["front"]})
        cpu.append(_children_s() - used)
        used = _children_s()
        subprocess.run([sys.executable, "-c", _BARE, str(source / "lidar.pcap")], check=True, capture_output=True)
        bare.append(_children_s() - used)
    return {"ingest_processor_s": min(cpu), "ingest_over_bare_decode": min(cpu) / min(bare)}


def _detection(lidar: Path) -> dict[str, float]:
    region = Region.from_document(WALKER_REGION)
    answer: dict[str, float] = {}
    with SweepFile(lidar) as file:
        for detector in DETECTORS:
            for shard in (range(_WARM_SWEEPS), range(len(file) // 2)):
                began = time.process_time()
                detect_range(file, region, detector, indices=shard)
                answer[f"{detector}_shard_processor_s"] = time.process_time() - began
    return answer
