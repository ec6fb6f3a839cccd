"""The mask of outliers, side by side with other ways to compute one, in one run.

Nanoseconds of CPU time per value, the least of several rounds on one thread, and the ratio to
Tertia. The alternatives do not all answer the same question (sigma clipping iterates, Hampel looks
at a window), but each is what its users would call for it. What is not installed is left out.
"""

from functools import partial

from timing import least, optional, report

# isort: split
import numpy as np

from tertia import screening

astropy = optional("astropy.stats")
hampel = optional("hampel")
numba = optional("numba")
scipy = optional("scipy.stats")

K = 2.5


def tertia_mask(y):
    return screening.leave_one_out_mask(y, K, n_threads=1)


def numpy_threshold(y):
    """Two passes with the constant c(k, N)."""
    n = y.shape[-1]
    c = K * (n - 1) ** 1.5 / np.sqrt(n * (n * (n - 2) + K**2 * (n - 1)))
    mean = y.mean(axis=-1, keepdims=True)
    return np.abs(y - mean) > c * y.std(axis=-1, ddof=1, keepdims=True)


def numpy_leave_one_out(y):
    """M', D' and the mask, by the formulas."""
    n = y.shape[-1]
    e = y - y.mean(axis=-1, keepdims=True)
    squares = (e**2).sum(axis=-1, keepdims=True)
    variance = (squares - e**2 * n / (n - 1)) / (n - 2)
    return np.abs(e) * n / (n - 1) > K * np.sqrt(variance)


def scipy_zscore(y):
    return np.abs(scipy.zscore(y, axis=-1)) > K


def astropy_sigma_clip(y):
    return astropy.sigma_clip(y, sigma=K, maxiters=1, axis=-1 if y.ndim > 1 else None).mask


def hampel_filter(y):
    return hampel.hampel(y, window_size=11, n_sigma=K).outlier_indices


def mask_rows(y, k, out):
    """A loop over numbers, for numba."""
    rows, n = y.shape
    c = k * (n - 1) ** 1.5 / np.sqrt(n * (n * (n - 2) + k * k * (n - 1)))
    for i in range(rows):
        total = 0.0
        for j in range(n):
            total += y[i, j]
        mean = total / n
        squares = 0.0
        for j in range(n):
            squares += (y[i, j] - mean) ** 2
        threshold = c * np.sqrt(squares / (n - 1))
        for j in range(n):
            out[i, j] = abs(y[i, j] - mean) > threshold


if numba:
    compiled = numba.njit(mask_rows)


def numba_loops(y):
    rows = y.reshape(-1, y.shape[-1])
    out = np.empty(rows.shape, dtype=bool)
    compiled(rows, K, out)
    return out.reshape(y.shape)


ALTERNATIVES = {
    "NumPy, equivalent threshold": (np, numpy_threshold),
    "NumPy, leave-one-out moments": (np, numpy_leave_one_out),
    "numba": (numba, numba_loops),
    "SciPy zscore": (scipy, scipy_zscore),
    "astropy sigma_clip": (astropy, astropy_sigma_clip),
    "hampel": (hampel, hampel_filter),
}


def compare(shape):
    y = np.random.default_rng(1).standard_normal(shape)
    functions = {"Tertia": tertia_mask}
    for name, (package, function) in ALTERNATIVES.items():
        if package and not (name == "hampel" and (y.ndim > 1 or y.size > 10_000)):
            functions[name] = function
    functions["(np.sum: one read)"] = np.sum
    for function in functions.values():
        function(y)  # may compile
    best = least({name: (partial(function, y), y.size) for name, function in functions.items()})
    report(f"mask of {' × '.join(f'{n:,}' for n in shape)}, a value", best)


def main():
    for shape in [(100,), (10_000,), (10_000_000,), (10_000, 100)]:
        compare(shape)


if __name__ == "__main__":
    main()
