"""ASTERIX: what a decoder written from the documents finds, and clear errors."""

import contextlib
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import polars.testing
import pytest
from places import DATA
from reference import asterix as reference
from typer.testing import CliRunner

from tertia import cli
from tertia.io import read_asterix, write_asterix
from tertia.tracker import Plots, Radar, track

pytest.importorskip("dpkt")

JAHORINA, NETWORK = (DATA / "asterix" / name for name in ("Jahorina.raw", "cat_034_048.pcap"))
real = pytest.mark.skipif(not JAHORINA.is_file(), reason="the recordings are not here")
RADAR = (25, 12)
Save = Callable[..., Path]


@pytest.fixture
def save(tmp_path: Path) -> Save:
    def to_file(contents: bytes, name: str = "plots.ast") -> Path:
        path = tmp_path / name
        path.write_bytes(contents)
        return path

    return to_file


def flight() -> bytes:
    """Return what two radars see of an aircraft, and what one of them tells of itself."""
    place = {"place": (43.571, 16.406, 780), "period": 5.0}
    parts = [reference.block(34, reference.service(RADAR, 1, 86_390.0, **place))]
    for at in range(20):
        time = 86_390.5 + 5 * at
        plots = [
            reference.plot(
                radar, time, 40 + 0.3 * at, 90, address=0x4BAACD, code=0o2303, level=1440
            )
            for radar in (RADAR, (25, 13))
        ]
        parts.append(reference.block(48, *plots))
    return b"".join(parts)


def test_plots(save: Save) -> None:
    found = read_asterix(save(flight()))
    plots = found.plots
    assert plots.height == 40
    # past midnight
    np.testing.assert_array_equal(plots["time_s"][::2], 86_390.5 + 5 * np.arange(20))
    np.testing.assert_allclose(plots["range_nm"][::2], 40 + 0.3 * np.arange(20), atol=1 / 512)
    assert set(plots["azimuth_deg"]) == {90.0}
    assert plots.select(
        "sensor", "flight_level", "icao_address", "mode_3a", "detection", "simulated"
    ).row(1) == ("25/13", 360.0, "4BAACD", "2303", "mode-s-roll-call", False)
    assert found.sensors.rows() == [
        ("25/12", pytest.approx(43.571, abs=2e-5), pytest.approx(16.406, abs=2e-5), 780.0, 5.0, 20),
        ("25/13", None, None, None, None, 20),
    ]
    assert (found.skipped, found.repeated, found.other_packets) == ({}, 0, 0)
    assert repr(found) == (
        "AsterixRecording(40 plots, 2 sensors, 0 tracks, 0 reports, 0 positions, 0 messages)"
    )


def test_what_is_garbled_or_not_validated_is_unknown(save: Save) -> None:
    cases = [(0o2303, 1440), (0x8000 | 0o2303, 0x8000 | 1440), (0x4000 | 0o2303, 0x4000 | 1440)]
    rows = [
        reference.plot(RADAR, at, 10, 10, code=code, level=level)
        for at, (code, level) in enumerate(cases)
    ]
    plots = read_asterix(save(reference.block(48, *rows))).plots
    assert plots.select("mode_3a", "flight_level").rows() == [("2303", 360.0), *2 * [(None, None)]]
    below = reference.plot(RADAR, 0, 10, 10, level=-10 & 0x3FFF)
    assert read_asterix(save(reference.block(48, below))).plots["flight_level"].item() == -2.5


def test_kinds_of_plots(save: Save) -> None:
    """Simulated (SIM, TST), field monitor (RAB), no detection."""
    descriptors = [b"\x20", b"\xb0", b"\xa1\x80", b"\xa2", b"\x00"]
    rows = [reference.plot(RADAR, at, 9, 9, descriptor=d) for at, d in enumerate(descriptors)]
    plots = read_asterix(save(reference.block(48, *rows))).plots
    assert plots["detection"].to_list() == ["psr", *3 * ["mode-s-roll-call"], "none"]
    assert plots["simulated"].to_list() == [False, True, True, False, False]
    assert plots["field_monitor"].to_list() == [False, False, False, True, False]


def test_the_period_is_that_between_north_markers_if_nothing_is_said(save: Save) -> None:
    rows = [reference.service(RADAR, 1, time) for time in (10.0, 14.0, 18.0, 18.0, 30.0)]
    rows += [reference.service(RADAR, 2, 11.0)]
    assert read_asterix(save(reference.block(34, *rows))).sensors["scan_period_s"].item() == 4.0


def test_system_tracks_and_reports(save: Save) -> None:
    track_place = struct.pack(">ii", *(round(a / (180 / 2**25)) for a in (45.4, -15.1)))
    tracks = reference.record(
        {
            1: bytes([25, 100]),
            4: reference.time_of_day(45_827.5),
            5: track_place,
            7: struct.pack(">hh", 4 * 30, 4 * -40),
            9: struct.pack(">H", 0o1275),
            12: struct.pack(">H", 4713),
            17: struct.pack(">h", 4 * 390),
            18: struct.pack(">h", 1000),
            # I062/500: X and Y, root of the covariance
            27: b"\xc0" + struct.pack(">HHh", 2 * 30, 2 * 40, 2 * -15),
        }
    )
    fine = struct.pack(">ii", *(round(a / (180 / 2**30)) for a in (-45.25, 15.5)))
    report = reference.record(
        {
            1: bytes([25, 50]),
            2: b"\x00",
            6: bytes(6),
            7: fine,
            11: bytes.fromhex("4BAACD"),
            12: reference.time_of_day(45_828.0),
            16: struct.pack(">h", 1000),
            21: struct.pack(">h", 4 * 350),
            26: struct.pack(">HH", 1024, 16384),
        }
    )
    path = save(
        reference.block(62, tracks) + reference.block(247, b"\x00") + reference.block(21, report)
    )
    found = read_asterix(path)
    assert found.skipped == {247: 1}
    row = found.tracks.row(0, named=True)
    assert (row["time_s"], row["sensor"], row["target"]) == (45_827.5, "25/100", "4713")
    assert (row["latitude_deg"], row["longitude_deg"]) == pytest.approx((45.4, -15.1), abs=6e-6)
    assert (row["speed_m_s"], row["course_deg"]) == pytest.approx((50.0, 143.13010235415598))
    assert (row["flight_level"], row["mode_3a"]) == (390.0, "1275")
    assert (row["east_sigma_m"], row["north_sigma_m"]) == (30.0, 40.0)
    assert row["covariance_east_north_m2"] == -225.0
    assert row["height_m"] == pytest.approx(6250 * 0.3048)
    row = found.reports.row(0, named=True)
    assert (row["time_s"], row["target"], row["flight_level"]) == (45_828.0, "4BAACD", 350.0)
    assert (row["latitude_deg"], row["longitude_deg"]) == pytest.approx((-45.25, 15.5), abs=1e-7)
    assert (row["height_m"], row["course_deg"]) == (pytest.approx(1905.0), 90.0)
    assert row["speed_m_s"] == pytest.approx(1024 / 2**14 * 1852)


def test_packets(save: Save) -> None:
    """Twice, as from two lines, and with others between them."""
    one = reference.ethernet(flight()[:200])
    contents = flight()
    half = sum(len(body) + 3 for _, body in list(reference.blocks(contents))[:11])
    parts = [reference.ethernet(part) for part in (contents[:half], contents[half:])]
    arp = bytes(12) + b"\x08\x06" + bytes(28)
    other = reference.ethernet(b"no ASTERIX")
    path = save(reference.pcap(arp, *parts, other, *parts), "net.pcap")
    found, plain = read_asterix(path), read_asterix(save(contents))
    assert found.plots.equals(plain.plots)
    assert found.sensors.equals(plain.sensors)
    assert (found.repeated, found.other_packets) == (40, 1)
    with pytest.raises(ValueError, match="has no packet that contains ASTERIX"):
        read_asterix(save(reference.pcap(arp, other), "net.pcap"))
    with pytest.raises(ValueError, match="packet 2 is cut off or a fragment"):
        read_asterix(save(reference.pcap(arp, one[:100]), "net.pcap"))
    whole = reference.pcap(*parts)
    with pytest.raises(ValueError, match="cut off"):
        read_asterix(save(whole[:-100], "net.pcap"))
    with pytest.raises(ValueError, match=r"cut off or damaged after packet 1"):
        read_asterix(save(whole[: 24 + 16 + len(parts[0]) + 10], "net.pcap"))


def ioss(part: bytes) -> bytes:
    """Return a frame of the final format of IOSS."""
    return struct.pack(">HBBB", len(part) + 12, 0, 1, 7) + b"\x01\x02\x03" + part + b"\xa5" * 4


def rff(part: bytes) -> bytes:
    """Return a frame of RFF."""
    return struct.pack("<IH", 1234, len(part)) + part


@pytest.mark.parametrize(("frame", "header"), [(ioss, b""), (rff, b"2026-11-22".ljust(128))])
def test_frames(frame: Callable[[bytes], bytes], header: bytes, save: Save) -> None:
    """Blocks in frames are those without; what is damaged is left out and counted."""
    contents = flight()
    bodies = [reference.block(category, body) for category, body in reference.blocks(contents)]
    plain = read_asterix(save(contents))
    framed = [frame(one) for one in bodies]
    found = read_asterix(save(header + b"".join(framed)))
    assert found.plots.equals(plain.plots)
    assert found.sensors.equals(plain.sensors)
    assert (found.damaged, found.other_packets) == (0, 0)
    cut = read_asterix(save(header + b"".join(framed)[:-3]))
    assert cut.damaged == 1
    assert cut.plots.equals(plain.plots[: cut.plots.height])
    assert f"frame {len(framed)} is cut off" in cut.first_damage
    # after the frames that decide, one has something else in it
    spoiled = [*framed[:12], frame(b"\xff\x00\x00\x01"), *framed[12:]]
    found = read_asterix(save(header + b"".join(spoiled)))
    assert found.plots.equals(plain.plots)
    assert found.damaged == 1
    assert "frame 13, byte 0: no data block begins here" in found.first_damage


@pytest.mark.parametrize(
    ("contents", "message"),
    [
        (b"", "plots.ast is empty"),
        (
            b"time_s,range_m\n1,2\n",
            "byte 0: no ASTERIX data block begins here .bytes 74696d655f732c",
        ),
        (flight()[:2], "byte 0: the data block is cut off, .*; no other record can be decoded"),
        (b"time_s,code\n" + b"48 0,12.5\n" * 999, "byte 0: no ASTERIX data block begins here"),
        (
            reference.block(48, b"\xff\xff"),
            "byte 3: a record of category 48 is damaged: .*; no other",
        ),
    ],
)
def test_damaged_files(contents: bytes, message: str, save: Save) -> None:
    with pytest.raises(ValueError, match=message):
        read_asterix(save(contents))


BROKEN = reference.block(48, reference.plot(RADAR, 1, 1, 1), reference.plot(RADAR, 2, 2, 2)[:-1])


@pytest.mark.parametrize(
    ("contents", "plots", "lost", "place"),
    [
        (flight()[:-1], 38, 40, "byte 800: the data block is cut off"),
        (flight() + b"\xff\x00\x10", 40, 3, "byte 841: the data block is cut off"),
        (
            flight() + b"\x30\x00\x02",
            40,
            3,
            "byte 841: no data block begins here (bytes 300002); 3 bytes",
        ),
        (b"\xff\x00\x10" + flight(), 40, 3, "byte 0: no data block begins here (bytes ff0010"),
        # a length, of the last block and of another one, is found by what can be decoded
        (flight()[:801] + b"\xff" + flight()[802:], 40, 0, "byte 800: the length of a data block"),
        (flight()[:433] + b"\x30" + flight()[434:], 40, 0, "byte 431: the length of a data block"),
        (flight()[:433] + b"\x10" + flight()[434:], 40, 0, "byte 431: the length of a data block"),
        (
            flight()[:431] + b"\xff\x00\x09" + flight()[434:],
            38,
            41,
            "byte 431: no data block begins",
        ),
        (BROKEN + flight(), 41, 0, "byte 14: a record of category 48 is damaged"),
    ],
)
def test_what_is_damaged_is_left_out_and_counted(
    contents: bytes, plots: int, lost: int, place: str, save: Save, radars: Path
) -> None:
    found = read_asterix(save(contents))
    assert (found.plots.height, found.lost_bytes) == (plots, lost)
    assert place in found.first_damage
    pytest.importorskip("pyproj")
    code, _, err = run("track", save(contents), "--sensors", radars)
    assert code == 0
    assert f"; the first damage: {found.first_damage}\n" in err
    assert ("outside data blocks" in err) == (lost > 0)


def test_after_any_damaged_length_the_next_blocks_are_found(save: Save) -> None:
    """A byte of the header of a data block is any other: its two plots are lost at most."""
    random = np.random.default_rng(34)
    starts = np.cumsum([0, *(len(body) + 3 for _, body in reference.blocks(flight()))])
    for at in starts[1:-1]:
        contents = bytearray(flight())
        contents[at + random.integers(3)] ^= int(random.integers(1, 256))
        found = read_asterix(save(bytes(contents)))
        assert found.plots.height >= 38
        assert found.damaged + len(found.skipped) > 0


def test_mutated_recordings_are_read_or_refused(save: Save) -> None:
    random = np.random.default_rng(18)
    for _ in range(150):
        contents = bytearray(flight())
        for at in random.integers(0, len(contents), 3):
            contents[at] = random.integers(256)
        with contextlib.suppress(ValueError):
            assert read_asterix(save(bytes(contents))).plots.height <= 60


def test_other_categories_are_named_and_counted(save: Save, radars: Path) -> None:
    pytest.importorskip("pyproj")
    others = reference.block(247, b"\x00") + 2 * reference.block(253, b"\x00")
    path = save(flight() + others)
    assert read_asterix(path).skipped == {247: 1, 253: 2}
    code, _, err = run("track", path, "--sensors", radars)
    assert code == 0
    assert (
        f"{path}: not supported and left out: 1 block of category 247 (versions), 2 blocks of "
        "category 253 (unknown)\n"
    ) in err


def angles(bits: int, *degrees: float) -> bytes:
    return b"".join(struct.pack(">i", round(a / (180 / 2**bits))) for a in degrees)


def test_messages_of_a_tracker_about_its_sensors_and_itself(save: Save) -> None:
    head = {1: bytes([25, 100]), 2: b"\x07"}
    sensor = {**head, 4: bytes(RADAR), 3: reference.time_of_day(50.0)}
    # degraded, PSR and MLT failed; overload in transmission, time invalid, no plots
    sensor[5] = bytes([0b0110_0011, 0b0010_1100])
    sensor |= {6: struct.pack(">h", -250), 7: struct.pack(">hh", 150, -128)}
    sensor |= {8: struct.pack(">h", 8192), 9: struct.pack(">hh", -30, 64)}
    sensor |= {10: struct.pack(">h", -4096), 11: struct.pack(">h", 2048)}
    held = {**sensor, 3: reference.time_of_day(51.0), 5: bytes([0b0000_0001, 0b1000_0000])}
    far = {**head, 4: bytes([25, 13]), 3: reference.time_of_day(52.0), 5: b"\xc0"}
    system = {1: bytes([25, 100]), 2: b"\x01", 3: b"\x07", 4: reference.time_of_day(53.0)}
    ended = {**system, 2: b"\x02", 5: b"\x09"}
    service = {**system, 2: b"\x03", 7: b"\x04"}
    contents = reference.block(63, *map(reference.record, (sensor, held, far)))
    contents += reference.block(
        65, *map(reference.record, ({**system, 6: b"\x70"}, ended, service))
    )
    found = read_asterix(save(contents)).messages
    assert found["time_s"].to_list() == [50.0, 51.0, 52.0, 53.0, 53.0]
    assert found["sensor"].to_list() == ["25/12", "25/12", "25/13", "25/100", "25/100"]
    assert found["source"].to_list() == ["25/100"] * 5
    assert found["service"].to_list() == [7] * 5
    states = ["degraded", "inhibited", "not connected", "degraded", None]
    assert found["state"].to_list() == states
    assert found["failed"].to_list() == ["psr+multilateration", "", "", None, None]
    assert found["overload"].to_list() == [True, False, None, True, None]
    assert found["time_valid"].to_list() == [False, True, None, False, None]
    assert found["plots_missing"].to_list() == [True, False, None, None, None]
    assert found["service_report"].to_list() == [None] * 4 + [4]
    biases = found.select(pl.selectors.matches("bias|gain"))
    assert biases.row(0) == pytest.approx(
        (-0.25, 0.0015, -1852.0, 45.0, -3e-4, 926.0, -22.5, 11.25)
    )
    assert biases.row(2) == (None,) * 8


def test_messages_of_sensors_about_themselves(save: Save) -> None:
    """North markers and sectors alone say nothing of a state."""
    head = {1: bytes(RADAR), 2: b"\x01", 3: reference.time_of_day(10.0)}
    states = [{6: b"\x80\x00"}, {6: b"\x80\x88"}, {6: b"\x80\x52"}, {6: b"\x10\x10"}]
    errors = {12: struct.pack(">bb", -64, 32)}
    contents = reference.block(34, *(reference.record(head | one) for one in (*states, errors)))
    contents += reference.block(34, reference.service(RADAR, 1, 11.0))
    old = {1: bytes(RADAR), 2: b"\x01", 4: reference.time_of_day(12.0), 10: errors[12]}
    contents += reference.block(2, reference.record(old))
    multilateration = {1: bytes([25, 60]), 2: b"\x02", 3: reference.time_of_day(13.0)}
    contents += reference.block(19, reference.record(multilateration | {4: b"\xb0"}))
    found = read_asterix(save(contents)).messages
    assert found["time_s"].to_list() == [10.0, 10.0, 10.0, 10.0, 12.0, 13.0]
    assert found["sensor"].to_list() == found["source"].to_list()
    own = ["operational", "inhibited", "operational", None, None, "inhibited"]
    assert found["state"].to_list() == own
    assert found["overload"].to_list() == [False, True, True, None, None, True]
    assert found["time_valid"].to_list() == [True, True, False, None, None, False]
    apart = found.select("collimation_range_m", "collimation_azimuth_deg")
    assert apart.rows()[3:5] == [(-926.0, 0.703125)] * 2


def test_multilateration(save: Save) -> None:
    target = {
        1: bytes([25, 60]),
        2: b"\x40",
        3: reference.time_of_day(100.0),
        4: angles(25, 45.5, -15.25),
        5: (2000).to_bytes(3, "big") + (-3000).to_bytes(3, "big", signed=True),
        6: struct.pack(">H", 77),
        8: struct.pack(">H", 0o1275),
        9: struct.pack(">hh", 4 * 30, 4 * -40),
        10: struct.pack(">h", 4 * 12),
        12: bytes.fromhex("4BAACD"),
        15: struct.pack(">h", 160),
        19: b"\x40" + struct.pack(">HHh", 4 * 6, 4 * 8, -2),
    }
    service = {1: bytes([25, 60]), 2: b"\x02", 3: reference.time_of_day(99.0)}
    service |= {8: angles(30, 45.25, -15.5), 9: struct.pack(">h", 4 * 120)}
    contents = reference.block(19, reference.record(service))
    found = read_asterix(save(contents + reference.block(20, reference.record(target))))
    row = found.positions.row(0, named=True)
    assert (row["time_s"], row["sensor"], row["target"]) == (100.0, "25/60", "77")
    assert (row["latitude_deg"], row["longitude_deg"]) == pytest.approx((45.5, -15.25), abs=6e-6)
    assert (row["east_m"], row["north_m"]) == (1000.0, -1500.0)
    assert (row["mode_3a"], row["icao_address"], row["flight_level"]) == ("1275", "4BAACD", 12.0)
    assert (row["speed_m_s"], row["course_deg"]) == pytest.approx((50.0, 143.13010235415598))
    assert row["height_m"] == pytest.approx(1000 * 0.3048)
    assert (row["east_sigma_m"], row["north_sigma_m"]) == (6.0, 8.0)
    assert row["covariance_east_north_m2"] == -0.5 * 6.0 * 8.0
    assert found.sensors.select("sensor", "latitude_deg", "longitude_deg", "height_m").row(0) == (
        "25/60",
        pytest.approx(45.25, abs=1e-6),
        pytest.approx(-15.5, abs=1e-6),
        120.0,
    )


def test_old_plots(save: Save) -> None:
    """Plots and tracks; a source and a time that are not repeated."""
    first = reference.old_plot(
        RADAR, 70_000.25, 40, **{"070": b"\x04\xc3", "090": struct.pack(">H", 1440)}
    )
    wrong = reference.old_plot(None, 70_000.5, 41, **{"070": b"\x84\xc3", "090": b"\x45\xa0"})
    tracked = {"161": struct.pack(">H", 7), "200": struct.pack(">HH", 1024, 32768)}
    more = {"descriptor": b"\xb1\x00", "070": b"\x0f\xff", "090": struct.pack(">h", -10 & 0x3FFF)}
    track = reference.old_plot((25, 13), 70_001, 42, **tracked, **more)
    contents = reference.block(1, first, wrong) + reference.block(1, track)
    found = read_asterix(save(reference.old_service(RADAR, 1, 70_000) + contents))
    assert found.editions == {1: "1.4", 2: "1.2"}
    names = ("time_s", "sensor", "range_nm", "azimuth_deg", "flight_level", "mode_3a")
    assert found.plots.select(names).rows() == [
        (70_000.25, "25/12", 40.0, 90.0, 360.0, "2303"),
        (70_000.5, "25/12", 41.0, 90.0, None, None),
        (70_001.0, "25/13", 42.0, 90.0, -2.5, "7777"),
    ]
    assert found.plots["detection"].to_list() == ["ssr", "ssr", "ssr+psr"]
    row = found.plots.select(
        "simulated", "field_monitor", "track_number", "speed_m_s", "course_deg"
    ).row(2)
    assert row == (False, False, 7, pytest.approx(1024 / 2**14 * 1852), 180.0)
    assert found.sensors.select("sensor", "scan_period_s", "plot_count").rows() == [
        ("25/12", 5.0, 2),
        ("25/13", None, 1),
    ]
    assert not found.truncated_times
    alone = read_asterix(save(contents))
    assert alone.truncated_times
    assert alone.plots["time_s"].to_list() == [70_000 % 512 + at for at in (0.25, 0.5, 1.0)]


def old_flight() -> bytes:
    """Return half an hour of an aircraft about midnight, as two radars see it."""
    parts = []
    for at in range(360):
        time = 85_500.5 + 5 * at
        for radar in (RADAR, (25, 13)):
            if at % 30 == 0:
                parts.append(reference.old_service(radar, 1, time - 0.4))
            code = {"070": b"\x04\xc3", "090": struct.pack(">H", 1440)}
            plot = reference.old_plot(radar, time, 40 + 0.3 * at, **code)
            parts.append(reference.block(1, plot))
    return b"".join(parts)


def test_old_times_are_completed_over_midnight(save: Save, radars: Path, tmp_path: Path) -> None:
    pytest.importorskip("pyproj")
    path, output = save(old_flight()), tmp_path / "tracks.parquet"
    found = read_asterix(path)
    np.testing.assert_array_equal(found.plots["time_s"][::2], 85_500.5 + 5 * np.arange(360))
    text = radars.read_text(encoding="utf-8").replace("[[radar]]", "[[radar]]\n{}", 1)
    place = "latitude_deg = 43.571\nlongitude_deg = 16.406\nheight_m = 780"
    radars.write_text(text.format(place), encoding="utf-8")
    code, _, err = run("track", path, "--sensors", radars, "--output", output)
    assert (code, err) == (0, "")
    tracks = pl.read_parquet(output)
    assert set(tracks["mode_3a"].drop_nulls()) == {"2303"}
    assert tracks["time_s"].max() == 85_500.5 + 5 * 359


def test_times_without_service_messages_are_told(save: Save, radars: Path) -> None:
    pytest.importorskip("pyproj")
    plots = [reference.old_plot((25, 13), 70_000 + 5 * at, 40 + 0.3 * at) for at in range(9)]
    path = save(reference.block(1, *plots))
    _, _, err = run("track", path, "--sensors", radars)
    assert f"{path}: times restart every 512 s, because no service message has" in err


def test_surface_movement(save: Save) -> None:
    target = {
        1: bytes([25, 70]),
        2: b"\x01",
        3: b"\x60",
        4: reference.time_of_day(50.0),
        6: struct.pack(">HH", 1852, 16384),
        7: struct.pack(">hh", 300, -400),
        8: struct.pack(">HH", 1024, 16384),
        10: struct.pack(">H", 9),
        22: bytes([4 * 2, 4 * 3]) + struct.pack(">h", -4),
    }
    status = {1: bytes([25, 70]), 2: b"\x03", 4: reference.time_of_day(51.0)}
    records = reference.record(target), reference.record(status)
    found = read_asterix(save(reference.block(10, *records)))
    row = found.positions.row(0, named=True)
    assert found.positions.height == 1
    assert (row["time_s"], row["target"], row["east_m"], row["north_m"]) == (50, "9", 300, -400)
    assert (row["speed_m_s"], row["course_deg"]) == (pytest.approx(1024 / 2**14 * 1852), 90.0)
    assert (row["east_sigma_m"], row["north_sigma_m"]) == (2.0, 3.0)
    assert row["covariance_east_north_m2"] == -1.0
    plot = found.plots.select("sensor", "range_nm", "azimuth_deg", "detection").row(0)
    assert plot == ("25/70", 1.0, 90.0, "psr")


def test_old_reports_are_read_by_their_edition(save: Save) -> None:
    records = [
        reference.record(
            {
                1: bytes([25, 50]),
                2: b"\x00\x00",
                3: reference.time_of_day(200.0 + at),
                4: angles(25, -45.25, 15.5),
                5: bytes.fromhex("4BAACD"),
                6: struct.pack(">h", 1000),
                10: struct.pack(">h", 4 * 350),
                16: struct.pack(">HH", 1024, 16384),
            }
        )
        for at in range(4)
    ]
    found = read_asterix(save(b"".join(reference.block(21, one) for one in records)))
    assert found.editions == {21: "0.26"}
    assert found.reports["time_s"].to_list() == [200.0, 201.0, 202.0, 203.0]
    row = found.reports.row(0, named=True)
    assert (row["target"], row["flight_level"], row["course_deg"]) == ("4BAACD", 350.0, 90.0)
    assert (row["latitude_deg"], row["longitude_deg"]) == pytest.approx((-45.25, 15.5), abs=6e-6)


@real
def test_a_real_recording_is_what_the_documents_say() -> None:
    expected = [reference.values(items) for items in reference.plots(JAHORINA.read_bytes())]
    assert len(expected) == 2099
    distinct = list(dict.fromkeys(expected))
    found = read_asterix(JAHORINA)
    assert found.repeated == len(expected) - len(distinct)
    columns = ["time_s", "range_nm", "azimuth_deg", "flight_level", "icao_address", "mode_3a"]
    assert found.plots.select(columns).rows() == distinct
    assert found.sensors.select("sensor", "scan_period_s", "plot_count").row(0) == (
        "23/2",
        5.0078125,
        1676,
    )


@real
def test_a_real_recording_of_a_network() -> None:
    found = read_asterix(NETWORK)
    assert found.sensors["sensor"].to_list() == [
        f"25/{sic}" for sic in (11, 12, 13, 14, 201, 204, 205)
    ]
    place = found.sensors.row(1, named=True)
    told = (
        place["latitude_deg"],
        place["longitude_deg"],
        place["height_m"],
        place["scan_period_s"],
    )
    assert told == pytest.approx((43.57102202219, 16.40606241326, 780.0, 4.9453125), abs=1e-5)
    # each packet was recorded on two lines
    assert found.plots.height == found.repeated == 64


# ------------------------------------------------------------------------------------------------
# tertia track

RADARS = """
[[radar]]
name = "25/12"
range_sigma_m = 60
azimuth_sigma_deg = 0.08

[[radar]]
name = "25/13"
latitude_deg = 43.6
longitude_deg = 16.5
height_m = 100
range_sigma_m = 60
azimuth_sigma_deg = 0.08
scan_period_s = 5
"""


def run(command: str, *arguments: object) -> tuple[int, str, str]:
    result = CliRunner().invoke(cli.app, [command, *map(str, arguments)], catch_exceptions=False)
    return result.exit_code, result.stdout, result.stderr


@pytest.fixture
def radars(tmp_path: Path) -> Path:
    path = tmp_path / "radars.toml"
    path.write_text(RADARS, encoding="utf-8")
    return path


def test_positions_and_periods_come_from_the_recording(
    save: Save, radars: Path, tmp_path: Path
) -> None:
    """The second radar, whose place is wrong, sees another aircraft; the first is its own."""
    pytest.importorskip("pyproj")
    output = tmp_path / "tracks.parquet"
    code, out, err = run("track", save(flight()), "--sensors", radars, "--output", output)
    warning = (
        "tracks 1 and 2 have the same address, 4BAACD, at the same time: are positions that a "
        "sensor reports false, or do two targets send this address?\n"
    )
    assert (code, err) == (0, warning)
    assert "origin of east and north: latitude 43.57" in out
    found = pl.read_parquet(output)
    assert set(found["icao_address"].drop_nulls()) == {"4BAACD"}
    assert set(found["sensor"]) == {"25/12", "25/13"}
    east = found.filter(pl.col("sensor") == "25/12").sort("time_s")["longitude_deg"]
    assert east[-1] > east[0] > 16.406


def test_of_a_recording_what_is_no_target_is_left_out(save: Save, radars: Path) -> None:
    pytest.importorskip("pyproj")
    more = [reference.plot(RADAR, 86_391, 9, 9, descriptor=d) for d in (b"\xb0", b"\xa2", b"\x00")]
    path = save(flight() + reference.block(48, *more) + flight()[-41:])
    code, _, err = run("track", path, "--sensors", radars)
    assert code == 0
    assert f"{path}: 3 plots left out: simulated, of a field monitor, or without a det" in err
    assert f"{path}: 2 plots left out: duplicates" in err


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "latitude_deg = 43.6\nlongitude_deg = 16.5\nheight_m = 100\n",
            "",
            "25/13 has no position",
        ),
        (
            "scan_period_s = 5",
            "",
            "give scan_period_s of 25/13: its recording has none (I034/041)",
        ),
        ('name = "25/13"', 'name = "north"', "north has no position|has plots of 25/13: add"),
        ("height_m = 100\n", "", "height_m of 25/13 is missing"),
        ("range_sigma_m = 60", "", "range_sigma_m of 25/12 is missing"),
    ],
)
def test_what_is_missing_is_told_in_one_line(
    old: str, new: str, message: str, save: Save, radars: Path, tmp_path: Path
) -> None:
    pytest.importorskip("pyproj")
    assert old in RADARS
    radars.write_text(RADARS.replace(old, new, 1), encoding="utf-8")
    output = tmp_path / "tracks.csv"
    code, out, err = run("track", save(flight()), "--sensors", radars, "--output", output)
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert any(part in err for part in message.split("|"))
    assert not output.exists()


def test_a_recording_of_other_things_is_told(save: Save, radars: Path) -> None:
    system = {1: bytes([25, 100]), 2: b"\x01", 4: reference.time_of_day(53.0), 6: b"\x00"}
    others = reference.block(65, reference.record(system)) + reference.block(247, b"\x00")
    code, out, err = run("track", save(others), "--sensors", radars)
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert (
        "has no plots of targets (categories 48, 1); it has 1 message (63, 65 and others), 1 "
        "block of category 247 (versions)" in err
    )


def test_radars_that_should_not_be_used_are_told(save: Save, radars: Path) -> None:
    pytest.importorskip("pyproj")
    head = {1: bytes(RADAR), 2: b"\x01", 3: reference.time_of_day(86_395.0)}
    messages = [reference.record(head | {6: b"\x80" + state}) for state in (b"\x82", b"\x80")]
    path = save(flight() + reference.block(34, *messages))
    code, _, err = run("track", path, "--sensors", radars)
    assert code == 0
    assert err.splitlines()[:2] == [
        f"{path}: radar 25/12 reported at times that its time source is invalid",
        f"{path}: radar 25/12 reported at times that it is not released for operational use",
    ]


def test_codes_count_where_nobody_has_an_address(save: Save, tmp_path: Path) -> None:
    rows = [reference.plot(RADAR, 4.0 * at, 40 + 0.3 * at, 90, code=0o2303) for at in range(9)]
    told = RADARS.split("\n\n", maxsplit=1)[0] + "\nscan_period_s = 4\neast_m = 0\nnorth_m = 0\n"
    (tmp_path / "one.toml").write_text(told, encoding="utf-8")
    path, output = save(reference.block(48, *rows)), tmp_path / "t.csv"
    assert run("track", path, "--sensors", tmp_path / "one.toml", "--output", output)[0] == 0
    assert set(pl.read_csv(output, infer_schema=False)["mode_3a"]) == {"2303"}


@real
def test_tracks_of_a_real_recording_are_those_of_the_library(tmp_path: Path) -> None:
    sites = tmp_path / "radars.toml"
    told = 'name = "23/2"\neast_m = 0\nnorth_m = 0\nrange_sigma_m = 60\nazimuth_sigma_deg = 0.08'
    sites.write_text(f"[[radar]]\n{told}\n", encoding="utf-8")
    output = tmp_path / "tracks.parquet"
    code, _, err = run("track", JAHORINA, "--sensors", sites, "--output", output)
    assert code == 0
    assert err.endswith("423 plots left out: duplicates\n")
    plots = read_asterix(JAHORINA).plots
    address = [-1 if one is None else int(one, 16) for one in plots["icao_address"]]
    code = [-1 if one is None else int(one, 8) for one in plots["mode_3a"]]
    radar = Radar(
        range_sigma=60.0, azimuth_sigma=np.radians(0.08), scan_period=5.0078125, name="23/2"
    )
    expected = track(
        Plots(
            plots["time_s"],
            plots["range_nm"] * 1852.0,
            np.radians(plots["azimuth_deg"]),
            height=(plots["flight_level"] * 30.48).fill_null(np.nan),
            icao_address=address,
            mode_3a=code,
            callsign=plots["callsign"],
        ),
        [radar],
    )
    found = pl.read_parquet(output)
    np.testing.assert_array_equal(found.select("east_m", "north_m").to_numpy(), expected.position)
    assert found["track"].to_list() == expected.track.tolist()
    # the tracks hold what has one address together, and fly
    seen = found.filter(pl.col("plot").is_not_null())
    assert seen.height > 0.98 * plots.height
    kept = seen.group_by("track").agg(pl.col("icao_address").drop_nulls().n_unique())
    assert (kept["icao_address"] <= 1).all()
    # and what they know of codes and callsigns is sent on
    assert found["mode_3a"].null_count() < 0.1 * found.height
    assert set(found["callsign"].drop_nulls()) <= set(plots["callsign"].drop_nulls())


def test_a_truth_in_latitude_and_longitude(save: Save, radars: Path, tmp_path: Path) -> None:
    pytest.importorskip("pyproj")
    tracks = tmp_path / "tracks.parquet"
    assert run("track", save(flight()), "--sensors", radars, "--output", tracks)[0] == 0
    rows = pl.read_parquet(tracks).filter(pl.col("sensor") == "25/12")
    truth, figures = tmp_path / "truth.csv", tmp_path / "figures.json"
    rows.select("time_s", "latitude_deg", "longitude_deg", target=pl.lit("A")).write_csv(truth)
    alone = tmp_path / "one.csv"
    rows.write_csv(alone)
    code, _, err = run("evaluate", alone, "--truth", truth)
    assert (code, err.count("\n")) == (2, 1)
    assert "give origin, " in err
    origin = "43.57100487,16.40600204"
    told = run("evaluate", alone, "--truth", truth, "--origin", origin, "--output", figures)
    assert told[0] == 0, told[2]
    error = pl.read_json(figures).filter(pl.col("figure") == "RMSE")["value"].item()
    assert error < 30.0
    # and the same from ADS-B
    unit = 180 / 2**30
    parts = []
    for row in rows.iter_rows(named=True):
        place = [round(row[name] / unit) for name in ("latitude_deg", "longitude_deg")]
        items = {
            1: bytes(RADAR),
            2: b"\x00",
            5: reference.time_of_day(row["time_s"]),
            7: struct.pack(">ii", *place),
            11: bytes.fromhex("4BAACD"),
        }
        parts.append(reference.block(21, reference.record(items)))
    path = save(b"".join(parts), "adsb.ast")
    told = run("evaluate", alone, "--truth", path, "--origin", origin, "--output", figures)
    assert told[0] == 0, told[2]
    again = pl.read_json(figures).filter(pl.col("figure") == "RMSE")["value"].item()
    assert again == pytest.approx(error, abs=0.5)
    code, _, err = run("evaluate", alone, "--truth", save(flight()), "--origin", origin)
    assert (code, err.count("\n")) == (1, 1)
    assert "neither ADS-B reports (category 21) nor system tracks (62)" in err


# ------------------------------------------------------------------------------------------------
# tracks out


def system_tracks(count: int = 200) -> pl.DataFrame:
    """Return tracks on the steps of category 62, some without some of the items."""
    rng = np.random.default_rng(62)

    def steps(size: float, low: int, high: int, missing: float = 0.2) -> list[float | None]:
        whole = rng.integers(low, high, count)
        there = rng.random(count) >= missing
        return [size * int(one) if here else None for one, here in zip(whole, there, strict=True)]

    def pair(first: str, second: str, size: float, low: int, high: int) -> dict[str, object]:
        values = steps(size, low, high)
        other = [None if one is None else size * int(rng.integers(low, high)) for one in values]
        return {first: values, second: other}

    angle, foot = 180 / 2**25, 0.3048
    return pl.DataFrame(
        {
            "time_s": np.arange(count) / 128 + 86_399.0,
            "target": [str(number) for number in rng.integers(0, 65_536, count)],
            **pair("latitude_deg", "longitude_deg", angle, -(2**23), 2**23),
            **pair("east_m", "north_m", 0.5, -(2**23), 2**23),
            **pair("velocity_east_m_s", "velocity_north_m_s", 0.25, -(2**15), 2**15),
            **pair("east_sigma_m", "north_sigma_m", 0.5, 0, 2**16),
            **pair("velocity_east_sigma_m_s", "velocity_north_sigma_m_s", 0.25, 0, 256),
            "covariance_east_north_m2": [
                None if one is None else one * abs(one) for one in steps(0.5, -(2**15), 2**15)
            ],
            "height_m": steps(6.25 * foot, -200, 20_000),
            "flight_level": steps(0.25, -60, 6_000),
            "vertical_rate_m_s": steps(6.25 * foot / 60, -500, 500),
            "icao_address": [None if k % 7 == 0 else f"{0x4B0000 + k:06X}" for k in range(count)],
            "mode_3a": [None if k % 5 == 0 else f"{k:04o}" for k in range(count)],
            "callsign": [None if k % 3 == 0 else f"TRT {k}" for k in range(count)],
            "confirmed": rng.random(count) < 0.5,
            "coasted": rng.random(count) < 0.5,
            **{
                name: [None if k % 4 == 0 else k % 3 for k in range(count)]
                for name in ("transversal", "longitudinal", "vertical")
            },
        }
    )


def test_tracks_are_read_as_they_were_written(tmp_path: Path) -> None:
    tracks = system_tracks()
    write_asterix(tracks, tmp_path / "tracks.ast", source=(25, 100))
    found = read_asterix(tmp_path / "tracks.ast")
    assert (found.damaged, found.skipped, set(found.tracks["sensor"])) == (0, {}, {"25/100"})
    pl.testing.assert_frame_equal(
        found.tracks.select(tracks.columns), tracks, rel_tol=1e-14, abs_tol=0
    )
    # and from what was read, the same octets
    write_asterix(found.tracks, tmp_path / "again.ast", source=(25, 100))
    assert (tmp_path / "again.ast").read_bytes() == (tmp_path / "tracks.ast").read_bytes()


def test_another_decoder_reads_what_was_written(tmp_path: Path) -> None:
    base = pytest.importorskip("asterix.base")
    generated = pytest.importorskip("asterix.generated")
    tracks = system_tracks(40)
    write_asterix(tracks, tmp_path / "tracks.ast")
    edition = generated.manifest["CATS"][62][-1]
    records = []
    for category, body in reference.blocks((tmp_path / "tracks.ast").read_bytes()):
        assert category == 62
        rest = base.Bits.from_bytes(body)
        while len(rest):
            record, rest = edition.cv_record.parse(base.ParsingMode.StrictParsing, rest)
            records.append(record)
    assert len(records) == 40
    expected = tracks.select("east_m", "confirmed", "coasted").rows()
    for record, (east, confirmed, coasted) in zip(records, expected, strict=True):
        item = record.get_item("100")
        found = item and item.variation.get_item("X").variation.content.as_quantity("m")
        assert found == east
        status = record.get_item("080").variation
        assert status.get_item("CNF").as_uint() == (not confirmed)
        there = status.get_item("CST")
        assert (there is not None and there.as_uint() == 1) == coasted


def test_a_row_without_a_plot_is_coasted(tmp_path: Path) -> None:
    rows = pl.DataFrame({"time_s": [1.0, 2.0], "track": [1, 1], "plot": [None, 3]})
    write_asterix(rows, tmp_path / "tracks.ast")
    assert read_asterix(tmp_path / "tracks.ast").tracks["coasted"].to_list() == [True, False]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"east_m": 5e6}, "row 0: east_m is 5e\\+06, outside the range of category 62"),
        ({"east_sigma_m": -1.0}, "row 0: east_sigma_m is -1, outside"),
        ({"callsign": "A/B"}, "callsign has values that cannot be encoded"),
        ({"mode_3a": "7799"}, "mode_3a has values that cannot be encoded"),
        ({"icao_address": "1FFFFFF"}, "icao_address has a number that needs more than 24 bits"),
        ({"track": None, "target": None}, "tracks have no column track or target"),
        ({"time_s": None}, "tracks have no column time_s"),
    ],
)
def test_what_no_item_holds_is_refused(
    change: dict[str, object], message: str, tmp_path: Path
) -> None:
    table = {"time_s": 1.0, "track": 1, "north_m": 0.0, "north_sigma_m": 1.0} | change
    tracks = pl.DataFrame({name: [one] for name, one in table.items() if one is not None})
    with pytest.raises(ValueError, match=message):
        write_asterix(tracks, tmp_path / "tracks.ast")


def test_tracks_of_the_command(save: Save, radars: Path, tmp_path: Path) -> None:
    pytest.importorskip("pyproj")
    written = tmp_path / "tracks.ast"
    code, out, _ = run("track", save(flight()), "--sensors", radars, "--output", written)
    assert code == 0
    assert f"rows to {written}" in out
    run("track", save(flight()), "--sensors", radars, "--output", tmp_path / "tracks.csv")
    expected = pl.read_csv(tmp_path / "tracks.csv")
    found = read_asterix(written).tracks
    assert found.height == expected.height > 0
    assert found["time_s"].to_list() == [round(t * 128) / 128 for t in expected["time_s"]]
    for name, step in (("east_m", 0.5), ("velocity_north_m_s", 0.25), ("latitude_deg", 6e-6)):
        np.testing.assert_allclose(found[name], expected[name], atol=step / 2)


def test_sigmas_without_room_are_left_out(tmp_path: Path) -> None:
    sigmas = {"velocity_east_sigma_m_s": [63.9, 63.8], "velocity_north_sigma_m_s": [1.0, 1.0]}
    rows = pl.DataFrame({"time_s": [1.0, 2.0], "track": [1, 1], **sigmas})
    write_asterix(rows, tmp_path / "tracks.ast")
    found = read_asterix(tmp_path / "tracks.ast").tracks
    assert found["velocity_east_sigma_m_s"].to_list() == [None, 63.75]


def test_what_is_between_steps_is_rounded(tmp_path: Path) -> None:
    rows = pl.DataFrame(
        {"time_s": [86_399.999], "track": ["B"], "east_m": [0.26], "north_m": [9.8]}
    )
    write_asterix(rows, tmp_path / "tracks.ast")
    row = read_asterix(tmp_path / "tracks.ast").tracks.row(0, named=True)
    assert [row[name] for name in ("time_s", "target", "east_m", "north_m")] == [
        0.0,
        "1",
        0.5,
        10.0,
    ]
