//! The least-squares problem about a point: rows of measurements and priors, and their cost.
//!
//! z = T + u |p - s| + o(t) + m + e, all in metres of propagation at the given speed: T is the emission time,
//! u the given over the true speed, o the clock (linear between nodes), and m the path error of a beacon.
//! Motion is driven by white jerk and white acceleration; clock rates are random walks.

use super::super::mirror::Mirror;
use super::layout::Layout;
use super::linear::{Group, Row};
use super::scene::Scene;

/// Degrees of freedom of Student's distribution of the errors.
pub(super) const NU: f64 = 3.0;
/// Standard deviation of the relative rate of a quartz clock.
const RATE: f64 = 1e-4;
/// Number of arrivals of each receiver between two nodes, and the largest number of nodes.
const PER_NODE: usize = 16;
const NODES: usize = 400;
/// Standard deviations of vague priors, in extents of the net: of clock offsets; of positions, velocities and
/// accelerations in a usual interval. Without those of velocities and accelerations, stiff motion would leave
/// no significant digits.
const OFFSET: f64 = 10.0;
const FAR: [f64; 3] = [10.0, 1.0, 1.0];
/// Variances that white acceleration adds to the rows of a motion, relative to white jerk, if a step is 1.
const ACCELERATION: [f64; 3] = [60.0, 12.0, 0.0];
/// Shortest step of a motion over its usual step.
const SHORTEST: f64 = 1e-2;

/// A point in the space of the unknowns. Motion is in units of the identity's usual interval.
#[derive(Clone, Debug)]
pub(super) struct State<const D: usize> {
    pub emission: Vec<f64>,
    pub motion: Vec<[[f64; D]; 3]>,
    pub clock: Vec<f64>,
    pub slowness: f64,
    pub site: Vec<[f64; D]>,
    pub path: Vec<f64>,
}

/// Intensities: scale of the errors in units of the given standard deviations, path errors in metres, clock
/// drift in metres, white jerk and white acceleration of each identity in units of its interval.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Model {
    pub scale: f64,
    pub path: f64,
    pub drift: f64,
    pub jerk: Vec<f64>,
    pub acceleration: Vec<f64>,
}

pub(super) struct Problem<'a, const D: usize> {
    pub scene: &'a Scene<D>,
    /// First row of each emission, then the number of rows.
    pub first: Vec<usize>,
    /// Identity of each emission.
    pub identity: Vec<usize>,
    pub nodes: Vec<f64>,
    /// Node before each row, and the fraction of the way to the next node.
    pub place: Vec<(usize, f64)>,
    /// Path from a beacon to a receiver of each row.
    pub path: Vec<Option<usize>>,
    pub layout: Layout,
    /// Usual interval between emissions of each identity.
    pub unit: Vec<f64>,
    /// Emission before each one, of the same moving identity.
    pub previous: Vec<Option<usize>>,
    pub extent: f64,
    pub middle: [f64; D],
    /// Plane of the receivers if emissions are searched on the side of its normal only.
    pub mirror: Option<Mirror<D>>,
}

impl<'a, const D: usize> Problem<'a, D> {
    /// Sets up the problem; `nodes` are those of another problem, none: nodes that suit the rows.
    pub fn new(scene: &'a Scene<D>, nodes: Option<Vec<f64>>) -> Self {
        let rows = &scene.rows;
        let emissions = rows.last().map_or(0, |row| row.emission + 1);
        let mut first = vec![0; emissions + 1];
        let mut identity = vec![0; emissions];
        for (at, row) in rows.iter().enumerate() {
            (first[row.emission + 1], identity[row.emission]) = (at + 1, row.identity);
        }
        let nodes = nodes.unwrap_or_else(|| spread_nodes(scene));
        let place: Vec<(usize, f64)> = rows.iter().map(|row| node(&nodes, row.time)).collect();
        let mut found = vec![None; scene.beacon.len() * scene.is_base.len()];
        let mut paths = 0;
        let path = rows.iter().map(|row| {
            scene.beacon[row.identity]?;
            let known = &mut found[row.identity * scene.is_base.len() + row.sensor];
            Some(*known.get_or_insert_with(|| {
                paths += 1;
                paths - 1
            }))
        });
        let path = path.collect();
        let interval: Vec<usize> = first[..emissions].iter().map(|&at| place[at].0).collect();
        let layout = Layout::new(scene, &identity, &interval, nodes.len(), paths);
        let mut last = vec![None; scene.beacon.len()];
        let previous = identity.iter().enumerate().map(|(emission, &name)| {
            if scene.beacon[name].is_some() { None } else { last[name].replace(emission) }
        });
        let previous = previous.collect();
        let (extent, middle) = spanned(&scene.sites);
        let mut problem = Self {
            scene,
            first,
            identity,
            nodes,
            place,
            path,
            layout,
            unit: vec![1.0; scene.beacon.len()],
            previous,
            extent,
            middle,
            mirror: None,
        };
        problem.unit = problem.intervals();
        problem
    }

    /// Median interval between the emissions of each identity.
    fn intervals(&self) -> Vec<f64> {
        let mut steps = vec![Vec::new(); self.unit.len()];
        for (emission, before) in self.previous.iter().enumerate() {
            if let Some(before) = before {
                let time = |e: usize| self.scene.rows[self.first[e]].time;
                steps[self.identity[emission]].push(time(emission) - time(*before));
            }
        }
        let median = |steps: &mut Vec<f64>| {
            steps.sort_by(f64::total_cmp);
            steps.get(steps.len() / 2).copied().filter(|step| *step > 0.0).unwrap_or(1.0)
        };
        steps.iter_mut().map(median).collect()
    }

    /// Returns the point with the given values only.
    pub fn origin(&self) -> State<D> {
        let rows = &self.scene.rows;
        let emissions = self.identity.len();
        let emission = (0..emissions).map(|e| {
            let times = rows[self.first[e]..self.first[e + 1]].iter();
            times.map(|row| row.time).fold(f64::INFINITY, f64::min) * self.scene.speed
        });
        State {
            emission: emission.collect(),
            motion: vec![[self.middle, [0.0; D], [0.0; D]]; emissions],
            clock: vec![0.0; self.layout.clock.len()],
            slowness: 1.0,
            site: self.scene.sites.clone(),
            path: vec![0.0; self.layout.path.len()],
        }
    }

    /// Returns the position of an emission and its first column, which belongs to a motion or a site.
    fn source(&self, state: &State<D>, emission: usize) -> ([f64; D], Option<usize>) {
        match self.scene.beacon[self.identity[emission]] {
            Some(site) => (state.site[site], self.layout.site[site]),
            None => (state.motion[emission][0], self.layout.motion[emission]),
        }
    }

    /// Returns the reading of a clock less the time base at a row, in metres.
    pub fn clock(&self, state: &State<D>, at: usize) -> f64 {
        let k = self.scene.is_base.len();
        let (node, share) = self.place[at];
        let here = node * k + self.scene.rows[at].sensor;
        let next = if share > 0.0 { state.clock[here + k] } else { 0.0 };
        (1.0 - share) * state.clock[here] + share * next
    }

    /// Returns the rows of the measurements; the emission, whose derivative is 1, has no column.
    pub fn rows(&self, state: &State<D>) -> Vec<Row> {
        let k = self.scene.is_base.len();
        let row = |(at, arrival): (usize, &super::scene::Arrival)| {
            let (source, from) = self.source(state, arrival.emission);
            let site = state.site[arrival.sensor];
            let offset: [f64; D] = std::array::from_fn(|i| source[i] - site[i]);
            let distance = offset.iter().map(|x| x * x).sum::<f64>().sqrt();
            let path = self.path[at].map_or(0.0, |path| state.path[path]);
            let expected = state.emission[arrival.emission]
                + state.slowness * distance
                + self.clock(state, at)
                + path;
            let mut row = Row::new(arrival.time * self.scene.speed - expected);
            let to = self.layout.site[arrival.sensor];
            if from != to || from.is_none() {
                for (i, x) in offset.iter().enumerate() {
                    let towards = state.slowness * x / distance.max(1e-9 * self.extent);
                    row.push(from.map(|from| from + i), towards);
                    row.push(to.map(|to| to + i), -towards);
                }
            }
            let (node, share) = self.place[at];
            row.push(self.layout.clock[node * k + arrival.sensor], 1.0 - share);
            if share > 0.0 {
                row.push(self.layout.clock[(node + 1) * k + arrival.sensor], share);
            }
            row.push(self.layout.slowness, distance);
            row.push(self.path[at].and_then(|path| self.layout.path[path]), 1.0);
            row
        };
        self.scene.rows.iter().enumerate().map(row).collect()
    }

    /// Returns the rows of the priors, divided by the part of the standard deviation that does not depend on
    /// the group.
    pub fn priors(&self, state: &State<D>) -> Vec<(Row, Group)> {
        let mut rows = Vec::new();
        self.motion_priors(state, &mut rows);
        self.clock_priors(state, &mut rows);
        let mut unit = |column: Option<usize>, off: f64, sigma: f64, group: Group| {
            if column.is_some() {
                let mut row = Row::new(off / sigma);
                row.push(column, 1.0 / sigma);
                rows.push((row, group));
            }
        };
        let scene = self.scene;
        let sigma = scene.speed_sigma / scene.speed;
        unit(self.layout.slowness, 1.0 - state.slowness, sigma, Group::Unit);
        for (at, first) in self.layout.site.iter().enumerate() {
            for i in 0..D {
                let off = scene.sites[at][i] - state.site[at][i];
                unit(first.map(|first| first + i), off, scene.site_sigma[at], Group::Unit);
            }
        }
        for (&column, &value) in self.layout.path.iter().zip(&state.path) {
            unit(column, -value, 1.0, Group::Path);
        }
        rows
    }

    /// Adds the priors of the motions. White jerk: the state after dt is F x + w, w ~ N(0, q N Q N),
    /// N = diag(dt^5/2, dt^3/2, dt^1/2); each row is one of U N^-1 w, with U'U = Q^-1. White acceleration
    /// adds to the variances of these rows only: its covariance of U N^-1 w is diag(60, 12, 0)/dt².
    fn motion_priors(&self, state: &State<D>, rows: &mut Vec<(Row, Group)>) {
        let factor = [
            [720_f64.sqrt(), -(180_f64.sqrt()), 5_f64.sqrt()],
            [0.0, 12_f64.sqrt(), -(3_f64.sqrt())],
            [0.0, 0.0, 1.0],
        ];
        for (emission, first) in self.layout.motion.iter().enumerate() {
            let Some(first) = *first else { continue };
            let now = &state.motion[emission];
            let before = self.previous[emission];
            for i in 0..D {
                let rest = [now[0][i] - self.middle[i], now[1][i], now[2][i]];
                for (order, value) in rest.iter().enumerate() {
                    let far = FAR[order] * self.extent;
                    let mut row = Row::new(-value / far);
                    row.push(Some(first + order * D + i), 1.0 / far);
                    rows.push((row, Group::Unit));
                }
            }
            let Some(before) = before else { continue };
            let name = self.identity[emission];
            let step = (state.emission[emission] - state.emission[before]) / self.scene.speed;
            let dt = (step / self.unit[name]).max(SHORTEST);
            let scales = [dt.powf(-2.5), dt.powf(-1.5), dt.powf(-0.5)];
            let transition = [[1.0, dt, 0.5 * dt * dt], [0.0, 1.0, dt], [0.0, 0.0, 1.0]];
            let last = &state.motion[before];
            let Some(start) = self.layout.motion[before] else { continue };
            let parts = factor.iter().zip(ACCELERATION);
            for (i, (factor, share)) in (0..D).flat_map(|i| parts.clone().map(move |row| (i, row)))
            {
                let (mut residual, mut old) = (0.0, [0.0; 3]);
                for a in 0..3 {
                    let weight = factor[a] * scales[a];
                    let expected: f64 = (0..3).map(|b| transition[a][b] * last[b][i]).sum();
                    residual -= weight * (now[a][i] - expected);
                    for b in 0..3 {
                        old[b] -= weight * transition[a][b];
                    }
                }
                let mut row = Row::new(residual);
                for a in 0..3 {
                    row.push(Some(first + a * D + i), factor[a] * scales[a]);
                    row.push(Some(start + a * D + i), old[a]);
                }
                rows.push((row, Group::Motion(name, share / (dt * dt))));
            }
        }
    }

    fn clock_priors(&self, state: &State<D>, rows: &mut Vec<(Row, Group)>) {
        let (k, m) = (self.scene.is_base.len(), self.nodes.len());
        let offset = OFFSET * self.extent;
        let mut push = |terms: &[(usize, f64)], known: f64, group: Group| {
            let off = terms.iter().map(|&(at, v)| v * state.clock[at]).sum::<f64>();
            let mut row = Row::new(-off - known);
            for &(at, value) in terms {
                row.push(self.layout.clock[at], value);
            }
            rows.push((row, group));
        };
        for sensor in (0..k).filter(|&sensor| !self.scene.is_base[sensor]) {
            let at = |node: usize| node * k + sensor;
            push(&[(at(0), 1.0 / offset)], 0.0, Group::Unit);
            if m > 1 {
                let v = 1.0 / ((self.nodes[1] - self.nodes[0]) * RATE * self.scene.speed);
                let aligned = self.scene.lines[sensor].rate / RATE;
                push(&[(at(0), -v), (at(1), v)], aligned, Group::Unit);
            }
            for node in 2..m {
                let before = self.nodes[node - 1] - self.nodes[node - 2];
                let after = self.nodes[node] - self.nodes[node - 1];
                let s = (0.5 * (before + after)).sqrt();
                let (a, b) = (1.0 / (before * s), 1.0 / (after * s));
                let terms = [(at(node - 2), a), (at(node - 1), -a - b), (at(node), b)];
                push(&terms, 0.0, Group::Drift);
            }
        }
    }

    /// Returns the point after a step of this length, given the steps of the unknowns and of the emissions.
    pub fn moved(&self, state: &State<D>, step: &[f64], emission: &[f64], length: f64) -> State<D> {
        let mut moved = state.clone();
        let add = |value: &mut f64, column: Option<usize>| {
            *value += column.map_or(0.0, |column| length * step[column]);
        };
        for (motion, first) in moved.motion.iter_mut().zip(&self.layout.motion) {
            for (at, value) in motion.as_flattened_mut().iter_mut().enumerate() {
                add(value, first.map(|first| first + at));
            }
        }
        for (value, &column) in moved.clock.iter_mut().zip(&self.layout.clock) {
            add(value, column);
        }
        add(&mut moved.slowness, self.layout.slowness);
        for (site, first) in moved.site.iter_mut().zip(&self.layout.site) {
            for (at, value) in site.iter_mut().enumerate() {
                add(value, first.map(|first| first + at));
            }
        }
        for (value, &column) in moved.path.iter_mut().zip(&self.layout.path) {
            add(value, column);
        }
        for (value, step) in moved.emission.iter_mut().zip(emission) {
            *value += length * step;
        }
        moved
    }

    /// Minus the logarithm of the density, up to a constant.
    pub fn cost(&self, rows: &[Row], priors: &[(Row, Group)], model: &Model) -> f64 {
        let errors = rows.iter().zip(&self.scene.rows).map(|(row, arrival)| {
            let error = row.residual / (self.scene.sigma[arrival.sensor] * model.scale);
            0.5 * (NU + 1.0) * (error * error / NU).ln_1p()
        });
        let priors =
            priors.iter().map(|(row, group)| 0.5 * row.residual.powi(2) / model.variance(*group));
        errors.sum::<f64>() + priors.sum::<f64>()
    }
}

impl Model {
    pub fn variance(&self, group: Group) -> f64 {
        match group {
            Group::Unit => 1.0,
            Group::Path => self.path * self.path,
            Group::Drift => self.drift * self.drift,
            Group::Motion(identity, share) => {
                self.jerk[identity] + share * self.acceleration[identity]
            }
        }
    }
}

/// Returns times between which there are about equal numbers of arrivals.
fn spread_nodes<const D: usize>(scene: &Scene<D>) -> Vec<f64> {
    let mut times: Vec<f64> = scene.rows.iter().map(|row| row.time).collect();
    times.sort_by(f64::total_cmp);
    let n = times.len();
    let intervals = (n / (PER_NODE * scene.is_base.len())).clamp(1, NODES);
    let span = times[n - 1] - times[0];
    let mut nodes: Vec<f64> = Vec::with_capacity(intervals + 1);
    for i in 0..=intervals {
        let time = times[i * (n - 1) / intervals];
        if nodes.last().is_none_or(|last| time - last > 1e-6 * span) {
            nodes.push(time);
        }
    }
    nodes
}

fn node(nodes: &[f64], time: f64) -> (usize, f64) {
    if nodes.len() < 2 {
        return (0, 0.0);
    }
    let at = nodes.partition_point(|&node| node <= time).clamp(1, nodes.len() - 1) - 1;
    let share = (time - nodes[at]) / (nodes[at + 1] - nodes[at]);
    (at, share.clamp(0.0, 1.0))
}

/// Returns the diagonal of the bounding box of these points, and its centre.
fn spanned<const D: usize>(sites: &[[f64; D]]) -> (f64, [f64; D]) {
    let ends = |i: usize| {
        sites.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), site| {
            (low.min(site[i]), high.max(site[i]))
        })
    };
    let extent = (0..D).map(|i| (ends(i).1 - ends(i).0).powi(2)).sum::<f64>().sqrt();
    (extent.max(f64::MIN_POSITIVE), std::array::from_fn(|i| 0.5 * (ends(i).0 + ends(i).1)))
}
