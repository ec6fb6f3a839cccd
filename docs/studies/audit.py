"""The tables and the picture of the page on audits."""

from collections.abc import Callable
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from studies.honesty import IntArray
from studies.montecarlo import WITHIN_95, FloatArray, autoregressive, generator
from studies.pages import markdown, repetitions
from tertia import audit, plot

TRIALS = 400
SIZES = ((1, 200), (1, 1000), (5, 200), (40, 50))
# a record whose rows are as many groups
INDEPENDENT = (1000, 1)
CORRELATIONS = (0.0, 0.5, 0.8, 0.9, 0.95)
# the variance is twice what is claimed, so that 77.6 % of 95 % regions of two axes hold the truth
EXCESS = 2.0
BLOCK, PERIOD, WINDOW = 25, 150.0, 60
# of each group with an error in common
ROWS = 100


def correlated(correlation: float, shape: tuple[int, int], rng: np.random.Generator) -> FloatArray:
    """Return errors of two axes (series, steps, 2), of variance one."""
    return autoregressive(rng.standard_normal((*shape, 2)), correlation)


def cell(
    draw: Callable[[], FloatArray],
    variance: float,
    true: tuple[float, float, float],
    groups: IntArray | None = None,
) -> str:
    """Return how often intervals of NEES, coverage and scale hold the true figures."""
    held, number, count = np.zeros(3), 0.0, repetitions(TRIALS)
    for _ in range(count):
        found = audit(draw(), variance, groups=groups, probability=[0.95])
        figures = (found.nees, found.coverage[0.95], found.scale[0.95])
        held += [one.low <= t <= one.high for one, t in zip(figures, true, strict=True)]
        number += found.effective_number
    shares = " ".join(f"{share:.3f}" for share in held / count)
    return f"{shares} ({number / count:.0f})"


def intervals() -> str:
    """Return this for errors that last, also if all rows are treated as independent."""
    rows = []
    true = (EXCESS, 1 - 0.05 ** (1 / EXCESS), EXCESS)
    for correlation in CORRELATIONS:
        cells = []
        for series, steps in (*SIZES, INDEPENDENT):
            rng = generator(90, series, steps, round(100 * correlation))
            groups = np.repeat(np.arange(series), steps)
            shape = (1, series) if steps == 1 else (series, steps)
            draw = partial(_lasting, correlation, shape, rng)
            cells.append(cell(draw, 1.0, true, groups))
        rows.append([f"{correlation:g}", *cells])
    head = ["correlation", *(f"{series} × {steps}" for series, steps in SIZES)]
    return markdown([*head, f"1 × {INDEPENDENT[0]}, as if independent"], rows)


def _lasting(correlation: float, shape: tuple[int, int], rng: np.random.Generator) -> FloatArray:
    errors = np.sqrt(EXCESS) * correlated(correlation, shape, rng)
    return np.asarray(errors.reshape(-1, 2))


def groups() -> str:
    """Return this for groups that have an error in common, by its size over the noise."""
    rows = []
    for count in (3, 5, 10, 20, 40):
        cells = []
        for size in (0.0, 1.0, 3.0):
            labels = np.repeat(np.arange(count), ROWS)
            draw = partial(_shared, size, labels, generator(96, count, int(size)))
            cells.append(cell(draw, 1 + size**2, (1.0, 0.95, 1.0), labels))
        rows.append([f"{count} × {ROWS}", *cells])
    return markdown(["groups × rows", "no common error", "as large as the noise", "3 times"], rows)


def _shared(size: float, labels: IntArray, rng: np.random.Generator) -> FloatArray:
    common = size * rng.standard_normal((labels[-1] + 1, 2))
    return np.asarray(common[labels] + rng.standard_normal((len(labels), 2)))


def stops(steps: int, rng: np.random.Generator) -> FloatArray:
    """Return white errors with a bias that changes from stop to stop."""
    bias = np.repeat(rng.standard_normal((steps // BLOCK + 1, 2)), BLOCK, axis=0)[:steps]
    return np.asarray((bias + rng.standard_normal((steps, 2))) / np.sqrt(2))


def smooth(steps: int, rng: np.random.Generator) -> FloatArray:
    """Return errors as those of a smoother, which hardly change from row to row."""
    weights = np.hanning(WINDOW)
    noise = rng.standard_normal((2, steps + WINDOW - 1))
    axes = [np.convolve(one, weights / np.linalg.norm(weights), "valid") for one in noise]
    return np.stack(axes, axis=-1)


def directions(steps: int, rng: np.random.Generator) -> FloatArray:
    """Return white errors with a deviation that follows a slowly turning direction."""
    step = 2 * np.pi / PERIOD * (1 + 0.3 * rng.standard_normal(steps))
    phase = np.cumsum(step) + rng.uniform(0, 2 * np.pi)
    deviation = np.sqrt(2) * np.stack([np.sin(phase), np.cos(phase)], axis=-1)
    return np.asarray((deviation + rng.standard_normal((steps, 2))) / np.sqrt(2))


def gusts(steps: int, rng: np.random.Generator) -> FloatArray:
    """Return white errors whose size changes slowly."""
    size = correlated(0.98, (1, steps), rng)[0, :, :1]
    return np.asarray(np.exp(0.6 * size) * rng.standard_normal((steps, 2)))


def heavy(steps: int, rng: np.random.Generator) -> FloatArray:
    """Return Student's errors with three degrees of freedom: their squares have no variance."""
    return rng.standard_t(3, (steps, 2))


def other_errors() -> str:
    """Return the same for errors that no model of the posterior describes."""
    kinds: dict[str, Callable[[int, np.random.Generator], FloatArray]] = {
        "biased per stop of 25": stops,
        "direction-dependent": directions,
        "smooth": smooth,
        "size changes slowly": gusts,
        "Student, 3 degrees": heavy,
    }
    rows = []
    for k, (name, draw) in enumerate(kinds.items()):
        long = np.concatenate(
            [draw(20_000, generator(91, k, part)) for part in range(repetitions(30))]
        )
        squares = np.sum(long**2, axis=-1)
        quantile = WITHIN_95[2]
        true = (
            squares.mean() / 2,
            float(np.mean(squares <= quantile)),
            float(np.quantile(squares, 0.95)) / quantile,
        )
        cells = []
        for steps in (200, 1000):
            cells.append(cell(partial(draw, steps, generator(92, k, steps)), 1.0, true))
        rows.append([name, *cells])
    return markdown(["errors", "200", "1000"], rows)


def verdicts() -> str:
    """Return how often each verdict is given of sigmas that are wrong by a factor."""
    rows = []
    for factor in (0.5, 1.0, 1.2, 1.5, 2.0):
        cells = []
        for correlation, steps in ((0.0, 50), (0.0, 200), (0.9, 200), (0.9, 1000)):
            rng = generator(93, round(10 * factor), steps, round(10 * correlation))
            count, said = repetitions(TRIALS), []
            for _ in range(count):
                error = factor * correlated(correlation, (1, steps), rng)[0]
                said.append(audit(error, 1.0, probability=[0.95]).verdict)
            words = ("too small", "honest", "too large", "too short")
            shares = [sum(one.startswith(word) for one in said) / count for word in words]
            cells.append(" ".join(f"{share:.2f}" for share in shares))
        rows.append([f"{factor:g}", *cells])
    head = ["true / stated sigma", "50, white", "200, white", "200, AR(.9)", "1000, AR(.9)"]
    return markdown(head, rows)


def audit_figure() -> Figure:
    """Draw the audit of errors that last, whose sigmas are too small in one part."""
    rng = generator(94)
    error = correlated(0.9, (1, 3000), rng)[0]
    distance = np.linspace(0.0, 30.0, len(error))
    found = audit(error * (1 + distance / 30)[:, np.newaxis], 1.0, strata={"range (km)": distance})
    figure = Figure(figsize=(6.5, 4.5), layout="constrained")
    plot.audit(found, ax=figure.subplots())
    return figure
