"""Correspondence sets, calibrations and results."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any
from uuid import UUID

from apexcal.documents.base import Page
from apexcal.documents.calibrations import CalibrationTemplate, CalibrationView, SlotView
from apexcal.documents.comparisons import Drift, ResultComparison
from apexcal.documents.correspondence_sets import SetView, SetWithPairs
from apexcal.documents.publications import CURRENT, PublicationView
from apexcal.documents.published_calibrations import CurrentCalibration, VehicleCalibration
from apexcal.documents.results import ResultView
from apexcal.transport import Resource, at, read


class CorrespondenceSets(Resource):
    """``client.correspondence_sets``: immutable 3D-2D pairs of one camera."""

    def build(
        self, detection_id: UUID | str, camera: str, *, exclude_flagged: bool = False, machine_marks: bool = False
    ) -> SetView:
        """A set from the marks of a detection's vertices, the machine's too. The same content is the same set."""
        body = {"camera": camera, "exclude_flagged": exclude_flagged, "machine_marks": machine_marks}
        return self._http.post(at("detections", detection_id, "correspondence-sets"), SetView, body)

    def import_pairs(self, rig_id: UUID | str, camera: str, pairs: Sequence[Mapping[str, float]]) -> SetView:
        """A set from ``{"x", "y", "z", "u", "v"}`` (metres, LiDAR frame; pixels), ``stamp_ns`` or ``group`` each."""
        return self._import(rig_id, camera, json={"pairs": [dict(pair) for pair in pairs]})

    def import_csv(self, rig_id: UUID | str, camera: str, text: bytes) -> SetView:
        """A set from CSV with the columns x, y, z, u, v and, where known, stamp_ns or group."""
        return self._import(rig_id, camera, content=text, headers={"Content-Type": "text/csv"})

    def without(self, set_id: UUID | str, pairs: Sequence[int]) -> SetView:
        """A set of a set's pairs without those of these numbers, counted from 0."""
        return self._http.post(at("correspondence-sets", set_id, "selections"), SetView, {"leave_out": list(pairs)})

    def get(self, set_id: UUID | str) -> SetWithPairs:
        """One set with its pairs."""
        return self._http.get(at("correspondence-sets", set_id), SetWithPairs)

    def list(self, rig_id: UUID | str) -> Iterator[SetView]:
        """The sets of a rig."""
        return self._http.items(at("rigs", rig_id, "correspondence-sets"), SetView)

    def _import(self, rig_id: UUID | str, camera: str, **body: Any) -> SetView:
        return read(
            self._http.create(at("rigs", rig_id, "correspondence-sets"), params={"camera": camera}, **body), SetView
        )


class Calibrations(Resource):
    """``client.calibrations``: requests, results, and what a vehicle is given."""

    def create(
        self,
        vehicle_id: UUID | str,
        correspondence_set_ids: Sequence[UUID | str],
        models: Sequence[str] | None = None,
        **request: Any,
    ) -> CalibrationView:
        """Request a calibration: every model, or every one of ``models``, on every camera's pairs.

        ``request`` holds what the API takes besides: ``preset``, ``schedule``, ``search``, ``rotation_range_deg``,
        ``bounds_preset``, ``intrinsics_from``, ``intrinsics`` (a lens by camera), ``intrinsics_as``, ``bounds``,
        ``locked``, ``priors``, ``loss``, ``outliers``, ``weights``, ``common_errors``, ``line_time_us``, ``seed``,
        ``folds``, ``farm``, ``publish``.
        """
        body = {"correspondence_set_ids": [str(set_id) for set_id in correspondence_set_ids], **request}
        if models is not None:
            body["models"] = list(models)
        return self._http.post(at("vehicles", vehicle_id, "calibrations"), CalibrationView, body)

    def create_without(self, result_id: UUID | str, pairs: Sequence[int]) -> CalibrationView:
        """Request a result's calibration again without those pairs of its camera that have these numbers, from 0."""
        result = self.result(result_id)
        calibration = self.get(result.calibration_id)
        fewer = CorrespondenceSets(self._http).without(result.set_id, pairs)
        request = calibration.request.model_dump(mode="json", exclude_unset=True)
        fields = {name: value for name, value in request.items() if name in CalibrationTemplate.model_fields}
        sets = [fewer.id if old == result.set_id else old for old in calibration.request.correspondence_set_ids]
        return self.create(calibration.vehicle_id, sets, **fields)

    def list(self, vehicle_id: UUID | str) -> Iterator[CalibrationView]:
        """The calibrations of a vehicle, newest first."""
        return self._http.items(at("vehicles", vehicle_id, "calibrations"), CalibrationView)

    def get(self, calibration_id: UUID | str) -> CalibrationView:
        """One calibration: its state, its runs and, when it is done, its ``summary``."""
        return self._http.get(at("calibrations", calibration_id), CalibrationView)

    def delete(self, calibration_id: UUID | str) -> None:
        """Delete a calibration with its results, unless one is published. Its pairs stay."""
        self._http.delete(at("calibrations", calibration_id))

    def cancel(self, calibration_id: UUID | str) -> CalibrationView:
        """End a calibration that is not done."""
        return self._http.post(at("calibrations", calibration_id, "cancel"), CalibrationView)

    def result(self, result_id: UUID | str) -> ResultView:
        """What a run found: parameters, transform, standard deviations, residuals, checks."""
        return self._http.get(at("results", result_id), ResultView)

    def compare(self, result_id: UUID | str, other_id: UUID | str) -> ResultComparison:
        """How far a result is from another one of its camera: mount, lens, and pixels over the image."""
        return self._http.get(at("results", result_id, "comparison"), ResultComparison, other=str(other_id))

    def drift(self, vehicle_id: UUID | str, camera: str, *, limit: int = 20, after: str | None = None) -> Drift:
        """A camera's newest recommended results, oldest first, each compared with the one before and the first.

        ``after``: the ``next`` of an answer, to get the results before these.
        """
        return self._http.get(at("vehicles", vehicle_id, "drift"), Drift, camera=camera, limit=limit, after=after)

    def slots(self, calibration_id: UUID | str, camera: str, model: str, fold: int = -1) -> Iterator[SlotView]:
        """The GA slots of one run, with the worker that ran each."""
        return self._http.items(
            at("calibrations", calibration_id, "slots"), SlotView, camera=camera, model=model, fold=fold
        )

    def publish(
        self, result_id: UUID | str, reason: str | None = None, *, override: bool = False, alias: str = CURRENT
    ) -> PublicationView:
        """Make a result its camera's current calibration, or let another alias lead to it.

        ApiError ``checks_stop`` where a check says so (``fields["checks"]``): ``override`` publishes
        all the same, for this ``reason``, and both are kept. A result that was published before needs a reason.
        """
        why = {"override": {"reason": reason or ""}} if override else {"reason": reason}
        return self._http.post(at("results", result_id, "publication"), PublicationView, {"alias": alias, **why})

    def publications(self, vehicle_id: UUID | str, camera: str, alias: str = CURRENT) -> Iterator[PublicationView]:
        """What a camera was given under an alias, newest first: by whom, when, why and against which checks."""
        address = at("vehicles", vehicle_id, "cameras", camera, "publications")
        return self._http.items(address, PublicationView, alias=alias)

    def withdraw(self, publication_id: UUID | str, reason: str) -> PublicationView:
        """Withdraw what an alias leads to; the answer is the alias's move to nowhere.

        :meth:`current` then raises ApiError ``calibration_withdrawn`` until something is published. The one before
        does not come back by itself. A withdrawal of ``current`` also removes aliases that lead to the same result.
        """
        return self._http.post(at("publications", publication_id, "withdrawal"), PublicationView, {"reason": reason})

    def aliases(self, vehicle_id: UUID | str, camera: str) -> list[PublicationView]:
        """Where each alias of a camera leads, by its last move."""
        return self._http.get(at("vehicles", vehicle_id, "cameras", camera, "aliases"), Page[PublicationView]).items

    def current(self, vehicle_id: UUID | str, camera: str, alias: str = CURRENT) -> CurrentCalibration:
        """A camera's current calibration, or what another alias leads to.

        ApiError ``no_calibration_yet`` if there is none, ``calibration_withdrawn`` if it was withdrawn,
        ``calibration_does_not_apply`` if a sensor was swapped since.
        """
        path = at("vehicles", vehicle_id, "cameras", camera, "calibration")
        return self._http.get(path, CurrentCalibration, alias=alias)

    def vehicle(
        self, vehicle_id: UUID | str, cameras: Sequence[str] | None = None, as_of: str | None = None, **query: Any
    ) -> VehicleCalibration:
        """What all cameras of a vehicle are given now, or were at a moment.

        ``query``: ``alias``, and ``serial`` (``NAME=SERIAL`` of each mounted sensor). Raises ApiError
        ``no_calibration_yet``, ``calibration_withdrawn``, ``calibration_does_not_apply``.
        """
        return self._http.get(
            at("vehicles", vehicle_id, "calibration"), VehicleCalibration, camera=cameras, as_of=as_of, **query
        )
