"""Records of ASTERIX per second of CPU time: here, and decoded by libasterix.

`python benches/recordings.py [FILE]`: a recording, by default a simulated hour of ten radars as a
file and as packets. The library is given the first thousand records.
"""

import struct
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from asterix import base, generated

from tertia.io import read_asterix

RADARS, AIRCRAFT, PERIOD, HOUR = 10, 150, 4.0, 3600.0


def recording() -> list[bytes]:
    """Return data blocks of category 48, each of a sector of a radar."""
    rng = np.random.default_rng(0)
    blocks = []
    for scan in range(int(HOUR / PERIOD)):
        for radar in range(RADARS):
            parts = []
            for one in range(AIRCRAFT):
                clock = round((scan * PERIOD + one * PERIOD / AIRCRAFT) * 128)
                parts.append(
                    b"\xfd\x90"
                    + struct.pack(">BB", 25, radar)
                    + clock.to_bytes(3, "big")
                    + b"\xa0"
                    + rng.integers(0, 65536, 2, dtype=np.uint16).tobytes()
                    + struct.pack(">HH", 0o1000 + one, 1400)
                    + (0x4B0000 + one).to_bytes(3, "big")
                    + struct.pack(">H", one)
                )
            for at in range(0, AIRCRAFT, 10):
                body = b"".join(parts[at : at + 10])
                blocks.append(struct.pack(">BH", 48, len(body) + 3) + body)
    return blocks


def packets(blocks: list[bytes]) -> bytes:
    """Return a network recording with a data block in each packet."""
    parts = [struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)]
    for block in blocks:
        udp = struct.pack(">HHHH", 4000, 8600, len(block) + 8, 0) + block
        head = struct.pack(">BBHHHBBH8x", 0x45, 0, len(udp) + 20, 0, 0, 64, 17, 0)
        frame = bytes(12) + b"\x08\x00" + head + udp
        parts.append(struct.pack("<IIII", 0, 0, len(frame), len(frame)) + frame)
    return b"".join(parts)


def seconds(path: Path) -> tuple[int, float]:
    """Return the plots of a recording, and the least CPU time of three runs."""
    least = np.inf
    for _ in range(3):
        start = time.process_time()
        found = read_asterix(path)
        least = min(least, time.process_time() - start)
    return found.plots.height + found.repeated, least


def library(contents: bytes) -> float:
    """Return how many records of category 48 libasterix decodes per second."""
    edition = generated.manifest["CATS"][48][-1]
    count, at, start = 0, 0, time.process_time()
    while count < 1000 and at < len(contents):
        category, length = struct.unpack_from(">BH", contents, at)
        rest = base.Bits.from_bytes(contents[at + 3 : at + length])
        at += length
        while category == 48 and len(rest):
            record, rest = edition.cv_record.parse(base.ParsingMode.StrictParsing, rest)
            count += record is not None
    return count / (time.process_time() - start)


def main() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        if len(sys.argv) > 1:
            paths = [Path(sys.argv[1])]
        else:
            paths = [Path(folder, "hour.ast"), Path(folder, "hour.pcap")]
            blocks = recording()
            paths[0].write_bytes(b"".join(blocks))
            paths[1].write_bytes(packets(blocks))
        for path in paths:
            count, taken = seconds(path)
            print(f"{path.name}: {count} plots, {count / taken:,.0f} per second")
        print(f"libasterix, records alone: {library(paths[0].read_bytes()):,.0f} per second")


if __name__ == "__main__":
    main()
