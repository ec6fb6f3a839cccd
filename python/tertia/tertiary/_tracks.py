"""Tracks of single sensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from tertia._arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    diagonal,
    finite,
    instance,
    integer,
    place_of,
    require_each,
    samples,
)
from tertia._result import Result
from tertia.sensors._identities import (
    NO_CALLSIGN,
    NO_IDENTITY,
    TextArray,
    callsigns,
    icao_addresses,
    mode_3a_codes,
    whole,
)
from tertia.tracker import TrackTable

# as for plots: larger ones are errors of units
_LARGEST = {"time": 1e11, "position": 1e9, "velocity": 1e5, "covariance": 1e18, "height": 1e9}
# largest difference of elements mirrored at the diagonal, in standard deviations, as in the core
_ASYMMETRY = 1e-10


@dataclass(frozen=True, slots=True, eq=False, init=False)
class SensorTracks(Result):
    """Tracks of one or several sensors, in any order; each row is the state after a plot.

    Attributes
    ----------
    time : ndarray of shape (N,)
        Time in seconds.
    sensor : ndarray of int, shape (N,)
        Index of the sensor.
    track : ndarray of int, shape (N,)
        Number of the track at its sensor; it must not be negative. If a number appears again after
        an interruption of six scans or more, it denotes a new track.
    position, velocity : ndarray of shape (N, 2)
        East and north, in metres and metres per second.
    covariance : ndarray of shape (N, 4, 4)
        Covariance of position and velocity; nan if the sensor does not report it. In that case the
        covariance of the position is assumed to be that of a plot of the sensor, and the covariance
        of the velocity that of a straight line through three plots.
    height : ndarray of shape (N,)
        Height in metres; nan if it is not known.
    icao_address, mode_3a : ndarray of int, shape (N,)
        Address of 24 bits and mode 3/A code; -1 if they are not known. If two tracks have an
        address, it alone decides whether their identities are the same; otherwise their `identity`,
        then their callsign, then their code.
    callsign : ndarray of str, shape (N,)
        Aircraft identification; empty if it is not known.
    identity : ndarray of int, shape (N,)
        Any other number that stays with the target; -1 if there is none.
    turn_probability : ndarray of shape (N,)
        Probability that the target turns; nan if it is not known.

    Raises
    ------
    ValueError
        If columns have different lengths, if a number is not finite or is too large, or a
        covariance is not symmetric or not positive definite.
    TypeError
        If a column has the wrong type.

    Examples
    --------
    >>> from tertia.tertiary import SensorTracks
    >>> SensorTracks([0.0], 0, 17, [[30e3, 40e3]], [[200.0, 0.0]])
    SensorTracks(1 tracks, 1 rows)
    """

    _rows: ClassVar = "time", 0

    time: FloatArray
    sensor: IntArray
    track: IntArray
    position: FloatArray
    velocity: FloatArray
    covariance: FloatArray
    height: FloatArray
    icao_address: IntArray
    mode_3a: IntArray
    callsign: TextArray
    identity: IntArray
    turn_probability: FloatArray

    def __init__(
        self,
        time: npt.ArrayLike,
        sensor: npt.ArrayLike,
        track: npt.ArrayLike,
        position: npt.ArrayLike,
        velocity: npt.ArrayLike,
        *,
        covariance: npt.ArrayLike | None = None,
        height: npt.ArrayLike = np.nan,
        icao_address: npt.ArrayLike = NO_IDENTITY,
        mode_3a: npt.ArrayLike = NO_IDENTITY,
        callsign: npt.ArrayLike = NO_CALLSIGN,
        identity: npt.ArrayLike = NO_IDENTITY,
        turn_probability: npt.ArrayLike = np.nan,
    ) -> None:
        instants = finite(samples(time, "time"), "time")
        if instants.ndim != 1:
            raise ValueError(f"time has shape {instants.shape}; it must be (N,)")
        covariances = np.nan if covariance is None else covariance
        columns: dict[str, tuple[npt.NDArray[Any], tuple[int, ...]]] = {
            "time": (instants, ()),
            "sensor": (whole(sensor, "sensor"), ()),
            "track": (whole(track, "track"), ()),
            "position": (finite(samples(position, "position"), "position"), (2,)),
            "velocity": (finite(samples(velocity, "velocity"), "velocity"), (2,)),
            "covariance": (samples(covariances, "covariance"), (4, 4)),
            "height": (samples(height, "height"), ()),
            "icao_address": (icao_addresses(icao_address), ()),
            "mode_3a": (mode_3a_codes(mode_3a), ()),
            "callsign": (callsigns(callsign), ()),
            "identity": (whole(identity, "identity"), ()),
            "turn_probability": (samples(turn_probability, "turn_probability"), ()),
        }
        for key, (values, tail) in columns.items():
            shape = (len(instants), *tail)
            try:
                # a copy, so that the caller's array may change
                column = np.array(np.broadcast_to(values, shape), order="C")
            except ValueError:
                raise ValueError(f"{key} has shape {values.shape}; it must be {shape}") from None
            object.__setattr__(self, key, column)
        for key in ("sensor", "track"):
            wrong = np.flatnonzero(getattr(self, key) < 0)
            if len(wrong):
                value = getattr(self, key)[wrong[0]]
                raise ValueError(f"{key}[{wrong[0]}] is {value}; it must not be negative")
        for key, largest in _LARGEST.items():
            values = getattr(self, key)
            require_each(values, ~(np.abs(values) > largest), key, f"at most {largest:g} in size")
        object.__setattr__(self, "covariance", _symmetric(self.covariance))
        known = np.all(np.isfinite(self.covariance), axis=(1, 2))
        try:
            np.linalg.cholesky(self.covariance[known])
        except np.linalg.LinAlgError:
            least = [np.min(np.linalg.eigvalsh(one)) for one in self.covariance[known]]
            first = np.flatnonzero(known)[np.argmax(np.array(least) <= 0.0)]
            raise ValueError(f"covariance[{first}] is not positive definite") from None

    @classmethod
    def of(cls, table: TrackTable, *, sensor: int | None = None) -> SensorTracks:
        """Return the tracks of a tracker, with those rows of confirmed tracks that have a plot.

        Rows without a plot are left out, because they are only extrapolated and contain no new
        information.

        Parameters
        ----------
        table : TrackTable
            Tracks of one sensor.
        sensor : int, optional
            Index of the sensor at the fusion centre; by default the index in the table.

        Returns
        -------
        SensorTracks
            The selected rows, in the order of the table.

        Raises
        ------
        ValueError
            If `sensor` is negative.
        TypeError
            If an argument has the wrong type.

        Examples
        --------
        >>> import numpy as np
        >>> from tertia.tertiary import SensorTracks
        >>> from tertia.tracker import Plots, Radar, track
        >>> radar = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0)
        >>> time = np.arange(0.0, 100.0, 4.0)
        >>> table = track(Plots(time, 50e3 + 200 * time, 0.5), [radar])
        >>> SensorTracks.of(table, sensor=2)
        SensorTracks(1 tracks, 23 rows)
        """
        instance(table, "table", TrackTable)
        # what was not confirmed at the time was not known to be a track
        kept = (table.plot >= 0) & table.confirmed
        index = table.sensor[kept] if sensor is None else integer(sensor, "sensor", 0)
        return cls(
            table.time[kept],
            index,
            table.track[kept],
            table.position[kept],
            table.velocity[kept],
            covariance=table.covariance[kept],
            height=table.height[kept],
            icao_address=table.icao_address[kept],
            mode_3a=table.mode_3a[kept],
            callsign=table.callsign[kept],
            identity=table.identity[kept],
            turn_probability=table.turn_probability[kept],
        )

    @classmethod
    def concatenate(cls, several: Sequence[SensorTracks]) -> SensorTracks:
        """Return the rows of several tables, one table after the other, as one table.

        Parameters
        ----------
        several : sequence of SensorTracks
            The tables; at least one.

        Returns
        -------
        SensorTracks
            All rows.

        Raises
        ------
        ValueError
            If there is no table.
        """
        if not several:
            raise ValueError("several is empty; there must be at least one table")
        joined = {
            name: np.concatenate([getattr(one, name) for one in several]) for name in cls.__slots__
        }
        return cls(**joined)

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.time)

    def __getitem__(self, index: slice | BoolArray | IntArray) -> SensorTracks:
        """Return the rows that a slice, a mask or indices select."""
        some = SensorTracks.__new__(SensorTracks)
        for name in self.__slots__:
            object.__setattr__(some, name, np.ascontiguousarray(getattr(self, name)[index]))
        return some

    def __repr__(self) -> str:
        """Return a text that states the numbers of tracks and rows."""
        tracks = np.unique(np.column_stack([self.sensor, self.track]), axis=0)
        return f"SensorTracks({len(tracks)} tracks, {len(self)} rows)"


def _symmetric(covariance: FloatArray) -> FloatArray:
    """Return covariances without the asymmetry of rounding; larger ones are errors."""
    mirrored = np.swapaxes(covariance, 1, 2)
    if np.array_equal(covariance, mirrored, equal_nan=True):
        return covariance
    sigma = np.sqrt(np.abs(diagonal(covariance)))
    scale = sigma[:, :, np.newaxis] * sigma[:, np.newaxis, :]
    for index in np.argwhere(np.abs(covariance - mirrored) > _ASYMMETRY * scale)[:1]:
        at = tuple(index)
        raise ValueError(
            f"{place_of('covariance', index)} is {covariance[at]} and its mirror image is "
            f"{mirrored[at]}; a covariance matrix must be symmetric"
        )
    return covariance + 0.5 * (mirrored - covariance)
