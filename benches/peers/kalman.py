"""The filter of angle, rate and acceleration, side by side with other filters, in one run.

Nanoseconds of CPU time per step of a track, the least of several rounds on one thread, and the
ratio to Tertia: with the final state alone, and with means and covariances of all steps, to which
Tertia adds innovations, their variances and the likelihood. Everything must agree to 1e-9 standard
deviations before it is timed. Those that take microseconds a step get fewer steps. What is not
installed is left out; compilation is not timed. All tracks start from one state, and the other
filters get equal noise and no gaps, so "one gain for all" is possible; it is not where plots are
missing. Where the noise of each plot is given and plots are missing, numba does the same
work. Nothing is there to compare with fusion.
"""

import importlib
from datetime import datetime, timedelta
from functools import partial

from timing import least, optional, report

# isort: split
import numpy as np

from tertia.fusion import fuse_series
from tertia.kalman import AngleFilter, SingerModel, filter_series

numba = optional("numba")
filterpy = optional("filterpy.kalman")
jax = optional("jax")
pykalman = optional("pykalman")
simdkalman = optional("simdkalman")
statsmodels = optional("statsmodels.tsa.statespace.kalman_filter")
stonesoup = optional("stonesoup")

MODEL = SingerModel(5.0, 1 / 20, 0.003)
F, Q, H, R = MODEL.transition(), MODEL.process_noise(), np.array([[1.0, 0.0, 0.0]]), 0.01
PRIOR = (np.zeros(3), np.diag([1.0, 0.01, 0.003**2]))
ROWS, COLUMNS = np.triu_indices(3)
# as plain numbers: the first state, F without its zeros and ones, Q
STATE = (*PRIOR[0].tolist(), *PRIOR[1][ROWS, COLUMNS].tolist())
FACTORS = tuple(F[[0, 0, 1, 2], [1, 2, 2, 2]].tolist())
NOISE = tuple(Q[ROWS, COLUMNS].tolist())

SHAPES = [(1, 10_000), (1_000, 200), (20_000, 50)]
TOLERANCE = 1e-9
# steps for what takes microseconds or more
FEW, FEWER = 4_000, 1_000


jitable = numba.extending.register_jitable if numba else lambda function: function


def tertia_final(z, r=R):
    result = filter_series(z, r, MODEL, initial=PRIOR, store="final", n_threads=1)
    return result.mean, result.upper


def tertia_all(z, r=R):
    result = filter_series(z, r, MODEL, initial=PRIOR, store="all", n_threads=1)
    return result.mean, result.upper


@jitable
def predicted(state, factors, noise):
    """F x and F P F' + Q, of numbers or arrays."""
    x0, x1, x2, p00, p01, p02, p11, p12, p22 = state
    f01, f02, f12, f22 = factors
    a00 = p00 + f01 * p01 + f02 * p02
    a01 = p01 + f01 * p11 + f02 * p12
    a02 = p02 + f01 * p12 + f02 * p22
    a11 = p11 + f12 * p12
    a12 = p12 + f12 * p22
    return (
        x0 + f01 * x1 + f02 * x2,
        x1 + f12 * x2,
        f22 * x2,
        a00 + f01 * a01 + f02 * a02 + noise[0],
        a01 + f12 * a02 + noise[1],
        f22 * a02 + noise[2],
        a11 + f12 * a12 + noise[3],
        f22 * a12 + noise[4],
        f22 * f22 * p22 + noise[5],
    )


@jitable
def updated(state, z, r):
    """X + K (z - x0) and (I - K h') P, likewise."""
    x0, x1, x2, p00, p01, p02, p11, p12, p22 = state
    s = 1.0 / (p00 + r)
    k0, k1, k2, kept = p00 * s, p01 * s, p02 * s, r * s
    new = z - x0
    return (
        x0 + k0 * new,
        x1 + k1 * new,
        x2 + k2 * new,
        p00 * kept,
        p01 * kept,
        p02 * kept,
        p11 - p01 * k1,
        p12 - p01 * k2,
        p22 - p02 * k2,
    )


def tracks(z, r, store):
    """A loop over numbers, for numba: `store` says whether all steps are kept."""
    state = STATE
    mean = np.empty((z.shape[0], z.shape[1] if store else 1, 3))
    upper = np.empty((z.shape[0], z.shape[1] if store else 1, 6))
    for i in range(z.shape[0]):
        state = STATE
        for j in range(z.shape[1]):
            if j > 0:
                state = predicted(state, FACTORS, NOISE)
            if not np.isnan(z[i, j]):
                state = updated(state, z[i, j], r[i, j])
            at = j if store else 0
            mean[i, at, 0], mean[i, at, 1], mean[i, at, 2] = state[:3]
            for c in range(6):
                upper[i, at, c] = state[3 + c]
    return mean, upper


if numba:
    compiled = numba.njit(tracks)


def numba_final(z, r=None):
    mean, upper = numba_all(z, r, False)
    return mean[:, 0], upper[:, 0]


def numba_all(z, r=None, store=True):
    return compiled(z, np.broadcast_to(R, z.shape) if r is None else r, store)


def numpy_shared_final(z):
    """All tracks at once, and their covariance as numbers, because it is the same."""
    state = updated(STATE, z[:, 0], R)
    for plots in z.T[1:]:
        state = updated(predicted(state, FACTORS, NOISE), plots, R)
    return np.stack(state[:3], axis=-1), np.tile(state[3:], (len(z), 1))


def numpy_shared_all(z):
    mean, upper = np.empty((*z.shape, 3)), np.empty((*z.shape, 6))
    state = updated(STATE, z[:, 0], R)
    for j, plots in enumerate(z.T):
        if j > 0:
            state = updated(predicted(state, FACTORS, NOISE), plots, R)
        for c in range(3):
            mean[:, j, c] = state[c]
        upper[:, j] = state[3:]
    return mean, upper


def numpy_steps(z):
    """All tracks at once, each with its matrix, as textbooks print it."""
    x, p = (np.broadcast_to(a, (len(z), *a.shape)) for a in PRIOR)
    for j, plots in enumerate(z.T):
        if j > 0:
            x, p = x @ F.T, F @ p @ F.T + Q
        k = p[:, :, 0] / (p[:, :1, 0] + R)
        x = x + k * (plots - x[:, 0])[:, np.newaxis]
        p = p - k[:, :, np.newaxis] * p[:, :1, :]
        yield x, p


def numpy_final(z):
    *_, last = numpy_steps(z)
    return last


def numpy_all(z):
    mean, covariance = np.empty((*z.shape, 3)), np.empty((*z.shape, 3, 3))
    for j, (x, p) in enumerate(numpy_steps(z)):
        mean[:, j], covariance[:, j] = x, p
    return mean, covariance


def filterpy_filter():
    track = filterpy.KalmanFilter(dim_x=3, dim_z=1)
    track.x, track.P = PRIOR[0][:, np.newaxis].copy(), PRIOR[1].copy()
    track.F, track.H, track.Q, track.R = F, H, Q, np.array([[R]])
    return track


def filterpy_final(z):
    results = []
    for plots in z:
        track = filterpy_filter()
        track.update(plots[0])
        for plot in plots[1:]:
            track.predict()
            track.update(plot)
        results.append((track.x[:, 0], track.P))
    return stacked(results)


def filterpy_all(z):
    results = [filterpy_filter().batch_filter(plots, update_first=True) for plots in z]
    return stacked((mean[..., 0], covariance) for mean, covariance, *_ in results)


def stacked(results):
    means, covariances = zip(*results, strict=True)
    return np.array(means), np.array(covariances)


def simdkalman_all(z):
    model = simdkalman.KalmanFilter(F, Q, H, R)
    states = model.compute(
        z, 0, *PRIOR, smoothed=False, filtered=True, observations=False
    ).filtered.states
    return states.mean, states.cov


def pykalman_all(z):
    model = pykalman.KalmanFilter(F, H, Q, [[R]], None, None, *PRIOR)
    return stacked(model.filter(plots) for plots in z)


def statsmodels_filter():
    # with its own tolerance the gain is kept fixed too early, at the cost of 5e-8
    model = statsmodels.KalmanFilter(k_endog=1, k_states=3, k_posdef=3, tolerance=0)
    model["transition"], model["design"] = F, H
    model["state_cov"], model["obs_cov"], model["selection"] = Q, [[R]], np.eye(3)
    model.initialize_known(*PRIOR)
    return model


def statsmodels_all(z):
    results = []
    for plots in z:
        # a model that is bound to other plots would return the results of the first ones
        model = statsmodels_filter()
        model.bind(plots)
        result = model.filter()
        results.append((result.filtered_state.T, np.moveaxis(result.filtered_state_cov, 2, 0)))
    return stacked(results)


def stonesoup_steps(z):
    """Every step's state, track after track."""
    motion = stonesoup_classes["LinearGaussianTimeInvariantTransitionModel"](
        transition_matrix=F, covariance_matrix=Q
    )
    sensor = stonesoup_classes["LinearGaussian"](
        ndim_state=3, mapping=[0], noise_covar=np.array([[R]])
    )
    predictor = stonesoup_classes["KalmanPredictor"](motion)
    updater = stonesoup_classes["KalmanUpdater"](sensor)
    start, step = datetime(2024, 1, 1), timedelta(seconds=MODEL.dt)
    for plots in z:
        state = stonesoup_classes["GaussianStatePrediction"](*PRIOR, timestamp=start)
        for j, plot in enumerate(plots):
            time_of_plot = start + j * step
            detection = stonesoup_classes["Detection"]([plot], timestamp=time_of_plot)
            if j > 0:
                state = predictor.predict(state, timestamp=time_of_plot)
            state = updater.update(stonesoup_classes["SingleHypothesis"](state, detection))
            yield state


def stonesoup_all(z):
    states = [(state.mean[:, 0], state.covar) for state in stonesoup_steps(z)]
    mean, covariance = stacked(states)
    return mean.reshape(*z.shape, 3), covariance.reshape(*z.shape, 3, 3)


if stonesoup is not None:
    STONESOUP = {
        "models.transition.linear": "LinearGaussianTimeInvariantTransitionModel",
        "models.measurement.linear": "LinearGaussian",
        "predictor.kalman": "KalmanPredictor",
        "updater.kalman": "KalmanUpdater",
        "types.prediction": "GaussianStatePrediction",
        "types.detection": "Detection",
        "types.hypothesis": "SingleHypothesis",
    }
    stonesoup_classes = {
        name: getattr(importlib.import_module(f"stonesoup.{module}"), name)
        for module, name in STONESOUP.items()
    }

if jax is not None:
    jax.config.update("jax_enable_x64", True)
    jnp = jax.numpy

    def _jax_final(first, plots):
        def step(state, plot):
            return updated(predicted(state, FACTORS, NOISE), plot, R), None

        state, _ = jax.lax.scan(step, updated(first, plots[0], R), plots[1:])
        return jnp.stack(state[:3]), jnp.stack(state[3:])

    def _jax_all(first, plots):
        def step(state, plot):
            state = updated(state, plot, R)
            return predicted(state, FACTORS, NOISE), (jnp.stack(state[:3]), jnp.stack(state[3:]))

        return jax.lax.scan(step, first, plots)[1]

    JAX_FINAL, JAX_ALL = (jax.jit(jax.vmap(f)) for f in (_jax_final, _jax_all))
    # with one state to start from, JAX computes one covariance for all tracks
    JAX_SHARED_FINAL, JAX_SHARED_ALL = (
        jax.jit(jax.vmap(f, in_axes=(None, 0))) for f in (_jax_final, _jax_all)
    )

    def jax_final(z):
        first = tuple(np.full(len(z), number) for number in STATE)
        return jax.block_until_ready(JAX_FINAL(first, z))

    def jax_all(z):
        first = tuple(np.full(len(z), number) for number in STATE)
        return jax.block_until_ready(JAX_ALL(first, z))

    def jax_shared_final(z):
        return jax.block_until_ready(JAX_SHARED_FINAL(STATE, z))

    def jax_shared_all(z):
        return jax.block_until_ready(JAX_SHARED_ALL(STATE, z))


def alternatives():
    """Name, functions for the final state and for everything, and the steps they can be given."""
    if numba:
        yield "numba, scalar loop", numba_final, numba_all, None
    yield "NumPy, loop over steps", numpy_final, numpy_all, None
    yield "NumPy, one gain for all", numpy_shared_final, numpy_shared_all, None
    if jax:
        yield "JAX jit(vmap(scan))", jax_final, jax_all, None
        yield "JAX, one gain for all", jax_shared_final, jax_shared_all, None
    if simdkalman:
        yield "simdkalman", None, simdkalman_all, None
    if statsmodels:
        yield "statsmodels", None, statsmodels_all, FEW
    if filterpy:
        yield "filterpy", filterpy_final, filterpy_all, FEW
    if pykalman:
        yield "pykalman", None, pykalman_all, FEW
    if stonesoup:
        yield "Stone Soup", None, stonesoup_all, FEWER


def simulate(shape, gaps=0.0):
    rng = np.random.default_rng(1)
    phase = 2 * np.pi * rng.random((*shape[:-1], 1))
    angle = 10.0 * np.sin(np.arange(shape[-1]) / 50 + phase)
    z = angle + R**0.5 * rng.standard_normal(shape)
    z[rng.random(shape) < gaps] = np.nan
    return z


def fewer(z, most):
    if most is None or z.size <= most:
        return z
    return z[:, :most] if len(z) == 1 else z[: max(1, most // z.shape[1])]


def require_agreement(name, function, reference, z):
    """Compare means and covariances, in standard deviations."""
    (mean, upper), (own_mean, own_upper) = function(z), reference(z)
    mean, upper = np.asarray(mean), np.asarray(upper)
    if upper.shape[-2:] == (3, 3):
        upper = upper[..., ROWS, COLUMNS]
    if (mean.shape, upper.shape) != (own_mean.shape, own_upper.shape):
        raise SystemExit(f"{name} returns shapes {mean.shape} and {upper.shape}")
    sigma = np.sqrt(own_upper[..., [0, 3, 5]])
    scale = sigma[..., ROWS] * sigma[..., COLUMNS]
    off = max(np.max(abs(mean - own_mean) / sigma), np.max(abs(upper - own_upper) / scale))
    if not off <= TOLERANCE:
        raise SystemExit(f"{name} is off by {off:.1e} for {z.shape}")


def ones(z):
    """Write as many numbers as Tertia returns for every step."""
    np.ones((*z.shape, 11))


def compare(shape):
    size = " × ".join(f"{n:,}" for n in shape)
    for what, own, every in [
        ("final state", tertia_final, False),
        ("all states", tertia_all, True),
    ]:
        compare_equal(f"filter, {size}, equal noise, {what}, a step", shape, own, every)
        compare_own(f"filter, {size}, R of each plot and gaps, {what}, a step", shape, own, every)


def compare_equal(title, shape, own, every):
    z = simulate(shape)
    problems = {"Tertia": (partial(own, z), z.size)}
    for name, final, stored, most in alternatives():
        function = stored if every else final
        if function:
            plots = fewer(z, most)
            require_agreement(name, function, own, plots)
            problems[name] = (partial(function, plots), plots.size)
    if every:
        problems["(np.ones: one write)"] = (partial(ones, z), z.size)
    report(title, least(problems))


def compare_own(title, shape, own, every):
    """One plot in twenty missing, and a variance of each."""
    z = simulate(shape, gaps=0.05)
    r = R * (1 + 0.5 * np.random.default_rng(2).random(shape))
    problems = {"Tertia": (partial(own, z, r), z.size)}
    if numba:
        function = numba_all if every else numba_final
        require_agreement("numba", lambda z: function(z, r), lambda z: own(z, r), z)
        problems["numba, scalar loop"] = (partial(function, z, r), z.size)
    report(title, least(problems))


def streaming():
    """One step of an object, in a loop of Python."""
    z = simulate((1_000,))
    problems = {}

    def step_tertia(plots):
        track = AngleFilter(MODEL, R)
        track.set_state(*PRIOR)
        track.update(plots[0])
        for plot in plots[1:].tolist():
            track.step(plot)
        return track.mean, track.covariance

    def step_filterpy(plots):
        mean, covariance = filterpy_final(plots[np.newaxis])
        return mean[0], covariance[0]

    require_agreement("AngleFilter", step_tertia, tertia_final, z)
    problems["Tertia"] = (partial(step_tertia, z), z.size)
    if filterpy:
        require_agreement("filterpy", step_filterpy, tertia_final, z)
        problems["filterpy"] = (partial(step_filterpy, z), z.size)
    if stonesoup:
        problems["Stone Soup"] = (lambda: list(stonesoup_steps(z[np.newaxis])), z.size)
    report("a filter that is fed plot by plot, a step", least(problems))


def fusion():
    shapes = {2: (2, 2_000), 3: (3, 2_000), 8: (8, 2_000), 10: (10, 2_000)}
    for radars, shape in shapes.items():
        call = partial(fuse_series, simulate(shape), R, MODEL, n_threads=1)
        title = f"fuse_series, robust, {radars} radars, a plot"
        report(title, least({"Tertia": (call, radars * 2_000)}))


def main():
    for shape in SHAPES:
        compare(shape)
    streaming()
    fusion()


if __name__ == "__main__":
    main()
