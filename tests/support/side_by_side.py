"""Which tests run on one process of `pytest -n`, and in which order, so that no processor is idle at the end."""

from __future__ import annotations

from typing import Any

import pytest
from xdist.scheduler.loadfile import LoadFileScheduling

# Starting a service costs more than most of what is asked of it: whoever shares one stays together. Farms mostly wait
# for processes to start and for leases to end, so they come one after the other, beside tests that compute. Nothing
# takes longer, so they come first.
_TOGETHER = (("tests/e2e/",), ("tests/faults/",), ("tests/apexcal/", "tests/integration/"))

_SERVED = tuple(folder for folders in _TOGETHER for folder in folders)

# `make` has compiled the kernels (tests/support/kernels.py). Long groups come first; short files fill up the end.
_FIRST = (
    *_SERVED,
    "tests/workers/vertices/",
    "tests/workers/solver/",
    "tests/workers/readers/",
    "tests/contract/",
)

# After so many seconds a long form hangs, or one that may be the first to start a service.
LONG_S = 900

# What is tested here is the database itself, who holds which row, what it takes as text, or how it orders.
_EVERY_CASE = (
    "tests/faults/",
    "tests/service/platform/db/",
    "tests/service/platform/jobs/",
    "tests/service/annotations/test_task_actions.py",
    "tests/service/platform/http/test_repeated_requests.py",
    "tests/service/platform/http/test_texts.py::test_what_is_no_text",
)

# Locks, constraints and statements that each database has of its own: each test's first case runs on PostgreSQL too.
_EVERY_TEST = (
    "tests/contract/test_work.py",
    "tests/service/admin/",
    "tests/service/analyses/",
    "tests/service/annotations/test_answer_actions.py",
    "tests/service/annotations/test_corners_of_long_walks.py",
    "tests/service/annotations/test_disclosure_actions.py",
    "tests/service/annotations/test_routes.py",
    "tests/service/calibration_runs/",
    "tests/service/calibrations/test_drift.py",
    "tests/service/calibrations/test_results.py",
    "tests/service/detections/",
    "tests/service/fleet_requests/",
    "tests/service/platform/auth/test_credential_actions.py",
    "tests/service/platform/health/",
    "tests/service/platform/http/test_one_thread.py",
    "tests/service/platform/http/test_problems.py::test_a_schema_of_another_version_is_said",
    "tests/service/platform/storage/",
    "tests/service/publications/test_actions.py",
    "tests/service/publications/test_retrieval.py",
    "tests/service/publications/test_routes.py::test_the_history_comes_in_pages",
    "tests/service/recordings/",
    "tests/workers/tasks/",
)


class SideBySide(LoadFileScheduling):
    """`--dist loadfile`, where some folders count as one file."""

    def _split_scope(self, nodeid: str) -> str:
        for folders in _TOGETHER:
            if nodeid.startswith(folders):
                return folders[0]
        return super()._split_scope(nodeid)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> SideBySide | None:
    """Only where a file's tests shall stay together anyway."""
    if config.getoption("dist") != "loadfile":
        return None
    config.option.loadscopereorder = False  # by their number of tests
    return SideBySide(config, log)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put them into that order, on every process alike."""
    for item in items:
        is_long = item.get_closest_marker("slow") or item.nodeid.startswith(_SERVED)
        if is_long and not item.get_closest_marker("timeout"):
            item.add_marker(pytest.mark.timeout(LONG_S))
    _leave_out_crossed(items)
    items.sort(
        key=lambda item: next((n for n, name in enumerate(_FIRST) if item.nodeid.startswith(name)), len(_FIRST))
    )


def _leave_out_crossed(items: list[pytest.Item]) -> None:
    """Mark as slow on PostgreSQL all but a file's first test, or all but a test's first case."""
    all_ids = {item.nodeid for item in items}
    seen: set[str] = set()
    for item in items:
        test, _, case = item.nodeid.partition("[")
        on_sqlite = f"{test}[{case.replace('postgresql', 'sqlite')}"
        if "postgresql" not in case or on_sqlite not in all_ids or test.startswith(_EVERY_CASE):
            continue
        once = test if test.startswith(_EVERY_TEST) else test.partition("::")[0]
        if once in seen:
            item.add_marker("slow")
        elif not item.get_closest_marker("slow"):
            seen.add(once)
