"""Control lines of a stream: commands of a controller to a running tracker."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from tertia.cli.files.text import json_of
from tertia.io._plans import plan_of
from tertia.tables._track import plan_names

if TYPE_CHECKING:
    from tertia.flightplan import FlightPlan
    from tertia.geo import LocalFrame, SystemPlane
    from tertia.tracker import Tracker

# beginning of control lines if the other lines are CSV
CSV_MARK = "#control "


def request_of(line: bytes) -> dict[str, Any] | None:
    """Return the request in a control line; None for any other line."""
    text = line.decode("utf-8", "replace").strip()
    if text.startswith(CSV_MARK):
        text = text.removeprefix(CSV_MARK)
    elif not text.startswith("{") or '"control"' not in text:
        return None
    request = json_of(text)
    if request is None:
        return {"control": None}
    return request if isinstance(request, dict) and "control" in request else None


class Control:
    """Execution of requests, which name plans as files do.

    `plans` contains the latest version of each plan by number, including removed plans.
    """

    def __init__(
        self,
        tracker: Tracker,
        plans: list[FlightPlan],
        frame: LocalFrame | SystemPlane | None,
    ) -> None:
        self._tracker, self._plans, self._frame = tracker, plans, frame
        self._commands: dict[str, Callable[[Mapping[str, Any]], None]] = {
            "add_plan": self._add,
            "replace_plan": self._replace,
            "remove_plan": lambda request: tracker.remove_plan(self._number(request)),
            "correlate": self._correlate,
            "decorrelate": lambda request: tracker.decorrelate(_track(request)),
            "suspend_plan": lambda request: tracker.suspend_plan(_track(request)),
            "resume_plan": lambda request: tracker.resume_plan(_track(request)),
        }

    def answer(self, request: Mapping[str, Any]) -> str:
        """Execute a request, and return the answer, a line of JSON."""
        name = request["control"]
        reason = None
        try:
            command = self._commands.get(name) if isinstance(name, str) else None
            if command is None:
                raise ValueError(f"control is {name!r}; it must be {' or '.join(self._commands)}")
            command(request)
        except (ValueError, TypeError, OverflowError) as error:
            reason = str(error)
        return json.dumps({"control": name, "ok": reason is None, "reason": reason})

    def _add(self, request: Mapping[str, Any]) -> None:
        plan = self._plan(request)
        if any(at is not None and at.name == plan.name for at in self._tracker.plans):
            raise ValueError(f"name is {plan.name!r}; a plan with this name already exists")
        self._tracker.add_plan(plan)
        self._plans.append(plan)

    def _replace(self, request: Mapping[str, Any]) -> None:
        number, plan = self._number(request), self._plan(request)
        self._tracker.replace_plan(number, plan)
        self._plans[number] = plan

    def _correlate(self, request: Mapping[str, Any]) -> None:
        number = self._number(request, "plan")
        self._tracker.correlate(_track(request), number, take=request.get("take", False))

    def _plan(self, request: Mapping[str, Any]) -> FlightPlan:
        fields = {name: value for name, value in request.items() if name != "control"}
        if not isinstance(fields.get("name"), str):
            raise ValueError(f"name is {fields.get('name')!r}; it must be the name of the plan")
        return plan_of(fields, self._frame)

    def _number(self, request: Mapping[str, Any], key: str = "name") -> int:
        """Return the number of the plan with a name."""
        name = request.get(key)
        names, plans = plan_names(self._plans), self._tracker.plans
        found = [at for at, plan in enumerate(plans) if plan is not None and names[at] == name]
        if not found:
            raise ValueError(f"{key} is {name!r}; it must be the name of a plan")
        return found[-1]


def _track(request: Mapping[str, Any]) -> int:
    if "track" not in request:
        raise ValueError("track is missing; it must be the number of a confirmed track")
    return request["track"]  # type: ignore[no-any-return]  # the tracker checks it
