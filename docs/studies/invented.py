"""Recordings of sensors unlike those of the other studies, used as somebody new would use them."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from studies.montecarlo import FloatArray, generator, in_region
from studies.pages import markdown, repetitions
from tertia.location import locate
from tertia.sensors import Bias, Station
from tertia.trajectory import Arrivals, reconstruct, reconstruct_arrivals

# the stated sigma is that of the white noise times this
STATED = (0.5, 1.0, 2.0)
LOW, HIGH = 0.85, 0.99
INSTANTS, STEP = 60, 2.0
RUNS = 40
SOUND = 340.0
# share of ranges that are late, and for how many instants they are
LATE, LASTING = 0.2, 3.0
KNOWN_SPEED: dict[str, Any] = {"propagation_speed": SOUND, "propagation_speed_sigma": 0.01 * SOUND}


@dataclass
class Recording:
    """What stations measured, the white part of its errors, and where the target was."""

    stations: list[FloatArray]
    truth: FloatArray
    measured: dict[str, Any]
    sigma: float
    known: Bias | None = None
    """What somebody who knows the instruments would state of their systematic errors."""

    def sensors(self, stated: float, bias: Bias | None = None) -> list[Station]:
        """Return the stations with a sigma that is so many times that of the white noise."""
        own: dict[str, Any] = {f"{kind}_sigma": stated * self.sigma for kind in self.measured}
        own.pop("range_difference_sigma", None)
        return [Station(place, bias=bias, **own) for place in self.stations]


def table() -> str:
    """Tabulate how often the claimed 95 % region holds the truth, by stated sigma."""
    rows = []
    for at, (name, draw) in enumerate(RECORDINGS.items()):
        for called, solve in WAYS.items():
            if called in {ARRIVALS, SPEED, SPEED_OF_PATH} and draw not in {_sounds, _shots}:
                continue
            if called == ALONE and draw is not _indoor:
                continue
            cells, said = [], set()
            for stated in STATED:
                shares = []
                for run in range(repetitions(RUNS, 1)):
                    recording = draw(generator(4711, at, run))
                    if called == KNOWN and recording.known is None:
                        break
                    share, told = solve(recording, stated)
                    shares.append(share)
                    said.add(told)
                if shares:
                    share = float(np.nanmean(shares))
                    cells.append(f"{share:.0%}" if LOW <= share <= HIGH else f"**{share:.0%}**")
            if cells:
                rows.append([name, called, *cells, ", ".join(sorted(said))])
    head = ["recording", "estimator", "sigma × ½", "sigma × 1", "sigma × 2", "`systematic`"]
    return markdown(head, rows)


def _way(rng: np.random.Generator, size: float, speed: float) -> FloatArray:
    """Return a way with slow turns that passes the origin within `size`."""
    heading = rng.uniform(0.0, 2 * np.pi) + np.cumsum(rng.normal(0.0, 0.03, INSTANTS))
    steps = STEP * speed * np.column_stack([np.sin(heading), np.cos(heading)])
    path = np.cumsum(steps, axis=0)
    return np.asarray(path - path.mean(axis=0) + rng.uniform(-size, size, 2))


def _azimuths(places: FloatArray, truth: FloatArray) -> FloatArray:
    east, north = np.moveaxis(truth[:, np.newaxis, :2] - places[..., :2], -1, 0)
    return np.asarray(np.arctan2(east, north))


def _ships(rng: np.random.Generator) -> Recording:
    """Draw bearings from three moving ships, each with a heading that is off and drifts."""
    truth = _way(rng, 3000.0, 8.0)
    start = 6000.0 * np.array([[-1.0, -0.6], [1.0, -0.5], [0.1, 1.2]])
    speed = STEP * rng.normal(0.0, 4.0, (3, 2))
    places = start + np.arange(INSTANTS)[:, np.newaxis, np.newaxis] * speed
    sigma = np.radians(1.0)
    gyro = np.cumsum(0.1 * sigma * rng.standard_normal((INSTANTS, 3)), axis=0)
    gyro += sigma * rng.standard_normal(3)
    azimuth = _azimuths(places, truth) + gyro + sigma * rng.standard_normal((INSTANTS, 3))
    known = Bias(azimuth_sigma=1.2, drift_share=0.4, drift_time=100.0, degrees=True)
    return Recording(list(np.moveaxis(places, 1, 0)), truth, {"azimuth": azimuth}, sigma, known)


def _rooms(rng: np.random.Generator) -> Recording:
    """Draw angles of a tag to six antennas of a hall; reflections last while it is in one place."""
    truth = _way(rng, 4.0, 0.15)
    places = np.array([[-12.0, -8.0], [12, -8], [12, 8], [-12, 8], [0, -8], [0, 8]])
    sigma = np.radians(4.0)
    _, room = np.unique(np.floor(truth / 3.0), axis=0, return_inverse=True)
    room = room.ravel()
    reflected = np.radians(5.0) * rng.standard_t(3, (room.max() + 1, 6))[room]
    azimuth = _azimuths(places, truth) + reflected + sigma * rng.standard_t(4, (INSTANTS, 6))
    known = Bias(azimuth_sigma=7.0, drift_share=1.0, drift_time=20.0, degrees=True)
    return Recording(list(places), truth, {"azimuth": azimuth}, sigma, known)


def _indoor(rng: np.random.Generator) -> Recording:
    """Draw ranges to six anchors of a hall, each with an offset; a fifth is late for a while."""
    truth = _way(rng, 2.0, 0.1)
    places = np.array([[-12.0, -8.0], [12, -8], [12, 8], [-12, 8], [0, -8], [0, 8]])
    offset = rng.uniform(0.05, 0.3, 6) * rng.choice([-1.0, 1.0], 6)
    far = np.linalg.norm(truth[:, np.newaxis] - places, axis=-1) + offset
    sigma = 0.1
    # being late begins and ends at random; each time the delays have a mean of their own
    late = rng.random(6) < LATE
    mean = rng.uniform(0.3, 2.0, 6)
    for at in range(INSTANTS):
        far[at] += late * rng.exponential(mean) + sigma * rng.standard_normal(6)
        ends = late & (rng.random(6) < 1 / LASTING)
        begins = ~late & (rng.random(6) < LATE / (1 - LATE) / LASTING)
        mean = np.where(begins, rng.uniform(0.3, 2.0, 6), mean)
        late = (late & ~ends) | begins
    known = Bias(range_sigma=0.2)
    return Recording(list(places), truth, {"range": far}, sigma, known)


def _sounds(rng: np.random.Generator, drift: float = 1.0) -> Recording:
    """Draw differences of ranges of calls; the speed of sound is off by 1 %, one clock drifts."""
    truth = _way(rng, 300.0, 3.0)
    places = 600.0 * np.array([[-1.0, -1.0], [1, -1], [1, 1], [-1, 1], [0, 1.5], [-1.6, 0]])
    far = np.linalg.norm(truth[:, np.newaxis] - places, axis=-1) * (1 + rng.normal(0.0, 0.01))
    clock = rng.normal(0.0, 3.0) + rng.normal(0.0, 0.05) * np.arange(INSTANTS)
    far[:, 3] += drift * clock
    far += rng.standard_normal(far.shape)
    return Recording(list(places), truth, {"range_difference": far[:, 1:] - far[:, :1]}, 2**0.5)


def _shots(rng: np.random.Generator) -> Recording:
    """Draw the same with exact clocks."""
    return _sounds(rng, drift=0.0)


def _theodolites(rng: np.random.Generator) -> Recording:
    """Draw angles of three theodolites, not quite level, whose elevations refraction raises."""
    truth = np.column_stack([_way(rng, 1000.0, 30.0), np.full(INSTANTS, 2000.0)])
    places = np.array([[-4000.0, -3000.0, 10.0], [4500, -2500, 40], [500, 5000, 0]])
    sigma = np.radians(0.01)
    offset = truth[:, np.newaxis] - places
    flat = np.hypot(offset[..., 0], offset[..., 1])
    true = _azimuths(places, truth)
    noise, tilt = rng.standard_normal((2, INSTANTS, 3)), rng.standard_normal(3)
    lifted = tilt * np.cos(true - rng.uniform(0.0, 2 * np.pi, 3))
    lifted += 2 * abs(rng.standard_normal()) * flat / 5000.0
    measured = {
        "azimuth": true + sigma * noise[0],
        "elevation": np.arctan2(offset[..., 2], flat) + sigma * (lifted + noise[1]),
    }
    known = Bias(azimuth_sigma=0.0, elevation_sigma=0.025, degrees=True)
    return Recording(list(places), truth, measured, sigma, known)


def _inside(position: FloatArray, covariance: FloatArray, truth: FloatArray) -> float:
    known, size = np.isfinite(position).all(axis=-1), truth.shape[-1]
    if not known.any():
        return float("nan")
    error = (position - truth)[known]
    return float(np.mean(in_region(error, covariance[known][:, :size, :size])))


def _differences(recording: Recording, stated: float) -> dict[str, Any]:
    """Return the sigma of range differences, which is not that of a station, and their speed."""
    if "range_difference" not in recording.measured:
        return {}
    return {"range_difference_sigma": stated * recording.sigma, "propagation_speed": SOUND}


def _instants(recording: Recording, stated: float, **speed: Any) -> tuple[float, str]:
    options = _differences(recording, stated) | speed
    fix = locate(recording.sensors(stated), **recording.measured, **options)
    return _inside(fix.position, fix.covariance, recording.truth), fix.systematic


def _alone(recording: Recording, stated: float) -> tuple[float, str]:
    """Locate each instant in a call of its own."""
    stations, truth = recording.sensors(stated), recording.truth
    position, covariance = np.full_like(truth, np.nan), np.full((*truth.shape, 2), np.nan)
    for at, ranges in enumerate(recording.measured["range"]):
        with suppress(ValueError):
            fix = locate(stations, range=ranges)
            position[at], covariance[at] = fix.position, fix.covariance
    return _inside(position, covariance, truth), "estimated"


def _track(
    recording: Recording, stated: float, bias: Bias | None = None, **speed: Any
) -> tuple[float, str]:
    options = _differences(recording, stated) | speed
    time = STEP * np.arange(INSTANTS)
    path = reconstruct(recording.sensors(stated, bias), time, **recording.measured, **options)
    return _inside(path.position, path.covariance, recording.truth), path.systematic


def _stretched(recording: Recording, stated: float) -> tuple[float, str]:
    """State how well the speed of sound is known."""
    return _instants(recording, stated, **KNOWN_SPEED)


def _stretched_track(recording: Recording, stated: float) -> tuple[float, str]:
    return _track(recording, stated, **KNOWN_SPEED)


def _known(recording: Recording, stated: float) -> tuple[float, str]:
    return _track(recording, stated, recording.known)


def _arrivals(recording: Recording, stated: float) -> tuple[float, str]:
    """Give what was received to the solution with unknown clocks and speed."""
    late = np.column_stack([np.zeros(INSTANTS), recording.measured["range_difference"]]) / SOUND
    k = late.shape[1]
    time = late + STEP * np.arange(INSTANTS)[:, np.newaxis]
    sensor = np.tile(np.arange(k), INSTANTS)
    emission = np.repeat(np.arange(INSTANTS), k)
    heard = Arrivals(time.ravel(), sensor, np.ones(time.size, dtype=int), emission)
    stations = [Station(place, arrival_time_sigma=stated / SOUND) for place in recording.stations]
    path = reconstruct_arrivals(
        stations, heard, propagation_speed=SOUND, propagation_speed_sigma=0.01 * SOUND
    )
    return _inside(path.position, path.covariance, recording.truth), path.systematic


RECORDINGS: dict[str, Callable[[np.random.Generator], Recording]] = {
    "finders on three ships, headings off by a degree and drifting": _ships,
    "tag in a hall, reflections by place": _rooms,
    "calls, speed of sound off by 1 %, one clock drifts": _sounds,
    "theodolites not level, refraction": _theodolites,
    "shots, speed of sound off by 1 %, exact clocks": _shots,
    "tag in a hall, anchors with offsets, ranges late for seconds": _indoor,
}
KNOWN, ARRIVALS = "`reconstruct`, `bias` stated", "`reconstruct_arrivals`, no beacon"
ALONE = "`locate`, each instant alone"
SPEED = "`locate`, `propagation_speed_sigma` stated"
SPEED_OF_PATH = "`reconstruct`, `propagation_speed_sigma` stated"
WAYS: dict[str, Callable[[Recording, float], tuple[float, str]]] = {
    "`locate`": _instants,
    ALONE: _alone,
    SPEED: _stretched,
    "`reconstruct`": _track,
    SPEED_OF_PATH: _stretched_track,
    KNOWN: _known,
    ARRIVALS: _arrivals,
}
