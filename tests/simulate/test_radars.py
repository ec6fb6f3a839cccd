"""Plots of simulated radars, and the scenarios by which methods are compared."""

from typing import get_args

import numpy as np
import pytest

from tertia.fusion import fuse_series
from tertia.kalman import SingerModel
from tertia.simulate import ScenarioName, radar_scenario, radars

MODEL = SingerModel(5.0, 0.05, 0.003)


class TestRadars:
    def test_noise_of_each_radar_at_each_step(self):
        sigma = np.array([[0.1, 0.2, 0.3], [1.0, 2.0, 4.0]])
        record = radars(MODEL, 3, sigma=sigma, batch=20_000, rng=1)
        error = record.z - record.truth[:, np.newaxis, :, 0]
        assert record.z.shape == (20_000, 2, 3)
        np.testing.assert_allclose(error.mean(axis=0) / sigma, 0, atol=4 / np.sqrt(20_000))
        np.testing.assert_allclose(error.std(axis=0) / sigma, 1, atol=4 / np.sqrt(40_000))
        score = (error / sigma).reshape(20_000, 6)
        np.testing.assert_allclose(score.T @ score / 20_000, np.eye(6), atol=0.045)
        assert np.mean(score**4) == pytest.approx(3, abs=4 * np.sqrt(24 / score.size))
        assert not record.outlier.any()

    @pytest.mark.parametrize("exact", [False, True])
    def test_motion_is_that_of_the_model(self, exact):
        model = SingerModel(5.0, 0.1, 0.2, exact=exact)
        record = radars(model, 30, angle=40.0, rate=0.5, batch=20_000, rng=2)
        truth = record.truth
        assert truth.shape == (20_000, 30, 3)
        np.testing.assert_array_equal(truth[:, 0, :2], np.tile([40.0, 0.5], (20_000, 1)))
        # the acceleration is stationary
        np.testing.assert_allclose(truth[..., 2].std(axis=0), 0.2, rtol=4 / np.sqrt(40_000))
        push = truth[:, 1:] - truth[:, :-1] @ model.transition().T
        noise = model.process_noise()
        found = np.einsum("rsi,rsj->ij", push, push) / (20_000 * 29)
        scale = np.sqrt(np.diag(noise)) + 1e-9
        np.testing.assert_allclose((found - noise) / np.outer(scale, scale), 0, atol=0.01)
        assert np.corrcoef(push[:, 10, 2], push[:, 11, 2])[0, 1] == pytest.approx(0, abs=0.03)
        fading = np.mean(truth[:, 9, 2] * truth[:, 8, 2]) / 0.04
        assert fading == pytest.approx(np.exp(-0.5) if exact else 0.5, abs=0.04)

    def test_gaps(self):
        seen = np.array([[1.0, 0.0, 0.3], [0.7, 1.0, 0.0]])
        record = radars(MODEL, 3, detection_probability=seen, batch=20_000, rng=3)
        share = 1 - np.isnan(record.z).mean(axis=0)
        np.testing.assert_array_equal(share[[0, 0, 1, 1], [0, 1, 1, 2]], [1, 0, 1, 0])
        assert share[0, 2] == pytest.approx(0.3, abs=4 * np.sqrt(0.21 / 20_000))
        assert share[1, 0] == pytest.approx(0.7, abs=4 * np.sqrt(0.21 / 20_000))
        each = radars(MODEL, 3, detection_probability=[[1.0], [0.0]], rng=3).z
        np.testing.assert_array_equal(np.isnan(each), [[False] * 3, [True] * 3])
        assert not np.isnan(record.truth).any()

    def test_booleans_are_probabilities(self):
        seen = np.array([[True, False, True], [False, True, True]])
        for flags in (seen, seen.tolist(), seen.astype(object)):
            z = radars(MODEL, 3, detection_probability=flags, rng=3).z
            np.testing.assert_array_equal(~np.isnan(z), seen)
        numbers = radars(MODEL, 3, detection_probability=seen.astype(float), rng=3).z
        np.testing.assert_array_equal(z, numbers)
        assert not np.isnan(radars(MODEL, 3, detection_probability=True, rng=3).z).any()
        wrong = radars(MODEL, 3, outlier_probability=~seen, rng=3).outlier
        np.testing.assert_array_equal(wrong, ~seen)

    def test_outliers(self):
        probability = np.array([[0.0, 0.3], [1.0, 0.1]])
        record = radars(
            MODEL,
            2,
            sigma=[0.1, 0.2],
            outlier_probability=probability,
            outlier_size=10.0,
            batch=20_000,
            rng=4,
        )
        share = record.outlier.mean(axis=0)
        error = 4 * np.sqrt(probability * (1 - probability) / 20_000)
        assert (np.abs(share - probability) <= error).all()
        off = record.z - record.truth[:, np.newaxis, :, 0]
        for radar, sigma in enumerate([0.1, 0.2]):
            wrong = record.outlier[:, radar]
            size = off[:, radar][wrong].std() / sigma
            assert size == pytest.approx(10, rel=4 / np.sqrt(2 * wrong.sum()))
        sound = off[:, 0][~record.outlier[:, 0]]
        assert sound.std() == pytest.approx(0.1, rel=4 / np.sqrt(2 * sound.size))
        missing = radars(MODEL, 50, detection_probability=0.5, outlier_probability=1.0, rng=4)
        np.testing.assert_array_equal(missing.outlier, ~np.isnan(missing.z))

    def test_a_turn(self):
        """Its rate is the derivative of its angle, its acceleration that of its rate."""
        dt, first, last, top = 0.01, 100, 900, 1.5
        model = SingerModel(dt, 0.05, 0.0)
        truth = radars(model, 1200, turn=(first, last, top), angle=7.0, rate=0.25, rng=5).truth
        plain = radars(model, 1200, angle=7.0, rate=0.25, rng=5).truth
        angle, rate, acceleration = (truth - plain).T
        for value, derivative in ((angle, rate), (rate, acceleration)):
            differences = (value[2:] - value[:-2]) / (2 * dt)
            smooth = ~np.isin(np.arange(1, 1199), [first, last])
            expected = derivative[1:-1]
            np.testing.assert_allclose(differences[smooth], expected[smooth], atol=1e-4 * top)
        # the turn is over outside its steps, and the rate highest in the middle
        outside = np.r_[0 : first + 1, last:1200]
        np.testing.assert_allclose(rate[outside], 0, atol=1e-12)
        np.testing.assert_allclose(acceleration[outside], 0, atol=1e-12)
        assert rate[(first + last) // 2] == pytest.approx(top)
        assert rate.max() == pytest.approx(top)
        assert angle[first] == pytest.approx(0, abs=1e-12)
        # half of the highest rate, all the time
        np.testing.assert_allclose(angle[last:], top * (last - first) * dt / 2, rtol=1e-12)

    def test_a_turn_may_end_after_the_record(self):
        truth = radars(MODEL, 10, turn=(5, 30, 2.0), rng=6).truth
        whole = radars(MODEL, 40, turn=(5, 30, 2.0), rng=6).truth
        assert truth.shape == (10, 3)
        assert np.isfinite(truth).all()
        # the first acceleration is drawn alike; then the draws are too
        np.testing.assert_allclose(truth, whole[:10], rtol=1e-12)

    def test_plots_wrap_and_the_truth_does_not(self):
        record = radars(MODEL, 200, angle=359.9, rate=1.0, period=360.0, batch=5, rng=7)
        plain = radars(MODEL, 200, angle=359.9, rate=1.0, batch=5, rng=7)
        assert record.truth.max() > 1000
        assert record.z.min() >= 0
        assert record.z.max() < 360
        turns = (plain.z - record.z) / 360
        np.testing.assert_allclose(turns, np.round(turns), atol=1e-12)

    def test_a_plot_just_below_north_is_not_360(self):
        record = radars(SingerModel(5.0, 0.05, 0.0), 50, sigma=[1e-17], period=360.0, rng=8)
        assert record.z.min() >= 0
        assert record.z.max() < 360

    @pytest.mark.parametrize(("batch", "shape"), [((), ()), (4, (4,)), ((2, 0), (2, 0))])
    def test_shapes(self, batch, shape):
        record = radars(MODEL, 9, sigma=[0.1, 0.2, 0.3], batch=batch, rng=9)
        assert record.z.shape == record.outlier.shape == (*shape, 3, 9)
        assert record.truth.shape == (*shape, 9, 3)
        assert radars(MODEL, 1, sigma=[0.1], rng=9).z.shape == (1, 1)

    def test_a_seed_gives_the_same_record_and_a_generator_goes_on(self):
        first, second = (radars(MODEL, 9, rng=3).z for _ in range(2))
        np.testing.assert_array_equal(first, second)
        generator = np.random.default_rng(3)
        np.testing.assert_array_equal(radars(MODEL, 9, rng=generator).z, first)
        assert not np.array_equal(radars(MODEL, 9, rng=generator).z, first)

    @pytest.mark.parametrize(
        ("options", "error", "message"),
        [
            ({"steps": 0}, ValueError, "steps is 0"),
            ({"steps": 2.5}, TypeError, "steps is 2.5"),
            ({"sigma": 0.1}, ValueError, "sigma is"),
            ({"sigma": []}, ValueError, "sigma is"),
            ({"sigma": np.ones((1, 1, 1))}, ValueError, "sigma is"),
            ({"sigma": [0.1, -0.1]}, ValueError, "sigma is"),
            ({"sigma": [0.1, np.nan]}, ValueError, r"sigma\[1\] is nan"),
            ({"sigma": np.ones((2, 3))}, ValueError, r"sigma has shape \(2, 3\)"),
            ({"detection_probability": 1.5}, ValueError, "detection_probability is 1.5"),
            ({"detection_probability": -0.5}, ValueError, "detection_probability is -0.5"),
            ({"detection_probability": [0.5] * 3}, ValueError, "detection_probability has shape"),
            ({"detection_probability": [True] * 3}, ValueError, "detection_probability has shape"),
            ({"detection_probability": [[True], []]}, ValueError, "detection_probability is ragg"),
            ({"detection_probability": "yes"}, TypeError, "detection_probability has dtype"),
            (
                {"detection_probability": np.ma.array([[True], [True]], mask=[[0], [1]])},
                ValueError,
                r"detection_probability\[1, 0\] is nan",
            ),
            ({"outlier_probability": np.inf}, ValueError, "outlier_probability is inf"),
            ({"outlier_probability": 2}, ValueError, "outlier_probability is 2"),
            ({"outlier_size": -1}, ValueError, "outlier_size is -1"),
            ({"outlier_size": "x"}, TypeError, "outlier_size is 'x'"),
            ({"turn": 5}, TypeError, "turn is 5; it must be"),
            ({"turn": (5, 5, 1.0)}, ValueError, r"turn is \(5, 5, 1.0\)"),
            ({"turn": (-1, 5, 1.0)}, ValueError, "turn is -1"),
            ({"turn": (1.5, 5, 1.0)}, TypeError, "turn is 1.5"),
            ({"turn": (1, 5, np.nan)}, ValueError, "turn is nan"),
            ({"angle": np.nan}, ValueError, "angle is nan"),
            ({"rate": np.inf}, ValueError, "rate is inf"),
            ({"period": 0}, ValueError, "period is 0"),
            ({"period": -360.0}, ValueError, "period is -360"),
            ({"batch": -1}, ValueError, "batch is -1"),
            ({"rng": "x"}, TypeError, "rng is 'x'"),
        ],
    )
    def test_bad_parameters(self, options, error, message):
        with pytest.raises(error, match=message):
            radars(**{"model": MODEL, "steps": 10} | options)

    def test_a_model_is_needed(self):
        with pytest.raises(TypeError, match="model is 5; it must be a SingerModel"):
            radars(5, 10)


SCENARIOS = get_args(ScenarioName)
MANY = 2000
FAULTS = {
    "noisy": range(60, 120),
    "outliers": range(60, 80),
    "turn": range(60, 72),
    "unknown": range(120),
    "outage": range(60, 68),
}


def plot_errors(scenario):
    return scenario.z - scenario.truth[..., np.newaxis, :, 0]


class TestRadarScenario:
    @pytest.mark.parametrize("name", SCENARIOS)
    @pytest.mark.parametrize(("batch", "shape"), [((), ()), (4, (4,)), ((2, 3), (2, 3))])
    def test_goes_straight_into_the_fusion(self, name, batch, shape):
        s = radar_scenario(name, steps=50, batch=batch, rng=1)
        steps = 100 if name == "asynchronous" else 50
        assert s.z.shape == s.outlier.shape == (*shape, 2, steps)
        assert s.truth.shape == (*shape, steps, 3)
        assert s.counted.shape == s.disturbed.shape == (steps,)
        assert s.counted.dtype == s.disturbed.dtype == bool
        track = fuse_series(s.z, s.measurement_variance, s.model)
        error = (track.mean - s.truth)[..., s.counted, 0]
        assert error.shape == (*shape, 30)
        assert np.abs(error).max() < 2

    @pytest.mark.parametrize("name", SCENARIOS)
    def test_fault_and_scans_that_count(self, name):
        s = radar_scenario(name, rng=1)
        fault = list(FAULTS.get(name, []))
        np.testing.assert_array_equal(np.flatnonzero(s.disturbed), fault)
        first, step = (40, 2) if name == "asynchronous" else (20, 1)
        np.testing.assert_array_equal(
            np.flatnonzero(s.counted), np.arange(first, s.z.size / 2, step)
        )

    def test_the_fault_begins_in_the_middle(self):
        shorter = radar_scenario("noisy", steps=47, rng=1)
        np.testing.assert_array_equal(np.flatnonzero(shorter.disturbed), range(23, 47))
        quicker = SingerModel(2.5, 0.05, 0.003)
        turn = radar_scenario("turn", model=quicker, steps=100, rng=1)
        np.testing.assert_array_equal(np.flatnonzero(turn.disturbed), range(50, 74))
        long_ago = radar_scenario("outliers", steps=40, rng=1)
        np.testing.assert_array_equal(np.flatnonzero(long_ago.disturbed), range(20, 40))

    @pytest.mark.parametrize("name", SCENARIOS)
    def test_noise_in_the_fault_and_elsewhere(self, name):
        s = radar_scenario(name, batch=MANY, rng=2)
        usual = [0.05, 0.2] if name in {"known", "unknown"} else [0.1, 0.1]
        faulty = [0.1, 0.5] if name == "noisy" else usual
        sound = np.where(s.outlier, np.nan, plot_errors(s))
        for steps, sigma in ((~s.disturbed, usual), (s.disturbed, faulty)):
            for radar, expected in enumerate(sigma):
                error = sound[:, radar, steps]
                error = error[~np.isnan(error)]
                if error.size:
                    assert error.std() == pytest.approx(expected, rel=4 / np.sqrt(2 * error.size))
                    assert abs(error.mean()) < 4 * expected / np.sqrt(error.size)

    @pytest.mark.parametrize("name", SCENARIOS)
    def test_what_the_radars_state(self, name):
        s = radar_scenario(name, rng=1)
        stated = [[0.05], [0.2]] if name == "known" else [[0.1], [0.1]]
        np.testing.assert_allclose(s.measurement_variance, np.square(stated), rtol=1e-15)

    @pytest.mark.parametrize("name", SCENARIOS)
    def test_outliers(self, name):
        s = radar_scenario(name, batch=MANY, rng=3)
        assert not s.outlier[:, 0].any()
        assert not s.outlier[:, 1, ~s.disturbed].any()
        if name != "outliers":
            assert not s.outlier.any()
            return
        wrong = s.outlier[:, 1, s.disturbed]
        assert wrong.mean() == pytest.approx(0.3, abs=4 * np.sqrt(0.21 / wrong.size))
        size = plot_errors(s)[s.outlier]
        assert size.std() == pytest.approx(1.5, rel=4 / np.sqrt(2 * size.size))
        assert np.mean((size / 1.5) ** 4) == pytest.approx(3, abs=4 * np.sqrt(96 / size.size))

    @pytest.mark.parametrize("name", sorted(set(SCENARIOS) - {"outage", "asynchronous"}))
    def test_no_plot_is_missing(self, name):
        assert not np.isnan(radar_scenario(name, batch=20, rng=4).z).any()

    def test_outage(self):
        s = radar_scenario("outage", batch=MANY, rng=5)
        seen = ~np.isnan(s.z)
        assert not seen[:, 1, s.disturbed].any()
        for rest in (seen[:, 0, s.disturbed], seen[:, 0, ~s.disturbed], seen[:, 1, ~s.disturbed]):
            assert rest.mean() == pytest.approx(0.7, abs=4 * np.sqrt(0.21 / rest.size))
        # plots are missing one by one
        lost = ~seen[:, 0] - 0.3
        pairs = np.mean(lost[:, 1:] * lost[:, :-1]) / 0.21
        assert pairs == pytest.approx(0, abs=4 / np.sqrt(lost.size))

    def test_asynchronous(self):
        s = radar_scenario("asynchronous", batch=3, rng=6)
        even = np.arange(240) % 2 == 0
        for radar, scans in enumerate((even, ~even)):
            np.testing.assert_array_equal(~np.isnan(s.z[:, radar]), np.tile(scans, (3, 1)))
        assert s.model == SingerModel(2.5, 0.05, 0.003)

    def test_the_truth_of_the_turn_is_consistent(self):
        """Rate and acceleration are derivatives of the angle, outside two edges."""
        dt = 0.05
        s = radar_scenario("turn", model=SingerModel(dt, 0.05, 0.003), steps=4000, rng=7)
        angle, rate, acceleration = s.truth.T
        edges = np.abs(np.arange(1, 3999)[:, np.newaxis] - [2000, 3200]).min(axis=1) <= 1
        for value, derivative in ((angle, rate), (rate, acceleration)):
            differences = (value[2:] - value[:-2]) / (2 * dt)
            largest = np.abs(derivative).max()
            gap = np.abs(differences - derivative[1:-1]) / largest
            assert gap[~edges].max() < 1e-5

    def test_the_turn_is_flown_at_200_metres_per_second(self):
        """Summed up in small straight pieces."""
        s = radar_scenario("turn", rng=8)
        pieces = 1000
        time = (np.arange(120 * pieces) + 0.5) * 5.0 / pieces - 300.0
        course = np.radians(180 + 1.5 * np.clip(time, 0, 60))
        flown = 200 * 5.0 / pieces * np.cumsum(np.stack([np.cos(course), np.sin(course)]), axis=1)
        at_scans = np.concatenate([[[0.0], [0.0]], flown[:, pieces - 1 :: pieces]], axis=1)[:, :120]
        north, east = at_scans - at_scans[:, 60:61] + [[60e3], [0.0]]
        np.testing.assert_allclose(s.truth[:, 0], np.degrees(np.arctan2(east, north)), atol=1e-6)
        # westwards at the end, 7639 metres nearer
        assert north[-1] == pytest.approx(60e3 - 200 / np.radians(1.5), rel=1e-6)
        assert s.truth[-1, 0] < -20

    def test_the_turn_is_the_same_every_time_and_for_every_model(self):
        first = radar_scenario("turn", batch=2, rng=9)
        other = radar_scenario("turn", model=SingerModel(5.0, 0.02, 1.0, exact=True), rng=10)
        np.testing.assert_array_equal(first.truth[0], first.truth[1])
        np.testing.assert_array_equal(first.truth[0], other.truth)
        assert other.model == SingerModel(5.0, 0.02, 1.0, exact=True)

    @pytest.mark.parametrize("name", sorted(set(SCENARIOS) - {"turn"}))
    def test_motion_is_that_of_the_model(self, name):
        model = SingerModel(4.0, 0.1, 0.2, exact=True)
        s = radar_scenario(name, model=model, batch=5, rng=11)
        assert (s.model.alpha, s.model.acceleration_sigma, s.model.exact) == (0.1, 0.2, True)
        assert s.model.dt == (2.0 if name == "asynchronous" else 4.0)
        steps = 240 if name == "asynchronous" else 120
        expected = radars(s.model, steps, batch=5, rng=11).truth
        np.testing.assert_array_equal(s.truth, expected)

    def test_a_healthy_record_is_that_of_two_radars(self):
        model = SingerModel(5.0, 0.05, 0.003)
        s, plain = radar_scenario("healthy", rng=12), radars(model, 120, rng=12)
        assert s.model == model
        np.testing.assert_array_equal(s.z, plain.z)
        np.testing.assert_array_equal(s.truth, plain.truth)

    @pytest.mark.parametrize("name", SCENARIOS)
    def test_a_seed_gives_the_same_record_and_a_generator_goes_on(self, name):
        first, second = (radar_scenario(name, rng=3).z for _ in range(2))
        np.testing.assert_array_equal(first, second)
        generator = np.random.default_rng(3)
        np.testing.assert_array_equal(radar_scenario(name, rng=generator).z, first)
        assert not np.array_equal(radar_scenario(name, rng=generator).z, first, equal_nan=True)

    @pytest.mark.parametrize(
        ("options", "error", "message"),
        [
            ({"name": "calm"}, ValueError, "name is 'calm'; it must be one of healthy, noisy, .*"),
            ({"name": "Healthy"}, ValueError, "name is 'Healthy'"),
            ({"name": None}, ValueError, "name is None"),
            ({"name": ["turn"]}, ValueError, r"name is \['turn'\]"),
            ({"model": 5}, TypeError, "model is 5; it must be a SingerModel"),
            ({"steps": 39}, ValueError, "steps is 39; it must be between 40 and"),
            ({"steps": 60.5}, TypeError, "steps is 60.5"),
            ({"batch": -1}, ValueError, "batch is -1"),
            ({"rng": "x"}, TypeError, "rng is 'x'"),
        ],
    )
    def test_bad_parameters(self, options, error, message):
        with pytest.raises(error, match=message):
            radar_scenario(**{"name": "asynchronous"} | options)
