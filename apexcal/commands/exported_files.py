"""Where an export's files go: one file, the terminal, or a folder for what comes as several."""

from __future__ import annotations

from pathlib import Path

from apexcal.archives import read_archive
from apexcal.commands.common import check_target, complain, console, usage, write_content
from apexcal.resources.exports import Exported


def write_exported(made: Exported, output: Path | None, force: bool) -> None:
    """Write what the service made. Several files go below ``output``, or into one where that ends with ``.zip``."""
    for note in made.notes:
        console(errors=True).print(note, markup=False, soft_wrap=True)
    if not made.name.endswith(".zip") or (output is not None and output.suffix == ".zip"):
        _write_one(made.content, output, force)
        return
    if output is None:
        usage("this format is several files", "Name a folder for them with --output, or a file that ends with .zip")
    try:
        files = read_archive(made.content)
    except ValueError as error:
        complain(f"what the service answered {error}")
    _write_below(files, output, force)


def _write_one(content: bytes, output: Path | None, force: bool) -> None:
    if output is None:
        print(content.decode(), end="")
        return
    check_target(output, force)
    write_content(output, content)
    console(errors=True).print(f"Wrote {output}.", soft_wrap=True)


def _write_below(files: dict[str, bytes], folder: Path, force: bool) -> None:
    if folder.exists() and not folder.is_dir():
        usage(f"{folder} is a file", "Name a folder")
    for name in files:
        if (folder / name).exists() and not force:
            usage(f"{folder / name} exists already", "Name another folder, or say --force")
    for name, content in files.items():
        write_content(folder / name, content)
    console(errors=True).print(f"Wrote {', '.join(files)} below {folder}.", soft_wrap=True)
