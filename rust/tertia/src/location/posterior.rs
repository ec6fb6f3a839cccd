//! Two to four bearings: the density of positions, without an approximation.
//!
//! The bearings have von Mises errors about the directions to the target, as in the azimuthal
//! telemetry model of Gerber et al. (2018); positions are evenly likely within a range of any
//! station. The common factor f between true and stated σ is log-normal and integrated out, where
//! a record is pooled with what all its other instants say of f: the law from which their Markov
//! chain draws, by quadrature.

use super::concentration::{
    self, Decay, Evidence, STEPS, Weights, factors, likely, ln_constants, normalise,
};
use super::contour::{Frame, Outline, Part, outline};
use super::quadtree::{Node, Ray, Scene, nodes};
use crate::sensors::{KINDS, Measurement, read};

/// With fewer bearings S can be zero whatever f is, and they say nothing of it.
const TELLING: usize = 3;
/// Near the limit of range: a share of it.
const EDGE: f64 = 0.98;
/// Shares of instants whose σ is not that of the others, by whatever factor: as likely as each other.
const OUTLYING: [f64; 5] = [0.01, 0.05, 0.1, 0.2, 0.4];
/// ln of the density outside the range.
const NOWHERE: f64 = f64::NEG_INFINITY;

/// What was measured at an instant: the arguments of [`Instant`](super::Instant), azimuths only.
#[derive(Clone, Copy, Debug)]
pub struct Bearings<'a> {
    /// Positions of K stations, 2 K numbers.
    pub stations: &'a [f64],
    /// Axes of each station, 4 K numbers, if not those of the frame.
    pub axes: Option<&'a [f64]>,
    /// As in [`Instant`](super::Instant): K values of each kind.
    pub values: &'a [f64],
    /// Stated standard deviations, right up to a common factor.
    pub sigmas: &'a [f64],
}

/// Mean and covariance of the position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summary {
    /// Expected position.
    pub mean: [f64; 2],
    /// Covariance.
    pub covariance: [[f64; 2]; 2],
    /// Expected factor between true and stated σ.
    pub factor: f64,
    /// Share of the mass at the limit of range.
    pub edge: f64,
}

impl Summary {
    /// That of too few bearings.
    pub const UNKNOWN: Self = Self {
        mean: [f64::NAN; 2],
        covariance: [[f64::NAN; 2]; 2],
        factor: f64::NAN,
        edge: f64::NAN,
    };
}

/// A region, and the circle about the mean.
#[derive(Clone, Debug, PartialEq)]
pub struct Density {
    /// ln of the density on the contour that holds so much of the mass.
    pub ln_level: f64,
    /// The contour.
    pub outline: Outline,
}

/// The bearings of an instant, and the law of f.
#[derive(Debug)]
pub struct Posterior {
    origin: [f64; 2],
    rays: Vec<Ray>,
    /// Where each stands in the instant.
    places: Vec<usize>,
    max_range: f64,
    constants: Weights,
}

impl Posterior {
    /// Reads bearings; `None` where there are fewer than two.
    pub fn new(bearings: &Bearings<'_>, max_range: f64) -> Option<Self> {
        let Bearings { stations, axes, values, sigmas } = *bearings;
        debug_assert_eq!(values.len() * 2, stations.len() * KINDS);
        let (mut rays, mut places) = (Vec::new(), Vec::new());
        read(stations, axes, values, sigmas, |place, m: Measurement<2>| {
            places.push(place);
            rays.push(Ray {
                station: m.station,
                direction: [m.sine, m.cosine],
                precision: m.precision * m.precision,
            });
        });
        let constants = ln_constants(rays.iter().map(|ray| ray.precision));
        let origin = [stations[0], stations[1]];
        (rays.len() >= 2).then_some(Self { origin, rays, places, max_range, constants })
    }

    /// Logarithm of the likelihood of each f, where the bearings tell.
    pub fn ln_likelihood(&self, decay: &Decay) -> Option<Weights> {
        (self.rays.len() >= TELLING).then(|| self.telling(decay, &self.nodes(decay, &likely())))
    }

    /// Mean, covariance and factor, f having these weights before the instant.
    pub fn summary(&self, decay: &Decay, weights: &Weights) -> Summary {
        let nodes = self.nodes(decay, weights);
        let mass = Mass::of(&nodes);
        let mean = [0, 1].map(|axis| mass.total(|node| node.p[axis]));
        let square =
            |node: &Node, i: usize, j: usize| (node.p[i] - mean[i]) * (node.p[j] - mean[j]);
        let of = |i, j| mass.total(|node| square(node, i, j));
        let cross = of(0, 1);
        let mut law: Weights = *weights;
        if self.rays.len() >= TELLING {
            let own = self.telling(decay, &nodes);
            for (law, own) in law.iter_mut().zip(own) {
                *law += own;
            }
            normalise(&mut law);
        }
        Summary {
            mean: [0, 1].map(|axis| mean[axis] + self.origin[axis]),
            covariance: [[of(0, 0), cross], [cross, of(1, 1)]],
            factor: law.iter().zip(factors()).map(|(ln, factor)| ln.exp() * factor).sum(),
            edge: mass.total(|node| f64::from(u8::from(node.nearest > EDGE * self.max_range))),
        }
    }

    /// The region of highest density that holds so much of the mass.
    pub fn region(&self, decay: &Decay, weights: &Weights, probability: f64) -> Density {
        let evidence = self.evidence(decay, weights);
        let mut nodes = nodes(&self.scene(), &evidence);
        nodes.sort_by(|a, b| b.ln.total_cmp(&a.ln));
        let mass = Mass::of(&nodes);
        let mut sum = 0.0;
        let within = mass.shares.iter().take_while(|&share| {
            let more = sum < probability;
            sum += share;
            more
        });
        let count = within.count();
        let level = nodes[count - 1].ln;
        let scene = self.scene();
        let ln_density = |p: [f64; 2]| {
            let (misfit, nearest) = scene.misfit(p);
            if nearest <= scene.max_range { evidence.ln_at(misfit) } else { NOWHERE }
        };
        let frame = Frame::around(nodes[..count].iter().map(|node| (node.p, node.area)));
        let (mut outline, _) = outline(&frame, Part::All, level, ln_density);
        outline.shift(self.origin);
        Density { ln_level: level - mass.ln_total, outline }
    }

    /// Radius about a point that holds so much of the mass.
    pub fn radius(
        &self,
        decay: &Decay,
        weights: &Weights,
        probability: f64,
        centre: [f64; 2],
    ) -> f64 {
        let nodes = self.nodes(decay, weights);
        let mass = Mass::of(&nodes);
        let centre = [0, 1].map(|axis| centre[axis] - self.origin[axis]);
        let distance = |node: &Node| (node.p[0] - centre[0]).hypot(node.p[1] - centre[1]);
        let mut rings: Vec<(f64, f64)> =
            nodes.iter().map(distance).zip(mass.shares.iter().copied()).collect();
        rings.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut sum = 0.0;
        for (radius, share) in &rings {
            sum += share;
            if sum >= probability {
                return *radius;
            }
        }
        rings.last().map_or(f64::NAN, |ring| ring.0)
    }

    /// Writes the residuals at a position, with σ larger by a factor; returns the number of bearings.
    pub fn residuals(&self, factor: f64, p: [f64; 2], out: &mut [f64]) -> usize {
        let p = [0, 1].map(|axis| p[axis] - self.origin[axis]);
        for (ray, &place) in self.rays.iter().zip(&self.places) {
            out[place] = ray.residual(p) / factor;
        }
        self.rays.len()
    }

    fn scene(&self) -> Scene<'_> {
        Scene { rays: &self.rays, max_range: self.max_range }
    }

    fn evidence<'a>(&self, decay: &'a Decay, weights: &Weights) -> Evidence<'a> {
        decay.evidence(weights, &self.constants)
    }

    fn nodes(&self, decay: &Decay, weights: &Weights) -> Vec<Node> {
        nodes(&self.scene(), &self.evidence(decay, weights))
    }

    fn telling(&self, decay: &Decay, nodes: &[Node]) -> Weights {
        decay.ln_likelihood(&self.constants, nodes.iter().map(|node| (node.misfit, node.area)))
    }
}

/// The weights of each instant of a record from those of all others: `ln prior + Σ_{j≠l} ln m_j`,
/// where a share of the instants has a factor of its own, of any size: one bearing that is reversed
/// would otherwise be worth more than a hundred good instants. The share is integrated out. The
/// prior where fewer than two instants tell. O(instants).
pub fn pooled(likelihoods: &[Option<Weights>]) -> Vec<Weights> {
    let prior = concentration::prior();
    if likelihoods.iter().flatten().count() < 2 {
        return vec![prior; likelihoods.len()];
    }
    let mut sums = OUTLYING.map(|_| prior);
    for own in likelihoods.iter().flatten() {
        for (sum, share) in sums.iter_mut().zip(OUTLYING) {
            for (sum, own) in sum.iter_mut().zip(or_own_factor(own, share)) {
                *sum += own;
            }
        }
    }
    let without = |own: &Option<Weights>| {
        let mut laws = sums;
        if let Some(own) = own {
            for (law, share) in laws.iter_mut().zip(OUTLYING) {
                for (law, own) in law.iter_mut().zip(or_own_factor(own, share)) {
                    *law -= own;
                }
            }
        }
        let largest = laws.iter().flatten().copied().fold(f64::NEG_INFINITY, f64::max);
        let mut weights = [0.0; STEPS];
        for (law, share) in laws.iter().zip(OUTLYING) {
            let law = law.map(|ln| (ln - largest).exp());
            let every = share * law.iter().sum::<f64>() / STEPS as f64;
            for (weight, law) in weights.iter_mut().zip(law) {
                *weight += (1.0 - share) * law + every;
            }
        }
        let mut weights = weights.map(f64::ln);
        normalise(&mut weights);
        weights
    };
    likelihoods.iter().map(without).collect()
}

/// The likelihood of a factor that the instant shares with others, or not.
fn or_own_factor(ln: &Weights, share: f64) -> Weights {
    let largest = ln.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let mean = ln.iter().map(|v| (v - largest).exp()).sum::<f64>() / STEPS as f64;
    ln.map(|v| largest + ((1.0 - share) * (v - largest).exp() + share * mean).ln())
}

/// How the mass of a density is spread over nodes.
struct Mass<'a> {
    nodes: &'a [Node],
    shares: Vec<f64>,
    ln_total: f64,
}

impl<'a> Mass<'a> {
    fn of(nodes: &'a [Node]) -> Self {
        let largest = nodes.iter().map(|node| node.ln).fold(f64::NEG_INFINITY, f64::max);
        let mut shares: Vec<f64> =
            nodes.iter().map(|node| node.area * (node.ln - largest).exp()).collect();
        let total: f64 = shares.iter().sum();
        shares.iter_mut().for_each(|share| *share /= total);
        Self { nodes, shares, ln_total: largest + total.ln() }
    }

    fn total(&self, of: impl Fn(&Node) -> f64) -> f64 {
        self.shares.iter().zip(self.nodes).map(|(share, node)| share * of(node)).sum()
    }
}
