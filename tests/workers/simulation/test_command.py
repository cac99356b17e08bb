import json
import subprocess
import sys

import pytest

from workers.simulation.__main__ import main
from workers.simulation.disturbances import Disturbances
from workers.simulation.options import parser, settings_of
from workers.simulation.settings import CameraSpec, Settings


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
    for option in ("--out", "--seconds", "--seed", "--camera-model", "--cameras", "--camera-hz", "--pitch-down-deg",
                   "--clock-offset-ms", "--clock-jitter-ms", "--sensor", "--rings", "--sector-deg", "--beam-mrad",
                   "--range-noise-mm", "--dropouts", "--walk", "--board", "--walker-height-m", "--head-above-m",
                   "--second-person", "--poles", "--speckle", "--format", "--camera-info", "--tree", "--json",
                   "--progress-json"):  # fmt: skip
        assert option in text


def test_every_option_reaches_the_settings():
    words = (
        "--out x --seconds 30 --seed 9 --camera-model pinhole --cameras front,side:60:kannala_brandt --camera-hz 10 "
        "--pitch-down-deg 5 --clock-offset-ms -12.5 --clock-jitter-ms 2 --sensor hdl64 --rings 20 --sector-deg 50 "
        "--range-noise-mm 20 --beam-mrad 3 --dropouts 0.1 --walk field --board 0.5x0.9 --walker-height-m 1.9 "
        "--head-above-m 0.1 --second-person behind --poles 3 --speckle 0.02 --format mcap "
        "--camera-info raw --tree true"
    )
    assert settings_of(parser().parse_args(words.split())) == Settings(
        seconds=30.0,
        seed=9,
        camera_model="pinhole",
        cameras=(CameraSpec("front"), CameraSpec("side", 60.0, "kannala_brandt")),
        camera_hz=10.0,
        pitch_down_deg=5.0,
        clock_offset_ms=-12.5,
        clock_jitter_ms=2.0,
        sensor="hdl64",
        rings=20,
        sector_deg=50.0,
        range_noise_mm=20.0,
        walk="field",
        board_m=(0.5, 0.9),
        disturbances=Disturbances(3.0, 0.1, 0.02, 1.9, 0.1, "behind", 3),
        format="mcap",
        camera_info="raw",
        tree="true",
    )
    assert settings_of(parser().parse_args(["--out", "x"])) == Settings()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--cameras rear", "rear:DEGREES"),
        ("--cameras front:abc", "no angle"),
        ("--cameras front:0:fisheye", "no camera model 'fisheye'"),
        ("--cameras front,front", "different names"),
        ("--cameras 12", "1 to 11"),
        ("--cameras Front:1", "no name for a camera"),
        ("--board 0.6", "0.61x0.91"),
        ("--board 0.6x9", "between 0.3 and 1.5"),
        ("--dropouts 2", "dropout_share"),
        ("--format pcap --sensor os1-64", "another format"),
        ("--format zip --camera-info raw", "hold a CameraInfo"),
    ],
)
def test_what_cannot_be_simulated_is_said_in_a_sentence(tmp_path, capsys, words, said):
    assert main(["--out", str(tmp_path), *words.split()]) == 2
    assert said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_plain_run_says_where_things_are(tmp_path, capsys):
    assert main(["--out", str(tmp_path / "plain"), "--seconds", "1", "--camera-model", "pinhole"]) == 0
    assert "truth.json" in capsys.readouterr().out
