"""What a tracker says about units, largest speeds and errors of ranges that cannot be as stated."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia.sensors import Radar, Station
from tertia.tracker._earth import in_plane
from tertia.tracker._plots import Plots
from tertia.tracker._registrar import joined
from tertia.tracker._sensors import Sensor, interval
from tertia.tracker._table import TrackTable

# times and places beyond which plots are not used
_FARTHEST = 1e11
# plots of a sensor that are looked at: most, fewest, and pairs with the plots around them; most
# plots around one
_LOOKED, _FEWEST, _PAIRS, _OTHERS = 60, 24, 60_000, 200
# times to the plots before and after, in scans; share of the path, and standard deviations, within
# which the next plot of a target is expected
_SCAN, _STEADY, _SIGMAS = (0.5, 1.5), 0.15, 5.0
# speeds that are too high: relative to the largest speed, and up to so many m/s, or times the
# largest speed; share of the plots that must show them
_FAST, _FASTEST, _TIMES, _SHOWN = 1.25, 500.0, 10.0, 0.3
# speed of tracks, relative to the largest speed, and share of their rows that may be faster, up to
# which the largest speed is not too low
_SLOW, _SPARE = 0.95, 0.05
# speeds of paths by chance, relative to the one before
_OTHER_SPEEDS = (2.0, -1.0)
# the same of a target that is not too fast: sigmas of its speed and of its place, and the change of
# its speed in a scan, relative to the largest speed
_SPEED_SIGMAS, _PLACE_SIGMAS, _CHANGE = 2.0, 3.0, 0.5
# units that ranges may have, or for which they were taken: their true lengths
_UNITS = {
    "feet": 0.3048,
    "yards": 0.9144,
    "kilometres": 1e3,
    "statute miles": 1609.344,
    "nautical miles": 1852.0,
    "nautical miles that were taken for kilometres": 1.852,
    "kilometres that were taken for nautical miles": 1.0 / 1.852,
}
# share of the range within which two radars have a target at the same place; by how much more such
# plots there must be than in other directions, and by how much more than with the unit stated
_PLACE, _AGREE, _BETTER = 0.03, 0.3, 3.0
# the same where only distances are compared
_WIDER = 1.001
# the direction of plots, and others for comparison
_ASIDE = np.radians([0.0, 40.0, 100.0, 180.0, 230.0, 310.0])
# about how many rows of tracks are used, those of so many scans at once, and most plots that are
# compared with others
_ROWS, _AT_ONCE, _COMPARED = 6000, 5.0, 400
# scans after which a live tracker looks at ranges, and how often it does if there are enough plots
_LATER, _LOOKS = 25.0, 4
# sigmas of errors of ranges (m, relative), azimuths (rad), times (s) and of the share of the slant
# that ranges lack: as usual, though much larger than the limits, and if one of them is wrong
_USUAL = np.array([1e3, 1.0 / 1852.0, np.radians(1.0), 1.0, 1e-3])
_GAIN, _SLANT, _KINDS = 1, 4, 5
_WRONG = {_GAIN: 0.1, _SLANT: 1.0}
# errors that are said, the least and the largest; largest squared residual, in variances;
# acceleration of targets, m/s2; least fall of the mean square, relative to it, and of their sum
_LIKELY = {_GAIN: (0.004, 0.2), _SLANT: (0.5, 1.5)}
_LARGEST, _ACCELERATION, _FALL, _SUM, _STEPS = 20.0, 2.0, 0.15, 60.0, 8
# mean square below which usual errors explain the differences
_UNEXPLAINED = 1.1


class Seen(NamedTuple):
    """Plots of a sensor that have a place, in the order of time."""

    time: FloatArray
    place: FloatArray
    sigma: FloatArray
    # from the radar, 0 of other sensors; by how much the slant range is longer; velocity of tracks
    away: FloatArray
    slant: FloatArray
    velocity: FloatArray


def seen_of(
    some: Plots,
    sensors: Sequence[Sensor],
    k: int,
    velocity: FloatArray | None = None,
    *,
    unit: float = 1.0,
) -> Seen:
    """Return some plots of a sensor in the plane, if its ranges have this unit."""
    sensor = sensors[k]
    away, slant = np.zeros((len(some), 2)), np.zeros(len(some))
    if isinstance(sensor, Radar):
        # numbers may be too large to be squared
        with np.errstate(over="ignore", invalid="ignore"):
            some = in_plane(some._replaced(range=unit * some.range), sensors)
            up = some.height - (sensor.position[2] if len(sensor.position) > 2 else 0.0)
            up = np.where(np.isfinite(up), up, 0.0)
            ground = np.sqrt(np.maximum(some.range**2 - up**2, 0.0))
            direction = np.stack([np.sin(some.azimuth), np.cos(some.azimuth)], axis=-1)
            away, slant = ground[:, np.newaxis] * direction, some.range - ground
        place = np.asarray(sensor.position)[:2] + away
        sigma = np.hypot(sensor.range_sigma, sensor.azimuth_sigma * ground)
    else:
        place = np.full((len(some), 2), np.nan) if some.position is None else some.position
        stated = getattr(sensor, "position_sigma", None)
        sigma = np.full(len(some), 0.0 if stated is None else stated)
        if some.covariance is not None:
            own = np.sqrt(np.max(np.diagonal(some.covariance, axis1=1, axis2=2), axis=1))
            sigma = np.where(np.isnan(own), sigma, own)
    moves = np.zeros((len(some), 2)) if velocity is None else velocity
    known = (np.abs(np.column_stack([some.time, place])) < _FARTHEST).all(axis=1)
    order = np.flatnonzero(known)[np.argsort(some.time[known], kind="stable")]
    columns = (some.time, place, sigma, away, slant, moves)
    return Seen(*(column[order] for column in columns))


def mistakes(
    plots: dict[int, Plots],
    sensors: Sequence[Sensor],
    names: Sequence[str],
    max_speed: float,
    *,
    may_be_faster: bool = True,
) -> list[str]:
    """Return what there is to say about units of ranges, and about the largest speed.

    `plots` are some successive plots of each sensor that measures positions. The speed is looked at
    if targets `may_be_faster`.
    """
    if len(plots) < 2 and not may_be_faster:
        return []
    seen = {k: seen_of(own, sensors, k) for k, own in plots.items()}
    said = _unit_doubts(seen, plots, sensors, names)
    return said or (_speed_doubts(seen, sensors, names, max_speed) if may_be_faster else [])


def are_slow(table: TrackTable, max_speed: float) -> bool:
    """Whether tracks have most of the plots of a recording, and are slower than targets may be."""
    speed = np.linalg.norm(table.velocity[:_ROWS], axis=-1)
    has_most = np.count_nonzero(table.track_of_plot >= 0) > 0.5 * len(table.track_of_plot)
    return bool(has_most and np.count_nonzero(speed > _SLOW * max_speed) < _SPARE * len(speed))


def _speed_doubts(
    seen: dict[int, Seen], sensors: Sequence[Sensor], names: Sequence[str], max_speed: float
) -> list[str]:
    """Return whether plots follow one another as those of targets that are too fast."""
    speeds = {k: _too_fast(own, interval(sensors[k]), max_speed) for k, own in seen.items()}
    fast = {k: speed for k, speed in speeds.items() if speed > 0.0}
    if not fast:
        return []
    return [
        f"{', '.join(names[k] for k in fast)}: plots follow one another as those of targets at "
        f"about {np.median([*fast.values()]):.0f} m/s, and max_speed is {max_speed:g} m/s: tracks "
        "are lost or split. Are max_speed, ranges and times in m/s, metres and seconds?"
    ]


def _too_fast(seen: Seen, period: float, max_speed: float) -> float:
    """Return the usual speed of targets that are faster than the largest speed; 0 if there is none.

    Three plots in succession show a speed if they are on a line. How many do so by chance is known
    from paths that turn by a right angle or change their speed, as on routes. Plots that may be of
    slower targets do not count.
    """
    at = _looked(seen, period)
    if not len(at):
        return 0.0
    place, sigma = seen.place[at, np.newaxis], seen.sigma[at, np.newaxis, np.newaxis]
    fastest = max(_FASTEST, _TIMES * max_speed)
    since, before = _around(seen, seen.time[at], period * np.array([-_SCAN[1], -_SCAN[0]]))
    ahead, after = _around(seen, seen.time[at], period * np.array(_SCAN))
    # most plots are too far away for any of the speeds below
    reach = fastest + _SIGMAS * sigma[..., 0] / (_SCAN[0] * period)
    velocity = (place - seen.place[before]) / -since[..., np.newaxis]
    (velocity,) = _nearest(_length(velocity) <= reach, velocity)
    moved = seen.place[after] - place
    farthest = (max(_OTHER_SPEEDS) + _STEADY) * reach * ahead
    moved, ahead = _nearest(_length(moved) <= farthest, moved, ahead)
    speed = _length(velocity)[..., np.newaxis]
    moved, ahead = moved[:, np.newaxis], ahead[:, np.newaxis]
    way = velocity[:, :, np.newaxis] * ahead[..., np.newaxis]
    off = _length(moved - way)
    near = off <= _PLACE_SIGMAS * sigma + _CHANGE * max_speed * ahead
    is_slow = near & (speed <= _FAST * max_speed + _SPEED_SIGMAS * sigma / period)
    is_fast = (speed > _FAST * max_speed) & (speed < fastest)
    is_fast &= ~is_slow.any(axis=(1, 2), keepdims=True)
    tolerance = _SIGMAS * sigma + _STEADY * speed * ahead
    hit = is_fast & (off <= tolerance)
    share = np.mean(hit.any(axis=(1, 2)))
    if share <= _SHOWN:
        return 0.0
    for other in (way[..., ::-1] * [1.0, -1.0], *(faster * way for faster in _OTHER_SPEEDS)):
        by_chance = is_fast & (_length(moved - other) <= tolerance)
        if share - np.mean(by_chance.any(axis=(1, 2))) <= _SHOWN:
            return 0.0
    return float(np.median(np.broadcast_to(speed, hit.shape)[hit]))


def _length(vectors: FloatArray) -> FloatArray:
    """Return the lengths of vectors in the plane, (..., 2), faster than `np.linalg.norm`."""
    east, north = vectors[..., 0], vectors[..., 1]
    length: FloatArray = np.sqrt(east * east + north * north)
    return length


def _nearest(is_near: BoolArray, *columns: FloatArray) -> list[FloatArray]:
    """Return columns (M, W, ...) with the entries that are near first, as many as rows have."""
    count = max(1, int(np.max(np.count_nonzero(is_near, axis=1))))
    order = np.argsort(~is_near, axis=1, kind="stable")[:, :count]
    rows = np.arange(len(order))[:, np.newaxis]
    return [column[rows, order] for column in columns]


def _looked(seen: Seen, period: float) -> IntArray:
    """Return the indices of the plots that are looked at; none of too few."""
    count = len(seen.time)
    if count < _LOOKED:
        return np.zeros(0, dtype=np.int64)
    in_scan = max(1.0, period * count / max(np.ptp(seen.time), period))
    looked = int(np.clip(_PAIRS / in_scan**2, _FEWEST, _LOOKED))
    return np.linspace(0, count - 1, looked).astype(np.int64)


def _around(seen: Seen, time: FloatArray, span: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return times from each time to the plots in a span about it, and the plots, (M, W).

    Of many plots, the first ones are returned. Where there are fewer, times are nan.
    """
    first, last = (np.searchsorted(seen.time, time + edge) for edge in span)
    width = int(np.clip(np.max(last - first), 1, _OTHERS))
    index = first[:, np.newaxis] + np.arange(width)
    inside = index < last[:, np.newaxis]
    index = np.minimum(index, len(seen.time) - 1)
    return np.where(inside, seen.time[index] - time[:, np.newaxis], np.nan), index


def _unit_doubts(
    seen: dict[int, Seen],
    plots: dict[int, Plots],
    sensors: Sequence[Sensor],
    names: Sequence[str],
) -> list[str]:
    """Return whether a radar and the others agree if its ranges have another unit."""
    best, text = 0.0, []
    for k, own in seen.items():
        sensor = sensors[k]
        others = [one for other, one in seen.items() if other != k and len(one.time)]
        if not isinstance(sensor, Radar) or not others:
            continue
        at, places = _looked(own, interval(sensor)), np.zeros((0, 0, 2))
        if len(at):
            places = np.concatenate([_places(one, own.time[at], sensor) for one in others], axis=1)
        stated = _agreement(own, at, places)
        # if plots agree as stated, no other unit can be better
        for called, unit in _UNITS.items() if stated < _AGREE else ():
            other = seen_of(plots[k], sensors, k, unit=unit)
            share = _agreement(other, at, places) if len(other.time) == len(own.time) else 0.0
            if share > max(_AGREE, _BETTER * stated, best):
                best = share
                text = [
                    f"{names[k]}: its plots agree with those of other sensors if its ranges are "
                    f"{unit:g} times as long: are they in {called}?"
                ]
    return text


def _places(other: Seen, time: FloatArray, sensor: Radar) -> FloatArray:
    """Return where the plots of another sensor at each time are, from the radar, (M, W, 2)."""
    since, index = _around(other, time, interval(sensor) * np.array([-0.5, 0.5]))
    places = other.place[index] - np.asarray(sensor.position)[:2]
    places[np.isnan(since)] = np.nan
    return places


def _agreement(seen: Seen, at: IntArray, places: FloatArray) -> float:
    """Return the share of the plots looked at with another one nearby, less that by chance.

    `places` are those of the plots of other sensors at the times of these plots, from the radar.
    """
    if not len(at):
        return 0.0
    away = seen.away[at]
    turned = np.stack([away, away[:, ::-1] * [1.0, -1.0]], axis=-1) @ np.stack(
        [np.cos(_ASIDE), np.sin(_ASIDE)]
    )
    turned = np.swapaxes(turned, 1, 2)[:, :, np.newaxis]
    distance = _length(away)[:, np.newaxis]
    near = _PLACE * distance + _SIGMAS * seen.sigma[at, np.newaxis]
    # plots near any of the places are about as far from the radar
    (places,) = _nearest(np.abs(_length(places) - distance) <= _WIDER * near, places)
    hit = (_length(places[:, np.newaxis] - turned) <= near[:, np.newaxis]).any(axis=-1)
    found = np.mean(hit, axis=0)
    return float(found[0] - np.max(found[1:]))


class Pairs(NamedTuple):
    """Differences of plots of two sensors at one target."""

    # (M, 2)
    off: FloatArray
    # derivatives by the errors of all sensors, (M, 2, errors)
    design: FloatArray
    # (M,)
    variance: FloatArray


class Followed(NamedTuple):
    """Final rows of confirmed tracks with a plot: times, indices of the plots, and velocities."""

    time: FloatArray
    plot: IntArray
    velocity: FloatArray


def followed(table: TrackTable) -> Followed:
    """Return the rows of a table that are final and have a plot."""
    rows = table.final & table.confirmed & (table.plot >= 0)
    return Followed(table.time[rows], table.plot[rows], table.velocity[rows])


def range_doubts(
    table: TrackTable, plots: Plots, sensors: Sequence[Sensor], names: Sequence[str]
) -> list[str]:
    """Return whether the ranges of a radar have an error that radars do not usually have."""
    if sum(not isinstance(one, Station) for one in sensors) < 2:
        return []
    pairs = _pairs(followed(table), plots, sensors)
    return [] if pairs is None else _ranges_of(pairs, sensors, names)


def _ranges_of(pairs: Pairs, sensors: Sequence[Sensor], names: Sequence[str]) -> list[str]:
    """Return which error of ranges explains how plots of two sensors at one target differ.

    They differ by their random errors and by the usual systematic errors. Ranges of a wrong scale,
    or without the slant, must explain much better how they differ.
    """
    usual = np.tile(_USUAL, len(sensors))
    before, _ = _explained(*pairs, usual)
    if before < _UNEXPLAINED:
        return []
    best, text = (1.0 - _FALL) * before, []
    for at in np.flatnonzero([isinstance(sensors[k // _KINDS], Radar) for k in range(len(usual))]):
        k, kind = divmod(int(at), _KINDS)
        if kind not in _WRONG:
            continue
        sigma = usual.copy()
        sigma[at] = _WRONG[kind]
        after, error = _explained(*pairs, sigma)
        low, high = _LIKELY[kind]
        if (
            after < best
            and (before - after) * len(pairs.off) > _SUM
            and low < abs(error[at]) < high
        ):
            best, text = after, [_wrong_range(names[k], kind, float(error[at]))]
    return text


def _wrong_range(name: str, kind: int, error: float) -> str:
    if kind == _GAIN:
        return (
            f"{name}: its ranges are {100.0 * error:+.1f} % off, more than radars usually are. Are "
            "they in metres? If they are, state a bias with this range_gain"
        )
    return (
        f"{name}: its plots agree with those of other sensors without the heights, which are taken "
        "out of ranges: are its ranges those on the ground, or its heights not in metres?"
    )


def _pairs(rows: Followed, plots: Plots, sensors: Sequence[Sensor]) -> Pairs | None:
    """Return plots of two sensors at one target that follow each other; None if there are too few.

    Stations and their plots are not used.
    """
    period = max(map(interval, sensors))
    # the plots of some scans, as those of one target follow each other
    block = rows.time // (_AT_ONCE * period) if period > 0.0 else rows.time
    used = block % (len(rows.time) // _ROWS + 1) == 0
    known = np.isfinite(plots.height[rows.plot])
    if known[used].any():
        # where radars have heights, plots without one have no place
        are_radars = np.array([isinstance(one, Radar) for one in sensors])
        used &= known | ~are_radars[plots.sensor[rows.plot]]
    plot, velocity = rows.plot[used], rows.velocity[used]
    sensor = plots.sensor[plot]
    parts = []
    for k in np.unique(sensor):
        if isinstance(sensors[k], Station):
            continue
        own = sensor == k
        seen = seen_of(plots[plot[own]], sensors, int(k), velocity[own])
        if len(seen.time):
            parts.append((np.full(len(seen.time), k), *seen))
    if len(parts) < 2:
        return None
    joined = [np.concatenate(column) for column in zip(*parts, strict=True)]
    order = np.argsort(joined[1], kind="stable")
    number, *columns = (column[order] for column in joined)
    seen = Seen(*columns)
    at = np.linspace(0, len(seen.time) - 1, min(_COMPARED, len(seen.time))).astype(np.int64)
    half = 0.5 * period
    since, other = _around(seen, seen.time[at], np.array([-half, half]))
    moved = seen.place[other] - since[..., np.newaxis] * seen.velocity[other]
    off = seen.place[at, np.newaxis] - moved
    apart = np.linalg.norm(off, axis=-1)
    apart[(number[other] == number[at, np.newaxis]) | np.isnan(apart)] = np.inf
    best = np.argmin(apart, axis=1)[:, np.newaxis]
    off, apart = np.take_along_axis(off, best[..., np.newaxis], 1)[:, 0], np.min(apart, axis=1)
    other = np.take_along_axis(other, best, 1)[:, 0]
    variance = seen.sigma[at] ** 2 + seen.sigma[other] ** 2 + (_ACCELERATION * half**2) ** 2
    reach = np.linalg.norm(seen.away[at], axis=-1) + np.linalg.norm(seen.away[other], axis=-1)
    near = apart <= _PLACE * reach + _SIGMAS * np.sqrt(variance)
    if np.count_nonzero(near) < _LOOKED:
        return None
    at, other, off, variance = at[near], other[near], off[near], variance[near]
    design = np.zeros((len(at), 2, len(sensors), _KINDS))
    for sign, index in ((1.0, at), (-1.0, other)):
        design[np.arange(len(at)), :, number[index]] += sign * _derivatives(seen, index)
    return Pairs(off, design.reshape(len(at), 2, -1), variance)


def _derivatives(seen: Seen, index: IntArray) -> FloatArray:
    """Return derivatives of places by errors of range, its scale, azimuth, time and slant."""
    away, velocity = seen.away[index], seen.velocity[index]
    distance = np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 1.0)
    along = np.where(np.any(away != 0.0, axis=-1, keepdims=True), away / distance, 0.0)
    across = away[:, ::-1] * [1.0, -1.0]
    slant = -along * seen.slant[index, np.newaxis]
    return np.stack([along, away, across, -velocity, slant], axis=-1)


def _explained(
    off: FloatArray, design: FloatArray, variance: FloatArray, sigma: FloatArray
) -> tuple[float, FloatArray]:
    """Return the mean square of what errors with these sigmas leave of differences, and the errors.

    The sigmas are those of the errors before any plots; far differences count as less far ones.
    """
    weight = np.ones(len(off))
    for _ in range(_STEPS):
        scaled = design * (weight / variance)[:, np.newaxis, np.newaxis]
        information = np.einsum("nia,nib->ab", scaled, design) + np.diag(sigma**-2.0)
        error = np.linalg.solve(information, np.einsum("nia,ni->a", scaled, off))
        square = np.sum((off - design @ error) ** 2, axis=-1) / variance
        weight = np.minimum(1.0, _LARGEST / square)
    return float(np.mean(np.minimum(square, _LARGEST))), error


class Ranges:
    """Rows of a live tracker and their plots, until it is known whether ranges are as expected."""

    def __init__(self, sensors: Sequence[Sensor]) -> None:
        self._sensors = sensors
        are_several = sum(not isinstance(one, Station) for one in sensors) > 1
        self._looks = _LOOKS * (are_several and any(isinstance(one, Radar) for one in sensors))
        self._span = _LATER * max(map(interval, sensors), default=1.0)
        self._due = np.nan
        # plots so far, number of those before them, and the rows of these plots
        self._plots: list[Plots] = []
        self._first = self._count = 0
        self._rows: list[Followed] = []

    def stop(self) -> None:
        """Look no more, as another mistake is known."""
        self._looks, self._plots, self._rows = 0, [], []

    def doubts(self, table: TrackTable, plots: Plots, names: Sequence[str]) -> list[str]:
        """Return what there is to say, once, after an update with these plots and rows."""
        self._count += len(plots)
        if not self._looks or not len(plots):
            return []
        self._plots.append(plots)
        self._rows.append(followed(table))
        now = float(np.max(plots.time, where=np.isfinite(plots.time), initial=-np.inf))
        if np.isnan(self._due):
            self._due = now + self._span
        if self._due - self._span <= now < self._due:
            return []
        time, plot, velocity = (np.concatenate(column) for column in zip(*self._rows, strict=True))
        known = plot >= self._first
        rows = Followed(time[known], plot[known] - self._first, velocity[known])
        several, self._plots, self._rows = joined(self._plots), [], []
        self._first, self._due = self._count, now + self._span
        pairs = _pairs(rows, several, self._sensors)
        self._looks -= pairs is not None
        said = [] if pairs is None else _ranges_of(pairs, self._sensors, names)
        self._looks *= not said
        return said
