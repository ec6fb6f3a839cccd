"""Location of emitters by direction finders, from a bearing of each direction finder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tertia._arrays import BoolArray, FloatArray, finite, samples
from tertia.bearing import estimate_bearing
from tertia.location import Location, locate
from tertia.sensors import Station
from tertia.trajectory import Trajectory, reconstruct

# the emitter moves if the halves of its record differ by more than this number of standard
# deviations
_MOVED = 4.0
# least number of bearings in each half of a record
_FEWEST = 10


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Emitter:
    """Bearings of an emitter from several direction finders.

    Attributes
    ----------
    name : str
        Label of the emitter on the page.
    time : ndarray of shape (N,)
        Times in seconds.
    azimuth : ndarray of shape (N, K)
        Bearings from K stations in radians, clockwise from north; nan where a bearing is missing.
    """

    name: str
    time: FloatArray
    azimuth: FloatArray

    def __init__(self, name: str, time: npt.ArrayLike, azimuth: npt.ArrayLike) -> None:
        instants, bearings = finite(time, "time"), samples(azimuth, "azimuth")
        if instants.ndim != 1 or bearings.ndim != 2 or len(bearings) != len(instants):
            raise ValueError(
                f"time has shape {instants.shape} and azimuth {bearings.shape}; they must be (N,) "
                "and (N, K)"
            )
        object.__setattr__(self, "name", str(name))
        object.__setattr__(self, "time", np.array(instants))
        object.__setattr__(self, "azimuth", np.array(bearings))


@dataclass(frozen=True, slots=True, eq=False)
class Heard:
    """An emitter, its bearings from the stations in radians (nan if unknown), and its position.

    `moves` is true if the bearings in the first half of the record differ from those in the second
    half; `path` is then used instead of `position`, for which the emitter is assumed to be fixed.
    `instants` has the positions at single times, if there are any.
    """

    emitter: Emitter
    bearing: FloatArray
    sigma: FloatArray
    outlier: BoolArray
    moves: bool
    position: Location | None
    instants: Location | None
    path: Trajectory | None


@dataclass(frozen=True, slots=True, eq=False)
class Finders:
    """Direction finders, and the results of their measurements for each emitter."""

    stations: Sequence[Station]
    heard: list[Heard]

    @property
    def names(self) -> list[str]:
        """Names of the stations; a station without a name has its number, counted from 1."""
        return [str(station.name or k) for k, station in enumerate(self.stations, start=1)]


def hear(emitter: Emitter, stations: Sequence[Station]) -> Heard:
    """Estimate the bearings of an emitter, and locate the emitter."""
    azimuth = emitter.azimuth
    count = len(stations)
    if azimuth.shape[1] != count:
        raise ValueError(
            f"azimuth of {emitter.name} has shape {azimuth.shape}; there are {count} stations"
        )
    bearing, sigma = np.full(count, np.nan), np.full(count, np.nan)
    outlier = np.zeros(azimuth.shape, dtype=bool)
    moves = False
    half = len(azimuth) // 2
    for k in range(count):
        found = _estimate(azimuth[:, k])
        if found is None:
            continue
        bearing[k], sigma[k], outlier[:, k] = found
        # movement of the emitter would be estimated as time-correlated noise
        parts = (azimuth[:half, k], azimuth[half:, k])
        halves = [_estimate(part, correlation=0.0) for part in parts]
        if halves[0] is not None and halves[1] is not None:
            (one, s, _), (other, t, _) = halves[0], halves[1]
            moves |= abs(np.sin((one - other) / 2)) * 2 > _MOVED * np.hypot(s, t)
    position = None if moves else _position(stations, bearing, sigma)
    return Heard(
        emitter=emitter,
        bearing=bearing,
        sigma=sigma,
        outlier=outlier,
        moves=bool(moves),
        position=position,
        instants=_instants(stations, azimuth),
        path=_path(stations, emitter) if moves else None,
    )


def _estimate(
    azimuth: FloatArray, correlation: float | None = None
) -> tuple[float, float, BoolArray] | None:
    """Return the bearing, its sigma and the outliers; None if there are too few measurements."""
    if np.sum(~np.isnan(azimuth)) < _FEWEST:
        return None
    found = estimate_bearing(azimuth, period=2 * np.pi, correlation=correlation, nan_policy="omit")
    return float(found.value), float(found.sigma), found.outlier


def _position(
    stations: Sequence[Station], bearing: FloatArray, sigma: FloatArray
) -> Location | None:
    known = np.isfinite(bearing) & (sigma > 0)
    if np.sum(known) < 2:
        return None
    heard = [station for station, there in zip(stations, known, strict=True) if there]
    found = locate(heard, azimuth=bearing[known][np.newaxis], azimuth_sigma=sigma[known])
    return found if np.all(found.success) else None


def _instants(stations: Sequence[Station], azimuth: FloatArray) -> Location | None:
    heard = _stated(stations)
    if len(heard) < 2:
        return None
    found = locate([stations[k] for k in heard], azimuth=azimuth[:, heard])
    return found if np.any(found.success) else None


def _path(stations: Sequence[Station], emitter: Emitter) -> Trajectory | None:
    heard = _stated(stations)
    azimuth = emitter.azimuth[:, heard]
    # a single bearing does not determine a position
    if np.sum(np.sum(~np.isnan(azimuth), axis=1) >= 2) < _FEWEST:
        return None
    order = np.argsort(emitter.time, kind="stable")
    return reconstruct([stations[k] for k in heard], emitter.time[order], azimuth=azimuth[order])


def _stated(stations: Sequence[Station]) -> list[int]:
    """Return the stations for which a sigma of the azimuth is stated."""
    return [k for k, station in enumerate(stations) if station.azimuth_sigma is not None]
