"""Plots by UDP on the loopback, tracks back in category 62: throughput and latency.

`python benches/live.py [PLOTS_PER_SECOND [SECONDS]]`: `tertia track --udp --send` receives what
twenty radars see; the latency of a row is the time from the sending of its plot to the arrival of
its record. Rows without a plot (coasted) come when no plot can come any more, a quarter of a scan
after its time; they are counted apart.
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

from tertia import _core
from tertia._arrays import BoolArray, FloatArray, IntArray

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
        sent = send(port, Traffic(rate), seconds)
        time.sleep(2.0)
        process.send_signal(signal.SIGINT)
        said = process.communicate()[1].decode().strip()
    show(heard, sent, seconds, said)


class Traffic:
    """Aircraft that fly straight on, and what twenty radars see of them."""

    def __init__(self, rate: float) -> None:
        random = np.random.default_rng(1)
        self.count = round(rate * PERIOD / RADARS)
        self._start = random.uniform([-80e3, 5e3], [280e3, 150e3], (self.count, 2))
        self._speed = 200 * random.standard_normal((self.count, 2)) / np.sqrt(2)
        self._turn = random.permutation(self.count)
        self._random = np.random.default_rng(2)

    def seen(self, step: int, since: float) -> FloatArray:
        """Return the plots of a step, of a sector of each radar, at a time since the beginning."""
        steps, parts = round(PERIOD / STEP), []
        for radar in range(RADARS):
            own = self._turn[(step + radar * 7) % steps :: steps]
            place = self._start[own] + self._speed[own] * since - [10_000 * radar, 0.0]
            reach = np.hypot(*place.T) + 50 * self._random.standard_normal(len(own))
            angle = np.degrees(np.arctan2(*place.T))
            angle += 0.07 * self._random.standard_normal(len(own))
            parts.append(np.column_stack([np.full(len(own), radar), own, reach, angle % 360]))
        return np.concatenate(parts)


def send(port: int, traffic: Traffic, seconds: float) -> int:
    """Send the plots of each step in real time, and return their number."""
    to = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    begin, count = time.time(), 0
    for step in range(round(seconds / STEP)):
        while (wait := begin + step * STEP - time.time()) > 0:
            time.sleep(wait)
        now = time.time()
        plots = traffic.seen(step, now - begin)
        count += len(plots)
        for packet in blocks(plots, now):
            to.sendto(packet, ("127.0.0.1", port))
    print(f"sending took {time.time() - begin:.1f} s")
    return count


def rows(packet: bytes) -> tuple[IntArray, IntArray]:
    """Return the times of day of the records of a packet in 1/128 s, and which are coasted."""
    every = enumerate(_core.asterix_definitions())
    number, names = next((k, [name for name, *_ in one[2]]) for k, one in every if one[0] == 62)
    _, columns, _ = _core.asterix_records(number, packet, np.array([3]), np.array([len(packet)]))
    return columns[names.index("070")], columns[names.index("080/CST")]


def show(heard: list[tuple[float, bytes]], sent: int, seconds: float, said: str) -> None:
    """Print what arrived, and how late."""
    found = [(at, *rows(packet)) for at, packet in heard]
    late = np.concatenate([at % 86_400 - time / 128 for at, time, _ in found]) * 1e3
    coasted = np.concatenate([flag for _, _, flag in found]) == 1
    print(f"{sent} plots sent, {sent / seconds:,.0f} a second; {said}")
    show_latencies(late, coasted)


def show_latencies(late: FloatArray, coasted: BoolArray) -> None:
    """Print how many milliseconds rows are late."""
    for what, which in (("rows with a plot", ~coasted), ("coasted rows", coasted)):
        if which.any():
            half, most, worst = np.quantile(late[which], [0.5, 0.99, 1.0])
            print(
                f"{which.sum()} {what} came back, {half:.0f} ms later (median), 99 % within "
                f"{most:.0f} ms, the last {worst:.0f} ms"
            )


if __name__ == "__main__":
    main(*map(float, sys.argv[1:]))
