"""Tables of pandas, Polars and pyarrow: the numbers of the library, in the kind that came."""

import pickle
from functools import partial

import numpy as np
import polars as pl
import polars.testing
import pytest
from places import EXAMPLES
from typer.testing import CliRunner

import tertia
from tertia import cli, fusion, kalman, screening, smoothing, tables
from tertia.geo import SystemPlane
from tertia.simulate import direction_finder
from tertia.tracker import Radar

pd = pytest.importorskip("pandas")
pa = pytest.importorskip("pyarrow")

KINDS = {
    "polars": lambda frame: frame,
    "pandas": lambda frame: frame.to_pandas(),
    "pyarrow": lambda frame: frame.to_arrow(compat_level=pl.CompatLevel.oldest()),
    "record batch": lambda frame: (
        frame.to_arrow(compat_level=pl.CompatLevel.oldest()).combine_chunks().to_batches()[0]
    ),
}
MODEL = {"alpha": 0.05, "acceleration_sigma": 0.003}


def bearing_table(counts=(60, 40, 4), missing=True):
    """Groups whose rows are mixed, one too short to be estimated."""
    parts = [
        pl.DataFrame(
            {
                "station": f"station {k}",
                "hour": k % 2,
                "azimuth_deg": direction_finder(n, bearing=359.0 + k, rng=k).theta,
            }
        )
        for k, n in enumerate(counts)
    ]
    table = pl.concat(parts).sample(fraction=1.0, shuffle=True, seed=1)
    if missing:
        there = pl.int_range(table.height, eager=True) != 7
        table = table.with_columns(pl.when(there).then("azimuth_deg").alias("azimuth_deg"))
    return table


def plot_table(targets=2, steps=50):
    rng = np.random.default_rng(3)
    time = np.arange(steps) * 2.0
    parts = []
    for target in range(targets):
        for sensor, sigma in (("north", 0.1), ("south", 0.3)):
            angle = 350.0 + 20 * target + 0.3 * time + sigma * rng.standard_normal(steps)
            parts.append(
                pl.DataFrame(
                    {"time_s": time, "sensor": sensor, "azimuth_deg": angle % 360.0}
                ).with_columns(target=pl.lit(target))
            )
    return pl.concat(parts).sample(fraction=0.9, shuffle=True, seed=2)


def position_table(targets=2, steps=40):
    rng = np.random.default_rng(4)
    time = 5.0 * np.arange(steps)
    parts = []
    for target in range(targets):
        truth = np.column_stack([100.0 * time, 2000.0 * np.sin(time / 60)])
        noise = 20.0 * rng.standard_normal((steps, 2))
        east, north = (truth + noise).T
        parts.append(
            pl.DataFrame(
                {"time_s": time, "east_m": east, "north_m": north, "s_m": 20.0 + target}
            ).with_columns(target=pl.lit(f"t{target}"))
        )
    table = pl.concat(parts).sample(fraction=1.0, shuffle=True, seed=5)
    return table.with_columns(north_m=pl.when(pl.int_range(pl.len()) != 11).then("north_m"))


def as_polars(table):
    if isinstance(table, pl.DataFrame):
        return table
    if isinstance(table, pd.DataFrame):
        return pl.from_pandas(table)
    return pl.from_arrow(table)


CALLS = {
    "bearings": (bearing_table, partial(tables.bearing, by=["station", "hour"])),
    "screen": (
        bearing_table,
        partial(tables.screen, values="azimuth_deg", by="station", period=360.0),
    ),
    "fuse": (plot_table, partial(tables.fuse_series, by="target", sigma=0.2, **MODEL)),
    "smooth": (position_table, partial(tables.smooth, by="target", sigma=20.0)),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", CALLS)
class TestEveryFunction:
    def test_returns_the_same_in_the_kind_that_came(self, name, kind):
        make, call = CALLS[name]
        table = KINDS[kind](make())
        found = call(table)
        assert type(found) is type(table)
        polars.testing.assert_frame_equal(
            as_polars(found), call(make()), check_dtypes=False, check_exact=True
        )

    def test_types_do_not_depend_on_what_is_missing_or_there_at_all(self, name, kind):
        make, call = CALLS[name]
        whole = make()
        options = {"sensors": ["north", "south"]} if name == "fuse" else {}
        full, none = (
            call(KINDS[kind](whole), **options),
            call(
                KINDS[kind](whole.head(3))[:0] if kind != "pandas" else whole.to_pandas().iloc[:0],
                **options,
            ),
        )
        assert len(as_polars(none)) == 0
        if kind == "pandas":
            assert none.dtypes.to_dict() == full.dtypes.to_dict()
        else:
            assert none.schema == full.schema

    def test_columns_of_the_table_keep_their_types(self, name, kind):
        make, call = CALLS[name]
        table = KINDS[kind](make())
        found = call(table)
        if kind == "pandas":
            before, after = table.dtypes.to_dict(), found.dtypes.to_dict()
        else:
            pairs = [(t.schema.names if kind != "polars" else t.columns, t) for t in (table, found)]
            before, after = (
                {n: t.schema.field(n).type if kind != "polars" else t.schema[n] for n in names}
                for names, t in pairs
            )
        shared = set(before) & set(after) - {"azimuth_deg"}
        assert shared
        assert {n: before[n] for n in shared} == {n: after[n] for n in shared}


class TestBearings:
    def test_numbers_are_those_of_the_library(self):
        table = bearing_table()
        for row in tables.bearing(table, by="station").rows(named=True):
            theta = table.filter(station=row["station"])["azimuth_deg"]
            assert row["missing"] == theta.null_count()
            if row["station"] == "station 2":
                assert (
                    row["azimuth_deg"] is row["azimuth_sigma_deg"] is row["outlier_count"] is None
                )
                assert row["note"] == "theta has 4 measurements; at least 5 are needed"
                continue
            expected = tertia.estimate_bearing(theta.drop_nulls())
            assert (
                row["azimuth_deg"],
                row["azimuth_sigma_deg"],
                row["polarity"],
                row["outlier_count"],
                row["note"],
            ) == (
                expected.value,
                expected.sigma,
                expected.polarity,
                expected.outlier.sum(),
                None,
            )

    def test_a_sample_that_cannot_be_estimated_leaves_others_of_its_length_alone(self):
        fine = direction_finder(30, bearing=10.0, rng=1).theta
        table = pl.DataFrame({"g": ["a"] * 30 + ["b"] * 30, "y": [*fine, *[1e200, -1e200] * 15]})
        found = tables.bearing(table, values="y", by="g", period=None, method="mean")
        assert found["y"][0] == tertia.estimate_bearing(fine, method="mean", period=None).value
        assert found["note"][0] is None
        assert "theta" in found["note"][1]

    def test_is_what_the_command_writes(self, tmp_path):
        path, output = EXAMPLES / "bearings.csv", tmp_path / "out.parquet"
        words = ["bearing", path, "--by", "target", "--output", output]
        assert CliRunner().invoke(cli.app, [str(w) for w in words]).exit_code == 0
        found = tables.bearing(pl.read_csv(path), by="target")
        polars.testing.assert_frame_equal(found, pl.read_parquet(output), check_exact=True)

    def test_a_column_of_sigmas_counts_in_groups_that_have_them_all(self):
        theta = [10.0, 13.0, None, 40.0, 41.0, 42.0, 43.0, 44.0, 80.0]
        table = pl.DataFrame(
            {
                "sensor": ["A"] * 3 + ["B"] * 5 + ["C"],
                "azimuth_deg": theta,
                "azimuth_sigma_deg": [2.0, 3.0, None, 1.0, None, 1.0, 1.0, 1.0, 4.0],
                "s": [1.0] * 9,
            }
        )
        found = tables.bearing(table, by="sensor")
        of_two = tertia.estimate_bearing([10.0, 13.0], sigma=[2.0, 3.0])
        assert found.row(0)[:5] == ("A", 2, 1, of_two.value, of_two.sigma)
        assert found["azimuth_sigma_deg"][1] == tertia.estimate_bearing(theta[3:8]).sigma
        assert found["azimuth_sigma_deg"][2] == 4.0
        # another name, one number for all, and methods that take none
        named = tables.bearing(table, by="sensor", columns={"azimuth_sigma_deg": "s"})
        given = tables.bearing(table, by="sensor", sigma=1.0)
        polars.testing.assert_frame_equal(named, given)
        assert given["azimuth_sigma_deg"].null_count() == 0
        mean = tables.bearing(table, by="sensor", method="mean")
        polars.testing.assert_frame_equal(
            mean, tables.bearing(table.drop("azimuth_sigma_deg"), by="sensor", method="mean")
        )
        negative = table.with_columns(azimuth_sigma_deg=-pl.col("azimuth_sigma_deg"))
        with pytest.raises(tables.RecordError, match="azimuth_sigma_deg"):
            tables.bearing(negative, by="sensor")

    def test_without_groups_there_is_one_row(self):
        theta = direction_finder(50, bearing=10.0, rng=1).theta
        (row,) = tables.bearing(pl.DataFrame({"azimuth_deg": theta})).rows(named=True)
        assert row["azimuth_deg"] == tertia.estimate_bearing(theta).value

    @pytest.mark.parametrize(
        ("column", "options", "error", "message"),
        [
            ("az", {}, ValueError, "no column az; it has station, hour, azimuth_deg"),
            ("azimuth_deg", {"by": "count"}, ValueError, "cannot group by count"),
            ("station", {}, ValueError, "station is 'station .*'; it must be a finite number"),
            ("azimuth_deg", {"method": "best"}, ValueError, "method"),
            ("azimuth_deg", {"n_threads": 0}, ValueError, "n_threads"),
        ],
    )
    def test_mistakes(self, column, options, error, message):
        with pytest.raises(error, match=message):
            tables.bearing(bearing_table(), values=column, **options)

    def test_infinity_is_an_error_with_its_row(self):
        table = pl.DataFrame({"azimuth_deg": [1.0, 2.0, np.inf, 3.0]})
        with pytest.raises(ValueError, match="row 2: azimuth_deg is inf; it must be a finite"):
            tables.bearing(table)


@pytest.mark.parametrize("table", [[1.0, 2.0], np.ones(3), {"azimuth_deg": [1.0]}])
def test_what_is_no_table_is_refused(table):
    with pytest.raises(TypeError, match="it must be a DataFrame of Polars or pandas"):
        tables.bearing(table)


def test_a_lazy_frame_is_to_be_collected():
    with pytest.raises(TypeError, match=r"LazyFrame.* collect it first"):
        tables.bearing(bearing_table().lazy())


class TestScreen:
    @pytest.mark.parametrize(
        ("rule", "function"),
        [
            ("bursts", screening.bursts),
            ("leave-one-out", screening.leave_one_out),
            ("k-sigma", screening.k_sigma),
        ],
    )
    def test_masks_are_those_of_the_library(self, rule, function):
        table = bearing_table()
        found = tables.screen(table, values="azimuth_deg", by="station", rule=rule, period=360.0)
        assert found.columns == [*table.columns, "outlier"]
        polars.testing.assert_frame_equal(found.drop("outlier"), table)
        assert found.filter(pl.col("azimuth_deg").is_null())["outlier"].to_list() == [None]
        for name in ("station 0", "station 1"):
            own = found.filter(pl.col("azimuth_deg").is_not_null(), station=name)
            expected = function(screening.unwrap_about_median(own["azimuth_deg"])).outlier
            assert own["outlier"].to_list() == expected.tolist()
            assert expected.any()

    def test_a_sample_too_small_to_judge_is_not_judged(self):
        table = pl.DataFrame({"g": ["a", "a", "b", "b", "b"], "y": [1.0, 9.0, 1.0, 1.1, 9.0]})
        found = tables.screen(table, values="y", by="g", rule="leave-one-out", name="bad")
        assert found["bad"].to_list() == [None, None, False, False, True]

    def test_the_index_of_pandas_is_kept(self):
        table = bearing_table().to_pandas().set_index(pd.Index(range(1000, 1104), name="id"))
        found = tables.screen(table, values="azimuth_deg", by="station")
        assert found.index.equals(table.index)
        assert found["outlier"].dtype == pd.BooleanDtype()

    def test_a_column_is_not_overwritten(self):
        with pytest.raises(ValueError, match="already has a column station"):
            tables.screen(bearing_table(), values="azimuth_deg", name="station")

    def test_an_unknown_rule_or_option(self):
        with pytest.raises(ValueError, match="rule is 'grubbs'; it must be one of bursts"):
            tables.screen(bearing_table(), values="azimuth_deg", rule="grubbs")
        with pytest.raises(ValueError, match="min_burst"):
            tables.screen(bearing_table(), values="azimuth_deg", min_burst=1)


class TestFuse:
    def test_numbers_are_those_of_the_library(self):
        table = plot_table()
        found = tables.fuse_series(table, by="target", sigma={"north": 0.1, "south": 0.3}, **MODEL)
        for target in range(2):
            own = table.filter(target=target)
            times = np.unique(own["time_s"])
            z = np.full((2, len(times)), np.nan)
            for time, sensor, angle in own.select("time_s", "sensor", "azimuth_deg").iter_rows():
                z[int(sensor == "south"), np.searchsorted(times, time)] = angle
            expected = fusion.fuse_series(
                z,
                np.array([[0.01], [0.09]]),
                kalman.SingerModel(1.0, **MODEL, exact=True),
                time=times,
                period=360.0,
            )
            track = found.filter(target=target)
            assert track["time_s"].to_list() == times.tolist()
            assert track["azimuth_deg"].to_numpy() == pytest.approx(expected.mean[:, 0], abs=1e-12)
            weight = track["weight_south"].to_numpy()
            assert weight == pytest.approx(expected.weights[1, :, 0], nan_ok=True, abs=1e-12)

    def test_is_what_the_command_writes(self, tmp_path):
        path, output = EXAMPLES / "radars.csv", tmp_path / "out.parquet"
        words = ["fuse-series", path, "--output", output]
        assert CliRunner().invoke(cli.app, [str(w) for w in words]).exit_code == 0
        found = tables.fuse_series(pl.read_csv(path))
        polars.testing.assert_frame_equal(found, pl.read_parquet(output), check_exact=True)

    def test_a_column_of_sigmas_and_dates(self):
        table = plot_table().with_columns(
            azimuth_sigma_deg=0.2, time_s=pl.datetime(2024, 1, 1) + pl.duration(seconds="time_s")
        )
        found = tables.fuse_series(table, by="target", **MODEL)
        plain = tables.fuse_series(plot_table(), by="target", sigma=0.2, **MODEL)
        polars.testing.assert_frame_equal(found.drop("time_s"), plain.drop("time_s"))
        assert found.schema["time_s"] == table.schema["time_s"]

    def test_parts_have_the_columns_of_all_sensors(self):
        table = plot_table().filter(sensor="north")
        found = tables.fuse_series(
            table, by="target", sigma=0.2, sensors=["north", "south"], **MODEL
        )
        assert found["weight_south"].null_count() == found.height
        with pytest.raises(
            ValueError, match="there are plots of sensor north; the sensors are south"
        ):
            tables.fuse_series(table, by="target", sigma=0.2, sensors=["south"], **MODEL)

    @pytest.mark.parametrize(
        ("change", "options", "message"),
        [
            ({"sensor": None}, {}, "row 0: sensor is missing"),
            ({"time_s": None}, {}, r"row 0: time_s is missing \(5 such rows\)"),
            (
                {"time_s": 1.0},
                {},
                "row 1: south has two plots at 1.0: if there are several targets, group the rows "
                "by a column",
            ),
            ({}, {"sigma": -1.0}, "sigma is -1.0; it must be a positive number"),
            ({}, {"sigma": {"north": 0.0}}, "sigma of north is 0.0"),
            ({}, {"columns": {"time_s": "azimuth_deg"}}, "azimuth_deg is given for two purposes"),
            ({}, {"sigma": None}, "the noise of .* give the sigma of"),
        ],
    )
    def test_mistakes(self, change, options, message):
        table = plot_table(1).head(5)
        table = table.with_columns(
            pl.lit(value, table.schema[name]).alias(name) for name, value in change.items()
        )
        with pytest.raises(ValueError, match=message):
            tables.fuse_series(table, **{"sigma": 0.2, **MODEL, **options})


class TestSmooth:
    def test_numbers_are_those_of_the_library(self):
        table = position_table()
        found = tables.smooth(table, sigma=["s_m", 30.0], by="target")
        polars.testing.assert_frame_equal(found.select(table.columns), table)
        for target in ("t0", "t1"):
            own = found.filter(target=target).sort("time_s")
            variance = np.column_stack([own["s_m"].to_numpy(), np.full(own.height, 30.0)]) ** 2
            y = own.select("east_m", "north_m").to_numpy()
            expected = smoothing.smooth(y, variance, time=own["time_s"])
            pairs = [
                (f"{a}_{q}", unit)
                for q, unit in (("smoothed", "m"), ("rate", "m_s"), ("acceleration", "m_s2"))
                for a in ("east", "north")
            ]
            mean = own.select(f"{name}_{unit}" for name, unit in pairs).to_numpy()
            sigma = own.select(f"{name}_sigma_{unit}" for name, unit in pairs).to_numpy()
            np.testing.assert_allclose(mean, expected.mean, rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(sigma, expected.sigma, rtol=1e-9)

    @pytest.mark.parametrize("form", ["components", "speed and course", "knots", "named"])
    def test_velocities(self, form):
        random = np.random.default_rng(4)
        time = np.arange(50.0)
        position = np.column_stack([100 * time, 30 * time]) + 10 * random.normal(size=(50, 2))
        velocity = np.array([100.0, 30.0]) + 0.5 * random.normal(size=(50, 2))
        velocity[7] = np.nan
        expected = smoothing.smooth(
            position, 100.0, time=time, velocity=velocity, velocity_covariance=0.25
        )
        table = pl.DataFrame({"time_s": time, "east_m": position[:, 0], "north_m": position[:, 1]})
        east, north = velocity.T
        speed, course = np.hypot(east, north), np.degrees(np.arctan2(east, north))
        columns = {
            "components": {"velocity_east_m_s": east, "velocity_north_m_s": north},
            "speed and course": {"speed_m_s": speed, "course_deg": course},
            "knots": {"speed_kt": speed * 3600 / 1852, "course_deg": course},
            "named": {"vx": east, "vy": north},
        }[form]
        table = table.with_columns(**columns)
        names = {"velocities": ["vx", "vy"]} if form == "named" else {}
        found = tables.smooth(table, sigma=10.0, velocity_sigma=[0.5, 0.5], **names)
        np.testing.assert_allclose(found["east_rate_m_s"], expected.velocity[:, 0], rtol=1e-9)
        np.testing.assert_allclose(found["north_smoothed_sigma_m"], expected.sigma[:, 1], rtol=1e-6)
        plain = tables.smooth(table, sigma=10.0)
        assert "smoothing_velocity_outlier" not in plain.columns
        assert plain["east_rate_sigma_m_s"][25] > 2 * found["east_rate_sigma_m_s"][25]

    def test_rows_before_the_first_fix(self):
        """Receivers write zeros until they have a fix."""
        random, time = np.random.default_rng(3), np.arange(100.0)
        plane = SystemPlane(47.0, 8.0)
        way = np.column_stack([15.0 * time, 5.0 * time]) + random.normal(0.0, 5.0, (100, 2))
        latitude, longitude, _ = plane.to_geodetic(np.column_stack([way, 0.0 * time]))
        table = pl.DataFrame({"time_s": time, "latitude_deg": latitude, "longitude_deg": longitude})
        zero = pl.int_range(pl.len()) < 3
        places = ["latitude_deg", "longitude_deg"]
        with pytest.warns(tables.RecordWarning, match="3 rows have the latitude 0"):
            found = tables.smooth(
                table.with_columns(pl.when(~zero).then(pl.col(places)).otherwise(0.0)), sigma=5.0
            )
        missing = table.with_columns(pl.when(~zero).then(pl.col(places)))
        expected = tables.smooth(missing, sigma=5.0)
        added = [name for name in found.columns if name not in table.columns]
        pl.testing.assert_frame_equal(found.select(added), expected.select(added))

    def test_sigmas_of_true_north(self):
        """Far from the first position, an ellipse along the parallel is not along east."""
        plane, time = SystemPlane(65.0, 10.0), np.arange(50.0)
        way = np.column_stack([20e3 * time, 0 * time, 0 * time])
        latitude, longitude, _ = plane.to_geodetic(way)
        scale, convergence = (np.asarray(one) for one in plane.scale_and_convergence(way))
        assert abs(convergence[-1]) > 0.25
        table = pl.DataFrame({"time_s": time, "latitude_deg": latitude, "longitude_deg": longitude})
        table = table.with_columns(east_sigma_m=pl.lit(2000.0), north_sigma_m=pl.lit(200.0))
        own = {"jerk": 1e-3, "robust": False}
        found = tables.smooth(table, sigma=["east_sigma_m", "north_sigma_m"], **own)
        sine, cosine = np.sin(convergence), np.cos(convergence)
        turn = np.moveaxis(np.array([[cosine, sine], [-sine, cosine]]) * scale, -1, 0)
        spread = turn @ np.diag([2000.0**2, 200.0**2]) @ turn.swapaxes(1, 2)
        expected = smoothing.smooth(
            way[:, :2], 0.5 * (spread + spread.swapaxes(1, 2)), time=time, **own
        )
        for name, k in (("east", 0), ("north", 1)):
            np.testing.assert_allclose(
                found[f"{name}_smoothed_sigma_m"], expected.sigma[:, k], rtol=1e-6
            )

    def test_velocities_of_true_north(self):
        """Far from the first position, north of the plane is not true north."""
        plane, time = SystemPlane(50.0, 14.0), np.arange(40.0)
        way = np.column_stack([400e3 + 200.0 * time, 0 * time, 0 * time])
        way[0] = 0.0
        latitude, longitude, _ = plane.to_geodetic(way)
        scale, convergence = plane.scale_and_convergence(way)
        course = np.degrees(np.pi / 2 - np.asarray(convergence))
        table = pl.DataFrame(
            {
                "time_s": 2000.0 + time,
                "latitude_deg": latitude,
                "longitude_deg": longitude,
                "speed_m_s": 200.0 / np.asarray(scale),
                "course_deg": course,
            }
        )
        table = table.with_columns(time_s=pl.when(pl.int_range(pl.len()) > 0).then("time_s"))
        table = table.with_columns(time_s=pl.col("time_s").fill_null(0.0))
        found = tables.smooth(table, sigma=5.0, velocity_sigma=0.1, jerk=1e-6)
        assert not found["smoothing_velocity_outlier"][1:].any()
        speed = np.hypot(found["east_rate_m_s"], found["north_rate_m_s"])[5:]
        np.testing.assert_allclose(speed, table["speed_m_s"][5:], atol=0.2)
        true = np.degrees(np.arctan2(found["east_rate_m_s"], found["north_rate_m_s"]))[5:]
        np.testing.assert_allclose(true, course[5:], atol=0.02)

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({}, "there are no velocities: velocity_east_m_s and velocity_north_m_s, or speed_m_s"),
            ({"velocities": ["vx"]}, "velocities has 1 elements; there are 2 columns"),
            ({"velocities": ["vx", "vy"]}, "vx"),
            ({"velocity_sigma": [1.0]}, "velocity_sigma has 1 elements"),
            ({"values": "east_m"}, "velocities must name the columns"),
        ],
    )
    def test_mistakes_with_velocities(self, options, message):
        with pytest.raises(ValueError, match=message):
            tables.smooth(position_table(), **({"sigma": 20.0, "velocity_sigma": 1.0} | options))

    def test_what_is_not_known_is_null(self):
        table = pl.DataFrame({"time_s": [0.0, 1.0], "east_m": [1.0, 2.0]})
        found = tables.smooth(table, values="east_m", sigma=1.0, jerk=0.0)
        assert found["east_acceleration_m_s2"].to_list() == [None, None]
        assert found["east_smoothed_m"].is_not_null().all()

    def test_mistakes(self):
        with pytest.raises(ValueError, match="sigma has 1 elements; there are 2 columns"):
            tables.smooth(position_table(), sigma=[1.0])
        with pytest.raises(ValueError, match=r"sigma is 0.0; it must be a positive number"):
            tables.smooth(position_table(), sigma=0.0)


RADARS = [
    Radar(
        (0.0, 0.0, 120.0),
        range_sigma=50.0,
        azimuth_sigma=np.radians(0.08),
        scan_period=4.0,
        name="west",
    )
]


class TestTrack:
    @pytest.mark.parametrize("kind", KINDS)
    def test_is_what_the_command_writes(self, kind, tmp_path):
        path, output = tmp_path / "plots.csv", tmp_path / "out.parquet"
        plots = pl.read_csv(EXAMPLES / "air_plots.csv").filter(
            pl.col("sensor") == "west", pl.col("time_s") < 120
        )
        plots.write_csv(path)
        radars = tmp_path / "radars.csv"
        radars.write_text(
            "name,east_m,north_m,up_m,range_sigma_m,azimuth_sigma_deg,scan_period_s\n"
            "west,0,0,120,50,0.08,4\n"
        )
        words = ["track", path, "--sensors", radars, "--output", output]
        assert CliRunner().invoke(cli.app, [str(w) for w in words]).exit_code == 0
        found = as_polars(tables.track(KINDS[kind](plots), sensors=RADARS))
        assert found.height > 100
        expected = pl.read_parquet(output)
        polars.testing.assert_frame_equal(found, expected, check_exact=True, check_dtypes=False)

    def test_nothing_in_nothing_out(self):
        plots = pl.read_csv(EXAMPLES / "air_plots.csv").head(0)
        assert tables.track(plots, sensors=RADARS).height == 0

    @pytest.mark.parametrize(
        ("change", "options", "message"),
        [
            ({"sensor": "east"}, {}, "row 0: sensor is 'east'; the sensors are west"),
            ({"mode_3a": 9}, {}, "row 0: mode_3a is '9'; it must be octal digits"),
            ({}, {"columns": {"range": "r"}}, "columns has 'range'; it must be one of time_s"),
            ({}, {"columns": {"time_s": "t"}}, "the table has no column t"),
        ],
    )
    def test_mistakes(self, change, options, message):
        plots = pl.read_csv(EXAMPLES / "air_plots.csv").filter(sensor="west").head(5)
        plots = plots.with_columns(pl.lit(v).alias(n) for n, v in change.items())
        with pytest.raises(ValueError, match=message):
            tables.track(plots, sensors=RADARS, **options)

    def test_a_table_without_ranges(self):
        with pytest.raises(ValueError, match="no column range_m or range_nm"):
            tables.track(pl.DataFrame({"time_s": [0.0], "azimuth_deg": [0.0]}), sensors=RADARS)


class TestStream:
    TABLE = bearing_table((60, 40, 33, 5, 5)).sort("station")

    @pytest.mark.parametrize("kind", KINDS)
    @pytest.mark.parametrize("size", [1, 7, 45, 1000])
    def test_batches_of_any_size_give_the_same(self, kind, size):
        batches = [KINDS[kind](part) for part in self.TABLE.iter_slices(size)]
        found = list(tables.stream(tables.bearing, batches, by="station"))
        assert all(type(one) is type(batches[0]) for one in found)
        polars.testing.assert_frame_equal(
            pl.concat(map(as_polars, found)),
            tables.bearing(self.TABLE, by="station"),
            check_exact=True,
            check_dtypes=False,
        )

    def test_rows_come_back_in_their_order(self):
        call = partial(tables.stream, tables.screen, values="azimuth_deg", by="station")
        found = pl.concat(call(self.TABLE.iter_slices(9)))
        expected = tables.screen(self.TABLE, values="azimuth_deg", by="station")
        polars.testing.assert_frame_equal(found, expected)

    @pytest.mark.parametrize("size", [1, 3, 100])
    def test_a_group_that_comes_again_is_an_error(self, size):
        table = pl.DataFrame({"g": [1, 1, 2, 1], "azimuth_deg": [1.0] * 4})
        with pytest.raises(ValueError, match=r"group \(1,\) are not consecutive"):
            list(tables.stream(tables.bearing, table.iter_slices(size), by="g"))

    def test_without_groups_all_batches_are_one(self):
        (found,) = tables.stream(tables.bearing, self.TABLE.iter_slices(10))
        polars.testing.assert_frame_equal(found, tables.bearing(self.TABLE))

    def test_empty_batches(self):
        batches = [self.TABLE[:0], self.TABLE[:50], self.TABLE[:0], self.TABLE[50:]]
        found = pl.concat(tables.stream(tables.bearing, batches, by="station"))
        polars.testing.assert_frame_equal(found, tables.bearing(self.TABLE, by="station"))
        assert list(tables.stream(tables.bearing, [self.TABLE[:0]], by="station")) == []

    def test_is_what_map_in_arrow_of_spark_calls(self):
        """A function of an iterator of record batches, which is sent to other processes."""
        call = partial(tables.stream, tables.bearing, values="azimuth_deg", by="station")
        call = pickle.loads(pickle.dumps(call))
        batches = KINDS["pyarrow"](self.TABLE).to_batches(max_chunksize=11)
        found = list(call(iter(batches)))
        assert all(isinstance(batch, pa.RecordBatch) for batch in found)
        empty = tables.bearing(batches[0][:0], by="station")
        assert {batch.schema for batch in found} == {empty.schema}


@pytest.mark.parametrize("name", CALLS)
def test_partitions_of_dask_give_the_same_as_one_process(name):
    dask = pytest.importorskip("dask")
    dataframe = pytest.importorskip("dask.dataframe")
    make, call = CALLS[name]
    key = call.keywords["by"] if name != "bearings" else "station"
    table = make()
    options = {"sensors": ["north", "south"]} if name == "fuse" else {}
    expected = call(table.to_pandas(), **options)
    whole = dataframe.from_pandas(table.to_pandas(), npartitions=1)
    parts = whole.shuffle(key, npartitions=3)
    # what Dask makes up to see the types is no recording that could be fused
    meta = {"meta": call(parts._meta, **options)} if name == "fuse" else {}
    with dask.config.set(scheduler="synchronous"):
        mapped = parts.map_partitions(call, **meta, **options)
        lengths = mapped.map_partitions(len).compute()
        found = mapped.compute()
    assert np.count_nonzero(lengths) > 1
    assert found.dtypes.to_dict() == mapped._meta.dtypes.to_dict()
    order = list(found.columns)
    polars.testing.assert_frame_equal(
        pl.from_pandas(found.sort_values(order)),
        pl.from_pandas(expected.sort_values(order)),
        check_exact=name != "smooth",
        rel_tol=1e-9,
    )


def test_no_confirmed_track_is_said():
    radar = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0)
    time = np.arange(0.0, 100.0, 4.0)
    plots = pl.DataFrame({"time_s": time, "range_m": 5e5 + 7e3 * time, "azimuth_deg": 30.0})
    with pytest.warns(tables.RecordWarning, match="no track was confirmed: .* max_speed"):
        found = tables.track(plots, sensors=[radar])
    assert found.is_empty()
    assert len(tables.track(plots, sensors=[radar], max_speed=8e3))
