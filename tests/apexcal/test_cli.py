"""The command's manners: quick help, sentences instead of tracebacks, exit codes."""

import fcntl
import json
import os
import resource
import subprocess
import sys
from uuid import uuid4

import pytest
import typer
from typer.testing import CliRunner

from apexcal.cli import COMMANDS, app
from apexcal.client import Client, ClientError
from apexcal.commands.named import pick
from apexcal.commands.session import Reply, Session
from apexcal.commands.terminal import complain
from apexcal.documents.fleets import VehicleOut

PASSED_ON = ("admin", "simulate", "pull")


def apexcal(*words: object, **environment: str) -> subprocess.CompletedProcess[str]:
    """The command within this process: starting one of its own costs more than most of what is asked of it."""
    if words[0] in PASSED_ON:
        return program(*words, **environment)
    named = dict.fromkeys([k for k in os.environ if k.startswith("APEXCAL_")])
    ran = CliRunner().invoke(app, [*map(str, words)], env=named | environment, prog_name="apexcal")
    if ran.exception and not isinstance(ran.exception, SystemExit):
        raise ran.exception
    return subprocess.CompletedProcess(words, ran.exit_code, ran.stdout, ran.stderr)


def program(*words: object, **environment: str) -> subprocess.CompletedProcess[str]:
    """The command as a process of its own."""
    clean = {k: v for k, v in os.environ.items() if not k.startswith("APEXCAL_")}
    return subprocess.run(
        [sys.executable, "-m", "apexcal.cli", *map(str, words)],
        capture_output=True,
        text=True,
        env=clean | environment,
    )


def test_help_names_every_command_at_once():
    """By processor time, which a busy machine does not stretch as it does the clock's."""
    taken = []
    for _ in range(3):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        shown = program("--help")
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        taken.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    assert shown.returncode == 0
    assert all(f"  {name} " in shown.stdout for name in COMMANDS)
    assert min(taken) < 0.4, "the help loads something heavy"


@pytest.mark.parametrize("name", [name for name in COMMANDS if name not in PASSED_ON])
def test_every_command_explains_itself(name):
    shown = CliRunner().invoke(app, [name, "--help"], prog_name="apexcal")
    assert shown.exit_code == 0
    assert f"Usage: apexcal {name}" in shown.stdout


@pytest.mark.parametrize("name", PASSED_ON)
def test_what_another_program_does_is_explained_by_it_as_our_command(name):
    shown = program(name, "--help")
    assert shown.returncode == 0
    assert f"usage: apexcal {name}" in shown.stdout.lower() and "Traceback" not in shown.stderr


_UNKNOWN_WORDS = (
    (["--loss", "huber"], "'saturating'"),
    (["--weights", "equals"], "'covariances'"),
    (["--outliers", "drop"], "'exclude'"),
    (["--model", "fisheye"], "kannala_brandt (the equidistant model"),
    (["--model", "pinhole", "--model", "ocam"], "there is no model 'ocam'"),
    (["--rotation-range-deg", "181"], "at most 180 degrees"),
    (["--rotation-range-deg", "0"], "0 is not above 0"),
    (["--rotation-range-deg", "nan"], "nan is not above 0"),
    (["--rotation-range-deg", "-inf"], "--rotation-range-deg"),
    (["--lock", "skew"], "is not NAME=VALUE"),
    (["--lock", "t_z=far"], "is not NAME=VALUE"),
    (["--lock", "skew=0", "--free-skew"], "not both"),
    (["--vehicle", "Car"], "belongs to one rig"),
    (["--pairs", "a.csv"], "not both"),
    (["--stated", "--intrinsics", "front.yaml"], "--stated takes the lens that the recording states"),
)
_ID = "01890000-0000-7000-8000-000000000000"
_NONSENSE = (
    *((["calibrate", "--detection", "x", *words], said) for words, said in _UNKNOWN_WORDS),
    *((["invite", "Ada", "--url", url, "--token", "apx_x"], repr(url)) for url in ("foo", "http://[::1", "http://")),
    (["invite", "Ada", "--url", "http://a:99999", "--token", "apx_x"], "--url"),
    *((["detect", "x", "--keep", "x > 1", "--offset-ms", shift], "--offset-ms") for shift in ("nan", "inf")),
    (["detect", "x", "--keep", "x > 1e999", "--token", "apx_x"], "'x > 1e999'"),
    (["detect", "x", "--keep", "x > 1", "--option", "min_points=NaN", "--token", "apx_x"], "'min_points=NaN'"),
    (["detect", "walk", "--keep", "x > 1", "--region", "region.json"], ""),
    (["detect", "x"], ""),
    (["calibrate"], ""),
    (["serve", "--host", "0.0.0.0"], ""),
    (["serve", "--workers", "99999999"], ""),
    (["serve", "--public-url", "nonsense"], ""),
    (["upload"], ""),
    (["upload", "/nonexistent"], ""),
    (["upload", __file__, "--lidar-model", "vlp61"], ""),
    (["suggest", "walk", "--out", "/nonexistent/region.json"], ""),
    (["calibrate-fleet", "--cancel", _ID, "--name", "Van"], ""),
    (["export", "--output", "/"], ""),
    (["copy", "walk.bag", "-o", "seen.mcap", "--for-viewers", "--joint", "front=camera"], "--joint"),
    (["publish", "the-best"], ""),
    (["publish", _ID, "--override"], ""),
    (["rollback", "--reason", " "], ""),
    (["ls", "publications", "--limit", "0"], ""),
)


@pytest.mark.parametrize(("words", "said"), _NONSENSE, ids=lambda given: " ".join(given)[:60])
def test_what_cannot_be_is_wrong_usage_before_anything_is_done(words, said):
    refused = CliRunner(env={"APEXCAL_URL": "http://127.0.0.1:9"}).invoke(app, words)
    assert refused.exit_code == 2
    assert said in refused.stderr


@pytest.mark.parametrize(("name", "said"), [("slove", "`apexcal solve`"), ("frobnicate", "`apexcal --help`")])
def test_a_command_that_is_none_names_the_nearest(name, said):
    ran = apexcal(name)
    assert ran.returncode == 2 and f"there is no command '{name}'" in ran.stderr and said in ran.stderr


def test_a_name_that_is_none_gets_the_nearest_of_many():
    vehicles = [VehicleOut.model_construct(id=uuid4(), name=f"Van {number}") for number in range(1008)]
    with pytest.raises(ClientError, match="no vehicle with the name or id 'vam 1007'") as refused:
        pick(None, vehicles, "vehicle", "vam 1007")
    assert "The nearest of 1,008: 'Van 1007'" in refused.value.hint and len(refused.value.hint) < 80


def test_a_token_that_is_none_is_said_with_where_it_is_from(embedded, tmp_path):
    """Nothing of the token itself is printed."""
    here = ("invite", "Ada", "--url", embedded.url)
    (tmp_path / "owner.token").write_bytes(b"secr\xe9t")
    (tmp_path / "supervisor.json").write_text(json.dumps({"url": embedded.url}))
    with (tmp_path / "serve.lock").open("a") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        from_file = apexcal(*here, "--data", tmp_path)
    refusals = {
        "--token": apexcal(*here, "--token", "secrét"),
        "APEXCAL_TOKEN": apexcal(*here, APEXCAL_TOKEN="secr t"),
        "owner.token": from_file,
    }
    for origin, refused in refusals.items():
        assert refused.returncode == 2, origin
        assert origin in refused.stderr
        assert "ASCII" in refused.stderr
        assert "secr" not in refused.stderr


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (FileNotFoundError(2, "No such file or directory", "gone.jpg"), "cannot read gone.jpg: no such file"),
        (UnicodeEncodeError("utf-8", "\udcff", 0, 1, "surrogates not allowed"), "no UTF-8"),
    ],
)
def test_a_file_that_goes_away_meanwhile_and_a_name_of_stray_bytes_are_said(tmp_path, capsys, error, said):
    with pytest.raises(typer.Exit) as left, Session().saying_errors():
        raise error
    assert left.value.exit_code == 1
    assert said in capsys.readouterr().err


def test_no_service_is_3_with_what_to_do(tmp_path):
    for words in (["--data", tmp_path / "none"], ["--url", "http://127.0.0.1:9", "--token", "apx_x"]):
        shown = apexcal("invite", "Ada", *words)
        assert shown.returncode == 3
        assert "apexcal serve" in shown.stderr
        assert "--data" not in words or str(tmp_path / "none") in shown.stderr
        assert "Traceback" not in shown.stderr


def test_a_refusal_is_1_with_the_services_sentence_and_hint(embedded):
    shown = apexcal("detect", "01890000-0000-7000-8000-000000000000", "--keep", "x > 0", "--data", embedded.data)
    assert shown.returncode == 1
    assert "not_found" in shown.stderr
    assert "Traceback" not in shown.stderr
    shown = apexcal("invite", "Ada", APEXCAL_URL=embedded.url, APEXCAL_TOKEN="apx_wrong")
    assert shown.returncode == 1
    assert "(not_signed_in)." in shown.stderr
    assert "APEXCAL_TOKEN" in shown.stderr
    assert ". (" not in shown.stderr


def test_a_worker_needs_the_services_environment():
    shown = program("worker")
    assert shown.returncode == 2
    assert "APEXCAL_DATABASE_URL" in shown.stderr
    known = {"APEXCAL_DATABASE_URL": "x", "APEXCAL_BROKER_URL": "y", "APEXCAL_BLOB_URL": ""}
    shown = CliRunner(env=known).invoke(app, ["worker"])
    assert shown.exit_code == 2
    assert "a worker needs APEXCAL_BLOB_URL" in shown.stderr
    known["APEXCAL_BLOB_URL"] = "s3://b/p"
    shown = CliRunner(env=known).invoke(app, ["worker", "--queues", "solve,paint,"])
    assert shown.exit_code == 2
    assert "'paint', ''" in shown.stderr


def test_a_preset_means_what_it_says_where_nothing_else_is_given(embedded, simulated, tmp_path):
    """The command fills nothing in that the preset would."""
    here = ("--data", embedded.data, "--json")
    rig = json.loads(apexcal("rig", simulated / "rig.json", "--fleet", "Presets", "--vehicle", "Car", *here).stdout)
    (tmp_path / "pairs.csv").write_text(pairs_csv(simulated))
    wanted = ("--model", "pinhole", "--folds", 0, "--preset", "paper", "--loss", "saturating", "--weights", "equal")
    wanted = (*wanted, "--rotation-range-deg", 12.5, "--line-time-us", 7.5)
    calibrated = apexcal(
        "calibrate", "--pairs", tmp_path / "pairs.csv", "--vehicle", rig["vehicle_id"], *wanted, *here
    )
    request = json.loads(calibrated.stdout)["request"]
    assert (request["preset"], request["search"], request["bounds_preset"]) == ("paper", "euler", "paper-table-1")
    assert (request["loss"], request["weights"], request["outliers"]) == ("saturating", "equal", "keep")
    assert (request["rotation_range_deg"], request["line_time_us"]) == (12.5, 7.5)


def test_a_refused_rig_leaves_nothing_behind_and_every_field_is_said(embedded, owner, simulated, tmp_path):
    rig = json.loads((simulated / "rig.json").read_text())
    del rig["cameras"][0]["image_size"], rig["lidar"]["frame"]
    (tmp_path / "rig.json").write_text(json.dumps(rig))
    words = ("--fleet", "Refused", "--vehicle", "Car", "--data", embedded.data)
    refused = apexcal("rig", tmp_path / "rig.json", *words)
    assert refused.returncode == 2
    assert "lidar.frame: " in refused.stderr
    assert "cameras.0.image_size: " in refused.stderr
    assert "Refused" not in [fleet.name for fleet in owner.fleets.list()]
    made = apexcal("rig", simulated / "rig.json", *words)
    assert "Made the fleet 'Refused'." in made.stderr
    assert "Made the vehicle 'Car'." in made.stderr
    assert "of Car in the fleet Refused is" in made.stdout


def test_what_a_rigs_images_are_is_corrected(embedded, owner, simulated):
    made = apexcal("rig", simulated / "rig.json", "--fleet", "Images", "--data", embedded.data, "--json")
    rig = json.loads(made.stdout)["id"]
    for word, kind in (("rectified", "rectified"), ("raw", "raw"), ("", None)):
        words = ("--correct", rig, "--images", f"front={word}", "--data", embedded.data)
        assert apexcal("rig", *words).returncode == 0
        images = owner.vehicles.rig(rig).cameras[0].images
        assert (images and images.kind) == kind
    for wrong in ("front=blurred", "nobody=raw"):
        assert apexcal("rig", "--correct", rig, "--images", wrong, "--data", embedded.data).returncode != 0
    for unclear in ((), ("--correct", rig), ("--images", "front=raw"), (simulated / "rig.json", "--correct", rig)):
        refused = apexcal("rig", *unclear, "--data", embedded.data)
        assert refused.returncode == 2 and "--correct with --images" in refused.stderr


def test_several_vehicles_of_a_name_are_told_apart_and_several_fleets_asked_for(embedded, owner, simulated):
    for name in ("North", "South"):
        owner.vehicles.create(owner.fleets.create(name).id, "Twin")
    several = apexcal("upload", simulated / "recording.bag", "--vehicle", "Twin", "--data", embedded.data)
    assert several.returncode == 1
    assert "in the fleet 'North'" in several.stderr
    assert "in the fleet 'South'" in several.stderr
    unnamed = apexcal("rig", simulated / "rig.json", "--vehicle", "Twin", "--data", embedded.data)
    assert unnamed.returncode == 2
    assert "--fleet" in unnamed.stderr


def test_a_token_of_a_fleet_makes_none_and_a_sign_in_link_does(embedded, owner):
    fleet = owner.fleets.create("Links")
    made = owner.fleets.create_token(fleet.id, "robot", "admin")
    elsewhere = ("--fleet", "Links", "--url", embedded.url)
    refused = apexcal("token", "child", *elsewhere, "--token", made.token)
    assert refused.returncode == 1 and "token_gives_nothing" in refused.stderr and "--link" in refused.stderr
    link = owner.fleets.invite(fleet.id, "Ada", "admin").link
    child = json.loads(apexcal("token", "child", *elsewhere, "--link", link, "--json").stdout)
    with Client(embedded.url, child["token"]) as robot:
        assert robot.me().name == "Ada"
    used = apexcal("token", "child", *elsewhere, "--link", link)
    assert used.returncode == 1 and "link_used" in used.stderr and "Traceback" not in used.stderr


def test_a_name_orders_no_terminal(capsys):
    name = "van\x1b[2J\u202e\x9b\udc80"
    with pytest.raises(typer.Exit):
        complain(f"there is no {name}\nhere", f"Not {name}.")
    for as_json in (False, True):
        Reply({"name": name}, f"Made {name}.").print(as_json=as_json)
    shown = capsys.readouterr()
    assert all(one.isprintable() for one in (shown.out + shown.err).split("\n"))
    assert "van\\u001b[2J\\u202e" in shown.err and "\nhere" in shown.err
    document = shown.out.partition("\n")[2]
    assert json.loads(document)["name"] == name


def pairs_csv(simulated) -> str:
    """Pairs without noise, from the truth: the apex at every camera frame that shows it."""
    frames = json.loads((simulated / "truth.json").read_text())["frames"]
    rows = [
        f"{x},{y},{z},{u},{v},{stamp}"
        for (x, y, z), (u, v), stamp, seen in zip(
            frames["apex_xyz"], frames["apex_uv"], frames["stamp_ns"], frames["apex_in_image"], strict=True
        )
        if seen
    ]
    return "\n".join(["x,y,z,u,v,stamp_ns", *rows]) + "\n"
