"""A detection that the machine has marked, and people who judge its marks."""

from collections.abc import Mapping, Sequence
from typing import Any
from uuid import UUID, uuid4

from apexcal.documents.states import WorkState
from service.platform.db.analyses import Analysis
from service.platform.db.annotations import CropPage
from service.platform.db.session import Database
from tests.service.detections.seeding import Seed, seed_answer, seed_marking
from tests.support.people import Actor, Api

SIGMA_PX = 0.4


def true_pixel(rank: int) -> tuple[float, float]:
    """Where the machine marks the vertex of this rank."""
    return 100.0 + 8.0 * rank, 200.0 + rank


def seed_marks(database: Database, seed: Seed, refused: int = 0, places: Sequence[Mapping[str, float]] = ()) -> UUID:
    """The machine's marks of all vertices but the last ``refused``, which may have two places; the analysis's id."""
    count, marked = len(seed.vertices), len(seed.vertices) - refused
    pixels = [true_pixel(rank) for rank in range(marked)]
    columns: dict[str, list[Any]] = {
        "vertex_id": [str(vertex) for vertex in seed.vertices],
        "corner": ["top"] * count,
        "u": [u for u, _ in pixels],
        "v": [v for _, v in pixels],
        "sigma_u": [SIGMA_PX] * marked,
        "sigma_v": [SIGMA_PX] * marked,
        "edge_px": [60.0] * marked,
        "reason": [None] * marked + ["two_places" if places else "no_edge"] * refused,
        "places": [[]] * marked + [list(places)] * refused,
    }
    marks = {name: values + [None] * (count - len(values)) for name, values in columns.items()}
    with database.writing() as session:
        of = {"fleet_id": seed.fleet_id, "vehicle_id": seed.vehicle_id, "recording_id": seed.recording_id}
        of |= {"detection_id": seed.detection_id, "kind": "machine_marks", "state": WorkState.DONE}
        row = Analysis(**of, asked={"camera": "front"}, result={"marks": marks})
        session.add(row)
        session.flush()
        return row.id


def seed_blind(api: Api, seed: Seed, ranks: range, off: tuple[float, float] = (0.0, 0.0)) -> None:
    """Somebody has marked these vertices blind, ``off`` from the machine's marks."""
    person = api.member(seed.fleet_id, "annotator", "blind")
    for rank in ranks:
        u, v = true_pixel(rank)
        seed_answer(api.database, seed, person.person_id, rank, "confirmed", (u + off[0], v + off[1]))


def seed_crops(api: Api, fleet: UUID, vertices: int, refused: int = 0) -> Seed:
    """A detection with the machine's marks of which five were also marked blind."""
    seed = seed_marking(api.database, fleet, vertices=vertices)
    seed_marks(api.database, seed, refused)
    seed_blind(api, seed, range(5))
    return seed


def ask(person: Actor, seed: Seed) -> Any:
    """Ask for a page of crops."""
    return person.post(f"/detections/{seed.detection_id}/crops/next", {"camera": "front"})


def progress(person: Actor, seed: Seed) -> dict[str, Any]:
    """How far the crops are."""
    return person.get(f"/detections/{seed.detection_id}/crops", params={"camera": "front"}).json()


def reply(person: Actor, page: dict[str, Any], wrong: list[str], id: str | None = None) -> Any:
    """Answer a page."""
    return person.post(f"/crop-pages/{page['id']}/answer", {"id": id or str(uuid4()), "wrong": wrong})


def shifted_on(api: Api, page: dict[str, Any]) -> list[str]:
    """The vertices whose marks the service has shifted, as only the database knows."""
    with api.database.reading() as session:
        return [one["vertex_id"] for one in session.get_one(CropPage, UUID(page["id"])).crops if one["shifted"]]


def finish(api: Api, person: Actor, seed: Seed, misses: int = 0) -> int:
    """Judge pages honestly until none is left, but for so many misses on each; returns how many pages there were."""
    for count in range(30):
        answer = ask(person, seed)
        if answer.status_code == 204:
            return count
        page = answer.json()
        assert reply(person, page, shifted_on(api, page)[misses:]).json()["accepted"]
    raise AssertionError("the pages do not end")
