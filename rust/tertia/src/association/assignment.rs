//! Assignments of at most one column to each row and one row to each column: the best and a quick one.
//!
//! Rows are tracks and columns plots, or vice versa. The best assignment is found by shortest
//! augmenting paths (Jonker, Volgenant 1987) over the given pairs only, so the cost is low if few
//! pairs compete, regardless of the number of rows and columns. As paths follow pairs, independent
//! components are solved separately; single pairs and rows with free columns need no search. If
//! nearly all pairs are given, a matrix is faster than lists of pairs.

use super::dense::{Dense, NONE, is_dense};
use super::grid::accumulate;
use super::pair::Pair;
use crate::base::interrupt::poll;
use crate::base::scratch::refill;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// A pair in the list of its row.
#[derive(Clone, Copy, Debug)]
struct Edge {
    column: u32,
    /// The negative gain.
    cost: f64,
}

/// A column that a path has reached; the heap returns the nearest first and, of equally near ones, a free
/// one, so that ties do not extend the search.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Reached {
    distance: f64,
    is_taken: bool,
    column: u32,
}

impl Eq for Reached {}

impl Ord for Reached {
    fn cmp(&self, other: &Self) -> Ordering {
        let rest = |one: &Self| (one.is_taken, one.column);
        other.distance.total_cmp(&self.distance).then(rest(other).cmp(&rest(self)))
    }
}

impl PartialOrd for Reached {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// The end of an augmenting path.
#[derive(Clone, Copy, Debug)]
enum End {
    /// A free column.
    Column(u32),
    /// A row that remains without a column.
    Row(u32),
}

/// The buffers of assignments; repeated use allocates no more memory.
#[derive(Clone, Debug, Default)]
pub struct Assigner {
    edges: Vec<Edge>,
    /// Start of the edges of each row, and the end of the last ones.
    start: Vec<u32>,
    result: Vec<Option<u32>>,
    row_of: Vec<u32>,
    /// Cost of the assigned pair of a row.
    cost_of: Vec<f64>,
    /// Price of a column in addition to its cost, never positive; 0 while it is free.
    price: Vec<f64>,
    distance: Vec<f64>,
    /// The row from which a column was reached.
    from: Vec<u32>,
    settled: Vec<bool>,
    reached: Vec<u32>,
    heap: BinaryHeap<Reached>,
    order: Vec<u32>,
    dense: Dense,
}

impl Assigner {
    /// Returns the column of each row for the largest sum of the gains. Ties are broken by the indices,
    /// not by the order of `pairs`.
    ///
    /// # Panics
    /// An index that is not below `rows` or `columns`.
    pub fn assign(&mut self, pairs: &[Pair], rows: usize, columns: usize) -> &[Option<u32>] {
        self.assign_all(pairs.iter().copied(), rows, columns)
    }

    /// [`Self::assign`] for pairs that are computed on demand.
    pub(super) fn assign_all(
        &mut self,
        pairs: impl ExactSizeIterator<Item = Pair> + DoubleEndedIterator + Clone,
        rows: usize,
        columns: usize,
    ) -> &[Option<u32>] {
        self.reset(rows, columns);
        if is_dense(pairs.len(), rows, columns) {
            let pairs = pairs.filter(Pair::counts);
            self.dense.assign(pairs, rows, columns, &mut self.result);
            return &self.result;
        }
        self.read(pairs);
        for row in 0..rows {
            poll();
            self.place(row as u32);
        }
        &self.result
    }

    /// Returns the column of each row if the best remaining pair is taken repeatedly; of equal gains, the
    /// pair with the first row, then with the first column. Cost O(P log P).
    ///
    /// # Panics
    /// An index that is not below `rows` or `columns`.
    pub fn nearest(&mut self, pairs: &[Pair], rows: usize, columns: usize) -> &[Option<u32>] {
        self.reset(rows, columns);
        self.order.clear();
        self.order.extend((0..pairs.len() as u32).filter(|&i| pairs[i as usize].counts()));
        self.order.sort_unstable_by(|&a, &b| {
            let (a, b) = (&pairs[a as usize], &pairs[b as usize]);
            b.gain.total_cmp(&a.gain).then((a.row, a.column).cmp(&(b.row, b.column)))
        });
        for &i in &self.order {
            let Pair { row, column, .. } = pairs[i as usize];
            if self.result[row as usize].is_none() && self.row_of[column as usize] == NONE {
                self.result[row as usize] = Some(column);
                self.row_of[column as usize] = row;
            }
        }
        &self.result
    }

    fn reset(&mut self, rows: usize, columns: usize) {
        refill(&mut self.result, rows, None);
        refill(&mut self.row_of, columns, NONE);
    }

    /// Sorts the valid pairs by row and column.
    fn read(&mut self, pairs: impl DoubleEndedIterator<Item = Pair> + Clone) {
        let (rows, columns) = (self.result.len(), self.row_of.len());
        refill(&mut self.start, rows + 1, 0);
        refill(&mut self.cost_of, rows, 0.0);
        refill(&mut self.price, columns, 0.0);
        refill(&mut self.distance, columns, f64::INFINITY);
        refill(&mut self.from, columns, NONE);
        refill(&mut self.settled, columns, false);
        for pair in pairs.clone().filter(Pair::counts) {
            assert!((pair.column as usize) < columns, "a column that is not there");
            self.start[..rows][pair.row as usize] += 1;
        }
        let end = accumulate(&mut self.start);
        refill(&mut self.edges, end as usize, Edge { column: 0, cost: 0.0 });
        for pair in pairs.rev().filter(Pair::counts) {
            let start = &mut self.start[pair.row as usize];
            *start -= 1;
            self.edges[*start as usize] = Edge { column: pair.column, cost: -pair.gain };
        }
        for row in 0..rows {
            let edges = &mut self.edges[self.start[row] as usize..self.start[row + 1] as usize];
            if !edges.is_sorted_by_key(|edge| edge.column) {
                edges.sort_by(|a, b| a.column.cmp(&b.column).then(a.cost.total_cmp(&b.cost)));
            }
        }
    }

    fn edges_of(&self, row: u32) -> std::ops::Range<usize> {
        self.start[row as usize] as usize..self.start[row as usize + 1] as usize
    }

    /// Assigns one additional row.
    fn place(&mut self, row: u32) {
        // most rows take a column that no other row wants
        let mut best = Reached { distance: 0.0, is_taken: true, column: NONE };
        let mut best_cost = 0.0;
        for &Edge { column, cost } in &self.edges[self.edges_of(row)] {
            let distance = cost - self.price[column as usize];
            let is_tie = distance == best.distance && best.is_taken && best.column != NONE;
            if distance < best.distance || is_tie {
                let is_taken = self.row_of[column as usize] != NONE;
                if !(is_tie && is_taken) {
                    (best, best_cost) = (Reached { distance, is_taken, column }, cost);
                }
            }
        }
        if best.column == NONE {
            return;
        }
        if !best.is_taken {
            self.result[row as usize] = Some(best.column);
            self.row_of[best.column as usize] = row;
            self.cost_of[row as usize] = best_cost;
            return;
        }
        let end = self.search(row);
        self.augment(row, end);
    }

    /// Finds the nearest end of a path from a free row (Dijkstra), and updates the prices for that path.
    fn search(&mut self, first: u32) -> End {
        let (mut row, mut travelled, mut own) = (first, 0.0, 0.0);
        let (mut exit, mut exit_row) = (f64::INFINITY, first);
        let end = loop {
            // the path may end at a row that gives up its column and remains without one
            if travelled - own < exit {
                (exit, exit_row) = (travelled - own, row);
            }
            for at in self.edges_of(row) {
                let Edge { column, cost } = self.edges[at];
                let j = column as usize;
                let distance = travelled + (cost - self.price[j]) - own;
                if distance < self.distance[j] && distance < exit && !self.settled[j] {
                    if self.distance[j] == f64::INFINITY {
                        self.reached.push(column);
                    }
                    (self.distance[j], self.from[j]) = (distance, row);
                    let is_taken = self.row_of[j] != NONE;
                    self.heap.push(Reached { distance, is_taken, column });
                }
            }
            let next = loop {
                match self.heap.pop() {
                    Some(next) if next.distance >= exit => break None,
                    Some(next) if self.settled[next.column as usize] => {}
                    next => break next,
                }
            };
            let Some(Reached { distance, is_taken, column }) = next else {
                travelled = exit;
                break End::Row(exit_row);
            };
            travelled = distance;
            if !is_taken {
                break End::Column(column);
            }
            self.settled[column as usize] = true;
            row = self.row_of[column as usize];
            own = self.cost_of[row as usize] - self.price[column as usize];
        };
        for &column in &self.reached {
            let j = column as usize;
            if self.settled[j] {
                self.price[j] += self.distance[j] - travelled;
            }
            (self.distance[j], self.settled[j]) = (f64::INFINITY, false);
        }
        self.reached.clear();
        self.heap.clear();
        end
    }

    /// Assigns every column on the path to the row before it.
    fn augment(&mut self, first: u32, end: End) {
        let mut next = match end {
            End::Column(column) => Some(column),
            End::Row(row) => self.result[row as usize].take(),
        };
        while let Some(column) = next {
            let row = self.from[column as usize];
            self.row_of[column as usize] = row;
            self.cost_of[row as usize] = self.cost(row, column);
            next = self.result[row as usize].replace(column);
            if row == first {
                break;
            }
        }
    }

    /// Smallest cost of a pair.
    fn cost(&self, row: u32, column: u32) -> f64 {
        let edges = &self.edges[self.edges_of(row)];
        let first = edges.partition_point(|edge| edge.column < column);
        let same = edges[first..].iter().take_while(|edge| edge.column == column);
        same.fold(0.0, |least, edge| edge.cost.min(least))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    /// Sum of the gains, after checking that no column is used twice and every choice is a given pair.
    fn total(pairs: &[Pair], result: &[Option<u32>], columns: usize) -> f64 {
        let mut used = vec![false; columns];
        let mut total = 0.0;
        for (row, column) in result.iter().enumerate() {
            let Some(column) = column else { continue };
            assert!(!std::mem::replace(&mut used[*column as usize], true));
            let same = |p: &&Pair| p.row as usize == row && p.column == *column && p.counts();
            total += pairs.iter().filter(same).map(|p| p.gain).fold(f64::NAN, f64::max);
        }
        total
    }

    /// Largest sum of the gains over all possible choices.
    fn brute(pairs: &[Pair], rows: u32, used: &mut [bool], row: u32) -> f64 {
        if row == rows {
            return 0.0;
        }
        let mut best = brute(pairs, rows, used, row + 1);
        for pair in pairs.iter().filter(|pair| pair.row == row && pair.counts()) {
            let j = pair.column as usize;
            if !used[j] {
                used[j] = true;
                best = best.max(pair.gain + brute(pairs, rows, used, row + 1));
                used[j] = false;
            }
        }
        best
    }

    fn assign(pairs: &[Pair], rows: usize, columns: usize) -> Vec<Option<u32>> {
        Assigner::default().assign(pairs, rows, columns).to_vec()
    }

    fn nearest(pairs: &[Pair], rows: usize, columns: usize) -> Vec<Option<u32>> {
        Assigner::default().nearest(pairs, rows, columns).to_vec()
    }

    fn drawn(random: &mut Random, rows: usize, columns: usize, share: f64) -> Vec<Pair> {
        let mut pairs = Vec::new();
        for row in 0..rows as u32 {
            for column in 0..columns as u32 {
                if random.uniform() < share {
                    // integer gains produce ties
                    let gain = random.symmetric(6.0) + 2.0;
                    let gain = if random.uniform() < 0.5 { gain.round() } else { gain };
                    pairs.push(Pair { row, column, gain });
                }
            }
        }
        pairs
    }

    #[test]
    fn against_brute_force() {
        let mut random = Random::new(2);
        let mut assigner = Assigner::default();
        for (rows, columns) in [(1, 1), (1, 5), (5, 1), (3, 3), (4, 6), (6, 4), (5, 5)] {
            for share in [0.2, 0.5, 1.0] {
                for _ in 0..200 {
                    let pairs = drawn(&mut random, rows, columns, share);
                    let result = assigner.assign(&pairs, rows, columns).to_vec();
                    let expected = brute(&pairs, rows as u32, &mut vec![false; columns], 0);
                    let found = total(&pairs, &result, columns);
                    assert!((found - expected).abs() < 1e-12, "{pairs:?} {result:?}");
                    assert_eq!(result, assign(&pairs, rows, columns));
                    let greedy = assigner.nearest(&pairs, rows, columns).to_vec();
                    assert!(total(&pairs, &greedy, columns) <= found + 1e-12);
                }
            }
        }
    }

    /// Lists and matrix give the same sum, and the same choice if no two sums are equal.
    #[test]
    fn dense_and_sparse_agree() {
        let mut random = Random::new(5);
        for (rows, columns) in [(64, 64), (70, 90), (90, 70), (64, 131)] {
            for share in [0.3, 1.0] {
                let mut pairs = drawn(&mut random, rows, columns, share);
                for whole in [true, false] {
                    if !whole {
                        pairs.iter_mut().for_each(|p| p.gain += 1e-3 * random.uniform());
                    }
                    let mut assigner = Assigner::default();
                    assigner.reset(rows, columns);
                    let counting = pairs.iter().copied().filter(Pair::counts);
                    assigner.dense.assign(counting, rows, columns, &mut assigner.result);
                    let dense = assigner.result.clone();
                    assigner.reset(rows, columns);
                    assigner.read(pairs.iter().copied());
                    (0..rows as u32).for_each(|row| assigner.place(row));
                    let expected = total(&pairs, &assigner.result, columns);
                    assert!((total(&pairs, &dense, columns) - expected).abs() < 1e-9);
                    assert!(whole || dense == assigner.result);
                }
            }
        }
    }

    #[test]
    fn the_order_of_the_pairs_does_not_matter() {
        let mut random = Random::new(3);
        for _ in 0..300 {
            let pairs = drawn(&mut random, 6, 6, 0.6);
            let mut shuffled = pairs.clone();
            for i in (1..shuffled.len()).rev() {
                shuffled.swap(i, (random.uniform() * (i + 1) as f64) as usize);
            }
            assert_eq!(assign(&pairs, 6, 6), assign(&shuffled, 6, 6));
            assert_eq!(nearest(&pairs, 6, 6), nearest(&shuffled, 6, 6));
        }
    }

    #[test]
    fn greed_is_not_best() {
        let pair = |row, column, gain| Pair { row, column, gain };
        let pairs = [pair(0, 0, 5.0), pair(0, 1, 4.0), pair(1, 0, 4.0)];
        assert_eq!(nearest(&pairs, 2, 2), [Some(0), None]);
        assert_eq!(assign(&pairs, 2, 2), [Some(1), Some(0)]);
        // a row gives up its column to a row with a larger gain
        assert_eq!(assign(&[pair(0, 0, 1.0), pair(1, 0, 3.0)], 2, 1), [None, Some(0)]);
    }

    #[test]
    fn what_is_worth_nothing_is_left_out() {
        for gain in [0.0, -1.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let pairs = [Pair { row: 0, column: 0, gain }];
            assert_eq!(assign(&pairs, 1, 1), [None]);
            assert_eq!(nearest(&pairs, 1, 1), [None]);
        }
        assert!(assign(&[], 0, 0).is_empty());
        assert_eq!(assign(&[], 2, 0), [None, None]);
    }

    #[test]
    fn equal_pairs_count_once() {
        let pair = |row, column, gain| Pair { row, column, gain };
        let pairs = [pair(0, 0, 1.0), pair(0, 0, 3.0), pair(1, 0, 2.0), pair(0, 1, 0.5)];
        assert_eq!(assign(&pairs, 2, 2), [Some(0), None]);
    }

    #[test]
    fn a_chain_that_is_long() {
        // each row gains a little less from its own column than from the next one
        let n = 3000_u32;
        let mut pairs = Vec::new();
        for row in 0..n {
            pairs.push(Pair { row, column: row, gain: 1.0 });
            pairs.push(Pair { row, column: row + 1, gain: 1.0001 });
        }
        pairs.push(Pair { row: n, column: n, gain: 9.0 });
        let result = assign(&pairs, n as usize + 1, n as usize + 1);
        assert!((0..=n).all(|row| result[row as usize] == Some(row)));
    }

    #[test]
    #[should_panic(expected = "a column that is not there")]
    fn a_column_must_be_there() {
        let _ = assign(&[Pair { row: 0, column: 3, gain: 1.0 }], 1, 3);
    }
}
