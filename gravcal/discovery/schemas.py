"""Products of discovery: variables, dimensions, units."""

_ROW = {"dims": "row", "units": "1"}
_TEST = {"dims": "test", "units": "1"}
DISCOVERY = {
    "time_row": {"dims": "row", "units": "s", "long_name": "epoch of a whitened row, GPS"},
    "channel": _ROW | {"long_name": "index of the channel in the attribute channels", "dtype": "i1"},
    "component": _ROW | {"long_name": "axis of the row: 0 x, 1 y, 2 z", "dtype": "i1"},
    "block": _ROW | {"long_name": "index of the block in the attribute blocks", "dtype": "i2"},
    "observed": _ROW | {"long_name": "whitened difference of measurement and model, noise of unit variance"},
    "residual_before": _ROW | {"long_name": "whitened residual of the baseline"},
    "residual_after": _ROW | {"long_name": "whitened residual of the extended model"},
    "found_columns": {
        "dims": "row column",
        "units": "1",
        "long_name": "whitened rows of what was found at unit size, without what the baseline of a block takes of them",
        "optional": True,
    },
    "test_block": _TEST | {"long_name": "index of the block", "dtype": "i2"},
    "test_channel": _TEST | {"long_name": "index of the channel", "dtype": "i1"},
    "test_band": _TEST | {"long_name": "band, quarters of the spectrum from low to high", "dtype": "i1"},
    "power_before": _TEST | {"long_name": "power over expected noise, baseline"},
    "power_after": _TEST | {"long_name": "power over expected noise, extended model"},
    "p_band_before": _TEST | {"long_name": "probability of more power by chance, baseline"},
    "p_band_after": _TEST | {"long_name": "probability of more power by chance, extended model"},
}
#: Channels that are also kept in the units of their reading, where a finding helps most.
READINGS = {
    "linear": "m s-2",
    "angular": "rad s-2",
    "attitude": "rad",
    "magnetometer": "T",
    "range": "m",
    "roll": "m s-2",
    "torque": "N m",
}
_PARTS = {
    "measured": "as measured",
    "simulated": "as the model without the finding simulates it, drift and start fitted",
    "extended": "as the extended model simulates it, drift and start fitted",
}
for _channel, _unit in READINGS.items():
    _along = {"dims": f"{_channel}_time", "optional": True}
    DISCOVERY[f"{_channel}_time"] = _along | {"units": "s", "long_name": "epoch of a reading, GPS"}
    DISCOVERY[f"{_channel}_finding"] = _along | {
        "units": "1",
        "long_name": "number of the finding, from 0; -1 for none",
    }
    for _part, _text in _PARTS.items():
        about = {"dims": f"{_channel}_time axis", "units": _unit, "long_name": _text, "optional": True}
        DISCOVERY[f"{_channel}_{_part}"] = about
