"""Latency of live tracks by CPU time, which other work of the machine hardly changes.

`python benches/live_cpu.py [PLOTS_PER_SECOND [SECONDS]]`: the packets of `live.py` arrive by a
clock that goes on by the CPU time of `tertia track` while it works, and otherwise to the next
packet. Without the sockets and with one thread; the first third is not counted.
"""

import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from live import LATENCY, STEP, Traffic, blocks, sensors, show_latencies

from tertia.cli.commands.datagrams import Datagrams
from tertia.cli.commands.stream import _Stream
from tertia.cli.files.read import read_sensors
from tertia.cli.terminal.pipe import Quiet
from tertia.io._asterix_writer import asterix_blocks
from tertia.tracker import Tracker


class Clock:
    """Goes on by the CPU time that was used since it was last asked or set."""

    def __init__(self) -> None:
        self.now, self.used, self._last = 0.0, 0.0, time.process_time()

    def ask(self) -> float:
        """Return the time."""
        spent = time.process_time() - self._last
        self._last += spent
        self.now += spent
        self.used += spent
        return self.now

    def wait(self, until: float) -> None:
        """Let the time pass, and forget what was used since it was asked."""
        self.now, self._last = max(self.now, until), time.process_time()


class Sender:
    """Keeps when rows were ready to be sent."""

    def __init__(self, clock: Clock) -> None:
        self.clock, self.late, self.coasted = clock, [np.empty(0)], [np.empty(0, bool)]

    def write(self, rows: pl.DataFrame, kind: object) -> None:
        """Make the packets of rows."""
        if rows.height:
            asterix_blocks(rows, (0, 0))
        self.late.append(self.clock.ask() - rows["time_s"].to_numpy())
        self.coasted.append(rows["plot"].is_null().to_numpy())


def arriving(
    packets: list[tuple[float, list[bytes]]], clock: Clock, pause: float
) -> Iterator[list[bytes] | Quiet]:
    """Yield what has arrived, and marks where nothing has."""
    clock.wait(0.0)
    at = 0
    while at < len(packets):
        if packets[at][0] > clock.ask():
            yield Quiet.NOW
            if packets[at][0] > clock.ask() + pause:
                clock.wait(clock.now + pause)
                yield Quiet.LONG
                clock.ask()
        clock.wait(packets[at][0])
        together: list[bytes] = []
        while at < len(packets) and packets[at][0] <= clock.now:
            together += packets[at][1]
            at += 1
        yield together


def main(rate: float = 20_000.0, seconds: float = 15.0) -> None:
    """Track, and print."""
    traffic, clock = Traffic(rate), Clock()
    times = [step * STEP for step in range(round(seconds / STEP))]
    packets = [(now, blocks(traffic.seen(k, now), now)) for k, now in enumerate(times)]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "sensors.csv")
        file.write_text(sensors(), encoding="utf-8")
        radars = read_sensors(file)
    sender: Any = Sender(clock)
    stream = _Stream(
        Tracker(list(radars.items), registration=False, n_threads=1),
        (),
        Datagrams("packets", {}, radars),
        control=None,
        latency=LATENCY,
        out=sender,
    )
    stream.run(arriving(packets, clock, stream.pause))  # type: ignore[arg-type]
    third = len(sender.late) // 3
    print(f"{rate:,.0f} plots a second; busy for {clock.used / clock.now:.0%} of the time")
    show_latencies(
        np.concatenate(sender.late[third:]) * 1e3, np.concatenate(sender.coasted[third:])
    )


if __name__ == "__main__":
    main(*map(float, sys.argv[1:]))
