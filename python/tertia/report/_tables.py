"""The tables of a page, and the rows of its summary."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tertia._arrays import FloatArray
from tertia.metrics._evaluation import figures
from tertia.metrics._indicator import share_text
from tertia.plot import rounded
from tertia.report._analysis import (
    INTERSECTION,
    OPTIMAL,
    OPTIMAL_FOUND,
    TOGETHER,
    Analysis,
    within,
)
from tertia.report._requirements import (
    CAPTION,
    COLUMNS,
    WITHOUT_LIMITS,
    requirement_cells,
    requirement_rows,
)
from tertia.report._times import Times

Row = dict[str, Any]
# largest number of rows of a table in a page
ROWS = 500
DEGREES = 180.0 / np.pi
# kinds of measurements, their units in column names, and their units in texts
KINDS = ("range", "m", " m"), ("azimuth", "deg", "°")


@dataclass(frozen=True, slots=True)
class Table:
    """A table: its name, caption and columns, rows of text, and all values as CSV.

    `words` marks the columns that contain text instead of numbers.
    """

    name: str
    caption: str
    columns: list[str]
    words: list[bool]
    rows: list[list[str]]
    more: int
    csv: str


def text(value: object) -> str:
    """Return a number as text with three digits, or with all digits before the decimal point."""
    if value is None or (isinstance(value, float) and np.isnan(value)):
        return "–"
    if isinstance(value, float):
        return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"
    return str(value)


def plus_minus(value: float | None, error: float | None) -> str:
    """Return a value and its error as text, rounded according to the size of the error."""
    if value is None or error is None or not (np.isfinite(value) and np.isfinite(error)):
        return "–"
    return " ± ".join(rounded(value, error))


def _parts(value: float | None) -> float | None:
    """Return a range gain in units of 1e-4."""
    return None if value is None else 1e4 * value


def finite_or_none(value: float) -> float | None:
    """Return the number, or None if it is not finite."""
    return float(value) if np.isfinite(value) else None


def radar_rows(analysis: Analysis) -> list[Row]:
    """Return rows with the noise, the biases and the updates of each radar."""
    rows, found = [], analysis.registration
    factor, error = found.noise_factor, found.noise_factor_sigma
    observable = found.observable
    for k, (name, radar) in enumerate(zip(analysis.names, analysis.radars, strict=True)):
        count, seen = analysis.updates[k], analysis.innovations[k]
        # a deviation of the azimuth is part of its sigma
        bias = found.sensors[k].bias
        expected = int(count.expected.sum())
        row: Row = {"radar": name, "plots": int(count.plots.sum())}
        for kind, unit, scale in (("range", "m", 1.0), ("azimuth", "deg", DEGREES)):
            stated = getattr(radar, f"{kind}_sigma") * scale
            level, level_error = (getattr(one, kind)[k] * stated for one in (factor, error))
            sigma = getattr(bias, f"{kind}_sigma") * scale
            value = getattr(bias, kind) * scale
            row |= {
                f"{kind}_sigma_stated_{unit}": stated,
                f"{kind}_sigma_{unit}": finite_or_none(level),
                f"{kind}_sigma_error_{unit}": finite_or_none(level_error),
            }
            row |= _bias(kind, f"_{unit}", value, sigma, observable[kind][k])
        for kind, unit in (("range_gain", ""), ("time", "_s")):
            value, sigma = (float(getattr(bias, name)) for name in (kind, f"{kind}_sigma"))
            row |= _bias(kind, unit, value, sigma, observable[kind][k])
        rows.append(
            row
            | {
                "innovations_squared": float(np.mean(seen.square)) if len(seen.square) else None,
                "probability_of_update": int(count.hit.sum()) / expected if expected else None,
                "outliers": int(count.outlier.sum()),
                "unassociated": int(count.unassociated.sum()),
                "refused": int(count.refused.sum()),
                "in_no_track": int(count.unused.sum()),
            }
        )
    return rows


def _bias(kind: str, unit: str, value: float, sigma: float, is_observable: bool) -> Row:
    """Return a systematic error; None if the plots do not determine it."""
    return {
        f"{kind}_bias{unit}": float(value) if is_observable else None,
        f"{kind}_bias_sigma{unit}": float(sigma),
    }


def fusion_rows(analysis: Analysis) -> list[Row]:
    """Return rows with the errors of the single and the fused tracks at their common instants."""
    if analysis.fusion is None:
        return []
    fused = analysis.fusion
    parts: list[tuple[str, FloatArray, str]] = [
        (f"{name} alone", fused.stated.covariance[:, k], f"#{k}")
        for k, name in enumerate(analysis.names)
    ]
    parts += [
        (name, fused.states[name][1], name) for name in (OPTIMAL, OPTIMAL_FOUND, INTERSECTION)
    ]
    # this name differs from that of the errors at updates in other tables
    parts.append((f"{TOGETHER}, at these instants", fused.states[TOGETHER][1], TOGETHER))
    rows = []
    for title, spread, key in parts:
        sigma = np.sqrt((spread[:, 0, 0] + spread[:, 1, 1]) / 2)
        known = np.isfinite(sigma)
        row: Row = {
            "tracks": title,
            "instants": int(known.sum()),
            "sigma_m": float(np.median(sigma[known])) if np.any(known) else None,
        }
        if fused.error:
            error, nees = fused.error[key], fused.nees[key]
            there = np.isfinite(error[:, 0])
            square = np.sum(error[there] ** 2, axis=1)
            row |= {
                "rmse_m": float(np.sqrt(np.mean(square))) if np.any(there) else None,
                "nees_per_axis": float(np.mean(nees[there]) / 2) if np.any(there) else None,
                "within_95": finite_or_none(within(nees)),
            }
        rows.append(row)
    return rows


def evaluation_rows(analysis: Analysis) -> list[Row]:
    """Return the figures of each set of tracks compared with the truth, one row per figure."""
    if not analysis.judged:
        return []
    columns = {
        name: figures(one, analysis.update_interval) for name, one in analysis.judged.items()
    }
    first = next(iter(columns.values()))
    return [
        {"figure": figure, "unit": unit}
        | {
            name: next((value for other, value, _ in values if other == figure), None)
            for name, values in columns.items()
        }
        for figure, _, unit in first
    ]


def audit_rows(analysis: Analysis) -> list[Row]:
    """Return the audit of each set of tracks, which judges its sigmas."""
    return [
        {
            "tracks": name,
            "count": one.count,
            "effective_number": one.effective_number,
            "nees_per_axis": one.nees.value,
            "nees_low": one.nees.low,
            "nees_high": one.nees.high,
            **{
                f"{key}_{100 * p:.0f}": value
                for p, share in one.coverage.items()
                for key, value in (
                    ("within", share.value),
                    ("low", share.low),
                    ("high", share.high),
                )
            },
            "radius_95_m": finite_or_none(one.radius[0.95].value),
            "verdict": one.verdict,
        }
        for name, one in analysis.audits.items()
    ]


def plan_rows(analysis: Analysis) -> list[Row]:
    """Return rows with the conformance of tracks to their plans."""
    return [
        {
            "plan": one.name,
            "track": one.track,
            "first_s": float(one.time[0]),
            "last_s": float(one.time[-1]),
            "conforms": float(np.mean(one.conforms)),
            "cross_track_rms_m": float(np.sqrt(np.mean(one.cross_track[one.conforms] ** 2)))
            if np.any(one.conforms)
            else None,
            "largest_cross_track_m": float(np.max(np.abs(one.cross_track))),
            "left_s": finite_or_none(one.left),
            "back_s": finite_or_none(one.back),
        }
        for one in analysis.followed
    ]


def track_rows(analysis: Analysis) -> list[Row]:
    """Return one row for each track from the plots of all radars."""
    table, rows = analysis.joint, []
    plans = {one.track: one.name for one in analysis.followed}
    for number in np.unique(table.track[table.confirmed]):
        own = (table.track == number) & table.confirmed
        hit = own & (table.plot >= 0)
        height = table.height[own]
        rows.append(
            {
                "track": int(number),
                "plan": plans.get(int(number)),
                "first_s": float(table.time[own].min()),
                "last_s": float(table.time[own].max()),
                "plots": int(hit.sum()),
                "probability_of_update": float(hit.sum() / own.sum()),
                "speed_m_s": float(np.mean(np.hypot(*table.velocity[own].T))),
                "height_m": float(np.nanmean(height)) if np.any(np.isfinite(height)) else None,
                "turning": float(np.mean(table.turn_probability[own] > 0.5)),
                "sigma_m": float(
                    np.median(
                        np.sqrt((table.covariance[own, 0, 0] + table.covariance[own, 1, 1]) / 2)
                    )
                ),
            }
        )
    return rows


def tables(analysis: Analysis, times: Times) -> dict[str, list[Table]]:
    """Return the tables of each section."""
    return {
        "radars": [_radar_table(analysis), *_reference_tables(analysis)],
        "fusion": [_fusion_table(analysis)] if analysis.fusion is not None else [],
        "truth": [_requirement_table(analysis), _evaluation_table(analysis)]
        if analysis.judged
        else [],
        "audit": [_audit_table(analysis)] if analysis.audits else [],
        "plans": [_plan_table(analysis, times)] if analysis.followed else [],
        "tracks": [_track_table(analysis, times)],
    }


def table(
    name: str,
    caption: str,
    columns: dict[str, str],
    rows: list[Row],
    values: Sequence[Row] | None = None,
) -> Table:
    """Return a table with the columns of these titles; it is cut off after `ROWS` rows.

    `values` are the rows of the summary that the CSV contains; they are needed if `rows` has texts.
    """
    cells = [[text(row.get(key)) for key in columns] for row in rows[:ROWS]]
    more = max(0, len(rows) - ROWS)
    words = [_are_words([row[at] for row in cells]) for at in range(len(columns))]
    return Table(name, caption, list(columns.values()), words, cells, more, _csv(values or rows))


def _are_words(cells: Sequence[str]) -> bool:
    """Return whether a column contains texts and no numbers."""
    there = [cell for cell in cells if cell not in {"", "–"}]
    return bool(there) and not any(cell[0].isdigit() or cell[0] in "+-−<" for cell in there)


def _csv(rows: Sequence[Row]) -> str:
    """Return all rows as CSV, with numbers in full precision."""
    file = io.StringIO()
    names = dict.fromkeys(name for row in rows for name in row)
    writer = csv.DictWriter(file, list(names), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return file.getvalue()


def _radar_table(analysis: Analysis) -> Table:
    rows = radar_rows(analysis)
    for row in rows:
        for kind, unit, _ in KINDS:
            level, bias = f"{kind}_sigma", f"{kind}_bias"
            row[kind] = plus_minus(row[f"{level}_{unit}"], row[f"{level}_error_{unit}"])
            row[bias] = plus_minus(row[f"{bias}_{unit}"], row[f"{bias}_sigma_{unit}"])
        row["gain"] = plus_minus(
            _parts(row["range_gain_bias"]), _parts(row["range_gain_bias_sigma"])
        )
        row["time"] = plus_minus(row["time_bias_s"], row["time_bias_sigma_s"])
    columns = {
        "radar": "radar",
        "plots": "plots",
        "range_sigma_stated_m": "range sigma, stated (m)",
        "range": "estimated (m)",
        "azimuth_sigma_stated_deg": "azimuth sigma, stated (°)",
        "azimuth": "estimated (°)",
        "range_bias": "range bias (m)",
        "gain": "range gain (10⁻⁴)",
        "azimuth_bias": "azimuth bias (°)",
        "time": "clock (s)",
        "innovations_squared": "normalised innovation²",
        "probability_of_update": "updated scans",
        "outliers": "outliers",
        "unassociated": "unassociated",
        "refused": "refused",
        "in_no_track": "without a track",
    }
    caption = (
        "Noise as stated for the radars and as estimated from their plots, and systematic errors "
        "at the end, estimated from targets that several radars see (–: not determined by the "
        "plots). The "
        "mean normalised squared innovation is 1 per axis if the stated noise and the motion "
        "model are correct."
    )
    return table("radar-table", caption, columns, rows, radar_rows(analysis))


def reference_rows(analysis: Analysis) -> list[Row]:
    """Return rows that compare the tracks of each radar with those of all other radars."""
    return [
        {
            "radar": one.radar,
            "plots": one.count,
            "distance_m": one.distance,
            "reference_sigma_m": one.sigma,
            "nees_per_axis": one.nees,
        }
        for one in analysis.references
    ]


def _reference_tables(analysis: Analysis) -> list[Table]:
    if not analysis.references:
        return []
    columns = {
        "radar": "radar",
        "plots": "plots",
        "distance_m": "distance (m)",
        "reference_sigma_m": "sigma of the reference (m)",
        "nees_per_axis": "NEES per axis",
    }
    caption = (
        "Tracks of each radar, with stated noise, versus a reference: smoothed tracks of the same "
        "targets from the plots of all other radars, with estimated noise and without their "
        "biases. Distances are per axis and include the errors of the reference; the NEES allows "
        "for both errors."
    )
    return [table("reference-table", caption, columns, reference_rows(analysis))]


def _fusion_table(analysis: Analysis) -> Table:
    columns = {"tracks": "tracks", "instants": "instants", "sigma_m": "stated sigma (m)"}
    if analysis.fusion is not None and analysis.fusion.error:
        columns |= {
            "rmse_m": "RMSE at these instants (m)",
            "nees_per_axis": "NEES per axis",
            "within_95": "within the 95 % ellipse",
        }
    caption = (
        "Tracks of single radars, extrapolated to common instants at which at least two radars "
        "have a track, and fused. States that are too far from their targets are left out. Sigma "
        "is the median per axis. Estimated noise: the noise of each period is used, and biases "
        "are removed. Fusion assumes that the errors of the radars are independent; in turns they "
        "are correlated, because all trackers assume the same motion. Covariance intersection is "
        "valid for any correlation, and is conservative."
    )
    return table("fusion-table", caption, columns, fusion_rows(analysis))


def _requirement_table(analysis: Analysis) -> Table:
    cells, values = requirement_cells(analysis), requirement_rows(analysis)
    columns, caption = COLUMNS, CAPTION
    if not analysis.limits:
        columns = {key: name for key, name in COLUMNS.items() if key not in {"limit", "verdict"}}
        caption = WITHOUT_LIMITS
    return table("requirement-table", caption, columns, cells, values)


def _evaluation_table(analysis: Analysis) -> Table:
    columns = {"figure": "figure", "unit": "unit"} | {name: name for name in analysis.judged}
    caption = f"Tracks versus truth. An update is required every {analysis.update_interval:.3g} s."
    return table("evaluation-table", caption, columns, evaluation_rows(analysis))


def _audit_table(analysis: Analysis) -> Table:
    rows = [
        {
            "tracks": name,
            "count": one.count,
            "worth": f"{one.effective_number:.0f}",
            "nees": str(one.nees).partition(":")[0],
            **{f"{100 * p:g} %": share_text(share) for p, share in one.coverage.items()},
            "radius": one.radius[0.95].value if np.isfinite(one.radius[0.95].value) else None,
            "verdict": one.verdict,
        }
        for name, one in analysis.audits.items()
    ]
    shares = {f"{100 * p:g} %": f"within {100 * p:g} %" for p in (0.5, 0.9, 0.95, 0.99)}
    columns = {
        "tracks": "tracks",
        "count": "updates",
        "worth": "effective number",
        "nees": "NEES per axis",
        **shares,
        "radius": "95 % of errors within (m)",
        "verdict": "sigmas are",
    }
    caption = (
        "Errors versus stated covariances, with 95 % intervals that allow for time-correlated "
        "errors; the effective number is the number of independent updates that have the same "
        "information. Factors apply to sigmas."
    )
    return table("audit-table", caption, columns, rows, audit_rows(analysis))


def _plan_table(analysis: Analysis, times: Times) -> Table:
    columns = {
        "plan": "plan",
        "track": "track",
        "first_s": times.column("from"),
        "last_s": times.column("to"),
        "conforms": "share on the plan",
        "cross_track_rms_m": "RMS cross-track on the plan (m)",
        "largest_cross_track_m": "largest cross-track (m)",
        "left_s": times.column("left"),
        "back_s": times.column("back"),
    }
    caption = (
        "Conformance of tracks to their plans. A plan counts as left if at least five successive "
        "plots do not conform to it, over at least three scans of the slowest radar."
    )
    values = plan_rows(analysis)
    return table("plan-table", caption, columns, _timed(values, times), values)


def _track_table(analysis: Analysis, times: Times) -> Table:
    columns = {
        "track": "track",
        "plan": "plan",
        "first_s": times.column("from"),
        "last_s": times.column("to"),
        "plots": "plots",
        "probability_of_update": "updated scans",
        "speed_m_s": "speed (m/s)",
        "height_m": "height (m)",
        "turning": "share in turns",
        "sigma_m": "stated sigma (m)",
    }
    values = track_rows(analysis)
    errors = ", with their systematic errors subtracted" if analysis.is_corrected else ""
    caption = f"Tracks of all radars together{errors}."
    return table("track-table", caption, columns, _timed(values, times), values)


def _timed(rows: list[Row], times: Times) -> list[Row]:
    """Return the rows with their times converted to text."""
    names = ("first_s", "last_s", "left_s", "back_s")
    return [row | {name: times.text(row[name]) for name in names if name in row} for row in rows]
