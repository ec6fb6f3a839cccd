"""The audit: vectors, parity with the reference, coverage under errors that last, refusals."""

import numpy as np
import polars as pl
import pytest
from checks import NAN, close, rng
from places import DATA
from reference import metrics as reference
from scipy import stats

import tertia
from tertia import _core, audit, metrics
from tertia.geo import LocalFrame
from tertia.location import Station, locate
from tertia.sensors import Bias

ONE = {"number": np.array([50.0]), "probability": np.ones(1), "degrees_of_freedom": np.inf}


def lasting_errors(correlation, series, steps, seed, axes=2):
    """AR(1) errors of variance one."""
    white = rng(seed, series, steps).standard_normal((series, steps, axes))
    errors = white.copy()
    for step in range(1, steps):
        fresh = np.sqrt(1 - correlation**2) * white[:, step]
        errors[:, step] = correlation * errors[:, step - 1] + fresh
    return errors.reshape(-1, axes), np.repeat(np.arange(series), steps)


class TestVectors:
    def test_wilson(self):
        low, high = _core.share_interval(0.9, ONE, 0.95)
        assert [low, high] == close([0.7863976856252035, 0.9565242350681096], 1e-12)

    def test_conformal_radius(self):
        found = audit(np.arange(1.0, 41.0), 1.0, groups=np.arange(40))
        assert found.radius[0.95].value == 39.0
        assert found.radius[0.9].value == 37.0
        assert found.radius[0.99].value == np.inf
        assert found.radius[0.95].effective_number == close(40.0)

    def test_figures_of_a_small_record(self):
        found = audit([[1.0, 2.0], [0.0, 4.0]], [[1.0, 0.0], [0.0, 4.0]], probability=[0.5, 0.95])
        assert found.nees.value == 1.5
        assert found.coverage[0.95].value == 1.0
        # d^2 = 2 and 4; the median of chi-square with two degrees of freedom is 2 ln 2
        assert found.scale[0.5].value == close(3.0 / (2 * np.log(2)))
        assert found.verdict == "too short to tell"

    def test_radius_of_more_axes_is_a_distance(self):
        found = audit(np.tile([3.0, 4.0], (40, 1)), 1.0, groups=np.arange(40))
        assert found.radius[0.5].value == 5.0


class TestKernels:
    @pytest.mark.parametrize("correlation", [0.0, 0.6, 0.97])
    @pytest.mark.parametrize("axes", [1, 2])
    def test_lasting_against_dense_covariances(self, correlation, axes):
        errors, group = lasting_errors(correlation, 2, 45, 3, axes)
        gaps = np.where(np.diff(group, prepend=-1) != 0, 0.0, rng(4).uniform(0.5, 1.5, 90))
        found = _core.lasting(errors, gaps)
        expected = reference.lasting(errors, gaps)
        np.testing.assert_allclose(found[0], expected[0], rtol=1e-7, atol=1e-12)
        np.testing.assert_allclose(found[1], expected[1], rtol=1e-10)

    def test_smooth_errors_are_thinned(self):
        noise = rng(5).standard_normal(459)
        errors = np.convolve(noise, np.hanning(60), "valid")[:, None]
        gaps = np.append(0.0, np.ones(399))
        assert reference.thinning(errors, gaps) > 10
        found, expected = _core.lasting(errors, gaps), reference.lasting(errors, gaps)
        np.testing.assert_allclose(found[0], expected[0], rtol=1e-6, atol=1e-12)

    @pytest.mark.parametrize("ratio", [0.5, 2.0, 9.0])
    def test_interval_of_a_mean(self, ratio):
        number, probability = np.array([12.0, 90.0, 400.0]), np.array([0.2, 0.5, 0.3])
        worth = {"number": number, "probability": probability, "degrees_of_freedom": np.inf}
        found = _core.mean_interval(3.0, ratio, worth, 0.95)
        assert found == close(reference.mean_interval(3.0, ratio, number, probability, 0.95), 1e-8)

    @pytest.mark.parametrize("nu", [0.7, 3.0, 250.0, 99_000.0, 3e5, 1e8])
    def test_interval_of_one_variance(self, nu):
        worth = ONE | {"number": np.array([nu / 2])}
        low, high = _core.mean_interval(1.0, 1.0, worth, 0.9)
        expected = nu / stats.chi2.ppf([0.95, 0.05], nu)
        assert [low, high] == close(expected, 1e-7)

    def test_few_groups_widen_by_student(self):
        worth = ONE | {"degrees_of_freedom": 11.0}
        low, high = _core.rank_interval(0.5, worth, 0.95)
        half = stats.t.ppf(0.975, 11) * 0.5 / np.sqrt(50)
        assert [low, high] == close([0.5 - half, 0.5 + half], 1e-10)

    @pytest.mark.parametrize("axes", [1, 2, 3])
    def test_correlation_of_what_is_inside(self, axes):
        weights = np.array(_core.indicator_powers(axes, 0.9))
        assert weights.sum() == close(1.0)
        for rho in (0.1, 0.3, 0.5):
            expected = reference.indicator_correlation(axes, 0.9, rho)
            found = weights @ rho ** np.array(reference.POWERS, dtype=float)
            assert expected * 0.999 <= found <= expected * 1.03 + 1e-12

    def test_a_normal_variable_below_its_quantile(self):
        weights = np.array(_core.indicator_powers(0, 0.5))
        # Sheppard: 2/pi arcsin rho
        for rho in (0.2, 0.5):
            found = weights @ rho ** np.array(reference.POWERS, dtype=float)
            assert found == close(2 / np.pi * np.arcsin(rho), 0.02)

    def test_refused(self):
        with pytest.raises(ValueError, match="confidence_level is 1"):
            _core.share_interval(0.5, ONE, 1.0)
        with pytest.raises(ValueError, match="probability is 0"):
            _core.rank_interval(0.0, ONE, 0.95)
        with pytest.raises(ValueError, match="gaps is 3"):
            _core.lasting(np.ones((2, 1)), np.ones(3))


class TestIntervals:
    """Claimed variances are half of the true ones; so many of 120 intervals hold the truth."""

    TRIALS = 120

    @pytest.mark.parametrize(
        ("correlation", "series", "steps"),
        [(0.0, 1, 200), (0.8, 1, 200), (0.95, 1, 1000), (0.5, 5, 200), (0.8, 40, 50)],
    )
    def test_hold_the_truth(self, correlation, series, steps):
        inside = 1 - np.exp(-stats.chi2.ppf(0.95, 2) / 4)
        held = np.zeros(3)
        for trial in range(self.TRIALS):
            error, group = lasting_errors(correlation, series, steps, 10 + trial)
            found = audit(np.sqrt(2) * error, 1.0, groups=group, probability=[0.95])
            figures = (found.nees, found.coverage[0.95], found.scale[0.95])
            held += [
                one.low <= true <= one.high
                for one, true in zip(figures, (2, inside, 2), strict=True)
            ]
        # four standard deviations of .95 of 120
        assert np.all(held / self.TRIALS > 0.87), held / self.TRIALS

    @pytest.mark.parametrize(("flights", "noise"), [(10, 1.0), (20, 0.3)])
    def test_hold_the_truth_if_flights_have_biases(self, flights, noise):
        """With normal biases: few flights are outside, whose number shows no variance."""
        held, wrong, trials = 0, 0, 200
        group = np.repeat(np.arange(flights), 100)
        for trial in range(trials):
            random = rng(400 + trial)
            bias = random.standard_normal((flights, 2))[group]
            error = bias + noise * random.standard_normal(bias.shape)
            found = audit(error, 1.0 + noise**2, groups=group, probability=[0.95])
            held += found.coverage[0.95].low <= 0.95 <= found.coverage[0.95].high
            wrong += found.coverage[0.95].verdict in {"too small", "too large"}
        # it was .86 and .77
        assert held / trials > 0.92
        assert wrong / trials < 0.07

    @pytest.mark.parametrize(("targets", "correlation"), [(10, 0.9), (20, 0.98), (10, 1.0)])
    def test_hold_the_truth_if_targets_follow_in_turn(self, targets, correlation):
        """Without groups; half of the variance lasts."""
        held, trials = 0, 40
        for trial in range(trials):
            error, _ = lasting_errors(correlation, targets, 80, 700 + trial)
            error = (error + rng(800 + trial).standard_normal(error.shape)) / np.sqrt(2)
            turns = error.reshape(targets, 80, 2).swapaxes(0, 1).reshape(-1, 2)
            nees = audit(turns, 1.0).nees
            held += nees.low <= 1.0 <= nees.high
        assert held / trials > 0.9

    def test_as_if_independent_they_would_not(self):
        held = 0
        for trial in range(self.TRIALS):
            error, _ = lasting_errors(0.95, 1, 1000, 10 + trial)
            low, high = metrics.consistency_bounds(1000, 2, 0.95)
            held += low <= np.mean(np.sum(error**2, axis=-1)) <= high
        assert held / self.TRIALS < 0.6


class TestVerdicts:
    def test_too_small(self):
        found = audit(rng(1).normal(0, 3.0, (500, 2)), 1.0)
        assert found.verdict.startswith("too small by a factor of 2.9 (2.")
        assert found.coverage[0.95].verdict == "too small"
        assert repr(found).startswith("Audit(too small by a factor of 2.9")

    def test_too_large(self):
        found = audit(rng(1).normal(0, 0.5, (500, 2)), 1.0)
        assert found.verdict.startswith("too large by a factor of 2.")
        assert found.nees.verdict.startswith("too large by a factor of 2.0")

    def test_errors_of_zero(self):
        found = audit(np.zeros((50, 2)), 1.0)
        assert found.verdict == "all errors are 0: the estimates seem to be the truth itself"
        assert "unbounded" not in str(found)

    def test_honest(self):
        assert audit(rng(1).standard_normal((500, 2)), 1.0).verdict == "honest"

    def test_too_short(self):
        assert audit(rng(1).standard_normal(6), 1.0).verdict == "too short to tell"

    def test_errors_that_never_change_are_one_error(self):
        found = audit(np.full((300, 2), 1.2), 1.0)
        assert found.effective_number < 3
        assert found.verdict == "too short to tell"

    def test_a_gross_error_shows_in_a_short_record(self):
        assert audit(rng(1).normal(0, 50.0, 8), 1.0).verdict.startswith("too small")

    def test_print(self):
        error = rng(1).standard_normal((400, 2))
        error[3] = NAN
        found = audit(error, 1.0, strata=np.repeat(["sea", "land"], 200))
        text = str(found)
        assert "sigmas: honest" in text
        assert "1 rows left out" in text
        assert "land: Audit(" in text


class TestArguments:
    def test_shapes_of_covariances(self):
        error = rng(2).standard_normal((60, 2))
        expected = audit(error, np.tile(4.0 * np.eye(2), (60, 1, 1))).nees
        for covariance in (4.0, np.full(60, 4.0), np.full((60, 2), 4.0), 4.0 * np.eye(2)):
            assert audit(error, covariance).nees == expected

    def test_one_and_three_axes(self):
        for axes in (1, 3):
            found = audit(rng(3).standard_normal((300, axes)), 1.0)
            assert found.verdict == "honest"

    def test_missing_rows_are_counted(self):
        error = rng(2).standard_normal((60, 2))
        error[5, 0] = NAN
        covariance = np.ones((60, 2))
        covariance[7] = np.inf
        found = audit(error, covariance)
        assert (found.count, found.missing) == (58, 2)

    def test_the_error_of_the_truth_counts(self):
        error = rng(4).normal(0, np.sqrt(5.0), (2000, 2))
        found = audit(error, 1.0, truth_covariance=4.0 * np.eye(2))
        assert found.verdict == "honest"
        assert found.scale[0.95].value == close(1.0, 0.3)
        # the truth's error alone explains more than there is
        assert audit(error, 1.0, truth_covariance=9.0).scale[0.95].value == 0.0

    def test_scale_with_truth_solves_its_equation(self):
        error = rng(5).normal(0, 4.0, (50, 2))
        c, t = np.array([[2.0, 0.5], [0.5, 1.0]]), np.array([[0.4, -0.1], [-0.1, 0.8]])
        found = audit(error, c, truth_covariance=t, probability=[0.5])
        quantile = stats.chi2.ppf(0.5, 2)
        squares = metrics.nees(error, found.scale[0.5].value * c + t)
        # linear between the two middle rows
        assert np.median(squares) == close(quantile, 0.02)

    def test_time_orders_the_rows(self):
        error, _ = lasting_errors(0.9, 1, 300, 1)
        shuffled = rng(6).permutation(300)
        inorder = audit(error, 1.0, time=np.arange(300.0))
        found = audit(error[shuffled], 1.0, time=np.arange(300.0)[shuffled])
        assert found.nees.low == close(inorder.nees.low)
        assert found.effective_number == close(inorder.effective_number)

    def test_groups_of_text(self):
        error, group = lasting_errors(0.5, 12, 30, 1)
        names = np.array([f"flight {k}" for k in group], dtype=object)
        found, expected = (audit(error, 1.0, groups=labels).nees for labels in (names, group))
        assert (found.low, found.high) == close((expected.low, expected.high), 1e-10)

    def test_strata_by_label_and_by_quartile(self):
        error = rng(7).standard_normal((400, 2)) * np.repeat([1.0, 4.0], 200)[:, None]
        found = audit(error, 1.0, strata={"part": np.repeat(["a", "b"], 200), "size": error[:, 0]})
        assert list(found.strata)[:2] == ["part a", "part b"]
        assert len(found.strata) == 6
        assert found.strata["part a"].verdict == "honest"
        assert found.strata["part b"].verdict.startswith("too small by a factor of 3.7")

    @pytest.mark.parametrize("scale", [1e-7, 1e-3, 1.0, 1e6])
    def test_quartiles_have_distinct_names_whatever_the_unit(self, scale):
        values = np.random.default_rng(1).uniform(0.1, 0.9, 200)
        for size in (values, 1e4 + values):
            found = audit(values, 1.0, strata={"sigma": scale * size})
            assert [part.count for part in found.strata.values()] == [50] * 4

    def test_labels_have_distinct_names(self):
        label = np.repeat([1000000.1, 1000000.2, 0.5, np.nan], 50)
        found = audit(label, 1.0, strata={"code": label})
        assert list(found.strata) == ["code 0.5", "code 1000000.1", "code 1000000.2"]

    def test_time_offset(self):
        time = np.arange(400.0)
        velocity = np.column_stack([5 * np.cos(time / 40), 5 * np.sin(time / 40)])
        error = rng(8).standard_normal((400, 2)) - 3.0 * velocity
        found = audit(error, 1.0, time=time, velocity=velocity).time_offset
        assert found.low < 3.0 < found.high
        assert found.value == close(3.0, 0.02)
        assert found.verdict.startswith("add 3")
        assert audit(error, 1.0).time_offset is None

    def test_split(self):
        one, other = rng(9).normal(0.0, [[[3.0]], [[4.0]]], (2, 500, 2))
        assert metrics.audit_split(one, 9.0, other, 16.0).verdict == "honest"
        assert metrics.audit_split(one, 9.0, other, 1.0).verdict.startswith("too small")

    def test_top_level(self):
        assert tertia.audit is metrics.audit
        assert tertia.Audit is metrics.Audit


class TestRefused:
    def test_singular_covariances_with_their_row(self):
        covariance = np.tile(np.eye(2), (9, 1, 1))
        covariance[7] = [[1.0, 1.0], [1.0, 1.0]]
        covariance[2] = NAN
        with pytest.raises(
            np.linalg.LinAlgError, match=r"covariance\[7\] is not positive definite"
        ):
            audit(np.ones((9, 2)), covariance)

    def test_variance_of_zero(self):
        with pytest.raises(np.linalg.LinAlgError, match=r"covariance\[1\]"):
            audit(np.ones(3), [1.0, 0.0, 1.0])

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            ({"error": np.ones((2, 2, 2)), "covariance": 1.0}, r"error has shape \(2, 2, 2\)"),
            ({"error": np.ones((3, 2)), "covariance": np.ones((3, 3))}, "covariance has shape"),
            ({"error": [NAN, NAN], "covariance": 1.0}, "^error and covariance have no row of"),
            (
                {"error": [1.0], "covariance": 1.0, "time": [NAN]},
                "^error, covariance and time have no row of finite numbers",
            ),
            ({"error": [1.0], "covariance": 1.0, "probability": [1.5]}, "probability is 1.5"),
            ({"error": [1.0], "covariance": 1.0, "probability": []}, "probability is empty"),
            ({"error": [1.0], "covariance": 1.0, "confidence_level": 1.0}, "confidence_level"),
            ({"error": [1.0], "covariance": 1.0, "time": [1.0, 2.0]}, "time has shape"),
            ({"error": [1.0], "covariance": 1.0, "groups": [1, 2]}, "groups has shape"),
            ({"error": [1.0], "covariance": 1.0, "strata": {"a": [1, 2]}}, r"strata\['a'\]"),
            ({"error": [1.0], "covariance": 1.0, "velocity": [1.0, 2.0]}, "velocity has shape"),
        ],
    )
    def test_arguments(self, arguments, message):
        with pytest.raises(ValueError, match=message):
            audit(arguments.pop("error"), arguments.pop("covariance"), **arguments)


@pytest.mark.skipif(not (DATA / "difar").is_dir(), reason="no recordings")
class TestSonobuoys:
    """Positions from the bearings of four drifting finders, whose compasses are off by degrees."""

    @staticmethod
    def audited(bias):
        rows = pl.read_csv(DATA / "difar/bearings.csv", null_values=["NaN"])
        frame = LocalFrame(32.82, -117.585)
        calls, buoys = (
            rows[name].unique(maintain_order=True).to_list() for name in ("call_id", "buoy")
        )
        call = rows["call_id"].replace_strict(calls, range(len(calls))).to_numpy()
        buoy = rows["buoy"].replace_strict(buoys, range(len(buoys))).to_numpy()
        azimuth, sites = np.full((len(calls), 4), NAN), np.full((4, len(calls), 2), NAN)
        azimuth[call, buoy] = np.radians(rows["bearing_deg"].to_numpy())
        sites[buoy, call] = frame.to_local(rows["buoy_lat"], rows["buoy_lon"], 0.0)[:, :2]
        boat, time = np.zeros((len(calls), 2)), np.zeros(len(calls))
        boat[call] = frame.to_local(rows["boat_lat"], rows["boat_lon"], 0.0)[:, :2]
        time[call] = rows["t_s"].to_numpy()
        for site in sites:
            for axis in site.T:
                axis[:] = np.interp(np.arange(len(axis)), *_known(axis))
        stations = [Station(site, azimuth_sigma=np.radians(5.0)) for site in sites]
        fixes = locate(stations, azimuth=azimuth, bias=bias)
        error = np.where(fixes.success[:, np.newaxis], fixes.position - boat, NAN)
        return audit(error, fixes.covariance, time=time)

    def test_trusted_sigmas_are_convicted(self):
        found = self.audited(Bias())
        assert found.verdict.startswith("too small by a factor of ")
        assert found.coverage[0.95].high < 0.8

    def test_estimated_biases_are_acquitted(self):
        found = self.audited(None)
        # one track is worth some ten independent positions, which may be too few to acquit
        assert found.verdict in {"honest", "too short to tell"}
        assert found.coverage[0.95].low < 0.95 < found.coverage[0.95].high
        assert found.coverage[0.95].value > 0.9


def _known(values):
    there = np.flatnonzero(np.isfinite(values))
    return there, values[there]


@pytest.mark.parametrize("shape", [(0,), (0, 2), (3, 0)])
def test_no_errors(shape):
    with pytest.raises(ValueError, match="error has shape"):
        audit(np.zeros(shape), 1.0)
