"""The published processing on invented truth goes wrong in the direction that docs/published_methods.md says."""

import numpy as np

from benchmarks import published_methods as study


def test_one_half_too_much_doubles_the_scale_factors(capsys):
    """Recovery: printed eqs. 8-10 give twice the linear factors of x and z (erratum T-4)."""
    found = study.inertial_sensor(1)
    assert np.allclose(found["published",][0][[0, 2]], 2.0, rtol=0.06)
    assert np.allclose(found["gravcal",][0][[0, 2]], 1.0, rtol=0.03)


def test_drag_by_quaternions_is_the_plain_reading(capsys):
    """Recovery: eq. 16 errs by the gradient over a millimetre, 1e-9 m s-2, a hundred times more than a model of it."""
    found = study.gradient_torque(1)
    (printed,), (ours,) = (found[name, "places exact"] for name in ("one_sensor_published", "one_sensor"))
    assert np.all(printed > 2e-10)
    assert np.all(ours < 0.05 * printed)


def test_orbital_harmonics_over_three_minutes_are_one_column():
    """Published: eq. 32 beside the signal, condition number 2.6e6 (erratum C-7); a quadratic has 2."""
    share = np.linspace(-1, 1, 1800)  # of 180 s
    wave, phase = np.sign(np.sin(2 * np.pi * 7.5 * share)), 2 * np.pi * (share + 1) * 90 / (97.13 * 60)
    harmonics = [f(n * phase) for n in (1, 2) for f in (np.sin, np.cos)]
    assert 2.4e6 < np.linalg.cond(np.stack([wave, share**0, *harmonics], axis=1)) < 2.8e6
    assert np.linalg.cond(np.stack([wave, share**0, share, 1.5 * share**2 - 0.5], axis=1)) < 3
