"""Times of arrival in tables: the columns are the arguments of `locate`."""

import numpy as np
import polars as pl
import pytest

from tertia import tables
from tertia.location import locate
from tertia.sensors import Station

PLACES = {"A": (0, 0), "B": (4000, 0), "C": (0, 3000), "D": (4200, 3100), "E": (2000, -1500)}
TARGET = np.array([1500.0, 1100.0])
STATIONS = [
    Station(p, name=name, arrival_time_sigma=0.02, position_sigma=2.0) for name, p in PLACES.items()
]


def heard():
    """Two shots, one of them not heard everywhere."""
    distance = np.linalg.norm(TARGET - np.array(list(PLACES.values())), axis=1)
    times = distance / 340.0 + 0.01 * np.array([[1, -2, 0, 2, -1], [0, 1, -1, 1, 0]])
    times[1] += 60.0
    times[1, 0] = np.nan
    rows = [(60.0 * t, name, times[t, k]) for t in (0, 1) for k, name in enumerate(PLACES)]
    return times, pl.DataFrame(rows, ["time_s", "sensor", "arrival_time_s"], orient="row")


@pytest.mark.parametrize("form", ["wide", "long"])
def test_a_table_is_located_as_arrays_are(form):
    times, table = heard()
    if form == "long":
        table = table.select(
            "time_s", "sensor", kind=pl.lit("arrival_time"), value="arrival_time_s"
        )
    found = tables.locate(table, sensors=STATIONS, propagation_speed=340.0)
    fix = locate(STATIONS, arrival_time=times, propagation_speed=340.0)
    np.testing.assert_allclose(found.select("east_m", "north_m"), fix.position, rtol=1e-12)
    np.testing.assert_allclose(found["east_sigma_m"], fix.sigma[:, 0], rtol=1e-12)
    np.testing.assert_allclose(found["emission_time_s"], fix.emission_time, rtol=1e-12)
    np.testing.assert_allclose(found["emission_time_sigma_s"], fix.emission_time_sigma, rtol=1e-12)
    assert found["measurement_count"].to_list() == [5, 4]
    assert found["degrees_of_freedom"].to_list() == [2, 1]


def test_the_error_of_a_survey_counts():
    _, table = heard()
    exact = [Station(s.position, name=s.name, arrival_time_sigma=0.02) for s in STATIONS]
    with_it = tables.locate(table, sensors=STATIONS, propagation_speed=340.0)
    without = tables.locate(table, sensors=exact, propagation_speed=340.0)
    assert np.all(with_it["east_sigma_m"].to_numpy() > without["east_sigma_m"].to_numpy())
