"""What a camera's pairs state of their errors: what they weigh by, and the errors that all of them share."""

from __future__ import annotations

from sqlalchemy import select
from sqlalchemy.orm import object_session

from apexcal.documents.pairs import CLOCK_SIGMA, CORNER, MARK_SIGMA, SIGMAS, VELOCITY, states_errors, tells_motion
from apexcal.documents.person_bias import person_px
from apexcal.documents.rules import WeightRule, Weights
from service.platform.db.base import Json
from service.platform.db.calibrations import CorrespondenceSet
from service.platform.db.detections import Detection
from service.platform.http.problems import unprocessable

# Mean elevation error of a recording's vertices, the largest that was measured (docs/decisions/0008): of the refined
# detector with the board's size open, and of the ring rules, which state no deviations and place the apex low.
_ELEVATION_DEG = {"refined": 0.01, "ring_rules": 0.1}
# Of a recording's board and LiDAR. Its edges lie off by 3.5 mm (EN 315), which moves the tip alike along both axes of
# its plane. A tip is worn by anything up to 8 mm: 4.6 mm about none (JCGM 100:2008, 4.3.7). A range is right to 30 mm
# (data sheet of the VLP-16).
_BOARD_MM = {"tip_across_mm": 3.5, "tip_up_mm": 5.8, "range_mm": 17.3}
# An upper corner of level edges is worn along its diagonal, half of the variance along each axis.
_UPPER_CORNER_MM = {"tip_across_mm": 4.8, "tip_up_mm": 4.8}
# Of a recording's poses with several corners: a corner is out by both of its edges. The rings' ranges, each right to
# 30 mm, tilt a board of 0.8 m by this: eight rings of 17.3 mm, 0.23 m about their middle (root mean square).
_POSES = {"corners_out_mm": 5.0, "tilt_up_deg": 1.5, "tilt_across_deg": 1.5}
# A habit of aiming anywhere within the pixel that shows the corner, alike likely: half a pixel over the root of three
# (JCGM 100:2008, 4.3.7).
_PERSON_PX = 0.289
# Whom nobody and nothing contradicts may be worse: on good targets an operator is accurate to one to three pixels
# (PhotoModeler's manual, "Sub-pixel target marking"); the least of it, in each coordinate.
_ALONE_PX = 1.0


def weighing(camera: str, pairs: Json, rule: WeightRule) -> Weights:
    """What the pairs weigh by; the workers make weights of it. ``pairs``: a set's columns, each for all its pairs.

    Raises:
        Problem: 422 ``no_covariances``, weights by covariances are asked for and the pairs state none.
    """
    if states_errors(pairs):
        return "equal" if rule == "equal" else "covariances"
    if rule == "covariances":
        raise unprocessable(
            "no_covariances",
            f"The pairs of {camera} state no standard deviations that they could weigh by.",
            f"Detect with `refined`, import the columns {', '.join(SIGMAS)} or {MARK_SIGMA}, or leave the choice of "
            "weights out (weights: covariances; --weights covariances).",
            camera=camera,
        )
    return "equal"


def weighing_note(camera: str, weights: Weights) -> list[str]:
    """A sentence where the pairs weigh by their errors."""
    if weights == "equal":
        return []
    return [f"{camera}: pairs weigh by the standard deviations that they state (weights: equal counts all alike)."]


def common_errors(pairs: CorrespondenceSet, deviations: Json) -> Json:
    """Standard deviations by name; empty if nothing is known.

    ``deviations`` are the deviations that the request gives. Nothing is known of imported pairs.

    Raises:
        Problem: 422 ``no_motion`` if a deviation in time is asked for and the pairs do not tell how the corner moved.
    """
    _check_motion(pairs, deviations)
    defaults: Json = {}
    if pairs.source == "annotations":
        refined = all(name in pairs.columns for name in SIGMAS)
        defaults["elevation_deg"] = _ELEVATION_DEG["refined" if refined else "ring_rules"]
        defaults |= _BOARD_MM | (_UPPER_CORNER_MM if _is_upper(pairs) else {})
        defaults |= _POSES if "group" in pairs.columns else {}
        defaults["person_px"] = person_px(pairs.columns, _PERSON_PX, _ALONE_PX)
        if CLOCK_SIGMA in pairs.columns and "stamp_ns" in pairs.columns:
            defaults["clock_ms"] = pairs.columns[CLOCK_SIGMA][0]
    return {name: value for name, value in (defaults | deviations).items() if value}


def _is_upper(pairs: CorrespondenceSet) -> bool:
    """Whether the pairs are of an upper corner of a board with level edges."""
    session = object_session(pairs)
    if session is None or pairs.detection_id is None:
        return False
    options = session.scalar(select(Detection.options).where(Detection.id == pairs.detection_id))
    return bool((options or {}).get("upper_corner"))


def _check_motion(pairs: CorrespondenceSet, deviations: Json) -> None:
    # Pairs that state the clocks' deviation themselves are solved without it if the board stood still.
    names = ["line_time_us"] if CLOCK_SIGMA in pairs.columns else ["clock_ms", "line_time_us"]
    in_time = [name for name in names if deviations.get(name)]
    tells = VELOCITY in pairs.columns or tells_motion(pairs.columns.get("stamp_ns") or [], pairs.columns.get(CORNER))
    if in_time and not tells:
        raise unprocessable(
            "no_motion",
            f"The pairs of {pairs.camera} do not say how the corner moved, so nothing follows from {in_time[0]}.",
            f"Give stamp_ns of pairs from a walk, or leave {' and '.join(in_time)} out of common_errors.",
        )
