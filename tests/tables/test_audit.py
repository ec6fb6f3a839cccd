"""Audits of tables: the figures of the library, of every layout that is read."""

import json
import struct
from datetime import datetime

import numpy as np
import polars as pl
import pytest
import terminal
from checks import rng
from places import DATA
from reference import asterix as reference

from tertia import audit, tables
from tertia.tables import ColumnError, RecordError

STEPS = 300


def way(seconds=1.0):
    """A target that turns, from 0 s on."""
    time = seconds * np.arange(STEPS)
    return time, np.column_stack([900 * np.sin(time / 40), 900 * np.cos(time / 40)])


def positions(scale=1.0, columns=("east_m", "north_m")):
    time, place = way()
    error = scale * rng(3).multivariate_normal([0, 0], [[400.0, 120.0], [120.0, 225.0]], STEPS)
    found = pl.DataFrame({"time_s": time}).with_columns(
        pl.Series(columns[0], place[:, 0] + error[:, 0]),
        pl.Series(columns[1], place[:, 1] + error[:, 1]),
        east_sigma_m=pl.lit(20.0),
        north_sigma_m=pl.lit(15.0),
        covariance_east_north_m2=pl.lit(120.0),
    )
    return found, error


def truth(step=0.5):
    time = np.arange(-5.0, STEPS + 5.0, step)
    east, north = 900 * np.sin(time / 40), 900 * np.cos(time / 40)
    return pl.DataFrame({"time_s": time, "east_m": east, "north_m": north})


def on_the_earth(table):
    """Return the latitudes and longitudes of positions."""
    frame = pytest.importorskip("tertia.geo").LocalFrame(48.0, 11.0)
    place = np.column_stack([table["east_m"], table["north_m"], np.zeros(table.height)])
    latitude, longitude, _ = map(np.array, frame.to_geodetic(place))
    return latitude, longitude


def figure(found, name, probability=None):
    rows = found.filter(figure=name)
    rows = rows if probability is None else rows.filter(probability=probability)
    return rows.row(0, named=True)


class TestPositions:
    def test_are_those_of_the_library(self):
        table, error = positions()
        time, place = way()
        beside = table.with_columns(true_east_m=place[:, 0], true_north_m=place[:, 1])
        found = tables.audit(beside)
        expected = audit(error, [[400.0, 120.0], [120.0, 225.0]], time=time)
        row = figure(found, "coverage", 0.95)
        assert row["value"] == pytest.approx(expected.coverage[0.95].value)
        assert row["low"] == pytest.approx(expected.coverage[0.95].low)
        assert row["verdict"] == expected.coverage[0.95].verdict == "honest"

    def test_a_truth_of_its_own_times_is_interpolated(self):
        table, error = positions()
        found = tables.audit(table, truth())
        expected = audit(error, [[400.0, 120.0], [120.0, 225.0]])
        assert figure(found, "nees")["value"] == pytest.approx(expected.nees.value, rel=1e-2)
        assert figure(found, "time_offset")["verdict"] == "honest"

    def test_the_clock_of_the_truth(self):
        late = truth().with_columns(pl.col("time_s") - 2.0)
        row = figure(tables.audit(positions()[0], late), "time_offset")
        assert row["low"] < 2.0 < row["high"]

    def test_gaps_of_the_truth_are_not_bridged(self):
        table, _ = positions()
        gap = truth().filter(~pl.col("time_s").is_between(100.0, 150.0))
        with_gap = tables.audit(table, gap)
        assert figure(with_gap, "coverage", 0.95)["verdict"] == "honest"

    def test_sigmas_too_small(self):
        row = figure(tables.audit(positions(3.0)[0], truth()), "scale", 0.95)
        assert row["verdict"].startswith("too small by a factor of ")
        assert row["low"] < 9.0 < row["high"]

    def test_sigma_of_the_truth(self):
        table, _ = positions()
        noisy = truth().with_columns(
            pl.col("east_m") + 30 * pl.Series(rng(4).standard_normal(620)),
            pl.col("north_m") + 30 * pl.Series(rng(5).standard_normal(620)),
        )
        assert figure(tables.audit(table, noisy), "nees")["verdict"].startswith("too small")
        for told in (
            tables.audit(table, noisy, truth_sigma=30.0),
            tables.audit(table, noisy.with_columns(position_sigma_m=pl.lit(30.0))),
        ):
            assert figure(told, "nees")["verdict"] == "honest"

    def test_latitude_and_longitude(self):
        table, _ = positions()
        degrees = []
        for one in (table, truth()):
            latitude, longitude = on_the_earth(one)
            there = one.drop("east_m", "north_m")
            degrees.append(there.with_columns(latitude_deg=latitude, longitude_deg=longitude))
        expected = figure(tables.audit(table, truth()), "nees")["value"]
        found = figure(tables.audit(*degrees), "nees")["value"]
        assert found == pytest.approx(expected, rel=1e-3)
        one = figure(tables.audit(table, degrees[1], origin=(48.0, 11.0)), "nees")["value"]
        assert one == pytest.approx(expected, rel=1e-3)

    @pytest.mark.parametrize("far", [2.5e6, 19e6])
    def test_sigmas_beside_latitudes_are_of_true_north(self, far):
        geod = pytest.importorskip("pyproj").Geod(ellps="WGS84")
        random, count = np.random.default_rng(8), 400
        # from west to east, from 65 degrees north
        longitude, latitude, _ = geod.fwd(
            *(np.full(count, one) for one in (10.0, 65.0, 80.0)), np.linspace(0.0, far, count)
        )
        east, north = random.standard_normal((2, count)) * [[2000.0], [200.0]]
        seen = geod.fwd(
            longitude, latitude, np.degrees(np.arctan2(east, north)), np.hypot(east, north)
        )
        time = 3600.0 * np.arange(count)
        true = pl.DataFrame({"time_s": time, "latitude_deg": latitude, "longitude_deg": longitude})
        one = pl.DataFrame({"time_s": time, "latitude_deg": seen[1], "longitude_deg": seen[0]})
        one = one.with_columns(east_sigma_m=pl.lit(2000.0), north_sigma_m=pl.lit(200.0))
        expected = np.mean((east / 2000.0) ** 2 + (north / 200.0) ** 2) / 2
        options = {"max_distance": 20e3}
        for origin in (None, (65.0, 10.0)):
            found = figure(tables.audit(one, true, origin=origin, **options), "nees")
            assert found["value"] == pytest.approx(expected, rel=0.02)
        beside = one.with_columns(true_latitude_deg=latitude, true_longitude_deg=longitude)
        assert figure(tables.audit(beside), "nees")["value"] == pytest.approx(expected, rel=0.02)

    def test_heights_that_one_table_lacks(self):
        frame = pytest.importorskip("tertia.geo").LocalFrame(48.0, 11.0)
        table, _ = positions()
        degrees = []
        for one in (table, truth()):
            far = np.column_stack([one["east_m"] + 2e5 * (one["time_s"] > 150.0), one["north_m"]])
            latitude, longitude, _ = frame.to_geodetic(np.c_[far, np.zeros(one.height)])
            degrees.append(one.with_columns(latitude_deg=latitude, longitude_deg=longitude))
        there, true = (one.drop("east_m", "north_m") for one in degrees)
        high = there.with_columns(height_m=pl.lit(11_000.0))
        expected = figure(tables.audit(there, true), "nees")["value"]
        assert figure(tables.audit(high, true), "nees")["value"] == pytest.approx(expected)
        beside = high.with_columns(
            true_latitude_deg=pl.col("latitude_deg"), true_longitude_deg=pl.col("longitude_deg")
        )
        assert figure(tables.audit(beside), "nees")["value"] == pytest.approx(0.0, abs=1e-9)

    def two_tracks(self):
        """The same estimates twice, 5 km apart."""
        table, _ = positions()
        both = pl.concat([table.with_columns(track=pl.lit(k)) for k in (1, 2)])
        return both.with_columns(pl.col("east_m") + 5000.0 * (pl.col("track") - 1))

    def in_a_row(self, names, axis="east_m"):
        """Targets of these names on parallel paths, 5 km apart."""
        return pl.concat(
            [
                truth().with_columns(pl.col(axis) + 5000.0 * k, target=pl.lit(name))
                for k, name in enumerate(names)
            ]
        )

    def test_tracks_are_matched_to_targets_and_are_groups(self):
        targets = self.in_a_row(["AFR", "DLH"])
        found = tables.audit(self.two_tracks(), targets, max_distance=200.0)
        assert figure(found, "nees")["verdict"] == "honest"

    def test_numbers_of_tracks_that_are_those_of_other_targets(self):
        with pytest.warns(tables.RecordWarning, match="0% of the estimates are within 1000 m"):
            found = tables.audit(self.two_tracks(), self.in_a_row(range(3)))
        assert figure(found, "nees")["verdict"] == "honest"

    def test_names_are_believed_if_no_target_is_near(self):
        table, _ = positions()
        named = table.with_columns(pl.col("east_m") + 9000.0, track=pl.lit("AFR"))
        found = tables.audit(named, self.in_a_row(["AFR", "DLH"], "north_m"))
        assert figure(found, "nees")["verdict"].startswith("too small")

    def test_strata_and_groups(self):
        table, _ = positions()
        parts = table.with_columns(flight=np.arange(STEPS) // 20, half=np.arange(STEPS) // 150)
        found = tables.audit(parts, truth(), by="flight", strata=["half"])
        assert found["part"].unique(maintain_order=True).to_list() == ["all", "half 0", "half 1"]

    def test_yaps_and_traffic(self):
        table, _ = positions()
        expected = figure(tables.audit(table.drop("covariance_east_north_m2"), truth()), "nees")
        names = {"time_s": "top", "east_m": "x", "north_m": "y"}
        names |= {"east_sigma_m": "x_sd", "north_sigma_m": "y_sd"}
        yaps = table.drop("covariance_east_north_m2").rename(names)
        assert figure(tables.audit(yaps, truth()), "nees") == expected

    def test_flights_of_traffic(self):
        table, _ = positions()
        flights = []
        for one in (table, truth()):
            latitude, longitude = on_the_earth(one)
            moment = datetime(2024, 1, 1) + pl.Series(one["time_s"] * 1e6).cast(pl.Duration("us"))
            columns = {"timestamp": moment, "latitude": latitude, "longitude": longitude}
            flights.append(pl.DataFrame({"icao24": "4b1801", **columns}))
        smoothed = flights[0].with_columns(position_sigma_m=pl.lit(17.7))
        found = tables.audit(smoothed, flights[1])
        assert figure(found, "coverage", 0.95)["verdict"] == "honest"


class TestScalars:
    def test_degrees_wrap(self):
        true = rng(6).uniform(0, 360, 200)
        error = rng(7).normal(0, 4.0, 200)
        table = pl.DataFrame({"azimuth_deg": (true + error) % 360, "true_azimuth_deg": true})
        found = tables.audit(table.with_columns(azimuth_sigma_deg=pl.lit(2.0)), value="azimuth_deg")
        assert figure(found, "nees")["value"] == pytest.approx(np.mean(error**2) / 4)
        assert figure(found, "radius", 0.5)["unit"] == "deg"


class TestRefused:
    def test_without_a_truth(self):
        with pytest.raises(ColumnError, match="has no column true_east_m"):
            tables.audit(positions()[0])

    def test_without_sigmas(self):
        table = positions()[0].select("time_s", "east_m", "north_m")
        with pytest.raises(ColumnError, match="neither east_sigma_m and north_sigma_m nor"):
            tables.audit(table, truth())

    def test_another_frame(self):
        there = pl.DataFrame({"time_s": [0.0], "latitude_deg": [48.0], "longitude_deg": [11.0]})
        with pytest.raises(ValueError, match="give origin"):
            tables.audit(positions()[0], there)

    def test_another_time(self):
        with pytest.raises(RecordError, match=r"no estimate has both .* the times and the origins"):
            tables.audit(positions()[0], truth().with_columns(pl.col("time_s") + 1e6))

    def test_a_singular_covariance(self):
        table = positions()[0].with_columns(covariance_east_north_m2=pl.lit(300.0))
        with pytest.raises(RecordError, match=r"covariance\[0\] is not positive definite"):
            tables.audit(table, truth())

    def test_a_sigma_that_is_no_sigma(self):
        """Such as one that marks an unknown error."""
        table = positions()[0].with_columns(north_sigma_m=pl.lit(-9999.0))
        message = r"row 0: north_sigma_m is -9999; it must be positive \(\d+ such rows\)"
        with pytest.raises(RecordError, match=message):
            tables.audit(table, truth())
        there = truth().with_columns(target=pl.lit("a"))
        with pytest.raises(RecordError, match=message):
            tables.evaluate(table.with_columns(track=pl.lit(1)), there)

    def test_truth_sigma(self):
        with pytest.raises(ValueError, match=r"truth_sigma is -1"):
            tables.audit(positions()[0], truth(), truth_sigma=-1.0)


class TestCommand:
    def test_prints_and_writes(self, tmp_path):
        positions(2.0)[0].write_csv(tmp_path / "positions.csv")
        truth().write_csv(tmp_path / "truth.csv")
        arguments = (tmp_path / "positions.csv", "--truth", tmp_path / "truth.csv")
        done = terminal.succeed("audit", *arguments, "--plot", tmp_path / "a.png")
        assert "too small by a factor of" in done.out
        assert (tmp_path / "a.png").stat().st_size > 1000
        told = json.loads(terminal.succeed("audit", *arguments, "--json").out)
        assert told["count"] == STEPS
        written = terminal.result("audit", *arguments, folder=tmp_path)
        assert written.to_dicts() == told["figures"]

    def test_other_names_of_columns(self, tmp_path):
        table, _ = positions()
        table.write_csv(tmp_path / "positions.csv")
        truth().rename({"time_s": "ts", "east_m": "utm_x"}).write_csv(tmp_path / "gps.csv")
        names = ("--truth-column", "time_s=ts", "--truth-column", "east_m=utm_x")
        done = terminal.succeed(
            "audit", tmp_path / "positions.csv", "--truth", tmp_path / "gps.csv", *names
        )
        assert "honest" in done.out
        wrong = terminal.run(
            "audit", tmp_path / "positions.csv", "--truth", tmp_path / "gps.csv", *names[:2]
        )
        assert wrong.code != 0

    def test_accuracies_of_system_tracks(self, tmp_path):
        pytest.importorskip("pyproj")
        records, rows = [], []
        for k in range(60):
            place = (45.4 + 1e-3 * k, -15.1)
            off = rng(k).normal(0, 60.0 / 111e3)
            records.append(
                reference.record(
                    {
                        1: bytes([25, 100]),
                        4: reference.time_of_day(45_000.0 + k),
                        5: struct.pack(
                            ">ii", *(round(a / (180 / 2**25)) for a in (place[0] + off, place[1]))
                        ),
                        12: struct.pack(">H", 7),
                        27: b"\x80" + struct.pack(">HH", 2 * 30, 2 * 30),
                    }
                )
            )
            rows.append((45_000.0 + k, "7", *place))
        (tmp_path / "tracks.ast").write_bytes(reference.block(62, *records))
        schema = ["time_s", "target", "latitude_deg", "longitude_deg"]
        pl.DataFrame(rows, schema, orient="row").write_csv(tmp_path / "truth.csv")
        done = terminal.succeed(
            "audit", tmp_path / "tracks.ast", "--truth", tmp_path / "truth.csv", "--json"
        )
        told = json.loads(done.out)
        assert told["count"] == 60
        nees = next(row for row in told["figures"] if row["figure"] == "nees")
        # north is off by twice its sigma, east by nothing
        assert nees["value"] == pytest.approx(2.0, rel=0.4)


@pytest.mark.skipif(not (DATA / "ssu1").is_dir(), reason="no recordings")
def test_the_tracks_of_yaps_are_convicted():
    """Sigmas of 0.5 m, errors of 3 m; the clock of the boat's GPS is 3 s off."""
    found = tables.audit(
        pl.read_csv(DATA / "ssu1/yaps_track.csv"),
        pl.read_csv(DATA / "ssu1/gps.csv"),
        truth_columns={"time_s": "ts", "east_m": "utm_x", "north_m": "utm_y"},
    )
    inside = figure(found, "coverage", 0.95)
    assert inside["high"] < 0.6
    assert figure(found, "scale", 0.95)["verdict"].startswith("too small by a factor of ")
    assert figure(found, "time_offset")["value"] == pytest.approx(-3.5, abs=1.0)
