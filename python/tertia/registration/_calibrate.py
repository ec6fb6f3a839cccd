"""Estimation of the bias of one sensor from targets whose positions are known."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import FloatArray, instance, instants_of, integer, points, radians, squarable
from tertia.sensors import Bias, Station
from tertia.sensors._kinds import ANGLES, STATION_KINDS

# largest order of the series that is tried, and that may be given
_MOST, _LARGEST = 8, 180


def calibrate(
    station: Station,
    time: npt.ArrayLike,
    position: npt.ArrayLike,
    *,
    range: npt.ArrayLike | None = None,  # noqa: A002  # that is what it is
    azimuth: npt.ArrayLike | None = None,
    elevation: npt.ArrayLike | None = None,
    deviation_order: int | None = None,
    degrees: bool = False,
) -> Bias:
    """Estimate the bias of a sensor from a calibration run, with known target positions.

    Parameters
    ----------
    station : Station
        The sensor, with a standard deviation for each kind of measurement that it made.
    time : array_like of shape (N,)
        Times in seconds, in non-decreasing order.
    position : array_like of shape (N, D)
        Known positions of the target in metres.
    range, azimuth, elevation : array_like of shape (N,), optional
        Measurements of the sensor in metres and radians; nan where one is missing.
    deviation_order : int, optional
        Order of the Fourier series that describes how the azimuth bias depends on the azimuth. By
        default it is the likeliest order up to 8; it may be up to 180. If the run covers less than
        120 degrees of azimuth, the order is limited to 1.
    degrees : bool
        Whether the angles in this call are in degrees.

    Returns
    -------
    Bias
        The bias that the sensor adds to its measurements, with its uncertainty; it can be passed to
        `Station(bias=...)`. In directions that the run does not cover, the sigma that `Bias.at`
        returns is larger.

    Raises
    ------
    ValueError, TypeError
        If a shape is wrong, nothing was measured, a standard deviation is missing, a number is
        outside its domain, or an argument has the wrong type.

    Warns
    -----
    UserWarning
        If the errors vary with the direction in a way that the series does not describe. The size
        of the part that is not described is included in the sigmas of the bias.

    Notes
    -----
    The model of the measured minus the true value is y = c + Σ (a_k sin k α + b_k cos k α) + g(t) +
    e, with the azimuth α. Here c is a constant with a wide prior distribution, the k-th
    coefficients have the prior distribution N(0, (s/k)²), g is a Gauss-Markov process, and the
    errors e have the stated standard deviation or a larger one. The variances and the correlation
    time are integrated out numerically: results for the points of a grid are averaged with their
    likelihoods, which a Kalman filter computes, as weights. Outliers have little influence, because
    measurements are weighted by Tukey's function. The order is that of the largest likelihood, for
    no drift or for the drift that was found. The cost is O(N log N).

    The series may not describe the deviation, for example near a mast. The residuals in
    neighbouring directions then have products with a positive mean. If this mean, less that of the
    drift, is significant (at 1 %), it is the variance of the part that is not described, and is
    added to that of the bias.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.registration import calibrate
    >>> from tertia.sensors import Station
    >>> finder = Station([0.0, 0.0], azimuth_sigma=0.02)
    >>> direction = np.linspace(0, 2 * np.pi, 200)
    >>> way = 1000 * np.column_stack([np.sin(direction), np.cos(direction)])
    >>> noise = 0.02 * np.random.default_rng(1).standard_normal(200)
    >>> seen = direction + 0.1 * np.sin(direction) + noise
    >>> bias = calibrate(finder, np.arange(200.0), way, azimuth=seen, deviation_order=1)
    >>> [round(float(v), 2) for v in bias.at(np.pi / 2)]
    [0.1, 0.0]
    """
    instance(station, "station", Station)
    instants = instants_of(time)
    place = points(position, "position")
    if place.shape != (instants.size, station.position.shape[-1]):
        raise ValueError(
            f"position has shape {place.shape}; it must be "
            f"({instants.size}, {station.position.shape[-1]})"
        )
    if deviation_order is not None:
        deviation_order = _order(deviation_order)
    expected = _expected(station, place)
    fields: dict[str, Any] = {}
    drifts = []
    for kind, values in zip(STATION_KINDS, (range, azimuth, elevation), strict=True):
        if values is None:
            continue
        if kind not in expected:
            raise ValueError(f"{kind} needs a station with three coordinates")
        known = radians(values, kind, degrees=degrees) if kind in ANGLES else values
        known = squarable(known, kind)
        if known.shape != instants.shape:
            raise ValueError(f"{kind} has shape {known.shape}; it must be {instants.shape}")
        sigma = getattr(station, f"{kind}_sigma")
        if sigma is None:
            raise ValueError(f"{kind}_sigma of the station is missing")
        there = ~np.isnan(known)
        if not there.any():
            raise ValueError(f"{kind} has no measurement")
        off = (known - expected[kind])[there]
        if kind in ANGLES:
            off = (off + np.pi) % (2 * np.pi) - np.pi
        direction = expected["azimuth"][there]
        orders = _orders(deviation_order, direction) if kind == "azimuth" else (0, 0)
        mean, covariance, drift, lasts, rest = _core.calibrate(
            instants[there], off, direction, sigma, orders
        )
        own, known_to = len(mean) // 2, covariance[0, 0] + rest
        if rest > 0:
            _warn(kind, np.sqrt(rest), own)
        fields[kind] = mean[0]
        fields[f"{kind}_sigma"] = float(np.sqrt(known_to + drift))
        drifts.append((drift, drift + known_to, lasts))
        if own > 0:
            scale = float(np.sqrt(np.mean(mean[1:] ** 2 + np.diag(covariance)[1:])))
            fields |= {
                "deviation_order": own,
                "deviation_sigma": scale,
                "deviation": mean[1:],
                "deviation_covariance": covariance,
            }
    if not drifts:
        raise ValueError("nothing was measured; give range, azimuth or elevation")
    # one share and one time for all kinds: those of the kind that drifts most
    drift, whole, lasts = max(drifts, key=lambda one: one[0] / one[1])
    return Bias(**fields, drift_share=drift / whole, drift_time=lasts)


def _expected(station: Station, place: FloatArray) -> dict[str, FloatArray]:
    offset = place - station.position
    if station.axes is not None:
        offset = (station.axes @ offset[..., np.newaxis])[..., 0]
    level = np.hypot(offset[:, 0], offset[:, 1])
    expected = {
        "range": np.linalg.norm(offset, axis=-1),
        "azimuth": np.arctan2(offset[:, 0], offset[:, 1]),
    }
    if offset.shape[-1] == 3:
        expected["elevation"] = np.arctan2(offset[:, 2], level)
    return expected


def _order(value: int) -> int:
    """Return the given order of the series, after checking it."""
    order = integer(value, "deviation_order", 0)
    if order > _LARGEST:
        raise ValueError(f"deviation_order is {order}; it must be at most {_LARGEST}")
    return order


def _orders(order: int | None, direction: FloatArray) -> tuple[int, int]:
    """Return the smallest and the largest order of the series."""
    most = _MOST if order is None else order
    if _arc(direction) < np.radians(120):
        most = min(most, 1)
    return 0 if order is None else most, most


def _warn(kind: str, size: float, order: int) -> None:
    """Warn that a bias depends on the direction in a way that is not described."""
    angle = kind in ANGLES
    what = f"{np.degrees(size):.3g} degrees" if angle else f"{size:.3g} m"
    beyond = f" that a series of order {order} does not describe" if kind == "azimuth" else ""
    warnings.warn(
        f"errors of {kind} depend on the direction by {what}{beyond}; this is included in "
        f"{kind}_sigma of the bias, as if it were random",
        UserWarning,
        stacklevel=3,
    )


def _arc(direction: FloatArray) -> float:
    """Return the angle that the directions cover: the full circle minus the largest gap."""
    ordered = np.sort(direction % (2 * np.pi))
    gaps = np.diff(np.append(ordered, ordered[0] + 2 * np.pi))
    return float(2 * np.pi - np.max(gaps))
