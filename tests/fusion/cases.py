"""Estimates for the tests of fusion with systematic errors."""

from checks import rng


def problem(k, m, seed, spread=3.0):
    factor = rng(seed).standard_normal((k, m, m + 2))
    covariances = factor @ factor.swapaxes(-1, -2) / m
    return rng(seed + 1).normal(0, spread, (k, m)), covariances
