"""Comparison of the indicators of tracks with their limits."""

from __future__ import annotations

from typing import Any

import numpy as np

from tertia.metrics._evaluation import requirements
from tertia.metrics._indicator import share_text, text
from tertia.report._analysis import Analysis

Row = dict[str, Any]
CAPTION = (
    "Indicators of the tracks versus their limits, with 95 % confidence intervals by flight. A "
    "limit is met if the whole interval is within it, and not met if the whole interval is beyond "
    "it. Otherwise the recording is too short to decide (not shown)."
)
WITHOUT_LIMITS = (
    "Indicators with confidence intervals of 95 % by flight. If limits are given (--limits FILE "
    "or limits=), the table also states which of them are met."
)
COLUMNS = {
    "figure": "figure",
    "tracks": "tracks",
    "found": "value",
    "limit": "limit",
    "verdict": "verdict",
}


def requirement_rows(analysis: Analysis) -> list[Row]:
    """Return the indicators of each set of tracks with their intervals, limits and verdicts."""
    return [
        {
            "figure": figure,
            "unit": unit,
            "tracks": name,
            "value": one.value if np.isfinite(one.value) else None,
            "low": one.low if np.isfinite(one.low) else None,
            "high": one.high if np.isfinite(one.high) else None,
            "limit": limit,
            "verdict": one.verdict,
        }
        for name, judged in analysis.judged.items()
        for figure, one, limit, unit in requirements(judged, analysis.limits)
    ]


def requirement_cells(analysis: Analysis) -> list[Row]:
    """Return the indicators of `requirement_rows` as texts for a table."""
    return [
        {
            "figure": figure,
            "tracks": name,
            "found": f"{' '.join(text(one.value, one.low, one.high))} {unit}"
            if unit
            else share_text(one),
            "limit": None
            if limit is None
            else f"{limit:g} {unit}"
            if unit
            else f"{100 * limit:g} %",
            "verdict": one.verdict or ("no limit is given" if limit is None else "unknown"),
        }
        for name, judged in analysis.judged.items()
        for figure, one, limit, unit in requirements(judged, analysis.limits)
    ]
