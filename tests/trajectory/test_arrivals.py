"""Trajectories from arrival times at receivers that nobody synchronised."""

import pickle
import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from checks import WITHIN_95, in_region
from places import DATA, needs_data
from trajectory.nets import BEACON, SPEED, TAG, Net, net, solved

from tertia import metrics
from tertia.sensors import Bias, Station
from tertia.trajectory import (
    Arrivals,
    ArrivalTrajectory,
    ClockBias,
    group_arrivals,
    reconstruct_arrivals,
)


def calls(
    seed: int, *, speed: float, fast: float = 3.0, rate: float = 0.0, beacon: bool = False
) -> Net:
    """Simulate one source that walks straight past clocks that are off and at different rates."""
    rng = np.random.default_rng(seed)
    place = 600.0 * np.array([[-1.0, -1.0], [1, -1], [1, 1], [-1, 1], [0, 1.5], [-1.6, 0]])
    time = np.cumsum(rng.uniform(1.0, 3.0, 60))
    course = rng.uniform(0.0, 2 * np.pi) + np.cumsum(rng.normal(0.0, 0.03, 60))
    steps = fast * np.diff(time, prepend=0.0)[:, np.newaxis]
    source = rng.uniform(-200, 200, 2) + np.cumsum(
        steps * np.column_stack([np.sin(course), np.cos(course)]), axis=0
    )
    names = np.where(beacon & (np.arange(60) % 3 == 0), BEACON, TAG)
    source[names == BEACON] = place[2]
    clock = rng.uniform(-5, 5, 6) + (rate + 1e-5) * rng.standard_normal(6) * time[:, np.newaxis]
    clock[:, 0] = 0.0
    reading = time[:, np.newaxis] + clock
    reading += np.linalg.norm(source[:, np.newaxis] - place, axis=-1) / speed
    reading += 1.0 / speed * rng.standard_normal(reading.shape)
    row, sensor = np.nonzero(np.ones(reading.shape, dtype=bool))
    return Net(
        [Station(p) for p in place],
        Arrivals(reading[row, sensor], sensor, names[row], row),
        {BEACON: 2} if beacon else {},
        time,
        source,
        names,
        clock,
        row,
    )


def truth_of(scene: Net, track: ArrivalTrajectory) -> npt.NDArray[np.float64]:
    """Return where the emissions really came from."""
    found = np.empty_like(track.position)
    for name in np.unique(track.target):
        own, rows = track.target == name, np.flatnonzero(scene.identity == name)
        near = np.argmin(np.abs(scene.time[rows] - track.time[own][:, np.newaxis]), axis=1)
        found[own] = scene.source[rows[near]]
    return found


def distances(scene: Net, track: ArrivalTrajectory) -> npt.NDArray[np.float64]:
    """Return squared errors, normalised."""
    d = track.position.shape[1]
    error = track.position - truth_of(scene, track)
    return np.asarray(metrics.nees(error, track.covariance[:, :d, :d]))


def check_result(track: ArrivalTrajectory, n: int) -> None:
    """Check what holds for every result."""
    assert track.success
    assert len(track.arrivals) == n
    assert np.all(np.diff(track.time) > 0)
    assert track.covariance == pytest.approx(np.swapaxes(track.covariance, -1, -2), rel=1e-12)
    assert np.all(np.linalg.eigvalsh(track.covariance)[:, 0] > 0)
    assert np.all(track.time_sigma > 0)
    used = track.arrivals.emission
    assert used is not None
    assert np.array_equal(used < 0, np.isnan(track.residual))
    assert not track.outlier[used < 0].any()


def test_clocks_and_positions_of_one_tag() -> None:
    scene = net(1)
    track = solved(scene)
    check_result(track, len(scene.arrivals))
    assert track.systematic == "estimated"
    assert abs(track.correlation) < 0.2
    assert "correlated" not in repr(track)
    assert np.median(np.linalg.norm(track.position - truth_of(scene, track), axis=1)) < 1.5
    # the clocks, beyond the travel time that an error of the survey may hide
    value, sigma = track.bias.at(time=scene.time)
    inside = (scene.time > track.bias.node[0]) & (scene.time < track.bias.node[-1])
    off = (value - scene.clock.T)[1:, inside] / sigma[1:, inside]
    assert np.sqrt(np.mean(off**2)) < 2.0
    assert np.all(value[0] == 0)
    assert np.all(sigma[0] == 0)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"tags": 3, "beacons": 1},
        {"beacons": 0, "tags": 2, "k": 9, "emissions": 80},
        {"late": 0.15, "k": 9},
        {"dimension": 3, "k": 12},
        {"survey": 0.0, "speed": 299_792_458.0, "noise": 1e-8, "extent": 20e3},
    ],
    ids=["one tag", "three tags", "no beacon", "late arrivals", "in space", "radio"],
)
def test_regions_hold_the_truth(options: dict[str, Any]) -> None:
    squares = []
    given = {"propagation_speed": options.get("speed", SPEED)}
    if "speed" in options:
        given["propagation_speed_sigma"] = 0.0
    for seed in range(6):
        scene = net(seed, **options)
        track = solved(scene, **given)
        check_result(track, len(scene.arrivals))
        squares.append(distances(scene, track))
    d = options.get("dimension", 2)
    inside = np.mean(np.concatenate(squares) < WITHIN_95[d])
    # six nets share few errors of survey and speed: some 3 % of uncertainty
    assert 0.86 < inside <= 1.0
    assert np.median(np.concatenate(squares)) < 2.0 * d


def test_emissions_are_found_whatever_the_clocks() -> None:
    scene = net(3, tags=2)
    grouped = group_arrivals(scene.arrivals)
    assert grouped.emission is not None
    # each emission of the truth is one found, and the other way round
    pairs = set(zip(scene.emission.tolist(), grouped.emission.tolist(), strict=True))
    assert len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs})
    assert "emissions" in repr(grouped)
    # the time base does not matter
    base = [
        Station(one.position, position_sigma=1.0, bias=Bias(time=12.5) if at == 3 else None)
        for at, one in enumerate(scene.stations)
    ]
    first = solved(scene)
    scene.stations = base
    other = solved(scene)
    assert np.all(other.bias[3].reading == 12.5)
    assert len(first.time) == len(other.time)
    assert np.max(np.abs(first.position - other.position) / first.sigma) < 0.1


def periodic(seed: int, *, count: int) -> Net:
    """Simulate a tag with a constant interval, and two beacons with `count` irregular emissions."""
    rng = np.random.default_rng([31, seed, count])
    place = np.column_stack([np.tile([0.0, 250, 500, 750], 2), np.repeat([0.0, 300], 4)])
    clock = rng.normal(0.0, 20.0, 8)
    times = [30.0 * np.arange(1, 241)]
    times += [np.sort(rng.uniform(0.0, 7200.0, count)) for _ in range(2)]
    way = np.column_stack([300 * np.sin(times[0] / 900 + seed), 120 * np.cos(times[0] / 700)])
    sources = [place.mean(axis=0) + way, *(np.tile(place[at], (count, 1)) for at in (0, 6))]
    arrival, sensor, identity, emission = [], [], [], []
    for name, (emitted, source) in enumerate(zip(times, sources, strict=True)):
        far = np.linalg.norm(source[:, np.newaxis] - place, axis=-1)
        which, receiver = np.nonzero(rng.random(far.shape) < 0.7 * np.exp(-((far / 600) ** 3)))
        heard = emitted[which] + far[which, receiver] / SPEED + clock[receiver]
        arrival.append(heard + 3e-4 * rng.standard_normal(len(heard)))
        sensor.append(receiver)
        identity.append(np.full(len(heard), name))
        emission.append(which + 1000 * name)
    columns = [np.concatenate(one) for one in (arrival, sensor, identity, emission)]
    arrivals = Arrivals(*columns[:3])
    stations = [Station(one) for one in place]
    return Net(stations, arrivals, {}, columns[0], place, columns[2], clock, columns[3])


@pytest.mark.parametrize("count", [20, 60])
def test_beacons_tell_which_multiple_of_the_interval_a_clock_is_off(count: int) -> None:
    for seed in range(6):
        data = periodic(seed, count=count)
        found = group_arrivals(data.arrivals).emission
        assert found is not None
        order = np.argsort(found, kind="stable")[np.count_nonzero(found < 0) :]
        same = np.diff(found[order]) == 0
        right = np.diff(data.emission[order]) == 0
        assert np.mean(right[same]) > 0.98, seed


def test_an_echo_is_not_used_and_an_outlier_is_marked() -> None:
    scene = net(4)
    heard = scene.arrivals
    echo = Arrivals(
        np.append(heard.time, heard.time[10] + 0.02),
        np.append(heard.sensor, heard.sensor[10]),
        np.append(heard.identity, heard.identity[10]),
    )
    echo.time[50] += 0.05
    scene.arrivals = echo
    track = solved(scene)
    assert track.arrivals.emission is not None
    assert track.arrivals.emission[-1] == -1
    assert track.outlier[50]
    assert np.count_nonzero(track.outlier) < 8


def test_corrected_times_and_saved_clocks(tmp_path: Path) -> None:
    scene = net(5)
    track = solved(scene)
    corrected = track.bias.correct(scene.arrivals)
    value, _ = track.bias.at(time=corrected)
    again = corrected + value[scene.arrivals.sensor, np.arange(len(corrected))]
    assert again == pytest.approx(scene.arrivals.time, abs=1e-9)
    one = track.bias[2]
    assert one.at(time=100.0)[0] == pytest.approx(track.bias.at(time=100.0)[0][2])
    assert one.at(time=track.bias.node[-1] + 1e3)[1] == np.inf
    track.bias.save(tmp_path / "clocks.json")
    loaded = ClockBias.load(tmp_path / "clocks.json")
    for kept in (pickle.loads(pickle.dumps(track.bias)), loaded):
        assert np.array_equal(kept.reading, track.bias.reading)
        assert np.array_equal(kept.time_sigma, track.bias.time_sigma)


def test_a_receiver_that_never_hears_a_beacon() -> None:
    scene = net(6)
    heard = scene.arrivals
    keep = (heard.sensor != 4) | (heard.identity == TAG)
    scene.arrivals = Arrivals(heard.time[keep], heard.sensor[keep], heard.identity[keep])
    track = solved(scene)
    check_result(track, int(keep.sum()))
    assert np.mean(distances(scene, track) < WITHIN_95[2]) > 0.8


def test_a_receiver_that_hears_nothing() -> None:
    scene = net(7)
    scene.stations.append(Station([0.0, 0.0], position_sigma=1.0))
    track = solved(scene)
    assert track.bias.at(time=100.0)[1][7] > 1e-3


def test_scale_and_systematic_errors_are_told() -> None:
    scene = net(8)
    far = solved(scene, propagation_speed=SPEED + 60, propagation_speed_sigma=3.0)
    assert far.propagation_speed_deviation < -3
    assert "sigmas from the given one" in repr(far)
    scene = net(8, beacons=0, tags=2, survey=0.0, k=9, emissions=80)
    track = solved(scene, propagation_speed_sigma=0.0)
    assert track.systematic == "not included"
    assert "systematic error not included" in repr(track)
    assert solved(scene, propagation_speed_sigma=0.0, path_sigma=0.0).systematic == "given"


def test_errors_that_last_are_told() -> None:
    scene = net(1, noise=1e-5)
    heard = scene.arrivals
    # of the tag, by the receiver and slowly in time
    lasting = 3e-4 * np.sin(heard.time / 150 + heard.sensor) * (heard.identity == TAG)
    scene.arrivals = Arrivals(heard.time + lasting, heard.sensor, heard.identity)
    track = solved(scene)
    assert track.correlation > 0.3
    assert "residuals correlated" in repr(track)


def test_clocks_that_share_no_emission_are_named() -> None:
    scene = net(9)
    heard = scene.arrivals
    apart = np.where(heard.sensor >= 5, heard.identity + 100, heard.identity)
    scene.arrivals = Arrivals(heard.time, heard.sensor, apart)
    with pytest.raises(ValueError, match="clocks of station 5, station 6 cannot be tied"):
        solved(scene)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"propagation_speed": 0.0}, "propagation_speed is 0"),
        ({"propagation_speed_sigma": -1.0}, "propagation_speed_sigma is -1"),
        ({"path_sigma": np.nan}, "path_sigma is nan"),
        ({"jerk": 0.0}, "jerk is 0"),
        ({"beacons": {1: 9}}, "beacons[1] is station 9; there are 7 stations"),
        ({"beacons": {1: [0.0, 0.0, 0.0]}}, "beacons[1] has shape (3,)"),
        ({"arrivals": Arrivals([1.0], [9], [1])}, "sensor 9; there are 7"),
        ({"arrivals": Arrivals([1.0, 2.0], [0, 1], [1, 2], [0, 1])}, "cannot be tied"),
        (
            {"stations": [Station([i, 0.0], bias=Bias(time_sigma=1.0)) for i in range(7)]},
            "stations[0].bias.time_sigma is 1.0",
        ),
        ({"stations": [Station([0.0, 0.0])]}, "at least 2"),
        ({"stations": [Station([0.0, 0.0])] * 7}, "all at the same place"),
    ],
)
def test_wrong_arguments(changes: dict[str, Any], message: str) -> None:
    scene = net(10)
    given: dict[str, Any] = {
        "stations": scene.stations,
        "arrivals": scene.arrivals,
        "beacons": scene.beacons,
        "propagation_speed": SPEED,
    } | changes
    stations: Any = given.pop("stations")
    arrivals: Any = given.pop("arrivals")
    with pytest.raises(ValueError, match=re.escape(message)):
        reconstruct_arrivals(stations, arrivals, **given)


def test_times_too_large_to_resolve_the_travel() -> None:
    scene = net(11)
    heard = scene.arrivals
    late = Arrivals(heard.time + 1.7e9, heard.sensor, heard.identity)
    with pytest.raises(ValueError, match="subtract a common start"):
        reconstruct_arrivals(scene.stations, late, propagation_speed=299_792_458.0)


def test_wrong_columns() -> None:
    with pytest.raises(ValueError, match=re.escape("sensor has shape (1,); it must be (2,)")):
        Arrivals([1.0, 2.0], [0], [1, 1])
    with pytest.raises(TypeError, match="sensor has dtype float64"):
        Arrivals([1.0], [0.5], [1])
    with pytest.raises(TypeError, match="identity has dtype float64"):
        Arrivals([1.0], [0], [0.5])
    with pytest.raises(ValueError, match="emission is -2"):
        Arrivals([1.0], [0], [1], [-2])


def test_errors_that_last_widen_the_regions() -> None:
    inside, sigma = {}, {}
    for lasting in (0.0, 0.9):
        held, sizes = [], []
        for run in range(4):
            scene = net(120 + run, survey=0.0, emissions=80, lasting=lasting)
            track = reconstruct_arrivals(
                scene.stations, scene.arrivals, beacons=scene.beacons, propagation_speed=SPEED
            )
            rows = np.flatnonzero(scene.identity == TAG)
            gaps = np.abs(scene.time[rows] - track.time[:, np.newaxis])
            error = track.position - scene.source[rows[np.argmin(gaps, axis=1)]]
            held.append(in_region(error, track.covariance[:, :2, :2]))
            sizes.append(np.median(track.sigma))
        inside[lasting], sigma[lasting] = np.mean(np.concatenate(held)), np.mean(sizes)
    assert 0.9 < inside[0.0] < 0.99
    assert inside[0.9] > 0.65
    assert sigma[0.9] > 1.5 * sigma[0.0]


@needs_data
def test_the_hydrophones_of_ssu1() -> None:
    folder = DATA / "ssu1"
    detections = np.genfromtxt(folder / "detections.csv", delimiter=",", names=True)
    receivers = np.genfromtxt(folder / "hydros.csv", delimiter=",", names=True)
    gps = np.genfromtxt(folder / "gps.csv", delimiter=",", names=True)
    start = 1_568_045_000
    time = (detections["epo"] - start) + detections["frac"]
    serial = {number: at for at, number in enumerate(receivers["serial"])}
    sensor = np.array([serial[number] for number in detections["serial"]])
    place = np.column_stack([receivers["x"], receivers["y"]])
    middle = place.mean(axis=0)
    # the clock of the fifth is the one that agrees with the boat's
    stations = [
        Station(p - middle, position_sigma=3.0, bias=Bias() if at == 4 else None)
        for at, p in enumerate(place)
    ]
    tags = {int(tag): at for at, tag in enumerate(receivers["sync_tag"]) if np.isfinite(tag)}

    def track_of(chosen: npt.NDArray[np.bool_]) -> ArrivalTrajectory:
        heard = Arrivals(time[chosen], sensor[chosen], detections["tag"][chosen].astype(int))
        return reconstruct_arrivals(
            stations, heard, beacons=tags, propagation_speed=1548.0, propagation_speed_sigma=8.0
        )

    track = track_of(np.ones(len(time), dtype=bool))
    instants = track.time + start
    inside = (instants > gps["ts"][0]) & (instants < gps["ts"][-1])
    truth = np.column_stack([np.interp(instants, gps["ts"], gps[c]) for c in ("utm_x", "utm_y")])
    error = (track.position + middle - truth)[inside]
    distance = np.linalg.norm(error, axis=1)
    assert np.median(distance) < 3.6
    assert np.quantile(distance, 0.99) < 8.0
    covariance = track.covariance[inside, :2, :2] + 2.5**2 * np.eye(2)
    assert 0.93 < np.mean(in_region(error, covariance)) <= 0.99
    about = (truth - truth[inside].mean(axis=0))[inside]
    found = track.position[inside] - track.position[inside].mean(axis=0)
    assert abs(np.sum(about * found) / np.sum(about**2) - 1) < 0.012
    assert abs(track.propagation_speed_deviation) < 3
    # two halves of the receivers, which share no measurement but the base
    halves = [track_of((sensor % 2 == part) | (sensor == 4)) for part in (0, 1)]
    pairs = np.abs(halves[0].time[:, np.newaxis] - halves[1].time)
    a, b = np.nonzero(pairs < 2.0)
    off = halves[0].position[a] - halves[1].position[b]
    both = halves[0].covariance[a, :2, :2] + halves[1].covariance[b, :2, :2]
    nees = np.mean(metrics.nees(off, both)) / 2
    assert len(a) > 80
    assert nees < 1.3


def test_a_walk_is_not_taken_for_the_rates_of_clocks() -> None:
    """At 3 m/s, sound is shifted by a hundred times as much as clocks differ in their rates."""
    inside = []
    for seed in range(8):
        scene = calls(seed, speed=340.0)
        track = solved(scene, propagation_speed=340.0, propagation_speed_sigma=3.4)
        error = np.linalg.norm(track.position - truth_of(scene, track), axis=1)
        assert np.median(error) < 60.0
        inside.append(np.mean(distances(scene, track) < WITHIN_95[2]))
    assert np.mean(inside) > 0.8


def test_clocks_of_bad_rates_are_found_with_a_beacon() -> None:
    scene = calls(3, speed=340.0, rate=1e-3, beacon=True)
    track = solved(scene, propagation_speed=340.0, propagation_speed_sigma=0.0)
    clock, sigma = track.bias.at(time=scene.time[[10, 50]])
    assert clock == pytest.approx(scene.clock[[10, 50]].T, abs=0.01)
    assert np.all(sigma[1:] > 0)


@pytest.mark.parametrize("seed", [2, 8, 14])
def test_wrong_places_of_few_arrivals_do_not_stay(seed: int) -> None:
    """Four receivers leave two solutions, of which the motion tells which one is right."""
    scene = net(seed, k=5, tags=2, emissions=60, heard=0.85)
    assert np.max(distances(scene, solved(scene))) < 60.0


def walk(seed: int, acceleration: float) -> Net:
    """Simulate a tag whose motion is driven by white acceleration, and a beacon."""
    scene = net(seed, k=8, emissions=150, survey=0.0, beacons=1)
    rng = np.random.default_rng([seed, 1])
    own = scene.identity == TAG
    place, velocity = np.zeros(2), np.zeros(2)
    places = []
    for dt in np.diff(scene.time[own], prepend=scene.time[own][0] - 20.0):
        # what of the place follows the change of velocity, and what does not
        change = np.sqrt(acceleration * dt) * rng.standard_normal(2)
        rest = np.sqrt(acceleration * dt**3 / 12) * rng.standard_normal(2)
        place = place + dt * velocity + 0.5 * dt * change + rest
        velocity = velocity + change
        places.append(place)
    sites = np.array([station.position for station in scene.stations])
    before = np.linalg.norm(scene.source[:, np.newaxis] - sites, axis=-1)
    scene.source[own] = places
    longer = np.linalg.norm(scene.source[:, np.newaxis] - sites, axis=-1) - before
    heard = scene.arrivals
    travel = longer[scene.emission, heard.sensor] / SPEED
    scene.arrivals = Arrivals(heard.time + travel, heard.sensor, heard.identity)
    return scene


def test_motion_that_is_rougher_than_white_jerk() -> None:
    """A velocity that is a random walk: white jerk alone would smooth it too much."""
    inside, found = [], []
    for seed in range(6):
        scene = walk(seed, 3e-5)
        track = solved(scene)
        found.append(track.acceleration_noise[TAG])
        inside.append(np.mean(distances(scene, track) < WITHIN_95[2]))
    assert np.median(found) == pytest.approx(3e-5, rel=0.3)
    assert np.mean(inside) > 0.91


def test_a_smooth_motion_has_no_white_acceleration() -> None:
    """On a curve, it adds hardly anything to what white jerk adds to the velocity in a step."""
    shares = []
    for seed in range(6):
        track = solved(net(seed, k=8, emissions=150, survey=0.0, beacons=1))
        shares.append(track.acceleration_noise[TAG] / (track.jerk[TAG] * 20.0**2 / 3))
    assert np.median(shares) < 0.1


def test_times_beyond_the_range_of_sums():
    scale = 1e304
    time = np.cumsum(np.random.default_rng(1).uniform(20, 40, 200))
    time = np.concatenate([time, time + 71.3]) * scale
    heard = Arrivals(time, np.repeat([0, 1], 200), np.full(400, TAG))
    assert len(group_arrivals(heard)) == 400


@pytest.mark.parametrize("order", [[0, 1, 2, 3, 4], [3, 1, 4, 0, 2]])
def test_a_path_without_beacons_is_found_whatever_the_start(order: list[int]) -> None:
    """Emissions that are located one by one with wrong clocks lead to a wrong path."""
    rng = np.random.default_rng(1)
    time = np.cumsum(rng.uniform(8, 12, 80))
    truth = np.column_stack([200 + 0.9 * time, 300 + 200 * np.sin(time / 200)])
    places = np.array([[0, 0], [800, 100], [100, 900], [900, 1000], [400, -300.0]])
    distance = np.linalg.norm(truth[:, np.newaxis] - places, axis=-1)
    arrival = time[:, np.newaxis] + distance / 1500 + 2e-4 * rng.standard_normal(distance.shape)
    arrival += [0, 0.3, -0.2, 0.5, 0.1]
    emission, sensor = np.nonzero(rng.random(distance.shape) < 0.8)
    heard = Arrivals(
        arrival[emission, sensor], np.argsort(order)[sensor], np.zeros(len(sensor), int)
    )
    stations = [Station(places[at], arrival_time_sigma=2e-4) for at in order]
    track = reconstruct_arrivals(stations, heard, propagation_speed=1500.0)
    known = np.searchsorted(time, track.time + 4.0) - 1
    off = track.position - truth[known]
    assert np.median(np.hypot(*off.T)) < 5.0


@pytest.mark.parametrize("seed", [3, 4])
def test_a_wrong_survey_is_told_and_not_used(seed: int) -> None:
    scene = net(seed, k=8, emissions=60)
    wrong = scene.stations[5]
    scene.stations[5] = Station(wrong.position + np.array([25.0, -15.0]), position_sigma=1.0)
    with pytest.warns(UserWarning, match="the position of station 5: it is .* m from the stated"):
        track = solved(scene)
    near = np.argmin(np.abs(scene.time[:, np.newaxis] - track.time), axis=0)
    error = track.position - scene.source[near]
    assert np.mean(in_region(error, track.covariance[:, :2, :2])) >= 0.8
    assert np.linalg.norm(track.stations[5].position - wrong.position) < 8.0
