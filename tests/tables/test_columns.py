"""Columns of pandas, Polars and pyarrow where an array is asked for; null is nan."""

import numpy as np
import polars as pl
import pytest

import tertia
from tertia import fusion, kalman, location, metrics, screening, smoothing, tables
from tertia.tracker import Plots, Radar, track

pd = pytest.importorskip("pandas")
pa = pytest.importorskip("pyarrow")

KINDS = {
    "pandas": pd.Series,
    "pandas, nullable": lambda v: pd.Series(v, dtype="Float64"),
    "pandas, nullable array": lambda v: pd.array(v, dtype="Float64"),
    "pandas, Arrow": lambda v: pd.Series(v, dtype=pd.ArrowDtype(pa.float64())),
    "pandas, objects": lambda v: pd.Series([pd.NA if x is None else x for x in v], dtype=object),
    "pandas, another index": lambda v: pd.Series(v, index=range(100, 100 + len(v))),
    "polars": pl.Series,
    "pyarrow": pa.array,
    "pyarrow, chunks": lambda v: pa.chunked_array([v[:5], v[5:]]),
}
WHOLE = {
    "pandas": pd.Series,
    "pandas, nullable": lambda v: pd.Series(v, dtype="Int64"),
    "pandas, Arrow": lambda v: pd.Series(v, dtype=pd.ArrowDtype(pa.int64())),
    "polars": pl.Series,
    "pyarrow": pa.array,
}
RECORD = tertia.simulate.direction_finder(40, bearing=359.0, rng=7).theta.round(2).tolist()
GAPS = [None if i in {3, 20} else v for i, v in enumerate(RECORD)]
TIMES = np.cumsum(np.linspace(0.5, 1.5, 40)).tolist()
MODEL = kalman.SingerModel(1.0, 0.05, 0.1, exact=True)
RADAR = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.1), scan_period=4.0)


def as_array(values):
    return np.array([np.nan if v is None else v for v in values])


CALLS = {
    "screening.leave_one_out": lambda y, t: screening.leave_one_out(y, nan_policy="omit").cleaned,
    "screening.bursts": lambda y, t: screening.bursts(y, nan_policy="omit").cleaned,
    "screening.k_sigma": lambda y, t: screening.k_sigma(y, nan_policy="omit").cleaned,
    "estimate_bearing": lambda y, t: tertia.estimate_bearing(y, nan_policy="omit").outlier,
    "kalman.filter_series": lambda y, t: (
        kalman.filter_series(y, 1.0, MODEL, time=t, period=360.0).mean
    ),
    "kalman.smooth_series": lambda y, t: (
        kalman.smooth_series(y, 1.0, MODEL, time=t, period=360.0).mean
    ),
    "smoothing.local_polynomial": lambda y, t: smoothing.local_polynomial(y, time=t).value,
    "fusion.fuse_series": lambda y, t: (
        fusion.fuse_series([y], 1.0, MODEL, time=t, period=360.0).mean
    ),
    "metrics.rmse": lambda y, t: metrics.rmse(y),
    "tracker": lambda y, t: (
        track(Plots(t, y, y, degrees=True), [RADAR], clutter_density=1e-9).track_of_plot
    ),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("call", CALLS)
def test_a_column_is_an_array_and_null_is_nan(call, kind):
    make = KINDS[kind]
    found = CALLS[call](make(GAPS), make(TIMES))
    assert np.array_equal(found, CALLS[call](as_array(GAPS), TIMES), equal_nan=True)


@pytest.mark.parametrize("kind", KINDS)
def test_null_is_an_error_where_nan_is(kind):
    for call in (screening.leave_one_out, screening.grubbs, screening.unwrap_about_median):
        with pytest.raises(ValueError, match=r"\[3\] is nan; every measurement must be a finite"):
            call(KINDS[kind](GAPS))
    with pytest.raises(ValueError, match=r"time\[3\] is nan; it must be a finite number"):
        kalman.filter_series(RECORD, 1.0, MODEL, time=KINDS[kind](GAPS))


@pytest.mark.parametrize(
    "frame",
    [
        pd.DataFrame({"a": GAPS, "b": RECORD}),
        pd.DataFrame({"a": pd.array(GAPS, dtype="Float64"), "b": RECORD}),
        pd.DataFrame({"a": GAPS, "b": RECORD}).convert_dtypes(dtype_backend="pyarrow"),
        pl.DataFrame({"a": GAPS, "b": RECORD}),
    ],
    ids=["pandas", "pandas, nullable", "pandas, Arrow", "polars"],
)
def test_a_frame_is_a_matrix(frame):
    matrix = np.column_stack([as_array(GAPS), RECORD])
    expected = smoothing.smooth(matrix, 4.0, jerk=0.01)
    found = smoothing.smooth(frame, 4.0, jerk=0.01)
    assert np.array_equal(found.mean, expected.mean)


@pytest.mark.parametrize("kind", WHOLE)
def test_columns_of_integers(kind):
    numbers = WHOLE[kind]([0, 1, 0])
    found = Plots([0.0, 1.0, 2.0], [1e4] * 3, [0.1] * 3, sensor=numbers, identity=numbers)
    assert found.sensor.tolist() == found.identity.tolist() == [0, 1, 0]
    with pytest.raises(TypeError, match=r"sensor .* it must"):
        Plots([0.0, 1.0], [1e4] * 2, [0.1] * 2, sensor=WHOLE[kind]([0, None]))


@pytest.mark.parametrize("kind", KINDS)
def test_estimates_and_covariances(kind):
    make = KINDS[kind]
    found = fusion.fuse_scalar(make([3.0, 4.0]), np.eye(2), make([0.6, 0.8]), 5.2, 0.1)
    expected = fusion.fuse_scalar([3.0, 4.0], np.eye(2), [0.6, 0.8], 5.2, 0.1)
    assert np.array_equal(found.mean, expected.mean)
    stations = [location.Station(p, azimuth_sigma=0.01) for p in ([0.0, 0.0], [1e3, 0.0])]
    here, there = (
        location.locate(stations, azimuth=azimuth) for azimuth in (make([0.5, -0.5]), [0.5, -0.5])
    )
    assert np.array_equal(here.position, there.position)


@pytest.mark.parametrize(
    "column",
    [
        pd.Series(["1.0", "2.0", "3.0"]),
        pd.Series(["1.0", None, "3.0"], dtype="string"),
        pd.Series([True, None, False], dtype="boolean"),
        pd.Series(pd.to_datetime(["2024-01-01"] * 3)),
        pd.Series([1.0, pd.NaT, 2.0], dtype=object),
        pl.Series(["1.0", "2.0", "3.0"]),
        pl.Series([True, None, False]),
        pl.Series([None] * 3, dtype=pl.Datetime),
        pa.array([True, None, False]),
    ],
    ids=lambda column: f"{type(column).__module__.split('.')[0]} {getattr(column, 'dtype', '')}",
)
def test_columns_of_anything_else_are_refused(column):
    with pytest.raises(TypeError, match=r"must (be a real number|hold real numbers)"):
        screening.leave_one_out(column, nan_policy="omit")


def test_objects_of_several_types_in_a_table() -> None:
    """The message names the first cell that is no number."""
    cells = [10.5, 11, "11.5", None, 12, 11.0]
    mixed = pd.DataFrame({"azimuth_deg": pd.Series(cells, dtype=object)})
    numbers = pd.DataFrame({"azimuth_deg": [10.5, 11.0, 11.5, None, 12.0, 11.0]})
    pd.testing.assert_frame_equal(tables.bearing(mixed), tables.bearing(numbers))
    mixed.iloc[4] = "about 12"
    with pytest.raises(tables.RecordError, match="row 4: azimuth_deg is 'about 12'; it must be"):
        tables.bearing(mixed)


@pytest.mark.parametrize("yes", [True, 1, 1.0, "TRUE", "1", "yes", "t", " True "])
def test_flags(yes: object) -> None:
    time = 4.0 * np.arange(30)
    rows = {"time_s": time, "east_m": 100.0 * time, "north_m": 0.0, "track": 1}
    tracks = pl.DataFrame(rows | {"confirmed": [yes] * 30}, strict=False)
    truth = pl.DataFrame(rows | {"target": 1})
    figures = tables.evaluate(tracks, truth, update_interval=4.0)
    assert figures.filter(pl.col("figure") == "missed targets")["value"].item() == 0.0


def test_what_is_no_flag() -> None:
    rows = {"time_s": [0.0, 4.0], "east_m": 0.0, "north_m": 0.0, "track": 1}
    tracks = pl.DataFrame(rows | {"confirmed": ["true", "maybe"]})
    with pytest.raises(tables.RecordError, match="row 1: confirmed is 'maybe'; it must be true"):
        tables.evaluate(tracks, pl.DataFrame(rows | {"target": 1}), update_interval=4.0)


@pytest.mark.parametrize(
    "time",
    [
        pd.Series(pd.to_datetime([0, None, 2], unit="s", utc=True)),
        pd.Series(["1970-01-01T00:00:00", None, "1970-01-01T00:00:02"], dtype="string"),
        [np.nan, pd.NaT, pd.Timestamp(2, unit="s")],
        [pd.NA, None, pd.Timestamp(2, unit="s", tz="Europe/Berlin")],
    ],
)
def test_missing_times(time: object) -> None:
    found = Plots(time, 1e3, 0.1).time
    assert np.isnan(found[1])
    assert found[2] == 2.0
