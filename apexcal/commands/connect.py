"""A client for a command, and things found by name or id."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn, TypeVar
from uuid import UUID

from apexcal.client import ApiError, Client, ClientError, InputError, TokenError, UnreachableError
from apexcal.commands.common import FAILED, TOKEN_HINT, UNREACHABLE, USAGE, complain, locate, usage
from apexcal.documents.fleets import FleetOut, RigOut, VehicleOut
from apexcal.documents.recordings import RecordingSummary

Named = TypeVar("Named", FleetOut, VehicleOut, RigOut, RecordingSummary)

_SHOWN = 20
_WHERE_IDS_ARE = {
    "detection": "`apexcal detect` prints it, and it stands in the address of its marking page",
    "fleet request": "`apexcal calibrate-fleet` prints it, and it stands in the address of the request's page",
    "result": "`apexcal calibrate --json` prints it",
}


@contextmanager
def connected(url: str, token: str, data: Path, link: str = "", timeout_s: float | None = None) -> Iterator[Client]:
    """A client; what goes wrong inside the block is said in a sentence and ends the command with its exit code.

    With a sign-in ``link`` the client is signed in as its person instead, for as long as the block.
    """
    address, secret, origin = (url, "", "") if link else locate(url, token, data)
    try:
        client = None if link else Client(address, secret, timeout_s)
    except TokenError as error:
        usage(str(TokenError(origin)), error.hint)
    except (InputError, ValueError) as error:
        usage(str(error), getattr(error, "hint", "Give it with --url or APEXCAL_URL"))
    try:
        with client or Client.sign_in(link, url or None) as ready:
            yield ready
            if link:
                ready.sign_out()
    except UnreachableError as error:
        complain(str(error), error.hint, code=UNREACHABLE)
    except ApiError as error:
        complain(*_refusal(error, origin), code=USAGE if error.is_about_the_input else FAILED)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        complain(f"cannot read {error.filename}: {reason}" if error.filename else reason, code=FAILED)
    except UnicodeEncodeError:
        complain("a name or path holds bytes that are no UTF-8", "Write it again in this terminal.", code=FAILED)
    except InputError as error:
        usage(str(error), error.hint)
    except (ClientError, ValueError) as error:
        complain(str(error), getattr(error, "hint", ""), code=FAILED)


def _refusal(error: ApiError, token_origin: str) -> tuple[str, str]:
    """What the service refused and what to do; every field that it names stands on a line of its own."""
    fields = error.refused_fields
    if len(fields) > 1:
        lines = "".join(f"\n  {field}" for field in fields)
        return f"the service refused {len(fields)} fields ({error.code}):{lines}", "Correct them and try again."
    hint = "Correct it and try again." if fields else error.hint
    if error.code == "not_signed_in":
        hint = f"The token is {token_origin}; give a valid one with --token or APEXCAL_TOKEN. {TOKEN_HINT}."
    return f"{str(error).rstrip('.')} ({error.code})", hint


def pick(
    things: Iterable[Named],
    what: str,
    wanted: str,
    option: str,
    *,
    label: Callable[[Named], str] = lambda thing: str(thing.id),
    make: str = "apexcal rig rig.json --fleet F --vehicle V",
) -> Named:
    """The thing with this id or name; without one, the only thing there is. Raises :class:`ClientError`.

    Where the command should have named one of several it was called wrongly, and ends as such.
    ``label`` tells apart things of one name; ``make`` is the command that makes one where there is none.
    """
    found = list(things)
    matching = [thing for thing in found if not wanted or wanted in (str(thing.id), thing.name)]
    if len(matching) != 1:
        _refuse_to_pick(found, matching, what, wanted, option, label, make)
    return matching[0]


def _refuse_to_pick(
    found: list[Named],
    matching: list[Named],
    what: str,
    wanted: str,
    option: str,
    label: Callable[[Named], str],
    make: str,
) -> NoReturn:
    names = ", ".join(f"{thing.name!r}" for thing in found[:_SHOWN]) or "none"
    if not found:
        raise ClientError(f"there is no {what} yet", f"Make one first: `{make}`.")
    if not matching:
        more = ", ..." if len(found) > _SHOWN else ""
        raise ClientError(f"there is no {what} with the name or id {wanted!r}", f"There is: {names}{more}")
    if wanted:
        ids = "".join(f"\n  {label(thing)}" for thing in matching[:_SHOWN])
        raise ClientError(f"several {what}s are called {wanted!r}:{ids}", f"Give the id {option}.")
    usage(f"there are several {what}s: {names}", f"Say which one {option}.")


def find_fleet(client: Client, wanted: str) -> FleetOut:
    """A fleet by id or name."""
    return pick(client.fleets.list(), "fleet", wanted, "with --fleet")


def find_vehicle(client: Client, fleet: str, wanted: str) -> VehicleOut:
    """A vehicle by id, or by name in a fleet or in all of the caller's fleets."""
    if is_id(wanted):
        return client.vehicles.get(wanted)
    fleets = [find_fleet(client, fleet)] if fleet else list(client.fleets.list())
    names = {each.id: each.name for each in fleets}
    return pick(
        (vehicle for each in fleets for vehicle in client.vehicles.list(each.id)),
        "vehicle",
        wanted,
        "with --vehicle",
        label=lambda vehicle: f"{vehicle.id} in the fleet {names[vehicle.fleet_id]!r}",
    )


def find_recording(client: Client, wanted: str) -> RecordingSummary:
    """A recording by id, or by name among all that the caller may see. Raises :class:`ClientError`."""
    if not wanted.strip():
        usage("the recording's name is empty", "Give its id or name; `apexcal upload` prints both")
    if is_id(wanted):
        return client.recordings.get(wanted)
    return pick(
        client.recordings.list(),
        "recording",
        wanted,
        "instead of the name",
        label=lambda recording: f"{recording.id}, {recording.state}, of {recording.created_at}",
        make="apexcal upload FILE",
    )


def check_id(text: str, what: str) -> str:
    """The text, where it is an id. Where it is none the command was called wrongly, and says where ids are."""
    if not is_id(text):
        usage(f"{text!r} is no id of a {what}", _WHERE_IDS_ARE[what])
    return text


def find_rig(client: Client, vehicle: VehicleOut, wanted: str) -> RigOut:
    """A vehicle's rig by id or name."""
    return pick(client.vehicles.rigs(vehicle.id), "rig", wanted, "with --rig")


def cameras_of(rig: RigOut) -> list[str]:
    """The names of a rig's cameras."""
    return [camera.name for camera in rig.cameras]


def find_camera(names: Sequence[str], wanted: str) -> str:
    """The camera of this name; without one, the only one of these."""
    if wanted in names:
        return wanted
    if wanted:
        usage(f"the rig has no camera {wanted!r}", f"Its cameras are {', '.join(names)}")
    if len(names) != 1:
        usage("the rig has several cameras", f"Say which one with --camera: {', '.join(names)}")
    return names[0]


def is_id(text: str) -> bool:
    """Whether this is an id, and no name."""
    try:
        UUID(text)
    except ValueError:
        return False
    return True
