"""Velodyne sensors: which one sent a packet, and what its packets hold."""

from __future__ import annotations

import struct
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import Any, Final

from apexcal.documents.readings import LidarModel
from workers.readers.recording import ReadError

PACKET_BYTES: Final = 1206
BLOCKS: Final = 12
# Twelve blocks of flag, azimuth and 32 measurements of 3 bytes; then microseconds past the hour and two factory bytes
# (return mode, product), as every Velodyne manual prints it. HDL-64E sends status in the last two instead.
PACKET: Final = struct.Struct("<" + "HH96x" * BLOCKS + "IBB")
STRONGEST: Final = 0x37
DUAL: Final = 0x39
_MODES: Final = (STRONGEST, 0x38, DUAL)

_UPPER, _LOWER = 0xEEFF, 0xDDFF


@dataclass(frozen=True, slots=True)
class VelodyneModel:
    """One kind of sensor.

    Attributes:
        title: as its maker calls it.
        option: its name in ``lidar_model`` of the reading; None: only ever told by its packets.
        library: its name in ``velodyne_decoder.Model``.
        product: last byte of its packets; None where they do not say it.
        rings: number of lasers.
        blocks: blocks in which every laser has fired once, those of VLP-16 twice; in dual return mode twice as many.
        cycle_ns: time from the first firing of these to that of the next, from the manuals.
        early_ns: time from a packet's first firing to its stamp.
        flags: block flags that its packets may hold.
    """

    title: str
    option: LidarModel | None
    library: str
    product: int | None
    rings: int
    blocks: int
    cycle_ns: float
    early_ns: int = 0
    flags: frozenset[int] = frozenset({_UPPER})

    @property
    def with_article(self) -> str:
        """Its title with the article that is spoken before it."""
        return f"{'an' if self.title[0] in 'AH' else 'a'} {self.title}"


MODELS: Final = (
    VelodyneModel("VLP-16", "vlp16", "VLP16", 0x22, 16, 1, 110_592),
    VelodyneModel("Puck Hi-Res", None, "PuckHiRes", 0x24, 16, 1, 110_592),
    VelodyneModel("VLP-32C", "vlp32c", "VLP32C", 0x28, 32, 1, 55_296),
    VelodyneModel("HDL-32E", "hdl32e", "HDL32E", 0x21, 32, 1, 46_080),
    VelodyneModel(
        *("Alpha Prime", "alpha_prime", "VLS128", 0xA1, 128, 4, 53_333.2, 7_000),
        flags=frozenset({_UPPER, _LOWER, 0xCCFF, 0xBBFF}),
    ),
    VelodyneModel("HDL-64E", "hdl64e", "HDL64E_S3", None, 64, 2, 57_600, flags=frozenset({_UPPER, _LOWER})),
)
_HDL64E: Final = MODELS[-1]
_UNREAD: Final = {0x23: "VLP-32A or VLP-32B", 0x31: "Velarray"}
_OPTIONS: Final = ", ".join(model.option for model in MODELS if model.option is not None)


@dataclass(slots=True)
class Decoding:
    """The decoding of the packets of one sensor.

    Attributes:
        model: its kind.
        config: a ``velodyne_decoder.Config``.
        patch: the two last bytes to write over a packet's own, where old firmware left them empty; else empty.
        notes: sentences about what was found and assumed.
    """

    model: VelodyneModel
    config: Any  # the library has no types
    patch: bytes = b""
    notes: list[str] = field(default_factory=list[str])


def is_data_packet(payload: bytes) -> bool:
    """Whether a UDP payload looks like the measurements of a Velodyne sensor."""
    return len(payload) == PACKET_BYTES and payload[:2] == b"\xff\xee"


def find_decoding(packets: Sequence[bytes], stated: LidarModel | None, where: str) -> Decoding:
    """Tell the model from sample packets and make the decoder's configuration.

    Args:
        packets: data packets of one sensor from the beginning of the recording; for an HDL-64E some 5000, in which
            its own calibration is spread out byte by byte.
        stated: what the owner says.
        where: names the sensor in messages.

    Raises:
        ReadError: ``lidar_model_unknown``, ``lidar_model_contradicted``, ``return_mode_unsupported``.
    """
    factory_bytes = Counter((p[-2], p[-1]) for p in packets)
    flags = {flag for p in packets[:200] for flag in PACKET.unpack(p)[:24:2]}
    (mode, product), count = factory_bytes.most_common(1)[0]
    constant = count > 0.9 * len(packets)
    model = next((m for m in MODELS if m.product == product and constant), None)
    if model is None and _LOWER in flags and flags <= _HDL64E.flags and (not constant or stated == "hdl64e"):
        model = _HDL64E
    claimed = next((m for m in MODELS if stated is not None and m.option == stated), None)
    patch = b""
    if model is None and claimed is not None and flags <= claimed.flags and not (constant and product in _UNREAD):
        model = claimed
        patch = bytes((mode if mode in _MODES else STRONGEST, claimed.product or 0))
    if model is None:
        raise _unknown(product if constant else None, where)
    if claimed is not None and model is not claimed and not (model.title == "Puck Hi-Res" and stated == "vlp16"):
        raise ReadError(
            "lidar_model_contradicted",
            f"{where} is said to be {claimed.with_article}, but its packets come from {model.with_article}.",
            f"Leave lidar_model out, or set it to {model.option or 'nothing'}.",
        )
    if model is _HDL64E:
        return _hdl64e(packets, where)
    if not patch and mode not in _MODES:
        raise ReadError(
            "return_mode_unsupported",
            f"{where} sends packets in return mode 0x{mode:02x}, which is not read.",
            "Set the sensor to strongest, last or dual return (without confidence), and record again.",
        )
    notes = [f"{where}: {model.with_article}, {model.rings} rings; calibration: the maker's nominal angles."]
    if patch:
        notes.append(f"{where}: the packets do not say which sensor sent them; {model.with_article} was stated.")
    if mode == DUAL:
        notes.append(f"{where}: dual return; the strongest return of each firing was kept.")
    return Decoding(model, _config(model), patch, notes)


def _unknown(product: int | None, where: str) -> ReadError:
    if product in _UNREAD:
        return ReadError(
            "lidar_model_unknown",
            f"{where} sends packets of a {_UNREAD[product]}, which is not read.",
            "Record the point cloud of its driver (sensor_msgs/PointCloud2) instead.",
        )
    what = "vary" if product is None else f"name the product 0x{product:02x}"
    return ReadError(
        "lidar_model_unknown",
        f"{where}: the packets do not say which sensor sent them; their factory bytes {what}.",
        f"State the sensor in lidar_model: {_OPTIONS}.",
    )


def _config(model: VelodyneModel, calibration: Any = None, library: str | None = None) -> Any:
    velodyne: Any = import_module("velodyne_decoder")
    return velodyne.Config(
        model=getattr(velodyne.Model, library or model.library),
        calibration=calibration,
        max_range=350,
        timestamp_first_packet=True,
    )


def _hdl64e(packets: Sequence[bytes], where: str) -> Decoding:
    """An HDL-64E with the calibration that its status bytes spell out, or with one of the same series."""
    velodyne: Any = import_module("velodyne_decoder")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            status = velodyne.hdl64e.read_status_info(packets)
        table = velodyne.hdl64e.status_info_to_calib_dict(status)
        if [laser["laser_id"] for laser in table["lasers"]] != list(range(64)):
            raise ValueError
        calibration = velodyne.Calibration.from_string(import_module("yaml").dump(table))
        generation = str(status["Model"])
        note = f"{where}: an HDL-64E {generation}, 64 rings; its own calibration was read from its packets."
        model = replace(_HDL64E, cycle_ns=48_000) if generation == "S2" else _HDL64E
        return Decoding(model, _config(_HDL64E, calibration, f"HDL64E_{generation}"), notes=[note])
    except (ValueError, KeyError, IndexError, TypeError, struct.error, RuntimeError):
        calibrations: Any = import_module("velodyne_decoder.calibrations")
        calibration = calibrations.get_bundled_calibration("HDL-64E_S3-VeloView.yml")
        note = (
            f"{where}: an HDL-64E, 64 rings; its own calibration was not found in {len(packets)} packets, so that of "
            "another HDL-64E S3 was taken: points may be off by decimetres. Record at least 2 s."
        )
        return Decoding(_HDL64E, _config(_HDL64E, calibration), notes=[note])
