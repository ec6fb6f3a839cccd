"""Plots of radars on the earth: their positions in the system plane."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tertia import _core
from tertia._arrays import FloatArray
from tertia.sensors import Radar
from tertia.sensors._channels import DETECTIONS, sigmas_of, ways

if TYPE_CHECKING:
    from tertia.geo import SystemPlane
    from tertia.tracker._plots import Plots

# standard deviation of a reported height: hundreds of feet, rounded, and the encoder
_HEIGHT_SIGMA = 15.0
# of heights that are not known, before those of other plots tell: anywhere up to 12 km
LEVEL_SIGMA = 12_000.0 / np.sqrt(12.0).item()
# of the range: so much nearer than its height a plot is still straight above the radar
_OVERHEAD_SIGMAS = 3.0
# meridional radius at the equator, the smallest, in metres
_RADIUS = 6.33e6


def plane_of(sensors: Sequence[Radar]) -> SystemPlane | None:
    """Return the system plane of the sensors; None if the earth is flat."""
    frames = [sensor.frame for sensor in sensors]
    for k, frame in enumerate(frames):
        if frame != frames[0]:
            raise ValueError(f"sensors[{k}] has the frame {frame}, sensors[0] has {frames[0]}")
    return frames[0] if frames else None


def positions(
    plots: Plots,
    sensors: Sequence[Radar],
    plane: SystemPlane,
    doubt: FloatArray | float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Return positions, (N, 2), and their covariances, (N, 2, 2); nan if a plot has no position.

    A plot without a height is assumed to be at the mean height of the plots that have one, and the
    error of this assumption is included in its covariance. If no plot has a height, ranges are
    assumed to be horizontal. `doubt` is the sigma of heights that were not reported, but follow
    from others.
    """
    sites, known = _sites(sensors), np.isfinite(plots.height)
    heights = plots.height[known]
    level, spread = sites[plots.sensor, 2], 0.0
    if len(heights):
        level = np.full(len(plots), np.mean(heights))
        spread = (LEVEL_SIGMA**2 + np.sum((heights - level[0]) ** 2)) / (1 + len(heights))
    sigma = _sigmas(plots, sensors)
    height_sigma = np.where(known, np.hypot(_HEIGHT_SIGMA, doubt), np.sqrt(spread))
    columns = np.column_stack([plots.range, plots.azimuth, np.where(known, plots.height, level)])
    seen = _core.plots_in_plane(sites, plane._frame, plots.sensor, columns)
    jacobian = seen[:, 2:].reshape(-1, 3, 2).swapaxes(1, 2)
    scaled = jacobian * np.column_stack([sigma, height_sigma])[:, np.newaxis]
    # sine and cosine of a noisy azimuth are smaller by exp(-sigma^2 / 2) on average
    places = np.array([one.position[:2] for one in sensors])[plots.sensor]
    offset = (seen[:, :2] - places) * np.exp(0.5 * sigma[:, 1:] ** 2)
    return places + offset, scaled @ scaled.swapaxes(1, 2)


def _sigmas(plots: Plots, sensors: Sequence[Radar]) -> FloatArray:
    """Return the standard deviations of ranges and azimuths, (N, 2)."""
    each = np.array([[one.range_sigma, one.azimuth_sigma] for one in sensors])
    found: FloatArray = each[plots.sensor]
    for k, radar in enumerate(sensors):
        for name in ways(radar.channels or {}):
            if name:
                own = (plots.sensor == k) & (plots.detection == DETECTIONS.index(name))
                found[own] = sigmas_of(radar.channels or {}, name, (each[k, 0], each[k, 1]))
    return found


def in_plane(plots: Plots, sensors: Sequence[Any]) -> Plots:
    """Convert plots of radars on the earth to the plots that radars in a flat plane would measure.

    Applied to the converted plots, the formulas for the flat plane give the exact positions. A plot
    without a height is assumed to be at the mean height of the plots before it. If the measured
    range is too short for the reported height, the height is ignored, unless the target may be
    straight above the radar. Plots of other sensors are not changed.
    """
    radars = [one for one in sensors if isinstance(one, Radar)]
    plane = plane_of(radars)
    unknown = (plots.sensor < 0) | (plots.sensor >= len(sensors))
    if plane is None or np.any(unknown):
        # of sensors that do not exist the core tells
        return plots
    if len(radars) == len(sensors):
        return _flattened(plots, radars, plane)
    is_radar = np.array([isinstance(one, Radar) for one in sensors])
    own, number = is_radar[plots.sensor], np.cumsum(is_radar) - 1
    some = plots[own]
    flat = _flattened(some._replaced(sensor=number[some.sensor]), radars, plane)
    columns = {name: getattr(plots, name).copy() for name in ("range", "azimuth", "height")}
    for name, column in columns.items():
        column[own] = getattr(flat, name)
    return plots._replaced(**columns)


def _flattened(plots: Plots, sensors: Sequence[Radar], plane: SystemPlane) -> Plots:
    sites = _sites(sensors)
    up = plots.height - sites[plots.sensor, 2]
    sigma = np.array([one.range_sigma for one in sensors])[plots.sensor]
    excess = np.abs(up) - plots.range
    overhead = (excess >= 0.0) & (excess < _OVERHEAD_SIGMAS * sigma)
    height = np.where((excess >= 0.0) & ~overhead, np.nan, plots.height)
    columns = np.column_stack([plots.range, plots.azimuth, height])
    levels = _levels(height, sites[plots.sensor, 2])
    flat = _core.plots_flattened(sites, plane._frame, plots.sensor, columns, levels)
    # what is straight above the radar, or no plot at all, is for the kernel to say
    kept = overhead | np.isnan(flat[:, 0])
    flat[kept] = columns[kept, :2]
    limit = np.array([one.max_range for one in sensors])[plots.sensor]
    beyond = plots.range > limit
    flat[beyond, 0] = 2.0 * limit[beyond]
    distance, azimuth = flat.T.copy()
    return plots._replaced(range=distance, azimuth=azimuth, height=height)


def _levels(height: FloatArray, low: FloatArray) -> FloatArray:
    """Return the mean of all heights up to each plot, (N,), or `low` before the first height."""
    known = np.isfinite(height)
    count = np.cumsum(known)
    total = np.cumsum(np.where(known, height, 0.0))
    return np.where(count > 0, total / np.maximum(count, 1), low)


def reach(radar: Radar) -> float:
    """Return the largest range in the plane, where lengths far from the centre appear longer."""
    if radar.frame is None:
        return radar.max_range
    far = float(np.hypot(*radar.position[:2])) + radar.max_range
    return radar.max_range * (1.0 + (far / (2.0 * _RADIUS)) ** 2)


def _sites(sensors: Sequence[Radar]) -> FloatArray:
    """Return latitudes and longitudes in radians and heights in metres, (K, 3)."""
    sites = [one.site for one in sensors]
    return np.array(
        [[np.radians(s.latitude), np.radians(s.longitude), s.height] for s in sites if s]
    )
