"""Payloads of UDP packets in a network recording (pcap, pcapng)."""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

# first bytes of files of packets: times in microseconds or nanoseconds in both byte orders, and
# pcapng
MAGIC = {
    bytes.fromhex(text) for text in ("d4c3b2a1", "a1b2c3d4", "4d3cb2a1", "a1b23c4d", "0a0d0d0a")
}


def udp_payloads(path: Path, contents: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the number of each UDP packet, from 1, and its payload; other packets are skipped."""
    dpkt = import_module("dpkt")
    broken = (dpkt.Error, struct.error, ValueError)
    try:
        reader = dpkt.pcap.UniversalReader(io.BytesIO(contents))
        link = _links(dpkt).get(reader.datalink())
    except broken:
        raise ValueError(
            f"{path} begins like a network recording, but cannot be read as one"
        ) from None
    if link is None:
        raise ValueError(
            f"{path} was recorded on a link of type {reader.datalink()}, which is not supported; "
            "it must be Ethernet, raw IP or Linux's any"
        )
    number = 0
    try:
        for number, (_, frame) in enumerate(reader, start=1):
            payload = _payload(dpkt, link, frame)
            if payload is not None:
                yield number, payload
    except broken:
        raise ValueError(f"{path} is cut off or damaged after packet {number}") from None
    except EOFError:
        raise ValueError(
            f"{path}, packet {number} is cut off or a fragment: record whole packets (tcpdump -s 0)"
        ) from None


def _links(dpkt: Any) -> dict[int, Any]:
    """Return the protocol of the frames of each link type."""
    raw = {12, 14, 101, 228, 229}
    return {
        0: dpkt.loopback.Loopback,
        1: dpkt.ethernet.Ethernet,
        113: dpkt.sll.SLL,
        276: dpkt.sll2.SLL2,
        **dict.fromkeys(raw, lambda frame: _Raw(dpkt, frame)),
    }


class _Raw:
    """A packet without a link-layer frame."""

    def __init__(self, dpkt: Any, frame: bytes) -> None:
        kind = dpkt.ip6.IP6 if frame[:1] and frame[0] >> 4 == 6 else dpkt.ip.IP
        self.data = kind(frame)


def _payload(dpkt: Any, link: Any, frame: bytes) -> bytes | None:
    """Return the UDP payload of a frame; raise EOFError if the frame is incomplete."""
    try:
        packet = link(frame).data
    except dpkt.UnpackError:
        return None
    if not isinstance(packet, (dpkt.ip.IP, dpkt.ip6.IP6)) or packet.p != dpkt.ip.IP_PROTO_UDP:
        return None
    datagram = packet.data
    if not isinstance(datagram, dpkt.udp.UDP) or datagram.ulen > len(datagram.data) + 8:
        raise EOFError
    return bytes(datagram.data)
