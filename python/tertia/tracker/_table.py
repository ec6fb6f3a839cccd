"""Tables of tracks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from tertia import _core
from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia._result import Result
from tertia.sensors._identities import TextArray


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a `TrackTable`.

    Attributes
    ----------
    name : str
        Name of the attribute of the table.
    unit : str
        Unit; empty if there is none.
    type : {"float", "int", "str", "bool"}
        Type of the values.
    shape : tuple of int
        Shape of the value in one row; empty for a single number.
    doc : str
        Description of the column.
    """

    name: str
    unit: str
    type: str
    shape: tuple[int, ...]
    doc: str


# all columns, as the core writes them: files and pages follow this table
COLUMNS = tuple(
    Column(name, unit, kind, tuple(shape), doc)
    for name, unit, kind, shape, doc in _core.track_columns()
)


_PLACES = {column.name: place for place, column in enumerate(COLUMNS)}


class _Columns:
    """Columns that are converted to arrays when they are first accessed."""

    __slots__ = ("_columns",)

    _columns: _core.TrackColumns

    def __getattr__(self, name: str) -> Any:
        """Return a column; Python calls this method when the column is first accessed."""
        try:
            place = _PLACES[name]
        except KeyError:
            raise AttributeError(f"{type(self).__name__!r} has no attribute {name!r}") from None
        values = self._columns.column(place)
        object.__setattr__(self, name, values)
        return values


@dataclass(frozen=True, slots=True, eq=False)
class TrackTable(_Columns, Result):
    """Tracks: one row for each plot of a track, and one for each scan without such a plot.

    `COLUMNS` lists the columns with their units. `table[index]` has the rows that a slice, a mask
    or indices select.

    Attributes
    ----------
    time : ndarray of shape (N,)
        Time in seconds.
    track : ndarray of int, shape (N,)
        Number of the track. Numbers start at 1; a number is 2**40 or more while late plots may
        still change it.
    sensor : ndarray of int, shape (N,)
        Index of the sensor.
    plot : ndarray of int, shape (N,)
        Index of the plot among all plots that the tracker was given, of combined plots the last;
        -1 for a missed detection.
    position, velocity : ndarray of shape (N, 2)
        East and north, in metres and metres per second.
    covariance : ndarray of shape (N, 4, 4)
        Covariance of position and velocity.
    innovation : ndarray of shape (N, 2)
        Plot minus prediction, in metres; nan for a missed detection.
    innovation_covariance : ndarray of shape (N, 2, 2)
        Covariance of the innovation.
    turn_probability : ndarray of shape (N,)
        Probability that the target turns.
    speed_change_probability : ndarray of shape (N,)
        Probability that the speed of the target changes; 0 while it follows a plan.
    association_probability : ndarray of shape (N,)
        Probability that the plots assigned to the track are those of its target; 1 if no other
        assignment is likely.
    existence_probability : ndarray of shape (N,)
        Probability that the track follows a target and does not consist of false plots.
    height, vertical_rate : ndarray of shape (N,)
        Height in metres and vertical rate in m/s, positive upwards; nan if no height was reported.
    icao_address, mode_3a : ndarray of int, shape (N,)
        Address of 24 bits and mode 3/A code; -1 if they are not known. After two emergency codes in
        succession, `mode_3a` is that code, until another one is received.
    callsign : ndarray of str, shape (N,)
        Aircraft identification; empty if it is not known.
    identity : ndarray of int, shape (N,)
        Any other number that stays with the target; -1 if there is none.
    plan : ndarray of int, shape (N,)
        Index of the flight plan; -1 if the track has none.
    plan_status : ndarray of int, shape (N,)
        How the track was assigned its plan, or why it has none: a `flightplan.CorrelationStatus`.
    merged : ndarray of bool, shape (N,)
        Whether the plot also belongs to another track, because the radar did not resolve the two
        targets.
    confirmed : ndarray of bool, shape (N,)
        Whether the track had been confirmed by this time. In a recording it is also False for the
        first plots after a gap, until the track is resumed.
    conforms : ndarray of bool, shape (N,)
        Whether the target follows its plan; False if the plan is blocked.
    final : ndarray of bool, shape (N,)
        Whether the row is final; False if late plots may still change it.
    track_of_plot : ndarray of int, shape (P,)
        Number of the track of each plot; a negative `PlotStatus` if the plot was not used. Plots
        of tracks that were never confirmed have numbers that are not in the table.
    """

    _rows: ClassVar = "time", 0
    _omitted: ClassVar = ("track_of_plot",)

    time: FloatArray
    track: IntArray
    sensor: IntArray
    plot: IntArray
    position: FloatArray
    velocity: FloatArray
    covariance: FloatArray
    innovation: FloatArray
    innovation_covariance: FloatArray
    turn_probability: FloatArray
    speed_change_probability: FloatArray
    association_probability: FloatArray
    existence_probability: FloatArray
    height: FloatArray
    vertical_rate: FloatArray
    icao_address: IntArray
    mode_3a: IntArray
    callsign: TextArray
    identity: IntArray
    plan: IntArray
    plan_status: IntArray
    merged: BoolArray
    confirmed: BoolArray
    conforms: BoolArray
    final: BoolArray
    track_of_plot: IntArray

    @classmethod
    def _of(cls, columns: _core.TrackColumns, track_of_plot: IntArray) -> TrackTable:
        """Return the table from the columns returned by the core."""
        table = cls.__new__(cls)
        object.__setattr__(table, "_columns", columns)
        object.__setattr__(table, "track_of_plot", track_of_plot)
        return table

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.time)

    def __repr__(self) -> str:
        """Return a text that states the numbers of tracks and rows."""
        return f"TrackTable({len(np.unique(self.track))} tracks, {len(self)} rows)"

    def __getitem__(self, index: Any) -> TrackTable:
        """Return the rows that a slice, a mask or indices select, with all of `track_of_plot`."""
        kept = {column.name: getattr(self, column.name)[index] for column in COLUMNS}
        return TrackTable(**kept, track_of_plot=self.track_of_plot)

    def latest(self) -> TrackTable:
        """Return the rows that are still valid in a table that joins the tables of several updates.

        A tracker with a `lag` replaces rows that are not final. A new row replaces the rows of its
        track from its time on, and any other row with the same plot; a final row replaces all
        earlier rows of its track. `table[table.final]` contains only the rows that can no longer
        change.
        """
        # of each plot the last row holds
        _, last = np.unique(self.plot[::-1], return_index=True)
        holds = self.plot < 0
        holds[len(self) - 1 - last] = True
        # the earliest of the rows of the same track that come later in the table
        _, place = np.unique(self.track, return_inverse=True)
        _, rank = np.unique(self.time + 1j * self.sensor, return_inverse=True)
        order = np.lexsort([np.arange(len(self)), place])[::-1]
        # so that each track begins with a rank above all of the one before it
        ranks = np.where(self.final, len(self), rank) + place * (len(self) + 1)
        earliest = np.minimum.accumulate(ranks[order])
        later = np.concatenate([[np.iinfo(np.int64).max], earliest[:-1]])
        holds[order] &= ranks[order] < later
        settled = np.max(self.time[self.final], initial=-np.inf)
        return self[self.final | (holds & (self.time > settled))]

    @classmethod
    def join(cls, tables: Sequence[TrackTable]) -> TrackTable:
        """Return the rows of the tables of several updates, in their order, as one table."""
        kept = {
            column.name: np.concatenate([getattr(table, column.name) for table in tables])
            for column in COLUMNS
        }
        return cls(**kept, track_of_plot=np.concatenate([table.track_of_plot for table in tables]))


def numbered(
    table: _core.TrackColumns, tracks: Sequence[IntArray], parts: Sequence[IntArray], first: int
) -> IntArray:
    """Return the tracks of plots that were given in parts, in the order of the whole recording.

    `parts` are the indices of the plots of each part. Rows of the table get the numbers of their
    plots in the whole recording, the first of which is `first`.
    """
    if len(parts) == 1:
        return tracks[0]
    order = np.concatenate(parts)
    table.renumber(order, first)
    track_of_plot = np.empty(len(order), dtype=np.int64)
    track_of_plot[order] = np.concatenate(tracks)
    return track_of_plot
