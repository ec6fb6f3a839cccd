"""Association: against SciPy, plain NumPy, the vectors of the paper, and by Monte Carlo."""

import time

import numpy as np
import pytest
from checks import INF, NAN, rng
from hypothesis import given
from hypothesis import strategies as st
from reference import association as reference
from scipy import optimize, stats
from scipy.spatial import cKDTree
from tolerances import CHANCE

from tertia import _core
from tertia.association import (
    GUARD,
    INNER,
    OUTER,
    GateSector,
    associate,
    gate,
    gate_sectors,
    gate_threshold,
    likelihood_score,
    paper_score,
)

VECTORS = {
    1: (0.873457142989, 3.841458820694, 9.549535706083),
    2: (2.099644248997, 5.991464547108, 12.429216196844),
    3: (3.283112463526, 7.814727903251, 14.795517054552),
}
NAMES = ("inner", "outer", "guard")
CLUTTER = {"clutter_density": 1e-9}


def covariances(generator, *shape, m=2, size=100.0):
    root = generator.normal(size=(*shape, m, m + 2)) * size
    return root @ np.swapaxes(root, -1, -2) / m


class TestThresholds:
    @pytest.mark.parametrize("m", VECTORS)
    def test_vectors_of_the_paper(self, m):
        for name, expected in zip(NAMES, VECTORS[m], strict=True):
            assert gate_threshold(name, m) == pytest.approx(expected, rel=1e-10)
        numbers = [gate_threshold(p, m) for p in (INNER, OUTER, GUARD)]
        assert numbers == [gate_threshold(name, m) for name in NAMES]

    @pytest.mark.parametrize("m", [1, 2, 3, 4, 9, 40])
    @pytest.mark.parametrize("probability", [1e-3, 0.1, 0.5, 0.9, 0.999, 1 - 1e-12])
    def test_against_scipy(self, m, probability):
        found = gate_threshold(probability, m)
        expected = stats.chi2.isf(1 - probability, m)
        assert found == pytest.approx(expected, rel=1e-11)

    def test_of_three_scans(self):
        """The sum of three d² in the plane, as the paper uses it."""
        assert gate_threshold("guard", 6) == pytest.approx(20.79, abs=0.005)

    def test_default(self):
        assert gate_threshold() == gate_threshold(0.998, 2)

    @pytest.mark.parametrize(
        ("arguments", "kind", "message"),
        [
            ((0.0,), ValueError, "gate_probability is 0"),
            ((1.0,), ValueError, "gate_probability is 1"),
            ((NAN,), ValueError, "gate_probability is nan"),
            (("middle",), ValueError, "gate_probability is 'middle'"),
            ((None,), TypeError, "gate_probability is None"),
            ((0.5, 0), ValueError, "dimension is 0"),
            ((0.5, 1001), ValueError, "dimension is 1001"),
            ((0.5, 2.0), TypeError, "dimension is 2.0"),
        ],
    )
    def test_errors(self, arguments, kind, message):
        with pytest.raises(kind, match=message):
            gate_threshold(*arguments)

    @pytest.mark.parametrize("m", [2, 3])
    def test_gates_hold_as_many_true_plots_as_they_say(self, m):
        count = 20_000
        generator = rng(1, m)
        predicted = generator.uniform(-1e7, 1e7, (count, m))
        sigmas = covariances(generator, count, m=m)
        noise = np.linalg.cholesky(sigmas) @ generator.normal(size=(count, m, 1))
        plots = predicted + noise[..., 0]
        for name, probability in zip(NAMES, (INNER, OUTER, GUARD), strict=True):
            pairs = gate(predicted, sigmas, plots, gate_probability=name)
            own = np.count_nonzero(pairs.track == pairs.plot)
            low, high = stats.binom.interval(1 - CHANCE, count, probability)
            assert low <= own <= high


class TestRegions:
    def test_of_a_flight_to_the_north(self):
        where = {
            (0, 1.4): GateSector.INNER,
            (1, 1.8): GateSector.AHEAD,
            (-1, -1.8): GateSector.BEHIND,
            (-1.8, 1): GateSector.LEFT,
            (1.8, -1): GateSector.RIGHT,
            (0, 3): GateSector.GUARD_AHEAD,
            (0, -3): GateSector.GUARD_BEHIND,
            (-3, 0.1): GateSector.GUARD_LEFT,
            (3, -0.1): GateSector.GUARD_RIGHT,
            (0, 3.6): GateSector.OUTSIDE,
        }
        found = gate_sectors(list(where), np.eye(2), [0, 200])
        np.testing.assert_array_equal(found, list(where.values()))
        one = gate_sectors([0, 3], np.eye(2), [0, 200])
        assert isinstance(one, GateSector)
        assert one is GateSector.GUARD_AHEAD

    def test_against_angles(self):
        generator = rng(2)
        sigmas = covariances(generator, 2000)
        root = np.linalg.cholesky(sigmas)
        innovation = 2.2 * (root @ generator.normal(size=(2000, 2, 1)))[..., 0]
        velocity = generator.normal(size=(2000, 2)) * 200
        found = gate_sectors(innovation, sigmas, velocity)
        gates = VECTORS[2]
        expected = [
            reference.region(*row, gates) for row in zip(innovation, sigmas, velocity, strict=True)
        ]
        assert [GateSector(number).name for number in found] == expected
        assert len(set(expected)) == len(GateSector)

    def test_each_wedge_holds_a_quarter(self):
        generator = rng(3)
        count = 40_000
        sigma = covariances(generator)
        innovation = generator.multivariate_normal([0, 0], sigma, count)
        found = gate_sectors(innovation, sigma, [180.0, -60.0])
        for first, probability in ((GateSector.AHEAD, OUTER - INNER), (5, GUARD - OUTER)):
            for region in range(first, first + 4):
                low, high = stats.binom.interval(1 - CHANCE / 8, count, probability / 4)
                assert low <= np.count_nonzero(found == region) <= high

    @pytest.mark.parametrize(
        ("arguments", "kind", "message"),
        [
            (([1, 2, 3], np.eye(2), [1, 0]), ValueError, r"innovation has shape \(3,\)"),
            (([1, 2], np.eye(3), [1, 0]), ValueError, r"covariance has shape \(3, 3\)"),
            (([1, 2], np.eye(2), [1]), ValueError, r"velocity has shape \(1,\)"),
            (([1, 2], np.eye(2), [0, 0]), ValueError, "velocity is zero"),
            (([1, 2], np.eye(2), [[1, 0], [0, 0]]), ValueError, r"velocity\[1\] is zero"),
            (([1, NAN], np.eye(2), [1, 0]), ValueError, r"innovation\[1\] is nan"),
            ((np.ones((3, 2)), np.eye(2), np.ones((2, 2))), ValueError, "batches do not fit"),
            (([1, 2], np.ones((2, 2)), [1, 0]), np.linalg.LinAlgError, "covariance is singular"),
            (
                (np.ones((2, 2)), [np.eye(2), -np.eye(2)], [1, 0]),
                np.linalg.LinAlgError,
                "singular",
            ),
            (("x", np.eye(2), [1, 0]), TypeError, "innovation has dtype"),
        ],
    )
    def test_errors(self, arguments, kind, message):
        with pytest.raises(kind, match=message):
            gate_sectors(*arguments)


class TestScores:
    @pytest.mark.parametrize(
        ("q", "score", "zero"),
        [
            (4, 0.218437218263, 3.696784962986),
            (10, 0.901156521565, 5.116855762209),
            (100, 3.063598757417, 9.303374113107),
        ],
    )
    def test_vectors_of_the_paper(self, q, score, zero):
        d2 = 3.114285714286
        assert paper_score(d2, q) == pytest.approx(score, rel=1e-11)
        assert paper_score(d2, q) == pytest.approx(reference.paper_score(d2, q, 2), rel=1e-13)
        assert paper_score(zero, q) == pytest.approx(0, abs=1e-12)

    def test_in_space_and_in_batches(self):
        assert paper_score(5, 10, dimension=3) == pytest.approx(1.203877639491, rel=1e-11)
        d2 = rng(5).uniform(0, 20, (3, 4))
        found = paper_score(d2)
        np.testing.assert_allclose(found, reference.paper_score(d2, 100, 2), rtol=1e-12)
        assert isinstance(paper_score(1.0), float)
        assert paper_score(np.empty(0)).shape == (0,)

    @pytest.mark.parametrize("m", [1, 2, 3, 5])
    def test_likelihood_against_scipy(self, m):
        generator = rng(6, m)
        sigma = covariances(generator, m=m)
        e = generator.multivariate_normal(np.zeros(m), sigma)
        d2 = e @ np.linalg.solve(sigma, e)
        found = likelihood_score(d2, sigma, clutter_density=1e-8, detection_probability=0.8)
        log_density = stats.multivariate_normal(np.zeros(m), sigma).logpdf(e)
        assert found == pytest.approx(np.log(0.8 / 1e-8) + log_density, rel=1e-12)

    def test_likelihood_in_batches(self):
        generator = rng(7)
        sigmas, d2 = covariances(generator, 4, 1), generator.uniform(0, 9, 3)
        found = likelihood_score(d2, sigmas, **CLUTTER)
        assert found.shape == (4, 3)
        assert found[2, 1] == likelihood_score(d2[1], sigmas[2, 0], **CLUTTER)

    @pytest.mark.parametrize(
        ("call", "kind", "message"),
        [
            (lambda: paper_score(-1.0), ValueError, "nis is -1.0; it must be zero or positive"),
            (lambda: paper_score(NAN), ValueError, "nis is nan"),
            (lambda: paper_score(1.0, 1.0), ValueError, "q is 1"),
            (lambda: paper_score([], 0.5), ValueError, "q is 0.5"),
            (lambda: paper_score(1.0, NAN), ValueError, "q is nan"),
            (lambda: paper_score(1.0, dimension=0), ValueError, "dimension is 0"),
            (lambda: likelihood_score(1, np.eye(2), clutter_density=0), ValueError, "clutter"),
            (
                lambda: likelihood_score(1, np.eye(2), detection_probability=1, **CLUTTER),
                ValueError,
                "detection_probability is 1",
            ),
            (
                lambda: likelihood_score(1, -np.eye(2), **CLUTTER),
                np.linalg.LinAlgError,
                "positive definite",
            ),
            (lambda: likelihood_score(1, [1.0], **CLUTTER), ValueError, "covariance has shape"),
            (
                lambda: likelihood_score([1, 2], np.ones((3, 1, 1)), **CLUTTER),
                ValueError,
                "batches do not fit",
            ),
        ],
    )
    def test_errors(self, call, kind, message):
        with pytest.raises(kind, match=message):
            call()


def scene(seed, tracks, plots, m=2, extent=1000.0, size=100.0):
    generator = rng(8, seed)
    return (
        generator.uniform(-extent, extent, (tracks, m)),
        covariances(generator, tracks, m=m, size=size),
        generator.uniform(-extent, extent, (plots, m)),
        covariances(generator, plots, m=m, size=size / 2),
    )


class TestGate:
    @pytest.mark.parametrize("m", [2, 3])
    @pytest.mark.parametrize("noise", [False, True])
    @pytest.mark.parametrize(("tracks", "plots"), [(1, 1), (40, 60), (60, 0), (0, 60), (300, 200)])
    def test_against_all_pairs(self, tracks, plots, noise, m):
        predicted, sigmas, scan, noises = scene(1, tracks, plots, m)
        noises = noises if noise else None
        pairs = gate(predicted, sigmas, scan, noises, gate_probability="outer")
        d2, volume = reference.distances(predicted, sigmas, scan, noises)
        track, plot = np.nonzero(d2 <= VECTORS[m][1])
        np.testing.assert_array_equal(pairs.track, track)
        np.testing.assert_array_equal(pairs.plot, plot)
        np.testing.assert_allclose(pairs.nis, d2[track, plot], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(pairs.log_determinant, volume[track, plot], rtol=1e-12)
        assert len(pairs) == len(track)

    def test_circles_against_a_tree(self):
        generator = rng(9)
        predicted, plots = generator.uniform(0, 3e5, (2, 3000, 2))
        radius = 2000.0
        sigma = radius**2 / gate_threshold("guard") * np.eye(2)
        pairs = gate(predicted, sigma, plots)
        found = cKDTree(predicted).query_ball_tree(cKDTree(plots), radius)
        expected = [(i, k) for i, row in enumerate(found) for k in sorted(row)]
        assert list(zip(pairs.track, pairs.plot, strict=True)) == expected

    @pytest.mark.parametrize("far", [1e9, 1e15, 1e150, -1e300])
    def test_a_plot_far_away_changes_nothing(self, far):
        predicted, sigmas, scan, _ = scene(2, 200, 300)
        pairs = gate(predicted, sigmas, scan)
        more = gate(predicted, sigmas, np.vstack([scan, [far, far]]))
        np.testing.assert_array_equal(pairs.track, more.track)
        np.testing.assert_array_equal(pairs.plot, more.plot)

    def test_one_wide_gate_sees_everything(self):
        predicted, sigmas, scan, _ = scene(3, 50, 500)
        sigmas[7] = 1e30 * np.eye(2)
        pairs = gate(predicted, sigmas, scan)
        np.testing.assert_array_equal(pairs.plot[pairs.track == 7], np.arange(500))

    def test_one_covariance_for_all(self):
        predicted, _, scan, _ = scene(4, 20, 30)
        sigma, noise = 1e4 * np.eye(2), 2e3 * np.eye(2)
        one = gate(predicted, sigma, scan, noise)
        many = gate(predicted, np.tile(sigma, (20, 1, 1)), scan, np.tile(noise, (30, 1, 1)))
        np.testing.assert_array_equal(one.track, many.track)
        np.testing.assert_array_equal(one.nis, many.nis)
        assert repr(one) == f"Pairs({len(one)})"

    def test_the_edge_belongs_to_it(self):
        threshold = gate_threshold("guard")
        plots = [[np.sqrt(threshold), 0], [np.sqrt(threshold) * (1 + 1e-9), 0]]
        np.testing.assert_array_equal(gate([[0, 0]], np.eye(2), plots).plot, [0])

    @pytest.mark.parametrize(
        ("change", "kind", "message"),
        [
            ({"predicted": [0, 0]}, ValueError, r"predicted has shape \(2,\)"),
            ({"predicted": np.zeros((1, 4))}, ValueError, r"predicted has shape \(1, 4\)"),
            ({"predicted": [[0, NAN]]}, ValueError, r"predicted\[0, 1\] is nan"),
            ({"plots": np.zeros((1, 3))}, ValueError, r"plots has shape \(1, 3\)"),
            ({"plots": [[INF, 0]]}, ValueError, r"plots\[0, 0\] is inf"),
            ({"covariance": np.eye(3)}, ValueError, r"covariance has shape \(3, 3\)"),
            ({"covariance": [[1, 2], [2, 1]]}, np.linalg.LinAlgError, r"covariance\[0\]"),
            ({"covariance": [[1, 1], [1, 1]]}, np.linalg.LinAlgError, r"covariance\[0\] is sing"),
            ({"covariance": [[1, 0], [1, 1]]}, ValueError, "must be symmetric"),
            ({"plot_covariance": np.eye(3)}, ValueError, "plot_covariance has shape"),
            ({"plot_covariance": -np.eye(2)}, ValueError, r"plot_covariance\[0, 0, 0\] is -1"),
            ({"gate_probability": 1.0}, ValueError, "gate_probability is 1"),
            ({"plots": "x"}, TypeError, "plots has dtype"),
        ],
    )
    def test_errors(self, change, kind, message):
        right = {"predicted": [[0, 0]], "covariance": np.eye(2), "plots": [[0, 0]]}
        with pytest.raises(kind, match=message):
            gate(**{**right, **change})


def pairs_of(gain):
    row, column = np.nonzero(~np.isnan(gain))
    return row.astype(np.int64), column.astype(np.int64), gain[row, column]


def chosen(gain, method="gnn"):
    return _core.assign_pairs(*pairs_of(gain), *gain.shape, method)


def total(gain, columns):
    rows = np.flatnonzero(columns >= 0)
    taken = columns[rows]
    assert len(set(taken)) == len(taken)
    assert not np.isnan(gain[rows, taken]).any()
    return gain[rows, taken].sum()


class TestAssignment:
    @pytest.mark.parametrize("share", [0.02, 0.1, 0.5, 1.0])
    @pytest.mark.parametrize(
        ("rows", "columns"), [(1, 1), (1, 9), (9, 1), (30, 30), (50, 20), (20, 50), (150, 150)]
    )
    def test_against_scipy(self, rows, columns, share):
        generator = rng(10, rows, columns, int(100 * share))
        gain = generator.normal(1.0, 2.0, (rows, columns))
        gain[generator.uniform(size=gain.shape) > share] = NAN
        found = chosen(gain)
        # what is not worth anything is as good as left alone
        padded = np.nan_to_num(np.maximum(gain, 0.0))
        best = padded[optimize.linear_sum_assignment(padded, maximize=True)].sum()
        assert total(gain, found) == pytest.approx(best, rel=1e-12)
        assert total(gain, chosen(gain, "nearest")) <= best * (1 + 1e-12)

    @pytest.mark.parametrize("scale", [1e-200, 1.0, 1e200])
    def test_of_any_size(self, scale):
        gain = scale * rng(11).uniform(size=(12, 12))
        best = gain[optimize.linear_sum_assignment(gain, maximize=True)].sum()
        assert total(gain, chosen(gain)) == pytest.approx(best, rel=1e-12)

    def test_nearly_equal_gains(self):
        """Gains of hundreds that differ in the last digits."""
        gain = 700 + 1e-9 * rng(12).uniform(size=(40, 40))
        best = gain[optimize.linear_sum_assignment(gain, maximize=True)].sum()
        assert total(gain, chosen(gain)) == pytest.approx(best, rel=1e-13)

    @pytest.mark.parametrize("differs", ["neither", "row", "column"])
    @pytest.mark.parametrize(("rows", "columns"), [(2000, 2000), (2000, 1100), (1100, 2000)])
    def test_coincident_plots_and_tracks_cost_little(self, differs, rows, columns):
        """Gains that are equal, or depend on the row or the column alone; that took seconds."""
        gain = np.ones((rows, columns))
        if differs == "row":
            gain += rng(14).uniform(size=(rows, 1))
        elif differs == "column":
            gain += rng(14).uniform(size=columns)
        pairs = pairs_of(gain)
        begin = time.process_time()
        found = _core.assign_pairs(*pairs, rows, columns, "gnn")
        assert time.process_time() - begin < 1.5
        count = min(rows, columns)
        each = gain[:, 0] if differs == "row" else gain[0]
        best = np.sort(each)[-count:].sum()
        assert total(gain, found) == pytest.approx(best, rel=1e-12)

    @given(
        st.lists(
            st.tuples(st.integers(0, 4), st.integers(0, 4), st.sampled_from([-1.0, 1, 2, 3, 4.5])),
            max_size=14,
        )
    )
    def test_ties_are_broken_by_indices_alone(self, triples):
        arrays = [np.array(column) for column in zip(*triples, strict=True)] or [np.empty(0)] * 3
        row, column, gain = (a.astype(t) for a, t in zip(arrays, (int, int, float), strict=True))
        for method in ("gnn", "nearest"):
            found = _core.assign_pairs(row, column, gain, 5, 5, method)
            again = _core.assign_pairs(row[::-1], column[::-1], gain[::-1], 5, 5, method)
            np.testing.assert_array_equal(found, again)

    def test_greedy_takes_the_best_that_is_left(self):
        gain = rng(13).uniform(size=(20, 15))
        found = np.full(20, -1)
        left = gain.copy()
        while np.any(left > 0):
            row, column = np.unravel_index(np.argmax(left), left.shape)
            found[row] = column
            left[row], left[:, column] = 0, 0
        np.testing.assert_array_equal(chosen(gain, "nearest"), found)

    def test_errors(self):
        row, gain = np.array([0, 1]), np.array([1.0, 2.0])
        with pytest.raises(ValueError, match="row has 1"):
            _core.assign_pairs(row, row, gain, 1, 2, "gnn")
        with pytest.raises(ValueError, match="column has -1"):
            _core.assign_pairs(row, -row, gain, 2, 2, "gnn")
        with pytest.raises(ValueError, match="the same length"):
            _core.assign_pairs(row, row, gain[:1], 2, 2, "gnn")
        with pytest.raises(ValueError, match="method is 'other'"):
            _core.assign_pairs(row, row, gain, 2, 2, "other")


class TestAssociate:
    @pytest.mark.parametrize("score", ["likelihood", "paper"])
    @pytest.mark.parametrize("m", [2, 3])
    def test_is_the_best_of_all(self, m, score):
        predicted, sigmas, plots, noises = scene(5, 80, 70, m, extent=600.0)
        clutter = {2: 1e-7, 3: 1e-10}[m]
        options = {"clutter_density": clutter, "detection_probability": 0.7}
        result = associate(predicted, sigmas, plots, noises, score=score, **options)
        d2, volume = reference.distances(predicted, sigmas, plots, noises)
        gate_ = VECTORS[m][2]
        if score == "paper":
            worth = reference.paper_score(d2, 100.0, m)
            gain = worth - reference.paper_score(gate_, 100.0, m)
        else:
            density = np.exp(-d2 / 2 - volume / 2) / (2 * np.pi) ** (m / 2)
            worth = np.log(0.7 * density / clutter)
            gain = worth - np.log(0.3)
        gain = np.where(d2 <= gate_, np.maximum(gain, 0.0), 0.0)
        rows, columns = optimize.linear_sum_assignment(gain, maximize=True)
        kept = gain[rows, columns] > 0
        expected = np.full(80, -1)
        expected[rows[kept]] = columns[kept]
        np.testing.assert_array_equal(result.plot_of_track, expected)
        assert kept.sum() > 20
        has = expected >= 0
        of_pair = (np.flatnonzero(has), expected[has])
        np.testing.assert_array_equal(result.track_of_plot[expected[has]], of_pair[0])
        assert np.count_nonzero(result.track_of_plot >= 0) == has.sum()
        np.testing.assert_allclose(result.score[has], worth[of_pair], rtol=1e-10)
        np.testing.assert_allclose(result.nis[has], d2[of_pair], rtol=1e-9)
        assert np.isnan(result.score[~has]).all()
        assert np.isnan(result.nis[~has]).all()

    def test_the_gate_accepts_by_the_papers_score_and_the_likelihood_by_clutter(self):
        """d² = 11 is in the guard gate, where the paper's score is negative."""
        case = ([[0, 0]], np.eye(2), [[np.sqrt(11), 0]])
        paper = associate(*case, score="paper")
        np.testing.assert_array_equal(paper.plot_of_track, [0])
        assert paper.score[0] < 0
        for density, plot in ((1e-9, 0), (1.0, -1)):
            result = associate(*case, clutter_density=density)
            np.testing.assert_array_equal(result.plot_of_track, [plot])

    def test_a_target_that_is_always_seen_takes_what_there_is(self):
        case = ([[0, 0]], np.eye(2), [[2.5, 0]])
        rare = associate(*case, clutter_density=0.1, detection_probability=0.5)
        sure = associate(*case, clutter_density=0.1, detection_probability=0.999)
        assert rare.plot_of_track[0] == -1
        assert sure.plot_of_track[0] == 0

    def test_nearest_may_leave_a_track_alone(self):
        case = ([[0, 0], [3, 0]], np.eye(2), [[1.4, 0], [-3, 0]])
        case[2][0] = [1.2, 0]
        best = associate(*case, **CLUTTER)
        greedy = associate(*case, method="nearest", **CLUTTER)
        np.testing.assert_array_equal(best.plot_of_track, [1, 0])
        np.testing.assert_array_equal(greedy.plot_of_track, [0, -1])

    def test_a_wide_gate_does_not_win_by_its_size(self):
        """The paper's score gives the plot to the vague track, the likelihood to the sharp one."""
        sigmas = [np.eye(2), 400 * np.eye(2)]
        case = ([[0, 0], [10, 0]], sigmas, [[1.5, 0]])
        paper = associate(*case, score="paper")
        likely = associate(*case, **CLUTTER)
        np.testing.assert_array_equal(paper.plot_of_track, [-1, 0])
        np.testing.assert_array_equal(likely.plot_of_track, [0, -1])

    def test_nothing_to_do(self):
        empty = np.empty((0, 2))
        result = associate(empty, np.eye(2), [[0, 0]], **CLUTTER)
        np.testing.assert_array_equal(result.track_of_plot, [-1])
        assert repr(result) == "Association(0 of 0 tracks, 0 of 1 plots)"
        assert len(associate([[0, 0]], np.eye(2), empty, **CLUTTER).track_of_plot) == 0

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({}, "clutter_density is missing"),
            ({"score": "other"}, "score is 'other'"),
            ({"method": "other", **CLUTTER}, "method is 'other'"),
            ({"clutter_density": -1}, "clutter_density is -1"),
            ({"score": "paper", "q": 1}, "q is 1"),
            ({"detection_probability": 0, **CLUTTER}, "detection_probability is 0"),
        ],
    )
    def test_errors(self, options, message):
        with pytest.raises(ValueError, match=message):
            associate([[0, 0]], np.eye(2), [[0, 0]], **options)
