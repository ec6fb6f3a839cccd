"""Times of day across midnight, local times, and days of spreadsheets."""

import datetime as dt
import warnings

import numpy as np
import polars as pl
import pytest

from tertia import tables

DAY = 86_400.0
STATIONS = pl.DataFrame(
    {"name": ["a", "b"], "east_m": [0.0, 5e3], "north_m": 0.0, "azimuth_sigma_deg": 1.0}
)


def text_of(seconds: np.ndarray) -> list[str]:
    """Return times of day as text."""
    start = dt.datetime(2026, 1, 1)
    return [(start + dt.timedelta(seconds=float(one))).strftime("%H:%M:%S") for one in seconds]


def seen(times: list[object]) -> pl.DataFrame:
    """Return rows of two stations that see a target at these times."""
    rows = {"time_s": times, "sensor": ["a"] * len(times), "azimuth_deg": 30.0}
    return pl.concat(
        [
            pl.DataFrame(rows),
            pl.DataFrame(rows | {"sensor": "b", "azimuth_deg": -30}).cast(
                {"azimuth_deg": pl.Float64}
            ),
        ]
    )


def times_of(table: pl.DataFrame) -> list[float]:
    return tables.locate(table, sensors=STATIONS)["time_s"].to_list()


def quietly(table: pl.DataFrame) -> list[float]:
    with warnings.catch_warnings():
        warnings.simplefilter("error", tables.RecordWarning)
        return times_of(table)


@pytest.mark.parametrize("begin", [80_000.0, 86_390.0, 60_000.0])
@pytest.mark.parametrize("shuffled", [False, True])
def test_night(begin: float, *, shuffled: bool) -> None:
    """The order of the rows does not matter if the recording is shorter than half a day."""
    true = begin + np.arange(0.0, 30_000.0, 500.0)
    table = seen(text_of(true))
    if shuffled:
        table = table.sample(fraction=1.0, shuffle=True, seed=3)
    with pytest.warns(tables.RecordWarning, match="counted on from 86400"):
        found = times_of(table)
    np.testing.assert_allclose(found, true)


def test_two_days_in_order_with_late_rows() -> None:
    """Rows may be late, also by hours if all times are near."""
    true = 50_000 + np.arange(0.0, 1.9 * DAY, 300.0)
    late = true + np.where(np.arange(len(true)) % 7 == 3, -700.0, 0.0)
    table = seen(text_of(late)).filter(pl.col("sensor") == "a")
    with pytest.warns(tables.RecordWarning, match="counted on from 86400"):
        found = times_of(table)
    np.testing.assert_allclose(found, np.sort(late))


def test_a_day_in_any_order_stays_one_day() -> None:
    true = np.arange(0.0, DAY, 700.0)
    table = seen(text_of(true)).sample(fraction=1.0, shuffle=True, seed=1)
    with pytest.warns(tables.RecordWarning, match="give times with dates"):
        found = times_of(table)
    np.testing.assert_allclose(found, true)


def test_columns_of_the_type_time() -> None:
    clock = [dt.time(23, 59, 58), dt.time(23, 59, 59), dt.time(0, 0, 1)]
    with pytest.warns(tables.RecordWarning, match="counted on from 86400"):
        found = times_of(seen(clock))
    assert found == [DAY - 2, DAY - 1, DAY + 1]


def test_one_day_and_numbers_are_left_alone() -> None:
    assert quietly(seen(["12:00:00", "23:59:59"])) == [43_200.0, DAY - 1]
    assert quietly(seen([80_000.0, 5.0])) == [5.0, 80_000.0]


def test_end_of_summer_time() -> None:
    dates = [dt.datetime(2024, 10, 27, 2, minute) for minute in (50, 55, 59)]
    dates = [dt.datetime(2024, 10, 27, 1, 30), *dates]
    again = [dt.datetime(2024, 10, 27, 2, minute) for minute in (1, 5)]
    with pytest.warns(tables.RecordWarning, match="end of summer time"):
        times_of(seen(dates + again).filter(pl.col("sensor") == "a"))
    zoned = seen(dates + again).filter(pl.col("sensor") == "a")
    quietly(zoned.with_columns(pl.col("time_s").dt.replace_time_zone("UTC")))
    # the same times of two sensors, one after the other
    quietly(seen(dates))
    quietly(seen([dt.datetime(2024, 1, 1, 12) + dt.timedelta(minutes=k) for k in range(60)]))


def test_start_of_summer_time() -> None:
    """An hour of a night before Sunday is missing, and nothing else."""
    begin = dt.datetime(2026, 3, 29, 1, 30)
    dates = [begin + dt.timedelta(minutes=k + 60 * (k >= 30)) for k in range(60)]
    one = pl.col("sensor") == "a"
    with pytest.warns(tables.RecordWarning, match="start of summer time"):
        times_of(seen(dates).filter(one))
    with pytest.warns(tables.RecordWarning, match="start of summer time"):
        times_of(seen(dates[::-1]))
    quietly(seen(dates).with_columns(pl.col("time_s").dt.replace_time_zone("UTC")))
    # on another day, two hours, or from half past
    for later in (dt.timedelta(days=1), dt.timedelta(hours=9), dt.timedelta(minutes=30)):
        quietly(seen([one + later for one in dates]))
    quietly(seen([one for one in dates if one < dates[30] or one > dates[45]]))


def test_a_clock_that_is_set_back() -> None:
    """Only once, for all sensors, and not to where the recording begins."""
    true = np.arange(0.0, 200.0, 2.0)
    times = np.where(true < 120.0, true, true - 31.0)
    both = seen(times.tolist())
    mixed = both[[k + 100 * s for k in range(100) for s in range(2)]]
    with pytest.warns(tables.RecordWarning, match=r"goes back once, from 118 to 89:"):
        times_of(mixed)
    dated = mixed.with_columns(time_s=pl.from_epoch(pl.col("time_s") + 1e9, "s"))
    with pytest.warns(tables.RecordWarning, match="goes back once"):
        times_of(dated)
    # the rows of a second sensor come after those of the first one
    late = pl.concat([seen(true.tolist())[:100], seen((true + 50.0).tolist())[100:]])
    quietly(late)
    # messages are late, a second recording is added
    rng = np.random.default_rng(1)
    delayed = mixed.with_columns(time_s=rng.permutation(np.repeat(true, 2)))
    quietly(delayed.unique(["time_s", "sensor"], maintain_order=True))
    quietly(pl.concat([mixed[120:], mixed[:60].with_columns(pl.col("time_s") - 0.5)]))


def test_digits_of_the_time_of_day() -> None:
    """Numbers such as 123519 are no seconds."""

    def digits(seconds: np.ndarray) -> list[float]:
        minutes, rest = np.divmod(seconds, 60.0)
        hours, minutes = np.divmod(minutes, 60.0)
        return (10_000 * hours + 100 * minutes + rest).tolist()

    with pytest.warns(tables.RecordWarning, match="hhmmss"):
        times_of(seen(digits(45_319.0 + np.arange(0.0, 300.0, 4.0))))
    # seconds; every minute; less than three minutes
    quietly(seen((45_319.0 + np.arange(0.0, 300.0, 4.0)).tolist()))
    quietly(seen(np.arange(0.0, 6000.0, 50.0).tolist()))
    quietly(seen(digits(45_319.0 + np.arange(0.0, 100.0, 4.0))))
    # two recordings of half a minute
    quietly(seen([*np.arange(40.0), *np.arange(2000.0, 2040.0)]))


@pytest.mark.parametrize(
    ("start", "said"), [(45_231.5, "spreadsheets"), (2_460_434.5, "Julian dates")]
)
def test_days_of_spreadsheets_and_of_astronomers(start: float, said: str) -> None:
    days = start + np.arange(30) / DAY
    with pytest.warns(tables.RecordWarning, match=f"in days, as in {said}"):
        times_of(seen(days.tolist()))
    quietly(seen((start + np.arange(30.0)).tolist()))


@pytest.mark.parametrize(
    ("factor", "unit"), [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")]
)
def test_units_below_a_second(factor: float, unit: str) -> None:
    with pytest.warns(tables.RecordWarning, match=f"is it in {unit}"):
        times_of(seen((factor * (1.7638e9 + np.arange(30.0))).tolist()))
