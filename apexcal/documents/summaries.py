"""The summary of a calibration: its models and cameras side by side."""

from __future__ import annotations

from typing import Any, Literal
from uuid import UUID

from apexcal.documents.base import Document
from apexcal.documents.checks import Check, CheckVerdict
from apexcal.documents.jobs import ProblemView
from apexcal.documents.precision import Covariance, Deviations, Prediction
from apexcal.documents.results import Errors, Status, Stopped
from apexcal.documents.rules import LensOrigin
from apexcal.documents.transforms import SolvedTransform


class Behind(Document):
    """The distance of a model behind the likeliest one on held-out pairs.

    Standard errors come from the scatter between blocks of pairs. ``within_noise``: log likelihoods differ by less
    than 4.
    """

    px: float
    standard_error_px: float
    percent: float
    standard_error_percent: float
    within_noise: bool
    log_likelihood: float
    standard_error_log_likelihood: float


class BetweenModels(Document):
    """Deviations, intervals and prediction of a result with the spread between models, and the models' weights.

    Weights follow from held-out pairs. ``std`` are the roots of the covariance's diagonal.
    """

    weights: dict[str, float]
    std: Deviations
    interval95_half_width: Deviations
    covariance: Covariance
    prediction: Prediction | None

    def members(self) -> dict[str, Any]:
        """Return, as JSON, the members that replace those of the result."""
        return self.model_dump(mode="json", exclude={"weights"})


class ModelSummary(Document):
    """A model's fit to all pairs of a camera, and its errors on held-out ones.

    ``verdict`` is the gravest of its checks when the calibration ended, for the mount with its lens;
    ``verdict_alone`` is the gravest for the mount with another lens. ``behind`` says how far it is behind the
    model under which held-out pairs are likeliest. ``weight`` is its share among the models, ``heldout_sigma_px``
    the noise per coordinate of held-out pairs without wrong marks, ``heldout_forbidden`` how many have no projection.
    ``stated_lens`` says in a sentence how well a stated lens fits.
    """

    result_id: UUID
    status: Status
    message: str
    polished: Errors
    ga: Errors
    baseline: Errors | None
    linear_baseline: Errors | None
    free_parameters: int
    at_bounds: list[str]
    lens: LensOrigin
    stated_lens: str | None
    pairs: int
    explained_px: float | None
    marks_outside: int | None
    iterations: int
    stopped: Stopped | None
    heldout_mean_px: float | None
    heldout_rms_px: float | None
    heldout_pairs: int
    heldout_forbidden: int
    heldout_sigma_px: float | None
    weight: float | None
    between_models: BetweenModels | None
    seconds: float
    workers: list[str]
    verdict: CheckVerdict | None
    verdict_alone: CheckVerdict | None
    behind: Behind | None

    @property
    def stages(self) -> dict[str, Errors]:
        """Return the errors by stage: search, polish and, if it was computed, baseline."""
        stages = {"ga": self.ga, "polished": self.polished}
        return stages | ({"baseline": self.baseline} if self.baseline else {})


class CameraSummary(Document):
    """The models of a camera side by side, which one to take and why; whether it was published, where asked for.

    ``checks`` are all checks of the recommended model's result at the end of the calibration.
    """

    recommended: str | None
    why: str
    models: dict[str, ModelSummary]
    checks: list[Check]
    published: bool | None


class StatedDeviation(Document):
    """The distance of the transform between two cameras from one that the rig states."""

    source: Literal["nominal", "rig"]
    std_deg: float
    std_mm: float
    rotation_deg: float
    translation_mm: float
    chi2: float
    degrees_of_freedom: int
    probability: float
    sigmas: float


class OddVertex(Document):
    """A vertex whose marks in two cameras disagree: the pairs' indices in both."""

    indices: list[int]
    stamp_ns: int | None
    distance_px: float
    sigmas: float


class SharedVertices(Document):
    """The agreement of the marks of vertices that both cameras saw."""

    vertices: int
    counted: int
    mean_px: float
    rms_px: float
    expected_rms_px: float
    offset_px: list[float]
    offset_sigmas: float
    odd: list[OddVertex]


class CameraPair(Document):
    """The comparison of two cameras of a rig; ``transform`` is T_a_b, null if a mount is not determined.

    Deviations are of small turns about camera a's axes in degrees, and of t in millimetres.
    """

    cameras: list[str]
    models: list[str]
    name: str
    transform: SolvedTransform | None
    std: dict[str, float] | None
    interval95_half_width: dict[str, float] | None
    stated: list[StatedDeviation]
    shared: SharedVertices | None
    sentences: list[str]
    alarms: list[str]


class RigSummary(Document):
    """The comparisons of every two cameras of a rig; ``problem`` says why there are none."""

    pairs: list[CameraPair]
    alarms: list[str]
    left_out: list[str]
    problem: ProblemView | None


class Summary(Document):
    """The summary of a calibration: for each camera its models, and the cameras of the rig compared."""

    cameras: dict[str, CameraSummary]
    rig: RigSummary | None

    def model(self, camera: str, model: str | None) -> ModelSummary | None:
        """Return the summary of a camera's model; None if the model was not fitted."""
        of_camera = self.cameras.get(camera)
        return None if of_camera is None else of_camera.models.get(model or "")
