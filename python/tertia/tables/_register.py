"""Estimation of systematic errors and noise of radars from their plots."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl

from tertia import registration
from tertia.registration import Registration
from tertia.tables._described import SensorsLike
from tertia.tables._frames import Table, result
from tertia.tables._groups import known
from tertia.tables._parts import source_of
from tertia.tables._sensors import RADAR_BIAS, radar_rows
from tertia.tables._track import Recording, recording_of


@dataclass(frozen=True, slots=True)
class Registered:
    """A recording, and the errors of the radars estimated from its plots."""

    recording: Recording
    registration: Registration

    @property
    def changes(self) -> list[tuple[str, Any]]:
        """The radars whose errors changed suddenly, and when, to a tenth of a second."""
        names, clock = self.recording.sensors.names, self.recording.clock
        found = self.registration.changes
        times = clock.moments(np.round([time for time, _ in found], 1))
        return [(names[k], at) for (_, k), at in zip(found, times, strict=True)]

    @property
    def rows(self) -> pl.DataFrame:
        """One row per radar, in the form in which files describe radars."""
        found = self.registration
        rows = radar_rows(replace(self.recording.sensors, items=found.sensors))
        factors = {
            f"{kind}_noise_factor": known(np.asarray(getattr(found.noise_factor, kind)))
            for kind in ("range", "azimuth")
        }
        seen = {f"{kind}_observable": found.observable[kind] for kind in RADAR_BIAS}
        return rows.with_columns(**factors, **seen)


def register(
    table: Table,
    *,
    sensors: SensorsLike,
    columns: Mapping[str, str] | None = None,
    n_threads: int | None = None,
    **options: Any,
) -> Table:
    """Estimate systematic errors and noise of radars, as the command `tertia register` does.

    Parameters
    ----------
    table : DataFrame of Polars or pandas, Table or RecordBatch of pyarrow
        One row per plot, with the columns of `track`.
    sensors : sequence of Radar, DataFrame, or str or Path
        The radars. A radar without a name is identified by its index. A table has one row per
        radar, with the columns of sensors files; a path is that of a sensors file in TOML.
    columns : mapping of str to str, optional
        The names that columns have in this table, keyed by their standard names.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.
    **options
        Options of `tertia.tracker.Tracker`.

    Returns
    -------
    table of the same kind
        One row per radar, with the columns of sensors files: position, estimated `range_sigma_m`
        and `azimuth_sigma_deg`, and `range_bias_m`, `range_gain`, `azimuth_bias_deg` and
        `time_bias_s` with their sigmas. Further columns are `range_noise_factor` and
        `azimuth_noise_factor`, the ratios of the estimated to the stated noise, and for each error
        whether the plots determine it, such as `time_observable`. Errors are those at the end of
        the recording.

    Raises
    ------
    RecordError, ValueError, TypeError
        As for `track`.

    Examples
    --------
    >>> import numpy as np, polars as pl
    >>> from tertia import simulate, tables
    >>> from tertia.sensors import Bias, Radar
    >>> numbers = {"range_sigma": 50.0, "azimuth_sigma": 0.0015, "scan_period": 4.0}
    >>> radars = [Radar([east, 0.0], **numbers) for east in (-4e4, 4e4)]
    >>> traffic = simulate.dense_traffic(30, area=(1e5, 1e5), rng=1)
    >>> bias = Bias(azimuth=[0.0, 0.3], degrees=True)
    >>> plots = simulate.radar_plots(traffic, radars, bias=bias, rng=2).plots
    >>> rows = {"time_s": plots.time, "sensor": plots.sensor.astype(str), "range_m": plots.range}
    >>> rows |= {"azimuth_deg": np.degrees(plots.azimuth), "height_m": plots.height}
    >>> found = tables.register(pl.DataFrame(rows), sensors=radars)
    >>> found["azimuth_bias_deg"].round(2).to_list()
    [-0.0, 0.3]
    """
    recording = recording_of(source_of(table), sensors, columns)
    return result(table, registered(recording, n_threads, **options).rows)


def registered(recording: Recording, n_threads: int | None = None, **options: Any) -> Registered:
    """Return the errors of the radars of a recording, estimated from its plots."""
    radars = recording.sensors.items
    found = registration.register(recording.plots, radars, n_threads=n_threads, **options)
    return Registered(recording, found)
