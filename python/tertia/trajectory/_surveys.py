"""Surveys of receivers that the times of arrival contradict."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from tertia import _core

# probability that the survey of any receiver is taken for wrong, although all are as stated, and
# that it is if others have been estimated without theirs
_CHANCE, _DOUBT = 1e-6, 1e-2
# the sigma of a contradicted survey is multiplied by this, so that it says hardly anything
_FREED = 30.0
# least share of a stated variance that the arrivals are assumed to have contributed to an estimate
_LEAST = 0.1
# one survey may be wrong for each of so many receivers
_EACH = 4


def solve_without_wrong_surveys(
    solve: Callable[[dict[str, Any]], dict[str, Any]], net: dict[str, Any], names: Sequence[str]
) -> dict[str, Any]:
    """Return the solution of a net of receivers with these names, whose surveys may be wrong.

    If the estimated position of a receiver contradicts its survey, `solve` is called again with a
    much larger sigma of the worst survey. If nothing contradicts the surveys then, this solution is
    returned, and a warning says so.
    """
    stated, first, wrong = net["site_sigma"], solve(net), list[int]()
    found, worst = first, _worst(net, first, len(names), _CHANCE)
    while worst is not None and len(wrong) < len(names) // _EACH:
        wrong.append(worst)
        sigma = net["site_sigma"].copy()
        sigma[worst] *= _FREED
        net = net | {"site_sigma": sigma}
        found = solve(net)
        worst = _worst(net, found, len(names), _DOUBT)
    if worst is not None or found["failure"] is not None:
        # other errors that look like those of surveys
        return first
    for one in wrong:
        change = float(np.linalg.norm(found["site"][0][one] - net["sites"][one]))
        warnings.warn(
            f"the arrivals contradict the position of {names[one]}: it is {change:.3g} m from the "
            f"stated one, whose position_sigma is {stated[one]:.3g}, and was estimated almost "
            "without it; check the survey",
            UserWarning,
            stacklevel=3,
        )
    return found


def _worst(net: dict[str, Any], found: dict[str, Any], k: int, chance: float) -> int | None:
    """Return the receiver whose survey is contradicted most; None if none is."""
    if found["failure"] is not None:
        return None
    place, after = (np.asarray(table)[:k] for table in found["site"])
    before = np.maximum(net["site_sigma"][:k, np.newaxis] ** 2, np.finfo(float).tiny)
    variance = np.maximum(before - after**2, _LEAST * before)
    squares = np.sum((place - net["sites"][:k]) ** 2 / variance, axis=-1)
    worst = int(np.argmax(squares))
    limit = _core.chi_square_quantile(1.0 - chance / k, place.shape[-1])
    return worst if squares[worst] > limit else None
