"""Measurements over long distances on the earth, of which positions are estimated in a plane.

Azimuths and distances along the ellipsoid differ from those in the plane that touches it. The
differences at the estimated positions are subtracted from the measurements, and the positions are
estimated again. Each round reduces the error of a position by the share by which lengths in the
plane are wrong, 1 % at 1000 km.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from tertia._arrays import FloatArray
from tertia.geo import LocalFrame
from tertia.location import Location
from tertia.sensors import Station
from tertia.tables._earth import on_the_ellipsoid
from tertia.tables._sensors import Sensors
from tertia.trajectory import Trajectory

# in metres
_EARTH = 6.37e6
# differences below this share of the sigma are left as they are
_SMALL = 0.1
_ROUNDS = 4
# of a round that hardly changes positions, in sigmas
_STILL = 0.02

F = TypeVar("F", Location, Trajectory)
Measured = dict[str, Any]


def on_the_earth(
    solve: Callable[[Measured, Measured], F],
    measured: Measured,
    sigmas: Measured,
    sensors: Sensors[Station],
    speed: float,
) -> F:
    """Return positions estimated by `solve` from measurements on the ellipsoid, and their sigmas.

    `measured` has the arguments of `locate`, (N, K) each, and `sigmas` their sigmas as far as they
    are stated. Positions in space, or without latitudes and longitudes, are estimated once. O(N K)
    """
    frame = sensors.frame
    if not isinstance(frame, LocalFrame) or sensors.dimension > 2:
        return solve(measured, sigmas)
    most = _most(_places(sensors), measured, speed)
    if _are_small(most, sigmas, None):
        found = solve(measured, sigmas)
        if _are_small(_most([found.position], measured, speed), sigmas, found):
            return found
    else:
        # first with sigmas that allow for the plane, so that all instants have a position
        grown = {kind: np.hypot(sigma, most[kind]) for kind, sigma in sigmas.items()}
        found = solve(measured, grown)
    for _ in range(_ROUNDS):
        away = _of_kinds(*_differences(frame, sensors, found.position), speed)
        own = {kind: values - away[kind] for kind, values in measured.items()}
        before, found = found, solve(own, sigmas)
        if _is_still(before, found):
            break
    return found


def _most(places: list[FloatArray], measured: Measured, speed: float) -> dict[str, FloatArray]:
    """Return the largest differences from the plane among places.

    Lengths are shorter in the plane by at most half the square of the distance from the origin, in
    radii of the earth.
    """
    lengths = [np.fmax.reduce(np.linalg.norm(one, axis=-1), axis=None) for one in places]
    reach = float(np.fmax.reduce(lengths))
    share = np.full((1, 1), 0.5 * (reach / _EARTH) ** 2)
    found = _of_kinds(share, 2 * reach * share, speed)
    return {kind: found[kind] for kind in measured}


def _of_kinds(turned: FloatArray, longer: FloatArray, speed: float) -> dict[str, FloatArray]:
    """Return by how much measurements on the ellipsoid exceed those in the plane."""
    differences = longer[:, 1:] - longer[:, :1] if longer.shape[1] > 1 else longer
    return {
        "azimuth": turned,
        "range": longer,
        "range_difference": differences,
        "arrival_time": longer / speed,
    }


def _are_small(most: Measured, sigmas: Measured, found: Location | Trajectory | None) -> bool:
    """Return whether differences are small compared with the sigmas, stated or estimated."""
    estimated = getattr(found, "measurement_sigma", None)
    for kind, values in most.items():
        sigma = sigmas.get(kind, estimated)
        if sigma is not None and np.max(values) > _SMALL * np.nanmin(sigma):
            return False
    return True


def _is_still(before: Location | Trajectory, found: Location | Trajectory) -> bool:
    shift = np.linalg.norm(found.position - before.position, axis=-1)
    sigma = np.sqrt(found.covariance[:, 0, 0] + found.covariance[:, 1, 1])
    return not np.any((shift > _STILL * sigma) | (np.isnan(shift) & np.isfinite(sigma)))


def _differences(
    frame: LocalFrame, sensors: Sensors[Station], position: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return azimuths and distances on the ellipsoid minus those in the plane, (N, K).

    Where there is no position, they are those of the middle of the stations.
    """
    from pyproj import Geod  # noqa: PLC0415  # only for positions on the earth

    each = [np.broadcast_to(one, position.shape) for one in _places(sensors)]
    places = np.stack(each, axis=1)
    there = np.isfinite(position).all(axis=-1, keepdims=True)
    target = np.where(there, position, places.mean(axis=1))[:, np.newaxis]
    (latitude, longitude), (north, east) = (
        [one.reshape(at.shape[:-1]) for one in on_the_ellipsoid(frame, at.reshape(-1, 2))]
        for at in (places, target)
    )
    count = longitude.shape
    azimuth, _, distance = Geod(ellps="WGS84").inv(
        longitude, latitude, np.broadcast_to(east, count), np.broadcast_to(north, count)
    )
    offset = target - places
    shape = (len(position), 2, 2)
    axes = np.stack([np.broadcast_to(_axes(one), shape) for one in sensors.items], axis=1)
    own = np.einsum("nkij,nkj->nki", axes, offset)
    turned = np.radians(azimuth) - np.arctan2(own[..., 0], own[..., 1])
    turned = (turned + np.pi) % (2 * np.pi) - np.pi
    longer = distance - np.linalg.norm(offset, axis=-1)
    return np.nan_to_num(turned), np.nan_to_num(longer)


def _axes(station: Station) -> FloatArray:
    return np.eye(2) if station.axes is None else np.asarray(station.axes)


def _places(sensors: Sensors[Station]) -> list[FloatArray]:
    return [np.asarray(one.position) for one in sensors.items]
