"""Tracks of a whole recording."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

from tertia.sensors import Bias
from tertia.tracker._doubts import recording_doubts
from tertia.tracker._plots import Plots
from tertia.tracker._sensors import Sensor
from tertia.tracker._settings import largest_speed
from tertia.tracker._table import TrackTable
from tertia.tracker._tracker import Tracker


def track(plots: Plots, sensors: Sequence[Sensor], **options: Any) -> TrackTable:
    """Track a whole recording.

    Parameters
    ----------
    plots : Plots
        Plots in any order.
    sensors : sequence of Radar, PositionSensor or Station
        The sensors.
    **options
        Options of `Tracker`.

    Returns
    -------
    TrackTable
        All confirmed tracks, from their first plot on.

    Raises
    ------
    ValueError, TypeError
        As for `Tracker`.

    Warns
    -----
    UserWarning
        If the period of a sensor, the unit or the scale of its ranges, or `max_speed` is evidently
        wrong, a radar has no beam that turns, two tracks have the same address at the same time,
        all radars have the same errors, as if the position of one of them were wrong, or many
        targets give several plots in a scan although `target_extent` is 0.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.tracker import Plots, Radar, track
    >>> radar = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0)
    >>> time = np.arange(0.0, 100.0, 4.0)
    >>> track(Plots(time, 50e3 + 200 * time, 0.5), [radar])
    TrackTable(1 tracks, 25 rows)
    """
    table, bias = tracked(plots, sensors, **options)
    for said in recording_doubts(table, plots, sensors, bias, largest_speed(**options)):
        warnings.warn(said, UserWarning, stacklevel=2)
    return table


def tracked(plots: Plots, sensors: Sequence[Sensor], **options: Any) -> tuple[TrackTable, Bias]:
    """Return the tracks of a recording, and the errors of the sensors as estimated at its end."""
    tracker = Tracker(sensors, **options)
    return tracker._track(plots, None, recording=True), tracker.bias
