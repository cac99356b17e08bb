"""Calibration requests: what they come to as runs and jobs, and how what cannot work is refused."""

from uuid import UUID

import pytest

from service.platform.db.calibrations import Calibration, CalibrationRun, CorrespondenceSet
from service.platform.db.jobs import Job
from service.platform.db.recordings import Sensor
from tests.service.detections.seeding import seed_answer, seed_marking, seed_rig
from tests.support.asking import bring_pairs


@pytest.fixture
def rig(api, fleet):
    return seed_rig(api.database, fleet, bounds={"f_x": [300.0, 900.0], "k5": [-0.1, 0.1], "fx": [0.0, 1.0]})


def add_set(engineer, rig, count=60, camera="front", groups=(), **extra):
    pairs = [
        {"x": 4 + 0.1 * n, "y": n % 7 - 3.0, "z": 0.3, "u": 10.0 + n, "v": 20.0, "stamp_ns": n * 10**8} | extra
        for n in range(count)
    ]
    for pair, group in zip(pairs, groups, strict=False):
        pair["group"] = group
    return bring_pairs(engineer, rig.id, pairs, camera)


def ask(engineer, rig, *sets, **body):
    return engineer.post(f"/vehicles/{rig.vehicle_id}/calibrations", {"correspondence_set_ids": list(sets), **body})


def documents(api, calibration_id):
    with api.database.reading() as session:
        runs = session.query(CalibrationRun).filter_by(calibration_id=UUID(calibration_id))
        return {(run.model, run.fold): run.fit_request for run in runs}


def test_intrinsics_that_the_recording_states_hold_the_lens(api, fleet, engineer):
    seed = seed_marking(api.database, fleet, vertices=20)
    for number in range(20):
        seed_answer(api.database, seed, engineer.person_id, number, "confirmed", (10.0 + number, 20.0))
    made = engineer.post(f"/detections/{seed.detection_id}/correspondence-sets", {"camera": "front"}).json()
    request = {"models": ["pinhole"], "folds": 0, "intrinsics_from": "recording", "bounds": {"c_y": [230.0, 250.0]}}
    request["intrinsics_as"] = "bounds"

    def ask_it():
        return engineer.post(
            f"/vehicles/{seed.vehicle_id}/calibrations", {"correspondence_set_ids": [made["id"]], **request}
        )

    assert (ask_it().status_code, ask_it().json()["code"]) == (422, "no_intrinsics_stated")
    stated = {"model": "brown_conrady", "K": [500.0, 0, 320.0, 0, 510.0, 240.0, 0, 0, 1], "D": [0.0] * 5}
    for size, code in (((1280, 960), "intrinsics_of_another_size"), ((640, 480), None)):
        with api.database.writing() as session:
            facts = {"camera_info": stated | {"width": size[0], "height": size[1]}}
            session.get_one(Sensor, seed.camera_id).facts = facts
        answer = ask_it()
        assert answer.json().get("code") == code, answer.text
    bounds = documents(api, answer.json()["id"])["pinhole", -1]["bounds"]
    assert bounds["f_x"] == pytest.approx([450.0, 550.0]) and bounds["c_x"] == pytest.approx([288.0, 352.0])
    assert bounds["c_y"] == [230.0, 250.0], "what is asked for goes first"
    assert "front: f_x, f_y and c_x are looked for near what is stated." in answer.json()["notes"]
    request["bounds"] |= {"f_x": [400.0, 600.0], "f_y": [400.0, 600.0]}
    request["locked"] = {"c_x": 320.0}
    assert any("bound nothing" in note for note in ask_it().json()["notes"])
    usual = {"models": ["pinhole", "kannala_brandt"], "folds": 0, "intrinsics_as": "prior"}
    request.clear()
    request |= usual
    answer = ask_it().json()
    fits = documents(api, answer["id"])
    held = fits["pinhole", -1]["priors"]
    assert held["f_x"] == {"mean": 500.0, "sigma": 2.5} and held["c_y"] == {"mean": 240.0, "sigma": 3.2}
    assert fits["kannala_brandt", -1]["priors"] == {}
    assert all(one["stated_lens"]["model"] == "brown_conrady" for one in fits.values())
    assert "kannala_brandt is fitted with its own lens, for the stated lens is brown_conrady." in answer["notes"][-1]
    for changed, priors, stated in (({"intrinsics_as": "free"}, 0, True), ({"intrinsics_from": "bounds"}, 0, False)):
        request |= changed
        document = documents(api, ask_it().json()["id"])["pinhole", -1]
        assert (len(document["priors"]), document["stated_lens"] is not None) == (priors, stated)
    request.clear()
    request |= usual
    with api.database.writing() as session:
        session.get_one(Sensor, seed.camera_id).facts = {"camera_info": stated_of(1280)}
    document = documents(api, ask_it().json()["id"])["pinhole", -1]
    assert document["stated_lens"] is None, "it is of other images, and nobody insists on it"
    request["intrinsics_as"] = "locked"
    assert ask_it().json()["code"] == "intrinsics_of_another_size"


def test_a_stated_lens_is_locked_where_few_pairs_could_refine_it(api, engineer, rig):
    """Of brown_conrady 33 pairs leave 50 degrees of freedom; a model that is asked for and cannot be it is drawn.

    Corners of one pose err together, and count as one.
    """

    def lens_of(count, corners=1, **body):
        request = {"folds": 0, "intrinsics": {"front": PLUMB_BOB}} | body
        poses = [n // corners for n in range(count)]
        answer = ask(engineer, rig, add_set(engineer, rig, count, groups=poses), **request).json()
        made = {model: document for (model, _), document in documents(api, answer["id"]).items()}
        return {model: (of["locked"].get("f_x"), "f_x" in of["priors"]) for model, of in made.items()}

    own = {"pinhole": (None, False), "kannala_brandt": (None, False)}
    assert lens_of(32) == {"brown_conrady": (500.0, False)}
    assert lens_of(33) == {"brown_conrady": (None, True)} | own
    assert lens_of(80, corners=4) == {"brown_conrady": (500.0, False)}
    assert lens_of(132, corners=4) == {"brown_conrady": (None, True)} | own
    assert lens_of(32, intrinsics_as="prior") == {"brown_conrady": (None, True)} | own
    assert lens_of(32, models=["pinhole"]) == {"pinhole": (None, False)}


def test_the_lens_of_a_ready_recordings_camera_is_stated_later(api, fleet, engineer):
    seed = seed_marking(api.database, fleet, vertices=20)
    at = f"/recordings/{seed.recording_id}/cameras/front/lens"

    def state(lens, camera_at=at):
        etag = {"If-Match": engineer.get(f"/recordings/{seed.recording_id}").headers["etag"]}
        return engineer.put(camera_at, json=lens, headers=etag)

    assert state(PLUMB_BOB | {"width": 1280}).json()["code"] == "intrinsics_of_another_size"
    assert state(PLUMB_BOB, at.replace("front", "rear")).status_code == 404
    (camera,) = [
        each for each in state(PLUMB_BOB | {"source": "lens.yaml"}).json()["sensors"] if each["name"] == "front"
    ]
    stated = camera["facts"]["camera_info"]
    assert (stated["model"], stated["source"], stated["K"][0]) == ("brown_conrady", "lens.yaml", 500.0)
    for number in range(20):
        seed_answer(api.database, seed, engineer.person_id, number, "confirmed", (10.0 + number, 20.0))
    made = engineer.post(f"/detections/{seed.detection_id}/correspondence-sets", {"camera": "front"}).json()
    body = {"correspondence_set_ids": [made["id"]], "folds": 0}
    answer = engineer.post(f"/vehicles/{seed.vehicle_id}/calibrations", body)
    assert documents(api, answer.json()["id"])["brown_conrady", -1]["locked"]["k1"] == 0.1


def stated_of(width):
    K = [500.0, 0, 320.0, 0, 510.0, 240.0, 0, 0, 1]
    return {"model": "brown_conrady", "K": K, "D": [0.0] * 5, "width": width, "height": 480}


def test_skew_is_zero_unless_anyone_names_it(api, engineer, rig):
    def skew_of(**body):
        answer = ask(engineer, rig, add_set(engineer, rig), models=["brown_conrady"], folds=0, **body)
        assert answer.status_code == 202, answer.text
        return documents(api, answer.json()["id"])["brown_conrady", -1]["locked"].get("skew")

    assert skew_of() == 0.0
    assert skew_of(locked={"skew": 0.01}) == 0.01
    assert skew_of(bounds={"skew": [-0.1, 0.1]}) is None
    assert skew_of(priors={"skew": {"mean": 0.0, "sigma": 0.001}}) is None
    assert skew_of(preset="paper") is None, "Table I leaves it open"
    stated = PLUMB_BOB | {"K": [500.0, 5.0, 320.0, 0, 510.0, 240.0, 0, 0, 1.0]}
    assert skew_of(intrinsics={"front": stated}) is None, "a stated skew is refined like the rest"
    assert skew_of(intrinsics={"front": PLUMB_BOB}) == 0.0


P = [450.0, 0.0, 330.0, -54.0, 0.0, 450.0, 250.0, 0.0, 0.0, 0.0, 1.0, 0.0]


def test_rectified_images_have_the_lens_p_and_may_be_a_pinholes(api, fleet, engineer):
    seed = seed_marking(api.database, fleet, vertices=20)
    for number in range(20):
        seed_answer(api.database, seed, engineer.person_id, number, "confirmed", (10.0 + number, 20.0))
    made = engineer.post(f"/detections/{seed.detection_id}/correspondence-sets", {"camera": "front"}).json()
    request = {"models": ["pinhole"], "folds": 0, "intrinsics_from": "recording", "intrinsics_as": "locked"}

    def ask_it(stated, told, images):
        etag = {"If-Match": engineer.get(f"/rigs/{seed.rig_id}").headers["etag"]}
        body = {"cameras": {"front": images and {"kind": images}}}
        assert engineer.patch(f"/rigs/{seed.rig_id}/images", body, headers=etag).status_code == 200
        with api.database.writing() as session:
            session.get_one(Sensor, seed.camera_id).facts = {"camera_info": PLUMB_BOB | stated, "image_kind": told}
        return engineer.post(
            f"/vehicles/{seed.vehicle_id}/calibrations", {"correspondence_set_ids": [made["id"]], **request}
        )

    stated = {"model": "brown_conrady", "R": None, "P": P}
    for told, images in (("rectified", None), (None, "rectified"), ("raw", "rectified")):
        answer = ask_it(stated, told, images)
        assert answer.status_code == 202, answer.text
        locked = documents(api, answer.json()["id"])["pinhole", -1]["locked"]
        assert locked == {"f_x": 450.0, "f_y": 450.0, "c_x": 330.0, "c_y": 250.0}
    for told, images in (("raw", None), (None, None), ("rectified", "raw")):
        assert ask_it(stated, told, images).json()["code"] == "intrinsics_of_another_model"
    refused = ask_it(stated | {"P": None}, "rectified", None).json()
    assert refused["code"] == "no_intrinsics_stated" and "states P of rectified images" in refused["detail"]
    # A lens with a distortion is no rectified image's, whoever states it.
    request |= {"models": ["brown_conrady"], "intrinsics": {"front": PLUMB_BOB}}
    assert ask_it(stated, None, "rectified").json()["code"] == "intrinsics_of_raw_images"
    assert ask_it(stated, None, "raw").status_code == 202


PLUMB_BOB = {
    "width": 640,
    "height": 480,
    "distortion_model": "plumb_bob",
    "K": [500.0, 0.0, 320.0, 0.0, 510.0, 240.0, 0.0, 0.0, 1.0],
    "D": [0.1, -0.2, 0.001, -0.002, 0.05],
}


def given(api, engineer, rig, use_as, models=("pinhole", "brown_conrady", "kannala_brandt"), **changed):
    """The answer to a request with a given lens, and the documents by model where it was accepted."""
    request = {"folds": 0, "intrinsics_as": use_as} | ({"models": list(models)} if models else {})
    lens = {name: value for name, value in changed.items() if name in PLUMB_BOB}
    rest = {name: value for name, value in changed.items() if name not in PLUMB_BOB}
    answer = ask(engineer, rig, add_set(engineer, rig), **request, **rest, intrinsics={"front": PLUMB_BOB | lens})
    made = documents(api, answer.json()["id"]) if answer.status_code == 202 else {}
    return answer.json(), {model: document for (model, _), document in made.items()}


def test_a_given_lens_is_locked_for_the_models_that_can_be_it(api, engineer, rig):
    answer, made = given(api, engineer, rig, "locked", locked={"c_x": 321.0})
    assert set(made) == {"brown_conrady"}
    assert made["brown_conrady"]["locked"] == {
        "f_x": 500.0,
        "f_y": 510.0,
        "c_x": 321.0,
        "c_y": 240.0,
        "skew": 0.0,
        "k1": 0.1,
        "k2": -0.2,
        "k3": 0.001,
        "k4": -0.002,
        "k5": 0.05,
    }
    assert "front: pinhole and kannala_brandt are left out, for the stated lens is brown_conrady." in answer["notes"]
    _, plain = given(api, engineer, rig, "locked", D=[0.0] * 5)
    assert set(plain) == {"brown_conrady", "pinhole"}
    assert plain["pinhole"]["locked"] == {"f_x": 500.0, "f_y": 510.0, "c_x": 320.0, "c_y": 240.0}
    _, skewed = given(api, engineer, rig, "locked", D=[], K=[500.0, 5.0, 320.0, 0, 510.0, 240.0, 0, 0, 1.0])
    assert set(skewed) == {"brown_conrady"} and skewed["brown_conrady"]["locked"]["skew"] == 0.01


def test_a_given_lens_as_priors_and_as_bounds(api, engineer, rig):
    fisheye = {"distortion_model": "equidistant", "D": [0.1, 0.2, 0.3, 0.4]}
    _, made = given(api, engineer, rig, "prior", priors={"f_y": {"mean": 505.0, "sigma": 9.0}}, **fisheye)
    priors = made["kannala_brandt"]["priors"]
    assert priors["f_x"] == {"mean": 500.0, "sigma": 2.5} and priors["f_y"] == {"mean": 505.0, "sigma": 9.0}
    assert [priors[f"k{n}"]["mean"] for n in (1, 2, 3, 4)] == [0.1, 0.2, 0.3, 0.4]
    assert "locked" not in priors and made["kannala_brandt"]["locked"] == {}
    _, near = given(api, engineer, rig, "bounds")
    assert set(near) == {"pinhole", "brown_conrady", "kannala_brandt"}
    assert near["pinhole"]["bounds"]["f_x"] == [300.0, 900.0], "the rig's go first"
    assert near["pinhole"]["bounds"]["f_y"] == pytest.approx([459.0, 561.0])


@pytest.mark.parametrize(
    ("changed", "code", "says"),
    [
        ({"width": 1280}, "intrinsics_of_another_size", "1280 x 480 pixels, and its images have 640 x 480"),
        ({"distortion_model": "rational_polynomial", "D": [0.1] * 9}, "distortion_without_equal", "9 coefficients"),
        (
            {"distortion_model": "double_sphere"},
            "unknown_distortion_model",
            "'double_sphere', which is not supported",
        ),
        ({"K": [0.0] * 9}, "invalid_intrinsics", "no camera matrix"),
        ({"K": [1e-310, 1.0, 320.0, 0.0, 510.0, 240.0, 0.0, 0.0, 1.0]}, "invalid_intrinsics", "no camera matrix"),
        ({"models": ["kannala_brandt"]}, "intrinsics_of_another_model", "are of brown_conrady"),
        ({"K": [1.0]}, "invalid_request", "intrinsics.front.K"),
        (
            {"K": [500.0, 0.0, 320.0, 0.0, 43100.0, 240.0, 0.0, 0.0, 1.0]},
            "locked_out_of_bounds",
            "f_y of front is locked at 43100, outside of [128, 1920], the bounds of image-size",
        ),
    ],
)
def test_a_lens_that_cannot_be_taken_over_is_refused(api, engineer, rig, changed, code, says):
    answer, made = given(api, engineer, rig, "locked", **changed)
    assert answer.get("code") == code and says in answer["detail"], answer
    assert made == {}


def test_a_rational_lens_is_fitted_though_no_model_is_named(api, engineer, rig):
    rational = {"distortion_model": "rational_polynomial", "D": [0.4, 0.02, 1e-4, -2e-4, 0.0, 0.7, 0.1, 0.004]}
    _, made = given(api, engineer, rig, "locked", models=None, **rational)
    assert set(made) == {"rational_polynomial"} and made["rational_polynomial"]["locked"]["k6"] == 0.004
    answer, _ = given(api, engineer, rig, "locked", models=["pinhole"], **rational)
    assert answer["code"] == "intrinsics_of_another_model" and "rational_polynomial" in answer["hint"]


def test_rational_coefficients_that_are_zero_are_those_of_plumb_bob(api, engineer, rig):
    rational = {"distortion_model": "rational_polynomial", "D": [0.1, -0.2, 0.001, -0.002, 0.05, 0, 0, 0]}
    _, made = given(api, engineer, rig, "locked", **rational)
    assert made["brown_conrady"]["locked"]["k5"] == 0.05
    stranger = ask(engineer, rig, add_set(engineer, rig), intrinsics={"rear": PLUMB_BOB})
    assert (stranger.status_code, stranger.json()["code"]) == (422, "unknown_camera")


@pytest.mark.parametrize(
    ("asked", "loss", "outliers"),
    [
        ({}, "saturating", "exclude"),
        ({"preset": "toolbox", "outliers": "keep"}, "saturating", "keep"),
        ({"preset": "paper"}, "mean", "keep"),
        ({"preset": "paper", "loss": "saturating"}, "saturating", "keep"),
    ],
)
def test_wrong_marks_do_no_harm_unless_the_papers_form_is_asked_for(api, engineer, rig, asked, loss, outliers):
    made = ask(engineer, rig, add_set(engineer, rig), models=["pinhole"], folds=0, **asked).json()
    assert (made["request"]["loss"], made["request"]["outliers"]) == (loss, outliers)
    document = documents(api, made["id"])["pinhole", -1]
    assert (document["loss"], document["outliers"]) == (loss, outliers)


def test_a_request_becomes_a_run_for_every_model_and_fold(api, engineer, rig):
    answer = ask(engineer, rig, add_set(engineer, rig), models=["pinhole", "brown_conrady"], folds=3, farm="slots")
    assert answer.status_code == 202, answer.text
    made = answer.json()
    assert made["state"] == "queued"
    assert [(run["model"], run["fold"]) for run in made["runs"]] == [
        (model, fold) for model in ("brown_conrady", "pinhole") for fold in (-1, 0, 1, 2)
    ]
    assert made["progress"] == {"fraction": 0.0, "message": "0 of 8 fits have ended"}
    assert "name 'fx', which no model has" in made["notes"][0]
    with api.database.reading() as session:
        assert session.query(Calibration).one().remaining == 8
        runs = session.query(CalibrationRun).all()
        assert {(run.farm, run.slots, run.bundle, run.remaining) for run in runs} == {("slots", 2, 1, 2)}
        assert session.query(Job).filter_by(kind="solve").count() == 8 * 2
    document = documents(api, made["id"])[("pinhole", 1)]
    assert document["bounds"] == {"f_x": [300.0, 900.0]}
    assert (document["fold"], document["folds"], document["search"]) == (1, 3, "rotation_vector")
    assert document["image_size"] == [640, 480]
    assert document["nominal"]["to_frame"] == "camera_front_optical"
    assert document["seed"] == made["request"]["seed"]
    assert engineer.get(f"/calibrations/{made['id']}").json() == made
    assert engineer.get(f"/vehicles/{rig.vehicle_id}/calibrations").json()["items"] == [made]


def test_only_what_a_model_has_goes_into_its_document(api, engineer, rig):
    made = ask(
        engineer,
        rig,
        add_set(engineer, rig),
        models=["pinhole", "brown_conrady"],
        bounds={"f_x": [400, 500], "rotation_x_deg": [-10, 10]},
        locked={"skew": 0.0, "t_x": 0.1},
        priors={"k1": {"mean": 0.0, "sigma": 0.1}, "rotation_y_deg": {"mean": 90, "sigma": 180}},
        schedule={"slots": 3, "goal_px": 0.5},
    ).json()
    pinhole, brown = (documents(api, made["id"])[(model, -1)] for model in ("pinhole", "brown_conrady"))
    assert pinhole["bounds"]["f_x"] == brown["bounds"]["f_x"] == [400.0, 500.0]
    assert pinhole["bounds"]["rotation_x"] == pytest.approx([-0.17453293, 0.17453293])
    assert brown["bounds"]["k5"] == [-0.1, 0.1]
    assert "k5" not in pinhole["bounds"]
    assert pinhole["locked"] == {"t_x": 0.1}
    assert brown["locked"] == {"skew": 0.0, "t_x": 0.1}
    assert pinhole["priors"] == {"rotation_y": {"mean": pytest.approx(1.5707963), "sigma": pytest.approx(3.1415927)}}
    assert brown["priors"]["k1"] == {"mean": 0.0, "sigma": 0.1}
    usual = {
        "population": 800,
        "generations": 30,
        "scale": 0.7,
        "max_iterations": 60,
        "patience": 3,
        "tolerance": 1e-4,
        "agreeing": 2,
    }
    assert pinhole["schedule"] == {"slots": 3, "goal_px": 0.5, **usual}
    with api.database.reading() as session:
        assert {run.slots for run in session.query(CalibrationRun)} == {3}


def test_the_same_request_has_the_same_seed_whatever_its_ids_and_its_farming(api, fleet, engineer, rig):
    one = add_set(engineer, rig)
    first = ask(engineer, rig, one, farm="slots").json()
    again = ask(engineer, rig, one, farm="runs", publish="recommended").json()
    assert first["id"] != again["id"]
    assert first["request"]["seed"] == again["request"]["seed"]
    others = [
        ask(engineer, rig, one, loss="mean"),
        ask(engineer, rig, one, models=["pinhole"]),
        ask(engineer, rig, add_set(engineer, rig, count=61)),
        ask(engineer, rig, one, seed=7),
    ]
    seeds = {answer.json()["request"]["seed"] for answer in others}
    assert len(seeds | {first["request"]["seed"]}) == 5
    assert 7 in seeds


def test_the_paper_preset_means_its_own_form_and_bounds(api, engineer, rig):
    made = ask(engineer, rig, add_set(engineer, rig), models=["pinhole"], preset="paper").json()
    document = documents(api, made["id"])[("pinhole", -1)]
    assert (document["search"], document["bounds_preset"]) == ("euler", "paper-table-1")
    named = ask(engineer, rig, add_set(engineer, rig), models=["pinhole"], preset="paper", search="rotation_vector")
    assert documents(api, named.json()["id"])[("pinhole", -1)]["search"] == "rotation_vector"


@pytest.mark.parametrize(
    ("body", "code", "says"),
    [
        ({"models": ["fisheye"]}, "unknown_model", "kannala_brandt"),
        ({"models": ["fisheye"]}, "unknown_model", "brown_conrady"),
        ({"models": ["pinhole", "ocam"]}, "unknown_model", "'ocam'"),
        ({"bounds": {"f_x": [900, 300]}}, "bounds_inside_out", "f_x"),
        ({"bounds": {"f_x": [300, 300]}}, "bounds_inside_out", "locked"),
        ({"bounds": {"fx": [300, 900]}}, "unknown_parameter", "'fx'"),
        ({"models": ["pinhole"], "bounds": {"k1": [0, 1]}}, "unknown_parameter", "k1"),
        ({"locked": {"alpha": 0}}, "unknown_parameter", "rotation_x"),
        ({"locked": {"rotation_x": 0, "rotation_x_deg": 0}}, "unknown_parameter", "twice"),
        ({"priors": {"k1": {"mean": 0, "sigma": 0}}}, "invalid_request", "priors.k1.sigma"),
        ({"priors": {"f_x": {"mean": 1e308, "sigma": 1}}}, "invalid_request", "priors.f_x.mean: Input"),
        ({"priors": {"f_x": {"mean": 400, "sigma": 1e-320}}}, "invalid_request", "priors.f_x.sigma"),
        ({"priors": {"f_x": {"mean": 400, "sigma": 1e7}}}, "invalid_request", "priors.f_x.sigma"),
        ({"locked": {"f_x": 1e308}}, "invalid_request", "locked.f_x: Input should be less than or equal to 1000000"),
        ({"locked": {"f_x": 0}}, "locked_out_of_bounds", "no camera has a focal length below 1 px"),
        ({"locked": {"k1": 2}}, "locked_out_of_bounds", "outside of [-1, 1], the bounds of image-size"),
        (
            {"locked": {"f_y": 500}, "bounds": {"f_y": [510, 520]}},
            "locked_out_of_bounds",
            "[510, 520], the request's own bounds",
        ),
        ({"bounds": {"t_x": [-1e200, 1e200]}}, "invalid_request", "bounds.t_x.0: Input should be greater"),
        ({"schedule": {"population": 10}}, "invalid_request", "schedule.population"),
        ({"preset": "best"}, "invalid_request", "preset"),
        ({"models": []}, "invalid_request", "models"),
        ({"seed": 2**53}, "invalid_request", "seed"),
        ({"folds": 21}, "invalid_request", "folds"),
    ],
)
def test_what_cannot_be_is_refused_and_nothing_is_stored(api, engineer, rig, body, code, says):
    answer = ask(engineer, rig, add_set(engineer, rig), **body)
    problem = answer.json()
    assert (answer.status_code, problem["code"]) == (422, code)
    assert says in problem["detail"] + problem["hint"]
    with api.database.reading() as session:
        assert session.query(Calibration).count() == session.query(CalibrationRun).count() == 0


def test_too_few_pairs_names_both_numbers_and_a_lock_helps(api, engineer, rig):
    nine = add_set(engineer, rig, count=9)
    refused = ask(engineer, rig, nine, models=["pinhole"])
    assert refused.json()["code"] == "too_few_pairs"
    assert "9 pairs" in refused.json()["detail"] and "10 free" in refused.json()["detail"]
    helped = ask(engineer, rig, nine, models=["pinhole"], locked={"f_x": 500})
    assert helped.status_code == 202
    only = {"camera": "front", "model": "pinhole", "fold": -1, "state": "queued", "iteration": 0}
    assert helped.json()["runs"] == [only | {"best_loss": None, "failure": None}]
    assert any("Nothing is held out of pinhole on front" in note for note in helped.json()["notes"])


def test_held_out_blocks_are_whole_poses(api, engineer, rig):
    poses = [{"x": 4.0 + n, "y": 0.1 * n, "z": 0.3, "u": 10.0, "v": 20.0 + n, "group": n // 20} for n in range(60)]
    answer = ask(engineer, rig, bring_pairs(engineer, rig.id, poses), models=["pinhole"], folds=5).json()
    assert [run["fold"] for run in answer["runs"]] == [-1, 0, 1, 2]
    assert any("3 folds instead of 5" in note for note in answer["notes"])


def test_sets_must_fit_the_vehicle_the_rig_and_the_cameras(api, fleet, engineer, rig):
    one, two = add_set(engineer, rig), add_set(engineer, rig, count=50)
    assert ask(engineer, rig, one, two).json()["code"] == "camera_twice"
    other_fleet = api.fleet()
    stranger = api.member(other_fleet, "engineer")
    their_rig = seed_rig(api.database, other_fleet)
    theirs = add_set(stranger, their_rig)
    assert ask(engineer, rig, theirs).status_code == 404
    assert ask(stranger, rig, theirs).status_code == 404
    assert ask(engineer, rig, "00000000-0000-7000-8000-000000000000").status_code == 404


def test_what_a_set_said_of_itself_is_said_of_the_calibration_to_reviewers(api, fleet, engineer, rig):
    one = add_set(engineer, rig)
    with api.database.writing() as session:
        session.query(CorrespondenceSet).update(
            {"notes": ["31 of 222 corners have fewer than the 3 independent marks asked for."]}
        )
    made = ask(engineer, rig, one).json()
    assert "front: 31 of 222 corners have fewer than the 3 independent marks asked for." in made["notes"]
    addresses = (f"/calibrations/{made['id']}", f"/vehicles/{rig.vehicle_id}/calibrations")
    for role, sees in (("annotator", False), ("reviewer", True)):
        reader = api.member(fleet, role)
        for address in addresses:
            answer = reader.get(address).json()
            assert bool(answer.get("items", [answer])[0]["notes"]) == sees, "what people answered"


def test_cancelling_flags_every_job(api, engineer, rig):
    made = ask(engineer, rig, add_set(engineer, rig), models=["pinhole"]).json()
    answer = engineer.post(f"/calibrations/{made['id']}/cancel")
    assert answer.status_code == 202
    with api.database.reading() as session:
        assert all(job.cancel_requested for job in session.query(Job))


def test_the_seed_is_of_the_pairs_and_not_of_what_they_came_from(api, engineer, rig):
    one = add_set(engineer, rig)
    first = ask(engineer, rig, one).json()["request"]["seed"]
    with api.database.writing() as session:
        session.get_one(CorrespondenceSet, UUID(one)).content_hash = "of another recording"
    assert ask(engineer, rig, one).json()["request"]["seed"] == first
