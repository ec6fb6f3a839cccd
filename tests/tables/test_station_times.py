"""Stations whose times are in another zone or unit are named; honest records are not doubted."""

import warnings

import numpy as np
import polars as pl
import pytest

from tertia import tables

COUNT, PLACES = 200, {"a": (0, 0), "b": (3000, 0), "c": (0, 3000), "d": (3000, 3000)}
STATIONS = pl.DataFrame(
    {"name": list(PLACES), "east_m": [p[0] for p in PLACES.values()]}
    | {"north_m": [p[1] for p in PLACES.values()], "range_sigma_m": [10.0] * 4}
)
SUNDAY = np.datetime64("2024-03-31T01:55:00")


def notes(estimate, times, names="abcd", seen=slice(None)):
    """Return the warnings about ranges of which `times(seconds, name)` are written down."""
    rows = []
    for name in names:
        time = 5.0 * np.arange(COUNT)[seen if name == "d" else slice(None)]
        way = np.column_stack([500 + 2 * time, 1500 + 500 * np.sin(time / 150)])
        noise = 10 * np.random.default_rng([91, ord(name)]).normal(size=len(time))
        away = np.linalg.norm(way - PLACES[name], axis=1) + noise
        rows.append(pl.DataFrame({"time_s": times(time, name), "sensor": name, "range_m": away}))
    stations = STATIONS.filter(pl.col("name").is_in(list(names)))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        estimate(pl.concat(rows), sensors=stations)
    return [str(one.message) for one in caught]


def late(name, seconds, factor=1.0):
    return lambda time, own: factor * time + seconds if own == name else time


@pytest.mark.parametrize("estimate", [tables.locate, tables.reconstruct])
@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (late("b", 7200.0), "times of b .* are they 2 h late, as of another time zone"),
        (late("a", -3600.0), "times of a .* are they 1 h early"),
        (late("c", 0.0, 1e3), "times of c go from 0 to 995000 s, .* are they milliseconds"),
        (lambda time, own: time * 40 + 19800 * (own == "d"), "times of d .* 5.5 h late"),
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value")
def test_times_of_another_zone_or_unit_are_doubted(estimate, wrong, said):
    found = [one for one in notes(estimate, wrong) if "the times of" in one]
    assert len(found) == 1
    assert pl.Series(found).str.contains(said).all(), found


def test_summer_time_of_one_station_alone_is_doubted():
    def times(time, own):
        found = SUNDAY + (1e6 * time).astype("timedelta64[us]")
        later = np.where((own == "d") & (time >= 300.0), 3600, 0)
        return found + later.astype("timedelta64[s]")

    assert [one for one in notes(tables.locate, times) if "the time of d goes from" in one]
    assert not [
        one
        for one in notes(tables.locate, lambda t, _: SUNDAY + (1e6 * t).astype("timedelta64[us]"))
        if "summer" in one
    ]


@pytest.mark.parametrize("names", ["abcd", "abd"])
@pytest.mark.parametrize("seen", [slice(None), slice(100, None), slice(0, 60), slice(150, 152)])
def test_stations_that_see_a_target_for_a_while_are_not(names, seen):
    for times in (lambda t, _: t, lambda t, _: 60.0 * t, late("b", 2.0)):
        assert not [one for one in notes(tables.locate, times, names, seen) if "times of" in one]
