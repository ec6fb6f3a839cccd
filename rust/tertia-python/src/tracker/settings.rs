//! Motions and settings, as typed objects.

use crate::arrays::value_error;
use crate::kalman;
use pyo3::prelude::*;
use tertia::association::gate;
use tertia::tracker::{self, ImmModel, Mht, WindowModel};

/// A motion model of targets; the constructors are named after the models.
#[pyclass(frozen, module = "tertia._core")]
pub struct Motion(tracker::Motion);

#[pymethods]
impl Motion {
    #[staticmethod]
    #[pyo3(signature = (*, straight_sigma))]
    fn cv(straight_sigma: f64) -> Self {
        Self(tracker::Motion::Cv(straight_sigma))
    }

    #[staticmethod]
    #[pyo3(signature = (*, straight_sigma, turn_sigma, turn_rate_walk, turn_rate_sigma, straight_time, turn_time, acceleration_sigma, steady_time, speed_change_time))]
    #[allow(clippy::too_many_arguments)] // the parameters of the model
    fn imm(
        straight_sigma: f64,
        turn_sigma: f64,
        turn_rate_walk: f64,
        turn_rate_sigma: f64,
        straight_time: f64,
        turn_time: f64,
        acceleration_sigma: f64,
        steady_time: f64,
        speed_change_time: f64,
    ) -> Self {
        Self(tracker::Motion::Imm(ImmModel {
            straight_sigma,
            turn_sigma,
            turn_rate_walk,
            turn_rate_sigma,
            straight_time,
            turn_time,
            acceleration_sigma,
            steady_time,
            speed_change_time,
        }))
    }

    #[staticmethod]
    fn singer(model: kalman::Model) -> PyResult<Self> {
        Ok(Self(tracker::Motion::Singer(kalman::singer(model)?)))
    }

    #[staticmethod]
    #[pyo3(signature = (*, straight, after_turn, planned_turn, is_curved))]
    fn window(
        straight: usize,
        after_turn: usize,
        planned_turn: usize,
        is_curved: bool,
    ) -> PyResult<Self> {
        let model = WindowModel::try_new(straight, after_turn, planned_turn, is_curved);
        Ok(Self(tracker::Motion::Window(model.map_err(value_error)?)))
    }

    /// Whether the model can follow flight plans.
    #[getter]
    fn takes_plans(&self) -> bool {
        self.0.takes_plans()
    }
}

/// Method of association of plots with tracks; the constructors are named after the methods.
#[pyclass(frozen, module = "tertia._core")]
pub struct TrackAssociation(tracker::Association);

#[pymethods]
impl TrackAssociation {
    #[staticmethod]
    fn gnn() -> Self {
        Self(tracker::Association::Gnn)
    }

    #[staticmethod]
    fn paper(q: f64) -> Self {
        Self(tracker::Association::Paper(q))
    }

    #[staticmethod]
    #[pyo3(signature = (*, max_hypotheses, scans, cut))]
    fn mht(max_hypotheses: usize, scans: usize, cut: f64) -> Self {
        Self(tracker::Association::Mht(Mht { max_hypotheses, scans, cut }))
    }
}

/// Confirmation rule: numbers of plots and scans, or a probability.
#[derive(FromPyObject)]
pub enum Confirmation {
    Plots((usize, usize)),
    Existence(f64),
}

impl From<Confirmation> for tracker::Confirmation {
    fn from(rule: Confirmation) -> Self {
        match rule {
            Confirmation::Plots((plots, scans)) => Self::Plots(plots, scans),
            Confirmation::Existence(probability) => Self::Existence(probability),
        }
    }
}

/// Settings of a tracker, validated; radars and flight plans are passed to the tracker itself.
#[pyclass(frozen, module = "tertia._core")]
pub struct TrackerSettings(tracker::Settings);

#[pymethods]
impl TrackerSettings {
    /// `None` means the guard acceleration of the motion model, and an estimated clutter density.
    #[new]
    #[pyo3(signature = (
        *, motion, association, flown_probability, initiation, wind, wind_sigma, confirmation, coasting, clutter_density,
        max_speed, heights, gate_probability, guard_acceleration, identity_error_probability,
        emergency_codes
    ))]
    #[allow(clippy::too_many_arguments)] // the settings, by name
    fn new(
        motion: &Motion,
        association: &TrackAssociation,
        flown_probability: f64,
        initiation: bool,
        wind: [f64; 2],
        wind_sigma: f64,
        confirmation: Confirmation,
        coasting: usize,
        clutter_density: Option<f64>,
        max_speed: f64,
        heights: Option<(f64, f64)>,
        gate_probability: f64,
        guard_acceleration: Option<f64>,
        identity_error_probability: f64,
        emergency_codes: Vec<i64>,
    ) -> PyResult<Self> {
        let usual = motion.0.guard_acceleration();
        let settings = tracker::Settings {
            association: association.0,
            flown_probability,
            initiation,
            wind,
            wind_sigma,
            confirmation: confirmation.into(),
            coasting,
            clutter_density: clutter_density.unwrap_or(f64::NAN),
            max_speed,
            heights: heights
                .map_or(tracker::Heights::Air, |(h, sigma)| tracker::Heights::Above(h, sigma)),
            guard: gate::threshold(gate_probability, 2).map_err(value_error)?,
            guard_acceleration: guard_acceleration.map_or(usual, |a| [a; 2]),
            identity_error_probability,
            emergency_codes,
            ..tracker::Settings::new(Vec::new(), motion.0)
        };
        settings.check_options().map_err(value_error)?;
        Ok(Self(settings))
    }
}

impl Motion {
    /// The motion as a core type.
    pub fn core(&self) -> &tracker::Motion {
        &self.0
    }
}

impl TrackerSettings {
    pub fn with(
        &self,
        radars: Vec<tracker::Radar>,
        geometry: Vec<tracker::Geometry>,
        plans: tracker::Plans,
    ) -> tracker::Settings {
        tracker::Settings { radars, geometry, plans, ..self.0.clone() }
    }
}
