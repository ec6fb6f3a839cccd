"""Simulated records of a direction finder."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tertia._arrays import BoolArray, FloatArray, generator, integer
from tertia._result import Result
from tertia.simulate._parameters import _number, _pair, _period, _require, _shape, _wrap


@dataclass(frozen=True, slots=True, eq=False)
class BearingRecord(Result):
    """Simulated bearings, with their outliers marked.

    Attributes
    ----------
    theta : ndarray of shape (..., N)
        Measured bearings, wrapped to [0, period) if there is a period.
    bearing : float
        True bearing.
    single, burst : ndarray of bool, shape (..., N)
        True for single outliers, and for measurements that belong to a burst of outliers.
    """

    _rows: ClassVar = "theta", 0

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
    """Simulate the bearings of a direction finder with noise, single outliers and bursts.

    The noise is normal. Single outliers, such as those from equipment failures, are independent of
    each other. Bursts are runs of outliers, such as those from disturbances that last longer than
    the sampling interval. Their number has a Poisson distribution. Their lengths and positions are
    uniform, as far as they fit into the record. Each burst has one constant offset. A measurement
    in a burst is never a single outlier as well. The default parameters are those of scenario 'PS1'
    in the documentation.

    Parameters
    ----------
    n : int
        Number of measurements per record.
    bearing : float
        True bearing, in the unit of `period`.
    sigma : float
        Standard deviation of the noise, in the unit of `period`.
    single_probability : float
        Probability that a measurement is a single outlier.
    bursts_per_100 : float
        Expected number of bursts per 100 measurements, at most 10 000.
    burst_length : (int, int)
        Lengths of the shortest and of the longest burst, in measurements. No burst is longer than
        the record.
    amplitude : (float, float)
        Smallest and largest absolute value of the offset of an outlier, in units of `sigma`; its
        distribution is uniform between them.
    positive_probability : float
        Probability that the offset of a single outlier, or of a whole burst, is positive. If it is
        0.5, there is no polarity.
    period : float or None
        Period of the bearings, which are wrapped to [0, period); None leaves them unwrapped.
    batch : int or tuple of int
        Shape of the batch of records.
    rng : numpy.random.Generator or int, optional
        Random generator or its seed.

    Returns
    -------
    BearingRecord
        The record; `theta` has the shape `(*batch, n)` and the unit of `sigma`.

    Raises
    ------
    ValueError, TypeError
        If a parameter is outside its domain or has the wrong type, or the first number of a pair is
        larger than the second.

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
    period, random = _period(period), generator(rng)
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
    # one entry per measurement of a burst: its record and its position there
    place = np.arange(length.sum()) - np.repeat(np.cumsum(length) - length - start, length)
    members = (np.repeat(record, length), place)
    burst = np.zeros((records, n), dtype=bool)
    burst[members] = True
    offset[members] = np.repeat(offsets(record.size), length)

    theta += offset
    _wrap(theta, period)
    return BearingRecord(
        theta.reshape(shape), float(bearing), (single & ~burst).reshape(shape), burst.reshape(shape)
    )
