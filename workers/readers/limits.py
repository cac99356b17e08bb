"""Limits of the reading of one upload: memory, time, and disk."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of one ingestion.

    Attributes:
        memory_bytes: address space; the libraries alone take about 0.4 GB of it.
        cpu_s: processor seconds.
        wall_s: seconds by the clock.
        silence_s: seconds without a sign of progress.
        file_bytes: the largest file that may be written.
        output_ratio: bytes written for each byte of the recording. Unpacking counts, and so does what is removed
            again. Of the real recordings a bag of a VLP-32's packets takes most, 4.3, and most others about 1; a
            compressed tar of it would take 6.3. The default is three times that.
        video_ratio: the same where video is decoded. A still scene of 1920 x 1208 pixels takes 8 kB a frame as H.264
            (CRF 23) and 0.82 MB as JPEG, 104 times as much. The default is three times that.
        output_floor_bytes: what any recording may write besides.
        reserve_bytes: what stays free on the disk.
    """

    memory_bytes: int = 3 * 1024**3
    cpu_s: int = 3600
    wall_s: float = 3600.0
    silence_s: float = 60.0
    file_bytes: int = 64 * 1024**3
    output_ratio: float = 20.0
    video_ratio: float = 300.0
    output_floor_bytes: int = 16 * 1024**2
    reserve_bytes: int = 0

    def output_bytes(self, recording_bytes: int, *, video: bool) -> int:
        """Return how many bytes the reading of a recording of this size may write."""
        return self.output_floor_bytes + int((self.video_ratio if video else self.output_ratio) * recording_bytes)
