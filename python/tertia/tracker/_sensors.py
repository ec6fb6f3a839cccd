"""The sensors of a tracker in the form that the core takes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np

from tertia import _core
from tertia._arrays import FloatArray, instance
from tertia.sensors import PositionSensor, Radar, Station
from tertia.tracker._azimuths import check_station, placed
from tertia.tracker._earth import plane_of
from tertia.tracker._models import Motion, WindowModel, core_radar
from tertia.tracker._plots import Plots

Sensor: TypeAlias = Radar | PositionSensor | Station
# of a station, which does not say how often it sees a target
_DETECTION_PROBABILITY = 0.9


def sensors_of(values: Any) -> tuple[Sensor, ...]:
    """Return the sensors, after a check that there are some and that all have the same frame."""
    if not isinstance(values, Sequence):
        names = "Radar, PositionSensor or Station"
        raise TypeError(f"sensors is {values!r}; it must be a sequence of {names}")
    for i, value in enumerate(values):
        instance(value, f"sensors[{i}]", Radar, PositionSensor, Station)
    if not values:
        raise ValueError("sensors is empty; there must be at least one")
    plane_of([one for one in values if isinstance(one, Radar)])
    stations = {i: one for i, one in enumerate(values) if isinstance(one, Station)}
    if len(stations) == len(values):
        raise ValueError("sensors has only Stations; azimuths without ranges start no tracks")
    for i, station in stations.items():
        check_station(station, f"sensors[{i}]")
    refuse_deviations(values)
    return tuple(values)


def refuse_deviations(sensors: Sequence[Sensor], name: str = "sensors") -> None:
    """Raise an error if a radar states a deviation, which is of a direction finder."""
    for i, one in enumerate(sensors):
        if one.bias is not None and one.bias.deviation_order > 0:
            raise ValueError(
                f"{name}[{i}].bias has deviation_order {one.bias.deviation_order}; it must be 0: "
                "state an azimuth_sigma that includes the deviation, or correct the azimuths"
            )


def slant(sensors: Sequence[Sensor], plots: Plots | None = None) -> list[bool]:
    """Return which sensors are radars with slant ranges: all if any of the plots has a height.

    If no height is known, only the ranges of radars with a height of their own are slant ranges.
    """
    radars = [one if isinstance(one, Radar) else None for one in sensors]
    if plots is not None and np.isfinite(plots.height).any():
        return [one is not None for one in radars]
    return [one is not None and (one.site is not None or len(one.position) > 2) for one in radars]


def interval(sensor: Sensor) -> float:
    """Return the seconds between two plots of a target; 0 if a sensor has no such interval."""
    if isinstance(sensor, Station):
        return 0.0
    return sensor.scan_period if isinstance(sensor, Radar) else sensor.update_interval


def core_sensors(
    sensors: Sequence[Sensor], motion: Motion
) -> tuple[list[_core.Radar], list[_core.Geometry]]:
    """Return the sensors for the core, and how positions follow from their plots."""
    windowed = motion == "window" or isinstance(motion, WindowModel)
    if windowed and any(isinstance(one, Station) for one in sensors):
        raise ValueError(f"motion {motion!r} takes no azimuths alone, and sensors has a Station")
    scans = [one.scan_period for one in sensors if isinstance(one, Radar)]
    intervals = [one.update_interval for one in sensors if isinstance(one, PositionSensor)]
    each = [_core_sensor(sensor, min(scans + intervals)) for sensor in sensors]
    return [radar for radar, _ in each], [geometry for _, geometry in each]


def check_plots(plots: Plots, sensors: Sequence[Sensor]) -> None:
    """Raise an error if the plots cannot be those of the sensors, before any of them is used."""
    unknown = np.flatnonzero((plots.sensor < 0) | (plots.sensor >= len(sensors)))
    if len(unknown):
        at, count = unknown[0], len(sensors)
        raise ValueError(
            f"plots.sensor[{at}] is {plots.sensor[at]}; it must be the index of one of the {count} "
            "sensors"
        )
    placed(plots, sensors)
    if plots.velocity is None:
        return
    reporting = np.array([isinstance(one, PositionSensor) for one in sensors])
    moving = ~reporting[plots.sensor]
    wrong = np.flatnonzero(moving & np.isfinite(plots.velocity).any(axis=1))
    if len(wrong):
        at, sensor = wrong[0], plots.sensor[wrong[0]]
        raise ValueError(
            f"plots.velocity[{at}] belongs to sensors[{sensor}], which is not a PositionSensor; it "
            "must be nan, because only velocities that come with positions are used"
        )


def velocities_of(plots: Plots, sensors: Sequence[Sensor]) -> tuple[FloatArray, FloatArray]:
    """Return velocities, (N, 2), and covariances, (N, 2, 2); nan if a plot has none."""
    return reported(plots.velocity, plots.velocity_covariance, plots, sensors, "velocity")


def reported(
    values: FloatArray | None,
    covariance: FloatArray | None,
    plots: Plots,
    sensors: Sequence[Sensor],
    of: str,
) -> tuple[FloatArray, FloatArray]:
    """Return reported values with their covariances, by default those of the sensors."""
    found, spread = np.full((len(plots), 2), np.nan), np.full((len(plots), 2, 2), np.nan)
    if values is None:
        return found, spread
    stated = [getattr(one, f"{of}_sigma", None) for one in sensors]
    variance = np.array([np.nan if sigma is None else sigma**2 for sigma in stated])
    spread = variance[plots.sensor][:, np.newaxis, np.newaxis] * np.eye(2)
    if covariance is not None:
        spread = np.where(np.isnan(covariance), spread, covariance)
    known = np.isfinite(spread).all(axis=(1, 2)) & np.isfinite(values).all(axis=1)
    found[known], spread[~known] = values[known], np.nan
    return found, spread


def _core_sensor(sensor: Sensor, period: float) -> tuple[_core.Radar, _core.Geometry]:
    """Return a sensor for the core, and how positions follow from its plots."""
    if isinstance(sensor, Station):
        sigma = sensor.azimuth_sigma
        assert sigma is not None  # it was checked
        stand_in = PositionSensor(
            position_sigma=1.0, update_interval=period, detection_probability=_DETECTION_PROBABILITY
        )
        return _as_radar(stand_in), _core.Geometry.azimuth(sigma)
    if isinstance(sensor, PositionSensor):
        sigmas = (sensor.position_sigma, sensor.velocity_sigma)
        given = [np.nan if sigma is None else sigma for sigma in sigmas]
        return _as_radar(sensor), _core.Geometry.position(given)
    return core_radar(sensor), _radar_geometry(sensor)


def _radar_geometry(radar: Radar) -> _core.Geometry:
    site = radar.site
    if radar.frame is None or site is None:
        flat = len(radar.position) == 2  # east and north alone
        return _core.Geometry.flat() if flat else _core.Geometry.space()
    place = [*np.radians([site.latitude, site.longitude]).tolist(), site.height]
    return _core.Geometry.earth(place, radar.frame._frame, radar.max_range)


def _as_radar(sensor: PositionSensor) -> _core.Radar:
    """Return a position sensor as a radar, because the core counts reports by scans of a radar."""
    return _core.Radar(
        position=[0.0, 0.0, 0.0],
        range_sigma=1.0 if sensor.position_sigma is None else sensor.position_sigma,
        azimuth_sigma=1e-3,
        scan_period=sensor.update_interval,
        max_range=np.inf,
        detection_probability=sensor.detection_probability,
        extent=sensor.target_extent,
    )
