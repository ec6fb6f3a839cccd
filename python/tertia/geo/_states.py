"""Conversion of states of targets from and to polar coordinates, and between frames."""

from __future__ import annotations

import warnings

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import FloatArray, finite, instance, radians
from tertia.geo._arrays import AXES, numbers, rows
from tertia.geo._frames import LocalFrame, SystemPlane

_SIZES = (4, 6)


def polar_to_cartesian(
    state: npt.ArrayLike,
    covariance: npt.ArrayLike | None = None,
    *,
    origin: npt.ArrayLike = (0.0, 0.0),
) -> FloatArray | tuple[FloatArray, FloatArray]:
    """Convert range, azimuth and their rates to east, north and their rates.

    Parameters
    ----------
    state : array_like of shape (..., 4) or (..., 6)
        Range and its rate, then azimuth and its rate, in metres, radians and seconds. If there are
        six components, each rate is followed by the acceleration. The range is horizontal.
    covariance : array_like of shape (..., n, n), optional
        Covariances of the states.
    origin : array_like of shape (2,)
        East and north of the sensor in metres.

    Returns
    -------
    state : ndarray of shape (..., 4) or (..., 6)
        Position, velocity and, if there are six components, acceleration; in each of these, east
        comes before north.
    covariance : ndarray of shape (..., n, n)
        Covariances `J P J'`, where J contains the derivatives of the conversion and P is
        `covariance`; returned only if `covariance` is given.

    Raises
    ------
    ValueError, TypeError
        If a shape is wrong, a number is infinite, or azimuths appear to be in degrees.

    Examples
    --------
    In straight flight past a radar, the azimuth accelerates although the aircraft does not:

    >>> import numpy as np
    >>> from tertia.geo import cartesian_to_polar, polar_to_cartesian
    >>> polar = cartesian_to_polar([10e3, 20e3, -200.0, 0.0, 0.0, 0.0])
    >>> [round(value, 4) for value in np.degrees(polar[3:]).tolist()]
    [26.5651, -0.4584, -0.0037]
    >>> polar_to_cartesian(polar).round(6)[:4]
    array([10000., 20000.,  -200.,     0.])
    """
    given, half = _states(state, "state")
    radians(given[..., half], "azimuth")
    found, slopes = _core.polar_states(_padded(given, half, _POLAR))
    centre = _origin(origin)
    found[:, :2] += centre
    chosen = [*range(2 * half)]
    taken = found[:, chosen].reshape(given.shape)
    if covariance is None:
        return taken
    return taken, _moved(slopes[:, chosen][:, :, _polar(half)], covariance, given)


def cartesian_to_polar(
    state: npt.ArrayLike,
    covariance: npt.ArrayLike | None = None,
    *,
    origin: npt.ArrayLike = (0.0, 0.0),
) -> FloatArray | tuple[FloatArray, FloatArray]:
    """Convert east, north and their rates to range, azimuth and their rates.

    Parameters
    ----------
    state : array_like of shape (..., 4) or (..., 6)
        Position, velocity and, if there are six components, acceleration, in metres and seconds; in
        each of these, east comes before north.
    covariance, origin
        As for `polar_to_cartesian`.

    Returns
    -------
    state : ndarray of shape (..., 4) or (..., 6)
        Range and its rate, then azimuth, in [0, 2π), and its rate. If there are six components,
        each rate is followed by the acceleration. For a target at the sensor the state is nan, and
        there is a warning.
    covariance : ndarray of shape (..., n, n)
        As from `polar_to_cartesian`.

    Raises
    ------
    ValueError, TypeError
        If a shape is wrong or a number is infinite.

    Examples
    --------
    >>> from tertia.geo import cartesian_to_polar
    >>> cartesian_to_polar([3000.0, 4000.0, 30.0, 40.0], origin=(0.0, 0.0)).round(4)
    array([5.000e+03, 5.000e+01, 6.435e-01, 0.000e+00])
    """
    given, half = _states(state, "state")
    moved = given.copy()
    moved[..., :2] -= _origin(origin)
    found = _core.cartesian_states(_padded(moved, half, range(2 * half)))
    if np.any(np.isnan(found) & ~np.isnan(rows(given)).any(axis=-1, keepdims=True)):
        warnings.warn(
            "a target is at the sensor: it has no azimuth there", RuntimeWarning, stacklevel=2
        )
    polar = _polar(half)
    taken = found[:, polar].reshape(given.shape)
    if covariance is None:
        return taken
    _, slopes = _core.polar_states(found)
    known = np.isfinite(slopes).all(axis=(1, 2))
    back = np.full((len(found), 2 * half, 2 * half), np.nan)
    back[known] = np.linalg.inv(slopes[known][:, : 2 * half][:, :, polar])
    return taken, _moved(back, covariance, given)


def transform(
    state: npt.ArrayLike,
    covariance: npt.ArrayLike | None = None,
    *,
    source: LocalFrame | SystemPlane,
    target: LocalFrame | SystemPlane,
) -> FloatArray | tuple[FloatArray, FloatArray]:
    """Convert states from one frame to another.

    Positions are rotated and shifted. Velocities and accelerations are only rotated, because all
    frames are fixed to the earth. In conversions from or to a system plane, all of them are also
    changed by the scale of the plane, and accelerations by the curvature of a straight flight in
    the plane.

    Parameters
    ----------
    state : array_like of shape (..., 3), (..., 6) or (..., 9)
        Position; if there are six components, also velocity; if there are nine, also acceleration.
        Each of these has the components east, north and up or, in a system plane, east, north and
        height above the ellipsoid.
    covariance : array_like of shape (..., n, n), optional
        Covariances of the states.
    source, target : LocalFrame or SystemPlane
        Frame of `state`, and frame of the result.

    Returns
    -------
    state : ndarray of shape (..., n)
        The states in the frame `target`.
    covariance : ndarray of shape (..., n, n)
        Covariances in the frame `target`; only if `covariance` is given.

    Raises
    ------
    ValueError, TypeError
        If a shape is wrong, a number is infinite, or `source` or `target` is not a frame.

    Examples
    --------
    The same aircraft in the frames of two radars:

    >>> from tertia.geo import LocalFrame, transform
    >>> here, there = LocalFrame(50.1, 14.26, 380.0), LocalFrame(50.45, 15.3, 250.0)
    >>> state = [30e3, 40e3, 9000.0, 120.0, -180.0, 5.0]
    >>> [round(value, 3) for value in transform(state, source=here, target=there).tolist()]
    [-43961.896, 1107.879, 9174.572, 117.416, -181.689, 5.272]
    """
    for name, frame in (("source", source), ("target", target)):
        instance(frame, name, LocalFrame, SystemPlane)
    given = numbers(state, "state")
    n = given.shape[-1] if given.ndim else 0
    if n not in (AXES, 2 * AXES, 3 * AXES):
        raise ValueError(
            f"state has shape {given.shape}; it must be (..., 3), (..., 6) or (..., 9)"
        )
    spread = None if covariance is None else _covariances(covariance, given)
    moved, turned = source._frame.transform(target._frame, rows(given), spread)
    found = moved.reshape(given.shape)
    if turned is None:
        return found
    return found, turned.reshape(*given.shape, n)


# where the numbers of a polar state of four are among those of one of six
_POLAR = (0, 1, 3, 4)


def _polar(half: int) -> list[int]:
    return list(_POLAR) if half == 2 else list(range(6))


def _states(state: npt.ArrayLike, name: str) -> tuple[FloatArray, int]:
    """Return states, and the number of components per coordinate."""
    array = numbers(state, name)
    if array.ndim == 0 or array.shape[-1] not in _SIZES:
        raise ValueError(f"{name} has shape {array.shape}; it must be (..., 4) or (..., 6)")
    return array, array.shape[-1] // 2


def _padded(array: FloatArray, half: int, at: range | tuple[int, ...]) -> FloatArray:
    """Return rows of six numbers, in which numbers that are not given are 0."""
    full = np.zeros((array.size // (2 * half), 6))
    full[:, list(at) if half == 2 else slice(None)] = rows(array)
    return full


def _origin(origin: npt.ArrayLike) -> FloatArray:
    place = finite(origin, "origin")
    if place.shape != (2,):
        raise ValueError(f"origin has shape {place.shape}; it must be (2,)")
    return place


def _covariances(covariance: npt.ArrayLike, state: FloatArray) -> FloatArray:
    """Return covariances as a batch of matrices."""
    spread, n = numbers(covariance, "covariance"), state.shape[-1]
    try:
        fitted = np.broadcast_to(spread, (*state.shape, n))
    except ValueError:
        raise ValueError(
            f"covariance has shape {spread.shape}; it must be {(*state.shape, n)}"
        ) from None
    return np.ascontiguousarray(fitted).reshape(-1, n, n)


def _moved(slopes: FloatArray, covariance: npt.ArrayLike, state: FloatArray) -> FloatArray:
    """Return `J P J'` for each state."""
    spread = slopes @ _covariances(covariance, state) @ np.swapaxes(slopes, -1, -2)
    whole: FloatArray = (0.5 * (spread + np.swapaxes(spread, -1, -2))).reshape(
        *state.shape, state.shape[-1]
    )
    return whole
