//! Bindings of `tertia::trajectory::arrivals`.

use crate::arrays::{Array, Input, array, release, vector};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use tertia::trajectory::arrivals::{
    Heard, Scene, Solution, Undetermined, align, arrange, group, solve,
};

/// Known data of receivers, beacons and the medium, in metres and seconds.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Net<'py> {
    sites: Input<'py>,
    site_sigma: Input<'py>,
    sigma: Input<'py>,
    is_base: Vec<bool>,
    beacon: Vec<Option<usize>>,
    speed: f64,
    speed_sigma: f64,
    path_sigma: Option<f64>,
    clock_drift: Option<f64>,
    jerk: Option<f64>,
}

/// Recorded arrivals.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Recorded<'py> {
    time: Input<'py>,
    sensor: Vec<usize>,
    identity: Vec<usize>,
    emission: Option<Vec<Option<usize>>>,
}

/// Result, or the reason of the failure with the numbers of receivers or identities.
#[derive(Default, IntoPyObject)]
pub struct Solved<'py> {
    failure: Option<(&'static str, Vec<usize>)>,
    row: Vec<Option<usize>>,
    emission: Vec<usize>,
    identity: Vec<usize>,
    moving: Vec<usize>,
    time: Option<Array<'py>>,
    time_sigma: Option<Array<'py>>,
    mean: Option<Array<'py>>,
    covariance: Option<Array<'py>>,
    residual: Option<Array<'py>>,
    node: Option<Array<'py>>,
    clock: Option<[Array<'py>; 3]>,
    site: Option<[Array<'py>; 2]>,
    speed: (f64, f64),
    noise_factor: f64,
    path_sigma: f64,
    clock_drift: f64,
    jerk: Vec<f64>,
    acceleration_noise: Vec<f64>,
    degrees_of_freedom: f64,
    is_mirrored: bool,
    is_converged: bool,
    iterations: usize,
}

/// Index of the emission of each arrival; `None` if it belongs to none.
#[pyfunction]
pub fn group_arrivals(
    py: Python<'_>,
    time: Input<'_>,
    sensor: Vec<usize>,
    identity: Vec<usize>,
) -> PyResult<Vec<Option<usize>>> {
    let time = time.numbers("time")?;
    let k = sensor.iter().max().map_or(0, |last| last + 1);
    if time.len() != sensor.len() || time.len() != identity.len() {
        return Err(PyValueError::new_err("the shapes do not fit together"));
    }
    release(py, f64::INFINITY, || {
        let alignment = align(&time, &sensor, &identity, k);
        group(&alignment, &time, &sensor, &identity, 0.0)
    })
}

/// Estimates positions, clocks and other unknowns from arrivals.
#[pyfunction]
pub fn reconstruct_arrivals<'py>(
    py: Python<'py>,
    net: Net<'py>,
    recorded: Recorded<'py>,
) -> PyResult<Solved<'py>> {
    match net.sites.shape().last() {
        Some(2) => solved::<2>(py, &net, &recorded),
        _ => solved::<3>(py, &net, &recorded),
    }
}

fn solved<'py, const D: usize>(
    py: Python<'py>,
    net: &Net<'py>,
    recorded: &Recorded<'py>,
) -> PyResult<Solved<'py>> {
    let time = recorded.time.numbers("time")?;
    let mut scene = net.scene::<D>()?;
    let k = scene.is_base.len();
    let shapes = [recorded.sensor.len(), recorded.identity.len()].iter().all(|n| *n == time.len())
        && recorded.emission.as_ref().is_none_or(|emission| emission.len() == time.len())
        && recorded.sensor.iter().all(|sensor| *sensor < k)
        && recorded.identity.iter().all(|identity| *identity < scene.beacon.len());
    if !shapes {
        return Err(PyValueError::new_err("the shapes do not fit together"));
    }
    let heard = Heard {
        time: &time,
        sensor: &recorded.sensor,
        identity: &recorded.identity,
        emission: recorded.emission.as_deref(),
    };
    let found = release(py, f64::INFINITY, || {
        let row = arrange(&mut scene, &heard)?;
        Ok((row, solve(&scene)?))
    })?;
    match found {
        Ok((row, solution)) => Solved::new::<D>(py, &scene, row, solution),
        Err(why) => {
            let failure = match why {
                Undetermined::Apart(sensors) => ("apart", sensors),
                Undetermined::Nothing => ("nothing", Vec::new()),
                Undetermined::Clock(sensor) => ("clock", vec![sensor]),
                Undetermined::Motion(identity) => ("motion", vec![identity]),
                Undetermined::Other => ("other", Vec::new()),
            };
            Ok(Solved { failure: Some(failure), ..Solved::default() })
        }
    }
}

impl Net<'_> {
    fn scene<const D: usize>(&self) -> PyResult<Scene<D>> {
        let sites = self.sites.points::<D>("sites", 1)?;
        let site_sigma = self.site_sigma.numbers("site_sigma")?;
        let sigma = self.sigma.numbers("sigma")?;
        let fits = site_sigma.len() == sites.len()
            && sigma.len() == self.is_base.len()
            && sigma.len() <= sites.len()
            && !sigma.is_empty()
            && self.beacon.iter().flatten().all(|site| *site < sites.len());
        if !fits {
            return Err(PyValueError::new_err("the shapes do not fit together"));
        }
        Ok(Scene {
            sites,
            site_sigma,
            sigma,
            is_base: self.is_base.clone(),
            lines: Vec::new(),
            beacon: self.beacon.clone(),
            rows: Vec::new(),
            speed: self.speed,
            speed_sigma: self.speed_sigma,
            path_sigma: self.path_sigma,
            clock_drift: self.clock_drift,
            jerk: self.jerk,
        })
    }
}

impl<'py> Solved<'py> {
    fn new<const D: usize>(
        py: Python<'py>,
        scene: &Scene<D>,
        row: Vec<Option<usize>>,
        found: Solution,
    ) -> PyResult<Self> {
        let (n, states) = (found.moving.len(), 3 * D);
        let (m, k) = (found.node.len(), scene.is_base.len());
        let mut identity = vec![0; found.time.len()];
        for arrival in &scene.rows {
            identity[arrival.emission] = arrival.identity;
        }
        let table = |values| array(py, &[m, k], values);
        let sites = |values| array(py, &[scene.sites.len(), D], values);
        Ok(Self {
            failure: None,
            row,
            emission: scene.rows.iter().map(|arrival| arrival.emission).collect(),
            identity,
            moving: found.moving,
            time: Some(vector(py, found.time)?),
            time_sigma: Some(vector(py, found.time_sigma)?),
            mean: Some(array(py, &[n, states], found.mean)?),
            covariance: Some(array(py, &[n, states, states], found.covariance)?),
            residual: Some(vector(py, found.residual)?),
            node: Some(vector(py, found.node)?),
            clock: Some([
                table(found.clock)?,
                table(found.clock_variance)?,
                table(found.clock_covariance)?,
            ]),
            site: Some([sites(found.site)?, sites(found.site_sigma)?]),
            speed: found.speed,
            noise_factor: found.noise_factor,
            path_sigma: found.path_sigma,
            clock_drift: found.clock_drift,
            jerk: found.jerk,
            acceleration_noise: found.acceleration,
            degrees_of_freedom: found.degrees_of_freedom,
            is_mirrored: found.is_mirrored,
            is_converged: found.is_converged,
            iterations: found.iterations,
        })
    }
}
