//! Order of the unknowns in the matrix, chosen for low columns: motion and clocks in the order of time, then
//! the unknowns that the whole record shares.

use super::scene::Scene;

/// Column of each unknown; none if its value is known.
#[derive(Clone, Debug)]
pub(super) struct Layout {
    /// First of the 3 D columns of each emission: coordinates, then velocities, then accelerations.
    pub motion: Vec<Option<usize>>,
    /// Column of each node and receiver, (M, K).
    pub clock: Vec<Option<usize>>,
    /// Column of the reciprocal of the speed.
    pub slowness: Option<usize>,
    /// First of the D columns of each site.
    pub site: Vec<Option<usize>>,
    /// Column of each path from a beacon to a receiver.
    pub path: Vec<Option<usize>>,
    pub order: usize,
}

/// Unknown to which a column belongs.
pub(super) enum Unknown {
    Motion(usize),
    Clock(usize),
    Shared,
}

impl Layout {
    /// Arranges the columns; `interval` is the interval between nodes that contains each emission.
    pub fn new<const D: usize>(
        scene: &Scene<D>,
        identity: &[usize],
        interval: &[usize],
        nodes: usize,
        paths: usize,
    ) -> Self {
        let k = scene.is_base.len();
        let mut next = 0;
        let mut take = |count: usize| {
            next += count;
            Some(next - count)
        };
        let (mut motion, mut clock) = (vec![None; identity.len()], vec![None; nodes * k]);
        let mut emission = 0;
        for node in 0..nodes {
            while emission < identity.len() && (interval[emission] <= node || node + 1 == nodes) {
                if scene.beacon[identity[emission]].is_none() {
                    motion[emission] = take(3 * D);
                }
                emission += 1;
            }
            for sensor in (0..k).filter(|&sensor| !scene.is_base[sensor]) {
                clock[node * k + sensor] = take(1);
            }
        }
        let slowness = if scene.speed_sigma > 0.0 { take(1) } else { None };
        let site = scene.site_sigma.iter().map(|&s| if s > 0.0 { take(D) } else { None }).collect();
        let path = (0..paths)
            .map(|_| if scene.path_sigma == Some(0.0) { None } else { take(1) })
            .collect();
        Self { motion, clock, slowness, site, path, order: next }
    }

    /// Returns the unknown to which a column belongs.
    pub fn unknown<const D: usize>(&self, column: usize, k: usize) -> Unknown {
        let within =
            |first: &Option<usize>| first.is_some_and(|c| (c..c + 3 * D).contains(&column));
        if let Some(emission) = self.motion.iter().position(within) {
            return Unknown::Motion(emission);
        }
        match self.clock.iter().position(|&c| c == Some(column)) {
            Some(at) => Unknown::Clock(at % k),
            None => Unknown::Shared,
        }
    }
}
