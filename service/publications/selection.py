"""A request's selection among a vehicle's calibrations: cameras, alias, moment, and mounted sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Annotated, NamedTuple

from fastapi import Depends, Query
from pydantic import AwareDatetime

from apexcal.documents.base import Sought
from apexcal.documents.publications import CURRENT, AliasName
from service.platform.http.problems import unprocessable


class Selection(NamedTuple):
    """Part of what a vehicle is given. No ``cameras``: all of them.

    ``mounted`` are serial numbers that the client read off its sensors: by the camera's name, or ``lidar``.
    """

    cameras: Sequence[str] = ()
    alias: str = CURRENT
    as_of: datetime | None = None
    mounted: Mapping[str, str] = {}


_ALIAS = "`current`, or another alias of the cameras, such as `canary`"
_AS_OF = "a moment in the past"
_SERIAL = "`NAME=SERIAL`, as read off the mounted sensor; NAME is a camera or `lidar`"

AliasQuery = Annotated[AliasName, Query(description=_ALIAS)]
MomentQuery = Annotated[AwareDatetime | None, Query(description=_AS_OF)]
SerialQuery = Annotated[list[Sought] | None, Query(max_length=64, description=_SERIAL)]
CameraQuery = Annotated[list[Sought] | None, Query(max_length=64, description="only these cameras; by default all")]


async def _of_all(
    camera: CameraQuery = None, alias: AliasQuery = CURRENT, as_of: MomentQuery = None, serial: SerialQuery = None
) -> Selection:
    return Selection(sorted(set(camera or [])), alias, as_of, _mounted(serial or []))


async def _of_one(alias: AliasQuery = CURRENT, as_of: MomentQuery = None, serial: SerialQuery = None) -> Selection:
    return Selection((), alias, as_of, _mounted(serial or []))


VehicleSelection = Annotated[Selection, Depends(_of_all)]
CameraSelection = Annotated[Selection, Depends(_of_one)]


def _mounted(serials: Sequence[str]) -> Mapping[str, str]:
    """Serial numbers by sensor. Raises :class:`Problem` 422 ``invalid_serial``."""
    mounted: dict[str, str] = {}
    for text in serials:
        name, equals, serial = text.partition("=")
        if not (name and equals and serial) or mounted.get(name, serial) != serial:
            raise unprocessable(
                "invalid_serial",
                f"`serial` is {text!r}, which is not one sensor and its serial number.",
                "Write front=SN123 for the camera `front`, and lidar=SN456 for the LiDAR.",
            )
        mounted[name] = serial
    return mounted
