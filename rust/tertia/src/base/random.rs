//! Reproducible random numbers for tests.

/// Knuth's MMIX generator.
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Returns a number between 0 and 1.
    pub fn uniform(&mut self) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Returns a number between −size and size.
    pub fn symmetric(&mut self, size: f64) -> f64 {
        size * (2.0 * self.uniform() - 1.0)
    }
}

/// The i-th value of noise without a generator, with mean 0 and between −2 and 2.
pub fn noise(i: usize) -> f64 {
    let phase = |step: f64| (i as f64 * step).fract() * 2.0 - 1.0;
    phase(0.754_877_666_246_692_8) + phase(0.569_840_290_998_053_3)
}
