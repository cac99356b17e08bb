"""Options of the form CAMERA=FILE."""

from apexcal.commands.camera_files import camera_and_file


def test_a_camera_before_its_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert [str(part) for part in camera_and_file("front=a.csv")] == ["front", "a.csv"]
    assert [str(part) for part in camera_and_file("a.csv")] == ["", "a.csv"]
    (tmp_path / "a=b.csv").touch()
    assert [str(part) for part in camera_and_file("a=b.csv")] == ["", "a=b.csv"]
