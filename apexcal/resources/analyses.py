"""What is asked of a recording, of pairs or of a result, and answered by a worker."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args
from uuid import UUID

from apexcal.documents.analyses import AnalysisView, OffsetView, PreviewView, ReportView, SuggestionView
from apexcal.documents.copies import CopyView
from apexcal.documents.machine_marks import MachineMark, MarksList, MarksView
from apexcal.documents.marking_precision import PrecisionView
from apexcal.documents.pixel_points import PixelPointsView
from apexcal.documents.remedies import RemediesView
from apexcal.documents.validations import PairValidationView, RoadValidationView
from apexcal.resources.recordings import write_new
from apexcal.transport import Resource, at

View = TypeVar("View", bound=AnalysisView)


class Analyses(Resource):
    """``client.analyses``. What is asked returns at once; follow it with ``client.wait``."""

    def preview(self, recording_id: UUID | str, region: Mapping[str, Any]) -> PreviewView:
        """Ask how many frames and points a region keeps."""
        return self._ask(PreviewView, "preview", recording_id=recording_id, region=region)

    def suggest(self, recording_id: UUID | str) -> SuggestionView:
        """Ask for a region around what moves; its ``result`` has ``region`` and ``facts``."""
        return self._ask(SuggestionView, "suggestion", recording_id=recording_id)

    def estimate_offset(self, detection_id: UUID | str, camera: str, *, model: str | None = None) -> OffsetView:
        """Estimate how far the camera's clock is ahead of the LiDAR's, from a detection's vertices and their marks.

        Its ``result`` has ``offset_ns`` and ``sigma_ns``, for ``detections.create(..., offset_ns=...)``; ``model`` is
        the lens that is fitted along.
        """
        return self._ask(OffsetView, "clock_offset", detection_id=detection_id, camera=camera, model=model)

    def mark(self, detection_id: UUID | str, camera: str) -> MarksView:
        """Have the machine mark a detection's vertices in one camera; :meth:`marks` has where."""
        return self._ask(MarksView, "machine_marks", detection_id=detection_id, camera=camera)

    def marks(self, analysis_id: UUID | str) -> Sequence[MachineMark]:
        """The machine's marks and reasons. What one answers on their vertices afterwards counts as reviewed."""
        return self._http.get(at("analyses", analysis_id, "marks"), MarksList).marks

    def fit_marks(self, detection_id: UUID | str, camera: str) -> PrecisionView:
        """Ask how good the calibration of a detection's marks would be now. The service asks by itself, too."""
        return self._ask(PrecisionView, "precision", detection_id=detection_id, camera=camera)

    def copy_calibrated(
        self,
        recording_id: UUID | str,
        *,
        cameras: Sequence[str] = (),
        joints: Mapping[str, str] | None = None,
        for_viewers: bool = False,
    ) -> CopyView:
        """Copy the recording's bag and write the published calibration into it.

        ``joints``: by camera, the frame whose pose is replaced. ``for_viewers``: instead an MCAP file for Foxglove
        and Lichtblick with undistorted frames, of any kind of recording.
        """
        content = {"cameras": list(cameras), "joints": dict(joints or {}), "for_viewers": for_viewers}
        return self._ask(CopyView, "calibrated_copy", recording_id=recording_id, **content)

    def locate_pixels(
        self, recording_id: UUID | str, camera: str, pixels: Sequence[Mapping[str, float]], **request: Any
    ) -> PixelPointsView:
        """Ask which points in 3D the pixels show (``u``, ``v``, ``sigma_px``).

        ``request``: ``frame`` or ``stamp_ns``, and other members of a ``PixelPointsRequest``; its calibration is as
        in :meth:`validate_on_pairs`.
        """
        content = {"recording_id": recording_id, "camera": camera, "pixels": list(pixels), **request}
        return self._ask(PixelPointsView, "pixel_points", **content)

    def report(self, result_id: UUID | str) -> ReportView:
        """Ask for the report of a result, which must be a fit to all pairs. Its file is HTML."""
        return self._ask(ReportView, "report", result_id=result_id)

    def try_remedies(self, result_id: UUID | str) -> RemediesView:
        """Try what the checks of a result advise; its ``result`` says what each remedy brings on held-out pairs."""
        return self._ask(RemediesView, "remedies", result_id=result_id)

    def validate_on_pairs(
        self, set_id: UUID | str, *, result_id: UUID | str | None = None, calibration: Mapping[str, Any] | None = None
    ) -> PairValidationView:
        """Test a calibration on a correspondence set of its camera.

        It is a result's, or ``{"lens": ..., "transform": T_camera_lidar}``, or else the current one.
        """
        request = {"set_id": set_id, "result_id": result_id, "calibration": calibration}
        return self._ask(PairValidationView, "pair_validation", **request)

    def validate_on_road(
        self,
        on: Literal["lane", "edge"],
        recording_id: UUID | str,
        camera: str,
        *,
        result_id: UUID | str | None = None,
        calibration: Mapping[str, Any] | None = None,
    ) -> RoadValidationView:
        """Test a calibration on lane markers or depth edges of a drive; see :meth:`validate_on_pairs`."""
        request = {"recording_id": recording_id, "camera": camera, "result_id": result_id, "calibration": calibration}
        return self._ask(RoadValidationView, f"{on}_validation", **request)

    def list(self, view: type[View], **of: UUID | str) -> Iterator[View]:
        """The analyses of a kind, newest first; ``of`` is a ``vehicle_id``, ``recording_id`` or ``result_id``."""
        kinds = get_args(view.model_fields["kind"].annotation)
        return self._http.items("/analyses", view, kind=kinds, **{name: str(id) for name, id in of.items()})

    def get(self, view: type[View], analysis_id: UUID | str) -> View:
        """An analysis of this kind and, when it is done, its ``result``."""
        return self._http.get(at("analyses", analysis_id), view)

    def delete(self, analysis_id: UUID | str) -> None:
        """Delete an analysis with its file, or end its making."""
        self._http.delete(at("analyses", analysis_id))

    def read_file(self, analysis_id: UUID | str) -> bytes:
        """The file of a report or copy. Raises ApiError ``no_file``."""
        return self._http.send("GET", at("analyses", analysis_id, "file"), headers={"Accept": "*/*"}).content

    def download(self, analysis: CopyView | ReportView, target: Path) -> None:
        """Write the file of a report or copy to a new file, and compare its digest."""
        with self._http.stream(at("analyses", analysis.id, "file")) as response:
            write_new(target, response.iter_bytes(1 << 20), analysis.result.sha256 if analysis.result else "")

    def _ask(self, view: type[View], kind: str, **request: Any) -> View:
        ids = {name: str(value) for name, value in request.items() if isinstance(value, UUID)}
        body = {name: value for name, value in (request | ids).items() if value is not None}
        return self._http.post("/analyses", view, {"kind": kind, **body})
