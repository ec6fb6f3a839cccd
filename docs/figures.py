"""Make every table and picture of the pages, from fixed seeds: `make figures`.

Tables are written between their marks in the pages, pictures to `docs/img`.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))

from studies import (
    association,
    bearing,
    flightplan,
    fusion,
    instant,
    location,
    paper,
    registration,
    screening,
    smoothing,
    tracker,
    trajectory,
    weights,
)
from studies.pages import save, write

TABLES: dict[str, dict[str, Callable[[], str]]] = {
    "screening.md": {
        "false alarms": screening.false_alarms,
        "detection": screening.detection,
        "clean bursts": screening.clean_bursts,
        "repeated passes": screening.repeated_passes,
    },
    "bearing.md": {
        "reproduction": bearing.reproduction,
        "coverage": bearing.coverage,
        "small coverage": bearing.small_coverage,
        "clean cost": bearing.clean_cost,
        "losses": bearing.losses,
        "variance tests": bearing.variance_tests,
        "north": bearing.north,
        "scenarios": bearing.scenarios,
        "claims": paper.claims,
    },
    "weights.md": {
        "readings": weights.readings,
        "expansion": weights.expansion,
        "symmetric pairs": weights.symmetric_pairs,
        "too few": weights.too_few,
        "symmetrised": weights.symmetrised,
        "rounding": weights.rounding,
        "elements": weights.elements,
        "loss": weights.loss,
        "first order": weights.first_order_error,
        "rule": weights.rule,
        "many sensors": weights.many_sensors,
        "few samples": weights.few_samples,
        "model errors": weights.model_errors,
        "conventions": weights.conventions,
        "consistency": weights.consistency,
        "shared azimuth": weights.shared_azimuth,
        "right treatment": weights.right_treatment,
        "area": weights.area,
    },
    "location.md": {
        "faults": location.faults,
        "poor geometry": location.poor_geometry,
        "lenth": location.lenth,
    },
    "association.md": {
        "gates": association.gates,
        "zeros": association.zeros,
        "ambiguity": association.ambiguity,
        "updates": association.updates,
    },
    "registration.md": {
        "coverage": registration.coverage,
    },
    "fusion.md": {
        "paper weights": fusion.paper_weights,
        "mean weights": fusion.mean_weights,
        "noise factors": fusion.noise_factors,
        "rmse": fusion.rmse,
        "fault windows": fusion.fault_windows,
        "consistency": fusion.consistency,
        "worst ratios": fusion.worst_ratios,
        "every ratio": fusion.every_ratio,
        "every consistency": fusion.every_consistency,
        "several faults": fusion.several_faults,
        "cost": fusion.cost,
        "instant": instant.methods,
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
    },
    "tracker.md": {
        "columns": tracker.columns,
        "conforming": tracker.conforming,
        "associations": tracker.associations,
        "plans": tracker.plans,
        "paper": tracker.paper,
        "guards": tracker.guards,
        "flags": tracker.flags,
        "priors": tracker.priors,
        "wind": tracker.wind,
        "extrapolation": tracker.extrapolation,
    },
    "trajectory.md": {
        "faults": trajectory.faults,
        "consistency": trajectory.consistency,
        "biases": trajectory.biases,
        "finders": trajectory.finders,
        "claims": trajectory.claims,
        "windows": trajectory.windows,
        "groups": trajectory.groups,
        "decoded": trajectory.decoded,
    },
    "smoothing.md": {
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
    "flightplan_turn.png": flightplan.turn_figure,
    "fusion_track.png": fusion.track_figure,
    "fusion_smoothing.png": fusion.smoothing_figure,
    "smoothing_track.png": smoothing.track_figure,
    "trajectory.png": trajectory.track_figure,
}


def main() -> None:
    """Run all studies, one after the other."""
    start = time.perf_counter()
    total = len(FIGURES) + sum(map(len, TABLES.values()))
    done = 0

    def report(name: str) -> None:
        nonlocal done
        done += 1
        print(f"[{done:2}/{total}] {time.perf_counter() - start:5.0f} s  {name}", flush=True)

    for page, tables in TABLES.items():
        for name, table in tables.items():
            write(page, name, table())
            report(f"{page}: {name}")
    for name, figure in FIGURES.items():
        save(figure(), name)
        report(name)


if __name__ == "__main__":
    main()
