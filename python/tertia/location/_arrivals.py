"""Conversion of times of arrival, in seconds or NumPy's datetimes, to metres and back."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from tertia._arrays import FloatArray, array_of, positive, samples, scalar_or_array
from tertia.location._readers import deviations, require_length

# metres per second, in vacuum
LIGHT = 299_792_458.0
_SECOND = np.timedelta64(1, "s")
# dates whose steps are not coarser than clocks
_FINE = [(unit, 1) for unit in ("ns", "ps", "fs", "as")]


@dataclass(frozen=True, slots=True, eq=False)
class Arrivals:
    """Times of arrival at K stations in the form that the core requires.

    `first` is the first time of each instant, of shape (...). In double precision, seconds since
    1970 have a resolution of 0.2 µs, in which light travels 70 m. Therefore only the differences
    from `first` are multiplied by the speed of the signal. `value` and `sigma` are in metres, of
    shape (..., K).
    """

    first: npt.NDArray[Any]
    speed: FloatArray
    value: FloatArray
    sigma: FloatArray

    def at(self, scale: float) -> Arrivals:
        """Return the arrivals at a speed that is so many times the stated one."""
        return self if scale == 1.0 else replace(self, speed=self.speed * scale)

    def emission(self, emission: FloatArray) -> Any:
        """Return times of emission in units of the arrivals, from metres after the first one."""
        seconds = emission / self.speed
        if self.first.dtype.kind not in "mM":
            return scalar_or_array(np.asarray(self.first + seconds))
        known = np.isfinite(seconds)
        step = np.dtype(f"timedelta64[{np.datetime_data(self.first.dtype)[0]}]")
        steps = np.where(known, seconds, 0.0) * (_SECOND / np.ones((), step))
        after = np.rint(steps).astype(np.int64).astype(step)
        return np.where(known, self.first + after, np.array("NaT", self.first.dtype))[()]


def read_arrivals(
    value: npt.ArrayLike,
    sigma: npt.ArrayLike | None,
    own: FloatArray | None,
    speed: npt.ArrayLike,
    k: int,
) -> Arrivals:
    """Return times of arrival, after checking them."""
    time = array_of(value, "arrival_time")
    if time.dtype.kind in "mM":
        if np.datetime_data(time.dtype) not in _FINE:
            time = time.astype(f"{time.dtype.kind}8[ns]")
        absent = np.isnat(time)
    else:
        time = samples(value, "arrival_time")
        absent = np.isnan(time)
    require_length(time, "arrival_time", k)
    infinite = np.argwhere(~absent & ~np.isfinite(time))
    if len(infinite):
        place = ", ".join(map(str, infinite[0]))
        raise ValueError(f"arrival_time[{place}] is infinite; it must be a finite number, or nan")
    speeds = positive(speed, "propagation_speed")
    first = np.fmin.reduce(time, axis=-1)
    after = time - first[..., np.newaxis]
    seconds = after / _SECOND if time.dtype.kind in "mM" else after
    spread = deviations(sigma, own, "arrival_time", k, time, degrees=False)
    try:
        np.broadcast_shapes(speeds.shape, first.shape, spread.shape[:-1])
    except ValueError:
        raise ValueError(
            f"propagation_speed has shape {speeds.shape}; it must be one number, or one for each "
            f"instant, of shape {first.shape}"
        ) from None
    if time.dtype.kind == "f":
        _warn_if_coarse(first, spread)
    each = speeds[..., np.newaxis]
    return Arrivals(first, speeds, seconds * each, spread * each)


def _warn_if_coarse(first: FloatArray, sigma: FloatArray) -> None:
    """Warn if times are so large that double precision rounds them by more than their sigma."""
    largest = float(np.fmax.reduce(np.abs(first), axis=None, initial=0.0))
    if np.any(sigma < np.spacing(largest)):
        warnings.warn(
            f"arrival_time is about {largest:.6g} s, and a float64 has steps of "
            f"{np.spacing(largest):.2g} s there, which is more than its sigma: count from the "
            "start of the recording, or give dates in nanoseconds",
            stacklevel=4,
        )
