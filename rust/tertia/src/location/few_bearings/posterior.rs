//! Two to four bearings: the density of positions, without linearisation.
//!
//! The bearings have von Mises errors about the directions to the target, as in the azimuthal telemetry
//! model of Gerber et al. (2018); positions within a given range of any station are equally probable.
//! The factor f between true and stated σ is common to the bearings of an instant, has a log-normal
//! prior and is integrated out. If a record is pooled, the prior of f for each instant includes what
//! all other instants say about f. This is the distribution from which the Markov chain of Gerber et
//! al. draws; here it is computed by quadrature.

use super::concentration::{
    self, Decay, Evidence, STEPS, Weights, factors, likely, ln_constants, normalise,
};
use super::quadtree::{Node, Ray, Scene, nodes};
use crate::location::regions::contour::{Frame, Outline, Part, outline};
use crate::sensors::{KINDS, Measurement, read};

/// Smallest number of bearings with information about f: with fewer, S can be zero whatever f is.
const TELLING: usize = 3;
/// Share of the maximum range from which on a position counts as being at the limit.
const EDGE: f64 = 0.98;
/// Shares of instants with a factor of their own, of any size. All these shares are equally probable.
const OUTLYING: [f64; 5] = [0.01, 0.05, 0.1, 0.2, 0.4];
/// ln of the density outside the maximum range.
const NOWHERE: f64 = f64::NEG_INFINITY;

/// Measurements and stations of one instant; as [`Instant`](crate::location::Instant), with azimuths only.
#[derive(Clone, Copy, Debug)]
pub struct Bearings<'a> {
    /// Positions of K stations: 2 K numbers.
    pub stations: &'a [f64],
    /// Axes of each station, 4 K numbers; `None` for those of the frame.
    pub axes: Option<&'a [f64]>,
    /// K values of each kind, as in [`Instant`](crate::location::Instant).
    pub values: &'a [f64],
    /// Stated standard deviations, correct up to a common factor.
    pub sigmas: &'a [f64],
}

/// Mean and covariance of the position, with the expected factor of the sigmas.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summary {
    /// Expected position.
    pub mean: [f64; 2],
    /// Covariance.
    pub covariance: [[f64; 2]; 2],
    /// Expected factor between true and stated σ.
    pub factor: f64,
    /// Probability that the target is at the limit of the range.
    pub edge: f64,
}

impl Summary {
    /// Result for too few bearings.
    pub const UNKNOWN: Self = Self {
        mean: [f64::NAN; 2],
        covariance: [[f64::NAN; 2]; 2],
        factor: f64::NAN,
        edge: f64::NAN,
    };
}

/// The bearings of an instant, and the constants of their likelihood for each f.
#[derive(Debug)]
pub struct Posterior {
    origin: [f64; 2],
    rays: Vec<Ray>,
    /// Index of each bearing among the values of the instant.
    places: Vec<usize>,
    max_range: f64,
    constants: Weights,
}

impl Posterior {
    /// Reads bearings; `None` if there are fewer than two.
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

    /// Returns the logarithm of the likelihood of each f; `None` if the bearings contain no information
    /// about f.
    pub fn ln_likelihood(&self, decay: &Decay) -> Option<Weights> {
        (self.rays.len() >= TELLING).then(|| self.telling(decay, &self.nodes(decay, &likely())))
    }

    /// Returns mean, covariance and factor, for these prior weights of f.
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

    /// Returns the region of highest density that contains the target with this probability.
    pub fn region(&self, decay: &Decay, weights: &Weights, probability: f64) -> Outline {
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
        let Some(level) = nodes[..count].last().map(|node| node.ln) else {
            // the range is less than the rounding of coordinates
            return Outline::empty();
        };
        let scene = self.scene();
        let ln_density = |p: [f64; 2]| {
            let (misfit, nearest) = scene.misfit(p);
            if nearest <= scene.max_range { evidence.ln_at(misfit) } else { NOWHERE }
        };
        let frame = Frame::around(nodes[..count].iter().map(|node| (node.p, node.area)));
        let (mut outline, _) = outline(&frame, Part::All, level, ln_density);
        outline.shift(self.origin);
        outline
    }

    /// Returns the radius about `centre` that contains the target with this probability.
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

    /// Writes the residuals at a position, with σ multiplied by a factor; returns the number of
    /// bearings.
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

/// Returns the weights of f for each instant of a record, given the likelihoods of all other instants:
/// `ln prior + Σ_{j≠l} ln m_j`. A share of the instants has a factor of its own, of any size; otherwise
/// a single reversed bearing would outweigh more than a hundred good instants. The share is integrated
/// out. If fewer than two instants contain information about f, the weights are the prior. O(instants).
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

/// Returns the likelihood of the common factor if the instant has a factor of its own with this
/// probability.
fn or_own_factor(ln: &Weights, share: f64) -> Weights {
    let largest = ln.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let mean = ln.iter().map(|v| (v - largest).exp()).sum::<f64>() / STEPS as f64;
    ln.map(|v| largest + ((1.0 - share) * (v - largest).exp() + share * mean).ln())
}

/// Distribution of the probability over the nodes of a quadrature.
struct Mass<'a> {
    nodes: &'a [Node],
    shares: Vec<f64>,
}

impl<'a> Mass<'a> {
    fn of(nodes: &'a [Node]) -> Self {
        let largest = nodes.iter().map(|node| node.ln).fold(f64::NEG_INFINITY, f64::max);
        let mut shares: Vec<f64> =
            nodes.iter().map(|node| node.area * (node.ln - largest).exp()).collect();
        let total: f64 = shares.iter().sum();
        shares.iter_mut().for_each(|share| *share /= total);
        Self { nodes, shares }
    }

    fn total(&self, of: impl Fn(&Node) -> f64) -> f64 {
        self.shares.iter().zip(self.nodes).map(|(share, node)| share * of(node)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two stations, and two others at `far` m, which see the target in practically one direction from
    /// everywhere within the range of 300 m: summary, and area of the region.
    fn with_distant(far: f64) -> (Summary, f64) {
        let stations = [0.0, 0.0, 200.0, 100.0, far, 0.2 * far, -far, 0.7 * far];
        let mut values = vec![f64::NAN; KINDS * 4];
        for (value, station) in values[4..8].iter_mut().zip(stations.chunks(2)) {
            *value = (100.0 - station[0]).atan2(200.0 - station[1]);
        }
        let sigmas = [0.05; KINDS * 4];
        let bearings =
            Bearings { stations: &stations, axes: None, values: &values, sigmas: &sigmas };
        let posterior = Posterior::new(&bearings, 300.0).unwrap();
        let (decay, prior) = (Decay::new(4, &sigmas), concentration::prior());
        let area = posterior.region(&decay, &prior, 0.95).area;
        (posterior.summary(&decay, &prior), area)
    }

    #[test]
    fn how_far_distant_stations_are_does_not_matter() {
        let (near, area) = with_distant(1e4);
        let sigma = near.covariance[0][0].sqrt();
        for far in [1e5, 1e6, 1e7, 1e8, 1e10] {
            let (summary, found) = with_distant(far);
            assert!((found / area - 1.0).abs() < 0.1, "{far} {found} {area}");
            // the small probability near a distant station counts in the mean if it is very far
            if far <= 1e6 {
                let moved = (0..2).map(|axis| (summary.mean[axis] - near.mean[axis]).abs());
                assert!(moved.fold(0.0, f64::max) < 0.1 * sigma, "{far} {summary:?}");
            }
        }
        // a range below the rounding of coordinates
        assert!(with_distant(1e20).1.is_nan());
    }
}
