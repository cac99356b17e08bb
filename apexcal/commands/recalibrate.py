"""``apexcal recalibrate``: a result's calibration again, without some of its pairs."""

from __future__ import annotations

from typing import Annotated

import typer

from apexcal.commands.calibrated import show
from apexcal.commands.common import DataOption, JsonOption, TokenOption, UrlOption, bar, say, usage
from apexcal.commands.connect import check_id, connected
from apexcal.embedded.folder import DEFAULT


def recalibrate(
    result: Annotated[str, typer.Argument(help="Id of a result; its report states it.")],
    leave_out: Annotated[str, typer.Option(help="Numbers of the pairs to leave out, from 0: 3,17,40.")],
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """Repeat a result's calibration without some of its pairs. Its report shows which to leave out."""
    numbers = _numbers(leave_out)
    with connected(url, token, data) as client, bar("Calibrating", not as_json) as progress:
        asked = client.calibrations.create_without(check_id(result, "result"), numbers)
        done = client.wait(asked, on_progress=progress)
    if as_json:
        say(done, True, "")
    else:
        show(done)


def _numbers(text: str) -> list[int]:
    try:
        numbers = [int(one) for one in text.split(",")]
    except ValueError:
        usage(f"{text!r} is no list of numbers", "Give them as 3,17,40")
    if min(numbers) < 0:
        usage("pairs are counted from 0", "Give numbers of 0 and above")
    return numbers
