//! What the tests of every concept compare with.

/// Twelve digits; the expected values are printed with more.
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

/// Relative to what is expected.
pub fn assert_within(tolerance: f64, found: f64, expected: f64) {
    let error = (found - expected).abs();
    assert!(
        error <= tolerance * expected.abs(),
        "{found:.17e} is not {expected:.17e}: {error:.1e} off"
    );
}
