"""`tertia track --udp`: plots that arrive in ASTERIX, and system tracks that are sent."""

from __future__ import annotations

import socket
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import closing

import polars as pl

from tertia._result import counted
from tertia.cli.files.asterix import IDENTITIES, measured
from tertia.cli.terminal.say import WRONG_USAGE, fail, note
from tertia.io import read_asterix
from tertia.sensors import Radar
from tertia.tables._parts import Part
from tertia.tables._records import Reader
from tertia.tables._sensors import Sensors
from tertia.tables._times import Clock
from tertia.tables._track import PLOTS

# first byte of the service messages of radars whose plots have truncated times
_SERVICE = b"\x02"
# size in bytes of the kernel's buffer for packets that arrive while plots are tracked
_BUFFER = 1 << 23
_PORTS = 1 << 16
_PLOTS = {
    "time_s": pl.Float64,
    "sensor": pl.String,
    "range_nm": pl.Float64,
    "azimuth_deg": pl.Float64,
}


class Datagrams:
    """Conversion of the payloads of UDP packets to plots, as `stream` does for lines.

    `row` counts the plots of categories 48 and 1, `bad` the packets without such plots.
    """

    kind = None
    line = 0

    def __init__(self, name: str, columns: Mapping[str, str], sensors: Sensors[Radar]) -> None:
        self.name, self.sensors = name, sensors
        self.clock: Clock | None = None
        self.row = self.bad = 0
        self._columns = columns
        self._unknown: Counter[str] = Counter()
        # the last block of service messages; its full time completes the times of the next plots
        self._service: list[bytes] = []

    @property
    def identities(self) -> Sequence[str]:
        """The names of the columns of identities."""
        return IDENTITIES

    def of(self, packets: Sequence[bytes]) -> pl.DataFrame:
        """Return the plots of packets by the schema; `row` counts from the first packet of all."""
        try:
            found = read_asterix([*self._service, *packets])
        except ValueError as error:
            self._leave_out(len(packets), str(error))
            return self._none()
        for packet in packets:
            if packet.startswith(_SERVICE):
                self._service = [packet[: int.from_bytes(packet[1:3], "big")]]
        if found.truncated_times:
            self._leave_out(
                len(packets), "the time of day is unknown until a service message arrives"
            )
            return self._none()
        if found.other_packets:
            self._leave_out(found.other_packets, "a packet does not contain ASTERIX")
        if found.damaged:
            self._leave_out(found.damaged, found.first_damage)
        plots = measured(found)
        known = pl.col("sensor").is_in(self.sensors.names)
        self._doubt(plots.filter(~known)["sensor"])
        rows = self._read(plots.filter(known, pl.col("time_s").is_not_null()))
        self.row += rows.height
        return rows

    def _none(self) -> pl.DataFrame:
        return self._read(pl.DataFrame(schema=_PLOTS))

    def _read(self, plots: pl.DataFrame) -> pl.DataFrame:
        reader = Reader(Part(plots, self.name), PLOTS, self._columns, self.sensors.names)
        rows = reader.rows()
        if self.clock is None and plots.height:
            self.clock = Clock.of(rows["time"])
        return rows.with_columns(pl.col("row") + self.row)

    def _doubt(self, sensors: pl.Series) -> None:
        """Count the plots of radars not in the sensors file, and report the first such radar."""
        if sensors.len() and not self._unknown:
            note(f"tertia: {self.name}: radar {sensors[0]} is not in the file of sensors")
        self._unknown.update(sensors.to_list())

    def _leave_out(self, count: int, reason: str) -> None:
        if not self.bad:
            note(f"tertia: {self.name}: {reason}; such packets are left out")
        self.bad += count

    def end(self) -> None:
        """Print how many plots arrived, and how many were left out."""
        note(f"{counted(self.row, 'plot')} arrived")
        if self.bad:
            note(f"{counted(self.bad, 'packet')} left out")
        if self._unknown:
            radars = counted(len(self._unknown), "other radar")
            note(f"{counted(self._unknown.total(), 'plot')} of {radars} left out")


class TrackSender:
    """Sends rows of tracks by UDP, in category 62."""

    def __init__(self, address: str) -> None:
        self._to = _address(address, "--send")
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def write(self, rows: pl.DataFrame, kind: object) -> None:  # as in the writer of lines
        """Send rows, in packets of whole data blocks."""
        from tertia.io._asterix_writer import asterix_blocks  # noqa: PLC0415  # rarely used

        for block in asterix_blocks(rows, (0, 0)) if rows.height else []:
            self._socket.sendto(block, self._to)


def receiver(address: str) -> socket.socket:
    """Return a socket that receives packets at a port, from a multicast group if one is given."""
    host, port = _address(address if ":" in address else f"0.0.0.0:{port_of(address)}", "--udp")
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
        made.bind((host, port))
        if socket.inet_aton(host)[0] >> 4 == 0b1110:
            group = socket.inet_aton(host) + socket.inet_aton("0.0.0.0")
            made.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
    except OSError as error:
        with closing(made):
            fail(f"cannot receive at {address}: {error.strerror or error}")
    return made


def _address(text: str, option: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    try:
        return socket.gethostbyname(host), port_of(port)
    except OSError as error:
        fail(f"{option} {text}: {error.strerror or error}", WRONG_USAGE)


def port_of(text: str) -> int:
    """Return the number of a port; exit with an error if it is invalid."""
    if not text.isdecimal() or not 0 < int(text) < _PORTS:
        fail(f"{text!r} is not a port: give a number from 1 to {_PORTS - 1}", WRONG_USAGE)
    return int(text)
