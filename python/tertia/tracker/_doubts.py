"""What a tracker says about clocks and periods of sensors, and about addresses of two tracks."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence

import numpy as np

from tertia import _core
from tertia._arrays import FloatArray, IntArray
from tertia.sensors import RADAR_LIMITS, Bias, PositionSensor, Radar, Station
from tertia.sensors._sensors import own_biases
from tertia.tracker._extents import Extents
from tertia.tracker._mistakes import Ranges, are_slow, mistakes, range_doubts
from tertia.tracker._plots import Plots
from tertia.tracker._registrar import chosen, joined, scans
from tertia.tracker._sensors import Sensor, interval
from tertia.tracker._table import TrackTable

# plots and periods from which the period of a sensor is known, and most plots that are used
_ENOUGH, _PERIODS, _MOST = 30, 8.0, 4000
# factor by which a period differs that is said
_DIFFERS = 1.3
# periods of a beam that are tried, and the times between plots that are compared, relative to the
# period stated; most pairs of such plots
_TRIED, _LAGS, _PAIRS = np.geomspace(0.2, 5.0, 300), (0.2, 0.3, 0.5, 0.7, 1, 1.6, 2.3), 400
# mean cosine, of what a beam turned less what is expected, from which a period is believed; by how
# much it exceeds that of the period stated; difference between periods that explain the same
_TURNS, _MORE, _EQUAL = 0.9, 0.3, 0.03
# mean cosine below which there is no beam; times after which targets come back without one, in
# scans, and share of the targets that do
_NO_BEAM, _EARLY, _BACK = 0.4, (0.15, 0.6), 0.15
# sectors of 30° that must have several plots
_SECTOR, _SECTORS, _SEVERAL = np.pi / 6.0, 5, 3
# copies of a report come within so many seconds; share of the reports that follow sooner than
# usual, and of the plots of a radar that must follow within a period that is believed
_COPIED, _SOON, _SOONEST = 1e-3, 0.25, 0.05
# limits from which an error that all radars have is no chance, and by how much their errors may
# differ, relative to it; seconds after which live errors are looked at again
_COMMON, _ALIKE, _AGAIN = 3.0, 0.25, 60.0
# scans of the slowest sensor in which two tracks have one address until it is said; scans after
# which this is looked for; more than there are tracks
_SCANS, _LOOK, _TRACKS = 8, 3.0, 2.0**28


def names_of(sensors: Sequence[Sensor]) -> list[str]:
    """Return what messages call sensors."""
    return [f"sensors[{k}]" for k in range(len(sensors))]


def clock_doubts(core: _core.PlotTracker, names: Sequence[str]) -> list[str]:
    """Return what there is to say about clocks since the last call."""
    said = []
    for sensor, ahead, is_believed in core.take_clock_doubts():
        begin = f"{names[sensor]}: its plots go on about {abs(ahead):.0f} s"
        if is_believed:
            said.append(
                f"{begin} before the time of the tracker, and no sensor is in time: the tracker "
                "starts anew there. Was a clock set, or were earlier plots ahead?"
            )
        elif ahead < 0.0:
            said.append(
                f"{begin} before those of other sensors, and are refused. Is its clock wrong? If "
                "its plots are late, state a lag"
            )
        else:
            said.append(
                f"{begin} after those of other sensors, and are refused. Is its clock wrong?"
            )
    return said


def place_doubts(sensors: Sequence[Sensor], bias: Bias, names: Sequence[str]) -> list[str]:
    """Return whether all radars have the same errors, as if one of them were not at its place.

    If one of two radars is elsewhere, the tracks of both agree after a rotation and a change of
    scale. If the errors of radars are independent, they are hardly ever large and alike.
    """
    radars = [one for one in sensors if isinstance(one, Radar)]
    if len(radars) < max(2, len(sensors)):
        return []
    prior = own_biases(sensors)
    azimuth, gain = bias.azimuth - prior.azimuth, bias.range_gain - prior.range_gain
    both = np.stack([azimuth, gain], axis=-1)
    mean = both.mean(axis=0)
    limits = np.array([RADAR_LIMITS.azimuth_sigma, RADAR_LIMITS.range_gain_sigma])
    size = float(np.hypot(*mean))
    if np.hypot(*mean / limits) < _COMMON or np.ptp(both, axis=0).max() > _ALIKE * size:
        return []
    place = np.array([one.position[:2] for one in radars])
    apart = 1e-3 * size * np.max(np.linalg.norm(place - place[:, np.newaxis], axis=-1))
    return [
        f"{', '.join(names)}: all azimuths are {np.degrees(mean[0]):+.2f}° and all ranges "
        f"{100.0 * mean[1]:+.2f} % off, as if one of the sensors were {apart:.2g} km from its "
        "position. Are the positions, north and the units of ranges right?"
    ]


class Doubts:
    """The first plots, until the periods of the sensors are known, and the tracks of addresses."""

    def __init__(self, sensors: Sequence[Sensor], max_speed: float) -> None:
        self._max_speed = max_speed
        # sensors whose periods are not known yet, plots so far, and when to look at them
        self._unknown = {
            k: one for k, one in enumerate(sensors) if isinstance(one, Radar | PositionSensor)
        }
        self._plots: list[Plots] = []
        self._count, self._due = 0, np.nan
        self._span = _PERIODS * max(map(interval, sensors))
        self._shared, self._extents = Shared(sensors), Extents(sensors)
        self._ranges, self._sensors = Ranges(sensors), sensors
        # when to look at the errors of the sensors
        self._look = np.nan

    def of_places(
        self, sensors: Sequence[Sensor], bias: Callable[[], Bias], time: float
    ) -> list[str]:
        """Return what there is to say, once, about the errors that sensors have at a time."""
        if time < self._look or not np.isfinite(time):
            return []
        said = [] if np.isnan(self._look) else place_doubts(sensors, bias(), names_of(sensors))
        self._look = np.inf if said else time + _AGAIN
        return said

    def after(self, table: TrackTable, plots: Plots, first: int, names: Sequence[str]) -> list[str]:
        """Return what there is to say after an update with plots from index `first` on."""
        said = self._of_periods(plots, names) + self._shared.doubts(table)
        said += self._ranges.doubts(table, plots, names)
        if self._extents.are_known:
            return said
        own = np.flatnonzero((table.plot >= first) & (table.plot < first + len(plots)))
        return said + self._extents.after(table.track[own], table.plot[own] - first, plots, names)

    def _of_periods(self, plots: Plots, names: Sequence[str]) -> list[str]:
        """Return what there is to say about periods that are known with these plots."""
        if not self._unknown or not len(plots):
            return []
        self._plots.append(plots)
        time, self._count = float(plots.time[-1]), self._count + len(plots)
        if np.isnan(self._due):
            self._due = time + self._span
        if 0.0 < self._due - time <= self._span and self._count < _MOST:
            return []
        several, said = joined(self._plots), []
        self._plots, self._due = [several], time + self._span
        for k, sensor in [*self._unknown.items()]:
            seen = seen_by(sensor, several[several.sensor == k])
            if _is_enough(seen[:, 0], interval(sensor)):
                del self._unknown[k]
                said += period_doubts(sensor, seen, names[k], self._max_speed)
        if self._count >= _MOST or not self._unknown:
            self._unknown, self._plots = {}, []
            own = {k: several[several.sensor == k] for k in _ranging(self._sensors)}
            wrong = mistakes(own, self._sensors, names, self._max_speed)
            if wrong:
                # it also makes ranges and places look wrong
                self._look = np.inf
                self._ranges.stop()
            said += wrong
        return said


class Shared:
    """Rows of tracks with addresses since the last look, and the addresses that two tracks have."""

    def __init__(self, sensors: Sequence[Sensor]) -> None:
        self._scan = max(map(interval, sensors), default=1.0)
        self._rows: list[TrackTable] = []
        self._due = -np.inf
        # scans in which an address had two tracks, and the last of these
        self._double: dict[float, tuple[int, float]] = {}
        self._said: set[float] = set()

    def doubts(self, table: TrackTable, *, last: bool = False) -> list[str]:
        """Return which addresses are now known to be those of two tracks at the same time."""
        if not (table.icao_address >= 0).any():
            return []
        self._rows.append(table)
        newest = float(table.time[-1])
        if 0.0 < self._due - newest <= _LOOK * self._scan and not last:
            return []
        several, self._rows = self._rows, []
        self._due = newest + _LOOK * self._scan
        parts = []
        for one in several:
            # numbers of tracks may be provisional in rows that are not final
            shown = one.final & one.confirmed & (one.plot >= 0) & (one.icao_address >= 0)
            parts.append(np.stack([one.time, one.icao_address, one.track])[:, shown])
        return self._look(np.concatenate(parts, axis=1))

    def _look(self, seen: FloatArray) -> list[str]:
        """Return which addresses have two tracks in several scans, by time, address and track."""
        pairs = np.unique(seen[1] * _TRACKS + seen[2] % _TRACKS)
        address, count = np.unique(pairs // _TRACKS, return_counts=True)
        seen = seen[:, np.isin(seen[1], address[count > 1])]
        scans = np.unique(np.stack([np.floor(seen[0] / self._scan), *seen[1:]]), axis=1)
        said = []
        for (scan, own, first), (other_scan, other, second) in itertools.pairwise(scans.T.tolist()):
            if (scan, own) != (other_scan, other) or own in self._said:
                continue
            times, before = self._double.get(own, (0, -np.inf))
            if scan == before:
                continue
            times = times + 1 if 0.0 < scan - before <= _LOOK else 1
            self._double[own] = times, scan
            if times >= _SCANS:
                self._said.add(own)
                said.append(
                    f"tracks {first:.0f} and {second:.0f} have the same address, {int(own):06X}, "
                    "at the same time: are positions that a sensor reports false, or do two "
                    "targets send this address?"
                )
        return said


def recording_doubts(
    table: TrackTable, plots: Plots, sensors: Sequence[Sensor], bias: Bias, max_speed: float
) -> list[str]:
    """Return what there is to say about a recording, its tracks, and the errors of its sensors."""
    said = Shared(sensors).doubts(table, last=True)
    names = names_of(sensors)
    own = {k: plots[_begin(sensors[k], k, plots)] for k in _ranging(sensors)}
    for k, first in own.items():
        sensor, seen = sensors[k], seen_by(sensors[k], first)
        if not isinstance(sensor, Station):
            said += period_doubts(sensor, seen, names[k], max_speed)
    may_be_faster = not are_slow(table, max_speed)
    wrong = mistakes(own, sensors, names, max_speed, may_be_faster=may_be_faster)
    if not wrong:
        # otherwise, ranges and places look wrong, too
        wrong = place_doubts(sensors, bias, names) + range_doubts(table, plots, sensors, names)
    said += wrong
    return said + extent_doubts(table, plots, sensors, names)


def _ranging(sensors: Sequence[Sensor]) -> list[int]:
    """Return the indices of the sensors whose plots have a place."""
    return [k for k, one in enumerate(sensors) if not isinstance(one, Station)]


def extent_doubts(
    table: TrackTable, plots: Plots, sensors: Sequence[Sensor], names: Sequence[str]
) -> list[str]:
    """Return whether targets in a recording give several plots in a scan."""
    extents, said = Extents(sensors), []
    extents.expect(plots)
    if extents.are_known:
        return []
    track = np.full(len(plots), -1)
    track[table.plot[table.plot >= 0]] = table.track[table.plot >= 0]
    for index in scans(plots.time, max(map(interval, sensors))):
        if extents.are_known:
            break
        used = np.flatnonzero(track[index] >= 0)
        said += extents.after(track[index][used], used, chosen(plots, index), names)
    return said


def _begin(sensor: Sensor, index: int, plots: Plots) -> IntArray:
    """Return the indices of the first plots of the sensor of this index that have a place."""
    place = [plots.range, plots.azimuth]
    if not isinstance(sensor, Radar):
        place = [] if plots.position is None else [*plots.position.T]
    known = np.isfinite([plots.time, *place]).all(axis=0)
    own = np.flatnonzero((plots.sensor == index) & known)
    return own[np.argsort(plots.time[own], kind="stable")[:_MOST]]


def seen_by(sensor: Sensor, plots: Plots) -> FloatArray:
    """Return the times of plots of a sensor with their positions, and azimuths of a radar first."""
    if not isinstance(sensor, Radar):
        where = np.empty((len(plots), 2)) if plots.position is None else plots.position
        seen: FloatArray = np.column_stack([plots.time, where])
        return seen[:0] if plots.position is None else seen[np.isfinite(seen).all(axis=1)]
    direction = np.stack([np.sin(plots.azimuth), np.cos(plots.azimuth)], axis=-1)
    where = plots.range[:, np.newaxis] * direction
    known: FloatArray = np.column_stack([plots.time, plots.azimuth, where])
    return known[np.isfinite(known).all(axis=1)]


def period_doubts(
    sensor: Radar | PositionSensor, seen: FloatArray, name: str, max_speed: float
) -> list[str]:
    """Return what there is to say about the period of a sensor, from what it has seen."""
    stated = interval(sensor)
    seen = seen[np.argsort(seen[:, 0], kind="stable")][:_MOST]
    if not _is_enough(seen[:, 0], stated):
        return []
    if isinstance(sensor, Radar):
        return _beam_doubts(seen, stated, name, max_speed)
    found = _return(seen[:, 1:], seen[:, 0], max_speed, _SOON)
    if not _DIFFERS * stated < found < np.inf:
        return []
    return [
        f"{name}: reports of a target come about every {found:.2g} s, and update_interval is "
        f"{stated:g} s: targets that report less often than every {2.0 * stated:g} s have no "
        "tracks. State a longer update_interval"
    ]


def _beam_doubts(seen: FloatArray, stated: float, name: str, max_speed: float) -> list[str]:
    """Return what there is to say about the beam of a radar, from what it has seen."""
    turn, (early, late) = _turn(seen[:, :2], stated), stated * np.array(_EARLY)
    if turn == np.inf and _return(seen[:, 2:], seen[:, 0], max_speed, _BACK, early) < late:
        return [
            f"{name}: its plots do not follow a beam that turns, and targets come back after any "
            "time: tracks are split. Give its plots, as positions with covariances, to a "
            "PositionSensor"
        ]
    if (
        turn in {None, np.inf}
        or _return(seen[:, 2:], seen[:, 0], max_speed, _SOONEST) > _DIFFERS * turn
    ):
        return []
    return [
        f"{name}: its beam turns once in about {turn:.2g} s, and scan_period is {stated:g} s: "
        "tracks are lost or split. State the true one"
    ]


def _is_enough(time: FloatArray, stated: float) -> bool:
    known = len(time) >= _ENOUGH and np.ptp(time) >= _PERIODS * stated
    return bool(known or len(time) >= _MOST)


def _turn(seen: FloatArray, stated: float) -> float | None:
    """Return the period of a beam if it is clearly not that stated; infinity without a beam."""
    time, azimuth = seen.T
    sectors = np.bincount((azimuth % (2.0 * np.pi) // _SECTOR).astype(np.int64))
    if np.sum(sectors >= _SEVERAL) < _SECTORS:
        # plots at a few azimuths show no beam
        return None
    pairs = []
    for lag in _LAGS:
        other = np.searchsorted(time, time + lag * stated)
        own = np.flatnonzero(other < len(time))
        pairs.append((own, other[own]))
    first, second = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    first, second = (rows[:: len(rows) // _PAIRS + 1] for rows in (first, second))
    if len(first) < _ENOUGH:
        return None
    turned, since = azimuth[second] - azimuth[first], time[second] - time[first]
    rates = 2.0 * np.pi / (stated * _TRIED[:, np.newaxis])
    near = np.abs(np.log(_TRIED)) <= np.log(_DIFFERS)
    as_stated = float(np.max(np.mean(np.cos(turned - rates[near] * since), axis=1)))
    if as_stated > 1.0 - _MORE:
        # no period explains so much more
        return None
    follows = np.mean(np.cos(turned - rates * since), axis=1)
    best = float(np.max(follows))
    if best < _NO_BEAM:
        return np.inf
    if best < _TURNS or as_stated > best - _MORE:
        return None
    # half of a period may explain few azimuths as well
    good = np.split(np.arange(len(_TRIED)), np.flatnonzero(np.diff(follows > best - _EQUAL)) + 1)
    last = next(run for run in reversed(good) if follows[run[0]] > best - _EQUAL)
    return stated * float(_TRIED[last[np.argmax(follows[last])]])


def _return(
    place: FloatArray, time: FloatArray, max_speed: float, share: float, after: float = _COPIED
) -> float:
    """Return the time within which this share of the targets is seen again nearby; or infinity.

    Plots that follow sooner than `after` do not count.
    """
    since = time - time[:_ENOUGH, np.newaxis]
    moved = np.linalg.norm(place - place[:_ENOUGH, np.newaxis], axis=-1)
    again = (since > after) & (moved <= max_speed * since)
    soonest = np.min(since, axis=1, where=again, initial=np.inf)
    return float(np.quantile(soonest, share, method="lower"))
