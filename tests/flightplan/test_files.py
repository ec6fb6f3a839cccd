"""Plans from files."""

import json

import numpy as np
import pytest
from flightplan.cases import WAY
from pyproj import Geod

from tertia.geo import LocalFrame
from tertia.io import read_plans


class TestFiles:
    def test_csv(self, tmp_path):
        file = tmp_path / "plans.csv"
        file.write_text(
            "name,east_m,north_m,height_m,speed_m_s,identity,aircraft_type,mode_3a\n"
            "A,0,0,9000,220,17,A320,0021\nA,0,50000,9000,210,,,\nA,0,50000,9000,205,,,\n"
            "A,40000,70000,9300,,,,\n\nB,0,0,,180,,,\nB,100,70000,,,,,\n"
        )
        first, second = read_plans(file, types={"A320": 0.35})
        np.testing.assert_array_equal(first.waypoints, [[0, 0], [0, 5e4], [4e4, 7e4]])
        np.testing.assert_array_equal(first.speeds, [220, 205])
        np.testing.assert_array_equal(first.heights, [9000, 9000, 9300])
        assert (first.name, first.identity, first.bank) == ("A", 17, pytest.approx(0.35))
        assert (first.mode_3a, second.mode_3a) == (0o21, None)
        assert (second.name, second.identity, second.heights) == ("B", None, None)
        assert second.bank == pytest.approx(np.radians(25))

    def test_json(self, tmp_path):
        file = tmp_path / "plans.json"
        plans = [
            {"name": "A", "waypoints": WAY.tolist(), "speeds_m_s": 200, "start_time_s": 60},
            {"waypoints": WAY.tolist(), "times_s": [0, 300, 600, 1100, 1400, 1800.0]},
            {"waypoints": WAY.tolist(), "turn_radius_m": 6000.0, "identity": 3}
            | {"icao_address": "4a08eb", "mode_3a": "0021", "callsign": "CSA1"},
        ]
        file.write_text(json.dumps(plans))
        first, second, third = read_plans(file, speed=190.0)
        assert (first.start_time, first.name) == (60.0, "A")
        np.testing.assert_allclose(second.times, plans[1]["times_s"], atol=1e-6)
        np.testing.assert_allclose(third.turns.radius, 6000.0)
        assert set(third.speeds) == {190.0}
        kinds = (third.identity, third.icao_address, third.mode_3a, third.callsign)
        assert kinds == (3, 0x4A08EB, 0o21, "CSA1")
        for name, wrong in (("mode_3a", 21), ("mode_3a", "9"), ("icao_address", "XY")):
            file.write_text(json.dumps([plans[0] | {name: wrong}]))
            with pytest.raises(ValueError, match=f"plan A: {name} is {wrong!r}; it must be text"):
                read_plans(file)

    def test_geojson(self, tmp_path):
        file = tmp_path / "plans.geojson"
        points = [[2.1, 41.3, 0], [2.6, 41.5, 3000], [3.4, 41.5, 9000]]
        feature = {
            "type": "Feature",
            "properties": {"name": "A", "speeds_m_s": [120, 200], "bank_deg": 20},
            "geometry": {"type": "LineString", "coordinates": points},
        }
        file.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
        (one,) = read_plans(file, frame=LocalFrame(41.3, 2.1))
        geod = Geod(ellps="WGS84")
        for place, (longitude, latitude, _) in zip(one.waypoints, points, strict=True):
            azimuth, _, distance = geod.inv(2.1, 41.3, longitude, latitude)
            # in the plane that touches the earth at the origin
            assert np.hypot(*place) == pytest.approx(6.37e6 * np.sin(distance / 6.37e6), abs=0.05)
            if distance:
                found = np.degrees(np.arctan2(*place))
                assert found == pytest.approx(azimuth, abs=1e-4)
        np.testing.assert_array_equal(one.heights, [0, 3000, 9000])
        assert one.bank == pytest.approx(np.radians(20))
        with pytest.raises(ValueError, match="plan A: its positions are latitudes and longitudes"):
            read_plans(file)

    @pytest.mark.parametrize(
        ("name", "text", "message"),
        [
            ("a.txt", "", "its name must end in"),
            ("a.csv", "name,x\nA,3\n", "it must have name, and east_m and north_m"),
            ("a.csv", "name,east_m,north_m\nA,3,x\n", "cannot read"),
            ("a.csv", "", "cannot read"),
            ("a.csv", "name,east_m,north_m\nA,0,0\nA,0,9\n", "plan A: either speeds or times"),
            ("a.csv", "name,east_m,north_m\nA,0,0\nA,0,\n", r"plan A: waypoints\[1, 1\] is nan"),
            ("a.csv", "name,east_m,north_m,speed_m_s\nA,0,0,9\nA,0,0,9\n", "plan A: waypoints has"),
            ("a.json", "[", "cannot read"),
            ("a.json", "{}", "neither a list"),
            ("a.json", "[3]", "plan 0 has no waypoints"),
            ("a.json", "5", "neither a list"),
            ("a.geojson", '{"type": "FeatureCollection", "features": [5]}', "the feature 5"),
            ("a.json", '[{"waypoints": [[0, 0], [1, "x"]], "speeds_m_s": 1}]', "plan 0"),
            ("a.json", '[{"waypoints": [[0, 0], [1]], "speeds_m_s": 1}]', "plan 0"),
            (
                "a.geojson",
                '{"type": "FeatureCollection", "features": [{"geometry": {"type": "Point"}}]}',
                "has a Point",
            ),
        ],
    )
    def test_what_cannot_be_read(self, tmp_path, name, text, message):
        file = tmp_path / name
        file.write_text(text)
        with pytest.raises(ValueError, match=message):
            read_plans(file)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_json_in_other_encodings(encoding, tmp_path):
    path = tmp_path / "plans.json"
    path.write_text('[{"name": "Ä", "waypoints": [[0, 0], [9e3, 0]], "speeds_m_s": 90}]', encoding)
    assert read_plans(path)[0].name == "Ä"


@pytest.mark.parametrize(
    "text",
    [
        "[" * 100_000,
        '{"type": "FeatureCollection", "features": null}',
        '{"type": "FeatureCollection", "features": [{"geometry": {"type": "LineString"}}]}',
        '{"type": "FeatureCollection", "features": [{"geometry": "POINT (1 2)"}]}',
        '[{"waypoints": [[0, 0], [9e3, 0]], "speeds_m_s": 90, "identity": 1e999}]',
    ],
    ids=range(5),
)
def test_json_of_anything_else(text, tmp_path):
    path = tmp_path / "plans.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"plans\.json"):
        read_plans(path)
