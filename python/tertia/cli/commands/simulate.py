"""`tertia simulate`: files of simulated air traffic and direction finders."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import polars as pl
import typer

from tertia import simulate as simulated
from tertia._units import FLIGHT_LEVEL
from tertia.cli.files import write
from tertia.cli.terminal.say import WRONG_USAGE, counted, fail, working
from tertia.flightplan import FlightPlan
from tertia.fusion import common_azimuth
from tertia.sensors import Radar, Station
from tertia.simulate import FlightScenario, RadarPlots, SetUp, SetUpName, Traffic
from tertia.tracker import NO_IDENTITY

EXAMPLES = (
    "tertia simulate scene",
    "tertia simulate scene --set-up tma --aircraft 40 --radar-count 2 --duration 1200 --seed 7",
)
# every fifth aircraft leaves its plan, in one of these ways
_LEAVING: tuple[FlightScenario, ...] = ("straight-on", "hijack", "vectoring", "shortcut")
_EVERY = 5
_FIRST_CODE, _CODES, _FIRST_FLIGHT = 0o1001, 3000, 101
_TRUTH_STEP = 2.0
# aircraft start within this share of the time, or until so many seconds before its end
_STARTS, _LAST_START = 0.4, 600.0
# of the farthest route: how far the other radars are from the first
_RING = 0.35
# periods and noise of the radars, in those of the set-up; then they repeat
_PACES, _NOISES = (1.0, 1.25, 1.5), (1.0, 1.2, 1.4)
_UP = 50.0
_OUTLIERS, _DUPLICATES, _NO_HEIGHT, _NO_IDENTITY, _GARBLED = 0.02, 0.01, 0.02, 0.03, 0.002
# what is wrong with the last of several radars: metres; times its azimuth noise after half the time
_BIAS, _WORSE = 150.0, 2.5
# direction finders about the emitters: metres, degrees, bearings a second apart
_STATION_RING, _STATION_SIGMA, _BEARINGS = 20e3, 2.0, 100
_EMITTERS = {"beacon": (6e3, 4e3), "ship": (-5e3, 9e3)}
_WORSE_STATION = 2.0


def simulate(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder for the files; it is made if missing.")
    ],
    *,
    set_up: Annotated[SetUpName, typer.Option(help="Airspace and kind of radar.")] = "middle",
    aircraft: Annotated[int, typer.Option(min=1, max=_CODES, help="Number of aircraft.")] = 24,
    radar_count: Annotated[int, typer.Option(min=1, max=20, help="Number of radars.")] = 3,
    station_count: Annotated[
        int, typer.Option(min=3, max=20, help="Number of direction finders.")
    ] = 4,
    duration: Annotated[
        float, typer.Option(min=60.0, max=86_400.0, help="Seconds that the radars record.")
    ] = 900.0,
    clutter: Annotated[
        float, typer.Option(min=0.0, max=10_000.0, help="False plots per scan of a radar.")
    ] = 3.0,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same files.")] = 1,
) -> dict[str, Any]:
    """Simulate air traffic observed by radars, and emitters observed by direction finders.

    The files are inputs of the other commands: plots.csv, sensors.toml, plans.json, truth.csv;
    azimuths.csv, the plots of the aircraft as seen from the first radar, for tertia fuse-series;
    bearings.csv, for tertia locate. scene.json lists the sensors whose errors are larger than
    stated.
    """
    if folder.exists() and not folder.is_dir():
        fail(f"cannot write {folder}: it is no folder", WRONG_USAGE)
    random = np.random.default_rng(seed)
    with working("Simulating"):
        scene = simulated.set_up(set_up)
        stated, finder = _radars(scene, radar_count), _stations(station_count)
        plans = _plans(set_up, aircraft, duration, random)
        traffic = simulated.flights(
            plans, scenario=_scenarios(aircraft), wind=scene.wind, rng=random
        )
        seen, faults = _seen(traffic, stated, clutter, duration, random)
        tables = {
            "plots.csv": _plot_rows(seen, stated),
            "truth.csv": _truth(traffic, duration),
            "azimuths.csv": _azimuth_rows(seen, stated, plans),
            "bearings.csv": _bearings(finder, random),
        }
    worse = {str(finder[-1].name): {"sigma_deg": _WORSE_STATION * _STATION_SIGMA}}
    left = _left(traffic, duration)
    summary: dict[str, Any] = {
        "set_up": set_up,
        "seed": seed,
        "duration_s": duration,
        "aircraft_count": aircraft,
        "plot_count": seen.height,
        "clutter_count": int((seen["target"] < 0).sum()),
        "outlier_count": int(seen["outlier"].sum()),
        "duplicate_count": int(seen["duplicate"].sum()),
        "left_plan_s": left,
        "radars": faults,
        "emitters_m": {name: list(place) for name, place in _EMITTERS.items()},
        "stations": worse,
    }
    write.make_folder(folder)
    for name, table in tables.items():
        write.write(table, folder / name)
    for name, text in (
        ("sensors.toml", _sensors(stated, finder)),
        ("plans.json", _plan_list(plans)),
    ):
        write.write_text(text, folder / name)
    write.write_json(summary, folder / "scene.json")
    radars, plots = counted(radar_count, "radar"), counted(seen.height, "plot")
    typer.echo(
        f"{aircraft} aircraft on plans, {len(left)} of them left theirs; {radars}, {plots}, of "
        f"which {summary['clutter_count']} are false and {summary['outlier_count']} outliers"
    )
    for name, fault in (faults | worse).items():
        listed = ", ".join(f"{key} {value:g}" for key, value in fault.items())
        typer.echo(f"  {name} errs more than it states: {listed}")
    return summary


def _radars(scene: SetUp, count: int) -> list[Radar]:
    """Return the radars with their stated accuracy; the first is at the origin."""
    first, found = scene.radar, []
    for k in range(count):
        angle = 2 * np.pi * (k - 1) / max(count - 1, 1)
        distance = 0.0 if k == 0 else _RING * scene.distance[1]
        pace, noise = _PACES[k % len(_PACES)], _NOISES[k % len(_NOISES)]
        found.append(
            Radar(
                np.round([distance * np.sin(angle), distance * np.cos(angle), _UP]),
                range_sigma=noise * first.range_sigma,
                azimuth_sigma=np.radians(noise * np.degrees(first.azimuth_sigma)).item(),
                scan_period=pace * first.scan_period,
                max_range=first.max_range,
                detection_probability=first.detection_probability,
                name=f"radar-{k + 1}",
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
            zip(simulated.routes(name, count, rng=random), starts, strict=True)
        )
    ]


def _scenarios(count: int) -> list[FlightScenario]:
    return [
        _LEAVING[k // _EVERY % len(_LEAVING)] if k % _EVERY == _EVERY - 1 else "conforming"
        for k in range(count)
    ]


def _seen(
    traffic: Traffic,
    radars: Sequence[Radar],
    clutter: float,
    duration: float,
    random: np.random.Generator,
) -> tuple[pl.DataFrame, dict[str, Any]]:
    """Return the plots with their sources, and with the errors of the last radar."""
    real, bias = list(radars), np.zeros((len(radars), 2))
    faults: dict[str, Any] = {}
    if len(radars) > 1:
        last = radars[-1]
        bias[-1, 0] = _BIAS
        worse = _WORSE * last.azimuth_sigma
        real[-1] = Radar(
            last.position,
            range_sigma=last.range_sigma,
            azimuth_sigma=worse,
            scan_period=last.scan_period,
            max_range=last.max_range,
            detection_probability=last.detection_probability,
            name=last.name,
        )
        faults[str(last.name)] = {
            "range_bias_m": _BIAS,
            "azimuth_sigma_deg": round(float(np.degrees(worse)), 6),
            "since_s": duration / 2,
        }
    phase = random.uniform(size=len(radars)) * [radar.scan_period for radar in radars]
    halves = []
    for number, stations in enumerate((radars, real)):
        record = simulated.radar_plots(
            traffic,
            stations,
            clutter=clutter,
            phase=phase,
            bias=bias,
            outlier_probability=_OUTLIERS,
            duplicate_probability=_DUPLICATES,
            height_missing_probability=_NO_HEIGHT,
            identity_missing_probability=_NO_IDENTITY,
            identity_garbled_probability=_GARBLED,
            rng=random,
        )
        half = (record.plots.time > duration / 2) == bool(number)
        halves.append(_frame(record[half & (record.plots.time <= duration)]))
    return pl.concat(halves), faults


def _frame(record: RadarPlots) -> pl.DataFrame:
    plots = record.plots
    return pl.DataFrame(
        {
            **{name: getattr(plots, name) for name in plots.__slots__},
            **{name: getattr(record, name) for name in ("target", "outlier", "duplicate")},
        }
    )


def _plot_rows(seen: pl.DataFrame, radars: Sequence[Radar]) -> pl.DataFrame:
    """Return the plots with the columns of files."""
    code = seen["identity"].to_list()
    level = (seen["height"] / FLIGHT_LEVEL).round().fill_nan(None)
    return pl.DataFrame(
        {
            "time_s": seen["time"].round(3),
            "sensor": [str(radars[k].name) for k in seen["sensor"]],
            "range_m": seen["range"].round(1),
            "azimuth_deg": pl.Series(np.degrees(seen["azimuth"].to_numpy())).round(4),
            "flight_level": level.cast(pl.Int64),
            "mode_3a": [None if one == NO_IDENTITY else f"{one:04o}" for one in code],
        }
    )


def _azimuth_rows(
    seen: pl.DataFrame, radars: Sequence[Radar], plans: Sequence[FlightPlan]
) -> pl.DataFrame:
    """Return the azimuths of the aircraft as seen from the first radar."""
    known = seen.filter(
        (pl.col("target") >= 0) & ~pl.col("duplicate"), pl.col("height").is_not_nan()
    )
    parts = []
    for k, radar in enumerate(radars):
        own = known.filter(pl.col("sensor") == k)
        # along the ground
        rise = own["height"].to_numpy() - radar.position[2]
        distance = np.sqrt(np.maximum(own["range"].to_numpy() ** 2 - rise**2, 1.0))
        polar, covariance = common_azimuth(
            distance,
            own["azimuth"].to_numpy(),
            radar.position[:2],
            range_sigma=radar.range_sigma,
            azimuth_sigma=radar.azimuth_sigma,
            origin=radars[0].position[:2],
        )
        parts.append(
            pl.DataFrame(
                {
                    "time_s": own["time"].round(3),
                    "sensor": [str(radar.name)] * own.height,
                    "target": [str(plans[i].name) for i in own["target"]],
                    "azimuth_deg": np.degrees(polar[:, 0]).round(4),
                    "azimuth_sigma_deg": np.degrees(np.sqrt(covariance[:, 0, 0])).round(5),
                }
            )
        )
    return pl.concat(parts).sort("time_s", maintain_order=True)


def _truth(traffic: Traffic, duration: float) -> pl.DataFrame:
    """Return the positions of each flight while it is in the air."""
    times = np.arange(0.0, duration + _TRUTH_STEP / 2, _TRUTH_STEP)
    parts = []
    for k, plan in enumerate(traffic.plans):
        place = traffic.at(k, times)[0]
        there = np.isfinite(place[:, 0])
        parts.append(
            pl.DataFrame(
                {
                    "time_s": times[there],
                    "target": [str(plan.name)] * int(there.sum()),
                    "east_m": place[there, 0].round(1),
                    "north_m": place[there, 1].round(1),
                }
            )
        )
    return pl.concat(parts)


def _left(traffic: Traffic, duration: float) -> dict[str, float]:
    """Return the flights that left their plans, and when."""
    return {
        str(plan.name): round(float(time), 1)
        for plan, time in zip(traffic.plans, traffic.left, strict=True)
        if time <= duration
    }


def _stations(count: int) -> list[Station]:
    angles = 2 * np.pi * np.arange(count) / count
    places = np.round(_STATION_RING * np.column_stack([np.sin(angles), np.cos(angles)]))
    sigma = np.radians(_STATION_SIGMA).item()
    return [
        Station(place, name=f"finder-{k + 1}", azimuth_sigma=sigma)
        for k, place in enumerate(places)
    ]


def _bearings(stations: Sequence[Station], random: np.random.Generator) -> pl.DataFrame:
    """Return the bearings of each emitter from each finder, one per second."""
    parts = []
    for target, emitter in _EMITTERS.items():
        for k, station in enumerate(stations):
            last = k == len(stations) - 1
            east, north = np.asarray(emitter) - station.position
            record = simulated.direction_finder(
                _BEARINGS,
                bearing=float(np.degrees(np.arctan2(east, north)) % 360.0),
                sigma=_STATION_SIGMA * (_WORSE_STATION if last else 1.0),
                rng=random,
            )
            parts.append(
                pl.DataFrame(
                    {
                        "time_s": np.arange(float(_BEARINGS)),
                        "sensor": [str(station.name)] * _BEARINGS,
                        "target": [target] * _BEARINGS,
                        "azimuth_deg": record.theta.round(2),
                    }
                )
            )
    return pl.concat(parts)


def _sensors(radars: Sequence[Radar], stations: Sequence[Station]) -> str:
    """Return the sensors file."""
    # texts and numbers are written as in JSON
    blocks = ["# simulated; positions in metres, standard deviations of single measurements"]
    for radar in radars:
        blocks.append(
            _toml(
                "radar",
                radar,
                range_sigma_m=round(radar.range_sigma, 3),
                azimuth_sigma_deg=round(float(np.degrees(radar.azimuth_sigma)), 6),
                scan_period_s=radar.scan_period,
                max_range_m=radar.max_range,
                detection_probability=radar.detection_probability,
            )
        )
    blocks += [_toml("station", one, azimuth_sigma_deg=_STATION_SIGMA) for one in stations]
    return "\n\n".join(blocks) + "\n"


def _toml(noun: str, sensor: Radar | Station, **numbers: float) -> str:
    place = dict(zip(("east_m", "north_m", "up_m"), sensor.position.tolist(), strict=False))
    cells = {"name": sensor.name, **place, **numbers}
    lines = [f"{name} = {json.dumps(value)}" for name, value in cells.items()]
    return "\n".join([f"[[{noun}]]", *lines])


def _plan_list(plans: Sequence[FlightPlan]) -> str:
    listed = [
        {
            "name": plan.name,
            "identity": plan.identity,
            "start_time_s": plan.start_time,
            "waypoints": plan.waypoints.tolist(),
            "speeds_m_s": plan.speeds.tolist(),
            "heights_m": [] if plan.heights is None else plan.heights.round(1).tolist(),
        }
        for plan in plans
    ]
    return "[\n" + ",\n".join(json.dumps(plan) for plan in listed) + "\n]\n"
