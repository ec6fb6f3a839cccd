"""The radius that the error of a position exceeds with a stated risk, even if there are faults."""

from __future__ import annotations

from tertia import _core
from tertia._arrays import FloatArray, integer, probability, scalar_or_array
from tertia.location._scene import Scene


def protection_level_of(
    scene: Scene,
    position: FloatArray,
    *,
    risk: float,
    fault_probability: float,
    faults: int,
    false_alarm_probability: float,
) -> float | FloatArray:
    """Return the protection levels of positions; see `Location.protection_level`."""
    guarded = (
        probability(risk, "risk"),
        probability(fault_probability, "fault_probability"),
        integer(faults, "faults", 0),
        probability(false_alarm_probability, "false_alarm_probability"),
    )
    level: float | FloatArray = scalar_or_array(
        _core.protection_levels(scene.at(position), guarded, None)
    )
    return level
