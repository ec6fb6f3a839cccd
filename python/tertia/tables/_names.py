"""Recognition of column names that are written in different ways."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from difflib import SequenceMatcher
from functools import lru_cache
from shlex import quote
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tertia.tables._parts import Part, Source

# least similarity of a misspelt name: of a required column, and of an optional column
NEAR, VERY_NEAR = 0.75, 0.85
# similarity of usual names of a quantity, which are no misspelt names
_USUAL = 0.8
# words in the usual names of columns, by the standard name without its unit
_WORDS = {
    "time": "time timestamp datetime date utc epoch t",
    "latitude": "latitude lat",
    "longitude": "longitude lon lng long",
    "east": "easting x",
    "north": "northing y",
    "azimuth": "azimuth az azi azim bearing brg doa aoa",
    "elevation": "el elev",
    "range": "distance dist rng",
    "arrival_time": "toa",
    "sensor": "sensor station receiver rx node site anchor radar camera buoy",
    "name": "id sensor station receiver rx node site anchor radar camera buoy",
    "speed": "sog velocity groundspeed",
    "course": "cog heading track",
}
# words in the names of other quantities
_OTHERS = {"rate", "sigma", "std", "error", "bias", "accuracy", "difference", "bistatic"}
# units in names; those of a line are different spellings of one
_SPELLINGS = """
    m_s2\nm_s mps\ndeg_s\nm2\nm metres meters\nkm\ncm\nmm\ndm\nnm nmi\nmi mile miles\nft feet
    yd yds yards\nkt kts kn knots\nkm_h kmh kph\nmph\ndeg degrees\nrad radians\nmrad
    gon gons grad grads gradians\nmil mils\ns sec seconds\nms\nus\nns
"""
_SPELT = {name: line.split()[0] for line in _SPELLINGS.split("\n") for name in line.split()}
_UNIT = re.compile(f"_({'|'.join(_SPELT)})$")


@lru_cache(maxsize=1024)
def plain_name(name: object) -> str:
    """Return a name in standard spelling; for example, `Azimuth [°]` becomes azimuth_deg."""
    plain = re.sub(r"[\W_]+", "_", str(name).replace("°", " deg")).strip("_").casefold()
    return plain or str(name)


def hint(columns: Iterable[str], there: Sequence[object], near: float = NEAR) -> str:
    """Return the end of a message that suggests the intended name, or an empty text."""
    likeness, name, _ = _nearest(columns, there)
    if likeness > 1.0:
        return f"; {name} is in another unit"
    return f" (did you mean {name}?)" if likeness >= near else ""


def states_other_unit(column: str, name: object) -> bool:
    """Return whether a name ends with a unit, and a column with another one."""
    units = [_UNIT.search(plain_name(text)) for text in (column, name)]
    spelt = [_SPELT[unit[1]] for unit in units if unit is not None]
    # speed_ms is in metres per second
    return len(spelt) == 2 and spelt[0] != spelt[1] and spelt != ["m_s", "ms"]


def usual(column: str, there: Sequence[object]) -> str | None:
    """Return the name that is most similar to that of a column, if it is similar enough."""
    likeness, name, _ = _nearest([column], there)
    return name if likeness >= NEAR else None


def assignment(
    columns: Sequence[str], there: Sequence[object], option: str | None, *, shell: bool
) -> str:
    """Return the end of a message that says how to give the name of a missing column.

    `option` is the option of a command (`shell`) or of a function that does it, if there is one.
    """
    likeness, name, column = _nearest(columns, there)
    if option is None or likeness > 1.0:
        return ""
    if likeness < NEAR:
        column, name = columns[0] if len(columns) == 1 else "NAME", "COLUMN"
    if shell:
        return f": give --{option.replace('_', '-')} {quote(f'{column}={name}')}"
    return f': give {option}s={{"{column}": "{name}"}}'


def joined(ends: Sequence[str]) -> str:
    """Return the ends of several messages by `assignment` as one end."""
    stems = [one.removeprefix(": give ") for one in ends if one]
    if not stems:
        return ""
    if not stems[0].startswith("columns={"):
        return f": give {' '.join(stems)}"
    inside = ", ".join(one.removeprefix("columns={").removesuffix("}") for one in stems)
    return f": give columns={{{inside}}}"


def _nearest(columns: Iterable[str], there: Sequence[object]) -> tuple[float, str, str]:
    """Return the similarity of the most similar name, this name, and the column it resembles."""
    found = [(_alike(column, name), str(name), column) for column in columns for name in there]
    return max(found, key=lambda one: one[:2], default=(0.0, "", ""))


def own_names(part: Part, source: Source, columns: Mapping[str, str]) -> dict[str, str]:
    """Return the names of columns that apply to a part: not those that only other parts have."""
    others = [one for one in source if one is not part]
    return {
        name: column
        for name, column in columns.items()
        if part.has(column) or not any(other.has(column) for other in others)
    }


def misspelt(
    columns: Sequence[str],
    known: Iterable[str],
    there: Iterable[object],
    option: str | None,
    *,
    shell: bool,
) -> str | None:
    """Return a message if unknown names are probably misspelt names of missing columns.

    `option` and `shell` are those of `assignment`.
    """
    plain = set(map(plain_name, known))
    others = [name for name in there if plain_name(name) not in plain]
    said = hint(columns, others, VERY_NEAR)
    how = assignment(columns, others, option, shell=shell)
    return f"has no column {' or '.join(columns)}{said}{how}" if said else None


def all_misspelt(keys: Sequence[str], there: Sequence[str]) -> list[str]:
    """Return messages about keys that are given under misspelt names."""
    missing = [key for key in keys if key not in there]
    found = []
    for name in there:
        if name in keys:
            continue
        # the key that this name resembles most
        key = _nearest(missing, [name])[2]
        said = hint([key], [name], VERY_NEAR)
        if said:
            found.append(f"has no {key}{said}")
    return found


@lru_cache(maxsize=4096)
def _alike(column: str, name: object) -> float:
    """Return the similarity of two names without units; above 1 if only the units differ."""
    one, other = (_UNIT.sub("", plain_name(text)) for text in (column, name))
    units = [plain_name(text)[len(stem) :] for text, stem in ((column, one), (name, other))]
    if one == other and all(units):
        return 2.0
    if ("altitude" in one) != ("altitude" in other):
        # resembles a latitude
        return 0.0
    likeness = SequenceMatcher(None, one, other).ratio()
    # names with transposed letters count as misspelt
    if len(one) > 3 and sorted(one) == sorted(other):
        return 1.0
    words = {*other.split("_")}
    if likeness < _USUAL and words & {*_WORDS.get(one, "").split()} and not words & _OTHERS:
        return _USUAL if units[0] == units[1] or not units[1] else 2.0
    return likeness
