//! Solution by scoring steps for the unknowns and fixed-point steps for the intensities.

use super::super::mirror::Mirror;
use super::layout::Unknown;
use super::linear::{Group, Row};
use super::normal::{Normal, Weights};
use super::problem::{Model, Problem, State};
use super::scene::{Scene, Solution, Undetermined};
use super::start::median;
use super::starts::Start;
use crate::base::skyline::Skyline;
use crate::base::small::{Factor, dot};

/// Largest number of steps; number of steps before the intensities are estimated; least number of steps.
const ITERATIONS: usize = 100;
const FIRST: usize = 2;
const FEWEST: usize = 10;
/// Steps before which positions are searched anew: a wrong position with few arrivals may be a local minimum.
const RELOCATED: [usize; 2] = [4, 8];
/// Largest number of times that emissions that tear a motion apart are moved.
const MENDED: usize = 3;
/// Largest number of halvings of a step that does not lower the cost.
const HALVINGS: usize = 8;
/// Share of a step that is taken: with Student's distribution, small residuals pull up to twice as strongly
/// as the mean information suggests, and whole steps would oscillate about the solution.
const SHARE: f64 = 0.75;
/// Longest step of a position, relative to the extent of the net.
const LONGEST: f64 = 0.3;
/// The search ends if the sum of the squares of a step, in standard deviations, is less than `DECREMENT`, and
/// the intensities have changed by less than the share `CHANGE`.
const DECREMENT: f64 = 1e-3;
const CHANGE: f64 = 2e-2;
/// Largest change of the logarithm of an intensity in a step; largest factor by which a step is lengthened if
/// the changes form a geometric series; least intensity relative to the first one.
const JUMP: f64 = 2.3;
const AHEAD: f64 = 5.0;
const LOWEST: f64 = 1e-4;
/// Least degrees of freedom, as a share of the measurements.
const FREE: f64 = 0.05;
/// First jerk over the median squared step, in units of the usual interval; first white acceleration over the
/// first jerk, with which both add as much to a position.
const JERK: f64 = 20.0;
const ACCELERATION: f64 = 0.15;
/// Share of the variance of motion below which an intensity need not converge.
const NEGLIGIBLE: f64 = 1e-3;

/// Rows of the measurements and of the priors.
type Linear = (Vec<Row>, Vec<(Row, Group)>);

/// A row of a prior: its squared residual, the variance that its estimate leaves, and its prior variance.
struct Term {
    square: f64,
    spread: f64,
    variance: f64,
}

/// Sums over the rows whose variances depend on an intensity: derivatives of the evidence.
#[derive(Clone, Copy, Default)]
struct Tally {
    squares: f64,
    spread: f64,
    total: f64,
    rows: f64,
}

impl Tally {
    /// Adds a row whose variance has this derivative with respect to the intensity.
    fn add(&mut self, term: &Term, share: f64) {
        let unit = share / (term.variance * term.variance);
        self.squares += unit * term.square;
        self.spread += unit * term.spread;
        self.total += unit * term.variance;
        self.rows += 1.0;
    }

    /// Returns the factor by which the intensity changes.
    fn growth(&self) -> f64 {
        let known = self.total - self.spread;
        // if measurements determine nothing: the expectation-maximisation step
        if known < 1e-3 * self.total {
            (self.squares + self.spread) / self.total
        } else {
            self.squares / known
        }
    }
}

/// Tallies of all intensities, and the effective number of unknowns that priors determine.
#[derive(Default)]
struct Tallies {
    bound: f64,
    path: Tally,
    drift: Tally,
    jerk: Vec<Tally>,
    acceleration: Vec<Tally>,
}

/// State of the search.
struct Search<'a, 'b, const D: usize> {
    problem: &'a Problem<'b, D>,
    state: State<D>,
    model: Model,
    /// The first model, from which the least intensities follow.
    lowest: Model,
    /// Share of the measurements that is redundant.
    free: f64,
    /// Last change of the logarithm of each intensity.
    last: Vec<f64>,
    /// Whether positions are searched anew.
    relocates: bool,
}

/// A solution, minus the logarithm of the joint density of the measurements and the unknowns, and minus that of
/// the evidence (Laplace's approximation), up to constants.
struct Found {
    solution: Solution,
    cost: f64,
    evidence: f64,
}

/// Solves the scene; with a mirror, emissions are searched on the side of its normal. Also returns minus the
/// logarithm of the joint density of the measurements and the unknowns, up to a constant.
///
/// # Errors
/// The measurements do not determine an unknown.
pub(super) fn solve_beside<const D: usize>(
    scene: &Scene<D>,
    mirror: Option<Mirror<D>>,
) -> Result<(Solution, f64), Undetermined> {
    let problem = Problem { mirror, ..Problem::new(scene, None) };
    let mut best: Option<Found> = None;
    for start in problem.starts() {
        match problem.search(start, best.as_ref()) {
            // found twice
            Ok(None) => break,
            Ok(Some(found)) if best.as_ref().is_none_or(|best| found.evidence < best.evidence) => {
                best = Some(found);
            }
            Err(why) if best.is_none() => return Err(why),
            _ => {}
        }
    }
    best.map(|best| (best.solution, best.cost)).ok_or(Undetermined::Other)
}

impl<const D: usize> Problem<'_, D> {
    /// Searches from a start; none if the path of `best` is found again.
    fn search(&self, start: Start<D>, best: Option<&Found>) -> Result<Option<Found>, Undetermined> {
        let (state, scale) = self.start(start).map_err(|_| Undetermined::Other)?;
        let model = self.first_model(&state, scale);
        let mut search = Search {
            problem: self,
            state,
            lowest: model.clone(),
            model,
            free: 1.0,
            last: Vec::new(),
            relocates: matches!(start, Start::Apart),
        };
        search.run(best.map(|best| &best.solution)).map_err(|column| self.undetermined(column))
    }

    fn undetermined(&self, column: usize) -> Undetermined {
        match self.layout.unknown::<D>(column, self.scene.is_base.len()) {
            Unknown::Motion(emission) => Undetermined::Motion(self.identity[emission]),
            Unknown::Clock(sensor) => Undetermined::Clock(sensor),
            Unknown::Shared => Undetermined::Other,
        }
    }

    /// Returns the given intensities, or intensities with which priors are loose.
    fn first_model(&self, state: &State<D>, scale: f64) -> Model {
        let scene = self.scene;
        let sigma = scene.sigma.iter().sum::<f64>() / scene.sigma.len() as f64;
        let span = self.nodes[self.nodes.len() - 1] - self.nodes[0];
        let step = (span / self.nodes.len() as f64).max(f64::MIN_POSITIVE);
        let mut squares = vec![Vec::new(); self.unit.len()];
        for (emission, before) in self.previous.iter().enumerate() {
            let Some(before) = *before else { continue };
            let (a, b) = (&state.motion[before][0], &state.motion[emission][0]);
            let square = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>() / D as f64;
            squares[self.identity[emission]].push(square);
        }
        let jerk = squares.iter_mut().zip(&self.unit).map(|(squares, unit)| match scene.jerk {
            Some(jerk) => jerk * unit.powi(5),
            None => {
                squares.sort_by(f64::total_cmp);
                let median = squares.get(squares.len() / 2).copied().unwrap_or(0.0);
                JERK * median.max((sigma * scale).powi(2))
            }
        });
        let jerk: Vec<f64> = jerk.collect();
        let acceleration = match scene.jerk {
            Some(_) => vec![0.0; jerk.len()],
            None => jerk.iter().map(|jerk| ACCELERATION * jerk).collect(),
        };
        Model {
            scale,
            path: scene.path_sigma.unwrap_or(sigma * scale),
            drift: match scene.clock_drift {
                Some(drift) => drift * scene.speed,
                None => sigma * scale / step.powf(1.5),
            },
            jerk,
            acceleration,
        }
    }
}

impl<const D: usize> Search<'_, '_, D> {
    /// Returns none as soon as the path agrees with another one.
    fn run(&mut self, other: Option<&Solution>) -> Result<Option<Found>, usize> {
        let problem = self.problem;
        let (mut rows, mut priors) = (problem.rows(&self.state), problem.priors(&self.state));
        let mut envelope = problem.envelope(&rows, &priors);
        let mut iterations = 0;
        let (mut is_converged, mut change) = (false, f64::INFINITY);
        let mut mended = 0;
        while iterations < ITERATIONS && !is_converged {
            if self.relocates && RELOCATED.contains(&iterations) {
                self.relocate();
                (rows, priors) = (problem.rows(&self.state), problem.priors(&self.state));
            }
            let weights = Weights::new(problem, &rows, self.model.scale, self.free);
            let mut normal = problem.normal(envelope, &rows, &weights, &priors, &self.model);
            let (step, emission, decrement) = normal.step()?;
            (rows, priors) = self.move_along(&step, &emission, &rows, &priors);
            if iterations < ITERATIONS / 2 && problem.turn_back(&mut self.state) {
                (rows, priors) = (problem.rows(&self.state), problem.priors(&self.state));
            }
            // the inverse is the most expensive part of a step, and is computed only for the intensities
            if iterations >= FIRST && (change >= CHANGE || iterations < FEWEST) {
                let inverse = normal.matrix.inverse();
                change = self.adapt(&inverse, &rows, &priors);
            }
            envelope = normal.matrix;
            iterations += 1;
            if iterations >= FEWEST && other.is_some_and(|other| self.agrees(other)) {
                return Ok(None);
            }
            is_converged = iterations >= FEWEST && decrement < DECREMENT && change < CHANGE;
            let may_be_torn = (is_converged || iterations == ITERATIONS / 2) && mended < MENDED;
            if may_be_torn && problem.mend(&mut self.state, &mut self.model, &priors) {
                (rows, priors) = (problem.rows(&self.state), problem.priors(&self.state));
                (is_converged, change, mended) = (false, f64::INFINITY, mended + 1);
                self.last.clear();
            }
        }
        let mut weights = Weights::new(problem, &rows, self.model.scale, self.free);
        weights.thin(problem, &rows);
        let mut normal = problem.normal(envelope, &rows, &weights, &priors, &self.model);
        normal.step()?;
        let cost = self.cost();
        let evidence = cost + normal.half_ln_determinant();
        let inverse = normal.matrix.inverse();
        let ended = (is_converged, iterations);
        let solution = self.solution(&normal, &inverse, &rows, &weights, ended);
        Ok(Some(Found { solution, cost, evidence }))
    }

    /// Whether most positions are within a standard deviation, as a rule, of those of another solution.
    fn agrees(&self, other: &Solution) -> bool {
        let n = 3 * D;
        let own = other.mean.chunks_exact(n).zip(other.covariance.chunks_exact(n * n));
        let square = |(emission, (mean, covariance)): (&usize, (&[f64], &[f64]))| {
            let place = &self.state.motion[*emission][0];
            let offset: [f64; D] = std::array::from_fn(|i| place[i] - mean[i]);
            let spread = std::array::from_fn(|i| std::array::from_fn(|j| covariance[i * n + j]));
            Factor::try_new(&spread, 0.0).map_or(f64::INFINITY, |f| dot(&offset, &f.solve(&offset)))
        };
        median(&mut other.moving.iter().zip(own).map(square).collect::<Vec<f64>>()) < 1.0
    }

    /// Minus the logarithm of the joint density, up to a constant that does not depend on the intensities.
    fn cost(&self) -> f64 {
        let (problem, model) = (self.problem, &self.model);
        let (rows, priors) = (problem.rows(&self.state), problem.priors(&self.state));
        let scales = priors.iter().map(|(_, group)| 0.5 * model.variance(*group).ln());
        let scale = rows.len() as f64 * model.scale.ln();
        problem.cost(&rows, &priors, model) + scale + scales.sum::<f64>()
    }

    fn relocate(&mut self) {
        let sigmas = &self.problem.scene.sigma;
        let finest = self.model.scale * sigmas.iter().sum::<f64>() / sigmas.len() as f64;
        self.problem.relocate(&mut self.state, &vec![true; sigmas.len()], finest);
    }

    /// Takes the step, shortened if it is long or does not lower the cost, and returns the new rows.
    fn move_along(
        &mut self,
        step: &[f64],
        emission: &[f64],
        rows: &[Row],
        priors: &[(Row, Group)],
    ) -> Linear {
        let problem = self.problem;
        let positions = problem.layout.motion.iter().flatten().flat_map(|&c| &step[c..c + D]);
        let sites = problem.layout.site.iter().flatten().flat_map(|&c| &step[c..c + D]);
        let longest = positions.chain(sites).fold(0.0_f64, |longest, x| longest.max(x.abs()));
        let mut length = (LONGEST * problem.extent / longest.max(f64::MIN_POSITIVE)).min(SHARE);
        let before = problem.cost(rows, priors, &self.model);
        let mut halving = 0;
        loop {
            let moved = problem.moved(&self.state, step, emission, length);
            let (rows, priors) = (problem.rows(&moved), problem.priors(&moved));
            let cost = problem.cost(&rows, &priors, &self.model);
            if cost <= before + 1e-9 * before.abs() || halving == HALVINGS {
                self.state = moved;
                return (rows, priors);
            }
            length *= 0.5;
            halving += 1;
        }
    }

    /// Updates the intensities from the residuals (MacKay, Neural Computation 4, 1992): the sum of squares
    /// over the number of values that the measurements determine. Returns the largest relative change.
    fn adapt(&mut self, inverse: &Skyline, rows: &[Row], priors: &[(Row, Group)]) -> f64 {
        let tallies = self.tallies(inverse, priors);
        let n = rows.len() as f64;
        let unknowns = self.problem.layout.order as f64 - tallies.bound;
        let free = (n - self.problem.identity.len() as f64 - unknowns).max(FREE * n);
        self.free = free / n;
        let scene = self.problem.scene;
        let mut change = 0.0_f64;
        let mut steps = Vec::with_capacity(2 * tallies.jerk.len() + 3);
        let last = std::mem::take(&mut self.last);
        let mut update = |value: &mut f64, found: f64, lowest: f64, counts: bool| {
            let step = (found.max(lowest) / *value).ln().clamp(-JUMP, JUMP);
            if counts {
                change = change.max(step.abs());
            }
            // Aitken: extrapolates a geometric series
            let ratio = last.get(steps.len()).map_or(0.0, |last| step / last);
            let ahead = if (0.0..1.0).contains(&ratio) { 1.0 / (1.0 - ratio) } else { 1.0 };
            *value = (*value * (step * ahead.min(AHEAD)).exp()).max(lowest);
            // a series is not extrapolated twice
            steps.push(if ahead > 1.5 { f64::INFINITY } else { step });
        };
        let before = self.model.clone();
        if scene.path_sigma.is_none() && tallies.path.total > 0.0 {
            let found = before.path * tallies.path.growth().sqrt();
            update(&mut self.model.path, found, LOWEST * self.lowest.path, true);
        }
        if scene.clock_drift.is_none() && tallies.drift.total > 0.0 {
            let found = before.drift * tallies.drift.growth().sqrt();
            update(&mut self.model.drift, found, LOWEST * self.lowest.drift, true);
        }
        if scene.jerk.is_none() {
            let motions = [
                (&mut self.model.jerk, &tallies.jerk, &self.lowest.jerk),
                (&mut self.model.acceleration, &tallies.acceleration, &self.lowest.acceleration),
            ];
            for (values, tallies, lowest) in motions {
                for ((value, tally), lowest) in values.iter_mut().zip(tallies).zip(lowest) {
                    if tally.total > 0.0 {
                        let counts = *value * tally.total > NEGLIGIBLE * tally.rows;
                        let found = *value * tally.growth();
                        update(value, found, LOWEST.powi(2) * lowest, counts);
                    }
                }
            }
        }
        let weighted = rows.iter().zip(&scene.rows).map(|(row, arrival)| {
            let square = (row.residual / scene.sigma[arrival.sensor]).powi(2);
            let s = before.scale.powi(2);
            (super::problem::NU + 1.0) * s * square / (super::problem::NU * s + square)
        });
        let found = (weighted.sum::<f64>() / free).sqrt();
        update(&mut self.model.scale, found, 1e-9 * self.lowest.scale, true);
        self.last = steps;
        change
    }

    /// Sums up the information of the priors of each group about its intensity.
    fn tallies(&self, inverse: &Skyline, priors: &[(Row, Group)]) -> Tallies {
        let identities = self.model.jerk.len();
        let motion = vec![Tally::default(); identities];
        let mut found =
            Tallies { jerk: motion.clone(), acceleration: motion, ..Tallies::default() };
        for (row, group) in priors {
            let own = Term {
                square: row.residual * row.residual,
                spread: inverse.quadratic(row.columns()),
                variance: self.model.variance(*group),
            };
            found.bound += own.spread / own.variance;
            match *group {
                Group::Unit => {}
                Group::Path => found.path.add(&own, 1.0),
                Group::Drift => found.drift.add(&own, 1.0),
                Group::Motion(identity, share) => {
                    found.jerk[identity].add(&own, 1.0);
                    found.acceleration[identity].add(&own, share);
                }
            }
        }
        found
    }

    fn solution(
        &self,
        normal: &Normal,
        inverse: &Skyline,
        rows: &[Row],
        weights: &Weights,
        (is_converged, iterations): (bool, usize),
    ) -> Solution {
        let (problem, scene, state) = (self.problem, self.problem.scene, &self.state);
        let (k, m, speed) = (scene.is_base.len(), problem.nodes.len(), scene.speed);
        let variance = |column: Option<usize>| column.map_or(0.0, |c| inverse.get(c, c));
        let sigma = |row: &Row, sensor: usize| row.residual / (weights.sigma * scene.sigma[sensor]);
        let mut found = Solution {
            time: state.emission.iter().map(|t| t / speed).collect(),
            residual: rows.iter().zip(&scene.rows).map(|(row, a)| sigma(row, a.sensor)).collect(),
            node: problem.nodes.clone(),
            site: state.site.as_flattened().to_vec(),
            noise_factor: weights.sigma,
            path_sigma: self.model.path,
            clock_drift: self.model.drift / speed,
            degrees_of_freedom: self.free * rows.len() as f64,
            is_converged,
            iterations,
            ..Solution::default()
        };
        let variances = normal.emission_variances(inverse);
        found.time_sigma = variances.iter().map(|v| v.sqrt() / speed).collect();
        for (emission, first) in problem.layout.motion.iter().enumerate() {
            let Some(first) = *first else { continue };
            let unit = problem.unit[problem.identity[emission]];
            let scale = |at: usize| unit.powi(-((at / D) as i32));
            let values = state.motion[emission].as_flattened().iter().enumerate();
            found.moving.push(emission);
            found.mean.extend(values.map(|(at, value)| value * scale(at)));
            for i in 0..3 * D {
                let row =
                    (0..3 * D).map(|j| inverse.get(first + i, first + j) * scale(i) * scale(j));
                found.covariance.extend(row);
            }
        }
        for at in 0..m * k {
            let line = &scene.lines[at % k];
            let time = problem.nodes[at / k];
            found.clock.push(line.reading(time) - time + state.clock[at] / speed);
            let (here, next) = (problem.layout.clock[at], problem.layout.clock.get(at + k));
            let covariance = match (here, next.copied().flatten()) {
                (Some(here), Some(next)) => inverse.get(here, next),
                _ => 0.0,
            };
            found.clock_variance.push(variance(here) / (speed * speed));
            found.clock_covariance.push(covariance / (speed * speed));
        }
        let sites = problem.layout.site.iter();
        found.site_sigma = sites
            .flat_map(|first| (0..D).map(|i| variance(first.map(|first| first + i)).sqrt()))
            .collect();
        let slowness = variance(problem.layout.slowness).sqrt();
        found.speed = (speed / state.slowness, speed * slowness / state.slowness.powi(2));
        let of = |values: &[f64], power: i32| -> Vec<f64> {
            values.iter().zip(&problem.unit).map(|(value, unit)| value / unit.powi(power)).collect()
        };
        found.jerk = of(&self.model.jerk, 5);
        found.acceleration = of(&self.model.acceleration, 3);
        found
    }
}
