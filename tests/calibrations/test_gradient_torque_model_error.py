"""Errors of an extended model in the drag."""

import numpy as np

from flows import engine, models
from flows import gradient_torque as flow
from gravcal import catalog
from tasks.stage import read

BIAS, ERROR = 4e-11, 2e-11  # rad s-2


def drag(files, folder, value, error=""):
    """Drag by one sensor with a model of a biased angular reading."""
    path = folder / "model.toml"
    line = f'parameters.y = {{ value = {value}, {error}unit = "rad s-2" }}'
    path.write_text(f'[[effect]]\ncause = "gradient.angular_bias"\n{line}\n')
    chosen = catalog.parameters("gradient_torque").with_settings({"model": models.text_of(path)})
    found = {}

    def listen(call, state, ref):  # noqa: ARG001
        found[call.stage.writes, call.variant] = ref

    engine.run(flow.calibrate, flow.CALIBRATION.source(data=files), chosen, engine="inline", listener=listen)
    return read(found["gradient_torque.drag", "one_sensor"])


def test_the_error_of_a_bias_is_in_the_drag(tmp_path, monkeypatch):
    """Recovery: a bias that is wrong by its error moves the drag by what its errors hold beyond the noise."""
    monkeypatch.setenv("GRAVCAL_PRODUCTS", str(tmp_path / "products"))
    settings = {"duration_s": "7200"}
    flow.CALIBRATION.simulate(
        tmp_path / "files", seed=3, truth=None, effects={"gradient.angular_bias.y": BIAS}, settings=settings
    )
    given = (BIAS, ""), (BIAS + ERROR, ""), (BIAS, f"sigma = {ERROR}, ")
    sharp, wrong, wide = (drag(tmp_path / "files", tmp_path, *one) for one in given)
    moved = wrong["drag_b"].values - sharp["drag_b"].values
    np.testing.assert_array_equal(wide["drag_b"].values, sharp["drag_b"].values)
    for name in ("covariance", "covariance_total"):
        extra = wide[name].values - sharp[name].values
        np.testing.assert_allclose(extra, moved[:, :, None] * moved[:, None, :], rtol=1e-3, atol=1e-6 * extra.max())
    assert np.abs(moved).max() > 0
    pressure = wrong["pressure"].values - sharp["pressure"].values
    extra = wide["pressure_covariance"].values - sharp["pressure_covariance"].values
    np.testing.assert_allclose(extra, np.outer(pressure, pressure), rtol=1e-3, atol=1e-6 * np.abs(extra).max())
