"""Make air_plots.csv, air_radars.toml, air_plans.json, air_truth.csv: two radars, a dozen aircraft.

Nothing here was measured: `tertia.simulate` with fixed seeds makes the same files again. Twelve
aircraft fly five minutes of their flight plans, in a wind that is not in the plans; the last two
leave theirs. Both radars have clutter without identities.

west    scans in 4 s, 50 m and 0.08 degrees
east    scans in 6 s, 75 m and 0.10 degrees, 70 km from the other
"""

import csv
import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from tertia.flightplan import FlightPlan
from tertia.simulate import FlightScenario, RadarPlots, Traffic, flights, radar_plots, routes
from tertia.tracker import NO_IDENTITY, Radar

SEED = 7
AIRCRAFT = 12
DURATION_S, TRUTH_STEP_S = 300.0, 2.0
LEAVING: list[FlightScenario] = ["straight-on", "hijack"]
WIND_M_S = 20.0
CLUTTER_PER_SCAN = 3.0
FIRST_CODE = 0o4201


def radars() -> list[Radar]:
    """Return the radars."""
    rows = [
        ("west", (0.0, 0.0, 120.0), 50.0, 0.08, 4.0, 220e3, 0.95),
        ("east", (70e3, 10e3, 60.0), 75.0, 0.10, 6.0, 260e3, 0.93),
    ]
    return [
        Radar(
            place,
            range_sigma=sigma_m,
            azimuth_sigma=sigma_deg,
            scan_period=period_s,
            max_range=range_m,
            detection_probability=probability,
            name=name,
            degrees=True,
        )
        for name, place, sigma_m, sigma_deg, period_s, range_m, probability in rows
    ]


def plans() -> list[FlightPlan]:
    """Return the flight plans: each is a random route in the middle airspace."""
    return [
        FlightPlan(
            np.round(plan.waypoints),
            np.round(plan.speeds),
            heights=plan.heights,
            identity=FIRST_CODE + number,
            name=f"TRT{101 + number}",
        )
        for number, plan in enumerate(routes("middle", AIRCRAFT, rng=SEED))
    ]


def traffic() -> Traffic:
    """Simulate the aircraft."""
    conforming: list[FlightScenario] = ["conforming"] * (AIRCRAFT - len(LEAVING))
    return flights(plans(), scenario=conforming + LEAVING, wind=WIND_M_S, step=0.5, rng=SEED)


def record() -> RadarPlots:
    """Simulate what the radars see until the recording ends."""
    seen = radar_plots(
        traffic(), radars(), clutter=CLUTTER_PER_SCAN, identity_missing_probability=0.02, rng=SEED
    )
    return seen[seen.plots.time <= DURATION_S]


def plot_rows() -> Iterator[tuple[str, ...]]:
    """Yield time, radar, range, azimuth, flight level and code; empty where one is missing."""
    plots, names = record().plots, [radar.name or "" for radar in radars()]
    columns = (plots.time, plots.sensor, plots.range, plots.azimuth, plots.height, plots.identity)
    for time, radar, distance, azimuth, height, code in zip(*columns, strict=True):
        yield (
            f"{time:.3f}",
            names[radar],
            f"{distance:.1f}",
            f"{np.degrees(azimuth):.4f}",
            "" if np.isnan(height) else f"{height / 30.48:.0f}",
            "" if code == NO_IDENTITY else f"{code:04o}",
        )


def truth_rows() -> Iterator[tuple[str, ...]]:
    """Yield time, target, east and north while a flight is in the air."""
    flown = traffic()
    times = np.arange(0.0, DURATION_S + TRUTH_STEP_S / 2, TRUTH_STEP_S)
    for k, plan in enumerate(plans()):
        for time, (east, north) in zip(times, flown.at(k, times)[0], strict=True):
            if np.isfinite(east):
                yield f"{time:g}", plan.name or "", f"{east:.1f}", f"{north:.1f}"


def toml() -> str:
    """Return the file of the radars."""
    parts = ["# positions in a local frame; standard deviations of single plots"]
    for radar in radars():
        east, north, up = radar.position
        parts.append(
            f'\n[[radar]]\nname = "{radar.name}"\n'
            f"east_m = {east}\nnorth_m = {north}\nup_m = {up}\n"
            f"range_sigma_m = {radar.range_sigma}\n"
            f"azimuth_sigma_deg = {np.degrees(radar.azimuth_sigma):.2f}\n"
            f"scan_period_s = {radar.scan_period}\n"
            f"max_range_m = {radar.max_range}\n"
            f"detection_probability = {radar.detection_probability}"
        )
    return "\n".join(parts) + "\n"


def plan_list() -> str:
    """Return the file of the plans."""
    rows = [
        {
            "name": plan.name,
            "mode_3a": None if plan.identity is None else f"{plan.identity:04o}",
            "waypoints": plan.waypoints.tolist(),
            "speeds_m_s": plan.speeds.tolist(),
            "heights_m": [] if plan.heights is None else plan.heights.round(1).tolist(),
        }
        for plan in plans()
    ]
    return "[\n" + ",\n".join(json.dumps(plan) for plan in rows) + "\n]\n"


def _write(path: Path, header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)


PLOT_HEADER = ("time_s", "sensor", "range_m", "azimuth_deg", "flight_level", "mode_3a")
TRUTH_HEADER = ("time_s", "target", "east_m", "north_m")

if __name__ == "__main__":
    here = Path(__file__)
    here.with_name("air_radars.toml").write_text(toml(), encoding="utf-8")
    here.with_name("air_plans.json").write_text(plan_list(), encoding="utf-8")
    _write(here.with_name("air_plots.csv"), PLOT_HEADER, plot_rows())
    _write(here.with_name("air_truth.csv"), TRUTH_HEADER, truth_rows())
