//! A smooth, critically damped normal process, whose state is its value and its rate.

/// One step of the process: its transition matrix, and a root of the covariance of its noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Process {
    /// Transition matrix, row by row.
    pub transition: [[f64; 2]; 2],
    /// Root of the covariance, row by row.
    pub root: [[f64; 2]; 2],
}

/// The state of the process: its value and its rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wander {
    process: Process,
    state: [f64; 2],
}

impl Wander {
    /// Starts with a value and a rate.
    pub fn new(process: Process, state: [f64; 2]) -> Self {
        Self { process, state }
    }

    /// Returns the present value.
    pub fn value(&self) -> f64 {
        self.state[0]
    }

    /// Advances by one step, with two standard normal numbers.
    pub fn advance(&mut self, push: [f64; 2]) {
        let Process { transition: f, root } = self.process;
        let x = self.state;
        // x ← F x + √Q u
        self.state = [0, 1].map(|i| {
            (f[i][0] * x[0] + f[i][1] * x[1]) + (root[i][0] * push[0] + root[i][1] * push[1])
        });
    }
}
