"""Times of arrival and range differences that share an error: against formulas and the truth."""

import numpy as np
import pytest
from checks import in_region
from reference import location as reference
from scipy import optimize

from tertia import metrics
from tertia.location import LocationStatus, Station, accuracy_map, locate
from tertia.sensors import Bias

NAN = float("nan")
PLACES = np.array([(0, 0), (4000, 0), (0, 3000), (4200, 3100), (2000, -1500.0)])
TARGET = np.array([1500.0, 1100.0])
HEARD = np.linalg.norm(TARGET - PLACES, axis=1) + [3, -5, 8, -2, 4] + 123456.0
RING = np.array([5000 * np.array([np.sin(a), np.cos(a)]) for a in 2 * np.pi * np.arange(8) / 8])
EXACT = {"rtol": 1e-12, "atol": 1e-9}
ALIKE = {"propagation_speed": 1.0}


def heard(places=PLACES, time=HEARD, sigma=10.0, **options):
    """A fix from times in metres: the speed is 1."""
    options = {"propagation_speed": 1.0, "method": "least-squares", "bias": Bias(), **options}
    return locate(places, arrival_time=time, arrival_time_sigma=sigma, **options)


def differences(reference_station, **options):
    """A fix from the differences to any station."""
    order = [reference_station, *(i for i in range(len(PLACES)) if i != reference_station)]
    values = HEARD[order][1:] - HEARD[reference_station]
    options = {"method": "least-squares", "bias": Bias(), **options}
    return locate(
        PLACES[order], range_difference=values, range_difference_sigma=10 * 2**0.5, **options
    )


def draw(places, target, count, seed, sigma=10.0):
    distance = np.linalg.norm(target - places, axis=-1)
    noise = np.random.default_rng(seed).standard_normal((count, len(places)))
    return distance + sigma * noise


class TestLeastSquares:
    def test_equal_sigmas(self):
        fix = heard()
        np.testing.assert_allclose(fix.position, [1505.405144944034, 1099.074821480041], **EXACT)
        expected = [[39.856839482909, 0.465311378324], [0.465311378324, 42.120048002137]]
        np.testing.assert_allclose(fix.covariance, expected, **EXACT)
        assert fix.emission_time == pytest.approx(123458.2280632661, abs=1e-9)
        assert fix.statistic == pytest.approx(0.2962944594533935, rel=1e-11)
        assert fix.degrees_of_freedom == 2

    def test_sigmas_of_their_own(self):
        fix = heard(sigma=[10, 5, 10, 20, 10.0])
        np.testing.assert_allclose(fix.position, [1506.213382015101, 1098.957171572424], **EXACT)
        expected = [[29.747345453861, 11.145779062242], [11.145779062242, 55.021103571192]]
        np.testing.assert_allclose(fix.covariance, expected, **EXACT)
        assert fix.emission_time == pytest.approx(123457.81221467162, abs=1e-9)
        assert fix.statistic == pytest.approx(0.3385119285036676, rel=1e-11)

    @pytest.mark.parametrize("station", range(5))
    def test_differences_to_any_station_are_the_same(self, station):
        fix, other = heard(), differences(station)
        np.testing.assert_allclose(other.position, fix.position, rtol=0, atol=1e-8)
        np.testing.assert_allclose(other.covariance, fix.covariance, rtol=1e-10, atol=1e-9)
        assert other.statistic == pytest.approx(fix.statistic, rel=1e-8)
        assert other.degrees_of_freedom == fix.degrees_of_freedom
        robust = differences(station, method="robust")
        np.testing.assert_allclose(
            robust.position, heard(method="robust").position, rtol=0, atol=1e-5
        )

    def test_independent_differences(self):
        fix = differences(0, range_difference_correlation=0.0)
        np.testing.assert_allclose(fix.position, [1503.633350487268, 1098.084572522896], **EXACT)
        expected = [[37.573294373987, -22.639363470645], [-22.639363470645, 71.049161841094]]
        np.testing.assert_allclose(fix.covariance, expected, **EXACT)

    def test_the_residuals_are_those_of_the_differences(self):
        fix = differences(2)
        order = [2, 0, 1, 3, 4]
        predicted = reference.predict(fix.position, PLACES[order])["range_difference"]
        measured = HEARD[order][1:] - HEARD[2]
        expected = (measured - predicted) / (10 * 2**0.5)
        np.testing.assert_allclose(fix.residual.range_difference, expected, rtol=0, atol=1e-10)
        assert fix.residual.arrival_time is None
        assert fix.emission_time is None

    def test_missing_arrivals_cost_nothing_else(self):
        """Also the first one, which is the reference of differences."""
        places = np.concatenate([[[9e3, 9e3]], PLACES])
        fix = heard(places, np.concatenate([[NAN], HEARD]))
        np.testing.assert_allclose(fix.position, heard().position, rtol=0, atol=1e-9)
        assert np.isnan(fix.residual.arrival_time[0])
        with pytest.raises(ValueError, match="fewer measurements than"):
            heard(time=[HEARD[0], HEARD[1], NAN, NAN, NAN])

    @pytest.mark.parametrize("d", [2, 3])
    def test_against_scipy_with_other_kinds(self, d):
        places = np.column_stack([RING, np.linspace(0, 500, 8)])[:, :d]
        target = np.array([1200.0, -700.0, 900.0])[:d]
        rng = np.random.default_rng(1)
        truth = reference.predict(target, places)
        kinds = ("range", "azimuth") if d == 2 else ("range", "azimuth", "elevation")
        sigmas = {"range": 20.0, "azimuth": 0.01, "elevation": 0.01, "arrival": 15.0}
        measured = {kind: truth[kind] + sigmas[kind] * rng.normal(size=8) for kind in kinds}
        for kind in kinds:
            measured[kind][:6] = NAN
        z = 500.0 + truth["range"] + 15.0 * rng.normal(size=8)

        def residuals(x):
            own = reference.residuals(x[:d], places, measured, sigmas)
            ranges = reference.predict(x[:d], places)["range"]
            return np.concatenate([own, (z - x[d] - ranges) / 15.0])

        best = optimize.least_squares(
            residuals, [*target, 500.0], "3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15,
            x_scale="jac",
        )  # fmt: skip
        covariance = np.linalg.inv(best.jac.T @ best.jac)
        fix = locate(
            places,
            arrival_time=z / 300.0,
            arrival_time_sigma=0.05,
            propagation_speed=300.0,
            **measured,
            **{f"{kind}_sigma": sigmas[kind] for kind in kinds},
            method="least-squares",
            bias=Bias(),
        )
        np.testing.assert_allclose(fix.position, best.x[:d], rtol=0, atol=1e-4)
        np.testing.assert_allclose(fix.covariance, covariance[:d, :d], rtol=1e-5, atol=1e-5)
        assert fix.emission_time == pytest.approx(best.x[d] / 300.0, abs=1e-6)
        assert fix.emission_time_sigma == pytest.approx(covariance[d, d] ** 0.5 / 300.0, rel=1e-5)
        assert fix.statistic == pytest.approx(2 * best.cost, rel=1e-8)

    def test_an_accuracy_map_is_the_covariance_at_the_truth(self):
        exact = np.linalg.norm(TARGET - PLACES, axis=1)
        fix = heard(time=exact)
        stations = [Station(p, arrival_time_sigma=10.0) for p in PLACES]
        found = accuracy_map(stations, TARGET, propagation_speed=1.0)
        np.testing.assert_allclose(found.covariance, fix.covariance, rtol=1e-9)
        assert found.dop == pytest.approx(fix.dop, rel=1e-9)
        assert fix.dop == pytest.approx(np.sqrt(np.trace(fix.covariance)) / 10.0, rel=1e-9)
        same = accuracy_map(PLACES, TARGET, range_difference_sigma=10 * 2**0.5)
        np.testing.assert_allclose(same.covariance, fix.covariance, rtol=1e-9)
        alone = accuracy_map(
            PLACES, TARGET, range_difference_sigma=14.0, range_difference_correlation=0.0
        )
        assert np.linalg.norm(alone.covariance - same.covariance) > 10.0


class TestTimes:
    def test_seconds_since_1970_and_dates(self):
        """In double precision such seconds have steps of 70 m at the speed of light."""
        seconds = np.linalg.norm(TARGET - PLACES, axis=1) / 299_792_458.0
        nanoseconds = np.rint(seconds * 1e9).astype(np.int64)
        start = np.datetime64("2026-11-22T12:00:00", "ns")
        dates = start + nanoseconds.astype("timedelta64[ns]")
        dates[1] = np.datetime64("NaT")
        fix = locate(PLACES, arrival_time=dates, arrival_time_sigma=3e-8)
        expected = locate(
            PLACES, arrival_time=np.where(np.isnat(dates), NAN, nanoseconds * 1e-9),
            arrival_time_sigma=3e-8,
        )  # fmt: skip
        np.testing.assert_allclose(fix.position, expected.position, rtol=0, atol=1e-6)
        assert np.linalg.norm(fix.position - TARGET) < 1.0
        assert abs(fix.emission_time - start) <= np.timedelta64(2, "ns")
        assert expected.emission_time == pytest.approx(0.0, abs=2e-9)
        batch = locate(PLACES, arrival_time=[dates, dates], arrival_time_sigma=3e-8)
        assert batch.emission_time.dtype == "datetime64[ns]"
        assert batch.emission_time.shape == (2,)
        late = locate(PLACES, arrival_time=1.7e9 + seconds, arrival_time_sigma=3e-7)
        assert np.linalg.norm(late.position - TARGET) < 100.0

    def test_dates_of_instants_that_are_not_located(self):
        dates = np.full((2, 5), np.datetime64("NaT"), dtype="datetime64[us]")
        dates[0] = np.datetime64("2026-01-01", "us") + np.array([5, 9, 8, 10, 6], "timedelta64[us]")
        fix = locate(PLACES, arrival_time=dates, arrival_time_sigma=1e-6)
        assert fix.status[1] == LocationStatus.TOO_FEW
        assert np.isnat(fix.emission_time[1])

    def test_a_speed_for_each_instant(self):
        speeds = np.array([300.0, 340.0])
        seconds = np.linalg.norm(TARGET - PLACES, axis=1) / speeds[:, np.newaxis]
        # small against the distances, so that sigmas are as the speeds
        fix = locate(
            PLACES, arrival_time=seconds, arrival_time_sigma=0.001, propagation_speed=speeds
        )
        np.testing.assert_allclose(fix.position, [TARGET] * 2, rtol=0, atol=1e-6)
        np.testing.assert_allclose(fix.sigma[1] / fix.sigma[0], 340 / 300, rtol=1e-4)

    def test_an_unknown_sigma_is_in_seconds(self):
        fix = heard(sigma=None, time=HEARD / 340.0, propagation_speed=340.0)
        expected = np.sqrt(0.2962944594533935 / 2) * 10.0 / 340.0
        assert fix.measurement_sigma == pytest.approx(expected, rel=1e-9)
        pooled = heard(
            sigma=None, time=np.array([HEARD, HEARD]) / 340.0, propagation_speed=340.0, pooled=True
        )
        np.testing.assert_allclose(pooled.measurement_sigma, expected, rtol=0.02)


class TestSurvey:
    def test_of_arrivals_it_is_a_part_of_their_variance(self):
        surveyed = [
            Station(p, position_sigma=s) for p, s in zip(PLACES, [3, 0, 4, 1, 2], strict=True)
        ]
        fix = heard(surveyed)
        own = np.hypot(10.0, [3, 0, 4, 1, 2])
        expected = heard(sigma=own)
        np.testing.assert_allclose(fix.position, expected.position, rtol=0, atol=1e-8)
        np.testing.assert_allclose(fix.covariance, expected.covariance, rtol=1e-10)
        found = accuracy_map(surveyed, TARGET, arrival_time_sigma=10.0, propagation_speed=1.0)
        same = accuracy_map(PLACES, TARGET, arrival_time_sigma=own, propagation_speed=1.0)
        np.testing.assert_allclose(found.covariance, same.covariance, rtol=1e-10)

    def test_of_differences_that_of_the_first_is_shared(self):
        sigma = 10.0
        surveyed = [Station(p, position_sigma=5.0 * (i == 0)) for i, p in enumerate(PLACES)]
        fix = locate(
            surveyed, range_difference=HEARD[1:] - HEARD[0], range_difference_sigma=sigma * 2**0.5,
            method="least-squares", bias=Bias(),
        )  # fmt: skip
        expected = heard(sigma=np.hypot(sigma, [5.0, 0, 0, 0, 0]))
        np.testing.assert_allclose(fix.position, expected.position, rtol=0, atol=1e-8)
        np.testing.assert_allclose(fix.covariance, expected.covariance, rtol=1e-10)

    def test_of_angles_it_grows_with_nearness(self):
        """At the position that is found, and whatever the start."""
        places = np.array([[0, 0], [1000, 0], [0, 1000], [1500, 1500.0]])
        surveyed = [Station(p, position_sigma=20.0, azimuth_sigma=0.01) for p in places]
        target = np.array([400.0, 300.0])
        azimuth = reference.predict(target, places)["azimuth"] + [0.02, -0.03, 0.04, 0.01]
        fix = locate(surveyed, azimuth=azimuth, bias=Bias())
        distance = np.linalg.norm(fix.position - places, axis=1)
        again = locate(
            places, azimuth=azimuth, azimuth_sigma=np.hypot(0.01, 20.0 / distance),
            bias=Bias(), method="least-squares",
        )  # fmt: skip
        assert metrics.nees(fix.position - again.position, again.covariance) < 1e-4
        np.testing.assert_allclose(fix.covariance, again.covariance, rtol=0.02)


class TestErrorBars:
    @pytest.mark.parametrize("count", [5, 8])
    @pytest.mark.parametrize("kind", ["arrivals", "differences"])
    def test_normal_noise(self, count, kind):
        places, target = RING[:count] * [1.0, 0.8], np.array([900.0, 1500.0])
        z = draw(places, target, 4000, seed=3)
        if kind == "arrivals":
            fix = heard(places, z, method="robust")
        else:
            fix = locate(
                places, range_difference=z[:, 1:] - z[:, :1], range_difference_sigma=10 * 2**0.5,
                bias=Bias(),
            )  # fmt: skip
        error = fix.position - target
        nees = metrics.nees(error, fix.covariance)[fix.success]
        assert fix.success.mean() > 0.99
        assert 0.92 < nees.mean() / 2 < 1.04
        bound = accuracy_map(places, target, arrival_time_sigma=10.0, propagation_speed=1.0)
        found = np.sqrt(np.nanmean(np.sum(error**2, axis=-1)))
        assert found < 1.03 * bound.drms

    @pytest.mark.parametrize("wrong", range(5))
    def test_a_faulty_receiver_is_found(self, wrong):
        """The error it leaves was hundreds of metres, 12 to 26 sigma."""
        z = draw(PLACES, TARGET, 300, seed=4)
        z[:, wrong] += 300.0
        fix = heard(time=z, method="robust")
        expected = np.arange(5) == wrong
        found = np.all(fix.outlier.arrival_time == expected, axis=1)
        assert found.mean() > 0.95
        nees = metrics.nees(fix.position - TARGET, fix.covariance)[found]
        assert 0.8 < nees.mean() / 2 < 1.2
        shared = locate(
            PLACES, range_difference=z[:, 1:] - z[:, :1], range_difference_sigma=10 * 2**0.5,
            bias=Bias(),
        )  # fmt: skip
        np.testing.assert_allclose(shared.position[found], fix.position[found], rtol=0, atol=1e-3)
        told = shared.outlier.range_difference[found]
        assert np.all(told) if wrong == 0 else np.all(told == expected[1:])

    def test_many_outliers_of_a_batch(self):
        """With one fault in a hundred expected, 83 % of those located were inside (8 receivers)."""
        turn = 2 * np.pi * np.arange(8) / 8
        ring = 5000.0 * np.stack([np.sin(turn), np.cos(turn)], axis=-1)
        target = np.array([-600.0, 900.0])
        inside = []
        for seed in range(8):
            z = draw(ring, target, 100, seed=seed)
            rng = np.random.default_rng([6, seed])
            hit = rng.uniform(size=z.shape) < 0.2
            z += hit * rng.uniform(50.0, 150.0, z.shape) * rng.choice([-1.0, 1.0], z.shape)
            fix = heard(ring, z, method="robust", multipath=False)
            inside.append(in_region(fix.position - target, fix.covariance)[fix.success])
        share = np.mean(np.concatenate(inside))
        assert 0.9 < share < 0.98
        assert len(np.concatenate(inside)) > 0.8 * 800

    def test_late_is_likelier_than_early(self):
        z = draw(RING, np.array([500.0, 200.0]), 1000, seed=5)
        z[:, 3] += 45.0
        late = heard(RING, z, method="robust").outlier.arrival_time[:, 3].mean()
        either = heard(RING, z, method="robust", multipath=False).outlier.arrival_time[:, 3].mean()
        z[:, 3] -= 90.0
        early = heard(RING, z, method="robust").outlier.arrival_time[:, 3].mean()
        assert early + 0.02 < either < late - 0.02

    def test_two_positions(self):
        """Stations in a line hear the same from both sides; three often have two hyperbolas."""
        line = np.column_stack([1000.0 * np.arange(6), np.zeros(6)])
        z = draw(line, np.array([1500.0, 2500.0]), 20, seed=6)
        assert np.all(heard(line, z).status == LocationStatus.AMBIGUOUS)
        chosen = heard(line, z, initial=[1400.0, 2000.0])
        assert np.all(chosen.success)
        assert np.all(np.linalg.norm(chosen.position - [1500.0, 2500.0], axis=1) < 100.0)

    def test_any_number_of_threads(self):
        z = draw(RING, np.array([500.0, 200.0]), 500, seed=7)
        one, two = (heard(RING, z, method="robust", n_threads=n) for n in (1, 2))
        np.testing.assert_array_equal(one.position, two.position)
        np.testing.assert_array_equal(one.emission_time, two.emission_time)
        single = heard(RING, z[17], method="robust")
        np.testing.assert_array_equal(single.position, one.position[17])


class TestArguments:
    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({"arrival_time": [1.0, 2.0]}, r"arrival_time has shape \(2,\)"),
            ({"arrival_time": [1.0, 2, 3, np.inf, 5]}, r"arrival_time\[3\] is infinite"),
            ({"propagation_speed": 0.0}, "propagation_speed is 0.0; it must be a positive"),
            ({"propagation_speed": [1.0, 2.0, 3.0], "arrival_time": np.ones((2, 5))}, "one number"),
            ({"range_difference_correlation": 1.0}, "range_difference_correlation is 1.0"),
            ({"range_difference_correlation": -0.1}, "range_difference_correlation is -0.1"),
            ({"range_difference": np.ones(4), "range_difference_sigma": 1.0}, "share the errors"),
            ({"arrival_time_sigma": [1, 1, 1, NAN, 1.0]}, "arrival_time_sigma"),
        ],
    )
    def test_values(self, options, message):
        given = {"arrival_time": HEARD, "arrival_time_sigma": 10.0, "propagation_speed": 1.0}
        with pytest.raises(ValueError, match=message):
            locate(PLACES, **given | options)

    def test_types(self):
        with pytest.raises(TypeError, match="multipath is 1"):
            heard(multipath=1)
        with pytest.raises(TypeError, match="arrival_time has dtype"):
            heard(time=["now"] * 5)


class TestClocks:
    CLOCK = np.array([20.0, -45.0, 0.0, 10.0, -5.0])

    def test_what_is_known_is_subtracted(self):
        fast = heard(time=HEARD + self.CLOCK, bias=Bias(time=self.CLOCK))
        np.testing.assert_allclose(fast.position, heard().position, **EXACT)
        stations = [Station(p, bias=Bias(time=t)) for p, t in zip(PLACES, self.CLOCK, strict=True)]
        own = heard(places=stations, time=HEARD + self.CLOCK, bias=None)
        np.testing.assert_allclose(own.position, fast.position, **EXACT)
        np.testing.assert_array_equal(own.bias.time, self.CLOCK)

    def test_seconds_of_any_speed(self):
        bias = Bias(time=self.CLOCK / 340.0)
        time, sigma = (HEARD + self.CLOCK) / 340.0, 10.0 / 340.0
        fix = heard(time=time, sigma=sigma, propagation_speed=340.0, bias=bias)
        np.testing.assert_allclose(fix.position, heard().position, rtol=1e-9)

    def test_what_is_not_known_of_them_counts(self):
        fix = heard(bias=Bias(time_sigma=5.0))
        np.testing.assert_allclose(fix.covariance, heard(sigma=125**0.5).covariance, **EXACT)
        wide = accuracy_map(
            PLACES, TARGET, arrival_time_sigma=10.0, **ALIKE, bias=Bias(time_sigma=5.0)
        )
        same = accuracy_map(PLACES, TARGET, arrival_time_sigma=125**0.5, **ALIKE)
        np.testing.assert_allclose(wide.covariance, same.covariance, **EXACT)

    def test_a_clock_that_may_show_anything_measures_nothing(self):
        fix = heard(bias=Bias(time_sigma=[0, 0, 0, 0, np.inf]))
        np.testing.assert_allclose(fix.position, heard(PLACES[:4], HEARD[:4]).position, **EXACT)

    def test_a_gain_is_that_of_radars(self):
        with pytest.raises(ValueError, match="the bias of station 0 has a range_gain"):
            heard(bias=Bias(range_gain=1e-4))


def test_many_outliers_of_range_differences_are_counted():
    """The share of outliers of a batch is estimated from differences as from times of arrival."""
    held, located = [], []
    for seed in range(8):
        rng = np.random.default_rng([51, seed])
        places = rng.uniform(-10e3, 10e3, (8, 2))
        truth = rng.uniform(-4e3, 4e3, (80, 2))
        way = np.linalg.norm(truth[:, np.newaxis] - places, axis=-1)
        way += 30.0 * rng.standard_normal(way.shape)
        way += (rng.random(way.shape) < 0.3) * rng.exponential(400.0, way.shape)
        difference = way[:, 1:] - way[:, :1]
        found = locate(places, range_difference=difference, range_difference_sigma=30 * 2**0.5)
        held += list(in_region(found.position - truth, found.covariance)[found.success])
        located.append(np.mean(found.success))
    assert np.mean(held) > 0.85
    assert np.mean(located) > 0.75


def shots(seed: int, sigma: float, count: int = 25):
    """Return receivers, arrivals of `count` shots, positions, and the true speed of sound."""
    rng = np.random.default_rng([52, seed])
    places, truth = rng.uniform(-700, 700, (8, 2)), rng.uniform(-500, 500, (count, 2))
    speed = 343.0 * (1 + sigma * rng.standard_normal())
    time = np.linalg.norm(truth[:, np.newaxis] - places, axis=-1) / speed
    time += 2e-3 * rng.standard_normal(time.shape) + 100.0 * np.arange(count)[:, np.newaxis]
    return places, time, truth, speed


@pytest.mark.parametrize("count", [1, 25])
def test_the_speed_of_the_signals_is_estimated(count):
    """Positions are as accurate as with the true speed, and regions hold them."""
    share = 0.015
    errors, known, held, speeds = [], [], [], []
    for seed in range(40):
        places, time, truth, speed = shots(seed, share, count)
        options = {"arrival_time": time, "arrival_time_sigma": 2e-3}
        found = locate(
            places, **options, propagation_speed=343.0, propagation_speed_sigma=share * 343
        )
        exact = locate(places, **options, propagation_speed=speed)
        both = found.success & exact.success
        errors += list(np.sum((found.position - truth)[both] ** 2, axis=-1))
        known += list(np.sum((exact.position - truth)[both] ** 2, axis=-1))
        held += list(in_region(found.position - truth, found.covariance)[found.success])
        speeds.append((found.propagation_speed - speed) / found.propagation_speed_sigma)
    assert np.mean(np.sort(errors)[: int(0.95 * len(errors))]) < 1.5**2 * np.mean(
        np.sort(known)[: int(0.95 * len(known))]
    )
    assert np.mean(held) > 0.88
    assert 0.5 < np.sqrt(np.mean(np.square(speeds))) < 1.6


def test_an_unknown_speed_stretches_ranges():
    rng = np.random.default_rng(53)
    places = rng.uniform(-800, 800, (6, 2))
    truth = rng.uniform(-400, 400, (40, 2))
    measured = 1.006 * np.linalg.norm(truth[:, np.newaxis] - places, axis=-1)
    measured += 0.3 * rng.standard_normal(measured.shape)
    found = locate(
        places,
        range=measured,
        range_sigma=0.3,
        propagation_speed=1500.0,
        propagation_speed_sigma=7.5,
    )
    assert found.propagation_speed == pytest.approx(1500 / 1.006, abs=0.5)
    assert np.sqrt(np.mean((found.position - truth) ** 2)) < 0.35


def test_wrong_sigmas_of_the_speed():
    places = [[0, 0], [1000, 0], [2000, 0], [0, 2000], [2000, 2000]]
    with pytest.raises(ValueError, match="propagation_speed_sigma needs times of arrival"):
        locate(places, azimuth=np.zeros(5), azimuth_sigma=0.1, propagation_speed_sigma=1.0)
    for sigma, message in ((-1.0, "0 or positive"), (100.0, "it must be at most 20%")):
        with pytest.raises(ValueError, match=message):
            locate(
                places,
                arrival_time=np.arange(5.0),
                arrival_time_sigma=0.1,
                propagation_speed=343.0,
                propagation_speed_sigma=sigma,
            )


def test_positions_from_range_differences_do_not_depend_on_units():
    """The error of the first station grows with the others if the measurements contradict."""
    places = np.array([[0, 0], [5000, 0], [0, 5000], [5000, 5000], [2500, 8000], [-3000, 2500.0]])
    rng = np.random.default_rng(1)
    target = rng.uniform(500, 4500, (50, 2))
    distance = np.linalg.norm(target[:, np.newaxis] - places, axis=-1)
    distance += 40 * rng.standard_normal(distance.shape)
    difference = distance[:, 1:] - distance[:, :1]
    metres = locate(places, range_difference=difference, range_difference_sigma=28.0)
    km = locate(places / 1e3, range_difference=difference / 1e3, range_difference_sigma=0.028)
    np.testing.assert_allclose(km.position, metres.position / 1e3, rtol=1e-4)
    np.testing.assert_allclose(km.covariance, metres.covariance / 1e6, rtol=1e-3)


def test_a_nearly_unbounded_hypothesis_does_not_set_the_sigma():
    """With one outlier of few arrivals, larger sigmas may move the target to infinity."""
    rng = np.random.default_rng(5)
    for _ in range(60):
        count = int(rng.integers(5, 8))
        places, target = rng.uniform(-5e3, 5e3, (count, 2)), rng.uniform(-4e3, 4e3, 2)
        distance = np.linalg.norm(target - places, axis=1) + 20 * rng.standard_normal(count)
        distance[int(rng.integers(count))] += 500
        try:
            fix = locate(places, arrival_time=distance, arrival_time_sigma=20.0, **ALIKE)
        except ValueError:
            continue
        assert np.sqrt(np.trace(fix.covariance)) < 3e4
