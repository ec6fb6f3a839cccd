"""Fusion of the tracks of several sensors into one picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from tertia import tertiary
from tertia._arrays import FloatArray
from tertia._units import FLIGHT_LEVEL
from tertia.sensors import Radar
from tertia.tables._described import SensorsLike, sensors_of
from tertia.tables._frames import Table, result
from tertia.tables._groups import known, named, symmetric
from tertia.tables._identities import (
    IDENTIFIED,
    identities_in,
    identities_of,
    identity_columns,
)
from tertia.tables._parts import Source, source_of
from tertia.tables._records import SENSOR, TIME, Field, Schema, number, read
from tertia.tables._sensors import Sensors
from tertia.tables._times import Clock
from tertia.tables._track import COVARIANCES, state_columns
from tertia.tables._velocities import doubt_velocities
from tertia.tertiary import SensorTracks, SystemTracks

_MEANS = ("east_m", "north_m", "velocity_east_m_s", "velocity_north_m_s")
_SIGMAS = tuple(name.replace("_m", "_sigma_m", 1) for name in _MEANS)
TRACKS: Schema = {
    "time": TIME,
    "track": Field("name", {"track": 1.0}, required=True, whole=True),
    "sensor": SENSOR,
    "plot": number("plot"),
    "confirmed": Field("flag", {"confirmed": 1.0}),
    **{name: number(name, required=True) for name in _MEANS},
    **{name: number(name, positive=True) for name in _SIGMAS},
    **{name: number(name) for name in COVARIANCES.values()},
    "turn_probability": number("turn_probability"),
    "height": Field("number", {"height_m": 1.0, "flight_level": FLIGHT_LEVEL}),
    **IDENTIFIED,
}


@dataclass(frozen=True, slots=True)
class Fused:
    """Tracks of sensors, the picture that is made from them, and the names of the tracks."""

    tracks: SensorTracks
    names: list[str]
    picture: SystemTracks
    sensors: Sensors[Radar]
    clock: Clock
    identities: list[str]

    @property
    def rows(self) -> pl.DataFrame:
        """A table with one row for each target and cycle; unknown values are null."""
        found = self.picture
        members = {
            f"track_{name}": named(found.members[:, k], self.names)
            for k, name in enumerate(self.sensors.names)
        }
        return pl.DataFrame(
            {
                "time_s": self.clock.moments(found.time),
                "track": found.track,
                **state_columns(found, self.sensors),
                "height_m": known(found.height),
                **identity_columns(found, self.identities),
                "pvalue": known(found.pvalue),
                "confirmed": found.confirmed,
                "doubtful": found.doubtful,
                **members,
            }
        )

    @property
    def per_sensor(self) -> pl.DataFrame:
        """Return one row per sensor: how many tracks it has, and how many are fused with others."""
        found, rows = self.picture, []
        together = np.sum(found.members >= 0, axis=1) > 1
        for k, name in enumerate(self.sensors.names):
            own = found.members[:, k] >= 0
            count = len(np.unique(self.tracks.track[self.tracks.sensor == k]))
            share = float(np.mean(together[own])) if np.any(own) else None
            rows.append((name, int(np.sum(self.tracks.sensor == k)), count, share))
        names = ("row_count", "track_count")
        schema: dict[str, Any] = {"sensor": pl.String} | dict.fromkeys(names, pl.Int64)
        return pl.DataFrame(rows, schema | {"shared_share": pl.Float64}, orient="row")


def fuse_tracks(
    table: Table,
    *,
    sensors: SensorsLike,
    columns: Mapping[str, str] | None = None,
    **options: Any,
) -> Table:
    """Fuse the tracks of several sensors, as the command `tertia fuse-tracks` does.

    Parameters
    ----------
    table : DataFrame of Polars or pandas, Table or RecordBatch of pyarrow
        One row per message about a track, in any order, with columns as returned by `track`:
        `time_s`, `track`, `sensor`, `east_m`, `north_m`, `velocity_east_m_s` and
        `velocity_north_m_s`; and, if known, the sigmas and covariances, `turn_probability`,
        `height_m` or `flight_level`, `icao_address`, `mode_3a`, `callsign` and `identity`. If there
        is a column `plot`, rows without a plot are left out; if there is a column `confirmed`, rows
        that are not confirmed are left out.
    sensors : sequence of Radar, DataFrame, or str or Path
        The sensors. A sensor without a name is identified by its index. A table has one row per
        radar, with the columns of sensors files; a path is that of a sensors file in TOML.
    columns : mapping of str to str, optional
        The names that columns have in this table, keyed by their standard names.
    **options
        Options of `tertia.tertiary.FusionCentre`.

    Returns
    -------
    table of the same kind
        One row for each target and cycle, with `time_s`, `track`, position and velocity and their
        covariances, `course_deg`, `speed_m_s`, `height_m`, the identities, `pvalue`, `confirmed`,
        `doubtful`, and the target's track at each sensor, `track_<sensor>`. Unknown values are
        null.

    Raises
    ------
    RecordError, ValueError, TypeError
        As for `track`.

    Examples
    --------
    >>> import numpy as np, polars as pl
    >>> from tertia import tables
    >>> from tertia.sensors import Radar
    >>> radar = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0)
    >>> time = np.arange(0.0, 100.0, 4.0)
    >>> plots = pl.DataFrame({"time_s": time, "range_m": 50e3 + 200 * time, "azimuth_deg": 30.0})
    >>> tracks = tables.track(plots, sensors=[radar])
    >>> tables.fuse_tracks(tracks, sensors=[radar])["track_0"].unique().to_list()
    ['1']
    """
    found = fused_tracks(source_of(table), sensors, columns, **options)
    return result(table, found.rows)


def fused_tracks(
    source: Source,
    sensors: SensorsLike,
    columns: Mapping[str, str] | None = None,
    **options: Any,
) -> Fused:
    """Return the picture that is made from a table or from files of tracks."""
    radars = sensors_of(sensors)
    records = read(source, TRACKS, columns=columns, sensors=radars.names)
    rows, clock = records.rows, Clock.of(records.rows["time"], midnight=False)
    kept = np.ones(rows.height, dtype=bool)
    if "plot" in records.column:
        kept &= np.isfinite(rows["plot"].to_numpy())
    if "confirmed" in records.column:
        kept &= rows["confirmed"].fill_null(False).to_numpy()
    names, numbers = np.unique(rows["track"].to_numpy(), return_inverse=True)
    states = rows.select(_MEANS).to_numpy()
    whole = kept & np.all(np.isfinite(states), axis=1)
    tracks = SensorTracks(
        clock.seconds(rows["time"])[whole],
        rows["sensor"].to_numpy()[whole],
        numbers[whole],
        states[whole, :2],
        states[whole, 2:],
        covariance=_covariances(rows)[whole],
        height=rows["height"].to_numpy()[whole],
        **{name: column[whole] for name, column in identities_of(rows).items()},
        turn_probability=rows["turn_probability"].to_numpy()[whole],
    )
    each = tracks.track * len(radars.names) + tracks.sensor
    doubt_velocities("the tracks", each, tracks.time, tracks.position, tracks.velocity)
    picture = tertiary.fuse_tracks(tracks, radars.items, **options)
    return Fused(tracks, names.tolist(), picture, radars, clock, identities_in(records))


def _covariances(rows: pl.DataFrame) -> FloatArray:
    """Return covariances, (N, 4, 4), nan if unknown; without covariances they are diagonal."""
    sigmas = rows.select(_SIGMAS).to_numpy()
    between = {pair: rows[name].to_numpy() for pair, name in COVARIANCES.items()}
    covariance = symmetric(sigmas, between)
    beside = ~np.eye(4, dtype=bool)
    alone = np.all(np.isnan(covariance[:, beside]), axis=1)
    covariance[alone[:, np.newaxis, np.newaxis] & beside] = 0.0
    return covariance
