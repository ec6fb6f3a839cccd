"""Paths from stations with lasting errors that are not stated, stated in part, and in full."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from studies import changed_station, signal_strengths, station_clocks
from studies.montecarlo import FloatArray, generator
from studies.pages import markdown, repetitions
from tertia.location import Station
from tertia.sensors import Bias
from tertia.trajectory import reconstruct

RUNS = repetitions(30, 1)
# cameras: seconds, radians of noise and of pointing errors
FRAME, ANGLE, POINTING = 0.04, 5e-4, 1e-3
# metres: noise of ranges, and by how much they are too long behind the body
RANGE, BODY = 0.1, 0.3
# cosine of the angle from the direction of the walk beyond which the body is in the way
BEHIND = -0.3
# seconds: duration of the record of arrivals, and by how much a clock drifts during it
DURATION = changed_station.COUNT * changed_station.INTERVAL
DRIFT = 6 * changed_station.SIGMA / changed_station.LIGHT


@dataclass(frozen=True)
class Recording:
    """What stations measured at which times, their sigmas, and where the target was."""

    places: FloatArray
    time: FloatArray
    truth: FloatArray
    measured: dict[str, Any]
    sigma: float

    def inside(self, bias: Bias | None) -> tuple[float, float]:
        """Return the mean squared error of the path, and the share inside the 95 % regions."""
        sigmas: dict[str, Any] = {f"{kind}_sigma": self.sigma for kind in self.measured}
        stations = [Station(place, **sigmas) for place in self.places]
        with warnings.catch_warnings():
            # errors that are stated in part contradict each other
            warnings.simplefilter("ignore")
            path = reconstruct(stations, self.time, **self.measured, bias=bias)
        return station_clocks.judged(path, self.truth)


def cameras(frames: int, count: int, seed: int) -> Recording:
    """Draw directions of a drone from cameras that do not point exactly where they should."""
    rng = generator(641, count, seed)
    scene = station_clocks.SCENES["cameras and a drone"]
    time = np.asarray(FRAME * (np.arange(frames) - 0.5 * frames), np.float64)
    truth = station_clocks.way(scene, time, rng)
    turn = np.pi / 2 * (np.arange(count) + rng.uniform(-0.3, 0.3, count))
    places = scene.distance * np.stack([np.sin(turn), np.cos(turn), 0.02 * turn], axis=-1)
    offset = truth[:, np.newaxis] - places
    measured = {
        kind: station_clocks.measured(kind, offset)
        + POINTING * rng.standard_normal(count)
        + ANGLE * rng.standard_normal((frames, count))
        for kind in scene.sigmas
    }
    return Recording(places, time, truth, measured, ANGLE)


def chest(count: int, seed: int) -> Recording:
    """Draw ranges of a tag on the chest of a walker, which are too long behind the body."""
    rng = generator(642, count, seed)
    places, way, ranges = signal_strengths.scene(count, (0.0, 0.0), rng)
    steps = np.diff(way, axis=0, prepend=way[:1])
    for at in range(1, len(steps)):
        # before a wall he stands
        if not steps[at].any():
            steps[at] = steps[at - 1]
    towards = places - way[:, np.newaxis]
    ahead = np.einsum("nkd,nd->nk", towards, steps) / np.linalg.norm(towards, axis=-1)
    ranges = ranges + BODY * (ahead < BEHIND) + RANGE * rng.standard_normal(ranges.shape)
    return Recording(places, signal_strengths.TIMES, way, {"range": np.abs(ranges)}, RANGE)


def clocks(count: int, seed: int) -> Recording:
    """Draw times of arrival at receivers whose clocks drift."""
    _, measured, path = changed_station.record(seed, "arrival_time", count, 0.0)
    time = np.asarray(changed_station.INTERVAL * np.arange(changed_station.COUNT), np.float64)
    drift = DRIFT * generator(643, count, seed).standard_normal(count)
    arrivals = measured["arrival_time"] + np.outer(time / DURATION, drift)
    sigma = changed_station.SIGMA / changed_station.LIGHT
    return Recording(changed_station.PLACES[:count], time, path, {"arrival_time": arrivals}, sigma)


@dataclass(frozen=True)
class Scene:
    """How recordings are drawn, for how many stations, and what is stated in part and in full."""

    draw: Callable[[int, int], Recording]
    counts: tuple[int, ...]
    part: Bias
    full: Bias


def _cameras(frames: int) -> Scene:
    half, full = (Bias(azimuth_sigma=s, elevation_sigma=s) for s in (POINTING / 2, POINTING))
    return Scene(partial(cameras, repetitions(frames, frames // 5)), (3, 4), half, full)


def _shadow(size: float) -> Bias:
    return Bias(range_sigma=size, drift_share=1.0, drift_time=30.0)


SCENES = {
    "cameras, 4 s": _cameras(100),
    "cameras, 20 s": _cameras(500),
    "tag on the chest": Scene(chest, (4, 6, 8), _shadow(BODY / 2), _shadow(BODY)),
    "drifting clocks": Scene(
        clocks,
        (4, 5),
        Bias(time_sigma=DRIFT),
        Bias(time_sigma=DRIFT, drift_share=1.0, drift_time=DURATION),
    ),
}


def stated_errors() -> str:
    """Tabulate errors and coverage by what is stated of the errors that last."""
    rows = []
    for name, scene in SCENES.items():
        for count in scene.counts:
            recordings = [scene.draw(count, seed) for seed in range(RUNS)]
            row = [name, str(count)]
            for bias in (None, scene.part, scene.full):
                square, share = np.transpose([one.inside(bias) for one in recordings])
                rmse = np.sqrt(square.mean())
                row.append(f"{rmse:.3g} m; {share.mean():.0%}; {share.min():.0%}")
            rows.append(row)
    return markdown(["scene", "stations", "default", "stated in part", "stated in full"], rows)
