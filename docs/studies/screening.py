"""The tables and pictures of the page on screening."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies.montecarlo import CLEAN, SENSITIVE, FloatArray, generator, records
from studies.pages import BLUE, GREEN, GREY, ORANGE, PURPLE, markdown, repetitions
from tertia.screening import (
    Screening,
    bursts,
    critical_value,
    false_alarm_probability,
    k_sigma,
    leave_one_out,
    leave_one_out_mask,
    moving_polynomial,
)
from tertia.simulate import direction_finder

Rule = Callable[[FloatArray], Screening]
RULES: dict[str, Rule] = {
    "k-sigma, k = 2.5": lambda y: k_sigma(y, 2.5, replace=None),
    "k-sigma, k = 3": lambda y: k_sigma(y, 3.0, replace=None),
    "leave-one-out, frozen, k = 2.5": lambda y: leave_one_out(y, statistics="frozen"),
    "leave-one-out, sequential, k = 2.5": leave_one_out,
    "leave-one-out, sequential, k = 3": lambda y: leave_one_out(y, 3.0),
    "bursts, default": bursts,
    "bursts, sensitive": lambda y: bursts(y, **SENSITIVE),
}
LINES = {
    "k-sigma, k = 2.5": (GREY, ":"),
    "leave-one-out, frozen, k = 2.5": (BLUE, "--"),
    "leave-one-out, sequential, k = 2.5": (PURPLE, "-."),
    "bursts, default": (GREEN, "-"),
}


def false_alarms() -> str:
    """Probability that the frozen leave-one-out rule flags a good measurement."""
    sizes = (5, 10, 30, 100, 1000)
    rows = []
    for k in (2.0, 2.2, 2.5, 3.0, 3.5):
        cells = []
        for n in sizes:
            clean = generator(20, n).standard_normal((400_000 // n, n))
            found = leave_one_out_mask(clean, k).mean()
            cells.append(f"{false_alarm_probability(k, n):.4f} ({found:.4f})")
        rows.append([f"k = {k}", *cells])
    for significance in (0.05, 0.01, 0.001):
        rows.append(
            [
                f"k for {significance:.1%}",
                *(f"{critical_value(n, significance):.3f}" for n in sizes),
            ]
        )
    return markdown(["", *(f"N = {n}" for n in sizes)], rows)


def detection() -> str:
    """Share of singles, members of bursts and good measurements flagged, by rule, in PS1."""
    record = direction_finder(100, batch=repetitions(20_000), rng=generator(21), period=None)
    clean = records(100, 20_000, generator(22), **CLEAN)
    good = ~(record.single | record.burst)
    rows = []
    for name, rule in RULES.items():
        flagged = rule(record.theta).outlier
        in_clean = rule(clean).outlier
        shares = [flagged[kind].mean() for kind in (record.single, record.burst, good)]
        shares += [in_clean.mean(), in_clean.any(axis=-1).mean()]
        rows.append([name, *(f"{share:.1%}" for share in shares)])
    head = ["rule", "single outliers", "measurements in bursts", "good measurements"]
    return markdown([*head, "clean data: measurements", "clean data: records"], rows)


def clean_bursts() -> str:
    """How much `bursts` flags in clean samples."""
    sizes = (5, 10, 20, 30, 50, 100, 400, 1000)
    rows = []
    for label, options in (("default", {}), ("sensitive", SENSITIVE)):
        for what in ("records", "measurements"):
            cells = []
            for n in sizes:
                y = generator(23, n).standard_normal((repetitions(10_000), n))
                flagged = bursts(y, **options).outlier
                share = flagged.any(axis=-1).mean() if what == "records" else flagged.mean()
                cells.append(f"{share:.1%}")
            rows.append([f"{label}: {what}", *cells])
    return markdown(["share flagged", *(f"N = {n}" for n in sizes)], rows)


def repeated_passes() -> str:
    """Share of clean samples that repeated replacement flags in the end."""
    rows = []
    for k in (2.0, 2.1, 2.2, 2.5, 3.0):
        y = generator(24).standard_normal((20, repetitions(10_000)))
        ever = np.zeros(y.shape, dtype=bool)
        shares = []
        for turn in range(1, 1001):
            screening = leave_one_out(y, k, statistics="frozen")
            y, ever = screening.cleaned, ever | screening.outlier
            if turn in (1, 10, 100, 1000):
                shares.append(f"{ever.mean():.1%}")
            if turn > 1000 or not screening.outlier.any():
                break
        shares += [f"{ever.mean():.1%}"] * (4 - len(shares))
        rows.append([f"k = {k}", *shares])
    return markdown(["clean values replaced", "1 pass", "10", "100", "1000"], rows)


def _running_median(y: FloatArray) -> npt.NDArray[np.bool_]:
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(y, ((0, 0), (6, 6)), "edge"), 13, -1)
    deviation = np.abs(y - np.median(windows, axis=-1))
    return np.asarray(deviation > 4 * 1.4826 * np.median(deviation, axis=-1, keepdims=True))


def moving() -> str:
    """Share of outliers found, false alarms and noise that is left, of series that move."""
    n, count = 500, repetitions(400)
    t = np.arange(n)
    paths = {"constant": 0.0 * t, "drifts": 0.3 * t, "turns": 10 * np.sin(t / 10)}
    rules: dict[str, Callable[[FloatArray], npt.NDArray[np.bool_]]] = {
        "moving polynomial": lambda y: moving_polynomial(y).outlier,
        "running median": _running_median,
        "one mean": lambda y: leave_one_out(y, 4.0).outlier,
    }
    noise, wrong = generator(26).standard_normal((count, n)), generator(27).uniform(size=(count, n))
    bad = wrong < 0.04
    off = generator(28).uniform(6, 12, bad.shape) * generator(29).choice([-1.0, 1.0], bad.shape)
    error = noise + np.where(bad, off, 0.0)
    rows = []
    for name, rule in rules.items():
        cells = []
        for path in paths.values():
            flagged = rule(path + error)
            left = np.sqrt(np.mean(error[~flagged] ** 2))
            cells.append(f"{flagged[bad].mean():.1%}, {flagged[~bad].mean():.2%}, {left:.2f}")
        rows.append([name, *cells])
    return markdown(["rule", *paths], rows)


def record_figure() -> Figure:
    """One record with what each rule flags."""
    rng = generator(25)
    y = rng.standard_normal(100)
    wrong = np.zeros(100, dtype=bool)
    for place, offset in (
        (slice(38, 47), 4.0),
        (slice(70, 76), 3.6),
        (12, 5.0),
        (60, 4.5),
        (90, -5.0),
    ):
        y[place] += offset
        wrong[place] = True
    figure = Figure(figsize=(9, 6.2), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True, sharey=True)
    for ax, name in zip(axes.flat, LINES, strict=True):
        _record(ax, y, wrong, RULES[name](y).outlier)
        ax.set_title(name, fontsize=10)
    axes[0, 0].legend(loc="upper left", fontsize=8, ncols=2, frameon=False)
    figure.supxlabel("number of the measurement", fontsize=9)
    figure.supylabel("deviation from the truth, standard deviations", fontsize=9)
    return figure


def _record(
    ax: Axes, y: FloatArray, wrong: npt.NDArray[np.bool_], flagged: npt.NDArray[np.bool_]
) -> None:
    i = np.arange(y.size)
    for mask, marker, color, label in (
        (~wrong & ~flagged, ".", GREY, "good"),
        (wrong & flagged, "o", GREEN, "outlier, found"),
        (wrong & ~flagged, "s", ORANGE, "outlier, missed"),
        (~wrong & flagged, "x", PURPLE, "good, flagged"),
    ):
        ax.plot(i[mask], y[mask], marker, color=color, label=label, markersize=5)
    ax.axhline(0, color="black", linewidth=0.6)
    ax.set_ylim(-8.5, 9.5)
    found, false = np.count_nonzero(wrong & flagged), np.count_nonzero(~wrong & flagged)
    text = f"{found} of {np.count_nonzero(wrong)} found, {false} good flagged"
    ax.text(0.99, 0.03, text, transform=ax.transAxes, ha="right", fontsize=8)


def masking_figure() -> Figure:
    """How many equal errors of one sign are all found: the formula and simulations."""
    figure = Figure(figsize=(9, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    _largest(left)
    _caught(right)
    return figure


def _largest(ax: Axes) -> None:
    """Draw the largest m over k; the dots are found by trying."""
    ks = np.linspace(1.5, 4, 300)
    for n, color in ((20, ORANGE), (50, BLUE), (100, GREEN), (200, PURPLE)):
        m = np.arange(2, n)
        ratio = (n - m) * (n - 2) / ((m - 1) * (n - 1))
        ax.plot(
            ks, [1 + np.count_nonzero(ratio > k * k) for k in ks], color=color, label=f"N = {n}"
        )
        some = np.linspace(1.6, 3.9, 9)
        ax.plot(some, [_largest_found(n, k) for k in some], "o", color=color, markersize=4)
    ax.set(xlabel="threshold k", ylabel="largest number all found", yscale="log")
    ax.set_yticks([2, 5, 10, 20, 50], ["2", "5", "10", "20", "50"])
    ax.minorticks_off()
    ax.set_title("N values, m of them equally wrong, the others equal", fontsize=10)
    ax.legend(fontsize=8, frameon=False)


def _largest_found(n: int, k: float) -> int:
    samples = np.tril(np.ones((n, n)))[: n // 2]
    masks = leave_one_out_mask(samples, k)
    return 1 + max(i for i, mask in enumerate(masks) if mask[: i + 1].all())


def _caught(ax: Axes) -> None:
    """Draw the share of m successive errors of five sigma that each rule finds, N = 100."""
    sizes = (1, 2, 3, 4, 6, 8, 10, 12, 14, 16, 20, 25, 30, 35, 40)
    for name, (color, style) in LINES.items():
        shares = []
        for m in sizes:
            y = generator(26, m).standard_normal((2000, 100))
            y[:, 30 : 30 + m] += 5
            shares.append(RULES[name](y).outlier[:, 30 : 30 + m].mean())
        ax.plot(sizes, shares, style, color=color, label=name, linewidth=1.8)
    ax.axvline(14, color="black", linewidth=0.6)
    ax.text(14.6, 0.75, "14: the formula's\nlargest m at k = 2.5", fontsize=8)
    ax.set(xlabel="successive errors of +5σ among N = 100", ylabel="share of them found")
    ax.set_title("the same with noise", fontsize=10)
    ax.legend(fontsize=8, frameon=False)
