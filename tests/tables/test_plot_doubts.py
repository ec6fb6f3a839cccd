"""Warnings about plots that contradict the description of their sensor."""

import dataclasses
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from tertia import tables
from tertia.sensors import PositionSensor, Radar

PERIOD = 4.0
RADAR = Radar(range_sigma=50.0, azimuth_sigma=0.001, scan_period=PERIOD, name="hill")
TARGETS, SCANS = 24, 20


def _scene() -> pl.DataFrame:
    """Return plots of aircraft at all azimuths, at the times of the beam."""
    rng = np.random.default_rng(7)
    number, scan = np.meshgrid(np.arange(TARGETS), np.arange(SCANS))
    azimuth = 2 * np.pi * (number + 0.5) / TARGETS
    time = PERIOD * (scan + azimuth / (2 * np.pi))
    distance = 30e3 + 1e3 * number + 150.0 * time + rng.normal(0.0, 50.0, time.shape)
    azimuth = azimuth + rng.normal(0.0, 0.001, time.shape)
    columns = {"time_s": time, "range_m": distance, "azimuth_deg": np.degrees(azimuth)}
    return pl.DataFrame({name: column.ravel() for name, column in columns.items()})


def _told(plots: pl.DataFrame, *sensors: Radar | PositionSensor, **options: Any) -> list[str]:
    """Return the warnings of `track`."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", tables.RecordWarning)
        tables.track(plots, sensors=sensors, **options)
    return [str(one.message) for one in caught]


def test_nothing_is_said_of_plots_as_they_should_be() -> None:
    assert _told(_scene(), RADAR) == []


def test_plots_without_azimuths_are_left_out() -> None:
    """All of them have the same times, and the same lack of an azimuth."""
    scene = _scene()
    blind = scene.with_columns(
        time_s=(pl.col("time_s") / PERIOD).floor() * PERIOD, azimuth_deg=None
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        told = _told(pl.concat([scene, blind.cast(scene.schema)]), RADAR)
        other = blind.cast(scene.schema).with_columns(pl.lit("dale").alias("sensor"))
        both = pl.concat([scene.with_columns(pl.lit("hill").alias("sensor")), other])
        dale = Radar(range_sigma=50.0, azimuth_sigma=0.001, scan_period=PERIOD, name="dale")
        told += _told(both, RADAR, dale)
    assert told == []


@pytest.mark.parametrize("late", [0.0, 1.0])
def test_times_of_north_marks_are_noticed(late: float) -> None:
    scan = (pl.col("time_s") / PERIOD).floor() + late
    (told,) = _told(_scene().with_columns(time_s=scan * PERIOD), RADAR)
    assert told.startswith("plots of hill at all azimuths have the same times")
    assert "up to 4 s off" in told


@pytest.mark.parametrize(("ahead", "noticed"), [(9.0, True), (11.0, True), (12.0, False)])
def test_clocks_that_are_set_forward_are_noticed(ahead: float, *, noticed: bool) -> None:
    """Unless by whole turns of the beam; nothing is said of a pause in the recording."""
    scene, middle = _scene(), 10 * PERIOD + 1.0
    later = pl.when(pl.col("time_s") > middle).then(ahead).otherwise(0.0)
    told = _told(scene.with_columns(pl.col("time_s") + later), RADAR)
    assert ["were clocks set forward" in one for one in told] == [True] * noticed
    pause = pl.col("time_s").is_between(middle, middle + ahead)
    assert _told(scene.filter(~pause), RADAR) == []


def test_gradians_are_noticed() -> None:
    told = _told(_scene().with_columns(pl.col("azimuth_deg") / 0.9), RADAR)
    assert any("are they gradians?" in one for one in told)


def test_times_in_whole_seconds_are_noticed() -> None:
    (told,) = _told(_scene().with_columns(pl.col("time_s").floor()), RADAR)
    assert told.startswith("the times of hill are whole seconds")
    one = _scene().filter(pl.col("azimuth_deg") < 30.0)
    assert _told(one.with_columns(pl.col("time_s").floor()), RADAR) == []


def test_sectors_and_rounded_times_are_no_blocks() -> None:
    sector = (pl.col("time_s") / (PERIOD / 32)).ceil() * PERIOD / 32
    assert _told(_scene().with_columns(time_s=sector), RADAR) == []


def test_old_plots_that_come_again_are_noticed() -> None:
    scene = _scene()
    old = scene.filter(pl.col("time_s") < 5 * PERIOD)
    again = [old.with_columns(pl.col("time_s") + 5 * n * PERIOD) for n in range(4)]
    copies, none = _told(pl.concat(again), RADAR)
    assert copies.startswith("360 of 480 plots of hill are copies of earlier plots")
    # plots come again at the same places, as those of fixed echoes
    assert none.startswith("no track was confirmed")


@pytest.mark.parametrize("stated", [2.0, 6.0, 8.0])
def test_a_scan_period_that_is_not_that_of_the_beam_is_noticed(stated: float) -> None:
    told = _told(_scene(), dataclasses.replace(RADAR, scan_period=stated))
    assert told[0].startswith("hill: its beam turns once in about 4")
    assert f"scan_period is {stated:g} s" in told[0]
    for near in (3.3, 4.8):
        assert _told(_scene(), dataclasses.replace(RADAR, scan_period=near)) == []


def test_anchored_ships_and_plots_sent_twice_are_no_copies() -> None:
    scene = _scene()
    still = scene.with_columns(range_m=9e3, azimuth_deg=(pl.col("azimuth_deg") / 15).round() * 15)
    assert _told(still, RADAR, profile="vessel") == []
    (none,) = _told(still, RADAR)
    assert "never leaves its place" in none
    assert _told(pl.concat([scene, scene[::5]]), RADAR) == []


def test_reports_that_are_rarer_than_stated_are_noticed() -> None:
    number, step = np.meshgrid(np.arange(10), np.arange(60))
    time = 6.0 * step + 0.5 * number
    plots = pl.DataFrame(
        {
            "time_s": time.ravel(),
            "east_m": (100.0 * time + 2e3 * number).ravel(),
            "north_m": 0.0,
            "identity": number.ravel(),
        }
    )
    told = _told(plots, PositionSensor(position_sigma=20.0, name="ships"))
    assert told[0].startswith("10 of 10 targets report to ships only every 6 s")
    assert "update_interval is 1 s" in told[0]
    assert _told(plots, PositionSensor(position_sigma=20.0, update_interval=6.0)) == []
    # also without identities
    told = _told(plots.drop("identity"), PositionSensor(position_sigma=20.0, name="ships"))
    assert told[0].startswith("ships: reports of a target come about every 5.5 s")


def test_latitudes_and_longitudes_that_are_exchanged_are_noticed(tmp_path: Path) -> None:
    path = tmp_path / "sensors.toml"
    path.write_text(
        "[origin]\nlatitude_deg = 47\nlongitude_deg = 8\n"
        '[[position_sensor]]\nname = "adsb"\nposition_sigma_m = 30\n',
        encoding="utf-8",
    )
    time = np.arange(60.0)
    places = {"latitude_deg": 47.0 + 1e-3 * time, "longitude_deg": 8.0 + 1e-3 * time}
    exchanged = dict(zip(places, reversed(places.values()), strict=True))
    for columns, noticed in ((places, False), (exchanged, True)):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", tables.RecordWarning)
            tables.track(pl.DataFrame({"time_s": time, **columns}), sensors=path)
        assert ["longitude swapped" in str(one.message) for one in caught] == [True] * noticed


@pytest.mark.parametrize(
    ("hours", "told"), [(0.0, ""), (2.0, "2 h later"), (-1.0, "1 h earlier"), (0.02, "")]
)
def test_sensors_in_another_time_zone_are_noticed(hours: float, told: str) -> None:
    """Not if the times overlap, or one sensor merely begins when the other ends."""
    scene = _scene()
    other = scene.with_columns(sensor=pl.lit("dale"), time_s=pl.col("time_s") + 3600 * hours)
    plots = pl.concat([scene.with_columns(sensor=pl.lit("hill")), other], how="diagonal")
    dale = Radar((100.0, 0.0), range_sigma=50.0, azimuth_sigma=0.001, scan_period=4.0, name="dale")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", tables.RecordWarning)
        tables.track(plots, sensors=[dale, RADAR])
    said = [str(one.message) for one in caught if "time zone" in str(one.message)]
    assert len(said) == bool(told)
    assert not told or "dale has no plots at the times of the other sensors" in said[0]
    assert not told or told in said[0]
