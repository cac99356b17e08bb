"""From correspondences to a published calibration, in a browser."""

import re
from collections.abc import Callable

import cv2
import numpy as np
from playwright.sync_api import Page, expect

from tests.e2e.conftest import Track

NOISE_PX = 0.5


def pairs_of_truth(track: Track, count: int) -> list[dict[str, float]]:
    """Points in front of the simulated camera and where its true parameters see them, with some noise."""
    rng = np.random.default_rng(5)
    lens, mount = track.truth["intrinsics"], track.truth["transform"]
    K = np.array([[lens["f_x"], 0, lens["c_x"]], [0, lens["f_y"], lens["c_y"]], [0, 0, 1.0]])
    D = np.array([lens[name] for name in ("k1", "k2", "k3", "k4", "k5")])
    xyz = rng.uniform((5, -4, -1.5), (25, 4, 1.5), (count, 3))
    rotation, _ = cv2.Rodrigues(np.array(mount["rotation"]["matrix"]))
    uv, _ = cv2.projectPoints(xyz, rotation, np.array(mount["translation_m"]), K, D)
    uv = uv.reshape(-1, 2) + rng.normal(0, NOISE_PX, (count, 2))
    inside = np.all((uv > 0) & (uv < np.array(track.image_size) - 1), axis=1)
    columns = np.column_stack([xyz, uv])[inside]
    return [dict(zip("xyzuv", map(float, row), strict=True)) | {"group": i % 5} for i, row in enumerate(columns)]


def test_an_engineer_calibrates_and_publishes(sign_in: Callable[[str, str], Page], track: Track) -> None:
    track.owner.correspondence_sets.import_pairs(track.rig_id, "front", pairs_of_truth(track, 120))
    page = sign_in("Lea", "engineer")
    page.goto(f"{track.url}/recordings/{track.recording_id}")
    page.get_by_label(re.compile("from import")).check()
    page.get_by_role("checkbox", name=re.compile("kannala_brandt")).uncheck()
    page.get_by_role("checkbox", name=re.compile("pinhole")).uncheck()
    page.get_by_role("button", name="Calibrate").click()
    expect(page.get_by_role("heading", level=1)).to_contain_text("Calibration of")

    publish = page.get_by_role("button", name="Publish for the vehicle")
    publish.wait_for(timeout=40_000)
    row = page.get_by_role("row").filter(has_text="brown_conrady").first
    polished = re.findall(r"[\d.]+ / [\d.]+", row.inner_text())[1]
    mean, rms = (float(part) for part in polished.split(" / "))
    assert mean < rms < 2 * NOISE_PX
    expect(page.get_by_text("None published yet.")).to_be_visible()
    publish.click()
    expect(page.get_by_text("brown_conrady, published")).to_be_visible()
    page.reload()
    expect(page.get_by_text("Published: the current calibration")).to_be_visible()
    expect(publish).to_have_count(0)
    current = track.owner.calibrations.current(track.vehicle_id, "front")
    assert current["model"] == "brown_conrady"
