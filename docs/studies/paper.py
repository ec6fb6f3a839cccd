"""The pictures 2 to 4 of the paper made anew, and its claims."""

import functools

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import tertia
from studies.montecarlo import (
    K1,
    METHODS,
    Errors,
    FloatArray,
    classical,
    generator,
    k2,
    paper,
    records,
)
from studies.pages import BLUE, GREEN, GREY, ORANGE, PURPLE, markdown, repetitions

COUNT = repetitions(20_000)
SIZES = (20, 30, 50, 70, 100, 140, 200, 300, 400, 600)
THRESHOLDS = tuple(np.arange(2.0, 3.45, 0.1).round(1))
POLARITIES = tuple(np.arange(0, 0.16, 0.01).round(2))
CLASSICAL = ("mean", "k-sigma, to the letter")
LINES = {
    "mean": (GREY, "-"),
    "k-sigma, to the letter": (ORANGE, "--"),
    "paper, n_g=5": (BLUE, "-."),
    "paper, n_g=10": (PURPLE, "-."),
    "default": (GREEN, "-"),
}
Curves = dict[str, list[Errors]]


@functools.cache
def by_size() -> Curves:
    """Errors of the methods over N, in the scenario PS1."""
    data = [records(n, COUNT, generator(10, n)) for n in SIZES]
    return {name: [METHODS[name](theta) for theta in data] for name in LINES}


@functools.cache
def by_threshold() -> Curves:
    """Errors of the methods over k1, N = 100, the same records for all."""
    theta = records(100, COUNT, generator(11))
    curves: Curves = {name: [METHODS[name](theta)] * len(THRESHOLDS) for name in LINES}
    curves["k-sigma, to the letter"] = [classical(k)(theta) for k in THRESHOLDS]
    for size in (5, 10):
        curves[f"paper, n_g={size}"] = [paper(size, k)(theta) for k in THRESHOLDS]
    return curves


@functools.cache
def in_many_records() -> tuple[FloatArray, dict[str, FloatArray]]:
    """Polarity that the paper's algorithm finds, and errors, in 200 000 records, N = 100."""
    polarity, errors = [], []
    for part in range(10):
        theta = records(100, COUNT, generator(12, part))
        found = tertia.estimate_bearing(
            theta, period=None, method="paper", block_size=5, k=K1, variance_test=k2(100, 5)
        )
        polarity.append(np.abs(found.polarity))
        errors.append({name: METHODS[name](theta).error for name in LINES})
    joined = {name: np.concatenate([part[name] for part in errors]) for name in LINES}
    return np.concatenate(polarity), joined


@functools.cache
def by_polarity() -> Curves:
    """Errors of the methods over the polarity that was found, N = 100."""
    polarity, errors = in_many_records()
    bins = [np.abs(polarity - center) < 0.005 for center in POLARITIES]
    return {name: [Errors(error[inside]) for inside in bins] for name, error in errors.items()}


@functools.cache
def in_ten_trials() -> dict[str, FloatArray]:
    """RMSE of every ten successive trials, N = 100."""
    _, errors = in_many_records()
    return {
        name: np.sqrt(np.mean(error.reshape(-1, 10) ** 2, axis=-1))
        for name, error in errors.items()
    }


def advantage(curves: Curves, name: str = "paper, n_g=5") -> FloatArray:
    """Mean of the RMSE of the two classical methods, over that of a method."""
    rmse = {method: np.array([e.rmse for e in errors]) for method, errors in curves.items()}
    ratio: FloatArray = np.mean([rmse[method] for method in CLASSICAL], axis=0) / rmse[name]
    return ratio


def ten_trial_ratio() -> FloatArray:
    """Return the same from ten trials each."""
    rmse = in_ten_trials()
    ratio: FloatArray = sum(rmse[m] for m in CLASSICAL) / 2 / rmse["paper, n_g=5"]
    return ratio


def _draw(ax: Axes, x: tuple[float, ...], curves: Curves) -> None:
    for name, (color, style) in LINES.items():
        rmse = np.array([e.rmse for e in curves[name]])
        band = 2 * np.array([e.rmse_error for e in curves[name]])
        ax.plot(x, rmse, style, color=color, label=name, linewidth=1.6)
        ax.fill_between(x, rmse - band, rmse + band, color=color, alpha=0.25, linewidth=0)


def _ratios(ax: Axes, x: tuple[float, ...], curves: Curves) -> None:
    for name in ("paper, n_g=5", "paper, n_g=10", "default"):
        color, style = LINES[name]
        ax.plot(x, advantage(curves, name), style, color=color, label=name, linewidth=1.6)
    ax.axhline(1, color="black", linewidth=0.6)
    ax.set(ylabel="mean of both classical RMSE over this one", ylim=(0, None))


def _panels(curves: Curves, x: tuple[float, ...], label: str) -> tuple[Figure, Axes, Axes]:
    figure = Figure(figsize=(9, 3.9), layout="constrained")
    left, right = figure.subplots(1, 2)
    _draw(left, x, curves)
    _ratios(right, x, curves)
    left.set(xlabel=label, ylabel="RMSE, degrees")
    right.set_xlabel(label)
    return figure, left, right


def _logarithmic(ax: Axes) -> None:
    ax.set_xscale("log")
    ax.set_xticks([20, 50, 100, 200, 500], ["20", "50", "100", "200", "500"])
    ax.minorticks_off()


def size_figure() -> Figure:
    """Figure 2 of the paper: RMSE over the number of measurements."""
    figure, left, right = _panels(by_size(), SIZES, "measurements N")
    left.set_yscale("log")
    left.set_yticks([0.2, 0.5, 1, 2], ["0.2", "0.5", "1", "2"])
    for ax in (left, right):
        _logarithmic(ax)
    right.plot([100, 200], [1.28, 1], "k*", markersize=9, label="the paper says")
    left.plot(100, 0.7, "k*", markersize=9, label="the paper says")
    left.legend(fontsize=8, frameon=False)
    right.legend(fontsize=8, frameon=False, loc="lower right")
    return figure


def threshold_figure() -> Figure:
    """Figure 3 of the paper: RMSE over the threshold of the screening."""
    figure, left, right = _panels(by_threshold(), THRESHOLDS, "threshold k1")
    left.set_ylim(0, 1.45)
    left.legend(fontsize=8, frameon=False, ncols=2, loc="upper left")
    right.legend(fontsize=8, frameon=False, loc="lower left")
    for ax in (left, right):
        ax.axvspan(2.2, 2.8, color=GREY, alpha=0.12, linewidth=0)
    right.set_ylim(0, 2.9)
    right.text(2.23, 2.7, "here the paper is better, it says", fontsize=8)
    return figure


def polarity_figure() -> Figure:
    """Figure 4 of the paper: RMSE over the polarity."""
    label = "polarity |N+ − N−| / N, as found"
    figure, left, right = _panels(by_polarity(), POLARITIES, label)
    left.set_ylim(0, None)
    left.plot(0.1, 0.67, "k*", markersize=9, label="the paper says")
    right.plot(0.1, 1.48, "k*", markersize=9, label="the paper says")
    left.legend(fontsize=8, frameon=False)
    right.legend(fontsize=8, frameon=False, loc="upper left")
    return figure


def ten_trials_figure() -> Figure:
    """Show what ten trials for each point, as in the paper, can tell."""
    figure = Figure(figsize=(9, 3.9), layout="constrained")
    left, right = figure.subplots(1, 2)
    curves = by_size()
    for name in ("mean", "paper, n_g=5", "default"):
        color, style = LINES[name]
        left.plot(SIZES, [e.rmse for e in curves[name]], style, color=color, linewidth=2.5)
        for trial in range(4):
            ten = [Errors(e.error[10 * trial : 10 * trial + 10]).rmse for e in curves[name]]
            left.plot(SIZES, ten, "-", color=color, linewidth=0.7, alpha=0.6)
        left.plot([], [], style, color=color, label=name)
    left.set(xlabel="measurements N", ylabel="RMSE, degrees", ylim=(0, 3))
    _logarithmic(left)
    left.set_title("thick: 20 000 trials; thin: four times ten", fontsize=10)
    left.legend(fontsize=8, frameon=False)
    _histogram(right, ten_trial_ratio())
    return figure


def _histogram(ax: Axes, ratio: FloatArray) -> None:
    low, middle, high = np.quantile(ratio, [0.025, 0.5, 0.975])
    ax.hist(ratio, np.arange(0, 4.01, 0.05).tolist(), density=True, color=BLUE, alpha=0.5)
    for value in (low, middle, high):
        ax.axvline(value, color="black", linewidth=0.8)
        ax.text(value + 0.03, 0.93, f"{value:.2f}", transform=ax.get_xaxis_transform(), fontsize=8)
    ax.plot(1.28, 0.02, "k*", markersize=9, label="the paper says")
    ax.set(xlabel="classical RMSE over the paper's (n_g=5) from ten trials", ylabel="density")
    ax.set_title("N = 100, 20 000 times ten; lines: 2.5, 50, 97.5 %", fontsize=10)
    ax.legend(fontsize=8, frameon=False, loc="center right")


def claims() -> str:
    """Put what the paper says beside what is found."""
    sizes, thresholds, polarities = by_size(), by_threshold(), by_polarity()
    size, k1, polarity = (
        dict(zip(x, np.transpose([advantage(c), advantage(c, "paper, n_g=10")]), strict=True))
        for x, c in ((SIZES, sizes), (THRESHOLDS, thresholds), (POLARITIES, polarities))
    )
    at_100 = [sizes[f"paper, n_g={block}"][SIZES.index(100)].rmse for block in (5, 10)]
    at_tenth = [polarities[f"paper, n_g={block}"][10].rmse for block in (5, 10)]
    low, high = np.quantile(ten_trial_ratio(), [0.025, 0.975])
    found = [
        ("RMSE at N = 100", "about 0.7°", at_100, "°"),
        ("classical over paper, N = 100", "1.28", size[100], ""),
        ("the same, N = 200", "almost 1 above 200", size[200], ""),
        ("the same, N = 400", "almost 1 above 200", size[400], ""),
        ("the same, N = 100, k1 = 2.2", "above 1 for 2.2 to 2.8", k1[2.2], ""),
        ("the same, N = 100, k1 = 2.8", "above 1 for 2.2 to 2.8", k1[2.8], ""),
        ("the same, N = 100, k1 = 3", "close to 1 above 2.8", k1[3.0], ""),
        ("RMSE at N = 100, polarity 0.1", "about 0.67°", at_tenth, "°"),
        ("classical over paper, polarity 0", "", polarity[0.0], ""),
        ("classical over paper, polarity 0.1", "up to 1.48", polarity[0.1], ""),
    ]
    rows = [[what, says, *(f"{v:.2f}{unit}" for v in values)] for what, says, values, unit in found]
    rows.append(["95 % interval of ten trials, N = 100", "1.28", f"{low:.2f} to {high:.2f}", ""])
    return markdown(["", "the paper", "found, n_g=5", "found, n_g=10"], rows)
