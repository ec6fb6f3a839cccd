"""`tertia simulate`: files of simulated air traffic and direction finders."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import polars as pl
import typer

from tertia import simulate as simulated
from tertia._result import counted
from tertia._units import FLIGHT_LEVEL
from tertia.cli.files import write
from tertia.cli.terminal.options import option, pair
from tertia.cli.terminal.say import WRONG_USAGE, fail, working
from tertia.flightplan import FlightPlan
from tertia.fusion import common_azimuth
from tertia.geo import SystemPlane
from tertia.sensors import Radar, Station
from tertia.sensors._identities import NO_IDENTITY
from tertia.simulate import Scene, SetUpName, Traffic
from tertia.tables._groups import named
from tertia.tables._identities import identity_texts
from tertia.tables._sensors import GEODETIC, LOCAL
from tertia.tracker._earth import in_plane

EXAMPLES = (
    "tertia simulate scene",
    "tertia simulate scene --origin 50.1,14.26",
    "tertia simulate scene --set-up tma --aircraft 40 --radar-count 2 --duration 1200 --seed 7",
)
_TRUTH_STEP = 2.0


def simulate(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder for the files; it is created if missing.")
    ],
    *,
    set_up: Annotated[SetUpName, option("Airspace and kind of radar.")] = "middle",
    aircraft: Annotated[int, option("Number of aircraft.", min=1, max=3000)] = 24,
    radar_count: Annotated[int, option("Number of radars.", min=1, max=20)] = 3,
    station_count: Annotated[int, option("Number of direction finders.", min=3, max=20)] = 4,
    duration: Annotated[
        float, option("Duration of the recording in seconds.", min=60.0, max=86_400.0)
    ] = 900.0,
    clutter: Annotated[
        float, option("False plots per scan of a radar.", min=0.0, max=10_000.0)
    ] = 3.0,
    origin: Annotated[
        str | None,
        option(
            "Position of the first radar in degrees; by default the earth is flat.",
            metavar="LAT,LON",
        ),
    ] = None,
    seed: Annotated[
        int, option("Seed of the random numbers; the same seed gives the same files.", min=0)
    ] = 1,
) -> dict[str, Any]:
    """Simulate air traffic observed by radars, and emitters observed by direction finders.

    The files are inputs of the other commands: plots.csv, sensors.toml, plans.json, truth.csv;
    azimuths.csv, the plots of the aircraft as seen from the first radar, for tertia fuse-series;
    bearings.csv, for tertia locate. scene.json lists the sensors whose errors are larger than
    stated.
    """
    if folder.exists() and not folder.is_dir():
        fail(f"cannot write {folder}: it is not a folder", WRONG_USAGE)
    place = pair(origin, "--origin", float)
    with working("Simulating"):
        scene = simulated.scene(
            set_up,
            aircraft_count=aircraft,
            radar_count=radar_count,
            station_count=station_count,
            duration=duration,
            clutter=clutter,
            frame=None if place is None else SystemPlane(*place),
            rng=seed,
        )
        tables = {
            "plots.csv": _plots(scene),
            "truth.csv": _truth(scene.traffic, duration),
            "azimuths.csv": _azimuths(scene),
            "bearings.csv": _bearings(scene),
        }
    record, flights = scene.record, zip(scene.traffic.plans, scene.traffic.left, strict=True)
    summary: dict[str, Any] = {
        "set_up": set_up,
        "seed": seed,
        "duration_s": duration,
        "aircraft_count": aircraft,
        "plot_count": len(record),
        "clutter_count": int(np.sum(record.target < 0)),
        "outlier_count": int(np.sum(record.outlier)),
        "duplicate_count": int(np.sum(record.duplicate)),
        "left_plan_s": {
            str(plan.name): round(float(time), 1) for plan, time in flights if time <= duration
        },
        "radars": scene.radar_faults,
        "emitters_m": scene.emitters,
        "stations": scene.station_faults,
    }
    write.make_folder(folder)
    for name, table in tables.items():
        write.write(table, folder / name)
    write.write_text(_sensors(scene), folder / "sensors.toml")
    write.write_text(_plans(scene.traffic.plans), folder / "plans.json")
    write.write_json(summary, folder / "scene.json")
    typer.echo(
        f"{aircraft} aircraft with flight plans, {len(summary['left_plan_s'])} of them deviated; "
        f"{counted(radar_count, 'radar')}, {counted(len(record), 'plot')}, of which "
        f"{summary['clutter_count']} are false and {summary['outlier_count']} are outliers"
    )
    for name, fault in (*scene.radar_faults.items(), *scene.station_faults.items()):
        listed = ", ".join(f"{key} {value:g}" for key, value in fault.items())
        typer.echo(f"  {name} has larger errors than stated: {listed}")
    return summary


def _plots(scene: Scene) -> pl.DataFrame:
    plots = scene.record.plots
    level = pl.Series(plots.height / FLIGHT_LEVEL).round().fill_nan(None)
    return pl.DataFrame(
        {
            "time_s": pl.Series(plots.time).round(3),
            "sensor": named(plots.sensor, [str(radar.name) for radar in scene.radars]),
            "range_m": pl.Series(plots.range).round(1),
            "azimuth_deg": pl.Series(np.degrees(plots.azimuth)).round(4),
            "flight_level": level.cast(pl.Int64),
            "mode_3a": identity_texts(plots.identity, "mode_3a"),
        }
    )


def _azimuths(scene: Scene) -> pl.DataFrame:
    """Return the azimuths of the aircraft as seen from the first radar."""
    record, parts = scene.record, []
    known = (record.target >= 0) & ~record.duplicate & ~np.isnan(record.plots.height)
    names = [str(plan.name) for plan in scene.traffic.plans]
    for k, radar in enumerate(scene.radars):
        own = record[known & (record.plots.sensor == k)]
        plots = in_plane(own.plots, scene.radars)
        # convert the slant range to a horizontal range
        rise = plots.height - radar.position[2]
        polar, covariance = common_azimuth(
            np.sqrt(np.maximum(plots.range**2 - rise**2, 1.0)),
            plots.azimuth,
            radar.position[:2],
            range_sigma=radar.range_sigma,
            azimuth_sigma=radar.azimuth_sigma,
            origin=scene.radars[0].position[:2],
        )
        parts.append(
            pl.DataFrame(
                {
                    "time_s": pl.Series(plots.time).round(3),
                    "sensor": [str(radar.name)] * len(own),
                    "target": named(own.target, names),
                    "azimuth_deg": np.degrees(polar[:, 0]).round(4),
                    "azimuth_sigma_deg": np.degrees(np.sqrt(covariance[:, 0, 0])).round(5),
                }
            )
        )
    return pl.concat(parts).sort("time_s", maintain_order=True)


def _truth(traffic: Traffic, duration: float) -> pl.DataFrame:
    """Return the positions of each flight while it is in the air, with height and code."""
    codes = identity_texts(traffic.identity, "mode_3a")
    times = np.arange(0.0, duration + _TRUTH_STEP / 2, _TRUTH_STEP)
    parts = []
    for k, plan in enumerate(traffic.plans):
        place = traffic.at(k, times)[0]
        there = np.isfinite(place[:, 0])
        samples = traffic.start[k] + traffic.step * np.arange(traffic.height.shape[1])
        parts.append(
            pl.DataFrame(
                {
                    "time_s": times[there],
                    "target": [str(plan.name)] * int(there.sum()),
                    "east_m": place[there, 0].round(1),
                    "north_m": place[there, 1].round(1),
                    "height_m": np.interp(times[there], samples, traffic.height[k]).round(1),
                    "mode_3a": codes[k],
                }
            )
        )
    return pl.concat(parts)


def _bearings(scene: Scene) -> pl.DataFrame:
    return pl.concat(
        pl.DataFrame(
            {
                "time_s": np.arange(float(len(heard))),
                "sensor": [str(station.name)] * len(heard),
                "target": [target] * len(heard),
                "azimuth_deg": heard.round(2),
            }
        )
        for target, bearings in zip(scene.emitters, scene.bearings, strict=True)
        for station, heard in zip(scene.stations, bearings, strict=True)
    )


def _sensors(scene: Scene) -> str:
    """Return the sensors file."""
    # texts and numbers are written as in JSON
    blocks = ["# simulated; positions in metres, standard deviations of single measurements"]
    for radar in scene.radars:
        blocks.append(
            _toml(
                "radar",
                radar,
                range_sigma_m=round(radar.range_sigma, 3),
                azimuth_sigma_deg=_degrees(radar.azimuth_sigma),
                scan_period_s=radar.scan_period,
                max_range_m=radar.max_range,
                detection_probability=radar.detection_probability,
            )
        )
    for one in scene.stations:
        blocks.append(_toml("station", one, azimuth_sigma_deg=_degrees(one.azimuth_sigma or 0.0)))
    return "\n\n".join(blocks) + "\n"


def _degrees(angle: float) -> float:
    return round(float(np.degrees(angle)), 6)


def _toml(noun: str, sensor: Radar | Station, **numbers: float) -> str:
    site = sensor.site if isinstance(sensor, Radar) else None
    if site is None:
        place = dict(zip(LOCAL, sensor.position.tolist(), strict=False))
    else:
        values = (round(site.latitude, 9), round(site.longitude, 9), round(site.height, 3))
        place = dict(zip(GEODETIC, values, strict=True))
    cells = {"name": sensor.name, **place, **numbers}
    lines = [f"{name} = {json.dumps(value)}" for name, value in cells.items()]
    return "\n".join([f"[[{noun}]]", *lines])


def _plans(plans: Sequence[FlightPlan]) -> str:
    """Return plans as JSON, with their identities as codes, as in the plots."""
    identities = [NO_IDENTITY if plan.identity is None else plan.identity for plan in plans]
    codes = identity_texts(np.array(identities, dtype=np.int64), "mode_3a")
    listed = [
        {
            "name": plan.name,
            "mode_3a": code,
            "start_time_s": plan.start_time,
            "waypoints": plan.waypoints.tolist(),
            "speeds_m_s": plan.speeds.tolist(),
            "heights_m": [] if plan.heights is None else plan.heights.round(1).tolist(),
        }
        for plan, code in zip(plans, codes, strict=True)
    ]
    return "[\n" + ",\n".join(json.dumps(plan) for plan in listed) + "\n]\n"
