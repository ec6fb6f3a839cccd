//! Joint events: the most likely assignments of columns to rows, best first.
//!
//! A row has one of its columns or none. Two rows that may not have been resolved can have the same
//! column. If the rows are few, all events are enumerated; many rows are solved by Murty's method, in
//! which rows never share a column.

use super::assignment::Assigner;
use super::event::{Event, Limits, Unresolved, sort};
use super::murty;
use super::pair::Pair;

/// Largest number of events that are enumerated: that of 4 rows with 6 columns each.
const MOST: usize = 7 * 7 * 7 * 7;
/// Differences below this are rounding errors.
const ROUNDING: f64 = 1e-9;

/// Returns the events of `rows` with the given pairs (at most one for each row and column), best first;
/// equal gains are sorted by the columns. Cost: enumeration O(events), otherwise O(count × rows)
/// assignments.
pub fn events(
    pairs: &[Pair],
    rows: usize,
    unresolved: &[Unresolved],
    limits: Limits,
    assigner: &mut Assigner,
) -> Vec<Event> {
    let mut own: Vec<Vec<Pair>> = vec![Vec::new(); rows];
    for pair in pairs.iter().filter(|pair| pair.counts()) {
        own[pair.row as usize].push(*pair);
    }
    let events = own.iter().try_fold(1_usize, |count, own| count.checked_mul(own.len() + 1));
    if events.is_none_or(|events| events > MOST) {
        let columns = pairs.iter().map(|pair| pair.column as usize + 1).max().unwrap_or(0);
        return murty::best(pairs, rows, columns, limits, assigner);
    }
    for own in &mut own {
        own.sort_by(|a, b| b.gain.total_cmp(&a.gain).then(a.column.cmp(&b.column)));
    }
    let mut search = Search::new(own, unresolved, limits);
    search.descend(0, 0.0);
    search.finish()
}

/// Depth-first search with a bound.
struct Search<'a> {
    own: Vec<Vec<Pair>>,
    unresolved: &'a [Unresolved],
    limits: Limits,
    /// Upper bound of the gain of the rows from this one on.
    bound: Vec<f64>,
    columns: Vec<Option<u32>>,
    best: f64,
    found: Vec<Event>,
}

impl<'a> Search<'a> {
    fn new(own: Vec<Vec<Pair>>, unresolved: &'a [Unresolved], limits: Limits) -> Self {
        let rows = own.len();
        let mut bound = vec![0.0; rows + 1];
        for row in (0..rows).rev() {
            let alone = own[row].first().map_or(0.0, |pair| pair.gain);
            // the gain of an unresolved pair is counted with its second row
            let pairs = unresolved.iter().filter(|pair| pair.second as usize == row);
            let together: f64 = pairs
                .map(|pair| {
                    let shared = pair.shared.iter().map(|(_, gain)| *gain);
                    shared.fold(pair.missed.max(0.0), f64::max)
                })
                .sum();
            bound[row] = bound[row + 1] + alone + together;
        }
        let best = f64::NEG_INFINITY;
        Self { own, unresolved, limits, bound, columns: Vec::new(), best, found: Vec::new() }
    }

    fn descend(&mut self, row: usize, gain: f64) {
        if gain + self.bound[row] < self.best - self.limits.cut - ROUNDING {
            return;
        }
        if row == self.own.len() {
            self.best = self.best.max(gain);
            return self.found.push(Event { gain, columns: self.columns.clone() });
        }
        for i in 0..self.own[row].len() {
            let pair = self.own[row][i];
            if !self.columns.contains(&Some(pair.column)) {
                self.next(row, Some(pair.column), gain + pair.gain);
            }
        }
        self.next(row, None, gain);
        for k in 0..self.unresolved.len() {
            let pair = &self.unresolved[k];
            if pair.second as usize != row {
                continue;
            }
            let first = self.columns[pair.first as usize];
            for &(column, together) in &pair.shared {
                let holders = self.columns.iter().filter(|own| **own == Some(column)).count();
                if first == Some(column) && holders == 1 {
                    // the first row no longer has this column alone
                    let alone = self.alone(pair.first as usize, column);
                    self.share(row, column, gain - alone + together);
                }
            }
        }
    }

    /// Gain of a row that is the only one with this column.
    fn alone(&self, row: usize, column: u32) -> f64 {
        let pair = self.own[row].iter().find(|pair| pair.column == column);
        pair.map_or(0.0, |pair| pair.gain)
    }

    fn next(&mut self, row: usize, column: Option<u32>, gain: f64) {
        self.columns.push(column);
        let together = self.together(row, None);
        self.descend(row + 1, gain + together);
        self.columns.pop();
    }

    fn share(&mut self, row: usize, column: u32, gain: f64) {
        self.columns.push(Some(column));
        let together = self.together(row, Some(column));
        self.descend(row + 1, gain + together);
        self.columns.pop();
    }

    /// Gain of the row together with the preceding rows, except for a shared column.
    fn together(&self, row: usize, shared: Option<u32>) -> f64 {
        let pairs = self.unresolved.iter().filter(|pair| pair.second as usize == row);
        pairs
            .map(|pair| match (self.columns[pair.first as usize], self.columns[row]) {
                (None, None) => pair.missed,
                (first, second) if first == second && first == shared => 0.0,
                _ => pair.resolved,
            })
            .sum()
    }

    fn finish(mut self) -> Vec<Event> {
        let least = self.best - self.limits.cut;
        self.found.retain(|event| event.gain >= least);
        sort(&mut self.found);
        self.found.truncate(self.limits.count);
        self.found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;
    use crate::base::random::Random;

    const ALL: Limits = Limits { count: usize::MAX, cut: f64::INFINITY };

    fn pairs(gains: &[&[(u32, f64)]]) -> Vec<Pair> {
        let row = |(row, own): (usize, &&[(u32, f64)])| {
            let row = row as u32;
            own.iter().map(move |&(column, gain)| Pair { row, column, gain }).collect::<Vec<_>>()
        };
        gains.iter().enumerate().flat_map(row).collect()
    }

    /// Probabilities of the columns of each row, the last one of no column, summed over all events.
    fn marginals(events: &[Event], rows: usize, columns: usize) -> Vec<Vec<f64>> {
        let mut sums = vec![vec![0.0; columns + 1]; rows];
        let total: f64 = events.iter().map(|event| event.gain.exp()).sum();
        for event in events {
            for (own, column) in sums.iter_mut().zip(&event.columns) {
                own[column.map_or(columns, |column| column as usize)] += event.gain.exp() / total;
            }
        }
        sums
    }

    /// Three tracks with the weights of a worked example, 0.1 for no plot: every event is found exactly once.
    #[test]
    fn all_events_have_the_marginals_of_jpda() {
        let weights: [&[(u32, f64)]; 3] =
            [&[(0, 8.0), (1, 2.0)], &[(0, 3.0), (1, 5.0), (2, 1.0)], &[(1, 4.0), (2, 6.0)]];
        let gains: Vec<Vec<(u32, f64)>> = weights
            .iter()
            .map(|own| own.iter().map(|&(c, w)| (c, (w / 0.1_f64).ln())).collect())
            .collect();
        let rows: Vec<&[(u32, f64)]> = gains.iter().map(Vec::as_slice).collect();
        let found = events(&pairs(&rows), 3, &[], ALL, &mut Assigner::default());
        // columns 0 to 2, and no column
        let expected = [
            [0.864606317016, 0.115390101702, 0.0, 0.020003581281],
            [0.120276426367, 0.749792862324, 0.101398824247, 0.028531887062],
            [0.0, 0.111808820271, 0.870615585858, 0.017575593871],
        ];
        for (own, expected) in marginals(&found, 3, 3).iter().zip(expected) {
            assert!(own.iter().zip(expected).all(|(p, q)| (p - q).abs() < 1e-12), "{own:?}");
        }
    }

    #[test]
    fn a_cut_and_a_count_keep_the_best() {
        let mut random = Random::new(8);
        for _ in 0..200 {
            let mut drawn = Vec::new();
            for row in 0..3 {
                for column in 0..4 {
                    if random.uniform() < 0.6 {
                        drawn.push(Pair { row, column, gain: random.symmetric(8.0) + 4.0 });
                    }
                }
            }
            let mut assigner = Assigner::default();
            let all = events(&drawn, 3, &[], ALL, &mut assigner);
            assert!(all.is_sorted_by(|a, b| a.gain >= b.gain));
            assert_eq!(all[0].columns, assigner.assign(&drawn, 3, 4));
            let limits = Limits { count: 5, cut: 6.0 };
            let few = events(&drawn, 3, &[], limits, &mut assigner);
            let within = all.iter().filter(|e| e.gain >= all[0].gain - 6.0).take(5);
            assert!(few.iter().eq(within));
        }
    }

    /// Gains of a worked example with two tracks and two plots, and a resolution cell of 150 m and 1.4
    /// degrees.
    #[test]
    fn two_rows_may_share_a_column() {
        let missed = 2.0 * 0.1_f64.ln();
        let unseen = 0.10482397447_f64;
        let resolved = (-unseen).ln_1p();
        let gain = |both: f64, other: f64| both - other;
        let (both, a0, b1) = (21.0470460518, 7.96962574769, 8.47225011816);
        let (b0, a1) = (6.19641126063, 4.96100902177);
        assert_within(1e-10, a0 + b1 - missed, both);
        let alone = pairs(&[
            &[(0, gain(a0, missed)), (1, gain(a1, missed))],
            &[(0, gain(b0, missed)), (1, gain(b1, missed))],
        ]);
        let shared = vec![(0, gain(9.4449871615, missed)), (1, gain(9.06306015705, missed))];
        let close = Unresolved {
            first: 0,
            second: 1,
            resolved,
            missed: (unseen / 0.1 + 1.0 - unseen).ln(),
            shared,
        };
        let found = events(&alone, 2, &[close], ALL, &mut Assigner::default());
        let expected = [
            (20.9363111484, [Some(0), Some(1)]),
            (15.6518555649, [Some(1), Some(0)]),
            (9.4449871615, [Some(0), Some(0)]),
            (9.06306015705, [Some(1), Some(1)]),
            (8.36151521468, [None, Some(1)]),
            (7.85889084421, [Some(0), None]),
            (6.08567635715, [None, Some(0)]),
            (4.8502741183, [Some(1), None]),
            (-3.94072305484, [None, None]),
        ];
        assert_eq!(found.len(), expected.len());
        for (event, (weight, columns)) in found.iter().zip(expected) {
            assert_within(1e-9, event.gain + missed, weight);
            assert_eq!(event.columns, columns);
        }
    }
}
