"""Whether the error bars of fused and smoothed estimates hold."""

from collections.abc import Callable

import numpy as np

from studies.honesty import BoolArray, Draw, FloatArray, coverage_table
from studies.montecarlo import WITHIN_95, autoregressive, generator
from studies.pages import markdown, repetitions
from tertia.fusion import fuse, fuse_scalar, fuse_series
from tertia.kalman import SingerModel, filter_series, smooth_series
from tertia.smoothing import SmoothedPositions, local_polynomial, smooth

RUNS, STEPS, SENSORS = 40, 100, 4
MODEL = SingerModel(5.0, 1 / 20, 0.03, exact=True)
WHITE_JERK = 0.01


def within(error: FloatArray, sigma: FloatArray) -> BoolArray:
    """Return whether the truth is in the 95 % interval."""
    return np.asarray(np.abs(error) < np.sqrt(WITHIN_95[1]) * sigma)


def manoeuvre(runs: int, rng: np.random.Generator) -> FloatArray:
    """Return angles (runs, steps) of a target with the model's accelerations."""
    steps, dt = 10, MODEL.dt / 10
    keep = np.exp(-MODEL.alpha * dt)
    x, v = np.zeros(runs), 0.5 * rng.standard_normal(runs)
    a = MODEL.acceleration_sigma * rng.standard_normal(runs)
    angles = []
    for _ in range(STEPS):
        angles.append(x)
        for _ in range(steps):
            x = x + v * dt + a * dt**2 / 2
            v = v + a * dt
            new = MODEL.acceleration_sigma * rng.standard_normal(runs)
            a = keep * a + np.sqrt(1 - keep**2) * new
    return np.stack(angles, axis=-1)


def path(runs: int, rng: np.random.Generator) -> FloatArray:
    """Return positions (runs, steps, 2) of a target with white jerk, in units of the noise."""
    root = np.linalg.cholesky([[1 / 20, 1 / 8, 1 / 6], [1 / 8, 1 / 3, 1 / 2], [1 / 6, 1 / 2, 1]])
    f = np.array([[1, 1, 0.5], [0, 1, 1], [0, 0, 1]])
    x = rng.standard_normal((runs, 3, 2))
    positions = []
    for _ in range(STEPS):
        positions.append(x[:, 0])
        x = f @ x + np.sqrt(WHITE_JERK) * root @ rng.standard_normal(x.shape)
    return np.stack(positions, axis=1)


def constant_errors() -> str:
    """Tabulate fused series of three radars whose errors last, with and without `bias_sigma`."""
    runs, sigma, size = repetitions(400), 0.1, 0.3
    rows = []
    for name, prior, asked in (
        ("no errors", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ("no errors, but `bias_sigma` stated", (0.0, 0.0, 0.0), (0.0, size, size)),
        ("none trusted", (size, size, size), (0.0, 0.0, 0.0)),
        ("", (size, size, size), (size, size, size)),
        ("first trusted", (0.0, size, size), (0.0, 0.0, 0.0)),
        ("", (0.0, size, size), (0.0, size, size)),
        ("first trusted, others unknown", (0.0, size, size), (0.0, np.inf, np.inf)),
    ):
        rng = generator(61)
        truth = manoeuvre(runs, rng)[:, np.newaxis]
        bias = rng.standard_normal((runs, 3)) * prior
        plots = truth + bias[..., np.newaxis] + sigma * rng.standard_normal((runs, 3, STEPS))
        wrong = plots + (rng.random(plots.shape) < 0.05) * rng.normal(0.0, 2.0, plots.shape)
        cells = [name, ", ".join(f"{s:g}" for s in asked)]
        for z in (plots, wrong):
            found = fuse_series(z, sigma**2, MODEL, bias_sigma=asked)
            error = (found.mean[:, 5:, 0] - truth[:, 0, 5:]) / found.sigma[:, 5:, 0]
            off = (found.bias - bias)[:, np.array(asked) > 0]
            claimed = found.bias_sigma[:, np.array(asked) > 0]
            rmse = np.sqrt(np.mean((error * found.sigma[:, 5:, 0]) ** 2))
            inside = 100 * np.mean(np.abs(error) < np.sqrt(WITHIN_95[1]))
            cells += [f"{rmse:.3f}°", f"{np.mean(error**2):.2f}", f"{inside:.0f}%"]
            cells.append(f"{np.sqrt(np.mean((off / claimed) ** 2)):.2f}" if off.size else "")
        rows.append(cells)
    of_each = ["RMSE", "NEES", "within 95 %", "error of bias, σ"]
    return markdown(
        ["errors", "`bias_sigma`", *of_each, *(f"{name}, outliers" for name in of_each)], rows
    )


def of_means(**options: object) -> Callable[[Draw], BoolArray]:
    """Return the coverage of the fused means of 50 measurements by each of four sensors."""

    def inside(draw: Draw) -> BoolArray:
        errors = draw((repetitions(10 * RUNS), SENSORS, 50)).mean(axis=-1)
        covariances = np.full((SENSORS, 1, 1), 1 / 50)
        found = fuse(errors[..., np.newaxis], covariances, **options)  # type: ignore[arg-type]
        return within(found.mean, found.sigma)

    return inside


def of_scatter(count: int) -> Callable[[Draw], BoolArray]:
    """Return the coverage of two sensors' fused means where sigmas are from their scatter."""

    def inside(draw: Draw) -> BoolArray:
        x = draw((repetitions(4 * RUNS), 2, count))
        variance = x.var(axis=-1, ddof=1)[..., np.newaxis, np.newaxis] / count
        found = fuse(x.mean(axis=-1)[..., np.newaxis], variance, n=count)
        return np.asarray(np.abs(found.mean) < 1.96 * found.sigma)

    return inside


def of_scalar(draw: Draw) -> BoolArray:
    """Return the coverage of an estimate with a scalar added, both means of 50."""
    errors = draw((repetitions(10 * RUNS), 2, 50)).mean(axis=-1)
    found = fuse_scalar(errors[:, :1], [[1 / 50]], [1.0], errors[:, 1], np.sqrt(1 / 50))
    return within(found.mean, found.sigma)


def of_series(**options: object) -> Callable[[Draw], BoolArray]:
    """Return the coverage of a track fused of two radars."""

    def inside(draw: Draw) -> BoolArray:
        truth = manoeuvre(repetitions(RUNS), draw.rng)
        z = truth[:, np.newaxis] + draw((len(truth), 2, STEPS))
        found = fuse_series(z, 1.0, MODEL, **options)  # type: ignore[arg-type]
        return within(found.mean[..., 0] - truth, found.sigma[..., 0])[:, 5:]

    return inside


def of_filter(draw: Draw) -> BoolArray:
    """Return the coverage of the filter of one radar."""
    truth = manoeuvre(repetitions(RUNS), draw.rng)
    found = filter_series(truth + draw((len(truth), 1, STEPS))[:, 0], 1.0, MODEL)
    return within(found.mean[..., 0] - truth, found.sigma[..., 0])[:, 5:]


def of_smoother(draw: Draw) -> BoolArray:
    """Return the coverage of the smoother of one radar."""
    truth = manoeuvre(repetitions(RUNS), draw.rng)
    found = smooth_series(truth + draw((len(truth), 1, STEPS))[:, 0], 1.0, MODEL)
    return within(found.mean[..., 0] - truth, found.sigma[..., 0])


def of_path(**options: object) -> Callable[[Draw], BoolArray]:
    """Return the coverage of smoothed positions."""

    def inside(draw: Draw) -> BoolArray:
        truth = path(repetitions(RUNS), draw.rng)
        y = truth + np.swapaxes(draw((len(truth), 2, STEPS)), -1, -2)
        return held(smooth(y, 1.0, **options), truth)  # type: ignore[arg-type]

    return inside


def held(found: SmoothedPositions, truth: FloatArray) -> BoolArray:
    """Return whether the 95 % ellipses hold the truth."""
    return np.asarray(squares(found, truth) < WITHIN_95[2])


def squares(found: SmoothedPositions, truth: FloatArray) -> FloatArray:
    """Return the normalised squared errors of the positions."""
    error = (found.position - truth)[..., np.newaxis]
    solved = np.linalg.solve(found.position_covariance, error)
    return np.asarray((np.swapaxes(error, -1, -2) @ solved)[..., 0, 0])


def of_polynomial(draw: Draw) -> BoolArray:
    """Return the coverage of polynomials of degree 2, the variance estimated."""
    truth = path(repetitions(RUNS), draw.rng)[..., 0]
    found = local_polynomial(truth + draw((len(truth), 1, STEPS))[:, 0], 13, 2)
    return within(found.value - truth, found.sigma)


def coverage() -> str:
    """Return the coverage of fused and smoothed estimates."""
    return coverage_table(
        {
            "`fuse`, means of 50 by 4 sensors": of_means(),
            "the same, `bias_sigma=None`": of_means(bias_sigma=None),
            "`fuse_scalar`, means of 50": of_scalar,
            "`fuse(n=5)`, `tertia weights`": of_scatter(5),
            "`fuse_series`, 2 radars": of_series(),
            "the same, `correlation_time=None`": of_series(correlation_time=None),
            "`filter_series`": of_filter,
            "`smooth_series`": of_smoother,
            "`smooth`": of_path(),
            "the same, noise as stated": of_path(correlation_time=0.0, robust=False),
            "`local_polynomial`, degree 2": of_polynomial,
        },
        91,
    )


def effects() -> str:
    """Return the coverage of two sigmas where K sensors have systematic errors."""
    rows = []
    for sensors in (2, 3, 5, 10):
        for name, options in {"as stated": {}, "`bias_sigma=None`": {"bias_sigma": None}}.items():
            cells = []
            for size in (0.0, 1.0, 3.0, 9.0):
                rng = generator(92, sensors, int(size))
                shape = (repetitions(2000), sensors, 2)
                x = rng.standard_normal(shape) + size * rng.standard_normal(shape)
                s = np.broadcast_to(np.eye(2), (sensors, 2, 2))
                found = fuse(x, s, **options)  # type: ignore[arg-type]
                inside = np.abs(found.mean) < 2 * found.sigma
                width = np.median(found.sigma) * np.sqrt(sensors)
                cells.append(f"{np.mean(inside):.0%}; {width:.2f}")
            rows.append([str(sensors), name, *cells])
    head = ["K", "within two sigma; sigma √K", "τ/σ = 0", "1", "3", "9"]
    return markdown(head, rows)


def few() -> str:
    """Return the coverage of two sigmas where covariances are from n measurements."""
    rows = []
    cases = {
        "1 sensor": (1, 1, 1.0),
        "2 sensors": (2, 1, 1.0),
        "2 sensors, one 5 times as good": (2, 1, 5.0),
    }
    cases |= {
        "4 sensors, up to 3 times as good": (4, 1, 3.0),
        "2 sensors, in two dimensions": (2, 2, 2.0),
    }
    for name, (sensors, m, ratio) in cases.items():
        cells = []
        for n in (3, 5, 10, 30):
            rng = generator(93, sensors, m, int(ratio), n)
            sigma = np.geomspace(1, ratio, sensors)[:, np.newaxis, np.newaxis]
            x = sigma * rng.standard_normal((repetitions(200), sensors, n, m))
            away = x - x.mean(axis=-2, keepdims=True)
            s = np.swapaxes(away, -1, -2) @ away / (n * (n - 1))
            shares = []
            for options in ({}, {"n": n}):
                found = fuse(x.mean(axis=-2), s, **options)  # type: ignore[arg-type]
                shares.append(np.mean(np.abs(found.mean) < 2 * found.sigma))
            cells.append(f"{shares[0]:.0%}, **{shares[1]:.1%}**")
        rows.append([name, *cells])
    return markdown(["covariances treated as known, **with `n=`**", "n = 3", "5", "10", "30"], rows)


def noise() -> str:
    """Return RMSE, NEES and coverage of smoothed positions by how the noise is."""
    rows = []
    cases = ("white", "AR(.5)", "AR(.9)", "sigma × ½", "sigma × 2", "10 % outliers")
    moves = ("jump by 30 σ", "stay of 4 by 30 σ", "wanders by 3 σ")
    for case in (*cases, "30 % outliers", "run of 6 by 30 σ", *moves):
        rng = generator(94, sum(case.encode()))
        truth = path(repetitions(RUNS), rng)
        is_run = case.startswith("run")
        draw = Draw("white" if is_run or case in moves else case, rng)
        if case.startswith("jump"):
            truth[:, STEPS // 2 :] += 30
        elif case.startswith("stay"):
            truth[:, STEPS // 2 :, 0] += 30
            truth[:, STEPS // 2 + 4 :, 1] += 30
        elif case.startswith("wanders"):
            truth += 3 * autoregressive(rng.standard_normal(truth.shape), 0.7)
        y = truth + np.swapaxes(draw((len(truth), 2, STEPS)), -1, -2)
        if is_run:
            y[:, STEPS // 2 : STEPS // 2 + 6] += 30
        cells = []
        for options in ({"correlation_time": 0.0, "robust": False}, {}):
            found = smooth(y, 1.0, **options)  # type: ignore[arg-type]
            rmse = np.sqrt(np.mean((found.position - truth) ** 2))
            nees = np.mean(squares(found, truth)) / 2
            cells.append(f"{rmse:.2f}; {nees:.2f}; {np.mean(held(found, truth)):.0%}")
        rows.append([case, *cells])
    return markdown(["RMSE over σ; NEES; within 95 %", "noise as stated", "`smooth`"], rows)


def motions() -> str:
    """Return errors and coverage of smoothed positions by how the target moves."""
    rows = []
    for name, draw in {**MOTIONS, **ROUGH}.items():
        cells = []
        for steps, step in ((60, 1.0), (60, 5.0), (300, 5.0)):
            rng = generator(97, sum(name.encode()), steps, int(step))
            truth = step * np.cumsum(draw((repetitions(RUNS), steps, 2), step, rng), axis=1)
            found = smooth(truth + rng.standard_normal(truth.shape), 1.0, dt=step)
            rmse = np.sqrt(np.mean((found.position - truth) ** 2))
            nees = np.mean(squares(found, truth)) / 2
            wanders = np.mean(found.acceleration_noise > 0)
            inside = np.mean(held(found, truth))
            cells.append(f"{rmse:.2f}; {nees:.2f}; {inside:.0%}; {wanders:.0%}")
        rows.append([LABELS.get(name, name), *cells])
    head = ["RMSE over σ; NEES; within 95 %; white acceleration", "60 plots, 1 s", "60 plots, 5 s"]
    return markdown([*head, "300 plots, 5 s"], rows)


def _white_jerk(shape: tuple[int, ...], step: float, rng: np.random.Generator) -> FloatArray:
    acceleration = 0.01 * np.sqrt(step) * np.cumsum(rng.standard_normal(shape), axis=1)
    return np.asarray(step * np.cumsum(acceleration, axis=1))


def _manoeuvring(shape: tuple[int, ...], step: float, rng: np.random.Generator) -> FloatArray:
    return np.asarray(step * np.cumsum(_forgotten(shape, step, 0.05, rng), axis=1))


def _wandering(shape: tuple[int, ...], step: float, rng: np.random.Generator) -> FloatArray:
    return np.asarray(0.07 * np.sqrt(step) * np.cumsum(rng.standard_normal(shape), axis=1))


def _heading(shape: tuple[int, ...], step: float, rng: np.random.Generator) -> FloatArray:
    heading = np.cumsum(0.05 * np.sqrt(step) * rng.standard_normal(shape[:2]), axis=1)
    return np.stack([np.sin(heading), np.cos(heading)], axis=-1)


def _returning(shape: tuple[int, ...], step: float, rng: np.random.Generator) -> FloatArray:
    return _forgotten(shape, step, 0.3, rng)


def _briefly(shape: tuple[int, ...], step: float, rng: np.random.Generator) -> FloatArray:
    return _forgotten(shape, step, 0.3, rng, 3.0)


def _position(shape: tuple[int, ...], step: float, rng: np.random.Generator) -> FloatArray:
    return np.asarray(0.3 / np.sqrt(step) * rng.standard_normal(shape))


def _forgotten(
    shape: tuple[int, ...], step: float, size: float, rng: np.random.Generator, time: float = 20.0
) -> FloatArray:
    """Return what is kept for this time."""
    return autoregressive(size * rng.standard_normal(shape), float(np.exp(-step / time)))


def _turns(shape: tuple[int, ...], step: float, rng: np.random.Generator) -> FloatArray:
    rate = np.zeros(shape[:2])
    for start in range(0, shape[1], 25):
        rate[:, start : start + 12] = 0.1 * rng.standard_normal((shape[0], 1))
    heading = step * np.cumsum(rate, axis=1)
    return np.stack([np.sin(heading), np.cos(heading)], axis=-1)


MOTIONS: dict[str, Callable[[tuple[int, ...], float, np.random.Generator], FloatArray]] = {
    "white jerk": _white_jerk,
    "acceleration kept for 20 s (Singer)": _manoeuvring,
    "velocity that wanders": _wandering,
    "heading that wanders": _heading,
    "velocity kept for 20 s": _returning,
    "straight, turns of 12 plots": _turns,
}
# motions rougher than those that `smooth` models
ROUGH: dict[str, Callable[[tuple[int, ...], float, np.random.Generator], FloatArray]] = {
    "velocity correlated over 3 s": _briefly,
    "random-walk position": _position,
}
# the names above are part of the seeds of the simulations
LABELS = {
    "acceleration kept for 20 s (Singer)": "acceleration correlated over 20 s (Singer)",
    "velocity that wanders": "random-walk velocity",
    "heading that wanders": "random-walk heading",
    "velocity kept for 20 s": "velocity correlated over 20 s",
}
