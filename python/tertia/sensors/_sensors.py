"""Stations, radars, and their measurements of each kind."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tertia._arrays import (
    FloatArray,
    IntArray,
    finite,
    instance,
    positive,
    probability,
    real,
    require_each,
    scalar_or_array,
    sequence_of,
)
from tertia.sensors._bias import DRIFT_TIME, ERRORS, PLACED, RADAR_LIMITS, Bias
from tertia.sensors._bias import KINDS as ERROR_KINDS
from tertia.sensors._channels import Channel, channels_of, narrow, ways
from tertia.sensors._kinds import KINDS, STATION_KINDS, Kind, angle_sigma
from tertia.sensors._positions import PositionSensor, extent

if TYPE_CHECKING:
    from tertia.geo import LocalFrame, SystemPlane

# largest element by which axes times their transpose may differ from the identity
_ORTHONORMAL = 1e-9
# kinds with a standard deviation of a station's own
_WITH_SIGMAS = (*STATION_KINDS, "arrival_time")
_own_sigmas = attrgetter(*(f"{kind}_sigma" for kind in _WITH_SIGMAS))

# probability that a radar detects a target
_DETECTED = 0.9
# in seconds; ADS-B may be up to .4 s late (DO-260B; George, Tuladhar and Sivananthan 2020)
_LATENCY_SIGMA = 0.2
# of errors of positions that are to be estimated, in metres
_PLACE_LIMITS = {"east_sigma": 100.0, "north_sigma": 100.0}
# in seconds; a target is expected in every scan, so that shorter ones take for ever
_FASTEST_SCAN = 1e-3


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Station:
    """A station that measures ranges, angles and times of arrival.

    Parameters
    ----------
    degrees : bool
        Whether `azimuth_sigma` and `elevation_sigma` are given in degrees; radians are stored.

    Attributes
    ----------
    position : ndarray of shape (..., 2) or (..., 3)
        East, north and up in metres; the array has leading axes if the station moves.
    range_sigma : float or None
        Standard deviation of the ranges in metres; None if it is unknown, or if no ranges are
        measured.
    azimuth_sigma, elevation_sigma : float or None
        Standard deviations of the angles in radians; None as for `range_sigma`.
    arrival_time_sigma : float or None
        Standard deviation of the times of arrival in seconds; None as for `range_sigma`.
    position_sigma : float
        Standard deviation of each coordinate of the surveyed position in metres. All measurements
        of the station share the resulting error.
    bias : Bias or None
        Systematic errors of the station; None if they are not known.
    name : str or None
        Label of the station in pictures. Stations with the same name are one sensor at several
        places, such as the finder of a moving ship or car: `locate` estimates its error, which all
        places share (see `tertia.location.locate`). Several stations need different names, or none.
    axes : ndarray of shape (..., D, D) or None
        Unit vectors east, north and up at the station as rows, in the coordinates of the frame. The
        azimuths and elevations of the station refer to these axes. None: the axes of the station
        are those of the frame. The two differ if the station is so far from the origin that the
        curvature of the earth matters (see `tertia.geo`).

    Raises
    ------
    ValueError, TypeError
        If a shape is wrong, a number is outside its domain, axes are not a rotation, or an argument
        has the wrong type.

    Examples
    --------
    >>> from tertia.sensors import Station
    >>> Station([1000.0, 0.0], azimuth_sigma=0.5, degrees=True).azimuth_sigma
    0.008726646259971648
    """

    position: FloatArray
    range_sigma: float | None
    azimuth_sigma: float | None
    elevation_sigma: float | None
    arrival_time_sigma: float | None
    position_sigma: float
    bias: Bias | None
    name: str | None
    axes: FloatArray | None

    def __init__(
        self,
        position: npt.ArrayLike,
        *,
        range_sigma: float | None = None,
        azimuth_sigma: float | None = None,
        elevation_sigma: float | None = None,
        arrival_time_sigma: float | None = None,
        position_sigma: float = 0.0,
        bias: Bias | None = None,
        axes: npt.ArrayLike | None = None,
        name: str | None = None,
        degrees: bool = False,
    ) -> None:
        place = np.array(finite(position, "position"))
        require_dimension(place, "position", "(..., 2) or (..., 3)")
        sigmas = {
            "range_sigma": range_sigma,
            "azimuth_sigma": azimuth_sigma,
            "elevation_sigma": elevation_sigma,
            "arrival_time_sigma": arrival_time_sigma,
        }
        surveyed = finite(real(position_sigma, "position_sigma"), "position_sigma")
        require_each(surveyed, surveyed >= 0, "position_sigma", "0 or positive")
        object.__setattr__(self, "position", place)
        object.__setattr__(self, "position_sigma", float(surveyed))
        object.__setattr__(self, "bias", _own_bias(bias))
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "axes", None if axes is None else _axes(axes, place))
        for key, sigma in sigmas.items():
            object.__setattr__(self, key, None if sigma is None else _sigma(sigma, key, degrees))


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Radar:
    """A radar: its position, scan period and accuracy.

    On a flat earth, heights of targets are relative to the height of the radar. With a `frame`, as
    set by `tertia.geo.SystemPlane.radar`, the radar is on the curved earth: its azimuths are
    relative to true north at the radar, and heights are above the ellipsoid.

    Parameters
    ----------
    degrees : bool
        Whether `azimuth_sigma` and `azimuth_resolution` are given in degrees; radians are stored.

    Attributes
    ----------
    position : ndarray of shape (2,) or (3,)
        East, north and, if known, up in metres.
    range_sigma : float
        Standard deviation of the ranges in metres.
    azimuth_sigma : float
        Standard deviation of the azimuths in radians, at most 0.5.
    scan_period : float
        Duration of one rotation of the antenna in seconds, at least 0.001.
    max_range : float
        Largest range at which targets are detected, in metres.
    detection_probability : float
        Probability that a target within range is detected in a scan, by default 0.9. If `channels`
        are given, it is computed from their probabilities.
    channels : dict of str to Channel, or None
        Properties of the detection by echoes ("psr") and by replies ("ssr", "mode-s"); the channels
        detect independently. The sigmas of a plot then depend on the channels that detected it
        (`Plots.detection`). Plots whose channels are unknown have the sigmas of the radar. None:
        all plots have the same properties.
    range_resolution, azimuth_resolution : float or None
        Difference in range in metres, and difference in azimuth in radians, at which two targets
        give one common plot with a probability of a half. Give both or neither. If neither is
        given, every target has a plot of its own.
    target_extent : float
        Length in metres of the largest targets, if targets are larger than the resolution and give
        several plots in a scan, such as ships near a radar: the plots of one target in a scan are
        combined. With 0 (default), a target gives one plot in a scan.
    bias : Bias or None
        Systematic errors of range, azimuth and time, with their standard deviations. None: the
        errors are unknown, and their standard deviations are the limits `RADAR_LIMITS`. `Bias()`:
        there are no systematic errors.
    name : str or None
        Label of the radar in pictures and reports.
    frame : tertia.geo.SystemPlane or None
        System plane in which `position` is given, if the earth is curved; None: the earth is flat.

    Raises
    ------
    ValueError, TypeError
        If a shape is wrong, a number is outside its domain, or an argument has the wrong type.

    Examples
    --------
    >>> from tertia.sensors import Radar
    >>> Radar(range_sigma=50.0, azimuth_sigma=0.1, scan_period=4.0, degrees=True).azimuth_sigma
    0.0017453292519943296
    """

    position: FloatArray
    range_sigma: float
    azimuth_sigma: float
    scan_period: float
    max_range: float
    detection_probability: float
    channels: Mapping[str, Channel] | None
    range_resolution: float | None
    azimuth_resolution: float | None
    target_extent: float
    bias: Bias | None
    name: str | None
    frame: SystemPlane | None

    def __init__(
        self,
        position: npt.ArrayLike = (0.0, 0.0),
        *,
        range_sigma: float,
        azimuth_sigma: float,
        scan_period: float,
        max_range: float = np.inf,
        detection_probability: float | None = None,
        channels: Mapping[str, Channel] | None = None,
        range_resolution: float | None = None,
        azimuth_resolution: float | None = None,
        target_extent: float = 0.0,
        bias: Bias | None = None,
        name: str | None = None,
        frame: SystemPlane | None = None,
        degrees: bool = False,
    ) -> None:
        place = np.array(finite(position, "position"))
        if frame is not None and not hasattr(frame, "scale_and_convergence"):
            raise TypeError(f"frame is {frame!r}; it must be a SystemPlane")
        if place.shape not in {(2,), (3,)}:
            raise ValueError(f"position has shape {place.shape}; it must be (2,) or (3,)")
        own = channels_of(channels)
        detected = _detected(detection_probability, own)
        limit = real(max_range, "max_range")
        if not limit > 0.0:
            raise ValueError(f"max_range is {limit}; it must be positive")
        numbers = {
            "range_sigma": range_sigma,
            "azimuth_sigma": azimuth_sigma,
            "scan_period": scan_period,
        }
        for key, number in numbers.items():
            object.__setattr__(self, key, _sigma(number, key, degrees))
        cell = {"range_resolution": range_resolution, "azimuth_resolution": azimuth_resolution}
        if (range_resolution is None) != (azimuth_resolution is None):
            missing = next(key for key, size in cell.items() if size is None)
            raise ValueError(f"{missing} is None; both resolutions must be given, or none")
        for key, size in cell.items():
            object.__setattr__(self, key, None if size is None else _sigma(size, key, degrees))
        narrow(self.azimuth_sigma)
        if self.scan_period < _FASTEST_SCAN:
            raise ValueError(
                f"scan_period is {self.scan_period:g}; it must be at least {_FASTEST_SCAN} s"
            )
        object.__setattr__(self, "target_extent", extent(target_extent))
        object.__setattr__(self, "position", place)
        object.__setattr__(self, "max_range", limit)
        object.__setattr__(self, "detection_probability", detected)
        object.__setattr__(self, "channels", own)
        object.__setattr__(self, "bias", _own_bias(bias))
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "frame", frame)

    @property
    def site(self) -> LocalFrame | None:
        """The local frame of east, north and up at the radar; None on a flat earth."""
        return None if self.frame is None else self.frame.site(self.position)


@dataclass(frozen=True, slots=True, eq=False)
class ByKind:
    """One array for each kind of measurement; None for kinds that are not measured.

    Attributes
    ----------
    range, azimuth, elevation, arrival_time : ndarray of shape (..., K) or None
        One element for each station.
    range_difference : ndarray of shape (..., K - 1) or None
        One element for each station except the first.
    """

    range: npt.NDArray[Any] | None = None
    azimuth: npt.NDArray[Any] | None = None
    elevation: npt.NDArray[Any] | None = None
    range_difference: npt.NDArray[Any] | None = None
    arrival_time: npt.NDArray[Any] | None = None

    @property
    def count(self) -> int | IntArray:
        """Number of elements of all kinds that are not zero, or that are True, of shape (...)."""
        marks = [getattr(self, field.name) for field in fields(self)]
        present = [mark for mark in marks if mark is not None]
        total: int | IntArray = scalar_or_array(
            np.asarray(sum(np.count_nonzero(mark, axis=-1) for mark in present))
        )
        return total


def stack_stations(
    stations: Sequence[Station] | npt.ArrayLike,
) -> tuple[FloatArray, FloatArray | None, dict[str, FloatArray]]:
    """Return positions, (..., K, D), axes, (..., K, D, D), and sigmas of the stations, (K,)."""
    if isinstance(stations, Station):
        raise TypeError("stations is one Station; it must be a sequence of them")
    if not isinstance(stations, Sequence) or not any(isinstance(s, Station) for s in stations):
        places = finite(stations, "stations")  # type: ignore[arg-type]
        require_dimension(places, "stations", "(..., K, 2) or (..., K, 3)")
        if places.ndim < 2 or places.shape[-2] == 0:
            raise ValueError(f"stations has shape {places.shape}; it must be (..., K, D)")
        return places, None, {}
    known = sequence_of(stations, Station, "stations")
    positions = [station.position for station in known]
    try:
        fixed = {position.shape for position in positions} in ({(2,)}, {(3,)})
        each = positions if fixed else np.broadcast_arrays(*positions)
        places = np.array(each) if fixed else np.stack(each, axis=-2)
    except ValueError:
        shapes = ", ".join(str(position.shape) for position in positions)
        raise ValueError(f"the positions of the stations have shapes {shapes}") from None
    # one array for all, in which None is nan
    sigmas = np.array([_own_sigmas(station) for station in known], dtype=np.float64).T
    columns = dict(zip(_WITH_SIGMAS, sigmas, strict=True))
    return places, _all_axes(known, places.shape[-1]), columns


def own_biases(sensors: Sequence[Radar | PositionSensor | Station]) -> Bias:
    """Return the stated systematic errors of sensors, (K,), or the limits if none are stated."""
    given = [_bias_of(sensor) for sensor in sensors]
    columns = {
        kind: np.array(
            [
                _error(bias, kind) if kind.removesuffix("_sigma") in error_kinds(one) else 0.0
                for one, bias in zip(sensors, given, strict=True)
            ],
            dtype=np.float64,
        )
        for kind in ERRORS
    }
    return Bias._of(columns)


def error_kinds(sensor: Radar | PositionSensor | Station) -> Sequence[str | None]:
    """Return the four kinds of systematic errors of a sensor as the core knows them."""
    return PLACED if isinstance(sensor, PositionSensor) else ERROR_KINDS


def drift_rates(sensors: Sequence[Radar | PositionSensor | Station]) -> FloatArray:
    """Return the rates at which systematic errors return to their prior mean, (K, 4), in 1/s.

    If only a part of an error drifts, the error is treated as if all of it drifted at a
    correspondingly lower rate.
    """
    biases = [_bias_of(sensor) for sensor in sensors]
    pairs = zip(sensors, biases, strict=True)
    return np.array([[_drift_rate(bias, kind) for kind in error_kinds(one)] for one, bias in pairs])


def _drift_rate(bias: Bias | None, kind: str | None) -> float:
    """Return the rate at which a systematic error returns to its prior; 0 if it is constant."""
    if kind is None:
        return 0.0
    is_estimated = bias is None or getattr(bias, f"{kind}_sigma") is None
    share, time = (None, None) if bias is None else (bias.drift_share, bias.drift_time)
    if share is None:
        share = 1.0 if is_estimated else 0.0
    return share / (DRIFT_TIME if time is None else time)


def _bias_of(sensor: Radar | PositionSensor | Station) -> Bias | None:
    """Return the bias of a sensor; None means that only the limits for a radar are known."""
    if sensor.bias is not None or isinstance(sensor, Radar):
        return sensor.bias
    if isinstance(sensor, PositionSensor):
        return Bias(time_sigma=_LATENCY_SIGMA, drift_share=1.0)
    return Bias()


def _error(bias: Bias | None, kind: str) -> float:
    """Return a systematic error or its standard deviation as stated, or as in the limits."""
    value = getattr(RADAR_LIMITS if bias is None else bias, kind)
    if value is None and kind in _PLACE_LIMITS:
        return _PLACE_LIMITS[kind]
    return float(getattr(RADAR_LIMITS, kind) if value is None else value)


def survey_sigmas(stations: Sequence[Station] | npt.ArrayLike) -> FloatArray | None:
    """Return the standard deviations of the stations' positions, (K,); None if all are exact."""
    if not isinstance(stations, Sequence) or not isinstance(next(iter(stations), None), Station):
        return None
    sigmas = [one.position_sigma for one in sequence_of(stations, Station, "stations")]
    return np.array(sigmas) if any(sigmas) else None


def by_kind(array: npt.NDArray[Any], kinds: Sequence[Kind]) -> ByKind:
    """Return the rows of an array (..., 5, K) for the kinds that were measured, by kind."""
    return ByKind(
        **{kind: array[..., KINDS.index(kind), int(kind == "range_difference") :] for kind in kinds}
    )


def require_dimension(array: FloatArray, name: str, shape: str) -> None:
    """Raise an error unless the last axis is east, north and optionally up."""
    if array.ndim < 1 or array.shape[-1] not in {2, 3}:
        raise ValueError(f"{name} has shape {array.shape}; it must be {shape}")


def _detected(given: float | None, channels: Mapping[str, Channel] | None) -> float:
    """Return the probability that a radar detects a target, from its channels if it has any."""
    if channels is None:
        return probability(_DETECTED if given is None else given, "detection_probability")
    own = 1.0 - ways(channels)[""]
    # a copy of a radar is made with both
    if given not in {None, own}:
        raise ValueError(
            f"detection_probability is {given}; with channels it must be theirs, {own:g}"
        )
    return own


def _own_bias(bias: Bias | None) -> Bias | None:
    """Return the bias of one sensor, after checking it."""
    if bias is not None:
        instance(bias, "bias", Bias)
        if np.ndim(bias.range) > 0:
            raise ValueError(f"bias is that of {len(bias)} sensors; it must be that of one")
        for kind in ("east", "north"):
            if getattr(bias, kind) != 0.0 or getattr(bias, f"{kind}_sigma") != 0.0:
                raise ValueError(
                    f"bias has {kind} or {kind}_sigma; only a PositionSensor has such errors"
                )
    return bias


def _all_axes(stations: Sequence[Station], d: int) -> FloatArray | None:
    """Return the axes of all stations; None if the axes of every station are those of the frame."""
    own = [station.axes for station in stations]
    if not [axes for axes in own if axes is not None]:
        return None
    each = [np.eye(d) if station.axes is None else station.axes for station in stations]
    return np.stack(np.broadcast_arrays(*each), axis=-3)


def _axes(axes: npt.ArrayLike, place: FloatArray) -> FloatArray:
    """Return the axes of a station, after checking them."""
    array = np.array(finite(axes, "axes"))
    d = place.shape[-1]
    if array.ndim < 2 or array.shape[-2:] != (d, d):
        raise ValueError(f"axes has shape {array.shape}; it must be (..., {d}, {d})")
    if array.shape[:-2] not in {(), place.shape[:-1]}:
        raise ValueError(f"axes has shape {array.shape}, position {place.shape}; they do not fit")
    error = np.max(np.abs(array @ np.swapaxes(array, -1, -2) - np.eye(d)), initial=0.0)
    if error > _ORTHONORMAL:
        raise ValueError(f"axes is {error:.1g} off a rotation; its rows must be orthonormal")
    if np.any(np.linalg.det(array) < 0):
        raise ValueError("axes is a reflection; its rows must be east, north and up")
    return array


def _sigma(value: float, name: str, degrees: bool) -> float:
    return float(positive(angle_sigma(real(value, name), name, degrees=degrees), name))
