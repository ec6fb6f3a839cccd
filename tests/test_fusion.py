"""Fusion against plain matrices, printed vectors, exact equalities and truth."""

import pickle
import re
from functools import lru_cache
from typing import get_args

import numpy as np
import pytest
from reference import fusion as reference
from scipy import stats
from tolerances import CHANCE, PARITY, VECTOR

from tertia.fusion import AngleFusion, common_azimuth, fuse_series
from tertia.kalman import SingerModel, filter_series
from tertia.simulate import ScenarioName, radar_scenario, radars

NAN, INF = float("nan"), float("inf")
MODEL = SingerModel(5.0, 0.05, 0.003)
RESTLESS = SingerModel(5.0, 0.15, 0.05)
METHODS = reference.METHODS
# the reference inverts the joint covariance, whose condition is about 1e5
PARITY_OF_MATRICES = 1e-8
# shares of covariances that hardly differ make hardly a difference
PARITY_OF_INTERSECTION = 1e-7
FIELDS = ["mean", "upper", "weights", "noise_variance", "outlier", "innovation"]
FIELDS.append("innovation_variance")
EVERY_METHOD = pytest.mark.parametrize("method", METHODS)


def close(expected, relative=VECTOR):
    return pytest.approx(np.asarray(expected), rel=relative, abs=0)


def rng(seed=0):
    return np.random.default_rng(seed)


def same(a, b):
    for field in FIELDS:
        np.testing.assert_array_equal(getattr(a, field), getattr(b, field), err_msg=field)


def in_sigmas(result, expected, tolerance, period=None):
    """Means, covariances, in units of the expected standard deviations."""
    finite = np.isfinite(expected["covariance"]).all((-2, -1))
    assert finite.any()
    sigma = np.sqrt(np.diagonal(expected["covariance"][finite], axis1=-2, axis2=-1))
    away = result.mean[finite] - expected["mean"][finite]
    away[..., 0] = reference.wrap(away[..., 0], period)
    np.testing.assert_allclose(away / sigma, 0, atol=tolerance)
    spread = result.covariance[finite] - expected["covariance"][finite]
    scale = sigma[..., np.newaxis] * sigma[..., np.newaxis, :]
    np.testing.assert_allclose(spread / scale, 0, atol=tolerance)


def steps_of(model, times):
    t = np.diff(times)
    return t, [model.transition(dt) for dt in t], [model.process_noise(dt) for dt in t]


def nees(result, truth, at):
    """Normalised squared error, per dimension, of every run."""
    error = result.mean[..., at, :] - truth[..., at, :]
    solved = np.linalg.solve(result.covariance[..., at, :, :], error[..., np.newaxis])[..., 0]
    return np.sum(error * solved, axis=-1) / 3


def bounds_of_nees(runs):
    """Those of the mean over independent runs."""
    return stats.chi2.ppf([CHANCE / 2, 1 - CHANCE / 2], 3 * runs) / (3 * runs)


# V2 and V3

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


# against the reference


@lru_cache
def scene(k, seed, *, given):
    """Gaps, an outage, outliers, a faulty radar, irregular times, crossing north, and noise that
    changes from step to step."""
    random = rng(seed)
    n = 60
    times = np.cumsum(random.uniform(2, 7, n))
    times[20] = times[19]
    r = 0.01 * random.uniform(0.3, 3, (k, n))
    truth = 350 + 0.15 * (times - times[0]) + 2 * np.sin(times / 60)
    z = truth + np.sqrt(r) * random.standard_normal((k, n))
    z[0, 30:] += 0.5 * random.standard_normal(30)
    z[random.random((k, n)) < 0.1] = NAN
    z[k - 1, 25:33] = NAN
    z[:, 45:47] = NAN
    z[k - 1, 15] = truth[15] + 4
    z[0, 50] = truth[50] - 3
    initial = None
    if given:
        offset = random.normal(0, 0.1, (k, 3)) * [1, 0.1, 0.01]
        p = np.eye(3) * random.uniform(0.5, 1.5, (k, 1, 3)) * [0.5, 0.04, 0.0001]
        initial = np.array([350.0, 0.15, 0]) + offset, p
    return z % 360, r, times, initial


def both(k, seed, method, *, given, model=MODEL, **options):
    z, r, times, initial = scene(k, seed, given=given)
    result = fuse_series(
        z, r, model, method=method, initial=initial, time=times, period=360.0, **options
    )
    renamed = {"gate" if name == "outlier_gate" else name: v for name, v in options.items()}
    expected = reference.fuse(
        z,
        r,
        *steps_of(model, times),
        method=method,
        initial=initial,
        acceleration_variance=model.acceleration_sigma**2,
        period=360.0,
        **renamed,
    )
    return result, expected


def tolerance(method):
    matrices = dict.fromkeys(reference.MATRICES, PARITY_OF_MATRICES)
    return (matrices | {"covariance-intersection": PARITY_OF_INTERSECTION}).get(method, PARITY)


def check_parity(result, expected, method):
    in_sigmas(result, expected, tolerance(method), 360.0)
    np.testing.assert_array_equal(result.outlier, expected["outlier"])
    for field in ("noise_variance", "innovation", "innovation_variance"):
        actual, wanted = getattr(result, field), expected[field]
        np.testing.assert_allclose(actual, wanted, rtol=PARITY, atol=1e-11, err_msg=field)
    np.testing.assert_allclose(result.weights, expected["weights"], atol=1e3 * tolerance(method))


@EVERY_METHOD
@pytest.mark.parametrize("k", [1, 2, 3])
@pytest.mark.parametrize("seed", [1, 2])
def test_parity(k, seed, method):
    result, expected = both(k, seed, method, given=True)
    if k > 1:
        # else nothing of it is tried
        assert expected["outlier"].any()
        assert (expected["noise_variance"] > 2 * scene(k, seed, given=True)[1]).any()
    check_parity(result, expected, method)


@EVERY_METHOD
@pytest.mark.parametrize("k", [1, 2])
def test_parity_without_a_state(k, method):
    check_parity(*both(k, 3, method, given=False), method)


@EVERY_METHOD
def test_parity_with_an_exact_model(method):
    model = SingerModel(5.0, 0.3, 0.02, exact=True)
    check_parity(*both(2, 4, method, given=True, model=model), method)


@pytest.mark.parametrize(
    "options",
    [
        {"forgetting_factor": 0.7},
        {"forgetting_factor": 0.0},
        {"threshold": 1.0},
        {"outlier_gate": 3.0},
        {"change_probability": 0.05},
        {"change_probability": 1e-12},
    ],
)
@pytest.mark.parametrize("method", ["adaptive", "ewma", "robust"])
def test_parity_of_parameters(method, options):
    result, expected = both(2, 5, method, given=True, **options)
    check_parity(result, expected, method)
    plain, _ = both(2, 5, method, given=True)
    relevant = {
        "adaptive": "change_probability" not in options,
        "ewma": "forgetting_factor" in options,
        "robust": "change_probability" in options,
    }[method]
    assert relevant == (not np.allclose(plain.mean, result.mean, rtol=0, atol=1e-6))


# shapes and threads


def batches(*shape, k=2, n=40, seed=0):
    return radars(MODEL, n, sigma=[0.1] * k, detection_probability=0.9, batch=shape, rng=seed).z


@EVERY_METHOD
def test_a_batch_is_its_series(method):
    z, states = batches(2, 3), rng(1)
    initial = states.normal(size=(2, 3, 2, 3)), np.full((2, 3, 2, 3, 3), np.diag([1, 0.1, 0.01]))
    variance = states.uniform(0.005, 0.02, (2, 3, 2, 40))
    times = np.cumsum(states.uniform(3, 7, (2, 3, 40)), axis=-1)
    whole = fuse_series(z, variance, MODEL, method=method, initial=initial, time=times)
    assert whole.mean.shape == (2, 3, 40, 3)
    assert whole.upper.shape == (2, 3, 40, 6)
    assert whole.covariance.shape == (2, 3, 40, 3, 3)
    assert whole.weights.shape == (2, 3, 2, 40, 3)
    np.testing.assert_allclose(whole.sigma[..., 1] ** 2, whole.covariance[..., 1, 1], rtol=1e-14)
    for shape in (whole.outlier, whole.noise_variance, whole.innovation, whole.innovation_variance):
        assert shape.shape == (2, 3, 2, 40)
    for place in np.ndindex(2, 3):
        own = tuple(part[place] for part in initial)
        one = fuse_series(
            z[place], variance[place], MODEL, method=method, initial=own, time=times[place]
        )
        for field in FIELDS:
            np.testing.assert_array_equal(getattr(whole, field)[place], getattr(one, field))


@EVERY_METHOD
def test_threads_change_nothing(method):
    z = batches(37, k=3)
    same(
        fuse_series(z, 0.01, MODEL, method=method, n_threads=1),
        fuse_series(z, 0.01, MODEL, method=method, n_threads=5),
    )


def test_lists_order_in_memory_and_masks():
    z = batches(4)
    plain = fuse_series(z, 0.01, MODEL)
    for other in (
        z.tolist(),
        np.asfortranarray(z),
        np.ma.masked_invalid(z),
        np.repeat(z, 2, axis=-1)[..., ::2],
    ):
        same(plain, fuse_series(other, 0.01, MODEL))
    for variance in ([[0.01], [0.01]], np.full((2, 40), 0.01), np.full((4, 2, 40), 0.01)):
        same(plain, fuse_series(z, variance, MODEL))
    same(plain, fuse_series(z, 0.01, MODEL, time=np.arange(40) * 5.0))
    same(plain, fuse_series(z, 0.01, MODEL, time=np.full((4, 40), np.arange(40) * 5.0)))


def test_one_state_for_all_radars():
    state = np.array([0.0, 0, 0]), np.diag([1, 0.1, 0.01])
    each = np.zeros((4, 2, 3)), np.full((4, 2, 3, 3), state[1])
    z = batches(4)
    same(fuse_series(z, 0.01, MODEL, initial=state), fuse_series(z, 0.01, MODEL, initial=each))


def test_the_caller_keeps_the_plots():
    z = batches(2)
    before = z.copy()
    fuse_series(z, 0.01, MODEL, period=360.0)
    np.testing.assert_array_equal(z, before)


@pytest.mark.parametrize(
    ("z", "told"),
    [
        (batches(), r"FusedSeries\(2 radars, 40 steps, \d+ outliers\)"),
        (batches(3, 2), r"FusedSeries\(batch \(3, 2\), 2 radars, 40 steps, \d+ outliers\)"),
        (np.zeros((1, 1)), r"FusedSeries\(1 radar, 1 step, 0 outliers\)"),
    ],
)
def test_repr(z, told):
    assert re.fullmatch(told, repr(fuse_series(z, 0.01, MODEL)))


def test_repr_of_one_outlier():
    result = fuse_series(batches(), 0.01, MODEL)
    result.outlier[:] = False
    result.outlier[1, 7] = True
    assert repr(result) == "FusedSeries(2 radars, 40 steps, 1 outlier)"


# one step at a time


@EVERY_METHOD
@pytest.mark.parametrize("k", [1, 2, 4])
def test_streaming_is_the_series(method, k):
    z, r, times, _ = scene(k, 12, given=False)
    options = {"method": method, "period": 360.0, "change_probability": 0.01}
    whole = fuse_series(z, r, MODEL, time=times, **options)
    centre = AngleFusion(MODEL, [0.01] * k, **options)
    for step, dt in enumerate(np.diff(times, prepend=times[0])):
        if step in {1, 2, 30}:
            centre = pickle.loads(pickle.dumps(centre))
        if step:
            centre.step(z[:, step].tolist(), r[:, step].tolist(), dt=dt)
        else:
            centre.update(z[:, step].tolist(), r[:, step].tolist())
        np.testing.assert_array_equal(centre.mean, whole.mean[step])
        np.testing.assert_array_equal(centre.covariance, whole.covariance[step])
        np.testing.assert_array_equal(centre.weights, whole.weights[:, step])
        np.testing.assert_array_equal(centre.noise_variance, whole.noise_variance[:, step])
        np.testing.assert_array_equal(centre.outlier, whole.outlier[:, step])


def test_errors_of_a_stream_say_where():
    with pytest.raises(
        ValueError, match=r"^measurement_variance\[1\] is -0.2; it must be a positive"
    ):
        AngleFusion(MODEL, [0.1, -0.2])
    centre = AngleFusion(MODEL, [0.1, 0.2])
    with pytest.raises(ValueError, match=r"^plots\[1\] is inf; it must be a finite number, or nan"):
        centre.step([0.0, INF])
    with pytest.raises(ValueError, match=r"^measurement_variance\[0\] is 0"):
        centre.update([0.0, 1.0], [0.0, 1.0])


def test_plots_on_both_sides_of_a_far_prediction():
    """A prediction that is half a turn away says nothing, and turns no plot away."""
    state = np.array([180.0, 0, 0]), np.diag([1e4, 1e-4, 1e-6])
    result = fuse_series([[359.9], [0.1]], 0.01, MODEL, initial=state, period=360.0)
    assert abs(reference.wrap(result.mean[0, 0], 360.0)) < 0.05
    # between that of both and that of one of them
    assert 0.07 < result.sigma[0, 0] < 0.15


def test_an_angle_that_is_known_exactly():
    """The plots of that step tell nothing of it; later ones do."""
    z = batches(k=2, n=30, seed=6)
    state = np.zeros((2, 3)), np.tile(np.diag([0, 1e-3, 1e-5]), (2, 1, 1))
    result = fuse_series(z, 0.01, MODEL, initial=state)
    expected = fuse_series(z, 0.01, MODEL, method="central", initial=state)
    np.testing.assert_array_equal(result.mean[0], 0)
    away = (result.mean - expected.mean)[1:] / expected.sigma[1:]
    assert np.abs(away).max() < 1


def test_shares_of_a_step():
    """Of those that have a plot; of nothing there is none."""
    z = batches(k=3, n=60, seed=5)
    z[2, 20:30] = NAN
    z[:, 40] = NAN
    result = fuse_series(z, [[0.01], [0.04], [0.01]], MODEL)
    np.testing.assert_array_equal(result.weights[2, 20:30], 0)
    np.testing.assert_array_equal(result.weights[:, 40], 0)
    rest = np.delete(np.arange(5, 60), 35)
    rest = rest[~np.isnan(z[:, rest]).all(axis=0)]
    np.testing.assert_allclose(result.weights[:, rest].sum(axis=0), 1, rtol=1e-13)
    np.testing.assert_allclose(result.mean[40], MODEL.transition() @ result.mean[39], rtol=VECTOR)


# the start, and what is missing


@EVERY_METHOD
def test_the_state_is_known_from_a_radars_second_plot_on(method):
    z = batches()
    z[0, :4], z[0, 5] = NAN, NAN
    z[1, :7] = NAN
    z[0, [4, 6]] = 1.0, 1.2
    result = fuse_series(z, 0.01, MODEL, method=method)
    assert np.isnan(result.mean[:4]).all()
    assert np.isinf(result.sigma[:4]).all()
    # one plot: its angle alone, and only while it is new
    assert result.mean[4, 0] == 1.0
    assert result.sigma[4, 0] == close(0.1)
    assert np.isinf(result.sigma[4:6, 1]).all()
    assert np.isfinite(result.mean[6:]).all()
    assert np.isfinite(result.upper[6:]).all()
    if method not in {"central", "robust"}:
        assert np.isnan(result.weights[:, :6]).all()
        np.testing.assert_array_equal(result.weights[0, 6], 1)
        assert np.isnan(result.weights[1, 6]).all()


STARTS = {
    "as usual": (MODEL, 0.1, None),
    "restless": (RESTLESS, 0.1, None),
    "restless, exact": (SingerModel(5.0, 0.15, 0.05, exact=True), 0.02, None),
    "small noise": (RESTLESS, 0.01, None),
    "in turns": (RESTLESS, 0.02, [[1, 0], [0, 1]]),
    "one late": (RESTLESS, 0.02, "late"),
}


@pytest.mark.parametrize("method", ["equal", "posterior", "matrix", "central"])
@pytest.mark.parametrize("start", STARTS.values(), ids=STARTS)
def test_the_start_is_honest(method, start):
    """From the second plot of the first radar on."""
    model, sigma, seen = start
    runs, n = 2000, 12
    probability = np.ones((2, n))
    if seen == "late":
        probability[1, [0, 1, 2, 4]] = 0
    elif seen is not None:
        probability = np.tile(seen, n // 2).astype(float)
    record = radars(
        model, n, sigma=[sigma] * 2, detection_probability=probability, batch=runs, rng=11
    )
    result = fuse_series(record.z, sigma**2, model, method=method)
    known = np.flatnonzero(np.isfinite(result.upper[0]).all(axis=-1))
    second = np.flatnonzero(~np.isnan(record.z[0, 0]))[1]
    # two plots of different radars are enough for one filter of all
    assert known[0] <= second if method == "central" else known[0] == second
    if method != "central":
        first_of_second = np.flatnonzero(~np.isnan(record.z[0, 1]))[1]
        assert first_of_second > known[0] or seen is None
    assert np.linalg.eigvalsh(result.covariance[0, known[0] :]).min() > 0
    found = [nees(result, record.truth, k).mean() for k in known]
    # a bound for all steps together
    chance = CHANCE / len(known)
    low, high = stats.chi2.ppf([chance / 2, 1 - chance / 2], 3 * runs) / (3 * runs)
    assert min(found) > low
    assert max(found) < high


@EVERY_METHOD
def test_states_of_running_filters(method):
    """Angle, rate and acceleration are correlated in them."""
    z = batches(10, k=3, n=60)
    # as a radar that goes on from where it was: of little noise, of much, with fewer plots
    z[:, 2, 10:20] = NAN
    noise = np.array([[0.01], [0.04], [0.01]])
    first = filter_series(z[..., :20], noise, MODEL, store="final")
    model_step = first.mean @ MODEL.transition().T
    f = MODEL.transition()
    before = f @ first.covariance @ f.T + MODEL.process_noise()
    result = fuse_series(z[..., 20:], noise, MODEL, method=method, initial=(model_step, before))
    scale = np.sqrt(np.abs(result.upper[..., [0, 3, 5]]))
    relative = result.covariance / scale[..., np.newaxis] / scale[..., np.newaxis, :]
    assert np.linalg.eigvalsh(relative).min() > 0
    # the angle is no better known than by all plots of all radars
    assert result.sigma[:, 5:, 0].min() > 0.02


@EVERY_METHOD
def test_nothing_at_all(method):
    result = fuse_series(np.full((2, 2, 6), NAN), 0.01, MODEL, method=method)
    assert np.isnan(result.mean).all()
    assert np.isinf(result.sigma).all()
    assert not result.outlier.any()
    assert np.isnan(result.innovation).all()


@EVERY_METHOD
def test_a_radar_that_never_sees_changes_nothing(method):
    z = batches(k=3)
    z[1] = NAN
    with_it = fuse_series(z, 0.01, MODEL, method=method)
    without = fuse_series(z[[0, 2]], 0.01, MODEL, method=method)
    for field in ("mean", "upper"):
        np.testing.assert_array_equal(getattr(with_it, field), getattr(without, field))
    np.testing.assert_array_equal(with_it.outlier[[0, 2]], without.outlier)
    np.testing.assert_array_equal(with_it.weights[[0, 2]], without.weights)
    assert np.isnan(with_it.weights[1]).all()


@pytest.mark.parametrize("shape", [(0, 2, 5), (3, 0, 2, 5)])
def test_no_series(shape):
    result = fuse_series(np.empty(shape), 0.01, MODEL)
    assert result.mean.shape == (*shape[:-2], 5, 3)
    assert result.weights.shape == (*shape, 3)


# equalities


def as_expected(result):
    return {"mean": result.mean, "covariance": result.covariance}


@EVERY_METHOD
@pytest.mark.parametrize("given", [False, True])
def test_a_single_radar_is_its_filter(method, given):
    z = batches(20, k=1) + 359.9
    state = (np.array([[359.9, 0, 0]]), np.diag([1.0, 0.1, 0.01])[np.newaxis]) if given else None
    own = (state[0][0], state[1][0]) if given else None
    result = fuse_series(z, 0.01, MODEL, method=method, initial=state, period=360.0)
    expected = filter_series(z[:, 0], 0.01, MODEL, initial=own, period=360.0)
    healthy = np.ones(20, dtype=bool)
    if method == "robust":
        # its noise is never believed exactly
        assert abs(np.log(np.median(result.noise_variance) / 0.01)) < 0.3
        return
    if method in {"adaptive", "adaptive-matrix"}:
        # the covariance follows the noise that is believed
        healthy = (result.noise_variance == 0.01).all(axis=(1, 2))
        assert 3 <= healthy.sum() < 20
    assert np.isfinite(expected.upper[healthy]).all(axis=-1).sum() > 38 * healthy.sum() * 0.9
    chosen = {"mean": expected.mean[healthy], "covariance": expected.covariance[healthy]}
    result_of = type("Chosen", (), {f: getattr(result, f)[healthy] for f in ("mean", "covariance")})
    in_sigmas(result_of, chosen, PARITY, 360.0)
    np.testing.assert_array_equal(np.isnan(result.mean), np.isnan(expected.mean))
    seen = ~np.isnan(expected.mean[..., 0])
    away = reference.wrap(result.mean[seen] - expected.mean[seen], 360.0)
    np.testing.assert_allclose(away, 0, atol=PARITY)
    np.testing.assert_array_equal(result.innovation[:, 0], expected.innovation)


@pytest.mark.parametrize("k", [2, 3, 5])
@pytest.mark.parametrize("given", [False, True])
def test_central_is_one_filter_of_pooled_plots(k, given):
    n = 40
    z = (batches(k=k, seed=k) + 359.9) % 360
    z[:, 0] = 359.9 + 0.01 * np.arange(k)
    r = rng(k).uniform(0.005, 0.05, (k, n))
    plots, variances = reference.pooled(z, r, 360.0)
    variances = np.where(np.isnan(plots), 1.0, variances)
    state = np.array([359.9, 0.1, 0]), np.diag([1e-9, 0.1, 0.01])
    own = pool = None
    if given:
        # all radars start alike: of angles that are independent, the pool knows K times as much
        own = np.tile(state[0], (k, 1)), np.full((k, 3, 3), state[1] + np.diag([k * 1e-3, 0, 0]))
        pool = state[0], state[1] + np.diag([1e-3 + 1e-9 / k - 1e-9, 0, 0])
    result = fuse_series(z, r, MODEL, method="central", initial=own, period=360.0)
    expected = filter_series(plots, variances, MODEL, initial=pool, period=360.0)
    in_sigmas(result, as_expected(expected), PARITY, 360.0)


def test_hierarchical_fusion_of_information_is_central():
    z, r, times, initial = scene(3, 7, given=True)
    same_start = initial[0][0], initial[1][0]
    t, f, q = steps_of(MODEL, times)
    local = reference.hierarchical(z, r, f, q, same_start, 360.0)
    whole = reference.central(z, r, t, f, q, same_start, 0.0, 360.0)
    sigma = np.sqrt(np.diagonal(whole[1], axis1=1, axis2=2))
    away = local[0] - whole[0]
    away[:, 0] = reference.wrap(away[:, 0], 360.0)
    np.testing.assert_allclose(away / sigma, 0, atol=PARITY)
    scale = sigma[:, :, np.newaxis] * sigma[:, np.newaxis]
    np.testing.assert_allclose((local[1] - whole[1]) / scale, 0, atol=PARITY)
    # and so is the package's, of one radar with the pooled plots
    pooled, variances = reference.pooled(z, r, 360.0)
    variances = np.where(np.isnan(pooled), 1.0, variances)
    alone = tuple(np.asarray(part)[np.newaxis] for part in same_start)
    result = fuse_series(
        pooled[np.newaxis], variances, MODEL, method="central", initial=alone, time=times,
        period=360.0,
    )  # fmt: skip
    in_sigmas(result, {"mean": local[0], "covariance": local[1]}, 10 * PARITY, 360.0)


@pytest.mark.parametrize("k", [2, 3, 5])
def test_central_is_the_hierarchical_fusion_of_information(k):
    """`P^-1 = P-^-1 + sum of (P_k^-1 - P-^-1)` of radars that start from the centre's state."""
    z, r, times, _ = scene(k, 10, given=False)
    state = np.array([350.0, 0.15, 0.0])
    variances = np.array([0.5, 0.04, 1e-4])
    # of angles that are independent, the centre knows k times as much
    own = np.tile(state, (k, 1)), np.tile(np.diag(variances * [k, 1, 1]), (k, 1, 1))
    result = fuse_series(
        z, r, MODEL, method="central", initial=own, time=times, period=360.0
    )  # fmt: skip
    _, f, q = steps_of(MODEL, times)
    mean, covariance = reference.hierarchical(z, r, f, q, (state, np.diag(variances)), 360.0)
    in_sigmas(result, {"mean": mean, "covariance": covariance}, PARITY, 360.0)


@EVERY_METHOD
@pytest.mark.parametrize("given", [False, True])
def test_the_order_of_the_radars_does_not_matter(method, given):
    z, r, times, initial = scene(3, 8, given=given)
    order = [2, 0, 1]
    options = {"method": method, "time": times, "period": 360.0}
    plain = fuse_series(z, r, MODEL, initial=initial, **options)
    turned = None if initial is None else tuple(part[order] for part in initial)
    other = fuse_series(z[order], r[order], MODEL, initial=turned, **options)
    finite = np.isfinite(plain.upper).all(axis=-1)
    expected = {"mean": plain.mean[finite], "covariance": plain.covariance[finite]}
    assert finite.sum() > 50
    chosen = {f: getattr(other, f)[finite] for f in ("mean", "covariance")}
    in_sigmas(type("Chosen", (), chosen), expected, tolerance(method), 360.0)
    np.testing.assert_array_equal(other.outlier, plain.outlier[order])
    # where two radars know nothing of the acceleration, any weights of it are as good
    late = slice(10, None) if "matrix" in method else slice(None)
    np.testing.assert_allclose(
        other.weights[:, late], plain.weights[order][:, late], atol=1e3 * tolerance(method)
    )


@EVERY_METHOD
@pytest.mark.parametrize("scale", [1e-3, 250.0])
def test_units_do_not_matter(method, scale):
    z, r, times, _ = scene(2, 9, given=False)
    z = z % 360
    options = {"method": method, "time": times}
    plain = fuse_series(z, r, MODEL, period=360.0, **options)
    model = SingerModel(5.0, 0.05, 0.003 * scale)
    other = fuse_series(z * scale, r * scale**2, model, period=360.0 * scale, **options)
    np.testing.assert_array_equal(np.isfinite(other.upper), np.isfinite(plain.upper))
    finite = np.isfinite(plain.upper).all(axis=-1)
    expected = {"mean": plain.mean[finite], "covariance": plain.covariance[finite]}
    chosen = {
        "mean": other.mean[finite] / scale,
        "covariance": other.covariance[finite] / scale**2,
    }
    # angles of 360 have lost three digits
    in_sigmas(type("Chosen", (), chosen), expected, max(tolerance(method), 1e-9), 360.0)
    np.testing.assert_array_equal(other.outlier, plain.outlier)


# two radars whose plots agree too well are believed to have less noise than stated
@pytest.mark.parametrize("method", [name for name in METHODS if name != "robust"])
def test_equal_radars_that_agree_are_one(method):
    """Of radars that measure the same, the fused track is that of each."""
    z = np.tile(batches(k=1, seed=4), (2, 1))
    result = fuse_series(z, 0.01, MODEL, method=method)
    alone = filter_series(z[0], 0.005 if method == "central" else 0.01, MODEL)
    known = np.isfinite(result.upper).all(axis=-1)
    sigma = alone.sigma[known]
    np.testing.assert_allclose((result.mean[known] - alone.mean[known]) / sigma, 0, atol=PARITY)


def test_intersection_of_equals_is_their_mean():
    """Every share has the same bound; one half has the least error."""
    record = radars(MODEL, 60, batch=20, rng=5)
    result = fuse_series(record.z, 0.01, MODEL, method="covariance-intersection")
    np.testing.assert_allclose(result.weights[:, :, 2:, 0], 0.5, atol=1e-3)


# Monte Carlo

RUNS = 500


@lru_cache
def record_of(kind):
    """Matched model; from scan 60 on radar 2 is 5 times noisier, or has outliers up to 80."""
    sigma, wrong = np.full((2, 120), 0.1), np.zeros((2, 120))
    if kind == "noisier":
        sigma[1, 60:] = 0.5
    elif kind == "outliers":
        wrong[1, 60:80] = 0.3
    return radars(MODEL, 120, sigma=sigma, outlier_probability=wrong, batch=RUNS, rng=21)


@lru_cache
def fused(kind, method):
    return fuse_series(record_of(kind).z, 0.01, MODEL, method=method)


def mean_nees(kind, method, at):
    """Averaged over these steps of each run, which are not independent, then over the runs."""
    record, result = record_of(kind), fused(kind, method)
    each = np.mean([nees(result, record.truth, k) for k in at], axis=0)
    return each.mean(), each.std() / np.sqrt(RUNS)


def rmse(kind, method, at):
    error = fused(kind, method).mean[:, at, 0] - record_of(kind).truth[:, at, 0]
    return np.sqrt(np.mean(error**2))


class TestMonteCarlo:
    @pytest.mark.parametrize(
        "method",
        [name for name in METHODS if name not in {"ewma", "paper", "covariance-intersection"}],
    )
    @pytest.mark.parametrize("at", [59, 119])
    def test_honest(self, method, at):
        low, high = bounds_of_nees(RUNS)
        assert low < mean_nees("healthy", method, [at])[0] < high

    @pytest.mark.parametrize("method", ["ewma", "paper"])
    def test_honest_with_weights_that_depend_on_the_plots(self, method):
        """Not exactly, for they are no constants; little of it is left over many steps."""
        found, error = mean_nees("healthy", method, range(30, 120))
        assert found == pytest.approx(1, abs=0.03 + 3 * error)

    def test_intersection_is_a_bound(self):
        found, error = mean_nees("healthy", "covariance-intersection", range(30, 120))
        assert found + 2.6 * error <= 1

    @pytest.mark.parametrize(
        ("method", "expected"),
        [
            ("equal", 63.9),
            ("static", 63.9),
            ("posterior", 63.9),
            ("paper", 76.4),
            ("ewma", 65.6),
            ("matrix", 63.9),
            ("covariance-intersection", 63.9),
            ("adaptive", 64.4),
            ("adaptive-matrix", 64.6),
            ("central", 63.0),
            ("robust", 63.0),
        ],
    )
    def test_the_errors_of_healthy_radars(self, method, expected):
        """Of an independent simulation, in thousandths; 1000 runs there. "robust": as "central"."""
        found = 1000 * rmse("healthy", method, range(20, 120))
        assert found == pytest.approx(expected, rel=0.02)

    def test_a_noisier_radar_is_found(self):
        after = range(80, 120)
        for method in ("adaptive", "adaptive-matrix"):
            assert mean_nees("noisier", method, after)[0] <= 1.2
        for method in ("equal", "posterior", "central"):
            assert mean_nees("noisier", method, after)[0] > 3
        result = fused("noisier", "adaptive")
        # innovations of a filter with too large a gain speak of more noise than there is
        assert 0.25 < np.median(result.noise_variance[:, 1, 90:]) < 1
        assert (result.noise_variance[:, 0, 90:] == 0.01).mean() > 0.9
        assert np.median(result.weights[:, 1, 90:, 0]) < 0.25
        assert rmse("noisier", "adaptive", after) < rmse("noisier", "equal", after) / 1.8

    def test_outliers_are_found(self):
        within = range(60, 80)
        for method in ("adaptive", "adaptive-matrix"):
            assert rmse("outliers", method, within) < rmse("outliers", "equal", within) / 1.8
        result, record = fused("outliers", "adaptive"), record_of("outliers")
        # one of 15 sigma is below the gate of 4 S^(1/2) with the chance .4
        assert (result.outlier & record.outlier).sum() / record.outlier.sum() > 0.35
        assert result.outlier[:, :, :60].mean() < 0.001

    def test_robust_finds_the_noise(self):
        after = range(70, 120)
        assert mean_nees("noisier", "robust", after)[0] <= 1.1
        noise = fused("noisier", "robust").noise_variance
        # levels are powers of 4
        assert 0.12 < np.median(noise[:, 1, 90:]) < 0.5
        assert 0.007 < np.median(noise[:, 0, 90:]) < 0.014
        assert rmse("noisier", "robust", range(20, 120)) < 1.02 * rmse(
            "noisier", "adaptive", range(20, 120)
        )

    def test_robust_forgets_outliers(self):
        within, after = range(60, 80), range(80, 90)
        assert rmse("outliers", "robust", within) < 0.95 * rmse("outliers", "adaptive", within)
        assert rmse("outliers", "robust", after) < 1.08 * rmse("healthy", "robust", after)
        assert mean_nees("outliers", "robust", range(60, 90))[0] < 1.05
        result, record = fused("outliers", "robust"), record_of("outliers")
        assert (result.outlier & record.outlier).sum() / record.outlier.sum() > 0.25
        assert result.outlier[:, :, :60].mean() < 0.001

    def test_robust_costs_nothing_where_all_is_well(self):
        at = range(20, 120)
        assert rmse("healthy", "robust", at) < 1.015 * rmse("healthy", "central", at)
        assert rmse("healthy", "robust", at) < rmse("healthy", "equal", at)

    def test_robust_finds_a_better_radar(self):
        record = radars(MODEL, 120, sigma=[0.05, 0.2], batch=200, rng=23)
        result = fuse_series(record.z, 0.01, MODEL)
        noise = np.median(result.noise_variance[..., 60:], axis=(0, 2))
        assert noise[0] < 0.006
        assert noise[1] > 0.03
        error = result.mean[:, 20:, 0] - record.truth[:, 20:, 0]
        other = fuse_series(record.z, 0.01, MODEL, method="adaptive")
        of_other = other.mean[:, 20:, 0] - record.truth[:, 20:, 0]
        assert np.mean(error**2) < np.mean(of_other**2)

    @pytest.mark.parametrize("k", [3, 5])
    def test_robust_with_two_bad_radars(self, k):
        """Of three they are the majority."""
        sigma = np.full((k, 120), 0.1)
        sigma[1:3, 60:] = 0.5
        record = radars(MODEL, 120, sigma=sigma, batch=200, rng=24)
        errors = {}
        for method in ("robust", "adaptive"):
            result = fuse_series(record.z, 0.01, MODEL, method=method)
            error = result.mean[:, 70:, 0] - record.truth[:, 70:, 0]
            errors[method] = np.sqrt(np.mean(error**2))
        assert errors["robust"] < errors["adaptive"] * (0.75 if k == 3 else 1.0)
        robust = fuse_series(record.z, 0.01, MODEL)
        assert np.mean([nees(robust, record.truth, at) for at in range(70, 120)]) < 1.15

    def test_robust_follows_a_manoeuvre(self):
        record = radars(MODEL, 120, turn=(60, 78, 2.0), batch=100, rng=22)
        turning = slice(62, 76)
        errors = {}
        for method in ("robust", "central"):
            result = fuse_series(record.z, 0.01, MODEL, method=method)
            error = result.mean[:, turning, 0] - record.truth[:, turning, 0]
            errors[method] = np.sqrt(np.mean(error**2))
            if method == "robust":
                assert (result.noise_variance[..., turning] > 0.02).mean() < 0.05
                assert np.abs(result.weights[..., turning, 0] - 0.5).mean() < 0.1
        assert errors["robust"] < errors["central"] / 2

    def test_a_manoeuvre_accuses_nobody(self):
        record = radars(MODEL, 120, turn=(60, 78, 2.0), batch=100, rng=22)
        assert np.ptp(record.truth[0, :, 0]) > 80
        result = fuse_series(record.z, 0.01, MODEL, method="adaptive")
        turning = slice(62, 76)
        nis = result.innovation[..., turning] ** 2 / result.innovation_variance[..., turning]
        assert nis.mean() > 3
        assert (result.noise_variance[..., turning] > 0.01).mean() < 0.2
        assert np.abs(result.weights[..., turning, 0] - 0.5).mean() < 0.1


# the default beside all other rules, where a prediction is worth a plot and where it is not

MOTIONS = {
    "usual": MODEL,
    "restless": SingerModel(5.0, 1 / 10, 0.03, exact=True),
    "more restless": SingerModel(8.0, 1 / 15, 0.02, exact=True),
    "quiet": SingerModel(3.0, 1 / 40, 0.0005, exact=True),
}
FEW_RUNS = 150


@lru_cache
def scenario_of(motion, name):
    at = list(get_args(ScenarioName)).index(name)
    return radar_scenario(name, model=MOTIONS[motion], batch=FEW_RUNS, rng=rng([50, at]))


@lru_cache
def track_of(motion, name, method):
    s = scenario_of(motion, name)
    return fuse_series(s.z, s.measurement_variance, s.model, method=method)


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("name", get_args(ScenarioName))
def test_robust_is_near_the_best_rule(motion, name):
    s = scenario_of(motion, name)
    errors = {
        method: np.sqrt(
            np.mean((track_of(motion, name, method).mean - s.truth)[:, s.counted, 0] ** 2)
        )
        for method in METHODS
    }
    assert errors["robust"] <= 1.08 * min(errors.values())


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("name", ["healthy", "noisy", "outliers"])
def test_robust_is_honest_for_every_motion(motion, name):
    s, result = scenario_of(motion, name), track_of(motion, name, "robust")
    each = np.mean([nees(result, s.truth, at) for at in range(70, 120)], axis=0)
    if name == "healthy":
        assert abs(each.mean() - 1) < stats.norm.isf(CHANCE / 2) * each.std() / np.sqrt(FEW_RUNS)
    else:
        assert each.mean() <= 1.2


@pytest.mark.parametrize("motion", ["restless", "more restless"])
def test_a_quarrel_is_decided(motion):
    """Two radars contradict each other, and the prediction is worth little."""
    noisy = track_of(motion, "noisy", "robust")
    assert (noisy.weights[:, 1, 80:, 0] > 0.5).mean() < 0.01
    assert np.median(noisy.noise_variance[:, 0, 80:]) < 0.02
    assert np.median(noisy.noise_variance[:, 1, 80:]) > 0.1


# common azimuth


def polar(distance, azimuth, site, origin):
    east = distance * np.sin(azimuth) + site[0] - origin[0]
    north = distance * np.cos(azimuth) + site[1] - origin[1]
    return np.array([np.arctan2(east, north) % (2 * np.pi), np.hypot(east, north)])


SITES = [((-30e3, 20e3), (0.0, 0.0)), ((10e3, 5e3), (-7e3, 40e3)), ((1e3, -1e3), (1e3, 2e3))]
TARGETS = np.array([[50e3, 1.5], [20e3, 4.0], [8e3, 0.1], [120e3, 6.2]])


class TestCommonAzimuth:
    @pytest.mark.parametrize(("site", "origin"), SITES)
    @pytest.mark.parametrize(("distance", "azimuth"), TARGETS)
    def test_against_differences(self, distance, azimuth, site, origin):
        spread = np.array([50.0, 0.002])
        found, covariance = common_azimuth(
            distance, azimuth, site, distance_sigma=50.0, azimuth_sigma=0.002, origin=origin
        )
        assert found == close(polar(distance, azimuth, site, origin))
        columns = []
        for step in (np.array([1.0, 0]), np.array([0, 1e-5])):
            up, down = (
                polar(*(np.array([distance, azimuth]) + sign * step), site, origin)
                for sign in (1, -1)
            )
            away = up - down
            away[0] = reference.wrap(away[0], 2 * np.pi)
            columns.append(away / (2 * step.sum()))
        jacobian = np.stack(columns, axis=-1)
        scale = np.sqrt(np.diag(covariance))
        expected = jacobian @ np.diag(spread**2) @ jacobian.T
        np.testing.assert_allclose((covariance - expected) / np.outer(scale, scale), 0, atol=1e-6)

    def test_against_simulation(self):
        random = rng(31)
        draws = 200_000
        distance = 50e3 + 50 * random.standard_normal(draws)
        azimuth = 1.5 + 0.002 * random.standard_normal(draws)
        site = (-30e3, 20e3)
        found, covariance = common_azimuth(50e3, 1.5, site, distance_sigma=50, azimuth_sigma=0.002)
        sample = np.cov(polar(distance, azimuth, site, (0.0, 0.0)))
        scale = np.sqrt(np.diag(covariance))
        # the error of a correlation is at most 1/sqrt(n), of a variance sqrt(2/n)
        np.testing.assert_allclose(
            (sample - covariance) / np.outer(scale, scale), 0, atol=4 * np.sqrt(2 / draws)
        )
        assert found.shape == (2,)

    def test_a_site_at_the_origin_sees_what_it_sees(self):
        distance, azimuth = TARGETS.T
        place = (3e3, -4e3)
        found, covariance = common_azimuth(
            distance, azimuth, place, distance_sigma=50.0, azimuth_sigma=0.002, origin=place
        )
        np.testing.assert_allclose(found, np.stack([azimuth, distance], axis=-1), rtol=VECTOR)
        expected = np.broadcast_to(np.diag([0.002**2, 50.0**2]), covariance.shape)
        np.testing.assert_allclose(covariance, expected, rtol=VECTOR, atol=1e-12)

    def test_shapes(self):
        options = {"distance_sigma": 50.0, "azimuth_sigma": np.full((3, 1), 0.002)}
        found, covariance = common_azimuth(*TARGETS.T, (1e3, 2e3), **options)
        assert found.shape == (3, 4, 2)
        assert covariance.shape == (3, 4, 2, 2)
        np.testing.assert_array_equal(covariance, np.swapaxes(covariance, -1, -2))
        one, _ = common_azimuth(*TARGETS[2], (1e3, 2e3), distance_sigma=50.0, azimuth_sigma=0.002)
        np.testing.assert_array_equal(found[1, 2], one)

    def test_the_azimuth_is_below_a_whole_turn(self):
        found, _ = common_azimuth(1e3, -1e-18, (0, 0), distance_sigma=1.0, azimuth_sigma=0.002)
        assert 0 <= found[0] < 2 * np.pi

    @pytest.mark.parametrize(
        ("changes", "error", "message"),
        [
            ({"distance": -1.0}, ValueError, "distance is -1.0; it must be a positive number"),
            ({"distance": [1.0, 0.0]}, ValueError, r"distance\[1\] is 0.0"),
            ({"distance": NAN}, ValueError, "distance is nan"),
            ({"azimuth": INF}, ValueError, "azimuth is inf"),
            ({"azimuth": "north"}, TypeError, "azimuth has dtype"),
            ({"distance_sigma": 0.0}, ValueError, "distance_sigma is 0.0"),
            ({"azimuth_sigma": [[1.0, -1.0]]}, ValueError, r"azimuth_sigma\[0, 1\] is -1.0"),
            ({"site": (1.0, 2.0, 3.0)}, ValueError, r"site has shape \(3,\)"),
            ({"site": (1.0, NAN)}, ValueError, r"site\[1\] is nan"),
            ({"origin": 1.0}, ValueError, r"origin has shape \(\)"),
            ({"distance": [1.0] * 2, "azimuth": [1.0] * 3}, ValueError, "do not fit together"),
            ({"distance": 2.0, "azimuth": 0.0, "site": (0, -2)}, ValueError, "to the origin"),
        ],
    )
    def test_errors(self, changes, error, message):
        arguments = {"distance": 1e3, "azimuth": 0.5, "site": (1.0, 2.0)}
        arguments |= {"distance_sigma": 50.0, "azimuth_sigma": 0.002} | changes
        with pytest.raises(error, match=message):
            common_azimuth(**arguments)


# errors


def spoilt(z, value, *place):
    z = z.copy()
    z[place] = value
    return z


Z = np.arange(10.0).reshape(2, 5)
STATE_OF_TWO = np.zeros((2, 3)), np.full((2, 3, 3), np.eye(3))


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"z": Z[0]}, ValueError, r"z has shape \(5,\); it must be \(\.\.\., K, steps\)"),
        ({"z": 1.0}, ValueError, r"z has shape \(\)"),
        ({"z": Z[:0]}, ValueError, r"z has shape \(0, 5\)"),
        ({"z": Z[:, :0]}, ValueError, r"z has shape \(2, 0\)"),
        ({"z": [[1.0, 2.0], [3.0]]}, ValueError, "z is ragged"),
        ({"z": [["a", "b"]]}, TypeError, "z has dtype"),
        ({"z": spoilt(Z, INF, 1, 3)}, ValueError, r"^z\[1, 3\] is inf"),
        ({"z": spoilt(Z, -INF, 0, 0)}, ValueError, r"^z\[0, 0\] is -inf"),
        ({"z": spoilt(np.stack([Z] * 4), INF, 2, 1, 3)}, ValueError, r"^z\[2, 1, 3\] is inf"),
        (
            {"z": spoilt(np.ones((3, 2, 2, 5)), INF, 2, 1, 0, 4)},
            ValueError,
            r"^z\[2, 1, 0, 4\] is inf",
        ),
        ({"measurement_variance": -1.0}, ValueError, "^measurement_variance is -1"),
        ({"measurement_variance": 0.0}, ValueError, r"^measurement_variance.* is 0"),
        ({"measurement_variance": NAN}, ValueError, "^measurement_variance.* is nan"),
        (
            {"measurement_variance": spoilt(np.ones((2, 5)), -2.0, 1, 3)},
            ValueError,
            r"^measurement_variance\[1, 3\] is -2",
        ),
        (
            {
                "z": np.stack([Z] * 3),
                "measurement_variance": spoilt(np.ones((3, 2, 5)), 0, 2, 0, 1),
            },
            ValueError,
            r"^measurement_variance\[2, 0, 1\] is 0",
        ),
        (
            {"measurement_variance": [[0.1], [-0.2]]},
            ValueError,
            r"^measurement_variance\[1, 0\] is -0.2",
        ),
        (
            {
                "z": np.stack([Z] * 3),
                "measurement_variance": spoilt(np.ones((3, 2, 1)), -0.2, 2, 1, 0),
            },
            ValueError,
            r"^measurement_variance\[2, 1, 0\] is -0.2",
        ),
        (
            {"measurement_variance": spoilt(np.ones((1, 5)), -0.2, 0, 3)},
            ValueError,
            r"^measurement_variance\[0, 3\] is -0.2",
        ),
        ({"measurement_variance": np.ones((3, 1))}, ValueError, r"measurement_variance has shape"),
        ({"measurement_variance": np.ones((2, 4))}, ValueError, r"measurement_variance has shape"),
        ({"measurement_variance": "x"}, TypeError, "measurement_variance has dtype"),
        ({"model": 5.0}, TypeError, "model is 5.0; it must be a SingerModel"),
        ({"method": "best"}, ValueError, "method is 'best'; it must be 'robust', 'adaptive'"),
        ({"method": None}, ValueError, "method is 'None'"),
        ({"time": [0, 1, 2, 1, 3]}, ValueError, r"time\[3\] is before"),
        ({"time": [0, 1, 2]}, ValueError, "time has shape"),
        ({"time": 1.0}, ValueError, "time is a single number"),
        ({"time": [0, 1, NAN, 2, 3]}, ValueError, r"time\[2\] is nan"),
        ({"time": [0, 1, 2, 30, 31]}, ValueError, "alpha"),
        ({"period": 0.0}, ValueError, "period is 0"),
        ({"period": -360.0}, ValueError, "period is -360"),
        ({"period": "x"}, TypeError, "period is 'x'"),
        ({"forgetting_factor": 1.0}, ValueError, "forgetting_factor is 1"),
        ({"forgetting_factor": -0.5}, ValueError, "forgetting_factor is -0.5"),
        ({"forgetting_factor": NAN}, ValueError, "forgetting_factor is nan"),
        ({"forgetting_factor": "x"}, TypeError, "forgetting_factor is 'x'"),
        ({"threshold": 0.9}, ValueError, "threshold is 0.9"),
        ({"threshold": NAN}, ValueError, "threshold is nan"),
        ({"outlier_gate": 0.5}, ValueError, "outlier_gate is 0.5"),
        ({"change_probability": 0.0}, ValueError, "change_probability is 0"),
        ({"change_probability": 1.0}, ValueError, "change_probability is 1"),
        ({"change_probability": NAN}, ValueError, "change_probability is nan"),
        ({"change_probability": "x"}, TypeError, "change_probability is 'x'"),
        ({"outlier_gate": None}, TypeError, "outlier_gate is None"),
        ({"n_threads": 0}, ValueError, "n_threads is 0"),
        ({"initial": 5}, TypeError, "initial must be a pair"),
        ({"initial": (np.zeros(2), np.eye(3))}, ValueError, "initial has shapes"),
        ({"initial": (np.zeros((3, 3)), np.eye(3))}, ValueError, "initial has shape"),
        (
            {"initial": (np.zeros(3), np.full((3, 3), INF))},
            ValueError,
            "initial covariance.* is inf",
        ),
        ({"initial": (np.zeros(3), -np.eye(3))}, ValueError, r"covariance\[0, 0\] is -1"),
        (
            {"initial": (STATE_OF_TWO[0], spoilt(STATE_OF_TWO[1], -1.0, 1, 2, 2))},
            ValueError,
            r"^covariance\[1, 2, 2\] is -1",
        ),
        (
            {"initial": (STATE_OF_TWO[0], [np.eye(3), 2 * np.ones((3, 3)) - np.eye(3)])},
            np.linalg.LinAlgError,
            r"^covariance\[1\] is indefinite",
        ),
        (
            {"initial": (np.zeros(3), [[1, 2, 0], [2, 1, 0], [0, 0, 1]])},
            np.linalg.LinAlgError,
            "covariance",
        ),
    ],
)
def test_errors(changes, error, message):
    arguments = {"z": Z, "measurement_variance": 0.01, "model": MODEL} | changes
    with pytest.raises(error, match=message):
        fuse_series(**arguments)
