"""Plots, and the reasons why some plots cannot be used."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import FloatArray, IntArray, radians, samples, sequence_of
from tertia._result import Result
from tertia.sensors import Radar
from tertia.sensors._channels import NO_DETECTION, detections
from tertia.sensors._identities import (
    NO_IDENTITY,
    Identities,
    TextArray,
    checked,
    identities_of,
    whole,
)
from tertia.tracker._earth import plane_of, positions
from tertia.tracker._models import core_radar


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Plots(Result):
    """Plots of one or several sensors, in any order.

    Plots of a `Radar` are polar, those of a `PositionSensor` are positions with covariances, and
    those of a `Station` are azimuths.

    Parameters
    ----------
    degrees : bool
        Whether `azimuth` and `sensor_heading` are given in degrees; radians are stored.

    Attributes
    ----------
    time : ndarray of shape (N,)
        Time in seconds.
    range : ndarray of shape (N,)
        Range from the sensor in metres; nan for plots that are positions or azimuths. Ranges are
        slant ranges. If the radars are in a flat plane and no target has a known height, ranges are
        assumed to be horizontal.
    azimuth : ndarray of shape (N,)
        Azimuth in radians, clockwise from north.
    sensor : ndarray of int, shape (N,)
        Index of the sensor.
    height : ndarray of shape (N,)
        Height in metres; nan if it is not known.
    icao_address : ndarray of int, shape (N,), or None
        Addresses of 24 bits; -1 if there is none. If track and plot both have one, it alone decides
        whether they belong together.
    mode_3a : ndarray of int, shape (N,), or None
        Mode 3/A codes, for example 0o4204; -1 if there is none. Several targets may have the same
        code, and a target may be given another one. The codes 0o7500, 0o7600 and 0o7700 mean an
        emergency and are no identities; see `emergency_codes` of `Tracker`.
    callsign : ndarray of str, shape (N,), or None
        Aircraft identifications of at most eight characters, in capital letters; empty if there is
        none.
    identity : ndarray of int, shape (N,)
        Any other number that stays with the target; -1 if there is none. It is wrong with the
        `identity_error_probability` of `Tracker`.
    detection : ndarray of int, shape (N,)
        Channels that detected the plot: the index of psr, ssr, psr+ssr, mode-s or psr+mode-s in
        this list; -1 if they are not known. The names may be given instead of the indices. The
        column is used if the radar has `channels`; a value that these channels cannot produce is
        treated as unknown.
    position : ndarray of shape (N, 2) or None
        East and north in metres, for sensors that report positions; nan for plots of other sensors.
    covariance : ndarray of shape (N, 2, 2) or None
        Covariances of the positions; nan for plots to which the `position_sigma` of the sensor
        applies.
    velocity : ndarray of shape (N, 2) or None
        East and north velocity in m/s at the time of the plot, for sensors that report positions;
        nan for plots without one. A velocity that does not fit its track is not used, but the
        position is.
    velocity_covariance : ndarray of shape (N, 2, 2) or None
        Covariances of the velocities; nan for plots to which the `velocity_sigma` of the sensor
        applies. A velocity is not used if its covariance is not positive definite.
    sensor_position : ndarray of shape (N, 2) or None
        East and north in metres of a moving `Station` at the time of each plot; nan for plots to
        which the position stored in the station applies.
    sensor_heading : ndarray of shape (N,) or None
        Heading of a moving `Station`, for example of the bow of its ship, at the time of each plot:
        radians clockwise from north. The azimuth of the plot is relative to the heading; nan for
        plots with azimuths relative to north.

    Raises
    ------
    ValueError
        If columns have different shapes, an angle exceeds two turns, an address, code or callsign
        is impossible, or the name of a detection is unknown.
    TypeError
        If a column has the wrong type.
    """

    _rows: ClassVar = "time", 0

    time: FloatArray
    range: FloatArray
    azimuth: FloatArray
    sensor: IntArray
    height: FloatArray
    icao_address: IntArray | None
    mode_3a: IntArray | None
    callsign: TextArray | None
    identity: IntArray
    detection: IntArray
    position: FloatArray | None
    covariance: FloatArray | None
    velocity: FloatArray | None
    velocity_covariance: FloatArray | None
    sensor_position: FloatArray | None
    sensor_heading: FloatArray | None

    def __init__(
        self,
        time: npt.ArrayLike,
        range: npt.ArrayLike = np.nan,  # noqa: A002  # that is what it is
        azimuth: npt.ArrayLike = np.nan,
        *,
        sensor: npt.ArrayLike = 0,
        height: npt.ArrayLike = np.nan,
        icao_address: npt.ArrayLike | None = None,
        mode_3a: npt.ArrayLike | None = None,
        callsign: npt.ArrayLike | None = None,
        identity: npt.ArrayLike = NO_IDENTITY,
        detection: npt.ArrayLike = NO_DETECTION,
        position: npt.ArrayLike | None = None,
        covariance: npt.ArrayLike | None = None,
        velocity: npt.ArrayLike | None = None,
        velocity_covariance: npt.ArrayLike | None = None,
        sensor_position: npt.ArrayLike | None = None,
        sensor_heading: npt.ArrayLike | None = None,
        degrees: bool = False,
    ) -> None:
        instants = samples(time, "time")
        if instants.ndim != 1:
            raise ValueError(f"time has shape {instants.shape}; it must be (N,)")
        columns: dict[str, npt.NDArray[Any] | None] = {
            "time": instants,
            "range": samples(range, "range"),
            "azimuth": radians(azimuth, "azimuth", degrees=degrees),
            "sensor": whole(sensor, "sensor"),
            "height": samples(height, "height"),
            **checked(icao_address, mode_3a, callsign, identity),
            "detection": detections(detection),
            "sensor_heading": None
            if sensor_heading is None
            else radians(sensor_heading, "sensor_heading", degrees=degrees),
        }
        for key, values in columns.items():
            if values is None:
                object.__setattr__(self, key, None)
                continue
            try:
                same = values.shape == instants.shape
                column = values if same else np.broadcast_to(values, instants.shape)
                # a copy, so that the caller's array may change
                column = np.array(column, order="C")
            except ValueError:
                raise ValueError(
                    f"{key} has shape {values.shape}; it must be {instants.shape}, as time"
                ) from None
            object.__setattr__(self, key, column)
        for key, value, of, other in (
            ("covariance", covariance, "position", position),
            ("velocity", velocity, "position", position),
            ("velocity_covariance", velocity_covariance, "velocity", velocity),
        ):
            if value is not None and other is None:
                raise ValueError(f"{key} is given, but {of} is None")
        count = len(instants)
        object.__setattr__(self, "position", _rows(position, "position", (count, 2)))
        object.__setattr__(self, "covariance", _rows(covariance, "covariance", (count, 2, 2)))
        object.__setattr__(self, "velocity", _rows(velocity, "velocity", (count, 2)))
        spread = _rows(velocity_covariance, "velocity_covariance", (count, 2, 2))
        object.__setattr__(self, "velocity_covariance", spread)
        place = _rows(sensor_position, "sensor_position", (count, 2))
        object.__setattr__(self, "sensor_position", place)

    def __len__(self) -> int:
        """Return the number of plots."""
        return len(self.time)

    def __repr__(self) -> str:
        """Return a text that states the number of plots."""
        return f"Plots({len(self)})"

    def __getitem__(self, index: Any) -> Plots:
        """Return the plots that a slice, a mask or indices select."""
        some = Plots.__new__(Plots)
        for name in self.__slots__:
            whole = getattr(self, name)
            if whole is None:
                object.__setattr__(some, name, None)
                continue
            column = whole[index]
            if name == "time" and column.ndim != 1:
                raise ValueError(f"time has shape {column.shape}; it must be (N,)")
            object.__setattr__(some, name, np.ascontiguousarray(column))
        return some

    def to_cartesian(self, sensors: Sequence[Radar]) -> tuple[FloatArray, FloatArray]:
        """Return the plots as positions in the plane, as used by the tracker.

        Plots of radars on the earth (`Radar.frame`) are converted to the system plane. Those
        without a height are assumed to be at the mean height of the other plots; the error of this
        assumption is included in their covariances. In a flat plane, ranges of plots without a
        height are taken as horizontal.

        Parameters
        ----------
        sensors : sequence of Radar
            The radars that measured the plots.

        Returns
        -------
        position : ndarray of shape (N, 2)
            East and north in metres; nan if the plot is invalid or straight above the radar. Noise
            of the azimuth multiplies the mean of its sine and cosine by exp(-sigma^2 / 2); the
            positions are corrected for this factor.
        covariance : ndarray of shape (N, 2, 2)
            `J diag(range_sigma^2, azimuth_sigma^2) J'`, where J has the derivatives of the
            position. For a plot with a height, the contributions of the slant range and of the
            height error are added.

        Raises
        ------
        ValueError
            If a plot belongs to a sensor that does not exist.
        TypeError
            If a sensor is not a radar.

        Examples
        --------
        >>> import numpy as np
        >>> from tertia.tracker import Plots, Radar
        >>> radar = Radar(range_sigma=75.0, azimuth_sigma=np.radians(0.1), scan_period=10.0)
        >>> position, covariance = Plots([0.0], [150e3], 30.0, degrees=True).to_cartesian([radar])
        >>> position.round(1)
        array([[ 75000.1, 129904. ]])
        """
        radars = sequence_of(sensors, Radar, "sensors")
        plane = plane_of(radars)
        # of sensors that do not exist the core tells
        if plane is None or np.any((self.sensor < 0) | (self.sensor >= len(radars))):
            return _core.plots_to_cartesian([core_radar(radar) for radar in radars], self)
        return positions(self, radars, plane)

    @property
    def _identities(self) -> Identities:
        """The columns of identities, as the core reads them."""
        return identities_of(self)

    def _replaced(self, **columns: FloatArray | IntArray) -> Plots:
        """Return the same plots with some of the columns replaced."""
        some = Plots.__new__(Plots)
        for name in self.__slots__:
            object.__setattr__(some, name, columns.get(name, getattr(self, name)))
        return some


class PlotStatus(enum.IntEnum):
    """Reason why a plot was not used; `TrackTable.track_of_plot` has it instead of a track."""

    INVALID = -1
    LATE = -2
    AT_SENSOR = -3
    OUT_OF_RANGE = -4
    CLOCK_ERROR = -5
    DUPLICATE = -6
    NO_QUALITY = -7
    UNASSOCIATED = -8
    REFLECTION = -9

    @property
    def message(self) -> str:
        """The meaning of the status, as a sentence."""
        return _MESSAGES[self]


_MESSAGES = {
    PlotStatus.INVALID: (
        "time, range or azimuth is not finite or too large (over 1e11 s or 1e9 m), or the range is "
        "not positive"
    ),
    PlotStatus.LATE: "the plot is more than a scan older than plots that were processed before",
    PlotStatus.AT_SENSOR: "the target is straight above the radar",
    PlotStatus.OUT_OF_RANGE: "the plot is beyond the range of the radar",
    PlotStatus.CLOCK_ERROR: "the plot is isolated and much later than others: its clock is wrong",
    PlotStatus.DUPLICATE: (
        "the plot repeats the one before it or the last position of its target, or is a second "
        "plot of its target"
    ),
    PlotStatus.NO_QUALITY: (
        "the position has no valid covariance, and its sensor states no sigma of positions"
    ),
    PlotStatus.UNASSOCIATED: (
        "the azimuth matches no confirmed track, or several in nearly the same direction"
    ),
    PlotStatus.REFLECTION: (
        "the plot is of a target that the radar sees elsewhere, by a reflection or a side lobe"
    ),
}


def continuous(time: FloatArray, period: float, now: float) -> FloatArray:
    """Return the times of a clock that wraps as continuous times, near `now` if that is known."""
    known = np.flatnonzero(np.isfinite(time))
    if not len(known):
        return time
    unwrapped: FloatArray = time.copy()
    unwrapped[known] = np.unwrap(time[known], period=period)
    if np.isfinite(now):
        unwrapped[known] += np.round((now - unwrapped[known[0]]) / period) * period
    return unwrapped


def _rows(value: npt.ArrayLike | None, name: str, shape: tuple[int, ...]) -> FloatArray | None:
    """Return `value` as an array of the given shape; None if it is None."""
    if value is None:
        return None
    array = samples(value, name)
    if array.shape != shape:
        raise ValueError(f"{name} has shape {array.shape}; it must be {shape}, a row per plot")
    if len(shape) > 2 and not np.allclose(array, array.swapaxes(1, 2), equal_nan=True):
        raise ValueError(f"{name} is not symmetric")
    return np.array(array, order="C")
