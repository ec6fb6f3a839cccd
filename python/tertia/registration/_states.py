"""Tracks of single radars, and their states at instants that they have in common."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tertia import _core
from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia.sensors import PositionSensor, Radar
from tertia.tracker import Plots, PlotStatus, TrackTable

Run = Callable[..., TrackTable]


def alone(plots: Plots, sensors: Sequence[Radar | PositionSensor], k: int, run: Run) -> TrackTable:
    """Return the tracks of one sensor; plots and sensors keep the numbers of the recording."""
    own = np.flatnonzero(plots.sensor == k)
    part = plots[own]
    table = run(part._replaced(sensor=np.zeros_like(part.sensor)), [sensors[k]])
    statuses = np.full(len(plots), int(PlotStatus.INVALID))
    statuses[own] = table.track_of_plot
    return replace(
        table,
        sensor=np.full(len(table), k),
        plot=np.where(table.plot >= 0, own[table.plot], -1) if len(own) else table.plot,
        track_of_plot=statuses,
    )


@dataclass(frozen=True, slots=True, eq=False)
class States:
    """States of the tracks of K radars at M instants that they have in common.

    `state` (M, K, 4) and `covariance` (M, K, 4, 4) are nan where a radar has no track.
    `joint_state` and `joint_covariance` belong to the tracks from the plots of all radars; `track`
    has the numbers of these tracks.
    """

    time: FloatArray
    track: IntArray
    state: FloatArray
    covariance: FloatArray
    joint_state: FloatArray
    joint_covariance: FloatArray

    @property
    def present(self) -> BoolArray:
        """Whether each radar has a track at each instant, (M, K)."""
        return np.asarray(np.isfinite(self.state[..., 0]))

    def chosen(self, index: BoolArray) -> States:
        """Return the states at the selected instants."""
        return States(*(getattr(self, name)[index] for name in self.__slots__))

    def columns(self) -> dict[str, Any]:
        """Return the columns in the form that the core takes."""
        names = ("time", "track", "state", "covariance")
        return {name: np.ascontiguousarray(getattr(self, name)) for name in names}


def common_states(
    joint: TrackTable, single: Sequence[TrackTable], radars: Sequence[Radar]
) -> States:
    """Return the states of all tracks at instants at which the slowest radar has plots.

    A track of one radar belongs to the joint track that contains more than half of its plots.
    """
    periods = [radar.scan_period for radar in radars]
    tables = [_columns(table) for table in single]
    time, track, states = _core.common_states(_columns(joint), tables, periods)
    return States(time, track, *states)


def _columns(table: TrackTable) -> dict[str, Any]:
    """Return the columns of a table in the form that the core takes."""
    columns = {
        "state": np.hstack([table.position, table.velocity]),
        **{
            name: getattr(table, name)
            for name in (
                "time",
                "track",
                "plot",
                "confirmed",
                "covariance",
                "turn_probability",
                "track_of_plot",
            )
        },
    }
    return {name: np.ascontiguousarray(column) for name, column in columns.items()}
