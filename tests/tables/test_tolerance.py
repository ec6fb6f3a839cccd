"""Positions from measurements whose times differ, and one position of an hour of bearings."""

import numpy as np
import polars as pl
import pytest

from tertia import estimate_bearing, tables
from tertia.sensors import Bias, Station

PLACES = {"A": (0.0, 0.0), "B": (9e3, 1e3), "C": (4e3, 8e3), "D": (-2e3, 6e3)}
SIGMA = 3.0


def stations(bias: float | None = None) -> list[Station]:
    known = None if bias is None else Bias(azimuth_sigma=bias, degrees=True)
    return [
        Station(place, name=name, azimuth_sigma=SIGMA, bias=known, degrees=True)
        for name, place in PLACES.items()
    ]


def scene(
    seed: int, count: int, *, jitter: float = 0.0, wrong: float = 0.0, bias: float = 0.0
) -> tuple[np.ndarray, pl.DataFrame]:
    rng = np.random.default_rng(seed)
    emitter = np.array([5e3, 4e3]) + rng.normal(0, 500, 2)
    parts = []
    for name, place in PLACES.items():
        azimuth = np.degrees(np.arctan2(*(emitter - place))) + rng.normal(0, bias)
        azimuth = azimuth + rng.normal(0, SIGMA, count)
        bad = rng.random(count) < wrong
        azimuth[bad] = rng.uniform(0, 360, bad.sum())
        time = 10.0 * np.arange(count) + rng.uniform(-jitter, jitter, count)
        parts.append(pl.DataFrame({"time_s": time, "sensor": name, "azimuth_deg": azimuth % 360}))
    return emitter, pl.concat(parts)


def test_instants_of_stations_that_do_not_coincide() -> None:
    _, exact = scene(1, 351)
    _, jittered = scene(1, 351)
    rng = np.random.default_rng(2)
    jittered = jittered.with_columns(pl.col("time_s") + rng.uniform(-0.01, 0.01, jittered.height))
    found = tables.locate(jittered, sensors=stations(), tolerance=0.05)
    expected = tables.locate(exact, sensors=stations())
    assert found.height == expected.height == 351
    np.testing.assert_allclose(found["time_s"], expected["time_s"], atol=0.011)
    assert found.drop("time_s").equals(expected.drop("time_s"))
    # without it no two are of one instant
    with pytest.warns(tables.RecordWarning, match="at the same time; times are .* apart: give a"):
        assert tables.locate(jittered, sensors=stations())["east_m"].count() == 0


def test_an_instant_has_a_sensor_once() -> None:
    table = pl.DataFrame(
        {
            "time_s": [0.0, 0.1, 0.2, 0.3, 2.0],
            "sensor": ["A", "B", "A", "B", "A"],
            "range_m": [5e3, 5e3, 5.1e3, 5.1e3, 5e3],
        }
    )
    places = [Station(PLACES[name], name=name, range_sigma=5.0) for name in "AB"]
    found = tables.locate(table, sensors=places, tolerance=1.0, initial=(4e3, 4e3))
    np.testing.assert_allclose(found["time_s"], [0.05, 0.25, 2.0])
    assert found["measurement_count"].to_list() == [2, 2, 1]


def test_dates_are_kept() -> None:
    _, table = scene(3, 20, jitter=0.01)
    dated = table.with_columns(
        pl.lit("2026-11-22").str.to_datetime().dt.offset_by("1h")
        + pl.duration(microseconds=(pl.col("time_s") * 1e6).round().cast(pl.Int64))
    ).rename({"literal": "time"})
    found = tables.locate(
        dated.drop("time_s"), sensors=stations(), tolerance=0.05, columns={"time_s": "time"}
    )
    assert found.height == 20
    assert found["time_s"].dtype.is_temporal()


@pytest.mark.parametrize(("wrong", "bias"), [(0.2, 0.0), (0.2, 2.0)])
def test_one_position_of_an_hour_is_within_its_sigma(wrong: float, bias: float) -> None:
    """Of 60 scenes with wrong bearings, 95 % regions hold the truth 49 times or more: p = 1e-4."""
    inside = 0
    for seed in range(60):
        emitter, table = scene(seed, 60, jitter=3.0, wrong=wrong, bias=bias)
        found = tables.locate(table, sensors=stations(bias), tolerance=np.inf)
        assert found.height == 1
        row = found.row(0, named=True)
        covariance = np.diag([row["east_sigma_m"] ** 2, row["north_sigma_m"] ** 2])
        covariance[0, 1] = covariance[1, 0] = row["covariance_east_north_m2"]
        error = np.array([row["east_m"], row["north_m"]]) - emitter
        inside += bool(error @ np.linalg.solve(covariance, error) < 5.991)
    assert inside >= 49


def test_the_bearings_of_a_sensor_are_those_that_bearing_estimates() -> None:
    _, table = scene(5, 50, wrong=0.2)
    together = tables.locate(table, sensors=stations(), tolerance=np.inf)
    singly = tables.bearing(table, by="sensor")
    apart = tables.locate(singly, sensors=stations())
    assert together["measurement_count"].item() == 4
    np.testing.assert_allclose(
        together.select("east_m", "north_m", "east_sigma_m").row(0),
        apart.select("east_m", "north_m", "east_sigma_m").row(0),
        rtol=1e-12,
    )
    first = estimate_bearing(table.filter(pl.col("sensor") == "A")["azimuth_deg"].to_numpy())
    assert singly["azimuth_sigma_deg"][0] == first.sigma


def test_of_few_the_median_counts() -> None:
    table = pl.DataFrame(
        {
            "time_s": np.arange(6.0),
            "sensor": ["A", "B", "A", "B", "A", "B"],
            "azimuth_deg": [359.0, 300.0, 1.0, 301.0, 5.0, 302.0],
            "azimuth_sigma_deg": 2.0,
        }
    )
    found = tables.locate(table, sensors=stations()[:2], tolerance=np.inf)
    once = pl.DataFrame({"sensor": ["A", "B"], "azimuth_deg": [1.0, 301.0]})
    expected = tables.locate(once.with_columns(azimuth_sigma_deg=2.0), sensors=stations()[:2])
    names = ("east_m", "north_m", "east_sigma_m", "north_sigma_m")
    assert expected["east_m"].count() == 1
    np.testing.assert_allclose(
        found.select(names).row(0), expected.select(names).row(0), rtol=1e-12
    )


@pytest.mark.parametrize("tolerance", [-1.0, float("nan")])
def test_a_tolerance_is_no_less_than_zero(tolerance: float) -> None:
    _, table = scene(1, 3)
    with pytest.raises(ValueError, match=r"tolerance is .*; it must be at least 0 seconds"):
        tables.locate(table, sensors=stations(), tolerance=tolerance)
