"""Times, identities and rows of tracks as they are in tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl

from tertia._arrays import FloatArray, IntArray
from tertia.flightplan import FlightPlan
from tertia.tables._columns import PER_SECOND, known
from tertia.tracker import NO_IDENTITY, TrackTable

# bases of identities: decimal numbers, mode 3/A codes in octal, 24-bit addresses in hexadecimal
IDENTITIES = {"icao_address": 16, "mode_3a": 8, "identity": 10}
_DIGITS = {16: "{:06X}", 8: "{:04o}"}
_DAY = 86_400

# components of the state: how their columns begin, and their units
_STATE = (
    ("east", "m"),
    ("north", "m"),
    ("velocity_east", "m_s"),
    ("velocity_north", "m_s"),
)
_PRODUCTS = {("m", "m"): "m2", ("m", "m_s"): "m2_s", ("m_s", "m_s"): "m2_s2"}


@dataclass(frozen=True, slots=True)
class Clock:
    """Times of the plots, and the seconds that stand for them.

    Dates become seconds since the midnight before the first of them.
    """

    dtype: pl.DataType
    midnight: int
    ticks: float

    @property
    def dated(self) -> bool:
        """Whether the times are dates."""
        return isinstance(self.dtype, pl.Datetime)

    @classmethod
    def of(cls, moments: pl.Series) -> Clock:
        """Return that of some times."""
        if not isinstance(moments.dtype, pl.Datetime) or moments.is_empty():
            return cls(moments.dtype, 0, 1.0)
        ticks = PER_SECOND[moments.dtype.time_unit]
        day = int(_DAY * ticks)
        return cls(moments.dtype, int(moments.to_physical().to_numpy().min()) // day * day, ticks)

    def seconds(self, moments: pl.Series) -> FloatArray:
        """Return times as seconds."""
        if not self.dated:
            return np.asarray(moments.to_numpy(), dtype=np.float64)
        since: FloatArray = (moments.to_physical().to_numpy() - self.midnight) / self.ticks
        return since

    def moments(self, seconds: FloatArray) -> pl.Series:
        """Return seconds as times."""
        if not self.dated:
            return pl.Series(seconds)
        ticks = self.midnight + np.rint(seconds * self.ticks).astype(np.int64)
        moments: pl.Series = pl.Series(ticks).cast(self.dtype)
        return moments


@dataclass(frozen=True, slots=True)
class Identities:
    """A column of identities: how it is called, and in what base it is."""

    name: str

    def numbers(self, text: pl.Series) -> pl.Series:
        """Return texts as numbers, null where they are none."""
        found: pl.Series = text.str.to_integer(base=IDENTITIES[self.name], strict=False)
        return found.set((found < 0).fill_null(False), None)

    def texts(self, numbers: IntArray) -> pl.Series:
        """Return numbers as identities are written, null where there is none."""
        digits = _DIGITS.get(IDENTITIES[self.name])
        if digits is None:
            return pl.Series(numbers).set(pl.Series(numbers == NO_IDENTITY), None)
        texts = [None if n == NO_IDENTITY else digits.format(n) for n in numbers.tolist()]
        return pl.Series(texts, dtype=pl.String)


def plan_names(plans: Sequence[FlightPlan]) -> list[str]:
    """Return how plans are called: by their names, or by numbers from 1 on."""
    return [str(number) if p.name is None else p.name for number, p in enumerate(plans, start=1)]


def track_rows(
    table: TrackTable,
    *,
    clock: Clock,
    identities: Identities,
    radars: Sequence[str],
    plans: Sequence[FlightPlan],
    geodetic: Mapping[str, FloatArray],
) -> pl.DataFrame:
    """Return one row per row of the table, null for what is not known.

    `geodetic` has positions on the earth by column, if they are known.
    """
    followed = table.plan >= 0
    return pl.DataFrame(
        {
            "time_s": clock.moments(table.time),
            "track": table.track,
            "radar": _named(table.sensor, list(radars)),
            "plot": pl.Series(table.plot).set(pl.Series(table.plot < 0), None),
            **_state(table),
            **geodetic,
            "course_deg": np.degrees(np.arctan2(*table.velocity.T)) % 360.0,
            "speed_m_s": np.hypot(*table.velocity.T),
            "turn_probability": table.turn_probability,
            "height_m": known(table.height, ~np.isnan(table.height)),
            "vertical_rate_m_s": known(table.vertical_rate, ~np.isnan(table.vertical_rate)),
            identities.name: identities.texts(table.identity),
            "plan": _named(table.plan, plan_names(plans)),
            "conforms": pl.Series(table.conforms).set(pl.Series(~followed), None),
            "confirmed": table.confirmed,
        }
    )


def covariance_columns() -> dict[tuple[int, int], str]:
    """Return the columns of the covariances between two components of the state."""
    return {
        (i, j): f"covariance_{first}_{second}_{_PRODUCTS[unit, other]}"
        for i, (first, unit) in enumerate(_STATE)
        for j, (second, other) in enumerate(_STATE)
        if i < j
    }


def _state(table: TrackTable) -> dict[str, FloatArray]:
    values = np.hstack([table.position, table.velocity])
    columns = {}
    for i, (name, unit) in enumerate(_STATE):
        columns[f"{name}_{unit}"] = values[:, i]
        columns[f"{name}_sigma_{unit}"] = np.sqrt(table.covariance[:, i, i])
    for (i, j), name in covariance_columns().items():
        columns[name] = table.covariance[:, i, j]
    return columns


def _named(numbers: IntArray, names: list[str]) -> pl.Series:
    """Return names by their numbers, null where the number is -1."""
    # the last one is that of -1
    chosen = np.array([*names, None], dtype=object)[numbers]
    return pl.Series(chosen.tolist(), dtype=pl.String)
