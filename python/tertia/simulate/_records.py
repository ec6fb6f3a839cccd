"""Records to try the estimators on, with the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from tertia._arrays import BoolArray, FloatArray, finite, generator, integer, real
from tertia._wishart import standard_wishart
from tertia.kalman import SingerModel, _require_model
from tertia.sensors import Kind, Station, stack_stations, to_station_axes

__all__ = [
    "BearingRecord",
    "PassiveLocation",
    "RadarRecord",
    "RadarScenario",
    "ScenarioName",
    "StationRecord",
    "direction_finder",
    "passive_location",
    "radar_scenario",
    "radars",
    "stations",
    "wishart",
]

ScenarioName: TypeAlias = Literal[
    "healthy", "noisy", "outliers", "turn", "known", "unknown", "outage", "asynchronous"
]
# keeps every product of two parameters finite
_LARGEST = 1e100
# metres: farther, the lines of sight are parallel in double precision
_FARTHEST = 1e12

_SCENARIO_SIGMA = 0.1
# scans until filters have settled
_SETTLED = 20
# disturbed scans, from the middle on
_DISTURBED_SCANS = {"noisy": np.inf, "outliers": 20, "outage": 8}
# the target that turns: metres per second, metres, radians per second, seconds
_SPEED, _DISTANCE, _TURN_RATE, _TURN_TIME = 200.0, 60e3, np.radians(1.5), 60.0


@dataclass(frozen=True, slots=True, eq=False)
class BearingRecord:
    """Simulated bearings and what is wrong with them.

    Attributes
    ----------
    theta : ndarray of shape (..., N)
        The bearings, in [0, period) if there is a period.
    bearing : float
        The true bearing.
    single, burst : ndarray of bool, shape (..., N)
        Which measurements are single anomalies, and which belong to a burst.
    """

    theta: FloatArray
    bearing: float
    single: BoolArray
    burst: BoolArray


def direction_finder(
    n: int,
    *,
    bearing: float = 0.0,
    sigma: float = 3.4,
    single_probability: float = 0.02,
    bursts_per_100: float = 0.75,
    burst_length: tuple[int, int] = (4, 10),
    amplitude: tuple[float, float] = (3.0, 5.0),
    positive_probability: float = 0.6,
    period: float | None = 360.0,
    batch: int | tuple[int, ...] = (),
    rng: np.random.Generator | int | None = None,
) -> BearingRecord:
    """Simulate a direction finder with noise, single anomalies and bursts of one polarity.

    Normal noise; single anomalies (failures of the equipment) with a probability per measurement;
    bursts (disturbances longer than the sampling interval), Poisson in number, uniform in length
    and in place as far as they fit into the record, with a constant offset. Where both meet, the
    burst counts. The defaults are the scenario 'PS1' of the documentation.

    Parameters
    ----------
    n : int
        Measurements per record.
    bearing : float
        True bearing.
    sigma : float
        Standard deviation of the noise.
    single_probability : float
        Probability that a measurement is a single anomaly.
    bursts_per_100 : float
        Expected number of bursts per 100 measurements, at most 10 000.
    burst_length : (int, int)
        Shortest and longest burst, in measurements; none is longer than the record.
    amplitude : (float, float)
        Smallest and largest offset of an anomaly, in units of `sigma`; uniform between them.
    positive_probability : float
        Probability that an anomaly, or a whole burst, is positive: 1/2 has no polarity.
    period : float or None
        The bearings are wrapped to [0, period); None: not wrapped.
    batch : int or tuple of int
        Shape of the batch of records.
    rng : numpy.random.Generator or int, optional
        Source of randomness, or its seed.

    Returns
    -------
    BearingRecord
        `theta` has the shape `(*batch, n)` and the unit of `sigma`.

    Raises
    ------
    ValueError
        A parameter outside its domain.
    TypeError
        A parameter of the wrong type.

    Examples
    --------
    >>> from tertia.simulate import direction_finder
    >>> record = direction_finder(200, bearing=45.0, rng=1)
    >>> record.theta.shape, int(record.single.sum()), int(record.burst.sum())
    ((200,), 2, 7)
    """
    n = integer(n, "n", 1)
    shortest, longest = (integer(v, "burst_length", 1) for v in _pair(burst_length, "burst_length"))
    low, high = (_number(v, "amplitude") for v in _pair(amplitude, "amplitude"))
    _require(shortest <= longest, "burst_length", burst_length, "a pair (shortest, longest)")
    _require(low <= high, "amplitude", amplitude, "a pair (smallest, largest)")
    bearing = _number(bearing, "bearing")
    sigma = _number(sigma, "sigma", 0)
    single_probability = _number(single_probability, "single_probability", 0, 1)
    positive_probability = _number(positive_probability, "positive_probability", 0, 1)
    bursts_per_100 = _number(bursts_per_100, "bursts_per_100", 0, 10_000)
    if period is not None:
        period = _number(period, "period", 0)
        _require(period > 0, "period", period, "a positive number or None")
    random = generator(rng)
    shape = (*_shape(batch), n)
    records = int(np.prod(shape[:-1]))

    def offsets(count: int) -> FloatArray:
        sign = np.where(random.random(count) < positive_probability, 1.0, -1.0)
        return sign * sigma * random.uniform(low, high, count)

    theta = bearing + sigma * random.standard_normal((records, n))
    single = random.random((records, n)) < single_probability
    offset = np.zeros((records, n))
    offset[single] = offsets(int(single.sum()))

    counts = random.poisson(bursts_per_100 * n / 100, records)
    record = np.repeat(np.arange(records), counts)
    length = np.minimum(random.integers(shortest, longest + 1, record.size), n)
    start = random.integers(0, n - length + 1)
    # one entry per measurement of a burst: its record and its place there
    place = np.arange(length.sum()) - np.repeat(np.cumsum(length) - length - start, length)
    members = (np.repeat(record, length), place)
    burst = np.zeros((records, n), dtype=bool)
    burst[members] = True
    offset[members] = np.repeat(offsets(record.size), length)

    theta += offset
    if period is not None:
        theta %= period
        theta[theta >= period] = 0.0
    return BearingRecord(
        theta.reshape(shape), float(bearing), (single & ~burst).reshape(shape), burst.reshape(shape)
    )


@dataclass(frozen=True, slots=True, eq=False)
class PassiveLocation:
    """Two stations that measure two azimuths and a range difference, and what they can tell.

    Attributes
    ----------
    position : ndarray of shape (..., 2)
        The target, east and north in metres.
    jacobian : ndarray of shape (..., 3, 2)
        Derivatives of the azimuth from the first station, that from the second (radians) and the
        range to the first station less that to the second (metres), by the position.
    sigma : ndarray of shape (3,)
        Standard deviations of the three measurements.
    covariances : ndarray of shape (..., 2, 2, 2)
        Covariance of the position from the two azimuths, and of that from the first azimuth and the
        range difference. The two share the first azimuth: they are not independent.
    """

    position: FloatArray
    jacobian: FloatArray
    sigma: FloatArray
    covariances: FloatArray

    def estimates(self, rng: np.random.Generator | int | None = None) -> FloatArray:
        """Draw both estimates of every position, to first order: shape (..., 2, 2).

        The last axes are the estimate and its components, east and north.
        """
        shape = self.jacobian.shape[:-1]
        error = self.sigma * generator(rng).standard_normal(shape)
        pairs = [
            np.linalg.solve(self.jacobian[..., rows, :], error[..., rows, np.newaxis])[..., 0]
            for rows in ([0, 1], [0, 2])
        ]
        return self.position[..., np.newaxis, :] + np.stack(pairs, axis=-2)


def passive_location(
    position: npt.ArrayLike,
    *,
    stations: npt.ArrayLike = ((-15e3, 0.0), (15e3, 0.0)),
    azimuth_sigma: float = np.radians(0.3).item(),
    range_difference_sigma: float = 100.0,
) -> PassiveLocation:
    """Return what two passive stations can tell about a target.

    This is the example of the source of `tertia.weights`.

    Parameters
    ----------
    position : array_like of shape (..., 2)
        The target, east and north in metres.
    stations : array_like of shape (2, 2)
        Positions of the stations, likewise.
    azimuth_sigma : float
        Standard deviation of an azimuth, in radians.
    range_difference_sigma : float
        Standard deviation of the range difference, in metres.

    Returns
    -------
    PassiveLocation
        Derivatives of the measurements and covariances of the two positions that they determine.

    Raises
    ------
    ValueError
        A wrong shape, a number outside its domain, or a target on the line through the stations,
        where the azimuths do not cross.
    TypeError
        An argument of the wrong type.

    Examples
    --------
    >>> from tertia.simulate import passive_location
    >>> target = passive_location([0.0, 40e3])
    >>> (target.covariances[:, [0, 1], [0, 1]] ** 0.5).round()
    array([[169., 450.],
           [142., 742.]])
    """
    target, places = finite(position, "position"), finite(stations, "stations")
    _require(target.shape[-1:] == (2,), "position", target.shape, "of shape (..., 2)")
    _require(places.shape == (2, 2), "stations", places.shape, "of shape (2, 2)")
    farthest = max(float(np.max(np.abs(x), initial=0)) for x in (target, places))
    _require(
        farthest <= _FARTHEST, "position", farthest, f"within {_FARTHEST:g} m, as the stations"
    )
    sigma = np.array(
        [_number(azimuth_sigma, "azimuth_sigma", 1e-12, 10)] * 2
        + [_number(range_difference_sigma, "range_difference_sigma", 1e-9, 1e12)]
    )
    offset = target[..., np.newaxis, :] - places
    distance = np.sqrt(np.sum(offset**2, axis=-1, keepdims=True))
    baseline = places[1] - places[0]
    height = offset[..., 0, 0] * baseline[1] - offset[..., 0, 1] * baseline[0]
    on_line = np.argwhere(np.abs(height) <= 1e-9 * np.sum(baseline**2))
    if len(on_line):
        where = target[tuple(on_line[0])]
        raise ValueError(f"position {where} lies on the line through the stations; it must not")
    toward = offset / distance
    # azimuths turn clockwise from north
    azimuths = np.stack([toward[..., 1], -toward[..., 0]], axis=-1) / distance
    difference = toward[..., :1, :] - toward[..., 1:, :]
    jacobian = np.concatenate([azimuths, difference], axis=-2)
    scaled = jacobian / sigma[:, np.newaxis]
    roots = np.linalg.inv(np.stack([scaled[..., [0, 1], :], scaled[..., [0, 2], :]], axis=-3))
    covariances = roots @ np.swapaxes(roots, -1, -2)
    return PassiveLocation(target, jacobian, sigma, covariances)


@dataclass(frozen=True, slots=True, eq=False)
class StationRecord:
    """Simulated measurements of a target by several stations, and what is wrong with them.

    Attributes
    ----------
    measurements : dict of str to ndarray of shape (..., K)
        What `tertia.location.locate` takes: `locate(stations, **record.measurements)`.
    outlier : dict of str to ndarray of bool, shape (..., K)
        Which measurements are outliers.
    position : ndarray of shape (..., D)
        The target.
    """

    measurements: dict[str, FloatArray]
    outlier: dict[str, BoolArray]
    position: FloatArray


def stations(
    stations: Sequence[Station],
    position: npt.ArrayLike,
    *,
    kinds: Sequence[Kind] | None = None,
    outlier_probability: float = 0.0,
    outlier_size: float = 20.0,
    missing_probability: float = 0.0,
    batch: int | tuple[int, ...] = (),
    rng: np.random.Generator | int | None = None,
) -> StationRecord:
    """Simulate what several stations measure of a target, with normal noise and outliers.

    Parameters
    ----------
    stations : sequence of K Station
        The stations; each measures what it has a standard deviation of.
    position : array_like of shape (..., D)
        The target.
    kinds : sequence of {"range", "azimuth", "elevation"}, optional
        What is measured; by default all that there are standard deviations of.
    outlier_probability : float
        Probability that a measurement is an outlier.
    outlier_size : float
        Offset of an outlier, in standard deviations, up or down.
    missing_probability : float
        Probability that a measurement is missing.
    batch : int or tuple of int
        Shape of the batch of records of every position.
    rng : numpy.random.Generator or int, optional
        Source of randomness, or its seed.

    Returns
    -------
    StationRecord
        Measurements of the shape `(*batch, ..., K)`, nan where they are missing.

    Raises
    ------
    ValueError
        A parameter outside its domain.
    TypeError
        A parameter of the wrong type.

    Examples
    --------
    >>> from tertia.location import Station, locate
    >>> from tertia.simulate import stations
    >>> places = [[0, 0], [3000, 0], [0, 3000], [3000, 3000]]
    >>> finders = [Station(p, azimuth_sigma=0.01) for p in places]
    >>> record = stations(finders, [1000, 2000], rng=1)
    >>> locate(finders, **record.measurements)
    Location([1000.74 ± 14.7, 2003.78 ± 14.6], 0 of 4 faulty)
    """
    places, axes, sigmas = stack_stations(stations)
    target = finite(position, "position")
    d = places.shape[-1]
    _require(target.shape[-1:] == (d,), "position", target.shape, f"of shape (..., {d})")
    outlier_probability = _number(outlier_probability, "outlier_probability", 0, 1)
    missing_probability = _number(missing_probability, "missing_probability", 0, 1)
    size, source = _number(outlier_size, "outlier_size", 0), generator(rng)
    truth = _sights(to_station_axes(target[..., np.newaxis, :] - places, axes))
    if kinds is None:
        chosen = [kind for kind in truth if not np.all(np.isnan(sigmas.get(kind, np.nan)))]
    else:
        chosen = list(kinds)
    record: dict[str, FloatArray] = {}
    outlier: dict[str, BoolArray] = {}
    for kind in chosen:
        _require(kind in truth, "kinds", kind, f"one of {', '.join(truth)}")
        shape = (*_shape(batch), *truth[kind].shape)
        wrong = source.uniform(size=shape) < outlier_probability
        sign = np.where(source.uniform(size=shape) < 0.5, -1.0, 1.0)
        error = source.standard_normal(shape) + np.where(wrong, size * sign, 0.0)
        gone = source.uniform(size=shape) < missing_probability
        record[kind] = np.where(gone, np.nan, truth[kind] + sigmas[kind] * error)
        outlier[kind] = wrong & ~np.isnan(record[kind])
    return StationRecord(record, outlier, np.broadcast_to(target, (*_shape(batch), *target.shape)))


def _sights(offset: FloatArray) -> dict[str, FloatArray]:
    """Return range, azimuth and (in space) elevation of offsets in the stations' axes."""
    truth = {
        "range": np.sqrt(np.sum(offset**2, axis=-1)),
        "azimuth": np.arctan2(offset[..., 0], offset[..., 1]),
    }
    if offset.shape[-1] == 3:
        truth["elevation"] = np.arctan2(offset[..., 2], np.hypot(offset[..., 0], offset[..., 1]))
    return truth


@dataclass(frozen=True, slots=True, eq=False)
class RadarRecord:
    """Simulated plots of several radars, and the truth.

    Attributes
    ----------
    z : ndarray of shape (..., K, steps)
        Plots of the angle, in [0, period) if there is a period; nan where a radar has none.
    truth : ndarray of shape (..., steps, 3)
        Angle (not wrapped), rate and acceleration.
    outlier : ndarray of bool, shape (..., K, steps)
        Which plots are outliers.
    """

    z: FloatArray
    truth: FloatArray
    outlier: BoolArray


def radars(
    model: SingerModel,
    steps: int,
    *,
    sigma: npt.ArrayLike = (0.1, 0.1),
    detection_probability: npt.ArrayLike = 1.0,
    outlier_probability: npt.ArrayLike = 0.0,
    outlier_size: float = 15.0,
    turn: tuple[int, int, float] | None = None,
    angle: float = 0.0,
    rate: float = 0.0,
    period: float | None = None,
    batch: int | tuple[int, ...] = (),
    rng: np.random.Generator | int | None = None,
) -> RadarRecord:
    """Simulate radars that see the same target.

    Parameters
    ----------
    model : SingerModel
        How the target moves, from plot to plot every `model.dt`.
    steps : int
        Plots of each radar.
    sigma : array_like of shape (K,) or (K, steps)
        Standard deviation of the noise of each radar, at each step.
    detection_probability : array_like of shape (), (K, 1) or (K, steps)
        Probability of a plot; 0 in an outage, or between the scans of a slower radar. False is 0,
        True is 1.
    outlier_probability : array_like of shape (), (K, 1) or (K, steps)
        Probability that a plot is an outlier, likewise.
    outlier_size : float
        Standard deviation of an outlier, in units of that of the noise.
    turn : (int, int, float), optional
        First and last step of a turn and the rate (angle per unit of time) that it adds, with a
        smooth beginning and end: a raised cosine.
    angle, rate : float
        Where the target begins, and how fast it moves.
    period : float, optional
        The plots are wrapped to [0, period); None: not wrapped.
    batch : int or tuple of int
        Shape of the batch of records.
    rng : numpy.random.Generator or int, optional
        Source of randomness, or its seed.

    Returns
    -------
    RadarRecord
        Plots and truth.

    Raises
    ------
    ValueError
        A parameter outside its domain, or shapes that do not fit.
    TypeError
        A parameter of the wrong type.

    Examples
    --------
    >>> from tertia.kalman import SingerModel
    >>> from tertia.simulate import radars
    >>> radars(SingerModel(5.0, 0.05, 0.003), 120, rng=1).z.shape
    (2, 120)
    """
    _require_model(model)
    steps = integer(steps, "steps", 1)
    if period is not None:
        period = _number(period, "period", 0)
        _require(period > 0, "period", period, "a positive number or None")
    spread = finite(sigma, "sigma")
    _require(spread.ndim in {1, 2} and spread.size > 0, "sigma", spread.shape, "(K,) or (K, steps)")
    count = spread.shape[0]
    spread = _per_step(spread.reshape(count, -1), "sigma", count, steps, high=_LARGEST)
    seen = _per_step(detection_probability, "detection_probability", count, steps)
    wrong = _per_step(outlier_probability, "outlier_probability", count, steps)
    size = _number(outlier_size, "outlier_size", 0)
    random, shape = generator(rng), _shape(batch)
    truth = np.zeros((*shape, steps, 3))
    truth[..., 0, :2] = _number(angle, "angle"), _number(rate, "rate")
    transition = model.transition()
    noise = model.process_noise()
    # Q may be singular: its square root by eigenvalues
    values, vectors = np.linalg.eigh(noise)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    truth[..., 0, 2] = model.acceleration_sigma * random.standard_normal(shape)
    for step in range(1, steps):
        push = random.standard_normal((*shape, 3)) @ root.T
        truth[..., step, :] = truth[..., step - 1, :] @ transition.T + push
    if turn is not None:
        truth += _turn(turn, steps, model.dt)
    places = (*shape, count, steps)
    outlier = random.random(places) < wrong
    error = spread * random.standard_normal(places)
    error = np.where(outlier, size * spread * random.standard_normal(places), error)
    z = truth[..., np.newaxis, :, 0] + error
    if period is not None:
        z %= period
        z[z >= period] = 0.0
    z[random.random(places) >= seen] = np.nan
    return RadarRecord(z, truth, outlier & ~np.isnan(z))


@dataclass(frozen=True, slots=True, eq=False)
class RadarScenario(RadarRecord):
    """Plots of two radars in a scenario, the truth, and what a filter is told.

    Attributes
    ----------
    z : ndarray of shape (..., 2, steps)
        Plots of the angle in degrees, not wrapped; nan where a radar has none.
    truth : ndarray of shape (..., steps, 3)
        Angle, rate and acceleration.
    outlier : ndarray of bool, shape (..., 2, steps)
        Which plots are outliers.
    measurement_variance : ndarray of shape (2, 1)
        Variances of the plots as the radars state them.
    model : SingerModel
        Model of the motion for the filter.
    counted : ndarray of bool, shape (steps,)
        Steps in which errors count: the filters have settled, and radar 1 scans.
    disturbed : ndarray of bool, shape (steps,)
        Steps of the disturbance or of the turn; in "unknown" all.
    """

    measurement_variance: FloatArray
    model: SingerModel
    counted: BoolArray
    disturbed: BoolArray


def radar_scenario(
    name: ScenarioName,
    *,
    model: SingerModel | None = None,
    steps: int = 120,
    batch: int | tuple[int, ...] = (),
    rng: np.random.Generator | int | None = None,
) -> RadarScenario:
    """Simulate two radars in one of the scenarios by which the documentation compares methods.

    Degrees and seconds. The noise has sigma 0.1, and both radars state that; exceptions are told.

    Parameters
    ----------
    name : str
        "healthy": nothing is wrong.
        "noisy": radar 2 has five times its noise from the middle on.
        "outliers": 30 % of the plots of radar 2 have 15 sigma in 20 scans from the middle on.
        "turn": no random acceleration; towards the radars at 200 m/s, and from the middle on, 60 km
        away, a turn by 90 degrees at 1.5 degrees per second.
        "known": sigma is 0.05 and 0.2, and the radars state that.
        "unknown": sigma is 0.05 and 0.2, and the radars state 0.1.
        "outage": plots with probability 0.7; radar 2 has none in 8 scans from the middle on.
        "asynchronous": radar 2 scans half a period after radar 1: twice as many steps, half as
        long.
    model : SingerModel, optional
        How the target moves, but for the turn; each radar scans every `model.dt`. By default
        `SingerModel(5.0, 1 / 20, 0.003)`.
    steps : int
        Scans of each radar, at least 40.
    batch : int or tuple of int
        Shape of the batch of records.
    rng : numpy.random.Generator or int, optional
        Source of randomness, or its seed.

    Returns
    -------
    RadarScenario
        Plots, truth, and what to tell the filter. Errors count from scan 20 on.

    Raises
    ------
    ValueError
        An unknown name, or a parameter outside its domain.
    TypeError
        A parameter of the wrong type.

    Examples
    --------
    >>> from tertia.fusion import fuse_series
    >>> from tertia.metrics import rmse
    >>> from tertia.simulate import radar_scenario
    >>> s = radar_scenario("noisy", batch=200, rng=1)
    >>> for method in ("equal", "adaptive"):
    ...     track = fuse_series(s.z, s.measurement_variance, s.model, method=method)
    ...     error = track.mean - s.truth
    ...     print(f"{method}: {rmse(error[:, s.counted, 0]):.3f}")
    equal: 0.173
    adaptive: 0.081
    """
    names = get_args(ScenarioName)
    if not isinstance(name, str) or name not in names:
        told = ", ".join(map(repr, names[:-1]))
        raise ValueError(f"name is {name!r}; it must be {told} or {names[-1]!r}")
    model = SingerModel(5.0, 1 / 20, 0.003) if model is None else model
    _require_model(model)
    steps = integer(steps, "steps", 2 * _SETTLED)
    since = np.arange(float(steps)) - steps // 2
    counted, disturbed = np.arange(steps) >= _SETTLED, _disturbed(name, since, model.dt)
    second = disturbed & [[False], [True]]
    stated = np.full((2, 1), _SCENARIO_SIGMA)
    motion, options = model, dict[str, Any](sigma=stated)
    if name == "noisy":
        options["sigma"] = _SCENARIO_SIGMA * np.where(second, 5.0, 1.0)
    elif name == "outliers":
        options["outlier_probability"] = 0.3 * second
    elif name == "turn":
        motion = replace(model, acceleration_sigma=0.0)
    elif name == "known":
        stated = options["sigma"] = np.array([[0.05], [0.2]])
    elif name == "unknown":
        options["sigma"] = np.array([[0.05], [0.2]])
    elif name == "outage":
        options["detection_probability"] = 0.7 * ~second
    elif name == "asynchronous":
        model = motion = replace(model, dt=model.dt / 2)
        scans = np.arange(2 * steps) % 2 == [[0], [1]]
        options["detection_probability"] = scans
        counted, disturbed = np.repeat(counted, 2) & scans[0], np.repeat(disturbed, 2)
        steps *= 2
    record = radars(motion, steps, batch=batch, rng=rng, **options)
    if name == "turn":
        path = _right_angle(since * model.dt)
        record.truth[:] = path
        record.z[:] += path[:, 0]
    return RadarScenario(
        record.z, record.truth, record.outlier, stated**2, model, counted, disturbed
    )


def _disturbed(name: ScenarioName, since: FloatArray, dt: float) -> BoolArray:
    """Return the disturbed scans, of those `since` the middle."""
    if name == "unknown":
        return np.ones(since.shape, dtype=bool)
    scans = _DISTURBED_SCANS.get(name, 0.0)
    return (since >= 0) & (since * dt < _TURN_TIME if name == "turn" else since < scans)


def _right_angle(time: FloatArray) -> FloatArray:
    """Return angle, rate and acceleration of the target that turns, from the time 0 on."""
    turned = np.clip(time, 0.0, _TURN_TIME)
    # north and east as real and imaginary part; the course is south at first
    velocity = -_SPEED * np.exp(1j * _TURN_RATE * turned)
    place = _DISTANCE + (velocity + _SPEED) / (1j * _TURN_RATE) + velocity * (time - turned)
    turns = (time >= 0) & (time < _TURN_TIME)
    # the angle is the imaginary part of log(place)
    slope = velocity / place
    bend = np.where(turns, 1j * _TURN_RATE * velocity, 0.0) / place - slope**2
    path: FloatArray = np.degrees(np.stack([np.angle(place), slope.imag, bend.imag], axis=-1))
    return path


def _per_step(
    value: npt.ArrayLike, name: str, count: int, steps: int, high: float = 1.0
) -> FloatArray:
    array = finite(_numbers(value), name)
    inside = (array >= 0) & (array <= high)
    _require(bool(np.all(inside)), name, array.tolist(), f"between 0 and {high:g}")
    try:
        return np.broadcast_to(array, (count, steps))
    except ValueError:
        raise ValueError(
            f"{name} has shape {array.shape}; it must fit {count} radars and {steps} steps"
        ) from None


def _numbers(value: npt.ArrayLike) -> npt.ArrayLike:
    """Return booleans as 0 and 1, and all else as it is."""
    try:
        array = np.asanyarray(value)
    except ValueError:
        return value
    is_flag = array.dtype == np.bool_ or (
        array.dtype == np.object_ and all(isinstance(one, (bool, np.bool_)) for one in array.flat)
    )
    return array.astype(np.float64) if is_flag else value


def _turn(turn: tuple[int, int, float], steps: int, dt: float) -> FloatArray:
    """Return angle, rate and acceleration that a turn adds."""
    try:
        first, last, added = turn
    except (TypeError, ValueError):
        raise TypeError(f"turn is {turn!r}; it must be (first step, last step, rate)") from None
    first, last = integer(first, "turn", 0), integer(last, "turn", 0)
    _require(first < last, "turn", turn, "a pair of rising steps and a rate")
    top = _number(added, "turn")
    elapsed = np.clip(np.arange(steps) - first, 0, last - first) * dt
    length = (last - first) * dt
    phase = 2 * np.pi * elapsed / length
    angle = top * (elapsed - length / (2 * np.pi) * np.sin(phase)) / 2
    rate = top * (1 - np.cos(phase)) / 2
    acceleration = top * np.pi / length * np.sin(phase)
    return np.stack([angle, rate, acceleration], axis=-1)


def wishart(
    covariance: npt.ArrayLike,
    degrees_of_freedom: float,
    *,
    batch: int | tuple[int, ...] = (),
    rng: np.random.Generator | int | None = None,
) -> FloatArray:
    """Draw sample covariances: Wishart matrices over their degrees of freedom.

    Parameters
    ----------
    covariance : array_like of shape (m, m)
        Their mean.
    degrees_of_freedom : float
        n - 1 for the sample covariance of n measurements. Above m - 1, or whole; where it is less
        than m, the matrices are singular.
    batch : int or tuple of int
        Shape of the batch of matrices.
    rng : numpy.random.Generator or int, optional
        Source of randomness, or its seed.

    Returns
    -------
    ndarray of shape (*batch, m, m)
        Symmetric matrices.

    Raises
    ------
    numpy.linalg.LinAlgError
        The covariance is not positive definite.
    ValueError
        A wrong shape, or a number outside its domain.
    TypeError
        An argument of the wrong type.

    Examples
    --------
    >>> from tertia.simulate import wishart
    >>> wishart([[4.0, 1.0], [1.0, 2.0]], 29, batch=5, rng=1).shape
    (5, 2, 2)
    """
    mean = finite(covariance, "covariance")
    m = mean.shape[-1] if mean.ndim else 0
    _require(mean.shape == (m, m) and m > 0, "covariance", mean.shape, "of shape (m, m)")
    nu = _number(degrees_of_freedom, "degrees_of_freedom", 1)
    drawable = nu > m - 1 or nu == int(nu)
    _require(drawable, "degrees_of_freedom", nu, f"a whole number, or above {m - 1}")
    scale = np.sqrt(np.abs(np.diagonal(mean)))
    symmetric = np.all(np.abs(mean - mean.T) <= 1e-10 * scale * scale[:, np.newaxis])
    _require(bool(symmetric), "covariance", mean.tolist(), "symmetric")
    root = np.linalg.cholesky(mean)
    drawn = root @ standard_wishart(m, nu, _shape(batch), generator(rng)) @ root.T
    matrices: FloatArray = (drawn + np.swapaxes(drawn, -1, -2)) / 2
    return matrices


def _pair(value: Any, name: str) -> tuple[Any, Any]:
    try:
        first, second = value
    except (TypeError, ValueError):
        raise TypeError(f"{name} is {value!r}; it must be a pair of numbers") from None
    return first, second


def _shape(batch: int | tuple[int, ...]) -> tuple[int, ...]:
    sizes = batch if isinstance(batch, tuple) else (batch,)
    return tuple(integer(size, "batch", 0) for size in sizes)


def _number(value: Any, name: str, low: float = -_LARGEST, high: float = _LARGEST) -> float:
    """Return `value` as a float between the limits."""
    number = real(value, name)
    _require(low <= number <= high, name, value, f"between {low:g} and {high:g}")
    return number


def _require(holds: bool, name: str, value: object, requirement: str) -> None:
    if not holds:
        raise ValueError(f"{name} is {value!r}; it must be {requirement}")
