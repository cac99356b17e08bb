"""What the bench of verdicts sums up, and that it judges a walk by the product's own path."""

import numpy as np
import pytest

from benchmarks.coverage.calibrations import Bench
from benchmarks.coverage.marks import Errors, columns
from benchmarks.coverage.walks import pair, walk
from benchmarks.trust.__main__ import summary
from benchmarks.trust.judging import judge
from benchmarks.trust.runs import Told


def test_the_worst_fault_counts_at_its_larger_size_alone(capsys):
    judged = [Told(None, None, True, "stop", ["Why."]), Told(None, None, True, "look", [])]
    judged += [Told("turned_0.2", False, False, None, []), Told("turned_1.0", True, True, None, [])]
    judged += [Told("clock", True, True, "stop", []), Told("clock", False, True, "pass", [])]
    judged += [Told("shifted", None, True, None, [])]
    assert summary(judged) == {"worst_fault_named": 0.5, "sound_accused": 0.5}
    assert "against a sound result: Why." in capsys.readouterr().err
    assert summary([]) == {"worst_fault_named": None, "sound_accused": None}


@pytest.mark.slow
def test_wrong_marks_are_named_and_sound_ones_are_not():
    walked = walk(11)
    bench, paired = Bench(walked), pair(walked, "brown_conrady")
    request = {"models": ["brown_conrady"], "folds": 2}
    sound, wrong = (
        judge(bench, paired, columns(paired, Errors(blunders=share), np.random.default_rng(1)), request)
        for share in (0.0, 0.1)
    )
    assert sound.verdict.level != "stop" and not sound.failed
    assert wrong.verdict.level == "stop" and "wrong_pairs" in wrong.failed
