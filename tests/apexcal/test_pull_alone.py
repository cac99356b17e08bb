"""The program that `apexcal pull --program` writes, and the command that runs the same code."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

from typer.testing import CliRunner

from apexcal.cli import app
from apexcal.commands.pull import program_source
from tests.support.databases import one_database

# Of Python's library, what came after 3.8 and a program like this could use: a name of each addition.
_NEWER = {
    *("removeprefix", "removesuffix", "is_relative_to", "readlink", "with_stem", "hardlink_to", "walk", "cache"),
    *("file_digest", "randbytes", "to_thread", "ExceptionGroup", "BooleanOptionalAction", "exit_on_error", "UTC"),
    *("pairwise", "batched", "add_note", "fromisoformat", "aclosing", "chdir", "StrEnum", "zoneinfo", "tomllib"),
}


def test_the_program_is_one_file_for_python_3_8_and_its_library_alone(tmp_path: Path) -> None:
    """By Python 3.8's grammar and a list of what came later: no older Python is installed here."""
    file = tmp_path / "apexcal-pull.py"
    written = CliRunner().invoke(app, ["pull", "--program", "-o", str(file)])
    assert written.exit_code == 0, written.output
    tree = ast.parse(file.read_text(), feature_version=(3, 8))
    imported = {
        name.name.split(".")[0] for node in ast.walk(tree) if isinstance(node, ast.Import) for name in node.names
    }
    imported |= {node.module.split(".")[0] for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert imported <= sys.stdlib_module_names - _NEWER
    names = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    names |= {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    assert not names & _NEWER
    # Annotations are not evaluated. Elsewhere `list[int]`, `int | str` and a merge of dictionaries came later.
    annotations = {
        id(part)
        for node in ast.walk(tree)
        for root in (getattr(node, "annotation", None), getattr(node, "returns", None))
        if root is not None
        for part in ast.walk(root)
    }
    for node in ast.walk(tree):
        if id(node) in annotations:
            continue
        assert not (isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitOr)), ast.unparse(node)
        is_generic = isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name)
        assert not (is_generic and node.value.id in {"list", "dict", "tuple", "set", "type"}), ast.unparse(node)
    # What two modules call alike would be one thing.
    definitions = [node.name for node in tree.body if isinstance(node, (ast.FunctionDef, ast.ClassDef))]
    assigned = [part for node in tree.body if isinstance(node, ast.Assign) for part in ast.walk(node.targets[0])]
    definitions += [part.id for part in assigned if isinstance(part, ast.Name)]
    assert len(definitions) == len(set(definitions))


@one_database
def test_the_program_runs_where_nothing_is_installed(car, tmp_path: Path) -> None:
    file = tmp_path / "alone.py"
    file.write_text(program_source())
    words = ["-o", str(car.file), "--url", car.url]
    environment = {"APEXCAL_TOKEN": car.viewer.token}
    done = subprocess.run([sys.executable, "-I", "-S", file, *words], env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, ""), done.stderr
    good = car.file.read_bytes()
    # The command asks as the program does: it finds the file unchanged.
    pulled = CliRunner().invoke(app, ["pull", *words, "--token", car.viewer.token])
    assert pulled.exit_code == 0 and "has not changed" in pulled.stderr and car.file.read_bytes() == good
    done = subprocess.run([sys.executable, "-I", "-S", file, "-o", "x"], env={}, capture_output=True, text=True)
    assert done.returncode == 2 and "APEXCAL_URL" in done.stderr and "Traceback" not in done.stderr


def test_the_command_looks_for_the_service_of_this_machine_and_refuses_odd_times(tmp_path: Path) -> None:
    words = ["pull", "-o", str(tmp_path / "car.json"), "--data", str(tmp_path)]
    alone = CliRunner(env={"APEXCAL_URL": "", "APEXCAL_TOKEN": ""})
    nobody = alone.invoke(app, words)
    assert nobody.exit_code == 3 and "no service runs on" in nobody.stderr
    for seconds in ("0", "-1", "nan", "soon"):
        refused = alone.invoke(app, [*words, "--timeout", seconds])
        assert refused.exit_code == 2 and "--timeout" in refused.stderr
