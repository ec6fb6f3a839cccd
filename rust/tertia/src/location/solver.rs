//! Positions of instants: what was measured, starts that are trusted, results.

use super::block::Block;
use super::candidates::Candidates;
use super::descent::{self, HUBER_STEPS, Loss, NEAR, TOLERANCE, TUKEY, TUKEY_TOLERANCE};
use super::fix::{Fix, Instant, Method, Output, Status};
use super::growth::growth;
use super::lanes::LANES;
use super::lenth::Weight;
use super::profile::Unbounded;
use super::search::{Minimum, Search};
use super::summary::Spread;
use crate::base::distribution::chi_square_upper;
use crate::base::small::{Factor, Vector, norm, undetermined};
use crate::sensors::{Measurement, Row, read};

/// The same from a start that is trusted.
const NEAR_HUBER: f64 = 0.5;

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

/// An estimator of positions.
#[derive(Clone, Copy, Debug)]
pub struct Locator {
    method: Method,
    /// Whether covariances grow where residuals are too large.
    grows: bool,
    /// Whether they follow the cost where it is no parabola.
    profiles: bool,
}

impl Locator {
    /// An estimator by this method.
    pub fn new(method: Method) -> Self {
        Self { method, grows: false, profiles: false }
    }

    /// The same, with covariances that grow where the residuals of an instant are larger than
    /// their sigmas allow.
    pub fn growing(self) -> Self {
        Self { grows: true, ..self }
    }

    /// The same, with covariances that hold where errors are not small compared with distances, and
    /// no position where its ellipse has no end.
    pub fn profiling(self) -> Self {
        Self { profiles: true, ..self }
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
    pub(super) fn loss(&self, redundancy: usize) -> Loss {
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
        let failed = |status| Fix {
            status,
            degrees_of_freedom,
            statistic: f64::NAN,
            pvalue: f64::NAN,
            dop: f64::NAN,
            sigma: f64::NAN,
        };
        if degrees_of_freedom < 0 {
            return failed(Status::TooFew);
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
            Err(status) => return failed(status),
        };
        for (value, (p, o)) in out.position.iter_mut().zip(minimum.position.iter().zip(origin)) {
            *value = p + o;
        }
        if arrived.is_none_or(|first| first.position != minimum.position) {
            rows.clear();
            rows.extend(measurements.iter().map(|m| m.row(&minimum.position)));
        }
        let summary = search.summary(&minimum, self.lenth(), rows);
        let growth = match summary.kept {
            (square, freedom) if self.grows && !unknown => growth::<D>(square, freedom),
            _ => 1.0,
        };
        let mut covariance = summary.covariance.map(|row| row.map(|v| v * growth));
        let scale = if unknown { summary.sigma / minimum.scale } else { 1.0 };
        if self.profiles && self.lenth().is_none() {
            match search.curved(&minimum, &covariance, growth * scale * scale) {
                Ok(curved) => covariance = curved.unwrap_or(covariance),
                Err(Unbounded) => {
                    out.position.fill(f64::NAN);
                    return failed(Status::IllConditioned);
                }
            }
        }
        for (i, row) in covariance.iter().enumerate() {
            out.covariance[i * D..(i + 1) * D].copy_from_slice(row);
        }
        let mut statistic = 0.0;
        let [own, robust] = [summary.sigma, minimum.scale].map(f64::recip);
        for (row, &place) in rows.iter().zip(&*places) {
            let u = row.residual * own;
            out.residual[place] = u;
            out.outlier[place] = (row.residual * robust).abs() >= summary.fault;
            statistic += u * u;
        }
        Fix {
            statistic,
            pvalue: match unknown {
                true => f64::NAN,
                false if redundancy == 0 => 1.0,
                false => chi_square_upper(statistic, redundancy),
            },
            dop: summary.dop,
            sigma: if unknown { summary.sigma } else { f64::NAN },
            ..failed(Status::None)
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
        spread.dop()
    }
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
