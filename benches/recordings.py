"""ASTERIX, records per second of CPU time: here, by libasterix and by asterix_decoder.

`python benches/recordings.py [PYTHON]`: a table of all categories, of random records; then a
simulated hour of ten radars, as a file and as packets, and tracks that are written. asterix_decoder
has a module of the same name as libasterix: `PYTHON` is an interpreter that has it. Both are given
the first two thousand records, of which libasterix parses the structure alone.
"""

import json
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from asterix import base, generated

from tertia import _core
from tertia.io import read_asterix, write_asterix

RADARS, AIRCRAFT, PERIOD, HOUR = 10, 150, 4.0, 3600.0
DIFFERENT, BLOCK, COUNT, FEW = 200, 10, 200_000, 2_000
# what asterix_decoder is timed by, in an interpreter of its own
DECODER = """
import sys, time, asterix
data = open(sys.argv[1], "rb").read()
start = time.process_time()
found = asterix.parse(data, verbose=False)
print('{"count": %d, "seconds": %f}' % (len(found), time.process_time() - start))
"""


def record(uap: Any, rng: np.random.Generator) -> bytes | None:
    """Return a record of random items, or None if the random bytes are none."""
    most = rng.integers(1, uap.cv_fspec_max_bytes + 1)
    spec = rng.integers(0, 256, most) & rng.integers(0, 256, most)
    spec[0] |= 0x80
    spec[:-1] |= 1
    spec[-1] &= 0xFE
    body = rng.integers(0, 256, 160) & rng.integers(0, 256, 160)
    contents = bytes([*spec, *body])
    try:
        parsed = uap.parse(base.ParsingMode.StrictParsing, base.Bits.from_bytes(contents))
    except TypeError:
        return None
    return None if isinstance(parsed, ValueError) else contents[: -(len(parsed[1]) // 8) or None]


def records(number: int, uap: Any) -> Iterator[bytes]:
    """Yield different records of a definition."""
    rng = np.random.default_rng(number)
    left = DIFFERENT
    while left:
        one = record(uap, rng)
        if one is None:
            continue
        block, _, damage = _core.asterix_records(number, one, np.array([0]), np.array([len(one)]))
        if len(block) == 1 and not damage:
            left -= 1
            yield one


def blocks(category: int, parts: list[bytes], count: int) -> bytes:
    """Return data blocks of so many records."""
    bodies = [b"".join(parts[at : at + BLOCK]) for at in range(0, len(parts), BLOCK)]
    once = b"".join(struct.pack(">BH", category, len(body) + 3) + body for body in bodies)
    return once * (count // len(parts))


def least(run: Callable[[], object]) -> float:
    """Return the least CPU time of three runs."""
    found = np.inf
    for _ in range(3):
        start = time.process_time()
        run()
        found = min(found, time.process_time() - start)
    return found


def library(uap: Any, parts: list[bytes]) -> float:
    """Return how many records libasterix parses per second."""
    strict = base.ParsingMode.StrictParsing
    start = time.process_time()
    for k in range(FEW):
        uap.parse(strict, base.Bits.from_bytes(parts[k % len(parts)]))
    return FEW / (time.process_time() - start)


def decoder(python: str, path: Path) -> str:
    """Return how many records asterix_decoder makes per second, and of how many."""
    done = subprocess.run(
        [python, "-c", DECODER, path], capture_output=True, check=False, text=True
    )
    if done.returncode:
        return "-"
    found = json.loads(done.stdout.splitlines()[-1])
    said = f" (makes {found['count']:,} of {FEW:,})" if found["count"] != FEW else ""
    return f"{found['count'] / found['seconds']:,.0f}{said}"


def categories(folder: Path, python: str | None) -> None:
    """Print the table of all categories."""
    print("| category | edition | here | libasterix | asterix_decoder |\n|---|---|---|---|---|")
    done = set()
    manifest: Any = generated.manifest
    for number, (category, (edition, *_), _) in enumerate(_core.asterix_definitions()):
        if category in done:
            continue
        done.add(category)
        one = manifest["CATS"][category][-1].cv_uap
        uap = one.cv_record if hasattr(one, "cv_record") else one.cv_uaps["plot"]
        parts = list(records(number, uap))
        many, few = folder / "many.ast", folder / "few.ast"
        many.write_bytes(blocks(category, parts, COUNT))
        few.write_bytes(blocks(category, parts, FEW))
        here = COUNT / least(partial(read_asterix, many))
        other = decoder(python, few) if python else "-"
        print(f"| {category} | {edition} | {here:,.0f} | {library(uap, parts):,.0f} | {other} |")


def recording() -> list[bytes]:
    """Return data blocks of category 48, each of a sector of a radar."""
    rng = np.random.default_rng(0)
    found = []
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
                found.append(struct.pack(">BH", 48, len(body) + 3) + body)
    return found


def packets(blocks: list[bytes]) -> bytes:
    """Return a network recording with a data block in each packet."""
    parts = [struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)]
    for block in blocks:
        udp = struct.pack(">HHHH", 4000, 8600, len(block) + 8, 0) + block
        head = struct.pack(">BBHHHBBH8x", 0x45, 0, len(udp) + 20, 0, 0, 64, 17, 0)
        frame = bytes(12) + b"\x08\x00" + head + udp
        parts.append(struct.pack("<IIII", 0, 0, len(frame), len(frame)) + frame)
    return b"".join(parts)


def tracks() -> pl.DataFrame:
    """Return system tracks, on the steps of their items."""
    rng = np.random.default_rng(1)
    return pl.DataFrame(
        {
            "time_s": np.sort(rng.integers(0, 86_400 * 128, COUNT)) / 128,
            "target": rng.integers(0, 1000, COUNT).astype(str),
            "east_m": rng.integers(-400_000, 400_000, COUNT) / 2,
            "north_m": rng.integers(-400_000, 400_000, COUNT) / 2,
            "velocity_east_m_s": rng.integers(-1000, 1000, COUNT) / 4,
            "velocity_north_m_s": rng.integers(-1000, 1000, COUNT) / 4,
            "east_sigma_m": rng.integers(0, 200, COUNT) / 2,
            "north_sigma_m": rng.integers(0, 200, COUNT) / 2,
            "flight_level": rng.integers(0, 1600, COUNT) / 4,
            "mode_3a": [f"{code:04o}" for code in rng.integers(0, 4096, COUNT)],
            "icao_address": [f"{code:06X}" for code in rng.integers(0, 2**24, COUNT)],
        }
    )


def main() -> None:
    """Print the tables."""
    with tempfile.TemporaryDirectory() as folder:
        categories(Path(folder), sys.argv[1] if len(sys.argv) > 1 else None)
        file, network = Path(folder, "hour.ast"), Path(folder, "hour.pcap")
        found = recording()
        file.write_bytes(b"".join(found))
        network.write_bytes(packets(found))
        plots = int(HOUR / PERIOD) * RADARS * AIRCRAFT
        print()
        for path in (file, network):
            each = plots / least(partial(read_asterix, path))
            print(f"{path.name}: {plots} plots, {each:,.0f} per second")
        rows, first, second = tracks(), Path(folder, "one.ast"), Path(folder, "two.ast")
        each = COUNT / least(lambda: write_asterix(rows, first))
        again = read_asterix(first).tracks
        write_asterix(again, second)
        same = first.read_bytes() == second.read_bytes()
        print(
            f"category 62: {COUNT} tracks written, {each:,.0f} per second; read and written ",
            end="",
        )
        print("again they are the same octets" if same else "again they are OTHER octets")


if __name__ == "__main__":
    main()
