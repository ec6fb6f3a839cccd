"""Positions from measurements whose times differ, and one position of an hour of bearings."""

from typing import Any

import numpy as np
import polars as pl
import pytest
from checks import in_region

from tertia import estimate_bearing, tables
from tertia.sensors import Bias, Station
from tertia.tables._locate import locations_of
from tertia.tables._parts import source_of

PLACES = {"A": (0.0, 0.0), "B": (9e3, 1e3), "C": (4e3, 8e3), "D": (-2e3, 6e3)}
SIGMA = 3.0
OPTIONS = {"method": "robust", "height": None, "height_sigma": None}


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
    with pytest.warns(
        tables.RecordWarning, match="at the same time, and the times differ by .*: give a"
    ):
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


def located(scenes: list[tuple[np.ndarray, pl.DataFrame]], **options: Any) -> pl.DataFrame:
    """Return one position of each scene, and whether its 95 % region holds the emitter."""
    each = [table.with_columns(scene=pl.lit(k)) for k, (_, table) in enumerate(scenes)]
    options = {"sensors": stations(), "tolerance": np.inf, **options}
    found = tables.locate(pl.concat(each), by="scene", **options)
    assert found["scene"].to_list() == list(range(len(scenes)))
    error = found.select("east_m", "north_m").to_numpy() - [emitter for emitter, _ in scenes]
    names = ("east_sigma_m", "north_sigma_m", "covariance_east_north_m2")
    first, second, both = found.select(names).to_numpy().T
    covariance = np.array([[first**2, both], [both, second**2]]).transpose(2, 0, 1)
    return found.with_columns(inside=in_region(error, covariance))


@pytest.mark.parametrize(("wrong", "bias"), [(0.2, 0.0), (0.2, 2.0)])
def test_one_position_of_an_hour_is_within_its_sigma(wrong: float, bias: float) -> None:
    """Of 60 scenes with wrong bearings, 95 % regions hold the truth 49 times or more: p = 1e-4."""
    scenes = [scene(seed, 60, jitter=3.0, wrong=wrong, bias=bias) for seed in range(60)]
    assert located(scenes, sensors=stations(bias))["inside"].sum() >= 49


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


def test_of_few_without_a_sigma_the_median_counts() -> None:
    table = pl.DataFrame(
        {
            "time_s": np.arange(9.0),
            "sensor": ["A", "B", "C"] * 3,
            "azimuth_deg": [359.0, 300.0, 250.0, 1.0, 301.0, 251.0, 5.0, 302.0, 257.0],
        }
    )
    bare = [Station(PLACES[name], name=name) for name in "ABC"]
    found = tables.locate(table, sensors=bare, tolerance=np.inf, method="least-squares")
    once = pl.DataFrame({"sensor": ["A", "B", "C"], "azimuth_deg": [1.0, 301.0, 251.0]})
    expected = tables.locate(once, sensors=bare, method="least-squares")
    names = ("east_m", "north_m", "east_sigma_m", "north_sigma_m")
    assert expected["east_m"].count() == 1
    np.testing.assert_allclose(
        found.select(names).row(0), expected.select(names).row(0), rtol=1e-12
    )


@pytest.mark.parametrize("count", [3, 6, 30])
def test_regions_of_few_bearings_hold_and_are_not_too_large(count: int) -> None:
    """Of 80 regions 69 or more hold the truth: p = 1e-3.

    The axes are those of mean bearings with the sigma that the good ones give them, .8 of all.
    """
    scenes = [scene(seed, count, jitter=3.0, wrong=0.2) for seed in range(80)]
    found = located(scenes, probability=0.95).drop_nulls("region_semi_major_m")
    assert len(found) > 0.95 * 80
    assert found["inside"].mean() >= 69 / 80
    sigma = SIGMA / np.sqrt(0.8 * count)
    exact = [
        (emitter, table.with_columns(azimuth_sigma_deg=sigma))
        for emitter, table in (scene(seed, 1) for seed in range(20))
    ]
    best = located(exact, probability=0.95, tolerance=0.0)["region_semi_major_m"].median()
    assert found["region_semi_major_m"].median() < 1.6 * best


def test_noise_that_is_twice_the_stated() -> None:
    """Regions grow by what the scatter says: 80 % of 60 or more hold the truth."""
    rng = np.random.default_rng(3)
    scenes = []
    for seed in range(60):
        emitter, table = scene(seed, 12)
        noise = rng.normal(0, SIGMA * np.sqrt(3.0), table.height)
        azimuth = (pl.col("azimuth_deg") + pl.Series(noise)) % 360
        scenes.append((emitter, table.with_columns(azimuth_deg=azimuth)))
    assert located(scenes)["inside"].sum() >= 48


def test_few_bearings_count_as_bearing_combines_them() -> None:
    """Without wrong ones, each sensor has the estimate of `bearing` with the stated sigma."""
    _, table = scene(8, 3)
    found = tables.locate(table, sensors=stations(), tolerance=np.inf)
    singly = tables.bearing(table, by="sensor", sigma=SIGMA)
    apart = tables.locate(singly, sensors=stations())
    assert found["east_m"].item() == pytest.approx(apart["east_m"].item(), abs=50.0)
    assert found["east_sigma_m"].item() == pytest.approx(apart["east_sigma_m"].item(), rel=0.1)


@pytest.mark.parametrize("count", [4, 60])
def test_which_bearings_were_left_out(count: int) -> None:
    _, table = scene(7, count)
    wrong = np.zeros(table.height, dtype=bool)
    wrong[[1, count + 2]] = True
    turned = (table["azimuth_deg"] + pl.Series(np.where(wrong, 90.0, 0.0))) % 360
    table = table.with_columns(azimuth_deg=turned).sample(fraction=1.0, shuffle=True, seed=1)
    found = locations_of(
        source_of(table.sort("time_s", maintain_order=True)),
        sensors=stations(),
        tolerance=np.inf,
        **OPTIONS,
    )
    each = found.measurements
    assert each.height == 4 * count
    key = ["sensor", "time_s", "value"]
    told = set(each.filter("outlier").select(key).rows())
    true = table.with_columns(value="azimuth_deg").filter(
        pl.col("azimuth_deg").is_in(turned.filter(pl.Series(wrong)).implode())
    )
    assert set(true.select(key).rows()) <= told
    assert len(told) <= 2 + 0.02 * each.height
    # residuals are those of the position, in sigmas
    place = np.array([PLACES[name] for name in each["sensor"]])
    position = found.rows.select("east_m", "north_m").to_numpy()[0]
    expected = np.degrees(np.arctan2(*(position - place).T))
    apart = (each["value"].to_numpy() - expected + 180.0) % 360.0 - 180.0
    np.testing.assert_allclose(each["residual"], apart / SIGMA, atol=0.05)
    summary = dict(found.sensors.select("sensor", "measurement_count").rows())
    assert summary == dict.fromkeys("ABCD", count)


@pytest.mark.parametrize("tolerance", [-1.0, float("nan")])
def test_a_tolerance_is_no_less_than_zero(tolerance: float) -> None:
    _, table = scene(1, 3)
    with pytest.raises(ValueError, match=r"tolerance is .*; it must be at least 0 seconds"):
        tables.locate(table, sensors=stations(), tolerance=tolerance)


@pytest.mark.parametrize("count", [39, 40, 60])
def test_bearings_that_rounding_made_equal_have_the_stated_sigma(count: int) -> None:
    emitter, table = scene(5, count)
    step = 30.0
    rounded = table.with_columns((pl.col("azimuth_deg") / step).round() * step % 360)
    found = tables.locate(rounded, sensors=stations(), tolerance=np.inf)
    assert np.isfinite(found.select("east_m", "north_m", "east_sigma_m").row(0)).all()
    assert found["measurement_count"].item() == len(PLACES)
    assert np.hypot(*(np.array(found.select("east_m", "north_m").row(0)) - emitter)) < 5e3
