//! Wind that carries the signals, known with a standard deviation.
//!
//! A signal from p reaches s after the path x (time multiplied by the speed), with `|s − p − β x| = x`.
//! β is the wind in units of the speed of the signals; it is horizontal, and common to all instants of
//! a batch. To first order, the wind lengthens the paths by −β·(s − p); the part of this that all
//! receivers share is absorbed by the emission. The posterior of β is computed by Gauss–Newton steps
//! with a normal prior, in which position and emission of each instant are eliminated.

use crate::base::small::{Factor, Matrix, Vector, dot, norm};
use crate::location::search::fix::{Fix, Instant, Output, Solution, Status};
use crate::location::solver::{Locator, Workspace};
use crate::sensors::{KINDS, Kind};

/// Largest number of instants of a batch, evenly spread, from which the wind is estimated.
const SAMPLE: usize = 256;
/// Number of first steps in which the sigmas of arrivals include the unknown wind, so that arrivals are
/// not taken for faults.
const LOOSE: usize = 2;
/// Largest number of steps.
const STEPS: usize = 8;
/// Length of a step, in standard deviations of the prior, below which it is the last one.
const STILL: f64 = 1e-4;
/// Largest wind component, in standard deviations of the prior.
const FARTHEST: f64 = 6.0;
/// Number of components of the wind.
const AXES: usize = 2;
/// Largest number of unknowns of an instant: a position and the emission.
const UNKNOWNS: usize = 4;

/// A horizontal wind in units of the speed of the signals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wind {
    /// Mean of the components, east and north.
    pub mean: Vector<AXES>,
    /// Covariance of the components.
    pub covariance: Matrix<AXES>,
}

/// What an instant says about the wind: information matrix, right side of the normal equations, and the
/// derivatives of position and emission with respect to the wind.
struct Told {
    information: Matrix<AXES>,
    pull: Vector<AXES>,
    follows: [Vector<AXES>; UNKNOWNS],
}

impl Wind {
    /// Returns the wind with the information from measurements divided by `growth`, because of lasting
    /// errors. The information of the prior, with this sigma of each component, remains.
    pub fn grown(&self, growth: f64, sigma: f64) -> Self {
        let prior = sigma.powi(-2);
        let Some(mut information) = Factor::try_new(&self.covariance, 0.0).map(|f| f.inverse())
        else {
            return *self;
        };
        for i in 0..AXES {
            for j in 0..AXES {
                let own = if i == j { prior } else { 0.0 };
                information[i][j] = (information[i][j] - own) / growth + own;
            }
        }
        let covariance = Factor::try_new(&information, 0.0).map(|f| f.inverse());
        Self { covariance: covariance.unwrap_or(self.covariance), ..*self }
    }

    /// Adds the error of the wind to the covariance of a position and to the variance of its emission.
    pub fn add_to<const D: usize>(
        &self,
        instant: &Instant<'_>,
        out: &mut Output<'_>,
        fix: &mut Fix,
    ) {
        if fix.status != Status::None {
            return;
        }
        let told = told::<D>(instant, self, out.position, out.residual, out.outlier);
        let Some(Told { follows, .. }) = told else { return };
        let spread = |a: &Vector<AXES>, b: &Vector<AXES>| -> f64 {
            let pairs = (0..AXES).flat_map(|i| (0..AXES).map(move |j| (i, j)));
            pairs.map(|(i, j)| a[i] * self.covariance[i][j] * b[j]).sum()
        };
        for i in 0..D {
            for j in i..D {
                out.covariance[i * D + j] += spread(&follows[i], &follows[j]);
                out.covariance[j * D + i] = out.covariance[i * D + j];
            }
        }
        let emission = spread(&follows[UNKNOWNS - 1], &follows[UNKNOWNS - 1]);
        fix.emission_sigma = fix.emission_sigma.hypot(emission.sqrt());
    }

    /// Returns the path of a signal from p to a station, and its derivatives with respect to the wind.
    fn way<const D: usize>(&self, p: &[f64], station: &[f64]) -> (f64, Vector<AXES>) {
        let d: Vector<D> = std::array::from_fn(|i| station[i] - p[i]);
        let beta: Vector<D> = std::array::from_fn(|i| if i < AXES { self.mean[i] } else { 0.0 });
        let along = dot(&d, &beta);
        let rest = 1.0 - dot(&beta, &beta);
        let x = ((along * along + rest * dot(&d, &d)).sqrt() - along) / rest;
        let still: Vector<D> = std::array::from_fn(|i| d[i] - beta[i] * x);
        let slope = -x / (x + dot(&still, &beta)).max(f64::MIN_POSITIVE);
        (x, std::array::from_fn(|i| slope * still[i]))
    }

    /// Converts times of arrival, in 5 K numbers in metres, into those in still air; `p` is the
    /// position of the target.
    fn still<const D: usize>(&self, values: &mut [f64], stations: &[f64], p: &[f64]) {
        let k = values.len() / KINDS;
        let arrivals = &mut values[Kind::Arrival as usize * k..];
        for (value, station) in arrivals.iter_mut().zip(stations.chunks_exact(D)) {
            let direct: Vector<D> = std::array::from_fn(|i| station[i] - p[i]);
            *value -= self.way::<D>(p, station).0 - norm(&direct);
        }
    }
}

impl Locator {
    /// Estimates the wind, each component of which has this standard deviation. O(N M), for at most 256
    /// instants.
    pub fn wind<const D: usize>(
        &self,
        instants: &[Instant<'_>],
        sigma: f64,
        workspace: &mut Workspace<D>,
    ) -> Wind {
        let prior = sigma.powi(-2);
        let none = [[sigma * sigma, 0.0], [0.0, sigma * sigma]];
        let mut wind = Wind { mean: [0.0; AXES], covariance: none };
        let count = instants.len().min(SAMPLE);
        let mut places = vec![None; count];
        for step in 0..STEPS {
            let allowed = if step < LOOSE { sigma } else { 0.0 };
            let mut information = [[prior, 0.0], [0.0, prior]];
            let mut pull = wind.mean.map(|own| -prior * own);
            for (i, place) in places.iter_mut().enumerate() {
                let instant = &instants[i * instants.len() / count];
                let Some(told) = self.told(instant, &wind, allowed, place, workspace) else {
                    continue;
                };
                for a in 0..AXES {
                    pull[a] += told.pull[a];
                    (0..AXES).for_each(|b| information[a][b] += told.information[a][b]);
                }
            }
            let Some(factor) = Factor::try_new(&information, 0.0) else { break };
            let change = factor.solve(&pull);
            wind.mean = std::array::from_fn(|a| {
                (wind.mean[a] + change[a]).clamp(-FARTHEST * sigma, FARTHEST * sigma)
            });
            wind.covariance = factor.inverse();
            if norm(&change) < STILL * sigma && allowed == 0.0 {
                break;
            }
        }
        wind
    }

    /// Locates an instant in this wind, starting from its previous position if there is one, and
    /// returns what it says about the wind. Sigmas allow for an additional wind with the standard
    /// deviation `allowed`, so that its effect is not taken for faults.
    fn told<const D: usize>(
        &self,
        instant: &Instant<'_>,
        wind: &Wind,
        allowed: f64,
        place: &mut Option<Vec<f64>>,
        workspace: &mut Workspace<D>,
    ) -> Option<Told> {
        let mut values = instant.values.to_vec();
        let start = place.clone().unwrap_or_else(|| middle::<D>(instant.stations));
        wind.still::<D>(&mut values, instant.stations, &start);
        let initial = place.as_deref().or(instant.initial);
        let loose = loosened::<D>(instant, allowed);
        let at = Instant { values: &values, sigmas: &loose, initial, ..*instant };
        let mut solution = Solution::<D>::of(instant);
        let fix = self.locate(&at, &mut solution.output(), workspace);
        if fix.status != Status::None {
            return None;
        }
        let Solution { position, mut residual, outlier, .. } = solution;
        let sigmas = loose.iter().zip(instant.sigmas);
        residual.iter_mut().zip(sigmas).for_each(|(off, (loose, own))| *off *= loose / own);
        let told = told::<D>(instant, wind, &position, &residual, &outlier);
        *place = Some(position.to_vec());
        told
    }

    /// Returns the times of arrival of all instants as they would be in still air. O(N M).
    pub fn in_still_air<const D: usize>(
        &self,
        instants: &[Instant<'_>],
        wind: &Wind,
        workspace: &mut Workspace<D>,
    ) -> Vec<f64> {
        let mut all = Vec::new();
        for instant in instants {
            let mut place = None;
            // the second-order terms of the paths depend on the position
            self.told(instant, wind, 0.0, &mut place, workspace);
            let mut values = instant.values.to_vec();
            let place = place.unwrap_or_else(|| middle::<D>(instant.stations));
            wind.still::<D>(&mut values, instant.stations, &place);
            all.extend(values);
        }
        all
    }
}

/// Returns the standard deviations; those of arrivals include the effect of an unknown wind, which
/// increases with the distance from the middle of the stations.
fn loosened<const D: usize>(instant: &Instant<'_>, allowed: f64) -> Vec<f64> {
    let (k, middle) = (instant.values.len() / KINDS, middle::<D>(instant.stations));
    let mut sigmas = instant.sigmas.to_vec();
    let arrivals = &mut sigmas[Kind::Arrival as usize * k..];
    for (sigma, station) in arrivals.iter_mut().zip(instant.stations.chunks_exact(D)) {
        let away: Vector<D> = std::array::from_fn(|i| station[i] - middle[i]);
        *sigma = sigma.hypot(allowed * norm(&away));
    }
    sigmas
}

/// Returns the middle of the stations, where a target is assumed to be before it is located.
fn middle<const D: usize>(stations: &[f64]) -> Vec<f64> {
    let k = stations.len() / D;
    (0..D).map(|i| stations.iter().skip(i).step_by(D).sum::<f64>() / k as f64).collect()
}

/// Returns what the arrivals of a located instant, without outliers, say about the wind; `None` if they
/// leave position or emission undetermined.
fn told<const D: usize>(
    instant: &Instant<'_>,
    wind: &Wind,
    p: &[f64],
    residual: &[f64],
    outlier: &[bool],
) -> Option<Told> {
    let k = instant.values.len() / KINDS;
    let first = Kind::Arrival as usize * k;
    let mut normal = [[0.0; UNKNOWNS]; UNKNOWNS];
    let mut mixed = [[0.0; AXES]; UNKNOWNS];
    let (mut right, mut pull) = ([0.0; UNKNOWNS], [0.0; AXES]);
    let mut information = [[0.0; AXES]; AXES];
    // in the plane there is no third coordinate
    if D < UNKNOWNS - 1 {
        normal[D][D] = 1.0;
    }
    if let Some((_, sigma)) = instant.height {
        normal[D - 1][D - 1] += sigma.powi(-2).min(f64::MAX.sqrt());
    }
    for station in (0..k).filter(|i| !residual[first + i].is_nan() && !outlier[first + i]) {
        let survey = instant.position_sigmas.map_or(0.0, |sigmas| sigmas[station]);
        let precision = instant.sigmas[first + station].hypot(survey).recip();
        let place = &instant.stations[station * D..][..D];
        let direct: Vector<D> = std::array::from_fn(|i| p[i] - place[i]);
        let length = norm(&direct).max(f64::MIN_POSITIVE);
        let row: Vector<UNKNOWNS> = std::array::from_fn(|i| match i {
            i if i < D => direct[i] / length * precision,
            i if i == UNKNOWNS - 1 => precision,
            _ => 0.0,
        });
        let own = wind.way::<D>(p, place).1.map(|slope| slope * precision);
        let off = residual[first + station];
        for i in 0..UNKNOWNS {
            right[i] += row[i] * off;
            (0..UNKNOWNS).for_each(|j| normal[i][j] += row[i] * row[j]);
            (0..AXES).for_each(|a| mixed[i][a] += row[i] * own[a]);
        }
        for a in 0..AXES {
            pull[a] += own[a] * off;
            (0..AXES).for_each(|b| information[a][b] += own[a] * own[b]);
        }
    }
    let factor = Factor::try_new(&normal, 0.0)?;
    let columns: [Vector<UNKNOWNS>; AXES] =
        std::array::from_fn(|a| factor.solve(&std::array::from_fn(|i| mixed[i][a])));
    for a in 0..AXES {
        pull[a] -= dot(&columns[a], &right);
        for b in 0..AXES {
            information[a][b] -= (0..UNKNOWNS).map(|i| mixed[i][a] * columns[b][i]).sum::<f64>();
        }
    }
    let follows = std::array::from_fn(|i| std::array::from_fn(|a| -columns[a][i]));
    Some(Told { information, pull, follows })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    const WIND: Wind = Wind { mean: [0.03, -0.02], covariance: [[1e-4, 0.0], [0.0, 1e-4]] };

    /// During the propagation the air has moved; the rest of the path is that through the air.
    #[test]
    fn the_way_in_a_wind() {
        let (p, station) = ([100.0, 200.0], [900.0, -300.0]);
        let (way, slope) = WIND.way::<2>(&p, &station);
        let through: Vector<2> = std::array::from_fn(|i| station[i] - p[i] - WIND.mean[i] * way);
        assert_within(1e-9, norm(&through), way);
        for axis in 0..2 {
            let mut other = WIND;
            other.mean[axis] += 1e-6;
            assert_within(1e-2, slope[axis], (other.way::<2>(&p, &station).0 - way) / 1e-6);
        }
    }

    #[test]
    fn a_prior_does_not_grow() {
        assert_within(1e-12, WIND.grown(100.0, 1e-2).covariance[0][0], 1e-4);
        let small = Wind { covariance: [[1e-6, 0.0], [0.0, 1e-6]], ..WIND };
        let grown = small.grown(4.0, 1e-2).covariance[0][0];
        assert_within(1e-9, grown, ((1e6 - 1e4) / 4.0 + 1e4_f64).recip());
    }
}
