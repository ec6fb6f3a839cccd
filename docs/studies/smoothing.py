"""The tables and the picture of the page on smoothing."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from studies.montecarlo import FloatArray, generator
from studies.pages import markdown, repetitions
from tertia import metrics, plot
from tertia.smoothing import LocalPolynomial, SmoothedPositions, local_polynomial, smooth

BoolArray = npt.NDArray[np.bool_]

WINDOW = 13
# of the picture, so that a band can be seen
NOISY = 100.0
TRIALS = repetitions(4000)
STATED: dict[str, Any] = {"correlation_time": 0.0, "robust": False}
# a turn in 3-D: radius, climb, seconds from plot to plot
RADIUS, CLIMB, STEP, PERIOD = 1500.0, 10.0, 1.0, 60.0
SIGMA = 4.5
STEPS = 121
# about what `smooth` fits to the turn; runs with the gate, which is a loop in Python
TURN_JERK, GATED = 4.5, 25


def with_error(value: float, error: float) -> str:
    """Format a mean with its standard error."""
    return f"{value:.3f} ± {error:.1g}"


def share(hits: BoolArray) -> str:
    """Format a share."""
    return f"{100 * np.mean(hits):.1f} %"


def shapes(amplitude: float) -> dict[str, FloatArray]:
    """Return noise-free series of 41 instants, in units of the noise."""
    t = np.linspace(-1.0, 1.0, 41)
    return {
        "constant": np.zeros(41),
        "line": amplitude * t,
        "parabola": amplitude * t**2,
        "sine, period of 2 windows": amplitude * np.sin(2 * np.pi * 41 / 26 / 2 * t),
    }


def noisy(study: int) -> Iterator[tuple[str, FloatArray, FloatArray]]:
    """Yield the title, the truth and the plots, (trials, 41), of each shape at two amplitudes."""
    for amplitude in (3.0, 30.0):
        for name, truth in shapes(amplitude).items():
            if name == "constant" and amplitude > 3:
                continue
            noise = generator(study, int(amplitude)).standard_normal((TRIALS, truth.size))
            title = name if name == "constant" else f"{name}, amplitude {amplitude:g} σ"
            yield title, truth, truth + noise


def smoothed(y: FloatArray, degree: Any) -> LocalPolynomial:
    """Smooth with a window of 13."""
    return local_polynomial(y, WINDOW, degree)


def degree_coverage() -> str:
    """RMSE and coverage of two standard errors, by degree, in the middle of the record."""
    rows = []
    middle = slice(10, 31)
    for label, truth, y in noisy(70):
        cells = []
        for degree in (0, 1, 2, 3, "adaptive"):
            found = smoothed(y, degree)
            error = (found.value - truth)[:, middle]
            inside = np.abs(error) < 2 * found.sigma[:, middle]
            cells.append(f"{np.sqrt(np.mean(error**2)):.2f}; {share(inside)}")
        rows.append([label, *cells])
    head = ["RMSE over σ; within 2 sigma", "degree 0", "1", "2", "3", "adaptive"]
    return markdown(head, rows)


def degrees_chosen() -> str:
    """Shares of the degrees that are chosen."""
    rows = []
    for label, _, y in noisy(71):
        cells = []
        for variances in (None, 1.0):
            degree = local_polynomial(y, WINDOW, variance=variances).degree[:, 10:31]
            counts = [100 * np.mean(degree == p) for p in range(4)]
            cells.append(", ".join(f"{count:.0f}" for count in counts))
        rows.append([label, *cells])
    head = ["degrees 0, 1, 2, 3 chosen, %", "F test", "chi-square test, variances known"]
    return markdown(head, rows)


def ends() -> str:
    """Return standard errors in the middle and at the end."""
    rows = []
    for degree in range(4):
        cells = []
        for derivative in range(min(degree, 2) + 1):
            sigma = local_polynomial(
                np.zeros(41), WINDOW, degree, derivative=derivative, variance=1.0
            ).sigma
            cells.append(f"{sigma[20]:.3g}, {sigma[3]:.3g}, {sigma[0]:.3g}")
        rows.append([str(degree), *cells, *["–"] * (3 - len(cells))])
    head = ["degree", "value", "rate", "second derivative"]
    return markdown(head, rows)


def turn(runs: int, *study: int, period: float = PERIOD) -> tuple[FloatArray, FloatArray]:
    """Return positions and velocities of a turn (steps, 6), and plots (runs, steps, 3)."""
    t = STEP * np.arange(STEPS)
    phase, rate = 2 * np.pi * t / period, 2 * np.pi / period
    position = [RADIUS * np.cos(phase), RADIUS * np.sin(phase), CLIMB * t]
    velocity = [-RADIUS * rate * np.sin(phase), RADIUS * rate * np.cos(phase), CLIMB + 0 * t]
    truth = np.column_stack(position + velocity)
    noise = SIGMA * generator(72, *study).standard_normal((runs, STEPS, 3))
    return truth, truth[:, :3] + noise


def polynomials(y: FloatArray, degree: Any, **options: Any) -> FloatArray:
    """Smooth the axes of plots one by one; values only."""
    value = local_polynomial(np.swapaxes(y, -1, -2), WINDOW, degree, **options).value
    return np.swapaxes(value, -1, -2)


def methods() -> str:
    """Three-dimensional RMSE of positions and velocities on turns."""
    rows = []
    for period in (240.0, 60.0, 30.0):
        truth, y = turn(repetitions(100, 10), 1, int(period), period=period)
        track = smooth(y, SIGMA**2)
        estimates: dict[str, tuple[FloatArray, FloatArray | None]] = {
            "plots": (y, None),
            "local polynomial, degree 2": (
                polynomials(y, 2),
                polynomials(y, 2, derivative=1),
            ),
            "local polynomial, adaptive, F test": (
                polynomials(y, "adaptive"),
                polynomials(y, "adaptive", derivative=1),
            ),
            "local polynomial, adaptive, chi-square test": (
                polynomials(y, "adaptive", variance=SIGMA**2),
                polynomials(y, "adaptive", variance=SIGMA**2, derivative=1),
            ),
            "`smooth`": (track.position, track.velocity),
        }
        for name, (position, velocity) in estimates.items():
            errors = [position - truth[:, :3]]
            errors += [] if velocity is None else [velocity - truth[:, 3:]]
            rmse = [float(np.sqrt(np.mean(np.sum(error**2, axis=-1)))) for error in errors]
            cells = [f"{value:.2f}" for value in rmse] + ["–"] * (2 - len(rmse))
            nees = "–"
            if name == "`smooth`":
                error = track.position - truth[:, :3]
                nees = f"{np.mean(metrics.nees(error, track.position_covariance)) / 3:.2f}"
            rows.append([f"{period:g} s", name, *cells, nees])
    head = ["turn in", "", "position, m", "velocity, m/s", "NEES per dimension"]
    return markdown(head, rows)


def bisquare(y: FloatArray, iterations: int = 8) -> FloatArray:
    """Smooth along time with bisquare weights of the residuals, σ known."""
    weight = np.ones_like(y)
    value = y
    for _ in range(iterations):
        variances = np.swapaxes(SIGMA**2 / np.maximum(weight, 1e-9), -1, -2)
        value = polynomials(y, 2, variance=variances)
        weight = np.maximum(0, 1 - ((y - value) / (4.685 * SIGMA)) ** 2) ** 2
    return value


def gated(y: FloatArray, jerk: float, gate: float = 16.27) -> FloatArray:
    """Smooth what a filter of constant acceleration accepts: chi-square of 3, 0.1 %."""
    kept = y.copy()
    f = np.array([[1, STEP, STEP**2 / 2], [0, 1, STEP], [0, 0, 1]])
    q = jerk * np.array(
        [
            [STEP**5 / 20, STEP**4 / 8, STEP**3 / 6],
            [STEP**4 / 8, STEP**3 / 3, STEP**2 / 2],
            [STEP**3 / 6, STEP**2 / 2, STEP],
        ]
    )
    for run in kept:
        start = smooth(run[:5], SIGMA**2, jerk=jerk, **STATED)
        x = start.mean[-1].reshape(3, 3)
        p = start.covariance[-1][::3, ::3]
        for k in range(5, len(run)):
            x, p = f @ x, f @ p @ f.T + q
            s = p[0, 0] + SIGMA**2
            innovation = run[k] - x[0]
            if innovation @ innovation / s > gate:
                run[k] = np.nan
                continue
            gain = p[:, :1] / s
            x, p = x + gain * innovation, p - gain * gain.T * s
    return np.asarray(smooth(kept, SIGMA**2, jerk=jerk, **STATED).position)


def faults() -> str:
    """RMSE about faults of one axis, over the faults and seven instants beside them."""
    runs: dict[str, list[float]] = {
        "no outlier": [],
        "single, 5 σ": [5],
        "2 same": [5, 5],
        "2 opposite": [5, -5],
        "3 same": [5, 5, 5],
        "+4, −6, +5": [4, -6, 5],
        "4 same": [5, 5, 5, 5],
        "7 same": [5] * 7,
    }
    cells: dict[str, list[str]] = {}
    for i, sizes in enumerate(runs.values()):
        truth, y = turn(repetitions(100), 2, i)
        first = STEPS // 2 - len(sizes) // 2
        y[:, first : first + len(sizes), 0] += SIGMA * np.array(sizes)
        near = slice(first - 7, first + len(sizes) + 7)
        estimates = {
            "plots": y,
            "local polynomial, adaptive": polynomials(y, "adaptive"),
            "local polynomial, degree 2": polynomials(y, 2),
            "local polynomial, degree 2, bisquare weights": bisquare(y),
            "`smooth`": smooth(y, SIGMA**2).position,
            "`smooth`, noise as stated": smooth(y, SIGMA**2, **STATED).position,
            "`smooth` after a gate": gated(y[:GATED], TURN_JERK),
            "`smooth` after a gate with a hundredth of the jerk": gated(y[:GATED], TURN_JERK / 100),
        }
        for name, estimate in estimates.items():
            error = (estimate - truth[:, :3])[:, near]
            rmse = np.sqrt(np.mean(np.sum(error**2, axis=-1)))
            cells.setdefault(name, []).append(f"{rmse:.3g}")
    head = ["3-D RMSE, m", *runs]
    return markdown(head, [[name, *row] for name, row in cells.items()])


def tracks(runs: int, steps: int, jerk: float, *study: int) -> tuple[FloatArray, FloatArray]:
    """Return states (runs, steps, 6) of targets with white jerk in two axes, and plots of σ = 1."""
    rng = generator(73, *study)
    root = np.linalg.cholesky([[1 / 20, 1 / 8, 1 / 6], [1 / 8, 1 / 3, 1 / 2], [1 / 6, 1 / 2, 1]])
    f = np.array([[1, 1, 0.5], [0, 1, 1], [0, 0, 1]])
    x = rng.standard_normal((runs, 3, 2)) * np.array([[100.0], [10.0], [1.0]])
    states = [x]
    for _ in range(steps - 1):
        x = f @ x + np.sqrt(jerk) * root @ rng.standard_normal(x.shape)
        states.append(x)
    truth = np.stack(states, axis=1).reshape(runs, steps, 6)
    return truth, truth[..., :2] + rng.standard_normal((runs, steps, 2))


def nees(track: SmoothedPositions, truth: FloatArray) -> list[str]:
    """Mean NEES per dimension of position, velocity and acceleration, with standard errors."""
    cells = []
    for i, name in enumerate(("position", "velocity", "acceleration")):
        error = getattr(track, name) - truth[..., 2 * i : 2 * i + 2]
        values = np.asarray(metrics.nees(error, getattr(track, f"{name}_covariance"))) / 2
        of_runs = values.mean(axis=-1)
        cells.append(
            with_error(float(of_runs.mean()), float(of_runs.std() / np.sqrt(of_runs.size)))
        )
    return cells


def jerk_fit() -> str:
    """How well the jerk is determined, and what that does to the covariance."""
    rows = []
    for jerk in (0.01, 1.0):
        for steps in (10, 20, 50, 200, 600):
            runs = repetitions(max(100, min(400, 20_000 // steps)))
            truth, y = tracks(runs, steps, jerk, steps, int(100 * jerk))
            fitted, known = smooth(y, 1.0, **STATED), smooth(y, 1.0, jerk=jerk, **STATED)
            found = np.asarray(fitted.jerk)
            error = np.asarray(fitted.jerk_sigma) / np.asarray(fitted.jerk)
            known_jerk = (found > 0) & np.isfinite(error)
            inside = np.abs(np.log(found[known_jerk] / jerk)) < 2 * error[known_jerk]
            rows.append(
                [
                    f"{jerk:g}",
                    str(steps),
                    f"{np.median(found) / jerk:.2f}",
                    f"{np.median(error[known_jerk]):.0%}" if known_jerk.any() else "–",
                    share(inside) if known_jerk.any() else "–",
                    share(found == 0),
                    nees(known, truth)[0],
                    nees(fitted, truth)[0],
                ]
            )
    head = ["q T⁵/σ²", "plots", "median estimate / truth", "stated error", "within two sigma"]
    return markdown([*head, "estimate 0", "NEES, jerk known", "NEES, jerk fitted"], rows)


def consistency() -> str:
    """NEES with the true jerk at the ends and in the middle."""
    truth, y = tracks(repetitions(3000), 40, 0.1, 7)
    track = smooth(y, 1.0, jerk=0.1, **STATED)
    rows = []
    for label, at in {"first": 0, "second": 1, "middle": 20, "last": 39}.items():
        one = slice(at, at + 1)
        parts = {
            name: getattr(track, name)[:, one] for name in ("mean", "covariance", "innovation")
        }
        part = replace(track, **parts)
        rows.append([label, *nees(part, truth[:, one])])
    return markdown(["instant", "position", "velocity", "acceleration"], rows)


def track_figure() -> Figure:
    """Draw a turn with a gap: points, curve and band."""
    truth, _ = turn(1, 3)
    x = truth[:, 0] + NOISY * generator(74).standard_normal(STEPS)
    x[40:55] = np.nan
    variances = np.full(STEPS, NOISY**2)
    times = STEP * np.arange(STEPS)
    figure = Figure(figsize=(8, 6), layout="constrained")
    top, bottom = figure.subplots(2, sharex=True)
    track = smooth(x[:, np.newaxis], variances[:, np.newaxis], time=times)
    plot.smoothing(x[:, np.newaxis], track, time=times, ax=top)
    curve = local_polynomial(x, WINDOW, time=times, variance=variances)
    plot.smoothing(x, curve, time=times, ax=bottom)
    for ax, title in ((top, "smooth"), (bottom, "local_polynomial")):
        ax.plot(times, truth[:, 0], ":", color="0.3", linewidth=1)
        ax.set(title=title, ylabel="x, m")
    top.set(xlabel="")
    bottom.set(xlabel="s")
    return figure
