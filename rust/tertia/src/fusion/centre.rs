//! The fusion centre, which fuses the tracks of several radars step by step.

use super::belief::{Belief, believed_noise};
use super::intersection::Intersection;
use super::matrix::{best_weights, difference, full, matrices, packed};
use super::repeats::{Repeats, Seen};
use super::robust::{Robust, first_variances};
use super::rules::{Beliefs, Rule, shares};
use crate::kalman::{Filter, Innovation, State, Transition};
use nalgebra::{Const, Matrix3, Vector3};

/// Report on a radar at one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RadarReport {
    /// Innovation of the radar's own filter.
    pub innovation: Innovation,
    /// Estimated variance of the radar's noise.
    pub noise: f64,
    /// Whether the plot of the radar was a single outlier.
    pub outlier: bool,
    /// Weight of the radar in angle, rate and acceleration: the diagonal of its weight matrix.
    pub weight: [f64; 3],
}

impl RadarReport {
    /// Report without any information.
    pub const NONE: Self = Self {
        innovation: Innovation::NONE,
        noise: f64::NAN,
        outlier: false,
        weight: [f64::NAN; 3],
    };
}

/// State of a radar in the centre.
#[derive(Clone, Debug)]
struct Radar {
    filter: Filter,
    /// Estimated covariance of the actual error of the radar's track.
    actual: Matrix3<f64>,
    /// Gain of this step; zero without a plot.
    gain: Vector3<f64>,
    innovation: Option<Innovation>,
    /// Whether angle and rate are known.
    known: bool,
}

/// State that a plot initiates.
#[derive(Clone, Copy, Debug)]
enum Start {
    /// First plot: the angle becomes known.
    FirstPlot,
    /// Second plot, with this time since the first: the rate becomes known.
    SecondPlot(f64),
}

/// The centre: the filters of the radars, their estimated noise, and the cross covariances of their
/// errors, which come from the common motion.
#[derive(Clone, Debug)]
pub struct Centre {
    radars: Vec<Radar>,
    beliefs: Vec<Option<Belief>>,
    /// cov(e_i, e_j) at i K + j, for i < j. While the state of a radar is not yet known, e is the effect
    /// of the acceleration since its first plot.
    cross: Vec<Matrix3<f64>>,
    central: Filter,
    robust: Robust,
    repeats: Repeats,
    rule: Rule,
    parameters: Beliefs,
    period: Option<f64>,
    weights: Vec<Matrix3<f64>>,
    scratch: Vec<f64>,
    /// Plots of a step; repeated plots are nan.
    kept: Vec<f64>,
    /// Created at the first use.
    intersection: Option<Intersection<Const<3>>>,
}

impl Centre {
    /// Creates a centre from the initial filters of the radars. Either all or none of their states are known.
    pub fn new(
        filters: impl IntoIterator<Item = Filter>,
        rule: Rule,
        parameters: Beliefs,
        period: Option<f64>,
    ) -> Self {
        let radars: Vec<_> = filters.into_iter().map(Radar::new).collect();
        let k = radars.len();
        let mut centre = Self {
            beliefs: radars.iter().map(|radar| radar.known.then_some(Belief::NEW)).collect(),
            cross: vec![Matrix3::zeros(); k * k],
            central: radars.first().map_or(Filter::new(0.0, period), |radar| radar.filter),
            robust: Robust::new(k, parameters.change_probability),
            repeats: Repeats::new(k, parameters.change_probability),
            weights: vec![Matrix3::zeros(); k],
            scratch: Vec::with_capacity(k),
            kept: Vec::with_capacity(k),
            intersection: None,
            radars,
            rule,
            parameters,
            period,
        };
        for i in 0..k {
            for j in i + 1..k {
                let [a, b] = [i, j].map(|index| &centre.radars[index]);
                centre.cross[i * k + j] = a.common_prior(b);
            }
        }
        if centre.radars.iter().all(|radar| radar.known) {
            centre.start_central();
        }
        centre
    }

    /// Starts the central filter from all given states, which share the same priors of rate and
    /// acceleration.
    fn start_central(&mut self) {
        let known: Vec<usize> = (0..self.radars.len()).collect();
        let mut weights = vec![Matrix3::zeros(); known.len()];
        best_weights(known.len(), |i, j| self.joint(i, j), &mut weights);
        self.weights = weights;
        let state = self.combined(&known);
        self.central = Filter::from_state(state, self.period);
        self.weights.fill(Matrix3::zeros());
    }

    /// Combines the states of the `known` radars with the current weights.
    fn combined(&self, known: &[usize]) -> State {
        let base = self.mean(known[0]);
        let mut mean = base;
        let mut covariance = Matrix3::zeros();
        for &i in known {
            mean += self.weights[i] * difference(&self.mean(i), &base, self.period);
            for &j in known {
                covariance += self.weights[i] * self.joint(i, j) * self.weights[j].transpose();
            }
        }
        State { mean: [mean[0], mean[1], mean[2]], covariance: packed(&covariance) }
    }

    /// Returns the complete state as lists of numbers.
    pub fn saved(&self) -> Vec<Vec<f64>> {
        let mut saved = vec![self.central.saved()];
        saved.extend(self.robust.saved());
        saved.extend(self.cross.iter().map(|cross| cross.as_slice().to_vec()));
        for (radar, belief) in self.radars.iter().zip(&self.beliefs) {
            saved.push(radar.filter.saved());
            saved.push(radar.actual.as_slice().to_vec());
            saved.push(belief.map_or(Vec::new(), |b| vec![b.q, b.d, b.mean_square]));
        }
        saved.extend(self.repeats.saved());
        saved
    }

    /// Restores a centre from [`Centre::saved`]; `None` if the numbers are not those of a saved centre.
    pub fn restored(&self, saved: &[Vec<f64>]) -> Option<Self> {
        let mut centre = self.clone();
        let mut lists = saved.iter();
        centre.central = centre.central.restored(lists.next()?)?;
        centre.robust.restore(&mut lists)?;
        let square = |list: &Vec<f64>| (list.len() == 9).then(|| Matrix3::from_column_slice(list));
        for cross in &mut centre.cross {
            *cross = square(lists.next()?)?;
        }
        for (radar, belief) in centre.radars.iter_mut().zip(&mut centre.beliefs) {
            radar.filter = radar.filter.restored(lists.next()?)?;
            radar.known = radar.filter.is_known();
            radar.actual = square(lists.next()?)?;
            *belief = match lists.next()?[..] {
                [q, d, mean_square] => Some(Belief { q, d, mean_square, nis: None }),
                [] => None,
                _ => return None,
            };
        }
        // older saved states do not contain the data on repeated plots
        if lists.len() > 0 {
            centre.repeats.restore(&mut lists)?;
        }
        lists.next().is_none().then_some(centre)
    }

    /// Predicts all filters to the next step.
    pub fn predict(&mut self, transition: &Transition) {
        for radar in &mut self.radars {
            radar.filter.predict(transition);
        }
        self.central.predict(transition);
        if self.rule == Rule::Robust {
            self.robust.predict(transition);
            return;
        }
        let (f, q) = matrices(transition);
        for radar in &mut self.radars {
            radar.actual = f * radar.actual * f.transpose() + q;
        }
        self.for_each_pair(|_, _, cross| *cross = f * *cross * f.transpose() + q);
    }

    /// Whether the last plot of a radar was left out because it repeats the one before.
    pub fn repeats(&self, radar: usize) -> bool {
        self.repeats.repeats(radar)
    }

    /// Updates the centre with the plots z (nan: no plot) of all radars and their nominal variances r.
    /// Rules that find faults leave out repeated plots.
    pub fn update(&mut self, z: &[f64], r: &[f64], reports: &mut [RadarReport]) -> State {
        if !self.rule.finds_faults() {
            return self.take_in(z, r, reports);
        }
        let mut kept = std::mem::take(&mut self.kept);
        kept.clear();
        kept.extend_from_slice(z);
        let seen: Vec<Seen> =
            self.radars.iter().map(|radar| Seen::by(&radar.filter, radar.innovation)).collect();
        self.repeats.leave_out(&mut kept, r, &seen, self.period);
        let state = self.take_in(&kept, r, reports);
        for (report, (z, kept)) in reports.iter_mut().zip(z.iter().zip(&kept)) {
            report.outlier |= kept.is_nan() && !z.is_nan();
        }
        self.kept = kept;
        state
    }

    /// Updates the centre with all given plots.
    fn take_in(&mut self, z: &[f64], r: &[f64], reports: &mut [RadarReport]) -> State {
        if self.rule == Rule::Robust {
            let known = self.central.is_known();
            let first = (!known).then(|| first_variances(z, r, self.period));
            self.update_filters(z, r, first.as_deref());
            self.update_robust(z, r, known, reports);
            for (i, variance) in first.into_iter().flatten().enumerate() {
                reports[i].outlier = !z[i].is_nan() && variance.is_infinite();
            }
            return self.central.state();
        }
        let started = self.update_filters(z, r, Some(r));
        for (belief, radar) in self.beliefs.iter_mut().zip(&self.radars) {
            if let Some(belief) = belief {
                belief.update(radar.innovation, 1.0 - self.parameters.forgetting_factor);
            }
        }
        for (i, report) in reports.iter_mut().enumerate() {
            let innovation = self.radars[i].innovation;
            let (noise, outlier) = believed_noise(
                &self.beliefs,
                i,
                r[i],
                innovation,
                &self.parameters,
                &mut self.scratch,
            );
            let radar = &mut self.radars[i];
            let kept = radar.kept();
            radar.actual = kept * radar.actual * kept.transpose()
                + radar.gain * radar.gain.transpose() * noise;
            let innovation = innovation.unwrap_or(Innovation::NONE);
            *report = RadarReport { innovation, noise, outlier, weight: [f64::NAN; 3] };
        }
        let change: Vec<_> =
            self.radars.iter().zip(&started).map(|(radar, start)| radar.change(start)).collect();
        self.for_each_pair(|i, j, cross| *cross = change[i] * *cross * change[j].transpose());
        for (i, start) in started.iter().enumerate() {
            if let Some(Start::SecondPlot(_)) = start {
                self.radars[i].actual = full(&self.radars[i].filter.state().covariance);
                self.radars[i].known = true;
                self.beliefs[i] = Some(Belief::NEW);
            }
        }
        self.fuse(r, reports)
    }

    /// Updates the robust rule. The plots that start its filter are used with their stated noise.
    fn update_robust(&mut self, z: &[f64], r: &[f64], known: bool, reports: &mut [RadarReport]) {
        for (report, radar) in reports.iter_mut().zip(&self.radars) {
            let innovation = radar.innovation.unwrap_or(Innovation::NONE);
            let weight = if radar.filter.has_plot() && known { 0.0 } else { f64::NAN };
            *report = RadarReport { innovation, weight: [weight; 3], ..RadarReport::NONE };
        }
        if known {
            self.robust.update(&mut self.central, z, r, self.period, |radar, found| {
                reports[radar].outlier = found.outlier;
                reports[radar].weight = [found.share; 3];
            });
        }
        for (i, report) in reports.iter_mut().enumerate() {
            report.noise = r[i] * self.robust.excess(i);
            self.radars[i].known = self.radars[i].filter.is_known();
        }
    }

    fn for_each_pair(&mut self, mut change: impl FnMut(usize, usize, &mut Matrix3<f64>)) {
        let k = self.radars.len();
        for i in 0..k {
            for j in i + 1..k {
                change(i, j, &mut self.cross[i * k + j]);
            }
        }
    }

    /// Updates the radars' own filters with nominal noise, and the central filter with the variances `central`,
    /// if there are any, of which infinite ones are left out. Returns for each radar which state its plot has
    /// initiated.
    fn update_filters(
        &mut self,
        z: &[f64],
        r: &[f64],
        central: Option<&[f64]>,
    ) -> Vec<Option<Start>> {
        let mut started = vec![None; z.len()];
        for (i, radar) in self.radars.iter_mut().enumerate() {
            (radar.gain, radar.innovation) = (Vector3::zeros(), None);
            if z[i].is_nan() {
                continue;
            }
            let since = radar.filter.since_first_plot();
            let innovation = radar.filter.update(z[i], r[i]);
            if let Some(variance) = central.map(|r| r[i]).filter(|r| r.is_finite()) {
                self.central.update(z[i], variance);
            }
            if radar.known {
                let [p00, p01, p02, ..] = radar.filter.state().covariance;
                radar.gain = Vector3::new(p00, p01, p02) / r[i];
                radar.innovation = innovation;
            } else {
                started[i] = match since {
                    None => Some(Start::FirstPlot),
                    Some(since) if radar.filter.is_known() => Some(Start::SecondPlot(since.f[0])),
                    Some(_) => None,
                };
            }
        }
        started
    }

    /// cov(e_i, e_j); on the diagonal with the stated or the estimated noise, depending on the rule.
    fn joint(&self, i: usize, j: usize) -> Matrix3<f64> {
        let k = self.radars.len();
        match i.cmp(&j) {
            std::cmp::Ordering::Less => self.cross[i * k + j],
            std::cmp::Ordering::Greater => self.cross[j * k + i].transpose(),
            std::cmp::Ordering::Equal if self.rule.believes() => self.radars[i].actual,
            std::cmp::Ordering::Equal => full(&self.radars[i].filter.state().covariance),
        }
    }

    fn fuse(&mut self, r: &[f64], reports: &mut [RadarReport]) -> State {
        let known: Vec<usize> = (0..self.radars.len()).filter(|&i| self.radars[i].known).collect();
        if self.rule == Rule::Central {
            return self.central.state();
        }
        if known.is_empty() {
            return self.unfused();
        }
        let bound = self.weigh(&known, r);
        for &i in &known {
            let diagonal = self.weights[i].diagonal();
            reports[i].weight = [diagonal[0], diagonal[1], diagonal[2]];
        }
        let combined = self.combined(&known);
        let covariance = bound.as_ref().map_or(combined.covariance, packed);
        State { covariance, ..combined }
    }

    /// State before any radar has two plots: the angle that one filter for all plots has. The rate is that of
    /// the tracks, of which there are none yet.
    fn unfused(&self) -> State {
        let State { mean: [angle, _, acceleration], covariance: [p00, .., p22] } =
            self.central.state();
        State {
            mean: [angle, if angle.is_nan() { angle } else { 0.0 }, acceleration],
            covariance: [p00, 0.0, 0.0, f64::INFINITY, 0.0, p22],
        }
    }

    fn mean(&self, i: usize) -> Vector3<f64> {
        Vector3::from(self.radars[i].filter.state().mean)
    }

    /// Sets the weights. Covariance intersection also returns its bound of the covariance.
    fn weigh(&mut self, known: &[usize], r: &[f64]) -> Option<Matrix3<f64>> {
        match self.rule {
            Rule::AdaptiveMatrix | Rule::Matrix => {
                let mut out = vec![Matrix3::zeros(); known.len()];
                best_weights(known.len(), |a, b| self.joint(known[a], known[b]), &mut out);
                for (&i, weight) in known.iter().zip(out) {
                    self.weights[i] = weight;
                }
                None
            }
            Rule::CovarianceIntersection => Some(self.intersect(known)),
            _ => {
                let precision: Vec<_> = known.iter().map(|&i| self.precision(i, r[i])).collect();
                for component in 0..3 {
                    let share = shares(precision.iter().map(|p| p[component]));
                    for (&i, share) in known.iter().zip(share) {
                        self.weights[i][(component, component)] = share;
                    }
                }
                None
            }
        }
    }

    /// Unnormalised weights of radar i, component by component.
    fn precision(&self, i: usize, r: f64) -> Vector3<f64> {
        let radar = &self.radars[i];
        let same = Vector3::repeat;
        match self.rule {
            Rule::Static => same(1.0 / r),
            Rule::Paper | Rule::PaperPrinted => match radar.innovation {
                // ∞ for a residual of zero
                Some(new) => radar.gain.map(|k| (k * new.value).powi(-2)),
                None if self.rule == Rule::Paper => same(0.0),
                None => same(f64::INFINITY),
            },
            Rule::Ewma => {
                let mean = self.beliefs[i].map_or(f64::NAN, |belief| belief.mean_square);
                let expected = || radar.filter.state().covariance[0] + r;
                same(1.0 / if mean.is_nan() { expected() } else { mean })
            }
            Rule::Posterior | Rule::Adaptive => self.joint(i, i).diagonal().map(|p| 1.0 / p),
            _ => same(1.0),
        }
    }

    /// Covariance intersection. If the covariances together are singular, the first radar's is returned.
    fn intersect(&mut self, known: &[usize]) -> Matrix3<f64> {
        let own: Vec<_> = known.iter().map(|&i| self.joint(i, i)).collect();
        let new = || Intersection::new(self.radars.len(), Const::<3>);
        let intersection = self.intersection.get_or_insert_with(new);
        let Ok(&bound) = intersection.intersect(&own) else {
            self.weights.fill(Matrix3::zeros());
            self.weights[known[0]] = Matrix3::identity();
            return own[0];
        };
        for (&i, weight) in known.iter().zip(&intersection.weight) {
            self.weights[i] = *weight;
        }
        bound
    }
}

impl Radar {
    fn new(filter: Filter) -> Self {
        let known = filter.is_known();
        let actual = if known { full(&filter.state().covariance) } else { Matrix3::zeros() };
        Self { filter, actual, gain: Vector3::zeros(), innovation: None, known }
    }

    /// Matrix that this step's plot applies to the error. After a first plot, the error of the angle is
    /// that of the plot; after a second plot, the error of the rate is the change of the angle's error
    /// since the first plot, divided by the time between them.
    fn change(&self, start: &Option<Start>) -> Matrix3<f64> {
        match start {
            None => self.kept(),
            Some(Start::FirstPlot) => Matrix3::from_diagonal(&Vector3::new(0.0, 0.0, 1.0)),
            Some(Start::SecondPlot(t)) => {
                Matrix3::new(0.0, 0.0, 0.0, -1.0 / t, 1.0, 0.0, 0.0, 0.0, 1.0)
            }
        }
    }

    /// Common initial error of two radars. If the states are unknown, this is the acceleration; if they
    /// are given, it is the prior of rate and acceleration, which a plot of the angle does not change.
    /// States with correlated components come from plots and are regarded as independent.
    fn common_prior(&self, other: &Self) -> Matrix3<f64> {
        let prior = |radar: &Self| {
            let p = &radar.actual;
            let acceleration = radar.filter.acceleration_variance();
            if !radar.known {
                Some(Vector3::new(0.0, 0.0, acceleration))
            } else if p[(0, 1)] == 0.0 && p[(0, 2)] == 0.0 && p[(1, 2)] == 0.0 {
                Some(Vector3::new(0.0, p[(1, 1)], p[(2, 2)]))
            } else {
                None
            }
        };
        match (prior(self), prior(other)) {
            (Some(a), Some(b)) => Matrix3::from_diagonal(&a.inf(&b)),
            _ => Matrix3::zeros(),
        }
    }

    /// `I − K h^T`.
    fn kept(&self) -> Matrix3<f64> {
        let mut kept = Matrix3::identity();
        let column = kept.column(0) - self.gain;
        kept.set_column(0, &column);
        kept
    }
}
