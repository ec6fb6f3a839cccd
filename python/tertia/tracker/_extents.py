"""Whether targets give several plots in a scan although no extent of theirs is stated."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia.sensors import PositionSensor, Radar
from tertia.tracker._plots import Plots
from tertia.tracker._sensors import Sensor, interval

# plots are of one scan of a target if they are within so many standard deviations, and their times
# within so many periods, or as far apart as the beam took from one to the other
_NEAR, _TOGETHER = 10.0, 0.005
# scans in which the plots of a track are counted; tracks with so many scans, and their share, from
# which targets are extended; pairs of plots that are compared at a time
_SCANS, _ENOUGH, _SHARE, _PAIRS = 20, 8, 0.25, 1_000_000
# share of the plots that follow another one of the same target from which plots are counted at all;
# mean number of plots from which a target is extended, and variance relative to it: two targets
# that fly together have two plots in almost every scan
_SOME, _SEVERAL, _VARIES = 0.1, 1.5, 0.35


class Extents:
    """Numbers of plots in a scan, and how far apart they are, of the first tracks of sensors."""

    def __init__(self, sensors: Sequence[Sensor]) -> None:
        self._sensors = {
            k: one
            for k, one in enumerate(sensors)
            if isinstance(one, Radar | PositionSensor) and one.target_extent == 0.0
        }
        self._seen: dict[tuple[int, int], list[list[float]]] = {}
        # plots of each sensor, those that follow another one of the same target, and scans
        self._pairs = dict.fromkeys(self._sensors, np.zeros(3))

    @property
    def are_known(self) -> bool:
        """Whether there is nothing left to find out."""
        return not self._sensors

    def expect(self, plots: Plots) -> None:
        """Leave out the sensors that have hardly any plots together in this recording."""
        for k, sensor in [*self._sensors.items()]:
            own = np.flatnonzero(plots.sensor == k)
            # the sensor may have no plots at all
            if len(own) < _SCANS or np.mean(_follows(sensor, plots, own)) < _SOME:
                del self._sensors[k]

    def after(
        self, tracks: IntArray, used: IntArray, plots: Plots, names: Sequence[str]
    ) -> list[str]:
        """Return what there is to say after a scan, in which tracks used these of the plots."""
        said = []
        for k, sensor in [*self._sensors.items()]:
            own = np.flatnonzero(plots.sensor == k)
            new = np.flatnonzero(plots.sensor[used] == k)
            if not len(new):
                continue
            follow = np.count_nonzero(_follows(sensor, plots, own))
            self._pairs[k] = self._pairs[k] + [len(own), follow, 1.0]
            count, pairs, times = self._pairs[k]
            if pairs < _SOME * count:
                if times >= _SCANS:
                    del self._sensors[k]
                continue
            new = new[np.argsort(tracks[new], kind="stable")][: max(1, _PAIRS // len(own))]
            near = _near(sensor, plots, own, used[new])
            for track, one in zip(tracks[new].tolist(), near.tolist(), strict=True):
                self._seen.setdefault((k, track), []).append(one)
            if max(len(self._seen[k, track]) for track in tracks[new].tolist()) >= _SCANS:
                del self._sensors[k]
                said += [f"{names[k]}: {one}" for one in self._judge(k)]
        return said

    def _judge(self, sensor: int) -> list[str]:
        """Return what there is to say about a sensor."""
        seen = [np.array(own) for (k, _), own in self._seen.items() if k == sensor]
        long = [own for own in seen if len(own) >= _ENOUGH]
        mean = np.array([own[:, 0].mean() for own in long])
        varies = np.array([own[:, 0].var() for own in long]) > _VARIES * mean
        extended = (mean > _SEVERAL) & varies
        if np.mean(extended) < _SHARE:
            return []
        several = np.concatenate([own for own, is_so in zip(long, extended, strict=True) if is_so])
        count, apart = several[:, 0].mean(), np.quantile(several[:, 1], 0.95)
        return [
            f"many targets give several plots in a scan, {count:.1f} on average and often "
            f"{float(f'{apart:.2g}'):g} m apart: they may have several tracks each. State the "
            "length of the largest targets as target_extent"
        ]


def _follows(sensor: Radar | PositionSensor, plots: Plots, own: IntArray) -> BoolArray:
    """Return which plots of a sensor follow another one of the same target in a scan."""
    own = own[np.argsort(plots.time[own], kind="stable")]
    return _together(sensor, plots, own[1:], own[:-1])[0]


def _near(
    sensor: Radar | PositionSensor, plots: Plots, own: IntArray, used: IntArray
) -> FloatArray:
    """Return how many plots of a sensor are near those used, and the distance of the farthest."""
    is_near, distance = _together(sensor, plots, own, used[:, np.newaxis])
    farthest = np.where(is_near, distance, 0.0).max(axis=1)
    near: FloatArray = np.stack([is_near.sum(axis=1), farthest], axis=-1)
    return near


def _together(
    sensor: Radar | PositionSensor, plots: Plots, one: IntArray, other: IntArray
) -> tuple[BoolArray, FloatArray]:
    """Return which plots may be of one target in a scan, and how far apart they are."""
    late = np.abs(plots.time[one] - plots.time[other])
    if isinstance(sensor, Radar):
        turned = plots.azimuth[one] - plots.azimuth[other]
        turned = np.abs((turned + np.pi) % (2.0 * np.pi) - np.pi)
        late = np.minimum(late, np.abs(late - sensor.scan_period * turned / (2.0 * np.pi)))
        distance = plots.range[other]
        along, across = plots.range[one] - distance, distance * turned
        sigma_along = np.full(distance.shape, sensor.range_sigma)
        sigma_across = distance * sensor.azimuth_sigma
    else:
        assert plots.position is not None
        along, across = np.moveaxis(plots.position[one] - plots.position[other], -1, 0)
        sigma_along, sigma_across = (_sigma(sensor, plots, other, k) for k in range(2))
    with np.errstate(over="ignore"):
        is_near = (np.abs(along) < _NEAR * sigma_along) & (np.abs(across) < _NEAR * sigma_across)
        distance = np.hypot(along, across)
    return is_near & (late <= _TOGETHER * interval(sensor)), distance


def _sigma(sensor: PositionSensor, plots: Plots, index: IntArray, axis: int) -> FloatArray:
    """Return the standard deviations of reported positions along an axis, nan where not stated."""
    stated = np.nan if sensor.position_sigma is None else sensor.position_sigma
    sigma = np.full(index.shape, stated)
    if plots.covariance is None:
        return sigma
    own = np.sqrt(plots.covariance[index, axis, axis])
    return np.where(np.isnan(own), sigma, own)
