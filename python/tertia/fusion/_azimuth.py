"""Azimuths of several sensors, as seen from one origin."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tertia._arrays import FloatArray, common_batch, finite, positive, radians, squarable


def common_azimuth(
    range: npt.ArrayLike,  # noqa: A002  # that is what it is
    azimuth: npt.ArrayLike,
    position: npt.ArrayLike,
    *,
    range_sigma: npt.ArrayLike,
    azimuth_sigma: npt.ArrayLike,
    origin: npt.ArrayLike = (0.0, 0.0),
) -> tuple[FloatArray, FloatArray]:
    """Convert range and azimuth of a sensor to those seen from a common origin.

    Parameters
    ----------
    range, azimuth : array_like of shape (...)
        Range in metres and azimuth in radians, clockwise from north, as measured by the sensor.
    position : array_like of shape (2,)
        Position of the sensor, east and north in metres.
    range_sigma, azimuth_sigma : array_like of shape (...)
        Standard deviations of range and azimuth, in metres and radians.
    origin : array_like of shape (2,)
        Position of the common origin, east and north in metres.

    Returns
    -------
    polar : ndarray of shape (..., 2)
        Azimuth in [0, 2 pi), in radians, and range in metres, seen from the origin.
    covariance : ndarray of shape (..., 2, 2)
        Covariance of `polar`, to first order.

    Raises
    ------
    ValueError, TypeError
        If shapes do not fit, a number is not finite or not positive where it must be, the target is
        at the origin, or an argument has the wrong type.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.fusion import common_azimuth
    >>> polar, covariance = common_azimuth(
    ...     50e3, np.pi / 2, [-30e3, 20e3], range_sigma=50.0, azimuth_sigma=0.002
    ... )
    >>> polar.round(4)
    array([7.85400000e-01, 2.82842712e+04])
    >>> (np.diagonal(covariance) ** 0.5).round(4)
    array([2.80000e-03, 7.90569e+01])
    """
    r = positive(squarable(range, "range"), "range")
    a = finite(radians(azimuth, "azimuth"), "azimuth")
    sr = positive(squarable(range_sigma, "range_sigma"), "range_sigma")
    sa = positive(radians(azimuth_sigma, "azimuth_sigma", is_sigma=True), "azimuth_sigma")
    places = [finite(squarable(position, "position"), "position")]
    places.append(finite(squarable(origin, "origin"), "origin"))
    for name, place in zip(("position", "origin"), places, strict=True):
        if place.shape != (2,):
            raise ValueError(f"{name} has shape {place.shape}; it must be (2,)")
    common_batch(range=r.shape, azimuth=a.shape, range_sigma=sr.shape, azimuth_sigma=sa.shape)
    r, a, sr, sa = np.broadcast_arrays(r, a, sr, sa)
    toward = np.stack([np.sin(a), np.cos(a)], axis=-1)
    offset = r[..., np.newaxis] * toward + (places[0] - places[1])
    rho = np.sqrt(np.sum(offset**2, axis=-1))
    if np.any(rho == 0):
        raise ValueError("range and azimuth lead to the origin, where no azimuth is defined")
    # errors east and north, along the line of sight and across
    across = np.stack([toward[..., 1], -toward[..., 0]], axis=-1)
    errors = np.stack([sr[..., np.newaxis] * toward, (r * sa)[..., np.newaxis] * across], axis=-1)
    seen = offset / rho[..., np.newaxis]
    rows = np.stack([np.stack([seen[..., 1], -seen[..., 0]], -1) / rho[..., np.newaxis], seen], -2)
    roots = rows @ errors
    turned = np.asarray(np.arctan2(offset[..., 0], offset[..., 1]) % (2 * np.pi))
    turned[turned >= 2 * np.pi] = 0.0
    polar = np.stack([turned, rho], axis=-1)
    return polar, roots @ np.swapaxes(roots, -1, -2)
