"""Positions of many instants, side by side with other ways to them, in one run.

Microseconds of CPU time an instant, the least of several rounds on one thread, and the ratio to
Tertia. The alternatives are `scipy.optimize.least_squares` in a loop, with an analytic Jacobian,
and Gauss-Newton with Huber's and Tukey's weights for a whole batch in NumPy, with what Tertia tells
besides: covariance, whitened residuals, their sum of squares and its probability. They start from
the median of the stations' own fixes. Results of least squares must agree to 1e-6 sigma, those of
Tukey's biweight to .01 in all but one in two hundred (the steps in NumPy are few), before they are
timed. Tertia takes the sigmas as stated, as the others do; "the default" also looks for systematic
errors.

Then times of arrival, with the emission as an unknown, against the same loop, which starts from the
middle of the receivers.
"""

from functools import partial

from timing import least, report

# isort: split
import numpy as np
from scipy.optimize import least_squares
from scipy.stats import chi2

from tertia.location import locate
from tertia.sensors import Bias

STATIONS = np.array([[1, 1000, 2], [2000, 300, 5], [400, 2600, 0], [2500, 2500, 30.0]])
SIGMAS = np.array([10.0, np.radians(0.3), np.radians(0.3)])
FAULTY = 0.05
COUNT = 10_000
LOOPED = 100
HUBER, TUKEY = 1.345, 4.685
ASYMPTOTIC = 0.963
# the sigmas as stated, which is what the others know
TRUSTED = Bias()


def predicted(p):
    """Ranges, azimuths and elevations, (..., 3, K), and their derivatives, (..., 3, K, 3)."""
    d = p[..., np.newaxis, :] - STATIONS
    east, north, up = np.moveaxis(d, -1, 0)
    flat = east**2 + north**2
    rho, squared = np.sqrt(flat), flat + up**2
    distance = np.sqrt(squared)
    zero = np.zeros_like(rho)
    values = np.stack([distance, np.arctan2(east, north), np.arctan2(up, rho)], axis=-2)
    tilt = -up / rho / squared
    slopes = [
        d / distance[..., np.newaxis],
        np.stack([north / flat, -east / flat, zero], axis=-1),
        np.stack([east * tilt, north * tilt, rho / squared], axis=-1),
    ]
    return values, np.stack(slopes, axis=-3)


def whitened(p, z):
    """Residuals, (..., 3 K), and derivatives of the predictions, (..., 3 K, 3)."""
    values, slopes = predicted(p)
    r = z - values
    r[..., 1, :] = np.remainder(r[..., 1, :] + np.pi, 2 * np.pi) - np.pi
    r = r / SIGMAS[:, np.newaxis]
    j = slopes / SIGMAS[:, np.newaxis, np.newaxis]
    return r.reshape(*r.shape[:-2], -1), j.reshape(*j.shape[:-3], -1, 3)


def start(z):
    """The median of the stations' own fixes."""
    r, a, e = np.moveaxis(z, -2, 0)
    level = r * np.cos(e)
    fixes = np.stack([level * np.sin(a), level * np.cos(a), r * np.sin(e)], axis=-1) + STATIONS
    return np.median(fixes, axis=-2)


def batched(z, robust):
    """Gauss-Newton in NumPy: ten steps, or eight of Huber's and twelve of Tukey's.

    Returns positions, covariances, residuals, chi-square and its probability.
    """
    p = start(z)
    for step in range(20 if robust else 10):
        r, j = whitened(p, z)
        w = weights(r, HUBER if robust and step < 8 else TUKEY if robust else None)
        a, b = normal(r, j, w)
        p = p + np.linalg.solve(a, b)[..., 0]
    r, j = whitened(p, z)
    a, _ = normal(r, j, weights(r, TUKEY if robust else None))
    covariance = (ASYMPTOTIC if robust else 1.0) * np.linalg.inv(a)
    total = np.sum(r**2, axis=-1)
    return p, covariance, r, total, chi2.sf(total, r.shape[-1] - 3)


def weights(r, constant):
    """Huber's, Tukey's or no weights of residuals."""
    if constant is None:
        return np.ones_like(r)
    if constant == HUBER:
        return np.minimum(1.0, HUBER / np.maximum(np.abs(r), 1e-300))
    return np.maximum(0.0, 1 - (r / TUKEY) ** 2) ** 2


def normal(r, j, w):
    """Return J' W J and J' W r."""
    weighted = np.swapaxes(j * w[..., np.newaxis], -1, -2)
    # where no measurement has a weight left
    return weighted @ j + 1e-12 * np.eye(3), weighted @ r[..., np.newaxis]


def looped(z, loss):
    """SciPy, one instant after the other."""
    first = start(z)

    def residual(p, one):
        return whitened(p, one)[0]

    def jacobian(p, one):
        return -whitened(p, one)[1]

    scale = 1.0 if loss == "linear" else HUBER
    return np.array(
        [
            least_squares(
                residual,
                x0,
                jacobian,
                args=(one,),
                loss=loss,
                f_scale=scale,
                xtol=1e-12,
                ftol=1e-12,
                gtol=1e-12,
                x_scale="jac",
            ).x
            for x0, one in zip(first, z, strict=True)
        ]
    )


def tertia(z, method, bias=TRUSTED):
    ranges, azimuths, elevations = np.moveaxis(z, -2, 0)
    s = SIGMAS
    return locate(
        STATIONS,
        range=ranges,
        azimuth=azimuths,
        elevation=elevations,
        range_sigma=s[0],
        azimuth_sigma=s[1],
        elevation_sigma=s[2],
        method=method,
        bias=bias,
        n_threads=1,
    )


def heard(count, receivers, late):
    """Receivers on a ring of 5 km and times of arrival in metres, some of them late."""
    rng = np.random.default_rng(2)
    turn = 2 * np.pi * np.arange(receivers) / receivers
    places = 5000 * np.stack([np.sin(turn), np.cos(turn)], axis=-1)
    target = rng.uniform(-2500, 2500, (count, 1, 2))
    noise = rng.standard_normal((count, receivers))
    noise += np.where(rng.uniform(size=noise.shape) < late, 30.0, 0.0)
    return places, np.linalg.norm(target - places, axis=-1) + 10.0 * noise


def arrivals(places, z, method):
    return locate(
        places,
        arrival_time=z,
        arrival_time_sigma=10.0,
        propagation_speed=1.0,
        method=method,
        bias=TRUSTED,
        n_threads=1,
    )


def arrivals_looped(places, z, loss):
    """SciPy, one instant after the other."""

    def residual(x, one):
        return (one - x[2] - np.linalg.norm(x[:2] - places, axis=1)) / 10.0

    def jacobian(x, one):
        d = x[:2] - places
        slope = d / np.linalg.norm(d, axis=1, keepdims=True)
        return -np.column_stack([slope, np.ones(len(places))]) / 10.0

    first = [1.0, 1.0, 0.0]
    scale = 1.0 if loss == "linear" else HUBER
    options = {"loss": loss, "f_scale": scale, "x_scale": "jac"}
    options |= {"xtol": 1e-12, "ftol": 1e-12, "gtol": 1e-12}
    return np.array(
        [least_squares(residual, first, jacobian, args=(one,), **options).x[:2] for one in z]
    )


def time_arrivals():
    for receivers in (5, 32):
        for late in (0.0, FAULTY):
            places, z = heard(10_000, receivers, late)
            for method, loss in (("least-squares", "linear"), ("robust", "huber")):
                few = z[:LOOPED]
                if method == "least-squares":
                    agree(
                        arrivals(places, few, method), arrivals_looped(places, few, loss), 1e-4, 0
                    )
                problems = {
                    "Tertia": (partial(arrivals, places, z, method), len(z)),
                    "SciPy, loop": (partial(arrivals_looped, places, few, loss), LOOPED),
                }
                title = f"locate, {receivers} times of arrival, {method}, {late:.0%} late"
                report(title, least(problems), "µs")


def measurements(count, faulty):
    rng = np.random.default_rng(1)
    targets = rng.uniform([0, 0, 200], [3000, 3000, 1500], (count, 3))
    noise = rng.normal(size=(count, 3, 4))
    noise += np.where(rng.uniform(size=noise.shape) < faulty, 30.0, 0.0)
    return predicted(targets)[0] + SIGMAS[:, np.newaxis] * noise


def agree(found, p, tolerance, share):
    error = np.linalg.solve(np.linalg.cholesky(found.covariance), (found.position - p)[..., None])
    distance = np.linalg.norm(error[..., 0], axis=-1)
    assert np.mean(~(distance < tolerance)) <= share, np.sort(distance)[-20:]


def main():
    few = measurements(LOOPED, 0.0)
    agree(tertia(few, "least-squares"), looped(few, "linear"), 1e-6, 0.0)
    agree(tertia(few, "least-squares"), batched(few, robust=False)[0], 1e-6, 0.0)
    many = measurements(1_000, 0.0)
    agree(tertia(many, "robust"), batched(many, robust=True)[0], 0.01, 0.005)
    for faulty in (0.0, FAULTY):
        z = measurements(COUNT, faulty)
        for method, loss in (("least-squares", "linear"), ("robust", "huber")):
            problems = {
                "Tertia": (partial(tertia, z, method), COUNT),
                "Tertia, the default": (partial(tertia, z, method, None), COUNT),
                "NumPy, all at once": (partial(batched, z, method == "robust"), COUNT),
                "SciPy, loop": (partial(looped, z[:LOOPED], loss), LOOPED),
            }
            title = f"locate, 4 stations in space, {method}, {faulty:.0%} faults, an instant"
            report(title, least(problems), "µs")
    time_arrivals()


if __name__ == "__main__":
    main()
