"""``apexcal marks``: the machine marks the board's corners in the frames."""

from __future__ import annotations

from collections.abc import Sequence

from rich.table import Table

from apexcal.commands.camera_files import state_lenses
from apexcal.commands.named import find_camera, find_detection
from apexcal.commands.options import CameraOption, DetectionArgument, IntrinsicsOption
from apexcal.commands.session import Reply, Session
from apexcal.documents.detections import DetectionView
from apexcal.documents.machine_marks import MachineMark, MarksFacts, MarksView


def marks(
    session: Session, detection: DetectionArgument, camera: CameraOption = "", intrinsics: IntrinsicsOption = None
) -> Reply:
    """Have the machine mark a detection's corners in a camera's frames, or read its marks if it has.

    `apexcal calibrate --detection DETECTION --machine-marks` uses them. With --intrinsics it marks again.
    """
    client = session.client
    of = find_detection(client, detection)
    recording = client.recordings.get(of.recording_id)
    name = find_camera([client.vehicles.rig(recording.rig_id)], camera)
    if intrinsics:
        state_lenses(client, recording, intrinsics, None)
    return marks_of(session, of, name, again=bool(intrinsics))


def marks_of(session: Session, of: DetectionView, camera: str, *, again: bool) -> Reply:
    """The machine's newest marks of a detection in a camera; where there are none, or with ``again``, new ones."""
    client = session.client
    analyses = () if again else client.analyses.list(MarksView, recording_id=of.recording_id)
    analysis = next((each for each in analyses if (each.detection_id, each.camera) == (of.id, camera)), None)
    if analysis is None or analysis.state in ("failed", "cancelled"):
        analysis = client.analyses.mark(of.id, camera)
    view = session.wait(analysis, "Marking")
    assert view.result is not None
    answers = client.analyses.marks(view.id)
    document = {"analysis": view, "marks": answers}
    sentence = _sentence(view.result, camera)
    return Reply(document, sentence if session.as_json else [_table(answers), sentence])


def _sentence(facts: MarksFacts, camera: str) -> str:
    if facts.refusal:
        return f"The machine cannot mark camera {camera}. {facts.refusal}"
    others = "".join(f"\n  {count}: {reason.replace('_', ' ')}" for reason, count in facts.reasons.items())
    sigma = f", with standard deviations about {facts.sigma_px:.2f} px" if facts.sigma_px else ""
    marked = f"The machine marked {facts.marked} of {facts.corners} corners in camera {camera}{sigma}.{others}"
    if facts.warning:
        marked = f"{marked}\n{facts.warning}"
    if facts.clock_offset_ms is None:
        return marked
    ms = f"{facts.clock_offset_ms:.0f}"
    return f"{marked}\nThe camera's clock is {ms} ms ahead of the LiDAR's: detect again with --offset-ms {ms}."


def _table(answers: Sequence[MachineMark]) -> Table:
    table = Table("vertex", "corner", "u", "v", "sigma u", "sigma v", "why not")
    for mark in answers:
        values = (mark.u, mark.v, mark.sigma_u, mark.sigma_v)
        numbers = [f"{value:.2f}" if value is not None else "" for value in values]
        places = " or ".join(f"({spot.u:.1f}, {spot.v:.1f})" for spot in mark.places)
        why = f"{(mark.reason or '').replace('_', ' ')} {places}".strip()
        table.add_row(str(mark.vertex_id), mark.corner, *numbers, why)
    return table
