"""Checks of the options of the tracker."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tertia import _core
from tertia._arrays import integer, listed, positive, real
from tertia.tracker._models import (
    Association,
    Motion,
    PlanModel,
    ProfileName,
    core_association,
    core_motion,
    profile_of,
)


def core_settings(
    *,
    motion: Motion,
    plan_model: PlanModel | None,
    association: Association,
    confirmation: tuple[int, int] | float,
    coasting: int,
    clutter_density: float | None,
    profile: ProfileName,
    max_speed: float | None,
    gate_probability: float,
    guard_acceleration: float | None,
    identity_error_probability: float,
    emergency_codes: Sequence[int],
    with_plans: bool,
) -> _core.TrackerSettings:
    """Check the options of `Tracker` that can be checked without sensors and plots."""
    model = PlanModel() if plan_model is None else plan_model
    if not isinstance(model, PlanModel):
        raise TypeError(f"plan_model is {plan_model!r}; it must be a PlanModel")
    if clutter_density is not None:
        clutter_density = float(
            positive(real(clutter_density, "clutter_density"), "clutter_density")
        )
    if guard_acceleration is not None:
        guard_acceleration = real(guard_acceleration, "guard_acceleration")
    codes = listed(emergency_codes, "emergency_codes")
    moves, kind = core_motion(motion, profile), profile_of(profile)
    if with_plans and not moves.takes_plans:
        raise ValueError(f"motion {motion!r} takes no plans; 'imm' and 'window' do")
    return _core.TrackerSettings(
        motion=moves,
        association=core_association(association),
        flown_probability=model.flown_probability,
        initiation=model.initiation,
        wind=list(model.wind),
        wind_sigma=model.wind_sigma,
        confirmation=_confirmation(confirmation),
        coasting=integer(coasting, "coasting", 1),
        clutter_density=clutter_density,
        max_speed=largest_speed(profile=profile, max_speed=max_speed),
        heights=kind.heights,
        gate_probability=real(gate_probability, "gate_probability"),
        guard_acceleration=guard_acceleration,
        identity_error_probability=real(identity_error_probability, "identity_error_probability"),
        emergency_codes=[integer(code, "emergency_codes", 0) for code in codes],
    )


def largest_speed(
    *, profile: ProfileName = "aircraft", max_speed: float | None = None, **_: Any
) -> float:
    """Return the largest speed of a target in m/s, from the options of `Tracker`."""
    return profile_of(profile).max_speed if max_speed is None else real(max_speed, "max_speed")


def _confirmation(rule: tuple[int, int] | float) -> tuple[int, int] | float:
    """Return the rule (M, N), or the probability of a target, by which a track is confirmed."""
    if isinstance(rule, float):
        return real(rule, "confirmation")
    if not isinstance(rule, Sequence) or len(rule) != 2:
        raise TypeError(
            f"confirmation is {rule!r}; it must be a pair: plots, scans; or a probability"
        )
    plots, scans = (integer(count, "confirmation", 2) for count in rule)
    return plots, scans
