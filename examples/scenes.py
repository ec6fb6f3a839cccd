"""Files as ten users have them, on WGS 84: `python examples/scenes.py bearings` writes one scene.

Each scene is a folder of its name with what was measured and `truth.csv`. Geometry is by pyproj,
not by Tertia.
"""

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import polars as pl
from pyproj import Geod, Transformer

Floats: TypeAlias = npt.NDArray[np.float64]
Rng: TypeAlias = np.random.Generator
Row: TypeAlias = dict[str, Any]
Faults: TypeAlias = Mapping[str, Mapping[str, float]]
# latitudes and longitudes, heights, and their times
Flight: TypeAlias = tuple[Floats, Floats, Floats]

EARTH = Geod(ellps="WGS84")
GEOCENTRIC = Transformer.from_crs(4979, 4978)
START = np.datetime64("2026-11-22T12:00:00", "ms")


def dates(seconds: Floats) -> list[str]:
    """Return seconds after noon as text, as recorders write it."""
    return [f"{START + np.timedelta64(round(1e3 * one), 'ms')}Z" for one in seconds]


def path(
    latitude: float,
    longitude: float,
    course: float,
    speed: float,
    seconds: Floats,
    *,
    turn: float = 0.0,
) -> Floats:
    """Return the way from a place with a course that changes by `turn` degrees per second."""
    steps, places = np.diff(seconds, prepend=0.0), []
    for step in steps:
        longitude, latitude, _ = EARTH.fwd(longitude, latitude, course, speed * step)
        course += turn * step
        places.append((latitude, longitude))
    return np.array(places)


def distances(
    latitude: float, longitude: float, height: float, places: Floats, heights: Floats | float
) -> Floats:
    """Return the distances from a point on the earth to places."""
    own = GEOCENTRIC.transform(latitude, longitude, height)
    up = np.broadcast_to(heights, len(places))
    there = GEOCENTRIC.transform(places[:, 0], places[:, 1], up)
    found: Floats = np.linalg.norm(np.stack(there, axis=-1) - own, axis=-1)
    return found


def azimuths(latitude: float, longitude: float, places: Floats) -> Floats:
    """Return true azimuths from a point on the earth to places."""
    count = len(places)
    found, _, _ = EARTH.inv([longitude] * count, [latitude] * count, places[:, 1], places[:, 0])
    return np.asarray(found)


def toml(folder: Path, kind: str, rows: Sequence[Row]) -> None:
    """Write a file of sensors."""
    cells = (
        "\n".join(f"{key} = {value!r}".replace("'", '"') for key, value in row.items())
        for row in rows
    )
    text = "\n\n".join(f"[[{kind}]]\n{one}" for one in cells) + "\n"
    (folder / "sensors.toml").write_text(text, encoding="utf-8")


def site(name: str, latitude: float, longitude: float, **more: float) -> Row:
    """Return the row of a sensor."""
    return {"name": name, "latitude_deg": latitude, "longitude_deg": longitude, **more}


def measured(azimuth: Floats, sigma: float, share: float, rng: Rng) -> Floats:
    """Return azimuths with errors; a share of them is wrong."""
    angle = azimuth + rng.normal(0, sigma, len(azimuth))
    wrong = rng.random(len(angle)) < share
    angle[wrong] = rng.uniform(0, 360, wrong.sum())
    return angle % 360


def bearings(folder: Path, rng: Rng) -> None:
    """Write an hour of bearings of one emitter; a fifth are wrong, the stations not synchronous."""
    stations = [
        site("hill", 49.20, 16.55, azimuth_sigma_deg=3.0),
        site("tower", 49.23, 16.68, azimuth_sigma_deg=3.0),
        site("roof", 49.14, 16.62, azimuth_sigma_deg=3.0),
        site("van", 49.17, 16.70, azimuth_sigma_deg=3.0),
    ]
    toml(folder, "station", stations)
    emitter, parts = np.array([[49.186, 16.612]]), []
    for one in stations:
        time = np.sort(rng.uniform(0, 3600, 300))
        angle = azimuths(one["latitude_deg"], one["longitude_deg"], emitter)
        angle = measured(np.repeat(angle, 300), 3.0, 0.2, rng)
        columns = {"time_s": dates(time), "sensor": one["name"], "azimuth_deg": angle}
        parts.append(pl.DataFrame(columns))
    pl.concat(parts).sort("time_s").write_csv(folder / "bearings.csv", float_precision=1)
    truth = {"latitude_deg": emitter[:, 0], "longitude_deg": emitter[:, 1]}
    pl.DataFrame(truth).write_csv(folder / "truth.csv")


def telemetry(folder: Path, rng: Rng) -> None:
    """Write bearings of an animal from three towers over an afternoon, a few minutes apart."""
    towers = [
        site("east", 46.512, 7.560, azimuth_sigma_deg=4.0),
        site("north", 46.530, 7.535, azimuth_sigma_deg=4.0),
        site("south", 46.495, 7.530, azimuth_sigma_deg=4.0),
    ]
    toml(folder, "station", towers)
    time = np.arange(0.0, 4 * 3600.0, 120.0)
    way = path(46.505, 7.538, 20.0, 0.05, time, turn=0.003)
    parts = []
    for k, one in enumerate(towers):
        # one after the other, within half a minute
        angle = measured(azimuths(one["latitude_deg"], one["longitude_deg"], way), 4.0, 0.08, rng)
        heard = time + 10.0 * k + rng.uniform(-3, 3, len(time))
        columns = {"time_s": dates(heard), "sensor": one["name"], "azimuth_deg": angle}
        parts.append(pl.DataFrame(columns))
    pl.concat(parts).sort("time_s").write_csv(folder / "bearings.csv", float_precision=1)
    truth = {"time_s": dates(time + 10.0), "latitude_deg": way[:, 0], "longitude_deg": way[:, 1]}
    pl.DataFrame(truth).write_csv(folder / "truth.csv")


def arrivals(folder: Path, rng: Rng) -> None:
    """Write times of arrival of a beacon at six receivers, one of which has a clock 2 µs late."""
    places = [(50.00, 14.30), (50.20, 14.35), (50.15, 14.70), (49.95, 14.60), (50.08, 14.15)]
    places.append((49.88, 14.40))
    receivers = [
        site(f"rx{k}", *place, height_m=300.0, arrival_time_sigma_s=5e-8)
        for k, place in enumerate(places)
    ]
    toml(folder, "station", receivers)
    time = np.arange(0.0, 60.0, 2.0)
    way, height = path(50.05, 14.25, 70.0, 200.0, time), 6000.0
    rows = []
    for k, one in enumerate(receivers):
        far = distances(one["latitude_deg"], one["longitude_deg"], 300.0, way, height)
        delay = far / 299_792_458.0 + rng.normal(0, 5e-8, len(time)) + (2e-6 if k == 4 else 0.0)
        # after each signal, from the whole second on
        columns = {"time_s": time, "sensor": one["name"], "arrival_time_s": delay}
        rows.append(pl.DataFrame(columns))
    pl.concat(rows).write_csv(folder / "arrivals.csv")
    columns = {"time_s": time, "latitude_deg": way[:, 0], "longitude_deg": way[:, 1]}
    pl.DataFrame(columns | {"height_m": height}).write_csv(folder / "truth.csv")


def plots_of(
    radars: Sequence[Row], flights: Sequence[Flight], duration: float, rng: Rng, faults: Faults
) -> pl.DataFrame:
    """Return the plots of radars, which have faults in range, azimuth and time."""
    parts = []
    for row in radars:
        own = faults.get(row["name"], {})
        height = row.get("height_m", 0.0)
        for target, (places, heights, moments) in enumerate(flights):
            period = row["scan_period_s"]
            seen = np.arange(rng.uniform(0, period), duration, period)
            seen = seen[
                (seen >= moments[0]) & (seen <= moments[-1]) & (rng.random(len(seen)) < 0.95)
            ]
            at = np.column_stack([np.interp(seen, moments, places[:, i]) for i in range(2)])
            up = np.interp(seen, moments, heights)
            far = distances(row["latitude_deg"], row["longitude_deg"], height, at, up)
            angle = azimuths(row["latitude_deg"], row["longitude_deg"], at)
            far = far + rng.normal(0, row["range_sigma_m"], len(seen)) + own.get("range", 0.0)
            angle = angle + rng.normal(0, row["azimuth_sigma_deg"], len(seen))
            angle = (angle + own.get("azimuth", 0.0)) % 360
            parts.append(
                pl.DataFrame(
                    {
                        "time_s": seen,
                        "sensor": row["name"],
                        "range_m": far,
                        "azimuth_deg": angle,
                        "height_m": up,
                        "icao_address": f"{0x4A0000 + target:06X}",
                    }
                )
            )
    return pl.concat(parts).sort("time_s")


def air(
    folder: Path,
    rng: Rng,
    radars: Sequence[Row],
    duration: float = 600.0,
    faults: Faults | None = None,
) -> None:
    """Write the plots of a dozen aircraft by radars, and where the aircraft were."""
    toml(folder, "radar", radars)
    moments = np.arange(0.0, duration + 1.0, 1.0)
    flights = []
    for _ in range(12):
        latitude, longitude = rng.uniform(49.3, 50.7), rng.uniform(13.5, 15.5)
        course, speed = rng.uniform(0, 360), rng.uniform(120, 240)
        way = path(latitude, longitude, course, speed, moments, turn=rng.choice([0, 0, 0.15]))
        flights.append((way, np.full(len(moments), rng.uniform(3e3, 11e3)), moments))
    plots_of(radars, flights, duration, rng, faults or {}).write_csv(folder / "plots.csv")
    pl.concat(
        [
            pl.DataFrame(
                {
                    "time_s": moments,
                    "target": f"{0x4A0000 + k:06X}",
                    "latitude_deg": way[:, 0],
                    "longitude_deg": way[:, 1],
                    "height_m": heights,
                }
            )
            for k, (way, heights, _) in enumerate(flights)
        ]
    ).write_csv(folder / "truth.csv")


def radar(name: str, latitude: float, longitude: float, period: float) -> Row:
    """Return the row of a radar."""
    return site(
        name,
        latitude,
        longitude,
        height_m=350.0,
        range_sigma_m=50.0,
        azimuth_sigma_deg=0.07,
        scan_period_s=period,
        max_range_m=250e3,
    )


def misaligned(folder: Path, rng: Rng) -> None:
    """Write plots of two radars, of which one is turned by 0.4 degrees and 200 m long."""
    radars = [radar("west", 50.0, 14.0, 4.0), radar("east", 50.2, 15.0, 5.0)]
    air(folder, rng, radars, faults={"east": {"azimuth": 0.4, "range": 200.0}})


def periods(folder: Path, rng: Rng) -> None:
    """Write plots of an approach radar and an en-route radar, with 4 and 12 seconds per turn."""
    radars = [radar("approach", 50.1, 14.26, 4.0), radar("route", 49.5, 15.4, 12.0)]
    air(folder, rng, radars)


def adsb(folder: Path, rng: Rng) -> None:
    """Write positions of an aircraft as others received them: noise, jumps, duplicates, a gap."""
    time = np.sort(rng.uniform(0, 900, 800))
    time = time[(time < 300) | (time > 345)]
    moments = np.arange(0.0, 901.0)
    way = path(50.0, 14.0, 60.0, 210.0, moments, turn=0.08)
    at = np.column_stack([np.interp(time, moments, way[:, i]) for i in range(2)])
    noisy = []
    for latitude, longitude in at:
        jumps = rng.random() < 0.03
        off = rng.uniform(2e3, 30e3) if jumps else abs(rng.normal(0, 20 * np.sqrt(2)))
        noisy.append(EARTH.fwd(longitude, latitude, rng.uniform(0, 360), off)[:2])
    found = pl.DataFrame(
        {
            "time_s": time,
            "icao_address": "4A0001",
            "latitude_deg": [y for _, y in noisy],
            "longitude_deg": [x for x, _ in noisy],
        }
    )
    again = found.sample(30, seed=1)
    pl.concat([found, again]).sort("time_s").write_csv(folder / "positions.csv")
    columns = {"time_s": moments, "latitude_deg": way[:, 0], "longitude_deg": way[:, 1]}
    pl.DataFrame(columns).write_csv(folder / "truth.csv")


def gaps(folder: Path, rng: Rng) -> None:
    """Write an hour of azimuths of a ship, with gaps, and noise that nobody stated."""
    time = np.arange(0.0, 3600.0, 10.0)
    way = path(54.30, 10.30, 80.0, 8.0, time)
    angle = azimuths(54.40, 10.45, way)
    heard = (rng.random(len(time)) < 0.85) & ~((time > 1500) & (time < 1800))
    seen = (angle + rng.normal(0, 0.4, len(time))) % 360
    pl.DataFrame({"time_s": time[heard], "sensor": "finder", "azimuth_deg": seen[heard]}).write_csv(
        folder / "azimuths.csv"
    )
    pl.DataFrame({"time_s": time, "azimuth_deg": angle % 360}).write_csv(folder / "truth.csv")


def drive(folder: Path, rng: Rng) -> None:
    """Write azimuths of a beacon on a car at four finders, 5 % of them wrong; GPS knows the way."""
    moments = np.arange(0.0, 1200.0, 2.0)
    way = path(49.190, 16.600, 0.0, 10.0, moments, turn=0.7)
    way = way + 0.004 * np.sin(moments / 170.0)[:, np.newaxis]
    columns = {"time_s": moments, "latitude_deg": way[:, 0], "longitude_deg": way[:, 1]}
    places = {"hill": (49.30, 16.45), "tower": (49.32, 16.75), "roof": (49.05, 16.70)}
    for name, place in (places | {"mast": (49.08, 16.42)}).items():
        angle = azimuths(*place, way) + rng.normal(0, 0.2, len(way))
        wrong = rng.random(len(way)) < 0.05
        angle[wrong] = rng.uniform(0, 360, wrong.sum())
        columns[f"{name}_deg"] = angle % 360
    pl.DataFrame(columns).write_csv(folder / "drive.csv")


SCENES: dict[str, Callable[[Path, Rng], None]] = {
    one.__name__: one
    for one in (bearings, telemetry, arrivals, misaligned, periods, adsb, gaps, drive)
}


def write(name: str) -> None:
    """Write the files of a scene into a folder of its name."""
    folder = Path(name)
    folder.mkdir(exist_ok=True)
    SCENES[name](folder, np.random.default_rng(2026))


if __name__ == "__main__":
    for name in sys.argv[1:] or SCENES:
        write(name)
