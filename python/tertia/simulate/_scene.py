"""A complete scene: flights with plans, radars and direction finders, some of them faulty."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tertia._arrays import FloatArray, generator, integer, positive, real
from tertia.flightplan import FlightPlan
from tertia.geo import SystemPlane
from tertia.sensors import Bias, Radar, Station
from tertia.simulate._bearings import direction_finder
from tertia.simulate._flights import flights
from tertia.simulate._parameters import _require
from tertia.simulate._radar_plots import RadarPlots, radar_plots
from tertia.simulate._routes import FlightScenario
from tertia.simulate._set_ups import SetUp, SetUpName, routes, set_up
from tertia.simulate._traffic import Traffic
from tertia.tracker import Plots

__all__ = ["Scene", "scene"]

# every fifth aircraft leaves its plan, in one of these ways
_LEAVING: tuple[FlightScenario, ...] = ("straight-on", "hijack", "vectoring", "shortcut")
_EVERY = 5
_FIRST_CODE, _CODES, _FIRST_FLIGHT = 0o1001, 3000, 101
# aircraft start within this share of the time, or until so many seconds before its end
_STARTS, _LAST_START = 0.4, 600.0
# of the farthest route: how far the other radars are from the first
_RING = 0.35
# periods and noise of the radars, in those of the set-up; then they repeat
_PACES, _NOISES = (1.0, 1.25, 1.5), (1.0, 1.2, 1.4)
_UP = 50.0
_IMPERFECT = {
    "outlier_probability": 0.02,
    "duplicate_probability": 0.01,
    "height_missing_probability": 0.02,
    "identity_missing_probability": 0.03,
    "identity_garbled_probability": 0.002,
}
# what is wrong with the last of several radars: metres; times its azimuth noise after half the time
_BIAS, _WORSE = 150.0, 2.5
# direction finders about the emitters: metres, degrees, bearings a second apart
_STATION_RING, _STATION_SIGMA, _BEARINGS = 20e3, 2.0, 100
_EMITTERS = {"beacon": (6e3, 4e3), "ship": (-5e3, 9e3)}
_WORSE_STATION = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A simulated scene: the stated properties of the sensors, their measurements, and the truth.

    Attributes
    ----------
    radars : list of Radar
        The radars as stated.
    traffic : Traffic
        The aircraft and their plans.
    record : RadarPlots
        The plots of the radars.
    stations : list of Station
        The direction finders as stated.
    emitters : mapping of str to (float, float)
        East and north of the emitters in metres, by name.
    bearings : ndarray of shape (E, K, N)
        Bearings of each emitter by each direction finder in degrees, one per second.
    radar_faults, station_faults : mapping of str to mapping
        Properties that are worse than stated, by the name of the sensor. Radars have a
        `range_bias_m`, and the sigma `azimuth_sigma_deg` from the time `azimuth_sigma_since_s` on.
        Direction finders have the sigma `sigma_deg`.
    """

    radars: list[Radar]
    traffic: Traffic
    record: RadarPlots
    stations: list[Station]
    emitters: Mapping[str, tuple[float, float]]
    bearings: FloatArray
    radar_faults: Mapping[str, Mapping[str, float]]
    station_faults: Mapping[str, Mapping[str, float]]


def scene(
    name: SetUpName = "middle",
    *,
    aircraft_count: int = 24,
    radar_count: int = 3,
    station_count: int = 4,
    duration: float = 900.0,
    clutter: float = 3.0,
    frame: SystemPlane | None = None,
    rng: np.random.Generator | int | None = None,
) -> Scene:
    """Simulate air traffic that radars detect, and emitters that direction finders locate.

    Every fifth aircraft leaves its plan. If there are several radars, the ranges of the last one
    are 150 m too long, and its azimuths are 2.5 times as noisy as stated in the second half of the
    recording. The errors of the last direction finder are twice as large as stated.

    Parameters
    ----------
    name : str
        Airspace and kind of radar, as for `set_up`.
    aircraft_count, radar_count, station_count : int
        Numbers of aircraft (at most 3000), radars and direction finders (at least one).
    duration : float
        Duration of the recording in seconds.
    clutter : float
        Mean number of false plots per scan of a radar.
    frame : SystemPlane, optional
        System plane in which the positions of the aircraft are given; the radars are on the
        ellipsoid. By default the earth is flat.
    rng : numpy.random.Generator or int, optional
        Random generator or its seed.

    Returns
    -------
    Scene
        The stated properties of the sensors, their measurements, and the truth.

    Raises
    ------
    ValueError
        If the set-up is unknown, or a number is outside its domain.
    TypeError
        If a parameter has the wrong type.

    Examples
    --------
    >>> from tertia.simulate import scene
    >>> found = scene("tma", aircraft_count=5, radar_count=2, duration=120.0, rng=1)
    >>> found.bearings.shape, found.radar_faults["radar-2"]["range_bias_m"]
    ((2, 4, 100), 150.0)
    """
    count = integer(aircraft_count, "aircraft_count", 1)
    _require(count <= _CODES, "aircraft_count", count, f"not above {_CODES}")
    seconds = float(positive(real(duration, "duration"), "duration"))
    random, air = generator(rng), set_up(name)
    radars = _radars(air, integer(radar_count, "radar_count", 1), frame)
    stations = _stations(integer(station_count, "station_count", 1))
    plans = _plans(name, count, seconds, random)
    scenarios: list[FlightScenario] = [
        _LEAVING[k // _EVERY % len(_LEAVING)] if k % _EVERY == _EVERY - 1 else "conforming"
        for k in range(count)
    ]
    traffic = flights(plans, scenario=scenarios, wind=air.wind, rng=random)
    record, faults = _record(traffic, radars, clutter, seconds, random)
    worse = {str(stations[-1].name): {"sigma_deg": _WORSE_STATION * _STATION_SIGMA}}
    bearings = _bearings(stations, random)
    return Scene(radars, traffic, record, stations, dict(_EMITTERS), bearings, faults, worse)


def _radars(air: SetUp, count: int, frame: SystemPlane | None) -> list[Radar]:
    """Return the radars as stated; the first one is at the origin, and the others are around it."""
    first, found = air.radar, []
    for k in range(count):
        angle = 2 * np.pi * (k - 1) / max(count - 1, 1)
        distance = 0.0 if k == 0 else _RING * air.distance[1]
        noise = _NOISES[k % len(_NOISES)]
        found.append(
            replace(
                first,
                position=np.round([distance * np.sin(angle), distance * np.cos(angle), _UP]),
                range_sigma=noise * first.range_sigma,
                azimuth_sigma=np.radians(noise * np.degrees(first.azimuth_sigma)).item(),
                scan_period=_PACES[k % len(_PACES)] * first.scan_period,
                name=f"radar-{k + 1}",
                frame=frame,
            )
        )
    return found


def _plans(
    name: SetUpName, count: int, duration: float, random: np.random.Generator
) -> list[FlightPlan]:
    last = max(_STARTS * duration, duration - _LAST_START)
    starts = np.round(np.sort(random.uniform(0.0, last, count)))
    return [
        FlightPlan(
            np.round(plan.waypoints),
            np.round(plan.speeds),
            start_time=start,
            heights=plan.heights,
            identity=_FIRST_CODE + number,
            name=f"TRT{_FIRST_FLIGHT + number}",
        )
        for number, (plan, start) in enumerate(
            zip(routes(name, count, rng=random), starts, strict=True)
        )
    ]


def _record(
    traffic: Traffic,
    radars: list[Radar],
    clutter: float,
    duration: float,
    random: np.random.Generator,
) -> tuple[RadarPlots, dict[str, dict[str, float]]]:
    """Return the plots, and the faults of the last radar."""
    real, bias = list(radars), np.zeros(len(radars))
    faults = {}
    if len(radars) > 1:
        last, bias[-1] = radars[-1], _BIAS
        real[-1] = replace(last, azimuth_sigma=_WORSE * last.azimuth_sigma)
        faults[str(last.name)] = {
            "range_bias_m": _BIAS,
            "azimuth_sigma_deg": round(float(np.degrees(real[-1].azimuth_sigma)), 6),
            "azimuth_sigma_since_s": duration / 2,
        }
    phase = random.uniform(size=len(radars)) * [radar.scan_period for radar in radars]
    halves = []
    for late, used in enumerate((radars, real)):
        record = radar_plots(
            traffic,
            used,
            clutter=clutter,
            phase=phase,
            bias=Bias(range=bias),
            rng=random,
            **_IMPERFECT,
        )
        time = record.plots.time
        halves.append(record[((time > duration / 2) == bool(late)) & (time <= duration)])

    def joined(holders: list[Any], column: str) -> Any:
        return np.concatenate([getattr(one, column) for one in holders])

    parts = [half.plots for half in halves]
    plots = Plots(
        joined(parts, "time"),
        joined(parts, "range"),
        joined(parts, "azimuth"),
        sensor=joined(parts, "sensor"),
        height=joined(parts, "height"),
        identity=joined(parts, "identity"),
    )
    target, outlier = joined(halves, "target"), joined(halves, "outlier")
    return RadarPlots(plots, target, outlier, joined(halves, "duplicate"), phase), faults


def _stations(count: int) -> list[Station]:
    angles = 2 * np.pi * np.arange(count) / count
    places = np.round(_STATION_RING * np.column_stack([np.sin(angles), np.cos(angles)]))
    sigma = np.radians(_STATION_SIGMA).item()
    return [
        Station(place, name=f"finder-{k + 1}", azimuth_sigma=sigma)
        for k, place in enumerate(places)
    ]


def _bearings(stations: list[Station], random: np.random.Generator) -> FloatArray:
    """Return the bearings of each emitter by each direction finder, (E, K, N), in degrees."""
    sigmas = [_STATION_SIGMA] * (len(stations) - 1) + [_STATION_SIGMA * _WORSE_STATION]
    heard = []
    for emitter in _EMITTERS.values():
        for station, sigma in zip(stations, sigmas, strict=True):
            bearing = np.degrees(np.arctan2(*(emitter - station.position))) % 360.0
            heard.append(
                direction_finder(_BEARINGS, bearing=float(bearing), sigma=sigma, rng=random).theta
            )
    return np.reshape(heard, (len(_EMITTERS), len(stations), _BEARINGS))
