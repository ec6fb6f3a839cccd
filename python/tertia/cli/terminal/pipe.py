"""Lines from a pipe and packets from a socket, as they arrive."""

import enum
import os
import queue
import socket
import threading
from collections.abc import Callable, Generator, Iterator

_BYTES, _WAITING = 1 << 16, 16
_PATIENCE_S = 60.0
# largest numbers of packets that wait, and that are processed together
_PACKETS, _TOGETHER = 100_000, 2000


class Quiet(enum.Enum):
    """Marks for pauses: no line is waiting, or no line has arrived for some time."""

    NOW = enum.auto()
    LONG = enum.auto()


class _Arriving:
    """Parts that a thread reads, so that pauses are detected; the thread waits for the consumer."""

    def __init__(self, read: Callable[[], bytes], pause: float, waiting: int) -> None:
        self._pause = pause
        self._read: queue.Queue[bytes | OSError] = queue.Queue(waiting)
        # not through sys.stdin: its lock would be held when the program ends
        threading.Thread(target=self._take, args=(read,), daemon=True).start()

    def _take(self, read: Callable[[], bytes]) -> None:
        part = b"\n"
        while part:
            try:
                part = read()
            except OSError as error:
                self._read.put(error)
                return
            self._read.put(part)

    def _next(self) -> Generator[Quiet, None, bytes]:
        if self._read.empty():
            yield Quiet.NOW
        part = self._wait(self._pause)
        if part is None:
            yield Quiet.LONG
        while part is None:
            # once Polars has set its handler, Ctrl-C interrupts only a wait with a timeout
            part = self._wait(_PATIENCE_S)
        if isinstance(part, OSError):
            raise part
        return part

    def _wait(self, seconds: float) -> bytes | OSError | None:
        try:
            return self._read.get(timeout=seconds)
        except queue.Empty:
            return None


class Lines(_Arriving):
    """The lines that arrive at a file descriptor, and marks when none arrive."""

    def __init__(self, descriptor: int, pause: float) -> None:
        super().__init__(lambda: os.read(descriptor, _BYTES), pause, _WAITING)

    def __iter__(self) -> Iterator[list[bytes] | Quiet]:
        """Yield lines that arrived together, and a mark before waiting for more."""
        rest = b""
        while part := (yield from self._next()):
            *lines, rest = (rest + part).split(b"\n")
            yield lines
        if rest:
            yield [rest]


class Packets(_Arriving):
    """The packets that arrive at a socket, and marks when none arrive."""

    def __init__(self, receiving: socket.socket, pause: float) -> None:
        # an empty packet must not end the loop
        super().__init__(lambda: receiving.recv(_BYTES) or b"\0", pause, _PACKETS)

    def __iter__(self) -> Iterator[list[bytes] | Quiet]:
        """Yield packets that arrived together, and a mark before waiting for more."""
        while True:
            packets = [(yield from self._next())]
            while not self._read.empty() and len(packets) < _TOGETHER:
                packets.append((yield from self._next()))
            yield packets
