"""Tests wait for what they need, never for a while: a sleep proves nothing on a machine that is busy."""

import ast
from pathlib import Path

TESTS = Path(__file__).parents[1]
_SLEEPS = ("sleep", "wait_for_timeout")
# A sleep outside of a `while` that looks again, and what it is instead of a proof.
PACES = {
    "e2e/screenshots.py": "for people who look at the pictures",
    "e2e/test_states.py": "for people who look at the pictures",
    "e2e/test_marking.py": "a person's second for each mark; and a loop that looks again",
    "e2e/test_marking_beside.py": "between two taps, which would be a double tap otherwise",
    "e2e/test_marks_kept.py": "a loop that looks again, as often as a minute takes",
    "e2e/test_workspace.py": "a loop that looks again, as often as half a minute takes",
    "faults/test_nothing_is_lost.py": "how long the broker stays away",
    "service/platform/http/test_connections.py": "between two pieces of what is endless",
    "service/test_app.py": "how far the service has come when it is stopped",
}


def sleeps(tree: ast.AST, in_loop: bool = False) -> list[int]:
    """Lines with a sleep that stands in no `while`."""
    found = []
    for node in ast.iter_child_nodes(tree):
        looks_again = isinstance(node, ast.While) or (in_loop and not isinstance(node, ast.FunctionDef))
        if isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in _SLEEPS and not in_loop:
            found.append(node.lineno)
        found += sleeps(node, looks_again)
    return found


def test_a_sleep_stands_in_a_loop_that_looks_again() -> None:
    places = {str(path.relative_to(TESTS)): sleeps(ast.parse(path.read_text())) for path in TESTS.rglob("*.py")}
    bare = {name: lines for name, lines in places.items() if lines}
    assert {name: lines for name, lines in bare.items() if name not in PACES} == {}, (
        "wait for what is needed: tests/support/processes.py has wait_until, tests/support/databases.py "
        "wait_until_one_waits"
    )
    assert set(PACES) == set(bare), "an exception that is no more"
