//! The best assignment if nearly all pairs compete: shortest augmenting paths (Jonker, Volgenant
//! 1987) over a matrix, whose rows are scanned with SIMD vectors.

use super::pair::Pair;
use crate::base::interrupt::poll;
use crate::base::scratch::refill;
use crate::base::vector::{Vector, WIDEST};
use pulp::{Arch, Simd, WithSimd};

/// Values of adjacent columns.
type Lane = [f64; WIDEST];

/// A matrix is used if at least one of this many elements is a pair, and if it has at least `LEAST` elements.
const SHARE: usize = 4;
const LEAST: usize = 4096;
/// Index that stands for no row or no column.
pub(super) const NONE: u32 = u32::MAX;

/// Whether a matrix is faster than lists of pairs.
pub(super) fn is_dense(pairs: usize, rows: usize, columns: usize) -> bool {
    let elements = rows.saturating_mul(columns);
    elements >= LEAST && pairs >= elements / SHARE
}

/// The cost matrix, and the buffers of a search.
#[derive(Clone, Debug, Default)]
pub(super) struct Dense {
    width: usize,
    /// Negative gains, row by row with `width` lanes; infinite where there is no pair.
    costs: Vec<Lane>,
    /// Price of a column in addition to its cost, never positive; 0 while it is free.
    price: Vec<Lane>,
    /// Price of a column that is not settled; minus infinity once it is settled.
    open: Vec<Lane>,
    /// Distance of each column that is not settled.
    distance: Vec<Lane>,
    /// The row from which a column was reached.
    from: Vec<Lane>,
    /// 0 while a column is free, then infinite.
    taken: Vec<Lane>,
    settled: Vec<(u32, f64)>,
    row_of: Vec<u32>,
    column_of: Vec<u32>,
    /// Order in which rows are placed.
    order: Vec<u32>,
    wish: [Vec<Wish>; 2],
    wanted: Vec<u32>,
}

/// The partner from which a row or a column gains most.
#[derive(Clone, Copy, Debug)]
struct Wish {
    gain: f64,
    partner: u32,
    /// Number of partners from which it gains as much.
    equal: u32,
}

impl Wish {
    const NONE: Self = Self { gain: 0.0, partner: NONE, equal: 0 };

    /// Keeps the better partner; of equal ones, the first.
    fn hear(&mut self, gain: f64, partner: u32) {
        if gain > self.gain {
            *self = Self { gain, partner, equal: 1 };
        } else if gain == self.gain {
            self.partner = self.partner.min(partner);
            self.equal += 1;
        }
    }
}

impl Dense {
    /// Assigns the column of each row for the largest sum of the gains; `result` is empty at first.
    /// O(rows · columns) at best, also if all gains are equal; at worst that times the smaller of the two.
    /// Either the rows or the columns are placed one by one, whichever compete less for the same best
    /// partners, beginning with those that gain most: later ones then seldom displace others.
    pub fn assign(
        &mut self,
        pairs: impl Iterator<Item = Pair> + Clone,
        rows: usize,
        columns: usize,
        result: &mut [Option<u32>],
    ) {
        let [of_rows, of_columns] = self.conflicts(pairs.clone(), rows, columns);
        if of_rows <= of_columns {
            self.place_all(pairs, rows, columns);
            for (result, &column) in result.iter_mut().zip(&self.column_of) {
                *result = (column != NONE).then_some(column);
            }
            return;
        }
        self.wish.swap(0, 1);
        let turned = pairs.map(|pair| Pair { row: pair.column, column: pair.row, ..pair });
        self.place_all(turned, columns, rows);
        for (result, &column) in result.iter_mut().zip(&self.row_of) {
            *result = (column != NONE).then_some(column);
        }
    }

    /// Number of rows, and of columns, whose best partners are already the best partners of others. Those
    /// that come after all partners are taken do not count if they gain equally from several.
    fn conflicts(
        &mut self,
        pairs: impl Iterator<Item = Pair>,
        rows: usize,
        columns: usize,
    ) -> [usize; 2] {
        let Self { wish: [of_rows, of_columns], wanted, .. } = self;
        refill(of_rows, rows, Wish::NONE);
        refill(of_columns, columns, Wish::NONE);
        for Pair { row, column, gain } in pairs {
            assert!((column as usize) < columns, "a column that is not there");
            of_rows[row as usize].hear(gain, column);
            of_columns[column as usize].hear(gain, row);
        }
        [(of_rows, columns), (of_columns, rows)].map(|(wishes, others)| {
            refill(wanted, others, 0);
            let rivals = wishes.iter().filter(|wish| {
                let Some(wanted) = wanted.get_mut(wish.partner as usize) else { return false };
                *wanted += 1;
                *wanted > wish.equal && (wish.equal == 1 || *wanted as usize <= others)
            });
            rivals.count()
        })
    }

    fn place_all(&mut self, pairs: impl Iterator<Item = Pair>, rows: usize, columns: usize) {
        self.reset(rows, columns);
        for pair in pairs {
            let (lane, at) = (pair.column as usize / WIDEST, pair.column as usize % WIDEST);
            let cost = &mut self.costs[pair.row as usize * self.width + lane][at];
            *cost = cost.min(-pair.gain);
        }
        let Self { order, wish: [of_rows, _], .. } = self;
        let gain = |row: &u32| of_rows[*row as usize].gain;
        order.clear();
        order.extend((0..rows as u32).filter(|row| gain(row) > 0.0));
        order.sort_by(|a, b| gain(b).total_cmp(&gain(a)));
        Arch::new().dispatch(Placing(self));
    }

    fn reset(&mut self, rows: usize, columns: usize) {
        self.width = columns.div_ceil(WIDEST);
        let infinite = [f64::INFINITY; WIDEST];
        refill(&mut self.costs, rows * self.width, infinite);
        refill(&mut self.distance, self.width, infinite);
        for buffer in [&mut self.price, &mut self.open, &mut self.from, &mut self.taken] {
            refill(buffer, self.width, [0.0; WIDEST]);
        }
        refill(&mut self.row_of, columns, NONE);
        refill(&mut self.column_of, rows, NONE);
    }

    fn price(&self, column: u32) -> f64 {
        self.price.as_flattened()[column as usize]
    }

    fn cost(&self, row: u32, column: u32) -> f64 {
        let costs = &self.costs[row as usize * self.width..][..self.width];
        costs.as_flattened()[column as usize]
    }

    /// Assigns one additional row if that increases the sum of the gains.
    #[inline(always)]
    fn place<S: Simd>(&mut self, simd: S, first: u32) {
        let (mut row, mut travelled, mut own) = (first, 0.0, 0.0);
        let (mut exit, mut exit_row) = (f64::INFINITY, first);
        self.open.copy_from_slice(&self.price);
        self.distance.fill([f64::INFINITY; WIDEST]);
        self.settled.clear();
        let end = loop {
            // the path may end at a row that gives up its column and remains without one
            if travelled - own < exit {
                (exit, exit_row) = (travelled - own, row);
            }
            let (distance, column) = self.scan(simd, row, travelled - own);
            if distance >= exit {
                travelled = exit;
                break NONE;
            }
            travelled = distance;
            if self.row_of[column as usize] == NONE {
                break column;
            }
            self.settled.push((column, distance));
            self.open.as_flattened_mut()[column as usize] = f64::NEG_INFINITY;
            self.distance.as_flattened_mut()[column as usize] = f64::INFINITY;
            row = self.row_of[column as usize];
            own = self.cost(row, column) - self.price(column);
        };
        for &(column, distance) in &self.settled {
            self.price.as_flattened_mut()[column as usize] += distance - travelled;
        }
        let mut next = if end == NONE {
            std::mem::replace(&mut self.column_of[exit_row as usize], NONE)
        } else {
            end
        };
        // every column on the path is assigned to the row before it
        while next != NONE {
            let row = self.from.as_flattened()[next as usize] as u32;
            self.row_of[next as usize] = row;
            self.taken.as_flattened_mut()[next as usize] = f64::INFINITY;
            next = std::mem::replace(&mut self.column_of[row as usize], next);
            if row == first {
                break;
            }
        }
    }

    /// Extends the search from a row to all columns, and returns the nearest column that is not settled: of
    /// equal ones, the first that is free, so that ties do not extend the search, or else the first.
    #[inline(always)]
    fn scan<S: Simd>(&mut self, simd: S, row: u32, base: f64) -> (f64, u32) {
        let splat = |value| Vector::splat(simd, value);
        let (from, base) = (splat(f64::from(row)), splat(base));
        let (mut least, mut place) = (splat(f64::INFINITY), splat(0.0));
        let (mut least_free, mut free_place) = (least, place);
        let costs = &self.costs[row as usize * self.width..][..self.width];
        let rest = self.open.iter().zip(&mut self.distance).zip(&mut self.from).zip(&self.taken);
        for (lane, (costs, (((open, distance), origin), taken))) in
            costs.iter().zip(rest).enumerate()
        {
            for at in 0..WIDEST / S::F64_LANES {
                let through = base + (Vector::load(simd, costs, at) - Vector::load(simd, open, at));
                let before = Vector::load(simd, distance, at);
                let stays = before.at_most(through);
                let nearest = before.or(stays, through);
                nearest.store(distance, at);
                Vector::load(simd, origin, at).or(stays, from).store(origin, at);
                let here = splat((lane * WIDEST + at * S::F64_LANES) as f64);
                let later = least.at_most(nearest);
                least = least.or(later, nearest);
                place = place.or(later, here);
                let free = nearest + Vector::load(simd, taken, at);
                let later = least_free.at_most(free);
                least_free = least_free.or(later, free);
                free_place = free_place.or(later, here);
            }
        }
        let free = first(least_free, free_place);
        let any = first(least, place);
        if free.0 <= any.0 { free } else { any }
    }
}

/// The least of these distances and its column, given the columns of the first lane; of equal ones, the
/// first column.
#[inline(always)]
fn first<S: Simd>(least: Vector<S>, place: Vector<S>) -> (f64, u32) {
    let (mut distances, mut places) = ([f64::INFINITY; WIDEST], [0.0; WIDEST]);
    least.store(&mut distances, 0);
    place.store(&mut places, 0);
    let columns = (0..S::F64_LANES).map(|i| (distances[i], places[i] as u32 + i as u32));
    columns.fold((f64::INFINITY, NONE), |a, b| if (b.0, b.1) < a { b } else { a })
}

struct Placing<'a>(&'a mut Dense);

impl WithSimd for Placing<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for at in 0..self.0.order.len() {
            poll();
            self.0.place(simd, self.0.order[at]);
        }
    }
}
