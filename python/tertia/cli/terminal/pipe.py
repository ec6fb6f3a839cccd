"""Lines from a pipe, as they are written."""

import enum
import os
import queue
import threading
from collections.abc import Generator, Iterator

_BYTES, _WAITING = 1 << 16, 16


class Quiet(enum.Enum):
    """Marks that no line has arrived: at present, or for some time."""

    NOW = enum.auto()
    LONG = enum.auto()


class Lines:
    """The lines that can be read from a file descriptor, and marks where there are none.

    A thread reads, to detect pauses; it waits until the lines are taken.
    """

    def __init__(self, descriptor: int, pause: float) -> None:
        self._pause = pause
        self._read: queue.Queue[bytes | OSError] = queue.Queue(_WAITING)
        # not through sys.stdin: its lock would be held when the program ends
        threading.Thread(target=self._take, args=(descriptor,), daemon=True).start()

    def _take(self, descriptor: int) -> None:
        part = b"\n"
        while part:
            try:
                part = os.read(descriptor, _BYTES)
            except OSError as error:
                self._read.put(error)
                return
            self._read.put(part)

    def __iter__(self) -> Iterator[list[bytes] | Quiet]:
        """Yield lines that arrived together, and a mark before waiting for more."""
        rest = b""
        while part := (yield from self._next()):
            *lines, rest = (rest + part).split(b"\n")
            yield lines
        if rest:
            yield [rest]

    def _next(self) -> Generator[Quiet, None, bytes]:
        if self._read.empty():
            yield Quiet.NOW
        try:
            part = self._read.get(timeout=self._pause)
        except queue.Empty:
            yield Quiet.LONG
            part = self._read.get()
        if isinstance(part, OSError):
            raise part
        return part
