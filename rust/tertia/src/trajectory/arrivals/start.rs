//! Starting point: clocks from beacons, then positions of moving identities.

use super::linear::{Group, Row};
use super::normal::Weights;
use super::problem::{Model, NU, Problem, State};
use super::scene::{Arrival, Scene};
use super::starts::Start;
use crate::base::small::{Factor, add_multiple, add_outer};

/// Largest number of steps in which the scale of the errors decreases; least factor of a decrease; first
/// scale relative to the extent.
const STEPS: usize = 25;
const SHRINK: f64 = 0.5;
const SCALE: f64 = 0.33;
/// Relative change of the scale below which it has converged.
const SETTLED: f64 = 1e-2;
/// Smallest scale for the location of single emissions, relative to the extent.
const FINEST: f64 = 1e-3;
/// Longest step relative to the extent.
const LONGEST: f64 = 0.3;
/// Drift of the clocks between nodes, relative to the extent, for the fit to beacons alone.
const WANDER: f64 = 1e-3;
/// Standard deviation of positions relative to the extent.
const FAR: f64 = 3.0;
/// Least number of arrivals from beacons with which a clock is known.
const ENOUGH: usize = 3;
/// Ratio of the standard deviation of normal errors to the median of their absolute values.
const NORMAL: f64 = 1.4826;

/// Number of neighbours on each side with which a position is compared, and number of rounds.
const NEIGHBOURS: usize = 2;
const ROUNDS: usize = 3;

/// A receiver that heard an emission: its position, and the time in metres.
type Heard<const D: usize> = ([f64; D], f64);

/// Possible position and time of an emission.
#[derive(Clone, Copy)]
struct Candidate<const D: usize> {
    position: [f64; D],
    time: f64,
    cost: f64,
}

/// An emission of a moving identity.
struct Fix<const D: usize> {
    emission: usize,
    heard: Vec<Heard<D>>,
    candidates: Vec<Candidate<D>>,
    chosen: Candidate<D>,
}

impl<const D: usize> Problem<'_, D> {
    /// Returns the starting point, and the scale of the errors there.
    pub fn start(&self, start: Start<D>) -> Result<(State<D>, f64), usize> {
        let mut state = self.origin();
        let place = match start {
            Start::Apart => self.middle,
            Start::Together(place) => place,
        };
        state.clock = self.steady(&place);
        let mut scale = FINEST * self.extent;
        let mut is_known = vec![true; self.scene.is_base.len()];
        if let Some(scene) = beacons_alone(self.scene) {
            let clocks = Problem::new(&scene, Some(self.nodes.clone()));
            let found = clocks.anneal()?;
            state.clock = found.0.clock;
            scale = found.1;
            let mut counts = vec![0; is_known.len()];
            for row in &scene.rows {
                counts[row.sensor] += 1;
            }
            is_known = counts.iter().map(|&count| count >= ENOUGH).collect();
        }
        match start {
            Start::Apart => {
                self.relocate(&mut state, &is_known, scale.max(FINEST * self.extent));
                self.emit(&mut state, |emission| self.layout.motion[emission].is_none());
            }
            Start::Together(_) => {
                state.motion.iter_mut().for_each(|motion| motion[0] = place);
                self.emit(&mut state, |_| true);
            }
        }
        let rows = self.rows(&state);
        Ok((state, self.spread(&rows)))
    }

    /// Sets the times of these emissions to those that fit the positions of their sources.
    pub fn emit(&self, state: &mut State<D>, is_meant: impl Fn(usize) -> bool) {
        let rows = self.rows(state);
        for emission in (0..self.identity.len()).filter(|&e| is_meant(e)) {
            let own = self.first[emission]..self.first[emission + 1];
            let mut off: Vec<f64> = rows[own].iter().map(|row| row.residual).collect();
            state.emission[emission] += median(&mut off);
        }
    }

    /// Returns the clocks without rates, if emissions come from about this position.
    fn steady(&self, place: &[f64; D]) -> Vec<f64> {
        let scene = self.scene;
        let k = scene.is_base.len();
        let distance = |sensor: usize| {
            let square = |i: usize| (place[i] - scene.sites[sensor][i]).powi(2);
            (0..D).map(square).sum::<f64>().sqrt()
        };
        let base = scene.is_base.iter().position(|&is_base| is_base).map_or(0.0, distance);
        let at = |node: usize| {
            let (sensor, line) = (node % k, &scene.lines[node % k]);
            let rate = line.rate * (self.nodes[node / k] - line.corrected(line.origin));
            let own = base - distance(sensor) - rate * scene.speed;
            if scene.is_base[sensor] { 0.0 } else { own }
        };
        (0..k * self.nodes.len()).map(at).collect()
    }

    /// Locates the emissions of moving identities anew, each on its own with the present clocks, unless the
    /// present position fits best. `finest` is the size of the residuals.
    pub fn relocate(&self, state: &mut State<D>, is_known: &[bool], finest: f64) {
        let mut fixes: Vec<Vec<Fix<D>>> = (0..self.unit.len()).map(|_| Vec::new()).collect();
        for emission in (0..self.identity.len()).filter(|&e| self.layout.motion[e].is_some()) {
            let heard = self.heard(state, emission, is_known);
            let mut candidates = vec![self.descent(&heard, state.motion[emission][0], finest)];
            candidates.extend(self.candidates(&heard, finest));
            self.keep_beside(&mut candidates, &heard, finest);
            let chosen = *least(&candidates, |one| one.cost);
            fixes[self.identity[emission]].push(Fix { emission, heard, candidates, chosen });
        }
        for fixes in &mut fixes {
            for _ in 0..ROUNDS {
                self.choose(fixes, finest);
            }
            for fix in fixes {
                state.motion[fix.emission][0] = fix.chosen.position;
                state.emission[fix.emission] = state.slowness * fix.chosen.time;
            }
        }
    }

    /// Returns the scale of the residuals, in units of the given standard deviations.
    fn spread(&self, rows: &[Row]) -> f64 {
        let sigma = |arrival: &Arrival| self.scene.sigma[arrival.sensor];
        let sizes = rows.iter().zip(&self.scene.rows);
        let mut sizes: Vec<f64> =
            sizes.map(|(row, arrival)| (row.residual / sigma(arrival)).abs()).collect();
        (NORMAL * median(&mut sizes)).max(1e-12 * self.extent)
    }

    /// Estimates the clocks of a scene of beacons robustly.
    fn anneal(&self) -> Result<(State<D>, f64), usize> {
        let mut state = self.origin();
        let span = self.nodes[self.nodes.len() - 1] - self.nodes[0];
        let step = span / self.nodes.len() as f64;
        let drift = WANDER * self.extent / step.max(f64::MIN_POSITIVE).powf(1.5);
        let sigmas = &self.scene.sigma;
        let finest = sigmas.iter().copied().fold(f64::INFINITY, f64::min);
        let scale = SCALE * self.extent / finest;
        let identities = self.unit.len();
        let (jerk, acceleration) = (vec![1.0; identities], vec![0.0; identities]);
        let mut model = Model { scale, path: 1.0, drift, jerk, acceleration };
        let mut envelope = None;
        for _ in 0..STEPS {
            let (rows, priors): (Vec<Row>, Vec<(Row, Group)>) =
                (self.rows(&state), self.priors(&state));
            let weights = Weights::new(self, &rows, model.scale, 1.0);
            let empty = envelope.take().unwrap_or_else(|| self.envelope(&rows, &priors));
            let mut normal = self.normal(empty, &rows, &weights, &priors, &model);
            let (step, emission, _) = normal.step()?;
            state = self.moved(&state, &step, &emission, 1.0);
            envelope = Some(normal.matrix);
            let before = model.scale;
            model.scale = self.spread(&self.rows(&state)).max(SHRINK * before);
            if (model.scale / before - 1.0).abs() < SETTLED {
                break;
            }
        }
        Ok((state, model.scale * finest))
    }

    /// Returns the receivers that heard an emission, if possible only those whose clocks are known.
    fn heard(&self, state: &State<D>, emission: usize, is_known: &[bool]) -> Vec<Heard<D>> {
        let all = self.first[emission]..self.first[emission + 1];
        let sensor = |at: usize| self.scene.rows[at].sensor;
        let mut used: Vec<usize> = all.clone().filter(|&at| is_known[sensor(at)]).collect();
        if used.len() <= D {
            used = all.collect();
        }
        let time = |at: usize| {
            (self.scene.rows[at].time * self.scene.speed - self.clock(state, at)) / state.slowness
        };
        used.into_iter().map(|at| (state.site[sensor(at)], time(at))).collect()
    }

    /// Returns possible positions of an emission heard by these receivers: minima from several starts.
    fn candidates(&self, heard: &[Heard<D>], finest: f64) -> Vec<Candidate<D>> {
        let middle = middle(heard);
        let mut early: Vec<&Heard<D>> = heard.iter().collect();
        early.sort_by(|a, b| a.1.total_cmp(&b.1));
        let mut starts = vec![middle, early[0].0];
        for other in early.iter().skip(1).take(3) {
            starts.push(std::array::from_fn(|i| 0.5 * (early[0].0[i] + other.0[i])));
        }
        starts.into_iter().map(|start| self.descent(heard, start, finest)).collect()
    }

    /// Reflects the motion of emissions behind the plane of the receivers, as long as clocks are so wrong that
    /// steps lead there. Returns whether there are any.
    pub fn turn_back(&self, state: &mut State<D>) -> bool {
        let Some(mirror) = &self.mirror else { return false };
        let behind = state
            .motion
            .iter_mut()
            .zip(&self.layout.motion)
            .filter(|(motion, first)| first.is_some() && mirror.distance(&motion[0]) < 0.0);
        let mut count = 0;
        for (motion, _) in behind {
            *motion = mirror.turned(motion);
            count += 1;
        }
        count > 0
    }

    /// Replaces candidates behind the plane of the receivers by those that are found from their mirror images
    /// and from positions above the receivers, if there are any.
    fn keep_beside(&self, all: &mut Vec<Candidate<D>>, heard: &[Heard<D>], finest: f64) {
        let Some(mirror) = &self.mirror else { return };
        let is_beside = |one: &Candidate<D>| mirror.distance(&one.position) > 0.0;
        let behind = all.iter().filter(|one| !is_beside(one));
        let images = behind.map(|one| mirror.beside(&one.position));
        let found: Vec<_> =
            images.chain(mirror.starts()).map(|start| self.descent(heard, start, finest)).collect();
        all.extend(found);
        if all.iter().any(is_beside) {
            all.retain(is_beside);
        }
    }

    /// Replaces positions by others that fit as well and are nearer to those before and after.
    fn choose(&self, fixes: &mut [Fix<D>], finest: f64) {
        let expected: Vec<[f64; D]> = (0..fixes.len())
            .map(|at| {
                let low = at.saturating_sub(NEIGHBOURS);
                let high = (at + NEIGHBOURS).min(fixes.len() - 1);
                std::array::from_fn(|i| {
                    let others = (low..=high).filter(|&other| other != at || low == high);
                    median(&mut others.map(|o| fixes[o].chosen.position[i]).collect::<Vec<_>>())
                })
            })
            .collect();
        let off = |a: &[f64; D], b: &[f64; D]| {
            a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>()
        };
        let all = fixes.iter().zip(&expected);
        let mut squares: Vec<f64> = all.map(|(f, e)| off(&f.chosen.position, e)).collect();
        let usual = median(&mut squares).max(finest * finest);
        for (fix, expected) in fixes.iter_mut().zip(&expected) {
            let near = self.descent(&fix.heard, *expected, finest);
            if self.mirror.as_ref().is_none_or(|mirror| mirror.distance(&near.position) > 0.0) {
                fix.candidates.push(near);
            }
            fix.chosen = *least(&fix.candidates, |one| {
                let square = off(&one.position, expected) / usual;
                one.cost + 0.5 * (NU + 1.0) * (square / NU).ln_1p()
            });
        }
    }

    /// Returns the position and time of an emission; errors have Student's distribution with a scale that
    /// decreases.
    fn descent(&self, heard: &[Heard<D>], start: [f64; D], finest: f64) -> Candidate<D> {
        let middle = middle(heard);
        let mut position: [f64; D] = std::array::from_fn(|i| start[i] + 1e-3 * self.extent);
        let mut scale = SCALE * self.extent;
        let distance = |position: &[f64; D], site: &[f64; D]| {
            let square: f64 = position.iter().zip(site).map(|(p, s)| (p - s) * (p - s)).sum();
            square.sqrt().max(1e-6 * self.extent)
        };
        let mut off: Vec<f64> =
            heard.iter().map(|(site, time)| time - distance(&position, site)).collect();
        let mut time = median(&mut off);
        let far = (FAR * self.extent).powi(-2);
        for _ in 0..STEPS {
            let (mut matrix, mut pull) = ([[0.0; D]; D], [0.0; D]);
            let (mut weight, mut sum, mut own) = (0.0, [0.0; D], 0.0);
            for (site, z) in heard {
                let r = distance(&position, site);
                let towards: [f64; D] = std::array::from_fn(|i| (position[i] - site[i]) / r);
                let error = z - r - time;
                let w = (NU + 1.0) / (NU * scale * scale + error * error);
                weight += w;
                own += w * error;
                for i in 0..D {
                    sum[i] += w * towards[i];
                    pull[i] += w * towards[i] * error;
                }
                add_outer(&mut matrix, w, &towards);
            }
            for i in 0..D {
                pull[i] -= sum[i] * own / weight + far * (position[i] - middle[i]);
                for j in 0..D {
                    matrix[i][j] -= sum[i] * sum[j] / weight;
                }
                matrix[i][i] += far;
            }
            let Some(factor) = Factor::try_new(&matrix, 0.0) else { break };
            let step = factor.solve(&pull);
            let longest = step.iter().fold(0.0_f64, |longest, x| longest.max(x.abs()));
            let length = (LONGEST * self.extent / longest.max(f64::MIN_POSITIVE)).min(1.0);
            let taken: f64 = (0..D).map(|i| sum[i] * step[i]).sum();
            time += length * (own - taken) / weight;
            add_multiple(&mut position, length, &step);
            scale = (0.7 * scale).max(finest);
        }
        let errors = heard.iter().map(|(site, z)| {
            let error = (z - distance(&position, site) - time) / scale;
            0.5 * (NU + 1.0) * (error * error / NU).ln_1p()
        });
        let off: f64 = (0..D).map(|i| (position[i] - middle[i]).powi(2)).sum();
        let cost = errors.sum::<f64>() + 0.5 * far * off;
        Candidate { position, time, cost }
    }
}

/// Mean position of receivers.
fn middle<const D: usize>(heard: &[Heard<D>]) -> [f64; D] {
    std::array::from_fn(|i| heard.iter().map(|(site, _)| site[i]).sum::<f64>() / heard.len() as f64)
}

/// The candidate of least cost.
fn least<const D: usize>(
    candidates: &[Candidate<D>],
    cost: impl Fn(&Candidate<D>) -> f64,
) -> &Candidate<D> {
    let mut best = &candidates[0];
    for one in &candidates[1..] {
        if cost(one) < cost(best) {
            best = one;
        }
    }
    best
}

/// Returns the scene with beacons only, in which everything but the clocks is known; none if there are no
/// beacons.
fn beacons_alone<const D: usize>(scene: &Scene<D>) -> Option<Scene<D>> {
    let mut rows: Vec<Arrival> = Vec::new();
    let mut last = None;
    for row in scene.rows.iter().filter(|row| scene.beacon[row.identity].is_some()) {
        let emission = rows.last().map_or(0, |before: &Arrival| {
            before.emission + usize::from(last != Some(row.emission))
        });
        last = Some(row.emission);
        rows.push(Arrival { emission, ..*row });
    }
    (!rows.is_empty()).then(|| Scene {
        rows,
        site_sigma: vec![0.0; scene.sites.len()],
        speed_sigma: 0.0,
        path_sigma: Some(0.0),
        ..scene.clone()
    })
}

/// Median of the values; 0 if there are none.
pub(super) fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}
