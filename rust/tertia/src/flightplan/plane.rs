//! Vectors and angles in the plane.

/// East and north.
pub(super) type Vector = [f64; 2];

pub(super) fn minus(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1]]
}

/// `a + t b`
pub(super) fn along(a: Vector, t: f64, b: Vector) -> Vector {
    [a[0] + t * b[0], a[1] + t * b[1]]
}

pub(super) fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

/// Cross product, positive if b is to the left of a.
pub(super) fn cross(a: Vector, b: Vector) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

pub(super) fn norm(a: Vector) -> f64 {
    a[0].hypot(a[1])
}

/// Returns the vector scaled to length 1; `None` for the zero vector.
pub(super) fn unit(a: Vector) -> Option<Vector> {
    let length = norm(a);
    (length > 0.0).then(|| [a[0] / length, a[1] / length])
}

/// The normal to the left.
pub(super) fn left(a: Vector) -> Vector {
    [-a[1], a[0]]
}

/// Rotates a vector counter-clockwise.
pub(super) fn turned(a: Vector, angle: f64) -> Vector {
    let (sine, cosine) = angle.sin_cos();
    [cosine * a[0] - sine * a[1], sine * a[0] + cosine * a[1]]
}

/// Angle from a to b, in (−π, π].
pub(super) fn between(a: Vector, b: Vector) -> f64 {
    cross(a, b).atan2(dot(a, b))
}
