"""Tracker: scans of radar plots in, tracks out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tertia._arrays import FloatArray, IntArray, finite, positive, real, samples

__all__ = ["Plots", "Radar"]

# identity of a plot that has none
NO_IDENTITY = -1


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Radar:
    """Where a radar is, and how it measures.

    Attributes
    ----------
    position : ndarray of shape (2,) or (3,)
        East, north and, if known, up in metres.
    range_sigma : float
        Standard deviation of its ranges in metres.
    azimuth_sigma : float
        That of its azimuths in radians.
    period : float
        Seconds of a scan.
    range_max : float
        Metres; beyond, nothing is detected.
    detection_probability : float
        How often an aircraft within its range is seen in a scan.
    name : str or None
        How pictures and reports call it.
    """

    position: FloatArray
    range_sigma: float
    azimuth_sigma: float
    period: float
    range_max: float
    detection_probability: float
    name: str | None

    def __init__(
        self,
        position: npt.ArrayLike = (0.0, 0.0),
        *,
        range_sigma: float,
        azimuth_sigma: float,
        period: float,
        range_max: float = np.inf,
        detection_probability: float = 0.9,
        name: str | None = None,
    ) -> None:
        place = finite(position, "position")
        if place.shape not in {(2,), (3,)}:
            raise ValueError(f"position has shape {place.shape}; it must be (2,) or (3,)")
        probability = real(detection_probability, "detection_probability")
        if not 0.0 < probability < 1.0:
            raise ValueError(f"detection_probability is {probability}; it must be between 0 and 1")
        limit = real(range_max, "range_max")
        if not limit > 0.0:
            raise ValueError(f"range_max is {limit}; it must be positive")
        numbers = {"range_sigma": range_sigma, "azimuth_sigma": azimuth_sigma, "period": period}
        for key, number in numbers.items():
            object.__setattr__(self, key, float(positive(real(number, key), key)))
        object.__setattr__(self, "position", place)
        object.__setattr__(self, "range_max", limit)
        object.__setattr__(self, "detection_probability", probability)
        object.__setattr__(self, "name", name)


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Plots:
    """What radars saw: polar plots, one element each, in any order.

    Attributes
    ----------
    time : ndarray of shape (N,)
        Seconds.
    range : ndarray of shape (N,)
        Metres from the radar: slant range where there is a height, horizontal otherwise.
    azimuth : ndarray of shape (N,)
        Radians, clockwise from north.
    radar : ndarray of int, shape (N,)
        Index of the radar.
    height : ndarray of shape (N,)
        Metres; nan where it is not known.
    identity : ndarray of int, shape (N,)
        What the transponder answered, for example a code or an address; -1 where nothing.
    """

    time: FloatArray
    range: FloatArray
    azimuth: FloatArray
    radar: IntArray
    height: FloatArray
    identity: IntArray

    def __init__(
        self,
        time: npt.ArrayLike,
        range: npt.ArrayLike,  # noqa: A002  # that is what it is
        azimuth: npt.ArrayLike,
        *,
        radar: npt.ArrayLike = 0,
        height: npt.ArrayLike = np.nan,
        identity: npt.ArrayLike = NO_IDENTITY,
    ) -> None:
        instants = samples(time, "time")
        if instants.ndim != 1:
            raise ValueError(f"time has shape {instants.shape}; it must be (N,)")
        columns = {
            "time": instants,
            "range": samples(range, "range"),
            "azimuth": samples(azimuth, "azimuth"),
            "radar": _whole(radar, "radar"),
            "height": samples(height, "height"),
            "identity": _whole(identity, "identity"),
        }
        for key, values in columns.items():
            try:
                column = np.ascontiguousarray(np.broadcast_to(values, instants.shape))
            except ValueError:
                raise ValueError(
                    f"{key} has shape {values.shape}; it must be {instants.shape}, as time"
                ) from None
            object.__setattr__(self, key, column)

    def __len__(self) -> int:
        """Return the number of plots."""
        return len(self.time)

    def __repr__(self) -> str:
        """Tell the number of plots."""
        return f"Plots({len(self)})"

    def __getitem__(self, index: slice | IntArray | npt.NDArray[np.bool_]) -> Plots:
        """Return some of the plots."""
        return Plots(
            self.time[index],
            self.range[index],
            self.azimuth[index],
            radar=self.radar[index],
            height=self.height[index],
            identity=self.identity[index],
        )


def _whole(value: npt.ArrayLike, name: str) -> IntArray:
    """Return `value` as int64 numbers."""
    array = np.asarray(value)
    if array.dtype.kind not in "iu":
        raise TypeError(f"{name} has dtype {array.dtype}; it must hold integers")
    return array.astype(np.int64)
