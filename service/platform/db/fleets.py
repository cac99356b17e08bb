"""Fleets, their vehicles, and the rigs that the vehicles carry."""

from __future__ import annotations

import re
from typing import Any
from uuid import UUID

from sqlalchemy import BigInteger, Index, String, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column, relationship, validates

from service.platform.db.base import Bytes, Dated, Json, Name, Row, Version, belongs_to


class Fleet(Dated):
    """A fleet, to which roles are bound. Every row below belongs to exactly one fleet.

    ``quota_bytes`` is what it may take; None: what the settings say. ``row_bytes`` is what its rows took when they
    were counted last, and what was added since. ``retention`` has the days
    after which each layer of its recordings, and its imported pairs, go. ``policy`` says what its results
    must show to be published.
    """

    name: Mapped[Name] = mapped_column(unique=True)
    quota_bytes: Mapped[int | None] = mapped_column(BigInteger)
    row_bytes: Mapped[Bytes] = mapped_column(default=0)
    policy: Mapped[Json | None]
    retention: Mapped[Json | None]
    version: Mapped[Version]


def natural_order(name: str) -> str:
    """Return a text by which names sort as people order them: numbers by their size, whatever the letters' case."""
    return re.sub("[0-9]+", lambda digits: digits[0].lstrip("0").zfill(10), name.casefold())[:200]


class Vehicle(Dated):
    """One vehicle of a fleet. ``sort_name`` follows from its name: lists are sorted by it."""

    __table_args__ = (UniqueConstraint("fleet_id", "name"), Index("ix_vehicle_fleet_id_id", "fleet_id", "id"))

    fleet_id: Mapped[UUID] = belongs_to("fleet.id")
    name: Mapped[Name]
    sort_name: Mapped[Name]
    version: Mapped[Version]

    @validates("name")
    def _sorts_by_it(self, key: str, name: str) -> str:
        self.sort_name = natural_order(name)
        return name


class Rig(Dated):
    """One LiDAR and one or more cameras on a vehicle.

    ``camera_transforms`` are those between cameras that are known otherwise, with their standard deviations. Members
    of ``policy`` replace the fleet's.
    """

    __table_args__ = (UniqueConstraint("vehicle_id", "name"),)

    fleet_id: Mapped[UUID] = belongs_to("fleet.id")
    vehicle_id: Mapped[UUID] = belongs_to("vehicle.id")
    name: Mapped[Name]
    camera_transforms: Mapped[list[Any] | None]
    policy: Mapped[Json | None]
    version: Mapped[Version]
    lidars: Mapped[list[RigLidar]] = relationship(order_by="RigLidar.position", passive_deletes=True)
    cameras: Mapped[list[RigCamera]] = relationship(order_by="RigCamera.position", passive_deletes=True)

    @property
    def lidar(self) -> RigLidar:
        """Its LiDAR: a rig has one."""
        return self.lidars[0]


class RigLidar(Row):
    """The LiDAR of a rig; ``T_vehicle_lidar`` is a transform document or absent.

    Serial numbers, here and of cameras, are those of the mounted sensors, if known.
    """

    __table_args__ = (UniqueConstraint("rig_id", "name"),)

    rig_id: Mapped[UUID] = belongs_to("rig.id")
    position: Mapped[int]
    name: Mapped[Name]
    frame: Mapped[Name]
    topic: Mapped[str | None]
    serial: Mapped[str | None] = mapped_column(String(200), index=True)
    T_vehicle_lidar: Mapped[Json | None]


class RigCamera(Row):
    """One camera of a rig: its nominal mount ``T_camera_lidar`` (a transform document), image size and bounds.

    ``joint`` holds ``T_parent_lidar`` and ``T_child_camera`` around the joint that its results are also given for.
    ``images`` says whether they are raw or rectified, and of rectified ones the rotation ``R`` of their CameraInfo.
    """

    __table_args__ = (UniqueConstraint("rig_id", "name"),)

    rig_id: Mapped[UUID] = belongs_to("rig.id")
    position: Mapped[int]
    name: Mapped[Name]
    frame: Mapped[Name]
    topic: Mapped[str | None]
    serial: Mapped[str | None] = mapped_column(String(200), index=True)
    image_width: Mapped[int]
    image_height: Mapped[int]
    nominal: Mapped[Json]
    bounds: Mapped[Json]
    joint: Mapped[Json | None]
    images: Mapped[Json | None]
