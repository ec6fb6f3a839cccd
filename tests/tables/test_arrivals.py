"""Times of arrival in tables: the columns are the arguments of `locate`."""

import numpy as np
import polars as pl
import pytest
from terminal import run

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


def _radio(form):
    """Return one signal with times of arrival in some form, as text, and the true position."""
    distance = np.linalg.norm(TARGET - np.array(list(PLACES.values())), axis=1)
    ticks = np.rint(1e9 * (0.25 + distance / 299_792_458.0)).astype(np.int64)
    seconds = 1_700_000_000 + ticks // 10**9
    fraction = [f"{one:09d}" for one in (ticks % 10**9).tolist()]
    dates = seconds.astype("datetime64[s]").astype(str)
    cells = {
        "dates with a zone": [
            f"{date}.{part}Z" for date, part in zip(dates, fraction, strict=True)
        ],
        "dates": [f"{date}.{part}" for date, part in zip(dates, fraction, strict=True)],
        "seconds since 1970": [f"{s}.{part}" for s, part in zip(seconds, fraction, strict=True)],
        "datetimes": (seconds * 10**9 + ticks % 10**9).astype("datetime64[ns]"),
    }[form]
    return pl.DataFrame({"sensor": [*PLACES], "arrival_time_s": cells})


@pytest.mark.parametrize("form", ["dates with a zone", "dates", "seconds since 1970", "datetimes"])
def test_dates_and_epochs_keep_their_nanoseconds(form):
    radios = [Station(p, name=name, arrival_time_sigma=1e-9) for name, p in PLACES.items()]
    found = tables.locate(_radio(form), sensors=radios)
    np.testing.assert_allclose(found.select("east_m", "north_m").row(0), TARGET, atol=0.5)
    sent = found["emission_time_s"][0]
    if form == "seconds since 1970":
        assert sent == pytest.approx(1_700_000_000.25, abs=1e-6)
    else:
        assert str(sent).startswith("2023-11-14 22:13:20.2")
        assert found["emission_time_s"].dtype == pl.Datetime(
            "ns", "UTC" if "zone" in form else None
        )


def test_numbers_that_are_rounded_by_more_than_their_sigma_give_a_warning():
    radios = [Station(p, name=name, arrival_time_sigma=1e-9) for name, p in PLACES.items()]
    coarse = _radio("seconds since 1970").cast({"arrival_time_s": pl.Float64})
    with pytest.warns(UserWarning, match="count from the start"):
        tables.locate(coarse, sensors=radios)


def test_files_must_agree_on_the_kind_of_arrival_times(tmp_path):
    _radio("dates").write_csv(tmp_path / "a.csv")
    _radio("seconds since 1970").write_csv(tmp_path / "b.csv")
    sensors = tmp_path / "s.csv"
    pl.DataFrame({"name": [*PLACES], "east_m": 0.0, "north_m": 0.0}).write_csv(sensors)
    done = run("locate", tmp_path / "a.csv", tmp_path / "b.csv", "--sensors", sensors)
    assert done.code == 1
    assert "arrival_time_s holds dates in" in done.err
