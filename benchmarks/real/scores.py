"""What became of a run, against what the publisher of the recording states."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import cv2
import numpy as np

from apexcal.client import Client
from apexcal.documents.machine_marks import MachineMark, MarksView
from apexcal.geometry.rotations import vector_from_rotation
from benchmarks.detection.real import DIAMOND, WRONG_POSE, Floats, judge, published
from benchmarks.real.forms import LENS_OF, Case

_NEAR_PX: Final = 2.0
_DEVIATIONS: Final = 3.0
_MOUNT: Final = ("rotation_x", "rotation_y", "rotation_z", "t_x", "t_y", "t_z")
_CORNERS: Final = ("top", "left", "right", "bottom")


class Outcome(NamedTuple):
    """A row of the table. ``marks`` holds counts: offered, within 2 px, within 3 deviations, of judged ones."""

    case: Case
    vertices: str
    marks: str
    verdict: str
    is_written: bool
    mount: str
    why: str
    seconds: float

    @property
    def line(self) -> str:
        """All of it in a line."""
        file = "file" if self.is_written else "no file"
        return (
            f"{self.case.title:46} {self.vertices:16} {self.marks:36} {self.verdict:32} {file:8} {self.mount:62} "
            f"{self.seconds:4.0f} s  {self.why}"
        )


def outcome(
    case: Case, client: Client, document: dict[str, Any] | None, said: str, *, is_written: bool, seconds: float
) -> Outcome:
    """Read a run's vertices and marks from the service, and judge them."""
    name = f"{case.title}{'.bag' if case.form == 'bag' else ''}"
    recording = next((each for each in client.recordings.list() if each.name == name), None)
    detection = next(iter(client.detections.list(recording.id)), None) if recording else None
    vertices, marks = "none", ""
    if recording and detection:
        listed = list(client.detections.vertices(detection.id))
        true = judge(case.recording)
        off = [1e3 * float(np.linalg.norm(np.array([v.x, v.y, v.z]) - true[v.sweep_index])) for v in listed]
        vertices = f"{len(off)}/{len(true)} {np.median(off):.0f}/{max(off):.0f} mm" if off else "0"
        analysis = next(iter(client.analyses.list(MarksView, recording_id=recording.id)), None)
        if analysis and analysis.result:
            frame_of = {v.id: v.sweep_index for v in listed}
            marks = _marks(case, client.analyses.marks(analysis.id), frame_of) if analysis.result.marked else "0"
    verdict, mount, why = "-", "", " ".join(said.rpartition("apexcal: ")[2].split())[:400]
    if document:
        (summary,) = document["summary"]["cameras"].values()
        model = summary["models"].get(summary["recommended"] or "")
        verdict = f"{summary['recommended']}, {model['lens'] if model else ''}: {model['verdict'] if model else ''}"
        why = "; ".join(f"{c['verdict']} {c['name']}" for c in summary["checks"] if c["verdict"] != "pass")
        if model:
            result = client.calibrations.result(model["result_id"])
            alone = next(check["figures"] for check in summary["checks"] if check["name"] == "mount_alone")
            stated = f"(95 %: {alone['half_width_deg'] or 0:.2f} deg {alone['half_width_mm'] or 0:.0f} mm)"
            mount = f"{_apart(case, result.model_dump(mode='json'))} {stated}".strip()
    return Outcome(case, vertices, marks, verdict, is_written, mount, why, seconds)


def _marks(case: Case, marks: Any, frame_of: dict[Any, int]) -> str:
    offered: list[MachineMark] = [mark for mark in marks if mark.u is not None]
    if case.recording != DIAMOND:
        return f"{len(offered)}/{len(marks)}"
    poses = published()
    near = scaled = judged = 0
    frame = WRONG_POSE
    for mark in marks:
        frame = frame_of.get(mark.vertex_id, frame)  # the other corners of a sweep follow its tip
        if frame == WRONG_POSE or mark.u is None or mark.sigma_u is None or mark.sigma_v is None:
            continue
        off = np.array([mark.u, mark.v]) - poses[frame][mark.corner].uv
        judged += 1
        near += float(np.hypot(*off)) <= _NEAR_PX
        scaled += bool(np.all(np.abs(off) <= _DEVIATIONS * np.array([mark.sigma_u, mark.sigma_v])))
    return f"{len(offered)}/{len(marks)}, 2 px {near}/{judged}, 3 s {scaled}/{judged}"


def _apart(case: Case, result: dict[str, Any]) -> str:
    """How far the mount is from that of the published corners under the published lens, in degrees and mm.

    With it goes the widest of the six distances along the camera's axes in half widths of its 95 % interval: one of
    six independent ones exceeds 1 in a quarter of sound results, 1.35 in one of twenty.
    """
    if case.recording != DIAMOND:
        return ""
    lens = LENS_OF[case.recording].intrinsics
    K = np.array([[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1]])
    labels = [pose[name] for k, pose in enumerate(published()) if k != WRONG_POSE for name in _CORNERS]
    points, pixels = np.array([each.xyz for each in labels]), np.array([each.uv for each in labels])
    rays = cv2.fisheye.undistortPoints(pixels[:, None], K, lens[4:8])
    _, turn, shift = cv2.solvePnP(points, rays, np.eye(3), np.zeros(0), flags=cv2.SOLVEPNP_SQPNP)
    R, t = np.asarray(cv2.Rodrigues(turn)[0]), np.asarray(shift).ravel()
    T = result["transform"]
    own_R, own_t = np.reshape(T["rotation"]["matrix"], (3, 3)), np.array(T["translation_m"])
    rotation: Floats = vector_from_rotation(own_R @ R.T)
    off = dict(zip(_MOUNT, [*np.degrees(rotation), *(own_t - t)], strict=True))
    half_widths = result["interval95_half_width"]
    widest = max((abs(off[axis]) / half for axis in _MOUNT if (half := half_widths.get(axis))), default=np.nan)
    apart_mm = 1e3 * np.linalg.norm(own_R.T @ own_t - R.T @ t)
    return f"{np.degrees(np.linalg.norm(rotation)):.2f} deg {apart_mm:.0f} mm, {widest:.2f} of its interval"
