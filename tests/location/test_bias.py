"""Systematic errors of stations: given, found from contradictions, and not included."""

import numpy as np
import pytest
from checks import in_region
from reference import growth as reference
from scipy import stats

from tertia import metrics
from tertia.location import LocationStatus, Station, locate
from tertia.sensors import Bias

SQUARE = np.array([[0, 0], [2000, 0], [2000, 2000], [0, 2000.0]])
PLANE = np.array([*SQUARE.tolist(), [1000, -1500], [-1500, 800], [3500, 1200], [800, 3600]])
TARGET = np.array([700.0, 1100.0])
TOWARDS = np.arctan2(*(TARGET - PLANE).T)
SIGMA = np.radians(0.3)
STATED = {"azimuth_sigma": SIGMA}


def draw(count, seed):
    """Azimuths of the target with white noise, (count, K)."""
    return TOWARDS + SIGMA * np.random.default_rng(seed).normal(size=(count, len(PLANE)))


def paths(count, seed, errors, places=PLANE):
    """Azimuths of a target that moves, with errors (count, K) in sigmas, and where it is."""
    turn = np.linspace(0, 3, count)
    truth = np.column_stack([600 + 500 * np.sin(turn), 900 + 400 * np.cos(2 * turn)])
    offset = truth[:, np.newaxis] - places
    azimuth = np.arctan2(offset[..., 0], offset[..., 1])
    rng = np.random.default_rng(seed)
    return azimuth + SIGMA * errors(rng, azimuth.shape), truth


def inside(fixes, truth):
    """Share of the located instants whose 95 % ellipse holds the truth."""
    found = fixes.success
    square = metrics.nees(fixes.position - truth, fixes.covariance)[found]
    return np.mean(square < stats.chi2.ppf(0.95, truth.shape[-1]))


ERRORS = {
    "white": lambda rng, shape: rng.normal(size=shape),
    "twice the sigma": lambda rng, shape: 2 * rng.normal(size=shape),
    "constant biases": lambda rng, shape: rng.normal(size=shape) + 2 * rng.normal(size=shape[-1]),
    "biases per stop": lambda rng, shape: (
        rng.normal(size=shape) + np.repeat(2 * rng.normal(size=(10, shape[-1])), shape[0] // 10, 0)
    ),
}


class TestContradictions:
    @pytest.mark.parametrize("places", [SQUARE, PLANE], ids=["4", "8"])
    @pytest.mark.parametrize("errors", ERRORS)
    def test_coverage(self, errors, places):
        shares = []
        for seed in range(12):
            azimuth, truth = paths(200, seed, ERRORS[errors], places)
            shares.append(inside(locate(places, azimuth=azimuth, **STATED, pooled=False), truth))
        assert 0.88 < np.mean(shares) < 0.985

    @pytest.mark.parametrize("times", [10, 30, 100])
    @pytest.mark.parametrize("kind", ["azimuth", "range", "arrival_time"])
    def test_sigmas_that_are_far_too_small(self, kind, times):
        """Most instants have a position, and its sigma is that of the errors."""
        found, held = [], []
        for seed in range(6):
            rng = np.random.default_rng([seed, times])
            truth = rng.uniform(-600, 600, (100, 2)) + 1000
            offset = truth[:, np.newaxis] - PLANE
            far = np.linalg.norm(offset, axis=-1)
            towards = np.arctan2(offset[..., 0], offset[..., 1])
            true, unit = {"azimuth": (towards, 5e-4), "range": (far, 0.2)}.get(kind, (far, 0.2))
            measured = true + times * unit * rng.standard_normal(far.shape)
            options = {"propagation_speed": 1.0} if kind == "arrival_time" else {}
            fix = locate(PLANE, **{kind: measured, f"{kind}_sigma": unit}, **options)
            found.append(np.mean(fix.success))
            held.append(inside(fix, truth))
        assert np.mean(found) > 0.9
        assert 0.88 < np.mean(held) < 0.99

    def test_nothing_is_added_where_nothing_contradicts(self):
        azimuth = draw(20_000, seed=3)
        trusted, free = (
            locate(PLANE, azimuth=azimuth, **STATED, bias=bias) for bias in (Bias(), None)
        )
        np.testing.assert_array_equal(trusted.position, free.position)
        assert np.all(free.bias.azimuth_sigma == 0)
        ratio = (free.covariance[:, 0, 0] / trusted.covariance[:, 0, 0])[free.success]
        assert np.all(ratio >= 1 - 1e-12)
        assert np.mean(ratio < 1 + 1e-12) > 0.9
        nees = np.nanmean(metrics.nees(free.position - TARGET, free.covariance)) / 2
        assert 0.95 < nees < 1.01

    def test_the_sigma_that_is_found(self):
        azimuth, _ = paths(400, 1, ERRORS["twice the sigma"])
        found = locate(PLANE, azimuth=azimuth, **STATED).bias
        np.testing.assert_allclose(found.azimuth_sigma, np.sqrt(3) * SIGMA, rtol=0.1)

    def test_errors_that_last_count_less(self):
        """The same contradiction again is no new one: more is left unknown."""
        scale = 2.0
        white, _ = paths(256, 2, lambda rng, shape: scale * rng.normal(size=shape), SQUARE)
        rng = np.random.default_rng(3)
        target = np.array([900.0, 700.0])
        offset = target - SQUARE
        still = np.arctan2(offset[:, 0], offset[:, 1]) + SIGMA * scale * rng.normal(size=4)
        lasting = locate(SQUARE, azimuth=np.tile(still, (256, 1)), **STATED, pooled=True)
        single = locate(SQUARE, azimuth=still[np.newaxis], **STATED, pooled=True)
        ratio = lasting.covariance[0, 0, 0] / single.covariance[0, 0, 0]
        # 1.5 instants with two degrees of freedom each, instead of one
        assert 0.4 < ratio < 1
        assert locate(SQUARE, azimuth=white, **STATED, pooled=True).success.all()

    @pytest.mark.parametrize("threads", [1, 3])
    def test_threads_do_not_matter(self, threads):
        azimuth, _ = paths(1000, 5, ERRORS["constant biases"])
        a = locate(PLANE, azimuth=azimuth, **STATED)
        b = locate(PLANE, azimuth=azimuth, **STATED, n_threads=threads)
        np.testing.assert_array_equal(a.covariance, b.covariance)


class TestOneInstant:
    def test_the_growth_is_that_of_the_mixture(self):
        """The factor of the reference, in the plane and with dependent residuals."""
        for seed in range(40):
            azimuth = draw(1, seed=seed)[0]
            wrong = {"azimuth": TOWARDS + 2.5 * (azimuth - TOWARDS)}
            options = {"method": "least-squares", **STATED}
            free = locate(PLANE, **wrong, **options)
            trusted = locate(PLANE, **wrong, **options, bias=Bias())
            expected = reference.growth(trusted.statistic, trusted.degrees_of_freedom, 2)
            np.testing.assert_allclose(free.covariance, expected * trusted.covariance, rtol=1e-9)

    def test_sigmas_that_are_too_small(self):
        """Of half the size: more than a test of one instant can find is not promised."""
        rng = np.random.default_rng(8)
        places = PLANE[[0, 1, 3, 4]]
        offset = TARGET - places
        hits = []
        for _ in range(300):
            azimuth = np.arctan2(offset[:, 0], offset[:, 1])
            azimuth = azimuth + 2 * SIGMA * rng.normal(size=len(places))
            free = locate(places, azimuth=azimuth, **STATED)
            hits.append(in_region(free.position - TARGET, free.covariance))
        assert np.mean(hits) > 0.68

    def test_outliers_do_not_hide_sigmas_that_are_too_small(self):
        """Anchors with offsets of twice the sigma, and some late ranges: few agree by chance."""
        found, held = [], []
        for seed in range(300):
            rng = np.random.default_rng(seed)
            turn = 2 * np.pi * np.arange(6) / 6 + rng.uniform(-0.3, 0.3, 6)
            places = 10 * np.column_stack([np.sin(turn), np.cos(turn)])
            truth = rng.uniform(-5, 5, 2)
            far = np.linalg.norm(truth - places, axis=1) + 0.1 * rng.normal(size=6)
            far += rng.uniform(0.05, 0.3, 6) * rng.choice([-1, 1], 6)
            far += np.where(rng.random(6) < 0.2, rng.exponential(1.0, 6), 0.0)
            fix = locate(places[np.newaxis], range=far[np.newaxis], range_sigma=0.1)
            found.append(fix.success[0])
            if fix.success[0]:
                held.append(inside(fix, truth))
        assert np.mean(found) > 0.98
        assert np.mean(held) > 0.8

    def test_a_fault_of_one_instant_costs_little(self):
        """Where the others agree, there is one fault, and sigmas are right."""
        found, ratios, held = [], [], []
        for seed in range(200):
            azimuth = draw(1, seed=seed)
            azimuth[0, 3] += 30 * SIGMA
            fix = locate(PLANE, azimuth=azimuth, **STATED)
            trusted = locate(PLANE, azimuth=azimuth, **STATED, bias=Bias())
            found.append(fix.outlier.azimuth[0, 3])
            ratios.append(np.sqrt(fix.covariance[0, 0, 0] / trusted.covariance[0, 0, 0]))
            held.append(inside(fix, TARGET))
        assert np.mean(found) > 0.95
        assert 1 <= np.median(ratios) < 1.3
        assert np.mean(held) > 0.93

    def test_it_says_whether_it_could_tell(self):
        azimuth = draw(1, seed=1)[0]
        assert locate(PLANE, azimuth=azimuth, **STATED).systematic == "estimated"
        assert locate(PLANE, azimuth=azimuth, **STATED, bias=Bias()).systematic == "given"
        fix = locate(PLANE[:2], azimuth=azimuth[:2], **STATED)
        assert fix.systematic == "not included"
        assert repr(fix).endswith("0 of 2 faulty, systematic error not included)")


class TestHardlyChecked:
    """Theodolites: where two azimuths cross, only the elevations are redundant."""

    PLACES = np.array([[0, 0, 1.6], [80, 10, 1.5], [30, 90, 1.7]])
    SIGMA = 5e-6

    def measured(self, seed, count, instants, error):
        """Stations, angles whose azimuths have a constant error in sigmas, and the targets."""
        rng = np.random.default_rng([6, seed])
        truth = rng.uniform([10, 30, 0], [90, 90, 15], (instants, 3))
        offset = truth[:, np.newaxis] - self.PLACES[:count]
        plan = np.hypot(offset[..., 0], offset[..., 1])
        azimuth = np.arctan2(offset[..., 0], offset[..., 1])
        elevation = np.arctan2(offset[..., 2], plan)
        shape = azimuth.shape
        angles = {
            "azimuth": azimuth
            + self.SIGMA * (error * rng.normal(size=count) + rng.normal(size=shape)),
            "elevation": elevation + self.SIGMA * rng.normal(size=shape),
        }
        stations = [
            Station(place, azimuth_sigma=self.SIGMA, elevation_sigma=self.SIGMA)
            for place in self.PLACES[:count]
        ]
        return stations, angles, truth

    @pytest.mark.parametrize("instants", [1, 20])
    def test_it_says_that_azimuths_are_not_checked(self, instants):
        for count, expected in ((2, "not included"), (3, "estimated")):
            stations, angles, _ = self.measured(1, count, instants, 0.0)
            assert locate(stations, **angles).systematic == expected
            one = {kind: value[0] for kind, value in angles.items()}
            assert locate(stations, **one).systematic == expected

    def located(self, error):
        """Yield positions with and without systematic errors, and the truth."""
        for seed in range(40):
            stations, angles, truth = self.measured(seed, 2, 20, error)
            yield locate(stations, **angles), locate(stations, **angles, bias=Bias()), truth

    def test_contradictions_may_be_due_to_them(self):
        """Ten sigmas change the elevations little: it was 6 % inside."""
        shares, ratios = [], []
        for fixes, trusted, truth in self.located(10.0):
            shares.append(inside(fixes, truth))
            errors = [np.linalg.norm(one.position - truth, axis=1) for one in (fixes, trusted)]
            ratios.append(np.median(errors[0]) / np.median(errors[1]))
        assert np.mean(shares) > 0.6
        assert np.median(ratios) < 1.01

    def test_without_errors_they_cost_nothing(self):
        shares, ratios = [], []
        for fixes, trusted, truth in self.located(0.0):
            shares.append(inside(fixes, truth))
            ratios.append(np.median(fixes.covariance[:, 0, 0] / trusted.covariance[:, 0, 0]))
        assert 0.93 < np.mean(shares) < 0.985
        assert np.median(ratios) == pytest.approx(1.0)


class TestGiven:
    def test_values_are_subtracted_and_sigmas_added(self):
        azimuth = draw(1, seed=2)[0]
        shift = np.linspace(-0.01, 0.02, 8)
        spread = np.linspace(0, 0.01, 8)
        total = np.hypot(SIGMA, spread)
        fix = locate(
            PLANE,
            azimuth=azimuth + shift,
            **STATED,
            bias=Bias(azimuth=shift, azimuth_sigma=spread),
        )
        same = locate(PLANE, azimuth=azimuth, azimuth_sigma=total, bias=Bias())
        np.testing.assert_allclose(fix.position, same.position, rtol=0, atol=1e-7)
        np.testing.assert_allclose(fix.covariance, same.covariance, rtol=1e-9)
        assert fix.systematic == "given"
        np.testing.assert_array_equal(fix.bias.azimuth_sigma, spread)

    def test_of_the_stations(self):
        azimuth = draw(1, seed=2)[0]
        bias = Bias(azimuth=0.01, azimuth_sigma=0.002)
        stations = [Station(p, azimuth_sigma=SIGMA, bias=bias) for p in PLANE]
        a = locate(stations, azimuth=azimuth)
        b = locate(PLANE, azimuth=azimuth, **STATED, bias=bias)
        np.testing.assert_array_equal(a.position, b.position)
        np.testing.assert_array_equal(a.covariance, b.covariance)
        # what the call gives replaces it
        c = locate(stations, azimuth=azimuth, bias=Bias())
        np.testing.assert_array_equal(c.bias.azimuth, 0.0)

    def test_one_that_deviates_with_the_direction(self):
        """The deviation is that of the true azimuth; its sigma adds to that of the noise."""
        card = Bias(azimuth=0.1, deviation_order=1, deviation=[0.15, -0.05], deviation_sigma=SIGMA)
        deviation = 0.1 + 0.15 * np.sin(TOWARDS[0]) - 0.05 * np.cos(TOWARDS[0])
        azimuth = np.stack([TOWARDS, TOWARDS])
        azimuth[:, 0] += deviation
        stations = [Station(place, bias=Bias()) for place in SQUARE]
        stations[0] = Station(SQUARE[0], bias=card)
        fix = locate(stations, azimuth=azimuth[:, :4] % (2 * np.pi), **STATED)
        np.testing.assert_allclose(fix.position, [TARGET, TARGET], atol=1e-6)
        sigma = SIGMA * np.array([np.sqrt(2), 1, 1, 1])
        wider = locate(SQUARE, azimuth=TOWARDS[:4], azimuth_sigma=sigma, bias=Bias())
        np.testing.assert_allclose(fix.covariance[0], wider.covariance, rtol=1e-6)
        assert fix.systematic == "given"

    def test_a_bias_that_is_unknown_is_no_measurement(self):
        azimuth = draw(1, seed=2)[0]
        unknown = np.array([np.inf, 0, 0, 0, 0, 0, 0, 0])
        fix = locate(PLANE, azimuth=azimuth, **STATED, bias=Bias(azimuth_sigma=unknown))
        rest = locate(PLANE[1:], azimuth=azimuth[1:], **STATED, bias=Bias())
        np.testing.assert_allclose(fix.position, rest.position, rtol=0, atol=1e-6)
        assert np.isnan(fix.residual.azimuth[0])

    def test_a_trusted_station_keeps_its_sigma(self):
        azimuth, _ = paths(200, 4, ERRORS["constant biases"])
        unknown = [None] * 7
        stations = [
            Station(p, **STATED, bias=b) for p, b in zip(PLANE, [Bias(), *unknown], strict=True)
        ]
        found = locate(stations, azimuth=azimuth).bias.azimuth_sigma
        assert found[0] == 0
        assert np.all(found[1:] > 0)

    def test_errors(self):
        azimuth = draw(1, seed=0)[0]
        with pytest.raises(TypeError, match="bias is 3; it must be a Bias"):
            locate(PLANE, azimuth=azimuth, **STATED, bias=3)
        with pytest.raises(ValueError, match="bias is that of 2 sensors; there are 8 stations"):
            locate(PLANE, azimuth=azimuth, **STATED, bias=Bias(azimuth=[0.0, 0.1]))
        with pytest.raises(ValueError, match="then azimuth_sigma is needed, too"):
            locate(PLANE, azimuth=azimuth, bias=Bias(azimuth_sigma=0.1))
        with pytest.raises(TypeError, match="pooled is 1"):
            locate(PLANE, azimuth=azimuth, pooled=1)


class TestPooled:
    @pytest.mark.parametrize("count", [3, 4])
    def test_few_bearings_and_no_sigma(self, count):
        """One degree of freedom each, one sigma for all."""
        shares, sigmas = [], []
        for seed in range(10):
            azimuth, truth = paths(100, seed, ERRORS["white"], PLANE[:count])
            fixes = locate(PLANE[:count], azimuth=azimuth, pooled=True)
            shares.append(inside(fixes, truth))
            sigmas.append(fixes.measurement_sigma[0])
        assert 0.93 < np.mean(shares) < 0.97
        assert np.mean(sigmas) == pytest.approx(SIGMA, rel=0.05)

    def test_sigmas_that_are_too_large_shrink(self):
        azimuth, truth = paths(300, 6, lambda rng, shape: 0.5 * rng.normal(size=shape))
        assert inside(locate(PLANE, azimuth=azimuth, **STATED), truth) > 0.99
        assert 0.92 < inside(locate(PLANE, azimuth=azimuth, **STATED, pooled=True), truth) < 0.98

    def test_nothing_to_estimate_from(self):
        fixes = locate(SQUARE[:2], azimuth=[[0.5, -0.5]] * 3, pooled=True)
        assert np.isinf(fixes.covariance[:, 0, 0]).all()


class TestGeometry:
    """Where errors are not small compared with distances."""

    @staticmethod
    def bearings(places, target, size, seed=1, count=4000):
        places = np.asarray(places, dtype=float)
        offset = np.asarray(target) - places
        noise = np.random.default_rng(seed).normal(size=(count, len(places)))
        azimuth = np.arctan2(offset[:, 0], offset[:, 1]) + size * noise
        return locate(places, azimuth=azimuth, azimuth_sigma=size)

    @pytest.mark.parametrize("baseline", [200.0, 140.0])
    def test_a_short_baseline(self, baseline):
        target = np.array([baseline / 2, 1000.0])
        fixes = self.bearings([[0, 0], [baseline, 0]], target, 0.02)
        assert fixes.success.mean() > 0.8
        assert 0.93 < inside(fixes, target) < 0.98

    def test_a_line_and_a_target_far_away(self):
        places = [[0, 0], [300, 0], [600, 0], [900, 0]]
        near, far = np.array([2000.0, 3000.0]), np.array([15_000.0, 30_000.0])
        assert 0.93 < inside(self.bearings(places, near, 0.02), near) < 0.98
        fixes = self.bearings(places, far, 0.02)
        # it was 80 %, at a NEES of 3.7
        assert fixes.success.mean() < 0.1
        assert np.mean(fixes.status == LocationStatus.ILL_CONDITIONED) > 0.7

    def test_it_is_told(self):
        with pytest.raises(ValueError, match="region that holds the target with 95 % has no end"):
            locate([[0, 0], [10, 0]], azimuth=[0.010, 0.0], azimuth_sigma=0.02)


def test_what_does_not_scatter_is_common_to_all_stations():
    """Ranges that are too long together move a distant target away from all of them."""
    rng = np.random.default_rng(77)
    places = np.array([[0.0, 0.0], [60.0, 10.0], [20.0, 80.0], [90.0, 70.0], [40.0, 40.0]])
    truth = np.array([400.0, 300.0]) + rng.uniform(-80, 80, (400, 2))
    distance = np.linalg.norm(truth[:, np.newaxis] - places, axis=-1)
    common = 2.0 * rng.standard_normal((400, 1))
    scatter = 0.5 * rng.standard_normal(distance.shape)
    stations = [Station(place, range_sigma=2.0) for place in places]

    def inside(bias, error):
        fix = locate(stations, range=distance + error, bias=bias)
        off = fix.position - truth
        return np.mean(in_region(off, fix.covariance))

    assert inside(Bias(), common + scatter) < 0.8
    assert inside(None, common + scatter) > 0.9
    found = locate(stations, range=distance + common + scatter).bias
    assert np.all(found.range_sigma > 1.5)
    # and nothing changes where errors scatter as stated
    healthy = distance + 2.0 * rng.standard_normal(distance.shape)
    trusted, default = (locate(stations, range=healthy, bias=bias) for bias in (Bias(), None))
    assert np.nanmedian(default.covariance / trusted.covariance) < 1.05
