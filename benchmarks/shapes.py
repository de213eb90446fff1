"""Clean cases of the open world, noise of another shape: `python -m benchmarks.shapes SHAPE KIND --seed N --out DIR`.

All else is as `../shared/worlds/open/make_case.py` has it; its random numbers alone go through a shape.
"""

import runpy
import sys
from pathlib import Path

import numpy as np

OPEN = Path(__file__).parents[2] / "shared" / "worlds" / "open" / "make_case.py"
SERIES = 1000  # numbers from which on they are a series of noise
SPREAD = 0.35  # of the logarithm of an amplitude that changes


def changing(noise: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Noise (n, ...) whose amplitude is another in each series and changes steadily along it."""
    first, last = SPREAD * (rng.standard_normal() + rng.standard_normal() * np.array([-0.5, 0.5]))
    return noise * np.exp(np.linspace(first, last, len(noise))).reshape(-1, *[1] * (noise.ndim - 1))


def tailed(noise: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Noise (n, ...) times what makes white noise follow Student's t with four degrees of freedom, of unit variance."""
    return noise / np.sqrt(rng.chisquare(4, noise.shape) / 4) / np.sqrt(2)


def bumped(noise: np.ndarray, _: np.random.Generator) -> np.ndarray:
    """Noise (n, ...) with a resonance at an eighth of the sampling rate and a red end."""
    frequency = np.fft.rfftfreq(len(noise))
    gain = 1 + 2 * np.exp(-(((frequency - 0.12) / 0.015) ** 2) / 2)
    gain += 0.02 / np.maximum(frequency, 1 / len(noise)) ** 0.7
    spectrum = np.fft.rfft(noise, axis=0) * gain.reshape(-1, *[1] * (noise.ndim - 1))
    return np.fft.irfft(spectrum, len(noise), axis=0)


SHAPES = {"changing": changing, "tailed": tailed, "bumped": bumped}


class Shaped:
    """Source of random numbers whose long normal series go through a shape; all others are as they were."""

    def __init__(self, rng, shape):
        self.rng, self.shape = rng, shape

    def __getattr__(self, name):
        """Any other kind of number."""
        return getattr(self.rng, name)

    def standard_normal(self, size=None):
        """Normal numbers."""
        numbers = self.rng.standard_normal(size)
        return self.shape(numbers, self.rng) if np.size(numbers) >= SERIES else numbers

    def normal(self, loc=0.0, scale=1.0, size=None):
        """Normal numbers of a mean and a spread."""
        return loc + scale * self.standard_normal(size) if size is not None else self.rng.normal(loc, scale)


def main() -> None:
    """Make a case."""
    shape = SHAPES[sys.argv[1]]
    sys.path.insert(0, str(OPEN.parent))
    import truthsim

    plain, coloured = np.random.default_rng, truthsim.colored

    def colored(rng, count, rate_hz, asd):
        """Coloured noise; white numbers with tails are coloured, else coloured ones take the shape."""
        rng = getattr(rng, "rng", rng)
        if shape is not tailed:
            return shape(coloured(rng, count, rate_hz, asd), rng)
        frequency = np.fft.rfftfreq(count, 1 / rate_hz)
        frequency[0] = frequency[1]
        white = np.fft.rfft(tailed(rng.standard_normal(count), rng))
        return np.fft.irfft(white * asd(frequency) * np.sqrt(rate_hz / 2), count)

    np.random.default_rng = lambda *seed: Shaped(plain(*seed), shape)
    truthsim.colored = colored
    sys.argv = [str(OPEN), *sys.argv[2:]]
    runpy.run_path(str(OPEN), run_name="__main__")


if __name__ == "__main__":
    main()
