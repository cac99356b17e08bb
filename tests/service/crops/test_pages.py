"""Pages of crops: some marks are shifted and nobody is told which; an answer is one; two people get other marks."""

import json
from concurrent.futures import ThreadPoolExecutor
from uuid import UUID, uuid4

import pytest
from sqlalchemy import select

from service.platform.db.analyses import Analysis
from service.platform.db.annotations import Answer, CropPage, Disclosure
from service.platform.db.session import Database
from tests.service.crops.marking import (
    ask,
    finish,
    progress,
    reply,
    seed_blind,
    seed_crops,
    seed_marks,
    shifted_on,
    true_pixel,
)
from tests.service.detections.seeding import seed_marking


@pytest.fixture
def ida(api, fleet):
    return api.member(fleet, "annotator", "Ida")


@pytest.fixture
def ben(api, fleet):
    return api.member(fleet, "annotator", "Ben")


def test_a_page_tells_pixels_to_draw_and_nothing_of_which_are_shifted(api, fleet, ida):
    seed = seed_crops(api, fleet, vertices=60)
    page = ask(ida, seed).json()
    assert len(page["crops"]) == 24
    rank = {str(vertex): index for index, vertex in enumerate(seed.vertices)}
    off = [one["vertex_id"] for one in page["crops"] if (one["u"], one["v"]) != true_pixel(rank[one["vertex_id"]])]
    assert sorted(off) == sorted(shifted_on(api, page)) and 3 <= len(off) <= 6
    assert len({frozenset(one) for one in page["crops"]}) == 1, "a shifted crop has the members of all others"
    for crop in page["crops"]:
        assert set(crop) == {"vertex_id", "corner", "frame_index", "u", "v", "side_px", "image"}
        assert crop["side_px"] == 60.0
        assert crop["image"]["url"].endswith(f"/cameras/front/frames/{crop['frame_index']}")
    assert "shift" not in json.dumps(page)
    assert ask(ida, seed).json() == page, "asked again it is the same page"


def test_an_honest_person_comes_to_the_end_and_what_they_confirm_counts(api, fleet, ida, engineer):
    seed = seed_crops(api, fleet, vertices=60)
    assert progress(ida, seed) == {
        "marks": 60,
        "judged": 5,
        "blind_needed": 0,
        "next_blind": str(seed.vertices[5]),
        "unmarked": 0,
        "next_unmarked": None,
    }
    pages = finish(api, ida, seed)
    assert 3 <= pages <= 5
    assert progress(ida, seed)["judged"] == 60
    made = engineer.post(f"/detections/{seed.detection_id}/correspondence-sets", {"camera": "front"}).json()
    assert made["count"] == 60
    assert "55 of 60 marks are the machine's; people looked at 55 of these." in made["notes"]


def test_whoever_accepts_everything_is_told_so_and_confirms_nothing(api, fleet, ida, engineer):
    seed = seed_crops(api, fleet, vertices=60)
    page = ask(ida, seed).json()
    verdict = reply(ida, page, []).json()
    count = len(shifted_on(api, page))
    assert (verdict["accepted"], verdict["missed"], verdict["shifted"]) == (False, count, count)
    assert (verdict["confirmed"], verdict["rejected"]) == (0, 0)
    assert verdict["sentence"].startswith("You accepted every mark of the page, but the service had shifted")
    assert verdict["progress"]["judged"] == 5
    again = ask(ida, seed).json()
    assert again["id"] != page["id"]
    sets = f"/detections/{seed.detection_id}/correspondence-sets"
    assert engineer.post(sets, {"camera": "front"}).json()["count"] == 5, "what was marked blind"


def test_one_miss_is_forgiven_and_two_are_not(api, fleet, ida):
    seed = seed_crops(api, fleet, vertices=60)
    page = ask(ida, seed).json()
    verdict = reply(ida, page, shifted_on(api, page)[2:]).json()
    assert (verdict["accepted"], verdict["missed"]) == (False, 2)
    page = ask(ida, seed).json()
    verdict = reply(ida, page, shifted_on(api, page)[1:]).json()
    assert (verdict["accepted"], verdict["missed"]) == (True, 1)
    assert verdict["confirmed"] == 24 - len(shifted_on(api, page))


def test_a_rejected_mark_is_taken_out_of_the_pairs(api, fleet, ida, engineer):
    seed = seed_crops(api, fleet, vertices=60)
    page = ask(ida, seed).json()
    shifted = shifted_on(api, page)
    rejected = next(one["vertex_id"] for one in page["crops"] if one["vertex_id"] not in shifted)
    verdict = reply(ida, page, [*shifted, rejected]).json()
    assert (verdict["accepted"], verdict["rejected"]) == (True, 1)
    assert (verdict["progress"]["unmarked"], verdict["progress"]["next_unmarked"]) == (1, rejected)
    sets = f"/detections/{seed.detection_id}/correspondence-sets"
    made = engineer.post(sets, {"camera": "front", "machine_marks": True}).json()
    pairs = engineer.get(f"/correspondence-sets/{made['id']}").json()["pairs"]
    assert len(pairs) == 59
    rank = {str(vertex): index for index, vertex in enumerate(seed.vertices)}[rejected]
    assert true_pixel(rank) not in {(pair["u"], pair["v"]) for pair in pairs}


def test_the_same_answer_twice_is_one_and_another_one_is_refused(api, fleet, ida):
    seed = seed_crops(api, fleet, vertices=60)
    page = ask(ida, seed).json()
    shifted, id = shifted_on(api, page), str(uuid4())
    first = reply(ida, page, shifted, id).json()
    assert reply(ida, page, list(reversed(shifted)), id).json() == first
    other = reply(ida, page, [], id)
    assert (other.status_code, other.json()["code"]) == (409, "answer_id_used")
    elsewhere = reply(ida, page, shifted)
    assert (elsewhere.status_code, elsewhere.json()["code"]) == (409, "page_answered")
    strange = reply(ida, ask(ida, seed).json(), [str(uuid4())])
    assert (strange.status_code, strange.json()["code"]) == (422, "not_on_page")
    with api.database.reading() as session:
        answered = session.scalars(select(CropPage).where(CropPage.answered_at.is_not(None))).all()
    assert [str(row.id) for row in answered] == [page["id"]]


def test_two_tabs_share_a_page_and_two_people_who_ask_at_once_get_other_marks(api, fleet, ida, ben):
    seed = seed_crops(api, fleet, vertices=60)
    people = [ida, ben, ida, ben]
    with ThreadPoolExecutor(4) as pool:
        pages = [answer.json() for answer in pool.map(lambda person: ask(person, seed), people)]
    assert pages[0] == pages[2] and pages[1] == pages[3]
    vertices = [{one["vertex_id"] for one in page["crops"]} for page in pages[:2]]
    assert vertices[0].isdisjoint(vertices[1])
    assert reply(ben, pages[0], []).status_code == 404, "another person's page does not exist"
    id, shifted = str(uuid4()), shifted_on(api, pages[0])
    with ThreadPoolExecutor(2) as pool:
        both = [*pool.map(lambda _: reply(ida, pages[0], shifted, id).json(), range(2))]
    assert both[0] == both[1] and both[0]["accepted"]


def test_some_are_marked_blind_first_and_reviewed_ones_do_not_count(api, fleet, ida):
    seed = seed_marking(api.database, fleet, vertices=30)
    none = ask(ida, seed)
    assert (none.status_code, none.json()["code"]) == (409, "no_marks")
    seed_marks(api.database, seed, refused=4)
    assert progress(ida, seed)["blind_needed"] == 5
    seed_blind(api, seed, range(4))
    seed_blind(api, seed, range(26, 30))  # where the machine has no mark they measure nothing
    refused = ask(ida, seed)
    assert (refused.status_code, refused.json()["code"], refused.json()["blind_needed"]) == (
        409,
        "blind_marks_first",
        1,
    )
    with api.database.writing() as session:
        session.scalars(select(Answer).where(Answer.frame_index == 0)).one().reviewed = True
    assert progress(ida, seed)["blind_needed"] == 2
    seed_blind(api, seed, range(10, 12))
    assert ask(ida, seed).status_code == 200


def test_what_one_saw_on_a_page_is_disclosed_and_an_answer_afterwards_is_reviewed(api, fleet, ida):
    seed = seed_crops(api, fleet, vertices=60)
    page = ask(ida, seed).json()
    with api.database.reading() as session:
        rows = session.scalars(select(Disclosure).where(Disclosure.person_id == ida.person_id)).all()
    assert {row.frame_index for row in rows} == {one["frame_index"] for one in page["crops"]}
    assert {row.told_in for row in rows} == {"crops"}
    vertex = page["crops"][0]["vertex_id"]
    asked = {"camera": "front", "vertex_id": vertex, "ahead": 2}
    task = ida.post(f"/detections/{seed.detection_id}/tasks/next", asked).json()
    assert task["vertex"]["id"] == vertex and len(task["ahead"]) == 2
    answer = {"id": str(uuid4()), "version": 0, "verdict": "confirmed", "mark": {"u": 5.0, "v": 6.0}}
    assert ida.post(f"/tasks/{task['task_id']}/answer", answer).json()["reviewed"]
    strange = ida.post(f"/detections/{seed.detection_id}/tasks/next", asked | {"vertex_id": str(uuid4())})
    assert strange.status_code == 404


def test_corners_without_a_mark_of_the_machine_are_named_for_the_marking_page(api, fleet, ida, engineer):
    seed = seed_crops(api, fleet, vertices=30, refused=3)
    now = progress(ida, seed)
    assert (now["marks"], now["unmarked"], now["next_unmarked"]) == (27, 3, str(seed.vertices[27]))
    seed_blind(api, seed, range(27, 28))
    now = progress(ida, seed)
    assert (now["unmarked"], now["next_unmarked"]) == (2, str(seed.vertices[28]))


def test_with_few_marks_there_is_no_page(api, fleet, ida):
    seed = seed_marking(api.database, fleet, vertices=8)
    seed_marks(api.database, seed, refused=3)
    refused = ask(ida, seed)
    assert (refused.status_code, refused.json()["code"]) == (409, "too_few_marks")


def test_misses_widen_what_is_stated_of_a_confirmed_mark(api):
    deviations = []
    for misses in (0, 1):
        fleet = api.fleet()
        person, engineer = api.member(fleet, "annotator"), api.member(fleet, "engineer")
        seed = seed_crops(api, fleet, vertices=40)
        finish(api, person, seed, misses)
        made = engineer.post(f"/detections/{seed.detection_id}/correspondence-sets", {"camera": "front"}).json()
        pairs = engineer.get(f"/correspondence-sets/{made['id']}").json()["pairs"]
        blind, others = pairs[:5], pairs[5:]
        assert all(pair["sigma_px"] is None and not pair["machine"] and pair["confirmed"] == 0 for pair in blind)
        assert all(pair["machine_off_px"] == [0.0, 0.0] for pair in blind)
        assert all(pair["machine"] and pair["confirmed"] == 1 and pair["reviewed"] == 1 for pair in others)
        assert all(pair["marks"] == 1 and pair["machine_off_px"] is None for pair in others), "nobody else is blind"
        assert len({pair["sigma_px"] for pair in others}) == 1
        deviations.append(others[0]["sigma_px"])
    assert 0.4 < deviations[0] < deviations[1] < 2.0


def test_marks_of_a_person_who_is_away_are_given_to_others(api, fleet, ida, ben):
    seed = seed_crops(api, fleet, vertices=12)
    page = ask(ida, seed).json()
    assert ask(ben, seed).status_code == 204
    database: Database = api.database
    with database.writing() as session:
        row = session.get_one(CropPage, UUID(page["id"]))
        row.created_at = row.created_at.replace(year=2020)
    theirs = ask(ben, seed).json()
    assert {one["vertex_id"] for one in theirs["crops"]} == {one["vertex_id"] for one in page["crops"]}
    for person, own in ((ida, page), (ben, theirs)):
        assert reply(person, own, shifted_on(api, own)).json()["accepted"], "a late answer counts"


def test_an_annotators_work_is_listed_with_what_waits(api, fleet, ida):
    seed = seed_crops(api, fleet, vertices=60)
    (work,) = ida.get(f"/fleets/{fleet}/marking-work").json()
    assert (work["detection_id"], work["camera"]) == (str(seed.detection_id), "front")
    assert (work["waiting"], work["to_confirm"], work["mine"]) == (55, 55, 0)
    page = ask(ida, seed).json()
    confirmed = reply(ida, page, shifted_on(api, page)).json()["confirmed"]
    (work,) = ida.get(f"/fleets/{fleet}/marking-work").json()
    assert (work["waiting"], work["to_confirm"], work["mine"]) == (55 - confirmed, 55 - confirmed, confirmed)
    finish(api, ida, seed)
    assert ida.get(f"/fleets/{fleet}/marking-work").json() == []


def test_nobody_is_shown_a_mark_outside_of_its_frame(api, fleet, ida):
    seed = seed_crops(api, fleet, vertices=40)
    with api.database.writing() as session:
        analysis = session.scalars(select(Analysis)).one()
        marks = {name: list(column) for name, column in analysis.result["marks"].items()}
        marks["v"][7], marks["u"][8] = -40.0, 5000.0
        analysis.result = {"marks": marks}
    assert progress(ida, seed)["marks"] == 38 and progress(ida, seed)["unmarked"] == 0
    finish(api, ida, seed)
    assert progress(ida, seed)["judged"] == 38
