"""Fleets with their people and tokens; vehicles and rigs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any
from uuid import UUID

from apexcal.documents.fleet_health import CameraHealth, HealthOrder
from apexcal.documents.fleets import FleetOut, RigOut, VehicleOut
from apexcal.documents.people import ChangedMember, Invitation, MadeToken, Member, Token
from apexcal.documents.roles import Role
from apexcal.errors import ApiError
from apexcal.transport import Resource, at, if_match


class Fleets(Resource):
    """``client.fleets``: fleets, their members and their tokens."""

    def create(self, name: str) -> FleetOut:
        """Make a fleet (the owner only)."""
        return self._http.post("/fleets", FleetOut, {"name": name})

    def list(self) -> Iterator[FleetOut]:
        """The fleets that this person or token is in."""
        return self._http.items("/fleets", FleetOut)

    def get(self, fleet_id: UUID | str) -> FleetOut:
        """One fleet."""
        return self._http.get(at("fleets", fleet_id), FleetOut)

    def rename(self, fleet_id: UUID | str, name: str, *, version: int) -> FleetOut:
        """Give a fleet another name."""
        return self._http.patch(at("fleets", fleet_id), FleetOut, {"name": name}, version=version)

    def delete(self, fleet_id: UUID | str) -> None:
        """Delete a fleet of which nothing is published, with its vehicles (the owner only)."""
        self._http.delete(at("fleets", fleet_id))

    def set_policy(self, fleet_id: UUID | str, policy: Mapping[str, float | bool], *, version: int) -> FleetOut:
        """State what results must show to be published: ``{"heldout_mean_px": 0.8}``; ``{}`` states nothing."""
        return self._http.put(at("fleets", fleet_id, "policy"), FleetOut, dict(policy), if_match(version))

    def members(self, fleet_id: UUID | str) -> Iterator[Member]:
        """Everybody in a fleet: ``person_id``, ``name``, ``role``."""
        return self._http.items(at("fleets", fleet_id, "members"), Member)

    def invite(self, fleet_id: UUID | str, name: str, role: Role) -> Invitation:
        """A one-time sign-in ``link`` for a new person, with their ``person_id`` and ``expires_at``."""
        return self._http.post(at("fleets", fleet_id, "invitations"), Invitation, {"name": name, "role": role})

    def set_role(self, fleet_id: UUID | str, person_id: UUID | str, role: Role) -> ChangedMember:
        """Give a member another role."""
        return self._http.patch(at("fleets", fleet_id, "members", person_id), ChangedMember, {"role": role})

    def remove_member(self, fleet_id: UUID | str, person_id: UUID | str) -> None:
        """End a person's membership. What they marked stays."""
        self._http.delete(at("fleets", fleet_id, "members", person_id))

    def create_token(
        self, fleet_id: UUID | str, name: str, role: Role, *, expires_in_days: int | None = None
    ) -> MadeToken:
        """A token for a program, in ``token``. It is shown this once."""
        body: dict[str, Any] = {"name": name, "role": role}
        if expires_in_days is not None:
            body["expires_in_days"] = expires_in_days
        return self._http.post(at("fleets", fleet_id, "tokens"), MadeToken, body)

    def tokens(self, fleet_id: UUID | str) -> Iterator[Token]:
        """The tokens of a fleet, without their secrets."""
        return self._http.items(at("fleets", fleet_id, "tokens"), Token)

    def revoke_token(self, token_id: UUID | str) -> None:
        """End a token at once."""
        self._http.delete(at("tokens", token_id))


class Vehicles(Resource):
    """``client.vehicles``: vehicles, and how their sensors are mounted."""

    def create(self, fleet_id: UUID | str, name: str) -> VehicleOut:
        """Make a vehicle in a fleet."""
        return self._http.post(at("fleets", fleet_id, "vehicles"), VehicleOut, {"name": name})

    def list(self, fleet_id: UUID | str) -> Iterator[VehicleOut]:
        """The vehicles of a fleet."""
        return self._http.items(at("fleets", fleet_id, "vehicles"), VehicleOut)

    def health(
        self,
        fleet_id: UUID | str,
        *,
        name: str = "",
        state: Sequence[str] = (),
        work: Sequence[str] = (),
        order: HealthOrder = "vehicle",
    ) -> Iterator[CameraHealth]:
        """The cameras of a fleet's vehicles: state, error, last recording, and what each waits for (``work``).

        ``name``: a part of the vehicle's or camera's name. ``order``: the member to sort by, ``-`` turns it round.
        """
        address = at("fleets", fleet_id, "health")
        filters = {"name": name or None, "state": [*state] or None, "work": [*work] or None}
        return self._http.items(address, CameraHealth, **filters, order=order)

    def get(self, vehicle_id: UUID | str) -> VehicleOut:
        """One vehicle."""
        return self._http.get(at("vehicles", vehicle_id), VehicleOut)

    def rename(self, vehicle_id: UUID | str, name: str, *, version: int) -> VehicleOut:
        """Give a vehicle another name."""
        return self._http.patch(at("vehicles", vehicle_id), VehicleOut, {"name": name}, version=version)

    def delete(self, vehicle_id: UUID | str) -> None:
        """Delete a vehicle of which nothing is published, with its rigs, recordings and calibrations."""
        self._http.delete(at("vehicles", vehicle_id))

    def delete_rig(self, rig_id: UUID | str) -> None:
        """Delete a rig that no recording has, with its imported pairs and their calibrations."""
        self._http.delete(at("rigs", rig_id))

    def create_rig(self, vehicle_id: UUID | str, rig: Mapping[str, Any]) -> RigOut:
        """Add a rig: one LiDAR and its cameras, each with its nominal ``T_camera_lidar`` (a transform document)."""
        return self._http.post(at("vehicles", vehicle_id, "rigs"), RigOut, dict(rig))

    def check_rig(self, rig: Mapping[str, Any]) -> None:
        """Check whether the service would accept a rig, without making one. Raises :class:`ApiError` if it would not.

        It asks for the nil vehicle id, which no vehicle has. The service checks the rig before it looks for the
        vehicle, so ``not_found`` means that the rig is accepted.
        """
        try:
            self.create_rig(UUID(int=0), rig)
        except ApiError as error:
            if error.code != "not_found":
                raise

    def rigs(self, vehicle_id: UUID | str) -> Iterator[RigOut]:
        """The rigs of a vehicle."""
        return self._http.items(at("vehicles", vehicle_id, "rigs"), RigOut)

    def rig(self, rig_id: UUID | str) -> RigOut:
        """One rig."""
        return self._http.get(at("rigs", rig_id), RigOut)

    def set_serials(self, rig_id: UUID | str, serials: Mapping[str, Any], *, version: int) -> RigOut:
        """Correct or complete serial numbers: ``{"lidar": "SN1", "cameras": {"front": "SN2"}}``.

        For a sensor that was swapped make a new rig.
        """
        return self._http.patch(at("rigs", rig_id, "serials"), RigOut, dict(serials), version=version)

    def set_images(self, rig_id: UUID | str, cameras: Mapping[str, Any], *, version: int) -> RigOut:
        """Correct what cameras' images are: ``{"front": {"kind": "raw"}}``; null lets the next recording tell it."""
        return self._http.patch(at("rigs", rig_id, "images"), RigOut, {"cameras": dict(cameras)}, version=version)

    def set_policy(self, rig_id: UUID | str, policy: Mapping[str, float | bool], *, version: int) -> RigOut:
        """State a rig's own limits, which replace the fleet's of the same name; ``{}`` states nothing."""
        return self._http.put(at("rigs", rig_id, "policy"), RigOut, dict(policy), if_match(version))
