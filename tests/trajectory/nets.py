"""Nets of receivers that nobody synchronised, for the tests of arrivals."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from checks import correlated

from tertia.sensors import Station
from tertia.trajectory import Arrivals, ArrivalTrajectory, reconstruct_arrivals

SPEED = 1500.0
TAG, BEACON = 7, 1


@dataclass
class Net:
    """A simulated net: what is given, and the truth."""

    stations: list[Station]
    arrivals: Arrivals
    beacons: dict[int, Any]
    time: npt.NDArray[np.float64]
    source: npt.NDArray[np.float64]
    identity: npt.NDArray[np.int64]
    clock: npt.NDArray[np.float64]
    emission: npt.NDArray[np.int64]


def net(
    seed: int,
    *,
    k: int = 7,
    dimension: int = 2,
    emissions: int = 40,
    tags: int = 1,
    beacons: int = 2,
    survey: float = 1.0,
    noise: float = 2e-4,
    speed: float = SPEED,
    heard: float = 0.95,
    extent: float = 400.0,
    late: float = 0.0,
    lasting: float = 0.0,
) -> Net:
    """Simulate tags on curves and beacons at the first receivers, heard by drifting clocks."""
    rng = np.random.default_rng(seed)
    place = rng.uniform(-0.5, 0.5, (k, dimension)) * extent
    names = [BEACON + i for i in range(beacons)] + [TAG + i for i in range(tags)]
    time = np.cumsum(rng.uniform(0.5, 1.5, (len(names), emissions)) * 20, axis=1)
    source: Any = np.empty((len(names), emissions, dimension))
    for i in range(len(names)):
        phase, rate = rng.uniform(0, 6.28, dimension), rng.uniform(0.5, 1.0, dimension) / 300
        source[i] = 0.35 * extent * np.sin(rate * time[i][:, np.newaxis] + phase)
        if i < beacons:
            source[i] = place[i]
    time, source = time.reshape(-1), source.reshape(-1, dimension)
    identity = np.repeat(names, emissions)
    offset, rate = rng.uniform(-60, 60, k), 1e-5 * rng.standard_normal(k)
    offset[0], rate[0] = 0.0, 0.0
    clock = offset + rate * time[:, np.newaxis]
    travel = np.linalg.norm(source[:, np.newaxis] - place, axis=-1) / speed
    error = noise * rng.standard_normal(travel.shape)
    correlated(error.reshape(len(names), emissions, k), lasting)
    error += np.where(rng.random(travel.shape) < late, 30 * noise, 0.0)
    row, sensor = np.nonzero(rng.random(travel.shape) < heard)
    reading = (time[:, np.newaxis] + travel + clock + error)[row, sensor]
    given = place + survey * rng.standard_normal(place.shape)
    return Net(
        [Station(p, position_sigma=survey) for p in given],
        Arrivals(reading, sensor, identity[row]),
        {name: at for at, name in enumerate(names[:beacons])},
        time,
        source,
        identity,
        clock,
        row,
    )


def solved(scene: Net, **options: Any) -> ArrivalTrajectory:
    given = {"propagation_speed": SPEED, "propagation_speed_sigma": 3.0} | options
    return reconstruct_arrivals(scene.stations, scene.arrivals, beacons=scene.beacons, **given)
