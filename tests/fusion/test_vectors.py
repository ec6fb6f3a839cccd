"""The rules of the source, against printed vectors."""

import numpy as np
import pytest
from checks import NAN, close
from fusion.scenes import MODEL
from reference import fusion as reference

from tertia.fusion import fuse, fuse_series
from tertia.kalman import SingerModel, filter_series

T4 = SingerModel(4.0, 0.05, np.sqrt(4e-6 / 0.36))
V2 = np.array([[NAN, 10.41, 10.77, 11.25, 11.60, 12.05], [NAN, 10.30, 10.95, 11.10, NAN, 12.30]])
V2_NOISE = np.array([[0.01], [0.04]])
V2_INITIAL = (
    np.array([[10.0, 0, 0], [10.1, 0, 0]]),
    np.array([np.diag([0.01, 0.04, 1e-4]), np.diag([0.04, 0.04, 1e-4])]),
)
V2_MEANS = {
    "paper": [12.0451982656175, 0.105734160326341, 0.000230796779820971],
    "adaptive": [12.082737580949, 0.113898181340249, 0.000858511197732528],
    "adaptive-matrix": [12.0815717165248, 0.11186695113395, 0.000561812820999961],
    "central": [12.0848675793787, 0.11301839263859, 0.000656027754028872],
}
V2_WEIGHTS = {
    "paper": [0.997342635060639, 0.995140377416702, 0.990079968791573],
    "adaptive": [0.822415067987045, 0.733135026804825, 0.56301085677157],
}
V2_VARIANCES = [0.00656820249793116, 0.000360945996842242, 8.4685823979125e-06]
V2_THIRD = [12.0286377301038, 0.112316122022975, 0.000736387137964763]
# the printed states have 15 digits, but the accelerations of the vectors fewer significant ones
V2_DIGITS = 2e-12


def fused_v2(method):
    return fuse_series(V2, V2_NOISE, T4, method=method, initial=V2_INITIAL)


def referred_v2(method):
    f, q = reference.printed(4.0, 0.05, 4e-6 / 0.36)
    noise = np.broadcast_to(V2_NOISE, V2.shape)
    between = [4.0] * 5, [f] * 5, [q] * 5
    return reference.fuse(V2, noise, *between, method=method, initial=V2_INITIAL)


class TestVectors:
    @pytest.mark.parametrize("method", V2_MEANS)
    def test_mean(self, method):
        assert fused_v2(method).mean[-1] == close(V2_MEANS[method], V2_DIGITS)
        assert referred_v2(method)["mean"][-1] == close(V2_MEANS[method], V2_DIGITS)

    @pytest.mark.parametrize("method", V2_WEIGHTS)
    def test_weights(self, method):
        for weights in (fused_v2(method).weights, referred_v2(method)["weights"]):
            assert weights[0, -1] == close(V2_WEIGHTS[method])
            np.testing.assert_allclose(weights.sum(axis=0), 1, rtol=1e-15)

    def test_variances(self):
        assert np.diag(fused_v2("adaptive").covariance[-1]) == close(V2_VARIANCES)
        assert fused_v2("central").covariance[-1, 0, 0] == close(0.00644947056534109)

    def test_own_filters(self):
        """X1 and X2 of the vectors, from the paper's weights of one radar alone."""
        expected = [
            [12.0446279972368, 0.105582735705442, 0.000216216126618942],
            [12.2592271936905, 0.13674248490462, 0.00168603541404649],
        ]
        for i in range(2):
            initial = tuple(part[i : i + 1] for part in V2_INITIAL)
            result = fuse_series(V2[i : i + 1], V2_NOISE[i], T4, method="paper", initial=initial)
            assert result.mean[-1] == close(expected[i], V2_DIGITS)

    def test_third_filter(self):
        """As printed: a radar without a plot has a residual of zero, and the weight 1."""
        f, q = reference.printed(4.0, 0.05, 4e-6 / 0.36)
        tracks = [reference.Track(state, 0, None) for state in zip(*V2_INITIAL, strict=True)]
        # 0/0 at the first step
        angles = [10.05]
        for k in range(1, 6):
            corrections = np.zeros((2, 3))
            for i, track in enumerate(tracks):
                track.predict(4.0, f, q)
                if not np.isnan(V2[i, k]):
                    (gain, innovation, _), _ = track.update(V2[i, k], V2_NOISE[i, 0])
                    corrections[i] = gain * innovation
            weights = reference.paper_weights(corrections)[:, 0]
            angles.append(weights @ [track.x[0] for track in tracks])
        start = np.array([angles[0], 0, 0]), np.diag([0.01, 0.04, 1e-4])
        x, _ = reference.third_filter(angles[1:], 0.01, f, q, *start)
        assert x == close(V2_THIRD, V2_DIGITS)

    def test_third_filter_by_its_option(self):
        options = {"method": "paper", "initial": V2_INITIAL, "outage": "printed"}
        fused = fuse_series(V2, V2_NOISE, T4, **options)
        np.testing.assert_array_equal(fused.weights[:, 4], [[0, 0, 0], [1, 1, 1]])
        start = [10.05, 0, 0], np.diag([0.01, 0.04, 1e-4])
        angles = np.concatenate([[NAN], fused.mean[1:, 0]])
        again = filter_series(angles, 0.01, T4, initial=start)
        assert again.mean[-1] == close(V2_THIRD, V2_DIGITS)
        both = fuse_series(V2, V2_NOISE, T4, **options, third_filter=T4)
        np.testing.assert_array_equal(both.unfiltered, fused.mean)
        own = filter_series(fused.mean[:, 0], np.mean(V2_NOISE) / 2, T4)
        np.testing.assert_array_equal(both.mean, own.mean)
        np.testing.assert_array_equal(both.upper, own.upper)

    @pytest.mark.parametrize("options", [{"outage": "printed"}, {"third_filter": T4}])
    def test_options_of_the_paper_alone(self, options):
        with pytest.raises(ValueError, match="are for 'paper'"):
            fuse_series(V2, V2_NOISE, T4, **options)
        with pytest.raises(ValueError, match="outage is 'none'"):
            fuse_series(V2, V2_NOISE, T4, method="paper", outage="none")

    def test_states_by_their_corrections(self):
        """Weights as products of the others' squares, over their sum."""
        x = [[359.98, 0.110, 0.0010], [0.03, 0.125, 0.0004]]
        y = [[0.05, 0.004, 0.0002], [-0.02, 0.001, -0.0003]]
        found = fuse(x, method="paper", corrections=y, period=360.0)
        second = [0.8620689655172, 0.9411764705882, 0.3076923076923]
        assert np.diag(found.weights[1]) == close(second, 1e-12)
        expected = [0.02310344827583, 0.1241176470588, 0.0008153846153846]
        assert found.mean == close(expected, 1e-11)
        assert np.all(np.isnan(found.covariance))
        known = fuse(x, [np.eye(3)] * 2, method="paper", corrections=y, period=360.0)
        share = np.diagonal(known.weights, axis1=1, axis2=2)
        assert np.diag(known.covariance) == close(np.sum(share**2, axis=0), 1e-15)

    def test_corrections_of_zero(self):
        corrections = [[0.0, 0.0, 1e-200], [0.0, 1.0, 1e-200]]
        found = fuse(np.zeros((2, 3)), method="paper", corrections=corrections)
        np.testing.assert_array_equal(np.diag(found.weights[0]), [0.5, 1.0, 0.5])
        alone = fuse([[1.0], [NAN]], method="paper", corrections=[[1.0], [0.0]])
        assert alone.mean == 1.0

    def test_what_the_rule_needs(self):
        x, s = np.zeros((2, 3)), [np.eye(3)] * 2
        with pytest.raises(ValueError, match="needs corrections"):
            fuse(x, s, method="paper")
        with pytest.raises(ValueError, match="takes no corrections"):
            fuse(x, s, corrections=x)
        with pytest.raises(ValueError, match="needs them"):
            fuse(x)
        with pytest.raises(ValueError, match=r"corrections\[0, 0\] is nan"):
            fuse(x, method="paper", corrections=x + NAN)

    def test_without_a_plot_a_radar_is_left_out_of_the_papers_rule(self):
        np.testing.assert_array_equal(fused_v2("paper").weights[:, 4], [[1, 1, 1], [0, 0, 0]])

    @pytest.mark.parametrize(
        ("corrections", "weight"),
        [((0.1, 0.2), 0.8), ((0.3, -0.1), 0.1), ((0, 0.1), 1), ((0.1, 0), 0), ((0, 0), 0.5)],
    )
    def test_rule_of_the_paper(self, corrections, weight):
        """Steady filters alike: the corrections are as the innovations, Y = K v."""
        printed = reference.paper_weights(np.array(corrections)[:, np.newaxis] * np.ones(3))
        assert printed[0] == close([weight] * 3)
        # K = 1/2 for all of P = R = 1
        z = 2 * np.array(corrections)[:, np.newaxis]
        state = np.zeros((2, 3)), np.full((2, 3, 3), np.diag([1.0, 0, 0]) + 0.0)
        state[1][:, 0, 1:] = state[1][:, 1:, 0] = 0.1
        state[1][:, [1, 2], [1, 2]] = 1.0
        result = fuse_series(z, 1.0, MODEL, method="paper", initial=state)
        assert result.weights[0, 0] == close([weight] * 3)

    def test_wrap(self):
        """359 and 1 degrees with the weights 3/4 and 1/4."""
        states = np.array([[359.0, 0, 0], [1.0, 0, 0]])
        covariances = np.array([np.diag([1.0, 1, 1]), np.diag([3.0, 1, 1])])
        none = np.full((2, 1), NAN)
        result = fuse_series(
            none, 1.0, MODEL, method="posterior", initial=(states, covariances), period=360.0
        )
        assert result.mean[0, 0] == close(359.5)
        weights = [np.eye(3) * 0.75, np.eye(3) * 0.25]
        mean, _ = reference.combine(weights, states, np.zeros((2, 2, 3, 3)), 360.0)
        assert mean[0] == close(359.5)


# two tracks of one target: position and velocity
FIRST = [[8100, 900, 220, 30], [900, 6400, 25, 180], [220, 25, 36, 4], [30, 180, 4, 30]]
SECOND = [
    [14400, -2000, 300, -60],
    [-2000, 10000, -50, 260],
    [300, -50, 49, -6],
    [-60, 260, -6, 40],
]
STATES = np.array([[1000.0, 2000, 100, 50], [860, 2095, 94, 46]])


def test_independent_tracks():
    found = fuse(STATES, np.array([FIRST, SECOND], dtype=float))
    mean = [954.5955862076, 2028.047076863, 97.21025017035, 47.80340428431]
    variances = [5065.782372154, 3822.215076831, 20.41505898324, 16.85222675532]
    np.testing.assert_allclose(found.mean, mean, rtol=1e-12)
    np.testing.assert_allclose(np.diag(found.covariance), variances, rtol=1e-12)


def test_tracks_with_common_process_noise():
    first, second = np.linalg.cholesky(FIRST), np.linalg.cholesky(SECOND)
    block = first @ np.diag([0.1, 0.1, 0.3, 0.3]) @ second.T
    cross = np.zeros((2, 2, 4, 4))
    cross[0, 1], cross[1, 0] = block, block.T
    found = fuse(STATES, np.array([FIRST, SECOND], dtype=float), cross_covariances=cross)
    mean = [956.9396805927, 2026.479935219, 97.0212350385, 47.95062030454]
    variances = [5514.992967404, 4193.236057556, 25.54454487058, 21.27973378563]
    np.testing.assert_allclose(found.mean, mean, rtol=1e-12)
    np.testing.assert_allclose(np.diag(found.covariance), variances, rtol=1e-12)
    np.testing.assert_allclose(found.covariance[0, 2], 135.4918745787, rtol=1e-12)


def test_covariance_intersection_of_tracks():
    other = [[9000, 1500, 300, 0], [1500, 900, 0, 40], [300, 0, 90, 5], [0, 40, 5, 12]]
    both = np.array([np.diag([400, 10000, 9, 100]), other], dtype=float)
    found = fuse(STATES, both, method="covariance-intersection")
    mean = [993.5405865205, 2111.070039235, 99.92193555401, 46.07169959935]
    variances = [755.5036997839, 1173.265216762, 16.06938306665, 20.84272214489]
    np.testing.assert_allclose(found.mean, mean, rtol=1e-9)
    np.testing.assert_allclose(np.diag(found.covariance), variances, rtol=1e-9)
    determinant = np.linalg.slogdet(found.covariance).logabsdet
    np.testing.assert_allclose(determinant, 19.22437825853, rtol=1e-12)
