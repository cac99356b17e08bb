"""Pairs that tell little, drawn at random, and the whole way of a run: fit, document, summary, report."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any
from uuid import UUID

import numpy as np

from apexcal.documents.fit_requests import fit_request
from apexcal.documents.results import FitResult
from tests.workers.solver.rigs import NOMINAL, plain, real_correspondences
from workers.models.summary import CameraFit, camera_summary
from workers.reports.contents import contents
from workers.reports.material import Material
from workers.solver.narrowing import run_search
from workers.tasks.run_inputs import read_run
from workers.tasks.solving import solved

Json = dict[str, Any]
MODELS = ("pinhole", "brown_conrady", "kannala_brandt")
KINDS = ("poses", "twice", "line", "plane", "corner", "behind", "one_point", "one_pixel")
SHORT = {"slots": 1, "population": 64, "generations": 4, "max_iterations": 2}
SIZE = (1280, 960)


def drawn(seed: int) -> tuple[Json, Json]:
    """(the solver's document, a set's columns): 2 to 6 poses with few pairs, often of a kind that tells little."""
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % len(KINDS)]
    poses, each = int(rng.integers(2, 7)), int(rng.integers(3, 13))
    count = poses * each
    middles = rng.uniform((4, -3, -1), (12, 3, 1), (poses, 3))
    group = np.repeat(np.arange(poses), each)
    xyz = middles[group] + rng.uniform(-0.4, 0.4, (count, 3))
    if kind == "line":
        xyz = np.array([5.0, -2.0, -0.5]) + rng.uniform(0, 4, (count, 1)) * np.array([0.3, 1.0, 0.2])
    if kind == "plane":
        xyz[:, 0] = 6.0
    if kind == "behind":
        xyz[:, 0] *= -1.0
    if kind == "one_point":
        xyz[:] = xyz[0]
    forward, left, up = xyz.T
    with np.errstate(divide="ignore"):
        uv = np.column_stack([640.0 - 700.0 * left / np.abs(forward), 480.0 - 700.0 * up / np.abs(forward)])
    uv += rng.choice([0.0, 1.0, 30.0]) * rng.normal(size=uv.shape)
    if kind == "corner":
        uv = 20.0 + 0.02 * uv
    if kind == "one_pixel":
        uv[:] = 300.0
    if kind == "twice":
        half = count // 2
        xyz[half : 2 * half], uv[half : 2 * half] = xyz[:half], uv[:half]
    pairs = dict(zip("xyzuv", (*xyz.T.tolist(), *uv.T.tolist()), strict=True)) | _named(rng, group)
    return _document(rng, seed, int(rng.integers(0, 3)), SIZE, poses), pairs


def real(seed: int) -> tuple[Json, Json]:
    """As `drawn`, of 2 or 3 poses of the recorded board, 4 corners each, found and marked up to nine times."""
    rng = np.random.default_rng(seed)
    points, pixels, poses = real_correspondences()
    chosen = rng.choice(np.unique(poses), int(rng.integers(2, 4)), replace=False)
    rows = np.flatnonzero(np.isin(poses, chosen))
    rows = np.sort(np.tile(rows, int(rng.integers(1, 10))))
    uv = pixels[rows] + rng.choice([0.0, 0.5]) * rng.normal(size=(len(rows), 2))
    xyz = points[rows] + rng.choice([0.0, 0.01]) * rng.normal(size=(len(rows), 3))
    pairs = dict(zip("xyzuv", (*xyz.T.tolist(), *uv.T.tolist()), strict=True))
    pairs |= _named(rng, poses[rows])
    return _document(rng, seed, int(rng.integers(0, 3)), (1920, 1208), len(chosen)), pairs


def _named(rng: np.random.Generator, group: np.ndarray) -> Json:
    count = len(group)
    named: Json = {"group": group.tolist()} if rng.random() < 0.7 else {}
    if rng.random() < 0.5:
        named["stamp_ns"] = (10**18 + 100_000_000 * np.arange(count)).tolist()
    if rng.random() < 0.3:
        named["marked_by"] = [[int(one)] for one in rng.integers(0, 2, count)]
    if rng.random() < 0.3:
        named |= {"sigma_azimuth_rad": [1e-3] * count, "sigma_elevation_rad": [2e-3] * count}
        named |= {"sigma_range_m": [0.01] * count, "sigma_px": rng.choice([0.01, 1.0], count).tolist()}
    return named


def _document(rng: np.random.Generator, seed: int, model: int, size: tuple[int, int], poses: int) -> Json:
    document: Json = {"model": MODELS[model], "camera": "front", "image_size": size, "nominal": NOMINAL}
    document |= {"schedule": SHORT, "seed": seed, "outliers": str(rng.choice(["keep", "exclude"]))}
    document["loss"] = str(rng.choice(["mean", "saturating"]))
    focal, middle = (700.0, (640.0, 480.0)) if size == SIZE else (1177.0, (962.0, 612.0))
    lens = {"f_x": focal, "f_y": focal, "c_x": middle[0], "c_y": middle[1]}
    none = {"pinhole": 0, "brown_conrady": 5, "kannala_brandt": 4}[MODELS[model]]
    if rng.random() < 0.5:
        document["locked"] = lens | {f"k{i + 1}": 0.0 for i in range(none)}
    if rng.random() < 0.5:
        document["stated_lens"] = {"model": MODELS[model], "skew": 0.0, **lens} | {
            f"k{i + 1}": 0.01 for i in range(none)
        }
    if rng.random() < 0.5:
        document["common_errors"] = {"person_px": 0.5, "azimuth_deg": 0.02}
    if rng.random() < 0.3:
        document |= {"bounds": {"rotation_x": [-3.2, 3.2], "rotation_y": [-3.2, 3.2], "rotation_z": [-3.2, 3.2]}}
    return document | {"folds": int(rng.choice([0, 2]))}


def calibrated(document: Json, pairs: Json) -> Iterator[str]:
    """The run to all pairs, its folds, the summary and the report, each as a database and a browser take them.

    Raises what they raise: a SolveError is a refusal, anything else is a defect.
    """
    if "sigma_px" in pairs:
        document = document | {"weights": "covariances"}
    document = fit_request(**document).model_dump(mode="json")
    results = []
    for fold in range(-1, document["folds"]):
        run = read_run(document, fold, pairs)
        state = run_search(run.problem)
        found = solved(run, state)
        yield json.dumps(plain(found), allow_nan=False)
        results.append(FitResult.model_validate(plain(found)))
    fits = [CameraFit(UUID(int=2), fold if fold >= 0 else None, found, 0.1) for fold, found in enumerate(results, -1)]
    yield camera_summary(fits).model_dump_json()
    run = read_run(document, -1, pairs)
    heldout = [one.heldout for one in results[1:]]
    yield json.dumps(contents(Material(results[0], run.problem, pairs, heldout=heldout)), allow_nan=False)
