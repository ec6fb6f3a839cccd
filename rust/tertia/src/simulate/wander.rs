//! A normal process whose rate is a process, too (critically damped).

/// One step of the process: its transition, and a root of the covariance of its noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Process {
    /// Row by row.
    pub transition: [[f64; 2]; 2],
    /// Row by row.
    pub root: [[f64; 2]; 2],
}

/// The process and its rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wander {
    process: Process,
    state: [f64; 2],
}

impl Wander {
    /// Starts from a value and a rate.
    pub fn new(process: Process, state: [f64; 2]) -> Self {
        Self { process, state }
    }

    /// The process now.
    pub fn value(&self) -> f64 {
        self.state[0]
    }

    /// Goes on by a step, with two standard normal numbers.
    pub fn advance(&mut self, push: [f64; 2]) {
        let Process { transition: f, root } = self.process;
        let x = self.state;
        // x ← F x + √Q u
        self.state = [0, 1].map(|i| {
            (f[i][0] * x[0] + f[i][1] * x[1]) + (root[i][0] * push[0] + root[i][1] * push[1])
        });
    }
}
