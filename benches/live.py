"""Plots by UDP on the loopback, tracks back in category 62: throughput and latency.

`python benches/live.py [PLOTS_PER_SECOND [SECONDS]]`: `tertia track --udp --send` receives what
twenty radars see; the latency of a row is the time from the sending of its plot to the arrival of
its record.
"""

import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from tertia._arrays import FloatArray, IntArray

RADARS, PERIOD, LATENCY, STEP = 20, 4.0, 0.05, 0.02
COMMAND = [sys.executable, "-c", "from tertia.cli import main; main()", "track"]


def sensors() -> str:
    """Return a file of sensors, twenty radars in one place each."""
    rows = [f"25/{k},{10_000 * k},0,50,0.07,{PERIOD:g}" for k in range(RADARS)]
    head = "name,east_m,north_m,range_sigma_m,azimuth_sigma_deg,scan_period_s"
    return "\n".join([head, *rows])


def blocks(plots: FloatArray, now: float) -> list[bytes]:
    """Return packets of ten plots: the radar, the aircraft, range and azimuth at a time of day."""
    parts: dict[int, list[bytes]] = {}
    clock = round(now % 86_400 * 128).to_bytes(3, "big")
    for radar, aircraft, reach, angle in plots:
        record = b"\xf1\x80" + struct.pack(">BB", 25, int(radar)) + clock + b"\xa0"
        record += struct.pack(">HH", round(reach / 1852 * 256), round(angle * 65536 / 360) % 65536)
        record += (0x400000 + int(aircraft)).to_bytes(3, "big")
        parts.setdefault(int(radar), []).append(record)
    found = []
    for records in parts.values():
        for at in range(0, len(records), 10):
            body = b"".join(records[at : at + 10])
            found.append(struct.pack(">BH", 48, len(body) + 3) + body)
    return found


def main(rate: float = 20_000.0, seconds: float = 30.0) -> None:
    """Send, receive, and print."""
    random = np.random.default_rng(1)
    aircraft = round(rate * PERIOD / RADARS)
    start = random.uniform([-80e3, 5e3], [280e3, 150e3], (aircraft, 2))
    speed = 200 * random.standard_normal((aircraft, 2)) / np.sqrt(2)
    turn = random.permutation(aircraft)
    heard: list[tuple[float, bytes]] = []
    listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 25)
    listener.bind(("127.0.0.1", 0))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        port = one.getsockname()[1]

    def listen() -> None:
        while True:
            packet = listener.recv(1 << 16)
            heard.append((time.time(), packet))

    threading.Thread(target=listen, daemon=True).start()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "sensors.csv")
        file.write_text(sensors(), encoding="utf-8")
        options = ["--sensors", file, "--latency", LATENCY, "--registration", "off"]
        addresses = [
            "--udp",
            f"127.0.0.1:{port}",
            "--send",
            f"127.0.0.1:{listener.getsockname()[1]}",
        ]
        process = subprocess.Popen(
            [*COMMAND, *addresses, *map(str, options)], stderr=subprocess.PIPE
        )
        assert process.stderr is not None
        process.stderr.readline()
        sent = send(port, start, speed, turn, seconds)
        time.sleep(2.0)
        process.send_signal(signal.SIGINT)
        said = process.communicate()[1].decode().strip()
    show(heard, sent, seconds, said)


def send(port: int, start: FloatArray, speed: FloatArray, turn: IntArray, seconds: float) -> int:
    """Send the plots of a radar's sector at each step, in real time."""
    random = np.random.default_rng(2)
    to = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    begin, count = time.time(), 0
    steps = round(PERIOD / STEP)
    for step in range(round(seconds / STEP)):
        while (wait := begin + step * STEP - time.time()) > 0:
            time.sleep(wait)
        now = time.time()
        rows = []
        for radar in range(RADARS):
            own = turn[(step + radar * 7) % steps :: steps]
            place = start[own] + speed[own] * (now - begin) - [10_000 * radar, 0.0]
            reach = np.hypot(*place.T) + 50 * random.standard_normal(len(own))
            angle = np.degrees(np.arctan2(*place.T)) + 0.07 * random.standard_normal(len(own))
            rows.append(np.column_stack([np.full(len(own), radar), own, reach, angle % 360]))
        plots = np.concatenate(rows)
        count += len(plots)
        for packet in blocks(plots, now):
            to.sendto(packet, ("127.0.0.1", port))
    print(f"sending took {time.time() - begin:.1f} s")
    return count


def show(heard: list[tuple[float, bytes]], sent: int, seconds: float, said: str) -> None:
    """Print what arrived, and how late."""
    # of the first record in each packet: four octets of specification, the source, the time
    late = [at % 86_400 - int.from_bytes(one[9:12], "big") / 128 for at, one in heard]
    half, most, worst = np.quantile(late, [0.5, 0.99, 1.0]) * 1e3
    print(f"{sent} plots sent, {sent / seconds:,.0f} a second; {said}")
    print(f"{len(late)} packets came back, {half:.0f} ms later (median), 99 % within {most:.0f} ms")
    print(f"the last of all {worst:.0f} ms")


if __name__ == "__main__":
    main(*map(float, sys.argv[1:]))
