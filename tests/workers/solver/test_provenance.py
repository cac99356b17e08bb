"""The same inputs and sources have the same digests; any change has another."""

import pytest

from workers.solver import provenance
from workers.solver.provenance import pairs_sha256, sources_sha256


def test_pairs_are_told_by_their_values_and_not_by_their_order_of_columns():
    pairs = {
        "x": [1.0, 2.0],
        "y": [0.5, 0.25],
        "z": [0, 1],
        "u": [3, 4],
        "v": [1e-3, 2.0],
        "stamp_ns": [1, 2**62],
    }
    same = dict(reversed(pairs.items())) | {"z": [0.0, 1.0], "u": [3.0, 4.0]}
    assert pairs_sha256(pairs) == pairs_sha256(same)
    assert pairs_sha256(pairs) != pairs_sha256(pairs | {"u": [3.0, 4.0 + 1e-15 * 4]})
    assert pairs_sha256(pairs) != pairs_sha256(pairs | {"stamp_ns": [1, 2**62 + 1]})
    with pytest.raises(ValueError, match="not JSON compliant"):
        pairs_sha256(pairs | {"v": [float("nan"), 1.0]})


def test_an_edited_source_has_another_digest(tmp_path, monkeypatch):
    files = ("workers/geometry/one.py", "workers/solver/one.py", "apexcal/documents/bounds.py")
    for file in files:
        (tmp_path / file).parent.mkdir(parents=True)
        (tmp_path / file).write_text("x = 1\n")
    monkeypatch.setattr(provenance, "__file__", str(tmp_path / "workers" / "solver" / "provenance.py"))
    digests = set()
    for edit in (None, *zip(files, ("x = 2\n", "x = 1\n\n", "x = 3\n"), strict=True)):
        if edit:
            (tmp_path / edit[0]).write_text(edit[1])
        sources_sha256.cache_clear()
        digests.add(sources_sha256())
    sources_sha256.cache_clear()
    assert len(digests) == 4
