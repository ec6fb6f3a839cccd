//! Search for the minimum that explains an instant best: start, robust steps, other minima.

pub(super) mod arrivals;
mod candidates;
pub(super) mod fix;
pub(super) mod lenth;
pub(super) mod mirror;

use super::descent::minimum::Minimum;
use super::descent::starts;
use super::descent::{self, Cost, End, HUBER, HUBER_STEPS, Loss, NEAR, TOLERANCE, TUKEY_TOLERANCE};
use crate::base::small::{Factor, Vector, undetermined};
use crate::sensors::{Kind, Measurement};
use candidates::Candidates;
use fix::Status;
use lenth::Weight;
use mirror::Side;

const STEPS: usize = 100;
const HUBER_TOLERANCE: f64 = 0.1;
const TUKEY_STEPS: usize = 50;
const RESCALINGS: usize = 12;
/// A start is better than the result of Huber's steps only if its scale is smaller by more than this
/// factor.
const SMALLER_BY_CHANCE: f64 = 2.0;
/// Correction of a scale for few measurements: 1 + FEW / (M − N).
const FEW: f64 = 5.0;
/// Median of the absolute value of a standard normal number.
const NORMAL_MEDIAN: f64 = 0.674_489_750_196_081_7;
/// Minima whose likelihoods differ by less than a factor of 20 cannot be told apart: ln 20.
const AMBIGUOUS: f64 = 2.995_732_273_553_991;
/// Largest number of other minima that are searched for.
const RIVALS: usize = 3;
/// The same if outliers are frequent.
const RIVALS_OF_MANY: usize = 8;
/// Number of faults up to which a minimum is accepted without a search for others, if the start is the
/// median of the stations' fixes.
const TRUSTED_FAULTS: f64 = 2.0;
/// How much more a point may cost than the minimum it leads to: for few measurements, and
/// ([`SLACK_OF_MANY`]) for [`MANY`] or more.
const SLACK: f64 = 10.0;
const SLACK_OF_MANY: f64 = 4.0;
const MANY: usize = 8;
/// Degrees of freedom from which on every start may lead to its own minimum. With fewer, any few
/// measurements would form one, so only the minima that Huber's steps lead to count.
const RIVALRY: usize = 4;
/// A descent that is still moving within this share of the extent from a station would end at the station:
/// close to it, the azimuth can take any value.
const APPROACHED: f64 = 1e-2;
/// Largest cost of a point at which as many measurements as unknowns meet.
const MEETING: f64 = 1e-6;

/// Search for the position of one instant. The state has D coordinates and, if there are arrivals, their
/// emission.
pub(super) struct Search<'a, const D: usize, const N: usize> {
    pub problem: descent::Problem<'a, D, N>,
    pub loss: Loss,
    pub unknown: bool,
    /// A start, and the minimum to which it led.
    pub start: Option<Vector<N>>,
    pub first: Option<Minimum<N>>,
    /// Whether the better of two minima is taken even if the other one is nearly as good.
    pub decides: bool,
    /// The likely side of the stations, and the origin of positions.
    pub side: Option<(Side, Vector<D>)>,
}

/// Buffers of a search.
#[derive(Debug, Default)]
pub(super) struct Buffers<const D: usize, const N: usize> {
    pub candidates: Candidates<D>,
    points: Vec<Vector<N>>,
    costs: Vec<f64>,
    pub scratch: Vec<f64>,
}

impl<const D: usize, const N: usize> Search<'_, D, N> {
    /// Returns the best minimum, or an error if another one explains the measurements as well. If the start
    /// is the best of several points, these and their costs are given; otherwise both are empty.
    pub fn minimum(
        &self,
        initial: Option<Vector<D>>,
        (own, own_costs): (&[Vector<N>], &[f64]),
        buffers: &mut Buffers<D, N>,
    ) -> Result<Minimum<N>, Status> {
        let Buffers { candidates, points, costs, scratch } = buffers;
        let measurements = self.problem.measurements;
        if let Some(start) = initial {
            let start = state(measurements, &start, scratch);
            return Ok(self.refine(start, scratch));
        }
        let first = self.start.map(|s| self.first.unwrap_or_else(|| self.refine_steadily(s)));
        points.clear();
        points.extend_from_slice(own);
        costs.clear();
        costs.extend_from_slice(own_costs);
        if points.is_empty() {
            if let Some(minimum) = first.filter(|minimum| self.is_trusted(minimum)) {
                return Ok(minimum);
            }
            candidates.find(measurements, self.problem.extent);
            states(measurements, &candidates.points, points, scratch);
            points.extend(self.start);
            self.cost_all(points, costs, scratch);
        }
        let at = least(costs).ok_or(Status::NoIntersection)?;
        let better = |minimum: &Minimum<N>| minimum.normal.cost <= costs[at];
        let converged = first.filter(|first| first.end == End::Converged);
        let minimum = match converged.filter(better) {
            Some(minimum) => minimum,
            None => self.refine(points[at], scratch),
        };
        let most =
            0.5 * (measurements.len() as f64 - N as f64) + TRUSTED_FAULTS * self.loss.of_fault();
        let from_most = N == D && own.is_empty() && self.start.is_some();
        let is_likely = self.prior(&minimum.state) == 0.0;
        if from_most && is_likely && minimum.end == End::Converged && minimum.normal.cost < most {
            return Ok(minimum);
        }
        let candidates = points.len();
        let has_images = |m: &Measurement<D>| m.kind.is_difference() || m.kind == Kind::Elevation;
        if self.side.is_some() || measurements.iter().any(has_images) {
            points.extend(mirror::images::<D, N>(measurements, &minimum.state));
            let cost = |point| self.problem.cost(point, self.loss, minimum.scale);
            costs.extend(points[candidates..].iter().map(cost));
        }
        self.rivalled(minimum, (points, candidates), costs, scratch)
    }

    /// Whether the minimum reached from a start that most measurements support needs no other starts.
    fn is_trusted(&self, minimum: &Minimum<N>) -> bool {
        if minimum.end != End::Converged || self.prior(&minimum.state) > 0.0 {
            return false;
        }
        if self.loss == Loss::SQUARE && N == D {
            return true;
        }
        let count = self.problem.measurements.len();
        let cost = minimum.normal.cost;
        if N > D {
            let hardly = self.loss == Loss::SQUARE || {
                cost < arrivals::trusted_cost(count, N, self.loss.of(Kind::Arrival).evidence(1.0))
            };
            return hardly && self.start.is_some() && self.tells_sides(minimum);
        }
        let fault = self.loss.of_fault();
        cost < 0.5 * count as f64 + fault || cost + AMBIGUOUS < fault * self.agreeing(minimum)
    }

    /// Returns the number of stations without a fault. At any other position each of them would have at
    /// least one, provided that each station alone determines a position.
    fn agreeing(&self, minimum: &Minimum<N>) -> f64 {
        let stations = self.problem.measurements.chunk_by(|a, b| a.index == b.index);
        let agrees = |m: &Measurement<D>| {
            !self.loss.of(m.kind).is_fault(m.row_at(&minimum.state).residual / minimum.scale)
        };
        stations.filter(|station| station.iter().all(agrees)).count() as f64
    }

    /// Whether the mirror images of a minimum explain the measurements so badly that no descent from them
    /// would lead to another minimum nearly as good.
    fn tells_sides(&self, minimum: &Minimum<N>) -> bool {
        let mut images = mirror::images(self.problem.measurements, &minimum.state);
        let cost = |image| self.problem.cost(&image, self.loss, minimum.scale);
        images.all(|image| cost(image) > minimum.normal.cost + AMBIGUOUS + SLACK)
    }

    /// Computes the costs of points, or the scales of their residuals if σ is unknown.
    fn cost_all(&self, points: &[Vector<N>], costs: &mut Vec<f64>, scratch: &mut Vec<f64>) {
        if self.loss == Loss::SQUARE || !self.unknown {
            starts::costs(self.problem.measurements, points, self.loss, costs);
        } else {
            costs.clear();
            costs.extend(points.iter().map(|point| self.median_scale(point, scratch)));
        }
    }

    /// Descends from a trusted start: the result of Huber's steps is not compared with it.
    pub fn refine_steadily(&self, start: Vector<N>) -> Minimum<N> {
        let (mut state, scale) = (start, 1.0);
        let mut run = |loss, steps, tolerance| {
            self.problem.descend(&mut state, loss, scale, steps, tolerance)
        };
        let (end, normal) = if self.loss == Loss::SQUARE {
            run(self.loss, STEPS, TOLERANCE)
        } else {
            run(Loss::Alike(Cost::Huber(HUBER)), HUBER_STEPS, HUBER_TOLERANCE);
            run(self.loss, TUKEY_STEPS, TUKEY_TOLERANCE)
        };
        Minimum { state, normal, end, scale, others: [[0.0; N]; N] }
    }

    /// Descends from a start.
    fn refine(&self, start: Vector<N>, scratch: &mut Vec<f64>) -> Minimum<N> {
        let mut state = start;
        if self.loss == Loss::SQUARE {
            let (end, normal) = self.problem.descend(&mut state, self.loss, 1.0, STEPS, TOLERANCE);
            return Minimum { state, normal, end, scale: 1.0, others: [[0.0; N]; N] };
        }
        let mut scale = 1.0;
        for _ in 0..if self.unknown { HUBER_STEPS } else { 1 } {
            let steps = if self.unknown { 1 } else { HUBER_STEPS };
            if self.unknown {
                scale = self.median_scale(&state, scratch);
            }
            let huber = Loss::Alike(Cost::Huber(HUBER));
            self.problem.descend(&mut state, huber, scale, steps, HUBER_TOLERANCE);
        }
        if !self.is_better(&state, &start, scratch) {
            state = start;
        }
        if self.unknown {
            for _ in 0..RESCALINGS {
                scale = self.median_scale(&state, scratch);
                self.problem.descend(&mut state, self.loss, scale, 1, TUKEY_TOLERANCE);
            }
            scale = self.median_scale(&state, scratch);
        }
        let (end, normal) =
            self.problem.descend(&mut state, self.loss, scale, TUKEY_STEPS, TUKEY_TOLERANCE);
        Minimum { state, normal, end, scale, others: [[0.0; N]; N] }
    }

    /// Descends from the start of another minimum, where Huber's steps would lead to the best one. The mirror
    /// image of a minimum to which Huber's steps led needs none.
    fn rival(&self, start: Vector<N>, is_image: bool, scratch: &mut Vec<f64>) -> Minimum<N> {
        let few =
            !is_image && self.problem.measurements.len() < N + RIVALRY && !self.tells_many_apart();
        if few || self.unknown || self.loss == Loss::SQUARE {
            return self.refine(start, scratch);
        }
        let mut state = start;
        let (end, normal) =
            self.problem.descend(&mut state, self.loss, 1.0, TUKEY_STEPS, TUKEY_TOLERANCE);
        Minimum { state, normal, end, scale: 1.0, others: [[0.0; N]; N] }
    }

    /// Whether every set of measurements that agree may be the right one. This does not apply to arrivals:
    /// with the emission as an unknown, more of them agree by chance.
    fn tells_many_apart(&self) -> bool {
        N == D && self.loss.expects_many()
    }

    fn is_better(&self, p: &Vector<N>, q: &Vector<N>, scratch: &mut Vec<f64>) -> bool {
        if self.unknown {
            // the smallest of many scales is too small by chance
            let factor = SMALLER_BY_CHANCE;
            return self.median_scale(p, scratch) <= factor * self.median_scale(q, scratch);
        }
        self.problem.cost(p, self.loss, 1.0) <= self.problem.cost(q, self.loss, 1.0)
    }

    /// Estimates σ from the ⌈(M + N)/2⌉-th smallest residual, the middle one of those that a fit does not
    /// make small, with the correction of Rousseeuw and Leroy (1987) for few measurements.
    fn median_scale(&self, x: &Vector<N>, scratch: &mut Vec<f64>) -> f64 {
        scratch.clear();
        scratch.extend(self.problem.measurements.iter().map(|m| m.row_at(x).residual.abs()));
        if scratch.iter().any(|r| r.is_nan()) {
            return f64::INFINITY;
        }
        let count = scratch.len();
        let at = (count + N).div_ceil(2) - 1;
        let (_, &mut size, _) = scratch.select_nth_unstable_by(at, f64::total_cmp);
        let correction = 1.0 + FEW / (count - N) as f64;
        (correction * size / NORMAL_MEDIAN).max(f64::MIN_POSITIVE.sqrt())
    }

    /// Returns the best of a minimum and those that other candidates lead to, or an error if two are
    /// equally good. From the number `candidates` on, points are mirror images of the minimum.
    fn rivalled(
        &self,
        mut best: Minimum<N>,
        (points, candidates): (&[Vector<N>], usize),
        costs: &mut Vec<f64>,
        scratch: &mut Vec<f64>,
    ) -> Result<Minimum<N>, Status> {
        if best.scale != 1.0 {
            costs.clear();
            costs.extend(points.iter().map(|p| self.problem.cost(p, self.loss, best.scale)));
        }
        let own = points.iter().zip(costs.iter()).filter(|(point, _)| best.is_same(point));
        let nearest = own.map(|(_, &cost)| cost).fold(f64::INFINITY, f64::min);
        for (point, cost) in points.iter().zip(costs.iter_mut()) {
            *cost += self.prior(point);
        }
        let mut rival: Option<Minimum<N>> = None;
        let mut found = [None; RIVALS_OF_MANY];
        let rivals = if self.tells_many_apart() { RIVALS_OF_MANY } else { RIVALS };
        for slot in &mut found[..rivals] {
            for minimum in [Some(best), rival].into_iter().flatten() {
                let prior = self.prior(&minimum.state);
                for (point, cost) in points.iter().zip(costs.iter_mut()) {
                    if minimum.is_below(point, *cost - prior) {
                        *cost = f64::INFINITY;
                    }
                }
            }
            let limit = self.posterior(&best) + AMBIGUOUS + self.slack(&best, nearest);
            let Some(at) = least(costs).filter(|&at| costs[at] < limit) else { break };
            costs[at] = f64::INFINITY;
            let mut other = self.rival(points[at], at >= candidates, scratch);
            if other.end != End::Converged || best.is_same(&other.state) {
                continue;
            }
            if other.scale != best.scale {
                other.normal = self.problem.normal(&other.state, self.loss, best.scale);
            }
            if self.posterior(&other) < self.posterior(&best) || best.end != End::Converged {
                (best, other) = (other, best);
            }
            *slot =
                Some((other.state, self.posterior(&other))).filter(|_| other.end == End::Converged);
            let closer = |r: &Minimum<N>| self.posterior(r) > self.posterior(&other);
            if other.end == End::Converged && rival.as_ref().is_none_or(closer) {
                rival = Some(other);
            }
        }
        let least = self.posterior(&best);
        match rival {
            Some(rival) if !self.decides && self.posterior(&rival) < least + AMBIGUOUS => {
                Err(Status::Ambiguous)
            }
            _ if self.loss.expects_many() => {
                best.allow_for(found.iter().flatten(), least);
                Ok(best)
            }
            _ => Ok(best),
        }
    }

    /// Returns the prior cost of a state, which is 0 on the likely side of the stations.
    fn prior(&self, state: &Vector<N>) -> f64 {
        self.side.map_or(0.0, |(side, origin)| side.cost(&state[..D], &origin))
    }

    fn posterior(&self, minimum: &Minimum<N>) -> f64 {
        minimum.normal.cost + self.prior(&minimum.state)
    }

    /// Returns how much more a point costs, as a rule at most, than the minimum it leads to. With many
    /// measurements, this is not much more than the excess of the cheapest point (`nearest`) of the best
    /// minimum.
    fn slack(&self, best: &Minimum<N>, nearest: f64) -> f64 {
        let count = self.problem.measurements.len();
        let most = best.normal.cost + count as f64 + SLACK;
        if count < MANY || self.unknown || self.loss == Loss::SQUARE {
            return most;
        }
        most.min(SLACK_OF_MANY + 2.0 * (nearest - best.normal.cost))
    }

    /// Whether a point is so close to a station, within this share of the extent, that its direction is
    /// undefined.
    fn is_blind(&self, p: &Vector<D>, share: f64) -> bool {
        let near = share * self.problem.extent;
        self.problem.measurements.iter().any(|m| m.is_blind(p, near))
    }

    /// Returns an error if a descent did not end at a minimum, or if the minimum is not a single point.
    pub fn checked(&self, minimum: Minimum<N>) -> Result<Minimum<N>, Status> {
        let p = &position(&minimum.state);
        if self.is_blind(p, NEAR) {
            return Err(Status::AtStation);
        }
        let exact = self.problem.measurements.len() == N;
        if exact && (minimum.normal.cost.is_nan() || minimum.normal.cost > MEETING) {
            return Err(Status::NoIntersection);
        }
        match minimum.end {
            End::Diverged => return Err(Status::NoIntersection),
            End::Singular => return Err(Status::Singular),
            End::Moving if self.is_blind(p, APPROACHED) => return Err(Status::AtStation),
            End::Moving => return Err(Status::NotConverged),
            End::Converged => {}
        }
        // without a scale there is a position, but no covariance
        let scaled = !minimum.scale.is_nan();
        if scaled && Factor::try_new(&minimum.normal.matrix, 0.0).is_none() {
            return Err(Status::Singular);
        }
        Ok(minimum)
    }

    /// Returns Lenth's estimate, starting from the least-squares position.
    pub fn lenth(
        &self,
        initial: Option<Vector<D>>,
        weight: Weight,
        buffers: &mut Buffers<D, N>,
    ) -> Result<Minimum<N>, Status> {
        let start = self.checked(self.minimum(initial, (&[], &[]), buffers)?)?;
        let measurements = self.problem.measurements;
        if self.unknown && measurements.len() == N {
            // no redundancy from which κ could be estimated
            let mut minimum = Minimum { scale: f64::NAN, ..start };
            minimum.normal.matrix = undetermined();
            return Ok(minimum);
        }
        let known = (!self.unknown).then(|| measurements[0].precision.powi(2));
        let estimate = lenth::estimate(measurements, position(&start.state), known, weight);
        let mut state = start.state;
        state[..D].copy_from_slice(&estimate.position);
        let mut normal = self.problem.normal(&state, Loss::SQUARE, 1.0);
        for (row, own) in normal.matrix.iter_mut().zip(estimate.covariance.ok_or(Status::Singular)?)
        {
            row[..D].copy_from_slice(&own);
        }
        let end = if estimate.converged { End::Converged } else { End::Moving };
        let scale = if self.unknown { 1.0 / estimate.kappa.sqrt() } else { 1.0 };
        Ok(Minimum { state, normal, end, scale, others: [[0.0; N]; N] })
    }
}

/// Returns the coordinates of a state.
pub(super) fn position<const D: usize, const N: usize>(state: &Vector<N>) -> Vector<D> {
    std::array::from_fn(|i| state[i])
}

/// Returns a position with the emission that the arrivals have there.
fn state<const D: usize, const N: usize>(
    measurements: &[Measurement<D>],
    p: &Vector<D>,
    scratch: &mut Vec<f64>,
) -> Vector<N> {
    let mut state = [0.0; N];
    state[..D].copy_from_slice(p);
    if N > D {
        state[D] = arrivals::emission(measurements, p, scratch);
    }
    state
}

/// Converts positions into states; positions that are not finite are left out.
pub(super) fn states<const D: usize, const N: usize>(
    measurements: &[Measurement<D>],
    from: &[Vector<D>],
    to: &mut Vec<Vector<N>>,
    scratch: &mut Vec<f64>,
) {
    to.clear();
    let finite = from.iter().filter(|point| point.iter().all(|v| v.is_finite()));
    to.extend(finite.map(|p| state(measurements, p, scratch)));
}

/// Returns the index of the smallest finite number, if there is one.
pub(super) fn least(costs: &[f64]) -> Option<usize> {
    let (mut at, mut least) = (None, f64::INFINITY);
    for (i, &cost) in costs.iter().enumerate() {
        if cost < least && cost > f64::NEG_INFINITY {
            (at, least) = (Some(i), cost);
        }
    }
    at
}
