"""Gates of rig and fleet: what fails is an objection, and the verdict stays with the publication."""

from __future__ import annotations

import numpy as np
from sqlalchemy import update

from service.platform.db.calibrations import Result
from tests.service.calibrations.test_results import DOCUMENT, FOUND, failed, seed_results
from tests.service.publications.given import history, publish, put_pairs
from tests.support.results import half

# As the solver names them (workers/solver/uncertainty.py).
STD = {
    "rotation_x": 0.02, "rotation_y": 0.05, "rotation_z": 0.01, "t_x": 0.004, "t_y": 0.002, "t_z": 0.007, "f_x": 3.0
}  # fmt: skip

COVARIANCE = {"names": list(STD), "units": [""] * len(STD), "matrix": np.diag(np.square(list(STD.values()))).tolist()}


def state(admin, kind, id, policy):
    etag = admin.get(f"/{kind}/{id}").headers["etag"]
    made = admin.put(f"/{kind}/{id}/policy", json=policy, headers={"If-Match": etag})
    assert made.status_code == 200, made.text
    return made.json()


def test_a_policy_is_stated_by_an_admin(fleet, rig, admin, engineer):
    assert state(admin, "fleets", fleet, {"heldout_mean_px": 0.8})["policy"] == {"heldout_mean_px": 0.8}
    assert admin.get(f"/fleets/{fleet}").json()["policy"] == {"heldout_mean_px": 0.8}
    assert state(admin, "rigs", rig.id, {"std_mm": 5})["policy"] == {"std_mm": 5.0}
    assert state(admin, "rigs", rig.id, {})["policy"] is None
    assert admin.put(f"/rigs/{rig.id}/policy", json={"std_mm": 5}).status_code == 428
    for wrong in ({"std_mm": 0}, {"coverage": 1.5}, {"heldout": 1}, {"std_deg": "x"}):
        answer = admin.put(f"/rigs/{rig.id}/policy", json=wrong, headers={"If-Match": '"v3"'})
        assert answer.status_code == 422, wrong


def test_what_misses_a_limit_is_published_with_a_reason_only(api, fleet, rig, admin):
    state(admin, "fleets", fleet, {"heldout_mean_px": 0.8, "std_deg": 0.1, "std_mm": 5})
    _, (result, _) = seed_results(api, rig)
    with api.database.writing() as session:
        session.execute(update(Result).values(document=DOCUMENT | {"std": STD, "covariance": COVARIANCE}))
    refused = admin.post(f"/results/{result}/publication")
    (check,) = refused.json()["checks"]
    assert (check["name"], check["verdict"]) == ("policy", "stop")
    assert check["sentence"] == (
        "The policy asks for at most 0.8 px as the mean error of held-out pairs; it is 0.9 px. "
        "The policy asks for at most 5 mm as the largest standard deviation of the translation; it is 7 mm."
    )
    assert check["figures"] == {"heldout_mean_px": 0.9, "std_deg": 0.05, "std_mm": 7.0}
    made = admin.post(f"/results/{result}/publication", {"override": {"reason": "For the yard only."}}).json()
    # A policy that changes later changes nothing of before.
    state(admin, "fleets", fleet, {})
    assert history(admin, rig)[0]["override"] == made["override"]
    assert made["override"] == {"reason": "For the yard only.", "sentences": [check["sentence"]]}


def test_a_rig_replaces_the_limits_of_the_same_name(api, fleet, rig, admin):
    state(admin, "fleets", fleet, {"heldout_mean_px": 0.8, "std_mm": 1})
    state(admin, "rigs", rig.id, {"heldout_mean_px": 2, "std_mm": 20})
    assert publish(api, rig, admin)["override"] is None


def test_a_measure_that_a_result_lacks_does_not_pass(api, rig, admin):
    state(admin, "rigs", rig.id, {"std_deg": 0.1})
    _, (result, _) = seed_results(api, rig)
    (against,) = failed(admin.get(f"/results/{result}").json())
    assert against.endswith("this result does not have it.")
    with api.database.writing() as session:
        std = STD | {"rotation_y": None}
        session.execute(update(Result).values(document=DOCUMENT | {"std": std}))
    assert "this result does not have it" in failed(admin.get(f"/results/{result}").json())[0]


def test_halves_and_the_spread_of_the_models_count_where_a_result_has_them(api, rig, admin):
    state(admin, "rigs", rig.id, {"halves_ratio": 1.5, "std_mm": 5})
    spread = {"std": STD | {"t_z": 0.006}, "interval95_half_width": {"t_z": 0.011}, "prediction": None}
    spread["covariance"] = DOCUMENT["covariance"]
    found = FOUND | {"between_models": {"weights": {}, **spread}}
    _, (result, _) = seed_results(api, rig, found=found)
    with api.database.writing() as session:
        halves = [half("alternating", ratio=1.2), half("first_and_last", ratio=1.7)]
        document = DOCUMENT | {"std": STD | {"t_z": 0.004}, "halves": halves}
        session.execute(update(Result).values(document=document))
    answer = admin.get(f"/results/{result}").json()
    assert {name: answer[name] for name in spread} == spread
    (missed,) = failed(answer)
    assert "the difference of halves" in missed and "it is 1.7" in missed
    assert "at most 5 mm" in missed and "it is 6 mm" in missed


def test_coverage_counts_the_cells_of_the_image_that_hold_pairs(api, rig, admin):
    """640 x 480: cells of 80 x 80. A pair that was left out, and one outside of the image, cover nothing."""
    state(admin, "rigs", rig.id, {"coverage": 0.5})
    cells = [(column, row) for column in range(8) for row in range(3)]
    u = [80.0 * column + 40 for column, _ in cells]
    v = [80.0 * row + 79.9 for _, row in cells]
    _, (result, _) = seed_results(api, rig)
    put_pairs(api, [*u, -1.0, 5.0], [*v, 5.0, 480.0])
    assert failed(admin.get(f"/results/{result}").json()) == []
    with api.database.writing() as session:
        left_out = [{"index": 3, "residual_px": 9.0, "score": 9.0, "reason": "x", "excluded": True}]
        session.execute(update(Result).values(document=DOCUMENT | {"outliers": left_out}))
    (against,) = failed(admin.get(f"/results/{result}").json())
    assert "at least 0.5" in against and against.endswith("it is 0.479.")
