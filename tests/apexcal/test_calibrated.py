"""What is said of a finished calibration."""

import io
from uuid import UUID

from rich.console import Console

from apexcal.commands.calibrated import lens_of, line_of, table_of, verdict_line, why_unpublished
from apexcal.documents.checks import Check
from apexcal.documents.summaries import CameraSummary
from tests.support.results import model_summary, summary

STAGE = {"mean_px": 119.11, "rms_px": 264.42}
ID = UUID("0192f0c1-2d3e-7a4b-8c5d-6e7f8a9b0c1d")
BROWN = model_summary(ID, heldout_mean_px=34.21, verdict="stop")
KANNALA = model_summary(
    ID, **dict.fromkeys(("ga", "polished", "baseline"), STAGE), heldout_mean_px=200.0, heldout_pairs=80,
    verdict="look", verdict_alone="stop",
)  # fmt: skip


def camera_of(**models):
    return CameraSummary.model_validate(summary(models, recommended="kannala_brandt")["cameras"]["front"])


CAMERA = camera_of(brown_conrady=BROWN, kannala_brandt=KANNALA)


def test_the_table_fits_into_80_columns():
    out = Console(file=io.StringIO(), width=80)
    out.print(table_of("front", CAMERA))
    shown = out.file.getvalue()
    assert "kannala_brandt *" in shown
    assert "119.11/264.42" in shown
    assert "…" not in shown


def test_the_verdict_and_each_check_are_a_line():
    check = Check(
        name="bounds", title="Bounds", verdict="look", sentence="f_x lies on its bound.", remedy="Widen it.",
        figures={}, scope="mount_with_lens",
    )  # fmt: skip
    camera = CAMERA.model_copy(update={"checks": [check]})
    assert verdict_line(camera) == "Verdict on kannala_brandt: look; stop for the mount with another lens."
    assert line_of(check) == "look: f_x lies on its bound. Widen it."


def test_the_lens_of_the_recommended_model_is_told():
    refined = KANNALA | {"lens": "stated, refined", "stated_lens": "The stated lens leaves 3.1 px RMS."}
    assert (
        lens_of(camera_of(kannala_brandt=refined))
        == "Lens of kannala_brandt: stated, refined. The stated lens leaves 3.1 px RMS."
    )
    assert lens_of(CAMERA) == "Lens of kannala_brandt: fitted."


def test_each_reason_for_not_publishing_is_its_own():
    withheld, replaced = (CAMERA.model_copy(update={"published": was}) for was in (False, True))
    reasons = [why_unpublished(CAMERA, publish=False), why_unpublished(withheld, publish=True)]
    assert len({*reasons, why_unpublished(replaced, publish=True)}) == 3
    assert reasons[1].startswith("a check keeps it back. A reviewer")
