"""Velocities in another unit or convention than stated are noticed."""

import warnings
from typing import Any

import numpy as np
import polars as pl
import pytest

from tertia import tables
from tertia.sensors import PositionSensor, Radar

SPEED, COURSE = pl.col("speed_m_s"), pl.col("course_deg")
CHANGES: list[tuple[dict[str, Any], str]] = [
    ({"speed_m_s": SPEED / 0.5144}, "speeds were in knots"),
    ({"speed_m_s": SPEED * 3.6}, "speeds were in km/h"),
    ({"course_deg": (90.0 - COURSE) % 360.0}, "courses were anticlockwise from east, or east and"),
    ({"course_deg": (COURSE + 180.0) % 360.0}, "courses were directions from which targets come"),
    (
        {"speed_m_s": SPEED / 0.5144, "course_deg": -COURSE % 360.0},
        "speeds were in knots and courses were anticlockwise from north",
    ),
]


def _paths(seed: int, speed: float = 8.0) -> pl.DataFrame:
    """Return reports of vessels that turn, every 3 s, in any order."""
    rng = np.random.default_rng(seed)
    number, step = (one.ravel() for one in np.meshgrid(np.arange(6), np.arange(60)))
    course = 60.0 * number + 2.0 * step
    steps = 3.0 * speed * np.exp(1j * np.radians(90.0 - course)).reshape(60, 6)
    place = (np.cumsum(steps, axis=0) - 0.5 * steps).ravel() + 2e3 * number
    columns = {
        "time_s": 3.0 * step,
        "identity": number,
        "east_m": place.real + rng.normal(0.0, 1.0, place.shape),
        "north_m": place.imag + rng.normal(0.0, 1.0, place.shape),
        "speed_m_s": speed * (1.0 + rng.normal(0.0, 0.02, place.shape)),
        "course_deg": course % 360.0,
    }
    return pl.DataFrame(columns).sample(fraction=1.0, shuffle=True, seed=seed)


def _told(found: Any, plots: pl.DataFrame, **options: Any) -> list[str]:
    """Return what is said of velocities."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", tables.RecordWarning)
        found(plots, **options)
    return [str(one.message) for one in caught if "velocities" in str(one.message)]


def _smoothed(plots: pl.DataFrame) -> list[str]:
    columns = {"values": ("east_m", "north_m"), "sigma": 1.0, "by": "identity"}
    return _told(tables.smooth, plots, velocity_sigma=0.3, **columns)


def _tracked(plots: pl.DataFrame) -> list[str]:
    sensor = PositionSensor(position_sigma=1.0, update_interval=3.0, velocity_sigma=0.3)
    return _told(tables.track, plots, sensors=[sensor], profile="vessel")


@pytest.mark.parametrize("told", [_smoothed, _tracked])
def test_usual_velocities(told: Any) -> None:
    assert told(_paths(1)) == []
    # at rest nothing can be said
    assert told(_paths(2, speed=0.01)) == []


@pytest.mark.parametrize("told", [_smoothed, _tracked])
@pytest.mark.parametrize(("changes", "said"), CHANGES)
def test_velocities_in_another_unit_or_convention(
    told: Any, changes: dict[str, Any], said: str
) -> None:
    (noted,) = told(_paths(3).with_columns(**changes))
    assert "contradict the positions, and would agree if " + said in noted


def test_velocities_that_are_plainly_wrong() -> None:
    plots = _paths(4).with_columns(speed_m_s=SPEED * 1.4)
    assert _smoothed(plots) == _tracked(plots) == []


@pytest.mark.parametrize(("unit", "said"), [(1.0, []), (0.5144, ["speeds were in knots"])])
def test_velocities_of_tracks_in_another_unit(unit: float, said: list[str]) -> None:
    paths, course = _paths(3, speed=180.0), np.pi / 180.0 * COURSE
    tracks = paths.select(
        "time_s",
        "east_m",
        "north_m",
        track=pl.col("identity"),
        velocity_east_m_s=SPEED / unit * course.sin(),
        velocity_north_m_s=SPEED / unit * course.cos(),
    )
    radar = Radar(range_sigma=50.0, azimuth_sigma=0.001, scan_period=3.0)
    told = _told(tables.fuse_tracks, tracks, sensors=[radar])
    assert len(told) == len(said)
    assert all(one in text for one, text in zip(said, told, strict=True))
