"""Random series: coloured noise from a table of densities, and smooth disturbances."""

import numpy as np

LINEAR = {  # amplitude density, m s-2 Hz-1/2, of SRF axes
    "x": ([0.1, 0.25, 0.35, 1.0, 5.0], [1.7e-10, 1.7e-10, 1e-10, 1e-10, 9e-10]),
    "y": ([0.1, 3.0, 4.0, 5.0], [1.7e-10, 1.7e-10, 3.5e-10, 3.5e-10]),
    "z": ([0.1, 0.2, 1.0, 5.0], [1e-10, 1e-10, 2.4e-10, 9.7e-10]),
}
ANGULAR = {  # rad s-2 Hz-1/2
    "x": ([0.1, 0.2, 1.0, 5.0], [3e-8, 3e-8, 1.3e-8, 1.3e-8]),
    "y": ([0.1, 0.2, 0.6, 1.0, 5.0], [1.7e-8, 1.7e-8, 7e-9, 7e-9, 9e-8]),
    "z": ([0.1, 5.0], [1.7e-8, 1.7e-8]),
}


def density(table, frequency_hz):
    """Density at frequencies, straight in log-log, flat outside the table."""
    knots, values = table
    return np.exp(np.interp(np.log(np.maximum(frequency_hz, 1e-6)), np.log(knots), np.log(values)))


def coloured(rng, count, tables, rate_hz=10.0):
    """Series (count, 3) with the one-sided densities of the tables."""
    size = 2 ** int(np.ceil(np.log2(2 * count)))
    shape = [density(tables[axis], np.fft.rfftfreq(size, 1 / rate_hz)) for axis in "xyz"]
    white = np.fft.rfft(rng.normal(0, np.sqrt(rate_hz / 2), (3, size)))
    return np.fft.irfft(white * shape, size)[:, :count].T


class Smooth:
    """Slow vector: constant, once and twice per revolution, and eight slow sines per axis."""

    def __init__(self, rng, constant, harmonic, slow):
        self.constant, self.harmonic = np.asarray(constant, float), rng.normal(0, harmonic, (4, 3))
        self.amplitude = rng.normal(0, slow, (8, 3))
        self.frequency = 1 / rng.uniform(250.0, 1200.0, (8, 3))
        self.phase = rng.uniform(0, 2 * np.pi, (8, 3))

    def __call__(self, seconds):
        """Vector (n, 3)."""
        u = 2 * np.pi * np.asarray(seconds)[:, None] / 5670.0
        orbital = np.hstack([np.sin(u), np.cos(u), np.sin(2 * u), np.cos(2 * u)]) @ self.harmonic
        out = self.constant + orbital
        for a, f, p in zip(self.amplitude, self.frequency, self.phase, strict=True):
            out = out + a * np.sin(2 * np.pi * f * np.asarray(seconds)[:, None] + p)
        return out
