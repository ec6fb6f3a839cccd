//! The grid of sizes and correlation times of lasting errors.
//!
//! One filter of the drifts gives the likelihood of any constants, so points with the same drifts share a
//! filter.

use super::contradictions::{Blocks, Kernel, Point, Sums};
use super::prior::Prior;
use crate::base::exponential::exponentials;
use crate::sensors::KINDS;
use crate::trajectory::measured::Record;
use std::cell::RefCell;
use std::rc::Rc;

/// Standard deviations of constants and drifts, in units of those of the measurements, if there is one kind.
const SCALES: Scales = Scales { first: 0.125, ratio: 2.0, count: 8, steps: &[-1, 0, 1, 2, 3, 4] };
/// The same if there are several kinds.
const COARSE: Scales = Scales { first: 0.15, ratio: 3.162, count: 5, steps: &[0, 1, 2] };
/// Least drift that accompanies a constant, relative to the constant or, if that is larger than the noise, to
/// the noise: no station is steadier. Without this drift, errors that change slowly, for example with the
/// direction, would be taken for constants.
const STEADY: f64 = 0.5;
/// Largest drift.
const MOST_DRIFT: f64 = 8.0;
/// Prior weight of drifts that are small beside their constants, but not the least, relative to that of other
/// drifts.
const BETWEEN: f64 = 0.25;
/// Correlation times, as fractions of the duration of the record.
const TIMES: [f64; 4] = [0.5, 0.15, 0.05, 0.015];
/// Least correlation time, in blocks.
const RESOLVED: f64 = 1.5;
/// Prior odds of no lasting errors against any.
const NOTHING: f64 = 2.0;
/// Scales that are tried first, for one kind or all: if none is likelier than no errors, nothing lasts.
const PROBES: [f64; 2] = [0.25, 1.0];
/// Least number of stations among which one alone may be wrong: with fewer, others would be as likely.
const SEVERAL: usize = 4;
/// Number of suspects that are tried.
const SUSPECTS: usize = 4;
/// Prior odds that one column alone is wrong against any lasting errors, scales of its error, and scales of
/// the errors of the others.
const ALONE: f64 = 0.12;
const ALONE_SCALES: [f64; 3] = [4.0, 16.0, 64.0];
const OTHER_SCALES: [f64; 2] = [0.0, 0.25];
/// Ratio of the error of one column to what errors of the stated sizes of all columns would let it seem, from
/// which it may be the only one that is wrong: two-sided 95 % quantile of the standard normal distribution.
const BEYOND: f64 = 1.96;
/// Number of independent contradictions from which it is no chance that one error explains all of them, so that
/// it may be smaller.
const MANY: usize = 4;
/// Drift over constant during the search for suspects.
const SUSPECT_DRIFT: f64 = 0.35;
/// Standard deviation of the logarithms of the scales of different kinds.
const ALIKE: f64 = 1.2;
/// Probability of no lasting errors from which on none are removed.
pub(in crate::trajectory) const CERTAIN: f64 = 0.5;
/// Probability, relative to that of the best point, below which a point of the grid is dropped. It is low
/// because many such points together may matter.
const UNLIKELY: f64 = 3e-4;
/// Total probability of the largest errors, which are dropped if none are removed: a 95 % region need not
/// cover errors so unlikely, and they would be most of the variance.
const LARGEST: f64 = 0.05;
/// Difference of ln of the probability from that of the best point, beyond which a point is dropped.
const FALL: f64 = 6.0;

/// Standard deviations of the errors of a kind, in units of those of the measurements.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Size {
    constant: f64,
    drift: f64,
}

impl Size {
    const NONE: Self = Self::constant(0.0);

    const fn constant(constant: f64) -> Self {
        Self { constant, drift: 0.0 }
    }

    const fn drift(drift: f64) -> Self {
        Self { constant: 0.0, drift }
    }

    /// A constant with the least drift.
    fn steady(constant: f64) -> Self {
        Self { constant, drift: STEADY * constant.min(1.0) }
    }

    fn is_possible(&self) -> bool {
        self.drift <= MOST_DRIFT
    }
}

/// Geometric series of standard deviations, and the numbers of steps by which drifts are below the constants.
struct Scales {
    first: f64,
    ratio: f64,
    count: usize,
    steps: &'static [isize],
}

impl Scales {
    fn level(&self, i: usize) -> f64 {
        self.first * self.ratio.powi(i as i32)
    }

    /// Returns the level of the least drift of a constant: one step below the constant, or that of the
    /// steadiest stations.
    fn least(&self, i: usize) -> usize {
        let steady = (1..self.count).take_while(|at| self.level(*at) <= STEADY).count();
        i.saturating_sub(1).min(steady)
    }

    fn drift(&self, i: usize) -> Option<Size> {
        Some(Size::drift(self.level(i))).filter(Size::is_possible)
    }

    /// Returns a constant whose drift is this number of steps below it, but not below the least drift.
    fn both(&self, i: usize, step: isize) -> Option<Size> {
        let at = i.saturating_add_signed(-step).max(self.least(i));
        Some(Size { constant: self.level(i), drift: self.level(at) }).filter(Size::is_possible)
    }
}

/// How drifts change over time.
#[derive(Clone, Copy, Debug)]
struct Course {
    time: f64,
    kernel: Kernel,
}

/// A point of the grid with its probability and the growth of the noise.
pub(in crate::trajectory) struct Weighed {
    pub point: Point,
    pub sums: Rc<Sums>,
    /// Probability; ln of it until [`Grid::weighed`] has normalised it.
    pub probability: f64,
    pub growth: f64,
}

/// Points at which the likelihood is evaluated.
pub(in crate::trajectory) struct Grid<'a> {
    blocks: &'a Blocks,
    /// Unit of the errors of each column: the standard deviation of its measurements or, if it is given, that
    /// of the lasting error.
    sigma: Vec<f64>,
    /// Number of the kind of each column among those whose errors are estimated; none if the standard
    /// deviation of the lasting error is given.
    kind: Vec<Option<usize>>,
    kinds: usize,
    /// Share of the drift and correlation time of each column; none where they are to be estimated.
    own: Vec<(Option<f64>, Option<f64>)>,
    /// Whether any share is to be estimated.
    any_share: bool,
    courses: Vec<Course>,
    /// Sums of points with different drifts.
    sums: RefCell<Vec<(Point, Rc<Sums>)>>,
}

impl<'a> Grid<'a> {
    pub fn new(record: &Record<'_>, blocks: &'a Blocks, prior: &Prior, columns: &[usize]) -> Self {
        let k = record.width() / KINDS;
        let mut found: Vec<usize> =
            columns.iter().filter(|c| prior.sigma[**c].is_nan()).map(|c| c / k).collect();
        found.dedup();
        let kind = |c: &usize| {
            prior.sigma[*c].is_nan().then(|| found.iter().position(|own| *own == c / k)).flatten()
        };
        let sigma = |c: &usize| {
            let given = prior.sigma[*c];
            if given.is_nan() { record.sigmas[*c] } else { given }
        };
        let span = record.time[record.len() - 1] - record.time[0];
        let step = span / blocks.time.len() as f64;
        let mut times: Vec<f64> =
            TIMES.iter().map(|part| part * span).filter(|t| *t > RESOLVED * step).collect();
        // positive even if all instants have the same time
        let whole = span.max(f64::MIN_POSITIVE);
        if times.is_empty() {
            times.push(whole);
        }
        // errors of given size without a given share are constant
        let own: Vec<(Option<f64>, Option<f64>)> = columns
            .iter()
            .map(|c| {
                let known = |v: f64| (!v.is_nan()).then_some(v);
                let share = if prior.sigma[*c].is_nan() { None } else { Some(0.0) };
                (known(prior.share[*c]).or(share), known(prior.time[*c]))
            })
            .collect();
        let any_share = own.iter().any(|own| own.0.is_none());
        let any_time = own.iter().any(|own| own.1.is_none() && own.0 != Some(0.0));
        let times = if any_time { times } else { vec![whole] };
        let courses = [Kernel::Markov, Kernel::Smooth]
            .into_iter()
            .flat_map(|kernel| times.iter().map(move |&time| Course { time, kernel }))
            .collect();
        let (sigma, kind) =
            (columns.iter().map(sigma).collect(), columns.iter().map(kind).collect());
        let (kinds, sums) = (found.len(), RefCell::default());
        Self { blocks, sigma, kind, kinds, own, any_share, courses, sums }
    }

    fn point(&self, sizes: &[Size], Course { time, kernel }: Course) -> Point {
        let (constant, drift, times) = (Vec::new(), Vec::new(), Vec::new());
        let mut point = Point { constant, drift, time: times, kernel, alone: None };
        for ((sigma, kind), own) in self.sigma.iter().zip(&self.kind).zip(&self.own) {
            let size = kind.map_or(Size::constant(1.0), |kind| sizes[kind]);
            let time = own.1.unwrap_or(time);
            let (mut constant, mut drift) = (size.constant.powi(2), size.drift.powi(2));
            // a drift with an infinite correlation time is a constant
            let share = if time.is_finite() { own.0 } else { Some(0.0) };
            if let Some(share) = share {
                (constant, drift) =
                    ((1.0 - share) * (constant + drift), share * (constant + drift));
            }
            point.constant.push(constant * sigma * sigma);
            point.drift.push(drift * sigma * sigma);
            point.time.push(time);
        }
        point
    }

    /// Returns the points that matter, with their probabilities and the growth of the noise. The growth
    /// multiplies all errors, so if the noise is smaller than stated, the stated sizes of lasting errors are
    /// increased first: they do not depend on the noise.
    pub fn weighed_as_stated(&mut self) -> Vec<Weighed> {
        let points = self.weighed();
        let growth: f64 = points.iter().map(|one| one.probability * one.growth).sum();
        if growth >= 1.0 || self.kind.iter().all(Option::is_some) {
            return points;
        }
        let stated = self.sigma.iter_mut().zip(&self.kind).filter(|(_, kind)| kind.is_none());
        stated.for_each(|(sigma, _)| *sigma /= growth.sqrt());
        self.weighed()
    }

    /// Returns the points that matter, with their probabilities and the growth of the noise.
    fn weighed(&self) -> Vec<Weighed> {
        let mut points = self.searched();
        exponentials(&mut points, |one| &mut one.probability);
        points.retain(|one| one.probability > UNLIKELY);
        let total: f64 = points.iter().map(|one| one.probability).sum();
        points.iter_mut().for_each(|one| one.probability /= total);
        let is_nothing = |one: &&Weighed| one.point.is_nothing();
        let nothing: f64 = points.iter().filter(is_nothing).map(|one| one.probability).sum();
        if nothing < CERTAIN {
            return points;
        }
        let size = |one: &Weighed| -> f64 {
            let each = one.point.constant.iter().zip(&one.point.drift).zip(&self.sigma);
            each.map(|((constant, drift), sigma)| (constant + drift) / (sigma * sigma)).sum()
        };
        points.sort_by(|a, b| size(a).total_cmp(&size(b)));
        let mut left = 0.0;
        while let Some(last) = points.last().filter(|one| left + one.probability <= LARGEST) {
            left += last.probability;
            points.pop();
        }
        points.iter_mut().for_each(|one| one.probability /= 1.0 - left);
        points
    }

    /// Returns the points that may matter, with ln of their probabilities and the growth of the noise.
    fn searched(&self) -> Vec<Weighed> {
        let mut points = Vec::new();
        match self.kinds {
            0 => {
                let judged = |course: &Course| self.judged(self.point(&[], *course), 0.0);
                points.extend(self.courses.iter().filter_map(judged));
            }
            1 => {
                let none = self.point(&[Size::NONE], self.courses[0]);
                points.extend(self.judged(none, NOTHING.ln()));
                if self.blocks.count == 0 {
                    // without contradictions nothing can be estimated
                    return points;
                }
                for (sizes, prior) in self.sizes(&SCALES) {
                    let courses = self.courses_of(&sizes);
                    let prior = prior - (courses.len() as f64).ln();
                    let judged = |course: &Course| self.judged(self.point(&sizes, *course), prior);
                    points.extend(courses.iter().filter_map(judged));
                }
                points.extend(self.alone());
            }
            _ => {
                points.extend(self.several());
                points.extend(self.alone());
            }
        }
        points
    }

    /// Returns the ways in which errors of these sizes may change over time; without a drift there is one.
    fn courses_of(&self, sizes: &[Size]) -> &[Course] {
        let drifts = self.point(sizes, self.courses[0]).drift.iter().any(|v| *v > 0.0);
        if drifts { &self.courses } else { &self.courses[..1] }
    }

    /// Returns the Gauss–Markov drift with one of the correlation times, counted from the longest.
    fn markov(&self, at: usize) -> Course {
        self.courses[at.min(self.courses.len() / 2 - 1)]
    }

    /// Returns sizes of the errors of all kinds with ln of their prior probabilities: drifts alone, and
    /// constants with drifts from twice the constant (equal to it if there are several kinds) down to the
    /// least.
    fn sizes(&self, scales: &Scales) -> Vec<(Vec<Size>, f64)> {
        let mut all = Vec::new();
        let mut add = |weight: f64, of: &dyn Fn(&[usize]) -> Option<Vec<Size>>| {
            let sizes = vectors(scales.count, self.kinds).filter_map(|levels| of(&levels));
            all.extend(sizes.map(|sizes| {
                let prior = unlike(&sizes) + weight.ln();
                (sizes, prior)
            }));
        };
        let of_each = |levels: &[usize], of: &dyn Fn(usize) -> Option<Size>| {
            levels.iter().map(|i| of(*i)).collect::<Option<Vec<Size>>>()
        };
        if self.any_share {
            let most = scales.count as isize;
            let least = |levels: &[usize]| of_each(levels, &|i| scales.both(i, most));
            add(1.0, &|levels| of_each(levels, &|i| scales.drift(i)));
            add(1.0, &least);
            for &step in scales.steps {
                let weight = if step > 1 { BETWEEN } else { 1.0 };
                let own = |levels: &[usize]| of_each(levels, &|i| scales.both(i, step));
                add(weight, &|levels| {
                    own(levels).filter(|own| Some(own) != least(levels).as_ref())
                });
            }
        } else {
            add(1.0, &|levels| of_each(levels, &|i| Some(Size::constant(scales.level(i)))));
        }
        let total = all.iter().map(|(_, prior)| prior.exp()).sum::<f64>().ln();
        all.iter_mut().for_each(|(_, prior)| *prior -= total);
        all
    }

    /// Returns points at which one column is far more wrong than the others, always or from some time on.
    /// Where few measurements are redundant, its error must be larger than the stated sizes allow: errors of all
    /// columns can look like one of a single column by chance.
    fn alone(&self) -> Vec<Weighed> {
        let (slow, fast) = (self.markov(0), self.markov(self.courses.len() / 4));
        let size: fn(f64) -> Size = Size::steady;
        let ways = [
            (size, slow, f64::INFINITY),
            (Size::drift, slow, slow.time),
            (Size::drift, fast, fast.time),
        ];
        let suspects = self.suspects(slow);
        let are_many = self.blocks.ways(&self.sigma) >= MANY;
        let each = self.kind.len() * ALONE_SCALES.len() * OTHER_SCALES.len() * ways.len();
        let prior = (ALONE / each as f64).ln();
        let mut points = Vec::new();
        for (size, course, lasts) in ways {
            let of = |size: Size| self.point(&vec![size; self.kinds], course);
            let is_beyond =
                |at: &&usize| are_many || self.blocks.excess(**at, &self.sigma, lasts) > BEYOND;
            let own: Vec<usize> = suspects.iter().filter(is_beyond).copied().collect();
            for (other, scale) in OTHER_SCALES.iter().flat_map(|o| ALONE_SCALES.map(|s| (*o, s))) {
                for &at in &own {
                    let (mut point, own) = (of(size(other)), of(size(scale)));
                    (point.constant[at], point.drift[at]) = (own.constant[at], own.drift[at]);
                    point.alone = Some(at);
                    points.extend(self.judged(point, prior));
                }
            }
        }
        points
    }

    /// Returns the columns with the largest errors among those with enough other columns of their kind.
    fn suspects(&self, course: Course) -> Vec<usize> {
        let size = Size { constant: ALONE_SCALES[0], drift: SUSPECT_DRIFT * ALONE_SCALES[0] };
        let point = self.point(&vec![size; self.kinds], course);
        let mean = self.sums(&point).constants(&point.constant).0;
        let alike = |kind: Option<usize>| self.kind.iter().filter(|own| **own == kind).count();
        let may = |at: &usize| self.kind[*at].is_some() && alike(self.kind[*at]) >= SEVERAL;
        let mut own: Vec<usize> = (0..mean.len()).filter(may).collect();
        let size = |at: usize| (mean[at] / self.sigma[at]).abs();
        own.sort_by(|a, b| size(*b).total_cmp(&size(*a)));
        own.truncate(SUSPECTS);
        own
    }

    fn judged(&self, point: Point, prior: f64) -> Option<Weighed> {
        let sums = self.sums(&point);
        let (value, growth) = self.blocks.likelihood(&sums, &point.constant)?;
        Some(Weighed { point, sums, probability: value + prior, growth })
    }

    /// Returns the sums for the drifts of a point.
    fn sums(&self, point: &Point) -> Rc<Sums> {
        let mut all = self.sums.borrow_mut();
        if let Some((_, sums)) = all.iter().find(|(other, _)| other.drifts_as(point)) {
            return Rc::clone(sums);
        }
        let sums = Rc::new(self.blocks.sums(point));
        all.push((point.clone(), Rc::clone(&sums)));
        sums
    }

    /// Returns the points for several kinds. Sizes are judged with a likely correlation time, and correlation
    /// times with the likeliest sizes that drift, as if sizes and times were independent. The prior makes
    /// sizes of different kinds alike, because otherwise one kind would explain errors of others as well.
    fn several(&self) -> Vec<Weighed> {
        let middle = self.markov(1);
        let judged = |sizes: &[Size], prior| self.judged(self.point(sizes, middle), prior);
        let Some(none) = judged(&vec![Size::NONE; self.kinds], 0.0) else { return Vec::new() };
        if !self
            .probes()
            .any(|sizes| judged(&sizes, 0.0).is_some_and(|one| one.probability > none.probability))
        {
            return vec![none];
        }
        let none = Weighed { probability: none.probability + NOTHING.ln(), ..none };
        let mut found = Vec::new();
        for (sizes, prior) in self.sizes(&COARSE) {
            found.extend(judged(&sizes, prior).map(|one| (sizes, one)));
        }
        let top = found.iter().map(|(_, one)| one.probability).fold(none.probability, f64::max);
        let drifting = found.iter().filter(|(sizes, _)| self.courses_of(sizes).len() > 1);
        let likely = drifting.max_by(|a, b| a.1.probability.total_cmp(&b.1.probability));
        let parts = likely.map_or(Vec::new(), |(sizes, _)| self.parts(sizes));
        let mut points = vec![none];
        for (sizes, one) in found.into_iter().filter(|(_, one)| one.probability > top - FALL) {
            if self.courses_of(&sizes).len() == 1 {
                points.push(one);
                continue;
            }
            for (course, part) in self.courses.iter().zip(&parts) {
                let probability = one.probability + part;
                if probability > top - FALL {
                    let point = self.point(&sizes, *course);
                    let sums = self.sums(&point);
                    points.push(Weighed { point, sums, probability, growth: one.growth });
                }
            }
        }
        points
    }

    /// Sizes of one kind or of all kinds; if anything lasts, one of them must be likelier than no errors.
    fn probes(&self) -> impl Iterator<Item = Vec<Size>> {
        let sizes = PROBES.iter().flat_map(|&scale| {
            [Size::constant(scale), Size { constant: 0.8 * scale, drift: 0.6 * scale }]
        });
        let kinds = self.kinds;
        sizes.flat_map(move |size| {
            let one =
                move |kind| (0..kinds).map(|k| if k == kind { size } else { Size::NONE }).collect();
            (0..kinds).map(one).chain(std::iter::once(vec![size; kinds]))
        })
    }

    /// Returns ln of the probabilities of the ways in which errors of these sizes may change.
    fn parts(&self, sizes: &[Size]) -> Vec<f64> {
        let judged = |course: &Course| self.judged(self.point(sizes, *course), 0.0);
        let value = |course| judged(course).map_or(f64::NEG_INFINITY, |one| one.probability);
        let values: Vec<f64> = self.courses.iter().map(value).collect();
        let best = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let total = values.iter().map(|value| (value - best).exp()).sum::<f64>().ln() + best;
        values.into_iter().map(|value| value - total).collect()
    }
}

/// Returns all vectors of `size` numbers below `count`.
fn vectors(count: usize, size: usize) -> impl Iterator<Item = Vec<usize>> {
    let place = move |number: usize, at: usize| number / count.pow(at as u32) % count;
    (0..count.pow(size as u32)).map(move |number| (0..size).map(|at| place(number, at)).collect())
}

/// Half-Cauchy density of a scale about 1, per unit of its logarithm.
fn cauchy(scale: f64) -> f64 {
    scale / (1.0 + scale * scale)
}

/// ln of the prior density of sizes: of their mean, and of their differences between kinds.
fn unlike(sizes: &[Size]) -> f64 {
    let logs: Vec<f64> = sizes.iter().map(|size| size.constant.hypot(size.drift).ln()).collect();
    let mean = logs.iter().sum::<f64>() / logs.len() as f64;
    let differences = logs.iter().map(|log| -0.5 * ((log - mean) / ALIKE).powi(2));
    cauchy(mean.exp()).ln() + differences.sum::<f64>()
}
