"""The tables of the page on arrival times."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from studies.honesty import Draw, coverage_table
from studies.montecarlo import WITHIN_95, FloatArray, generator, in_region, normalised_squares
from studies.pages import DATA, markdown, repetitions, table_of
from tertia.sensors import Bias, Station
from tertia.trajectory import Arrivals, ArrivalTrajectory, reconstruct_arrivals

RUNS = repetitions(20)
HONEST_RUNS = repetitions(8, 1)
# emissions of a tag
SOME, MORE, MANY = repetitions(80, 40), repetitions(120, 60), repetitions(150, 60)
# of the recording: standard deviations of the boat's GPS in metres, and by how much it is late
GPS_SIGMAS, GPS_LATE = (2.0, 2.5), 3.0
BoolArray = npt.NDArray[np.bool_]
Errors = Callable[[tuple[int, int], FloatArray], FloatArray]


@dataclass(frozen=True)
class Net:
    """Receivers, beacons and tags; metres and seconds."""

    receivers: int = 8
    extent: float = 400.0
    speed: float = 1500.0
    speed_sigma: float = 8.0
    survey: float = 2.0
    path: float = 1e-3
    noise: float = 2.5e-4
    offset: float = 60.0
    rate: float = 2e-5
    drift: float = 1e-9
    tags: int = 1
    emissions: int = SOME
    interval: float = 30.0
    tag_speed: float = 1.0
    is_straight: bool = False
    turning: float = 0.0
    beacons: int = 3
    at_places: bool = False
    detected: float = 0.9


NETS: dict[str, Net] = {
    "8 hydrophones, beacons at 3 of them": Net(),
    "5 hydrophones, 2 tags": Net(receivers=5, tags=2),
    "8 hydrophones, 3 beacons at other known positions": Net(at_places=True),
    "10 hydrophones, 2 tags, no beacon": Net(
        receivers=10, tags=2, beacons=0, emissions=MANY, tag_speed=1.5, speed_sigma=3.0
    ),
    "8 hydrophones, clock drift ten times as large": Net(drift=1e-8),
    "8 hydrophones, straight path, emissions every 3 s on average": Net(
        is_straight=True, interval=3.0, emissions=MANY
    ),
    "radio, 6 receivers over 30 km, 3 aircraft": Net(
        receivers=6, extent=30e3, speed=299_792_458.0, speed_sigma=0.0, survey=0.5, path=0.0,
        noise=5e-8, offset=1e-3, rate=1e-9, drift=1e-12, tags=3, emissions=MORE, interval=1.0,
        tag_speed=150.0, is_straight=True, beacons=2, at_places=True,
    ),
    "radio, 8 receivers over 12 km, a bird that turns at random": Net(
        extent=12e3, speed=299_792_458.0, speed_sigma=0.0, survey=0.0, path=0.0, noise=3e-8,
        offset=1e-3, rate=3e-7, drift=1e-12, emissions=MANY, interval=5.0, tag_speed=12.0,
        turning=0.05, beacons=1,
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Scene:
    """What is given, and where each emission really came from."""

    stations: list[Station]
    arrivals: Arrivals
    beacons: dict[int, int | FloatArray]
    time: FloatArray
    source: FloatArray
    identity: npt.NDArray[np.int64]
    speed: float


def scene(net: Net, rng: np.random.Generator, errors: Errors | None = None) -> Scene:
    """Simulate a net; by default errors are Student's with 3 degrees of freedom."""
    place = rng.uniform(-0.5, 0.5, (net.receivers, 2)) * net.extent
    speed = net.speed + net.speed_sigma * rng.standard_normal()
    times, sources, names = [], [], []
    beacons: dict[int, int | FloatArray] = {}
    span = net.emissions * net.interval
    for name in range(net.beacons + net.tags):
        is_beacon = name < net.beacons
        count = net.emissions // 2 if is_beacon else net.emissions
        time = np.cumsum(rng.uniform(0.6, 1.4, count)) * span / count
        if is_beacon:
            here = rng.uniform(-0.5, 0.5, 2) * net.extent if net.at_places else place[name]
            beacons[name] = here if net.at_places else name
            sources.append(np.tile(here, (count, 1)))
        else:
            sources.append(way(net, time, rng))
        times.append(time)
        names.append(np.full(count, name))
    time, source, identity = np.concatenate(times), np.concatenate(sources), np.concatenate(names)
    offset = source[:, np.newaxis] - place
    travel = np.linalg.norm(offset, axis=-1) / speed
    azimuth = np.arctan2(offset[..., 0], offset[..., 1])
    error = np.empty_like(travel)
    for name in np.unique(identity):
        own = np.flatnonzero(identity == name)
        own = own[np.argsort(time[own])]
        if errors is None:
            error[own] = rng.standard_t(3, (len(own), net.receivers))
        else:
            error[own] = errors((net.receivers, len(own)), azimuth[own].T).T
        if name in beacons:
            travel[own] += net.path * rng.standard_normal(net.receivers)
    reading = time[:, np.newaxis] + travel + net.noise * error + clocks(net, time, rng)
    emission, sensor = np.nonzero(rng.random(reading.shape) < net.detected)
    given = place + net.survey * rng.standard_normal(place.shape)
    stations = [Station(p, position_sigma=net.survey, arrival_time_sigma=net.noise) for p in given]
    heard = Arrivals(reading[emission, sensor], sensor, identity[emission])
    return Scene(stations, heard, beacons, time, source, identity, speed)


def way(net: Net, time: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return positions on a line, straight or with random turns, or on three frequencies."""
    if net.turning:
        step = np.diff(time, prepend=time[0])
        heading = rng.uniform(0, 2 * np.pi) + np.cumsum(
            net.turning * np.sqrt(step) * rng.standard_normal(time.size)
        )
        pace = np.column_stack([np.sin(heading), np.cos(heading)])
        return np.asarray(np.cumsum(net.tag_speed * step[:, np.newaxis] * pace, axis=0))
    if net.is_straight:
        course = rng.uniform(0, 2 * np.pi)
        along = np.array([np.sin(course), np.cos(course)])
        return np.asarray(net.tag_speed * (time - time.mean())[:, np.newaxis] * along)
    rate = rng.uniform(0.5, 1.5, (3, 2)) * 3 * net.tag_speed / net.extent
    phase = rng.uniform(0, 2 * np.pi, (3, 2))
    size = rng.uniform(0.1, 0.25, (3, 2)) * net.extent
    waves = [size[i] * np.sin(rate[i] * time[:, np.newaxis] / (i + 1) + phase[i]) for i in range(3)]
    return np.asarray(sum(waves))


def clocks(net: Net, time: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return what clocks read more than the time; the first is right. Rates walk at random."""
    grid = np.linspace(0.0, 1.01 * time.max(), 400)
    step = grid[1]
    rates = net.drift * np.sqrt(step) * rng.standard_normal((net.receivers, grid.size))
    wander = step * np.cumsum(np.cumsum(rates, axis=1), axis=1)
    offset = net.offset * rng.standard_normal(net.receivers)
    rate = net.rate * rng.standard_normal(net.receivers)
    columns = [
        offset[k] + rate[k] * time + np.interp(time, grid, wander[k])
        for k in range(1, net.receivers)
    ]
    return np.column_stack([np.zeros_like(time), *columns])


def solved(given: Scene, net: Net) -> ArrivalTrajectory:
    """Reconstruct with the defaults."""
    return reconstruct_arrivals(
        given.stations,
        given.arrivals,
        beacons=given.beacons,
        propagation_speed=net.speed,
        propagation_speed_sigma=net.speed_sigma,
    )


def errors_of(given: Scene, track: ArrivalTrajectory) -> tuple[FloatArray, FloatArray]:
    """Return errors in metres, and squared in sigmas."""
    truth = np.empty_like(track.position)
    for name in np.unique(track.target):
        own, rows = track.target == name, np.flatnonzero(given.identity == name)
        near = np.argmin(np.abs(given.time[rows] - track.time[own][:, np.newaxis]), axis=1)
        truth[own] = given.source[rows[near]]
    error = track.position - truth
    return np.linalg.norm(error, axis=1), normalised_squares(error, track.covariance[:, :2, :2])


def nets() -> str:
    """Errors and coverage of simulated nets; the last column is over runs, as errors are common."""
    rows = []
    for at, (name, net) in enumerate(NETS.items()):
        found, claimed, speeds = [], [], []
        for run in range(RUNS):
            given = scene(net, generator(90, at, run))
            track = solved(given, net)
            found.append(errors_of(given, track))
            claimed.append(np.median(np.sqrt(np.sum(track.sigma**2, axis=1))))
            if net.speed_sigma:
                off = track.propagation_speed - given.speed
                speeds.append(off / track.propagation_speed_sigma)
        error = np.concatenate([one[0] for one in found])
        squares = np.concatenate([one[1] for one in found])
        inside = np.array([np.mean(one[1] < WITHIN_95[2]) for one in found])
        spread = inside.std(ddof=1) / np.sqrt(len(inside)) if len(inside) > 1 else np.nan
        rms = f"{np.sqrt(np.mean(np.square(speeds))):.2f}" if speeds else "–"
        rows.append([
            name, f"{np.median(error):.2f}", f"{np.quantile(error, 0.95):.2f}",
            f"{np.mean(claimed):.2f}", f"{inside.mean():.0%} ± {spread:.0%}",
            f"{np.mean(squares) / 2:.2f}", rms,
        ])  # fmt: skip
    head = ["network", "p50, m", "p95, m", "claimed sigma, m", "inside 95 %", "NEES per axis"]
    return markdown([*head, "speed error, RMS in sigmas"], rows)


def honesty() -> str:
    """Coverage with errors as they are in the field, with and without errors of the survey."""

    def inside(net: Net) -> Callable[[Draw], BoolArray]:
        def runs(draw: Draw) -> BoolArray:
            held = []
            for _ in range(HONEST_RUNS):
                given = scene(net, draw.rng, draw)
                held.append(errors_of(given, solved(given, net))[1] < WITHIN_95[2])
            return np.concatenate(held)

        return runs

    exact = replace(Net(), survey=0.0, path=0.0, speed_sigma=0.0)
    return coverage_table(
        {
            "`reconstruct_arrivals`, survey ± 2 m": inside(Net()),
            "`reconstruct_arrivals`, survey exact": inside(exact),
        },
        91,
    )


def recording() -> str:
    """Compare a tag that a boat tows with the boat's GPS, in the recording that comes with YAPS.

    Without the recording, the table is that of the page.
    """
    folder = DATA / "ssu1"
    if not folder.is_dir():
        return table_of("arrivals.md", "recording")
    detections, hydros, gps, yaps = (
        np.genfromtxt(folder / f"{name}.csv", delimiter=",", names=True)
        for name in ("detections", "hydros", "gps", "yaps_track")
    )
    places = np.column_stack([hydros["x"], hydros["y"]])
    middle, start = places.mean(axis=0), np.floor(gps["ts"][0])
    # the clock of the fifth is the one that agrees with the boat's
    stations = [
        Station(place - middle, position_sigma=3.0, bias=Bias() if at == 4 else None)
        for at, place in enumerate(places)
    ]
    number = {serial: at for at, serial in enumerate(hydros["serial"])}
    track = reconstruct_arrivals(
        stations,
        Arrivals(
            detections["epo"] - start + detections["frac"],
            [number[serial] for serial in detections["serial"]],
            detections["tag"].astype(int),
        ),
        beacons={int(tag): at for at, tag in enumerate(hydros["sync_tag"]) if np.isfinite(tag)},
        propagation_speed=1548.0,
        propagation_speed_sigma=8.0,
    )
    found = track.time + start, track.position + middle, track.covariance[:, :2, :2]
    published = yaps["top"], np.column_stack([yaps["x"], yaps["y"]]), None
    head = ["solution", "positions", "p50, m", "p90, m", "p99, m"]
    head += [f"inside 95 %, GPS ± {sigma:g} m" for sigma in GPS_SIGMAS]
    rows = [
        ["Tertia, GPS as recorded", *_against(gps, *found)],
        [f"Tertia, GPS {GPS_LATE:g} s later", *_against(gps, *found, late=GPS_LATE)],
        ["YAPS, as stored with the recording", *_against(gps, *published)],
    ]
    return markdown([*head, "scale of the positions"], rows)


def _against(
    gps: npt.NDArray[np.void],
    time: FloatArray,
    position: FloatArray,
    covariance: FloatArray | None,
    late: float = 0.0,
) -> list[str]:
    """Return percentiles of the errors, coverage, and the scale of the way."""
    known = (time > gps["ts"][0]) & (time < gps["ts"][-1])
    truth = np.column_stack(
        [np.interp(time[known] + late, gps["ts"], gps[axis]) for axis in ("utm_x", "utm_y")]
    )
    found = position[known]
    error = found - truth
    cells = [f"{len(error)}"]
    cells += [
        f"{part:.1f}" for part in np.quantile(np.linalg.norm(error, axis=1), [0.5, 0.9, 0.99])
    ]
    for sigma in GPS_SIGMAS:
        if covariance is None:
            cells.append("–")
            continue
        whole = covariance[known] + sigma**2 * np.eye(2)
        cells.append(f"{np.mean(in_region(error, whole)):.0%}")
    about = truth - truth.mean(axis=0)
    scale = np.sum(about * (found - found.mean(axis=0))) / np.sum(about**2)
    return [*cells, f"{scale:.3f}"]
