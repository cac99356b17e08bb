"""Requests that calibrate many vehicles."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any
from uuid import UUID

from apexcal.documents.fleet_requests import DryRunView, FleetRequestView, RequestVehicleView
from apexcal.transport import Resource, at


class FleetRequests(Resource):
    """``client.fleet_requests``: calibrations of all vehicles that a filter names, in one call."""

    def create(
        self,
        fleet_id: UUID | str,
        vehicles: Mapping[str, Any] | None = None,
        *,
        key: str | None = None,
        **calibration: Any,
    ) -> FleetRequestView:
        """Calibrate every vehicle that the filter names (all, without one) from its newest pairs.

        ``vehicles`` holds any of ``vehicle_ids``, ``name``, ``rig``, ``not_calibrated_since``, ``new_pairs``;
        ``calibration`` what ``client.calibrations.create`` takes besides the pairs. ``key``: an idempotency key.
        """
        body = {"vehicles": dict(vehicles or {}), "calibration": calibration}
        return self._http.post(at("fleets", fleet_id, "fleet-requests"), FleetRequestView, body, key=key)

    def preview(
        self, fleet_id: UUID | str, vehicles: Mapping[str, Any] | None = None, **calibration: Any
    ) -> DryRunView:
        """What :meth:`create` would do: how many vehicles match, and which would be skipped and why."""
        body = {"vehicles": dict(vehicles or {}), "calibration": calibration, "dry_run": True}
        return self._http.post(at("fleets", fleet_id, "fleet-requests"), DryRunView, body)

    def get(self, request_id: UUID | str) -> FleetRequestView:
        """One fleet request with its counts."""
        return self._http.get(at("fleet-requests", request_id), FleetRequestView)

    def list(self, fleet_id: UUID | str) -> Iterator[FleetRequestView]:
        """The requests of a fleet, newest first."""
        return self._http.items(at("fleets", fleet_id, "fleet-requests"), FleetRequestView)

    def vehicles(self, request_id: UUID | str, state: str | None = None) -> Iterator[RequestVehicleView]:
        """The request's vehicles by name, or those in one state (queued, running, done, failed, ...)."""
        return self._http.items(at("fleet-requests", request_id, "vehicles"), RequestVehicleView, state=state)

    def cancel(self, request_id: UUID | str) -> FleetRequestView:
        """End every vehicle that has not ended."""
        return self._http.post(at("fleet-requests", request_id, "cancel"), FleetRequestView)

    def retry(self, request_id: UUID | str) -> FleetRequestView:
        """Calibrate the failed vehicles again, each from its newest pairs."""
        return self._http.post(at("fleet-requests", request_id, "retry"), FleetRequestView)
