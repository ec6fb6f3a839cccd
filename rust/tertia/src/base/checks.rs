//! Comparisons and instruction sets for the tests of all concepts.

/// Compares to twelve digits; the expected values are printed with more.
pub fn assert_close(found: f64, expected: f64) {
    assert_within(1e-12, found, expected);
}

/// [`assert_close`] for every element; zeros must be exact.
pub fn assert_all_close(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len());
    for (&found, &expected) in found.iter().zip(expected) {
        assert_close(found, expected);
    }
}

/// Compares within a tolerance relative to the expected value.
pub fn assert_within(tolerance: f64, found: f64, expected: f64) {
    let error = (found - expected).abs();
    assert!(
        error <= tolerance * expected.abs(),
        "{found:.17e} is not {expected:.17e}: {error:.1e} off"
    );
}

/// Instruction sets on which a kernel must return the same bits.
#[derive(Clone, Copy)]
pub enum Level {
    /// One number at a time.
    Scalar,
    /// AVX2.
    #[cfg(target_arch = "x86_64")]
    V3(pulp::x86::V3),
    /// AVX-512.
    #[cfg(target_arch = "x86_64")]
    V4(pulp::x86::V4),
}

impl Level {
    /// Returns the instruction sets of this machine.
    pub fn all() -> Vec<Self> {
        let found = vec![Self::Scalar];
        #[cfg(target_arch = "x86_64")]
        let found = {
            let avx2 = pulp::x86::V3::try_new().map(Self::V3);
            let avx512 = pulp::x86::V4::try_new().map(Self::V4);
            found.into_iter().chain(avx2).chain(avx512).collect()
        };
        found
    }

    /// Runs a kernel with this instruction set.
    pub fn run<W: pulp::WithSimd>(self, kernel: W) -> W::Output {
        match self {
            Self::Scalar => pulp::Simd::vectorize(pulp::Scalar, kernel),
            #[cfg(target_arch = "x86_64")]
            Self::V3(simd) => pulp::Simd::vectorize(simd, kernel),
            #[cfg(target_arch = "x86_64")]
            Self::V4(simd) => pulp::Simd::vectorize(simd, kernel),
        }
    }
}
