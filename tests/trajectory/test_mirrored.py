"""Paths of which stations in a plane see the mirror image as well."""

import warnings

import numpy as np
import pytest
from checks import WITHIN_95
from trajectory.scenes import walk

from tertia import metrics, tables
from tertia.location import LIGHT, Station
from tertia.sensors import Bias
from tertia.trajectory import reconstruct

SIGMA = 10.0
TIME = np.arange(80.0)
# mean NEES of one path, whose errors are a few independent ones
WORST = 5.0
KINDS = ("range", "arrival_time", "range_difference", "azimuth")
WAYS = [
    {},
    {"spatial": "least-squares"},
    {"smoother": "local-polynomial"},
    {"order": "temporal-first"},
]


def ring(count, *, relief=0.0, rng=None):
    """Return stations around the origin, at heights that differ by so much."""
    turn = 2 * np.pi * (np.arange(count) + 0.3) / count
    distance = 4000.0 * np.resize([1.0, 0.7, 0.9, 0.6, 0.8], count)
    heights = relief * rng.standard_normal(count) if relief else np.zeros(count)
    return np.column_stack([distance * np.sin(turn), distance * np.cos(turn), heights])


def flight(height):
    """Return a path over the stations with a slow turn."""
    course = 0.7 + 0.008 * (TIME - 40.0)
    level = np.cumsum(40.0 * np.column_stack([np.sin(course), np.cos(course)]), axis=0)
    return np.column_stack([level - level.mean(axis=0) + [200.0, 100.0], 0 * TIME + height])


def seen(places, path, rng, kind="range"):
    """Return what the stations measure, with their standard deviations."""
    offset = path[:, np.newaxis] - places
    ranges = np.linalg.norm(offset, axis=-1)
    ranges += SIGMA * rng.standard_normal(ranges.shape)
    sigma = np.full(len(places), SIGMA)
    if kind == "arrival_time":
        return {"arrival_time": TIME[:, np.newaxis] + ranges / LIGHT,
                "arrival_time_sigma": sigma / LIGHT}  # fmt: skip
    if kind == "range_difference":
        return {"range_difference": ranges[:, 1:] - ranges[:, :1],
                "range_difference_sigma": sigma[1:] * np.sqrt(2)}  # fmt: skip
    found = {"range": ranges, "range_sigma": sigma}
    if kind == "azimuth":
        azimuth = np.arctan2(offset[..., 0], offset[..., 1])
        found |= {"azimuth": azimuth + 0.003 * rng.standard_normal(azimuth.shape)}
        found |= {"azimuth_sigma": np.full(len(places), 0.003)}
    return found


def path_of(places, measured, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return reconstruct([Station(place) for place in places], TIME, **measured, **options)


def squares(track, path):
    """Return the squared errors over the covariances."""
    d = path.shape[1]
    return metrics.nees(track.position - path, track.covariance[:, :d, :d])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("height", [300.0, 3000.0, 10_000.0])
def test_paths_above_stations_on_the_ground_stay_there(kind, height):
    if kind == "range_difference" and height < 3000.0:
        pytest.skip("the differences hardly tell so low a height")
    places, path = ring(2 if kind == "azimuth" else 6), flight(height)
    track = path_of(places, seen(places, path, np.random.default_rng(1), kind))
    assert np.all(track.position[:, 2] > 0)
    assert np.mean(squares(track, path)) < 3 * WORST
    assert track.mirror_image is not None
    np.testing.assert_allclose(track.mirror_image[:, :2], track.position[:, :2], atol=1e-6)
    np.testing.assert_allclose(track.mirror_image[:, 2], -track.position[:, 2], atol=1e-6)


@pytest.mark.parametrize("count", [3, 4, 6])
@pytest.mark.parametrize("relief", [0.0, 5.0])
def test_few_stations_and_small_differences_of_their_heights(count, relief):
    rng = np.random.default_rng(2)
    places, path = ring(count, relief=relief, rng=rng), flight(300.0)
    track = path_of(places, seen(places, path, rng))
    assert np.all(track.position[:, 2] > 0)
    assert np.mean(squares(track, path)) < 3 * WORST


@pytest.mark.parametrize("options", WAYS)
def test_all_ways_keep_to_one_side(options):
    places, path = ring(4), flight(2000.0)
    measured = seen(places, path, np.random.default_rng(3))
    with pytest.warns(UserWarning, match="mirror image"):
        track = reconstruct([Station(p) for p in places], TIME, **measured, **options)
    assert np.all(track.position[:, 2] > 0)
    assert np.max(np.abs(track.position - path)) < 60.0
    assert "mirror image possible" in repr(track)


@pytest.mark.parametrize("options", WAYS)
def test_an_initial_position_chooses_the_side(options):
    places, path = ring(4), flight(-500.0)
    measured = seen(places, path, np.random.default_rng(4))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        track = reconstruct(
            [Station(p) for p in places], TIME, **measured, initial=[0, 0, -1], **options
        )
    assert np.all(track.position[:, 2] < 0)
    assert track.mirror_image is None


def test_stations_at_heights_that_differ_tell_what_is_below_them():
    rng = np.random.default_rng(5)
    places, path = ring(6, relief=250.0, rng=rng), flight(-1500.0)
    track = path_of(places, seen(places, path, rng))
    assert np.all(track.position[:, 2] < 0)
    assert track.mirror_image is None
    above = path_of(places, seen(places, flight(1500.0), rng))
    assert np.all(above.position[:, 2] > 0)
    assert above.mirror_image is None


@pytest.mark.parametrize("bias", [None, Bias()])
@pytest.mark.parametrize(("height", "least"), [(0.0, 0.9), (60.0, 0.88), (300.0, 0.88)])
def test_heights_near_the_plane_of_the_stations_are_as_close_as_they_say(height, least, bias):
    inside, errors = [], []
    for seed in range(12):
        rng = np.random.default_rng([6, seed])
        places, path = ring(3 + seed % 4), flight(height)
        track = path_of(places, seen(places, path, rng), bias=bias)
        inside.append(squares(track, path) < WITHIN_95[3])
        errors.append(track.position[:, 2] - height)
    assert np.mean(inside) > least
    # a single instant does not know whether a boat is 90 m high
    assert np.sqrt(np.mean(np.square(errors))) < 70.0


def line(rng, path, count=4):
    places = np.column_stack([np.linspace(-3000, 3000, count), np.zeros(count)])
    return places, seen(places, path, rng)


def test_neither_side_of_a_line_is_above_the_other():
    path = flight(0.0)[:, :2] + [0.0, 3000.0]
    places, measured = line(np.random.default_rng(7), path)
    with pytest.raises(ValueError, match="mirror image"):
        reconstruct([Station(p) for p in places], TIME, **measured)
    for side in (1.0, -1.0):
        track = path_of(places, measured, initial=path[0] * [1.0, side])
        assert np.mean(squares(track, path * [1.0, side])) < 2 * WORST


def test_a_path_may_cross_the_line_of_the_stations():
    path = np.column_stack([-800 + 25 * TIME, 2000 - 45 * TIME])
    places, measured = line(np.random.default_rng(8), path)
    track = path_of(places, measured, initial=path[0])
    assert track.position[-1, 1] < -1000
    far = np.abs(path[:, 1]) > 300
    assert np.mean(squares(track, path)[far] < WITHIN_95[2]) > 0.85


def test_elevations_tell_the_side():
    places, path = ring(4), flight(300.0)
    measured = seen(places, path, np.random.default_rng(9))
    offset = path[:, np.newaxis] - places
    elevation = np.arctan2(offset[..., 2], np.linalg.norm(offset[..., :2], axis=-1))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        track = reconstruct(
            [Station(p, elevation_sigma=0.01) for p in places],
            TIME,
            **measured,
            elevation=elevation,
        )
    assert track.mirror_image is None
    assert np.max(np.abs(track.position - path)) < 60.0


def test_wrong_initial_positions():
    places, path = ring(4), flight(300.0)
    measured = seen(places, path, np.random.default_rng(10))
    for initial, message in ([0, 0], "initial has shape"), ([0, 0, np.nan], "initial"):
        with pytest.raises(ValueError, match=message):
            path_of(places, measured, initial=initial)


def test_tables_pass_the_initial_position():
    pl = pytest.importorskip("polars")
    places, path = ring(4), flight(-500.0)
    measured = seen(places, path, np.random.default_rng(11))["range"]
    table = pl.concat(
        pl.DataFrame({"time_s": TIME, "range_m": measured[:, k]}).with_columns(
            sensor=pl.lit(f"{k}")
        )
        for k in range(4)
    )
    stations = [Station(p, name=f"{k}", range_sigma=SIGMA) for k, p in enumerate(places)]
    found = tables.reconstruct(table, sensors=stations, initial=[0.0, 0.0, -1.0])
    assert found["up_m"].max() < 0


def warnings_of(places, path, seed, **options):
    """Return the path and the warnings about it."""
    measured = seen(places, path, np.random.default_rng(seed))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        track = reconstruct([Station(place) for place in places], TIME, **measured, **options)
    return track, " ".join(str(one.message) for one in caught)


def test_a_path_that_would_cross_the_plane_is_reported():
    places = ring(5)
    for height in (0.0, 60.0, 3000.0):
        _, said = warnings_of(places, flight(height), 5)
        assert "turns back" not in said
    falling = flight(0.0)
    falling[:, 2] = np.linspace(1000.0, -1000.0, len(TIME))
    track, said = warnings_of(places, falling, 5)
    assert "turns back at the plane of the stations" in said
    assert "reflected" in said
    assert np.all(track.position[:, 2] > -50.0)


def test_a_path_below_that_has_none_above_is_reported():
    places = ring(6, relief=250.0, rng=np.random.default_rng(0))
    track, said = warnings_of(places, flight(-1500.0), 0)
    assert np.all(track.position[:, 2] < 0)
    assert "no path above the stations fits" in said


def heard(seed, path, *, sigma=1.0, share=0.05):
    """Return 8 hydrophones on a line, and range differences of which some are wrong."""
    rng = np.random.default_rng(seed)
    places = np.column_stack([50.0 * (np.arange(8) - 3.5), np.zeros(8)])
    ranges = np.linalg.norm(path[:, np.newaxis] - places, axis=-1)
    ranges += sigma * rng.standard_normal(ranges.shape)
    wrong = rng.random(ranges.shape) < share
    ranges[wrong] += rng.uniform(10.0, 200.0, np.count_nonzero(wrong))
    given = {"range_difference": ranges[:, 1:] - ranges[:, :1]}
    return [Station(p) for p in places], given | {"range_difference_sigma": sigma * np.sqrt(2)}


def swim(count, start, course, turn=0.0):
    """Return a path at 2 m/s."""
    courses = course + turn * np.arange(count)
    return start + np.cumsum(2.0 * np.column_stack([np.sin(courses), np.cos(courses)]), axis=0)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("crosses", [False, True])
def test_outliers_do_not_make_a_path_cross_the_line(seed, crosses):
    if crosses:
        path = swim(300, [-100.0, 300.0], 2.6, 0.002)
    else:
        path = swim(300, [-150.0, 400.0], 1.2, 0.004)
    stations, given = heard(seed, path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        track = reconstruct(stations, np.arange(300.0), **given, initial=path[0])
    far = np.abs(path[:, 1]) > 30
    np.testing.assert_array_equal(np.sign(track.position[far, 1]), np.sign(path[far, 1]))
    assert np.mean(squares(track, path)[far] < WITHIN_95[2]) > 0.85


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("sigma", [5.0, 10.0])
def test_it_is_said_if_nothing_tells_whether_a_path_crosses_the_line(seed, sigma):
    """In a short record, a kink at the line is hardly less likely than a crossing."""
    path = swim(40, [60.0, 40.0], 2.8)
    stations, given = heard(seed, path, sigma=sigma, share=0.0)
    with pytest.warns(UserWarning, match="may cross it or turn back"):
        reconstruct(stations, np.arange(40.0), **given, initial=path[0])


def test_an_initial_position_does_not_make_a_path_unknown():
    # nearly in a plane: the search on the side of the initial position fails
    rng = np.random.default_rng([78, 16])
    times = 0.2 * np.arange(150.0)
    level = walk(rng, len(times), 0.2, [20.0, 20.0])
    path = np.column_stack([level, 1.2 + 0.2 * np.sin(times / 5)])
    places = np.column_stack([rng.uniform(0, 20, (6, 2)), rng.uniform(0, 4, 6)])
    ranges = np.linalg.norm(path[:, np.newaxis] - places, axis=-1)
    ranges += 0.1 * rng.standard_normal(ranges.shape)
    is_late = rng.random(ranges.shape) < 0.2
    ranges[is_late] += rng.exponential(2, np.count_nonzero(is_late))
    stations = [Station(place, range_sigma=0.1) for place in places]
    found = []
    for initial in (None, path[0]):
        # the path near the plane is doubtful, and this is said
        with pytest.warns(UserWarning, match="turns back at the plane"):
            found.append(reconstruct(stations, times, range=ranges, initial=initial))
    track, started = found
    np.testing.assert_allclose(started.position, track.position, atol=0.05)


def tag(seed):
    """Return anchors at 1.8 to 3.8 m, the path of a tag below them, and ranges to it."""
    rng, n = np.random.default_rng(seed), 100
    corners = np.array([[0, 0], [20, 0], [20, 15], [0, 15]])
    level = corners + rng.uniform(-0.5, 0.5, (4, 2))
    places = np.column_stack([level, rng.uniform(1.8, 3.8, 4)])
    course = np.cumsum(rng.standard_normal(n) * 0.15 * np.sqrt(0.2)) + rng.uniform(0, 6.28)
    way = np.cumsum(0.24 * np.column_stack([np.sin(course), np.cos(course)]), axis=0)
    way = np.clip(way - way.mean(axis=0) + [10, 7.5], 1, [19, 14])
    path = np.column_stack([way, np.full(n, 1.2)])
    distance = np.linalg.norm(path[:, np.newaxis] - places, axis=-1)
    return places, path, distance + 0.1 * rng.standard_normal(distance.shape)


def test_regions_reach_an_image_that_is_as_likely_and_not_stated():
    places, path, ranges = tag(108)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        anchors = [Station(place, range_sigma=0.1) for place in places]
        track = reconstruct(anchors, 0.2 * np.arange(100), range=ranges)
    error = np.abs(track.position[:, 2] - path[:, 2])
    assert np.mean(error > 2.0 * np.sqrt(track.covariance[:, 2, 2])) < 0.2
