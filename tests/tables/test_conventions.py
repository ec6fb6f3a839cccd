"""Measurements in another convention are suspected, and usual ones are not."""

import warnings
from collections.abc import Callable

import numpy as np
import polars as pl
import pytest

from tertia import tables

PLACES = np.array([[0, 0, 3], [900, 100, 12], [800, 950, 5], [-100, 800, 8.0]])
STEPS = np.arange(80)
WAY = np.column_stack(
    [
        400 + 300 * np.cos(STEPS / 14),
        450 + 250 * np.sin(STEPS / 11),
        80 + 40 * np.sin(STEPS / 20),
    ]
)
SIGMAS = {
    "range_sigma_m": 5.0,
    "azimuth_sigma_deg": 2.0,
    "elevation_sigma_deg": 2.0,
    "range_difference_sigma_m": 5.0,
    "arrival_time_sigma_s": 1e-3,
}
KEYS = ("range_m", "azimuth_deg", "elevation_deg", "range_difference_m")


def stations(places: np.ndarray = PLACES) -> pl.DataFrame:
    columns = dict(zip(("east_m", "north_m", "up_m"), places.T, strict=False))
    return pl.DataFrame({"name": list("abcd"), **columns, **SIGMAS})


def seen(seed: int, *kinds: str, wrong: float = 0.05, bias: float = 0.0) -> pl.DataFrame:
    """Return what four stations measure; some measurements are missing, and some are wrong."""
    rng = np.random.default_rng(seed)
    away = WAY[:, np.newaxis] - PLACES
    if "elevation_deg" not in kinds:
        away[..., 2] = 0.0
    distance = np.linalg.norm(away, axis=-1)
    noise = rng.normal(size=(len(KEYS), *distance.shape))
    noise[rng.random(noise.shape) < wrong] *= 20
    flat = np.hypot(away[..., 0], away[..., 1])
    values = {
        "range_m": distance + 5 * noise[0],
        "azimuth_deg": np.degrees(np.arctan2(away[..., 0], away[..., 1])) + 2 * noise[1],
        "elevation_deg": np.degrees(np.arctan2(away[..., 2], flat)) + 2 * noise[2],
        "range_difference_m": distance - distance[:, :1] + 5 * noise[3],
    }
    values["azimuth_deg"][:, 1] += bias
    values["range_difference_m"][:, 0] = np.nan
    values["elevation_deg"] = np.clip(values["elevation_deg"], -89.0, 89.0)
    values["range_m"] = np.abs(values["range_m"])
    rows = {"time_s": np.repeat(STEPS.astype(float), 4), "sensor": list("abcd") * len(STEPS)}
    table = pl.DataFrame(rows | {kind: values[kind].ravel() for kind in kinds})
    there = rng.random(table.height) > 0.1
    return table.filter(pl.Series(there)).fill_nan(None)


def said_of(table: pl.DataFrame, sensors: pl.DataFrame, **options: float) -> list[str]:
    """Return what `locate` says of conventions."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        tables.locate(table, sensors=sensors, **options)
    return [str(one.message) for one in caught if "contradict" in str(one.message)]


AZIMUTH = pl.col("azimuth_deg")
BOTH = ("azimuth_deg", "elevation_deg")
CASES: dict[str, tuple[tuple[str, ...], pl.Expr]] = {
    "anticlockwise from east": (BOTH, (90 - AZIMUTH).alias("azimuth_deg")),
    "anticlockwise from north": (("azimuth_deg",), -AZIMUTH),
    "clockwise from south": (("azimuth_deg",), AZIMUTH + 180),
    "in gradians": (BOTH, AZIMUTH % 360 / 0.9),
    "measured from the zenith": (BOTH, (90 - pl.col("elevation_deg")).alias("elevation_deg")),
    "there and back": (("range_m",), pl.col("range_m") * 2),
    "in feet": (("range_m",), pl.col("range_m") / 0.3048),
    "in centimetres": (("range_m",), pl.col("range_m") * 100),
    "in millimetres": (("range_m",), pl.col("range_m") * 1000),
    "the range of the first sensor minus": (("range_difference_m",), -pl.col("range_difference_m")),
}


def of_kinds(kinds: tuple[str, ...]) -> pl.DataFrame:
    return stations() if "elevation_deg" in kinds else stations(PLACES[:, :2])


@pytest.mark.parametrize("kinds", dict.fromkeys(kinds for kinds, _ in CASES.values()))
def test_nothing_is_said_of_usual_measurements(kinds: tuple[str, ...]) -> None:
    for seed in range(3):
        assert not said_of(seen(seed, *kinds), of_kinds(kinds))


@pytest.mark.parametrize("case", CASES)
def test_another_convention_is_said(case: str) -> None:
    kinds, change = CASES[case]
    for seed in range(3):
        said = said_of(seen(seed, *kinds).with_columns(change), of_kinds(kinds))
        assert len(said) == 1
        assert case in said[0]


def test_also_before_a_path_and_with_one_instant_for_each_group() -> None:
    table = seen(5, "azimuth_deg").with_columns((90 - AZIMUTH).alias("azimuth_deg"))
    flat = stations(PLACES[:, :2])
    with pytest.warns(tables.RecordWarning, match="anticlockwise from east"):
        tables.reconstruct(table, sensors=flat)
    each = table.rename({"time_s": "event"})
    with pytest.warns(tables.RecordWarning, match="anticlockwise from east"):
        tables.locate(each, sensors=flat, by="event")


def test_ranges_in_feet_at_a_known_height() -> None:
    """Without the height, stations below a ceiling leave it open, and no convention agrees."""
    rng, places = np.random.default_rng(4), PLACES.copy()
    places[:, 2] = [12.0, 12.5, 12.2, 12.4]
    way = np.column_stack([WAY[:, :2], np.full(len(WAY), 1.5)])
    distance = np.linalg.norm(way[:, np.newaxis] - places, axis=-1)
    distance += rng.normal(0.0, 5.0, distance.shape)
    table = pl.DataFrame(
        {
            "time_s": np.repeat(STEPS.astype(float), 4),
            "sensor": list("abcd") * len(STEPS),
            "range_m": (distance / 0.3048).ravel(),
        }
    )
    with pytest.warns(tables.RecordWarning, match="in feet"):
        tables.locate(table, sensors=stations(places), height=1.5, height_sigma=0.1)


def test_exchanged_coordinates_of_sensors() -> None:
    exchanged = stations(PLACES[:, [1, 0]])
    [said] = said_of(seen(6, "azimuth_deg"), exchanged)
    assert "east and north of the sensors were exchanged" in said


@pytest.mark.parametrize(
    "change",
    [
        lambda seed: seen(seed, *BOTH, wrong=0.3),
        lambda seed: seen(seed, "azimuth_deg", bias=15.0),
        lambda seed: seen(seed, "range_m", wrong=0.25),
        lambda seed: seen(seed, "range_difference_m", wrong=0.25),
        lambda seed: seen(seed, *KEYS[:3], wrong=0.2),
        lambda seed: seen(seed, "azimuth_deg").filter(pl.col("sensor").is_in(["a", "b"])),
        lambda seed: seen(seed, "azimuth_deg").head(6),
        # noise alone
        lambda seed: seen(seed, "azimuth_deg").with_columns(AZIMUTH.shuffle(seed)),
    ],
)
def test_no_false_alarms(change: Callable[[int], pl.DataFrame]) -> None:
    """Neither many faults nor a misaligned station look like another convention."""
    for seed in range(10, 16):
        table = change(seed)
        places = PLACES if "elevation_deg" in table.columns else PLACES[:, :2]
        assert not said_of(table, stations(places))


def test_sounds_at_the_speed_of_light() -> None:
    distance = np.linalg.norm(WAY[:, np.newaxis, :2] - PLACES[:, :2], axis=-1)
    arrival = STEPS[:, np.newaxis] * 10 + distance / 340
    rows = {"time_s": np.repeat(STEPS.astype(float), 4), "sensor": list("abcd") * len(STEPS)}
    table = pl.DataFrame(rows | {"arrival_time_s": arrival.ravel()})
    with pytest.warns(tables.RecordWarning, match="signals need only .* are they sounds"):
        tables.locate(table, sensors=stations(PLACES[:, :2]))
    with warnings.catch_warnings():
        warnings.simplefilter("error", tables.RecordWarning)
        tables.locate(table, sensors=stations(PLACES[:, :2]), propagation_speed=340.0)
