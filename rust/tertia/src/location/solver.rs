//! The position of one instant: start, robust steps, other minima, covariance.

use super::block::{Arrival, Block, LANES};
use super::candidates::Candidates;
use super::descent::{self, End, HUBER, Loss, Normal, TUKEY};
use super::doubt::doubt;
use super::lenth::{self, Weight};
use crate::base::distribution::chi_square_upper;
use crate::base::small::{Factor, Matrix, Vector, add, norm, quadratic};
use crate::sensors::{Measurement, Row, read};

/// Least squares end where a step is shorter than so many standard deviations.
const TOLERANCE: f64 = 1e-9;
const STEPS: usize = 100;
/// Robust steps: Huber's only lead to Tukey's.
const HUBER_STEPS: usize = 8;
const HUBER_TOLERANCE: f64 = 0.1;
/// The same from a start that is trusted.
const NEAR_HUBER: f64 = 0.5;
const TUKEY_STEPS: usize = 50;
const TUKEY_TOLERANCE: f64 = 1e-7;
const RESCALINGS: usize = 12;
/// A start is better than Huber's fit where its scale is smaller by this factor.
const SMALLER_BY_CHANCE: f64 = 2.0;
/// Steps to the σ whose weighted residuals are as large as those found.
const SPREAD_STEPS: usize = 20;
/// Correction of a scale for few measurements.
const FEW: f64 = 5.0;
/// Median of the size of a standard normal number.
const NORMAL_MEDIAN: f64 = 0.674_489_750_196_081_7;
/// Minima whose likelihoods differ less than by a factor of 20 cannot be told apart: ln 20.
const AMBIGUOUS: f64 = 2.995_732_273_553_991;
/// Points within so many standard deviations, squared, belong to one minimum.
const SAME_MINIMUM: f64 = 25.0;
/// Other minima looked for.
const RIVALS: usize = 3;
/// Faults with which the median of the stations' own fixes is trusted as a start, and the best of
/// them; beyond, other positions may explain as much.
const TRUSTED_FAULTS: [f64; 2] = [1.0, 2.0];
/// Degrees of freedom from which on every start may lead to a minimum of its own. With fewer, any
/// few measurements would, and those count that Huber's steps lead to.
const RIVALRY: usize = 4;
/// Least sum of the weights beyond what the coordinates use up.
const LEAST_REST: f64 = 1e-9;
/// A point is at a station below this share of the extent.
const NEAR: f64 = 1e-9;
/// Where a descent creeps closer than this, it would end at a station: close to one, its azimuth
/// can be anything.
const APPROACHED: f64 = 1e-2;
/// Largest cost of a point where as many measurements as coordinates meet.
const MEETING: f64 = 1e-6;

/// How a position is estimated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Tukey's biweight from so many degrees of freedom on, least squares below.
    Robust(usize),
    /// Least squares.
    LeastSquares,
    /// Lenth's maximum likelihood.
    LenthMle,
    /// Lenth's form of Huber's estimator.
    LenthHuber,
    /// Lenth's form of Andrews' estimator.
    LenthAndrews,
}

/// Why an instant has no position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Problem {
    /// It has one.
    None = 0,
    /// Fewer measurements than coordinates.
    TooFew = 1,
    /// Bearings that are parallel, diverge, or meet behind a station; ranges that do not meet.
    NoIntersection = 2,
    /// Measurements that leave some direction undetermined.
    Singular = 3,
    /// Two positions that explain the measurements (almost) equally well.
    Ambiguous = 4,
    /// A position at a station, or straight above one that measures angles.
    AtStation = 5,
    /// No minimum was reached.
    NotConverged = 6,
}

/// What was measured at one instant.
#[derive(Clone, Copy, Debug)]
pub struct Instant<'a> {
    /// Positions of K stations, K D numbers.
    pub stations: &'a [f64],
    /// East, north and up of each station, K D² numbers, to which its angles refer; those of the
    /// frame if there are none.
    pub axes: Option<&'a [f64]>,
    /// Ranges, azimuths, elevations and range differences, 4 K finite numbers, nan where there is
    /// none.
    pub values: &'a [f64],
    /// Their standard deviations; nan if they are unknown and equal.
    pub sigmas: &'a [f64],
    /// A position near the one looked for.
    pub initial: Option<&'a [f64]>,
}

/// Where the results go.
#[derive(Debug)]
pub struct Output<'a> {
    /// D numbers.
    pub position: &'a mut [f64],
    /// D² numbers.
    pub covariance: &'a mut [f64],
    /// 4 K whitened residuals, measured less predicted; nan where nothing was measured.
    pub residual: &'a mut [f64],
    /// 4 K marks of measurements without weight.
    pub outlier: &'a mut [bool],
}

/// What besides the position came out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fix {
    /// Why there is no position.
    pub problem: Problem,
    /// Measurements less coordinates, negative where there are too few.
    pub degrees_of_freedom: i64,
    /// Sum of all squared residuals.
    pub chi_square: f64,
    /// Probability of a larger one; nan where σ is estimated.
    pub p_value: f64,
    /// Root of the trace of the covariance for σ = 1; nan where units are mixed.
    pub dilution: f64,
    /// The standard deviation of a measurement where it is estimated, nan otherwise.
    pub sigma: f64,
}

impl Fix {
    /// That of an instant that has not been located.
    pub const UNKNOWN: Self = Self {
        problem: Problem::TooFew,
        degrees_of_freedom: 0,
        chi_square: f64::NAN,
        p_value: f64::NAN,
        dilution: f64::NAN,
        sigma: f64::NAN,
    };
}

/// Buffers of a thread.
#[derive(Debug)]
pub struct Workspace<const D: usize> {
    records: Vec<Record<D>>,
    block: Block<D>,
    candidates: Candidates<D>,
    costs: Vec<f64>,
    scratch: Vec<f64>,
}

impl<const D: usize> Default for Workspace<D> {
    fn default() -> Self {
        Self {
            records: vec![Record::default(); LANES],
            block: Block::default(),
            candidates: Candidates::default(),
            costs: Vec::new(),
            scratch: Vec::new(),
        }
    }
}

/// What was measured at one instant, without gaps.
#[derive(Clone, Debug)]
struct Record<const D: usize> {
    measurements: Vec<Measurement<D>>,
    /// Where each stands in the instant.
    places: Vec<usize>,
    /// The size of the geometry.
    extent: f64,
    /// A start that is trusted, and the minimum it led to.
    start: Option<Vector<D>>,
    first: Option<Minimum<D>>,
    /// Residuals and their derivatives there.
    rows: Vec<Row<D>>,
}

impl<const D: usize> Default for Record<D> {
    fn default() -> Self {
        Self {
            measurements: Vec::new(),
            places: Vec::new(),
            extent: 0.0,
            start: None,
            first: None,
            rows: Vec::new(),
        }
    }
}

/// A minimum of the cost.
#[derive(Clone, Copy, Debug)]
struct Minimum<const D: usize> {
    position: Vector<D>,
    normal: Normal<D>,
    end: End,
    scale: f64,
}

/// An estimator of positions.
#[derive(Clone, Copy, Debug)]
pub struct Locator {
    method: Method,
}

/// One instant on its way through the solver.
struct Search<'a, const D: usize> {
    problem: descent::Problem<'a, D>,
    loss: Loss,
    unknown: bool,
    /// Where a start that is trusted led to.
    first: Option<Minimum<D>>,
}

impl Locator {
    /// An estimator by this method.
    pub fn new(method: Method) -> Self {
        Self { method }
    }

    /// Estimates the positions of instants, [`location::BLOCK`](super::BLOCK) of them side by side
    /// at best. Where that fails, position and covariance are nan. The result does not depend on
    /// the company.
    ///
    /// # Panics
    /// If there is not an output and a fix for each instant.
    pub fn locate_all<const D: usize>(
        &self,
        instants: &[Instant<'_>],
        out: &mut [Output<'_>],
        fixes: &mut [Fix],
        workspace: &mut Workspace<D>,
    ) {
        assert!(instants.len() == out.len() && instants.len() == fixes.len());
        let blocks = instants.chunks(LANES).zip(out.chunks_mut(LANES));
        for ((instants, out), fixes) in blocks.zip(fixes.chunks_mut(LANES)) {
            self.descend(instants, workspace);
            for (at, instant) in instants.iter().enumerate() {
                fixes[at] = self.finish(instant, at, &mut out[at], workspace);
            }
        }
    }

    /// Estimates the position of one instant: [`Locator::locate_all`].
    pub fn locate<const D: usize>(
        &self,
        instant: &Instant<'_>,
        out: &mut Output<'_>,
        workspace: &mut Workspace<D>,
    ) -> Fix {
        self.descend(std::slice::from_ref(instant), workspace);
        self.finish(instant, 0, out, workspace)
    }

    /// What a residual costs, with so many degrees of freedom.
    fn loss(&self, redundancy: usize) -> Loss {
        match self.method {
            Method::Robust(least) if redundancy >= least.max(1) => Loss::Tukey(TUKEY),
            _ => Loss::Square,
        }
    }

    /// Reads instants, and goes down from the starts that are trusted side by side.
    fn descend<const D: usize>(&self, instants: &[Instant<'_>], workspace: &mut Workspace<D>) {
        let Workspace { records, block, candidates, .. } = workspace;
        let records = &mut records[..instants.len()];
        for (record, instant) in records.iter_mut().zip(instants) {
            record.read(instant);
            if instant.initial.is_none() && self.lenth().is_none() && !record.is_unknown(instant) {
                record.start = candidates.middle(&record.measurements);
            }
        }
        for from in 0..records.len() {
            let (first, start) = match &records[from] {
                Record { start: Some(start), first: None, .. } => (&records[from], start),
                _ => continue,
            };
            block.begin(&first.measurements, start);
            let mut members = [false; LANES];
            for (lane, record) in records.iter().enumerate().skip(from) {
                let Some(start) = record.start.filter(|_| record.first.is_none()) else { continue };
                members[lane] = block.fits(&record.measurements);
                if members[lane] {
                    block.set(lane, &record.measurements, &start);
                }
            }
            let loss = self.loss(first.measurements.len() - D);
            let tolerance = if loss == Loss::Square { TOLERANCE } else { TUKEY_TOLERANCE };
            block.descend(loss, (HUBER_STEPS, NEAR_HUBER), tolerance);
            for (lane, record) in records.iter_mut().enumerate().filter(|(lane, _)| members[*lane])
            {
                let arrival = block.arrival(lane, record.extent, &mut record.rows);
                record.first = arrival.map(Minimum::of);
                // others are left to the safeguards
                record.start = record.start.filter(|_| arrival.is_some());
            }
        }
    }

    /// The position of a record, from the minimum that its start led to or from others.
    fn finish<const D: usize>(
        &self,
        instant: &Instant<'_>,
        at: usize,
        out: &mut Output<'_>,
        workspace: &mut Workspace<D>,
    ) -> Fix {
        out.position.fill(f64::NAN);
        out.covariance.fill(f64::NAN);
        out.residual.fill(f64::NAN);
        out.outlier.fill(false);
        let Workspace { records, candidates, costs, scratch, .. } = workspace;
        let record = &mut records[at];
        let unknown = record.is_unknown(instant);
        let Record { measurements, places, extent, first: arrived, rows, .. } = record;
        let count = measurements.len();
        let degrees_of_freedom = count as i64 - D as i64;
        let failed = |problem| Fix {
            problem,
            degrees_of_freedom,
            chi_square: f64::NAN,
            p_value: f64::NAN,
            dilution: f64::NAN,
            sigma: f64::NAN,
        };
        if degrees_of_freedom < 0 {
            return failed(Problem::TooFew);
        }
        let redundancy = count - D;
        let loss = self.loss(redundancy);
        let problem = descent::Problem { measurements, extent: *extent };
        let search = Search { problem, loss, unknown, first: *arrived };
        let origin = first::<D>(instant.stations);
        let initial = instant.initial.map(|p| std::array::from_fn(|i| p[i] - origin[i]));
        let found = match self.lenth() {
            None => search.minimum(initial, candidates, costs, scratch),
            Some(weight) => search.lenth(initial, weight, candidates, costs, scratch),
        };
        let minimum = match found.and_then(|minimum| search.checked(minimum)) {
            Ok(minimum) => minimum,
            Err(problem) => return failed(problem),
        };
        for (value, (p, o)) in out.position.iter_mut().zip(minimum.position.iter().zip(origin)) {
            *value = p + o;
        }
        if arrived.is_none_or(|first| first.position != minimum.position) {
            rows.clear();
            rows.extend(measurements.iter().map(|m| m.row(&minimum.position)));
        }
        let summary = search.summary(&minimum, self.lenth(), rows);
        for (i, row) in summary.covariance.iter().enumerate() {
            out.covariance[i * D..(i + 1) * D].copy_from_slice(row);
        }
        let mut chi_square = 0.0;
        let [own, robust] = [summary.sigma, minimum.scale].map(f64::recip);
        for (row, &place) in rows.iter().zip(&*places) {
            let u = row.residual * own;
            out.residual[place] = u;
            out.outlier[place] = (row.residual * robust).abs() >= summary.fault;
            chi_square += u * u;
        }
        Fix {
            chi_square,
            p_value: match unknown {
                true => f64::NAN,
                false if redundancy == 0 => 1.0,
                false => chi_square_upper(chi_square, redundancy),
            },
            dilution: summary.dilution,
            sigma: if unknown { summary.sigma } else { f64::NAN },
            ..failed(Problem::None)
        }
    }

    fn lenth(&self) -> Option<Weight> {
        match self.method {
            Method::LenthMle => Some(Weight::One),
            Method::LenthHuber => Some(Weight::Huber),
            Method::LenthAndrews => Some(Weight::Andrews),
            _ => None,
        }
    }

    /// The covariance that stations would have at a position, the arguments as in [`Instant`],
    /// `sigmas` nan for what they do not measure; infinite where it is not determined. Returns the
    /// dilution. O(K).
    pub fn accuracy<const D: usize>(
        stations: &[f64],
        axes: Option<&[f64]>,
        sigmas: &[f64],
        position: &[f64],
        covariance: &mut [f64],
        workspace: &mut Workspace<D>,
    ) -> f64 {
        let values = sigmas;
        let record = &mut workspace.records[0];
        record.read(&Instant { stations, axes, values, sigmas, initial: None });
        let Record { measurements, extent, .. } = &*record;
        let extent = *extent;
        let origin = first::<D>(stations);
        let p: Vector<D> = std::array::from_fn(|i| position[i] - origin[i]);
        let near = NEAR * (extent + norm(&p));
        let problem = descent::Problem { measurements, extent };
        let matrix = problem.normal(&p, Loss::Square, 1.0).matrix;
        let blind = measurements.iter().any(|m| m.is_blind(&p, near));
        let inverse = Factor::try_new(&matrix, 0.0).filter(|_| !blind).map(|f| f.inverse());
        for (i, row) in inverse.unwrap_or_else(undetermined).iter().enumerate() {
            covariance[i * D..(i + 1) * D].copy_from_slice(row);
        }
        if inverse.is_none() {
            return f64::INFINITY;
        }
        let mut spread = Spread::of(measurements);
        for m in measurements {
            spread.add(m, &m.row(&p), true);
        }
        spread.dilution()
    }
}

/// Infinite variances; what is between them is not a number.
fn undetermined<const D: usize>() -> Matrix<D> {
    std::array::from_fn(|i| std::array::from_fn(|j| if i == j { f64::INFINITY } else { f64::NAN }))
}

/// The first station, from which positions are counted: a common offset costs no digits.
fn first<const D: usize>(stations: &[f64]) -> Vector<D> {
    std::array::from_fn(|i| stations[i])
}

impl<const D: usize> Record<D> {
    /// Whether the standard deviation is to be estimated.
    fn is_unknown(&self, instant: &Instant<'_>) -> bool {
        self.places.iter().any(|&at| instant.sigmas[at].is_nan())
    }

    /// Collects what was measured, station by station.
    fn read(&mut self, instant: &Instant<'_>) {
        self.measurements.clear();
        self.places.clear();
        (self.start, self.first) = (None, None);
        let mut extent = 0.0_f64;
        let Instant { stations, axes, values, sigmas, .. } = *instant;
        read(stations, axes, values, sigmas, |place, m: Measurement<D>| {
            if !m.kind.is_angle() {
                extent = extent.max(m.value.abs());
            }
            extent = extent.max(norm(&m.station));
            self.measurements.push(m);
            self.places.push(place);
        });
        self.extent = extent;
    }
}

impl<const D: usize> Search<'_, D> {
    /// The best minimum, if no other explains the measurements as well.
    fn minimum(
        &self,
        initial: Option<Vector<D>>,
        candidates: &mut Candidates<D>,
        costs: &mut Vec<f64>,
        scratch: &mut Vec<f64>,
    ) -> Result<Minimum<D>, Problem> {
        if let Some(start) = initial {
            return Ok(self.refine(start, scratch));
        }
        let count = self.problem.measurements.len() as f64;
        let [few, more] = TRUSTED_FAULTS.map(|faults| faults * TUKEY * TUKEY / 6.0);
        let limits = [0.5 * count + few, 0.5 * (count - D as f64) + more];
        if let Some(minimum) = self.first.filter(|minimum| self.is_trusted(minimum, limits[0])) {
            return Ok(minimum);
        }
        let middle = candidates.middle(self.problem.measurements);
        if let Some(start) = middle.filter(|_| !self.unknown) {
            let minimum = self.first.unwrap_or_else(|| self.refine_steadily(start));
            if self.is_trusted(&minimum, limits[0]) {
                return Ok(minimum);
            }
            let best = self.best(&candidates.points, costs, scratch);
            let other = best.map(|at| self.refine(candidates.points[at], scratch));
            let better = |other: &Minimum<D>| other.normal.cost < minimum.normal.cost;
            let minimum = other.filter(better).unwrap_or(minimum);
            if self.is_trusted(&minimum, limits[1]) {
                return Ok(minimum);
            }
        }
        candidates.read(self.problem.measurements);
        candidates.all(self.problem.extent);
        let points = &mut candidates.points;
        let Some(start) = self.best(points, costs, scratch) else {
            return Err(Problem::NoIntersection);
        };
        let minimum = self.refine(points[start], scratch);
        self.rivalled(minimum, points, costs, scratch)
    }

    /// Whether a minimum needs no other starts: it costs less than so much.
    fn is_trusted(&self, minimum: &Minimum<D>, limit: f64) -> bool {
        let hardly = self.loss == Loss::Square || minimum.normal.cost < limit;
        minimum.end == End::Converged && hardly
    }

    /// Index of the point with the least cost, and the costs of all.
    fn best(
        &self,
        points: &[Vector<D>],
        costs: &mut Vec<f64>,
        scratch: &mut Vec<f64>,
    ) -> Option<usize> {
        costs.clear();
        for point in points {
            costs.push(match self.loss {
                Loss::Tukey(_) if self.unknown => self.median_scale(point, scratch),
                loss => self.problem.cost(point, loss, 1.0),
            });
        }
        least(costs)
    }

    /// Goes down from a start that is trusted: Huber's steps are not compared with it.
    fn refine_steadily(&self, start: Vector<D>) -> Minimum<D> {
        let (mut position, scale) = (start, 1.0);
        let mut run = |loss, steps, tolerance| {
            self.problem.descend(&mut position, loss, scale, steps, tolerance)
        };
        let (end, normal) = if self.loss == Loss::Square {
            run(self.loss, STEPS, TOLERANCE)
        } else {
            run(Loss::Huber(HUBER), HUBER_STEPS, HUBER_TOLERANCE);
            run(self.loss, TUKEY_STEPS, TUKEY_TOLERANCE)
        };
        Minimum { position, normal, end, scale }
    }

    /// Goes down from a start.
    fn refine(&self, start: Vector<D>, scratch: &mut Vec<f64>) -> Minimum<D> {
        let mut position = start;
        if self.loss == Loss::Square {
            let (end, normal) =
                self.problem.descend(&mut position, self.loss, 1.0, STEPS, TOLERANCE);
            return Minimum { position, normal, end, scale: 1.0 };
        }
        let mut scale = 1.0;
        for _ in 0..if self.unknown { HUBER_STEPS } else { 1 } {
            let steps = if self.unknown { 1 } else { HUBER_STEPS };
            if self.unknown {
                scale = self.median_scale(&position, scratch);
            }
            let huber = Loss::Huber(HUBER);
            self.problem.descend(&mut position, huber, scale, steps, HUBER_TOLERANCE);
        }
        if !self.is_better(&position, &start, scratch) {
            position = start;
        }
        if self.unknown {
            for _ in 0..RESCALINGS {
                scale = self.median_scale(&position, scratch);
                self.problem.descend(&mut position, self.loss, scale, 1, TUKEY_TOLERANCE);
            }
            scale = self.median_scale(&position, scratch);
        }
        let (end, normal) =
            self.problem.descend(&mut position, self.loss, scale, TUKEY_STEPS, TUKEY_TOLERANCE);
        Minimum { position, normal, end, scale }
    }

    /// Goes down from the start of another minimum: Huber's steps would lead to the best one.
    fn rival(&self, start: Vector<D>, scratch: &mut Vec<f64>) -> Minimum<D> {
        let few = self.problem.measurements.len() < D + RIVALRY;
        if few || self.unknown || self.loss == Loss::Square {
            return self.refine(start, scratch);
        }
        let mut position = start;
        let (end, normal) =
            self.problem.descend(&mut position, self.loss, 1.0, TUKEY_STEPS, TUKEY_TOLERANCE);
        Minimum { position, normal, end, scale: 1.0 }
    }

    fn is_better(&self, p: &Vector<D>, q: &Vector<D>, scratch: &mut Vec<f64>) -> bool {
        if self.unknown {
            // the least of many scales is too small by chance
            let factor = SMALLER_BY_CHANCE;
            return self.median_scale(p, scratch) <= factor * self.median_scale(q, scratch);
        }
        self.problem.cost(p, self.loss, 1.0) <= self.problem.cost(q, self.loss, 1.0)
    }

    /// σ from the size of the residual of the middle of those that a fit does not make small, with
    /// the correction of Rousseeuw and Leroy (1987) for few measurements.
    fn median_scale(&self, p: &Vector<D>, scratch: &mut Vec<f64>) -> f64 {
        scratch.clear();
        scratch.extend(self.problem.measurements.iter().map(|m| m.row(p).residual.abs()));
        if scratch.iter().any(|r| r.is_nan()) {
            return f64::INFINITY;
        }
        let count = scratch.len();
        let at = (count + D).div_ceil(2) - 1;
        let (_, &mut size, _) = scratch.select_nth_unstable_by(at, f64::total_cmp);
        let correction = 1.0 + FEW / (count - D) as f64;
        (correction * size / NORMAL_MEDIAN).max(f64::MIN_POSITIVE.sqrt())
    }

    /// The better of a minimum and those that other candidates lead to; an error if two are
    /// equally good.
    fn rivalled(
        &self,
        mut best: Minimum<D>,
        points: &mut [Vector<D>],
        costs: &mut Vec<f64>,
        scratch: &mut Vec<f64>,
    ) -> Result<Minimum<D>, Problem> {
        if best.scale != 1.0 {
            costs.clear();
            costs.extend(points.iter().map(|p| self.problem.cost(p, self.loss, best.scale)));
        }
        let mut rival: Option<Minimum<D>> = None;
        for _ in 0..RIVALS {
            for minimum in [Some(best), rival].into_iter().flatten() {
                for (point, cost) in points.iter().zip(costs.iter_mut()) {
                    if minimum.is_same(point) {
                        *cost = f64::INFINITY;
                    }
                }
            }
            let count = self.problem.measurements.len() as f64;
            let limit = 2.0 * best.normal.cost + AMBIGUOUS + count + 10.0;
            let Some(at) = least(costs).filter(|&at| costs[at] < limit) else { break };
            costs[at] = f64::INFINITY;
            let mut other = self.rival(points[at], scratch);
            if other.end != End::Converged || best.is_same(&other.position) {
                continue;
            }
            if other.scale != best.scale {
                other.normal = self.problem.normal(&other.position, self.loss, best.scale);
            }
            if other.normal.cost < best.normal.cost || best.end != End::Converged {
                (best, other) = (other, best);
            }
            let closer = |r: &Minimum<D>| r.normal.cost > other.normal.cost;
            if other.end == End::Converged && rival.as_ref().is_none_or(closer) {
                rival = Some(other);
            }
        }
        match rival {
            Some(rival) if rival.normal.cost < best.normal.cost + AMBIGUOUS => {
                Err(Problem::Ambiguous)
            }
            _ => Ok(best),
        }
    }

    /// Whether a measurement has no direction within this share of the extent.
    fn is_blind(&self, p: &Vector<D>, share: f64) -> bool {
        let near = share * self.problem.extent;
        self.problem.measurements.iter().any(|m| m.is_blind(p, near))
    }

    /// Fails where a minimum is none, or not one point.
    fn checked(&self, minimum: Minimum<D>) -> Result<Minimum<D>, Problem> {
        let p = &minimum.position;
        if self.is_blind(p, NEAR) {
            return Err(Problem::AtStation);
        }
        let exact = self.problem.measurements.len() == D;
        if exact && (minimum.normal.cost.is_nan() || minimum.normal.cost > MEETING) {
            return Err(Problem::NoIntersection);
        }
        match minimum.end {
            End::Diverged => return Err(Problem::NoIntersection),
            End::Singular => return Err(Problem::Singular),
            End::Moving if self.is_blind(p, APPROACHED) => return Err(Problem::AtStation),
            End::Moving => return Err(Problem::NotConverged),
            End::Converged => {}
        }
        // without a scale there is no covariance, but a position
        let scaled = !minimum.scale.is_nan();
        if scaled && Factor::try_new(&minimum.normal.matrix, 0.0).is_none() {
            return Err(Problem::Singular);
        }
        Ok(minimum)
    }

    /// Lenth's estimate, from the least-squares position.
    fn lenth(
        &self,
        initial: Option<Vector<D>>,
        weight: Weight,
        candidates: &mut Candidates<D>,
        costs: &mut Vec<f64>,
        scratch: &mut Vec<f64>,
    ) -> Result<Minimum<D>, Problem> {
        let start = self.checked(self.minimum(initial, candidates, costs, scratch)?)?;
        let measurements = self.problem.measurements;
        if self.unknown && measurements.len() == D {
            // nothing is left to estimate κ from
            let mut minimum = Minimum { scale: f64::NAN, ..start };
            minimum.normal.matrix = undetermined();
            return Ok(minimum);
        }
        let known = (!self.unknown).then(|| measurements[0].precision.powi(2));
        let estimate = lenth::estimate(measurements, start.position, known, weight);
        let mut normal = self.problem.normal(&estimate.position, Loss::Square, 1.0);
        normal.matrix = estimate.covariance.ok_or(Problem::Singular)?;
        let end = if estimate.converged { End::Converged } else { End::Moving };
        let scale = if self.unknown { 1.0 / estimate.kappa.sqrt() } else { 1.0 };
        Ok(Minimum { position: estimate.position, normal, end, scale })
    }

    /// Covariance, σ and dilution, from residuals and their derivatives.
    fn summary(&self, minimum: &Minimum<D>, lenth: Option<Weight>, rows: &[Row<D>]) -> Summary<D> {
        let robust = self.loss != Loss::Square;
        let fault = match lenth {
            Some(Weight::Andrews) => lenth::ZERO,
            None if robust => TUKEY,
            _ => f64::INFINITY,
        };
        let reciprocal = 1.0 / minimum.scale;
        let mut spread = Spread::of(self.problem.measurements);
        let (mut sum, mut total) = (0.0, 0.0);
        for (m, row) in self.problem.measurements.iter().zip(rows) {
            let u = row.residual * reciprocal;
            let (weight, ..) = self.loss.at(u);
            sum += weight * u * u;
            total += weight;
            spread.add(m, row, u.abs() < fault);
        }
        let dilution = spread.dilution();
        if lenth.is_some() {
            let covariance = minimum.normal.matrix;
            return Summary { covariance, sigma: minimum.scale, fault, dilution };
        }
        let inverse = Factor::try_new(&minimum.normal.matrix, 0.0)
            .map_or_else(undetermined, |factor| factor.inverse());
        let of =
            |sigma: f64| if robust { Expected::of_tukey(sigma) } else { Expected::of_square() };
        let mut sigma = 1.0;
        if self.unknown {
            let rest = total - D as f64;
            if rest < LEAST_REST {
                return Summary { covariance: undetermined(), sigma: f64::NAN, fault, dilution };
            }
            sigma = (sum / rest).sqrt();
            for _ in 0..SPREAD_STEPS {
                sigma = (sum / rest / of(sigma).spread).sqrt();
            }
        }
        let factor = of(sigma).variance * sigma * sigma;
        let mut covariance = inverse.map(|row| row.map(|v| v * factor));
        if robust {
            let rows = rows.iter().map(|row| {
                let row = row.scaled(reciprocal);
                (row, self.loss.at(row.residual).0)
            });
            add(&mut covariance, &doubt(rows, &inverse));
        }
        Summary { covariance, sigma: minimum.scale * sigma, fault, dilution }
    }
}

/// What Tukey's weights do to normal errors of some σ, in units of the scale.
struct Expected {
    /// `E w E ψ² / (E ψ')² / σ²`: the variance of an estimate over `σ² / Σ w`.
    variance: f64,
    /// `E w r² / E w / σ²`
    spread: f64,
}

impl Expected {
    fn of_square() -> Self {
        Self { variance: 1.0, spread: 1.0 }
    }

    /// Moments of the normal distribution; what is beyond c is left out, less than 1e-5 up to σ = 1.
    fn of_tukey(sigma: f64) -> Self {
        let q = (sigma.min(1.0) / TUKEY).powi(2);
        let weight = 1.0 - 2.0 * q + 3.0 * q * q;
        // E w r² and E ψ' are the same
        let slope = 1.0 - 6.0 * q + 15.0 * q * q;
        let square = 1.0 - 12.0 * q + 90.0 * q * q - 420.0 * q.powi(3) + 945.0 * q.powi(4);
        Self { variance: weight * square / (slope * slope), spread: slope / weight }
    }
}

/// What is made of a minimum.
struct Summary<const D: usize> {
    covariance: Matrix<D>,
    sigma: f64,
    /// Residuals from here on have no weight.
    fault: f64,
    dilution: f64,
}

impl<const D: usize> Minimum<D> {
    fn of(arrival: Arrival<D>) -> Self {
        let Arrival { position, matrix, cost } = arrival;
        let normal = Normal::at_minimum(matrix, cost);
        Self { position, normal, end: End::Converged, scale: 1.0 }
    }

    /// Whether a point is within the error of this one.
    fn is_same(&self, point: &Vector<D>) -> bool {
        let difference = std::array::from_fn(|i| point[i] - self.position[i]);
        quadratic(&self.normal.matrix, &difference) <= SAME_MINIMUM
    }
}

/// Index of the least number that is finite.
fn least(costs: &[f64]) -> Option<usize> {
    let finite = costs.iter().enumerate().filter(|(_, cost)| cost.is_finite());
    finite.min_by(|a, b| a.1.total_cmp(b.1)).map(|(at, _)| at)
}

/// The information of errors of size 1, where their unit is the same.
struct Spread<const D: usize> {
    matrix: Matrix<D>,
    mixed: bool,
}

impl<const D: usize> Spread<D> {
    fn of(measurements: &[Measurement<D>]) -> Self {
        let angles = measurements.iter().filter(|m| m.kind.is_angle()).count();
        let mixed = angles != 0 && angles != measurements.len();
        Self { matrix: [[0.0; D]; D], mixed }
    }

    fn add(&mut self, m: &Measurement<D>, row: &Row<D>, counts: bool) {
        if self.mixed || !counts {
            return;
        }
        let square = 1.0 / (m.precision * m.precision);
        for i in 0..D {
            for j in 0..=i {
                self.matrix[i][j] += square * row.gradient[i] * row.gradient[j];
            }
        }
    }

    /// Root of the trace of the covariance; nan where units are mixed.
    fn dilution(&self) -> f64 {
        if self.mixed {
            return f64::NAN;
        }
        let Some(factor) = Factor::try_new(&self.matrix, 0.0) else { return f64::INFINITY };
        let inverse = factor.inverse();
        (0..D).map(|i| inverse[i][i]).sum::<f64>().sqrt()
    }
}
