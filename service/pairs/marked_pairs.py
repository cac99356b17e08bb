"""Builds pairs from marks, with sentences about vertices that gave none or fewer marks than wanted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.corners import TOP
from apexcal.documents.pairs import (
    CLOCK_SIGMA,
    CONFIRMED,
    CORNER,
    MACHINE,
    MACHINE_OFF,
    MARK_SIGMA,
    MARKED_BY,
    SIGMAS,
    VELOCITY,
)
from service.annotations.consensus import Consensus, ConsensusOutcome, Opinion, agree, combine, far_apart_px
from service.annotations.tally_queries import opinions_of
from service.crops.queries import blind_opinions
from service.pairs.machine_opinions import MachineOpinion, machine_opinions
from service.pairs.pair_files import Columns
from service.platform.db.analyses import Analysis
from service.platform.db.detections import Detection, Vertex, VertexFrame, marked_corners
from service.platform.db.fleets import RigCamera
from service.platform.db.recordings import Recording, Sensor
from service.platform.http.problems import conflict

# A walker's board moves by a millimetre in this time.
_STILL_NS = 1_000_000


@dataclass(frozen=True)
class Built:
    """Pairs as columns, and what is to be said about them."""

    columns: Columns
    notes: list[str]


def build(
    session: Session, detection: Detection, camera: Sensor, *, exclude_flagged: bool, machine_marks: bool = False
) -> Built:
    """The pairs of a detection's vertices in one camera, ordered by time.

    x, y, z is where the vertex was at the frame's time, where the pairing interpolated. Columns besides x y z u v:
    stamp_ns (of the vertex as it was measured), gap_ns (frame minus vertex), sweep_index, frame_index, marks (how
    many independent ones), spread_px (of these), flagged (as many rejections as confirmations), reviewed (how many
    answers were given after something of others' was told; where there are such), marked_by (the people's numbers,
    from 0), machine (nobody but the machine marked it; where there are such), confirmed (how many people accepted
    that mark after they saw it), sigma_px (of such a mark, else None), machine_off_px (the machine's mark minus
    people's blind ones, where there are both), sigma_clock_ms (of the clocks' offset, if it was estimated),
    velocity_m_s (of the corner, by the detection's vertices near in time, if these are of a moving board), and
    sigma_azimuth_rad, sigma_elevation_rad, sigma_range_m where all vertices state a covariance. Where pairs are of
    other corners than the tip: corner, and group, because the corners of one sweep err together.

    Raises:
        Problem: 409 ``nothing_marked``.
    """
    per_vertex = session.get_one(Recording, detection.recording_id).marks_per_vertex
    opinions = opinions_of(session, detection.id, camera.id)
    machine = machine_opinions(session, detection.id, camera, opinions)
    of_machine = {vertex_id: _of_machine(mark, opinions.get(vertex_id, [])) for vertex_id, mark in machine.items()}
    for vertex_id, mark in machine.items():
        if machine_marks and not mark.confirmations:
            opinions.setdefault(vertex_id, []).append(mark.opinion)
    everything = session.execute(
        select(Vertex, VertexFrame)
        .join(VertexFrame, VertexFrame.vertex_id == Vertex.id)
        .where(Vertex.detection_id == detection.id, VertexFrame.sensor_id == camera.id)
        .order_by(Vertex.time_ns, Vertex.sweep_index, Vertex.corner.desc(), Vertex.x, Vertex.y, Vertex.z)
    ).all()
    # What was marked counts also if its corner is no longer asked for.
    corners = marked_corners(detection)
    vertices = [(vertex, frame) for vertex, frame in everything if vertex.corner in corners or vertex.id in opinions]
    apart_px = _apart_px(session, detection, camera)
    consensus = {vertex.id: agree(opinions.get(vertex.id, []), apart_px) for vertex, _ in vertices}
    corners_used = {vertex.corner for vertex, _ in vertices}
    velocities = _velocities([vertex for vertex, _ in everything if vertex.corner in corners_used])
    rows: list[dict[str, Any]] = [
        _row(vertex, frame, consensus[vertex.id])
        | ({VELOCITY: velocities[vertex.id]} if velocities else {})
        | {MARKED_BY: _markers(opinions[vertex.id])}
        | of_machine.get(vertex.id, _NOT_OF_MACHINE)
        for vertex, frame in vertices
        if consensus[vertex.id].pixel
        and not (exclude_flagged and consensus[vertex.id].outcome is ConsensusOutcome.TIED)
    ]
    if not rows:
        raise conflict(
            "nothing_marked",
            f"No corner of camera {camera.name} is marked yet ({len(vertices)} have a frame).",
            "Mark corners, or confirm the machine's marks, on the recording's page; or take these unseen "
            "(machine_marks; --machine-marks).",
        )
    # A column is for all pairs or for none.
    common = [name for name in rows[0] if all(name in row for row in rows)]
    if not any(row["reviewed"] for row in rows):
        common.remove("reviewed")
    of_any = any(row[MACHINE] for row in rows)
    for name, nothing in _NOT_OF_MACHINE.items():
        if not of_any or all(row[name] == nothing for row in rows):
            common.remove(name)
    columns = {name: [row[name] for row in rows] for name in common}
    columns[MARKED_BY] = _numbered(columns[MARKED_BY])
    if set(columns[CORNER]) == {TOP}:
        del columns[CORNER]
    if len(set(columns["sweep_index"])) < len(rows):
        columns["group"] = columns["sweep_index"]
    clock_ms = _clock_sigma_ms(session, detection, camera)
    if clock_ms is not None:
        columns[CLOCK_SIGMA] = [clock_ms] * len(rows)
    notes = _notes(consensus, per_vertex, apart_px, exclude_flagged=exclude_flagged)
    if MACHINE in columns:
        confirmed = sum(count > 0 for count in columns.get(CONFIRMED, ()))
        of_these = f"; people looked at {confirmed} of these" if confirmed else ""
        notes.append(f"{sum(columns[MACHINE])} of {len(rows)} marks are the machine's{of_these}.")
    return Built(columns, [*notes, *_pairing_note(detection, columns), *_clock_notes(session, detection)])


_NOT_OF_MACHINE: dict[str, Any] = {MACHINE: False, CONFIRMED: 0, MARK_SIGMA: None, MACHINE_OFF: None}


def _of_machine(mark: MachineOpinion, of_people: list[Opinion]) -> dict[str, Any]:
    """The columns of a pair that has a mark of the machine; ``of_people``: all opinions of its vertex."""
    columns = dict(_NOT_OF_MACHINE)
    if not any(opinion.mark for opinion in of_people if not opinion.machine):
        columns |= {MACHINE: True, CONFIRMED: mark.confirmations, MARK_SIGMA: mark.sigma_px}
    blind = [opinion.mark for opinion in blind_opinions(of_people) if opinion.mark]
    if blind and mark.opinion.mark:
        columns[MACHINE_OFF] = [a - b for a, b in zip(mark.opinion.mark, combine(blind), strict=True)]
    return columns


def _velocities(vertices: Sequence[Vertex]) -> dict[UUID, list[float]]:
    """Return the corner's velocity at each vertex's time, m/s in the LiDAR's frame; empty for still poses."""
    from apexcal.geometry.motion import velocities_of  # NumPy, which no other request for marks needs

    points = [[vertex.x, vertex.y, vertex.z] for vertex in vertices]
    moved = velocities_of(points, [vertex.time_ns for vertex in vertices], [vertex.corner for vertex in vertices])
    if moved is None:
        return {}
    return {vertex.id: each for vertex, each in zip(vertices, moved.tolist(), strict=True)}


def _markers(opinions: Sequence[Opinion]) -> list[UUID]:
    return sorted(
        opinion.person for opinion in opinions if opinion.person and opinion.verdict == "confirmed" and opinion.mark
    )


def _numbered(markers: Sequence[Sequence[UUID]]) -> list[list[int]]:
    """Numbers in the order of the first marks. A set holds no names."""
    number = {person: i for i, person in enumerate(dict.fromkeys(person for row in markers for person in row))}
    return [[number[person] for person in row] for row in markers]


def _clock_sigma_ms(session: Session, detection: Detection, camera: Sensor) -> float | None:
    """Return the deviation of the clock offset that this detection's pairing used; None if it used no estimate."""
    offset_ns = detection.pairing.get("offset_ns", 0)
    analyses = session.scalars(
        select(Analysis)
        .where(
            Analysis.recording_id == detection.recording_id,
            Analysis.kind == "clock_offset",
            Analysis.result.is_not(None),
        )
        .order_by(Analysis.created_at.desc())
    )
    return next(
        (
            analysis.result["sigma_ns"] / 1e6
            for analysis in analyses
            if analysis.result
            and analysis.result["offset_ns"] == offset_ns
            and analysis.asked["camera"] == camera.name
        ),
        None,
    )


def _apart_px(session: Session, detection: Detection, camera: Sensor) -> float:
    """Infinite if the rig no longer has the camera."""
    recording = session.get_one(Recording, detection.recording_id)
    of_rig = session.scalar(
        select(RigCamera).where(RigCamera.rig_id == recording.rig_id, RigCamera.name == camera.name)
    )
    return far_apart_px(of_rig.image_width, of_rig.image_height) if of_rig else math.inf


def _pairing_note(detection: Detection, columns: Columns) -> list[str]:
    """A sentence, if vertices of a walk were not moved to their frames' times."""
    gaps = sorted(abs(gap) for gap in columns["gap_ns"])
    if detection.pairing["mode"] != "nearest" or gaps[-1] < _STILL_NS:
        return []
    return [
        f"Vertices were paired with the nearest frame, up to {gaps[-1] / 1e6:.0f} ms away, and not moved to its "
        "time. If the board moved, detect again with pairing mode auto; marks stay valid."
    ]


def _clock_notes(session: Session, detection: Detection) -> list[str]:
    """A sentence for each sensor whose clock was set back while it recorded."""
    sensors = session.scalars(
        select(Sensor).where(Sensor.recording_id == detection.recording_id).order_by(Sensor.name)
    )
    jumps = {sensor.name: (sensor.facts or {}).get("jumps", []) for sensor in sensors}
    return [
        f"The clock of {name} was set back by {-jump['duration_ns'] / 1e9:.1f} s at {jump['after_ns'] / 1e9:.1f} s: "
        "before and after it the clocks of LiDAR and camera differ by different amounts, so only the pairs of one "
        "part belong together."
        for name, of_sensor in jumps.items()
        for jump in of_sensor
        if jump["duration_ns"] < 0
    ]


def _row(vertex: Vertex, frame: VertexFrame, agreed: Consensus) -> dict[str, Any]:
    u, v = agreed.pixel or (0.0, 0.0)
    at = vertex if frame.x is None else frame
    return {
        "x": at.x,
        "y": at.y,
        "z": at.z,
        "u": u,
        "v": v,
        "stamp_ns": vertex.time_ns,
        "gap_ns": frame.gap_ns,
        "sweep_index": vertex.sweep_index,
        "frame_index": frame.frame_index,
        "marks": agreed.marks,
        "spread_px": agreed.spread_px,
        "flagged": agreed.outcome is ConsensusOutcome.TIED,
        "reviewed": agreed.reviewed,
        CORNER: vertex.corner,
        **_sigmas(at.covariance),
    }


def _sigmas(covariance: list[list[float]] | None) -> dict[str, float]:
    """The standard deviations of a vertex by their columns; nothing where its detector states none."""
    if covariance is None:
        return {}
    return {name: math.sqrt(covariance[index][index]) for index, name in enumerate(SIGMAS)}


def _notes(consensus: dict[UUID, Consensus], per_vertex: int, apart_px: float, *, exclude_flagged: bool) -> list[str]:
    total = len(consensus)
    answered = [answer for answer in consensus.values() if answer.answers]
    few = sum(answer.answers - answer.reviewed < per_vertex for answer in answered)
    reviewed = sum(answer.reviewed > 0 for answer in answered)
    count = {outcome: sum(answer.outcome is outcome for answer in answered) for outcome in ConsensusOutcome}
    tied = "left out" if exclude_flagged else "kept and flagged"
    fewer = (
        f"have fewer than the {per_vertex} independent marks asked for"
        if per_vertex > 1
        else "have no independent mark"
    )
    sentences = {
        "are not marked, and left out": total - len(answered),
        fewer: few,
        "were marked or confirmed by people who had seen others' answers": reviewed,
        "are left out, because most people rejected them": count[ConsensusOutcome.REMOVED],
        f"have as many rejections as confirmations, and are {tied}": count[ConsensusOutcome.TIED],
        f"are left out, because two marks lie more than {apart_px:.0f} px apart; have them marked once more": (
            count[ConsensusOutcome.APART]
        ),
        "are left out, because people were unsure of them": count[ConsensusOutcome.UNMARKED],
    }
    return [f"{n} of {total} corners {words}." for words, n in sentences.items() if n]
