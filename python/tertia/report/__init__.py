"""Reports: a recording of radars on one page, with tracks, noise, fusion, plans and truth.

`make` needs the extra `report` (Plotly, Jinja2); the page opens in any browser, without a network.
"""

from tertia.report._bearings import Emitter
from tertia.report._report import Report, make

__all__ = ["Emitter", "Report", "make"]
