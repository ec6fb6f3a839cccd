"""`tertia track --stream`: tracks from a stream of plots, written row by row."""

import os
import re
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import polars as pl
import typer

from tertia._arrays import IntArray
from tertia._result import counted
from tertia.cli.commands.control import Control, request_of
from tertia.cli.commands.datagrams import Datagrams, TrackSender, receiver
from tertia.cli.files.read import TIME_FORMAT, has_lines
from tertia.cli.files.text import cells_of, json_of, separator_of, with_point
from tertia.cli.files.write import as_lines
from tertia.cli.terminal.pipe import Lines, Packets, Quiet
from tertia.cli.terminal.say import INTERRUPTED, WRONG_USAGE, fail, note, reading
from tertia.flightplan import FlightPlan
from tertia.sensors import Radar
from tertia.tables._doubts import doubt_unit
from tertia.tables._identities import IDENTIFIED
from tertia.tables._names import plain_name
from tertia.tables._parts import Part
from tertia.tables._records import Reader
from tertia.tables._sensors import Sensors
from tertia.tables._times import Clock
from tertia.tables._track import plots_of, schema_of, track_rows
from tertia.tracker import PlotStatus, Tracker, TrackTable
from tertia.tracker._sensors import interval

Rows: TypeAlias = Literal["csv", "jsonl"]
Cells: TypeAlias = Mapping[str, Any]

STDIN = Path("-")
# latency as a share of the shortest scan period
_USUAL_LATENCY = 0.25
# number of plots of one batch from which a unit is checked
_ENOUGH = 100
# number of the latest plots that rows of a stream with a lag can refer to
_REMEMBERED = 100_000
# number of rows that are written together while plots arrive faster than they are tracked
_WRITTEN = 1000


def source(files: Sequence[Path]) -> Path:
    """Return the source of a stream of lines; exit with an error if there is none."""
    if len(files) > 1:
        fail("a stream is one file, or standard input", WRONG_USAGE)
    path = files[0] if files else STDIN
    if not has_lines(path):
        fail(f"cannot stream {path}: a stream has lines of CSV or JSON", WRONG_USAGE)
    return path


def run(
    source: Path | str,
    sensors: Sensors[Radar],
    tracker: Tracker,
    plans: Sequence[FlightPlan],
    columns: Mapping[str, str],
    *,
    control: Control | None,
    latency: float | None,
    rows: Rows | None,
    send: str | None,
) -> None:
    """Track plots from a file, from standard input, or from packets to a UDP address (a text).

    With `control`, control lines are executed.
    """
    if sys.stdout is sys.stderr:
        # stdout may have been replaced because of --json
        fail("--json cannot be used with a stream; use --rows jsonl", WRONG_USAGE)
    if latency is not None and not 0 <= latency < np.inf:
        fail(f"--latency is {latency:g}; it must be a number of seconds, 0 or more", WRONG_USAGE)
    out = _RowWriter(rows) if send is None else TrackSender(send)
    names = {STDIN: "standard input"}
    plots = (
        Datagrams(f"UDP {source}", columns, sensors)
        if isinstance(source, str)
        else _Plots(names.get(source, str(source)), columns, sensors)
    )
    stream = _Stream(tracker, plans, plots, control=control, latency=latency, out=out)
    if isinstance(source, str):
        with receiver(source) as receiving:
            note(f"receiving at {source}; Ctrl-C ends")
            stream.run(Packets(receiving, stream.pause))
    elif source == STDIN:
        stream.run(Lines(sys.stdin.fileno(), stream.pause))
    else:
        with reading(source), source.open("rb") as file:
            stream.run(Lines(file.fileno(), stream.pause))


class _RowWriter:
    """Writer of rows to standard output, as CSV or JSON; by default in the format of the plots."""

    def __init__(self, rows: Rows | None) -> None:
        self._rows = rows
        self._out = typer.get_binary_stream("stdout")
        self._headed = False

    def write(self, rows: pl.DataFrame, kind: Rows | None) -> None:
        """Write rows; an empty table writes the header, only once."""
        if self._headed and not rows.height:
            return
        if (self._rows or kind) == "jsonl":
            self._out.write(as_lines(rows))
        else:
            self._out.write(rows.write_csv(include_header=not self._headed).encode())
        self._headed = True
        self._out.flush()


class _Plots:
    """Converts lines to plots; the first line shows whether they are CSV or JSON.

    `line` counts all lines, `row` possible plots, and `bad` lines that are not used.
    """

    def __init__(self, name: str, columns: Mapping[str, str], sensors: Sensors[Radar]) -> None:
        self.name, self.sensors = name, sensors
        self.clock: Clock | None = None
        self.kind: Rows | None = None
        self.line = self.row = self.bad = 0
        self._columns, self._schema = columns, schema_of(sensors)
        # possible column names of each quantity; if names are given, only these
        self._choices = {
            quantity: [columns[name] for name in one.columns if name in columns]
            or [columns.get(name, name) for name in one.columns]
            for quantity, one in self._schema.items()
        }
        self._chosen: dict[str, str] = {}
        self._header: list[str] | None = None
        self._separator = ","
        self._doubted: list[pl.DataFrame] | None = []

    @property
    def identities(self) -> list[str]:
        """The names of the columns of identities."""
        return [name for name in IDENTIFIED if name in self._chosen] or ["identity"]

    def of(self, lines: Sequence[bytes]) -> pl.DataFrame:
        """Return the plots of lines by the schema; `row` counts from the start of the stream."""
        numbers, found = [], []
        for cells in self._cells(lines):
            numbers.append((self.line, self.row))
            self.row += 1
            found.append(cells)
        problems = {at: one for at, one in enumerate(found) if isinstance(one, str)}
        good = [{} if isinstance(one, str) else one for one in found]
        self._choose(good)
        for at, cells in enumerate(good):
            needed = self._schema["range"].required
            if needed and at not in problems and self._chosen.get("range") not in cells:
                problems[at] = f"it has no {' or '.join(self._choices['range'])}"
        text = pl.DataFrame(
            {name: [_text(cells.get(name)) for cells in good] for name in self._chosen.values()},
            dict.fromkeys(self._chosen.values(), pl.String),
        )
        rows = self._read(text, problems)
        if problems and not self.bad:
            at = min(problems)
            note(
                f"tertia: {self.name}, line {numbers[at][0]}: {problems[at]}; such lines are left "
                "out"
            )
        self.bad += len(problems)
        kept = [at for at in range(len(found)) if at not in problems]
        rows = rows[kept].with_columns(
            row=pl.Series([numbers[at][1] for at in kept], dtype=pl.Int64)
        )
        self._doubt(text[kept])
        return rows

    def _cells(self, lines: Sequence[bytes]) -> Iterator[Cells | str]:
        """Yield the cells of each line, or the reason why there are none."""
        for line in lines:
            self.line += 1
            text = line.decode("utf-8-sig" if self.line == 1 else "utf-8", "replace").strip(" \r\n")
            if not text or (self.kind is None and self._is_comment(text)):
                continue
            if self.kind is None:
                self.kind = "jsonl" if text.startswith("{") else "csv"
                if self.kind == "csv":
                    self._begin(text)
                    continue
            if self._header is None:
                yield _of_json(text)
            else:
                yield _of_csv(text, self._header, self._separator)

    def _is_comment(self, line: str) -> bool:
        """Return whether a line before the header is a comment, not a header after a `#`."""
        cells = set(map(plain_name, re.split(r"[,;\t|]", line)))
        looked_for = (name for names in self._choices.values() for name in names)
        return line.startswith("#") and cells.isdisjoint(map(plain_name, looked_for))

    def _begin(self, line: str) -> None:
        """Read the header, which must have the required columns."""
        self._separator = separator_of(line)
        self._header = [name.strip() for name in cells_of(line, self._separator)]
        part = Part(pl.DataFrame(schema=dict.fromkeys(self._header, pl.String)), self.name)
        # misspelt names are recognised as in files
        looked_for = [name for names in self._choices.values() for name in names]
        standard = {part.column(name): name for name in looked_for if part.has(name)}
        self._header = [standard.get(name, name) for name in self._header]
        part = Part(pl.DataFrame(schema=dict.fromkeys(self._header, pl.String)), self.name)
        Reader(part, self._schema, self._columns, self.sensors.names).rows()
        for quantity, choices in self._choices.items():
            there = [name for name in choices if name in self._header]
            if there:
                self._chosen[quantity] = there[0]

    def _choose(self, cells: Sequence[Cells]) -> None:
        """Choose columns for the quantities that appear for the first time."""
        there = set().union(*cells) if self._header is None else set()
        for quantity, choices in self._choices.items():
            known = [name for name in choices if name in there]
            if known:
                self._chosen.setdefault(quantity, known[0])

    def _read(self, text: pl.DataFrame, problems: dict[int, str]) -> pl.DataFrame:
        """Read texts by the schema; texts that cannot be read are added to `problems`."""
        names = self.sensors.names
        absent = [
            choices[0]
            for quantity, choices in self._choices.items()
            if quantity not in self._chosen
            and (self._schema[quantity].required or (quantity == "sensor" and len(names) > 1))
        ]
        text = text.with_columns(pl.lit(None, pl.String).alias(name) for name in absent)
        called = {name: one for name, one in self._columns.items() if one in text.columns}
        if self.clock is None:
            self._learn_times(text, called, problems)
        like = None if self.clock is None else self.clock.dtype
        part = self._part(text)
        return Reader(part, self._schema, called, names, like=like, problems=problems).rows()

    def _part(self, text: pl.DataFrame) -> Part:
        return Part(text, self.name, time_format=TIME_FORMAT.get())

    def _learn_times(
        self, text: pl.DataFrame, called: Mapping[str, str], problems: Mapping[int, str]
    ) -> None:
        """Determine the kind of times from the first valid one."""
        column = text[self._choices["time"][0]]
        for at in range(len(column)):
            wrong: dict[int, str] = {}
            reader = Reader(self._part(text), self._schema, called, problems=wrong)
            moment = reader.times(column[at : at + 1])
            if at not in problems and not wrong and moment.null_count() == 0:
                self.clock = Clock.of(moment, midnight=True)
                return

    def _doubt(self, text: pl.DataFrame, *, last: bool = False) -> None:
        """Warn once if a unit looks wrong, when there are enough plots or the stream ends."""
        if self._doubted is None:
            return
        self._doubted.append(text)
        count = sum(part.height for part in self._doubted)
        if count < _ENOUGH and not last:
            return
        texts, self._doubted = pl.concat(self._doubted, how="diagonal"), None
        for quantity in ("azimuth", "range", "height"):
            called = self._chosen.get(quantity)
            if called is not None and called in texts.columns:
                columns = self._schema[quantity].columns
                names = (n for n in columns if self._columns.get(n, n) == called)
                doubt_unit(next(names), texts[called].cast(pl.Float64, strict=False))

    def end(self) -> None:
        """Exit with an error if there was no plot; otherwise print how many lines were ignored."""
        if not self.row:
            fail(f"{self.name} is empty")
        if self.bad == self.row:
            fail(f"{self.name}: none of {counted(self.row, 'line')} can be used")
        self._doubt(pl.DataFrame(), last=True)
        if self.bad:
            note(f"{self.bad} of {counted(self.row, 'line')} left out")


def _of_json(text: str) -> Cells | str:
    cells = json_of(text)
    return cells if isinstance(cells, dict) else "it is not a JSON object"


def _of_csv(text: str, header: Sequence[str], separator: str) -> Cells | str:
    cells = cells_of(text, separator)
    if separator != ",":
        cells = list(map(with_point, cells))
    if len(cells) != len(header):
        return f"it has {counted(len(cells), 'field')}, the header has {len(header)}"
    return dict(zip(header, cells, strict=True))


def _text(value: object) -> str | None:
    """Return a value of JSON as a cell of CSV."""
    whole = isinstance(value, float) and value.is_integer()
    return None if value is None else str(int(value) if whole else value)  # type: ignore[call-overload]


class _Arrived:
    """Numbers in the stream of plots that were tracked, by their index.

    Without a lag, only plots of the last call are needed.
    """

    def __init__(self, kept: int) -> None:
        self._known = np.empty(0, dtype=np.int64)
        self._first, self._kept = 0, kept

    def add(self, numbers: IntArray) -> None:
        """Add the numbers of the next plots."""
        old = max(len(self._known) - self._kept, 0)
        self._known = np.concatenate([self._known[old:], numbers])
        self._first += old

    def of(self, plot: IntArray) -> IntArray:
        """Return the numbers of plots; -1 for a missed detection."""
        # the last one is that of no plot
        known = np.append(self._known, -1)
        return known[np.where(plot < 0, -1, plot - self._first)]


class _Stream:
    """Tracks plots as their lines arrive, and writes the rows of confirmed tracks.

    Plots are collected for `latency` seconds of their own time, by default a quarter of the
    shortest scan period, or until no plot has arrived for `latency` seconds.
    """

    def __init__(
        self,
        tracker: Tracker,
        plans: Sequence[FlightPlan],
        plots: _Plots | Datagrams,
        *,
        control: Control | None,
        latency: float | None,
        out: _RowWriter | TrackSender,
    ) -> None:
        periods = [period for one in plots.sensors.items if (period := interval(one)) > 0]
        self._tracker, self._plots, self._out = tracker, plots, out
        self._plans, self._control = plans, control
        self._latency = _USUAL_LATENCY * min(periods) if latency is None else latency
        self._lag = tracker.lag
        self._oldest = max(*periods, self._lag)
        self._gathered: list[pl.DataFrame] = []
        self._since = 0.0
        self._ready: list[TrackTable] = []
        self._arrived = _Arrived(_REMEMBERED if tracker.lag else 0)
        self._named: Sequence[str] | None = None
        self._statuses: Counter[int] = Counter()

    @property
    def pause(self) -> float:
        """Length in seconds of a pause that ends the collection of plots."""
        return max(self._latency, 1e-3)

    def run(self, arriving: Lines | Packets) -> None:
        """Read until the input ends, the output is closed, or the user interrupts."""
        code = 0
        try:
            try:
                for lines in arriving:
                    if not isinstance(lines, Quiet):
                        self._read(lines)
                        continue
                    if lines is Quiet.LONG:
                        self._flush()
                    self._write()
            except KeyboardInterrupt:
                code = INTERRUPTED
            self._flush()
            if self._lag:
                self._show(self._tracker.finish())
            self._write()
        except BrokenPipeError:
            # the program must not try to write to the closed pipe when it ends
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        except OSError as error:
            fail(f"cannot read {self._plots.name}: {error.strerror}")
        self._plots.end()
        for status, count in sorted(self._statuses.items(), reverse=True):
            note(f"{counted(count, 'plot')} refused: {PlotStatus(status).message}")
        if code:
            raise typer.Exit(code)

    def _read(self, lines: Sequence[bytes]) -> None:
        """Take plots, and execute control lines between those before and after them."""
        if self._control is None:
            self._take(self._plots.of(lines))
            return
        begin = 0
        for at, line in enumerate(lines):
            request = request_of(line)
            if request is None:
                continue
            self._take(self._plots.of(lines[begin:at]))
            self._plots.line += 1
            self._flush()
            note(self._control.answer(request))
            begin = at + 1
        self._take(self._plots.of(lines[begin:]))

    def _take(self, rows: pl.DataFrame) -> None:
        """Collect plots, and track those that are complete."""
        clock, period = self._plots.clock, self._tracker.clock_period
        if clock is None:
            return
        if period is not None and clock.dated:
            fail(
                "--clock-period can be used only if times are in seconds; these plots have dates",
                WRONG_USAGE,
            )
        begin = 0
        for at, time in enumerate(clock.seconds(rows["time"]).tolist()):
            since = time - self._since
            if period is not None:
                since -= period * round(since / period)
            # a plot that is older than a scan and the lag does not belong to this batch: the clock
            # has jumped
            if not -self._oldest <= since < self._latency and (self._gathered or at > begin):
                self._gathered += [rows[begin:at]] if at > begin else []
                self._flush()
                begin = at
            late = self._lag > 0.0 and -self._oldest <= since < 0.0
            if not self._gathered and at == begin and not late:
                self._since = time
        if begin < rows.height:
            self._gathered.append(rows[begin:])

    def _flush(self) -> None:
        """Track the collected plots, and write their rows."""
        gathered, self._gathered = self._gathered, []
        clock = self._plots.clock
        if not gathered or clock is None:
            return
        rows = pl.concat(gathered)
        plots = plots_of(rows, clock, self._plots.sensors)
        table = self._tracker._track(plots, None, recording=False)
        for said in self._tracker._doubts(table, plots, self._plots.sensors.names):
            note(said)
        self._statuses.update(table.track_of_plot[table.track_of_plot < 0].tolist())
        self._arrived.add(rows["row"].to_numpy())
        self._show(table)
        if sum(map(len, self._ready)) >= _WRITTEN:
            self._write()

    def _show(self, table: TrackTable) -> None:
        """Add rows to those that are ready, with the numbers of plots in the stream."""
        self._ready.append(replace(table, plot=self._arrived.of(table.plot)))

    def _write(self) -> None:
        """Write the rows that are ready."""
        ready, self._ready = self._ready, []
        if not ready:
            return
        table, plots = TrackTable.join(ready), self._plots
        clock = plots.clock or Clock(pl.Float64())
        if self._named is None:
            # the header is written once, so the columns are fixed here
            self._named = plots.identities
        rows = track_rows(table, clock, self._named, plots.sensors, self._plans)
        if self._lag:
            rows = rows.with_columns(pl.Series("final", table.final))
        self._out.write(rows, plots.kind)
