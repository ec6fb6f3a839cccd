"""Plots in another convention than those of other sensors are suspected, and usual ones are not."""

import re
import warnings
from typing import Any

import numpy as np
import polars as pl
import pytest

from tertia import tables
from tertia.sensors import PositionSensor, Radar

SITES = {"hill": (0.0, 0.0), "town": (60e3, 15e3), "coast": (-20e3, 55e3)}
RADARS = [
    Radar(place, range_sigma=50.0, azimuth_sigma=0.0015, scan_period=4.0, name=name)
    for name, place in SITES.items()
]
BEACONS = PositionSensor(position_sigma=30.0, update_interval=4.0, name="beacons")
DEGREES = pl.col("azimuth_deg")


def _scene(seed: int, names: list[str], targets: int = 25, scans: int = 20) -> pl.DataFrame:
    """Return plots of aircraft by radars that rotate, nine in ten of them, and false plots."""
    rng = np.random.default_rng(seed)
    start = rng.uniform(-70e3, 90e3, (targets, 2))
    velocity = rng.uniform(-200.0, 200.0, (targets, 2))
    parts = []
    for name in names:
        scan, target = (one.ravel() for one in np.meshgrid(np.arange(scans), np.arange(targets)))
        time = 4.0 * (scan + rng.uniform(size=scan.shape))
        place = start[target] + velocity[target] * time[:, np.newaxis]
        identity = target.copy()
        false = rng.random(time.shape) < 0.1
        place[false], identity[false] = rng.uniform(-90e3, 90e3, (false.sum(), 2)), -1
        away = place - np.array(SITES.get(name, (0.0, 0.0)))
        azimuth = np.arctan2(away[:, 0], away[:, 1]) + rng.normal(0.0, 0.0015, time.shape)
        columns = {
            "time_s": time,
            "sensor": [name] * len(time),
            "range_m": np.linalg.norm(away, axis=1) + rng.normal(0.0, 50.0, time.shape),
            "azimuth_deg": np.degrees(azimuth) % 360.0,
            "identity": identity,
        }
        if name == BEACONS.name:
            columns |= {"east_m": place[:, 0], "north_m": place[:, 1]}
            columns |= {"range_m": [None] * len(time), "azimuth_deg": [None] * len(time)}
        own = pl.DataFrame(columns).filter(pl.Series(rng.random(time.shape) < 0.9))
        parts.append(own.with_columns(pl.col("range_m", "azimuth_deg").cast(pl.Float64)))
    return pl.concat(parts, how="diagonal").with_columns(
        identity=pl.when(pl.col("identity") >= 0).then("identity")
    )


def _told(plots: pl.DataFrame, sensors: list[Any] | None = None) -> list[str]:
    """Return what is said of the places of targets."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", tables.RecordWarning)
        tables.track(plots, sensors=sensors or RADARS)
    said = [str(one.message) for one in caught]
    return [one for one in said if "different places" in one or "apart" in one]


def _of(name: str, changed: pl.Expr) -> pl.Expr:
    """Return the azimuths, of which those of one radar are changed."""
    own = pl.when(pl.col("sensor") == name).then(changed).otherwise(DEGREES)
    return own.alias("azimuth_deg")


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("identified", [True, False])
def test_nothing_is_said_of_usual_plots(seed: int, *, identified: bool) -> None:
    """Not even if a radar is a degree off, which registration finds."""
    plots = _scene(seed, list(SITES))
    plots = plots if identified else plots.drop("identity")
    assert _told(plots) == []
    assert _told(plots.with_columns(_of("town", DEGREES + 1.0))) == []


@pytest.mark.parametrize("identified", [True, False])
@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (90.0 - DEGREES, "if azimuths were anticlockwise from east, or if east and north"),
        (-DEGREES, "if azimuths were anticlockwise from north"),
        (DEGREES + 180.0, "if azimuths were clockwise from south"),
        (DEGREES - 8.0, "if azimuths were about 8° larger: are they relative to magnetic"),
        (_of("town", 90.0 - DEGREES), "if the azimuths of town were anticlockwise from east"),
        (_of("coast", DEGREES + 5.0), "if the azimuths of coast were about 5° smaller"),
    ],
)
def test_azimuths_in_another_convention(changed: pl.Expr, said: str, *, identified: bool) -> None:
    plots = _scene(2, list(SITES)).with_columns(azimuth_deg=changed % 360.0)
    (told,) = _told(plots if identified else plots.drop("identity"))
    assert told.startswith(f"sensors see most targets at different places, and would agree {said}")


def test_plots_of_two_radars_that_were_exchanged() -> None:
    exchanged = pl.col("sensor").replace({"hill": "town", "town": "hill"})
    (told,) = _told(_scene(3, list(SITES)).with_columns(exchanged))
    assert told.endswith("if the plots of hill were those of town, and vice versa")
    two = _scene(3, ["hill", "town"]).with_columns(exchanged)
    (told,) = _told(two, RADARS[:2])
    assert "if azimuths were clockwise from south, or if" in told
    assert told.endswith("or if the radars were exchanged")


def test_a_radar_at_another_place() -> None:
    place = (48e3, 22e3)
    moved = Radar(place, range_sigma=50.0, azimuth_sigma=0.0015, scan_period=4.0, name="town")
    sensors = [RADARS[0], moved, RADARS[2]]
    plots = _scene(4, list(SITES))
    (told,) = _told(plots, sensors)
    assert "if town were about 12 km east and about 7" in told
    assert told.endswith("km south of its stated position")
    # without identities positions are not sought
    assert _told(plots.drop("identity"), sensors) == []


def test_a_radar_beside_reported_positions() -> None:
    plots = _scene(5, ["hill", "beacons"])
    sensors = [RADARS[0], BEACONS]
    assert _told(plots, sensors) == []
    (told,) = _told(plots.with_columns(azimuth_deg=(90.0 - DEGREES) % 360.0), sensors)
    assert "if azimuths were anticlockwise from east" in told


def test_places_that_nothing_explains() -> None:
    """The clock of one radar is minutes off, within the recording."""
    plots = _scene(6, ["hill", "town"], scans=60)
    late = pl.when(pl.col("sensor") == "town").then(100.0).otherwise(0.0)
    (told,) = _told(plots.with_columns(pl.col("time_s") + late), RADARS[:2])
    assert told.startswith("plots of hill and town with the same identity are about")
    assert told.endswith("the position, the north or the clock of one of them wrong?")


@pytest.mark.parametrize("degrees", [45, 120])
def test_a_north_that_is_far_off_is_told_without_identities(degrees: int) -> None:
    plots = _scene(9, ["hill", "town"]).drop("identity")
    assert _told(plots, RADARS[:2]) == []
    (told,) = _told(plots.with_columns(_of("town", (DEGREES + degrees) % 360.0)), RADARS[:2])
    assert f"if the azimuths of town were about {degrees}° smaller" in told


@pytest.mark.parametrize("seconds", [20.0, -120.0])
def test_a_clock_that_is_off_is_told_without_identities(seconds: float) -> None:
    plots = _scene(10, ["hill", "town"], scans=60).drop("identity")
    late = pl.when(pl.col("sensor") == "town").then(seconds).otherwise(0.0)
    (told,) = _told(plots.with_columns(pl.col("time_s") + late), RADARS[:2])
    way = "smaller" if seconds > 0.0 else "larger"
    found = re.search(rf"if the times of town were about (\d+) s {way}", told)
    assert found is not None
    assert abs(float(found[1]) - abs(seconds)) <= 4.0


def test_radars_that_see_different_targets() -> None:
    """Of plots without identities, and of codes that several have, nothing can be told."""
    hill = _scene(7, ["hill"]).with_columns(pl.col("range_m") * 0.3)
    town = _scene(8, ["town"]).with_columns(pl.col("range_m") * 0.3)
    far = Radar((900e3, 0.0), range_sigma=50.0, azimuth_sigma=0.0015, scan_period=4.0, name="town")
    both = pl.concat([hill, town])
    assert _told(both.drop("identity"), [RADARS[0], far]) == []
    shared = both.drop("identity").with_columns(mode_3a=pl.lit("1000"))
    assert _told(shared, [RADARS[0], far]) == []
