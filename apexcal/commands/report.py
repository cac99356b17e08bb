"""``apexcal report``: the report of a result, as one HTML file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from apexcal.commands.common import (
    DataOption,
    JsonOption,
    TokenOption,
    UrlOption,
    bar,
    check_target,
    say,
    write_content,
)
from apexcal.commands.connect import check_id, connected
from apexcal.embedded.folder import DEFAULT


def report(
    result: Annotated[str, typer.Argument(help="Id of a result; `apexcal calibrate --json` prints them.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write.")] = Path("report.html"),
    force: Annotated[bool, typer.Option("--force", help="Replace the file.")] = False,
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """Make the report of a result: verdict, expected errors, residuals, error maps. It opens without a network."""
    check_target(output, force)
    with connected(url, token, data) as client, bar("Making the report", not as_json) as progress:
        asked = client.calibrations.make_report(check_id(result, "result"))
        made = client.wait(asked, on_progress=progress)
        content = client.calibrations.report(result)
    write_content(output, content)
    say(made, as_json, f"The report is in {output}. Its verdict: {made.verdict}.")
