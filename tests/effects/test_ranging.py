"""Effects of the ranging."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gravcal.effects.base import Context
from gravcal.effects.ranging import EFFECTS, RIPPLE

BY_SLUG = {entry.slug: entry for entry in EFFECTS}
TIME = np.arange(5.0)
ANGLE = np.zeros((5, 2, 2))
ANGLE[:, 0, 0] = RIPPLE * np.arange(5) / 4
LINE = np.tile([[1.0, 0.0, 0.02], [1.0, 0.01, 0.0]], (5, 1, 1))
EXTRA = {"angle": ANGLE, "range": np.full(5, 2e5), "range_rate": np.full(5, 0.5), "antenna_correction": np.full(5, 2.9)}
EXTRA |= {"line_of_sight_b": LINE, "antenna_x": np.array([1.4, 1.5]), "argument": np.pi / 2 * TIME, "warmth": TIME / 4}
EXTRA["correction_band"] = np.outer(np.arange(5), [0, 1, 0, 0, 0])
CONTEXT = Context(time=TIME, extra=EXTRA)


@pytest.mark.parametrize(
    ("slug", "given", "expected"),
    [
        ("ranging.multipath", {"pitch_a": 2e-6}, 2e-6 * np.array([0, 1, 0, -1, 0])),
        (
            "ranging.multipath",
            {"cosine_pitch_a": 1e-6, "period": 2 * RIPPLE},
            1e-6 * (np.array([0, -(1 - 0.5**0.5), -1, -1 - 0.5**0.5, -2])),
        ),
        ("ranging.phase_break", {"size": 0.01, "time": 2.5}, [0, 0, 0, 0.01, 0.01]),
        ("ranging.delay", {"delay": 1e-3}, np.full(5, -5e-4)),
        ("ranging.scale", {"excess": 1e-8}, np.full(5, 2e-3)),
        ("ranging.antenna_correction", {"share": 0.5}, np.full(5, -1.45)),
        ("attitude.star_camera_noise", {"share_10_20_mhz": 0.5}, 0.5 * np.arange(5)),
        ("ranging.phase_centre", {"z_a": 1e-3, "x_b": 1e-3}, np.full(5, -0.00102)),
        ("ranging.phase_centre_drift", {"z_a": 1e-8, "x_b": 1e-8}, -1.02e-8 * TIME),
        ("ranging.phase_centre_curvature", {"pitch_a": 1e-3}, 1e-3 * (RIPPLE * TIME / 4) ** 2),
        ("ranging.slow_orbit_error", {"cosine": 1e-3}, [1e-3, -1e-3, 1e-3, -1e-3, 1e-3]),
        ("ranging.star_camera_misalignment", {"pitch_a": 1e-3, "yaw_b": 1e-3}, np.full(5, 2.8e-5 - 1.5e-5)),
        ("ranging.once_per_revolution", {"sine": 1e-3}, [0, 1e-3, 0, -1e-3, 0]),
        ("ranging.thermal", {"swing": 4e-5}, 1e-5 * TIME),
    ],
)
def test_an_effect_adds_what_its_law_says(slug, given, expected):
    """Analytic: each law at numbers done by hand."""
    effect = BY_SLUG[slug]
    assert_allclose(effect.contribution(CONTEXT, effect.values(given)), expected, atol=1e-18)
