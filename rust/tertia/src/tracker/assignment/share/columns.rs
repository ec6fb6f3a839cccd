//! The plots of a group, numbered as the columns of its assignment.

/// Index that stands for no column.
const NOWHERE: u32 = u32::MAX;

/// The plot of each column, and the column of each plot.
#[derive(Default)]
pub(super) struct Columns {
    plots: Vec<u32>,
    /// Column of each plot of the scan.
    column: Vec<u32>,
    /// Whether a row has taken the plot of each column.
    taken: Vec<bool>,
}

impl Columns {
    /// Begins a group of a scan with `plots` plots. Cost O(columns of the previous group).
    pub fn clear(&mut self, plots: usize) {
        for &plot in &self.plots {
            self.column[plot as usize] = NOWHERE;
        }
        self.plots.clear();
        self.taken.clear();
        if self.column.len() < plots {
            self.column.resize(plots, NOWHERE);
        }
    }

    /// The column of a plot; a new one if it has none yet.
    pub fn number(&mut self, plot: u32) -> u32 {
        let column = &mut self.column[plot as usize];
        if *column == NOWHERE {
            *column = self.plots.len() as u32;
            self.plots.push(plot);
            self.taken.push(false);
        }
        *column
    }

    /// The column of a plot, if it has one.
    pub fn of(&self, plot: u32) -> Option<u32> {
        let column = self.column[plot as usize];
        (column != NOWHERE).then_some(column)
    }

    /// The plot of a column.
    pub fn plot(&self, column: u32) -> u32 {
        self.plots[column as usize]
    }

    /// Number of columns.
    pub fn len(&self) -> usize {
        self.plots.len()
    }

    /// Notes that a row has taken a plot.
    pub fn take(&mut self, plot: u32) {
        let column = self.number(plot);
        self.taken[column as usize] = true;
    }

    /// Whether a row has taken a plot.
    pub fn is_taken(&self, plot: u32) -> bool {
        self.of(plot).is_some_and(|column| self.taken[column as usize])
    }
}
