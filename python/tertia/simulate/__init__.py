"""Simulation: measurements for tests of estimators, together with the true values."""

from tertia.simulate._bearings import BearingRecord, direction_finder
from tertia.simulate._covariances import wishart
from tertia.simulate._flights import flights
from tertia.simulate._radar_plots import RadarPlots, radar_plots
from tertia.simulate._radars import (
    RadarRecord,
    RadarScenario,
    ScenarioName,
    radar_scenario,
    radars,
)
from tertia.simulate._routes import FlightScenario
from tertia.simulate._scene import Scene, scene
from tertia.simulate._set_ups import SetUp, SetUpName, routes, set_up
from tertia.simulate._stations import PassiveLocation, StationRecord, passive_location, stations
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
    "Scene",
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
    "scene",
    "set_up",
    "stations",
    "wishart",
]
