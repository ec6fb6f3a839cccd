"""The tables and pictures of the page on weights."""

import functools
import textwrap
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt
import passive_location
from matplotlib.figure import Figure

from studies.montecarlo import FloatArray, generator
from studies.pages import BLUE, GREEN, GREY, ORANGE, PURPLE, markdown, repetitions
from tertia import fusion, simulate, weights

Matrices = FloatArray
Exact = list[list[Fraction]]

SIZES = (5, 10, 30, 100)
TRIALS = repetitions(200_000)


def ellipse(a: float, b: float, degrees: float = 0.0) -> FloatArray:
    """Return the covariance with variances a and b along axes that are turned."""
    turn = rotation(2, degrees)
    matrix: FloatArray = turn @ np.diag([a, b]) @ turn.T
    return matrix


def rotation(m: int, degrees: float) -> FloatArray:
    """Return a rotation in the plane of the first two axes."""
    turn, angle = np.eye(m), np.radians(degrees)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return turn


def equal(m: int, sensors: int = 2) -> FloatArray:
    """Return equal sensors with covariance I."""
    return np.tile(np.eye(m), (sensors, 1, 1))


VECTOR = np.array([[[4, 1], [1, 2]], [[1, -0.5], [-0.5, 3]]])
CASES: dict[str, Matrices] = {
    "m = 1, equal": equal(1),
    "m = 2, equal": equal(2),
    "m = 2, crossed": np.array([np.diag([1.0, 4]), np.diag([4.0, 1])]),
    "m = 2, S2 = 10 S1": np.array([np.eye(2), 10 * np.eye(2)]),
    "m = 2, S2 = 100 S1": np.array([np.eye(2), 100 * np.eye(2)]),
    "m = 2, test vector": VECTOR,
    "m = 3, equal": equal(3),
    "m = 2, K = 3: I, 10 I, 100 I": np.array([np.eye(2), 10 * np.eye(2), 100 * np.eye(2)]),
    "m = 3, K = 10, equal": equal(3, 10),
}
# Monte Carlo losses of an independent simulation, per cent; its crossed ellipses are not given
EXPECTED: dict[str, tuple[float, ...]] = {
    "m = 2, equal": (41, 16.7, 5.2, 1.5),
    "m = 2, crossed": (50, 17.4, 4.8, 1.35),
    "m = 2, S2 = 10 S1": (57, 12.1, 2.2, 0.54),
    "m = 3, equal": (72, 24, 7.0, 2.0),
}
LINES = {
    "m = 2, equal": (BLUE, "o"),
    "m = 2, crossed": (GREEN, "s"),
    "m = 2, S2 = 10 S1": (ORANGE, "^"),
    "m = 2, S2 = 100 S1": (GREY, "v"),
    "m = 3, equal": (PURPLE, "D"),
}


def simulated(s: Matrices, n: Any, trials: int = TRIALS, **options: Any) -> tuple[float, float]:
    """Return the simulated loss and its standard error, per cent."""
    result = weights.fusion_loss(s, n, method="monte-carlo", trials=trials, **options)
    assert isinstance(result.loss, float)
    assert isinstance(result.loss_sigma, float)
    return 100 * result.loss, 100 * result.loss_sigma


def first_order(s: Matrices, n: Any, **options: Any) -> float:
    """Return the loss to first order, per cent."""
    return 100 * float(weights.fusion_loss(s, n, method="first-order", **options).loss)


def measured(s: Matrices, n: int, count: int, rng: np.random.Generator) -> FloatArray:
    """Draw n measurements of a target at zero by every sensor: (count, K, n, m)."""
    noise = rng.standard_normal((count, len(s), n, s.shape[-1]))
    result: FloatArray = noise @ np.swapaxes(np.linalg.cholesky(s), -1, -2)
    return result


def losses_with(s: Matrices, w: FloatArray) -> FloatArray:
    """Return the loss of a fused estimate that has these weights (..., K, m, m)."""
    mean_squared_error = (w @ s @ np.swapaxes(w, -1, -2)).sum(axis=-3)
    return trace(mean_squared_error) / trace(np.linalg.inv(np.linalg.inv(s).sum(axis=-3))) - 1


def trace(matrix: FloatArray) -> FloatArray:
    """Return the traces of the last two axes."""
    result: FloatArray = np.trace(matrix, axis1=-2, axis2=-1)
    return result


def literal_weights(covariances: Matrices) -> FloatArray:
    """Return the weights as printed, (6): every covariance and the sum of the inverses inverted."""
    precisions = np.linalg.inv(covariances)
    result: FloatArray = np.linalg.inv(precisions.sum(axis=-3, keepdims=True)) @ precisions
    return result


def short(value: float) -> str:
    """Format a loss with three digits."""
    return f"{value:.0f}" if value >= 100 else f"{value:#.3g}"


def mean_and_error(losses: FloatArray) -> tuple[float, float]:
    """Return the mean loss and its standard error, per cent."""
    return 100 * float(losses.mean()), 100 * float(losses.std() / np.sqrt(losses.size))


def exact_loss(m: int, nu: int) -> float:
    """Return the loss of two equal sensors, per cent."""
    total = (nu - 1) + nu * (2 * nu * m - 2) / (2 * nu - m - 1)
    return 100 * total / ((2 * nu - 1) * (nu + 1))


def loss() -> str:
    """Losses: simulated, to first order, and independent; and how far they are apart."""
    rows, of_exact, of_raw, of_expected = [], [], [], []
    for name, s in CASES.items():
        cells = []
        for i, n in enumerate(SIZES):
            trials = TRIALS if len(s) < 10 else TRIALS // 20
            value, error = simulated(s, n, trials, rng=generator(40, n))
            cell = f"{short(value)} ± {error:.1g} ({short(first_order(s, n))}"
            if name.endswith("equal") and len(s) == 2:
                of_exact.append((value - exact_loss(s.shape[-1], n - 1)) / error)
            if n <= 30 and len(s) < 10:
                x = measured(s, n, repetitions(20_000), generator(41, n))
                drawn = losses_with(s, literal_weights(weights.sample_covariance(x)))
                raw, raw_error = mean_and_error(drawn)
                of_raw.append((value - raw) / np.hypot(error, raw_error))
            if name in EXPECTED:
                expected = EXPECTED[name][i]
                cell += f"; {expected:g}"
                if name != "m = 2, crossed":
                    of_expected.append(abs(value / expected - 1))
            cells.append(cell + ")")
        rows.append([name, *cells])
    table = markdown(["loss, %", *(f"n = {n}" for n in SIZES)], rows)
    note = (
        "Largest |z| against the exact loss of two equal sensors: "
        f"{np.abs(of_exact).max():.1f}, of {len(of_exact)}; against the formulas as printed, "
        f"inverses included, with covariances of raw measurements: {np.abs(of_raw).max():.1f}, of "
        f"{len(of_raw)} (n ≤ 30). Largest difference from the independent figures, without the "
        f"crossed ones: {max(of_expected):.1%} of them."
    )
    return f"{table}\n{textwrap.fill(note, 100)}\n"


def loss_figure() -> Figure:
    """Loss over n, simulated and to first order."""
    sizes = (5, 6, 7, 8, 10, 14, 20, 30, 50, 100, 200)
    figure = Figure(figsize=(6.5, 4.2), layout="constrained")
    ax = figure.subplots()
    for name, (color, marker) in LINES.items():
        s = CASES[name]
        losses = [simulated(s, n, 50_000, rng=generator(42, n))[0] for n in sizes]
        ax.plot(sizes, losses, marker, color=color, label=name, markersize=5)
        ax.plot(sizes, [first_order(s, n) for n in sizes], color=color, linewidth=1.2)
    ax.axhline(5, color="black", linewidth=0.6)
    ax.set(xscale="log", yscale="log", xlabel="measurements n of each sensor", ylabel="loss, %")
    ax.set_xticks([5, 10, 20, 50, 100, 200], ["5", "10", "20", "50", "100", "200"])
    ax.set_yticks([0.1, 1, 5, 10, 100], ["0.1", "1", "5", "10", "100"])
    ax.minorticks_off()
    ax.set_title("dots: simulated; lines: to first order", fontsize=10)
    ax.legend(fontsize=8, frameon=False)
    return figure


def elements() -> str:
    """Compare standard deviation and bias of the elements of W with what is predicted."""
    count = repetitions(100_000)
    rows = []
    for name, s in list(CASES.items())[:7]:
        cells = []
        for n in SIZES:
            rng = generator(43, n)
            drawn = [simulate.wishart(matrix, n - 1, batch=count, rng=rng) for matrix in s]
            w = weights.weight_matrices(np.stack(drawn, axis=1))[:, -1]
            variances = np.diag(weights.weight_covariance(s, n)).reshape(s.shape[1:]).T
            ratio = w.std(axis=0) / np.sqrt(variances)
            cell = (
                f"{ratio.min():.2f} to {ratio.max():.2f}"
                if ratio.size > 1
                else f"{ratio[0, 0]:.2f}"
            )
            bias = (w.mean(axis=0) - weights.weight_matrices(s)[-1]).ravel()
            predicted = weights.weight_bias(s, n).ravel()
            largest = np.abs(predicted).argmax()
            if np.abs(predicted[largest]) > 20 * w.std(axis=0).max() / np.sqrt(count):
                cell += f"; {bias[largest] / predicted[largest]:.2f}"
            cells.append(cell)
        rows.append([name, *cells])
    return markdown(["actual relative to predicted", *(f"n = {n}" for n in SIZES)], rows)


def first_order_error() -> str:
    """Error of the loss to first order over the degrees of freedom per m + 1."""
    inf = np.inf
    cases: dict[str, tuple[Matrices, Callable[[int], Any]]] = {
        name: (CASES[name], lambda n: n)
        for name in ("m = 1, equal", "m = 2, equal", "m = 3, equal", "m = 2, crossed")
    }
    for ratio in (10, 10_000):
        for m in (1, 2, 6):
            s = np.array([np.eye(m), ratio * np.eye(m)])
            cases[f"m = {m}, S2 = {ratio} S1"] = (s, lambda n: n)
    for m in (1, 2):
        s = np.array([np.eye(m), 10_000 * np.eye(m)])
        cases[f"m = {m}, S2 = 10000 S1, S1 known"] = (s, lambda n: [inf, n])
    cases["m = 2, S2 = 10000 S1, S2 known"] = (s, lambda n: [n, inf])
    cases["m = 2, K = 10, equal"] = (equal(2, 10), lambda n: n)
    rows = []
    for name, (s, counts) in cases.items():
        cells = []
        for per in (20, 50, 100, 200):
            n = counts(per * (s.shape[-1] + 1) + 1)
            trials = repetitions(30_000 if s.shape[-1] > 3 or len(s) > 2 else 300_000, 1000)
            value, error = simulated(s, n, trials, rng=generator(44, per))
            of_value = first_order(s, n) / value
            cells.append(f"{100 * (of_value - 1):+.1f} ± {100 * of_value * error / value:.1f}")
        rows.append([name, *cells])
    limit = [1 / (2 * per * inverse_wishart_loss(1, 2 * per)) - 1 for per in (20, 50, 100, 200)]
    rows.append(["m = 1, S2 = ∞ S1, S1 known: exact", *(f"{100 * error:+.2f}" for error in limit)])
    head = "first order minus simulated, % of the loss"
    return markdown([head, *(f"{per} (m + 1)" for per in (20, 50, 100, 200))], rows)


def inverse_wishart_loss(m: int, nu: int) -> float:
    """Return `E (B^-1 - I)²` of a Wishart matrix B with mean I, over (m + 1).

    The loss is in this ratio to `W (m + 1)` where the first of two sensors is known and far better.
    """
    square = nu**2 * (nu - 1) / ((nu - m) * (nu - m - 1) * (nu - m - 3))
    return (square - 2 * nu / (nu - m - 1) + 1) / (m + 1)


def dominated(m: int, w: float) -> Matrices:
    """Return two sensors with weight w of the second in the one component that counts.

    In the others, which are known far better, the second sensor has all the weight.
    """
    first, second = np.diag([w] + [1e-4] * (m - 1)), np.diag([1 - w] + [1e-8] * (m - 1))
    return np.stack([first, second])


def random_sensors(m: int, sensors: int, count: int, rng: np.random.Generator) -> FloatArray:
    """Return sets of covariances: variances 1e-3 to 1e3 on axes turned at random."""
    axes, _ = np.linalg.qr(rng.standard_normal((count, sensors, m, m)))
    variances = 10 ** rng.uniform(-3, 3, (count, sensors, 1, m))
    matrices = (axes * variances) @ np.swapaxes(axes, -1, -2)
    symmetric: FloatArray = (matrices + np.swapaxes(matrices, -1, -2)) / 2
    return symmetric


def rule_for(m: int) -> int:
    """Return the n of the rule for two sensors, without knowing the covariances."""
    return int(np.ceil(1 + 22 * max((m + 3) ** 2 / 16 if m <= 5 else 0, m - 1)))


def rule() -> str:
    """Losses at the n of the rule in adversarial cases, and the n that is needed."""
    rows = []
    for m in range(1, 7):
        sizes = sorted({rule_for(m), 15 * m + 6}) if m <= 3 else [rule_for(m)]
        cases: dict[str, Matrices] = {"equal": equal(m)}
        cases["S2 = 10 S1"] = np.array([np.eye(m), 10 * np.eye(m)])
        if m > 1:
            cases["worst to first order"] = dominated(m, max((5 - m) / 8, 1e-3))
        for n in sizes:
            cells = []
            for s in cases.values():
                value, _ = simulated(s, n, repetitions(50_000), rng=generator(45, n))
                needed = weights.required_samples(s, trials=repetitions(20_000))
                cells.append(f"{value:.2f} ({needed})")
            cells += [""] * (3 - len(cells))
            pairs = random_sensors(m, 2, 300, generator(46, m))
            found = weights.fusion_loss(pairs, n, method="monte-carlo", trials=repetitions(3000))
            cells.append(f"{100 * np.max(found.loss):.2f}")
            rows.append([f"{m}", f"{n}", *cells])
    head = ["m", "n", "equal", "S2 = 10 S1", "worst to first order", "worst of 300 random pairs"]
    return markdown(head, rows)


def many_sensors() -> str:
    """Losses of more than two sensors at the n of the rule for two, and of that for many."""
    rows = []
    for m in (1, 2, 3, 6):
        for n in (rule_for(m), 1 + 22 * (m + 1)):
            cells = []
            for count in (2, 3, 5, 10, 50):
                trials = repetitions(10_000 if count <= 10 else 3000)
                value, _ = simulated(equal(m, count), n, trials, rng=generator(47, m, count))
                cells.append(f"{value:.2f}")
            five = random_sensors(m, 5, 100, generator(60, m))
            found = weights.fusion_loss(five, n, method="monte-carlo", trials=repetitions(2000))
            nu = n - 1
            limit = (nu - 1) * (nu - m - 1) / ((nu - m) * (nu - m - 3)) - 1
            cells += [f"{100 * limit:.2f}", f"{100 * np.max(found.loss):.2f}"]
            rows.append([f"{m}", f"{n}", *cells])
    head = ["equal sensors, loss, %: m", "n", *(f"K = {k}" for k in (2, 3, 5, 10, 50))]
    return markdown([*head, "K = ∞, exact", "worst of 100 random sets of 5"], rows)


def too_few() -> str:
    """Mean loss over ever more draws where it has no finite mean, and where it has one."""
    rows = []
    for n in (2, 3):
        rng = generator(48, n)
        drawn = simulate.wishart(np.eye(2), n - 1, batch=(10**5, 2), rng=rng)
        losses = losses_with(equal(2), weights.weight_matrices(drawn))
        exact = "infinite" if n == 2 else f"{exact_loss(2, n - 1) / 100:.3g}"
        rows.append([f"{n}", *(f"{losses[: 10**k].mean():.3g}" for k in (2, 3, 4, 5)), exact])
    return markdown(["mean loss, m = 2: n", "100 draws", "10³", "10⁴", "10⁵", "exact"], rows)


def conventions() -> str:
    """Losses by the convention: to first order, from Wishart draws, and from raw measurements."""
    words: tuple[weights.Convention, ...] = ("sample-mean", "known-mean", "paper", "differences")
    rows = []
    for name in ("m = 2, equal", "m = 2, S2 = 10 S1", "m = 3, equal"):
        s = CASES[name]
        for n in (5, 10, 30):
            x = measured(s, n, repetitions(20_000), generator(49, n))
            raw = {
                "sample-mean": weights.sample_covariance(x),
                "known-mean": weights.sample_covariance(x, mean=np.zeros(s.shape[-1])),
                "differences": weights.sample_covariance(x, differences=True),
            }
            raw["paper"] = raw["known-mean"] * (n / (n - 1))
            cells = []
            for word in words:
                first = first_order(s, n, convention=word)
                rng, trials = generator(50, n), repetitions(60_000)
                drawn, _ = simulated(s, n, trials, convention=word, rng=rng)
                found, _ = mean_and_error(losses_with(s, weights.weight_matrices(raw[word])))
                cells.append(", ".join(map(short, (first, drawn, found))))
            rows.append([name, f"{n}", *cells])
    return markdown(["first order, Wishart draws, measurements, %", "n", *words], rows)


def commutation(m: int) -> FloatArray:
    """Return K with K vec A = vec A'."""
    matrix: FloatArray = np.eye(m * m).reshape(m, m, m, m).swapaxes(0, 1).reshape(m * m, m * m)
    return matrix


def blocks_with(s: Matrices, reading: str) -> FloatArray:
    """Return the blocks of P as someone may read (12) to (14)."""
    m = s.shape[-1]
    right = weights.jacobian(s)
    if reading == "S by rows":
        return right @ commutation(m)
    if reading == "W by rows":
        return commutation(m) @ right
    if reading == "E_ij = I":
        w, c = weights.weight_matrices(s), np.linalg.inv(s)
        columns = np.array([w[0] @ c[0] @ w[1], -w[1] @ c[1] @ w[0]])
        by_columns = np.swapaxes(columns, -1, -2).reshape(2, m * m, 1)
        return np.repeat(by_columns, m * m, axis=-1)
    if reading == "symmetric pairs":
        off_diagonal = ~np.eye(m, dtype=bool).ravel()
        return right + np.where(off_diagonal, right @ commutation(m), 0)
    return right


def variance_ratio(s: Matrices, reading: str) -> FloatArray:
    """Return the variances of W's elements by (10) with such a P over the right ones."""
    of_s = np.stack([weights.covariance_of_covariance(matrix, 1.0) for matrix in s])
    variances = []
    for p in (blocks_with(s, reading), blocks_with(s, "as here")):
        covariance = (p @ of_s @ np.swapaxes(p, -1, -2)).sum(axis=0)
        variances.append(np.diag(covariance))
    ratio: FloatArray = variances[0] / variances[1]
    return ratio


def readings() -> str:
    """Compare P and C_W with those of other readings of the same equations."""
    s = VECTOR
    right = weights.jacobian(s)
    rows = []
    for reading in ("as here", "S by rows", "W by rows", "E_ij = I", "symmetric pairs"):
        change = np.abs(blocks_with(s, reading) - right).max() / np.abs(right).max()
        ratio = ", ".join(f"{value:.2f}" for value in variance_ratio(s, reading))
        rows.append([reading, f"{change:.2f}", ratio])
    head = ["reading", "largest change of P, relative to its largest element"]
    return markdown([*head, "variances of W11, W21, W12, W22, relative to the correct ones"], rows)


def expansion() -> str:
    """Compare (10) with the variances of W where (3) is as printed, by the point of expansion."""
    rows = []
    for n in (10, 30, 100):
        bias = n / (n - 1)
        c = weights.covariance_factor(n, "paper")
        of_s = np.stack([weights.covariance_of_covariance(matrix, c) for matrix in VECTOR])
        # of the law of the sample covariances: W does not know of a common factor
        right = np.diag(weights.weight_covariance(VECTOR, n, convention="known-mean"))
        x = measured(VECTOR, n, repetitions(100_000), generator(61, n))
        drawn = weights.weight_matrices(weights.sample_covariance(x, mean=[0, 0]) * bias)[:, -1]
        actual = np.swapaxes(drawn, -1, -2).reshape(len(drawn), -1).var(axis=0)
        cells = [f"{n}"]
        for centre in (VECTOR, bias * VECTOR):
            jacobian = weights.jacobian(centre)
            found = np.diag((jacobian @ of_s @ np.swapaxes(jacobian, -1, -2)).sum(axis=0))
            ratio = found / actual
            cells += [f"{np.mean(found / right):.3f}", f"{ratio.min():.2f} to {ratio.max():.2f}"]
        rows.append(cells)
    head = ["P at Σ: relative to the first order", "relative to the actual variances"]
    return markdown(["n", *head, "P at n/(n − 1) Σ: relative to the first order", head[1]], rows)


def symmetric_pairs() -> str:
    """Variances of W's elements with derivatives by symmetric pairs over the right ones."""
    cases = {
        "two passive sites, (10, 30) km": simulate.passive_location([10e3, 30e3]).covariances[None]
    }
    for m in (2, 3):
        rng = generator(51, m)
        drawn = simulate.wishart(np.eye(m), m + 1, batch=(1000, 2), rng=rng)
        cases[f"1000 random pairs, m = {m}"] = drawn
    rows = []
    for name, pairs in cases.items():
        ratio = np.array([variance_ratio(s, "symmetric pairs") for s in pairs])
        rows.append([name, *(f"{q:.3g}" for q in np.quantile(ratio, [0, 0.05, 0.5, 0.95, 1]))])
    head = ["wrong variance relative to correct", "smallest", "5 %", "median", "95 %", "largest"]
    return markdown(head, rows)


def symmetrised() -> str:
    """Losses with the true W made symmetric."""
    found = area_from()
    rows = []
    cases = {
        "test vector": VECTOR,
        "axes 3 : 1, second turned by 45°": np.array([ellipse(9, 1), ellipse(9, 1, 45)]),
        "axes 10 : 1, second turned by 45°": np.array([ellipse(100, 1), ellipse(100, 1, 45)]),
        "two passive sites, median over the area": found.location.covariances,
    }
    for name, s in cases.items():
        w = weights.weight_matrices(s)
        losses = losses_with(s, (w + np.swapaxes(w, -1, -2)) / 2)
        rows.append([name, f"{100 * np.median(losses):.1f}%"])
    return markdown(["W known exactly, but symmetrised", "loss"], rows)


def rational_weights(s: Matrices) -> tuple[Exact, float]:
    """Return W of the second of two sensors in rational numbers, and p.

    p is the smallest share of a component's variance in the sum that the others leave unexplained.
    """
    m = s.shape[-1]
    first, second = ([[Fraction(float(v)) for v in row] for row in matrix] for matrix in s)
    total = [
        [x + y for x, y in zip(*rows, strict=True)] for rows in zip(first, second, strict=True)
    ]
    # by elimination: W' = T^-1 S1, and T^-1
    table = [[*total[i], *first[i], *(Fraction(i == j) for j in range(m))] for i in range(m)]
    for j in range(m):
        table[j] = [value / table[j][j] for value in table[j]]
        for i in range(m):
            if i != j:
                factor = table[i][j]
                table[i] = [x - factor * y for x, y in zip(table[i], table[j], strict=True)]
    shares = (1 / (total[i][i] * table[i][2 * m + i]) for i in range(m))
    return [[table[j][m + i] for j in range(m)] for i in range(m)], float(min(shares))


def rounding_error(w: FloatArray, exact: Exact, s: Matrices) -> float:
    """Return the largest error of an element over the largest element, in standard deviations."""
    sigma = np.sqrt(np.diagonal(s.sum(axis=0)))
    unit = sigma / sigma[:, np.newaxis]
    error = [
        [float(Fraction(x) - y) for x, y in zip(*rows, strict=True)]
        for rows in zip(w.tolist(), exact, strict=True)
    ]
    size = np.abs(np.array(exact, dtype=float) * unit).max()
    return float(np.abs(np.array(error) * unit).max() / size)


def rounding() -> str:
    """Compare rounding errors of W by the sums and by the inverses, against rational numbers."""
    rows = []
    for label, both in (("one sensor", False), ("both, in the same direction", True)):
        for power in (0, 4, 8, 12):
            rng = generator(52, power)
            found = []
            for _ in range(30):
                axes, _ = np.linalg.qr(rng.standard_normal((3, 3)))
                variances = rng.uniform(0.5, 3, (2, 1, 3))
                variances[: 2 if both else 1, :, 2] = 10.0**-power
                s = (axes * variances) @ axes.T
                s = (s + np.swapaxes(s, -1, -2)) / 2
                exact, p = rational_weights(s)
                errors = [
                    rounding_error(method(s)[1], exact, s)
                    for method in (weights.weight_matrices, literal_weights)
                ]
                found.append([*errors, errors[0] * p, p])
            worst = np.max(found, axis=0)
            cells = [f"{value:.0e}" for value in (np.min(found, axis=0)[3], *worst[:3])]
            rows.append([label, f"1e-{power}" if power else "1", *cells])
    head = ["(almost) singular", "smallest variance of the singular sensor", "smallest p"]
    return markdown([*head, "sums only", "as printed", "sums only, times p"], rows)


def oas(s: Matrices, nu: int) -> FloatArray:
    """Shrink sample covariances towards a circle (Chen et al. 2010)."""
    m = s.shape[-1]
    square, of_trace = trace(s @ s), trace(s) ** 2
    share = ((1 - 2 / m) * square + of_trace) / ((nu + 1 - 2 / m) * (square - of_trace / m))
    return _towards_circle(s, np.minimum(share, 1))


def ledoit_wolf(x: FloatArray) -> FloatArray:
    """Return sample covariances shrunk towards a circle (Ledoit and Wolf 2004)."""
    n, m = x.shape[-2:]
    y = x - x.mean(axis=-2, keepdims=True)
    s = np.swapaxes(y, -1, -2) @ y / n
    circle = trace(s)[..., np.newaxis, np.newaxis] / m * np.eye(m)
    distance = np.sum((s - circle) ** 2, axis=(-2, -1))
    noise = (np.sum(np.sum(y**2, axis=-1) ** 2, axis=-1) / n - np.sum(s**2, axis=(-2, -1))) / n
    return _towards_circle(s, np.clip(noise / distance, 0, 1))


def _towards_circle(s: Matrices, share: FloatArray) -> FloatArray:
    m = s.shape[-1]
    share, size = share[..., np.newaxis, np.newaxis], trace(s)[..., np.newaxis, np.newaxis]
    shrunk: FloatArray = (1 - share) * s + share * size / m * np.eye(m)
    return shrunk


def intersected(covariances: Matrices) -> FloatArray:
    """Return the weights of the covariance intersection with the smallest claimed trace."""
    precisions = np.linalg.inv(covariances)
    first, second = precisions[:, 0], precisions[:, 1]
    smallest = np.full(len(first), np.inf)
    best = np.empty_like(precisions)
    for omega in np.linspace(0, 1, 41):
        shares = omega * first, (1 - omega) * second
        fused = np.linalg.inv(shares[0] + shares[1])
        better = trace(fused) < smallest
        smallest[better] = trace(fused)[better]
        best[better] = np.stack([fused @ share for share in shares], axis=1)[better]
    return best


def model_of(
    s: Matrices, count: int, rng: np.random.Generator, factor: float = 1.5, degrees: float = 10
) -> FloatArray:
    """Return wrong models of covariances: each axis too long or short by a factor, and turned."""
    m = s.shape[-1]
    variances, axes = np.linalg.eigh(s)
    wrong = variances * factor ** rng.choice([-2.0, 2.0], (count, *variances.shape))
    turns = np.stack([rotation(m, degrees), rotation(m, -degrees)])
    roots = turns[rng.integers(0, 2, (count, len(s)))] @ axes * np.sqrt(wrong)[..., np.newaxis, :]
    model: FloatArray = roots @ np.swapaxes(roots, -1, -2)
    return model


@functools.cache
def area_from(south_km: float | None = None, cell_km: float = 2.0) -> passive_location.Area:
    """Return the area of the example from so far north of the baseline on, by default centred."""
    south = -passive_location.HEIGHT_KM / 2 if south_km is None else south_km
    return passive_location.area(cell_km, south, repetitions(passive_location.TRIALS))


FEW = 10
FEW_TRIALS = repetitions(10_000)
FEW_CASES: dict[str, Matrices] = {
    "1: equal circles": equal(2),
    "2: S2 = 10 S1, circles": CASES["m = 2, S2 = 10 S1"],
    "3: axes 2 : 1, crossed": CASES["m = 2, crossed"],
    "4: axes 3 : 1, turned by 45°": np.array([ellipse(9, 1), ellipse(9, 1, 45)]),
    "5: axes 3 : 1, parallel at 30°, S2 = 4 S1": np.array(
        [ellipse(9, 1, 30), 4 * ellipse(9, 1, 30)]
    ),
    "6: equal spheres, m = 3": equal(3),
    "7: axes 1 : 2 : 3 and 3 : 2 : 1": np.array([np.diag([1.0, 4, 9]), np.diag([9.0, 4, 1])]),
    "axes 10 : 1, turned by 45°": np.array([ellipse(100, 1), ellipse(100, 1, 45)]),
    "two passive sites, (25, 30) km": simulate.passive_location([25e3, 30e3]).covariances,
}


def few_samples() -> str:
    """Losses of several estimates of the covariances from ten measurements."""
    columns: dict[str, list[float]] = {}
    for s in FEW_CASES.values():
        m = s.shape[-1]
        x = measured(s, FEW, FEW_TRIALS, generator(53))
        sample = weights.sample_covariance(x)
        model = model_of(s, FEW_TRIALS, generator(54))
        better = model_of(s, FEW_TRIALS, generator(54), np.sqrt(1.5))
        found = {
            "sample": weights.weight_matrices(sample),
            "model": weights.weight_matrices(model),
            "shrunk": weights.weight_matrices(weights.shrink_covariance(model, sample, FEW)),
            "shrunk, σ off by √1.5": weights.weight_matrices(
                weights.shrink_covariance(better, sample, FEW)
            ),
            "OAS": weights.weight_matrices(oas(sample, FEW - 1)),
            "Ledoit-Wolf": weights.weight_matrices(ledoit_wolf(x)),
            "diagonal": weights.weight_matrices(sample * np.eye(m)),
            "intersection": intersected(sample),
        }
        for name, w in found.items():
            columns.setdefault(name, []).append(mean_and_error(losses_with(s, w))[0])
    rows = [
        [case, *(f"{values[i]:.1f}" for values in columns.values())]
        for i, case in enumerate(FEW_CASES)
    ]
    rows.insert(7, ["**worst of 1 to 7**", *(f"**{max(v[:7]):.1f}**" for v in columns.values())])
    return markdown(["loss, %", *columns], rows)


def model_errors() -> str:
    """Loss of the blend, and of the model alone, over how wrong the model is."""
    names = list(FEW_CASES)
    chosen = [names[i] for i in (0, 2, 3, 7, 8)]
    rows = []
    for factor, degrees in (
        (1.0, 0),
        (1.25, 5),
        (1.5, 0),
        (1.0, 10),
        (1.5, 10),
        (2.0, 10),
        (2.0, 20),
    ):
        cells = []
        for name in chosen:
            s = FEW_CASES[name]
            sample = weights.sample_covariance(measured(s, FEW, FEW_TRIALS, generator(53)))
            model = model_of(s, FEW_TRIALS, generator(55), factor, degrees)
            blended = losses_with(
                s, weights.weight_matrices(weights.shrink_covariance(model, sample, FEW))
            )
            alone = losses_with(s, weights.weight_matrices(model))
            cells.append(f"{100 * blended.mean():.1f} ({abs(100 * alone.mean()):.1f})")
        rows.append([f"{factor:g}, {degrees}°", *cells])
    return markdown(["model wrong by", *chosen], rows)


def consistency() -> str:
    """How often the p-value of the combination is small."""
    count = repetitions(200_000)
    s = VECTOR
    x = measured(s, 1, count, generator(56))[..., 0, :]
    shifted = x.copy()
    shifted[:, 1, 0] += 3 * np.sqrt(s[:, 0, 0].sum())
    cases: dict[str, tuple[FloatArray, FloatArray]] = {"correct covariances": (x, s)}
    for n in (10, 30, 100):
        rng = generator(57, n)
        drawn = [simulate.wishart(matrix, n - 1, batch=count, rng=rng) for matrix in s]
        cases[f"covariances of n = {n}"] = (x, np.stack(drawn, axis=1))
    cases["stated sigmas of one sensor half the true ones"] = (
        x,
        s / np.array([4, 1])[:, None, None],
    )
    cases["one component off by 3 of its sigmas"] = (shifted, s)
    location = simulate.passive_location(np.broadcast_to([10e3, 30e3], (count, 2)))
    cases["a shared azimuth"] = (location.estimates(generator(58)), location.covariances[0])
    rows = []
    for name, (estimates, covariances) in cases.items():
        p = np.asarray(fusion.fuse(estimates, covariances).pvalue)
        rows.append([name, *(f"{np.mean(p < level):.2%}" for level in (0.05, 0.01, 0.001))])
    return markdown(["share of p-values", "below .05", "below .01", "below .001"], rows)


def area() -> str:
    """Range of W's standard deviations, losses and needed n over the area, by where it lies."""
    places = {
        "centred on the baseline, 2 km cells": area_from(),
        "centred on the baseline, 4 km cells": area_from(cell_km=4.0),
        "in front of the baseline, 2 km cells": area_from(0.0),
        "in front of the baseline, 6 km cells": area_from(0.0, 6.0),
        "in front of the baseline from 10 km on, 2 km cells": area_from(10.0),
    }
    rows = []
    for name, found in places.items():
        # for time's sake not every cell
        s = found.location.covariances[::2, ::2]
        first = weights.required_samples(s, method="first-order")
        needed = weights.required_samples(s, trials=repetitions(2000))
        rows.append(
            [
                name,
                f"{np.abs(found.north).min():g} km",
                _range(found.largest_sigma, ".2g"),
                _range(100 * found.first_order, ".1f"),
                _range(100 * found.loss, ".1f"),
                _range(first, "d"),
                _range(needed, "d"),
            ]
        )
    head = ["area of 120 × 88 km", "nearest row", "largest σ of W", "loss, first order, %"]
    return markdown([*head, "loss, %", "n for 5 %, first order", "n for 5 %"], rows)


def _range(values: npt.ArrayLike, form: str) -> str:
    return f"{np.min(values):{form}} to {np.max(values):{form}}"


def shared_azimuth() -> str:
    """Compare what fusing two estimates that share an azimuth claims with what it does."""
    rows = []
    for name, found in (
        ("centred on the baseline", area_from()),
        ("in front of the baseline", area_from(0.0)),
    ):
        location = found.location
        scaled = location.jacobian / location.sigma[:, np.newaxis]
        # errors of both estimates for unit errors of the three measurements
        response = np.zeros((*scaled.shape[:-2], 2, 2, 3))
        response[..., 0, :, :2] = np.linalg.inv(scaled[..., [0, 1], :])
        response[..., 1, :, ::2] = np.linalg.inv(scaled[..., [0, 2], :])
        fused = (weights.weight_matrices(location.covariances) @ response).sum(axis=-3)
        actual = trace(fused @ np.swapaxes(fused, -1, -2))
        claimed = trace(weights.fused_covariance(location.covariances))
        alone = trace(location.covariances[..., 0, :, :])
        row = location.jacobian[..., 2, :]
        right = trace(
            fusion.fuse_scalar(
                location.position,
                location.covariances[..., 0, :, :],
                row,
                np.sum(row * location.position, axis=-1),
                location.sigma[2],
            ).covariance
        )
        cells = []
        for ratio in (actual / claimed, actual / right, alone / right):
            low, middle, high = np.sqrt(np.quantile(ratio, [0, 0.5, 1]))
            cells.append(f"{middle:.2f} ({low:.2f} to {high:.2f})")
        rows.append([name, *cells, f"{np.mean(actual > alone):.0%}"])
    head = ["area", "actual / stated", "actual / best", "two azimuths alone / best"]
    return markdown([*head, "share of area worse than two azimuths alone"], rows)


def right_treatment() -> str:
    """Errors of the fused position over what is claimed, and p-values, from draws."""
    count = repetitions(100_000)
    rows = []
    for position in ([0.0, 40e3], [10e3, 30e3], [-30e3, 20e3]):
        location = simulate.passive_location(np.broadcast_to(position, (count, 2)))
        estimates = location.estimates(generator(59))
        both = fusion.fuse(estimates, location.covariances)
        # the range difference that the second estimate reproduces
        row = location.jacobian[..., 2, :]
        scalar = fusion.fuse_scalar(
            estimates[:, 0],
            location.covariances[:, 0],
            row,
            np.sum(row * estimates[:, 1], axis=-1),
            location.sigma[2],
        )
        cells = []
        for fused in (both, scalar):
            error = np.sum((fused.mean - position) ** 2, axis=-1).mean()
            ratio = np.sqrt(error / trace(fused.covariance).mean())
            small = np.mean(np.asarray(fused.pvalue) < 0.05)
            cells += [f"{ratio:.3f}", f"{small:.2%}"]
        east, north = (f"{x / 1e3:g}" for x in position)
        rows.append([f"({east}, {north}) km", *cells])
    head = ["target", "`fuse`: actual / stated rms", "p < .05"]
    return markdown([*head, "`fuse_scalar`: actual / stated rms", "p < .05"], rows)


def passive_location_figure() -> Figure:
    """Draw the maps of the example."""
    return passive_location.figure(area_from())
