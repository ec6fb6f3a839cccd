"""The speed of signals that is known with a standard deviation."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from tertia._arrays import (
    FloatArray,
    finite,
    lies_between,
    positive,
    real,
    require_each,
    scalar_or_array,
)
from tertia.sensors import Kind

# what travels at this speed
_TRAVELS: frozenset[Kind] = frozenset({"range", "range_difference", "arrival_time"})
# share of the speed, so that three standard deviations leave signals some speed
_LARGEST = 0.2
# speed up to which signals are sounds, m/s, and how well the speed of sound is known if nothing is
# said
_SOUND = 1e5
_USUAL = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Speed:
    """A stated speed and its standard deviation, as a share of it, before and after the estimate.

    `scale` is the estimated speed divided by the stated one. If `as_stated`, the speed is the
    stated one unless the measurements contradict it.
    """

    stated: FloatArray
    relative: float
    scale: float = 1.0
    as_stated: bool = False

    def found(self, share: float, sigma: float) -> Speed:
        """Return the estimate: by which share signals are faster, and its standard deviation."""
        if share == 0.0 and sigma == self.relative and self.scale == 1.0:
            return self
        return replace(self, relative=sigma, scale=1.0 + share)

    def scaled(self, rows: FloatArray, kinds: Sequence[Kind]) -> FloatArray:
        """Return measurements of each kind, (..., kinds, K), or their sigmas, at this speed."""
        if self.scale == 1.0:
            return rows
        factors = np.array([[self.scale if kind in _TRAVELS else 1.0] for kind in kinds])
        scaled: FloatArray = rows * factors
        return scaled

    @property
    def value(self) -> float | FloatArray:
        """The estimated speed in metres per second."""
        value: float | FloatArray = scalar_or_array(self.stated * self.scale)
        return value

    @property
    def sigma(self) -> float | FloatArray:
        """Its standard deviation."""
        sigma: float | FloatArray = scalar_or_array(self.stated * self.relative)
        return sigma


def read_speed(
    speed: npt.ArrayLike, sigma: npt.ArrayLike | None, kinds: Collection[Kind], *, robust: bool
) -> Speed:
    """Return a speed, after checking whether it can be estimated from these kinds.

    Without a sigma, only a `robust` method lets the measurements contradict the speed.
    """
    stated = positive(speed, "propagation_speed")
    travels = not _TRAVELS.isdisjoint(kinds)
    if sigma is None:
        is_sound = robust and travels and lies_between(stated, 0.0, _SOUND)
        return Speed(stated, _USUAL if is_sound else 0.0, as_stated=is_sound)
    width = finite(real(sigma, "propagation_speed_sigma"), "propagation_speed_sigma")
    require_each(width, width >= 0, "propagation_speed_sigma", "0 or positive")
    if width > 0 and not travels:
        raise ValueError(
            "propagation_speed_sigma needs times of arrival, ranges or range differences; none was "
            "given"
        )
    relative = float(width) / float(np.mean(stated)) if width > 0 else 0.0
    if relative > _LARGEST:
        raise ValueError(
            f"propagation_speed_sigma is {relative:.0%} of propagation_speed; it must be at most "
            f"{_LARGEST:.0%}"
        )
    return Speed(stated, relative)
