"""Records to try the estimators on, with the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tertia._arrays import BoolArray, FloatArray, integer, real

__all__ = ["BearingRecord", "direction_finder"]

# keeps every product of two parameters finite
_LARGEST = 1e100


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
    generator = _generator(rng)
    shape = (*_shape(batch), n)
    records = int(np.prod(shape[:-1]))

    def offsets(count: int) -> FloatArray:
        sign = np.where(generator.random(count) < positive_probability, 1.0, -1.0)
        return sign * sigma * generator.uniform(low, high, count)

    theta = bearing + sigma * generator.standard_normal((records, n))
    single = generator.random((records, n)) < single_probability
    offset = np.zeros((records, n))
    offset[single] = offsets(int(single.sum()))

    counts = generator.poisson(bursts_per_100 * n / 100, records)
    record = np.repeat(np.arange(records), counts)
    length = np.minimum(generator.integers(shortest, longest + 1, record.size), n)
    start = generator.integers(0, n - length + 1)
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


def _generator(rng: Any) -> np.random.Generator:
    try:
        return np.random.default_rng(rng)
    except (TypeError, ValueError) as error:
        kind = type(error)
        raise kind(
            f"rng is {rng!r}; it must be a Generator or a whole number, not negative"
        ) from None


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
