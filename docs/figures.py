"""Make the tables and pictures of the pages from fixed seeds: `figures.py [PAGE ...]`.

Tables are written between their marks in the pages, pictures to `docs/img`. `--small PAGE ...`
prints the tables of a hundredth of the repetitions. Those are kept in `tests/house/tables`, and a
test compares them with a fresh run: where they differ, the tables of the page are stale.
"""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path

os.environ["TERTIA_STUDY_SHARE"] = "0.01" if "--small" in sys.argv else "1"
sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))

from studies import (
    ambiguity,
    arrivals,
    association,
    audit,
    bearing,
    blind,
    boats,
    changed_station,
    channels,
    charts,
    constant_errors,
    contamination,
    contradictions,
    delays,
    deviations,
    existence,
    extents,
    fixed_echoes,
    flightplan,
    fused_tracks,
    fusion,
    geo,
    heights,
    honest_series,
    initiation,
    instant,
    invented,
    late_fixes,
    late_ranges,
    location,
    location_arrivals,
    manoeuvres,
    mirrored,
    misaligned,
    moving_finder,
    one_wrong,
    paper,
    positions,
    profiles,
    recordings,
    reflections,
    regions,
    registration,
    registration_bound,
    registration_demo,
    registration_history,
    registration_recordings,
    registration_start,
    reported_velocities,
    screening,
    sea_clutter,
    seams,
    series_errors,
    sides,
    signal_strengths,
    smooth_tracks,
    smoothing,
    speed_changes,
    stated_errors,
    station_clocks,
    tasks,
    tertiary,
    theodolites,
    timed_paths,
    tracker,
    trajectory,
    unhealthy,
    unstated,
    velocities,
    vertical,
    walkers,
    weights,
)
from studies.pages import save, write

TABLES: dict[str, dict[str, Callable[[], str]]] = {
    "screening.md": {
        "false alarms": screening.false_alarms,
        "detection": screening.detection,
        "clean bursts": screening.clean_bursts,
        "repeated passes": screening.repeated_passes,
        "moving": screening.moving,
    },
    "bearing-accuracy.md": {
        "reproduction": bearing.reproduction,
        "coverage": bearing.coverage,
        "small coverage": bearing.small_coverage,
        "stated sigma": bearing.stated_sigma,
        "differing sigmas": bearing.differing_sigmas,
        "north": bearing.north,
        "scenarios": bearing.scenarios,
        "contamination": contamination.contamination,
        "correlation": contamination.correlation,
        "repeated": contamination.repeated,
        "groups": contamination.groups,
    },
    "bearing-paper.md": {
        "clean cost": bearing.clean_cost,
        "losses": bearing.losses,
        "variance tests": bearing.variance_tests,
        "claims": paper.claims,
    },
    "geo.md": {
        "views": geo.views,
        "export": geo.export,
        "tracking": geo.tracking,
        "cruise": geo.cruise,
    },
    "weights.md": {
        "rule": weights.rule,
        "many sensors": weights.many_sensors,
        "consistency": weights.consistency,
        "shared azimuth": weights.shared_azimuth,
        "few": honest_series.few,
        "right treatment": weights.right_treatment,
    },
    "weights-accuracy.md": {
        "elements": weights.elements,
        "loss": weights.loss,
        "first order": weights.first_order_error,
        "few samples": weights.few_samples,
        "model errors": weights.model_errors,
        "conventions": weights.conventions,
        "area": weights.area,
    },
    "weights-paper.md": {
        "readings": weights.readings,
        "expansion": weights.expansion,
        "symmetric pairs": weights.symmetric_pairs,
        "too few": weights.too_few,
        "symmetrised": weights.symmetrised,
        "rounding": weights.rounding,
    },
    "honesty.md": {
        "bearings": contamination.grid,
        "slow changes": contamination.slow,
        "locate": location.coverage,
        "arrivals": location_arrivals.coverage,
        "arrivals without a position": location_arrivals.given_up,
        "regions": regions.coverage,
        "fused and smoothed": honest_series.coverage,
        "unsynchronised": arrivals.honesty,
        "reconstruct": trajectory.coverage,
        "recordings": recordings.table,
        "fireball": recordings.fireball,
        "invented": invented.table,
        "tasks": tasks.table,
    },
    "location.md": {"mirror images": sides.sides, "lenth": location.lenth},
    "location-errors.md": {
        "faults": location.faults,
        "late ranges": late_fixes.late,
        "biases": location.biases,
        "theodolites": theodolites.theodolites,
        "single instant": location.single_instant,
        "moving finder": moving_finder.moving_finder,
        "far too small": location.far_too_small,
    },
    "location-regions.md": {
        "regions": regions.curved,
        "poor geometry": location.poor_geometry,
        "few bearings": regions.few_bearings,
        "protection": regions.protection,
    },
    "location-arrivals.md": {
        "arrivals": location_arrivals.counts,
        "late arrivals": location_arrivals.late,
        "faulty receiver": location_arrivals.faulty,
    },
    "association.md": {
        "gates": association.gates,
        "zeros": association.zeros,
        "ambiguity": association.ambiguity,
        "hypotheses": ambiguity.hypotheses,
        "calibration": ambiguity.calibration,
        "resolution": ambiguity.resolution,
        "updates": association.updates,
    },
    "audit.md": {
        "intervals": audit.intervals,
        "groups": audit.groups,
        "other errors": audit.other_errors,
        "verdicts": audit.verdicts,
    },
    "tertiary.md": {
        "association": tertiary.association,
        "fusion": tertiary.fusion,
        "links": tertiary.links,
        "speed changes": tertiary.speed_changes,
        "expectations": tertiary.expectations,
        "sources": fused_tracks.sources,
        "contradictions": contradictions.contradictions,
        "few": fused_tracks.few,
    },
    "registration.md": {
        "coverage": registration.coverage,
        "aligned": registration.aligned,
        "deviations": deviations.deviations,
        "live": registration.live,
        "demo": registration_demo.table,
        "bound": registration_bound.table,
        "drift": registration_bound.drift,
        "grid": registration_start.grid,
        "changes": registration_start.changes,
        "history": registration_history.table,
        "recordings": registration_recordings.table,
    },
    "fusion.md": {
        "stuck": series_errors.stuck,
        "constant errors": honest_series.constant_errors,
        "slow errors": series_errors.slow,
    },
    "fusion-accuracy.md": {
        "rmse": fusion.rmse,
        "fault windows": fusion.fault_windows,
        "consistency": fusion.consistency,
        "worst ratios": fusion.worst_ratios,
        "every ratio": fusion.every_ratio,
        "every consistency": fusion.every_consistency,
        "several faults": fusion.several_faults,
        "cost": fusion.cost,
    },
    "fusion-estimates.md": {
        "instant": instant.methods,
        "effects": honest_series.effects,
    },
    "fusion-paper.md": {
        "paper weights": fusion.paper_weights,
        "mean weights": fusion.mean_weights,
        "noise factors": fusion.noise_factors,
    },
    "kalman.md": {
        "misprints": fusion.misprints,
        "wide priors": fusion.wide_priors,
        "smoothing": fusion.smoothing,
        "fit": fusion.fit_coverage,
        "metrics": fusion.filter_consistency,
        "accuracy": fusion.accuracy,
    },
    "flightplan.md": {
        "turns": flightplan.turns,
        "identification": flightplan.identification,
        "passing times": flightplan.passing,
        "blocking": flightplan.blocking,
        "initiation": initiation.initiation,
        "false tracks": initiation.false_tracks,
    },
    "smooth-tracks.md": {
        "accuracy": smooth_tracks.accuracy,
        "beside": smooth_tracks.beside,
        "between": smooth_tracks.between,
        "recording": smooth_tracks.recording,
    },
    "position-sensors.md": {
        "mixed": positions.mixed,
        "velocities": reported_velocities.reported_velocities,
        "unstated": unstated.unstated,
        "misaligned": misaligned.misaligned,
        "delays": delays.delays,
        "boats": boats.table,
    },
    "tracker.md": {
        "columns": tracker.columns,
        "late": unhealthy.late,
        "extents": extents.table,
    },
    "tracker-false-tracks.md": {
        "existence": existence.calibration,
        "life": existence.life,
        "unhealthy": unhealthy.unhealthy,
        "fixed echoes": fixed_echoes.table,
        "reflections": reflections.table,
        "sea clutter": sea_clutter.table,
        "channels": channels.channels,
    },
    "tracker-motion.md": {
        "conforming": tracker.conforming,
        "associations": tracker.associations,
        "speed changes": speed_changes.table,
        "manoeuvres": manoeuvres.table,
        "profiles": profiles.table,
        "heights": heights.table,
    },
    "tracker-plans.md": {
        "plans": tracker.plans,
        "extrapolation": tracker.extrapolation,
        "priors": tracker.priors,
        "wind": tracker.wind,
    },
    "tracker-paper.md": {
        "guards": tracker.guards,
        "flags": tracker.flags,
        "degrees": tracker.degrees,
        "paper": tracker.paper,
    },
    "report.md": {"blind": blind.blind},
    "embedding.md": {"seams": seams.seams},
    "arrivals.md": {
        "nets": arrivals.nets,
        "recording": arrivals.recording,
    },
    "trajectory.md": {
        "late arrivals": timed_paths.late,
        "faults": trajectory.faults,
        "late ranges": late_ranges.late,
        "mirrored": mirrored.mirrored,
        "consistency": trajectory.consistency,
        "motions": trajectory.motions,
        "vertical": vertical.vertical,
        "repeated": one_wrong.repeated,
        "signal strengths": signal_strengths.signal_strengths,
        "walkers": walkers.reconstructed,
    },
    "trajectory-systematic-errors.md": {
        "changed station": changed_station.changed_station,
        "lasting": trajectory.lasting,
        "finders": trajectory.finders,
        "biases": trajectory.biases,
        "one wrong": one_wrong.one_wrong,
        "changing errors": one_wrong.changing,
        "constant errors": constant_errors.table,
        "stated errors": stated_errors.stated_errors,
        "station clocks": station_clocks.station_clocks,
    },
    "trajectory-paper.md": {
        "claims": trajectory.claims,
        "windows": trajectory.windows,
        "groups": trajectory.groups,
        "decoded": trajectory.decoded,
    },
    "smoothing.md": {
        "noise": honest_series.noise,
        "motions": honest_series.motions,
        "walkers": walkers.smoothed,
        "velocities": velocities.velocities,
        "degree coverage": smoothing.degree_coverage,
        "degrees chosen": smoothing.degrees_chosen,
        "ends": smoothing.ends,
        "methods": smoothing.methods,
        "faults": smoothing.faults,
        "consistency": smoothing.consistency,
        "jerk fit": smoothing.jerk_fit,
    },
}
FIGURES = {
    "screening_record.png": screening.record_figure,
    "screening_masking.png": screening.masking_figure,
    "bearing_coverage.png": bearing.coverage_figure,
    "bearing_scenarios.png": bearing.scenarios_figure,
    "bearing_size.png": paper.size_figure,
    "bearing_threshold.png": paper.threshold_figure,
    "bearing_polarity.png": paper.polarity_figure,
    "bearing_ten_trials.png": paper.ten_trials_figure,
    "weights_loss.png": weights.loss_figure,
    "weights_passive_location.png": weights.passive_location_figure,
    "location_fix.png": location.fix_figure,
    "location_map.png": location.map_figure,
    "association_gates.png": association.gates_figure,
    "flightplan_turn.png": flightplan.turn_figure,
    "tracker_flow_charts.png": charts.flow_charts,
    "fusion_track.png": fusion.track_figure,
    "fusion_smoothing.png": fusion.smoothing_figure,
    "smoothing_track.png": smoothing.track_figure,
    "trajectory.png": trajectory.track_figure,
    "audit.png": audit.audit_figure,
}


def main(pages: Iterable[str]) -> None:
    """Run the studies of the pages, one after the other; by default all, and make the pictures."""
    chosen = {page: TABLES[page] for page in pages} or TABLES
    pictures = FIGURES if chosen is TABLES else {}
    start = time.perf_counter()
    total = len(pictures) + sum(map(len, chosen.values()))
    done = 0

    def report(name: str) -> None:
        nonlocal done
        done += 1
        print(f"[{done:2}/{total}] {time.perf_counter() - start:5.0f} s  {name}", flush=True)

    for page, tables in chosen.items():
        for name, table in tables.items():
            write(page, name, table())
            report(f"{page}: {name}")
        keep(page)
    for name, figure in pictures.items():
        save(figure(), name)
        report(name)


def keep(page: str) -> None:
    """Keep the small tables of a page beside its full ones."""
    command = [sys.executable, __file__, "--small", page]
    printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    _, tables = printed.split("\n", 1)
    (Path(__file__).parents[1] / "tests" / "house" / "tables" / page).write_text(tables, "utf-8")


def small(pages: Iterable[str]) -> None:
    """Print the tables of few repetitions, page by page."""
    for page in pages:
        print(f"page: {page}")
        for name, table in TABLES[page].items():
            print(f"table: {name}\n{table()}")


if __name__ == "__main__":
    named = [word for word in sys.argv[1:] if word != "--small"]
    (small if "--small" in sys.argv else main)(named)
