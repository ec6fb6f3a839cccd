"""Reports of positions and velocities, and moving stations, in tables of plots."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia.geo import LocalFrame, SystemPlane
from tertia.location._height import in_the_plane
from tertia.sensors import Radar, Station
from tertia.tables._groups import symmetric
from tertia.tables._records import Field, Schema, number
from tertia.tables._sensors import Sensors
from tertia.tables._velocities import COURSE, of_speed, to_plane, turned
from tertia.tracker._azimuths import north_of

# 'not available' in AIS (ITU-R M.1371)
AIS_LATITUDE = 91.0
# places and headings of sensors that move
MOVING: Schema = {
    "sensor_east": number("sensor_east_m"),
    "sensor_north": number("sensor_north_m"),
    "sensor_latitude": Field("number", {"sensor_latitude_deg": 1.0}, most=90.0),
    "sensor_longitude": Field("number", {"sensor_longitude_deg": 1.0}, most=360.0),
    "sensor_heading": Field("number", {"sensor_heading_deg": np.pi / 180}, most=720.0),
}
REPORTED: Schema = {
    "east": number("east_m"),
    "north": number("north_m"),
    "latitude": Field(
        "number", {"latitude_deg": 1.0}, most=90.0, unavailable={"latitude_deg": AIS_LATITUDE}
    ),
    "longitude": Field("number", {"longitude_deg": 1.0}, most=360.0),
    "east_sigma": number("east_sigma_m", positive=True),
    "north_sigma": number("north_sigma_m", positive=True),
    "east_north": number("covariance_east_north_m2"),
    "velocity_east": number("velocity_east_m_s"),
    "velocity_north": number("velocity_north_m_s"),
    **COURSE,
    "velocity_east_sigma": number("velocity_east_sigma_m_s", positive=True),
    "velocity_north_sigma": number("velocity_north_sigma_m_s", positive=True),
    "velocity_east_north": number("covariance_velocity_east_velocity_north_m2_s2"),
    **MOVING,
}


def reported_of(
    rows: pl.DataFrame, sensors: Sensors[Any], reports: BoolArray
) -> dict[str, FloatArray]:
    """Return the columns of `Plots` for reports; nan in other rows."""
    column = {name: rows[name].to_numpy() for name in REPORTED if name in rows.columns}
    place = np.column_stack([column["east"], column["north"]])
    is_local = np.isfinite(place).all(axis=1)
    if sensors.frame is not None:
        height = np.nan_to_num(rows["height"].to_numpy())
        found = sensors.frame.to_local(column["latitude"], column["longitude"], height)[:, :2]
        place = np.where(np.isnan(place), found, place)
    place[~reports] = np.nan
    turn = np.tile(np.eye(2), (len(place), 1, 1))
    if isinstance(sensors.frame, SystemPlane):
        # what is beside latitudes and longitudes is relative to true north
        turn[~is_local] = to_plane(sensors.frame, np.nan_to_num(place[~is_local]))
    columns = {"position": place, "covariance": turned(turn, _spread(column, "", reports))}
    velocity = np.column_stack([column["velocity_east"], column["velocity_north"]])
    velocity = np.where(np.isnan(velocity), of_speed(column["speed"], column["course"]), velocity)
    velocity[~reports] = np.nan
    if np.isnan(velocity).all():
        return columns
    velocity = np.einsum("nij,nj->ni", turn, velocity)
    spread = turned(turn, _spread(column, "velocity_", reports))
    return {**columns, "velocity": velocity, "velocity_covariance": spread}


def moving_of(rows: pl.DataFrame, sensors: Sensors[Any]) -> dict[str, FloatArray]:
    """Return the columns of `Plots` for stations that move; nan in other rows.

    Radars that move are refused.
    """
    column = {name: rows[name].to_numpy() for name in MOVING}
    if all(np.isnan(values).all() for values in column.values()):
        return {}
    stations = np.array([isinstance(one, Station) for one in sensors.items])
    own = stations[rows["sensor"].to_numpy()]
    place = np.column_stack([column["sensor_east"], column["sensor_north"]])
    heading = column["sensor_heading"].copy()
    geodetic = np.column_stack([column["sensor_latitude"], column["sensor_longitude"]])
    far = own & np.isnan(place).any(axis=1) & np.isfinite(geodetic).all(axis=1)
    if far.any() and sensors.frame is not None:
        place[far], north = _places(sensors.frame, geodetic[far])
        # the direction of north where the station is, instead of where it was described
        given = np.array([north_of(one) for one in sensors.items])[rows["sensor"].to_numpy()[far]]
        heading[far] = np.nan_to_num(heading[far]) - given + north
    _refuse_radars(rows["sensor"].to_numpy(), place, geodetic, column["sensor_heading"], sensors)
    place[~own], heading[~own] = np.nan, np.nan
    return {"sensor_position": place, "sensor_heading": heading}


def _refuse_radars(
    sensor: IntArray,
    place: FloatArray,
    geodetic: FloatArray,
    heading: FloatArray,
    sensors: Sensors[Any],
) -> None:
    """Refuse radars that move or turn, according to the places or headings in their rows."""
    for k, one in enumerate(sensors.items):
        own = sensor == k
        if not isinstance(one, Radar) or not own.any():
            continue
        where = place[own]
        if sensors.frame is not None and np.isnan(where).all():
            where = sensors.frame.to_local(*geodetic[own].T)[:, :2]
        away = np.linalg.norm(where - one.position[:2], axis=1)
        turned = 2 * np.abs(np.sin(heading[own] / 2))
        if np.any(away > one.range_sigma) or np.any(turned > one.azimuth_sigma):
            raise sensors.error(
                f"radar {sensors.names[k]} moves or is turned, according to its rows, but radars "
                "must not: describe it as a position sensor, and give east and north of its plots "
                "with their sigmas and covariance"
            )


def _places(frame: LocalFrame | SystemPlane, geodetic: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return east and north of places, (N, 2), and the directions of their north in the plane."""
    if isinstance(frame, SystemPlane):
        local = frame.to_local(*geodetic.T)
        return local[:, :2], np.asarray(frame.scale_and_convergence(local)[1])
    there = frame.station(*geodetic.T)
    return there.position[:, :2], np.arctan2(*in_the_plane(np.asarray(there.axes))[:, 1].T)


def _spread(column: dict[str, FloatArray], of: str, reports: BoolArray) -> FloatArray:
    """Return covariances, (N, 2, 2); nan where a sigma is missing."""
    sigmas = np.column_stack([column[f"{of}east_sigma"], column[f"{of}north_sigma"]])
    spread = symmetric(sigmas, {(0, 1): np.nan_to_num(column[f"{of}east_north"])})
    whole = reports & np.isfinite(spread).all(axis=(1, 2))
    spread[~whole] = np.nan
    return spread
