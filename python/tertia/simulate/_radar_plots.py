"""Simulated plots of aircraft from rotating radars."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    finite,
    generator,
    instance,
    real,
    sequence_of,
)
from tertia._units import FLIGHT_LEVEL
from tertia.sensors import Bias, Radar
from tertia.sensors._channels import DETECTIONS, NO_DETECTION, sigmas_of, ways
from tertia.simulate._parameters import _number, _require
from tertia.simulate._traffic import Traffic
from tertia.tracker import NO_IDENTITY, Plots

# no aircraft: clutter
CLUTTER = -1
# bits of a code that others' replies may change
_CODE_BITS = 12


@dataclass(frozen=True, slots=True, eq=False)
class RadarPlots:
    """Simulated plots, sorted by time, and the truth about each of them.

    Attributes
    ----------
    plots : Plots
        The plots, as input for a tracker.
    target : ndarray of int, shape (N,)
        Index of the flight that caused the plot; -1 for clutter.
    outlier : ndarray of bool, shape (N,)
        True for outliers.
    duplicate : ndarray of bool, shape (N,)
        True for plots that duplicate another plot of the same scan.
    phase : ndarray of shape (K,)
        A time in seconds at which the beam of each radar points north.
    """

    plots: Plots
    target: IntArray
    outlier: BoolArray
    duplicate: BoolArray
    phase: FloatArray

    def __len__(self) -> int:
        """Return the number of plots."""
        return len(self.target)

    def __repr__(self) -> str:
        """Return the number of plots, and how many of them are clutter, as text."""
        return f"RadarPlots({len(self)}, {int(np.sum(self.target == CLUTTER))} of them clutter)"

    def __getitem__(self, index: slice | IntArray | BoolArray) -> RadarPlots:
        """Return the plots of a slice, a mask or indices."""
        names = ("plots", "target", "outlier", "duplicate")
        return replace(self, **{name: getattr(self, name)[index] for name in names})

    def alone(self, flight: int) -> RadarPlots:
        """Return the plots of one flight, and all clutter between its first and last plot."""
        own = self.target == flight
        span = np.flatnonzero(own)
        if not len(span):
            return self[span]
        chosen = own | (self.target == CLUTTER)
        chosen[: span[0]] = False
        chosen[span[-1] + 1 :] = False
        return self[chosen]


def radar_plots(
    traffic: Traffic,
    radars: Sequence[Radar],
    *,
    clutter: npt.ArrayLike = 0.0,
    phase: npt.ArrayLike | None = None,
    bias: Bias | None = None,
    bias_start: float = 0.0,
    outlier_probability: float = 0.0,
    outlier_size: float = 20.0,
    duplicate_probability: float = 0.0,
    height_missing_probability: float = 0.0,
    identity_missing_probability: float = 0.0,
    identity_garbled_probability: float = 0.0,
    rng: np.random.Generator | int | None = None,
) -> RadarPlots:
    """Simulate the plots of aircraft and the false plots of rotating radars.

    The beam of a radar rotates clockwise, once per scan period. When the beam passes an aircraft
    within range, the aircraft is detected with the radar's detection probability. Range and azimuth
    have normal noise. If the flight has a height, the range is the slant range, even if the plot
    has no height. The number of false plots (clutter) has a Poisson distribution. False plots are
    uniformly distributed over the area within range, and have no identity.

    If a radar has channels, each of them detects aircraft independently. A plot that is detected by
    echo alone has neither identity nor height. The amount of clutter is then that stated by the
    channels.

    Radars with a `frame` are on the curved earth. The positions of the aircraft are then in this
    system plane, their heights are above the ellipsoid, and each radar measures relative to its own
    vertical and to true north.

    Parameters
    ----------
    traffic : Traffic
        The aircraft.
    radars : sequence of K Radar
        The radars; a radar without a third coordinate has the height 0.
    clutter : array_like of shape () or (K,)
        Mean number of false plots per scan. If it is not 0, the radar must have a finite
        `max_range`. If a radar has channels, this is the clutter of its first channel in the order
        psr, ssr, mode-s, unless that channel states a clutter of its own.
    phase : array_like of shape () or (K,), optional
        A time in seconds at which the beam points north; by default it is random and uniform over a
        scan.
    bias : Bias, optional
        Systematic errors of range, range gain, azimuth and time, the same for all radars or of
        shape (K,); by default there are none.
    bias_start : float
        Time in seconds from which the radars have these systematic errors.
    outlier_probability : float
        Probability that a plot is an outlier.
    outlier_size : float
        Standard deviation of the errors of an outlier, divided by that of the noise.
    duplicate_probability : float
        Probability that there is a second plot of the same target, with independent noise.
    height_missing_probability, identity_missing_probability : float
        Probability that the height is missing in a reply, and probability that the identity is
        missing.
    identity_garbled_probability : float
        Probability that some of the lowest 12 bits of an identity are wrong.
    rng : numpy.random.Generator or int, optional
        Random generator or its seed.

    Returns
    -------
    RadarPlots
        The plots and their truth; heights are rounded to 100 ft.

    Raises
    ------
    ValueError, TypeError
        If a parameter is outside its domain or has the wrong type, if shapes do not match, or if
        there is clutter without a maximum range.

    Examples
    --------
    >>> from tertia.simulate import encounter, radar_plots, set_up
    >>> traffic = encounter("crossing", rng=1)
    >>> radar_plots(traffic, [set_up("middle").radar], clutter=5, rng=1)
    RadarPlots(684, 498 of them clutter)
    """
    instance(traffic, "traffic", Traffic)
    stations = sequence_of(radars, Radar, "radars")
    count, random = len(stations), generator(rng)
    false = _per_radar(clutter, "clutter", count)
    _require(bool(np.all(false >= 0)), "clutter", false.tolist(), "zero or more")
    shift = _biases(bias, count)
    start = real(bias_start, "bias_start")
    periods = np.array([radar.scan_period for radar in stations])
    if phase is None:
        north = random.uniform(size=count) * periods
    else:
        north = _per_radar(phase, "phase", count)
    defects = _Defects(
        _number(outlier_probability, "outlier_probability", 0.0, 1.0),
        _number(outlier_size, "outlier_size", 0.0),
        _number(duplicate_probability, "duplicate_probability", 0.0, 1.0),
        _number(height_missing_probability, "height_missing_probability", 0.0, 1.0),
        _number(identity_missing_probability, "identity_missing_probability", 0.0, 1.0),
        _number(identity_garbled_probability, "identity_garbled_probability", 0.0, 1.0),
    )
    parts, numbers = [_nothing()], [np.zeros(0, dtype=np.int64)]
    for k, radar in enumerate(stations):
        flight, time = _meetings(traffic, radar, float(north[k]))
        own = [
            _seen(
                traffic,
                radar,
                flight,
                time,
                bias=shift[k],
                since=start,
                defects=defects,
                random=random,
            ),
            *_clutter(traffic, radar, mean=float(false[k]), north=float(north[k]), random=random),
        ]
        parts += own
        numbers.append(np.full(sum(len(part["time"]) for part in own), k))
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    columns["sensor"] = np.concatenate(numbers)
    order = np.argsort(columns["time"], kind="stable")
    columns = {name: column[order] for name, column in columns.items()}
    truth = {name: columns.pop(name) for name in ("target", "outlier", "duplicate")}
    return RadarPlots(Plots(**columns), **truth, phase=north)  # type: ignore[arg-type]


@dataclass(frozen=True, slots=True)
class _Defects:
    """Probabilities of defective plots, and the size of outliers."""

    outlier: float
    size: float
    duplicate: float
    no_height: float
    no_identity: float
    garbled: float


def _per_radar(value: npt.ArrayLike, name: str, count: int) -> FloatArray:
    array = finite(value, name)
    if array.shape not in {(), (1,), (count,)}:
        raise ValueError(f"{name} has shape {array.shape}; it must fit {(count,)}")
    fitted: FloatArray = np.broadcast_to(array, count).copy()
    return fitted


def _meetings(traffic: Traffic, radar: Radar, north: float) -> tuple[IntArray, FloatArray]:
    """Return the times at which the beam passes each flight, scan by scan."""
    if not len(traffic):
        return np.zeros(0, dtype=np.int64), np.zeros(0)
    place = radar.position[:2].tolist()
    if radar.frame is not None:
        # the beam points north where true north is in the plane
        _, convergence = radar.frame.scale_and_convergence(np.append(radar.position, 0.0)[:3])
        north -= float(convergence) * radar.scan_period / (2 * np.pi)
    return _core.beam_meetings(traffic._columns(), place, radar.scan_period, north)


def _polar(radar: Radar, position: FloatArray, height: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return azimuths and ranges; ranges are slant ranges if there is a height."""
    if radar.frame is not None and radar.site is not None:
        # flights without a height are on the ellipsoid
        places = radar.frame.to_geodetic(np.column_stack([position, np.nan_to_num(height)]))
        slant, turned, _ = radar.site.geodetic_to_polar(*places)
        return np.asarray(slant), np.asarray(turned)
    offset = position - radar.position[:2]
    place = radar.position[2] if len(radar.position) == 3 else 0.0
    ground = np.hypot(*offset.T)
    distance = np.where(np.isnan(height), ground, np.hypot(ground, height - place))
    return distance, np.arctan2(*offset.T)


def _beam(radar: Radar, north: float, time: FloatArray) -> FloatArray:
    return 2 * np.pi / radar.scan_period * (time - north)


def _biases(bias: Bias | None, count: int) -> list[Bias]:
    """Return the systematic errors of each radar."""
    if bias is None:
        return [Bias()] * count
    instance(bias, "bias", Bias)
    if np.ndim(bias.range) == 0:
        return [bias] * count
    if len(bias) != count:
        raise ValueError(f"bias is that of {len(bias)} sensors; there are {count}")
    return [bias[k] for k in range(count)]


def _seen(
    traffic: Traffic,
    radar: Radar,
    flight: IntArray,
    time: FloatArray,
    *,
    bias: Bias,
    since: float,
    defects: _Defects,
    random: np.random.Generator,
) -> dict[str, npt.NDArray[np.generic]]:
    """Return the plots of aircraft that are within range and detected."""
    position, _, height = traffic._state(flight, time)
    distance, direction = _polar(radar, position, height)
    draw = random.uniform(size=len(flight))
    seen = draw < radar.detection_probability
    seen &= distance <= radar.max_range
    twice = seen & (random.uniform(size=len(flight)) < defects.duplicate)
    rows = np.concatenate([np.flatnonzero(seen), np.flatnonzero(twice)])
    n = len(rows)
    outlier = random.uniform(size=n) < defects.outlier
    error = random.standard_normal((2, n)) * np.where(outlier, defects.size, 1.0)
    late = time[rows] >= since
    detection, sigma = _detected(radar, draw[rows])
    # the sigma is not used; it may be unknown
    off = replace(bias, azimuth_sigma=0.0).at(direction[rows])[0]
    azimuth = direction[rows] + late * off + sigma[1] * error[1]
    slant = distance[rows] * (1.0 + late * bias.range_gain) + late * bias.range
    # transponders report hundreds of feet
    reported = np.round(height[rows] / FLIGHT_LEVEL) * FLIGHT_LEVEL
    reported[random.uniform(size=n) < defects.no_height] = np.nan
    identity = _identity(traffic.identity[flight[rows]], defects, random)
    silent = detection == DETECTIONS.index("psr")
    reported[silent], identity[silent] = np.nan, NO_IDENTITY
    return {
        "time": time[rows] + late * bias.time,
        "range": np.abs(slant + sigma[0] * error[0]),
        "azimuth": azimuth % (2 * np.pi),
        "height": reported,
        "identity": identity,
        "detection": detection,
        "target": flight[rows],
        "outlier": outlier,
        "duplicate": np.arange(n) >= np.count_nonzero(seen),
    }


def _detected(radar: Radar, draw: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return which channels detect each aircraft, chosen at random, and the sigmas of the plots."""
    detection = np.full(len(draw), NO_DETECTION)
    own = radar.range_sigma, radar.azimuth_sigma
    sigma = np.tile(np.array(own)[:, np.newaxis], len(draw))
    end = 0.0
    for name, chance in ways(radar.channels or {}).items():
        if name and radar.channels is not None:
            rows = (draw >= end) & (draw < end + chance)
            end += chance
            detection[rows] = DETECTIONS.index(name)
            sigma[:, rows] = np.array(sigmas_of(radar.channels, name, own))[:, np.newaxis]
    return detection, sigma


def _identity(identity: IntArray, defects: _Defects, random: np.random.Generator) -> IntArray:
    """Return the replies of transponders, some of them missing or garbled."""
    n = len(identity)
    garbled = random.uniform(size=n) < defects.garbled
    bits = random.integers(1, 2**_CODE_BITS, n)
    missing = (identity == NO_IDENTITY) | (random.uniform(size=n) < defects.no_identity)
    reply = np.where(garbled, identity ^ bits, identity)
    return np.where(missing, NO_IDENTITY, reply)


def _clutter(
    traffic: Traffic,
    radar: Radar,
    *,
    mean: float,
    north: float,
    random: np.random.Generator,
) -> list[dict[str, npt.NDArray[np.generic]]]:
    """Return the false plots of each channel for the duration of the traffic."""
    means = {"": mean}
    if radar.channels is not None:
        stated = {name: one.clutter_per_scan for name, one in radar.channels.items()}
        first = next(iter(stated))
        means = {
            name: (mean if name == first else 0.0) if count is None else count
            for name, count in stated.items()
        }
    return [
        _false(traffic, radar, name, mean=count, north=north, random=random)
        for name, count in means.items()
    ]


def _false(
    traffic: Traffic,
    radar: Radar,
    detection: str,
    *,
    mean: float,
    north: float,
    random: np.random.Generator,
) -> dict[str, npt.NDArray[np.generic]]:
    """Return the false plots of a channel, each at a time when the beam points to its azimuth."""
    if mean == 0.0 or not len(traffic):
        return _nothing()
    limit = radar.max_range
    _require(bool(np.isfinite(limit)), "max_range", limit, "finite where there is clutter")
    first, last = float(np.min(traffic.start)), float(np.max(traffic.end))
    n = int(random.poisson(mean * (last - first) / radar.scan_period))
    time = random.uniform(first, last, n)
    columns = _nothing(n)
    columns["time"], columns["azimuth"] = time, _beam(radar, north, time) % (2 * np.pi)
    columns["range"] = limit * np.sqrt(random.uniform(size=n))
    if detection:
        columns["detection"] = np.full(n, DETECTIONS.index(detection))
    return columns


def _nothing(n: int = 0) -> dict[str, npt.NDArray[np.generic]]:
    """Return the columns of plots without measurements."""
    return {
        **dict.fromkeys(("time", "range", "azimuth", "height"), np.full(n, np.nan)),
        "identity": np.full(n, NO_IDENTITY),
        "detection": np.full(n, NO_DETECTION),
        "target": np.full(n, CLUTTER),
        "outlier": np.zeros(n, dtype=np.bool_),
        "duplicate": np.zeros(n, dtype=np.bool_),
    }
