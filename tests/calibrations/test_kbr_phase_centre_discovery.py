"""What discovery sees of a ranging campaign in which one satellite does not turn."""

import numpy as np
import pytest
from kbr_campaign import NOMINAL, process, simulated

from gravcal import catalog
from gravcal.calibrations.kbr_phase_centre.observations import observe
from gravcal.discovery.problem import prepare

#: Only the first satellite turns: x of the second is all but a bias.
ONE = (("manoeuvres", "+pitch_a,,,-pitch_a,+yaw_a,,,-yaw_a"), ("amplitude_deg", 0.5))


def without(columns, own):
    """Columns less their part along own ones, in 80 bits and twice, own ones made orthonormal one by one."""
    columns, basis = np.asarray(columns, np.longdouble), []
    for column in np.asarray(own, np.longdouble).T:
        for _ in range(3):
            for done in basis:
                column = column - done * (done @ column)
        basis.append(column / np.sqrt(column @ column))
    for _ in range(3):
        for done in basis:
            columns = columns - np.outer(done, done @ columns)
    return columns


@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="long doubles have no more digits here")
def test_x_of_a_satellite_that_does_not_turn_keeps_its_information():
    """Independent evaluation: own columns taken off in 80 bits; the part of x that is no bias is 1e-8 of it."""
    products = process(simulated(7, ONE)[0])
    names = ("orbit_degree", "crn_window_s", "crn_bandwidth_hz")
    parameters = catalog.parameters("kbr_phase_centre")
    given = {name: parameters.entries[name].value for name in names}
    parts = (products.aligned, products.pointed, products.equations[0], products.noise, products.solved[0])
    named = dict(zip(("align", "pointing", "observable", "noise", "solve"), parts, strict=True))
    observed = observe(named, nominal_m=NOMINAL, **given)
    found = prepare(observed.blocks, []).total
    assert observed.column[:, 3].std() < 1e-6
    clean = [without(np.column_stack([b.observed, b.global_columns]), b.local_columns) for b in observed.blocks]
    expected = sum(one.T @ one for one in clean).astype(float)
    scale = np.sqrt(np.diag(expected))
    assert found / np.outer(scale, scale) == pytest.approx(expected / np.outer(scale, scale), abs=1e-6)
