"""Channels in tables: what plots were detected by, and radars that describe it."""

from io import StringIO

import numpy as np
import polars as pl
import pytest
import terminal

from tertia import simulate, tables
from tertia.io import _asterix_rows
from tertia.sensors import Channel, Radar
from tertia.sensors._channels import DETECTIONS
from tertia.tables._described import sensors_of
from tertia.tables._detections import DETECTION, detections_of
from tertia.tables._parts import RecordError
from tertia.tables._sensors import radar_rows, radars
from tertia.tracker import track

CHANNELS = {
    "psr": Channel(0.85, range_sigma=80.0, azimuth_sigma=np.radians(0.16), clutter_per_scan=40.0),
    "ssr": Channel(0.6, range_sigma=30.0, azimuth_sigma=np.radians(0.06)),
}
RADAR = Radar(
    range_sigma=60.0,
    azimuth_sigma=np.radians(0.1),
    scan_period=4.0,
    max_range=120e3,
    name="west",
    channels=CHANNELS,
)
PLAIN = Radar(range_sigma=60.0, azimuth_sigma=np.radians(0.1), scan_period=4.0, name="west")
SENSORS = """
[[radar]]
name = "west"
east_m = 0.0
north_m = 0.0
range_sigma_m = 60.0
azimuth_sigma_deg = 0.1
scan_period_s = 4.0
max_range_m = 120e3
psr_detection_probability = 0.85
psr_range_sigma_m = 80.0
psr_azimuth_sigma_deg = 0.16
psr_clutter_per_scan = 40.0
ssr_detection_probability = 0.6
ssr_range_sigma_m = 30.0
ssr_azimuth_sigma_deg = 0.06
"""
SPELLINGS = {"psr+ssr": "ssr+psr", "mode-s": "mode-s-roll-call", "": None}


@pytest.fixture(scope="module")
def seen():
    traffic = simulate.dense_traffic(8, area=(80e3, 80e3), duration=160.0, rng=5)
    return simulate.radar_plots(traffic, [RADAR], rng=6).plots


@pytest.fixture(scope="module")
def table(seen):
    names = np.array([*DETECTIONS, ""])[seen.detection]
    columns = {
        "time_s": seen.time,
        "range_m": seen.range,
        "azimuth_deg": np.degrees(seen.azimuth),
        "height_m": seen.height,
        "detection": [SPELLINGS.get(name, name) for name in names.tolist()],
    }
    return pl.DataFrame(columns, nan_to_null=True)


def test_every_name_of_asterix_is_known():
    names = [name for name in _asterix_rows._DETECTIONS if name != "none"]
    codes = detections_of(pl.DataFrame({"detection": [*names, "none", None]}))
    assert [DETECTIONS[code] for code in codes[:-2]] == [
        "psr", "ssr", "psr+ssr", "mode-s", "mode-s", "psr+mode-s", "psr+mode-s",
    ]  # fmt: skip
    assert codes[-2:].tolist() == [-1, -1]
    assert list(DETECTION) == ["detection"]


def test_tracks_are_those_of_the_library(seen, table):
    found = tables.track(table, sensors=[RADAR])
    own = track(seen, [RADAR])
    assert found.height == len(own) > 100
    np.testing.assert_allclose(found["east_m"], own.position[:, 0], rtol=0, atol=1e-6)
    np.testing.assert_allclose(found["east_sigma_m"] ** 2, own.covariance[:, 0, 0], rtol=1e-9)
    # and without the column others
    assert tables.track(table.drop("detection"), sensors=[RADAR]).height != found.height


def test_the_column_counts_for_radars_with_channels_alone(table):
    marks = table.with_columns(pl.Series("detection", ["what", "ever"] * 10_000)[: table.height])
    one = tables.track(marks, sensors=[PLAIN])
    assert one.equals(tables.track(table.drop("detection"), sensors=[PLAIN]))
    with pytest.raises(RecordError, match="detection is what; it must be one of psr, ssr"):
        tables.track(marks, sensors=[RADAR])


def test_radars_are_described_and_read_again():
    rows = radar_rows(sensors_of([RADAR, Radar(**_plain("east"))])).to_dicts()
    assert rows[0]["psr_clutter_per_scan"] == 40.0
    assert rows[0]["detection_probability"] is None
    assert rows[1]["ssr_range_sigma_m"] is None
    first, second = radars(rows).items
    assert (second.channels, second.detection_probability) == (None, 0.9)
    for name, channel in CHANNELS.items():
        for key in ("detection_probability", "range_sigma", "azimuth_sigma", "clutter_per_scan"):
            expected = getattr(channel, key)
            found = getattr(first.channels[name], key)
            assert found == (expected if expected is None else pytest.approx(expected, rel=1e-12))


def test_extents_of_targets_are_described_and_read_again():
    rows = radar_rows(sensors_of([PLAIN, Radar(**_plain("east"), target_extent=250.0)])).to_dicts()
    assert [one.target_extent for one in radars(rows).items] == [0.0, 250.0]


def _plain(name):
    return {"range_sigma": 60.0, "azimuth_sigma": 1e-3, "scan_period": 4.0, "name": name}


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        ({"psr_range_sigma_m": 80.0}, "psr_detection_probability of west is missing"),
        ({"ssr_detection_probability": 1.5}, "west, ssr: detection_probability is 1.5"),
        (
            {"mode_s_detection_probability": 0.9, "mode_s_range_sigma_m": -1.0},
            "west, mode_s: range_sigma is -1",
        ),
        (
            {"psr_detection_probability": 0.9, "detection_probability": 0.8},
            "west: detection_probability is 0.8; with channels it must be",
        ),
    ],
)
def test_mistakes(cells, message):
    row = {
        "name": "west",
        "east_m": 0.0,
        "north_m": 0.0,
        "range_sigma_m": 60.0,
        "azimuth_sigma_deg": 0.1,
        "scan_period_s": 4.0,
    }
    with pytest.raises(RecordError, match=message):
        radars([row | cells])


def test_command_and_stream_read_them(table, tmp_path):
    plots, sensors, out = (tmp_path / name for name in ("plots.csv", "sensors.toml", "out.csv"))
    ordered = table.sort("time_s")
    ordered.write_csv(plots)
    sensors.write_text(SENSORS, encoding="utf-8")
    done = terminal.run("track", plots, "--sensors", sensors, "--output", out)
    assert done.code == 0
    found, own = pl.read_csv(out), tables.track(ordered, sensors=[RADAR])
    assert found.height == own.height
    np.testing.assert_allclose(found["east_m"], own["east_m"], rtol=0, atol=1e-3)
    both = []
    for rows in (ordered, ordered.drop("detection")):
        rows.write_csv(plots)
        both.append(terminal.succeed("track", plots, "--stream", "--sensors", sensors).out)
    first, second = (pl.read_csv(StringIO(text)) for text in both)
    assert first.height > 100
    # replies are nearer than the radar's sigma says
    assert first["east_sigma_m"].median() < 0.9 * second["east_sigma_m"].median()
