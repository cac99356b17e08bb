"""How much an answer asks of the database, as the page asks: with two vertices ahead."""

from sqlalchemy import event

from tests.service.annotations.test_routes import ask, reply
from tests.service.detections.seeding import seed_marking


def test_an_answer_and_the_next_tasks_take_eighteen_statements(api, fleet):
    seed = seed_marking(api.database, fleet, vertices=12, marks_per_vertex=2)
    one, two = api.member(fleet, "annotator", "one"), api.member(fleet, "annotator", "two")
    task = ask(one, seed, ahead=2)
    other = ask(two, seed, ahead=2)
    for person, held in ((one, task), (two, other)):
        person.get(f"/detections/{seed.detection_id}/progress?camera=front")
        assert reply(person, held).status_code == 200
    task = ask(one, seed, ahead=2)
    asked: list[str] = []

    def note(connection, cursor, statement, parameters, context, many):
        if not statement.startswith("BEGIN"):
            asked.append(statement)

    event.listen(api.database.engine, "before_cursor_execute", note)
    assert reply(one, task).status_code == 200
    answer = len(asked)
    assert ask(one, seed, ahead=2) is not None
    event.remove(api.database.engine, "before_cursor_execute", note)
    print(f"{answer} statements an answer, {len(asked) - answer} a hand-out")
    assert len(asked) <= 18, "\n\n".join(asked)
    assert answer <= 8
