"""Options of the form ``CAMERA=FILE``, and the correspondence sets that a calibration is made of."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from apexcal.client import ApiError, Client, InputError
from apexcal.commands.named import find_camera, find_detection, find_rig, find_vehicle
from apexcal.commands.stated_files import lens_files, read_lens
from apexcal.commands.terminal import note, usage
from apexcal.documents.correspondence_sets import SetView
from apexcal.documents.recordings import RecordingView
from apexcal.transport import Document


def camera_and_file(text: str) -> tuple[str, Path]:
    """``front=pairs.csv`` as its camera and file; without a camera, an empty name. A file of that whole name wins."""
    camera, sign, file = text.partition("=")
    if not sign or Path(text).exists():
        return "", Path(text)
    return camera, Path(file)


class PairsOf(NamedTuple):
    """A camera, and what makes the correspondence set of its pairs."""

    camera: str
    make: Callable[[], SetView]


def pairs_of_files(
    client: Client, files: Sequence[str], vehicle: str, rig: str, cameras: Sequence[str]
) -> list[PairsOf]:
    """The camera of each file, and its import. With several files each names its camera."""
    named = [camera_and_file(text) for text in files]
    if len(named) > 1 and not all(camera for camera, _ in named):
        usage("several --pairs, and one names no camera", "Write each as --pairs CAMERA=FILE")
    texts: list[bytes] = []
    for _, path in named:
        try:
            texts.append(path.read_bytes())
        except OSError as error:
            raise InputError(f"cannot read {path}: {(error.strerror or '').lower()}") from None
    with_rig = find_rig(client, find_vehicle(client, "", vehicle), rig)
    of = [find_camera([with_rig], camera or "".join(cameras[:1])) for camera, _ in named]
    bring = client.correspondence_sets.import_csv
    return [
        PairsOf(camera, partial(bring, with_rig.id, camera, text)) for camera, text in zip(of, texts, strict=True)
    ]


def pairs_of_marks(
    client: Client, detection_id: str, cameras: Sequence[str], *, machine_marks: bool
) -> list[PairsOf]:
    """Return each camera with the function that makes pairs of its marks."""
    detection = find_detection(client, detection_id)
    recording = client.recordings.get(detection.recording_id)
    with_rig = client.vehicles.rig(recording.rig_id)
    of = [find_camera([with_rig], camera) for camera in cameras or [""]]
    build = partial(client.correspondence_sets.build, detection.id, machine_marks=machine_marks)
    return [PairsOf(camera, partial(build, camera)) for camera in of]


@contextmanager
def saying_what_stays(sets: Sequence[SetView]) -> Iterator[None]:
    """If the service refuses the block's request, say which sets were imported: they stay."""
    try:
        yield
    except ApiError:
        for each in sets:
            if each.source == "import":
                pairs = "1 pair" if each.count == 1 else f"{each.count} pairs"
                note(
                    f"Imported all the same: {pairs} of {each.camera}, as the correspondence set {each.id}, "
                    "which is this camera's newest now."
                )
        raise


def state_lenses(client: Client, recording: RecordingView, files: Sequence[str], path: Path | None) -> RecordingView:
    """State the lenses of these files, or of files in the recording's folder or beside it; say which was taken.

    ``path``: of the recording on this machine; what lies there counts for cameras without a file and a CameraInfo.
    """
    sizes = {each.name: (each.facts.width, each.facts.height) for each in recording.sensors if each.kind == "camera"}
    stated = {each.name for each in recording.sensors if each.facts.camera_info}
    for camera, file in _files_of(files, list(sizes)):
        recording = _state(client, recording, camera, file, sizes[camera])
        stated.add(camera)
    for file in lens_files(path) if path and set(sizes) - stated else ():
        for camera in sorted(set(sizes) - stated):
            try:
                recording = _state(client, recording, camera, str(file), sizes[camera], is_named=len(sizes) > 1)
                stated.add(camera)
            except (ApiError, InputError) as error:
                note(f"No lens of {camera} was taken from {file}: {error}")
    return recording


def _state(
    client: Client, recording: RecordingView, camera: str, file: str, size: Any, *, is_named: bool = False
) -> RecordingView:
    lens = read_lens(client, file, camera, size if all(size) else None, is_named=is_named)
    current = client.recordings.get(recording.id)
    changed = client.recordings.state_lens(current, camera, lens | {"source": Path(file).name[:200]})
    note(f"The lens of {camera} is that of {file}.")
    return changed


def _files_of(files: Sequence[str], cameras: Sequence[str]) -> Iterator[tuple[str, str]]:
    """The camera of each `[CAMERA=]FILE`."""
    for text in files:
        camera, path = camera_and_file(text)
        if not camera and len(cameras) > 1:
            usage("--intrinsics names no camera, and there are several", "Write it as --intrinsics CAMERA=FILE")
        if camera and camera not in cameras:
            usage(f"--intrinsics names {camera!r}", f"The cameras are {', '.join(cameras)}")
        yield camera or cameras[0], str(path)


def lenses(
    client: Client, files: Sequence[str], cameras: Mapping[str, tuple[int, int] | None]
) -> dict[str, Document]:
    """The intrinsics of each camera that a file is given for. ``cameras``: the size of their images, if known."""
    return {camera: read_lens(client, file, camera, cameras[camera]) for camera, file in _files_of(files, [*cameras])}
