"""The model written out sample by sample, and a family of small problems of every kind."""

import cmath

import numpy as np

from tmca.dbd import Channel, Truth, simulate
from tmca.dbd.channel import no_paths

KINDS = {
    "shared": {},
    "even": {"M": 8, "P": 6},
    "block": {"messages": "block"},
    "dense": {"messages": "dense", "M": 9},
    "three pulses a symbol": {"symbol_ratio": 3},
    "two symbols a pulse": {"symbol_ratio": 0.5},
    "antennas": {"antennas": 3, "P": 4},
    "antennas, block": {"antennas": 2, "messages": "block"},
    "one pulse": {"P": 1, "M": 8},
    "one frequency": {"M": 1, "P": 9, "J": 1, "targets": 1},
    "two radars": {"targets": (1, 2)},
    "known waveforms": {"known_waveforms": True},
}


def small(kind, **more):
    """A problem of a kind, 7 frequencies and 5 pulses unless the kind says otherwise."""
    return simulate(**{"M": 7, "P": 5, "J": 2, "targets": 2, "paths": 1, "seed": 3, **KINDS[kind], **more})


def samples(shape, sources, truth):
    """Thesis equation (58), with n from −⌊M/2⌋."""
    y = np.zeros(shape, complex)
    for a, p, column in np.ndindex(*shape):
        n = column - shape[2] // 2
        for source, channel in zip(sources, truth, strict=True):
            J = source.rows.shape[2]
            v = channel.waveform[source.message[p] * J : (source.message[p] + 1) * J]
            sent = sum(source.rows[p, column, j] * v[j] for j in range(J))
            for (tau, nu, theta), gain in zip(channel.points, channel.amplitudes, strict=True):
                y[a, p, column] += gain * sent * cmath.exp(-2j * cmath.pi * (n * tau + p * nu + a * theta))
    return y


def polynomial(source, q, point):
    """``f(τ, ν, θ)`` of thesis equations (77) and (78), one number after the other."""
    J = source.rows.shape[2]
    f = np.zeros((source.message[-1] + 1) * J, complex)
    for a, p, column in np.ndindex(*q.shape):
        n = column - q.shape[2] // 2
        wave = cmath.exp(2j * cmath.pi * (n * point[0] + p * point[1] + a * point[2]))
        for j in range(J):
            f[source.message[p] * J + j] += q[a, p, column] * source.rows[p, column, j].conjugate() * wave
    return f


def full(atoms, point):
    """A point of these atoms as delay, Doppler and angle."""
    values = dict(zip(atoms.axes, point, strict=True))
    return [values.get(axis, 0.0) for axis in ("delay", "doppler", "angle")]


def alone(atoms, point, weight):
    """The samples of one path by the slow loop."""
    truth = Truth(np.array([full(atoms, point)]), np.ones(1), weight)
    return samples(atoms.shape, (atoms.source,), (truth,)).reshape(-1)


def lifted(problem, positions, weights):
    """Lifted channels at these positions with these coefficients, by source."""
    triples = zip(no_paths(problem), positions, weights, strict=True)
    return [Channel.from_weights(one.atoms, np.array(x), np.array(w, complex)) for one, x, w in triples]


def scattered(problem, count, seed=0):
    """Lifted channels with random atoms."""
    rng, families = np.random.default_rng(seed), [one.atoms for one in no_paths(problem)]
    pairs = [(rng.random((count, len(atoms.axes))), noise(rng, count, atoms.size)) for atoms in families]
    return lifted(problem, *zip(*pairs, strict=True))


def true_positions(problem):
    """The true points of every source in the coordinates of its lifted atoms."""
    pairs = zip(no_paths(problem), problem.truth, strict=True)
    return [one.atoms.seen(truth.points) for one, truth in pairs]


def moved(truth, step):
    """The same channel with all paths shifted in delay, Doppler and angle."""
    return Truth(truth.points + np.asarray(step, float), truth.amplitudes, truth.waveform)


def slopes(function, x, step=1e-6):
    """Central differences of a function of a real vector, one column a coordinate."""
    x = np.asarray(x, float)
    columns = []
    for at in range(x.size):
        ahead, behind = x.copy(), x.copy()
        ahead[at] += step
        behind[at] -= step
        columns.append((np.asarray(function(ahead)) - np.asarray(function(behind))) / (2 * step))
    return np.stack(columns, axis=-1)


def noise(rng, *shape):
    """Complex, of variance one."""
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)
