"""What a recording tells of its images is kept in the rig once; what the rig says goes before it, and is compared."""

from __future__ import annotations

import pytest
from sqlalchemy import select

from service.platform.db.fleets import Rig, RigCamera
from tests.service.detections.seeding import seed_rig
from tests.service.platform.jobs.support import make_fleet
from tests.support.databases import one_database
from workers.readers.normalised.manifest import SensorManifest
from workers.tasks.ingesting import keep_image_kinds

pytestmark = one_database
R = [0.9998, -0.02, 0.0, 0.02, 0.9998, 0.0, 0.0, 0.0, 1.0]
P = [500.0, 0.0, 320.0, 0.0, 0.0, 500.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0]
ROWS = {"matrix": [R[:3], R[3:6], R[6:]]}


def camera(kind, topic="/front/image", *, d=(0.1,), **info):
    whole = {
        "model": None,
        "K": P[:3] + P[4:7] + P[8:11],
        "D": list(d),
        "R": None,
        "P": P,
        "width": 640,
        "height": 480,
    }
    stated = whole | info if info or d else None
    stamps = {"count": 5, "first_ns": 0, "last_ns": 1, "rate_hz": 10.0, "gaps": [], "gap_count": 0}
    names = {"kind": "camera", "name": "front", "topic": topic, "frame_id": "camera", "file": "a"}
    return SensorManifest(**names, **stamps, camera_info=stated, image_kind=kind)


@pytest.fixture
def rig(database):
    return seed_rig(database, make_fleet(database))


def kept(database, rig, sensor, images=None):
    with database.writing() as session:
        row = session.scalar(select(RigCamera).where(RigCamera.rig_id == rig.id))
        if images is not None:
            row.images = images
        version = session.get_one(Rig, rig.id).version
        said = keep_image_kinds(session, rig.id, [sensor])
        session.flush()
        return said, row.images, session.get_one(Rig, rig.id).version - version


def test_rectified_images_are_kept_with_r_and_said(database, rig):
    said, images, changed = kept(database, rig, camera("rectified", "/front/image_rect", R=R))
    assert (images, changed) == ({"kind": "rectified", "rotation": ROWS}, 1)
    assert len(said) == 1 and said[0].startswith("front: images of /front/image_rect are rectified. Their lens is P")
    # The next recording changes nothing, and is told the same.
    assert kept(database, rig, camera("rectified", "/front/image_rect")) == (said, images, 0)


def test_raw_images_are_kept_without_a_word(database, rig):
    assert kept(database, rig, camera("raw", "/front/image_raw", R=R)) == ([], {"kind": "raw", "rotation": None}, 1)


def test_images_that_nothing_tells_of_are_asked_about(database, rig):
    said, images, changed = kept(database, rig, camera(None))
    assert (images, changed) == (None, 0)
    assert "neither the topic /front/image nor its camera info tells" in said[0] and "Say in the rig" in said[0]
    assert kept(database, rig, camera(None, d=(), P=None)) == ([], None, 0)
    assert kept(database, rig, camera(None, d=())) == ([], None, 0)


@pytest.mark.parametrize(("told", "stated"), [("raw", "rectified"), ("rectified", "raw")])
def test_the_rig_goes_before_the_recording(database, rig, told, stated):
    corrected = {"kind": stated, "rotation": None}
    said, images, changed = kept(database, rig, camera(told), corrected)
    assert (images, changed) == (corrected, 0)
    assert f"look {told}, and the rig says {stated}" in said[0]
    assert not any("look" in one for one in kept(database, rig, camera(None))[0])
