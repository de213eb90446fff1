"""How the shipped field was made: low degrees as of the Earth, rounded; the rest drawn by Kaula's rule.

python tests/io/shipped_field.py FILE
"""

import sys

import numpy as np

from gravcal.io.icgem import write_field
from gravcal.physics.constants import EARTH_RADIUS, GM
from gravcal.physics.gravity_field import Field

DEGREE, SEED, SIGMA = 60, 20180522, 1e-11
#: (n, m): C, S in 1e-6, textbook values of the Earth to five digits.
EARTH = {
    (2, 0): (-484.16948, 0.0),
    (2, 2): (2.4394, -1.4003),
    (3, 0): (0.95716, 0.0),
    (3, 1): (2.0305, 0.24820),
    (3, 2): (0.90479, -0.61901),
    (3, 3): (0.72132, 1.4143),
    (4, 0): (0.53997, 0.0),
    (4, 1): (-0.53616, -0.47357),
    (4, 2): (0.35050, 0.66248),
    (4, 3): (0.99086, -0.20096),
    (4, 4): (-0.18852, 0.30880),
    (5, 0): (0.068659, 0.0),
    (6, 0): (-0.14995, 0.0),
    (7, 0): (0.090513, 0.0),
    (8, 0): (0.049476, 0.0),
}
COMMENT = """Invented gravity field for gravcal, in the public domain. GM, radius and the lowest degrees are those
of the Earth, rounded; all other coefficients are random with the power of Kaula's rule (1e-5/n^2), to ten digits.
Not a model of the Earth: use a real .gfc file for real data. Standard deviations are invented too: 1e-11 each."""


def generated() -> Field:
    """The shipped field."""
    rng = np.random.default_rng(SEED)
    n, m = np.arange(DEGREE + 1)[:, None], np.arange(DEGREE + 1)[None, :]
    rule = np.where((m <= n) & (n >= 2), 1e-5 / np.maximum(n, 1) ** 2, 0.0)
    cosine, sine = (rule * rng.standard_normal(rule.shape) for _ in range(2))
    for (degree, order), (c, s) in EARTH.items():
        cosine[degree, order], sine[degree, order] = 1e-6 * c, 1e-6 * s
    cosine[0, 0] = 1.0
    cosine[2, 1], sine[2, :2], sine[:, 0] = 0.0, 0.0, 0.0
    cosine, sine = (np.vectorize(lambda v: float(f"{v:.9e}"))(part) for part in (cosine, sine))
    sigma = np.where(rule > 0, SIGMA, 0.0)
    return Field(GM, EARTH_RADIUS, cosine, sine, sigma, np.where(m > 0, sigma, 0.0), name="gravcal-60")


if __name__ == "__main__":
    write_field(sys.argv[1], generated(), COMMENT)
