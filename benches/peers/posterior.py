"""Positions of three bearings by their posterior, side by side with a Markov chain, in one run.

The chain is that of the azimuthal telemetry model of Gerber et al. (2018) in NumPy: in turn, a
position is drawn from its conditional density on a grid, and the concentration by a Metropolis
step; 11,000 draws. CPU time of a fix on one thread, and the ratio to Tertia. Means must agree
within a tenth of a standard deviation.
"""

from timing import cpu_time

# isort: split
import numpy as np

from tertia.location import locate

PLACES = np.array([[0, 0], [400, 0], [200, -300.0]])
BEARINGS = np.radians([35, 325, 2.0])
MAX_RANGE, MEDIAN, SPREAD = 1000.0, np.radians(5.0), 0.7
SIDE, DRAWS, BURN_IN, STEP = 120, 11_000, 1_000, 0.8
BATCH = 100


def ln_scaled_bessel(kappa):
    """ln (I0(κ) e^-κ), from Abramowitz and Stegun 9.8."""
    return np.log(np.i0(kappa)) - kappa if kappa < 500 else -0.5 * np.log(2 * np.pi * kappa)


def chain(rng):
    """Mean and standard deviations of the positions of one chain."""
    axis = np.linspace(-MAX_RANGE, MAX_RANGE + 400, SIDE)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    sigma, drawn = MEDIAN, []
    for _ in range(DRAWS):
        # the density is made anew for each draw, as a sampler of many fixes does
        d = grid[:, np.newaxis] - PLACES
        distance = np.hypot(d[..., 0], d[..., 1])
        along = d[..., 0] * np.sin(BEARINGS) + d[..., 1] * np.cos(BEARINGS)
        misfits = np.sum(1 - along / distance, axis=-1)
        misfits[distance.min(axis=-1) > MAX_RANGE] = np.inf
        cumulated = np.cumsum(np.exp(-(misfits - misfits.min()) / sigma**2))
        at = np.searchsorted(cumulated, rng.uniform() * cumulated[-1])
        drawn.append(grid[at])
        proposed = sigma * np.exp(STEP * rng.standard_normal())
        ln = [
            -misfits[at] / s**2
            - len(PLACES) * ln_scaled_bessel(s**-2)
            - 0.5 * (np.log(s / MEDIAN) / SPREAD) ** 2
            for s in (sigma, proposed)
        ]
        if np.log(rng.uniform()) < ln[1] - ln[0]:
            sigma = proposed
    kept = np.array(drawn[BURN_IN:])
    return kept.mean(axis=0), kept.std(axis=0)


def tertia(pooled):
    """Fixes with their regions."""
    azimuth = np.broadcast_to(BEARINGS, (BATCH, 3))
    fixes = locate(
        PLACES,
        azimuth=azimuth,
        method="posterior",
        max_range=MAX_RANGE,
        pooled=pooled,
        n_threads=1,
    )
    return fixes, fixes.region(0.95)


def main():
    found = []
    peer = cpu_time(lambda: found.append(chain(np.random.default_rng(1)))) / 1e6
    fixes, _ = tertia(pooled=False)
    mean, deviation = found[0]
    assert np.all(np.abs(fixes.position[0] - mean) < 0.1 * deviation), (fixes.position[0], mean)
    print(f"Markov chain of {DRAWS} draws: {peer:.0f} ms a fix")
    for name, pooled in (("alone", False), ("pooled", True)):
        own = cpu_time(lambda pooled=pooled: tertia(pooled)) / 1e6 / BATCH
        print(f"Tertia, {name}, with its region: {own:.2f} ms a fix ({peer / own:.0f}x)")


if __name__ == "__main__":
    main()
