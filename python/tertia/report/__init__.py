"""A recording of radars in one page: tracks, how good each radar is, fusion, plans, the truth.

`make` needs the extra `report` (Plotly, Jinja2); the page needs a browser and no network.
"""

from tertia.report._bearings import Emitter
from tertia.report._report import Report, make

__all__ = ["Emitter", "Report", "make"]
