"""The tables and pictures of the pages on the Kalman filter, on fusion and its accuracy."""

import functools
import itertools
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies.montecarlo import FloatArray, generator
from studies.pages import BLUE, GREY, ORANGE, PURPLE, markdown, repetitions
from tertia import metrics, simulate
from tertia.fusion import FusedSeries, fuse_series
from tertia.kalman import (
    AngleFilter,
    FilteredSeries,
    SingerModel,
    SmoothedSeries,
    filter_series,
    fit_noise,
    smooth_series,
    steady_state,
)
from tertia.simulate import RadarScenario, ScenarioName, radar_scenario

RUNS = repetitions(1000)
STEPS = 120
FAULT = 60
SETTLED = 20
SIGMA = 0.1

MODEL = SingerModel(5.0, 1 / 20, 0.003)
MODELS = {
    "α = 1/20, σ_a = .003, as printed": MODEL,
    "α = 1/60, σ_a = .01, exact": SingerModel(5.0, 1 / 60, 0.01, exact=True),
    "α = 1/20, σ_a = .0001, exact": SingerModel(5.0, 1 / 20, 0.0001, exact=True),
    "T = 10, α = 1/120, σ_a = .001, exact": SingerModel(10.0, 1 / 120, 0.001, exact=True),
    "α = 1/10, σ_a = .03, exact": SingerModel(5.0, 1 / 10, 0.03, exact=True),
    "T = 8, α = 1/15, σ_a = .02, exact": SingerModel(8.0, 1 / 15, 0.02, exact=True),
    "T = 3, α = 1/40, σ_a = .0005, exact": SingerModel(3.0, 1 / 40, 0.0005, exact=True),
}
RULES: dict[str, str] = {
    "equal": "equal",
    "static": "static",
    "paper": "paper",
    "ewma": "ewma",
    "posterior": "posterior",
    "matrix": "matrix",
    "covariance-intersection": "covariance-intersection",
    "adaptive": "adaptive",
    "adaptive-matrix": "adaptive-matrix",
    "central": "central",
    "robust": "**robust**",
}
SCENARIOS: tuple[ScenarioName, ...] = get_args(ScenarioName)
# RMSE in millidegrees of an independent simulation, in the order of SCENARIOS
EXPECTED: dict[str, tuple[float, ...]] = {
    "radar 1 alone": (86.2, 86.9, 86.7, 84.2, 45.5, 48.8, 173, 86.3),
    "equal": (63.9, 171, 168, 59.9, 86.3, 89.2, 258, 80.1),
    "static": (63.9, 171, 168, 59.9, 44.6, 89.2, 258, 80.1),
    "paper": (76.4, 131, 85.1, 72.3, 82.8, 80.8, 441, 124),
    "ewma": (65.6, 81.8, 73.8, 61.4, 48.0, 51.6, 286, 82.5),
    "posterior": (63.9, 171, 168, 59.9, 44.7, 89.2, 100, 75.2),
    "matrix": (63.9, 171, 168, 59.9, 44.6, 89.2, 98.1, 75.0),
    "covariance-intersection": (63.9, 171, 168, 59.9, 45.5, 89.2, 110, 86.3),
    "adaptive": (64.4, 80.8, 74.8, 60.1, 45.3, 51.1, 102, 76.0),
    "adaptive-matrix": (64.6, 81.0, 75.1, 60.1, 45.9, 51.2, 100, 76.1),
    "central": (63.0, 176, 172, 61.2, 44.3, 90.1, 97.4, 73.9),
}


@dataclass(frozen=True)
class Rms:
    """Root mean square error in millidegrees; the runs are independent, the scans are not."""

    squares: FloatArray

    @classmethod
    def of(cls, error: FloatArray) -> "Rms":
        """Take errors (runs, scans)."""
        return cls(np.mean((1000 * error) ** 2, axis=-1))

    @property
    def value(self) -> float:
        """The RMSE."""
        return float(np.sqrt(self.squares.mean()))

    @property
    def error(self) -> float:
        """Its standard error."""
        return float(self.squares.std() / np.sqrt(self.squares.size) / (2 * self.value))

    def ratio(self, other: "Rms") -> tuple[float, float]:
        """Return the ratio to another of the same runs, and its standard error."""
        ratio = self.value / other.value
        apart = self.squares / self.value**2 - other.squares / other.value**2
        return ratio, float(ratio * apart.std() / np.sqrt(apart.size) / 2)


def case(name: ScenarioName, model: SingerModel = MODEL, runs: int = RUNS) -> RadarScenario:
    """Simulate a scenario."""
    rng = generator(60, SCENARIOS.index(name))
    return radar_scenario(name, model=model, steps=STEPS, batch=runs, rng=rng)


def noisier(factor: float) -> RadarScenario:
    """Simulate "noisy" with another factor of the noise than 5."""
    scenario = radar_scenario("noisy", model=MODEL, steps=STEPS, batch=RUNS, rng=generator(60, 99))
    late, truth = scenario.z[:, 1, FAULT:], scenario.truth[:, FAULT:, 0]
    late[:] = truth + factor / 5 * (late - truth)
    return scenario


def fused(scenario: RadarScenario, method: str) -> FusedSeries:
    """Return the track of a rule."""
    return fuse_series(
        scenario.z,
        scenario.measurement_variance,
        scenario.model,
        method=method,  # type: ignore[arg-type]
    )


def errors(scenario: RadarScenario, angle: FloatArray) -> FloatArray:
    """Return the errors (runs, scans) of angles in the scans that count."""
    error: FloatArray = (angle - scenario.truth[..., 0])[:, scenario.counted]
    return error


def alone(scenario: RadarScenario, radar: int) -> FilteredSeries:
    """Return the track of a radar's own filter."""
    variance = scenario.measurement_variance[radar]
    return filter_series(scenario.z[:, radar], variance, scenario.model)


def literal_paper(scenario: RadarScenario) -> FloatArray:
    """Return the angle of the rule with a radar that has no plot: Y = 0, so all the weight."""
    tracks, corrections = [], []
    for radar in (0, 1):
        result = alone(scenario, radar)
        tracks.append(result.mean[..., 0])
        corrections.append(np.nan_to_num(result.gain[..., 0] * result.innovation) ** 2)
    first, second = corrections
    total = first + second
    w1 = np.divide(second, total, out=np.full(total.shape, 0.5), where=total > 0)
    angle: FloatArray = w1 * tracks[0] + (1 - w1) * tracks[1]
    return angle


def filtered_again(angle: FloatArray, scenario: RadarScenario) -> FloatArray:
    """Return fused angles after the third filter, whose noise is that of the first radar."""
    variance = scenario.measurement_variance[0]
    mean: FloatArray = filter_series(angle, variance, scenario.model).mean[..., 0]
    return mean


@functools.cache
def results(model: str) -> dict[tuple[str, str], Rms]:
    """Return the errors of all rules in all scenarios."""
    found = {}
    for name in SCENARIOS:
        scenario = case(name, MODELS[model])

        def note(
            rule: str, angle: FloatArray, at: RadarScenario = scenario, name: str = name
        ) -> None:
            found[rule, name] = Rms.of(errors(at, angle))

        note("radar 1 alone", alone(scenario, 0).mean[..., 0])
        for rule in RULES:
            angle = fused(scenario, rule).mean[..., 0]
            note(rule, angle)
            if rule == "paper":
                note("paper, third filter", filtered_again(angle, scenario))
        note("paper, as printed", literal_paper(scenario))
    return found


def three(value: float) -> str:
    """Format with three digits."""
    return f"{value:.0f}" if value >= 99.95 else f"{value:.1f}"


def rmse() -> str:
    """RMSE of all rules in all scenarios, beside those of an independent simulation."""
    found = results(next(iter(MODELS)))
    labels = {
        "radar 1 alone": "radar 1 alone",
        **RULES,
        "paper, as printed": "paper, as printed",
        "paper, third filter": "paper, third filter",
    }
    rows, apart = [], []
    for rule, label in labels.items():
        cells = []
        for i, name in enumerate(SCENARIOS):
            result = found[rule, name]
            cell = f"{three(result.value)} ± {result.error:.1g}"
            if rule in EXPECTED:
                expected = EXPECTED[rule][i]
                cell += f" ({expected:g})"
                apart.append((abs(result.value / expected - 1), label, name))
            cells.append(cell)
        rows.append([label, *cells])
    of_letter = [
        abs(found["paper, as printed", name].value / EXPECTED["paper"][i] - 1)
        for i, name in enumerate(SCENARIOS)
    ]
    close = sum(gap <= 0.03 for gap, *_ in apart)
    far = "; ".join(f"{label} in '{name}'" for gap, label, name in apart if gap > 0.03)
    text = (
        f"\n{RUNS} runs. Within 3 % of the independent figures: {close} of {len(apart)}. "
        f"Farther away: {far}. Largest difference of 'paper, as printed' from the independent "
        f"'paper': {max(of_letter):.1%}.\n"
    )
    return markdown(["RMSE, millidegrees", *SCENARIOS], rows) + text


def worst_ratios() -> str:
    """Largest ratio to the best rule over the scenarios, for all models of the motion."""
    rows = []
    literal = ("paper, as printed", "paper, third filter")
    for rule, label in (*RULES.items(), *zip(literal, literal, strict=True)):
        cells = []
        for model in MODELS:
            found = results(model)
            ratios = {
                name: found[rule, name].value / min(found[other, name].value for other in RULES)
                for name in SCENARIOS
            }
            worst = max(ratios, key=lambda name: ratios[name])
            cells.append(f"{ratios[worst]:.2f} ({worst})")
        rows.append([label, *cells])
    return markdown(["RMSE relative to the best rule, worst scenario", *MODELS], rows)


def every_ratio() -> str:
    """Ratio of the default to the best of the others, in every scenario and for every model."""
    rows = []
    for model, rule in itertools.product(MODELS, ("robust", "adaptive")):
        found = results(model)
        cells = []
        for name in SCENARIOS:
            others = [other for other in RULES if other != "robust"]
            best = min(others, key=lambda other: found[other, name].value)
            ratio = found[rule, name].value / found[best, name].value
            cells.append(f"{ratio:.3f} ({best})")
        rows.append([model, rule, *cells])
    return markdown(["RMSE relative to the best rule except 'robust'", "", *SCENARIOS], rows)


def cost() -> str:
    """Compare with equal weights where nothing is wrong."""
    rows = []
    for model, motion in MODELS.items():
        found = results(model)
        cells = []
        for rule in ("paper", "ewma", "adaptive", "adaptive-matrix", "robust"):
            ratio, error = found[rule, "healthy"].ratio(found["equal", "healthy"])
            cells.append(f"{100 * (ratio - 1):+.1f} ± {100 * error:.1g}")
        scenario = case("healthy", motion)
        result = fused(scenario, "robust")
        window = scenario.counted
        accused = (result.noise_variance > 2 * SIGMA**2)[..., window].mean()
        cells += [f"{accused:.1%}", f"{result.outlier[..., window].mean():.2%}"]
        rows.append([model, *cells])
    head = [
        "healthy: excess of RMSE over equal weights, %",
        "paper",
        "ewma",
        "adaptive",
        "adaptive-matrix",
    ]
    costs = ["robust: plots with R estimated twice as large", "robust: plots taken for outliers"]
    return markdown([*head, "robust", *costs], rows)


def per_dimension(error: FloatArray, covariance: FloatArray) -> str:
    """Format NEES per dimension with its standard error: (runs, scans, m)."""
    values = np.asarray(metrics.nees(error, covariance)) / error.shape[-1]
    of_runs = values.mean(axis=-1)
    return f"{of_runs.mean():.3g} ± {of_runs.std() / np.sqrt(of_runs.size):.1g}"


def consistency() -> str:
    """NEES per dimension of all rules, healthy and after the onset of noise."""
    # every second scan, for time's sake
    healthy = case("healthy", runs=repetitions(500)), slice(SETTLED, None, 2)
    onset = case("noisy", runs=repetitions(500)), slice(FAULT, None, 2)
    later = onset[0], slice(FAULT + 10, None, 2)
    both = (healthy, onset, later)
    naive = []
    for scenario, window in both:
        first, second = (alone(scenario, i) for i in (0, 1))
        error = ((first.mean + second.mean) / 2 - scenario.truth)[:, window]
        naive.append(per_dimension(error, first.covariance[:, window] / 2))
    rows = [["equal, errors treated as independent", *naive]]
    for rule, label in RULES.items():
        of_healthy, of_onset = fused(healthy[0], rule), fused(onset[0], rule)
        cells = []
        for (scenario, window), result in zip(both, (of_healthy, of_onset, of_onset), strict=True):
            error = (result.mean - scenario.truth)[:, window]
            cells.append(per_dimension(error, result.covariance[:, window]))
        rows.append([label, *cells])
    head = ["NEES per dimension", "healthy", f"noise ×5: scans {FAULT} to {STEPS - 1}"]
    return markdown([*head, f"{FAULT + 10} to {STEPS - 1}"], rows)


def every_consistency() -> str:
    """NEES per dimension in every scenario and for every model."""
    rows = []
    for (model, motion), rule in itertools.product(
        MODELS.items(), ("central", "adaptive", "robust")
    ):
        cells = []
        for name in SCENARIOS:
            scenario = case(name, motion, runs=repetitions(400))
            result = fused(scenario, rule)
            window = np.flatnonzero(scenario.counted)[::2]
            error = (result.mean - scenario.truth)[:, window]
            cells.append(per_dimension(error, result.covariance[:, window]))
        rows.append([model, rule, *cells])
    return markdown(["NEES per dimension", "", *SCENARIOS], rows)


# size of usual outliers, in standard deviations
OUTLIER = 15.0


def several_faults() -> str:
    """RMSE and NEES with other numbers of radars, and with more than one fault."""
    late = np.arange(STEPS) >= FAULT
    usual, worse = np.ones(STEPS), np.where(late, 5.0, 1.0)
    # noise over what is stated, and the share of outliers, of each radar, and their size in sigmas
    cases: dict[str, tuple[list[FloatArray], float] | tuple[list[FloatArray], float, float]] = {
        "1 radar, healthy": ([usual], 0),
        "1, outliers 10 %": ([usual], 0.1),
        "1, ×5": ([worse], 0),
        "2, both ×5": ([worse] * 2, 0),
        "2, outliers 10 % of both": ([usual] * 2, 0.1),
        "3, healthy": ([usual] * 3, 0),
        "3, two ×5": ([usual, worse, worse], 0),
        "3, outliers 10 % of all": ([usual] * 3, 0.1),
        "5, two ×5, outliers 10 % of all": ([usual] * 3 + [worse] * 2, 0.1),
        "1, outliers 10 %, 200 σ": ([usual], 0.1, 200.0),
        "2, outliers 10 % of both, 200 σ": ([usual] * 2, 0.1, 200.0),
        "3, outliers 10 % of all, 200 σ": ([usual] * 3, 0.1, 200.0),
    }
    rows = []
    for i, (name, (factors, wrong, *size)) in enumerate(cases.items()):
        record = simulate.radars(
            MODEL,
            STEPS,
            sigma=SIGMA * np.stack(factors),
            outlier_probability=wrong,
            outlier_size=size[0] if size else OUTLIER,
            batch=repetitions(400),
            rng=generator(67, i),
        )
        cells = []
        for rule in ("equal", "central", "adaptive", "robust"):
            result = fuse_series(record.z, SIGMA**2, MODEL, method=rule)
            error = (result.mean - record.truth)[:, SETTLED:]
            nees = per_dimension(error, result.covariance[:, SETTLED:]).split(" ")[0]
            cells.append(f"{three(Rms.of(error[..., 0]).value)}, {nees}")
        rows.append([name, *cells])
    head = ["RMSE in millidegrees, NEES per dimension", "equal", "central", "adaptive", "robust"]
    return markdown(head, rows)


def paper_weights() -> str:
    """Measure what is wrong with weights of one sample."""
    scenario = case("healthy")
    own = [alone(scenario, i) for i in (0, 1)]
    error = np.stack([result.mean - scenario.truth for result in own])[:, :, scenario.counted]
    innovation = own[0].innovation[:, scenario.counted]
    rho = [np.corrcoef(error[0, ..., c].ravel(), error[1, ..., c].ravel())[0, 1] for c in (0, 1)]
    with_own = np.corrcoef(innovation.ravel(), error[0, ..., 0].ravel())[0, 1]
    squares = np.corrcoef(innovation.ravel() ** 2, error[0, ..., 0].ravel() ** 2)[0, 1]
    single = float(np.mean(error[..., 0] ** 2))
    predicted = 1000 * np.sqrt(single * (0.75 + 0.25 * rho[0]))
    best = 1000 * np.sqrt(single * (0.5 + 0.5 * rho[0]))
    found = results(next(iter(MODELS)))
    paper, third = found["paper", "healthy"], found["paper, third filter", "healthy"]
    rho_a = np.corrcoef(error[0, ..., 2].ravel(), error[1, ..., 2].ravel())[0, 1]
    rows = [
        ["correlation of a plot's innovation with the error of the updated angle", with_own, ".3f"],
        ["correlation of the squares of these two", squares, ".3f"],
        ["correlation of the errors of the two radars in angle", rho[0], ".2f"],
        ["correlation of the errors of the two radars in rate", rho[1], ".2f"],
        ["correlation of the errors of the two radars in acceleration", rho_a, ".2f"],
        ["RMSE with equal weights, predicted, millidegrees", best, ".1f"],
        ["measured", found["equal", "healthy"].value, ".1f"],
        ["RMSE with the paper's weights, predicted, millidegrees", predicted, ".1f"],
        ["measured", paper.value, ".1f"],
        [
            "RMSE after the third filter, divided by the RMSE before it, healthy",
            third.ratio(paper)[0],
            ".3f",
        ],
    ]
    turn = case("turn")
    once = fused(turn, "paper").mean[..., 0]
    again = filtered_again(once, turn)
    before, after = (
        np.sqrt(np.mean((angle - turn.truth[..., 0]) ** 2, axis=0)) for angle in (once, again)
    )
    at = FAULT + int(np.argmax(after[FAULT : FAULT + 20]))
    rows.append(
        [
            f"the same at the turn, scan {at}, where its error is largest",
            float(after[at] / before[at]),
            ".2f",
        ]
    )
    formatted = [[name, f"{value:{form}}"] for name, value, form in rows]
    return markdown(["", "value"], formatted)


def mean_weights() -> str:
    """Mean weights of the better radar, with unequal gains."""
    scenario = case("known")
    rows = []
    for rule in ("posterior", "adaptive", "paper"):
        weights = fused(scenario, rule).weights[:, 0, SETTLED:]
        rows.append([rule, *(f"{w:.2f}" for w in weights.mean(axis=(0, 1)))])
    first, second = ((alone(scenario, i).mean - scenario.truth)[:, SETTLED:] for i in (0, 1))
    variances = [np.mean(error**2, axis=(0, 1)) for error in (first, second)]
    covariance = np.mean(first * second, axis=(0, 1))
    best = (variances[1] - covariance) / (variances[0] + variances[1] - 2 * covariance)
    rows.insert(0, ["best, computed from the errors", *(f"{w:.2f}" for w in best)])
    return markdown(["mean weight of the better radar", "angle", "rate", "acceleration"], rows)


def noise_factors() -> str:
    """From what wrong noise on do the rules pay."""
    factors = (1, 1.5, 2, 2.5, 3, 4, 5, 10)
    rules = ("equal", "paper", "ewma", "adaptive", "adaptive-matrix", "robust")
    rows: list[list[str]] = [[rule] for rule in rules]
    for factor in factors:
        scenario = case("noisy") if factor == 5 else noisier(factor)
        for row, rule in zip(rows, rules, strict=True):
            angle = fused(scenario, rule).mean[..., 0]
            row.append(three(Rms.of((angle - scenario.truth[..., 0])[:, FAULT:]).value))
    head = [f"RMSE, scans {FAULT} to {STEPS - 1}, millidegrees: noise of radar 2"]
    return markdown([*head, *(f"×{factor:g}" for factor in factors)], rows)


def fault_windows() -> str:
    """RMSE in the fault alone."""
    rows = []
    places: dict[ScenarioName, tuple[int, int, int]] = {
        "noisy": (FAULT, FAULT + 10, STEPS),
        "outliers": (FAULT, FAULT + 20, FAULT + 30),
        "outage": (FAULT, FAULT + 8, FAULT + 18),
        "turn": (FAULT, FAULT + 12, FAULT + 22),
    }
    scenarios = {name: case(name) for name in places}
    head = ["RMSE, millidegrees"]
    for name, edges in places.items():
        head += [f"{name}, {a} to {b - 1}" for a, b in itertools.pairwise(edges)]
    for rule, label in RULES.items():
        cells = []
        for name, edges in places.items():
            scenario = scenarios[name]
            error = fused(scenario, rule).mean[..., 0] - scenario.truth[..., 0]
            for a, b in itertools.pairwise(edges):
                cells.append(three(Rms.of(error[:, a:b]).value))
        rows.append([label, *cells])
    return markdown(head, rows)


def track_figure() -> Figure:
    """Draw a track with outliers and a radar that becomes noisy."""
    steps, rng = STEPS, generator(61, 5)
    scan = np.arange(float(steps))
    factor = np.where(scan >= 70, 5.0, 1.0)
    wrong = 0.3 * ((scan >= 30) & (scan < 45))
    record = simulate.radars(
        MODEL,
        steps,
        sigma=SIGMA * np.stack([np.ones(steps), factor]),
        outlier_probability=np.stack([np.zeros(steps), wrong]),
        rng=rng,
    )
    figure = Figure(figsize=(9, 7.6), layout="constrained")
    axes = figure.subplots(4, 1, sharex=True, height_ratios=[1, 1, 0.8, 0.8])
    found: dict[str, FusedSeries] = {}
    for axis, method, color in ((axes[0], "equal", ORANGE), (axes[1], "robust", BLUE)):
        found[method] = fuse_series(record.z, SIGMA**2, MODEL, method=method)  # type: ignore[arg-type]
        result = found[method]
        _band(axis, scan, result.mean[:, 0] - record.truth[:, 0], result.sigma[:, 0], color)
        axis.set_ylim(-1.1, 1.1)
        axis.set_ylabel("error, degrees", fontsize=9)
        axis.set_title(f"{method}: error of the fused angle, ±2 sigma as claimed", fontsize=10)
    robust = found["robust"]
    axes[2].plot(scan, robust.weights[1, :, 0], color=BLUE, lw=1.4)
    axes[2].set_ylim(-0.02, 0.72)
    axes[2].set_title("robust: share of radar 2 in the correction", fontsize=10)
    for radar, color in ((0, GREY), (1, ORANGE)):
        believed = np.sqrt(robust.noise_variance[radar])
        axes[3].semilogy(scan, believed, color=color, lw=1.4, label=f"radar {radar + 1}, believed")
    axes[3].semilogy(scan, SIGMA * factor, "k:", lw=1, label="radar 2, true (but outliers)")
    outlier = record.outlier[1]
    size = np.abs(record.z[1] - record.truth[:, 0])
    axes[3].semilogy(scan[outlier], size[outlier], "x", color=PURPLE, ms=6, label="true outliers")
    axes[3].set_ylim(0.05, 9)
    axes[3].set_title("robust: standard deviation of the plots, degrees", fontsize=10)
    axes[3].legend(ncols=4, fontsize=8, loc="upper right", frameon=False)
    axes[3].set_xlabel("scan", fontsize=9)
    for axis in axes:
        axis.axvspan(30, 44, color=GREY, alpha=0.12, lw=0)
        axis.axvspan(70, steps - 1, color=GREY, alpha=0.12, lw=0)
        axis.tick_params(labelsize=8)
        axis.set_xlim(0, steps - 1)
    return figure


def _band(axis: Axes, x: FloatArray, error: FloatArray, sigma: FloatArray, color: str) -> None:
    axis.fill_between(x, -2 * sigma, 2 * sigma, color=color, alpha=0.2, lw=0)
    axis.plot(x, error, color=color, lw=1.4)
    axis.axhline(0, color=GREY, lw=0.6)


def textbook(
    steps: int,
    start: FloatArray,
    form: Callable[[FloatArray, FloatArray, FloatArray], FloatArray],
    mixed: bool = False,
) -> tuple[FloatArray, FloatArray]:
    """Return the gains of the filter and its last covariance, with P⁻ as `form` has it of F, P, Q.

    `mixed`: (20) with the element 22 in the place 12.
    """
    f, q = MODEL.transition(), MODEL.process_noise()
    p, gains = start, []
    for step in range(steps):
        prior = p if step == 0 else form(f, p, q)
        gain = prior[:, 0] / (prior[0, 0] + SIGMA**2)
        gains.append(gain)
        p = prior - np.outer(gain, prior[0])
        if mixed:
            p = p.copy()
            p[0, 1] = p[1, 1]
    return np.array(gains), p


def misprints() -> str:
    """Gains of the filter as printed and as mended."""

    def mended(f: FloatArray, p: FloatArray, q: FloatArray) -> FloatArray:
        result: FloatArray = f @ p @ f.T + q
        return result

    def transposed(f: FloatArray, p: FloatArray, q: FloatArray) -> FloatArray:
        wrong = f.T.copy()
        wrong[0, 0], wrong[2, 2] = f[2, 2], 1.0
        result: FloatArray = f @ p @ wrong + q
        return result

    def product(f: FloatArray, p: FloatArray, q: FloatArray) -> FloatArray:
        result: FloatArray = f @ p @ f.T @ q
        return result

    def rms(f: FloatArray, p: FloatArray, q: FloatArray) -> FloatArray:
        result: FloatArray = f @ p @ f.T + np.sqrt(q)
        return result

    start = np.diag([SIGMA**2, 0.04, 0.0001])
    right, right_p = textbook(300, start, mended)
    variants: dict[str, tuple[Any, bool]] = {
        "corrected": (mended, False),
        "(18): × before the noise": (product, False),
        "(18): 1 − αT in the corner (1, 1)": (transposed, False),
        "(18), (20): element 22 in the place 12": (mended, True),
        "noise as an rms error, not squared": (rms, False),
    }
    rows = []
    for name, (form, mixed) in variants.items():
        gains, p = textbook(300, start, form, mixed)
        # no gain of rate and acceleration at the first plot
        apart = np.abs(gains[1:30] / right[1:30] - 1).max()
        sigma = np.sqrt(np.diagonal(right_p))
        skew = np.abs((p - p.T) / np.outer(sigma, sigma)).max()
        shown = ", ".join(f"{value:.3g}" if abs(value) > 1e-12 else "0" for value in gains[-1])
        rows.append([name, shown, f"{apart:.0%}", f"{skew:.1g}" if skew > 1e-9 else "0"])
    head = ["variant", "gain after 300 scans", "largest difference of a gain, 30 scans"]
    return markdown([*head, "asymmetry of P, as a correlation"], rows)


def wide_priors() -> str:
    """How much a wide prior in place of the exact start loses, with and without factors."""
    rng = generator(62)
    z = simulate.radars(MODEL, 10, sigma=(SIGMA,), rng=rng).z[0]
    exact = filter_series(z, SIGMA**2, MODEL)
    back = smooth_series(z, SIGMA**2, MODEL)
    wide_exact = exact.upper[-1, 0]
    rows = []
    for power in (2, 4, 6, 8, 9, 12, 14, 16):
        w = 10.0**power
        start = np.diag([w * SIGMA**2, w * SIGMA**2 / MODEL.dt**2, MODEL.acceleration_sigma**2])
        found = filter_series(z, SIGMA**2, MODEL, initial=(np.zeros(3), start))
        _, p = textbook(10, start, lambda f, p, q: f @ p @ f.T + q)
        smoothed = smooth_series(z, SIGMA**2, MODEL, initial=(np.zeros(3), start))
        values = (
            abs(p[0, 0] / wide_exact - 1),
            abs(found.upper[-1, 0] / wide_exact - 1),
            abs(found.mean[-1, 0] - exact.mean[-1, 0]) / SIGMA,
            abs(smoothed.mean[0, 0] - back.mean[0, 0]) / SIGMA,
        )
        cells = [f"{value:.0e}" if value else "0" for value in values]
        rows.append([f"1e{power}", *cells])
    head = ["prior relative to noise", "variance of the angle, short formula (I − K h') P"]
    head += ["variance of the angle, here"]
    head += ["error of angle, relative to σ", "error of smoothed first angle, relative to σ"]
    return markdown(head, rows)


def smoothing() -> str:
    """Smoothed over filtered standard deviations in the steady state."""
    ratios = (0.01, 0.1, 1.0, 10.0)
    rows = []
    for alpha in (0.01, 0.05, 0.25, 1.0):
        cells = []
        for ratio in ratios:
            model = SingerModel(1.0, alpha, ratio, exact=True)
            z = np.zeros(1201)
            smoothed = smooth_series(z, 1.0, model).sigma[600]
            filtered = np.sqrt(np.diagonal(steady_state(model, 1.0)[1]))
            cells.append(", ".join(f"{s / f:.2f}" for s, f in zip(smoothed, filtered, strict=True)))
        rows.append([f"{alpha:g}", *cells])
    return markdown(["αT", *(f"σ_a T²/σ = {ratio:g}" for ratio in ratios)], rows)


def fit_coverage() -> str:
    """How good the estimates of the noise are, and whether their errors are true."""
    runs = repetitions(200, 10)
    usual = SingerModel(5.0, 1 / 20, 0.003, exact=True)
    cases: dict[str, tuple[SingerModel, int, float]] = {
        "usual, 60 plots": (usual, 60, 1.0),
        "usual, 200": (usual, 200, 1.0),
        "usual, 600": (usual, 600, 1.0),
        "usual, 200 scans, Pd .7": (usual, 200, 0.7),
        "α = 1/60, σ_a = .01, 200": (SingerModel(5.0, 1 / 60, 0.01, exact=True), 200, 1.0),
        "αT = 2, σ_a = .03, 200": (SingerModel(5.0, 0.4, 0.03, exact=True), 200, 1.0),
    }
    rows = []
    for i, (name, (model, steps, seen)) in enumerate(cases.items()):
        z = simulate.radars(
            model,
            steps,
            sigma=(SIGMA,),
            detection_probability=seen,
            batch=runs,
            rng=generator(63, i),
        ).z
        fits = [fit_noise(record[0], dt=model.dt) for record in z]
        density = 2 * model.acceleration_sigma**2 / model.alpha
        true = np.array([model.alpha, model.acceleration_sigma, SIGMA, density])
        found = np.array(
            [[f.alpha, f.acceleration_sigma, f.measurement_sigma, f.density] for f in fits]
        )
        claimed = np.array([[*fit.sigma, fit.density_sigma] for fit in fits]) / found
        cells = []
        for c in range(4):
            known = np.isfinite(claimed[:, c])
            error = np.log(found[known, c] / true[c])
            covered = np.mean(np.abs(error) <= 2 * claimed[known, c])
            middle, usual_error = np.exp(np.median(error)), np.median(claimed[known, c])
            cells.append(f"{middle:.2f} ± {usual_error:.0%}; {covered:.0%}")
        rows.append([name, *cells, f"{np.mean(np.isinf(claimed[:, 0])):.0%}"])
    return markdown(["recording", "alpha", "σ_a", "σ", "density", "alpha not determined"], rows)


def filter_consistency() -> str:
    """Metrics of filters that fit and that do not."""
    runs, steps = 200, 220
    model = SingerModel(5.0, 1 / 20, 0.003, exact=True)
    record = simulate.radars(model, steps, sigma=(SIGMA,), batch=runs, rng=generator(64))
    variants = {
        "correct parameters": (model, SIGMA**2),
        "stated σ half the true σ": (model, SIGMA**2 / 4),
        "stated σ twice the true σ": (model, SIGMA**2 * 4),
        "σ_a a third of the true σ_a": (SingerModel(5.0, 1 / 20, 0.001, exact=True), SIGMA**2),
        "σ_a three times the true σ_a": (SingerModel(5.0, 1 / 20, 0.009, exact=True), SIGMA**2),
        "1 − αT instead of exp(−αT)": (MODEL, SIGMA**2),
    }
    late = slice(SETTLED, None)
    rows = []
    for name, (used, variance) in variants.items():
        result = filter_series(record.z[:, 0], variance, used)
        innovation, s = result.innovation[:, late], result.innovation_variance[:, late]
        nis = np.asarray(metrics.nis(innovation, s)).mean()
        lag = metrics.autocorrelation(innovation / np.sqrt(s), nlags=1)[:, 1].mean()
        error = (result.mean - record.truth)[:, late]
        rmse_of = 1000 * float(metrics.rmse(error[..., 0]))
        nees = per_dimension(error, result.covariance[:, late])
        rows.append([name, f"{nis:.3f}", f"{lag:+.3f}", nees, f"{rmse_of:.1f}"])
    low, high = metrics.consistency_bounds(runs * (steps - SETTLED))
    head = ["filter", f"mean NIS ({low:.3f} to {high:.3f})", "autocorrelation, lag 1"]
    return markdown([*head, "NEES per dimension", "RMSE, millidegrees"], rows)


def accuracy() -> str:
    """Differences between ways to compute the same."""
    rng = generator(65)
    record = simulate.radars(MODEL, 2000, sigma=(SIGMA,), angle=359.0, period=360.0, rng=rng)
    z = np.where(rng.random(2000) < 0.2, np.nan, record.z[0])
    series = filter_series(z, SIGMA**2, MODEL, period=360.0)
    track = AngleFilter(MODEL, SIGMA**2, period=360.0)
    angles = np.array([track.step(float(plot)) for plot in z])
    known = ~np.isnan(angles)
    streaming = float(np.abs(angles - series.mean[:, 0])[known].max())
    gain, covariance = steady_state(MODEL, SIGMA**2)
    long = filter_series(np.zeros(1000), SIGMA**2, MODEL)
    of_gain = float(np.abs(long.gain[-1] / gain - 1).max())
    of_covariance = float(np.abs(long.covariance[-1] / covariance - 1).max())
    smoothed = smooth_series(z, SIGMA**2, MODEL, period=360.0)
    last = float(np.abs(smoothed.mean[-1] - series.mean[-1]).max())
    truth = record.truth[:, 0]
    unwrapped = truth + (z - truth + 180) % 360 - 180
    straight = filter_series(unwrapped, SIGMA**2, MODEL)
    across = np.abs((series.mean[:, 0] - straight.mean[:, 0] + 180) % 360 - 180)
    rows = [
        ["`AngleFilter` and `filter_series`, 2000 steps, degrees", _tiny(streaming)],
        [
            "`steady_state` and the gain of `filter_series` after 1000 steps, relative",
            _tiny(of_gain),
        ],
        [
            "`steady_state` and `filter_series` after 1000 steps, covariances, relative",
            _tiny(of_covariance),
        ],
        ["smoothed and filtered state at the last step", _tiny(last)],
        [
            "plots that wrap at north and plots that do not, angle, degrees",
            _tiny(float(np.nanmax(across))),
        ],
    ]
    return markdown(["largest difference", "value"], rows)


def _tiny(value: float) -> str:
    return f"{value:.0e}" if value else "0"


def smoothing_figure() -> Figure:
    """Draw errors of a filtered and of a smoothed track."""
    steps = 80
    seen = np.ones(steps)
    seen[35:43] = 0
    record = simulate.radars(
        MODEL, steps, sigma=(SIGMA,), detection_probability=seen, rng=generator(66)
    )
    z, truth = record.z[0], record.truth
    figure = Figure(figsize=(9, 4.6), layout="constrained")
    axes: Iterable[Axes] = figure.subplots(2, 1, sharex=True, sharey=True)
    found: dict[str, tuple[FilteredSeries | SmoothedSeries, str]] = {
        "filtered: error of the angle, ±2 sigma": (filter_series(z, SIGMA**2, MODEL), ORANGE),
        "smoothed": (smooth_series(z, SIGMA**2, MODEL), BLUE),
    }
    scan = np.arange(float(steps))
    for axis, (name, (result, color)) in zip(axes, found.items(), strict=True):
        axis.plot(scan, z - truth[:, 0], ".", color=GREY, ms=4)
        _band(axis, scan, result.mean[:, 0] - truth[:, 0], result.sigma[:, 0], color)
        axis.set_title(name, fontsize=10)
        axis.set_ylim(-1.3, 1.3)
        axis.set_ylabel("degrees", fontsize=9)
        axis.tick_params(labelsize=8)
    axis.set_xlabel("scan", fontsize=9)
    axis.set_xlim(0, steps - 1)
    return figure
