"""ASTERIX, from the layout of EUROCONTROL's documents: bytes to items, and items to bytes."""

import struct
from collections.abc import Iterator, Mapping
from typing import Any

# items of category 48 in the order of their field reference numbers, with their lengths in bytes;
# "fx": extended, "bits": compound of octets, "8": repetitive
PLOT_ITEMS: list[tuple[str, Any]] = [
    ("010", 2), ("140", 3), ("020", "fx"), ("040", 4), ("070", 2), ("090", 2), ("130", "bits"),
    ("220", 3), ("240", 6), ("250", "8"), ("161", 2), ("042", 4), ("200", 4), ("170", "fx"),
    ("210", 4), ("030", "fx"), ("080", 2), ("100", 4), ("110", 2), ("120", None), ("230", 2),
]  # fmt: skip
DAY = 86_400


def record(items: Mapping[int, bytes]) -> bytes:
    """Return a record of items, by their field reference numbers from 1 on."""
    octets = (max(items) + 6) // 7
    spec = bytearray(octets)
    for number in items:
        octet, bit = divmod(number - 1, 7)
        spec[octet] |= 0x80 >> bit
    for octet in range(octets - 1):
        spec[octet] |= 1
    return bytes(spec) + b"".join(items[number] for number in sorted(items))


def block(category: int, *records: bytes) -> bytes:
    """Return a data block."""
    body = b"".join(records)
    return struct.pack(">BH", category, len(body) + 3) + body


def time_of_day(seconds: float) -> bytes:
    """Return a time of day, in 1/128 s."""
    return round(seconds % DAY * 128).to_bytes(3, "big")


def plot(radar: tuple[int, int], time: float, miles: float, degrees: float, **more: Any) -> bytes:
    """Return a record of category 48."""
    items = {
        1: bytes(radar),
        2: time_of_day(time),
        3: more.get("descriptor", b"\xa0"),
        4: struct.pack(">HH", round(miles * 256), round(degrees / 360 * 65536) % 65536),
    }
    if "code" in more:
        items[5] = struct.pack(">H", more["code"])
    if "level" in more:
        items[6] = struct.pack(">H", more["level"] & 0xFFFF)
    if "address" in more:
        items[8] = more["address"].to_bytes(3, "big")
    return record(items)


def service(radar: tuple[int, int], kind: int, time: float, **more: Any) -> bytes:
    """Return a record of category 34."""
    items = {1: bytes(radar), 2: bytes([kind]), 3: time_of_day(time)}
    if "period" in more:
        items[5] = struct.pack(">H", round(more["period"] * 128))
    if "place" in more:
        latitude, longitude, height = more["place"]
        unit = 180 / 2**23
        items[11] = struct.pack(">h", height) + b"".join(
            round(angle / unit).to_bytes(3, "big", signed=True) for angle in (latitude, longitude)
        )
    return record(items)


def old_plot(radar: tuple[int, int] | None, time: float, miles: float, **more: bytes) -> bytes:
    """Return a record of category 1: of a track, where it has a number."""
    items = {
        "010": bytes(radar) if radar else b"",
        "020": more.get("descriptor", b"\xa0" if "161" in more else b"\x20"),
        "040": struct.pack(">HH", round(miles * 128), 16384),
        "141": struct.pack(">H", round(time % DAY % 512 * 128)),
        **more,
    }
    plots = ("010", "020", "040", "070", "090", "130", "141")
    tracks = ("010", "020", "161", "040", "042", "200", "070", "090", "141")
    order = tracks if "161" in more else plots
    return record({k: items[one] for k, one in enumerate(order, 1) if items.get(one)})


def old_service(radar: tuple[int, int], kind: int, time: float) -> bytes:
    """Return a data block of category 2."""
    period = struct.pack(">H", 5 * 128)
    items = {1: bytes(radar), 2: bytes([kind]), 4: time_of_day(time), 5: period}
    return block(2, record(items))


def ethernet(payload: bytes) -> bytes:
    """Return a frame with an IPv4 packet with a UDP datagram."""
    udp = struct.pack(">HHHH", 4000, 8600, len(payload) + 8, 0) + payload
    ip = struct.pack(">BBHHHBBH4s4s", 0x45, 0, len(udp) + 20, 0, 0, 64, 17, 0, bytes(4), bytes(4))
    return bytes(12) + b"\x08\x00" + ip + udp


def pcap(*frames: bytes) -> bytes:
    """Return a recording of a network."""
    head = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)
    return head + b"".join(
        struct.pack("<IIII", 0, at, len(frame), len(frame)) + frame
        for at, frame in enumerate(frames)
    )


def blocks(contents: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the data blocks of a recording."""
    while contents:
        category, length = struct.unpack(">BH", contents[:3])
        yield category, contents[3:length]
        contents = contents[length:]


def plots(contents: bytes) -> Iterator[dict[str, bytes]]:
    """Yield the items of all records of category 48."""
    for category, records in blocks(contents):
        rest = records if category == 48 else b""
        while rest:
            items, rest = _items(rest)
            yield items


def _items(body: bytes) -> tuple[dict[str, bytes], bytes]:
    spec, body = _extended(body)
    flags = [bool(octet & (0x80 >> bit)) for octet in spec for bit in range(7)]
    items = {}
    for (name, length), there in zip(PLOT_ITEMS, flags, strict=False):
        if there:
            items[name], body = _split(body, length)
    assert not any(flags[len(PLOT_ITEMS) :])
    return items, body


def _split(body: bytes, length: Any) -> tuple[bytes, bytes]:
    if length == "fx":
        return _extended(body)
    if length == "bits":
        length = 1 + body[0].bit_count()
        assert not body[0] & 1
    if length == "8":
        length = 1 + 8 * body[0]
    return body[:length], body[length:]


def _extended(body: bytes) -> tuple[bytes, bytes]:
    length = next(at for at, octet in enumerate(body, start=1) if not octet & 1)
    return body[:length], body[length:]


def values(items: Mapping[str, bytes]) -> tuple[Any, ...]:
    """Return time, range, azimuth, flight level, address and code of a plot."""
    time = int.from_bytes(items["140"], "big") / 128
    rho, theta = struct.unpack(">HH", items["040"])
    level = code = address = None
    if "090" in items and items["090"][0] < 0x80 and not items["090"][0] & 0x40:
        raw = int.from_bytes(items["090"], "big") & 0x3FFF
        level = (raw - 0x4000 if raw & 0x2000 else raw) / 4
    if "070" in items and not items["070"][0] & 0xC0:
        code = f"{int.from_bytes(items['070'], 'big') & 0xFFF:04o}"
    if "220" in items:
        address = items["220"].hex().upper()
    return time, rho / 256, theta * 360 / 65536, level, address, code
