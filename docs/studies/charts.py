"""Flow charts of the paper on flight plans in radar tracking."""

from typing import Any, NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies.pages import BLUE, GREY, ORANGE


class Box(NamedTuple):
    """A step, or a question."""

    column: int
    row: int
    text: str
    asks: bool = False


class Chart(NamedTuple):
    """Boxes, and arrows between them with their texts."""

    title: str
    boxes: dict[str, Box]
    arrows: list[tuple[str, str, str]]


ASSOCIATION = Chart(
    "Which plot belongs to which track",
    {
        "predict": Box(0, 0, "predict the track to the\ntime of the scan: x, Σ"),
        "gate": Box(0, 1, "a plot in the gate of .998,\nd² = ΔZᵀ Σ⁻¹ ΔZ < 12.4?", asks=True),
        "score": Box(0, 2, "score of each plot:\nS = ½ (1/Q − 1) d² + ln Q"),
        "assign": Box(0, 3, "one plot a track, one track\na plot: largest sum of S"),
        "update": Box(0, 4, "update the track"),
        "guard": Box(1, 1, "one in the gate widened\nby an acceleration?", asks=True),
        "missed": Box(1, 2, "missed: extrapolate"),
        "begin": Box(1, 4, "plots of no track begin\nnew ones"),
    },
    [
        ("predict", "gate", ""),
        ("gate", "score", "yes"),
        ("gate", "guard", "no"),
        ("guard", "score", "yes"),
        ("guard", "missed", "no"),
        ("score", "assign", ""),
        ("assign", "update", "taken"),
        ("assign", "begin", "left"),
    ],
)
MANOEUVRE = Chart(
    "Whether the target manoeuvres",
    {
        "plot": Box(0, 0, "the plot of the track"),
        "inner": Box(0, 1, "in the inner gate (.65)?", asks=True),
        "straight": Box(1, 1, "straight and uniform:\nup to 20 plots"),
        "rules": Box(
            0,
            2,
            "beyond .998, two of three beyond\n.95, three d² over 20.8,\nor four on one side?",
            asks=True,
        ),
        "turn": Box(1, 2, "manoeuvre: side and rate\nby the guard gate; 3 plots"),
        "place": Box(0, 3, "ahead or behind?", asks=True),
        "speed": Box(1, 3, "the speed may change"),
        "course": Box(0, 4, "the course may change:\nmore plots decide"),
    },
    [
        ("plot", "inner", ""),
        ("inner", "straight", "yes"),
        ("inner", "rules", "no"),
        ("rules", "turn", "yes"),
        ("rules", "place", "no"),
        ("place", "speed", "yes"),
        ("place", "course", "no"),
    ],
)
PLAN = Chart(
    "What the flight plan adds",
    {
        "track": Box(0, 0, "detect and track"),
        "correlate": Box(0, 1, "find the plan: by identity,\nor by route and time"),
        "follows": Box(0, 2, "does the track follow it?", asks=True),
        "block": Box(1, 2, "block the plan: as without\n(the paper leaves it open)"),
        "refine": Box(0, 3, "refine its speed and times\nby the track"),
        "near": Box(0, 4, "near a turn of the route?", asks=True),
        "arc": Box(1, 4, "short history, guard gate,\npredict along the arc"),
        "straight": Box(0, 5, "predict straight on"),
    },
    [
        ("track", "correlate", ""),
        ("correlate", "follows", ""),
        ("follows", "block", "no"),
        ("follows", "refine", "yes"),
        ("refine", "near", ""),
        ("near", "arc", "yes"),
        ("near", "straight", "no"),
    ],
)


def flow_charts() -> Figure:
    """Draw the three algorithms side by side."""
    figure = Figure(figsize=(16, 6), layout="constrained")
    for ax, chart in zip(figure.subplots(1, 3), (ASSOCIATION, MANOEUVRE, PLAN), strict=True):
        draw(ax, chart)
    return figure


def draw(ax: Axes, chart: Chart) -> None:
    """Draw boxes and arrows; a question has an orange frame."""
    drawn = {}
    for name, box in chart.boxes.items():
        frame = "round,pad=0.6" if box.asks else "square,pad=0.5"
        look = {"boxstyle": frame, "facecolor": "white", "edgecolor": ORANGE if box.asks else BLUE}
        middle: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 9, "zorder": 2}
        drawn[name] = ax.text(box.column, -box.row, box.text, bbox=look, **middle)
    for first, second, text in chart.arrows:
        one, two = chart.boxes[first], chart.boxes[second]
        sides = {"patchA": drawn[first].get_bbox_patch(), "patchB": drawn[second].get_bbox_patch()}
        arrow = {"arrowstyle": "-|>", "color": GREY, "shrinkA": 0, "shrinkB": 0, **sides}
        ax.annotate("", (two.column, -two.row), (one.column, -one.row), arrowprops=arrow)
        beside: dict[str, Any] = {"fontsize": 8, "color": GREY}
        if one.column == two.column:
            ax.text(one.column + 0.03, -(one.row + two.row) / 2, text, va="center", **beside)
        else:
            ax.text(0.5, -(one.row + two.row) / 2 + 0.05, text, ha="center", va="bottom", **beside)
    rows = max(box.row for box in chart.boxes.values())
    ax.set(xlim=(-0.5, 1.5), ylim=(-rows - 0.5, 0.5), title=chart.title)
    ax.set_axis_off()
