"""GeoJSON and KML: the coordinates of the tables, their times, and errors before the work."""

import json
import runpy
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import polars as pl
import pytest
from places import EXAMPLES
from terminal import Write, run, succeed

from tertia.cli.files import maps

pyproj = pytest.importorskip("pyproj")
pytest.importorskip("simplekml")

NAMES = {
    "kml": "http://www.opengis.net/kml/2.2",
    "gx": "http://www.google.com/kml/ext/2.2",
}
RADARS = [
    'name = "west"\nlatitude_deg = 50\nlongitude_deg = 2\nheight_m = 120\nrange_sigma_m = 50\n'
    "azimuth_sigma_deg = 0.08\nscan_period_s = 4",
    'name = "east"\nlatitude_deg = 50\nlongitude_deg = 3\nheight_m = 40\nrange_sigma_m = 80\n'
    "azimuth_sigma_deg = 0.15\nscan_period_s = 6",
]


@pytest.fixture
def radars(write: Write) -> Path:
    return write("".join(f"[[radar]]\n{one}\n" for one in RADARS), "radars.toml")


def stations(write: Write, *, heights: bool = True) -> Path:
    """Return three stations about a place."""
    told = []
    for name, east, north in (("north", 0.003, 0.028), ("east", 0.042, 0.008), ("south", 0, 0)):
        place = f"latitude_deg = {50 + north}\nlongitude_deg = {2 + east}\n"
        place += "height_m = 20\n" if heights else ""
        sigmas = "range_sigma_m = 10\nazimuth_sigma_deg = 0.3\nelevation_sigma_deg = 0.3\n"
        told.append(f'[[station]]\nname = "{name}"\n{place}{sigmas}')
    return write("".join(told), "stations.toml")


def both(folder: Path, *arguments: object) -> tuple[pl.DataFrame, list[Any], list[Any]]:
    """Return the table, the features and the placemarks of a command."""
    for suffix in ("parquet", "geojson", "kml"):
        code, _, err = run(*map(str, arguments), "--output", folder / f"o.{suffix}")
        assert code == 0, err
    document = json.loads((folder / "o.geojson").read_text(encoding="utf-8"))
    assert document["type"] == "FeatureCollection"
    root = ElementTree.parse(folder / "o.kml").getroot()
    marks = root.findall(".//kml:Placemark", NAMES)
    return pl.read_parquet(folder / "o.parquet"), document["features"], marks


def text(mark: Any, path: str) -> list[str]:
    return [found.text for found in mark.findall(path, NAMES)]


def test_tracks(radars: Path, tmp_path: Path) -> None:
    plots = EXAMPLES / "air_plots.csv"
    rows, features, marks = both(tmp_path, "track", plots, "--sensors", radars)
    numbers = rows["track"].unique(maintain_order=True).sort().to_list()
    assert [one["properties"]["track"] for one in features] == numbers
    assert len(marks) == len(numbers) > 5
    for number, one, mark in zip(numbers, features, marks, strict=True):
        own = rows.filter(pl.col("track") == number).sort("time_s", maintain_order=True)
        assert one["geometry"]["type"] == "LineString"
        places = np.array(one["geometry"]["coordinates"])
        expected = own.select("longitude_deg", "latitude_deg").to_numpy()
        np.testing.assert_allclose(places[:, :2], expected, atol=1e-8)
        told = one["properties"]
        assert told["name"] == f"track {number}"
        assert told["times"] == own["time_s"].to_list()
        assert told["plot_count"] == own["plot"].count()
        assert told["mode_3a"] == own["mode_3a"].drop_nulls().last()
        coordinates = [line.split() for line in text(mark, ".//gx:coord")]
        np.testing.assert_allclose(np.array(coordinates, dtype=float)[:, :2], expected, atol=1e-8)
        whens = text(mark, ".//kml:when")
        first = own["time_s"][0]
        assert whens[0] == f"1970-01-01T00:{int(first) // 60:02}:{first % 60:06.3f}Z"
        assert len(whens) == own.height
        data = {d.get("name"): d[0].text for d in mark.findall(".//kml:Data", NAMES)}
        assert data["track"] == str(number)
        [mode] = text(mark, ".//kml:altitudeMode")
        if own["height_m"].count():
            assert mode == "absolute"
            known = own["height_m"].is_not_null().to_numpy()
            np.testing.assert_allclose(
                places[known, 2], own["height_m"].drop_nulls().to_numpy(), atol=1e-3
            )
        else:
            assert (mode, places.shape[1]) == ("clampToGround", 2)


def test_dates_and_unknown_heights(radars: Path, write: Write, tmp_path: Path) -> None:
    """The height is told by two plots alone; before them it is that of the first."""
    lines = [
        f"2026-03-01T23:59:{4 * at:02}Z,west,{50e3 + 800 * at},45,{3000 if at in {3, 4} else ''}"
        for at in range(12)
    ]
    head = "time_s,sensor,range_m,azimuth_deg,height_m"
    path = write("\n".join([head, *lines]) + "\n", "plots.csv")
    _, [one], [mark] = both(tmp_path, "track", path, "--sensors", radars)
    assert one["properties"]["times"][:2] == ["2026-03-01T23:59:00Z", "2026-03-01T23:59:04Z"]
    assert text(mark, ".//kml:when")[0] == "2026-03-01T23:59:00.000Z"
    heights = [place[2] for place in one["geometry"]["coordinates"]]
    assert heights[0] == heights[1] == heights[2] == pytest.approx(3000, abs=0.1)


def test_positions_and_trajectories(write: Write, tmp_path: Path) -> None:
    path = EXAMPLES / "measurements.csv"
    rows, features, marks = both(tmp_path, "locate", path, "--sensors", stations(write))
    rows = rows.drop_nulls("latitude_deg")
    assert len(features) == len(marks) == rows.height > 3
    for row, one, mark in zip(rows.iter_rows(named=True), features, marks, strict=True):
        place = (row["longitude_deg"], row["latitude_deg"], row["height_m"])
        assert one["geometry"]["type"] == "Point"
        assert one["geometry"]["coordinates"] == pytest.approx(place, abs=1e-3)
        assert one["properties"]["pvalue"] == row["pvalue"]
        assert one["properties"]["name"] == f"time_s {row['time_s']}"
        [told] = text(mark, ".//kml:coordinates")
        assert [float(part) for part in told.split(",")] == pytest.approx(place, abs=1e-3)
        assert text(mark, ".//kml:altitudeMode") == ["absolute"]
    rows, [line], [mark] = both(tmp_path, "reconstruct", path, "--sensors", stations(write))
    rows = rows.drop_nulls("latitude_deg")
    places = rows.select("longitude_deg", "latitude_deg", "height_m").to_numpy()
    np.testing.assert_allclose(line["geometry"]["coordinates"], places, atol=1e-3)
    assert line["properties"]["measurement_count"] == rows["measurement_count"].sum()
    assert len(text(mark, ".//gx:coord")) == rows.height


def test_in_the_plane_there_is_no_height(write: Write, tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    frame = pl.read_csv(EXAMPLES / "measurements.csv", infer_schema=False)
    frame.drop("elevation_deg").write_csv(path)
    _, features, marks = both(tmp_path, "locate", path, "--sensors", stations(write, heights=False))
    assert {len(one["geometry"]["coordinates"]) for one in features} == {2}
    assert {mode for mark in marks for mode in text(mark, ".//kml:altitudeMode")} == {
        "clampToGround"
    }


def test_lines_across_180_degrees_do_not_leap() -> None:
    rows = pl.DataFrame(
        {"time_s": [0, 1, 2], "latitude_deg": [1.0] * 3, "longitude_deg": [179.9, -180.0, -179.9]}
    )
    one = maps.feature(rows, "x", {})
    assert one is not None
    assert [place[0] for place in one.coordinates(unwrapped=True)] == [179.9, 180.0, 180.1]
    assert [place[0] for place in one.coordinates(unwrapped=False)] == [179.9, -180.0, -179.9]


@pytest.mark.parametrize("suffix", ["geojson", "kml"])
@pytest.mark.parametrize(
    ("command", "file", "option", "sites"),
    [
        ("track", "air_plots.csv", "--sensors", "air_radars.toml"),
        ("locate", "measurements.csv", "--sensors", "stations.toml"),
        ("reconstruct", "measurements.csv", "--sensors", "stations.toml"),
    ],
)
def test_local_positions_are_no_map(
    command: str, file: str, option: str, sites: str, suffix: str, tmp_path: Path
) -> None:
    output = tmp_path / f"o.{suffix}"
    arguments = (EXAMPLES / file, option, EXAMPLES / sites, "--output", output)
    code, out, err = run(command, *arguments)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert f"cannot write {output}: positions are only local: give latitude_deg and" in err
    assert not output.exists()


def test_other_commands_write_no_maps(tmp_path: Path) -> None:
    code, _, err = run("bearing", EXAMPLES / "bearings.csv", "--output", tmp_path / "o.kml")
    assert (code, err.count("\n")) == (2, 1)
    assert "its name must end in .csv" in err


def test_regions_and_bearings_on_maps(tmp_path: Path) -> None:
    """The region holds the position, and lines begin at the stations and pass by it."""
    runpy.run_path(str(EXAMPLES / "scenes.py"))["SCENES"]["bearings"](
        tmp_path, np.random.default_rng(3)
    )
    arguments = ("locate", tmp_path / "bearings.csv", "--sensors", tmp_path / "sensors.toml")
    arguments += ("--tolerance", "inf", "--probability", "0.9", "--output")
    for suffix in (".geojson", ".kml"):
        succeed(*arguments, tmp_path / f"map{suffix}")
    features = json.loads((tmp_path / "map.geojson").read_text(encoding="utf-8"))["features"]
    point, *lines, region = features
    assert region["geometry"]["type"] == "MultiPolygon"
    assert region["properties"]["probability"] == 0.9
    ((ring,),) = region["geometry"]["coordinates"]
    assert ring[0] == ring[-1]
    here = np.array(point["geometry"]["coordinates"])
    assert np.all(np.min(ring, axis=0) < here)
    assert np.all(here < np.max(ring, axis=0))
    earth = pyproj.Geod(ellps="WGS84")
    assert [one["properties"]["sensor"] for one in lines] == ["hill", "tower", "roof", "van"]
    for one in lines:
        (begin, end), azimuth = one["geometry"]["coordinates"], one["properties"]["azimuth_deg"]
        found, _, far = earth.inv(*begin, *end)
        assert (found - azimuth + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=0.01)
        assert far == pytest.approx(1.2 * earth.inv(*begin, *here)[2], rel=1e-3)
    text = (tmp_path / "map.kml").read_text(encoding="utf-8")
    assert text.count("<LineString") == 4
    assert text.count("<Polygon") == 1


@pytest.mark.parametrize("command", ["locate", "reconstruct"])
def test_azimuths_alone_are_on_the_ground(write: Write, tmp_path: Path, command: str) -> None:
    """The stations have heights, the positions have none."""
    azimuths = {"north": 140.0, "east": 270.0, "south": 75.0}
    lines = [
        f"{10 * at},{name},{value + 0.02 * at}"
        for at in range(5)
        for name, value in azimuths.items()
    ]
    path = write("\n".join(["time_s,sensor,azimuth_deg", *lines]) + "\n", "azimuths.csv")
    rows, features, marks = both(tmp_path, command, path, "--sensors", stations(write))
    assert rows["height_m"].null_count() == 5
    assert len(features) == len(marks) == (5 if command == "locate" else 1)
    places = np.vstack([one["geometry"]["coordinates"] for one in features])
    expected = rows.select("longitude_deg", "latitude_deg").to_numpy()
    np.testing.assert_allclose(places, expected, atol=1e-8)
    assert all(text(mark, ".//kml:altitudeMode") == ["clampToGround"] for mark in marks)
    _, out, _ = run(command, str(path), "--sensors", str(stations(write)))
    sigma = np.median(np.hypot(rows["east_sigma_m"].to_numpy(), rows["north_sigma_m"].to_numpy()))
    assert f"median sigma {sigma:.3g} m" in out
    one = write("\n".join(["time_s,sensor,azimuth_deg", *lines[:3]]) + "\n", "one.csv")
    if command == "locate":
        code, _, err = run(
            command, str(one), "--sensors", str(stations(write)), "--plot", str(tmp_path / "p.svg")
        )
        assert (code, err) == (0, "")
        assert "nan" not in (tmp_path / "p.svg").read_text(encoding="utf-8")
