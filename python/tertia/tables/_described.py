"""Descriptions of sensors: objects, rows of a table, or a file in TOML."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import polars as pl

from tertia.sensors import PositionSensor, Radar, Station
from tertia.tables._frames import is_table, names, series
from tertia.tables._parts import Part, RecordError, Source
from tertia.tables._sensors import GEODETIC, LOCAL, Row, Sensors, radars, stations, with_others
from tertia.tables._text import toml_of

# whatever describes sensors: objects, one row per sensor, or the path of a file
SensorsLike: TypeAlias = Any
REPORTS, _ORIGIN = "position_sensor", "origin"
_FORMS = "a DataFrame with one row per sensor, or the path of a .toml file"


@dataclass(frozen=True, slots=True)
class Description:
    """The tables of a sensors file in TOML, or rows without a kind, such as those of CSV."""

    document: Mapping[str, Any] | Sequence[Row]
    file: str = "sensors"

    @property
    def has_kinds(self) -> bool:
        """Whether the kinds of the sensors are stated."""
        return isinstance(self.document, Mapping)

    @property
    def origin(self) -> Row | None:
        """The table `[origin]`; None if there is none."""
        found = self.document.get(_ORIGIN) if isinstance(self.document, Mapping) else None
        if found is not None and not isinstance(found, Mapping):
            raise RecordError(
                f"{self.file}: {_ORIGIN} is not a table; it must begin with [{_ORIGIN}]"
            )
        return found

    def rows(self, noun: str) -> Sequence[Row]:
        """Return the tables `[[noun]]`; all rows if they have no kind."""
        if not isinstance(self.document, Mapping):
            return self.document
        rows = self.document.get(noun, [])
        for key in self.document.keys() - {noun} if not rows else ():
            if key.rstrip("s").casefold() == noun:
                raise RecordError(f"{self.file}: the tables [[{key}]] must be named [[{noun}]]")
        if not isinstance(rows, list) or not all(isinstance(row, Mapping) for row in rows):
            raise RecordError(
                f"{self.file}: {noun} is not a list of tables; each must begin with [[{noun}]]"
            )
        return rows

    def sensors(self, source: Source = (), *, flat: bool = False) -> Sensors[Any]:
        """Return the radars, as `radars` does, and the other sensors that track targets."""
        reports = self.rows(REPORTS) if self.has_kinds else ()
        others = self.rows("station") if self.has_kinds else ()
        some = self.rows("radar")
        if not reports and (not others or not some):
            return self.radars(source, flat=flat)
        found = self.radars(source, flat=flat) if some else None
        return with_others(found, reports, others, origin=self.origin, file=self.file)

    def radars(self, source: Source = (), *, flat: bool = False) -> Sensors[Radar]:
        """Return the radars, completed from recordings; the earth may be flat."""
        rows, origin, found = self.rows("radar"), self.origin, _found(source)
        return radars(rows, origin=origin, file=self.file, found=found or None, flat=flat)

    def stations(self, source: Source = ()) -> Sensors[Station]:
        """Return the stations; missing positions are taken from the recordings."""
        found = _found(source)
        rows = [
            row
            if {LOCAL[0], GEODETIC[0]} & set(row)
            else {**found.get(str(row.get("name")), {}), **row}
            for row in self.rows("station")
        ]
        return stations(rows, origin=self.origin, file=self.file)


def _found(source: Source) -> dict[str, Row]:
    """Return what recordings say of sensors; if several describe one, the first is used."""
    return {name: row for part in reversed(source) for name, row in part.sensors.items()}


def description(path: Path) -> Description:
    """Return the description in a TOML file."""
    try:
        return Description(toml_of(path), str(path))
    except ValueError as error:
        raise RecordError(f"cannot read {path}: {error}") from None


def sensors_of(given: SensorsLike) -> Sensors[Any]:
    """Return radars and other sensors that track targets, from any description."""
    described = _described(given)
    return described.sensors() if isinstance(described, Description) else described


def stations_of(given: SensorsLike) -> Sensors[Station]:
    """Return stations from any description."""
    described = _described(given)
    return described.stations() if isinstance(described, Description) else described


def _described(given: SensorsLike) -> Description | Sensors[Any]:
    if isinstance(given, Sensors):
        return given
    if isinstance(given, (str, os.PathLike)):
        path = Path(given)
        if path.suffix.lower() != ".toml":
            raise ValueError(
                f"sensors is {str(path)!r}; a path must be that of a .toml file: read other files "
                "into a DataFrame"
            )
        return description(path)
    if is_table(given):
        Part(given, "sensors").require("name")
        columns = {str(name): series(given, name) for name in names(given)}
        return Description(pl.DataFrame(columns).to_dicts())
    if not isinstance(given, Sequence):
        raise TypeError(
            f"sensors is a {type(given).__name__}; it must be a sequence of sensors, {_FORMS}"
        )
    for at, one in enumerate(given):
        if not isinstance(one, (Radar, PositionSensor, Station)):
            raise TypeError(
                f"sensors[{at}] is a {type(one).__name__}; it must be a Radar, PositionSensor or "
                f"Station; or sensors must be {_FORMS}"
            )
    frame = getattr(given[0], "frame", None) if given else None
    return Sensors(given, np.zeros(len(given)), np.full(len(given), np.nan), frame)
