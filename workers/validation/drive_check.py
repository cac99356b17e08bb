"""A deployed calibration held against a drive, without a service: ``python -m workers.validation.drive_check``.

It is called and answers as :mod:`workers.readers.__main__` does, with ``{"check": {...}}`` and pictures in ``OUT``.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from apexcal.documents.fleets import Camera
from apexcal.documents.imports import ReadCamera
from apexcal.documents.inspections import InspectedSensor, Inspection
from apexcal.documents.lenses import lens_of_images, parameters_of
from apexcal.documents.rig_proposals import LIDAR
from apexcal.documents.validations import CameraCheck, DriveCheck
from apexcal.geometry.image_frames import T_images_camera
from apexcal.geometry.se3 import from_document, to_document
from workers.readers.__main__ import inspected, main, on_progress, options_of
from workers.readers.images.decoded_frames import decoded_frames
from workers.readers.normalised.manifest import SensorManifest
from workers.readers.normalised.normalise import normalise
from workers.readers.normalised.sensor_files import FrameFile, SweepFile
from workers.readers.recording import ReadError
from workers.validation.calibration import KnownCalibration
from workers.validation.depth_edges import depth_edges
from workers.validation.edge_check import EdgeCheck
from workers.validation.lane_check import LaneCheck
from workers.validation.motion import STANDING, DriveMotion

DriveFrame = tuple[int, int, int]
"""A frame's stamp by the LiDAR's clock, ns, and its offset and length in the camera's file."""
FRAMES: Final = 30
"""Frames of a recording that are looked at."""
_PICTURES: Final = 3
_PICTURE_PX: Final = 1280


def spread(places: Sequence[DriveFrame], count: int = FRAMES) -> list[DriveFrame]:
    """Return at most ``count`` of the frames, at even steps."""
    chosen = np.unique(np.linspace(0, len(places) - 1, count).round().astype(int))
    return [places[index] for index in chosen]


def watch(
    check: EdgeCheck | LaneCheck,
    lidar: SweepFile,
    camera: Path,
    frames: Sequence[DriveFrame],
    scratch: Path,
    *,
    motion: DriveMotion | None = None,
    must_stop: Callable[[], None] = lambda: None,
    on_share: Callable[[float], None] = lambda share: None,
) -> None:
    """Give a check each frame with the sweep of its moment.

    Args:
        camera, scratch, must_stop: as `decoded_frames` takes them.
        motion: the LiDAR's motion at these frames, if it is known already.
    """
    places, colour = [(offset, length) for _, offset, length in frames], isinstance(check, LaneCheck)
    images = decoded_frames(camera, places, scratch, colour=colour, widest=check.widest_px, must_stop=must_stop)
    motion = motion or drive_motion(lidar, check.calibration, frames)
    if isinstance(check, EdgeCheck):
        check.is_motion_told = motion.is_told
    for number, (sweep, at, image) in enumerate(zip(motion.sweeps, motion.motions, images, strict=True)):
        on_share(number / len(frames))
        if image is not None and at is not None:
            check.add(lidar.sweep(sweep), image, at)


def drive_motion(lidar: SweepFile, calibration: KnownCalibration, frames: Sequence[DriveFrame]) -> DriveMotion:
    """Return how the LiDAR moves at each of the frames."""
    return DriveMotion.of(lidar, [stamp_ns for stamp_ns, *_ in frames], seen_after_ns(lidar, calibration))


def seen_after_ns(lidar: SweepFile, calibration: KnownCalibration) -> int:
    """Return the ns from a sweep's stamp until the LiDAR measures what the camera sees."""
    if not len(lidar):
        raise ReadError("no_sweeps", "The recording holds no sweeps.", "Validate with another recording.")
    sweep = lidar.sweep(len(lidar) // 2)
    in_view = calibration.project(sweep.xyz.astype(np.float64))[1]
    return int(np.median(sweep.offset_ns[in_view])) if in_view.any() else 0


def check_drive(
    inspection: Inspection,
    source: Path,
    out: Path,
    options: Any,
    on_progress: Callable[..., None],
    calibrations: Sequence[ReadCamera] = (),
) -> DriveCheck:
    """Hold each camera's stated lens and mount against the recording, and write pictures into the folder ``out``.

    ``calibrations``: what calibration files state of the cameras, instead of the recording.

    Raises:
        ReadError: the recording cannot be read, or holds no camera.
    """
    lidar, *cameras = inspection.sensors
    if inspection.proposal is None:
        raise ReadError("no_camera", "The recording holds no images.", "Record the cameras with the LiDAR.")
    stated = {
        camera.name: _of_files(camera, calibrations) if calibrations else _deployed(inspection, camera, of_rig)
        for camera, of_rig in zip(cameras, inspection.proposal.rig.cameras, strict=True)
    }
    checks = [
        CameraCheck(name=n, verdict="not_told", sentence=why) for n, why in stated.items() if isinstance(why, str)
    ]
    notes = list(inspection.proposal.notes)
    if len(checks) < len(stated):
        with TemporaryDirectory(dir=out) as folder:
            topics = {camera.name: camera.topic for camera in cameras}
            manifest = normalise(
                source, folder, lidar=lidar.topic, cameras=topics, options=options, on_progress=on_progress
            )
            with SweepFile(Path(folder) / manifest.sensors[0].file) as sweeps:
                for sensor in manifest.sensors:
                    calibration = stated.get(sensor.name)
                    if isinstance(calibration, KnownCalibration):
                        checks.append(_checked(sensor, calibration, sweeps, Path(folder), out))
                        if sensor.offset_ns:
                            offset_s = sensor.offset_ns / 1e9
                            notes.append(
                                f"Frames of {sensor.name} are paired with a clock offset of {offset_s:.3f} s."
                            )
    order = list(stated)
    checks.sort(key=lambda check: order.index(check.name))
    return DriveCheck(cameras=checks, notes=notes)


def _deployed(inspection: Inspection, camera: InspectedSensor, of_rig: Camera) -> KnownCalibration | str:
    """The calibration that the recording states of a camera, or a sentence: what it does not state."""
    for question in inspection.proposal.questions if inspection.proposal else ():
        if question.sensor in (LIDAR, camera.name):
            return f"Its mount is not stated. {question.sentence}"
    images = of_rig.images and of_rig.images.model_dump(mode="json")
    lens = camera.lens and lens_of_images(camera.lens.model_dump(), camera.image_kind)
    if not lens:
        return f"Its lens is not stated: no usable CameraInfo of {camera.topic} was recorded."
    values = lens["model"] and parameters_of(lens, lens["model"])
    if not values:
        return f"Its lens ({lens['distortion_model']}) has no equal here."
    nominal = from_document(of_rig.nominal.model_dump(mode="json"))
    mount = from_document(T_images_camera(nominal.to_frame, images)) @ nominal
    size = [lens["width"], lens["height"]]
    intrinsics = {"model": lens["model"], "image_size": size, **values}
    return KnownCalibration.of({"intrinsics": intrinsics, "transform": to_document(mount)})


def _of_files(camera: InspectedSensor, calibrations: Sequence[ReadCamera]) -> KnownCalibration | str:
    """Return the calibration that files state for the camera's image size, or a sentence that says what is missing.

    If several have that size, the camera's name decides.
    """
    fitting = [
        stated for stated in calibrations
        if stated.lens and stated.T_camera_lidar
        and (not stated.lens.width or camera.image_size in (None, (stated.lens.width, stated.lens.height)))
    ]  # fmt: skip
    chosen = _named(camera, fitting) if len(fitting) > 1 else fitting
    if len(chosen) != 1:
        names = ", ".join(stated.name for stated in calibrations)
        what = "no lens with a mount" if not fitting else "several calibrations"
        return f"The files ({names}) state {what} for its images of {camera.image_size} pixels."
    lens, mount = chosen[0].lens, chosen[0].T_camera_lidar
    assert lens and mount
    values = parameters_of(lens.model_dump(), lens.model)
    if not values:
        return f"Its lens ({lens.distortion_model}) has no equal here."
    size = [lens.width, lens.height] if lens.width else [*(camera.image_size or ())]
    intrinsics = {"model": lens.model, "image_size": size, **values}
    return KnownCalibration.of({"intrinsics": intrinsics, "transform": mount.model_dump(mode="json")})


def _named(camera: InspectedSensor, calibrations: Sequence[ReadCamera]) -> Sequence[ReadCamera]:
    """Return the calibrations with the camera's name or folder, else those with its number.

    KITTI's image_02 is 02 or P2 and, if rectified, rect_02.
    """
    names = {camera.name.lower(), *camera.topic.lower().split("/")}
    if named := [stated for stated in calibrations if stated.name.lower() in names]:
        return named
    number = _number(camera.name)
    named = [stated for stated in calibrations if number is not None and _number(stated.name) == number]
    is_rectified = "rect" in camera.topic
    return [stated for stated in named if ("rect" in stated.name) == is_rectified] if len(named) > 1 else named


def _number(name: str) -> int | None:
    return int(digits[-1]) if (digits := re.findall(r"\d+", name)) else None


def _checked(
    sensor: SensorManifest, calibration: KnownCalibration, lidar: SweepFile, folder: Path, out: Path
) -> CameraCheck:
    apart_ns = sensor.offset_ns or 0
    with FrameFile(folder / sensor.file) as file:
        frames = [
            (stamp - apart_ns, offset, length)
            for stamp, offset, length, *size, _ in file.entries.tolist()
            if (*size,) == calibration.image_size
        ]
    if not frames:
        width, height = calibration.image_size
        why = f"No frame has {width} x {height} pixels, as its CameraInfo says."
        return CameraCheck(name=sensor.name, verdict="stop", sentence=why)
    edges, lanes = EdgeCheck(calibration), LaneCheck(calibration)
    motion = drive_motion(lidar, calibration, spread(frames))
    for check in (edges, lanes):
        watch(check, lidar, folder / sensor.file, spread(frames), folder, motion=motion)
    on_lanes = lanes.result()
    verdict, sentence, axes = edges.verdict(on_lanes)
    if verdict == "pass":
        sentence += f" {edges.score:.2f} times the gradients nearby at its edges."
    turn = np.array([axis.turn_deg or 0.0 if axis.verdict in ("look", "stop") else 0.0 for axis in axes])
    views = {"": calibration} | ({"-as-it-fits": calibration.moved(turn, np.zeros(3))} if turn.any() else {})
    pictures = list(_pictures(sensor, views, lidar, spread(frames, _PICTURES), folder, out))
    return CameraCheck(
        name=sensor.name, verdict=verdict, sentence=sentence, frames=len(frames), axes=axes,
        lanes=on_lanes["verdict"], motion=motion.sentence, pictures=pictures,
    )  # fmt: skip


def _pictures(
    sensor: SensorManifest,
    views: dict[str, KnownCalibration],
    lidar: SweepFile,
    frames: Sequence[DriveFrame],
    folder: Path,
    out: Path,
) -> Iterator[str]:
    """Write frames with the depth edges in them, red near and blue far, and yield the files' names."""
    places = [(offset, length) for _, offset, length in frames]
    images = decoded_frames(
        folder / sensor.file, places, folder, colour=True, widest=_PICTURE_PX, must_stop=lambda: None
    )
    motion = drive_motion(lidar, views[""], frames)
    for number, (sweep, at, image) in enumerate(zip(motion.sweeps, motion.motions, images, strict=True), start=1):
        if image is None:
            continue
        measured = depth_edges(lidar.sweep(sweep))
        edges = (at or STANDING).applied(measured.points, measured.offset_ns)
        shade = (255.0 * np.clip(3.0 / np.linalg.norm(edges, axis=1), 0.0, 1.0)).astype(np.uint8)
        colours = np.asarray(cv2.applyColorMap(shade, cv2.COLORMAP_JET), np.uint8).reshape(-1, 3)
        for suffix, calibration in views.items():
            name = f"{sensor.name}-{number}{suffix}.jpg"
            drawn = _drawn(image, calibration, edges, colours)
            (out / name).write_bytes(cv2.imencode(".jpg", drawn)[1].tobytes())
            yield name


def _drawn(
    image: NDArray[np.uint8], calibration: KnownCalibration, points: NDArray[np.float64], colours: NDArray[np.uint8]
) -> NDArray[np.uint8]:
    drawn = image.copy()
    pixels, is_visible = calibration.project(points)
    scale = image.shape[1] / calibration.image_size[0]
    for (u, v), colour in zip(pixels[is_visible], colours[is_visible].tolist(), strict=True):
        cv2.circle(drawn, (round((u + 0.5) * scale - 0.5), round((v + 0.5) * scale - 0.5)), 2, colour, -1)
    return drawn


def _room(arguments: argparse.Namespace, request: dict[str, Any]) -> dict[str, Any]:
    options = options_of(request)
    arguments.out.mkdir(parents=True, exist_ok=True)
    inspection = inspected(arguments.source, request)
    calibrations = [ReadCamera.model_validate(camera) for camera in request.get("calibrations", ())]
    check = check_drive(inspection, arguments.source, arguments.out, options, on_progress, calibrations)
    return {"check": check.model_dump(mode="json")}


if __name__ == "__main__":
    sys.exit(main(room=_room))
