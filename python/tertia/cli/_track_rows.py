"""The rows of a table of tracks as they are in files."""

from collections.abc import Sequence

import numpy as np
import polars as pl

from tertia._arrays import FloatArray, IntArray
from tertia.cli import _tables
from tertia.cli._radar_plots import Recording
from tertia.cli._radars import RadarSites
from tertia.flightplan import FlightPlan
from tertia.tracker import TrackTable

# components of the state: how their columns begin, and their units
_STATE = (
    ("east", "m"),
    ("north", "m"),
    ("velocity_east", "m_s"),
    ("velocity_north", "m_s"),
)
_PRODUCTS = {("m", "m"): "m2", ("m", "m_s"): "m2_s", ("m_s", "m_s"): "m2_s2"}


def plan_names(plans: Sequence[FlightPlan]) -> list[str]:
    """Return how plans are called: by their names, or by numbers from 1 on."""
    return [str(number) if p.name is None else p.name for number, p in enumerate(plans, start=1)]


def track_rows(
    table: TrackTable,
    recording: Recording,
    sites: RadarSites,
    plans: Sequence[FlightPlan],
) -> pl.DataFrame:
    """Return one row per row of the table, null for what is not known."""
    followed = table.plan >= 0
    return pl.DataFrame(
        {
            "time_s": recording.clock.moments(table.time),
            "track": table.track,
            "radar": _named(table.radar, sites.names),
            "plot": pl.Series(table.plot).set(pl.Series(table.plot < 0), None),
            **_state(table),
            **sites.places.geodetic(table.position),
            "course_deg": np.degrees(np.arctan2(*table.velocity.T)) % 360.0,
            "speed_m_s": np.hypot(*table.velocity.T),
            "turning": table.turning,
            "height_m": _tables.known(table.height, ~np.isnan(table.height)),
            "climb_m_s": _tables.known(table.climb, ~np.isnan(table.climb)),
            recording.identity: recording.identities(table.identity),
            "plan": _named(table.plan, plan_names(plans)),
            "conforming": pl.Series(table.conforming).set(pl.Series(~followed), None),
            "confirmed": table.confirmed,
        }
    )


def covariance_columns() -> dict[tuple[int, int], str]:
    """Return the columns of the covariances between two components of the state."""
    return {
        (i, j): f"covariance_{first}_{second}_{_PRODUCTS[unit, other]}"
        for i, (first, unit) in enumerate(_STATE)
        for j, (second, other) in enumerate(_STATE)
        if i < j
    }


def _state(table: TrackTable) -> dict[str, FloatArray]:
    values = np.hstack([table.position, table.velocity])
    columns = {}
    for i, (name, unit) in enumerate(_STATE):
        columns[f"{name}_{unit}"] = values[:, i]
        columns[f"{name}_sigma_{unit}"] = np.sqrt(table.covariance[:, i, i])
    for (i, j), name in covariance_columns().items():
        columns[name] = table.covariance[:, i, j]
    return columns


def _named(numbers: IntArray, names: list[str]) -> pl.Series:
    """Return names by their numbers, null where the number is -1."""
    # the last one is that of -1
    chosen = np.array([*names, None], dtype=object)[numbers]
    return pl.Series(chosen.tolist(), dtype=pl.String)
