"""What all pairs of a camera may have in common: as the request says, or as its vertices' detector is known for."""

from __future__ import annotations

from apexcal.documents.pairs import SIGMAS
from service.db.base import Json
from service.db.calibrations import CorrespondenceSet

# Mean elevation error of a recording's vertices, the largest that was measured (docs/decisions/0008): of the refined
# detector with the board's size open, and of the ring rules, which state no deviations and place the apex low.
_ELEVATION_DEG = {"refined": 0.01, "ring_rules": 0.1}


def common_errors(pairs: CorrespondenceSet, asked: Json) -> Json:
    """The member of the solver's document that says so; nothing where nothing is known.

    ``asked`` are the deviations that the request gives. Of pairs that were brought nothing is known.
    """
    known: Json = {}
    if pairs.source == "annotations":
        refined = all(name in pairs.pairs for name in SIGMAS)
        known["elevation_deg"] = _ELEVATION_DEG["refined" if refined else "ring_rules"]
    stated = {name: value for name, value in (known | asked).items() if value}
    return {"common_errors": stated} if stated else {}
