"""Warnings about times, copies and intervals of plots that contradict their sensors."""

from __future__ import annotations

from typing import Any

import numpy as np

from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia.sensors import PositionSensor, Radar
from tertia.tables._doubts import doubt
from tertia.tables._sensors import REACH_OF_A_PLANE, Sensors
from tertia.tables._velocities import doubt_velocities
from tertia.tracker import Plots
from tertia.tracker._doubts import period_doubts, seen_by

# plots of a sensor below which nothing is said of it
_FEW = 50
# plots within this share of a scan have about the same azimuth; so many sectors of 30° are too many
_INSTANT, _SECTOR, _SECTORS = 0.05, np.pi / 6, 5
# share of the plots, or of the targets, above which a warning is given
_SHARE = 0.5
# mean resultant of the turn of a beam less that expected, above which there is a beam
_TURNS = 0.6
# scans around a gap, and plots on each side of it, from which the beam is known; share of a turn by
# which it may be elsewhere after a gap, and by which periods differ from those stated
_SCANS, _PLOTS, _AWAY, _SLOWER = 20.0, 10, 0.2, 0.01
# seconds between the plots of sensors with different time zones
_CLOCK = 300.0
# plots in a row that come again, a share of a scan to which their intervals are equal, scans before
# they come again, and the share of such plots
_ROW, _EQUAL, _LATER, _REPEATED = 5, 1e-3, 1.5, 0.05
# intervals after which a silent target has no track yet, and the quantile of intervals
_PATIENCE, _QUANTILE = 2.0, 0.75
# speed of a target in m/s that its reports may show
_FAST = 350.0


def doubt_plots(plots: Plots, sensors: Sensors[Any]) -> None:
    """Warn if times are not those of a beam or of other sensors, plots repeat, or are rare."""
    _doubt_clocks(plots, sensors)
    _doubt_gap(plots, sensors)
    for k, (name, sensor) in enumerate(zip(sensors.names, sensors.items, strict=True)):
        rows = np.flatnonzero((plots.sensor == k) & np.isfinite(plots.time))
        rows = rows[np.argsort(plots.time[rows], kind="stable")]
        if isinstance(sensor, Radar):
            rows = rows[np.isfinite(plots.azimuth[rows])]
        if len(rows) < _FEW:
            continue
        is_anonymous = isinstance(sensor, PositionSensor) and _targets(plots, rows) is None
        if isinstance(sensor, Radar) or is_anonymous:
            seen = seen_by(sensor, plots[rows])
            for said in period_doubts(sensor, seen, name, _FAST):
                doubt(said)
        if isinstance(sensor, Radar):
            _doubt_times(name, sensor, plots.time[rows], plots.azimuth[rows])
            _doubt_copies(name, sensor, plots.time[rows], plots.range[rows], plots.azimuth[rows])
        elif isinstance(sensor, PositionSensor):
            target = _targets(plots, rows)
            _doubt_interval(name, sensor, plots.time[rows], target)
            if target is not None and plots.position is not None and plots.velocity is not None:
                own = rows[target >= 0]
                moved = plots.time[own], plots.position[own], plots.velocity[own]
                doubt_velocities(name, target[target >= 0], *moved)
            if sensors.frame is not None and plots.position is not None:
                _doubt_places(name, plots.position[rows])


def _doubt_clocks(plots: Plots, sensors: Sensors[Any]) -> None:
    """Warn if the plots of a sensor are hours before or after those of all others."""
    spans: dict[str, FloatArray] = {}
    for k, name in enumerate(sensors.names):
        own = plots.time[(plots.sensor == k) & np.isfinite(plots.time)]
        if len(own) >= _FEW:
            # a few times may be wrong
            spans[name] = np.quantile(own, [0.02, 0.5, 0.98])
    for name, (first, middle, last) in spans.items():
        others = [span for other, span in spans.items() if other != name]
        apart = [min(abs(last - span[0]), abs(first - span[2])) for span in others]
        alone = all(last < span[0] or first > span[2] for span in others)
        if others and alone and min(apart) > _CLOCK:
            hours = (middle - np.median([span[1] for span in others])) / 3600.0
            doubt(
                f"{name} has no plots at the times of the other sensors: its times are about "
                f"{abs(hours):.3g} h {'later' if hours > 0 else 'earlier'}. Are they in another "
                "time zone?"
            )
            # of two sensors one is enough
            return


def _doubt_gap(plots: Plots, sensors: Sensors[Any]) -> None:
    """Warn if clocks seem to have been set forward in the longest gap of all sensors together."""
    known = np.sort(plots.time[np.isfinite(plots.time)])
    if len(known) < _FEW:
        return
    at = int(np.argmax(np.diff(known)))
    begin, end = known[at : at + 2]
    turns = [
        _turned(plots, k, radar.scan_period, begin, end)
        for k, radar in enumerate(sensors.items)
        if isinstance(radar, Radar)
    ]
    if max(turns, default=0.0) > _AWAY:
        doubt(
            f"no sensor has plots for {end - begin:.3g} s, and the beams of radars did not turn as "
            f"far as they should: were clocks set forward, {begin - known[0]:.6g} s after the "
            "beginning? Targets then seem to jump back"
        )


def _turned(plots: Plots, sensor: int, period: float, begin: float, end: float) -> float:
    """Return by which share of a turn a beam is elsewhere after a gap; 0 if it is not known."""
    near = np.abs(plots.time - 0.5 * (begin + end)) < 0.5 * (end - begin) + _SCANS * period
    rows = np.flatnonzero((plots.sensor == sensor) & near & np.isfinite(plots.azimuth))
    time, azimuth = plots.time[rows] - begin, plots.azimuth[rows]
    after = time > 0.0
    if min(after.sum(), (~after).sum()) < _PLOTS or end - begin > _SCANS * period:
        return 0.0
    # periods are seldom exactly as stated
    rates = 2.0 * np.pi / period * (1.0 + np.linspace(-_SLOWER, _SLOWER, 81))
    beams = np.exp(1j * (azimuth - rates[:, np.newaxis] * time))
    old, new = (np.mean(beams[:, part], axis=1) for part in (~after, after))
    best = int(np.argmax(np.abs(old) + np.abs(new)))
    if min(abs(old[best]), abs(new[best])) < _TURNS:
        return 0.0
    return float(np.abs(np.angle(new[best] / old[best]))) / (2.0 * np.pi)


def _doubt_times(name: str, radar: Radar, time: FloatArray, azimuth: FloatArray) -> None:
    """Warn if plots at all azimuths have the same times, or times without fractions of seconds."""
    instant = np.floor(time / (_INSTANT * radar.scan_period)).astype(np.int64)
    sector = np.floor(np.mod(azimuth, 2.0 * np.pi) / _SECTOR).astype(np.int64)
    _, place, count = np.unique(instant, return_inverse=True, return_counts=True)
    all_sectors = round(2.0 * np.pi / _SECTOR)
    pairs = np.unique(np.ravel(place) * all_sectors + sector)
    sectors = np.bincount(pairs // all_sectors, minlength=len(count))
    if np.sum(count[sectors >= _SECTORS]) > _SHARE * len(time):
        doubt(
            f"plots of {name} at all azimuths have the same times: are these the times of north "
            "marks or of messages? Each plot of a rotating radar needs the time at which the beam "
            f"passed its target; otherwise tracks are up to {radar.scan_period:g} s off"
        )
        return
    # from plot to plot, the beam turns as time goes, however its period drifts
    beam = np.exp(1j * (np.diff(azimuth) - 2.0 * np.pi / radar.scan_period * np.diff(time)))
    turns = np.abs(np.mean(beam)) > _TURNS and len(np.unique(sector)) >= _SECTORS
    if turns and np.all(time == np.round(time)):
        doubt(
            f"the times of {name} are whole seconds: were they rounded? A target moves meanwhile. "
            "The sigmas of tracks include that, but with fractions of seconds tracks are more "
            "accurate. If times were cut off instead of rounded, state time_bias_s = -0.5"
        )


def _doubt_copies(
    name: str, radar: Radar, time: FloatArray, distance: FloatArray, azimuth: FloatArray
) -> None:
    """Warn if sequences of plots come again later."""
    order = np.lexsort([azimuth, distance])
    before = np.full(len(time), -1)
    same = (np.diff(distance[order]) == 0) & (np.diff(azimuth[order]) == 0)
    before[order[1:][same]] = order[:-1][same]
    known = before >= 0
    later = np.where(known, time - time[before], np.nan)
    again = known & (later > _LATER * radar.scan_period)
    # of the plots in a row, all come again after the same time
    follows = again[1:] & again[:-1] & (np.diff(before) == 1)
    follows &= np.abs(np.diff(later)) < _EQUAL * radar.scan_period
    count = int(np.sum(_in_rows(follows)))
    if count > _REPEATED * len(time):
        doubt(
            f"{count} of {len(time)} plots of {name} are copies of earlier plots with later times, "
            "in the same order: does the sensor or the recorder send old plots again? They look "
            "like other targets"
        )


def _in_rows(follows: BoolArray) -> BoolArray:
    """Return which plots are in rows of enough plots, each of which follows the one before."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], follows, [False]]).astype(np.int8)))
    found = np.zeros(len(follows) + 1, dtype=bool)
    for begin, end in edges.reshape(-1, 2):
        found[begin : end + 1] = end - begin >= _ROW
    return found


def _doubt_interval(
    name: str, sensor: PositionSensor, time: FloatArray, target: IntArray | None
) -> None:
    """Warn if targets report much less often than the sensor states."""
    if target is None:
        return
    order = np.lexsort([time, target])
    own = target[order]
    inside = (own[1:] == own[:-1]) & (own[1:] >= 0)
    gap, number = np.diff(time[order])[inside], own[1:][inside]
    if not len(gap):
        return
    numbers, first, count = np.unique(number, return_index=True, return_counts=True)
    sorted_gap = gap[np.lexsort([gap, number])]
    usual = sorted_gap[first + np.ceil(_QUANTILE * (count - 1)).astype(np.int64)]
    most = _PATIENCE * sensor.update_interval
    rare = usual > most
    if np.any(rare) and np.sum(rare) >= 0.1 * len(numbers):
        doubt(
            f"{np.sum(rare)} of {len(numbers)} targets report to {name} only every "
            f"{np.median(usual[rare]):.3g} s, and its update_interval is "
            f"{sensor.update_interval:g} s: targets that report less often than every {most:g} s "
            "have no tracks. State a longer update_interval"
        )


def _doubt_places(name: str, place: FloatArray) -> None:
    """Warn if most reported positions are so far from the origin that the plane is wrong."""
    away = np.linalg.norm(place, axis=1)
    away = away[np.isfinite(away)]
    if len(away) and np.median(away) > REACH_OF_A_PLANE:
        doubt(
            f"positions of {name} are about {np.median(away) / 1e3:.0f} km from the origin: are "
            "latitude and longitude swapped?"
        )


def _targets(plots: Plots, rows: IntArray) -> IntArray | None:
    """Return a number per target for each report, negative if unknown; None without identities."""
    for column in (plots.icao_address, plots.identity, plots.callsign):
        if column is None:
            continue
        values: Any = np.asarray(column)[rows]
        known = values != "" if values.dtype.kind == "U" else values >= 0
        if np.any(known):
            numbers = np.unique(values, return_inverse=True)[1].astype(np.int64)
            return np.where(known, np.ravel(numbers), -1)
    return None
