"""Smoothing side by side with other libraries, in one run.

Nanoseconds of CPU time per instant, the least of several rounds on one thread, and the ratio to
Tertia. Local polynomials of one degree beside SciPy's `savgol_filter`, which returns no standard
errors; the smoother of constant acceleration and white jerk beside filterpy and statsmodels, which
start from a wide prior. Everything must agree before it is timed. What is not installed is left
out.
"""

from functools import partial

from timing import least, optional, report

# isort: split
import numpy as np
from scipy.signal import savgol_filter

from tertia.kalman import SingerModel, smooth_series
from tertia.smoothing import local_polynomial, smooth

filterpy = optional("filterpy.kalman")
statsmodels = optional("statsmodels.tsa.statespace.kalman_smoother")

WINDOW, JERK = 13, 1e-3
FEW = 2_000
F = np.array([[1, 1, 0.5], [0, 1, 1], [0, 0, 1]])
Q = JERK * np.array([[1 / 20, 1 / 8, 1 / 6], [1 / 8, 1 / 3, 1 / 2], [1 / 6, 1 / 2, 1]])
WIDE = 1e8


def series(n):
    rng = np.random.default_rng(1)
    return 10.0 * np.sin(np.arange(n) / 50) + rng.standard_normal(n)


def tertia_track(y):
    """The noise taken as stated, as the others do."""
    result = smooth(
        y[:, np.newaxis], 1.0, correlation_time=0.0, robust=False, jerk=JERK, n_threads=1
    )
    return result.mean, result.covariance


def tertia_robust(y):
    return smooth(y[:, np.newaxis], 1.0, jerk=JERK, n_threads=1)


def filterpy_track(y):
    track = filterpy.KalmanFilter(dim_x=3, dim_z=1)
    track.F, track.Q, track.H, track.R = F, Q, np.array([[1.0, 0, 0]]), np.eye(1)
    track.P = WIDE * np.eye(3)
    track.update(y[0])
    means, covariances = [track.x.copy()], [track.P.copy()]
    for plot in y[1:]:
        track.predict()
        track.update(plot)
        means.append(track.x.copy())
        covariances.append(track.P.copy())
    mean, covariance, *_ = track.rts_smoother(np.array(means), np.array(covariances))
    return mean[..., 0], covariance


def statsmodels_track(y):
    model = statsmodels.KalmanSmoother(k_endog=1, k_states=3)
    model.bind(np.asfortranarray(y[:, np.newaxis]))
    model["design"], model["obs_cov"] = np.array([[1.0, 0, 0]]), np.eye(1)
    model["transition"], model["selection"], model["state_cov"] = F, np.eye(3), Q
    model.initialize_known(np.zeros(3), WIDE * np.eye(3))
    result = model.smooth()
    return result.smoothed_state.T, np.moveaxis(result.smoothed_state_cov, -1, 0)


def require_agreement(name, found, expected, tolerance):
    off = np.max(np.abs(found - expected)) / np.max(np.abs(expected))
    if not off <= tolerance:
        raise SystemExit(f"{name} is off by {off:.1e}")


def polynomials(n):
    y = series(n)
    for derivative, degree in ((0, 2), (0, 3), (1, 2)):

        def own(y, degree=degree, derivative=derivative):
            return local_polynomial(y, WINDOW, degree, derivative=derivative, n_threads=1).value

        def other(y, degree=degree, derivative=derivative):
            return savgol_filter(y, WINDOW, degree, deriv=derivative, mode="interp")

        require_agreement("savgol_filter", other(y), own(y), 1e-12)
        problems = {
            "Tertia": (partial(own, y), n),
            "savgol_filter, no sigma": (partial(other, y), n),
        }
        title = f"local polynomial, {n:,} instants, degree {degree}, derivative {derivative}"
        report(title, least(problems))
    uneven = np.arange(n) + 0.3 * np.sin(np.arange(n))
    problems = {
        "Tertia": (lambda: local_polynomial(y, WINDOW, n_threads=1), n),
        "Tertia, irregular times": (
            lambda: local_polynomial(y, WINDOW, time=uneven, n_threads=1),
            n,
        ),
    }
    report(f"local polynomial, {n:,} instants, adaptive degree", least(problems))


def tracks():
    y = series(10_000)
    problems = {"Tertia": (partial(tertia_track, y), len(y))}
    problems["Tertia, the default, robust"] = (partial(tertia_robust, y), len(y))
    mean, covariance = tertia_track(y[:FEW])
    for name, module, function in [
        ("filterpy", filterpy, filterpy_track),
        ("statsmodels", statsmodels, statsmodels_track),
    ]:
        if module:
            found = function(y[:FEW])
            middle = slice(100, -100)
            require_agreement(name, found[0][middle], mean[middle], 1e-6)
            require_agreement(name, found[1][middle], covariance[middle], 1e-6)
            problems[name] = (partial(function, y[:FEW]), FEW)
    report("smooth, one axis, 10,000 instants, an instant", least(problems))


def angles():
    """One series of angles with the variance of each plot, and one in twenty missing."""
    z = series(10_000)
    z[7::20] = np.nan
    variance = 1.0 + 1e-3 * (np.arange(len(z)) % 7)
    model = SingerModel(5.0, 1 / 20, 0.003)
    call = partial(smooth_series, z, variance, model, n_threads=1)
    report("smooth_series, 10,000 plots, a step", least({"Tertia": (call, len(z))}))


def main():
    polynomials(100_000)
    tracks()
    angles()


if __name__ == "__main__":
    main()
