"""Records for the tests of bearings."""

from tertia.simulate import direction_finder

METHODS = ["robust", "corrected", "paper", "k-sigma", "mean"]
CLEAN = {"single_probability": 0.0, "bursts_per_100": 0.0}


def record(n, seed, **options):
    return direction_finder(n, bearing=50.0, period=None, rng=seed, **options).theta
