"""What is said of a finished calibration."""

import io

from rich.console import Console

from apexcal.commands.calibrated import lens_of, table_of, warnings_of, why_unpublished
from apexcal.documents.summaries import CameraSummary

STAGE = {"mean_px": 119.11, "rms_px": 264.42}
FOUND = {"result_id": "0192f0c1-2d3e-7a4b-8c5d-6e7f8a9b0c1d", "status": "ok", "message": ""}
BROWN = {**FOUND, "polished": {"mean_px": 4.18, "rms_px": 5.1}, "heldout_mean_px": 34.21, "alarms": ["far"]}
KANNALA = {
    **FOUND,
    **dict.fromkeys(("ga", "polished", "baseline"), STAGE),
    "heldout_mean_px": 200.0,
    "heldout_pairs": 80,
    "alarms": ["f_x lies on its bound"],
}
CAMERA = CameraSummary.model_validate(
    {
        "recommended": "kannala_brandt",
        "why": "",
        "models": {"brown_conrady": BROWN, "kannala_brandt": KANNALA},
    }
)


def test_the_table_fits_into_80_columns():
    out = Console(file=io.StringIO(), width=80)
    out.print(table_of("front", CAMERA))
    shown = out.file.getvalue()
    assert "kannala_brandt *" in shown
    assert "119.11 / 264.42" in shown
    assert "…" not in shown


def test_overfitted_models_and_the_recommended_models_alarms_are_warned_of():
    overfitted, alarm = warnings_of(CAMERA)
    assert overfitted.startswith("brown_conrady is at 34.21 px on held-out pairs")
    assert alarm == "kannala_brandt: f_x lies on its bound"


def test_the_lens_of_the_recommended_model_is_told():
    refined = KANNALA | {"lens": "stated, refined", "stated_lens": "The stated lens leaves 3.1 px RMS."}
    camera = CameraSummary.model_validate(
        {"recommended": "kannala_brandt", "why": "", "models": {"kannala_brandt": refined}}
    )
    assert lens_of(camera) == "Lens of kannala_brandt: stated, refined. The stated lens leaves 3.1 px RMS."
    assert lens_of(CAMERA) == "Lens of kannala_brandt: fitted."


def test_each_reason_for_not_publishing_is_its_own():
    doubtful = CAMERA.model_copy(update={"not_published": ["f_x lies on its bound.", "The slots disagree."]})
    reasons = {
        why_unpublished(CAMERA, wanted=False),
        why_unpublished(doubtful, wanted=True),
        why_unpublished(CAMERA, wanted=True),
    }
    assert len(reasons) == 3
    assert why_unpublished(doubtful, wanted=True).startswith("f_x lies on its bound. The slots disagree. A reviewer")
