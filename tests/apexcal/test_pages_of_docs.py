"""The pages of the documentation: their Python and `apexcal` blocks run, in order, against one service.

A folder stands for the reader's. Its `var/apexcal` is that of the service which all tests of commands ask. They run
inside it as they stand on the page. Ids, which a reader takes from what was printed before, are taken from there.
"""

from __future__ import annotations

import math
import re
import shlex
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack, chdir
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import typer
import yaml

from apexcal.cli import app
from apexcal.client import Client
from apexcal.commands.pull import pull_parser
from apexcal.documents.copies import CopyView
from apexcal.json_files import parse_document
from benchmarks.demo.truth import Truth
from service.admin.__main__ import app as admin
from tests.apexcal.test_cli import apexcal
from tests.faults.jobs import SHORT
from tests.support import walks
from tests.support.asking import leave_marks_to_people
from tests.support.places import ROOT
from tests.support.served import Embedded
from workers.simulation.options import parser as simulation_parser

PAGES = {
    str(path.relative_to(ROOT)): path.read_text()
    for path in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
}
_BLOCK = re.compile(r"^( *)```(\w*)\n(.*?)^\1```$", re.MULTILINE | re.DOTALL)
_PRINTED = re.compile(
    r"\b[Tt]he (recording|detection|calibration)\b.*? ([0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12})"
)


class Block(NamedTuple):
    """A fenced block of a page: its language and its lines, without the page's indentation."""

    language: str
    text: str

    @property
    def runs(self) -> bool:
        return self.language == "python" or any(line.startswith("apexcal ") for line in self.text.splitlines())


def blocks_of(text: str) -> list[Block]:
    return [
        Block(language, "".join(line.removeprefix(indent) for line in body.splitlines(keepends=True)))
        for indent, language, body in _BLOCK.findall(text)
    ]


@dataclass
class Reader:
    """Somebody who follows the pages, with the files that they have and the ids that were printed for them."""

    service: Embedded
    client: Client
    folder: Path
    walk: Path
    opened: ExitStack
    ids: dict[str, str] = field(default_factory=dict)
    followed: list[str] = field(default_factory=list)
    program: dict[str, object] = field(default_factory=dict)

    def follow(self, page: str) -> None:
        """Run the page's blocks, once, after the pages that it builds on."""
        if page in self.followed:
            return
        before, here = PAGE_SETUPS[page].after, PAGE_SETUPS[page]
        for other in before:
            self.follow(other)
        self.followed.append(page)
        here.prepare(self)
        for block in blocks_of(PAGES[page]):
            if block.language == "python":
                self.run_program(block.text, here)
            elif block.runs:
                for line in block.text.splitlines():
                    self.run_command(line, here)

    def run_program(self, text: str, setup: Setup) -> None:
        for written, ours in setup.instead.items():
            text = text.replace(written, ours)
        text = text.replace("http://127.0.0.1:8000", self.service.url).replace("apx_...", self.service.token)
        self.program |= {"input": lambda _: self.mark(str(self.program["detection"].id), most=150)}
        try:
            exec(compile(text, "a page", "exec"), self.program)
        finally:
            self.opened.callback(self.program["client"].close)

    def run_command(self, line: str, setup: Setup) -> None:
        for written, ours in setup.instead.items():
            line = line.replace(written, ours)
        words = [self.ids.get(word, word) for word in shlex.split(line, comments=True)]
        if not words:
            return
        assert words[0] == "apexcal", f"{line!r} is no command of ours, in a block of ours"
        if words[1:3] == ["calibrate", "--detection"]:
            self.mark(words[3])
        ran = apexcal(*words[1:])
        # So short a walk is kept back by checks, and lacks a CameraInfo.
        wanting = {"calibrate": 4 if "--publish" in words else 0, "inspect": 1}.get(words[1], 0)
        assert ran.returncode in (0, wanting), f"{line}\n{ran.stdout}\n{ran.stderr}"
        for thing, found in _PRINTED.findall(ran.stdout):
            self.ids[thing.upper()] = found
        if words[1] == "detect":  # until somebody marks, if anybody does
            leave_marks_to_people(self.client, self.ids["RECORDING"])
        if words[1] == "calibrate":
            self.look_at_results()
        if words[1] == "copy":
            assert apexcal(*words[1:]).returncode == 2, "it is there already"
            kept = self.client.analyses.list(CopyView, recording_id=self.ids["RECORDING"])
            assert list(kept) == [], "the service keeps a copy that was downloaded"

    def look_at_results(self) -> None:
        """Take the ids that stand on the calibration's page."""
        calibration = self.client.calibrations.get(self.ids["CALIBRATION"])
        result, other, *_ = calibration.summary.cameras["front"].models.values()
        self.ids |= {"RESULT": str(result.result_id), "OTHER": str(other.result_id)}
        self.ids |= {"SET_ID": str(calibration.request.correspondence_set_ids[0])}
        # The reader judges it and publishes it all the same.
        self.client.calibrations.publish(result.result_id, "To practise.", override=True)

    def mark(self, detection_id: str, most: int = 60) -> None:
        """What people do meanwhile: one of them marks vertices, a pixel off."""
        detection, random = self.client.detections.get(detection_id), np.random.default_rng(0)
        leave_marks_to_people(self.client, detection.recording_id)
        truth = Truth(self.walk / "truth.json")
        link = self.client.fleets.invite(detection.fleet_id, "Bo", "annotator").link
        with Client.sign_in(link, self.service.url) as bo:
            for _ in range(most):
                if (task := bo.marking.next_task(detection_id, "front")) is None:
                    break
                _, pixel = truth.apex(task.frame.stamp_ns)
                if pixel is None:
                    bo.marking.answer(task.task_id, "rejected")
                else:
                    u, v = (np.array(pixel) + random.normal(0.0, 1.0, 2)).tolist()
                    bo.marking.answer(task.task_id, "confirmed", u=u, v=v)

    def write(self, name: str, text: str) -> None:
        (self.folder / name).write_text(text)


class Setup(NamedTuple):
    """What a page supposes: pages that the reader has followed, files that they have, and what is shorter here."""

    prepare: Callable[[Reader], None] = lambda _: None
    after: tuple[str, ...] = ()
    instead: dict[str, str] = {}  # noqa: RUF012


def _walk(reader: Reader) -> None:
    """A recording that is not simulated by the page itself: the simulator's, as the page offers for practice."""
    shutil.copy(reader.walk / "recording.bag", reader.folder / "walk.bag")
    reader.write("truck.urdf", _TRUCK)


def _truck(reader: Reader) -> None:
    """The tree of the truck, whose links bear the names of the rig's frames; and a calibration without skew."""
    reader.write("truck.urdf", _TRUCK)
    client, set_id = reader.client, reader.ids["SET_ID"]
    vehicle_id = client.correspondence_sets.get(set_id).vehicle_id
    quick = {"locked": {"skew": 0}, "folds": 0, "schedule": SHORT}
    asked = client.calibrations.create(vehicle_id, [set_id], ["brown_conrady"], **quick)
    found = client.wait(asked).summary.cameras["front"].models["brown_conrady"]
    client.calibrations.publish(found.result_id, "For programs without skew.", override=True)


def _other_programs(reader: Reader) -> None:
    """What other programs wrote of the truck: pairs of the toolbox, a camchain of Kalibr, a calibration of KITTI."""
    reader.write("truck.urdf", _TRUCK)
    truth = Truth(reader.walk / "truth.json")
    lens, R, t = truth.intrinsics, truth.R, truth.t
    size = lens["image_size"]
    pairs = reader.client.correspondence_sets.get(reader.ids["SET_ID"]).pairs
    reader.write(
        "labels.txt",
        "".join(f"{n} {n} {one.x} {one.y} {one.z} {one.u + 1} {one.v + 1}\n" for n, one in enumerate(pairs, start=1)),
    )
    camera = {
        "camera_model": "pinhole",
        "intrinsics": [lens[name] for name in ("f_x", "f_y", "c_x", "c_y")],
        "distortion_model": "radtan",
        "distortion_coeffs": [lens[name] for name in ("k1", "k2", "k3", "k4")],
        "resolution": size,
    }
    reader.write("camchain.yaml", yaml.safe_dump({"cam0": camera}))
    K = [lens["f_x"], 0, lens["c_x"], 0, lens["f_y"], lens["c_y"], 0, 0, 1]
    P, eye = [*K[:3], 0, *K[3:6], 0, *K[6:], 0], [1, 0, 0, 0, 1, 0, 0, 0, 1]
    written = {"S_02": size, "K_02": K, "D_02": [0] * 5, "R_02": eye, "T_02": [0, 0, 0]}
    written |= {"S_rect_02": size, "R_rect_02": eye, "P_rect_02": P, "R_rect_00": eye}
    mount = {"R": R.ravel(), "T": t}
    for name, lines in (("calib_cam_to_cam.txt", written), ("calib_velo_to_cam.txt", mount)):
        reader.write(name, "".join(f"{key}: {' '.join(map(str, values))}\n" for key, values in lines.items()))


_TRUCK = f"""<robot name="truck">
  <link name="base_link"/><link name="velodyne"/><link name="camera_link"/><link name="camera_front_optical"/>
  <joint name="lidar_joint" type="fixed"><parent link="base_link"/><child link="velodyne"/>
    <origin xyz="0 0 2"/></joint>
  <joint name="camera_joint" type="fixed"><parent link="base_link"/><child link="camera_link"/>
    <origin xyz="0.1 0 1.8" rpy="0 0.25 0"/></joint>
  <joint name="optical_joint" type="fixed"><parent link="camera_link"/><child link="camera_front_optical"/>
    <origin rpy="{-math.pi / 2} 0 {-math.pi / 2}"/></joint>
</robot>
"""
_ENGINEERS = "docs/engineers.md"

# Fewer fits than by default: these cost most of what this file takes.
_FEW = "--model pinhole --model brown_conrady --folds 0"

# Engineers come first: the other pages suppose a recording and a published calibration.
PAGE_SETUPS: dict[str, Setup] = {
    _ENGINEERS: Setup(
        _walk,
        instead={"--detection DETECTION": "--detection DETECTION " + _FEW},
    ),
    "docs/judging.md": Setup(after=(_ENGINEERS,), instead={"DRIVE": "RECORDING"}),
    "docs/exports.md": Setup(_truck, (_ENGINEERS,), {"/etc/truck/": ""}),
    "docs/imports.md": Setup(
        _other_programs,
        (_ENGINEERS,),
        {"--rig-out rig.json": "--rig-out of_urdf.json", "--pairs labels.txt": "--pairs labels.txt " + _FEW},
    ),
    "docs/simulating.md": Setup(instead={"--seconds 240": "--seconds 1"}),
    "docs/api.md": Setup(
        after=(_ENGINEERS,),
        instead={
            '"Trucks"': '"Trucks of the program"',
            '["brown_conrady"])': f'["brown_conrady"], folds=0, schedule={SHORT})',
            "folds=5)": f"folds=0, schedule={SHORT})",
        },
    ),
}

# Blocks of other programs, or of more than one machine: (page, first line), and why they are not run here.
NOT_RUN = {
    ("README.md", "make demo"): "these make the environment and run these tests",
    ("docs/judging.md", "curl"): "needs a recording; tests/contract/test_pixel_points.py asks the same",
    ("docs/operators.md", "aws s3api"): "needs a bucket at a provider",
    ("docs/operators.md", "make env"): "needs Docker; `make compose-test` runs it",
    ("docs/operators.md", "docker compose down"): "needs Docker; `make compose-test` runs it",
}
_PROGRAMS = ("sh", "python", "")


@pytest.fixture(scope="module")
def reader(embedded: Embedded, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Reader]:
    folder = tmp_path_factory.mktemp("reader")
    (folder / "var").mkdir()
    (folder / "var" / "apexcal").symlink_to(embedded.data)
    with chdir(folder), Client(embedded.url, embedded.token) as client, ExitStack() as opened:
        yield Reader(embedded, client, folder, walks.walk("practice"), opened)


@pytest.mark.parametrize("page", PAGE_SETUPS)
def test_a_page_does_what_it_says(page: str, reader: Reader) -> None:
    reader.follow(page)


def test_every_block_runs_or_has_a_reason() -> None:
    seen, left_out = set(), dict(NOT_RUN)
    for page, text in PAGES.items():
        fences = len(re.findall(r"^ *```", text, re.MULTILINE))
        assert fences == 2 * len(blocks_of(text)), f"a fence of {page} is not understood"
        for block in blocks_of(text):
            if block.runs:
                seen.add(page)
            elif block.language in _PROGRAMS:
                reasons = [named for named in left_out if named[0] == page and block.text.startswith(named[1])]
                assert reasons, f"{page}: nothing runs\n{block.text}"
                del left_out[reasons[0]]
    assert not left_out, "these blocks are no more"
    for page, setup in PAGE_SETUPS.items():
        assert not [written for written in setup.instead if written not in PAGES[page]], f"{page} has changed"
    assert seen == set(PAGE_SETUPS)


def test_links_and_numbers_of_decisions_lead_somewhere() -> None:
    headings = {
        page: {re.sub(r"[^\w -]", "", line.lower()).replace(" ", "-") for line in re.findall(r"^#+ (.*)", text, re.M)}
        for page, text in PAGES.items()
    }
    for page, text in PAGES.items():
        for target in re.findall(r"\]\(([^)#]*(?:#[^)]*)?)\)", text):
            if "://" in target:
                continue
            path, _, heading = target.partition("#")
            there = (ROOT / page).parent.joinpath(path).resolve() if path else ROOT / page
            assert there.exists(), f"{page}: {target}"
            assert not heading or heading in headings[str(there.relative_to(ROOT))], f"{page}: {target}"
    decisions = {path.name[:4] for path in (ROOT / "docs/decisions").glob("*.md")}
    code = [path for room in ("apexcal", "service", "workers", "benchmarks") for path in (ROOT / room).rglob("*.py")]
    for path in code:
        for number in re.findall(r"[Dd]ecisions?[ /](\d{4})\b", path.read_text()):
            assert number in decisions, f"{path}: there is no decision {number}"


def test_rigs_as_the_page_shows_them_are_taken(reader: Reader) -> None:
    rigs = [block for block in blocks_of(PAGES["docs/rigs.md"]) if block.language == "json"]
    assert rigs
    for block in rigs:
        reader.client.vehicles.check_rig(parse_document(block.text, "the page's rig"))


def _options_of(words: tuple[str, ...]) -> set[str]:
    """The options of a command. Those of `admin`, `simulate` and `pull` are defined by other programs."""
    command: Any = typer.main.get_command(app)
    parsers = {"simulate": simulation_parser, "pull": pull_parser}
    if words[0] in parsers:
        return {name for action in parsers[words[0]]()._actions for name in action.option_strings}
    if words[0] == "admin":
        command, words = typer.main.get_command(admin), words[1:]
    for word in words:
        if hasattr(command, "resolve_command"):
            _, command, _ = command.resolve_command(typer.Context(command), [word])
    return {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}


def test_commands_within_sentences_have_the_options_that_they_are_said_to_have() -> None:
    named: dict[tuple[str, ...], set[tuple[str, str]]] = {}
    for page, text in PAGES.items():
        for command in re.findall(r"`apexcal\s([^`]+)`", _BLOCK.sub("", text)):
            words = shlex.split(command)
            path = tuple(words[:3]) if words[0] == "admin" else (words[0],)
            path = tuple(word for word in path if re.fullmatch(r"[a-z][a-z-]*", word))
            if path:
                named.setdefault(path, set()).update((word, page) for word in words if word.startswith("--"))
    assert len(named) > 10
    for path, options in named.items():
        there = _options_of(path)
        for option, page in options:
            assert option in there, f"{page}: `apexcal {' '.join(path)}` has no {option}"
