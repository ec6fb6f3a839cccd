"""The summary of a page: the values of all its tables, and its findings."""

from __future__ import annotations

import numpy as np

from tertia.report._analysis import FOUND, TOGETHER, UNCORRECTED, Analysis, within
from tertia.report._bearings import Finders
from tertia.report._finders import emitter_rows, finder_findings
from tertia.report._requirements import requirement_rows
from tertia.report._tables import (
    KINDS,
    Row,
    audit_rows,
    evaluation_rows,
    fusion_rows,
    plan_rows,
    plus_minus,
    radar_rows,
    reference_rows,
    text,
    track_rows,
)
from tertia.report._times import Times
from tertia.tracker import PlotStatus, TrackTable

# a finding is shown if it exceeds this number of its sigmas, and these relative sizes of noise and
# bias
_SURE, _OFF, _BIASED = 3.0, 0.15, 0.5
# smallest clock error that is shown, in seconds; an airliner flies 50 m in this time
_LATE = 0.2
# summary of a page without radars
_NOTHING: Row = {
    "plots": 0,
    "plots_refused": {},
    "tracks": 0,
    "tracks_not_corrected": 0,
    "plans": 0,
    **{
        name: []
        for name in (
            *("radars", "references", "fusion", "evaluation"),
            *("requirements", "audit", "conformance"),
        )
    },
}


def summary(analysis: Analysis | None, finders: Finders, scale: Times) -> Row:
    """Return all results as numbers, lists and texts for JSON; unknown values are None."""
    times = [heard.emitter.time for heard in finders.heard]
    found = []
    if analysis is not None:
        times.append(analysis.plots.time)
        found = _radar_findings(analysis, scale)
    time = np.concatenate([np.zeros(0), *times])
    time = time[np.isfinite(time)]
    return {
        "duration_s": float(np.ptp(time)) if len(time) else 0.0,
        "findings": [*found, *finder_findings(finders)],
        **(_NOTHING if analysis is None else _of_radars(analysis)),
        "emitters": emitter_rows(finders),
    }


def _of_radars(analysis: Analysis) -> Row:
    statuses, counts = np.unique(analysis.joint.track_of_plot, return_counts=True)
    return {
        "plots": len(analysis.plots),
        "plots_refused": {
            PlotStatus(status).message: count
            for status, count in zip(statuses.tolist(), counts.tolist(), strict=True)
            if status < 0
        },
        "tracks": len(track_rows(analysis)),
        "tracks_not_corrected": _count(analysis.uncorrected),
        "plans": len(analysis.plans),
        "radars": radar_rows(analysis),
        "references": reference_rows(analysis),
        "fusion": fusion_rows(analysis),
        "evaluation": evaluation_rows(analysis),
        "requirements": requirement_rows(analysis),
        "audit": audit_rows(analysis),
        "conformance": plan_rows(analysis),
    }


def _radar_findings(analysis: Analysis, scale: Times) -> list[str]:
    """Return sentences that state the findings."""
    found, biases = [], []
    for row in radar_rows(analysis):
        biases += (own := _bias_findings(row))
        found += _noise_findings(row) + own
    for time, k in analysis.registration.changes:
        found.append(f"{analysis.names[k]}: bias changed suddenly at {scale.at(time)}.")
    if biases:
        found += _cost(analysis)
    left = [one for one in analysis.followed if np.isfinite(one.left)]
    if left:
        listed = ", ".join(f"{one.name} at {scale.at(one.left)}" for one in left[:8])
        more = f", and {len(left) - 8} more" if len(left) > 8 else ""
        found.append(f"Left their plans: {listed}{more}.")
    if TOGETHER in analysis.judged:
        nees = analysis.judged[TOGETHER].nees
        rmse = analysis.judged[TOGETHER].indicators.rmse.value
        words = f"All radars together: RMSE {text(rmse)} m"
        if nees is not None and np.any(np.isfinite(nees)):
            words += (
                f", NEES per axis {text(float(np.nanmean(nees)) / 2)}, "
                f"{within(nees) * 100:.0f} % within the 95 % ellipse"
            )
        if TOGETHER in analysis.audits:
            words += f"; sigmas are {analysis.audits[TOGETHER].verdict}"
        found += [f"{words}.", *_better(analysis)]
    return found


def _count(table: TrackTable) -> int:
    return len(np.unique(table.track[table.confirmed]))


def _cost(analysis: Analysis) -> list[str]:
    """Return a sentence on the tracks if biases were not corrected, unless they are as good."""
    count, uncorrected = _count(analysis.joint), _count(analysis.uncorrected)
    words = [f"{uncorrected} tracks instead of {count}"] if uncorrected > count else []
    if {TOGETHER, UNCORRECTED} <= set(analysis.judged):
        rmse, worse = (
            analysis.judged[name].indicators.rmse.value for name in (TOGETHER, UNCORRECTED)
        )
        if worse > (1.0 + _OFF) * rmse:
            words.append(f"RMSE {text(worse)} m instead of {text(rmse)} m")
    return [f"Without correction of the biases: {', '.join(words)}."] if words else []


def _better(analysis: Analysis) -> list[str]:
    """Return a sentence on how much better the tracks with the estimated noise are, if any."""
    stated, found = (analysis.judged[name].indicators for name in (TOGETHER, FOUND))
    if (
        stated.false_tracks <= found.false_tracks
        and found.rmse.value > (1.0 - _OFF) * stated.rmse.value
    ):
        return []
    words = f"With the estimated noise and biases: RMSE {text(found.rmse.value)} m"
    if stated.false_tracks != found.false_tracks:
        words += f", {found.false_tracks} false tracks instead of {stated.false_tracks}"
    return [f"{words}."]


def _noise_findings(row: Row) -> list[str]:
    found = []
    for kind, unit, sign in KINDS:
        sigma, error = row[f"{kind}_sigma_{unit}"], row[f"{kind}_sigma_error_{unit}"]
        stated = row[f"{kind}_sigma_stated_{unit}"]
        if sigma is None or error is None:
            continue
        if abs(sigma - stated) > max(_SURE * error, _OFF * stated):
            found.append(
                f"{row['radar']}: {kind} sigma {plus_minus(sigma, error)}{sign}, "
                f"{sigma / stated:.2g} times the stated {text(stated)}{sign}."
            )
    return found


def _bias_findings(row: Row) -> list[str]:
    found = []
    for kind, unit, sign in KINDS:
        bias, error = row[f"{kind}_bias_{unit}"], row[f"{kind}_bias_sigma_{unit}"]
        stated = row[f"{kind}_sigma_stated_{unit}"]
        if bias is not None and abs(bias) > max(_SURE * error, _BIASED * stated):
            found.append(f"{row['radar']}: {kind} bias {plus_minus(bias, error)}{sign}.")
    late, error = row["time_bias_s"], row["time_bias_sigma_s"]
    if late is not None and abs(late) > max(_SURE * error, _LATE):
        found.append(f"{row['radar']}: clock error {plus_minus(late, error)} s.")
    return found
