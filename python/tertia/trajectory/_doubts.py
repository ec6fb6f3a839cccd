"""Warnings about paths that may be wrong."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from tertia import _core
from tertia._arrays import BoolArray, FloatArray
from tertia.location._doubts import doubt_numbers
from tertia.location._explained import warn_if_explained
from tertia.sensors._kinds import KINDS
from tertia.trajectory._speed import height_rows, instants

# share of instants with outliers from which angles may be in degrees
_CONTRADICTED = 0.25
# share of measurements that contradict a path from which it is doubtful
_MOST = 0.5
# the same, if errors of clocks are estimated: if clocks have not been found, about as many
_MOST_TIMED = 0.1
# least number of instants of a part in which stations are left out in turn, share of the instants
# with outliers from which it is one station, and most measurements with few redundant ones
_PART = 20
_ONE = 0.9
_FEW = 5
# share of the outliers that are followed by another one of the same station: more than of faults
_LASTING = 0.7
_BEHIND = (
    "no path above the stations fits the measurements: the path is below them; give initial to "
    "choose the side"
)
_MAY_CROSS = (
    "the path turns back at the plane of the stations, although one that crosses it would be "
    "smoother: what is measured is the same on both sides of the plane; measure elevations, or add "
    "a station outside the plane"
)
_DOUBTFUL = (
    "near the plane of the stations (in two dimensions, their line), the path may cross it or turn "
    "back: both explain the measurements about equally well, and what follows may be on the wrong "
    "side; measure azimuths, or add a station outside the plane"
)
_MIRRORED = (
    "two paths explain the measurements (almost) equally well: this one, above the stations, and "
    "its mirror image below them (mirror_image); give initial to choose. A path that crosses the "
    "plane of the stations would be reflected at it"
)
_FIRST = (
    "the first station contradicts the others, so all its range differences are outliers: the path "
    "follows from the differences between the other stations; check the clock and the position of "
    "the first station"
)
_IN_TURN = (
    "at most of the instants {} to {}, measurements contradict the path, of one station and then "
    "of another: few measurements are redundant, so it cannot be told which station is wrong, and "
    "the path may be wrong by more than its sigmas; leave out the station that may be wrong there"
)
_KIND = (
    "all measurements of {} contradict the others and are left out: check their sign, unit and "
    "reference"
)


def warn_of_path(found: dict[str, Any], values: FloatArray, *, timed: bool = False) -> None:
    """Warn if a path found by the core from measurements, (N, 5, K), may be wrong.

    `timed` means that errors of clocks were estimated.
    """
    _warn_of_sides(found)
    if _contradicts_first(found["outlier"], values):
        warnings.warn(_FIRST, UserWarning, stacklevel=3)
        return
    _warn_of_kinds(found["outlier"], values)
    _warn_if_in_turn(found["outlier"], values)
    _warn_if_few_agree(found["outlier"], values, timed=timed)


def _warn_of_kinds(outlier: BoolArray, values: FloatArray) -> None:
    """Warn of kinds of measurements of several stations that are all outliers."""
    known = np.isfinite(values)
    right = np.any(known & ~outlier, axis=(0, 2))
    several = np.count_nonzero(np.any(known, axis=0), axis=1) > 1
    for at in np.flatnonzero(several & ~right):
        warnings.warn(_KIND.format(KINDS[at]), UserWarning, stacklevel=4)


def _contradicts_first(outlier: BoolArray, values: FloatArray) -> bool:
    """Whether the first station is what is wrong with the range differences of most instants."""
    at = KINDS.index("range_difference")
    known = np.any(np.isfinite(values[:, at]), axis=-1)
    if np.any(np.isfinite(np.delete(values, at, axis=1))):
        # the differences may contradict the other measurements
        return False
    # only the core marks the column of the first station, which has no differences
    return int(np.count_nonzero(outlier[:, at, 0])) > _MOST * int(np.count_nonzero(known))


def _warn_if_in_turn(outlier: BoolArray, values: FloatArray) -> None:
    """Warn of a long part of the record in which stations are left out in turn."""
    judged = np.isfinite(values) & ~_repeats(values)
    known = np.flatnonzero(judged.any(axis=(1, 2)))
    wrong = (outlier & judged)[known].reshape(len(known), -1)
    sums = np.concatenate([[0.0], np.cumsum(wrong.any(axis=-1) - 0.5)])
    # the part in which more than half of the instants have outliers by the largest number
    rise = sums - np.minimum.accumulate(sums)
    end = int(np.argmax(rise))
    start = int(np.argmin(sums[: end + 1]))
    counts = wrong[start:end].sum(axis=0)
    redundant = judged[known].sum(axis=(1, 2))[start:end]
    contradicted = np.count_nonzero(wrong[start:end].any(axis=-1))
    if end - start < _PART or counts.max() > _ONE * contradicted:
        return
    part = wrong[start:end]
    lasts = np.count_nonzero(part[1:] & part[:-1]) > _LASTING * np.count_nonzero(part)
    if lasts and np.median(redundant) <= _FEW:
        first, last = known[start], known[end - 1]
        warnings.warn(_IN_TURN.format(first, last), UserWarning, stacklevel=4)


def _warn_if_few_agree(outlier: BoolArray, values: FloatArray, *, timed: bool) -> None:
    """Warn if the path contradicts most measurements, or many of them although clocks are free."""
    judged = np.isfinite(values) & ~_repeats(values)
    left_out, count = np.count_nonzero(outlier & judged), np.count_nonzero(judged)
    if timed and left_out > _MOST_TIMED * count:
        warnings.warn(
            f"{left_out} of {count} measurements contradict the path and are left out: the errors "
            "of the clocks may be wrong; correct times as far as their errors are known (time of "
            "Bias), or state one clock that is right (time_sigma 0)",
            UserWarning,
            stacklevel=4,
        )
        return
    if left_out > _MOST * count:
        warnings.warn(
            f"{left_out} of {count} measurements contradict the path and are left out, so it may "
            "be wrong: are sigmas far too small, do clocks of stations differ (then give Bias a "
            "time_sigma), or are positions of stations wrong?",
            UserWarning,
            stacklevel=4,
        )


def _repeats(values: FloatArray) -> BoolArray:
    """Return which measurements, (N, 5, K), equal the last one of their station and kind."""
    at = np.arange(len(values))[:, np.newaxis, np.newaxis]
    last = np.maximum.accumulate(np.where(np.isfinite(values), at, 0))
    before = np.take_along_axis(values, last[:-1], axis=0)
    return np.concatenate([np.zeros((1, *values.shape[1:]), bool), values[1:] == before])


def _warn_of_sides(found: dict[str, Any]) -> None:
    """Warn if it is not certain on which side of the plane of the stations the path is."""
    remarks = (
        (found["image"] is not None, _MIRRORED),
        (found["is_behind"], _BEHIND),
        (found["may_cross"], _MAY_CROSS),
        (found["is_doubtful"], _DOUBTFUL),
    )
    for applies, remark in remarks:
        if applies:
            warnings.warn(remark, UserWarning, stacklevel=4)


def doubt_measurements(
    record: dict[str, Any], found: dict[str, Any], *, degrees: bool, free: bool
) -> None:
    """Warn if single instants contradict themselves, and would agree under another convention.

    If systematic errors are `free`, also if a height, an offset or a clock explains contradictions.
    """
    values, sigmas, rows = record["values"], record["sigmas"], instants(record)
    options: tuple[Any, ...] = (
        *(None, height_rows(record), None, ("robust", 3), (True, record["correlation"])),
        *(sigmas.size * [False], False, (0.0, 0.0, (False, False)), 1),
    )

    def solve(values: FloatArray, sigmas: FloatArray) -> Sequence[Any]:
        return _core.locate(*rows, values, sigmas, *options)[:-2]

    known = sigmas[np.newaxis]
    # fixes without what contradicts the path say little where most of it does
    fixes = found.get("fixes")
    if fixes is None or np.mean(found["outlier"].any(axis=(-2, -1))) > _CONTRADICTED:
        fixes = solve(values, known)
    if doubt_numbers(fixes, values, known, solve, degrees=degrees):
        return
    # clocks and a speed that are estimated have effects like those of the causes
    is_known = record["clocks"] is None and record["speed_sigma"] == 0
    if free and record["robust"] and is_known and found["failure"] is None:
        position, velocity = np.split(found["mean"], 3, axis=1)[:2]
        own = known if record["own_sigmas"] is None else record["own_sigmas"]
        surveys = None if record["surveys"] is None else np.array(record["surveys"])
        warn_if_explained(
            (*rows, values, own, surveys, height_rows(record)),
            (position, velocity, found["outlier"]),
        )
