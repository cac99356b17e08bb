"""Lenses in documents of any program: a camera matrix by its content, its distortion by its names.

The names and their order are those of OpenCV's FileStorage and calibrators, of Autoware and livox_camera_calib, of
camodocal's ``writeParametersToYamlFile`` (VINS), of ORB-SLAM3's ``Settings.cc`` and stella_vslam, of vikit's
``camera_loader.h`` (FAST-LIVO2, FAST-Calib), of Basalt's ``calibration.json`` and of MATLAB's ``cameraParameters``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, Final

from apexcal.documents.bounds import LEAST_FOCAL_PX
from service.imports.contents import FileCamera, FileLens, camera_matrix, image_size, refused
from service.imports.members import (
    AS_CAMERA_INFO,
    Block,
    bare,
    blocks,
    is_matrix,
    member,
    scalar,
    vector,
    without_distortion,
)

_FOCALS: Final = (
    ("fx", "fy", "cx", "cy"),
    ("fx", "fy", "ppx", "ppy"),
    ("mu", "mv", "u0", "v0"),
    ("gamma1", "gamma2", "u0", "v0"),
    ("flx", "fly", "cx", "cy"),
)
_D: Final = (
    *("distortioncoefficient", "distortioncoeff", "distcoeff", "distcoef", "cameradistcoeff", "camdist"),
    *("distortionvector", "distortionparameter", "distortion", "dist", "coeff", "parameter", "d"),
)
_PARTS: Final = ("projectionparameter", "mirrorparameter", "intrinsic", "cameramatrix", *_D)
_SIZES: Final = (
    ("imagewidth", "imageheight"),
    ("width", "height"),
    ("camwidth", "camheight"),
    ("w", "h"),
    ("col", "row"),
)
_LISTED: Final = ("imagesize", "resolution", "imgsize")
_DISTORTION_MODEL: Final = ("distortionmodel", "distmodel", "distortiontype")
_CAMERA_MODEL: Final = ("modeltype", "cammodel", "cameramodel", "cameratype", "model", "type", "lenstype", "len")
_FISHEYE: Final = ("fisheyemodel", "fisheye", "isfisheye", "bfisheye")
_PLUMB_BOB: Final = ("plumb_bob", (("k1", "k2", "p1", "p2", "k3"), ("d0", "d1", "d2", "d3", "d4")))
_RATIONAL: Final = ("rational_polynomial", (("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),))
_EQUIDISTANT: Final = ("equidistant", (("k1", "k2", "k3", "k4"),))
# These say nothing of the distortion.
_PROJECTIONS: Final = ("", "pinhole", "perspective", "opencv")
# Our distortion model of each program's, and under which names its coefficients stand one by one.
_TERMS: Final = {
    **dict.fromkeys((*_PROJECTIONS, "plumbbob", "radtan", "radialtangential"), _PLUMB_BOB),
    **dict.fromkeys(("pinholefull", "pinholeradtan8", "rationalpolynomial"), _RATIONAL),
    **dict.fromkeys(
        ("equidistant", "equidistantcamera", "fisheye", "kannalabrandt8", "kb4", "opencvfisheye"), _EQUIDISTANT
    ),
    "kannalabrandt": ("equidistant", (("k2", "k3", "k4", "k5"),)),
    **dict.fromkeys(("none", "rectified"), ("none", ((),))),
}
_TERM: Final = re.compile(r"[kpds]\d|tau[xy]|xi|omega")
# Of projections that are not a pinhole's, or of a distortion the other way round (RealSense's inverse_brown_conrady).
_OTHER: Final = re.compile(
    r"fish|equi|kannala|kb\d|omni|mei|sphere|^ds$|ucm|fov|atan|ocam|scara|inverse|division|pano"
)
# Told by calibrateCamera: 4, 5, 8, 12 or 14 coefficients.
_RATIONAL_FROM: Final = 8
_BY_COUNT: Final = (
    "{} does not say its distortion model. It is read as OpenCV's (k1 k2 p1 p2 ...), not as cv2.fisheye's."
)


def named_cameras(name: str, document: Block) -> tuple[list[FileCamera], list[str]]:
    """The cameras of a document, named by the paths of their blocks, and notes.

    Raises:
        Problem: 422 ``calibration_file_not_read``, also for a lens whose distortion is under no known name.
    """
    every = dict(blocks(document))
    cameras: list[FileCamera] = []
    notes: list[str] = []
    for path, block in every.items():
        if bare(path.rpartition(".")[2]) in _PARTS:
            continue
        lens = lens_of_block(name if not path else f"{path} of {name}", block, notes, _around(path, every))
        if lens is not None:
            label = member(block, ("cameraname",)) or path or "camera"
            cameras.append(FileCamera(str(label)[:200], lens=lens))
    if len(cameras) == 1 and cameras[0].name in every:
        cameras = [FileCamera("camera", lens=cameras[0].lens)]
    return cameras, notes


def _around(path: str, every: Mapping[str, Block]) -> list[Block]:
    """The blocks around one, the nearest first, and ``Camera`` in each, where ORB-SLAM has what its cameras share."""
    around: list[Block] = []
    while True:
        if path in every:
            around += [every[path], *(each for each in [every[path].get("Camera")] if isinstance(each, dict))]
        if not path:
            return around
        path = path.rpartition(".")[0]


def lens_of_block(where: str, block: Block, notes: list[str], around: Sequence[Block] = ()) -> FileLens | None:
    """The lens in a block; None where it has no camera matrix. Raises as :func:`named_cameras`."""
    return _Reading(where, block, around).lens(notes)


class _Reading:
    """One block with those around it. ``terms`` are its numbers by bare names, with those of its parts."""

    def __init__(self, where: str, block: Block, around: Sequence[Block]) -> None:
        self.where = where
        parts = [each for name, each in block.items() if bare(name) in _PARTS and isinstance(each, dict)]
        self.parts: list[Block] = [part for part in parts if not is_matrix(part)]
        self.block: dict[str, Any] = {}
        for part in (*self.parts, block):
            self.block |= part
        self.around = around
        values = {bare(name.removeprefix("cam_")): scalar(value) for name, value in self.block.items()}
        self.terms = {name: value for name, value in values.items() if value is not None}

    def lens(self, notes: list[str]) -> FileLens | None:
        if (radial := vector(member(self.block, ("radialdistortion",)))) is not None:
            return self._of_matlab(radial)
        K = self._matrix(notes)
        if K is None:
            return None
        vectors = (vector(member(self.block, [name])) for name in _D)
        model, D = self._model(), next((numbers for numbers in vectors if numbers is not None), None)
        if D is None:
            return self._term_by_term(K, model)
        if bare(model or "") in _PROJECTIONS:
            notes.append(_BY_COUNT.format(self.where))
        ours = _TERMS[bare(model or "")][0] if bare(model or "") in _TERMS else str(model)
        if "brown" in bare(ours) and not any(D):  # RealSense's ways of Brown's model are a pinhole then
            ours = "plumb_bob"
        if ours == "plumb_bob" and len(D) >= _RATIONAL_FROM:
            ours = "rational_polynomial"
        return FileLens(ours[:64], K, D, self._size())

    def _matrix(self, notes: list[str]) -> list[float] | None:
        """K by rows: the block's only camera matrix, or focal lengths and centre by their names."""
        matrices: dict[str, list[float]] = {}
        for name, value in self.block.items():
            rows = vector(value) or []
            columns = [number for start in range(3) for number in rows[start::3]]
            if _is_camera_matrix(rows):
                matrices[name] = rows
            elif _is_camera_matrix(columns):
                notes.append(f"{name} of {self.where} is written by columns.")
                matrices[name] = columns
        if len({tuple(K) for K in matrices.values()}) > 1:
            raise refused(
                f"{self.where} has several camera matrices: {', '.join(matrices)}.",
                "Keep the matrix that belongs to the images and the distortion. Remove the others.",
            )
        if matrices:
            return next(iter(matrices.values()))
        listed = vector(member(self.block, ("intrinsic",))) or []
        if len(listed) == 4:
            return camera_matrix(*listed)
        names = next((names for names in _FOCALS if set(names) <= set(self.terms)), None)
        return camera_matrix(*(self.terms[each] for each in names)) if names else None

    def _model(self) -> str | None:
        """The model as the file names it; None where it names none. A camera's product name is none."""
        for block in (*self.parts, self.block, *self.around):
            if member(block, _FISHEYE) not in (None, 0, False, "0", "false"):
                return "equidistant"
            text = member(block, _DISTORTION_MODEL)
            if isinstance(text, str):
                return text
            texts = [text for name in _CAMERA_MODEL if isinstance(text := member(block, [name]), str)]
            curved = [text for text in texts if _OTHER.search(text.lower())]
            if models := curved or [text for text in texts if bare(text) in _TERMS]:
                return models[0]
        return None

    def _term_by_term(self, K: list[float], model: str | None) -> FileLens:
        if bare(model or "") not in _TERMS:
            return FileLens(str(model)[:64], K, [], self._size())
        ours, spellings = _TERMS[bare(model or "")]
        names = next((names for names in spellings if not names or names[0] in self.terms), None)
        if names is None:
            raise without_distortion(self.where, self.block)
        needed = names[:4] if ours == "plumb_bob" else names
        further = [
            name for name, value in self.terms.items() if _TERM.fullmatch(name) and name not in names and value
        ]
        if further or not set(needed) <= set(self.terms):
            raise refused(
                f"{self.where} has the coefficients {', '.join(filter(_TERM.fullmatch, self.terms))}; the "
                f"model {model or ours} takes {', '.join(names) or 'none'}.",
                AS_CAMERA_INFO,
            )
        return FileLens(ours, K, [self.terms.get(name, 0.0) for name in names], self._size())

    def _of_matlab(self, radial: list[float]) -> FileLens:
        """MATLAB's: pixel (1, 1) is the first, matrices before R2022b are by columns, and sizes are rows, columns."""
        K = self._matrix([])
        focal, centre = (vector(member(self.block, [name])) for name in ("focallength", "principalpoint"))
        if K is None and focal and centre and len(focal) == len(centre) == 2:
            K = camera_matrix(*focal, *centre)
        if K is None or not 2 <= len(radial) <= 3:
            raise refused(f"{self.where} has RadialDistortion without K, or not two or three in it.", AS_CAMERA_INFO)
        tangential = vector(member(self.block, ("tangentialdistortion",))) or [0.0, 0.0]
        size = vector(member(self.block, ("imagesize",)))
        size = image_size(f"The images of {self.where}", *size[::-1]) if size and len(size) == 2 else None
        K = [*K[:2], K[2] - 1.0, *K[3:5], K[5] - 1.0, *K[6:]]
        return FileLens("plumb_bob", K, [*radial[:2], *tangential, *radial[2:]], size)

    def _size(self) -> tuple[int, int] | None:
        for block in (self.block, *self.around):
            for names in _SIZES:
                pixels = [member(block, [name]) for name in names]
                if None not in pixels:
                    return image_size(f"The images of {self.where}", *pixels)
            listed = vector(member(block, _LISTED))
            # Basalt has one size for each of its cameras.
            if (
                listed
                and listed[0::2] == listed[:1] * (len(listed) // 2)
                and listed[1::2] == listed[1:2] * (len(listed) // 2)
            ):
                return image_size(f"The images of {self.where}", *listed[:2])
        return None


def _is_camera_matrix(numbers: Sequence[float]) -> bool:
    """No rotation is one: its numbers are at most 1."""
    return (
        len(numbers) == 9
        and min(numbers[0], numbers[4]) > LEAST_FOCAL_PX
        and numbers[3] == 0.0
        and list(numbers[6:]) == [0.0, 0.0, 1.0]
    )
