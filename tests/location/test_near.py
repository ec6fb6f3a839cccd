"""Ranges of targets near a station, which noise may make 0 or negative."""

from functools import partial

import numpy as np
import polars as pl
import pytest
from checks import assert_refused, in_region

from tertia import tables
from tertia.location import Station, locate
from tertia.trajectory import reconstruct

PLACES = np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 12.0], [0.0, 12.0], [10.0, 6.0]])
SIGMA = 1.0
STATIONS = [Station(place, range_sigma=SIGMA) for place in PLACES]


def walk(seed, step=0.1):
    """Ranges to a tag that walks past stations, in whole steps, with its positions."""
    random = np.random.default_rng([91, seed])
    angle = np.arange(150) / 12
    way = np.column_stack([10 + 10 * np.cos(angle), 6 + 6.0 * np.sin(2 * angle)])
    distance = np.linalg.norm(way[:, np.newaxis] - PLACES, axis=-1)
    ranges = step * np.round((distance + random.normal(0.0, SIGMA, distance.shape)) / step)
    ranges[random.random(ranges.shape) < 0.1] = np.nan
    return ranges, way


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_ranges_below_zero_are_noise(seed):
    ranges, way = walk(seed)
    assert np.sum(ranges < 0.0) > 1
    kept, fixes = ranges.copy(), locate(STATIONS, range=ranges)
    path = reconstruct(STATIONS, np.arange(150.0), range=ranges)
    assert np.mean(in_region(path.position - way, path.covariance[:, :2, :2])) > 0.85
    # those below 0 are as good as others
    kept[ranges <= 0.0] = np.nan
    without = reconstruct(STATIONS, np.arange(150.0), range=kept)
    near = np.any(ranges <= 0.0, axis=1)
    errors = [np.linalg.norm((one.position - way)[near], axis=1) for one in (path, without)]
    assert np.mean(errors[0] ** 2) < np.mean(errors[1] ** 2)
    assert np.isfinite(fixes.position).all(axis=1).mean() > 0.8


def test_in_tables():
    ranges, _ = walk(0)
    rows = {"time_s": np.repeat(np.arange(150.0), 5), "sensor": list("abcde") * 150}
    table = pl.DataFrame(rows | {"range_m": ranges.ravel()}).fill_nan(None)
    stations = [Station(place, range_sigma=SIGMA, name=name)
                for place, name in zip(PLACES, "abcde", strict=True)]  # fmt: skip
    found = tables.reconstruct(table, sensors=stations)
    expected = reconstruct(STATIONS, np.arange(150.0), range=ranges)
    np.testing.assert_array_equal(found["east_m"], expected.position[:, 0])
    far = table.with_columns(range_m=pl.when(pl.col("range_m") < 0).then(-9.0).otherwise("range_m"))
    with pytest.raises(ValueError, match=r"row \d+: range is -9; it must be positive"):
        tables.reconstruct(far, sensors=stations)


def test_what_stands_for_no_measurement_is_refused():
    ranges, _ = walk(0)
    ranges = np.abs(ranges) + 6.0 * SIGMA
    for value, count, message in (
        (0.0, 1, "range[3, 1] is 0.0; it must be a positive number, one that is negative by"),
        (-5.1, 1, "range[3, 1] is -5.1; it must be a positive number, one that is negative by"),
        (-1.0, 7, "range[3, 1] is -1.0; it must be nan if nothing was measured: all 7 ranges"),
    ):
        wrong = ranges.copy()
        wrong[3 : 3 + count, 1] = value
        time = np.arange(150.0)
        assert_refused(partial(locate, STATIONS, range=wrong), ValueError, message)
        assert_refused(partial(reconstruct, STATIONS, time, range=wrong), ValueError, message)
    # without a sigma nothing below 0 is noise
    alone = partial(locate, PLACES, range=[9, -0.1, 9, 9, 9.0])
    assert_refused(alone, ValueError, "range[1] is -0.1; it must be a positive number")


def test_coarse_ranges_may_be_zero():
    """As of a timing advance, of which one step is 554 m."""
    rng = np.random.default_rng(1)
    places = rng.uniform(-2000.0, 2000.0, (5, 2))
    time = 10.0 * np.arange(60)
    way = places[0] + np.outer(time - 300.0, [1.0, 0.5])
    away = np.linalg.norm(way[:, np.newaxis] - places, axis=-1)
    ranges = 554.0 * np.round(np.maximum(away + 100.0 * rng.normal(size=away.shape), 0.0) / 554.0)
    assert np.count_nonzero(ranges == 0.0) >= 5
    stations = [Station(place, range_sigma=160.0) for place in places]
    for found in (
        locate(stations, range=ranges),
        reconstruct(stations, time, range=ranges),
    ):
        assert np.nanmedian(np.linalg.norm(found.position - way, axis=1)) < 250.0
