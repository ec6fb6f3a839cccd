"""Sensors: positions, measurements and errors of stations and radars.

Positions are local east, north and up in metres; azimuths and elevations are radians, azimuths
clockwise from north.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from tertia._arrays import (
    FloatArray,
    IntArray,
    finite,
    instance,
    integer,
    positive,
    probability,
    radians,
    real,
    require_each,
    samples,
    scalar_or_array,
    sequence_of,
)

__all__ = ["Bias", "ByKind", "Kind", "Radar", "Station"]

Kind: TypeAlias = Literal["range", "azimuth", "elevation", "range_difference", "arrival_time"]

KINDS: tuple[Kind, ...] = ("range", "azimuth", "elevation", "range_difference", "arrival_time")
# what one station measures alone of the position
STATION_KINDS = KINDS[:3]
ANGLES: tuple[Kind, ...] = ("azimuth", "elevation")
# largest element by which axes times their transpose may differ from the identity
_ORTHONORMAL = 1e-9
# of a bias, the same for all sensors
_ALIKE = (
    "drift_share",
    "drift_time",
    "deviation_order",
    "deviation_sigma",
    "deviation",
    "deviation_covariance",
)


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
        East, north and up in metres; with leading axes where the station moves.
    range_sigma : float or None
        Standard deviation of its ranges in metres; None if it is unknown, or none are measured.
    azimuth_sigma, elevation_sigma : float or None
        Standard deviations of its angles in radians.
    arrival_time_sigma : float or None
        Standard deviation of its times of arrival in seconds.
    position_sigma : float
        Standard deviation of each coordinate of its position, as surveyed, in metres. It is an
        error of all its measurements, and the same one at all times.
    bias : Bias or None
        Its systematic errors; None if they are not known.
    name : str or None
        Its label in plots.
    axes : ndarray of shape (..., D, D) or None
        The station's own east, north and up as rows, in the coordinates of the frame: its azimuths
        and elevations refer to them. None: the axes of the frame. They differ where the earth
        curves between the station and the origin (see `tertia.geo`).

    Raises
    ------
    ValueError, TypeError
        A wrong shape, a number outside its domain, axes that are not a rotation, or an argument of
        the wrong type.

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
        place = finite(position, "position")
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
        if bias is not None:
            instance(bias, "bias", Bias)
            if np.ndim(bias.range) > 0:
                raise ValueError(f"bias is that of {len(bias)} sensors; it must be that of one")
        object.__setattr__(self, "bias", bias)
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "axes", None if axes is None else _axes(axes, place))
        for key, sigma in sigmas.items():
            object.__setattr__(self, key, None if sigma is None else _sigma(sigma, key, degrees))


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Radar:
    """A radar: its position, scan period and accuracy.

    Parameters
    ----------
    degrees : bool
        Whether `azimuth_sigma` is given in degrees; radians are stored.

    Attributes
    ----------
    position : ndarray of shape (2,) or (3,)
        East, north and, if known, up in metres.
    range_sigma : float
        Standard deviation of its ranges in metres.
    azimuth_sigma : float
        Standard deviation of its azimuths in radians.
    scan_period : float
        Seconds per rotation of the antenna.
    max_range : float
        Largest range of detections in metres.
    detection_probability : float
        Probability that a target within range is detected in a scan.
    name : str or None
        Its label in plots and reports.

    Raises
    ------
    ValueError, TypeError
        A wrong shape, a number outside its domain, or an argument of the wrong type.

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
    name: str | None

    def __init__(
        self,
        position: npt.ArrayLike = (0.0, 0.0),
        *,
        range_sigma: float,
        azimuth_sigma: float,
        scan_period: float,
        max_range: float = np.inf,
        detection_probability: float = 0.9,
        name: str | None = None,
        degrees: bool = False,
    ) -> None:
        place = finite(position, "position")
        if place.shape not in {(2,), (3,)}:
            raise ValueError(f"position has shape {place.shape}; it must be (2,) or (3,)")
        detected = probability(detection_probability, "detection_probability")
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
        object.__setattr__(self, "position", place)
        object.__setattr__(self, "max_range", limit)
        object.__setattr__(self, "detection_probability", detected)
        object.__setattr__(self, "name", name)


@dataclass(frozen=True, slots=True, eq=False, init=False, repr=False)
class Bias:
    """Systematic errors of a sensor, assumed or estimated.

    After its bias is subtracted, a measurement has only the systematic error of the bias, which is
    normal with the standard deviation `<kind>_sigma`. A sigma of 0 means that the bias is known,
    inf that it is unknown, and None that it is to be estimated.

    Parameters
    ----------
    degrees : bool
        Whether the angles and their sigmas are given in degrees; radians are stored.

    Attributes
    ----------
    range : float or ndarray of shape (K,)
        Metres, of one sensor or of K.
    azimuth, elevation : float or ndarray of shape (K,)
        Radians.
    time : float or ndarray of shape (K,)
        Reading of the sensor's clock less the true time, in seconds.
    range_sigma, azimuth_sigma, elevation_sigma, time_sigma : float, ndarray of shape (K,), or None
        Their standard deviations.
    drift_share : float or None
        Share of the variance that changes slowly, between 0 and 1; the rest is constant. None: to
        be estimated where the sigma is, else 0.
    drift_time : float or None
        Correlation time of this change in seconds: the correlation falls to 1/e; inf is no change.
        None: to be estimated.
    deviation_order : int
        Order of the Fourier series in the azimuth by which the azimuth bias of one sensor deviates
        from `azimuth`, as on a compass card; 0: none.
    deviation_sigma : float
        Standard deviation of its first harmonics; those of the k-th are 1/k of it.
    deviation : ndarray of shape (2 * deviation_order,)
        Its coefficients: of sin a, cos a, sin 2a, ...
    deviation_covariance : ndarray of shape (1 + 2 * order, 1 + 2 * order) or None
        Covariance of the constant part and the coefficients, as `calibrate` finds it; None: they
        are independent, with the standard deviations above.

    Raises
    ------
    ValueError, TypeError
        A wrong shape, a bias that is not finite, a sigma that is negative or nan, or an argument of
        the wrong type.

    Examples
    --------
    >>> from tertia.sensors import Bias
    >>> bias = Bias(azimuth=[0.5, -0.25], azimuth_sigma=0.1, degrees=True)
    >>> bias[1]
    Bias(azimuth=-0.00436, azimuth_sigma=0.00175)
    """

    range: float | FloatArray
    azimuth: float | FloatArray
    elevation: float | FloatArray
    time: float | FloatArray
    range_sigma: float | FloatArray | None
    azimuth_sigma: float | FloatArray | None
    elevation_sigma: float | FloatArray | None
    time_sigma: float | FloatArray | None
    drift_share: float | None
    drift_time: float | None
    deviation_order: int
    deviation_sigma: float
    deviation: FloatArray
    deviation_covariance: FloatArray | None

    def __init__(
        self,
        *,
        range: npt.ArrayLike = 0.0,  # noqa: A002  # its name everywhere
        azimuth: npt.ArrayLike = 0.0,
        elevation: npt.ArrayLike = 0.0,
        time: npt.ArrayLike = 0.0,
        range_sigma: npt.ArrayLike | None = 0.0,
        azimuth_sigma: npt.ArrayLike | None = 0.0,
        elevation_sigma: npt.ArrayLike | None = 0.0,
        time_sigma: npt.ArrayLike | None = 0.0,
        drift_share: float | None = None,
        drift_time: float | None = None,
        deviation_order: int = 0,
        deviation_sigma: float = 0.0,
        deviation: npt.ArrayLike | None = None,
        deviation_covariance: npt.ArrayLike | None = None,
        degrees: bool = False,
    ) -> None:
        if drift_share is not None and not 0.0 <= real(drift_share, "drift_share") <= 1.0:
            raise ValueError(f"drift_share is {drift_share}; it must be between 0 and 1")
        if drift_time is not None and not real(drift_time, "drift_time") > 0.0:
            raise ValueError(f"drift_time is {drift_time}; it must be positive")
        object.__setattr__(self, "drift_share", None if drift_share is None else float(drift_share))
        object.__setattr__(self, "drift_time", None if drift_time is None else float(drift_time))
        given = {
            "range": range,
            "azimuth": azimuth,
            "elevation": elevation,
            "time": time,
            "range_sigma": range_sigma,
            "azimuth_sigma": azimuth_sigma,
            "elevation_sigma": elevation_sigma,
            "time_sigma": time_sigma,
        }
        arrays = {
            name: _bias_number(value, name, degrees)
            for name, value in given.items()
            if value is not None
        }
        try:
            shape = np.broadcast_shapes(*(array.shape for array in arrays.values()))
        except ValueError:
            shape = (0, 0)
        if len(shape) > 1:
            shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
            raise ValueError(f"the fields have shapes {shapes}; each must be () or (K,)")
        for name in given:
            column = np.array(np.broadcast_to(arrays[name], shape)) if name in arrays else None
            object.__setattr__(self, name, None if column is None else scalar_or_array(column))
        order = integer(deviation_order, "deviation_order", 0)
        if order > 0 and shape != ():
            raise ValueError("deviation_order is that of one sensor; the fields have one for each")
        scale = _bias_number(real(deviation_sigma, "deviation_sigma"), "azimuth_sigma", degrees)
        curve = np.zeros(2 * order) if deviation is None else finite(deviation, "deviation")
        curve = np.radians(curve) if degrees and deviation is not None else curve
        spread = deviation_covariance
        if spread is not None:
            spread = finite(spread, "deviation_covariance")
        for key, array, size in (
            ("deviation", curve, (2 * order,)),
            ("deviation_covariance", spread, (2 * order + 1,) * 2),
        ):
            if array is not None and array.shape != size:
                raise ValueError(f"{key} has shape {array.shape}; for this order it must be {size}")
        object.__setattr__(self, "deviation_order", order)
        object.__setattr__(self, "deviation_sigma", float(scale))
        object.__setattr__(self, "deviation", curve)
        object.__setattr__(self, "deviation_covariance", spread)

    def at(self, azimuth: npt.ArrayLike | None = None) -> tuple[Any, Any]:
        """Return the azimuth bias of one sensor in a direction, and its standard deviation.

        Parameters
        ----------
        azimuth : array_like of shape (...), optional
            Directions in radians; without, the part that does not depend on them.

        Returns
        -------
        value, sigma : float or ndarray of shape (...)
            Radians. The sigma grows by itself in directions that a calibration has not seen.

        Raises
        ------
        ValueError, TypeError
            Biases of several sensors, a sigma of None, or directions that are no radians.

        Examples
        --------
        >>> from tertia.sensors import Bias
        >>> bias = Bias(azimuth=0.01, deviation_order=1, deviation=[0.02, 0.0])
        >>> round(bias.at(1.5707963)[0], 6)
        0.03
        """
        if np.ndim(self.range) > 0:
            raise ValueError("the bias is that of several sensors; take one of them, as bias[0]")
        if self.azimuth_sigma is None:
            raise ValueError("azimuth_sigma is None; it must be known")
        own = float(self.azimuth_sigma) ** 2
        if azimuth is None or self.deviation_order == 0:
            shape = () if azimuth is None else np.shape(azimuth)
            value, sigma = (np.full(shape, v) for v in (self.azimuth, self.azimuth_sigma))
            return scalar_or_array(value), scalar_or_array(sigma)
        angles = radians(azimuth, "azimuth")[..., np.newaxis] * np.arange(
            1, self.deviation_order + 1
        )
        terms = np.stack([np.sin(angles), np.cos(angles)], axis=-1).reshape(*angles.shape[:-1], -1)
        value = self.azimuth + terms @ self.deviation
        if self.deviation_covariance is None:
            each = np.repeat(self.deviation_sigma / np.arange(1, self.deviation_order + 1), 2)
            variance = own + terms**2 @ each**2
        else:
            rows = np.concatenate([np.ones((*terms.shape[:-1], 1)), terms], axis=-1)
            within = np.sum(rows @ self.deviation_covariance * rows, axis=-1)
            # the drift is not part of the covariance of the coefficients
            variance = within + max(own - self.deviation_covariance[0, 0], 0.0)
        return scalar_or_array(value), scalar_or_array(np.sqrt(variance))

    def save(self, path: str | Path) -> None:
        """Write the bias to a file, as JSON."""
        fields = {name: getattr(self, name) for name in Bias.__slots__}
        saved = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in fields.items()}
        Path(path).write_text(json.dumps(saved), encoding="utf-8")

    @classmethod
    def load(cls, path: str | Path) -> Bias:
        """Return the bias that `save` has written."""
        return cls(**json.loads(Path(path).read_text(encoding="utf-8")))

    def __len__(self) -> int:
        """Return the number of sensors."""
        if isinstance(self.range, float):
            raise TypeError("the bias is that of one sensor")
        return len(self.range)

    def __getitem__(self, sensor: int) -> Bias:
        """Return the bias of one of the sensors."""
        len(self)
        own: dict[str, Any] = {}
        for name in Bias.__slots__:
            value = getattr(self, name)
            own[name] = value if value is None or name in _ALIKE else value[sensor]
        return Bias(**own)

    def __repr__(self) -> str:
        """Show what is not zero."""
        shown = []
        for name in Bias.__slots__:
            value = getattr(self, name)
            if value is None:
                if name not in _ALIKE:
                    shown.append(f"{name}=None")
            elif name == "deviation_covariance":
                continue
            elif np.any(value):
                listed = np.array2string(np.asarray(value), precision=3, separator=", ")
                shown.append(
                    f"{name}={value:.3g}" if isinstance(value, float) else f"{name}={listed}"
                )
        return f"Bias({', '.join(shown)})"


@dataclass(frozen=True, slots=True, eq=False)
class ByKind:
    """One array for each kind of measurement; None for kinds that were not measured.

    Attributes
    ----------
    range, azimuth, elevation, arrival_time : ndarray of shape (..., K) or None
        One element for each station.
    range_difference : ndarray of shape (..., K - 1) or None
        One element for each station but the first.
    """

    range: npt.NDArray[Any] | None = None
    azimuth: npt.NDArray[Any] | None = None
    elevation: npt.NDArray[Any] | None = None
    range_difference: npt.NDArray[Any] | None = None
    arrival_time: npt.NDArray[Any] | None = None

    @property
    def count(self) -> int | IntArray:
        """Number of nonzero elements of all kinds, such as outliers, of shape (...)."""
        marks = [getattr(self, field.name) for field in fields(self)]
        present = [mark for mark in marks if mark is not None]
        total: int | IntArray = scalar_or_array(
            np.asarray(sum(np.count_nonzero(mark, axis=-1) for mark in present))
        )
        return total


def stack_stations(
    stations: Sequence[Station] | npt.ArrayLike,
) -> tuple[FloatArray, FloatArray | None, dict[str, FloatArray]]:
    """Return positions, (..., K, D), axes, (..., K, D, D), and the stations' own sigmas, (K,)."""
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
        places = np.stack(np.broadcast_arrays(*positions), axis=-2)
    except ValueError:
        shapes = ", ".join(str(position.shape) for position in positions)
        raise ValueError(f"the positions of the stations have shapes {shapes}") from None
    sigmas = {
        str(kind): np.array(
            [np.nan if (s := getattr(one, f"{kind}_sigma")) is None else s for one in known],
            dtype=np.float64,
        )
        for kind in (*STATION_KINDS, "arrival_time")
    }
    return places, _all_axes(known, places.shape[-1]), sigmas


def survey_sigmas(stations: Sequence[Station] | npt.ArrayLike) -> FloatArray | None:
    """Return the standard deviations of the stations' positions, (K,); None where all are exact."""
    if not isinstance(stations, Sequence) or not isinstance(next(iter(stations), None), Station):
        return None
    sigmas = np.array([one.position_sigma for one in sequence_of(stations, Station, "stations")])
    return sigmas if np.any(sigmas) else None


def by_kind(array: npt.NDArray[Any], kinds: Sequence[Kind]) -> ByKind:
    """Return the rows (..., 5, K) of the kinds that were measured."""
    return ByKind(
        *(
            array[..., at, int(kind == "range_difference") :] if kind in kinds else None
            for at, kind in enumerate(KINDS)
        )
    )


def require_dimension(array: FloatArray, name: str, shape: str) -> None:
    """Fail unless the last axis is east, north and perhaps up."""
    if array.ndim < 1 or array.shape[-1] not in {2, 3}:
        raise ValueError(f"{name} has shape {array.shape}; it must be {shape}")


def _all_axes(stations: Sequence[Station], d: int) -> FloatArray | None:
    """Return the axes of all stations, None if all are those of the frame."""
    if all(station.axes is None for station in stations):
        return None
    each = [np.eye(d) if station.axes is None else station.axes for station in stations]
    return np.stack(np.broadcast_arrays(*each), axis=-3)


def _axes(axes: npt.ArrayLike, place: FloatArray) -> FloatArray:
    """Return axes of a station, checked."""
    array = finite(axes, "axes")
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


def angle_sigma(value: npt.ArrayLike, name: str, *, degrees: bool) -> FloatArray:
    """Return standard deviations; those of angles are in radians."""
    if not name.startswith(ANGLES):
        return samples(value, name)
    return radians(value, name, degrees=degrees, is_sigma=True)


def _sigma(value: float, name: str, degrees: bool) -> float:
    return float(positive(angle_sigma(real(value, name), name, degrees=degrees), name))


def _bias_number(value: npt.ArrayLike, name: str, degrees: bool) -> FloatArray:
    """Return biases, or the standard deviations of biases, within their domain."""
    if not name.endswith("_sigma"):
        known = radians(value, name, degrees=degrees) if name in ANGLES else value
        return finite(known, name)
    array = angle_sigma(value, name, degrees=degrees)
    require_each(array, array >= 0, name, "0, positive or inf")
    return array
