"""Recordings as long as wanted, written in pieces, of bytes that cost little to make."""

import struct
import tarfile
from io import BytesIO
from itertools import chain

import numpy as np
from formats import pcd
from making_packets import datagram, packet_ns, packets
from making_recordings import (
    CLOUD,
    COMPRESSED,
    PERIOD_NS,
    START_NS,
    cloud,
    compressed,
    jpeg_claiming,
    scene,
    write_bag,
)
from pypcd4 import Encoding

FRAME_BYTES = 200_000
_TURN_PACKETS = 75


def frame(number):
    """What begins like a JPEG and is as long as one; no two are alike."""
    head = jpeg_claiming(1280, 720)
    return head[:-2] + struct.pack("<I", number) * ((FRAME_BYTES - len(head)) // 4) + head[-2:]


def long_bag(path, size):
    """Clouds and compressed frames, 10 a second each."""
    stamps = enumerate(START_NS + number * PERIOD_NS for number in range(size // (FRAME_BYTES + 32_000)))
    messages = (
        (("/points", CLOUD, at, cloud(at, scene())), ("/image", COMPRESSED, at, compressed(at, frame(number))))
        for number, at in stamps
    )
    return write_bag(path, chain.from_iterable(messages))


def long_pcap(path, size):
    """Packets of a VLP-16, 75 to the turn; a turn of packets is made once and sent with new stamps."""
    step = packet_ns()
    turn = [payload for _, payload in packets("vlp16", 1.1, hz=1e9 / (step * _TURN_PACKETS))][:_TURN_PACKETS]
    frames = np.array([np.frombuffer(bytes(16) + datagram(payload), np.uint8) for payload in turn])
    record = frames.shape[1]
    frames[:, 8:16] = np.frombuffer(struct.pack("<II", record - 16, record - 16), np.uint8)
    with path.open("wb") as file:
        file.write(struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 262_144, 1))
        for number in range(size // frames.nbytes):
            moments = START_NS + (number * _TURN_PACKETS + 1 + np.arange(_TURN_PACKETS)) * step
            stamps = np.stack([moments // 10**9, moments % 10**9 // 1000], axis=1).astype("<u4")
            device = ((moments - START_NS) // 1000 % 3_600_000_000).astype("<u4")
            frames[:, :8] = stamps.view(np.uint8)
            frames[:, -6:-2] = device.reshape(-1, 1).view(np.uint8)
            file.write(frames.tobytes())
    return path


def long_tar(path, size):
    """PCD files and images, their stamps in their names."""
    points = pcd(Encoding.BINARY)
    with tarfile.open(path, "w") as archive:
        for number in range(size // (FRAME_BYTES + len(points))):
            stamp = START_NS + number * PERIOD_NS
            for name, data in ((f"clouds/{stamp}.pcd", points), (f"images/{stamp}.jpg", frame(number))):
                entry = tarfile.TarInfo(name)
                entry.size = len(data)
                archive.addfile(entry, BytesIO(data))
    return path
