"""The sensors of a tracker, as arguments of the core."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np

from tertia import _core
from tertia._arrays import instance
from tertia.sensors import PositionSensor, Radar
from tertia.tracker._earth import plane_of
from tertia.tracker._models import core_radar

Sensor: TypeAlias = Radar | PositionSensor


def sensors_of(values: Any) -> tuple[Sensor, ...]:
    """Return the sensors of a tracker, checked; at least one, on the same earth."""
    if not isinstance(values, Sequence):
        raise TypeError(f"sensors is {values!r}; it must be a sequence of Radar or PositionSensor")
    for i, value in enumerate(values):
        instance(value, f"sensors[{i}]", Radar, PositionSensor)
    if not values:
        raise ValueError("sensors is empty; there must be at least one")
    plane_of([one for one in values if isinstance(one, Radar)])
    return tuple(values)


def radars_of(sensors: Sequence[Sensor]) -> list[Radar]:
    """Return the sensors, which must all be radars, as registration needs them."""
    found = [one for one in sensors if isinstance(one, Radar)]
    if len(found) < len(sensors):
        raise ValueError("registration is for radars alone; sensors has a PositionSensor")
    return found


def core_sensor(sensor: Sensor) -> tuple[_core.Radar, _core.Geometry]:
    """Return a sensor, and what its plots say of positions."""
    if isinstance(sensor, PositionSensor):
        sigma = np.nan if sensor.position_sigma is None else sensor.position_sigma
        return _as_radar(sensor), _core.Geometry.position(sigma)
    return core_radar(sensor), _radar_geometry(sensor)


def _radar_geometry(radar: Radar) -> _core.Geometry:
    site = radar.site
    if radar.frame is None or site is None:
        flat = len(radar.position) == 2  # east and north alone
        return _core.Geometry.flat() if flat else _core.Geometry.space()
    place = [*np.radians([site.latitude, site.longitude]).tolist(), site.height]
    return _core.Geometry.earth(place, radar.frame._frame, radar.max_range)


def _as_radar(sensor: PositionSensor) -> _core.Radar:
    """Return a sensor of positions as the core counts its reports: by intervals, everywhere."""
    return _core.Radar(
        position=[0.0, 0.0, 0.0],
        range_sigma=1.0 if sensor.position_sigma is None else sensor.position_sigma,
        azimuth_sigma=1e-3,
        scan_period=sensor.update_interval,
        max_range=np.inf,
        detection_probability=sensor.detection_probability,
    )
