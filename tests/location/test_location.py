"""Location: against SciPy, published fixes, and the truth."""

import functools

import numpy as np
import pytest
from checks import assert_covariance, in_region
from matplotlib.figure import Figure
from places import DATA, difar
from reference import location as reference
from scipy import integrate, optimize, stats
from scipy.spatial.transform import Rotation
from tolerances import CHANCE

from tertia import metrics, plot, simulate
from tertia.location import LocationStatus, Station, accuracy_map, locate
from tertia.sensors import Bias

NAN, INF = float("nan"), float("inf")
SQUARE = np.array([[0, 0], [2000, 0], [2000, 2000], [0, 2000.0]])
PLANE = np.array([*SQUARE.tolist(), [1000, -1500], [-1500, 800], [3500, 1200], [800, 3600]])
UP = np.array([0.0, 300, 10, 200, 5, 150, 0, 400])
SPACE = np.column_stack([PLANE, UP])
TRIO = np.array([[1, 1000, 2], [2000, 300, 5], [400, 2600, 0.0]])
TARGET = np.array([700.0, 1100.0])
HIGH = np.array([1000.0, 1500.0, 500.0])
SIGMAS = {
    "range": 10.0,
    "azimuth": np.radians(0.3),
    "elevation": np.radians(0.3),
    "range_difference": 10.0,
}
CASES = {
    "azimuths": (PLANE, TARGET, ("azimuth",)),
    "ranges": (PLANE, TARGET, ("range",)),
    "range differences": (PLANE, TARGET, ("range_difference",)),
    "ranges and azimuths": (SQUARE, TARGET, ("range", "azimuth")),
    "azimuths and range differences": (SQUARE, TARGET, ("azimuth", "range_difference")),
    "radars": (TRIO, HIGH, ("range", "azimuth", "elevation")),
    "ranges in space": (SPACE, HIGH, ("range",)),
    "range differences in space": (SPACE, HIGH, ("range_difference",)),
    "angles in space": (TRIO, HIGH, ("azimuth", "elevation")),
    "everything": (SPACE, HIGH, reference.KINDS),
    "ranges and elevations": (TRIO, HIGH, ("range", "elevation")),
}

# range differences as they are drawn here: each with an error of its own
independent = functools.partial(locate, range_difference_correlation=0.0)


def draw(case, count, seed=0, faults=0, size=20.0):
    """Measurements of `count` instants, with so many faults in each."""
    places, target, kinds = CASES[case] if isinstance(case, str) else case
    rng = np.random.default_rng(seed)
    truth = reference.predict(target, places)
    lengths = [truth[kind].size for kind in kinds]
    noise = rng.normal(size=(count, sum(lengths)))
    chosen = np.argsort(rng.random(noise.shape), axis=-1) < faults
    noise += chosen * size * rng.choice([-1, 1], noise.shape)
    parts = np.split(noise, np.cumsum(lengths)[:-1], axis=-1)
    return {k: truth[k] + SIGMAS[k] * e for k, e in zip(kinds, parts, strict=True)}


def sigma(kinds):
    """Sigmas that are right, and trusted."""
    return {"bias": Bias(), **{f"{kind}_sigma": SIGMAS[kind] for kind in kinds}}


def solve(case, measured, **options):
    places = CASES[case][0] if isinstance(case, str) else case[0]
    return independent(places, **measured, **{**sigma(measured), **options})


def one(measured, i=0):
    return {kind: value[i] for kind, value in measured.items()}


def whitened(fix):
    parts = [getattr(fix.residual, kind) for kind in reference.KINDS]
    rows = np.concatenate([part for part in parts if part is not None], axis=-1)
    return rows[..., ~np.isnan(rows)] if rows.ndim == 1 else rows


class TestLeastSquares:
    @pytest.mark.parametrize("case", CASES)
    def test_against_scipy(self, case):
        places, target, _ = CASES[case]
        measured = draw(case, 10, seed=1)
        fixes = solve(case, measured, method="least-squares", initial=target + 30.0)
        for i in range(10):
            row = one(measured, i)

            def fun(p, row=row):
                return reference.residuals(p, places, row, SIGMAS)

            best = optimize.least_squares(
                fun, target, "3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale="jac"
            )
            jacobian = reference.jacobian(best.x, places, row, SIGMAS)
            covariance = np.linalg.inv(jacobian.T @ jacobian)
            error = metrics.nees(fixes.position[i] - best.x, covariance) ** 0.5
            assert error < 1e-6  # SciPy's own: its Jacobian is of differences
            gradient = jacobian.T @ fun(fixes.position[i])
            assert np.sqrt(gradient @ covariance @ gradient) < 1e-7
            np.testing.assert_allclose(fixes.covariance[i], covariance, rtol=1e-6)
            np.testing.assert_allclose(
                whitened(fixes)[i], fun(fixes.position[i]), rtol=0, atol=1e-9
            )
            assert fixes.statistic[i] == pytest.approx(2 * best.cost, rel=1e-9)
            degrees = fun(target).size - target.size
            assert fixes.degrees_of_freedom[i] == degrees
            expected = stats.chi2.sf(fixes.statistic[i], degrees) if degrees else 1.0
            assert fixes.pvalue[i] == pytest.approx(expected, rel=1e-9)

    def test_the_gradient_vanishes_to_rounding(self):
        """J' r = 0 with J in closed form: ranges in the plane."""
        places, _, _ = CASES["ranges"]
        measured = draw("ranges", 50, seed=2)
        fixes = solve("ranges", measured, method="least-squares")
        offset = fixes.position[:, np.newaxis] - places
        distance = np.linalg.norm(offset, axis=-1)
        r = (measured["range"] - distance) / 10.0
        gradient = np.einsum("nk,nki->ni", r, offset / distance[..., np.newaxis] / 10.0)
        assert np.max(np.sqrt(metrics.nees(gradient, np.linalg.inv(fixes.covariance)))) < 1e-9

    @pytest.mark.parametrize("case", CASES)
    def test_exact_measurements_give_the_target(self, case):
        places, target, kinds = CASES[case]
        truth = reference.predict(target, places)
        exact = {kind: truth[kind] for kind in kinds}
        # stations on the ground do not tell up from down
        initial = target + 10 if case == "ranges and elevations" else None
        fix = solve(case, exact, initial=initial)
        np.testing.assert_allclose(fix.position, target, rtol=0, atol=1e-8)
        assert fix.statistic < 1e-12
        assert fix.outlier.count == 0
        assert fix.status == LocationStatus.OK
        assert fix.success

    def test_dilution(self):
        """Two perpendicular ranges."""
        fix = locate([[0, 1000], [1000, 0], [-1000, 0]], range=[1000, 1000, 1000], range_sigma=7.0)
        assert fix.dop == pytest.approx(np.sqrt(1 + 1 / 2), rel=1e-12)
        np.testing.assert_allclose(fix.covariance, np.diag([49 / 2, 49]), rtol=1e-12, atol=1e-9)
        mixed = solve("radars", one(draw("radars", 1)))
        assert np.isnan(mixed.dop)


class TestRobust:
    @pytest.mark.parametrize("faults", [0, 1, 2])
    @pytest.mark.parametrize("case", ["azimuths", "ranges", "range differences", "radars"])
    def test_it_is_the_minimum_of_tukeys_cost(self, case, faults):
        places, target, _ = CASES[case]
        measured = draw(case, 4, seed=3, faults=faults)
        fixes = solve(case, measured)
        for i in np.flatnonzero(fixes.success):
            row = one(measured, i)

            def cost(p, row=row):
                return reference.tukey_cost(reference.residuals(p, places, row, SIGMAS))

            best = min(
                (
                    optimize.minimize(cost, start, method="Nelder-Mead", options=OPTIONS)
                    for start in (target, fixes.position[i])
                ),
                key=lambda found: found.fun,
            )
            assert cost(fixes.position[i]) <= best.fun + 1e-9
            u = reference.residuals(fixes.position[i], places, row, SIGMAS)
            jacobian = reference.jacobian(fixes.position[i], places, row, SIGMAS)
            weighted = jacobian.T * reference.tukey_weight(u) @ jacobian
            factor = asymptotic_factor()
            # the reference's jacobian is that of residuals, measured less predicted
            expected = factor * np.linalg.inv(weighted) + reference.doubt(u, -jacobian)
            # covariances cancel: they are compared in units of the standard deviations
            unit = np.sqrt(np.outer(np.diagonal(expected), np.diagonal(expected)))
            np.testing.assert_allclose(fixes.covariance[i] / unit, expected / unit, atol=1e-5)
            assert fixes.outlier.count[i] == np.sum(np.abs(u) >= reference.TUKEY)

    def test_faults_are_found(self):
        measured = draw("radars", 1, seed=4)
        wrong = one(measured)
        wrong["range"][1] += 300
        wrong["azimuth"][2] -= 0.2
        fix = solve("radars", wrong)
        np.testing.assert_array_equal(fix.outlier.range, [False, True, False])
        np.testing.assert_array_equal(fix.outlier.azimuth, [False, False, True])
        assert not fix.outlier.elevation.any()
        assert fix.outlier.range_difference is None
        assert fix.pvalue < 1e-10
        assert np.linalg.norm(fix.position - HIGH) < 30

    def test_flat_costs(self):
        """Where the cost curves down, steps with weights alone creep for hundreds of steps."""
        fixes = solve("radars", draw("radars", 20_000, seed=1, faults=1, size=5.0))
        assert not np.any(fixes.status == LocationStatus.NOT_CONVERGED)

    @pytest.mark.parametrize("size", [1e3, 1e6, 1e9])
    def test_however_large(self, size):
        wrong = one(draw("ranges", 1, seed=5))
        clean = solve("ranges", wrong)
        wrong["range"][3] += size
        fix = solve("ranges", wrong)
        np.testing.assert_array_equal(np.flatnonzero(fix.outlier.range), [3])
        assert np.linalg.norm(fix.position - clean.position) < 10

    def test_redundancy_decides(self):
        """With three degrees of freedom it is robust, with two by least squares."""
        measured = reference.predict(TARGET, PLANE)["azimuth"][:5]
        measured[0] += 1.0
        s = SIGMAS["azimuth"]
        fix = locate(PLANE[:5], azimuth=measured, azimuth_sigma=s)
        assert fix.outlier.azimuth[0]
        squares = locate(PLANE[:5], azimuth=measured, azimuth_sigma=s, redundancy=4)
        plain = locate(PLANE[:5], azimuth=measured, azimuth_sigma=s, method="least-squares")
        np.testing.assert_array_equal(squares.position, plain.position)
        assert squares.outlier.count == 0
        few = locate(PLANE[:4], azimuth=measured[:4], azimuth_sigma=s, redundancy=2)
        assert few.outlier.azimuth[0]

    def test_contradictions_are_told(self):
        """Everything is wrong: no small error bar without a word."""
        rng = np.random.default_rng(7)
        azimuth = rng.uniform(0, 2 * np.pi, (500, 8))
        fixes = locate(PLANE, azimuth=azimuth, azimuth_sigma=0.005)
        located = fixes.success
        assert np.max(fixes.pvalue[located], initial=0.0) < 1e-6


OPTIONS = {"xatol": 1e-10, "fatol": 1e-14, "maxiter": 2000, "maxfev": 4000}


def asymptotic_factor():
    """`E w E psi² / (E psi')²` of Tukey's biweight, by quadrature."""
    c = reference.TUKEY

    def mean(f):
        return integrate.quad(lambda u: f((u / c) ** 2, u) * stats.norm.pdf(u), -c, c)[0]

    weight = mean(lambda q, u: (1 - q) ** 2)
    square = mean(lambda q, u: ((1 - q) ** 2 * u) ** 2)
    slope = mean(lambda q, u: (1 - q) * (1 - 5 * q))
    return weight * square / slope**2


class TestErrorBars:
    COUNT = 20_000

    def nees(self, case, **options):
        target = (CASES[case] if isinstance(case, str) else case)[1]
        measured = draw(
            case,
            self.COUNT,
            options.pop("seed", 8),
            options.pop("faults", 0),
            options.pop("size", 20.0),
        )
        fixes = solve(case, measured, **options)
        located = fixes.success
        assert located.mean() > 0.97
        return metrics.nees(fixes.position - target, fixes.covariance)[located]

    @pytest.mark.parametrize("method", ["least-squares", "robust"])
    @pytest.mark.parametrize("case", ["azimuths", "ranges", "range differences", "radars"])
    def test_without_faults(self, case, method):
        values = self.nees(case, method=method)
        d = CASES[case][1].size
        low, high = stats.chi2.ppf([CHANCE / 2, 1 - CHANCE / 2], d * values.size) / values.size / d
        assert low < values.mean() / d < high

    @pytest.mark.parametrize("faults", [1, 2])
    @pytest.mark.parametrize("case", ["azimuths", "ranges", "range differences", "radars"])
    def test_with_faults(self, case, faults):
        values = self.nees(case, faults=faults)
        assert values.mean() / CASES[case][1].size < 1.3

    @pytest.mark.parametrize("case", ["azimuths", "ranges", "range differences", "radars"])
    def test_faults_that_are_partly_believed(self, case):
        values = self.nees(case, faults=1, size=5.0)
        assert values.mean() / CASES[case][1].size < 1.3

    def test_sigma_unknown_by_least_squares(self):
        """An F distribution."""
        measured = draw("azimuths", self.COUNT, 9)
        fixes = locate(PLANE, **measured, method="least-squares")
        f = metrics.nees(fixes.position - TARGET, fixes.covariance) / 2
        inside = np.mean(f < stats.f.ppf(0.95, 2, 6))
        assert abs(inside - 0.95) < 3 * np.sqrt(0.95 * 0.05 / f.size)
        variance = fixes.measurement_sigma**2 / SIGMAS["azimuth"] ** 2
        assert abs(variance.mean() - 1) < 4 * variance.std() / np.sqrt(f.size)

    @pytest.mark.parametrize("faults", [0, 1])
    def test_sigma_unknown_robustly(self, faults):
        measured = draw("azimuths", self.COUNT, 10, faults)
        fixes = locate(PLANE, **measured)
        f = metrics.nees(fixes.position - TARGET, fixes.covariance) / 2
        assert 0.91 < np.mean(f < stats.f.ppf(0.95, 2, 6)) < 0.97
        assert 0.8 < np.nanmedian(fixes.measurement_sigma) / SIGMAS["azimuth"] < 1.1
        assert np.all(np.isnan(fixes.pvalue))
        assert fixes.success.mean() > 0.999


class TestInvariance:
    @pytest.mark.parametrize("method", ["robust", "least-squares"])
    @pytest.mark.parametrize("case", ["azimuths", "ranges", "radars"])
    def test_order_of_the_stations(self, case, method):
        places, _, kinds = CASES[case]
        measured = draw(case, 50, seed=11, faults=1)
        order = np.random.default_rng(12).permutation(len(places))
        a = solve(case, measured, method=method)
        b = independent(
            places[order],
            **{k: v[:, order] for k, v in measured.items()},
            **sigma(kinds),
            method=method,
        )
        np.testing.assert_array_equal(a.status, b.status)
        np.testing.assert_allclose(a.position, b.position, rtol=0, atol=1e-5)

    @pytest.mark.parametrize("case", CASES)
    def test_translation(self, case):
        places, target, kinds = CASES[case]
        measured = draw(case, 20, seed=13)
        shift = np.array([1e6, -2e6, 1e6])[: target.size]
        a = solve(case, measured, initial=target)
        b = independent(places + shift, **measured, **sigma(kinds), initial=target + shift)
        np.testing.assert_allclose(a.position, b.position - shift, rtol=0, atol=3e-8)

    @pytest.mark.parametrize("case", ["azimuths", "ranges", "radars", "everything"])
    def test_rotation(self, case):
        places, target, kinds = CASES[case]
        measured = draw(case, 20, seed=14)
        angle = 2.5
        turn = np.eye(target.size)
        # azimuths turn clockwise
        turn[:2, :2] = [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
        turned = dict(measured)
        if "azimuth" in turned:
            turned["azimuth"] = measured["azimuth"] + angle
        a = solve(case, measured)
        b = independent(places @ turn.T, **turned, **sigma(kinds))
        np.testing.assert_allclose(a.position @ turn.T, b.position, rtol=0, atol=1e-5)
        np.testing.assert_allclose(turn @ a.covariance @ turn.T, b.covariance, rtol=1e-5, atol=1e-6)

    @pytest.mark.parametrize("turns", [-1, 1])
    def test_whole_turns(self, turns):
        measured = draw("azimuths", 20, seed=15)
        a = solve("azimuths", measured)
        b = solve("azimuths", {"azimuth": measured["azimuth"] + 2 * np.pi * turns})
        np.testing.assert_allclose(a.position, b.position, rtol=0, atol=1e-7)

    @pytest.mark.parametrize("case", CASES)
    def test_a_batch_is_a_loop(self, case):
        measured = draw(case, 30, seed=16, faults=1)
        target = CASES[case][1]
        batch = solve(case, measured, initial=target)
        for i in np.flatnonzero(batch.success):
            single = solve(case, one(measured, i), initial=target)
            np.testing.assert_array_equal(single.position, batch.position[i])
            np.testing.assert_array_equal(single.covariance, batch.covariance[i])
            assert single.statistic == batch.statistic[i]

    @pytest.mark.parametrize("faults", [0, 2, 4])
    @pytest.mark.parametrize("method", ["robust", "least-squares"])
    def test_company_does_not_matter(self, method, faults):
        """Instants side by side: alone, in another order, beside gaps and nonsense."""
        measured = draw("radars", 61, seed=28, faults=faults)
        measured["azimuth"][::7, 1] = NAN
        measured["range"][3] = 1e9
        a = solve("radars", measured, method=method)
        order = np.random.default_rng(29).permutation(61)
        b = solve("radars", {k: v[order] for k, v in measured.items()}, method=method)
        names = ("position", "covariance", "statistic", "pvalue", "status")
        for name in names:
            np.testing.assert_array_equal(getattr(a, name)[order], getattr(b, name))
        np.testing.assert_array_equal(whitened(a)[order], whitened(b))
        for i in np.flatnonzero(a.success):
            single = solve("radars", one(measured, i), method=method)
            for name in names:
                np.testing.assert_array_equal(getattr(a, name)[i], getattr(single, name))

    @pytest.mark.parametrize("n_threads", [2, 5])
    def test_threads(self, n_threads):
        measured = draw("radars", 500, seed=17, faults=1)
        a = solve("radars", measured, n_threads=1)
        b = solve("radars", measured, n_threads=n_threads)
        for name in ("position", "covariance", "statistic", "status", "pvalue"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
        np.testing.assert_array_equal(a.outlier.range, b.outlier.range)

    def test_missing_is_absent(self):
        """nan as if the station were not there."""
        measured = one(draw("ranges", 1, seed=18))["range"]
        gaps = measured.copy()
        gaps[[2, 5]] = NAN
        a = locate(PLANE, range=gaps, range_sigma=10.0)
        kept = np.delete(np.arange(8), [2, 5])
        b = locate(PLANE[kept], range=measured[kept], range_sigma=10.0)
        np.testing.assert_array_equal(a.position, b.position)
        np.testing.assert_array_equal(a.covariance, b.covariance)
        assert np.isnan(a.residual.range[[2, 5]]).all()
        assert a.degrees_of_freedom == 4

    def test_moving_stations(self):
        rng = np.random.default_rng(19)
        places = PLANE + rng.normal(scale=100, size=(40, 8, 2))
        offset = TARGET - places
        azimuth = np.arctan2(offset[..., 0], offset[..., 1]) + rng.normal(0, 0.005, (40, 8))
        batch = locate(places, azimuth=azimuth, azimuth_sigma=0.005)
        moving = [Station(places[:, k], azimuth_sigma=0.005) for k in range(8)]
        np.testing.assert_array_equal(batch.position, locate(moving, azimuth=azimuth).position)
        for i in range(40):
            single = locate(places[i], azimuth=azimuth[i], azimuth_sigma=0.005)
            np.testing.assert_array_equal(single.position, batch.position[i])


def rotations(count, d, seed=0, size=None):
    """Rotations, by any angle or by up to `size` radians about each axis."""
    rng = np.random.default_rng(seed)
    if d == 2:
        angle = rng.uniform(-1, 1, count) * (np.pi if size is None else size)
        return np.stack(
            [np.stack([np.cos(a), np.sin(a), -np.sin(a), np.cos(a)]).reshape(2, 2) for a in angle]
        )
    if size is None:
        return Rotation.random(count, rng=rng).as_matrix()
    return Rotation.from_euler("xyz", rng.uniform(-size, size, (count, 3))).as_matrix()


def tilted(places, axes):
    every = {f"{kind}_sigma": SIGMAS[kind] for kind in ("range", "azimuth", "elevation")}
    return [Station(p, axes=a, **every) for p, a in zip(places, axes, strict=True)]


class TestAxes:
    """Stations whose angles refer to an east, north and up of their own."""

    @pytest.mark.parametrize("size", [0.02, 0.4])
    @pytest.mark.parametrize("case", CASES)
    def test_against_scipy(self, case, size):
        places, target, kinds = CASES[case]
        axes = rotations(len(places), target.size, seed=41, size=size)
        truth = reference.predict(target, places, axes)
        rng = np.random.default_rng(42)
        deviations = {f"{kind}_sigma": SIGMAS[kind] for kind in kinds}
        for _ in range(5):
            row = {k: truth[k] + SIGMAS[k] * rng.normal(size=truth[k].size) for k in kinds}
            fix = independent(
                tilted(places, axes),
                **row,
                **deviations,
                bias=Bias(),
                method="least-squares",
                initial=target + 30.0,
            )

            def fun(p, row=row):
                return reference.residuals(p, places, row, SIGMAS, axes)

            best = optimize.least_squares(
                fun, target, "3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale="jac"
            )
            jacobian = reference.jacobian(best.x, places, row, SIGMAS, axes)
            covariance = np.linalg.inv(jacobian.T @ jacobian)
            assert metrics.nees(fix.position - best.x, covariance) ** 0.5 < 1e-6
            np.testing.assert_allclose(fix.covariance, covariance, rtol=1e-6)
            np.testing.assert_allclose(whitened(fix), fun(fix.position), rtol=0, atol=1e-9)

    @pytest.mark.parametrize("case", CASES)
    def test_exact_measurements_give_the_target(self, case):
        """Without a start: the points where measurements meet know of the axes."""
        places, target, kinds = CASES[case]
        axes = rotations(len(places), target.size, seed=43)
        truth = reference.predict(target, places, axes)
        fix = independent(
            tilted(places, axes),
            **{kind: truth[kind] for kind in kinds},
            **{f"{kind}_sigma": SIGMAS[kind] for kind in kinds},
        )
        np.testing.assert_allclose(fix.position, target, rtol=0, atol=1e-8)
        assert fix.statistic < 1e-12
        assert fix.outlier.count == 0

    @pytest.mark.parametrize("method", ["robust", "least-squares"])
    @pytest.mark.parametrize("case", ["azimuths", "radars", "angles in space", "everything"])
    def test_a_rotated_frame_changes_nothing(self, case, method):
        """The same measurements, all coordinates in another frame."""
        places, target, kinds = CASES[case]
        measured = draw(case, 20, seed=44, faults=1)
        (turn,) = rotations(1, target.size, seed=45)
        a = solve(case, measured, method=method)
        stations = tilted(places @ turn.T, [turn.T] * len(places))
        deviations = {f"{kind}_sigma": SIGMAS[kind] for kind in kinds}
        b = independent(stations, **measured, **deviations, bias=Bias(), method=method)
        np.testing.assert_array_equal(a.status, b.status)
        np.testing.assert_allclose(a.position @ turn.T, b.position, rtol=0, atol=1e-5)
        np.testing.assert_allclose(turn @ a.covariance @ turn.T, b.covariance, rtol=1e-4, atol=1e-4)
        np.testing.assert_allclose(whitened(a), whitened(b), rtol=0, atol=1e-5)
        for kind in kinds:
            one, other = getattr(a.outlier, kind), getattr(b.outlier, kind)
            np.testing.assert_array_equal(one, other)

    @pytest.mark.parametrize("method", ["lenth-mle", "lenth-huber", "lenth-andrews"])
    def test_lenth(self, method):
        measured = draw("azimuths", 20, seed=46)
        (turn,) = rotations(1, 2, seed=47)
        a = locate(PLANE, **measured, method=method)
        b = locate(tilted(PLANE @ turn.T, [turn.T] * 8), **measured, azimuth_sigma=0.01)
        c = locate([Station(p @ turn.T, axes=turn.T) for p in PLANE], **measured, method=method)
        np.testing.assert_allclose(a.position @ turn.T, c.position, rtol=0, atol=1e-5)
        assert np.all(np.linalg.norm(b.position - c.position, axis=-1) < 30)

    def test_blind_along_its_own_vertical(self):
        (turn,) = rotations(1, 3, seed=48)
        stations = tilted(np.array([[0.0, 0, 0], [1e3, 0, 0]]), [turn, np.eye(3)])
        above = 500 * turn[2]
        offset = above - np.array([1e3, 0, 0])
        measured = {"range": [500.0, np.linalg.norm(offset)], "azimuth": [0.3, NAN]}
        with pytest.raises(ValueError, match="straight above"):
            locate(stations, **measured, elevation=[np.pi / 2, NAN], initial=above)
        assert np.all(np.isinf(accuracy_map(stations, above).sigma))
        assert np.all(np.isfinite(accuracy_map(stations, [0.0, 0.0, 500.0]).sigma))

    @pytest.mark.parametrize("d", [2, 3])
    def test_accuracy_map(self, d):
        places = TRIO[:, :d]
        axes = rotations(3, d, seed=49)
        grid = np.random.default_rng(50).uniform(-500, 3000, (20, d))
        kinds = ("range", "azimuth", "elevation")[:d]
        accuracy = accuracy_map(tilted(places, axes), grid, kinds=kinds)
        for p, covariance in zip(grid, accuracy.covariance, strict=True):
            exact = {kind: reference.predict(p, places, axes)[kind] for kind in kinds}
            jacobian = reference.jacobian(p, places, exact, SIGMAS, axes)
            np.testing.assert_allclose(covariance, np.linalg.inv(jacobian.T @ jacobian), rtol=1e-6)

    def test_a_batch_is_a_loop(self):
        """Stations that move and turn."""
        rng = np.random.default_rng(51)
        places = TRIO + rng.normal(scale=100, size=(20, 3, 3))
        axes = rotations(60, 3, seed=52).reshape(20, 3, 3, 3)
        axes[:, 2] = np.eye(3)
        truth = reference.predict(HIGH, places, axes)
        measured = {k: truth[k] + SIGMAS[k] * rng.normal(size=(20, 3)) for k in list(truth)[:2]}
        moving = [
            Station(
                places[:, k], axes=axes[:, k] if k < 2 else None, range_sigma=10, azimuth_sigma=5e-3
            )
            for k in range(3)
        ]
        batch = locate(moving, **measured)
        for i in range(20):
            single = locate(tilted(places[i], axes[i]), **one(measured, i), azimuth_sigma=5e-3)
            np.testing.assert_array_equal(single.position, batch.position[i])

    def test_those_of_the_frame(self):
        measured = draw("radars", 20, seed=53, faults=1)
        a = locate(tilted(TRIO, [np.eye(3)] * 3), **measured, bias=Bias())
        b = solve("radars", measured)
        np.testing.assert_allclose(a.position, b.position, rtol=0, atol=1e-8)

    @pytest.mark.parametrize("d", [2, 3])
    def test_simulated(self, d):
        places, target = TRIO[:, :d], HIGH[:d]
        axes = rotations(3, d, seed=54)
        stations = tilted(places, axes)
        kinds = ("range", "azimuth", "elevation")[:d]
        record = simulate.stations(stations, target, kinds=kinds, batch=2000, rng=55)
        truth = reference.predict(target, places, axes)
        for kind in kinds:
            error = np.mean(record.measurements[kind] - truth[kind], axis=0)
            assert np.all(np.abs(error) < 5 * SIGMAS[kind] / np.sqrt(2000))

    @pytest.mark.parametrize(
        ("axes", "message"),
        [
            (np.eye(2), r"axes has shape \(2, 2\); it must be \(..., 3, 3\)"),
            (np.ones(3), r"axes has shape \(3,\)"),
            (np.ones((4, 3, 3)), r"axes has shape \(4, 3, 3\), position \(3,\)"),
            (np.diag([1.0, 1.0, 1.0 + 1e-8]), "2e-08 off a rotation"),
            (np.diag([1.0, 1.0, -1.0]), "reflection"),
            (np.full((3, 3), NAN), r"axes\[0, 0\] is nan"),
        ],
    )
    def test_axes_that_are_none(self, axes, message):
        with pytest.raises(ValueError, match=message):
            Station([0, 0, 0], axes=axes)


class TestDegenerate:
    @pytest.mark.parametrize(
        ("places", "measured", "problem"),
        [
            ([[0, 0]], {"azimuth": [1.0]}, LocationStatus.TOO_FEW),
            ([[0, 0, 0.0]], {"range": [1.0]}, LocationStatus.TOO_FEW),
            ([[0, 0, 0.0]], {"range": [1.0], "azimuth": [0.2]}, LocationStatus.TOO_FEW),
            # parallel, diverging, behind one station
            ([[0, 0], [1000, 0]], {"azimuth": [0.3, 0.3]}, LocationStatus.NO_INTERSECTION),
            ([[0, 0], [1000, 0]], {"azimuth": [-0.3, 0.3]}, LocationStatus.NO_INTERSECTION),
            ([[0, 0], [1000, 0]], {"azimuth": [np.pi / 4, 3 * np.pi / 4]}, None),
            # circles too far apart
            ([[0, 0], [1000, 0]], {"range": [300, 300]}, LocationStatus.NO_INTERSECTION),
            ([[0, 0], [1000, 0]], {"range": [600, 600]}, LocationStatus.AMBIGUOUS),
            # in line: the mirror image is as good
            (
                [[0, 0], [1000, 0], [3000, 0]],
                {"range": [1500, 1118.0339887498948, 2291.28784747792]},
                LocationStatus.AMBIGUOUS,
            ),
            # along the baseline
            ([[0, 0], [1000, 0]], {"azimuth": [np.pi / 2, np.pi / 2]}, None),
            # a flat triangle of stations does not tell up from down
            (
                [[0, 0, 0], [1e3, 0, 0], [0, 1e3, 0.0]],
                {"range": [900, 900, 900]},
                LocationStatus.AMBIGUOUS,
            ),
        ],
    )
    def test_no_position(self, places, measured, problem):
        sigmas = {f"{kind}_sigma": 0.01 for kind in measured}
        rows = {kind: [value, value] for kind, value in measured.items()}
        batch = locate(places, **rows, **sigmas)
        assert np.all(batch.status != 0)
        if problem is not None:
            np.testing.assert_array_equal(batch.status, problem)
        assert np.isnan(batch.position).all()
        assert np.isnan(batch.covariance).all()
        with pytest.raises(ValueError, match=r"\w") as caught:
            locate(places, **measured, **sigmas)
        assert str(caught.value) == LocationStatus(batch.status[0]).message

    def test_only_that_instant(self):
        azimuth = np.array([[0.5, -0.5], [0.3, 0.3], [NAN, 0.3], [0.4, -0.6]])
        batch = locate([[0, 0], [1000, 0]], azimuth=azimuth, azimuth_sigma=0.01)
        np.testing.assert_array_equal(batch.success, [True, False, False, True])
        np.testing.assert_array_equal(batch.status, [0, 2, 1, 0])

    def test_at_a_station(self):
        azimuth = [np.pi / 2, 0.7, 0.0]
        places = [[0, 0], [1000, 0], [1000, -800]]
        batch = locate(places, azimuth=[azimuth] * 2, azimuth_sigma=0.01)
        np.testing.assert_array_equal(batch.status, LocationStatus.AT_STATION)
        with pytest.raises(ValueError, match="give nan for the measurements of that station"):
            locate(places, azimuth=azimuth, azimuth_sigma=0.01)
        azimuth[1] = NAN
        found = locate(places, azimuth=azimuth, azimuth_sigma=0.01)
        np.testing.assert_allclose(found.position, places[1], atol=1e-6)

    @pytest.mark.parametrize("method", ["robust", "least-squares"])
    @pytest.mark.parametrize("sigma", [1.0, 0.1, 1e-3])
    def test_rounding_is_not_small_compared_with_sigma(self, sigma, method):
        """Ranges of satellites: the rounding errors of positions are more than 1e-9 sigma."""
        rng = np.random.default_rng(1)
        directions = rng.normal(size=(9, 3))
        places = 2.6e7 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
        targets = rng.normal(0, 4e6, (100, 3))
        distances = np.linalg.norm(targets[:, np.newaxis] - places, axis=-1)
        measured = distances + sigma * rng.uniform(-1.7, 1.7, distances.shape)
        fixes = locate(places, range=measured, range_sigma=sigma, method=method)
        assert not np.any(fixes.status == LocationStatus.NOT_CONVERGED)
        assert fixes.success.mean() > 0.9
        errors = ((fixes.position - targets) / fixes.sigma)[fixes.success]
        assert 0.8 < np.sqrt(np.mean(errors**2)) < 1.2

    def test_initial_decides(self):
        for north in (-500, 500):
            fix = locate(
                [[0, 0], [1000, 0]], range=[600, 700], range_sigma=1.0, initial=[400, north]
            )
            assert np.sign(fix.position[1]) == np.sign(north)

    def test_a_third_station_decides(self):
        places = [[0, 0], [1000, 0], [400, 900]]
        ranges = np.linalg.norm(np.array(places) - [300, 500], axis=-1)
        fix = locate(places, range=ranges, range_sigma=1.0)
        np.testing.assert_allclose(fix.position, [300, 500], atol=1e-6)

    def test_sigma_unknown_and_nothing_redundant(self):
        fix = locate([[0, 0], [1000, 0]], azimuth=[0.5, -0.5])
        assert np.isfinite(fix.position).all()
        assert np.isinf(np.diagonal(fix.covariance)).all()
        assert np.isnan(fix.measurement_sigma)


class TestAccuracyMap:
    def test_it_is_the_covariance_of_exact_measurements(self):
        stations = [
            Station(p, range_sigma=10.0, azimuth_sigma=0.005, elevation_sigma=0.004) for p in TRIO
        ]
        grid = np.random.default_rng(20).uniform(100, 900, (4, 5, 3)) + np.array([0, 0, 300])
        found = accuracy_map(stations, grid)
        truth = reference.predict(grid[..., np.newaxis, :], TRIO)
        exact = {kind: truth[kind] for kind in ("range", "azimuth", "elevation")}
        fixes = locate(stations, **exact, method="least-squares")
        np.testing.assert_allclose(found.covariance, fixes.covariance, rtol=1e-7, atol=1e-7)
        only = accuracy_map(stations, grid, kinds=["range"])
        ranges = locate(stations, range=exact["range"], initial=grid, method="least-squares")
        np.testing.assert_allclose(only.covariance, ranges.covariance, rtol=1e-6)
        np.testing.assert_allclose(only.dop, ranges.dop, rtol=1e-6)

    def test_systematic_errors_are_in_it(self):
        bias = Bias(azimuth_sigma=[0.01, 0.0, 0.02], range_sigma=4.0 * np.ones(3))
        stations = [
            Station(p, range_sigma=3.0, azimuth_sigma=0.005, bias=bias[k])
            for k, p in enumerate(np.asarray(TRIO)[:, :2])
        ]
        truth = reference.predict(np.array([700.0, 300.0]), np.asarray(TRIO)[:, :2])
        exact = {kind: truth[kind] for kind in ("range", "azimuth")}
        found = accuracy_map(stations, [700.0, 300.0])
        fix = locate(stations, **exact, method="least-squares")
        np.testing.assert_allclose(found.covariance, fix.covariance, rtol=1e-6)
        trusted = accuracy_map(stations, [700.0, 300.0], bias=Bias())
        assert found.drms > 1.4 * trusted.drms
        with pytest.raises(ValueError, match="bias is that of 2 sensors"):
            accuracy_map(stations, [700.0, 300.0], bias=bias[:2])

    def test_what_may_be_off_by_anything_is_not_measured(self):
        bias = Bias(azimuth_sigma=[0.0, 0.0, np.inf])
        found = accuracy_map(SQUARE[:3], [700.0, 300.0], azimuth_sigma=0.01, bias=bias)
        without = accuracy_map(SQUARE[:2], [700.0, 300.0], azimuth_sigma=0.01)
        np.testing.assert_allclose(found.covariance, without.covariance, rtol=1e-12)
        with pytest.raises(ValueError, match="nothing would be measured"):
            accuracy_map(
                SQUARE[:3], [700.0, 300.0], azimuth_sigma=0.01, bias=Bias(azimuth_sigma=np.inf)
            )

    def test_undetermined(self):
        found = accuracy_map(SQUARE[:2], [[500, 0], [0, 0], [500, 500]], azimuth_sigma=0.01)
        np.testing.assert_array_equal(np.isinf(found.drms), [True, True, False])
        assert np.isinf(found.dop[0])
        assert found.dop[2] > 0

    def test_range_differences(self):
        found = accuracy_map(SQUARE, TARGET, range_difference_sigma=10.0)
        truth = reference.predict(TARGET, SQUARE)["range_difference"]
        fix = locate(SQUARE, range_difference=truth, range_difference_sigma=10.0)
        np.testing.assert_allclose(found.covariance, fix.covariance, rtol=1e-6)


def lenth(count=8):
    table = np.loadtxt(DATA / "lenth" / "lenth.dat", skiprows=1)
    table = table if count == 8 else np.delete(table, 5, axis=0)
    return table[:, 1:3], np.radians(table[:, 3])


@pytest.mark.skipif(not (DATA / "lenth").is_dir(), reason="the recording is not there")
class TestLenth:
    """Lenth (1981), On finding the source of a signal, with and without the sixth bearing."""

    PUBLISHED = (
        (7, "lenth-mle", 7.23, 1.98, 0.156, 0.156, 0.664),
        (7, "lenth-huber", 7.21, 1.98, 0.152, 0.152, 0.662),
        (7, "lenth-andrews", 7.21, 1.97, 0.156, 0.155, 0.669),
        (8, "lenth-mle", 5.87, 1.13, 1.490, 1.733, 0.509),
        (8, "lenth-huber", 6.78, 1.66, 0.883, 0.945, 0.600),
        (8, "lenth-andrews", 7.21, 1.97, 0.156, 0.155, 0.669),
    )

    @pytest.mark.parametrize(("count", "method", "x", "y", "sx", "sy", "correlation"), PUBLISHED)
    def test_published(self, count, method, x, y, sx, sy, correlation):
        places, azimuth = lenth(count)
        fix = locate(places, azimuth=azimuth, method=method)
        np.testing.assert_allclose(fix.position, [x, y], rtol=0, atol=0.005)
        # of eight bearings by Huber's it is .9444, printed .945
        np.testing.assert_allclose(fix.sigma, [sx, sy], rtol=0, atol=0.0006)
        found = fix.covariance[0, 1] / np.prod(fix.sigma)
        assert found == pytest.approx(correlation, abs=0.00051)

    def test_the_default_finds_the_wrong_bearing(self):
        places, azimuth = lenth()
        fix = locate(places, azimuth=azimuth)
        np.testing.assert_allclose(fix.position, [7.21, 1.97], rtol=0, atol=0.02)
        np.testing.assert_array_equal(np.flatnonzero(fix.outlier.azimuth), [5])

    def test_three_towers(self):
        """Most fixes are those of the reference, to a few metres."""
        fixes, reference_fixes, count = towers()
        distance = np.linalg.norm(fixes.position - reference_fixes, axis=-1)
        assert fixes.success.all()
        assert np.median(distance[count == 3]) < 5
        assert np.median(distance[count == 2]) < 1


def towers(method="lenth-mle"):
    """Fixes from three towers, the reference fixes, and how many bearings each has."""
    places = np.loadtxt(DATA / "lenth" / "towers.dat", delimiter=",", usecols=(0, 1))
    # a carriage return stands between the bearings and the fix
    lines = (DATA / "lenth" / "fixes.dat").read_bytes().decode().replace("\r", "").split("\n")
    # columns of a fixed width; three runs of stars or nonsense are no fixes
    lines = [line for line in lines if line[47:49] == "07" and line[55:57] == "43"]
    rows = [line[:47].split() for line in lines]
    index = np.array([[int(row[i]) - 1 for i in (4, 6, 8)] for row in rows])
    degrees = np.array([[float(row[i]) for i in (5, 7, 9)] for row in rows])
    # a bearing of zero was not taken
    azimuth = np.where(degrees == 0, NAN, np.radians(degrees))
    answer = np.array([[float(line[47:54]), float(line[55:62])] for line in lines])
    fixes = locate(places[index], azimuth=azimuth, method=method)
    return fixes, answer, np.sum(degrees != 0, axis=-1)


class TestLenthMethods:
    def test_the_likelihood_is_largest(self):
        """Of the von Mises distribution, with its concentration known."""
        measured = one(draw("azimuths", 1, seed=21))["azimuth"]

        def negative(p):
            return -np.sum(np.cos(measured - reference.predict(p, PLANE)["azimuth"]))

        best = optimize.minimize(negative, TARGET, options={"gtol": 1e-12})
        fix = locate(PLANE, azimuth=measured, method="lenth-mle")
        np.testing.assert_allclose(fix.position, best.x, rtol=0, atol=0.5)  # it is flat
        assert negative(fix.position) <= best.fun + 1e-13

    @pytest.mark.parametrize("method", ["lenth-mle", "lenth-huber", "lenth-andrews"])
    @pytest.mark.parametrize("sigma", [0.0, 1e-7, 1e-4])
    def test_precise_azimuths_of_unknown_sigma(self, sigma, method):
        rng = np.random.default_rng(3)
        targets = TARGET + rng.uniform(-500, 500, (200, 2))
        d = targets[:, np.newaxis] - PLANE
        measured = np.arctan2(d[..., 0], d[..., 1])
        measured += sigma * rng.uniform(-1.7, 1.7, measured.shape)
        fixes = locate(PLANE, azimuth=measured, method=method)
        assert fixes.success.all()
        np.testing.assert_allclose(fixes.position, targets, rtol=0, atol=1e-6 + 1e5 * sigma)

    @pytest.mark.parametrize("method", ["lenth-mle", "lenth-huber", "lenth-andrews"])
    def test_they_are_for_azimuths_in_the_plane(self, method):
        with pytest.raises(ValueError, match="azimuths alone, in the plane"):
            locate(SQUARE, range=[1, 1, 1, 1], range_sigma=1.0, method=method)
        with pytest.raises(ValueError, match="azimuths alone, in the plane"):
            locate(TRIO, azimuth=[1, 1, 1], method=method)
        with pytest.raises(ValueError, match="the same azimuth_sigma"):
            locate(SQUARE, azimuth=[1, 1, 1, 1], azimuth_sigma=[1, 1, 1, 1.5], method=method)


@pytest.mark.skipif(not (DATA / "difar").is_dir(), reason="the recording is not there")
def test_a_boat_among_drifting_direction_finders():
    """Recorded bearings with biases of several degrees: most fixes are within 300 m."""
    _, places, azimuth, truth = difar()
    enough = np.sum(~np.isnan(azimuth), axis=-1) >= 3
    fixes = locate(
        places[enough],
        azimuth=azimuth[enough],
        azimuth_sigma=np.radians(8.0),
        redundancy=2,
        bias=Bias(),
    )
    error = np.linalg.norm(fixes.position - truth[enough], axis=-1)
    assert fixes.success.mean() > 0.9
    assert np.nanmedian(error) < 300


@pytest.mark.skipif(not (DATA / "difar").is_dir(), reason="the recording is not there")
@pytest.mark.parametrize("stated", [2.0, 4.5])
def test_sonobuoys_with_biases_that_nobody_stated(stated):
    """The white noise is 4 to 5 degrees; today's 95 % ellipses held 18 and 39 %."""
    _, places, azimuth, truth = difar()
    fixes = locate(places, azimuth=azimuth, azimuth_sigma=np.radians(stated))
    found = fixes.success
    inside = in_region(fixes.position - truth, fixes.covariance)[found]
    assert 0.88 < np.mean(inside) < 0.98
    assert np.all(fixes.bias.azimuth_sigma > np.radians(8))


class TestArguments:
    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({}, "nothing was measured"),
            ({"azimuth": [1, 2, 3]}, r"azimuth has shape \(3,\); for 4 stations"),
            ({"range": [1, 2, 3, 0], "range_sigma": 1}, r"range\[3\] is 0.0; .* positive"),
            ({"range": [1, INF, 3, 4], "range_sigma": 1}, r"range\[1\] is inf"),
            ({"azimuth": [1, INF, 3, 4]}, r"azimuth\[1\] is inf"),
            ({"elevation": [0, 0, 0, 0]}, "three coordinates"),
            ({"range": [1, 2, 3, 4], "range_sigma": -1}, "range_sigma is -1.0"),
            ({"range": [1, 2, 3, 4], "range_sigma": [1, 2]}, r"range_sigma has shape \(2,\)"),
            (
                {"range": [1, 2, 3, 4], "azimuth": [1, 2, 3, 4], "range_sigma": 1},
                "azimuth_sigma of station 0 is missing",
            ),
            ({"azimuth": [1, 2, 3, 4], "method": "best"}, "method is 'best'"),
            ({"azimuth": [1, 2, 3, 4], "redundancy": 0}, "redundancy is 0"),
            ({"azimuth": [1, 2, 3, 4], "initial": [1, 2, 3]}, "initial has shape"),
            ({"azimuth": [1, 2, 3, 4], "initial": [1, NAN]}, r"initial\[1\] is nan"),
            ({"azimuth": np.ones((3, 4)), "initial": np.ones((2, 2))}, "do not fit together"),
        ],
    )
    def test_errors(self, options, message):
        with pytest.raises(ValueError, match=message):
            locate(SQUARE, **options)

    def test_degrees_are_told(self):
        """Where there is no position; azimuths beyond a turn may be unwrapped."""
        with pytest.raises(ValueError, match=r"azimuth\[0\] is 45.*degrees\?"):
            locate(SQUARE, azimuth=[45.0, 315.0, 225.0, 135.0], azimuth_sigma=0.01)
        with pytest.raises(ValueError, match=r"azimuth_sigma is 4.*degrees\?"):
            locate(SQUARE, azimuth=[0.1, 0.2, 0.3, 0.4], azimuth_sigma=4.0)
        with pytest.raises(ValueError, match=r"azimuth_sigma is 4.*degrees\?"):
            Station([0, 0], azimuth_sigma=4.0)
        with pytest.raises(ValueError, match=r"do not meet[^;]*short or too long$"):
            locate([[0, 0], [1000, 0]], azimuth=[-0.3, 0.3], azimuth_sigma=0.1)
        with pytest.raises(ValueError, match=r"elevation\[1\] is 45.0.*degrees\?"):
            locate(TRIO, elevation=[0.1, 45.0, 0.2], elevation_sigma=0.1)

    def test_stations(self):
        with pytest.raises(TypeError, match="one Station"):
            locate(Station([0, 0]), azimuth=[1.0])
        with pytest.raises(TypeError, match=r"stations\[1\]"):
            locate([Station([0, 0]), 3], azimuth=[1.0, 2.0])
        with pytest.raises(ValueError, match="shape"):
            Station([0.0])
        with pytest.raises(ValueError, match="range_sigma"):
            Station([0, 0], range_sigma=0.0)
        with pytest.raises(ValueError, match="shapes"):
            locate([Station([0, 0]), Station([0, 0, 0])], azimuth=[1.0, 2.0])
        with pytest.raises(ValueError, match="azimuth_sigma of station 1"):
            locate([Station([0, 0], azimuth_sigma=1.0), Station([1, 0])], azimuth=[1.0, 2.0])

    def test_accuracy_map(self):
        with pytest.raises(ValueError, match="no standard deviation"):
            accuracy_map(SQUARE, [[1, 2]])
        with pytest.raises(ValueError, match="range_sigma is missing"):
            accuracy_map(SQUARE, [[1, 2]], kinds=["range"], azimuth_sigma=1.0)
        with pytest.raises(ValueError, match="kinds has 'speed'"):
            accuracy_map(SQUARE, [[1, 2]], kinds=["speed"])
        with pytest.raises(ValueError, match="grid has shape"):
            accuracy_map(SQUARE, [[1, 2, 3]], range_sigma=1.0)

    def test_told(self):
        fix = solve("radars", draw("radars", 3))
        assert repr(fix) == "Location(batch (3,), 3 of 3 located)"
        assert "faulty" in repr(solve("radars", one(draw("radars", 3))))
        assert repr(accuracy_map(SQUARE, np.ones((4, 5, 2)), range_sigma=1.0)).endswith("(4, 5))")


class TestSimulated:
    STATIONS = tuple(Station(p, range_sigma=10.0, azimuth_sigma=0.005) for p in PLANE)

    def test_noise_and_faults(self):
        record = simulate.stations(
            self.STATIONS,
            TARGET,
            outlier_probability=0.2,
            missing_probability=0.1,
            batch=20_000,
            rng=22,
        )
        truth = reference.predict(TARGET, PLANE)
        for kind, s in (("range", 10.0), ("azimuth", 0.005)):
            u = (record.measurements[kind] - truth[kind]) / s
            fault = record.outlier[kind]
            clean = u[~fault & ~np.isnan(u)]
            assert abs(clean.std() - 1) < 0.01
            assert abs(np.abs(u[fault]).mean() - 20) < 0.05
            assert abs(np.isnan(u).mean() - 0.1) < 0.005
            assert abs(fault.mean() - 0.18) < 0.005

    def test_errors(self):
        with pytest.raises(ValueError, match="outlier_probability"):
            simulate.stations(self.STATIONS, TARGET, outlier_probability=2.0)
        with pytest.raises(ValueError, match="position"):
            simulate.stations(self.STATIONS, [1.0, 2.0, 3.0])
        with pytest.raises(ValueError, match="kinds"):
            simulate.stations(self.STATIONS, TARGET, kinds=["elevation"])


class TestPictures:
    STATIONS = tuple(Station(p, range_sigma=10.0, azimuth_sigma=0.005, name="s") for p in PLANE)

    def test_what_is_drawn_is_what_was_measured(self):
        record = simulate.stations(self.STATIONS, TARGET, rng=23)
        azimuth, ranges = record.measurements["azimuth"], record.measurements["range"]
        azimuth[2] += 1.0
        azimuth[4] = NAN
        fix = locate(self.STATIONS, azimuth=azimuth, range=ranges)
        ax = plot.location(
            self.STATIONS, fix, azimuth=azimuth, range=ranges, ax=Figure().subplots()
        )
        lines = ax.get_lines()
        rays = [line.get_xydata() for line in lines if len(line.get_xydata()) == 2]
        assert len(rays) == 7
        for ray, k in zip(rays, [0, 1, 2, 3, 5, 6, 7], strict=True):
            np.testing.assert_array_equal(ray[0], PLANE[k])
            way = ray[1] - ray[0]
            assert np.arctan2(*way) == pytest.approx(np.angle(np.exp(1j * azimuth[k])))
        faulty = [line for line in lines if line.get_linestyle() == "--"]
        np.testing.assert_array_equal(faulty[0].get_xydata()[0], PLANE[2])
        assert len(faulty) == 1
        (east, north), sigma = fix.position, fix.sigma
        title = f"east {east:.1f} ± {sigma[0]:.1f} m, north {north:.1f} ± {sigma[1]:.1f} m"
        assert ax.get_title() == title
        [ellipse] = [line for line in lines if str(line.get_label()).startswith("position")]
        np.testing.assert_array_equal(ellipse.get_xydata()[0], fix.position)
        points = ellipse.get_xydata()[2:] - fix.position
        np.testing.assert_allclose(
            metrics.nees(points, fix.covariance), stats.chi2.ppf(0.95, 2), rtol=1e-9
        )
        with pytest.raises(ValueError, match="have a batch"):
            plot.location(self.STATIONS, locate(self.STATIONS, azimuth=[azimuth] * 2))

    def test_a_map(self):
        axis = np.linspace(100.0, 1900.0, 9)
        grid = np.stack(np.meshgrid(axis, axis), axis=-1)
        accuracy = accuracy_map(self.STATIONS, grid)
        ax = plot.accuracy_map(self.STATIONS, grid, accuracy, ax=Figure().subplots())
        np.testing.assert_array_equal(ax.get_lines()[0].get_xydata(), PLANE)
        with pytest.raises(ValueError, match="grid has shape"):
            plot.accuracy_map(self.STATIONS, grid[:3], accuracy)


@pytest.mark.parametrize(
    "kind",
    [
        {"range": 40.0},
        {"azimuth": 0.05},
        {"arrival_time": 0.01},
        {"arrival_time": 0.01, "propagation_speed_sigma": 5.0},
        {"arrival_time": 0.01, "wind_sigma": 5.0},
    ],
    ids=" ".join,
)
def test_covariances_are_symmetric_to_the_last_bit(kind):
    """With large errors and outliers, which add terms to the covariance."""
    rng = np.random.default_rng(7)
    places, targets = (rng.normal(size=(n, 2)) * 1e3 for n in (6, 200))
    east, north = np.moveaxis(targets[:, np.newaxis] - places, -1, 0)
    distance = np.hypot(east, north)
    true = {"range": distance, "azimuth": np.arctan2(east, north), "arrival_time": distance / 340}
    (name, sigma), *others = kind.items()
    noise = rng.normal(size=distance.shape) * sigma
    noise[::5, 0] += 5 * sigma
    speed = {"propagation_speed": 340.0} if name == "arrival_time" else {}
    measured = {name: true[name] + noise, f"{name}_sigma": sigma, **speed, **dict(others)}
    assert_covariance(locate(places, **measured, bias=Bias()).covariance, 1e-9)


def test_the_sigma_of_a_missing_measurement_may_be_missing():
    """As in the columns of a data frame."""
    places, target = np.array([[0, 0], [900, 0], [0, 800], [700, 900]]), np.array([300.0, 400.0])
    ranges = np.linalg.norm(places - target, axis=-1) + np.zeros((5, 1))
    ranges[1, 2] = NAN
    sigma = np.where(np.isnan(ranges), NAN, 5.0)
    as_given = locate(places, range=ranges, range_sigma=sigma)
    np.testing.assert_array_equal(
        as_given.covariance, locate(places, range=ranges, range_sigma=5.0).covariance
    )
    times = ranges / 299_792_458.0
    heard = locate(places, arrival_time=times, arrival_time_sigma=sigma / 3e8)
    assert heard.success.all()
    sigma[3, 0] = NAN
    with pytest.raises(ValueError, match=r"range_sigma\[3, 0\] is nan"):
        locate(places, range=ranges, range_sigma=sigma)


def test_sigmas_of_an_instant_without_measurements_may_be_nan():
    places, none = [[0.0, 0.0], [1e3, 0.0], [0.0, 1e3]], [np.nan] * 3
    empty = locate(places, range=[none] * 2, range_sigma=[none] * 2)
    assert np.all(np.equal(empty.status, LocationStatus.TOO_FEW))
    with pytest.raises(ValueError, match="fewer measurements than coordinates"):
        locate(places, range=none, range_sigma=none)
    with pytest.raises(ValueError, match=r"range_sigma\[0\] is nan"):
        locate(places, range=[500.0, np.nan, np.nan], range_sigma=none)
