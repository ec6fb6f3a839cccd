"""Stations that measure azimuths without ranges: their checks and their positions at each plot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia.sensors import Station

if TYPE_CHECKING:
    from tertia.tracker._plots import Plots

_OTHERS = ("range_sigma", "elevation_sigma", "arrival_time_sigma")


def check_station(station: Station, name: str) -> None:
    """Raise an error unless the tracker supports all properties of a station."""
    if station.azimuth_sigma is None:
        raise ValueError(f"{name}.azimuth_sigma is None; the tracker needs that of a Station")
    for key in _OTHERS:
        if getattr(station, key) is not None:
            raise ValueError(
                f"{name}.{key} is {getattr(station, key):g}; the tracker uses only azimuths of a "
                "Station: ranges need a Radar, and positions a PositionSensor"
            )
    if station.position.ndim > 1:
        raise ValueError(
            f"{name}.position has shape {station.position.shape}; where a Station moves, give its "
            "place at each plot in Plots(sensor_position=)"
        )
    if station.position_sigma > 0.0:
        raise ValueError(f"{name}.position_sigma is {station.position_sigma:g}; it must be 0 here")
    bias = station.bias
    if bias is None:
        return
    if bias.deviation_order > 0:
        raise ValueError(f"{name}.bias has deviation_order {bias.deviation_order}; it must be 0")
    for key in ("azimuth_sigma", "time_sigma"):
        if getattr(bias, key) != 0.0:
            raise ValueError(
                f"{name}.bias.{key} is {getattr(bias, key)}; the tracker estimates no errors of a "
                "Station: it must be 0"
            )


def azimuth_sigmas(sensors: Sequence[Any]) -> FloatArray:
    """Return the standard deviations of the azimuths of stations, (K,); nan for other sensors."""
    known = [one.azimuth_sigma if isinstance(one, Station) else np.nan for one in sensors]
    return np.array(known, dtype=np.float64)


def placed(plots: Plots, sensors: Sequence[Any]) -> Plots:
    """Return the plots with the positions of the stations, and with azimuths relative to north."""
    station = np.array([isinstance(one, Station) for one in sensors])
    moving = plots.sensor_position is not None or plots.sensor_heading is not None
    if not moving and not station.any():
        return plots
    known = (plots.sensor >= 0) & (plots.sensor < len(sensors))
    own = np.where(known, plots.sensor, 0)
    seen = known & station[own]
    ranged = np.flatnonzero(seen & ~np.isnan(plots.range))
    if len(ranged):
        at = ranged[0]
        raise ValueError(
            f"plots.range[{at}] is {plots.range[at]:g}, and sensors[{own[at]}] is a Station; it "
            "must be nan"
        )
    nowhere = [np.nan, np.nan]
    places = [one.position[:2] if isinstance(one, Station) else nowhere for one in sensors]
    place = np.array(places, dtype=np.float64)[own]
    if plots.sensor_position is not None:
        moved = np.asarray(np.isfinite(plots.sensor_position).all(axis=1))
        place = np.where(moved[:, np.newaxis], plots.sensor_position, place)
        _require_stations("sensor_position", moved & known & ~seen, own)
    north = np.array([north_of(one) for one in sensors])[own]
    if plots.sensor_heading is not None:
        turned = np.asarray(np.isfinite(plots.sensor_heading))
        north = north + np.where(turned, plots.sensor_heading, 0.0)
        _require_stations("sensor_heading", turned & known & ~seen, own)
    given = np.full((len(plots), 2), np.nan) if plots.position is None else plots.position
    return plots._replaced(
        position=np.where(seen[:, np.newaxis], place, given),
        azimuth=plots.azimuth + north,
    )


def _require_stations(name: str, wrong: BoolArray, sensor: IntArray) -> None:
    """Raise an error if any of these plots has a property that only plots of a Station can have."""
    for at in np.flatnonzero(wrong)[:1]:
        raise ValueError(
            f"plots.{name}[{at}] belongs to sensors[{sensor[at]}], which is not a Station; pass "
            "plots of other moving sensors as positions of a PositionSensor"
        )


def north_of(sensor: Any) -> float:
    """Return the azimuth, in the system plane, of the direction that is north at the station."""
    axes = sensor.axes if isinstance(sensor, Station) else None
    return 0.0 if axes is None else float(np.arctan2(axes[1, 0], axes[1, 1]))
