"""Systematic errors of sensors."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from tertia._arrays import (
    FloatArray,
    finite,
    integer,
    radians,
    real,
    require_each,
    scalar_or_array,
)
from tertia._result import Result
from tertia.sensors._kinds import ANGLES, angle_sigma

# systematic errors of a radar, and their standard deviations
KINDS = ("range", "range_gain", "azimuth", "time")
# those of a sensor that reports positions, each in the place of a radar's
PLACED = ("east", None, "north", "time")
ERRORS = tuple(f"{kind}{suffix}" for suffix in ("", "_sigma") for kind in (*KINDS, "east", "north"))
# correlation time of the slow part of systematic errors that is assumed, in seconds
DRIFT_TIME = 30_000.0
# most steps to the azimuth without a deviation, and a step in radians that ends them
_MOST_STEPS, _STILL = 30, 1e-12
# of a bias, the same for all sensors
_ALIKE = (
    "drift_share",
    "drift_time",
    "deviation_order",
    "deviation_sigma",
    "deviation_covariance",
)
_NO_DEVIATION: dict[str, Any] = {
    "deviation_order": 0,
    "deviation_sigma": 0.0,
    "deviation": np.zeros(0),
}


@dataclass(frozen=True, slots=True, eq=False, init=False, repr=False)
class Bias(Result):
    """Systematic errors of a sensor, assumed or estimated.

    The values are subtracted from the measurements. The remaining systematic error is normal with
    mean zero and standard deviation `<kind>_sigma`. A sigma of 0 means that the bias is known
    exactly, a sigma of inf that it is unknown, and None that the sigma is to be estimated.

    Parameters
    ----------
    degrees : bool
        Whether the angles and their sigmas in this call are in degrees; radians are stored.

    Attributes
    ----------
    range : float or ndarray of shape (K,)
        Bias of the ranges in metres, of one sensor or of K sensors.
    azimuth, elevation : float or ndarray of shape (K,)
        Biases of the angles in radians.
    range_gain : float or ndarray of shape (K,)
        Relative error of the ranges: a range is measured as (1 + range_gain) times the true range,
        plus `range`.
    time : float or ndarray of shape (K,)
        Reading of the sensor's clock minus the true time, in seconds.
    east, north : float or ndarray of shape (K,)
        Biases of positions that a `PositionSensor` reports, in metres.
    range_sigma, range_gain_sigma, azimuth_sigma, elevation_sigma, time_sigma, east_sigma, \
            north_sigma : float, ndarray of shape (K,), or None
        Standard deviations of these biases, in the same units.
    drift_share : float or None
        Fraction of the variance of the bias that is due to a part of the bias that varies slowly,
        between 0 and 1; the remaining part is constant. None: it is estimated if the sigma is
        estimated; otherwise it is 0.
    drift_time : float or None
        Correlation time of the slow variation in seconds, which is the time after which the
        correlation has decreased to 1/e; inf means that there is no variation. None: it is
        estimated.
    deviation_order : int
        Order of the Fourier series that describes how the azimuth bias of a sensor deviates from
        `azimuth` as a function of the direction, as on the deviation card of a compass. 0 means
        that the bias is the same in all directions.
    deviation_sigma : float
        Standard deviation of the coefficients of the first harmonic of the deviation in radians;
        for the k-th harmonic it is 1/k of this value.
    deviation : ndarray of shape (2 * deviation_order,) or (K, 2 * deviation_order)
        Coefficients of sin a, cos a, sin 2a, ... in the deviation, in radians, where a is the
        azimuth.
    deviation_covariance : ndarray of shape (1 + 2 * order, 1 + 2 * order) or None
        Covariance of the constant part and the coefficients of one sensor, as estimated by
        `calibrate`. None: the constant part and the coefficients are independent, and have the
        standard deviations above.

    Raises
    ------
    ValueError, TypeError
        If a shape is wrong, a bias is not finite, a sigma is negative or nan, or an argument has
        the wrong type.

    Examples
    --------
    >>> from tertia.sensors import Bias
    >>> bias = Bias(azimuth=[0.5, -0.25], azimuth_sigma=0.1, degrees=True)
    >>> bias[1]
    Bias(azimuth=-0.00436, azimuth_sigma=0.00175)
    """

    _rows: ClassVar = ("range", 0)
    _omitted: ClassVar = ("drift_share", "drift_time", *_NO_DEVIATION, "deviation_covariance")

    range: float | FloatArray
    range_gain: float | FloatArray
    azimuth: float | FloatArray
    elevation: float | FloatArray
    time: float | FloatArray
    east: float | FloatArray
    north: float | FloatArray
    range_sigma: float | FloatArray | None
    range_gain_sigma: float | FloatArray | None
    azimuth_sigma: float | FloatArray | None
    elevation_sigma: float | FloatArray | None
    time_sigma: float | FloatArray | None
    east_sigma: float | FloatArray | None
    north_sigma: float | FloatArray | None
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
        range_gain: npt.ArrayLike = 0.0,
        azimuth: npt.ArrayLike = 0.0,
        elevation: npt.ArrayLike = 0.0,
        time: npt.ArrayLike = 0.0,
        east: npt.ArrayLike = 0.0,
        north: npt.ArrayLike = 0.0,
        range_sigma: npt.ArrayLike | None = 0.0,
        range_gain_sigma: npt.ArrayLike | None = 0.0,
        azimuth_sigma: npt.ArrayLike | None = 0.0,
        elevation_sigma: npt.ArrayLike | None = 0.0,
        time_sigma: npt.ArrayLike | None = 0.0,
        east_sigma: npt.ArrayLike | None = 0.0,
        north_sigma: npt.ArrayLike | None = 0.0,
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
            "range_gain": range_gain,
            "azimuth": azimuth,
            "elevation": elevation,
            "time": time,
            "east": east,
            "north": north,
            "range_sigma": range_sigma,
            "range_gain_sigma": range_gain_sigma,
            "azimuth_sigma": azimuth_sigma,
            "elevation_sigma": elevation_sigma,
            "time_sigma": time_sigma,
            "east_sigma": east_sigma,
            "north_sigma": north_sigma,
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
        scale = _bias_number(real(deviation_sigma, "deviation_sigma"), "azimuth_sigma", degrees)
        if deviation is None:
            curve = np.zeros((*shape, 2 * order) if order > 0 else 0)
        else:
            curve = np.array(finite(deviation, "deviation"))
        curve = np.radians(curve) if degrees and deviation is not None else curve
        spread = deviation_covariance
        if spread is not None and shape != ():
            raise ValueError("deviation_covariance is for one sensor; the fields are of several")
        if spread is not None:
            spread = np.array(finite(spread, "deviation_covariance"))
        for key, array, size in (
            ("deviation", curve, (*shape, 2 * order) if order > 0 else (0,)),
            ("deviation_covariance", spread, (2 * order + 1,) * 2),
        ):
            if array is not None and array.shape != size:
                raise ValueError(f"{key} has shape {array.shape}; for this order it must be {size}")
        object.__setattr__(self, "deviation_order", order)
        object.__setattr__(self, "deviation_sigma", float(scale))
        object.__setattr__(self, "deviation", curve)
        object.__setattr__(self, "deviation_covariance", spread)

    @classmethod
    def _of(cls, columns: Mapping[str, FloatArray]) -> Bias:
        """Return biases and sigmas of several sensors, (K,), without checking them."""
        bias: Bias = object.__new__(cls)
        none = np.zeros(len(next(iter(columns.values()))))
        for name in Bias.__slots__:
            is_column = name not in _ALIKE and name not in _NO_DEVIATION
            own = columns.get(name, none) if is_column else _NO_DEVIATION.get(name)
            object.__setattr__(bias, name, own)
        return bias

    def at(self, azimuth: npt.ArrayLike | None = None) -> tuple[Any, Any]:
        """Return the azimuth bias of one sensor in given directions, and its standard deviation.

        Parameters
        ----------
        azimuth : array_like of shape (...), optional
            Directions in radians. If it is missing, the part of the bias that does not depend on
            the direction is returned.

        Returns
        -------
        value, sigma : float or ndarray of shape (...)
            The bias and its standard deviation in radians. After a calibration, the sigma is larger
            in directions that the calibration did not cover.

        Raises
        ------
        ValueError, TypeError
            If these are the biases of several sensors, if the sigma is None, or if directions
            cannot be radians.

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

    def correct(self, plots: Any) -> Any:
        """Return plots with these biases of range, azimuth, position and time removed.

        Parameters
        ----------
        plots : Plots
            Plots of one sensor, or of the K sensors of these biases.

        Returns
        -------
        Plots
            The corrected plots. A plot with the time t, the range r and the azimuth a now has the
            time `t - time`, the range `(r - range) / (1 + range_gain)` and the azimuth `a -
            azimuth`; `east` and `north` are subtracted from positions.

        Raises
        ------
        ValueError
            If a plot belongs to a sensor for which there is no bias.

        Examples
        --------
        >>> from tertia.sensors import Bias
        >>> from tertia.tracker import Plots
        >>> Bias(range=[0.0, 150.0]).correct(Plots([0.0], 9150.0, 1.0, sensor=1)).range
        array([9000.])
        """
        if np.ndim(self.range) > 0:
            unknown = (plots.sensor < 0) | (plots.sensor >= len(self))
            if np.any(unknown):
                sensor = plots.sensor[unknown][0]
                raise ValueError(
                    f"plots has a plot of sensor {sensor}; there are {len(self)} biases"
                )

        def own(kind: str) -> Any:
            value = getattr(self, kind)
            return value if np.ndim(value) == 0 else value[plots.sensor]

        azimuth = plots.azimuth - own("azimuth")
        if self.deviation_order > 0:
            azimuth = self._without_each(plots)
        position = plots.position
        if position is not None and (np.any(self.east) or np.any(self.north)):
            position = position - np.stack(np.broadcast_arrays(own("east"), own("north")), axis=-1)
        return replace(
            plots,
            position=position,
            time=plots.time - own("time"),
            range=(plots.range - own("range")) / (1.0 + own("range_gain")),
            azimuth=azimuth,
        )

    def _without_each(self, plots: Any) -> FloatArray:
        """Return the azimuths of plots minus the biases of their sensors."""
        azimuth: FloatArray = np.array(plots.azimuth, dtype=np.float64)
        if np.ndim(self.range) == 0:
            return self._without(azimuth)
        for k in np.unique(plots.sensor):
            own = plots.sensor == k
            azimuth[own] = self[k]._without(azimuth[own])
        return azimuth

    def _without(self, measured: FloatArray) -> FloatArray:
        """Return measured azimuths minus the bias, which depends on the azimuth without it."""
        azimuth = measured - self.azimuth
        for _ in range(_MOST_STEPS):
            last, azimuth = azimuth, measured - self.at(azimuth)[0]
            if not np.any(np.abs(azimuth - last) > _STILL):
                break
        return azimuth

    def save(self, path: str | Path) -> None:
        """Write the bias to a JSON file."""
        fields = {name: getattr(self, name) for name in Bias.__slots__}
        saved = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in fields.items()}
        Path(path).write_text(json.dumps(saved), encoding="utf-8")

    @classmethod
    def load(cls, path: str | Path) -> Bias:
        """Read a bias from a file that `save` has written."""
        return cls(**json.loads(Path(path).read_text(encoding="utf-8")))

    def __bool__(self) -> bool:
        """Return True, so that `if bias:` asks whether there is one, not how large it is."""
        return True

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
            is_alike = value is None or name in _ALIKE or (name == "deviation" and value.ndim == 1)
            own[name] = value if is_alike else value[sensor]
        return Bias(**own)

    def __repr__(self) -> str:
        """Show the fields that are not zero."""
        shown = []
        for name in Bias.__slots__:
            value = getattr(self, name)
            if value is None:
                if name not in _ALIKE and name != "deviation":
                    shown.append(f"{name}=None")
            elif name == "deviation_covariance":
                continue
            elif np.any(value):
                listed = np.array2string(np.asarray(value), precision=3, separator=", ")
                shown.append(
                    f"{name}={value:.3g}" if isinstance(value, float) else f"{name}={listed}"
                )
        return f"Bias({', '.join(shown)})"


def _bias_number(value: npt.ArrayLike, name: str, degrees: bool) -> FloatArray:
    """Return biases, or their standard deviations, after checking their domain."""
    if not name.endswith("_sigma"):
        known = radians(value, name, degrees=degrees) if name in ANGLES else value
        return finite(known, name)
    array = angle_sigma(value, name, degrees=degrees)
    require_each(array, array >= 0, name, "0, positive or inf")
    return array


# limits of the systematic errors of radars: EUROCONTROL's standard for surveillance, 1997
RADAR_LIMITS = Bias(
    range_sigma=100.0,
    range_gain_sigma=1 / 1852,
    azimuth_sigma=float(np.radians(0.1)),
    time_sigma=0.1,
    drift_share=1.0,
    drift_time=DRIFT_TIME,
)
