"""What is wrong with a document is said in our words, without those of the library."""

import pytest
from pydantic import ValidationError

from apexcal.documents.base import first_fault
from apexcal.documents.fleets import NewRig
from apexcal.documents.transforms import Matrix


def test_a_fault_is_a_sentence_of_ours_and_says_where() -> None:
    with pytest.raises(ValidationError) as refused:
        Matrix.model_validate({"matrix": [[1, 0, 0], [0, 1, 0], [0, 0, 2]]})
    assert "Value error" in str(refused.value)
    assert first_fault(refused.value)[1].startswith("the rows are not orthonormal")
    with pytest.raises(ValidationError) as refused:
        NewRig.model_validate({"name": "roof", "lidar": {"frame": "velodyne"}, "cameras": [{"name": "front"}]})
    assert first_fault(refused.value) == ("cameras.0.frame", "Field required")
