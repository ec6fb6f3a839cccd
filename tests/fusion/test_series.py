"""Series of plots, fused: against plain matrices, exact equalities, and one step at a time."""

import pickle
import re
from contextlib import nullcontext

import numpy as np
import pytest
from checks import INF, NAN, assert_same, close, fields, rng
from fusion.scenes import EVERY_METHOD, METHODS, MODEL, RESTLESS, batches, nees, scene, steps_of
from reference import fusion as reference
from scipy import stats
from tolerances import CHANCE, PARITY, VECTOR

from tertia.fusion import AngleFusion, fuse_series
from tertia.kalman import SingerModel, filter_series
from tertia.simulate import radars

# the reference inverts the joint covariance, whose condition is about 1e5
PARITY_OF_MATRICES = 1e-8
# shares of covariances that hardly differ make hardly a difference
PARITY_OF_INTERSECTION = 1e-7


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


@pytest.mark.parametrize("dt", [1e-4, 1e-6, 1e-10])
@pytest.mark.parametrize("k", [2, 3])
def test_steps_that_are_short_are_one_average(k, dt):
    z = 5.0 + 0.1 * np.random.default_rng(1).standard_normal((k, 300))
    model = SingerModel(dt, 0.05, 0.003)
    matrix = fuse_series(z, 0.01, model, method="matrix")
    central = fuse_series(z, 0.01, model, method="central")
    # the radars have the same noise, and nothing moves meanwhile
    np.testing.assert_allclose(matrix.mean[-1, 0], central.mean[-1, 0], atol=1e-4)
    np.testing.assert_allclose(matrix.sigma[-1, 0], central.sigma[-1, 0], rtol=1e-2)


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
        for field in fields(one).keys() - {"systematic", "unfiltered"}:
            np.testing.assert_array_equal(getattr(whole, field)[place], getattr(one, field))


@EVERY_METHOD
def test_threads_change_nothing(method):
    z = batches(37, k=3)
    assert_same(
        fuse_series(z, 0.01, MODEL, method=method, n_threads=1),
        fuse_series(z, 0.01, MODEL, method=method, n_threads=5),
    )


def test_variances_and_times_of_all_forms():
    z = batches(4)
    plain = fuse_series(z, 0.01, MODEL)
    assert_same(plain, fuse_series(np.ma.masked_invalid(z), 0.01, MODEL))
    for variance in ([[0.01], [0.01]], np.full((2, 40), 0.01), np.full((4, 2, 40), 0.01)):
        assert_same(plain, fuse_series(z, variance, MODEL))
    assert_same(plain, fuse_series(z, 0.01, MODEL, time=np.arange(40) * 5.0))
    assert_same(plain, fuse_series(z, 0.01, MODEL, time=np.full((4, 40), np.arange(40) * 5.0)))


def test_one_state_for_all_radars():
    state = np.array([0.0, 0, 0]), np.diag([1, 0.1, 0.01])
    each = np.zeros((4, 2, 3)), np.full((4, 2, 3, 3), state[1])
    z = batches(4)
    assert_same(
        fuse_series(z, 0.01, MODEL, initial=state), fuse_series(z, 0.01, MODEL, initial=each)
    )


@pytest.mark.parametrize(
    ("z", "expected"),
    [
        (batches(), r"FusedSeries\(2 radars, 40 steps, \d+ outliers"),
        (batches(3, 2), r"FusedSeries\(batch \(3, 2\), 2 radars, 40 steps, \d+ outliers"),
        (np.zeros((1, 1)), r"FusedSeries\(1 radar, 1 step, 0 outliers"),
    ],
)
def test_repr(z, expected):
    note = r", systematic error not included\)"
    assert re.fullmatch(expected + note, repr(fuse_series(z, 0.01, MODEL)))


def test_repr_of_one_outlier():
    result = fuse_series(batches(), 0.01, MODEL)
    result.outlier[:] = False
    result.outlier[1, 7] = True
    assert (
        repr(result) == "FusedSeries(2 radars, 40 steps, 1 outlier, systematic error not included)"
    )


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
        np.testing.assert_array_equal(centre.repeated, whole.repeated[:, step])


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


@pytest.mark.parametrize("method", METHODS)
def test_the_order_of_the_radars_does_not_matter_before_there_are_tracks(method):
    """The angle was that of the first radar, or unknown if its plot was not new."""
    z = np.array([[NAN, NAN, 51.1], [NAN, 50.4, NAN], [49.9, NAN, NAN]])
    variance = np.array([[0.01], [0.01], [0.04]])
    one = fuse_series(z, variance, MODEL, method="central")
    for order in ([0, 1, 2], [2, 0, 1]):
        found = fuse_series(z[order], variance[order], MODEL, method=method)
        if method != "robust":
            np.testing.assert_array_equal(found.mean[:, 0], one.mean[:, 0])
            np.testing.assert_array_equal(found.upper[:, 0], one.upper[:, 0])
        assert np.isfinite(found.sigma[:, 0]).all()


# noise that lasts


def lasting_scene(correlation):
    random = rng(41)
    truth = 0.05 * np.arange(120) * np.ones((20, 1))
    errors = random.standard_normal((20, 2, 120))
    for k in range(1, 120):
        errors[..., k] *= np.sqrt(1 - correlation**2)
        errors[..., k] += correlation * errors[..., k - 1]
    return truth, (truth[:, np.newaxis] + 0.1 * errors) % 360


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9])
def test_the_covariance_grows_where_noise_lasts(correlation):
    truth, z = lasting_scene(correlation)
    model = SingerModel(5.0, 0.05, 0.003)
    warned = (
        pytest.warns(UserWarning, match="differ for long") if correlation > 0.5 else nullcontext()
    )
    with warned:
        plain = fuse_series(z, 0.01, model, period=360.0)
    found = fuse_series(z, 0.01, model, period=360.0, correlation_time=None)
    np.testing.assert_array_equal(found.mean, plain.mean)
    assert (found.correlation_time > 0).mean() == pytest.approx(float(correlation > 0), abs=0.25)
    error = (found.mean[..., 0] - truth + 180) % 360 - 180
    inside = np.mean((np.abs(error) < 1.96 * found.sigma[..., 0])[:, 20:])
    assert 0.9 < inside < 0.995
    if correlation == 0.9:
        assert np.mean((np.abs(error) < 1.96 * plain.sigma[..., 0])[:, 20:]) < 0.88
    given = fuse_series(z, 0.01, model, period=360.0, correlation_time=[30.0, 0.0])
    assert np.all(given.covariance[..., 0, 0] >= plain.covariance[..., 0, 0])
    np.testing.assert_array_equal(given.correlation_time, np.tile([30.0, 0.0], (20, 1)))
    assert found.systematic == "not included"


def test_covariance_intersection_grows_where_noise_lasts():
    """As the covariance of one radar does, because its covariance is as large as that of one."""
    _, z = lasting_scene(0.9)
    model = SingerModel(5.0, 0.05, 0.003)
    options = {"period": 360.0, "method": "covariance-intersection"}
    plain, found = (fuse_series(z, 0.01, model, correlation_time=c, **options) for c in (0, 50.0))
    one, lasting = (
        fuse_series(z[:, :1], 0.01, model, correlation_time=c, **options) for c in (0, 50.0)
    )
    grown, expected = found.upper[..., 20:, 0], lasting.upper[..., 20:, 0]
    np.testing.assert_allclose(
        grown / plain.upper[..., 20:, 0], expected / one.upper[..., 20:, 0], rtol=1e-3
    )
    assert np.all(grown > 1.2 * plain.upper[..., 20:, 0])


@pytest.mark.parametrize("wrong", [-1.0, [1.0, 2.0, 3.0], NAN])
def test_a_correlation_time_must_make_sense(wrong):
    with pytest.raises(ValueError, match="correlation_time"):
        fuse_series(np.zeros((2, 5)), 1.0, SingerModel(1.0, 0.1, 1.0), correlation_time=wrong)


@pytest.mark.parametrize("dt", [1e-4, 1e-5, 1e-8])
@pytest.mark.parametrize("method", ["matrix", "central"])
def test_tiny_steps(dt, method):
    """So short that nothing turns: the end of a straight line through all plots."""
    z = rng(7).normal(10.0, 0.1, (3, 200))
    found = fuse_series(z, 0.01, SingerModel(dt, 0.05, 0.1), method=method)
    assert np.isfinite(found.mean).all()
    # the rate is unknown at the first plot
    assert np.isfinite(found.covariance[1:]).all()
    sigma = np.sqrt(found.covariance[:, 0, 0])
    assert sigma[-1] == pytest.approx(2 * 0.1 / np.sqrt(600), rel=0.01)
    assert np.all(np.abs(found.mean[:, 0] - 10.0) < 5 * sigma)
