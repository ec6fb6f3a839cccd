"""Fused tracks and the best source alone, if sources are not what they say."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from studies.fused_tracks import (
    FLIGHTS,
    FLOWN,
    LENGTH,
    WARM,
    Flown,
    Seen,
    Source,
    alpha_beta,
    cell,
    flown,
    judged,
    kalman,
    navigation,
    seen,
    sensors,
)
from studies.pages import markdown, repetitions
from tertia._arrays import FloatArray
from tertia.sensors import Bias, Radar
from tertia.tertiary import SensorTracks, fuse_tracks

SEED = 2041
SCENES = repetitions(3, 1)
INTERVAL = 5.0
# scans after which a track is no longer used
OLD = 2.5


def thinned(source: Source, every: int) -> Source:
    """Return a source that leaves out rows."""

    def some(plots: Seen, radar: Radar, sensor: int) -> SensorTracks:
        found = source(plots, radar, sensor)
        first = np.searchsorted(found.track, found.track)
        return found[(np.arange(len(found)) - first) % every == every - 1]

    return some


def jumping(source: Source, by: float) -> Source:
    """Return a source whose clock jumps in the middle of the scene."""

    def some(plots: Seen, radar: Radar, sensor: int) -> SensorTracks:
        found = source(plots, radar, sensor)
        return replace(found, time=found.time + np.where(found.time > LENGTH / 2, by, 0.0))

    return some


@dataclass(frozen=True)
class Case:
    """Sources, the noise of plots relative to the stated noise, and whether clocks are unknown."""

    sources: tuple[Source, ...]
    noise: float = 1.0
    is_registered: bool = True


DAMPED = alpha_beta(0.51, 0.09, stated=False)
CASES = {
    "Kalman filters, as stated": Case((kalman(),) * 3),
    "α-β filters, critically damped": Case((DAMPED,) * 3),
    "the same, one of them": Case((kalman(), DAMPED, kalman())),
    "Kalman filters, every third row": Case((thinned(kalman(), 3),) * 3),
    "Kalman filters, 0.05 m²/s³": Case((kalman(density=0.05),) * 3),
    "noise of plots 3 times the stated one": Case((kalman(),) * 3, noise=3.0),
    "Kalman filter and navigation": Case((kalman(), navigation(60.0))),
    "one clock jumps by 3 s": Case(
        (kalman(), jumping(kalman(), 3.0), kalman()), is_registered=False
    ),
    "one clock jumps by −3 s": Case(
        (kalman(), jumping(kalman(), -3.0), kalman()), is_registered=False
    ),
}


def alone(tracks: SensorTracks, of: Flown, radar: Radar) -> FloatArray:
    """Return squares of position errors of one source, extrapolated to the cycles."""
    squares = []
    cycles = np.arange(WARM, LENGTH - INTERVAL, INTERVAL)
    for number in np.unique(tracks.track):
        own = tracks[tracks.track == number]
        last = np.searchsorted(own.time, cycles, side="right") - 1
        age = cycles - own.time[last]
        fresh = (last >= 0) & (age < OLD * radar.scan_period)
        last, age, time = last[fresh], age[fresh, np.newaxis], cycles[fresh]
        truth = of.at(np.full(len(time), number - 1), time)[0]
        error = own.position[last] + age * own.velocity[last] - truth
        squares.append(np.sum(error**2, axis=1))
    return np.concatenate(squares)


def contradictions() -> str:
    """Return coverage and errors of the picture, and errors of the best source alone."""
    rows = []
    for name, case in CASES.items():
        results, single = [], []
        for at, kind in enumerate(FLOWN * SCENES):
            rng = np.random.default_rng([SEED, at])
            of = flown(kind, FLIGHTS, rng)
            radars = sensors(len(case.sources), None if not case.is_registered else Bias())
            several = []
            for k, (source, radar) in enumerate(zip(case.sources, radars, strict=True)):
                actual = replace(
                    radar,
                    range_sigma=case.noise * radar.range_sigma,
                    azimuth_sigma=case.noise * radar.azimuth_sigma,
                )
                plots = seen(of, actual, (0.0, 0.0), rng)
                several.append(source(plots, radar, k))
            results.append(judged(fuse_tracks(SensorTracks.concatenate(several), radars), of))
            single.append([alone(own, of, r) for own, r in zip(several, radars, strict=True)])
        size = np.sqrt(np.mean(np.concatenate([one.square for one in results])))
        best = min(np.sqrt(np.mean(np.concatenate(own))) for own in zip(*single, strict=True))
        surplus = np.mean([one.excess for one in results])
        rows.append([name, cell(results), f"{size:.0f}", f"{best:.0f}", f"{surplus:.2f}"])
    head = ["sources", "in 95% regions", "position, m", "best source alone, m", "surplus"]
    return markdown(head, rows)
