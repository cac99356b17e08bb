"""What strangers' bytes make long is done beside the API."""

import os

import anyio
import pytest
from anyio.to_thread import run_sync

from service.platform.http.problems import Problem
from service.platform.http.processes import in_process


def _nice() -> tuple[int, int]:
    return os.getpid(), os.nice(0)


def test_it_is_another_process_that_yields_to_all_others():
    process, nice = anyio.run(run_sync, in_process, _nice)
    assert process != os.getpid() and nice == 19


def test_a_process_that_ends_is_a_refusal_and_the_next_call_has_a_new_one():
    async def ask():
        with pytest.raises(Problem) as refused:
            await run_sync(in_process, os._exit, 1)
        return refused.value, await run_sync(in_process, int, "3")

    problem, number = anyio.run(ask)
    assert (problem.status, problem.code, number) == (503, "reading_ended", 3)
