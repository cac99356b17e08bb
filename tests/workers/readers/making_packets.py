"""Packets of Velodyne sensors and captures of them, made for tests byte by byte as the manuals print them."""

import struct

import numpy as np

START_NS = 1_700_000_000_000_000_000
SENDER = bytes((192, 168, 1, 201))
PORT = 2368
# name: (product byte, block flags in turn, blocks to an azimuth, nanoseconds from one azimuth to the next)
SENSORS = {
    "vlp16": (0x22, (0xEEFF,), 1, 110_592),
    "vlp32c": (0x28, (0xEEFF,), 1, 55_296),
    "hdl32e": (0x21, (0xEEFF,), 1, 46_080),
    "hdl64e": (None, (0xEEFF, 0xDDFF), 2, 57_600),
    "alpha_prime": (0xA1, (0xEEFF, 0xDDFF, 0xCCFF, 0xBBFF), 4, 53_333),
}


def packets(sensor="vlp16", turns=3.3, *, first=118.88, hz=10.0, mode=0x37, clock_us=0, distance=2500, mute=None):
    """(moment of the first firing in ns, payload) of a sensor that sees the same distance everywhere.

    ``mute`` is a pair of azimuths between which it sends nothing.
    """
    product, flags, width, cycle_ns = SENSORS[sensor]
    dual = 2 if mode == 0x39 else 1
    step = 36_000 * hz * cycle_ns / 1e9
    units = 12 // (width * dual)
    count = int(turns * 36_000 / step / units)
    for number in range(count):
        start = first * 100 + number * units * step
        if mute is not None and mute[0] * 100 <= start % 36_000 < mute[1] * 100:
            continue
        data = bytearray()
        for block in range(12):
            unit = block // (width * dual)
            flag = flags[(block // dual) % width] if width > 1 else flags[0]
            far = 500 if dual == 2 and block % 2 == 0 else 0
            data += struct.pack("<HH", flag, int(start + unit * step) % 36_000)
            for channel in range(32):
                data += struct.pack("<HB", distance + far, channel)
        moment = START_NS + round(number * units * cycle_ns)
        stamp_us = (clock_us + round(number * units * cycle_ns / 1000)) % 3_600_000_000
        tail = (mode, product) if product is not None else (ord("HMSDNYGTVW"[number % 10]), number % 256)
        yield moment, bytes(data) + struct.pack("<IBB", stamp_us, *tail)


def packet_ns(sensor="vlp16", dual=False):
    _, _, width, cycle_ns = SENSORS[sensor]
    return 12 // (width * (2 if dual else 1)) * cycle_ns


def datagram(payload, *, sender=SENDER, port=PORT, tags=0, link="ethernet", identity=0, piece=0):
    """A frame with a UDP datagram; ``piece`` is IP's fragment field, a fragment's payload is taken as it is."""
    udp = struct.pack(">HHHH", 443, port, 8 + len(payload), 0) + payload if piece in (0, 0x4000) else payload
    ip = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(udp), identity, piece, 64, 17, 0) + sender + b"\xff" * 4
    if link == "cooked":
        return struct.pack(">HHH8sH", 0, 1, 6, b"", 0x0800) + ip + udp
    if link == "raw":
        return ip + udp
    return bytes(12) + b"\x81\x00\x00\x05" * tags + b"\x08\x00" + ip + udp


LINKS = {"ethernet": 1, "cooked": 113, "raw": 101}


def captured(stream, **how):
    """(host's stamp, frame): a packet is sent when its last laser has fired."""
    span = packet_ns()
    for moment, payload in stream:
        yield moment + span, datagram(payload, **how)


def write_pcap(path, frames, *, order="<", nano=False, link="ethernet"):
    unit = 1 if nano else 1000
    magic = 0xA1B23C4D if nano else 0xA1B2C3D4
    with path.open("wb") as file:
        file.write(struct.pack(order + "IHHiIII", magic, 2, 4, 0, 0, 262_144, LINKS[link]))
        for stamp, frame in frames:
            sec, rest = divmod(stamp, 1_000_000_000)
            file.write(struct.pack(order + "IIII", sec, rest // unit, len(frame), len(frame)) + frame)
    return path


def write_pcapng(path, frames, *, order="<", exponent=9):
    def block(kind, body):
        body += bytes(-len(body) % 4)
        size = len(body) + 12
        return struct.pack(order + "II", kind, size) + body + struct.pack(order + "I", size)

    with path.open("wb") as file:
        file.write(block(0x0A0D0D0A, struct.pack(order + "IHHq", 0x1A2B3C4D, 1, 0, -1)))
        options = struct.pack(order + "HHB3xHH", 9, 1, exponent, 0, 0)
        file.write(block(1, struct.pack(order + "HHI", 1, 0, 262_144) + options))
        file.write(block(4, struct.pack(order + "HH", 0, 0)))  # names of hosts: to be skipped
        for stamp, frame in frames:
            ticks = stamp // 10 ** (9 - exponent)
            head = struct.pack(order + "IIIII", 0, ticks >> 32, ticks & 0xFFFFFFFF, len(frame), len(frame))
            file.write(block(6, head + frame))
    return path


def jittered(frames, seed=0):
    """Frames that come up to 3 ms late, as a busy host stamps them, in order."""
    rng = np.random.default_rng(seed)
    last = 0
    for stamp, frame in frames:
        late = int(rng.exponential(150_000)) + (int(rng.uniform(0, 3_000_000)) if rng.random() < 0.05 else 0)
        last = max(last + 1_000, stamp + late)
        yield last, frame
