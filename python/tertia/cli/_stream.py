"""`tertia track --stream`: plots that come line by line, tracks that go row by row."""

import csv
import json
import math
import os
import re
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, BinaryIO, Literal, TypeAlias

import numpy as np
import polars as pl
import typer

from tertia.cli import _tables
from tertia.cli._measurements import doubt_degrees
from tertia.cli._pipe import Lines, Quiet
from tertia.cli._radar_plots import (
    AZIMUTH,
    DIGITS_TOLD,
    HEIGHTS,
    RADAR,
    RANGES,
    TIME,
    doubt_unit,
)
from tertia.cli._radars import RadarSites
from tertia.cli._terminal import INTERRUPTED, WRONG_USAGE, counted, fail, note
from tertia.tables._track_rows import IDENTITIES, Clock, Identities, track_rows
from tertia.tracker import NO_IDENTITY, Plots, PlotStatus, Tracker, TrackTable

Rows: TypeAlias = Literal["csv", "jsonl"]

STDIN = Path("-")
_MICROSECONDS = 1e6
# before Python 3.11 a fraction of a second has six digits, and an offset all of its own
_DATE = len("2026-03-01")
_FRACTION = re.compile(r"\.\d+")
_OFFSET = re.compile(r"(?:[Zz]|(?<=\d)([+-]\d\d)(?::?(\d\d))?)$")
# of the shortest scan
_USUAL_LATENCY = 0.25
# so many plots of a scan tell whether a unit is right, and more are not kept for that
_ENOUGH, _DOUBTED = 100, 1000
# rows that are written at once while plots come faster than they are tracked
_WRITTEN = 1000


@dataclass(slots=True)
class _Plot:
    """A plot in the units of the library, and its line; azimuth and others as they were read."""

    row: int
    time: float
    range: float
    azimuth: float
    radar: int
    height: float
    identity: int
    read: Mapping[str, float]


def _six_digits(fraction: re.Match[str]) -> str:
    return f"{fraction[0][:7]:0<7}"


def _whole_offset(offset: re.Match[str]) -> str:
    return "+00:00" if offset[1] is None else f"{offset[1]}:{offset[2] or '00'}"


class _BadLineError(ValueError):
    """A line that is no plot."""


class _Fields:
    """Makes plots of lines; the first line tells whether they are CSV or JSON."""

    def __init__(self, columns: Mapping[str, str], sites: RadarSites, name: str) -> None:
        self._columns = columns
        self._names = {radar: number for number, radar in enumerate(sites.names)}
        self._file = name
        self._header: list[str] | None = None
        self._zoned = False
        self.clock: Clock | None = None
        self.kind: Rows | None = None
        self.identity: str | None = None

    def begin(self, line: str) -> bool:
        """Take the first line, and return whether it was a header."""
        if line.startswith("{"):
            self.kind = "jsonl"
            return False
        self.kind, self._header = "csv", [name.strip() for name in next(csv.reader([line]))]
        wanted = [self._called(name) for name in (TIME, AZIMUTH)] + list(self._columns.values())
        several = len(self._names) > 1
        frame = pl.DataFrame(schema=dict.fromkeys(self._header, pl.String))
        path = Path(self._file)
        _tables.require_columns(frame, path, wanted + [self._called(RADAR)] * several)
        if self._first(RANGES, self._header) is None:
            told = f"{' or '.join(RANGES)}; {_tables.told_columns(frame)}"
            fail(f"{path} has no column {told}", WRONG_USAGE)
        self.identity = self._first(IDENTITIES, self._header)
        return True

    def plot(self, line: str, row: int) -> _Plot:
        """Return the plot of a line, or raise `_BadLineError`."""
        fields = self._fields(line)
        distance = self._first(RANGES, fields)
        if distance is None:
            raise _BadLineError(f"there is no {' or '.join(RANGES)}")
        height = self._first(HEIGHTS, fields)
        read = {name: self._number(fields, name) for name in (distance, AZIMUTH)}
        if height is not None:
            read[height] = self._number(fields, height)
        return _Plot(
            row,
            self._time(fields),
            read[distance] * RANGES[distance],
            math.radians(read[AZIMUTH]),
            self._radar(fields),
            math.nan if height is None else read[height] * HEIGHTS[height],
            self._identity(fields),
            read,
        )

    def _called(self, name: str) -> str:
        return self._columns.get(name, name)

    def _first(self, names: Mapping[str, object], there: Any) -> str | None:
        """Return the first that is given, or else the first that is there."""
        given = [name for name in names if name in self._columns]
        return next(iter(given or [name for name in names if name in there]), None)

    def _fields(self, line: str) -> Mapping[str, Any]:
        if self._header is None:
            try:
                fields = json.loads(line)
            except ValueError:
                fields = None
            if not isinstance(fields, dict):
                raise _BadLineError("it is no JSON object")
            return fields
        cells = next(csv.reader([line]))
        if len(cells) != len(self._header):
            told = f"it has {counted(len(cells), 'field')}, the header has {len(self._header)}"
            raise _BadLineError(told)
        return dict(zip(self._header, cells, strict=True))

    def _text(self, fields: Mapping[str, Any], name: str) -> str | None:
        """Return a field as text, None where it says that there is nothing."""
        value = fields.get(self._called(name))
        if value is None:
            return None
        whole = isinstance(value, float) and value.is_integer()
        text = str(int(value) if whole else value).strip()
        return None if _tables.is_mark(text) else text

    def _number(self, fields: Mapping[str, Any], name: str) -> float:
        value = fields.get(self._called(name))
        try:
            # most are numbers
            number = math.nan if value is None or isinstance(value, bool) else float(value)
        except (TypeError, ValueError):
            number = math.nan
        if math.isfinite(number):
            return number
        text = self._text(fields, name)
        if text is None:
            return math.nan
        raise _BadLineError(f"{self._called(name)} is {text!r}; it must be a finite number")

    def _time(self, fields: Mapping[str, Any]) -> float:
        text = self._text(fields, TIME)
        if text is None:
            raise _BadLineError(f"{self._called(TIME)} is missing")
        try:
            return self._seconds(text)
        except ValueError:
            raise _BadLineError(
                f"{self._called(TIME)} is {text!r}; it must be a number of seconds or a date with "
                "time, as the others are"
            ) from None

    def _seconds(self, text: str) -> float:
        """Return a time as seconds; of the first one it is learnt what times look like."""
        try:
            number: float | None = float(text)
        except ValueError:
            number = None
        if number is not None:
            if self.clock is None:
                self.clock = Clock(pl.Float64(), 0, 1.0)
            if self.clock.dated or not math.isfinite(number):
                raise ValueError
            return number
        day, rest = text[:_DATE], text[_DATE:]
        rest = _FRACTION.sub(_six_digits, _OFFSET.sub(_whole_offset, rest))
        moment = datetime.fromisoformat(day + rest)
        zoned = moment.tzinfo is not None
        since = moment if zoned else moment.replace(tzinfo=timezone.utc)
        ticks = pl.Series([since.astimezone(timezone.utc)]).to_physical().item()
        if self.clock is None:
            self._zoned = zoned
            self.clock = Clock.of(
                pl.Series([ticks]).cast(pl.Datetime("us", "UTC" if zoned else None))
            )
        if not self.clock.dated or zoned != self._zoned:
            raise ValueError
        return float(ticks - self.clock.midnight) / _MICROSECONDS

    def _radar(self, fields: Mapping[str, Any]) -> int:
        name = self._text(fields, RADAR)
        if name is None and len(self._names) == 1 and self._called(RADAR) not in fields:
            return 0
        if name is None:
            raise _BadLineError(f"{self._called(RADAR)} is missing")
        if name not in self._names:
            told = ", ".join(self._names)
            raise _BadLineError(f"{self._called(RADAR)} is {name!r}; the radars are {told}")
        return self._names[name]

    def _identity(self, fields: Mapping[str, Any]) -> int:
        if self.identity is None:
            self.identity = self._first(IDENTITIES, fields)
        text = None if self.identity is None else self._text(fields, self.identity)
        if self.identity is None or text is None:
            return NO_IDENTITY
        base = IDENTITIES[self.identity]
        try:
            number = int(text, base)
        except ValueError:
            number = NO_IDENTITY
        if not 0 <= number < 2**63:
            told = f"{self._called(self.identity)} is {text!r}; it must be {DIGITS_TOLD[base]}"
            raise _BadLineError(told)
        return number


class Stream:
    """Tracks plots as their lines come, and writes the rows of confirmed tracks.

    Plots are gathered for `latency` seconds of their own time, by default a quarter of the shortest
    scan, or until nothing has come for as long.
    """

    def __init__(
        self,
        tracker: Tracker,
        sites: RadarSites,
        columns: Mapping[str, str],
        *,
        latency: float | None,
        rows: Rows | None,
        name: str,
    ) -> None:
        periods = [radar.scan_period for radar in sites.radars]
        self._tracker, self._sites, self._name = tracker, sites, name
        self._latency = _USUAL_LATENCY * min(periods) if latency is None else latency
        self._scan = max(periods)
        self._rows = rows
        self._fields = _Fields(columns, sites, name)
        self._gathered: list[_Plot] = []
        self._ready: list[TrackTable] = []
        self._doubted: list[_Plot] | None = []
        self._now: float | None = None
        self._given = self._bad = self._read = 0
        self._statuses: Counter[int] = Counter()
        self._headed = False

    def run(self, descriptor: int, out: BinaryIO) -> None:
        """Read until nobody writes any more, or nobody reads, or somebody interrupts."""
        code = 0
        try:
            try:
                self._take_all(Lines(descriptor, max(self._latency, 1e-3)), out)
            except KeyboardInterrupt:
                code = INTERRUPTED
            self._flush(out)
            self._write(out)
        except BrokenPipeError:
            # nothing more can be written there when the program ends
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        except OSError as error:
            fail(f"cannot read {self._name}: {error.strerror}")
        self._say()
        if code:
            raise typer.Exit(code)

    def _take_all(self, lines: Lines, out: BinaryIO) -> None:
        number = 0
        for line in lines:
            if isinstance(line, Quiet):
                if line is Quiet.LONG:
                    self._flush(out)
                self._write(out)
                continue
            number += 1
            text = line.decode("utf-8-sig" if number == 1 else "utf-8", "replace").strip()
            if not text or (self._fields.kind is None and self._fields.begin(text)):
                continue
            self._read += 1
            try:
                plot = self._fields.plot(text, self._read - 1)
            except _BadLineError as error:
                self._bad += 1
                if self._bad == 1:
                    note(f"tertia: {self._name}, line {number}: {error}; such lines are left out")
                continue
            self._take(plot, out)

    def _take(self, plot: _Plot, out: BinaryIO) -> None:
        plot.time = self._going_on(plot.time)
        if self._gathered:
            since = plot.time - self._gathered[0].time
            # what is older than a scan is not of this stretch either: a clock has leapt
            if not -self._scan <= since < self._latency:
                self._flush(out)
        self._gathered.append(plot)

    def _going_on(self, time: float) -> float:
        """Return the time of a clock that does not begin again."""
        period = self._tracker.clock_period
        if period is not None and self._fields.clock is not None and self._fields.clock.dated:
            fail("--clock-period is for seconds; these plots have dates", WRONG_USAGE)
        if period is not None and self._now is not None:
            time += period * round((self._now - time) / period)
        self._now = time
        return time

    def _flush(self, out: BinaryIO) -> None:
        """Track what was gathered, and write what became of it."""
        gathered, self._gathered = self._gathered, []
        if not gathered:
            return
        self._doubt(gathered)

        def column(name: str) -> np.ndarray[Any, Any]:
            return np.array([getattr(plot, name) for plot in gathered])

        radar = column("radar")
        plots = Plots(
            column("time"),
            column("range"),
            column("azimuth") + self._sites.norths[radar],
            sensor=radar,
            height=column("height"),
            identity=column("identity"),
        )
        table = self._tracker.update(plots)
        self._statuses.update(table.track_of_plot[table.track_of_plot < 0].tolist())
        numbers = np.append(column("row"), -1)
        own = np.where(table.plot < 0, -1, table.plot - self._given)
        self._given += len(gathered)
        self._ready.append(replace(table, plot=numbers[own]))
        if sum(map(len, self._ready)) >= _WRITTEN:
            self._write(out)

    def _write(self, out: BinaryIO) -> None:
        """Write the rows that are ready."""
        ready, self._ready = self._ready, []
        if not ready or (self._headed and not any(map(len, ready))):
            return
        columns = {
            name: np.concatenate([getattr(one, name) for one in ready])
            for name in TrackTable.__slots__
        }
        clock = self._fields.clock or Clock(pl.Float64(), 0, 1.0)
        table = TrackTable(**columns)
        rows = track_rows(
            table,
            clock=clock,
            identities=Identities(self._fields.identity or "identity"),
            radars=self._sites.names,
            plans=self._tracker.plans,
            geodetic=self._sites.places.geodetic(table.position),
        )
        if (self._rows or self._fields.kind) == "jsonl":
            out.write(_tables.as_lines(rows))
        else:
            out.write(rows.write_csv(include_header=not self._headed).encode())
        self._headed = True
        out.flush()

    def _doubt(self, plots: Sequence[_Plot], *, last: bool = False) -> None:
        """Say once, after a scan or with the last plots, that a unit looks wrong."""
        if self._doubted is None:
            return
        self._doubted += plots
        times = [plot.time for plot in self._doubted]
        enough = len(times) >= _ENOUGH and max(times) - min(times) >= self._scan
        if not (enough or last or len(times) >= _DOUBTED):
            return
        reads = [plot.read for plot in self._doubted]
        self._doubted = None
        for name in (AZIMUTH, *RANGES, *HEIGHTS):
            values = pl.Series([read[name] for read in reads if name in read], dtype=pl.Float64)
            if name == AZIMUTH:
                doubt_degrees(values.to_numpy())
            else:
                doubt_unit(name, values)

    def _say(self) -> None:
        """Say at the end what was left out; fail if that was everything."""
        if not self._read:
            fail(f"{self._name} is empty")
        if self._bad == self._read:
            fail(f"{self._name}: no line can be used, of {counted(self._read, 'line')}")
        self._doubt([], last=True)
        if self._bad:
            note(f"{self._bad} of {counted(self._read, 'line')} left out")
        for status, count in sorted(self._statuses.items(), reverse=True):
            note(f"{counted(count, 'plot')} refused: {PlotStatus(status).message}")
