"""Errors that last: found from contradictions, given, or calibrated."""

import re

import numpy as np
import pytest
from checks import in_region
from places import DATA, difar

from tertia import metrics
from tertia.registration import calibrate
from tertia.sensors import Bias, Station
from tertia.trajectory import reconstruct

PLACES = np.array([[-1000.0, 1000.0], [1000.0, 900.0], [-900.0, -1000.0], [1000.0, -900.0]])
SIGMA = np.deg2rad(3.0)
TIMES = 5.0 * np.arange(120.0)


def way(rng):
    phase = rng.uniform(0, 2 * np.pi, 2)
    return np.column_stack(
        [700 * np.sin(TIMES / 90 + phase[0]), 600 * np.cos(TIMES / 110 + phase[1])]
    )


def directions(truth, places=PLACES):
    offset = truth[:, np.newaxis] - places
    return np.arctan2(offset[..., 0], offset[..., 1])


def finders(places=PLACES, **options):
    return [Station(place, azimuth_sigma=SIGMA, **options) for place in places]


def errors(kind, rng, azimuth):
    """Errors in standard deviations, (N, K)."""
    white = rng.standard_normal(azimuth.shape)
    n, k = azimuth.shape
    match kind:
        case "constant":
            return white + 1.5 * rng.standard_normal(k)
        case "per stop":
            return white + np.repeat(rng.standard_normal((6, k)), n // 6, axis=0)
        case "correlated":
            for i in range(1, n):
                white[i] = 0.9 * white[i - 1] + np.sqrt(0.19) * white[i]
            return white
        case "direction":
            sine, cosine = rng.standard_normal((2, k))
            return white + sine * np.sin(azimuth) + cosine * np.cos(azimuth)
        case "half":
            return 2.0 * white
        case _:
            return white


def inside(track, truth):
    error = track.position - truth
    return np.mean(in_region(error, track.covariance[:, :2, :2]))


@pytest.mark.parametrize("kind", ["constant", "per stop", "correlated", "direction", "half"])
def test_regions_hold_where_errors_are_not_as_stated(kind):
    trusted, default = [], []
    for run in range(12):
        rng = np.random.default_rng([40, run])
        truth = way(rng)
        azimuth = directions(truth)
        measured = azimuth + SIGMA * errors(kind, rng, azimuth)
        trusted.append(inside(reconstruct(finders(), TIMES, azimuth=measured, bias=Bias()), truth))
        track = reconstruct(finders(), TIMES, azimuth=measured)
        default.append(inside(track, truth))
        assert track.systematic == "estimated"
    assert np.mean(default) > 0.85
    if kind == "half":
        # noise that is larger than stated does not last: it is found in any case
        assert np.mean(trusted) > 0.85
    else:
        assert np.mean(default) > np.mean(trusted) + 0.1


def costs(paths):
    """Return by how much pairs of estimates have larger mean squared errors and variances."""
    squares = [[np.mean(np.square(one.position - truth)) for one in pair] for pair, truth in paths]
    sizes = [[np.mean(one.sigma**2) for one in pair] for pair, _ in paths]
    return [after / before for before, after in (np.mean(x, axis=0) for x in (squares, sizes))]


def test_healthy_scenes_do_not_pay():
    paths = []
    for run in range(12):
        rng = np.random.default_rng([41, run])
        truth = way(rng)
        measured = directions(truth) + SIGMA * rng.standard_normal((120, 4))
        pair = [
            reconstruct(finders(), TIMES, azimuth=measured, bias=bias) for bias in (Bias(), None)
        ]
        paths.append((pair, truth))
    square, size = costs(paths)
    assert square < 1.03**2
    assert size < 1.1


def test_what_nothing_contradicts_is_not_included():
    rng = np.random.default_rng(42)
    measured = directions(way(rng))[:, :2] + SIGMA * rng.standard_normal((120, 2))
    track = reconstruct(finders(PLACES[:2]), TIMES, azimuth=measured)
    assert track.systematic == "not included"
    assert "systematic error not included" in repr(track)
    trusted = reconstruct(finders(PLACES[:2]), TIMES, azimuth=measured, bias=Bias())
    assert trusted.systematic == "given"
    assert "not included" not in repr(trusted)
    np.testing.assert_array_equal(track.position, trusted.position)


@pytest.mark.parametrize("stated", ["call", "stations"])
def test_given_biases_are_removed_and_widen_the_covariance(stated):
    rng = np.random.default_rng(43)
    truth = way(rng)
    measured = directions(truth) + SIGMA * rng.standard_normal((120, 4)) + np.deg2rad(4.0)
    known = Bias(azimuth=4.0, azimuth_sigma=1.0, drift_share=0.5, drift_time=100.0, degrees=True)
    if stated == "call":
        track = reconstruct(finders(), TIMES, azimuth=measured, bias=known)
    else:
        track = reconstruct(finders(bias=known), TIMES, azimuth=measured)
    exact = reconstruct(finders(), TIMES, azimuth=measured - np.deg2rad(4.0), bias=Bias())
    assert track.systematic == "given"
    assert np.all(track.sigma > exact.sigma)
    assert np.linalg.norm(track.position - exact.position, axis=1).max() < 60
    np.testing.assert_allclose(track.bias.azimuth, np.deg2rad(4.0), atol=np.deg2rad(1.5))


def test_two_given_bearings_have_the_covariance_of_the_formula():
    """Constant errors add R diag(s^2) R' to an average of one place."""
    truth = np.tile([100.0, 50.0], (50, 1))
    places = np.array([[-1000.0, 0.0], [0.0, -1200.0]])
    measured = directions(truth, places)
    times = np.arange(50.0)
    s = np.deg2rad([1.0, 2.0])
    without, track = (
        reconstruct(finders(places), times, azimuth=measured, bias=bias, jerk=0.0)
        for bias in (Bias(), Bias(azimuth_sigma=s, drift_share=0.0))
    )
    offset = truth[0] - places
    square = np.sum(offset**2, axis=1)
    jacobian = np.column_stack([offset[:, 1] / square, -offset[:, 0] / square])
    response = np.linalg.inv(jacobian)
    expected = without.covariance[:, :2, :2] + response @ np.diag(s**2) @ response.T
    np.testing.assert_allclose(track.covariance[:, :2, :2], expected, rtol=1e-4)


def test_errors_of_the_survey_have_the_covariance_of_the_formula():
    """Ranges of stations whose places are off by s in each coordinate are off by s."""
    places = np.array([[-1000.0, 0.0], [0.0, -1200.0], [900.0, 700.0]])
    offset = np.array([100.0, 50.0]) - places
    measured = np.tile(np.linalg.norm(offset, axis=1), (20, 1))
    without, track = (
        reconstruct(
            [Station(place, range_sigma=2.0, position_sigma=sigma) for place in places],
            np.arange(20.0),
            range=measured,
            bias=Bias(),
            jerk=0.0,
        )
        for sigma in (0.0, 1.5)
    )
    units = offset / np.linalg.norm(offset, axis=1)[:, np.newaxis]
    expected = without.covariance[:, :2, :2] + 1.5**2 * np.linalg.inv(units.T @ units)
    np.testing.assert_allclose(track.covariance[:, :2, :2], expected, rtol=5e-3)
    with pytest.raises(ValueError, match="position_sigma of stations needs order"):
        reconstruct(
            [Station(place, range_sigma=2.0, position_sigma=1.0) for place in places],
            np.arange(20.0),
            range=measured,
            order="temporal-first",
        )


def test_calls_in_bursts_are_no_longer_records():
    """Errors of a stop last longer than its calls take, however long the ways between stops."""
    held = []
    for run in range(12):
        rng = np.random.default_rng([47, run])
        truth = way(rng)
        times = TIMES / 30.0 + 600.0 * (np.arange(120) // 20)
        measured = directions(truth) + SIGMA * errors("per stop", rng, directions(truth))
        held.append(inside(reconstruct(finders(), times, azimuth=measured), truth))
    assert np.mean(held) > 0.85


def test_a_calibrated_deviation_is_used():
    rng = np.random.default_rng(44)
    runs = np.linspace(0, 4 * np.pi, 240)
    amplitude = np.deg2rad(8.0) * rng.standard_normal((2, 4))

    def deviation(azimuth):
        return amplitude[0] * np.sin(azimuth) + amplitude[1] * np.cos(azimuth)

    stations = []
    for k, place in enumerate(PLACES):
        known = place + 900 * np.column_stack([np.sin(runs), np.cos(runs)])
        seen = runs + deviation(runs[:, np.newaxis])[:, k] + SIGMA * rng.standard_normal(240)
        bias = calibrate(
            Station(place, azimuth_sigma=SIGMA), np.arange(240.0), known, azimuth=seen % (2 * np.pi)
        )
        value, sigma = bias.at(runs)
        assert np.max(np.abs(value - deviation(runs[:, np.newaxis])[:, k]) / sigma) < 4.5
        stations.append(Station(place, azimuth_sigma=SIGMA, bias=bias))
    truth = way(rng)
    azimuth = directions(truth)
    measured = azimuth + deviation(azimuth) + SIGMA * rng.standard_normal(azimuth.shape)
    track = reconstruct(stations, TIMES, azimuth=measured)
    plain = reconstruct(finders(), TIMES, azimuth=measured, bias=Bias())
    assert track.systematic == "given"
    error, worse = (np.sqrt(np.mean((one.position - truth) ** 2)) for one in (track, plain))
    assert error < 0.6 * worse
    assert inside(track, truth) > 0.8


def test_a_large_deviation_is_that_of_the_true_azimuth():
    truth = way(np.random.default_rng(47))
    azimuth = directions(truth)
    card = Bias(azimuth=0.1, deviation_order=2, deviation=[0.15, -0.05, 0.05, 0.0])
    curve = 0.1 + 0.15 * np.sin(azimuth) - 0.05 * np.cos(azimuth) + 0.05 * np.sin(2 * azimuth)
    track = reconstruct(finders(), TIMES, azimuth=azimuth + curve, bias=card)
    plain = reconstruct(finders(), TIMES, azimuth=azimuth, bias=Bias())
    np.testing.assert_allclose(track.position, plain.position, rtol=0, atol=1e-4)


def test_a_calibration_is_uncertain_where_it_has_not_been():
    rng = np.random.default_rng(45)
    direction = np.linspace(0.0, np.deg2rad(150.0), 150)
    known = 900 * np.column_stack([np.sin(direction), np.cos(direction)])
    seen = direction + 0.1 * np.sin(2 * direction) + SIGMA * rng.standard_normal(150)
    station = Station([0.0, 0.0], azimuth_sigma=SIGMA)
    bias = calibrate(station, np.arange(150.0), known, azimuth=seen)
    assert bias.deviation_order in {2, 3}
    within, outside = (bias.at(np.deg2rad(angle))[1] for angle in (75.0, 270.0))
    assert outside > 3 * within
    narrow = calibrate(station, np.arange(90.0), known[:90], azimuth=seen[:90])
    assert narrow.deviation_order == 1


def calibrated(seed, curve, **options):
    """Return the calibration of a finder that deviates like this, and its errors in sigmas."""
    rng = np.random.default_rng([47, seed])
    direction = rng.uniform(0, 2 * np.pi, 300)
    known = 900 * np.column_stack([np.sin(direction), np.cos(direction)])
    seen = direction + curve(direction) + SIGMA * rng.standard_normal(300)
    station = Station([0.0, 0.0], azimuth_sigma=SIGMA)
    bias = calibrate(station, np.arange(300.0), known, azimuth=seen, **options)
    around = np.linspace(0, 2 * np.pi, 90)
    value, sigma = bias.at(around)
    return bias, (value - curve(around)) / sigma


def test_the_order_of_a_calibration_is_the_likeliest():
    def curve(a):
        return 0.08 * np.sin(a) + 0.05 * np.cos(4 * a)

    found = [calibrated(seed, curve) for seed in range(4)]
    assert [bias.deviation_order for bias, _ in found] == [4] * 4
    assert np.mean(np.abs([off for _, off in found]) < 1.96) > 0.9
    straight = [calibrated(seed, np.zeros_like)[0] for seed in range(4)]
    assert [bias.deviation_order for bias in straight] == [0] * 4


def test_a_deviation_that_no_series_describes_is_in_the_sigma():
    def curve(a):
        return 0.08 * np.sin(a) + 0.08 * np.cos(12 * a)

    for options in ({}, {"deviation_order": 2}):
        with pytest.warns(UserWarning, match="errors of azimuth depend on the direction by [23]"):
            found = [calibrated(seed, curve, **options)[1] for seed in range(4)]
        assert np.mean(np.abs(found) < 1.96) > 0.9


def test_a_calibration_of_all_kinds_survives_a_file(tmp_path):
    rng = np.random.default_rng(46)
    known = rng.uniform(-1000, 1000, (200, 3)) + np.array([0.0, 0.0, 1500.0])
    east, north, up = known.T
    bias = calibrate(
        Station([0.0, 0.0, 0.0], range_sigma=5.0, azimuth_sigma=0.01, elevation_sigma=0.01),
        np.arange(200.0),
        known,
        range=np.linalg.norm(known, axis=1) + 40 + 5 * rng.standard_normal(200),
        azimuth=np.arctan2(east, north) + 0.02 + 0.01 * rng.standard_normal(200),
        elevation=np.arctan2(up, np.hypot(east, north)) - 0.03 + 0.01 * rng.standard_normal(200),
        deviation_order=0,
    )
    for kind, true in (("range", 40.0), ("azimuth", 0.02), ("elevation", -0.03)):
        assert abs(getattr(bias, kind) - true) < 4 * getattr(bias, f"{kind}_sigma")
    bias.save(tmp_path / "bias.json")
    assert repr(Bias.load(tmp_path / "bias.json")) == repr(bias)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"time": np.arange(5.0)[::-1]}, "time[1] is before the previous time"),
        ({"position": np.ones((4, 2))}, "position has shape (4, 2); it must be (5, 2)"),
        ({"azimuth": None}, "nothing was measured"),
        ({"azimuth": np.full(5, np.nan)}, "azimuth has no measurement"),
        ({"azimuth": np.ones(4)}, "azimuth has shape (4,); it must be (5,)"),
        ({"range": np.ones(5)}, "range_sigma of the station is missing"),
        ({"elevation": np.ones(5)}, "elevation needs a station with three coordinates"),
    ],
)
def test_what_cannot_be_calibrated(changes, message):
    call = {"time": np.arange(5.0), "position": np.ones((5, 2)), "azimuth": np.ones(5)} | changes
    with pytest.raises(ValueError, match=re.escape(message)):
        calibrate(
            Station([0.0, 0.0], azimuth_sigma=0.1), call.pop("time"), call.pop("position"), **call
        )


def test_fields_of_a_bias_that_cannot_be():
    for fields, message in (
        ({"drift_share": 1.5}, "drift_share is 1.5; it must be between 0 and 1"),
        ({"drift_time": 0.0}, "drift_time is 0.0; it must be positive"),
        (
            {"azimuth": [0.0, 1.0], "deviation_covariance": [[1.0]]},
            "deviation_covariance is for one",
        ),
        ({"deviation_order": 1, "deviation": [1.0]}, "deviation has shape (1,)"),
    ):
        with pytest.raises(ValueError, match=re.escape(message)):
            Bias(**fields)


@pytest.mark.skipif(not (DATA / "difar").is_dir(), reason="the recording is not there")
def test_drifting_direction_finders_as_recorded():
    """The default was chosen with a look at this recording."""
    times, places, azimuth, truth = difar()
    stations = [Station(places[:, k], azimuth_sigma=np.deg2rad(5.0)) for k in range(4)]
    track = reconstruct(stations, times, azimuth=azimuth)
    assert track.systematic == "estimated"
    assert inside(track, truth) > 0.75
    enough = np.sum(~np.isnan(azimuth), axis=-1) >= 3
    error = np.linalg.norm(track.position - truth, axis=-1)[enough]
    assert np.all(np.percentile(error, [50, 90, 99]) < [219, 430, 500])


def test_clocks_of_receivers_that_walk_are_found():
    """Errors of receivers last in range differences, whichever receiver they are taken to."""
    trusted, default = [], []
    for run in range(8):
        rng = np.random.default_rng([41, run])
        truth = way(rng)
        places = np.vstack([PLACES, [[0.0, 1400.0], [1500.0, 100.0]]])
        far = np.linalg.norm(truth[:, np.newaxis] - places, axis=-1)
        walks = np.cumsum(0.5 * rng.standard_normal(far.shape), axis=0)
        far += 3.0 * rng.standard_normal(far.shape) + walks + 4.0 * rng.standard_normal(6)
        stated = {"range_difference": far[:, 1:] - far[:, :1]}
        stated["range_difference_sigma"] = 3.0 * np.sqrt(2.0)
        stations = [Station(place) for place in places]
        trusted.append(inside(reconstruct(stations, TIMES, bias=Bias(), **stated), truth))
        track = reconstruct(stations, TIMES, **stated)
        default.append(inside(track, truth))
        assert track.systematic == "estimated"
    assert np.mean(default) > 0.85
    assert np.mean(default) > np.mean(trusted) + 0.2


def test_large_errors_that_last_are_no_faults():
    """They would be left out as outliers, and what remained be taken for all that there is."""
    found = []
    for run in range(8):
        rng = np.random.default_rng([42, run])
        truth = way(rng)
        places = np.vstack([PLACES, [[0.0, 1400.0], [1500.0, 100.0]]])
        azimuth = directions(truth, places)
        lasting = 4.0 * np.repeat(rng.standard_normal((12, 6)), 10, axis=0)
        measured = azimuth + SIGMA * (lasting + rng.standard_normal(azimuth.shape))
        bias = reconstruct(finders(places), TIMES, azimuth=measured).bias
        found.append(np.mean(np.square(bias.azimuth_sigma) + np.square(bias.azimuth)))
    # what all finders may have in common is taken to be as large
    assert 0.8 < np.sqrt(np.mean(found)) / (4.0 * np.sqrt(2.0) * SIGMA) < 1.25


def test_three_bearings_of_one_place_exclude_no_lasting_errors():
    """Their errors contradict in one way only, which large ones leave silent now and then."""
    said = []
    for run in range(6):
        rng = np.random.default_rng([43, run])
        truth = np.full((120, 2), [100.0, 200.0]) + 0.05 * TIMES[:, np.newaxis]
        azimuth = directions(truth, PLACES)
        measured = azimuth + SIGMA * rng.standard_normal(azimuth.shape)
        three = reconstruct(finders(PLACES[:3]), TIMES, azimuth=measured[:, :3])
        four = reconstruct(finders(), TIMES, azimuth=measured)
        said.append((three.systematic, four.systematic))
    assert said.count(("not included", "estimated")) >= 3


@pytest.mark.parametrize("missing", [0.0, 0.1])
def test_four_healthy_ranges_in_space_are_trusted(missing):
    """One redundant range says little, so that the priors of lasting errors must not."""
    places = np.array([[2500.0, 0, 0], [0, -2600, 150], [-2400, 100, 400], [300, 2500, 600]])
    stations = [Station(place, range_sigma=10.0) for place in places]
    time = np.arange(60.0)
    removed, ratios, squares = [], [], []
    for seed in range(16):
        rng = np.random.default_rng([41, seed])
        course = rng.uniform(0, 2 * np.pi) + 0.01 * time
        path = np.cumsum(20.0 * np.column_stack([np.sin(course), np.cos(course), 0 * time]), axis=0)
        path += np.append(rng.uniform(-600, 600, 2), 2000.0) - path.mean(axis=0)
        ranges = np.linalg.norm(path[:, np.newaxis] - places, axis=-1)
        ranges += 10.0 * rng.standard_normal(ranges.shape)
        ranges[rng.random(ranges.shape) < missing] = np.nan
        track, trusted = (
            reconstruct(stations, time, range=ranges, **options)
            for options in ({}, {"bias": Bias()})
        )
        removed.append(np.any(track.bias.range != 0))
        ratios.append(np.mean(track.sigma) / np.mean(trusted.sigma))
        error = track.position - path
        squares.append(metrics.nees(error, track.covariance[:, :3, :3]) / 3)
    # 12 % were removed, sigma was up to 1.6 times that of trusted stations, and NEES .6
    assert np.mean(removed) < 0.1
    assert np.mean(ratios) < 1.15
    assert np.mean(squares) > 0.65


def tags(speed, count, run):
    """Return a tag's path among anchors with constant offsets of 1 to 10 sigmas, and its errors."""
    rng = np.random.default_rng([49, count, run])
    turn = 2 * np.pi * (np.arange(count) + rng.uniform(-0.3, 0.3, count)) / count
    places = 10.0 * np.column_stack([np.sin(turn), np.cos(turn)])
    course = rng.uniform(0, 2 * np.pi) + np.cumsum(0.1 * rng.standard_normal(60))
    path = speed * np.cumsum(np.column_stack([np.sin(course), np.cos(course)]), axis=0)
    path += rng.uniform(-3.0, 3.0, 2) - path.mean(axis=0)
    ranges = np.linalg.norm(path[:, np.newaxis] - places, axis=-1)
    ranges += rng.uniform(0.1, 1.0, count) * rng.choice([-1.0, 1.0], count)
    ranges += 0.1 * rng.standard_normal(ranges.shape)
    stations = [Station(place, range_sigma=0.1) for place in places]
    track = reconstruct(stations, np.arange(60.0), range=ranges)
    return track, path


def test_regions_of_a_tag_at_rest_hold_where_anchors_have_constant_offsets():
    held = [inside(*tags(0.0, count, run)) for count in (4, 8) for run in range(32)]
    # where an eighth of the variance of large errors had to drift, too, it was 0.50
    assert np.mean(held) > 0.7


def test_constant_offsets_are_found_from_a_tag_that_walks():
    held, squares = [], []
    for run in range(32):
        track, path = tags(0.2, 4, run)
        held.append(inside(track, path))
        squares.append(np.mean(np.sum(np.square(track.position - path), axis=1)))
    assert np.mean(held) > 0.9
    # where an eighth of the variance of large errors had to drift, too, it was 0.27 m
    assert np.sqrt(np.median(squares)) < 0.15


def test_given_errors_of_one_time():
    """Equal times of all instants: the correlation time of errors that do not drift was 0."""
    truth = np.tile([300.0, 200.0], (5, 1))
    azimuth = directions(truth) + SIGMA * np.random.default_rng(1).standard_normal((5, 4))
    track = reconstruct(finders(), np.zeros(5), azimuth=azimuth, bias=Bias(azimuth_sigma=SIGMA))
    alone = reconstruct(finders(), np.zeros(5), azimuth=azimuth, bias=Bias())
    own, without = (one.covariance[0, [0, 1], [0, 1]] for one in (track, alone))
    assert np.all(own > without)


RADARS = [
    Station(place, range_sigma=15.0, azimuth_sigma=0.002)
    for place in ([0.0, 0.0], [12e3, 0.0], [5e3, -9e3])
]


def in_turn(run, periods, is_turning, bias=(0.0, 0.0)):
    """Return times, a path, and ranges and azimuths of radars; one has a bias in sigmas."""
    rng = np.random.default_rng([49, run])
    starts = np.array(periods) * (0.1 + np.arange(len(periods)) / len(periods))
    own = [np.arange(start, 240, period) for start, period in zip(starts, periods, strict=True)]
    time = np.sort(np.concatenate(own))
    course = 0.03 * np.clip(time - 100, 0, 60) * is_turning
    steps = 80 * np.diff(time, prepend=0)[:, np.newaxis]
    truth = np.cumsum(steps * np.column_stack([np.cos(course), np.sin(course)]), axis=0)
    truth += [-4e3, 9e3]
    offset = truth[:, np.newaxis] - [radar.position for radar in RADARS[: len(periods)]]
    measured = np.array([np.hypot(*offset.T).T, np.arctan2(offset[..., 0], offset[..., 1])])
    error = rng.standard_normal(measured.shape)
    error[:, :, 1] += np.array(bias)[:, np.newaxis]
    measured += np.array([15.0, 0.002])[:, np.newaxis, np.newaxis] * error
    for station, times in enumerate(own):
        measured[:, ~np.isin(time, times), station] = np.nan
    return time, truth, *measured


@pytest.mark.parametrize("bias", [(2.0, 0.0), (4.0, 0.0), (0.0, 2.0)])
@pytest.mark.parametrize("is_turning", [False, True])
@pytest.mark.parametrize("periods", [(4.0, 4.0), (4.0, 4.0, 4.0), (4.0, 10.0)])
def test_biases_of_radars_that_measure_in_turn_are_found(periods, is_turning, bias):
    """No instant has redundant measurements; neighbouring ones contradict each other."""
    default = []
    for run in range(5):
        time, truth, ranges, azimuth = in_turn(run, periods, is_turning, bias)
        track = reconstruct(RADARS[: len(periods)], time, range=ranges, azimuth=azimuth)
        assert track.systematic == "estimated"
        default.append(inside(track, truth))
    assert np.mean(default) > 0.9


@pytest.mark.parametrize("is_turning", [False, True])
def test_healthy_radars_that_measure_in_turn_hardly_pay(is_turning):
    paths = []
    for run in range(12):
        time, truth, ranges, azimuth = in_turn(run, (4.0, 4.0), is_turning)
        pair = [
            reconstruct(RADARS[:2], time, range=ranges, azimuth=azimuth, bias=bias)
            for bias in (Bias(), None)
        ]
        paths.append((pair, truth))
    square, size = costs(paths)
    assert square < 1.03**2
    assert size < 1.4


def test_nothing_contradicts_a_radar_alone():
    time, _, ranges, azimuth = in_turn(0, (4.0, 4.0), True)
    own = ~np.isnan(ranges[:, 0])
    track = reconstruct(RADARS[:1], time[own], range=ranges[own, :1], azimuth=azimuth[own, :1])
    assert track.systematic == "not included"


def radars(seed, unit):
    """Return a track from ranges (in this unit) and azimuths of three radars, and its path in m."""
    rng = np.random.default_rng(seed)
    places = np.array([[0.0, 0.0], [20e3, 5e3], [5e3, 25e3]])
    time = 4.0 * np.arange(60.0)
    path = np.column_stack([15e3 + 8e3 * np.cos(time / 100), 60 * time - 10e3])
    offset = path[:, np.newaxis] - places
    distance = np.linalg.norm(offset, axis=-1)
    measured = distance + 50.0 * rng.standard_normal(distance.shape) + [0.0, 600.0, 0.0]
    azimuth = np.arctan2(offset[..., 0], offset[..., 1])
    azimuth += 0.5e-3 * rng.standard_normal(azimuth.shape)
    stations = [Station(unit * p, range_sigma=50.0 * unit, azimuth_sigma=0.5e-3) for p in places]
    return reconstruct(stations, time, range=unit * measured, azimuth=azimuth), path


def test_errors_of_ranges_are_found_beside_precise_azimuths():
    track, path = radars(1, 1.0)
    assert track.bias.range[1] == pytest.approx(600.0, abs=60.0)
    assert inside(track, path) > 0.85
    other, _ = radars(1, 1e-3)
    np.testing.assert_allclose(1e3 * other.position, track.position, atol=0.01)
    np.testing.assert_allclose(1e3 * other.bias.range, track.bias.range, atol=0.01)


@pytest.mark.parametrize(("seed", "step"), [(4, 550.0), (7, 150.0), (24, 78.0)])
def test_errors_that_stated_sigmas_allow_are_of_no_station_alone(seed, step):
    """Ranges in coarse steps to a phone at rest have constant errors."""
    rng = np.random.default_rng(seed)
    places, truth = rng.uniform(-4000, 4000, (5, 2)), rng.uniform(-2000, 2000, 2)
    steps = np.floor(np.linalg.norm(truth - places, axis=-1) / step) * step + step / 2
    stations = [Station(place, range_sigma=step / np.sqrt(12)) for place in places]
    track = reconstruct(stations, 2.0 * np.arange(60), range=np.tile(steps, (60, 1)))
    assert not np.any(track.outlier.range)
    assert inside(track, truth) == 1.0


def test_least_squares_leaves_no_station_out():
    rng = np.random.default_rng(1)
    truth = way(rng)
    distance = np.linalg.norm(truth[:, np.newaxis] - PLACES, axis=-1)
    measured = distance + 15.0 * rng.standard_normal(distance.shape)
    measured[5, 1] += 800.0
    stations = [Station(place, range_sigma=15.0) for place in PLACES]
    track = reconstruct(stations, TIMES, range=measured, spatial="least-squares")
    assert not np.any(track.outlier.range)
