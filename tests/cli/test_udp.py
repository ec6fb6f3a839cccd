"""`tertia track --udp`: plots in ASTERIX as they arrive, and system tracks that are sent on."""

import io
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import polars as pl
import polars.testing
import pytest
from reference import asterix as reference
from terminal import assert_refused, run

from tertia.io import read_asterix

COMMAND = [sys.executable, "-c", "from tertia.cli import main; main()", "track"]
RADARS = {"25/12": (0.0, 0.0), "25/13": (60e3, 5e3)}
SITES = "name,east_m,north_m,range_sigma_m,azimuth_sigma_deg,scan_period_s\n" + "".join(
    f"{name},{east},{north},50,0.07,4\n" for name, (east, north) in RADARS.items()
)
MIDNIGHT, PERIOD = 86_400.0, 4.0
WAIT_S = 60.0


def packets() -> list[bytes]:
    """Return what two radars see of four aircraft in two minutes about midnight, in packets."""
    random = np.random.default_rng(5)
    found = []
    for scan in np.arange(MIDNIGHT - 60.0, MIDNIGHT + 60.0, PERIOD):
        for name, place in RADARS.items():
            codes = tuple(map(int, name.split("/")))
            records = []
            for k in range(4):
                moment = scan + k
                target = np.array([20e3 + 8e3 * k + 100 * (moment - MIDNIGHT), 30e3])
                east, north = target - place
                miles = (np.hypot(east, north) + 40 * random.standard_normal()) / 1852
                degrees = np.degrees(np.arctan2(east, north)) + 0.05 * random.standard_normal()
                records.append(
                    reference.plot(codes, moment, miles, degrees % 360, address=0x4B0000 + k)
                )
            found.append(reference.block(48, *records))
    return found


@pytest.fixture
def sites(tmp_path: Path) -> Path:
    path = tmp_path / "sites.csv"
    path.write_text(SITES, encoding="utf-8")
    return path


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    """Return a socket that hears what is sent to it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as heard:
        heard.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        heard.bind(("127.0.0.1", 0))
        heard.settimeout(WAIT_S)
        yield heard


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


@contextmanager
def receiving(port: int, *options: object) -> Iterator[subprocess.Popen[bytes]]:
    """Start the command, and wait until it hears its port."""
    arguments = [*COMMAND, "--udp", f"127.0.0.1:{port}", *map(str, options)]
    pipe = subprocess.PIPE
    with subprocess.Popen(arguments, stdout=pipe, stderr=pipe) as process:
        assert process.stderr is not None
        first = process.stderr.readline()
        assert first.startswith(b"receiving at"), first + process.stderr.read()
        try:
            yield process
        finally:
            process.kill()


def send(port: int, payloads: list[bytes]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        for payload in payloads:
            one.sendto(payload, ("127.0.0.1", port))


def heard_by(listener: socket.socket, last: float) -> pl.DataFrame:
    """Return the tracks of packets, until one is later than a time."""
    found: list[bytes] = []
    while True:
        found.append(listener.recv(1 << 16))
        tracks = read_asterix(found).tracks
        if float(tracks["time_s"].max()) > last:  # type: ignore[arg-type]
            return tracks


def end(process: subprocess.Popen[bytes]) -> tuple[bytes, str]:
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=WAIT_S)
    return out, err.decode()


def test_packets_are_read_as_a_file_is(tmp_path: Path) -> None:
    path = tmp_path / "plots.ast"
    path.write_bytes(b"".join(packets()))
    found, plain = read_asterix(packets()), read_asterix(path)
    assert found.plots.equals(plain.plots)
    assert found.sensors.equals(plain.sensors)
    assert read_asterix([*packets(), b"none"]).other_packets == 1
    with pytest.raises(ValueError, match="has no packet that contains ASTERIX"):
        read_asterix([b"none"])


def old_packets() -> list[bytes]:
    """Return what two radars see of an aircraft about midnight, with the time in some packets."""
    found = [reference.block(1, reference.old_plot((25, 13), MIDNIGHT - 64.0, 9.0))]
    for scan in np.arange(MIDNIGHT - 60.0, MIDNIGHT + 60.0, PERIOD):
        found.append(reference.old_service((25, 12), 1, scan))
        for name, place in RADARS.items():
            east, north = np.array([50e3 + 100 * (scan - MIDNIGHT), 3e3]) - place
            angle = round(np.degrees(np.arctan2(east, north)) % 360 / 360 * 65536)
            plot = struct.pack(">HH", round(np.hypot(east, north) / 1852 * 128), angle)
            items = {"040": plot, "070": b"\x04\xc3"}
            codes = tuple(map(int, name.split("/")))
            found.append(reference.block(1, reference.old_plot(codes, scan + 1, 0, **items)))
    return found


def test_truncated_times_are_completed(sites: Path) -> None:
    """By the last service message, also of packets before; without any there is no time."""
    port = free_port()
    with receiving(port, "--sensors", sites, "--registration", "off", "--latency", 2) as process:
        first, *others = old_packets()
        send(port, [first])
        time.sleep(1.0)  # the first plot is read alone, before any service message
        for payload in others:
            send(port, [payload])
            time.sleep(0.01)
        time.sleep(1.0)
        out, err = end(process)
    assert "60 plots arrived" in err
    assert "the time of day is unknown until a service message" in err
    found = pl.read_csv(io.StringIO(out.decode()), infer_schema_length=None)
    assert set(found["mode_3a"]) == {2303}
    assert found["time_s"].max() == MIDNIGHT + 57.0


def test_rows_are_those_of_the_recording(sites: Path, tmp_path: Path) -> None:
    """The same tracks as from a file; packets that are none, and other radars, are said."""
    path, output, port = tmp_path / "plots.ast", tmp_path / "tracks.csv", free_port()
    path.write_bytes(b"".join(packets()))
    options = ("--sensors", sites, "--registration", "off")
    assert run("track", path, *options, "--output", output).code == 0
    other = reference.block(48, reference.plot((7, 7), MIDNIGHT - 60, 10.0, 10.0))
    # all at once, when it ends
    with receiving(port, *options, "--latency", 1000) as process:
        send(port, [*packets(), b"none", other])
        time.sleep(1.0)
        out, err = end(process)
    assert "240 plots arrived" in err
    assert "1 packet left out" in err
    assert "radar 7/7 is not in the file of sensors\n" in err
    assert "1 plot of 1 other radar left out" in err
    found = pl.read_csv(io.StringIO(out.decode()), infer_schema_length=None)
    wanted = pl.read_csv(output, infer_schema_length=None).filter("confirmed")
    # they may come yet
    for name in ("mode_3a", "callsign"):
        assert found.drop_in_place(name).null_count() == found.height
    assert found.columns == wanted.columns
    order = ["time_s", "track"]
    pl.testing.assert_frame_equal(found.sort(order), wanted.sort(order), check_exact=True)


def test_tracks_are_sent_as_they_are_known(sites: Path, listener: socket.socket) -> None:
    """The last scan's tracks arrive in category 62 while the stream goes on, past midnight."""
    port, to = free_port(), listener.getsockname()[1]
    options = ("--sensors", sites, "--latency", 0.2, "--send", f"127.0.0.1:{to}")
    with receiving(port, *options) as process:
        send(port, packets())
        # its clocks are estimated, too: times are nearly those of the plots
        tracks = heard_by(listener, MIDNIGHT + 58.5)
        assert process.poll() is None
        out, err = end(process)
    assert out == b""
    assert "240 plots arrived" in err
    assert tracks["icao_address"].n_unique() == 4
    last = tracks.filter(pl.col("time_s") > MIDNIGHT + 40.0)
    place = 20e3 + 8e3 * (last["icao_address"].str.to_integer(base=16) - 0x4B0000)
    off = last["east_m"] - place - 100.0 * (last["time_s"] - MIDNIGHT)
    assert last.height > 20
    assert np.sqrt(np.mean((off / last["east_sigma_m"]).to_numpy() ** 2)) < 1.5


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--udp", "0"), "'0' is not a port: give a number from 1 to 65535"),
        (("--udp", "port"), "'port' is not a port: give a number from 1 to 65535"),
        (("--udp", "8600", "plots.csv"), "--udp cannot be used with files or --control"),
        (("--udp", "8600", "--send", "nowhere"), "'nowhere' is not a port"),
        (("--udp", "192.0.2.1:8600"), "cannot receive at 192.0.2.1:8600"),
        (("plots.csv", "--send", "127.0.0.1:8600"), "--latency, --rows, --send and --control can"),
    ],
)
def test_wrong_usage(options: tuple[str, ...], message: str, sites: Path) -> None:
    done = run("track", *options, "--sensors", sites)
    assert_refused(done, message)
