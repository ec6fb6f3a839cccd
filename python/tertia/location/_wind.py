"""The medium of the signals: their speed, and a wind that carries them."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from tertia._arrays import FloatArray, finite, lies_between, real, require_each
from tertia.location._speed import Speed, read_speed
from tertia.sensors import Kind

# share of the speed of the signals
_LARGEST = 0.1
# speeds of sound in air, m/s, and the sigma of a component of a wind of which nothing is said
_IN_AIR = 250.0, 450.0
_USUAL = 5.0


@dataclass(frozen=True, slots=True, eq=False)
class Wind:
    """A horizontal wind, in units of the speed of the signals, before and after the estimate.

    `speed` is the stated speed of the signals. `values` are the measurements as they would be in
    still air. All but `speed` and `relative`, the stated standard deviation, are None before. If
    `as_stated`, the air is still unless the measurements contradict it.
    """

    speed: float
    relative: float
    mean: FloatArray | None = None
    covariance: FloatArray | None = None
    values: FloatArray | None = None
    as_stated: bool = False

    def found(self, blown: tuple[Any, Any, FloatArray] | None, shape: tuple[int, ...]) -> Wind:
        """Return the estimate of the core, whose measurements have this shape."""
        if blown is None:
            return self
        mean, covariance, values = blown
        return replace(
            self,
            mean=self.speed * np.array(mean),
            covariance=self.speed**2 * np.array(covariance),
            values=values.reshape(shape),
        )


_STILL = Wind(np.nan, 0.0)


def read_medium(
    speed: npt.ArrayLike,
    sigmas: tuple[npt.ArrayLike | None, float | None],
    kinds: Collection[Kind],
    *,
    robust: bool,
    unknown: bool = False,
) -> tuple[Speed, Wind]:
    """Return speed and wind, after checking whether they can be estimated from these kinds.

    `sigmas` are those of the speed and of the wind, `unknown` tells whether those of the
    measurements are to be estimated, `robust` whether the method is robust.
    """
    known = read_speed(speed, sigmas[0], kinds, robust=robust)
    if sigmas[1] is None:
        blows = robust and not unknown and set(kinds) == {"arrival_time"}
        return known, _usual_wind(known.stated) if blows else _STILL
    return known, _read_wind(sigmas[1], known.stated, kinds, unknown=unknown)


def _usual_wind(speed: FloatArray) -> Wind:
    """Return the wind that the measurements may show; none if the signals are no sound in air."""
    if not lies_between(speed, *_IN_AIR):
        return _STILL
    stated = float(np.mean(speed))
    return Wind(stated, _USUAL / stated, as_stated=True)


def _read_wind(sigma: float, speed: FloatArray, kinds: Collection[Kind], *, unknown: bool) -> Wind:
    if real(sigma, "wind_sigma") == 0.0:
        return _STILL
    width = finite(real(sigma, "wind_sigma"), "wind_sigma")
    require_each(width, width >= 0, "wind_sigma", "0 or positive")
    stated = float(np.mean(speed))
    if set(kinds) != {"arrival_time"}:
        raise ValueError(
            "wind_sigma needs times of arrival alone; measurements of other kinds were given"
        )
    if unknown:
        raise ValueError("wind_sigma needs arrival_time_sigma, or stations that have one")
    if width > _LARGEST * stated:
        raise ValueError(
            f"wind_sigma is {width:g} m/s and propagation_speed {stated:g} m/s; wind_sigma "
            f"must be at most {_LARGEST:.0%} of propagation_speed"
        )
    return Wind(stated, float(width) / stated)
