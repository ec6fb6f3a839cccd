"""Records to try the estimators on, with the truth."""

from tertia.simulate._flights import flights
from tertia.simulate._radar_plots import RadarPlots, radar_plots
from tertia.simulate._records import (
    BearingRecord,
    PassiveLocation,
    RadarRecord,
    RadarScenario,
    ScenarioName,
    StationRecord,
    direction_finder,
    passive_location,
    radar_scenario,
    radars,
    stations,
    wishart,
)
from tertia.simulate._routes import FlightScenario
from tertia.simulate._set_ups import SetUp, SetUpName, routes, set_up
from tertia.simulate._traffic import EncounterName, Traffic, dense_traffic, encounter

__all__ = [
    "BearingRecord",
    "EncounterName",
    "FlightScenario",
    "PassiveLocation",
    "RadarPlots",
    "RadarRecord",
    "RadarScenario",
    "ScenarioName",
    "SetUp",
    "SetUpName",
    "StationRecord",
    "Traffic",
    "dense_traffic",
    "direction_finder",
    "encounter",
    "flights",
    "passive_location",
    "radar_plots",
    "radar_scenario",
    "radars",
    "routes",
    "set_up",
    "stations",
    "wishart",
]
