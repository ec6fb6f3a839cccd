"""The covariance of a weight matrix, side by side with other ways to it, in one run.

Microseconds of CPU time, the least of several rounds on one thread, and the ratio to Tertia. The
alternatives go through the paper's formulas or their closed form, or differentiate the weight
itself and multiply the Jacobian into the covariance of the sample covariances. Everything must
agree to 1e-9 before it is timed. What is not installed is left out; compilation is not timed.
"""

from functools import partial

from timing import least, optional, report

# isort: split
import numpy as np

from tertia import weights

anp = optional("autograd.numpy")
jax = optional("jax")

N = 30
# of either sensor
C = (1 / (N - 1), 1 / (N - 1))
TOLERANCE = 1e-9
BATCH = 10_000


def tertia_covariance(s):
    return weights.weight_covariance(s, N, n_threads=1)


def tertia_n_of_each(s):
    return weights.weight_covariance(s, [N, N], n_threads=1)


def factors(s, numpy=np):
    """G, W, I - W and S_p of two sensors, also of a batch."""
    s1, s2 = s[..., 0, :, :], s[..., 1, :, :]
    g = numpy.linalg.inv(s1 + s2)
    w, v = s1 @ g, s2 @ g
    return g, w, v, v @ s1


def columns(matrix):
    """Vec stacks columns."""
    return matrix.reshape(-1, order="F")


def commuted(matrix):
    """The product with the commutation matrix, K."""
    size = len(matrix)
    m = int(size**0.5)
    return matrix.reshape(size, m, m).swapaxes(1, 2).reshape(size, size)


def propagate(blocks, s):
    """Equation (10), with dense products."""
    total = 0.0
    for p, covariance, c in zip(blocks, s, C, strict=True):
        product = np.kron(covariance, covariance)
        total = total + p @ (c * (product + commuted(product))) @ p.T
    return total


def loop(s):
    """The paper's (13) and (14), element by element."""
    c1, c2 = np.linalg.inv(s)
    m = len(c1)
    w = np.linalg.inv(c1 + c2) @ c2
    v = np.eye(m) - w
    p1, p2 = np.empty((m * m, m * m)), np.empty((m * m, m * m))
    for j in range(m):
        for i in range(m):
            e = np.zeros((m, m))
            e[i, j] = 1.0
            p1[:, j * m + i] = columns(v @ e @ c1 @ w)
            p2[:, j * m + i] = columns(-w @ e @ c2 @ v)
    return propagate((p1, p2), s)


def kron(s):
    """The Jacobian in closed form, and dense products."""
    g, w, v, _ = factors(s)
    return propagate((np.kron(g, v), -np.kron(g, w)), s)


def terms(s, numpy=np):
    """c1 GW, (I - W) S_p, c2 G (I - W), W S_p and W (I - W), also of a batch."""
    g, w, v, p = factors(s, numpy)
    return C[0] * g @ w, v @ p, C[1] * g @ v, w @ p, w @ v


def einsum(s, numpy=np):
    """C_W in closed form, also of a batch."""
    u1, r1, u2, r2, q = terms(s, numpy)
    result = numpy.einsum("...bq,...ap->...baqp", u1, r1)
    result = result + numpy.einsum("...bq,...ap->...baqp", u2, r2)
    result = result + sum(C) * numpy.einsum("...pb,...aq->...baqp", q, q)
    size = s.shape[-1] ** 2
    return result.reshape(*s.shape[:-3], size, size)


def outer(s):
    """The same by broadcasting and in place."""
    u1, r1, u2, r2, q = terms(s)
    result = u1[..., :, None, :, None] * r1[..., None, :, None, :]
    result += u2[..., :, None, :, None] * r2[..., None, :, None, :]
    scaled = sum(C) * q
    result += np.swapaxes(scaled, -1, -2)[..., :, None, None, :] * q[..., None, :, :, None]
    size = s.shape[-1] ** 2
    return result.reshape(*s.shape[:-3], size, size)


def complex_step(s):
    """Every element of both covariances perturbed, all at once."""
    m = s.shape[-1]
    step = 1e-20
    # [j, i] is E_ij
    changes = 1j * step * np.eye(m * m).reshape(m * m, m, m).swapaxes(1, 2)
    g1 = np.linalg.inv(s[0] + changes + s[1])
    blocks = ((s[0] + changes) @ g1, s[0] @ g1)
    # the sum is the same, whichever of the two is changed
    return propagate([b.imag.swapaxes(1, 2).reshape(m * m, m * m).T / step for b in blocks], s)


def weight(vectors, numpy):
    """Vec W of vec S_1 and vec S_2; the transposed of a matrix stacks its columns."""
    m = int(vectors.shape[-1] ** 0.5)
    s1, s2 = vectors[0].reshape(m, m).T, vectors[1].reshape(m, m).T
    return (s1 @ numpy.linalg.inv(s1 + s2)).T.reshape(-1)


def vectors_of(s):
    return s.swapaxes(1, 2).reshape(2, -1)


ALTERNATIVES = {
    "Tertia, n of each sensor": tertia_n_of_each,
    "E_ij loop (13), (14)": loop,
    "np.kron, dense": kron,
    "einsum, closed form": einsum,
    "NumPy outer, closed form": outer,
    "complex step": complex_step,
}
BATCHED = {"einsum, closed form": einsum, "NumPy outer, closed form": outer}

if anp:
    AUTOGRAD_JACOBIAN = optional("autograd").jacobian(lambda vectors: weight(vectors, anp))

    def autograd_jacobian(s):
        return propagate(np.moveaxis(AUTOGRAD_JACOBIAN(vectors_of(s)), 1, 0), s)

    ALTERNATIVES["autograd jacobian"] = autograd_jacobian

if jax:
    jax.config.update("jax_enable_x64", True)
    jnp = jax.numpy

    def _differentiated(s):
        m = s.shape[-1]
        blocks = jax.jacfwd(lambda vectors: weight(vectors, jnp))(vectors_of(s))
        total = 0.0
        for j, c in enumerate(C):
            product = jnp.kron(s[j], s[j])
            swapped = product.reshape(m * m, m, m).swapaxes(1, 2).reshape(m * m, m * m)
            total = total + blocks[:, j] @ (c * (product + swapped)) @ blocks[:, j].T
        return total

    JAX_DIFFERENTIATED = jax.jit(_differentiated)
    JAX_CLOSED = jax.jit(lambda s: einsum(s, jnp))

    def jax_differentiated(s):
        return JAX_DIFFERENTIATED(s).block_until_ready()

    def jax_closed(s):
        return JAX_CLOSED(s).block_until_ready()

    ALTERNATIVES |= {"JAX jit(jacfwd)": jax_differentiated, "JAX jit(closed form)": jax_closed}
    BATCHED["JAX jit(closed form)"] = jax_closed


def covariances(m, batch=()):
    root = np.random.default_rng(1).standard_normal((*batch, 2, m, 2 * m))
    product = root @ np.swapaxes(root, -1, -2) / (2 * m)
    return (product + np.swapaxes(product, -1, -2)) / 2


def require_agreement(functions, s):
    expected = tertia_covariance(s)
    for name, function in functions.items():
        off = np.abs(function(s) - expected).max() / np.abs(expected).max()
        if not off <= TOLERANCE:
            raise SystemExit(f"{name} is off by {off:.1e} for {s.shape}")


def compare(title, functions, s):
    require_agreement(functions, s)
    everything = {"Tertia": tertia_covariance} | functions
    report(title, least({name: (partial(f, s), 1) for name, f in everything.items()}), "µs")


def main():
    for m in (3, 6, 9):
        compare(f"weight_covariance, m = {m}", ALTERNATIVES, covariances(m))
    compare(f"weight_covariance, m = 3, {BATCH:,} at once", BATCHED, covariances(3, (BATCH,)))


if __name__ == "__main__":
    main()
