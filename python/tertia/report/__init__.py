"""Reports: makes a page about a recording of radars, with tracks, noise, fusion and plans.

`make` needs the extra `report` (Plotly, Jinja2, Polars). The page can be opened in any browser and
does not need a network.
"""

from tertia.report._bearings import Emitter
from tertia.report._report import Report, make

__all__ = ["Emitter", "Report", "make"]
