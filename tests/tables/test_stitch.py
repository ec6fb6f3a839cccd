"""Tracks over the seams of a recording that is tracked in parts."""

from functools import partial

import numpy as np
import polars as pl
import pytest

from tertia import simulate, tables
from tertia.sensors import Radar

RADARS = [
    Radar(
        place,
        range_sigma=50.0,
        azimuth_sigma=np.radians(0.08),
        scan_period=4.0,
        max_range=100e3,
        detection_probability=0.9,
        name=name,
    )
    for name, place in (("east", (30e3, 0.0)), ("west", (-30e3, 0.0)))
]
END, PART, OVERLAP = 900.0, 300.0, 120.0


@pytest.fixture(scope="module")
def plots():
    traffic = simulate.dense_traffic(12, area=(80e3, 80e3), duration=END, rng=5)
    seen = simulate.radar_plots(traffic, RADARS, clutter=5.0, rng=6).plots
    columns = {
        "time_s": seen.time,
        "sensor": ["east" if one == 0 else "west" for one in seen.sensor],
        "range_m": seen.range,
        "azimuth_deg": np.degrees(seen.azimuth),
        "height_m": seen.height,
    }
    table = pl.DataFrame(columns).fill_nan(None).sort("time_s", maintain_order=True)
    return table.with_row_index("plot")


track = partial(tables.track, sensors=RADARS, registration=False, n_threads=1)


def parts_of(plots, overlap=OVERLAP):
    return [
        plots.filter(pl.col("time_s").is_between(start - overlap, start + PART, closed="left"))
        for start in np.arange(0.0, END, PART)
    ]


@pytest.fixture(scope="module")
def whole(plots):
    """The tracks of one process."""
    return track(plots)


@pytest.fixture(scope="module")
def parts(plots):
    """The tracks of each part alone."""
    return [track(part) for part in parts_of(plots)]


def agreement(whole, found):
    """The share of rows with plots that are in the same tracks, and pairs of tracks."""
    both = whole.drop_nulls("plot").join(found.drop_nulls("plot"), on="plot", suffix="_found")
    pairs = both.group_by("track", "track_found").len().sort("len", descending=True)
    most = pairs.unique("track", keep="first", maintain_order=True)
    return most["len"].sum() / whole["plot"].count(), most


def test_parts_of_dask_give_the_tracks_of_one_process(plots, whole):
    dask = pytest.importorskip("dask")
    lazy = [dask.delayed(track)(part) for part in parts_of(plots)]
    computed = dask.compute(*lazy, scheduler="processes", num_workers=2)
    stitched = list(tables.stitch(computed))
    assert len(stitched) == 3
    # to the last bit in the first part, which begins as one process does
    both = stitched[0].drop_nulls("plot").join(whole, on="plot", suffix="_whole")
    assert both.height > 1000
    for name in ("track", "time_s", "east_m", "north_m", "east_sigma_m"):
        assert both[name].to_list() == both[f"{name}_whole"].to_list()
    found = pl.concat(stitched)
    assert found["plot"].drop_nulls().is_duplicated().sum() == 0
    share, pairs = agreement(whole, found)
    assert share > 0.99
    over = whole.group_by("track").agg(pl.col("time_s").min(), end=pl.col("time_s").max())
    long = over.filter((pl.col("time_s") < PART) & (pl.col("end") > 2 * PART))["track"]
    assert len(long) >= 10
    kept = pairs.filter(pl.col("track").is_in(long.implode()))
    assert kept["track_found"].n_unique() == len(long)


def test_numbers_of_tracks_are_unique_over_parts_without_overlap(plots):
    alone = [track(part) for part in parts_of(plots, overlap=0.0)]
    found = list(tables.stitch(alone))
    numbers = [set(part["track"]) for part in found]
    assert not numbers[0] & numbers[1]
    assert not numbers[1] & numbers[2]
    for part, own in zip(found, alone, strict=True):
        assert part.drop("track").equals(own.drop("track"))


def test_one_part_is_returned_as_it_is(plots):
    part = track(plots[:3000])
    (found,) = tables.stitch([part])
    assert found.equals(part)
    assert list(tables.stitch([])) == []


def test_a_part_without_tracks_is_no_seam(parts):
    found = pl.concat(tables.stitch([parts[0], parts[1].clear(), parts[2]]))
    assert set(found["track"].drop_nulls()) >= set(parts[0]["track"])


@pytest.mark.parametrize("kind", ["pandas", "pyarrow"])
def test_kinds_of_tables(parts, kind):
    pytest.importorskip(kind)
    expected = list(tables.stitch(parts))
    convert = pl.DataFrame.to_pandas if kind == "pandas" else pl.DataFrame.to_arrow
    for own, one in zip(tables.stitch([convert(part) for part in parts]), expected, strict=True):
        assert type(own).__module__.split(".")[0] == kind
        as_polars = pl.from_pandas(own) if kind == "pandas" else pl.from_arrow(own)
        assert as_polars["track"].to_list() == one["track"].to_list()
        np.testing.assert_array_equal(as_polars["east_m"], one["east_m"])


def test_dates_instead_of_seconds(plots):
    start = pl.datetime(2026, 1, 1, time_zone="UTC")
    dated = plots.with_columns(time_s=start + pl.duration(microseconds=pl.col("time_s") * 1e6))
    found, expected = (
        pl.concat(tables.stitch(track(part) for part in parts))
        for parts in (
            [dated[part["plot"][0] : part["plot"][-1] + 1] for part in parts_of(plots)],
            parts_of(plots),
        )
    )
    assert found["track"].to_list() == expected["track"].to_list()


def test_plots_that_are_not_numbered_are_refused(plots):
    parts = [track(part.drop("plot")) for part in parts_of(plots)]
    with pytest.raises(
        ValueError, match=r"plot \d+ of parts\[0\] and plot \d+ of parts\[1\] differ"
    ):
        list(tables.stitch(parts))


def test_parts_out_of_order_are_refused(parts):
    with pytest.raises(ValueError, match=r"parts\[1\] ends at 2.*must be in order of time"):
        list(tables.stitch(parts[1::-1]))


def test_tables_of_something_else_are_refused(plots):
    with pytest.raises(ValueError, match=r"parts\[0\] has no column track"):
        list(tables.stitch([plots]))
    with pytest.raises(TypeError, match="table is a dict"):
        list(tables.stitch([{"track": [1]}]))


def test_numbers_of_plots(plots, whole):
    numbered = track(plots.with_columns(pl.col("plot") + 10**9))
    assert (numbered["plot"] - 10**9).equals(whole["plot"].cast(pl.Int64))
    with pytest.raises(tables.RecordError, match="plot is 7; it must be a whole number"):
        track(plots.with_columns(plot=pl.lit(7)))
    with pytest.raises(tables.RecordError, match=r"plot is 0\.5"):
        track(plots.with_columns(pl.col("plot") + 0.5))
