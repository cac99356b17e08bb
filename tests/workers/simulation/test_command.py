"""The options of `python -m workers.simulation`, and what it says."""

import json

import pytest

from apexcal.documents.simulation import SimulationOptions, WalkName
from workers.simulation.__main__ import main
from workers.simulation.sensors import SENSORS
from workers.simulation.walks import WALKS


def test_the_command_reports_progress_and_a_summary(tmp_path, capsys):
    words = ["--out", str(tmp_path / "rig"), "--seconds", "1", "--camera-hz", "4"]
    assert main([*words, "--progress-json"]) == 0
    *progress, summary = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {line["stage"] for line in progress} == {"background", "recording"}
    assert progress[-1]["done"] == progress[-1]["total"] == summary["sweeps"] + summary["frames"]
    assert (tmp_path / "rig" / "recording.bag").stat().st_size == summary["recording_bytes"]
    assert main(words) == 2
    refused = capsys.readouterr().err
    assert "there already" in refused and "--out" in refused


EVERY_OPTION = """
    --seconds 1 --seed 9 --camera-model pinhole --cameras front,side:60:kannala_brandt --camera-hz 2
    --pitch-down-deg 5 --clock-offset-ms -12.5 --clock-jitter-ms 2 --sensor hdl64 --rings 20 --sector-deg 50
    --range-noise-mm 20 --beam-mrad 3 --dropouts 0.1 --walk field --board 0.5x0.9 --walker-height-m 1.9
    --head-above-m 0.1 --second-person behind --poles 3 --speckle 0.02 --format mcap --camera-info raw --tree true
    --images thermal
"""


def test_every_option_reaches_the_simulation(tmp_path, capsys):
    words = EVERY_OPTION.split()
    assert main(["--out", str(tmp_path), *words]) == 0
    stated = json.loads((tmp_path / "truth.json").read_text())["settings"]
    names = [word.removeprefix("--").replace("-", "_") for word in words[::2]]
    assert {name: str(stated[name]) for name in names} == {
        name: str(float(text)) if isinstance(stated[name], float) else text
        for name, text in zip(names, words[1::2], strict=True)
    }
    assert set(names) == set(SimulationOptions.model_fields)


def test_every_sensor_and_walk_that_can_be_asked_for_is_there():
    assert set(SENSORS) == set(SimulationOptions.model_fields["sensor"].annotation.__args__)
    assert set(WALKS) == set(WalkName.__args__)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("--cameras rear", "--cameras: where does camera 'rear' look? Say rear:DEGREES"),
        ("--cameras front:abc", "no angle"),
        ("--cameras front:0:fisheye", "no camera model 'fisheye'"),
        ("--cameras front,front", "different names"),
        ("--cameras 12", "1 to 11"),
        ("--cameras Front:1", "no name for a camera"),
        ("--cameras lidar:1", "no name for a camera"),
        ("--cameras side:71", "within 70 degrees"),
        ("--board 0.6", "0.61x0.91"),
        ("--board 0.6x9", "between 0.3 and 1.5"),
        ("--dropouts 2", "--dropouts: "),
        ("--beam-mrad -1", "--beam-mrad: "),
        ("--second-person above", "'none', 'beside' or 'behind'"),
        ("--format pcap", "'bag', 'db3' or 'mcap'"),
        ("--seconds 0", "--seconds: "),
        ("--seconds nan", "--seconds: "),
        ("--seed -1", "--seed: "),
        ("--sensor vlp17", "--sensor: "),
        ("--rings 2", "--rings: "),
        ("--sector-deg 181", "--sector-deg: "),
        ("--range-noise-mm -1", "--range-noise-mm: "),
    ],
)
def test_what_cannot_be_simulated_is_said_in_a_sentence(tmp_path, capsys, words, sentence):
    assert main(["--out", str(tmp_path), *words.split()]) == 2
    answer = capsys.readouterr().err
    assert sentence in answer and answer.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
