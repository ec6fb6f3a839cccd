"""Warnings about plots that agree with those of other sensors only under another convention."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tertia._arrays import FloatArray, IntArray
from tertia.location._conventions import CONVENTIONS, Change
from tertia.sensors import PositionSensor, Radar
from tertia.sensors._identities import is_known
from tertia.tables._doubts import doubt
from tertia.tables._sensors import Sensors
from tertia.tracker import Plots

# sensors that are compared, plots of each that are, and fewer than which say nothing
_SENSORS, _PLOTS, _FEW = 6, 100, 30
# different targets that plots with identities must have, or places of those without, and plots of
# another sensor at about the same time among which some without identities are near by chance
_TARGETS, _DENSE = 5, 300
# plots of one target are so near to one another: a share of both ranges, three standard deviations,
# and the way between the two times at this speed
_ANGLE, _SIGMAS, _SPEED = 0.01, 3.0, 200.0
# other conventions are tried if fewer plots agree; one is suggested if so many agree, so many more,
# and so many times as many; if none is, a warning is given if fewer than the least agree
_USUAL, _GAIN, _TIMES, _LEAST = 0.5, 0.25, 3.0, 0.2
# share that must agree under another convention, with identities and without
_IDENTIFIED, _ANONYMOUS = 0.75, 0.3
# another meaning is better if so many more plots agree, and none is looked for beyond this share
_BETTER, _ENOUGH = 0.05, 0.9
# azimuths may be radians if all are within as many degrees, and gradians beyond a circle: both are
# noted already
_RADIANS, _FULL = np.radians(2.0 * np.pi), np.radians(361.0)
_KINDS = ("icao_address", "callsign", "identity", "mode_3a")

# errors of north in degrees, and differences of clocks up to so many seconds, that are tried
_DEGREES, _CLOCK = [degrees for degrees in range(-179, 180) if degrees], 300.0
# plots of a scan from which on a difference of clocks shows
_SEVERAL = 3.0


@dataclass(frozen=True, slots=True)
class _Change:
    """Another meaning of the plots of some sensors, and how to get from it to the usual one."""

    said: str
    changed: Sequence[int]
    usual: Change
    # by which the position of each of these sensors changes
    shift: FloatArray


def doubt_plot_conventions(plots: Plots, sensors: Sensors[Any]) -> None:
    """Warn if sensors see most targets at different places, and say why that may be."""
    known = [k for k, one in enumerate(sensors.items) if isinstance(one, Radar | PositionSensor)]
    count = np.bincount(plots.sensor, minlength=len(sensors.items))
    chosen = sorted(known, key=lambda k: -count[k])[:_SENSORS]
    near = _near_in_time(plots, sensors, sorted(chosen))
    if not near:
        return
    scene = _Scene.of(plots, sensors, near)
    if all(one.agreement(scene.place) >= _USUAL for one in scene.pairs):
        return
    meant = scene.explanation() or _other_clock(plots, sensors, near)
    if meant is not None:
        doubt(f"sensors see most targets at different places, and would agree if {meant}")
        return
    worst = min(scene.pairs, key=lambda one: one.agreement(scene.place))
    if worst.kind is not None and worst.agreement(scene.place) < _LEAST:
        first, second = (sensors.names[k] for k in worst.sensors)
        away = np.linalg.norm(scene.place[worst.first] - scene.place[worst.second], axis=1)
        doubt(
            f"plots of {first} and {second} with the same {worst.kind} are about "
            f"{np.median(away) / 1e3:.3g} km apart: is the position, the north or the clock of one "
            "of them wrong?"
        )


@dataclass(frozen=True, slots=True)
class _Near:
    """Plots of two sensors at about the same time, with equal identities of a kind if they can."""

    sensors: tuple[int, int]
    first: IntArray
    second: IntArray
    kind: str | None


def _near_in_time(plots: Plots, sensors: Sensors[Any], chosen: Sequence[int]) -> list[_Near]:
    """Return plots of each two sensors that may be of one target, where that can be known."""
    rows = {}
    for k in chosen:
        own = np.flatnonzero((plots.sensor == k) & np.isfinite(plots.time))
        # nan if all are reports of positions
        largest = np.fmax.reduce(np.abs(plots.azimuth[own]), initial=np.nan)
        if len(own) >= _FEW and not (largest <= _RADIANS or largest > _FULL):
            rows[k] = own[np.argsort(plots.time[own], kind="stable")]
    found = []
    for two in itertools.combinations(rows, 2):
        first, second = (rows[k] for k in two)
        half = 0.5 * max(_interval(sensors.items[k]) for k in two)
        one = _identified(plots, two, (first, second), half)
        one = one or _anonymous(plots, two, (first, second), half)
        if one is not None:
            found.append(one)
    return found


def _identified(
    plots: Plots, two: tuple[int, int], rows: tuple[IntArray, IntArray], half: float
) -> _Near | None:
    """Return plots with equal identities, of the first kind that enough have."""
    for kind in _KINDS:
        column = getattr(plots, kind)
        if column is None:
            continue
        own, other = (one[is_known(column[one])] for one in rows)
        first, second = _within(plots.time, _some(own), other, half)
        same = column[first] == column[second]
        first, second = first[same], second[same]
        used = np.unique(first)
        if len(used) >= _FEW and len(np.unique(column[used])) >= _TARGETS:
            return _Near(two, first, second, kind)
    return None


def _anonymous(
    plots: Plots, two: tuple[int, int], rows: tuple[IntArray, IntArray], half: float
) -> _Near | None:
    """Return all plots at about the same time, unless there are so many that some are near."""
    own = _some(rows[0])
    first, second = _within(plots.time, own, rows[1], half)
    if len(np.unique(first)) < _FEW or len(first) > _DENSE * len(own):
        return None
    return _Near(two, first, second, None)


def _other_clock(plots: Plots, sensors: Sensors[Any], near: Sequence[_Near]) -> str | None:
    """Return by which times of a sensor its plots without identities would agree with others."""
    for one in near:
        # one target that moves on agrees with itself at another time
        several = min(_plots_per_scan(plots, k, _interval(sensors.items[k])) for k in one.sensors)
        if one.kind is not None or several < _SEVERAL:
            continue
        before = _agreement_after(0.0, plots, sensors, one)
        if before >= _USUAL:
            continue
        step = max(_interval(sensors.items[k]) for k in one.sensors)
        later = step * np.arange(1.0, _CLOCK / step + 1.0)
        delays = np.concatenate([-later, later])
        found = np.array([_agreement_after(delay, plots, sensors, one) for delay in delays])
        if np.max(found) >= max(_ANONYMOUS, before + _GAIN, _TIMES * before):
            # several agree in part, as targets move little in a scan
            weight = np.maximum(found - 0.5 * (np.max(found) + before), 0.0)
            delay = float(np.sum(weight * delays) / np.sum(weight))
            said = "smaller" if delay > 0.0 else "larger"
            names = [sensors.names[k] for k in one.sensors]
            return (
                f"the times of {names[1]} were about {abs(delay):.0f} s {said}: is its clock "
                f"wrong, or that of {names[0]}?"
            )
    return None


def _plots_per_scan(plots: Plots, sensor: int, interval: float) -> float:
    time = plots.time[(plots.sensor == sensor) & np.isfinite(plots.time)]
    return len(time) / (1.0 + np.ptp(time) / interval) if len(time) else 0.0


def _agreement_after(delay: float, plots: Plots, sensors: Sensors[Any], near: _Near) -> float:
    """Return the share of plots that agree if the times of the second sensor are so much late."""
    two, half = near.sensors, 0.5 * max(_interval(sensors.items[k]) for k in near.sensors)
    moved = plots._replaced(time=plots.time - delay * (plots.sensor == two[1]))
    rows = [np.flatnonzero((plots.sensor == k) & np.isfinite(plots.time)) for k in two]
    first, second = (own[np.argsort(moved.time[own], kind="stable")] for own in rows)
    pairs = _anonymous(moved, two, (first, second), half)
    scene = None if pairs is None else _Scene.of(moved, sensors, [pairs])
    if scene is None or not scene.pairs or scene.pairs[0].variety(scene.place) < _TARGETS:
        return 0.0
    return scene.pairs[0].agreement(scene.place)


def _within(
    time: FloatArray, own: IntArray, other: IntArray, half: float
) -> tuple[IntArray, IntArray]:
    """Return pairs of plots that are not farther apart in time; `other` is in order of time."""
    begin, end = (np.searchsorted(time[other], time[own] + way) for way in (-half, half))
    near = [other[a:b] for a, b in zip(begin, end, strict=True)]
    return np.repeat(own, end - begin), np.concatenate([other[:0], *near])


@dataclass(frozen=True, slots=True)
class _Pairs:
    """Rows of plots of two sensors that may be of one target, and how far apart these may be."""

    sensors: tuple[int, int]
    first: IntArray
    second: IntArray
    most: FloatArray
    kind: str | None
    # where those of each plot of the first sensor begin
    start: IntArray

    def agreement(self, place: FloatArray) -> float:
        """Return the share of the plots of the first sensor that have one of the second nearby."""
        east, north = (place[self.first] - place[self.second]).T
        is_near = east**2 + north**2 <= self.most**2
        return float(np.mean(np.logical_or.reduceat(is_near, self.start)))

    def variety(self, place: FloatArray) -> int:
        """Return at how many different places plots of both sensors agree."""
        cell = 2.0 * np.median(self.most)
        is_near = np.linalg.norm(place[self.first] - place[self.second], axis=1) <= self.most
        return len(np.unique(np.floor(place[self.first[is_near]] / cell), axis=0))


@dataclass(frozen=True, slots=True)
class _Scene:
    """Plots that are compared, as positions in the plane."""

    sensors: Sensors[Any]
    sensor: IntArray
    place: FloatArray
    # of the sensor of each plot; of the plot itself if its sensor reports positions
    origin: FloatArray
    pairs: Sequence[_Pairs]

    @classmethod
    def of(cls, plots: Plots, sensors: Sensors[Any], near: Sequence[_Near]) -> _Scene:
        used = np.unique(np.concatenate([rows for one in near for rows in (one.first, one.second)]))
        some = plots[used]
        place = np.full((len(some), 2), np.nan) if some.position is None else some.position.copy()
        origin, spread = place.copy(), np.zeros(len(some))
        radars = [k for k, one in enumerate(sensors.items) if isinstance(one, Radar)]
        rows = np.flatnonzero(np.isin(some.sensor, radars))
        if len(rows):
            own = some[rows]
            number = np.searchsorted(radars, own.sensor)
            items = [sensors.items[k] for k in radars]
            place[rows], covariance = own._replaced(sensor=number).to_cartesian(items)
            spread[rows] = _SIGMAS * np.sqrt(np.trace(covariance, axis1=1, axis2=2))
            origin[rows] = np.array([one.position[:2] for one in items])[number]
        allowed = _ANGLE * np.linalg.norm(place - origin, axis=1) + spread
        pairs = []
        for one in near:
            first, second = (np.searchsorted(used, rows) for rows in (one.first, one.second))
            most = allowed[first] + allowed[second]
            most += _SPEED * np.abs(some.time[first] - some.time[second])
            there = np.isfinite(most)
            if np.any(there):
                first, second = first[there], second[there]
                start = np.flatnonzero(np.diff(first, prepend=-1))
                pairs.append(_Pairs(one.sensors, first, second, most[there], one.kind, start))
        return cls(sensors, some.sensor, place, origin, pairs)

    def explanation(self) -> str | None:
        """Return under which other meaning most plots would agree."""
        best, meant = 0.0, None
        for several in self._changes():
            if best > _ENOUGH:
                break
            found = [self._agreement(one) for one in several]
            # the middle of those that are as good as the best
            good = np.flatnonzero(np.array(found) > max(found) - _BETTER)
            middle = int(good[len(good) // 2])
            if found[middle] > best + _BETTER:
                best, meant = found[middle], several[middle].said
        return meant

    def _agreement(self, change: _Change) -> float:
        """Return the share of plots that would agree; 0 if that is no reason to suggest it."""
        touched = [one for one in self.pairs if set(change.changed) & set(one.sensors)]
        if not touched:
            return 0.0
        place = self._changed(change)
        before, after = (
            float(np.mean([one.agreement(where) for one in touched]))
            for where in (self.place, place)
        )
        anonymous = any(one.kind is None for one in touched)
        needed = _ANONYMOUS if anonymous else _IDENTIFIED
        if before >= _USUAL or after < max(needed, before + _GAIN, _TIMES * before):
            return 0.0
        # a few targets at rest may agree by chance
        places = sum(one.variety(place) for one in touched)
        if anonymous and places < _TARGETS * len(touched):
            return 0.0
        return float(np.mean([one.agreement(place) for one in self.pairs]))

    def _changed(self, change: _Change) -> FloatArray:
        """Return the positions of all plots, if those of some sensors mean something else."""
        rows = np.isin(self.sensor, change.changed)
        place: FloatArray = self.place.copy()
        shift = np.zeros((len(self.sensors.items), 2))
        shift[list(change.changed)] = change.shift
        east, north = (self.place[rows] - self.origin[rows]).T
        azimuth = change.usual(np.arctan2(east, north) % (2.0 * np.pi))
        towards = np.column_stack([np.sin(azimuth), np.cos(azimuth)])
        place[rows] = self.origin[rows] + np.hypot(east, north)[:, np.newaxis] * towards
        place[rows] += shift[self.sensor[rows]]
        return place

    def _changes(self) -> Iterator[Sequence[_Change]]:
        """Yield other meanings of the plots, the most usual mistakes first."""
        used = sorted({k for one in self.pairs for k in one.sensors})
        radars = [k for k in used if isinstance(self.sensors.items[k], Radar)]
        names = self.sensors.names
        whose = {"azimuths": radars} | {f"the azimuths of {names[k]}": [k] for k in radars}
        for one in CONVENTIONS:
            if one.kind != "azimuth":
                continue
            # of two radars the same as half a turn
            swapped = len(radars) == 2 and np.isclose(one.usual(np.zeros(1)), np.pi).all()
            said = f"{one.said}{', or if the radars were exchanged' if swapped else ''}"
            for noun, changed in whose.items():
                yield [_Change(f"{noun} were {said}", changed, one.usual, np.zeros(2))]
        for two in itertools.combinations(radars, 2):
            sites = np.array([self.sensors.items[k].position[:2] for k in two])
            said = f"the plots of {names[two[0]]} were those of {names[two[1]]}, and vice versa"
            yield [_Change(said, two, _unchanged, sites[::-1] - sites)]
        for noun, changed in whose.items():
            yield [
                _Change(
                    f"{noun} were about {abs(degrees)}° {'larger' if degrees > 0 else 'smaller'}: "
                    "are they relative to magnetic north, to grid north or to a heading?",
                    changed,
                    _turned_by(degrees),
                    np.zeros(2),
                )
                for degrees in _DEGREES
            ]
        for k in radars:
            shift = self._shift(k)
            if shift is not None:
                east, north = shift / 1e3
                said = (
                    f"{names[k]} were {_towards(east, 'east', 'west')} and "
                    f"{_towards(north, 'north', 'south')} of its stated position"
                )
                yield [_Change(said, [k], _unchanged, shift)]

    def _shift(self, sensor: int) -> FloatArray | None:
        """Return how far a sensor is from where it is stated to be, if plots have identities."""
        apart = [np.empty((0, 2))]
        for one in self.pairs:
            if sensor in one.sensors and one.kind is not None:
                sign = 1.0 if one.sensors[1] == sensor else -1.0
                apart.append(sign * (self.place[one.first] - self.place[one.second]))
        every = np.concatenate(apart)
        middle: FloatArray | None = np.median(every, axis=0) if len(every) else None
        return middle


def _some(rows: IntArray) -> IntArray:
    """Return some of the rows, from all parts of the recording."""
    if len(rows) <= _PLOTS:
        return rows
    return rows[np.linspace(0, len(rows) - 1, _PLOTS).astype(np.int64)]


def _interval(sensor: Radar | PositionSensor) -> float:
    return sensor.scan_period if isinstance(sensor, Radar) else sensor.update_interval


def _unchanged(azimuth: FloatArray) -> FloatArray:
    return azimuth


def _turned_by(degrees: float) -> Change:
    return lambda azimuth: azimuth + np.radians(degrees)


def _towards(kilometres: float, ahead: str, behind: str) -> str:
    return f"about {abs(kilometres):.3g} km {ahead if kilometres > 0.0 else behind}"
