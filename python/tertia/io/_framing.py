"""Frames around data blocks, as used by recorders: IOSS (final format) and RFF."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeAlias

from tertia import _core
from tertia.io._categories import KNOWN

# function that returns where the contents of a frame begin and end, and where the frame ends
Frame: TypeAlias = Callable[[bytes, int], tuple[int, int, int]]
# number of frames from which the format is recognised
_DECIDING = 10
_RFF_HEADER = 128


def _ioss(contents: bytes, at: int) -> tuple[int, int, int]:
    """Length, error, board, day, three bytes of time; then contents and four bytes of padding."""
    end = at + int.from_bytes(contents[at : at + 2], "big")
    return at + 8, end - 4, end


def _rff(contents: bytes, at: int) -> tuple[int, int, int]:
    """Four bytes of time and the length, low byte first; then contents."""
    end = at + 6 + int.from_bytes(contents[at + 4 : at + 6], "little")
    return at + 6, end, end


# formats of frames, and the first byte of the first frame
FORMATS: tuple[tuple[Frame, int], ...] = ((_ioss, 0), (_rff, _RFF_HEADER))


def frames(contents: bytes) -> Iterator[tuple[int, bytes | None]] | None:
    """Return the number of each frame, from 1, and its contents; None if there are no frames.

    The contents are None for a last frame that is cut off.
    """
    for frame, begin in FORMATS:
        if _is_so(contents, frame, begin):
            return _each(contents, frame, begin)
    return None


def _is_so(contents: bytes, frame: Frame, at: int) -> bool:
    """Return whether the first frames contain only data blocks of known categories."""
    for number in range(_DECIDING):
        if at >= len(contents):
            return number > 0
        begin, stop, end = frame(contents, at)
        if not begin < stop <= end or (number == 0 and end > len(contents)):
            return False
        if end > len(contents):
            return True
        category, *_, read = _core.asterix_blocks(contents[begin:stop])
        if read != stop - begin or not KNOWN.issuperset(category.tolist()):
            return False
        at = end
    return True


def _each(contents: bytes, frame: Frame, at: int) -> Iterator[tuple[int, bytes | None]]:
    number = 1
    while at < len(contents):
        begin, stop, end = frame(contents, at)
        if not begin <= stop or end > len(contents):
            yield number, None
            return
        yield number, contents[begin:stop]
        at, number = end, number + 1
