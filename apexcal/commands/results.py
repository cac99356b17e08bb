"""Commands on a result: ``report``, ``compare``, ``validate``, ``drift``, ``recalibrate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from apexcal.commands.calibrated import tables
from apexcal.commands.named import (
    check_id,
    find_camera,
    find_recording,
    find_result,
    find_vehicle_camera,
)
from apexcal.commands.options import (
    CameraOption,
    FleetOption,
    ForceOption,
    OutputOption,
    ResultArgument,
    ResultOption,
    VehicleOption,
)
from apexcal.commands.session import Reply, Session
from apexcal.commands.stated_files import read_texts
from apexcal.commands.terminal import check_target, usage, write_content
from apexcal.documents.comparisons import ResultComparison
from apexcal.documents.imports import StatedComparison
from apexcal.documents.validations import RoadScore


def report(
    session: Session,
    result: ResultArgument,
    output: OutputOption = Path("report.html"),
    force: ForceOption = False,
    camera: CameraOption = "",
) -> Reply:
    """Save a result's page as one file: verdict, expected errors, residuals. It opens without a network."""
    check_target(output, force)
    analyses = session.client.analyses
    view = session.wait(analyses.report(find_result(session.client, result, camera)), "Making the report")
    assert view.result is not None
    write_content(output, analyses.read_file(view.id))
    return Reply(view, f"The report is in {output}. Its verdict: {view.result.verdict}.")


def compare(
    session: Session,
    files: Annotated[list[Path] | None, typer.Argument(exists=True)] = None,
    other: Annotated[str, typer.Option("--with")] = "",
    of: str = "",
    result: ResultOption = "",
    image_size: tuple[int, int] | None = None,
    vehicle: VehicleOption = "",
    camera: CameraOption = "",
    fleet: FleetOption = "",
) -> Reply:
    """Say how far a camera's calibration is from another result, or from what a file of another program states.

    Args:
        files: Calibration file of OpenCV, or all of KITTI's.
        other: Id of another result, instead of files.
        of: The camera's name in the files, if they hold several.
        image_size: Width and height, for files that say none.
    """
    if bool(files) == bool(other):
        usage("a result is compared either with files or with another result", "Give files, or --with RESULT")
    if result and (vehicle or camera):
        usage("a result belongs to one camera already", "Leave out --vehicle and --camera, or leave out --result")
    client = session.client
    if result:
        result_id = find_result(client, result)
    else:
        on, name = find_vehicle_camera(client, fleet, vehicle, camera)
        result_id = str(client.calibrations.current(on.id, name).result_id)
    if other:
        both = client.calibrations.compare(result_id, find_result(client, other, camera))
        return Reply(both, "\n".join(_result_lines(both)))
    texts = read_texts(files or [])
    stated = client.imports.compare(result_id, files=texts, camera=of or None, image_size=image_size)
    return Reply(stated, "\n".join(_stated_lines(stated)))


def validate(
    session: Session,
    kind: str,
    data_of: Annotated[str, typer.Argument(metavar="DATA")],
    camera: CameraOption = "",
    result: ResultOption = "",
) -> Reply:
    """Score a calibration without fitting it: on other pairs, on lane markers, or on edges of a drive.

    `pairs` compares the errors with what the calibration states. `lanes` asks whether the ground's bright points lie
    on bright pixels. `edges` asks whether depth steps lie on image gradients, and finds a camera that was knocked.

    Args:
        kind: pairs, lanes or edges.
        data_of: Id of a correspondence set for pairs; otherwise a recording.
    """
    client, result_id = session.client, find_result(session.client, result, camera) if result else None
    if kind == "pairs":
        request = client.analyses.validate_on_pairs(check_id(data_of, "correspondence set"), result_id=result_id)
    elif kind in ("lanes", "edges"):
        recording = find_recording(client, data_of)
        name = find_camera([client.vehicles.rig(recording.rig_id)], camera)
        on = "lane" if kind == "lanes" else "edge"
        request = client.analyses.validate_on_road(on, recording.id, name, result_id=result_id)
    else:
        usage(f"{kind!r} is no kind of validation.", "It is one of pairs, lanes, edges.")
    view = session.wait(request, "Validating")
    score = view.result
    assert score is not None
    sentence = f"{score.verdict}: {score.sentence}"
    if isinstance(score, RoadScore) and score.score is not None and score.score_at_one_degree is not None:
        sentence += f"\nScore {score.score:.2f}; {score.score_at_one_degree:.2f} at 1 degree of yaw."
    return Reply(view, sentence)


def recalibrate(
    session: Session, result: ResultArgument, leave_out: Annotated[str, typer.Option()], camera: CameraOption = ""
) -> Reply:
    """Repeat a result's calibration without some of its pairs. Its report shows which to leave out.

    Args:
        leave_out: Numbers of the pairs to leave out, from 0: 3,17,40.
    """
    try:
        numbers = [int(number) for number in leave_out.split(",")]
    except ValueError:
        usage(f"{leave_out!r} is no list of numbers", "Give them as 3,17,40")
    if min(numbers) < 0:
        usage("pairs are counted from 0", "Give numbers of 0 and above")
    request = session.client.calibrations.create_without(find_result(session.client, result, camera), numbers)
    calibration = session.wait(request, "Calibrating")
    return Reply(calibration, tables(calibration), next=f"apexcal open calibration {calibration.id}")


def _result_lines(comparison: ResultComparison) -> list[str]:
    lines = [comparison.sentence]
    if comparison.field_px is not None:
        sigmas = _sigmas(", ", comparison.field_sigmas)
        lines.append(f"Points 5 and 20 m away lie {comparison.field_px:.2f} px apart in the image (RMS{sigmas}).")
    return lines + [
        f"  {each.name:11} {each.difference:+10.4g} {each.unit:3}{_sigmas('  ', each.sigmas)}"
        for each in comparison.parameters
    ]


def _stated_lines(comparison: StatedComparison) -> list[str]:
    lines: list[str] = []
    if comparison.rotation_deg is not None and comparison.translation_mm is not None:
        sigmas = _sigmas(", ", comparison.sigmas, " of the result")
        mount = f"{comparison.rotation_deg:.3f} degrees and {comparison.translation_mm:.1f} mm"
        lines.append(f"T_camera_lidar differs by {mount}{sigmas}.")
    if lens := comparison.lens:
        differences = f"f_x {lens.f_x:+.2f}, f_y {lens.f_y:+.2f}, c_x {lens.c_x:+.2f}, c_y {lens.c_y:+.2f} px"
        lines.append(f"The result's lens minus the stated one: {differences}.")
    return [*lines, *comparison.hints] or ["The files state neither a lens nor a mount of this camera."]


def _sigmas(before: str, count: float | None, after: str = "") -> str:
    return "" if count is None else f"{before}{count:.1f} standard deviations{after}"
