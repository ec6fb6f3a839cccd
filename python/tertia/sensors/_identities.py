"""Identities of targets by their kinds: addresses, codes, callsigns, and any other numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from tertia._arrays import IntArray, array_of, place_of, without_na

TextArray: TypeAlias = npt.NDArray[np.str_]
# numbers, addresses, codes and callsigns; None where plots have none of a kind
Identities: TypeAlias = tuple[IntArray, IntArray | None, IntArray | None, TextArray | None]

# the identity of a target that has none, and its callsign
NO_IDENTITY = -1
NO_CALLSIGN = ""
# the columns of identities, as the core reads them
COLUMNS = ("identity", "icao_address", "mode_3a", "callsign")
# kinds of identities, those that are shared least first, and those that are numbers
KINDS = ("icao_address", "identity", "callsign", "mode_3a")
NUMBERS = ("icao_address", "identity", "mode_3a")
_ADDRESSES, _CODES = 1 << 24, 1 << 12
# characters of a callsign, and the codes that they may have
_LETTERS, _FIRST, _LAST = 8, 0x20, 0x5F


def whole(value: npt.ArrayLike, name: str) -> IntArray:
    """Return `value` as int64 numbers."""
    array = array_of(value, name)
    if array.dtype == np.int64:
        return array
    if array.dtype.kind == "O":
        # nullable columns of older pandas
        array = np.asarray(array.tolist())
    if array.dtype.kind not in "iu" and array.size:
        raise TypeError(f"{name} has dtype {array.dtype}; it must hold integers")
    large = np.flatnonzero(array > np.iinfo(np.int64).max)
    if len(large):
        raise ValueError(
            f"{name}[{large[0]}] is {array.flat[large[0]]}; it must be less than 2**63"
        )
    return array.astype(np.int64)


def icao_addresses(value: npt.ArrayLike) -> IntArray:
    """Return addresses of 24 bits; -1 where there is none."""
    return _below(value, "icao_address", _ADDRESSES, "an address of 24 bits")


def mode_3a_codes(value: npt.ArrayLike) -> IntArray:
    """Return mode 3/A codes; -1 where there is none."""
    return _below(value, "mode_3a", _CODES, "a code of 12 bits, as 0o7700")


def callsigns(value: npt.ArrayLike) -> TextArray:
    """Return callsigns in capital letters, without spaces at their ends; empty where unknown."""
    # NumPy would make texts of what is none in a list
    array = value if isinstance(value, np.ndarray) else np.asarray(value, dtype=object)
    if array.dtype.kind == "O":
        array = _texts(without_na(array))
    if array.dtype.kind != "U" and array.size:
        raise TypeError(f"callsign has dtype {array.dtype}; it must hold text")
    texts = np.char.upper(np.char.rstrip(array.astype(np.str_)))
    long = np.flatnonzero(np.char.str_len(texts) > _LETTERS)
    found = texts.astype(f"U{_LETTERS}", order="C")
    letters = found.reshape(-1, 1).view(np.uint32)
    wrong = np.flatnonzero(np.any((letters > _LAST) | (letters < _FIRST) & (letters > 0), axis=1))
    for at in (*long[:1], *wrong[:1]):
        raise ValueError(
            f"{_place('callsign', array, at)} is {str(texts.flat[at])!r}; it must have at most "
            f"{_LETTERS} letters and digits"
        )
    return found


def checked(
    icao_address: npt.ArrayLike | None,
    mode_3a: npt.ArrayLike | None,
    callsign: npt.ArrayLike | None,
    identity: npt.ArrayLike | None,
) -> dict[str, npt.NDArray[Any] | None]:
    """Return columns of identities by their names, after checking them, as the core reads them."""
    return {
        "identity": None if identity is None else whole(identity, "identity"),
        "icao_address": None if icao_address is None else icao_addresses(icao_address),
        "mode_3a": None if mode_3a is None else mode_3a_codes(mode_3a),
        "callsign": None if callsign is None else callsigns(callsign),
    }


def identities_of(rows: Any) -> Identities:
    """Return the columns of identities of plots or tracks, as the core reads them."""
    identity, icao_address, mode_3a, callsign = (getattr(rows, name) for name in COLUMNS)
    return identity, icao_address, mode_3a, callsign


def is_known(column: npt.NDArray[Any]) -> npt.NDArray[np.bool_]:
    """Return which identities of a kind are known."""
    known: npt.NDArray[np.bool_] = (
        column != NO_CALLSIGN if column.dtype.kind == "U" else column >= 0
    )
    return known


def leading(rows: Any, kinds: Sequence[str] = KINDS) -> str:
    """Return the first of the kinds of identities that any of the rows has."""
    for name in kinds:
        column = getattr(rows, name, None)
        if column is not None and np.any(is_known(column)):
            return name
    return "identity"


def of_target(
    icao_address: int | None, mode_3a: int | None, callsign: str | None, identity: int | None
) -> tuple[Mapping[str, Any], tuple[int, int, int, str]]:
    """Return the identities of one target, checked, by their names and as the core reads them."""
    number = NO_IDENTITY if identity is None else identity
    address = NO_IDENTITY if icao_address is None else int(icao_addresses(icao_address))
    code = NO_IDENTITY if mode_3a is None else int(mode_3a_codes(mode_3a))
    text = NO_CALLSIGN if callsign is None else str(callsigns(callsign))
    named = {
        "icao_address": None if address == NO_IDENTITY else address,
        "mode_3a": None if code == NO_IDENTITY else code,
        "callsign": text or None,
        "identity": identity,
    }
    return named, (number, address, code, text)


def _below(value: npt.ArrayLike, name: str, end: int, what: str) -> IntArray:
    numbers = whole(value, name)
    wrong = np.flatnonzero((numbers >= end) | (numbers < NO_IDENTITY))
    if len(wrong):
        first = numbers.flat[wrong[0]]
        place = _place(name, numbers, wrong[0])
        raise ValueError(f"{place} is {first}; it must be {what}, or -1 if there is none")
    return numbers


def _place(name: str, array: npt.NDArray[Any], at: int) -> str:
    """Return the name of an element of a column, by its place in the flattened column."""
    return place_of(name, map(int, np.unravel_index(at, array.shape)))


def _texts(array: npt.NDArray[Any]) -> TextArray:
    """Return objects as text; None and nan are unknown callsigns."""
    items = array.reshape(-1).tolist()
    texts = [NO_CALLSIGN if item is None or item != item else item for item in items]  # noqa: PLR0124  # nan
    for at, text in enumerate(texts):
        if not isinstance(text, str):
            raise TypeError(f"{_place('callsign', array, at)} is {text!r}; it must be text")
    return np.array(texts, dtype=np.str_).reshape(array.shape)
