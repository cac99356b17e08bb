"""`python -m tests.e2e.planted > tests/e2e/planted.json`: what checks say of each fault that `bench-judge` plants.

By case, what does not pass in the first draw whose verdict is not pass: 20 fits, a minute.
"""

import itertools
import json

import numpy as np

from apexcal.documents.checks import verdict_of
from benchmarks.judge.cases import CASES, Case
from benchmarks.judge.judging import calibrated
from service.platform.http.problems import Problem

Checks = list[dict[str, object]]


def failing(case: Case) -> Checks:
    """What does not pass in the first draw that the judge doubts; of sound and traceless cases in the first."""
    for seed in itertools.count(1):
        try:
            _, checks = calibrated(case.make(seed, np.random.default_rng([seed, 67])), with_folds=False)
        except Problem:
            continue
        if verdict_of(checks, "mount_with_lens") != "pass" or case.is_sound or not case.has_trace:
            return [check.model_dump(mode="json") for check in checks if check.is_doubt]
    raise AssertionError


if __name__ == "__main__":
    print(json.dumps({case.name: failing(case) for case in CASES}, indent=1))
