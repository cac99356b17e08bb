"""A handful of annotators drain a small recording in a real API process, and its short form: exact in every run."""

import json
import os
import subprocess
import sys

import pytest

from benchmarks.annotators.__main__ import measure


@pytest.mark.parametrize("kind", ["sqlite", pytest.param("postgresql", marks=pytest.mark.slow)])
def test_few_annotators_leave_each_vertex_with_exactly_as_many_answers_as_wanted(kind):
    found = measure(kind, 4, 2, vertices=6, think_s=(0.0, 0.0))
    assert found["wrong"] == []
    assert [status for status in found["refused"] if int(status) >= 400] == []


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_the_short_form():
    done = subprocess.run(
        (sys.executable, "-m", "benchmarks.annotators"),
        env={**os.environ, "SHORT": "1"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    runs = [json.loads(line) for line in done.stdout.strip().splitlines()]
    assert len(runs) == 10
    for run in runs:
        assert run["wrong"] == [], run
        assert [status for status in run["refused"] if int(status) >= 500] == [], run
