"""Invented events of the inertial sensor for the tests."""

from flows import engine, inertial_sensor
from gravcal import catalog

SHORT = {"roll_s": 10500.0, "roll_disturbed_share": 0.0}
SWING, ROLL = "2022-05-18", "2022-05-19"


def simulated(folder, seed=4, effects=None, **settings):
    """Truth of an event whose files are in a folder."""
    settings = SHORT | settings
    return inertial_sensor.CALIBRATION.simulate(folder, seed=seed, truth=None, effects=effects or {}, settings=settings)


def run(folder, **settings):
    """Result document and report product."""
    chosen, source = catalog.parameters("inertial_sensor"), inertial_sensor.CALIBRATION.source(data=folder)
    ref = engine.run(inertial_sensor.calibrate, source, chosen.with_settings(settings), engine="inline")
    return inertial_sensor.CALIBRATION.document(ref), ref


def within(estimate, truth, sigma="sigma"):
    """True if all errors are within 4.5 standard deviations."""
    pairs = zip(estimate["value"], truth, estimate[sigma], strict=True)
    return all(abs(value - true) < 4.5 * size for value, true, size in pairs)


def one(estimate):
    """Estimate of one number as one of vectors."""
    return {name: [value] for name, value in estimate.items()}
