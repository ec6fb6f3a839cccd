"""The page, which is made from a template with sections of figures and tables."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup
from plotly.offline import get_plotlyjs

import tertia
from tertia.report import _figures, _map
from tertia.report._analysis import Analysis
from tertia.report._bearings import Finders
from tertia.report._coverage import coverage_panels
from tertia.report._figures import Panel
from tertia.report._finders import finder_panels, finder_tables
from tertia.report._tables import Table, tables, text
from tertia.report._times import Times

_TEMPLATE = "page.html"


@dataclass(frozen=True, slots=True)
class Section:
    """A part of the page."""

    name: str
    title: str
    panels: list[Panel] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)


def page(
    analysis: Analysis | None,
    finders: Finders,
    numbers: dict[str, Any],
    title: str,
    times: Times,
) -> str:
    """Return the page as HTML."""
    sections = [] if analysis is None else _radar_sections(analysis, times)
    heard = Section(
        "finders", "Direction finders", finder_panels(finders, times.title), finder_tables(finders)
    )
    # inserted before the long table of tracks
    sections.insert(max(len(sections) - 1, 0), heard)
    shown = [section for section in sections if section.panels or section.tables]
    environment = Environment(
        loader=PackageLoader("tertia.report", "."),
        autoescape=select_autoescape(),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    charts = {panel.name: panel.figure for section in shown for panel in section.panels}
    return environment.get_template(_TEMPLATE).render(
        title=title,
        version=tertia.__version__,
        cards=_cards(numbers),
        findings=numbers["findings"],
        sections=shown,
        limits={"rows": _map.ROWS, "plots": _map.PLOTS, "truth": _map.TRUTH},
        # the whole library
        plotly=Markup(get_plotlyjs()),
        charts=_script(charts),
        time=_script({"title": times.title, "zero": times.zero}),
        corrected=analysis is not None and analysis.is_corrected,
        map=None if analysis is None else _script(_map.map_of(analysis)),
    )


def _radar_sections(analysis: Analysis, times: Times) -> list[Section]:
    rows, time = tables(analysis, times), times.title
    return [
        Section(
            "radars",
            "Radars",
            [*_figures.radar_panels(analysis, time), *coverage_panels(analysis)],
            rows["radars"],
        ),
        Section("fusion", "Fusion", _figures.fusion_panels(analysis, time), rows["fusion"]),
        Section("truth", "Versus truth", _figures.truth_panels(analysis, time), rows["truth"]),
        Section("audit", "Audit", [], rows["audit"]),
        Section("plans", "Flight plans", _figures.plan_panels(analysis, time), rows["plans"]),
        Section("tracks", "Tracks", [], rows["tracks"]),
    ]


def _cards(numbers: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the key figures that the page shows at its top, with their names."""
    cards = [(text(float(numbers["duration_s"])) + " s", "duration")]
    if numbers["radars"]:
        cards += [
            (f"{numbers['plots']:,}", "plots"),
            (str(len(numbers["radars"])), "radars"),
            (str(numbers["tracks"]), "tracks"),
        ]
    # quantities that the recording does not have are left out
    others = (numbers["plans"], "flight plans"), (len(numbers["emitters"]), "emitters")
    return [*cards, *((str(count), name) for count, name in others if count)]


def _script(value: Any) -> Markup:
    """Return JSON for a script element, escaped so that no text in it can close the element."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    return Markup(text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026"))
