"""Smoothing of flights of the library traffic, with standard deviations.

`smooth` replaces the positions and altitudes of a `traffic.core.Flight` by smoothed values, and
ground speed, track and vertical rate by the values of the smoothed path. Needs the extra `traffic`
(traffic, pyproj).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd
from traffic.core import Flight

from tertia import smoothing
from tertia._arrays import BoolArray, FloatArray, positive_number
from tertia._units import FOOT, KNOT
from tertia.geo import LocalFrame
from tertia.kalman import fit_noise

__all__ = ["smooth"]

_RADIUS = 6_371_000.0
# metres per second: vertical rates are in feet per minute
_FOOT_PER_MINUTE = FOOT / 60.0
# sum of squared normalised residuals that noise alone does not reach in a flight
_GATE = 36.0
# the same for one axis, in sigmas
_SINGLE = 4.0
_MOST_PASSES = 10
_FEWEST = 10
# this many rows determine the noise to a few percent
_STRETCH, _STRETCHES = 500, 4


def smooth(
    flight: Flight,
    *,
    position_sigma: float | None = None,
    altitude_sigma: float | None = None,
) -> Flight:
    """Smooth the path of a flight, excluding outliers and filling gaps.

    Parameters
    ----------
    flight : traffic.core.Flight
        A flight with `timestamp`, `latitude` and `longitude` and, if known, `altitude`, in the
        units of traffic: degrees, feet, knots, feet per minute. Values may be missing anywhere.
    position_sigma : float, optional
        Standard deviation of the positions in metres, the same east and north. By default it is
        estimated.
    altitude_sigma : float, optional
        Standard deviation of the altitudes in feet. By default it is estimated.

    Returns
    -------
    traffic.core.Flight
        The same rows, sorted by time, with `latitude`, `longitude`, `groundspeed`, `track` and, if
        altitudes are given, `altitude` and `vertical_rate` of the smoothed path, also where values
        were missing; nan where they are not determined. In addition, `groundspeed_sigma`,
        `track_sigma`, `altitude_sigma` and `vertical_rate_sigma` in the same units;
        `position_sigma_m`, `velocity_sigma_m_s` and `position_velocity_covariance_m2_s` of each
        horizontal axis (the errors to the east and to the north have equal sigmas and are
        independent); `altitude_vertical_rate_covariance` in square feet per minute; and
        `position_outlier` and `altitude_outlier`, which mark the values that were left out.

    Raises
    ------
    ValueError, TypeError
        If there are fewer than 10 positions, a sigma is not positive, the noise cannot be
        estimated, or an argument has the wrong type.

    Notes
    -----
    `tertia.smoothing.smooth` smooths the positions on the ellipsoid in three dimensions, so that
    flights may be long. Altitudes are smoothed separately. Rows farther than 6 sigma from the path
    through the other rows are left out; this is repeated until no more rows are found. Reported
    speeds are not used, so that they can serve as a check.

    One jerk is estimated for the whole flight, although jerk occurs mainly at the ends of turns.
    The errors are therefore larger than the sigmas there, and smaller in straight flight. In a
    flight of seven minutes with one turn, sampled every second, the rms errors were 0.9 sigma for
    position, 0.7 for ground speed and 1.6 for track.

    Examples
    --------
    >>> import pandas as pd
    >>> from tertia.interop.traffic import smooth
    >>> time = pd.date_range("2024-01-01", periods=60, freq="s", tz="UTC")
    >>> data = {"timestamp": time, "latitude": 52.0, "longitude": [4 + 2e-3 * k for k in range(60)]}
    >>> data |= {"callsign": "TEST", "icao24": "abcdef"}
    >>> path = smooth(Flight(pd.DataFrame(data)), position_sigma=10.0)
    >>> round(float(path.data["groundspeed"].iloc[30]))
    267
    """
    data = flight.data.sort_values("timestamp", kind="stable").reset_index(drop=True)
    moments = data["timestamp"]
    time = (moments - moments.iloc[0]).dt.total_seconds().to_numpy(dtype=np.float64)
    columns: dict[str, FloatArray | BoolArray] = {}
    height = np.zeros(len(data))
    if "altitude" in data.columns:
        columns, height = _vertical(time, _numbers(data, "altitude"), altitude_sigma)
    columns |= _horizontal(
        time, _numbers(data, "latitude"), _numbers(data, "longitude"), height, position_sigma
    )
    return Flight(data.assign(**columns))


def _numbers(data: pd.DataFrame, name: str) -> FloatArray:
    values: FloatArray = data[name].to_numpy(dtype=np.float64, na_value=np.nan)
    return values


def _vertical(
    time: FloatArray, altitude: FloatArray, sigma: float | None
) -> tuple[dict[str, FloatArray | BoolArray], FloatArray]:
    """Return the columns of the vertical motion, and the heights in metres."""
    y = altitude[:, np.newaxis] * FOOT
    known = None if sigma is None else positive_number(sigma, "altitude_sigma") * FOOT
    found, outlier = _robust(time, y, y, known, "altitude")
    value, deviation = found.mean / FOOT, found.sigma / FOOT
    covariance = found.covariance[:, 0, 1] / (FOOT * _FOOT_PER_MINUTE)
    columns: dict[str, FloatArray | BoolArray] = {
        "altitude": value[:, 0],
        "altitude_sigma": _known(deviation[:, 0]),
        "vertical_rate": value[:, 1] * 60.0,
        "vertical_rate_sigma": _known(deviation[:, 1] * 60.0),
        "altitude_vertical_rate_covariance": np.where(
            np.isfinite(deviation[:, 1]), covariance, np.nan
        ),
        "altitude_outlier": outlier,
    }
    return columns, np.nan_to_num(found.mean[:, 0])


def _horizontal(
    time: FloatArray,
    latitude: FloatArray,
    longitude: FloatArray,
    height: FloatArray,
    sigma: float | None,
) -> dict[str, FloatArray | BoolArray]:
    there = np.flatnonzero(~np.isnan(latitude + longitude))
    if len(there) < _FEWEST:
        raise ValueError(f"the flight has {len(there)} positions; it must have at least {_FEWEST}")
    middle = there[len(there) // 2]
    frame = LocalFrame(latitude[middle], longitude[middle])
    places = frame.to_local(latitude, longitude)
    known = None if sigma is None else positive_number(sigma, "position_sigma")
    # the vertical axis has no noise here, so noise and motion are not estimated from it
    found, outlier = _robust(time, places, places[:, :2], known, "position")
    north, east, _ = (np.asarray(value) for value in frame.to_geodetic(found.position))
    velocity = np.einsum("nij,nj->ni", frame.axes(north, east), found.velocity)[:, :2]
    # speed along the surface of the earth; at the height of the aircraft, the path is longer
    velocity *= (1.0 + height / _RADIUS)[:, np.newaxis]
    speed = np.hypot(*velocity.T)
    position_sigma, velocity_sigma = _known(found.sigma[:, 0]), _known(found.sigma[:, 3])
    with np.errstate(divide="ignore"):
        track_sigma = np.degrees(velocity_sigma / speed)
    return {
        "latitude": north,
        "longitude": east,
        "groundspeed": speed / KNOT,
        "track": np.degrees(np.arctan2(*velocity.T)) % 360.0,
        "groundspeed_sigma": velocity_sigma / KNOT,
        "track_sigma": np.minimum(track_sigma, 180.0),
        "position_sigma_m": position_sigma,
        "velocity_sigma_m_s": velocity_sigma,
        "position_velocity_covariance_m2_s": np.where(
            np.isnan(velocity_sigma), np.nan, found.covariance[:, 0, 3]
        ),
        "position_outlier": outlier,
    }


def _robust(
    time: FloatArray, y: FloatArray, fitted: FloatArray, sigma: float | None, name: str
) -> tuple[smoothing.SmoothedPositions, BoolArray]:
    """Smooth all axes of y without outliers; noise and jerk are those of the axes `fitted`."""
    far = _coarse(y)
    variance = _variance(time, np.where(far[:, np.newaxis], np.nan, fitted), sigma, name)
    missing = np.isnan(y).any(axis=1)
    plain: dict[str, Any] = {"correlation_time": 0.0, "robust": False}
    for _ in range(_MOST_PASSES):
        left = (far | missing)[:, np.newaxis]
        jerk = smoothing.smooth(np.where(left, np.nan, fitted), variance, time=time, **plain).jerk
        found = smoothing.smooth(np.where(left, np.nan, y), variance, time=time, jerk=jerk, **plain)
        again = _far(y, found, variance, far)
        if np.array_equal(again, far):
            break
        far = again
    return found, far


def _coarse(y: FloatArray) -> BoolArray:
    """Return for each row whether it is far from the median of its neighbours (decoding errors)."""
    far = np.zeros(len(y), dtype=bool)
    there = np.flatnonzero(~np.isnan(y).any(axis=1))
    if len(there) < _FEWEST:
        return far
    half = _FEWEST // 2
    near = np.clip(
        np.arange(len(there))[:, np.newaxis] + np.arange(-half, half + 1), 0, len(there) - 1
    )
    off = y[there] - np.median(y[there][near], axis=1)
    distance = np.sqrt(np.sum(off**2, axis=1))
    typical = np.median(distance[near], axis=1)
    # turns and gaps of a few rows do not reach this limit
    far[there] = distance > 30.0 * typical + 1000.0
    return far


def _variance(time: FloatArray, y: FloatArray, sigma: float | None, name: str) -> float:
    if sigma is not None:
        return sigma**2
    starts = np.unique(np.linspace(0, max(0, len(y) - _STRETCH), _STRETCHES).astype(np.int64))
    rows = starts[:, np.newaxis] + np.arange(min(_STRETCH, len(y)))
    try:
        fits = [fit_noise(axis[rows], time=time[rows], outlier_gate=_SINGLE) for axis in y.T]
    except ValueError as error:
        raise ValueError(f"{name}: {error}; give {name}_sigma") from None
    return float(np.mean([fit.measurement_sigma**2 for fit in fits]))


def _far(
    y: FloatArray, found: smoothing.SmoothedPositions, variance: float, left_out: BoolArray
) -> BoolArray:
    """Return which rows are far from the path through all other rows."""
    off = y - found.position
    uncertain = np.diagonal(found.position_covariance, axis1=-2, axis2=-1)
    # the error of a row is independent of the path only if the row was left out
    spread = np.where(left_out[:, np.newaxis], variance + uncertain, variance - uncertain)
    with np.errstate(invalid="ignore"):
        squares = np.sum(off**2 / np.maximum(spread, 1e-6 * variance), axis=1)
        far: BoolArray = squares > _GATE
    return far


def _known(sigma: FloatArray) -> FloatArray:
    """Return standard deviations, with nan instead of infinite ones."""
    return np.where(np.isfinite(sigma), sigma, math.nan)
