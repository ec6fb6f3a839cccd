"""Bearings of records with many outliers, lasting noise and systematic errors."""

from collections.abc import Callable
from typing import Any

import numpy as np

from studies.honesty import STOPS, Draw, coverage_table, stops
from studies.montecarlo import FloatArray, autoregressive, generator
from studies.pages import markdown, repetitions
from tertia import estimate_bearing

BoolArray = np.ndarray[Any, np.dtype[np.bool_]]

# measurements and records of each cell
SIZES = {10: 2000, 30: 2000, 100: 800, 300: 300, 1000: 150, 3000: 100}
SHARES = (0.0, 0.1, 0.2, 0.3, 0.4)
OFFSETS = (3.0, 5.0, 8.0, 20.0)
BURST = (4, 20)
_NAMES = ("default", "mean", "median", "biweight", "mean within 3σ of the shorth")


def _bursts(rng: np.random.Generator, n: int, bad: int, sides: int, size: float) -> FloatArray:
    """Return offsets in bursts of 4 to 20 that do not touch, as far as there is room for them."""
    offset = np.zeros(n)
    for _ in range(1000):
        if bad == 0:
            break
        length = min(bad, int(rng.integers(BURST[0], BURST[1] + 1)), n)
        start = int(rng.integers(n - length + 1))
        if not offset[max(0, start - 1) : start + length + 1].any():
            offset[start : start + length] = size * (1.0 if sides == 1 else rng.choice([-1.0, 1.0]))
            bad -= length
    return offset


def contaminated(
    rng: np.random.Generator,
    n: int,
    count: int,
    cell: tuple[float, int, float],
    burst: bool,
) -> FloatArray:
    """Return records of unit noise about 0, of which a share is off by a size on 1 or 2 sides."""
    share, sides, size = cell
    y, bad = rng.standard_normal((count, n)), round(share * n)
    for row in y:
        if burst:
            row[:] += _bursts(rng, n, bad, sides, size)
        else:
            side = np.ones(bad) if sides == 1 else rng.choice([-1.0, 1.0], bad)
            row[rng.permutation(n)[:bad]] += size * side
    return y


def _biweight(y: FloatArray) -> FloatArray:
    centre = np.median(y, axis=1, keepdims=True)
    scale = 1.4826 * np.median(np.abs(y - centre), axis=1, keepdims=True)
    for _ in range(20):
        weight = (1 - np.clip((y - centre) / (4.685 * scale), -1, 1) ** 2) ** 2
        centre = (weight * y).sum(1, keepdims=True) / weight.sum(1, keepdims=True)
    return np.asarray(centre[:, 0])


def _clipped(y: FloatArray) -> FloatArray:
    """Mean within three sigmas of the mean of the shorter half, sigma from its length."""
    z, n = np.sort(y, axis=1), y.shape[1]
    half = n // 2 + 1
    length = z[:, half - 1 :] - z[:, : n - half + 1]
    first = length.argmin(axis=1)
    inside = (np.arange(n) >= first[:, None]) & (np.arange(n) < first[:, None] + half)
    centre = np.mean(z, axis=1, where=inside, keepdims=True)
    near = np.abs(y - centre) < 3 * length.min(axis=1, keepdims=True) / 1.349
    return np.asarray(np.mean(y, axis=1, where=near))


def _cells() -> list[tuple[float, int, float]]:
    bad = [(e, sides, size) for e in SHARES[1:] for sides in (1, 2) for size in OFFSETS]
    return [(0.0, 1, 0.0), *bad]


def contamination() -> str:
    """RMSE over that of the best of four estimators, and coverage, by share and number."""
    rows, below, above = [], [], []
    rmse: dict[str, list[float]] = {name: [] for name in _NAMES}
    for burst in (False, True):
        for n, full in SIZES.items():
            count = repetitions(full, 2)
            found: dict[float, list[tuple[float, float, float]]] = {e: [] for e in SHARES}
            for number, cell in enumerate(_cells()):
                y = contaminated(generator(24, n, number, int(burst)), n, count, cell, burst)
                estimate = estimate_bearing(y, period=None)
                errors = (np.asarray(estimate.value), y.mean(1), np.median(y, 1), _biweight(y))
                each = [float(np.sqrt(np.mean(e**2))) for e in (*errors, _clipped(y))]
                for name, value in zip(_NAMES, each, strict=True):
                    rmse[name].append(value)
                ratio = each[0] / min(each[1:])
                covered = float(np.mean(np.abs(errors[0]) <= 2 * np.asarray(estimate.sigma)))
                found[cell[0]].append((cell[2], ratio, covered))
                place = f"N = {n}, {cell[0]:.0%}, {'bursts' if burst else 'isolated'}"
                place += f", {'one side' if cell[1] == 1 else 'two sides'}, {cell[2]:g}σ"
                if ratio > 1.25:
                    above.append(f"{place}: {ratio:.2f}")
                if cell[0] <= 0.3 and covered < 0.9:
                    below.append(f"{place}: {covered:.2f}")
            cells = [
                f"{max(r for _, r, _ in found[e]):.2f}; "
                f"{min(c for size, _, c in found[e] if size != OFFSETS[0]):.2f}"
                for e in SHARES
            ]
            rows.append(["bursts" if burst else "isolated", f"{n}", *cells])
    head = ["outliers", "N", *(f"{e:.0%}" for e in SHARES)]
    mean = {name: np.exp(np.mean(np.log(values))) for name, values in rmse.items()}
    ratios = "; ".join(f"{mean['default'] / mean[n]:.2f} for the {n}" for n in _NAMES[1:])
    return (
        f"{markdown(head, rows)}\n"
        f"RMSE of the default / RMSE of another estimator (geometric mean): {ratios}.\n\n"
        f"Ratios above 1.25: {'; '.join(above) or 'none'}.\n\n"
        f"Coverage below .90 with up to 30 % of outliers: {'; '.join(below) or 'none'}.\n"
    )


def correlation() -> str:
    """Coverage of two sigmas with lasting noise: assumed white, given, found; with outliers."""
    rows = []
    sizes = (10, 20, 50, 100, 400)
    for phi in (0.0, 0.3, 0.6, 0.8, 0.9, 0.95):
        cells = []
        for n in sizes:
            rng = generator(21, n, round(100 * phi))
            y = autoregressive(rng.standard_normal((repetitions(1000, 20), n)), phi)
            bad = y + np.where(rng.uniform(size=y.shape) < 0.2, 8.0, 0.0)
            shares = []
            for data, given in ((y, 0.0), (y, phi), (y, None), (bad, None)):
                estimate = estimate_bearing(data, period=None, correlation=given)
                covered = np.abs(np.asarray(estimate.value)) <= 2 * np.asarray(estimate.sigma)
                shares.append(f"{np.mean(covered):.2f}")
            cells.append(" ".join(shares))
        rows.append([f"{phi:g}", *cells])
    return markdown(["φ", *(f"N = {n}" for n in sizes)], rows)


def _pink(rng: np.random.Generator, count: int, n: int) -> FloatArray:
    """Return 1/f noise of unit variance, with periods of up to eight records."""
    frequency = np.fft.rfftfreq(8 * n)[1:]
    phase = rng.standard_normal((count, len(frequency), 2)) @ np.array([1.0, 1.0j])
    spectrum = np.concatenate([np.zeros((count, 1)), phase / np.sqrt(frequency)], axis=1)
    noise = np.fft.irfft(spectrum, 8 * n)
    return np.asarray(noise[:, :n] / np.sqrt(np.mean(noise**2)))


def _slow(rng: np.random.Generator, kind: str, count: int, n: int) -> tuple[FloatArray, FloatArray]:
    """Return records of an emitter about 0, and the slow part of their errors."""
    time, none = (np.arange(n) + 0.5) / n, np.zeros((count, n))
    if kind == "1/f noise":
        return _pink(rng, count, n), none
    if kind.startswith("AR"):
        return autoregressive(rng.standard_normal((count, n)), float(kind[3:-1])), none
    if kind == "drift by 5σ":
        level = none + 5.0 * (time - 0.5)
    elif kind == "sine, ± 2.5σ":
        level = 2.5 * np.sin(2 * np.pi * (time + rng.uniform(size=(count, 1))))
    else:
        level = 2.5 * np.cumsum(rng.standard_normal((count, n)), axis=1) / np.sqrt(n)
    return level + rng.standard_normal((count, n)), level


def slow() -> str:
    """Coverage of the claimed 95 % where errors change slowly, and how often the result says so."""
    kinds = ("drift by 5σ", "sine, ± 2.5σ", "random walk to 2.5σ", "1/f noise", "AR(.8)", "AR(.95)")
    sizes = {30: 600, 100: 300, 300: 150, 1000: 60}
    rows = []
    for number, kind in enumerate(kinds):
        for bad in (False, True):
            cells = []
            for n, full in sizes.items():
                rng = generator(37, number, n, int(bad))
                y, level = _slow(rng, kind, repetitions(full, 8), n)
                if bad:
                    y += np.where(rng.uniform(size=y.shape) < 0.15, 6.0, 0.0)
                found = estimate_bearing(y, period=None)
                error = np.asarray(found.value) - level.mean(axis=1)
                inside = np.mean(np.abs(error) <= 1.96 * np.asarray(found.sigma))
                rmse = np.sqrt(np.mean(error**2))
                cells.append(f"{rmse:.2f} {inside:.0%} {np.mean(found.drifts):.0%}")
            rows.append([f"{kind}, 15 % outliers" if bad else kind, *cells])
    return markdown(["errors", *(f"N = {n}" for n in sizes)], rows)


def repeated() -> str:
    """Tell what becomes of records with values that an instrument or a recorder repeats."""
    rows = []
    for share, times in ((0.0, 1), (0.3, 1), (0.6, 1), (0.0, 2), (0.0, 10)):
        cells = []
        for n in (40, 200):
            rng, count = generator(36, round(10 * share), times, n), repetitions(400)
            y = np.round(rng.standard_normal((count, n)), 2)
            length = round(share * n)
            for row in y if length else ():
                first = int(rng.integers(n - length))
                row[first : first + length] = row[first]
            found = estimate_bearing(np.repeat(y, times, axis=-1), period=None)
            inside = np.mean(np.abs(found.value) < 2 * np.asarray(found.sigma))
            cells.append(f"{np.sqrt(np.mean(np.square(found.value))):.2f}; {inside:.2f}")
        said = f"{share:.0%} of the record is stuck" if share else f"each recorded {times} times"
        rows.append(["all recorded once" if share == 0 and times == 1 else said, *cells])
    return markdown(["record", "N = 40", "N = 200"], rows)


def groups() -> str:
    """Coverage and size of sigma with a systematic error per group."""
    rows = []
    for size in (0.0, 1.0, 3.0):
        cells = []
        for count in (2, 3, 5, 10):
            rng = generator(22, count, round(size))
            label = np.arange(60) * count // 60
            y = rng.standard_normal((repetitions(1000, 20), 60))
            y += size * rng.standard_normal((len(y), count))[:, label]
            shares = []
            for options in ({}, {"groups": label}, {"groups": label, "bias_sigma": size}):
                estimate = estimate_bearing(y, period=None, **options)
                value, sigma = np.asarray(estimate.value), np.asarray(estimate.sigma)
                covered = np.mean(np.abs(value) <= 2 * sigma)
                shares.append(f"{covered:.2f} ({np.median(sigma):.2f})")
            cells.append(", ".join(shares))
        rows.append([f"{size:g}", *cells])
    return markdown(["systematic error, σ", *(f"{k} groups" for k in (2, 3, 5, 10))], rows)


def grid() -> str:
    """Coverage of the claimed 95 % with errors as they are in the field."""

    def estimator(n: int, **options: Any) -> Callable[[Draw], BoolArray]:
        def inside(draw: Draw) -> BoolArray:
            y = draw((repetitions(1000, 20), 1, n))[:, 0]
            estimate = estimate_bearing(y, period=None, **options)
            error, sigma = np.abs(np.asarray(estimate.value)), np.asarray(estimate.sigma)
            return np.asarray(error <= 1.96 * sigma)

        return inside

    names = {f"bearing, N = {n}": estimator(n) for n in (10, 30, 100, 300)}
    for n in (30, 100, 300):
        names[f"bearing, N = {n}, groups={STOPS} stops"] = estimator(n, groups=stops(n))
    return coverage_table(names, 23)
