import json
import subprocess
import sys

import pytest

from workers.simulation.__main__ import main


def test_the_command_reports_progress_and_a_summary_as_json(tmp_path):
    command = [sys.executable, "-m", "workers.simulation", "--out", str(tmp_path / "rig"), "--seconds", "1"]
    done = subprocess.run([*command, "--progress-json"], capture_output=True, text=True, check=True)
    *progress, summary = [json.loads(line) for line in done.stdout.splitlines()]
    assert {line["stage"] for line in progress} == {"background", "recording"}
    assert progress[-1]["done"] == progress[-1]["total"] == summary["sweeps"] + summary["frames"]
    assert (tmp_path / "rig" / "recording.bag").stat().st_size == summary["recording_bytes"]
    again = subprocess.run(command, capture_output=True, text=True, check=False)
    assert again.returncode == 2
    assert "there already" in again.stderr
    assert "--out" in again.stderr


def test_a_value_out_of_range_is_explained(tmp_path, capsys):
    assert main(["--out", str(tmp_path), "--seconds", "0", "--json"]) == 2
    answer = json.loads(capsys.readouterr().err)
    assert "seconds" in answer["error"]["message"]
    assert list(tmp_path.iterdir()) == []


def test_help_names_every_option(capsys):
    with pytest.raises(SystemExit) as left:
        main(["--help"])
    assert left.value.code == 0
    text = capsys.readouterr().out
    for option in ("--out", "--seconds", "--seed", "--camera-model", "--sensor", "--rings", "--sector-deg",
                   "--range-noise-mm", "--format", "--json", "--progress-json"):  # fmt: skip
        assert option in text


def test_a_plain_run_says_where_things_are(tmp_path, capsys):
    assert main(["--out", str(tmp_path / "plain"), "--seconds", "1", "--camera-model", "pinhole"]) == 0
    assert "truth.json" in capsys.readouterr().out
