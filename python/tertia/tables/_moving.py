"""Moving stations, whose positions are given in each row of a table."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import polars as pl

from tertia._arrays import FloatArray, IntArray
from tertia.location._height import in_the_plane
from tertia.sensors import Station
from tertia.tables._doubts import doubt
from tertia.tables._frames import names
from tertia.tables._names import usual
from tertia.tables._parts import Part, RecordError
from tertia.tables._records import Records, Schema, number
from tertia.tables._sensors import GEODETIC, Sensors

# positions of sensors in the rows of measurements, local or geodetic
PLACES: Schema = {
    "place_0": number("sensor_east_m", "sensor_latitude_deg"),
    "place_1": number("sensor_north_m", "sensor_longitude_deg"),
    "place_2": number("sensor_up_m", "sensor_height_m"),
}
_UNPLACED = (
    "{} can be used only if the positions of all sensors are given as latitudes and longitudes"
)


def names_of_places(records: Records, sensors: Sensors[Station]) -> list[str]:
    """Return the quantities that are coordinates of sensors; empty if no sensor moves."""
    if "place_0" not in records.column:
        for number, part in enumerate(records.source):
            _doubt_unused(part, records.rows.filter(pl.col("part") == number)["sensor"])
        return []
    needed = list(PLACES)[: sensors.dimension]
    for name in needed:
        if name not in records.column:
            wanted = " or ".join(PLACES[name].columns)
            raise records.source[0].error(
                f"the positions of the sensors are incomplete: {wanted} is missing"
            )
    used = dict.fromkeys(name for which in needed for name in records.standard[which])
    if len(used) > len(needed):
        raise RecordError(
            f"the positions of the sensors are in {', '.join(used)}; use latitudes and longitudes, "
            "or east and north, for all of them"
        )
    if _are_geodetic(records) and sensors.frame is None:
        raise sensors.error(_UNPLACED.format(records.column["place_0"]))
    return needed


def _doubt_unused(part: Part, sensor: pl.Series) -> None:
    """Warn if latitudes and longitudes change, and are not used."""
    there = names(part.table)
    found = [usual(name, there) for name in GEODETIC[:2]]
    if None in found or found[0] == found[1]:
        return
    places = pl.DataFrame([part.series(str(name)).alias(str(name)) for name in found])
    each = places.with_columns(sensor=sensor).drop_nulls()
    if each.n_unique() > each["sensor"].n_unique():
        doubt(
            f"{part.called}: {found[0]} and {found[1]} change, and are not used; if they are "
            "positions of sensors that move, name them sensor_latitude_deg and sensor_longitude_deg"
        )


def _are_geodetic(records: Records) -> bool:
    return "sensor_latitude_deg" in records.standard["place_0"]


def local_places(records: Records, rows: pl.DataFrame, sensors: Sensors[Station]) -> FloatArray:
    """Return the position of the sensor of each row, with its axes as further rows, (M, 1 + D, D).

    The position and the axes are nan if a row has no position of a sensor.
    """
    d = sensors.dimension
    given = rows.select(list(PLACES)[:d]).to_numpy()
    found = np.full((len(given), 1 + d, d), np.nan)
    there = np.isfinite(given).all(axis=1)
    if not _are_geodetic(records):
        found[:, 0] = given
        found[there, 1:] = np.eye(d)
    elif there.any() and sensors.frame is not None:
        one = sensors.frame.station(*given[there].T)
        found[there, 0] = one.position[:, :d]
        axes = np.broadcast_to(np.asarray(one.axes), (int(there.sum()), 3, 3))
        found[there, 1:] = in_the_plane(axes) if d == 2 else axes
    return found


def apart(rows: pl.DataFrame, places: FloatArray, count: int) -> tuple[pl.DataFrame, IntArray]:
    """Return the rows, with an additional sensor for each row of a moving sensor.

    Also return, for each additional sensor, the index of the moving sensor that it represents,
    which is one of the `count` original sensors.
    """
    moves = np.isfinite(places[:, 0]).all(axis=1)
    site = rows["site"].to_numpy().copy()
    own = site[moves]
    site[moves] = count + np.arange(len(own))
    return rows.with_columns(site=pl.Series(site)), own


def stations_of(
    sensors: Sensors[Station], rows: pl.DataFrame, places: FloatArray, own: IntArray, count: int
) -> Sensors[Station]:
    """Return the sensors, followed by copies of `own` with their positions at `count` steps."""
    like = np.concatenate([np.arange(len(sensors.items)), own]).astype(np.int64)
    d = sensors.dimension
    position = np.empty((count, len(like), d))
    axes = np.empty((count, len(like), d, d))
    for k, which in enumerate(like):
        item = sensors.items[which]
        position[:, k] = item.position
        axes[:, k] = np.eye(d) if item.axes is None else item.axes
    there = np.isfinite(places[:, 0]).all(axis=1)
    step, site = rows["step"].to_numpy(), rows["site"].to_numpy()
    at = step[there], site[there]
    position[at], axes[at] = places[there, 0], places[there, 1:]
    for k in np.unique(at[1]) if count > 1 else ():
        # between its measurements, a sensor is where it was last
        last = _last(step[there & (site == k)], step[site == k], count)
        position[:, k], axes[:, k] = position[last, k], axes[last, k]
    items = [
        replace(sensors.items[which], position=position[:, k], axes=axes[:, k])
        for k, which in enumerate(like)
    ]
    return replace(
        sensors,
        items=items,
        norths=sensors.norths[like],
        range_difference_sigma=sensors.range_difference_sigma[like],
    )


def _last(known: IntArray, seen: IntArray, count: int) -> IntArray:
    """Return the last step with a known place for each of `count` steps; those `seen` keep theirs.

    The steps before the first one with a known place have this one.
    """
    own = np.unique(known)
    last = own[np.maximum(np.searchsorted(own, np.arange(count), side="right") - 1, 0)]
    last[seen] = seen
    return last
