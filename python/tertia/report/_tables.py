"""The tables of a page, what is found, and the same for machines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tertia._arrays import FloatArray
from tertia.metrics._evaluation import figures
from tertia.plot import rounded
from tertia.report._analysis import (
    FOUND,
    INTERSECTION,
    OPTIMAL,
    OPTIMAL_FOUND,
    TOGETHER,
    Analysis,
    within,
)
from tertia.tracker import PlotStatus

Row = dict[str, Any]
# rows of a table in a page at most
ROWS = 500
# standard errors beyond which something is said, and how far off noise and bias must be
_SURE, _OFF, _BIASED = 3.0, 0.15, 0.5
_DEGREES = 180.0 / np.pi


@dataclass(frozen=True, slots=True)
class Table:
    """A table: its name, caption, columns, and rows of text."""

    name: str
    caption: str
    columns: list[str]
    rows: list[list[str]]
    more: int = 0


def text(value: object) -> str:
    """Return a cell: three digits, and all of those before the point."""
    if value is None or (isinstance(value, float) and np.isnan(value)):
        return "–"
    if isinstance(value, float):
        return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"
    return str(value)


def plus_minus(value: float | None, error: float | None) -> str:
    """Return a value with its error, digits as the error allows."""
    if value is None or error is None or not (np.isfinite(value) and np.isfinite(error)):
        return "–"
    return " ± ".join(rounded(value, error))


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def radar_rows(told: Analysis) -> list[Row]:
    """Return what is found of each radar."""
    rows = []
    for k, (name, radar) in enumerate(zip(told.names, told.radars, strict=True)):
        one, count, seen = told.noise[k], told.updates[k], told.innovations[k]
        expected = int(count.expected.sum())
        bias, error = told.biases.value[k], told.biases.error[k]
        rows.append(
            {
                "radar": name,
                "plots": int(count.plots.sum()),
                "range_sigma_stated_m": radar.range_sigma,
                "range_sigma_m": _known(one.sigma[0]),
                "range_sigma_error_m": _known(one.error[0]),
                "azimuth_sigma_stated_deg": radar.azimuth_sigma * _DEGREES,
                "azimuth_sigma_deg": _known(one.sigma[1] * _DEGREES),
                "azimuth_sigma_error_deg": _known(one.error[1] * _DEGREES),
                "range_bias_m": _known(bias[0]),
                "range_bias_error_m": _known(error[0]),
                "azimuth_bias_deg": _known(bias[1] * _DEGREES),
                "azimuth_bias_error_deg": _known(error[1] * _DEGREES),
                "innovations_squared": float(np.mean(seen.square)) if len(seen.square) else None,
                "probability_of_update": int(count.hit.sum()) / expected if expected else None,
                "far_off": int(count.faulty.sum()),
                "astray": int(count.astray.sum()),
                "refused": int(count.refused.sum()),
                "in_no_track": int(count.unused.sum()),
            }
        )
    return rows


def fusion_rows(told: Analysis) -> list[Row]:
    """Return how good tracks are at the common instants, alone and fused."""
    if told.fusion is None:
        return []
    fused = told.fusion
    parts: list[tuple[str, FloatArray, str]] = [
        (f"{name} alone", fused.told.covariance[:, k], f"#{k}") for k, name in enumerate(told.names)
    ]
    parts += [
        (name, fused.states[name][1], name)
        for name in (OPTIMAL, OPTIMAL_FOUND, INTERSECTION, TOGETHER)
    ]
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
                "within_95": _known(within(nees)),
            }
        rows.append(row)
    return rows


def evaluation_rows(told: Analysis) -> list[Row]:
    """Return the figures of each set of tracks beside the truth, one row per figure."""
    if not told.judged:
        return []
    columns = {name: figures(one, told.period) for name, one in told.judged.items()}
    first = next(iter(columns.values()))
    return [
        {"figure": figure, "unit": unit}
        | {
            name: next((value for other, value, _ in values if other == figure), None)
            for name, values in columns.items()
        }
        for figure, _, unit in first
    ]


def plan_rows(told: Analysis) -> list[Row]:
    """Return how tracks follow their plans."""
    return [
        {
            "plan": one.name,
            "track": one.track,
            "first_s": float(one.time[0]),
            "last_s": float(one.time[-1]),
            "conforming": float(np.mean(one.conforming)),
            "offset_rms_m": float(np.sqrt(np.mean(one.offset[one.conforming] ** 2)))
            if np.any(one.conforming)
            else None,
            "largest_offset_m": float(np.max(np.abs(one.offset))),
            "left_s": _known(one.left),
            "back_s": _known(one.back),
        }
        for one in told.followed
    ]


def emitter_rows(told: Analysis) -> list[Row]:
    """Return position and bearings of each emitter."""
    rows = []
    for heard in told.heard:
        names = [str(s.name or k + 1) for k, s in enumerate(told.stations)]
        row: Row = {
            "emitter": heard.emitter.name,
            "moves": heard.moves,
            "bearings": [
                {
                    "station": name,
                    "bearing_deg": _known(heard.bearing[k] * _DEGREES),
                    "sigma_deg": _known(heard.sigma[k] * _DEGREES),
                    "count": int(np.sum(~np.isnan(heard.emitter.azimuth[:, k]))),
                    "anomalous": int(heard.outlier[:, k].sum()),
                }
                for k, name in enumerate(names)
            ],
        }
        if heard.position is not None:
            place, sigma = heard.position.position[0], heard.position.sigma[0]
            row |= {
                "east_m": float(place[0]),
                "east_sigma_m": float(sigma[0]),
                "north_m": float(place[1]),
                "north_sigma_m": float(sigma[1]),
                "p_value": _known(float(np.ravel(heard.position.pvalue)[0])),
            }
        rows.append(row)
    return rows


def track_rows(told: Analysis) -> list[Row]:
    """Return what is told of each track of all radars."""
    table, rows = told.joint, []
    plans = {one.track: one.name for one in told.followed}
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


def tables(told: Analysis) -> dict[str, list[Table]]:
    """Return the tables of each section."""
    return {
        "radars": [_radar_table(told)],
        "fusion": [_fusion_table(told)] if told.fusion is not None else [],
        "truth": [_evaluation_table(told)] if told.judged else [],
        "plans": [_plan_table(told)] if told.followed else [],
        "finders": [_emitter_table(told), _bearing_table(told)] if told.heard else [],
        "tracks": [_track_table(told)],
    }


def _table(name: str, caption: str, columns: dict[str, str], rows: list[Row]) -> Table:
    cells = [[text(row.get(key)) for key in columns] for row in rows[:ROWS]]
    return Table(name, caption, list(columns.values()), cells, max(0, len(rows) - ROWS))


def _radar_table(told: Analysis) -> Table:
    rows = []
    for row in radar_rows(told):
        rows.append(
            row
            | {
                "range": plus_minus(row["range_sigma_m"], row["range_sigma_error_m"]),
                "azimuth": plus_minus(row["azimuth_sigma_deg"], row["azimuth_sigma_error_deg"]),
                "range_bias": plus_minus(row["range_bias_m"], row["range_bias_error_m"]),
                "azimuth_bias": plus_minus(row["azimuth_bias_deg"], row["azimuth_bias_error_deg"]),
            }
        )
    columns = {
        "radar": "radar",
        "plots": "plots",
        "range_sigma_stated_m": "range sigma, stated (m)",
        "range": "found (m)",
        "azimuth_sigma_stated_deg": "azimuth sigma, stated (°)",
        "azimuth": "found (°)",
        "range_bias": "range bias (m)",
        "azimuth_bias": "azimuth bias (°)",
        "innovations_squared": "normalised innovation²",
        "probability_of_update": "probability of update",
        "far_off": "far off",
        "astray": "astray",
        "refused": "refused",
        "in_no_track": "in no track",
    }
    caption = (
        "What radars state and what their plots show. Biases are found from the differences of the "
        "radars' tracks; – where the plots do not tell. Normalised innovations squared are 1 per "
        "axis where noise and motion are as stated."
    )
    return _table("radar-table", caption, columns, rows)


def _fusion_table(told: Analysis) -> Table:
    columns = {"tracks": "tracks", "instants": "instants", "sigma_m": "claimed sigma (m)"}
    if told.fusion is not None and told.fusion.error:
        columns |= {
            "rmse_m": "RMSE (m)",
            "nees_per_axis": "NEES per axis",
            "within_95": "within the 95 % ellipse",
        }
    caption = (
        "Tracks of single radars, brought to common instants where two radars or more have one, "
        "and fused there. Sigma is the median per axis. As found: with the noise of each stretch "
        "of time, and without the biases. Fusion takes the errors of the radars as "
        "independent; in turns they are not quite, as all radars believe in the same motion. "
        "Covariance intersection needs no such belief and is too careful."
    )
    return _table("fusion-table", caption, columns, fusion_rows(told))


def _evaluation_table(told: Analysis) -> Table:
    columns = {"figure": "figure", "unit": "unit"} | {name: name for name in told.judged}
    caption = f"Tracks beside the truth; updates are required every {told.period:.3g} s."
    return _table("evaluation-table", caption, columns, evaluation_rows(told))


def _plan_table(told: Analysis) -> Table:
    columns = {
        "plan": "plan",
        "track": "track",
        "first_s": "from (s)",
        "last_s": "to (s)",
        "conforming": "share on the plan",
        "offset_rms_m": "RMS offset on the plan (m)",
        "largest_offset_m": "largest offset (m)",
        "left_s": "left (s)",
        "back_s": "back (s)",
    }
    caption = (
        "Conformance: a plan counts as left where five plots or more do not fit it, for three "
        "scans of the slowest radar or longer."
    )
    return _table("plan-table", caption, columns, plan_rows(told))


def _emitter_table(told: Analysis) -> Table:
    rows = [
        {
            "emitter": row["emitter"],
            "moves": "yes" if row["moves"] else "no",
            "east": plus_minus(row.get("east_m"), row.get("east_sigma_m")),
            "north": plus_minus(row.get("north_m"), row.get("north_sigma_m")),
            "p_value": row.get("p_value"),
        }
        for row in emitter_rows(told)
    ]
    columns = {
        "emitter": "emitter",
        "moves": "moves",
        "east": "east (m)",
        "north": "north (m)",
        "p_value": "p-value",
    }
    caption = (
        "Positions from the bearings of all finders, each with the sigma that its record shows. A "
        "small p-value says that a bearing or a sigma is wrong."
    )
    return _table("emitter-table", caption, columns, rows)


def _bearing_table(told: Analysis) -> Table:
    rows = [
        {
            "emitter": row["emitter"],
            "station": one["station"],
            "bearing": plus_minus(one["bearing_deg"], one["sigma_deg"]),
            "count": one["count"],
            "anomalous": one["anomalous"],
        }
        for row in emitter_rows(told)
        for one in row["bearings"]
    ]
    columns = {
        "emitter": "emitter",
        "station": "finder",
        "bearing": "bearing (°)",
        "count": "measured",
        "anomalous": "anomalous",
    }
    return _table("bearing-table", "Bearings by the robust default.", columns, rows)


def _track_table(told: Analysis) -> Table:
    columns = {
        "track": "track",
        "plan": "plan",
        "first_s": "from (s)",
        "last_s": "to (s)",
        "plots": "plots",
        "probability_of_update": "probability of update",
        "speed_m_s": "speed (m/s)",
        "height_m": "height (m)",
        "turning": "share in turns",
        "sigma_m": "claimed sigma (m)",
    }
    return _table("track-table", "Tracks of all radars together.", columns, track_rows(told))


def summary(told: Analysis) -> Row:
    """Return all of it for machines: numbers, lists and texts alone, None where unknown."""
    time = told.plots.time[np.isfinite(told.plots.time)]
    statuses, counts = np.unique(told.joint.track_of_plot, return_counts=True)
    return {
        "plots": len(told.plots),
        "duration_s": float(np.ptp(time)) if len(time) else 0.0,
        "plots_refused": {
            PlotStatus(status).message: count
            for status, count in zip(statuses.tolist(), counts.tolist(), strict=True)
            if status < 0
        },
        "tracks": len(track_rows(told)),
        "plans": len(told.plans),
        "findings": findings(told),
        "radars": radar_rows(told),
        "fusion": fusion_rows(told),
        "evaluation": evaluation_rows(told),
        "conformance": plan_rows(told),
        "emitters": emitter_rows(told),
    }


def findings(told: Analysis) -> list[str]:
    """Return what stands out, in sentences."""
    found = []
    for row in radar_rows(told):
        found += _noise_findings(row) + _bias_findings(row)
    left = [one for one in told.followed if np.isfinite(one.left)]
    if left:
        listed = ", ".join(f"{one.name} at {one.left:.0f} s" for one in left[:8])
        more = f", and {len(left) - 8} more" if len(left) > 8 else ""
        found.append(f"Left their plans: {listed}{more}.")
    if TOGETHER in told.judged:
        nees = told.judged[TOGETHER].nees
        rmse = told.judged[TOGETHER].told.rmse
        words = f"All radars together: RMSE {text(float(rmse))} m"
        if nees is not None and np.any(np.isfinite(nees)):
            words += (
                f", NEES per axis {text(float(np.nanmean(nees)) / 2)}, "
                f"{within(nees) * 100:.0f} % within the 95 % ellipse"
            )
        found += [f"{words}.", *_better(told)]
    for row in emitter_rows(told):
        if row["moves"]:
            found.append(f"{row['emitter']} moves.")
        elif "east_m" in row:
            east = plus_minus(row["east_m"], row["east_sigma_m"])
            north = plus_minus(row["north_m"], row["north_sigma_m"])
            found.append(f"{row['emitter']} is at east {east} m, north {north} m.")
    return found


def _better(told: Analysis) -> list[str]:
    """Return what the noise that was found does for the tracks, where it does something."""
    stated, found = (told.judged[name].told for name in (TOGETHER, FOUND))
    if stated.false_tracks <= found.false_tracks and found.rmse > (1.0 - _OFF) * stated.rmse:
        return []
    return [
        f"With the noise that was found: RMSE {text(float(found.rmse))} m, {found.false_tracks} "
        f"false tracks instead of {stated.false_tracks}."
    ]


def _noise_findings(row: Row) -> list[str]:
    found = []
    for kind, unit, sign in (("range", "m", " m"), ("azimuth", "deg", "°")):
        sigma, error = row[f"{kind}_sigma_{unit}"], row[f"{kind}_sigma_error_{unit}"]
        stated = row[f"{kind}_sigma_stated_{unit}"]
        if sigma is None or error is None:
            continue
        if abs(sigma - stated) > max(_SURE * error, _OFF * stated):
            found.append(
                f"{row['radar']}: sigma of {kind} {plus_minus(sigma, error)}{sign}, "
                f"{sigma / stated:.2g} times what it states ({text(stated)}{sign})."
            )
    return found


def _bias_findings(row: Row) -> list[str]:
    found = []
    for kind, unit, sign in (("range", "m", " m"), ("azimuth", "deg", "°")):
        bias, error = row[f"{kind}_bias_{unit}"], row[f"{kind}_bias_error_{unit}"]
        stated = row[f"{kind}_sigma_stated_{unit}"]
        if bias is not None and abs(bias) > max(_SURE * error, _BIASED * stated):
            found.append(f"{row['radar']}: bias of {kind} {plus_minus(bias, error)}{sign}.")
    return found
