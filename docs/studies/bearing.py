"""The tables of the page on bearings."""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import tertia
from studies.montecarlo import (
    CLEAN,
    K1,
    METHODS,
    SINGLES,
    WITH_SIGMA,
    Errors,
    FloatArray,
    autoregressive,
    classical,
    generator,
    k2,
    library,
    paper,
    records,
)
from studies.pages import BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, markdown, repetitions
from tertia import screening
from tertia.simulate import direction_finder

COUNT = repetitions(20_000)
COVERAGE_LINES = {
    "mean": (GREY, "-"),
    "paper, n_g=5": (BLUE, "-."),
    "paper, n_g=10": (PURPLE, "-."),
    "corrected, n_g=10": (ORANGE, "--"),
    "default": (GREEN, "-"),
}
SIZES = (50, 100, 200, 400)
# RMSE in degrees of an independent simulation of the same scenario, 20 000 records
EXPECTED = {
    "mean": (1.324, 0.971, 0.690, 0.501),
    "k-sigma, to the letter": (1.265, 0.880, 0.603, 0.424),
    "paper, n_g=5": (1.006, 0.699, 0.563, 0.434),
    "paper, n_g=10": (0.775, 0.488, 0.357, 0.260),
    "median": (0.802, 0.553, 0.387, 0.272),
}
# the other reading of the same rule, compared with the same numbers but not counted
READINGS = {"k-sigma, both as measured": "k-sigma, to the letter"}


def reproduction() -> str:
    """RMSE in the scenario PS1 against the independent simulation, and the largest |z|."""
    data = [records(n, COUNT, generator(1, n)) for n in SIZES]
    largest = 0.0
    rows = []
    for name, method in METHODS.items():
        cells = []
        for i, theta in enumerate(data):
            errors = method(theta)
            cell = f"{errors.rmse:.3f} ± {errors.rmse_error:.3f}"
            expected = EXPECTED.get(READINGS.get(name, name))
            if expected:
                z = (errors.rmse - expected[i]) / (np.sqrt(2) * errors.rmse_error)
                largest = max(largest, abs(z)) if name in EXPECTED else largest
                cell += f" ({expected[i]:.3f}, {z:+.1f})"
            cells.append(cell)
        rows.append([name, *cells])
    table = markdown(["RMSE, degrees", *(f"N = {n}" for n in SIZES)], rows)
    counted = f"Largest |z| of {len(EXPECTED) * len(SIZES)} values (without 'both as measured')"
    return f"{table}\n{counted}: {largest:.1f}.\n"


def _covered(errors: Errors) -> str:
    p = errors.coverage
    return f"{p:.3f} ± {np.sqrt(p * (1 - p) / errors.error.size):.3f}"


def coverage() -> str:
    """Coverage of 2 sigma in clean data and in PS1."""
    rows = []
    for name in WITH_SIGMA:
        for label, scenario in (("clean", CLEAN), ("PS1", {})):
            data = (records(n, COUNT, generator(2, n), **scenario) for n in SIZES)
            rows.append([name, label, *(_covered(METHODS[name](theta)) for theta in data)])
    return markdown(["method", "data", *(f"N = {n}" for n in SIZES)], rows)


def small_coverage() -> str:
    """Coverage of the default in short records."""
    sizes = (5, 10, 15, 20, 30, 50)
    rows = []
    for label, scenario in (("clean", CLEAN), ("PS1", {})):
        data = (records(n, COUNT, generator(3, n), **scenario) for n in sizes)
        rows.append([label, *(_covered(METHODS["default"](theta)) for theta in data)])
    return markdown(["data", *(f"N = {n}" for n in sizes)], rows)


def stated_sigma() -> str:
    """Coverage of 2 sigma with a stated sigma of 1, and the median sigma times the root of N."""
    sizes = (1, 2, 5, 20, 100)
    rows = []
    for number, (label, noise) in enumerate(STATED.items()):
        cells = []
        for n in sizes:
            error = noise(generator(310, number, n), (repetitions(10_000), n))
            found = tertia.estimate_bearing(error, sigma=1.0, period=None)
            width = np.sqrt(n) * np.median(found.sigma)
            errors = Errors(np.asarray(found.value), np.asarray(found.sigma))
            cells.append(f"{_covered(errors)} ({width:.2f})")
        rows.append([label, *cells])
    return markdown(["noise", *(f"N = {n}" for n in sizes)], rows)


def differing_sigmas() -> str:
    """Coverage of 2 sigma if the stated sigmas differ by factors of up to 15."""
    sizes = (2, 3, 5, 10, 30)
    rows = []
    for number, (label, wrong) in enumerate(DIFFERING.items()):
        cells = []
        for n in sizes:
            rng, shape = generator(311, number, n), (repetitions(5000), n)
            sigma = 0.5 * 15.0 ** rng.random(shape)
            error = sigma * rng.standard_normal(shape)
            error += np.where(rng.random(shape) < 0.15, wrong(rng, sigma), 0.0)
            found = tertia.estimate_bearing(error, sigma=sigma, period=None)
            cells.append(_covered(Errors(np.asarray(found.value), np.asarray(found.sigma))))
        rows.append([label, *cells])
    return markdown(["15 % outliers", *(f"N = {n}" for n in sizes)], rows)


# what outliers add to measurements with these sigmas
DIFFERING: dict[str, Callable[[np.random.Generator, FloatArray], FloatArray]] = {
    "none": lambda _, sigma: 0.0 * sigma,
    "up to 30, either side": lambda rng, sigma: rng.uniform(-30.0, 30.0, sigma.shape),
    "5 to 20 sigma, either side": lambda rng, sigma: (
        rng.choice([-1.0, 1.0], sigma.shape) * rng.uniform(5.0, 20.0, sigma.shape) * sigma
    ),
}


def _white(rng: np.random.Generator, shape: tuple[int, int]) -> FloatArray:
    return np.asarray(rng.standard_normal(shape))


def _with_outliers(rng: np.random.Generator, shape: tuple[int, int], *sides: float) -> FloatArray:
    """Return noise to a fifth of which 5 to 15 sigma are added."""
    wrong = np.where(rng.random(shape) < 0.2, rng.uniform(5, 15, shape), 0.0)
    return np.asarray(_white(rng, shape) + rng.choice(sides, shape) * wrong)


def _lasting(rng: np.random.Generator, shape: tuple[int, int], correlation: float) -> FloatArray:
    return autoregressive(_white(rng, shape), correlation)


# noise of a stated sigma of 1
STATED: dict[str, Callable[[np.random.Generator, tuple[int, int]], FloatArray]] = {
    "as stated": _white,
    "twice the stated sigma": lambda rng, shape: 2.0 * _white(rng, shape),
    "half of the stated sigma": lambda rng, shape: 0.5 * _white(rng, shape),
    "20 % outliers, either side": lambda rng, shape: _with_outliers(rng, shape, -1.0, 1.0),
    "20 % outliers, one side": lambda rng, shape: _with_outliers(rng, shape, 1.0),
    "correlated, φ = .5": lambda rng, shape: _lasting(rng, shape, 0.5),
    "correlated, φ = .8": lambda rng, shape: _lasting(rng, shape, 0.8),
}


def random_scenario(rng: np.random.Generator) -> dict[str, Any]:
    """One of the random scenarios; the page states the distribution."""
    n, shortest = int(rng.integers(50, 401)), int(rng.integers(2, 8))
    low = rng.uniform(2.0, 4.0)
    return {
        "n": n,
        "sigma": rng.uniform(0.5, 5.0),
        "single_probability": rng.uniform(0.0, 0.06),
        "bursts_per_100": rng.uniform(0.0, 2.0),
        "burst_length": (shortest, int(rng.integers(shortest, 21))),
        "amplitude": (low, low + rng.uniform(0.0, 4.0)),
        "positive_probability": rng.uniform(0.5, 1.0),
        "period": None,
    }


@functools.cache
def scenario_errors(
    count: int = repetitions(160), trials: int = repetitions(2000)
) -> dict[str, np.ndarray[Any, Any]]:
    """RMSE of several methods in random scenarios, in units of sigma, and the share of outliers.

    'oracle' is the mean of the measurements that are right.
    """
    methods = {
        f"paper, n_g={size}": library(method="paper", block_size=size) for size in (5, 10, 20)
    }
    methods["paper, n_g=10, k2 = L F"] = paper(10, k=2.5)
    methods["corrected, n_g=10"] = library(method="corrected")
    for name in ("mean", "median", "default"):
        methods[name] = METHODS[name]
    result: dict[str, list[float]] = {name: [] for name in [*methods, "oracle", "share"]}
    rng = generator(4)
    for _ in range(count):
        scenario = random_scenario(rng)
        record = direction_finder(**scenario, batch=trials, rng=rng)
        right = ~(record.single | record.burst)
        oracle = Errors(np.sum(record.theta * right, axis=-1) / np.maximum(right.sum(-1), 1))
        for name, method in methods.items():
            result[name].append(method(record.theta).rmse / scenario["sigma"])
        result["oracle"].append(oracle.rmse / scenario["sigma"])
        result["share"].append(1 - float(right.mean()))
    return {name: np.array(values) for name, values in result.items()}


def scenarios() -> str:
    """Geometric-mean ratios and wins in the random scenarios."""
    found = scenario_errors()
    papers = [found[f"paper, n_g={size}"] for size in (5, 10, 20)]
    best = np.min(papers, axis=0)
    rows = []
    for name, rmse in found.items():
        if name == "share":
            continue
        logs = np.log(rmse / papers[1])
        ratio, error = np.exp(logs.mean()), logs.std(ddof=1) / np.sqrt(logs.size)
        wins = "" if name.startswith("paper") else f"{np.mean(rmse < best):.0%}"
        rows.append([name, f"{ratio:.3f} ± {ratio * error:.3f}", wins])
    won = "scenarios won against the best paper variant"
    return markdown(["method", "RMSE / RMSE of paper, n_g=10", won], rows)


def clean_cost() -> str:
    """RMSE in clean data over that of the mean."""
    data = [records(n, COUNT, generator(5, n), **CLEAN) for n in SIZES]
    ideal = [METHODS["mean"](theta).rmse for theta in data]
    rows = (
        [
            name,
            *(f"{METHODS[name](y).rmse / mean:.2f}" for y, mean in zip(data, ideal, strict=True)),
        ]
        for name in METHODS
    )
    return markdown(["RMSE / RMSE of the mean", *(f"N = {n}" for n in SIZES)], rows)


def _wrapped(angle: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    return (angle + 180) % 360 - 180


def north() -> str:
    """RMSE at south, at north, and at north without unwrapping."""
    options: dict[str, dict[str, Any]] = {
        "mean": {"method": "mean"},
        "k-sigma, excluded": {"method": "k-sigma", "k": K1},
        "paper, n_g=5": {"method": "paper", "block_size": 5, "k": K1, "variance_test": k2(100, 5)},
        "paper, n_g=10": {"method": "paper", "k": K1, "variance_test": k2(100, 10)},
        "corrected, n_g=10": {"method": "corrected", "k": K1},
        "default": {},
    }
    rows = []
    for name, option in options.items():
        cells = []
        for bearing, period in ((180.0, 360.0), (0.0, 360.0), (0.0, None)):
            theta = direction_finder(100, bearing=bearing, batch=COUNT, rng=generator(6)).theta
            value = np.asarray(tertia.estimate_bearing(theta, period=period, **option).value)
            cells.append(f"{Errors(_wrapped(value - bearing)).rmse:.4g}")
        rows.append([name, *cells])
    # `theta` of the loop's last turn is the record across north
    south = direction_finder(100, bearing=180.0, batch=COUNT, rng=generator(6)).theta
    medians = (
        np.median(south, axis=-1) - 180,
        np.median(screening.unwrap_about_median(theta), axis=-1),
        np.median(theta, axis=-1),
    )
    rows.append(["median", *(f"{Errors(_wrapped(m)).rmse:.4g}" for m in medians)])
    return markdown(["RMSE, degrees", "180°", "0°", "0°, without unwrapping"], rows)


def losses() -> str:
    """RMSE at N = 100 where the paper's algorithm loses, and where it wins."""
    cases = {"PS1": {}, "clean": CLEAN, "isolated singles": SINGLES}
    data = {name: records(100, COUNT, generator(7), **case) for name, case in cases.items()}
    few = np.abs(tertia.estimate_bearing(data["PS1"], period=None, method="paper", k=K1).polarity)
    data["PS1, polarity found ≤ .02"] = data["PS1"][few <= 0.02]
    rows = [
        [name, *(f"{method(theta).rmse:.3f}" for theta in data.values())]
        for name, method in METHODS.items()
    ]
    high = {"k-sigma, to the letter": classical(3.0), "paper, n_g=5": paper(5, 3.0)}
    high["paper, n_g=10"] = paper(10, 3.0)
    for name, method in high.items():
        rows.append([f"{name}, k1 = 3", *(f"{method(theta).rmse:.3f}" for theta in data.values())])
    return markdown(["RMSE at N = 100, degrees", *data], rows)


def variance_tests() -> str:
    """How often a clean record loses a block to the test of the variances, N = 100."""
    clean = records(100, COUNT, generator(9), **CLEAN)
    rows = []
    for size in (5, 10):
        tests = {"none": None, "Cochran, 5 %": "cochran", "k2 = L F": k2(100, size)}
        for name, test in (tests | {"Student, 5 %": "student"}).items():
            # a threshold of 20: nothing but the variances is tested
            options: dict[str, Any] = {
                "method": "paper",
                "block_size": size,
                "k": 20.0,
                "variance_test": test,
            }
            result = tertia.estimate_bearing(clean, period=None, **options)
            ratio = Errors(np.asarray(result.value)).rmse / METHODS["mean"](clean).rmse
            lost = np.mean(result.outlier.any(axis=-1))
            rows.append([name, f"{size}", f"{lost:.1%}", f"{ratio:.2f}"])
    head = ["test", "n_g", "clean records that lose a block", "RMSE / RMSE of the mean"]
    return markdown(head, rows)


def coverage_figure() -> Figure:
    """Coverage of 2 sigma over N."""
    sizes = (20, 30, 50, 70, 100, 140, 200, 300, 400, 600)
    figure = Figure(figsize=(9, 3.9), layout="constrained")
    for ax, (label, scenario) in zip(
        figure.subplots(1, 2, sharey=True), (("clean data", CLEAN), ("PS1", {})), strict=True
    ):
        data = [records(n, repetitions(10_000), generator(8, n), **scenario) for n in sizes]
        for name, (color, style) in COVERAGE_LINES.items():
            shares = [METHODS[name](theta).coverage for theta in data]
            ax.plot(sizes, shares, style, color=color, label=name, linewidth=1.6)
        ax.axhline(0.9545, color="black", linewidth=0.8)
        ax.set(xscale="log", xlabel="measurements N", title=label, ylim=(0.3, 1.02))
        ax.set_xticks([20, 50, 100, 200, 500], ["20", "50", "100", "200", "500"])
        ax.minorticks_off()
    figure.axes[0].set_ylabel("share of errors within 2 sigma (nominal .954)")
    figure.axes[0].legend(fontsize=8, frameon=False, loc="lower left")
    return figure


def scenarios_figure() -> Figure:
    """RMSE of the default in random scenarios over that of the best of the paper's."""
    found = scenario_errors()
    best = np.min([found[f"paper, n_g={size}"] for size in (5, 10, 20)], axis=0)
    figure = Figure(figsize=(6.5, 3.9), layout="constrained")
    ax = figure.subplots()
    for name, marker, color in (("default", "o", GREEN), ("mean", "x", GREY), ("oracle", ".", SKY)):
        ratio = found[name] / best
        ax.plot(found["share"], ratio, marker, color=color, label=name, markersize=5)
    ax.axhline(1, color="black", linewidth=0.8)
    ax.set(yscale="log", xlabel="share of outliers")
    ax.set_ylabel("RMSE over that of the best of\nthe paper's (n_g = 5, 10, 20)")
    ax.set_yticks([0.2, 0.5, 1, 2, 5], ["0.2", "0.5", "1", "2", "5"])
    ax.minorticks_off()
    ax.legend(fontsize=8, frameon=False)
    return figure
