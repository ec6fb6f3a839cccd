"""Reports: one page about a recording of radars, with tracks, noise, fusion, plans and truth.

`make` needs the extra `report` (Plotly, Jinja2). The page opens in any browser, without a network.
"""

from tertia.report._bearings import Emitter
from tertia.report._report import Report, make

__all__ = ["Emitter", "Report", "make"]
