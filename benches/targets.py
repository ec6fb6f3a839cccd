"""The targets of the project, compared with version 0.1 and what a run of the benches measured.

Version 0.1 was measured on the same kind of machine: two cores of an EPYC with AVX-512, one thread.
Where a target is missed, the table names the limiting factor.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Target:
    """One row: `title` and `size` say where the benches keep its measurement."""

    work: str
    # range of what version 0.1 took
    before: str
    # with AVX2 and with AVX-512 where they differ
    wanted: tuple[float, ...]
    title: str
    why: str
    size: int | None = None


DIVISIONS = "each step waits for the division of the step before"
WRITING = "each step writes eleven numbers, and the results do not fit into the caches"
TRACKER = (
    "the prototype had no registration, existence probabilities, outliers, noise estimates or "
    "resumed tracks"
)
CALL = "checks and results in Python take more time than the kernel"
HYPOTHESES = (
    "about forty hypotheses are weighted and merged for each plot, with vectorised exponentials"
)
BACK = "the backward pass waits for the state of each step"

TARGETS = (
    Target(
        "filter, 1,000 × 200, R of each plot and gaps, final state, a step",
        "5.3 ns",
        (3.5, 2.5),
        "filter, 1,000 × 200, R of each plot and gaps, final state, a step",
        "plots and variances do not fit into the inner caches",
    ),
    Target(
        "the same, all states",
        "14.6 ns",
        (8.5,),
        "filter, 1,000 × 200, R of each plot and gaps, all states, a step",
        WRITING,
    ),
    Target(
        "filter, 1,000 × 200, gain in common, final state, a step",
        "2.1 to 2.6 ns",
        (0.8, 0.6),
        "filter, 1,000 × 200, equal noise, final state, a step",
        "checking, reading and transposing of the plots; the likelihood of each series",
    ),
    Target(
        "filter, 20,000 × 50, R of each plot and gaps, final state, a step",
        "7.6 ns",
        (4.2,),
        "filter, 20,000 × 50, R of each plot and gaps, final state, a step",
        "plots and variances come from memory, not from the cache",
    ),
    Target(
        "the same, all states",
        "16.8 ns",
        (10.5,),
        "filter, 20,000 × 50, R of each plot and gaps, all states, a step",
        WRITING,
    ),
    Target(
        "filter, 20,000 × 50, gain in common, all states, a step",
        "13.5 ns",
        (10.0,),
        "filter, 20,000 × 50, equal noise, all states, a step",
        WRITING,
    ),
    Target(
        "filter, 1 × 10,000, R of each plot and gaps, all states, a step",
        "16 to 20 ns",
        (10.5,),
        "filter, 1 × 10,000, R of each plot and gaps, all states, a step",
        DIVISIONS,
    ),
    Target(
        "smooth_series, 10,000 plots, a step",
        "208 ns",
        (60.0,),
        "smooth_series, 10,000 plots, a step",
        BACK,
    ),
    Target(
        "smooth, one axis, jerk given, an instant",
        "930 ns",
        (150.0,),
        "smooth, one axis, 10,000 instants, an instant",
        BACK,
    ),
    Target(
        "fuse_series, robust, 2 radars, a plot",
        "570 ns",
        (400.0,),
        "fuse_series, robust, 2 radars, a plot",
        HYPOTHESES,
    ),
    Target(
        "fuse_series, robust, 10 radars, a plot",
        "1,070 ns",
        (700.0,),
        "fuse_series, robust, 10 radars, a plot",
        HYPOTHESES,
    ),
    Target(
        "track, 20,000 aircraft, 4 radars, one thread, a plot",
        "1.9 to 2.6 µs",
        (0.9,),
        "track, recording, 1 thread, a plot",
        TRACKER,
        20_000,
    ),
    Target(
        "the same, two threads",
        "–",
        (0.59,),
        "track, recording, 2 threads, a plot",
        TRACKER,
        20_000,
    ),
    *(
        Target(
            f"locate, {stations} stations, 5% faults, an instant",
            before,
            (wanted,),
            "locate, 5% faults, an instant",
            "systematic errors are estimated from the whole batch first; with sigmas as stated, "
            "`locate` takes about a quarter of this time",
            stations,
        )
        for stations, before, wanted in (
            (8, "7 µs", 4.0),
            (20, "28 µs", 10.0),
            (50, "162 µs", 25.0),
        )
    ),
    Target(
        "associate, 1,000 tracks and plots, all within the gates of all",
        "120,000 µs",
        (40_000.0,),
        "associate, 1,000 tracks and plots, all within the gates of all",
        "shortest augmenting paths over the whole matrix; SciPy and lap take longer",
    ),
    Target(
        "tables, fusion of 1,000,000 rows",
        "1.7 s",
        (0.7,),
        "tables, parquet, fuse, all rows",
        "reading and writing take a third of the time",
        1_000_000,
    ),
    *(
        Target(f"one call: {name}", before, (10.0,), f"one call: {name}", why)
        for name, before, why in (
            (
                "estimate_bearing, 100 values",
                "14 µs",
                "up to six mixtures are fitted by EM and averaged",
            ),
            (
                "fuse_series, 2 × 10 plots",
                "23 µs",
                "the kernel and Python take half of the time each",
            ),
            ("associate, 4 × 4", "37 µs", CALL),
            (
                "smooth, 10 × 2",
                "51 µs",
                "the jerk is fitted, which takes several tens of runs of the filter",
            ),
            ("locate, 4 stations", "81 µs", CALL),
        )
    ),
)


def measured(target, found):
    """Return what was measured and its unit; None where that part was not run."""
    for one in found:
        if one.get("work") != target.title:
            continue
        if target.size is None and "exponent" not in one:
            return one["costs"]["Tertia"], one["unit"]
        if target.size in one.get("sizes", ()):
            return one["costs"][one["sizes"].index(target.size)], one["unit"]
    return None


def rows(found, level, number):
    """Yield work, version 0.1, target, now, and the limiting factor where it is missed."""
    for target in TARGETS:
        if (now := measured(target, found)) is None:
            continue
        cost, unit = now
        wanted = target.wanted[-1] if level == "AVX-512" else target.wanted[0]
        missed = cost > wanted
        shown = f"{number(cost)} {unit}"
        yield (
            target.work,
            target.before,
            f"{wanted:,g} {unit}",
            shown if missed else f"**{shown}**",
            target.why if missed else "",
        )
