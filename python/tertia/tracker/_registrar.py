"""Systematic errors of radars, found while tracking."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tertia import _core
from tertia._arrays import FloatArray, IntArray
from tertia.sensors import Bias, Radar
from tertia.sensors._bias import KINDS
from tertia.sensors._sensors import own_biases
from tertia.tracker._earth import in_plane
from tertia.tracker._models import core_radar
from tertia.tracker._plots import Plots
from tertia.tracker._table import TrackTable


def target_plots(plots: Plots, tracks: TrackTable, rows: IntArray) -> dict[str, Any]:
    """Return the columns of the plots of these rows, with their targets, as the core takes them."""
    return {
        "sensor": plots.sensor,
        "target": np.ascontiguousarray(tracks.track[rows]),
        "time": plots.time,
        "range": plots.range,
        "azimuth": plots.azimuth,
        "height": plots.height,
        "turn_probability": np.ascontiguousarray(tracks.turn_probability[rows]),
    }


class Registrar:
    """Errors of radars as they are known after each scan, and the correction of plots by them."""

    def __init__(self, sensors: Sequence[Radar]) -> None:
        prior = own_biases(sensors)
        mean, sigma = (
            np.stack([np.asarray(getattr(prior, kind + suffix)) for kind in KINDS], axis=-1)
            for suffix in ("", "_sigma")
        )
        self._core = _core.Registrar([core_radar(radar) for radar in sensors], mean, sigma)
        self._sensors = tuple(sensors)
        self._given = 0

    @property
    def bias(self) -> Bias:
        """The errors of each radar and their standard deviations, (K,)."""
        value, sigma, _ = self._core.known()
        return Bias(
            range=value[:, 0],
            range_gain=value[:, 1],
            azimuth=value[:, 2],
            time=value[:, 3],
            range_sigma=sigma[:, 0],
            range_gain_sigma=sigma[:, 1],
            azimuth_sigma=sigma[:, 2],
            time_sigma=sigma[:, 3],
        )

    @property
    def noise(self) -> FloatArray:
        """Standard deviations of range and azimuth for tracking, (K, 2)."""
        return self._core.known()[2]

    @property
    def changes(self) -> list[tuple[float, int]]:
        """Times and sensors of sudden changes."""
        return self._core.changes()

    def learn(self, plots: Plots, tracks: TrackTable, time: float) -> TrackTable:
        """Learn from the rows that these plots made; return them with what is not known added."""
        rows = np.flatnonzero(tracks.plot >= self._given)
        own = plots[tracks.plot[rows] - self._given]
        self._given += len(plots)
        height = np.where(np.isfinite(own.height), own.height, tracks.height[rows])
        own = in_plane(own._moved(own.range, own.azimuth, height), self._sensors)
        columns = target_plots(own, tracks, rows)
        velocity, covariance = tracks.velocity[rows], tracks.covariance.copy()
        covariance[rows] += self._core.learn(columns, velocity, covariance[rows], time)
        return replace(tracks, covariance=covariance)

    def __getstate__(self) -> tuple[bytes, int, tuple[Radar, ...]]:
        """Return all that is known."""
        return self._core.__getstate__(), self._given, self._sensors

    def __setstate__(self, state: tuple[bytes, int, tuple[Radar, ...]]) -> None:
        """Restore what is known."""
        saved, self._given, self._sensors = state
        self._core = _core.Registrar.from_state(saved)
