"""Tables of an inertial-sensor event beside Tables 3 to 6 of the paper (Remote Sens. 2023, 15, 3817)."""

from __future__ import annotations

import numpy as np

from gravcal.report.pages import table
from gravcal.report.plain import AXES

NONE = "–"
RATIO = {"mass": 0.072, "x": 1.9440e-5, "y": 1.0328e-5, "arm_y": 10.45e-3}  # as printed, Sec. 2.2 and Table 1


def actuation(published):
    """Table 3: coefficients in use beside the printed ones.

    Parameters
    ----------
    published : {section: records}
    """
    from gravcal.calibrations.inertial_sensor.scale import electrodes

    rows = []
    for record, used in zip(published.get("actuation", ()), electrodes.READOUT, strict=False):
        same = np.array_equal(np.array(record["value"], dtype=float), used)
        rows.append([record["labels"]["scale_factor"], *(f"{c:g}" for c in used), "as printed" if same else "differs"])
    heads = ["factor", *(f"{name[0]}{name[2:]}" for name in electrodes.VOLTAGES), ""]
    return table("Combinations of the electrode voltages (Table 3).", heads, rows, words=(0, 7))


def factors(document, published):
    """Table 4: nominal, ground and orbit as printed, the printed beta taken to k without the 1/2, and ours.

    Parameters
    ----------
    document : result document; published : {section: records}
    """
    known = {r["labels"]["factor"]: r for r in published.get("scale_factors", ())}
    swing = document.get("swing", {})
    rows = []
    for name in ("k_x", "k_y", "k_z", "beta_x", "beta_y", "beta_z"):
        record = known.get(name, {"value": [None] * 3, "sigma": [None]})
        nominal, ground, orbit = (_short(v) for v in record["value"])
        kind, axis = name.split("_")
        own = swing.get(kind, {}).get(axis)
        rows.append([name, nominal, ground, orbit, _again(name, known), _measured(own)])
    heads = ["factor", "nominal printed", "ground printed", "orbit printed", "printed β, no 1/2", "this event"]
    caption = (
        "Scale factors (Table 4), k in m s⁻² V⁻¹, β in rad s⁻² V⁻¹: value ± error (total error). Fifth column: the "
        "printed β of orbit taken to k by J/(M l), arm about x of 8.00 and 10.45 mm."
    )
    return table(caption, heads, rows, wide=True)


def _again(name, known):
    """Linear factor that the printed beta gives."""
    if name == "k_x" and "beta_y" in known:
        return _short(known["beta_y"]["value"][2] * RATIO["y"] / (RATIO["mass"] * RATIO["arm_y"]))
    if name == "k_z" and "beta_x" in known:
        both = [known["beta_x"]["value"][2] * RATIO["x"] / (RATIO["mass"] * arm) for arm in (8.00e-3, 10.45e-3)]
        return " / ".join(_short(one) for one in both)
    return NONE


def _short(value):
    return NONE if value is None else f"{value:.3e}"


def _measured(own):
    """Value with its errors."""
    if not own or own["value"] is None:
        return "not determined"
    total = f" ({own['sigma_total']:.1e})" if own.get("sigma_total") is not None else ""
    return f"{own['value']:.4e} ± {own['sigma']:.1e}{total}"


def arms(document):
    """Linear factors for both arms about x.

    Parameters
    ----------
    document : result document
    """
    swing = document["swing"]
    rows = [
        [
            f"{name}{' (used)' if abs(float(name[:-3]) - swing['arm_x_mm']) < 1e-6 else ''}",
            _measured(one["x"]),
            _measured(one["z"]),
        ]
        for name, one in swing["arms"].items()
    ]
    return table(
        "Linear factors by the arm of β_x (erratum T-5): value ± error (total error).", ["arm", "k_x", "k_z"], rows
    )


def factor_budget(document):
    """Where the total error of the linear factors comes from.

    Parameters
    ----------
    document : result document
    """
    swing = document["swing"]
    words = {"beta": "β of the swing", "mass": "mass M", "inertia": "inertia J", "arm": "arm l"}
    parts = swing["k_budget_relative"].items()
    rows = [[words[name], *(f"{100 * shares[axis]:.2f}" for axis in "xz")] for name, shares in parts]
    rows.append(["total", *(f"{100 * swing['k'][a]['sigma_total'] / swing['k'][a]['value']:.2f}" for a in "xz")])
    caption = "Error budget of the linear factors, % (k = β J/(M l), erratum T-6)."
    return table(caption, ["cause", "k_x", "k_z"], rows, strong=len(rows) - 1)


def offset(document, published):
    """Table 5: offset beside the printed one.

    Parameters
    ----------
    document : result document; published : {section: records}
    """
    known = {r["labels"]["component"]: r for r in published.get("com_offset", ())}
    swing = document["swing"]
    rows = []
    for index, axis in enumerate(AXES):
        record = known.get(axis)
        printed = f"{record['value'][0]:.2f} ± {record['sigma'][0]:.2f}" if record else NONE
        own = [_micro(swing[name], index) for name in ("com_to_test_mass_um", "com_to_test_mass_without_y_um")]
        rows.append([axis, printed, *own])
    caption = "Centre of mass to test mass (Table 5), µm: value ± error with scale factors held (total error)."
    return table(caption, ["axis", "printed", "all axes, k_y of the ground", "without a_y"], rows)


def _micro(block, index):
    value, sigma, total = (block[name][index] for name in ("value", "sigma", "sigma_total"))
    return f"{value:.1f} ± {sigma:.1f} ({total:.1f})"


def budget(document):
    """Where the total error of the offset comes from.

    Parameters
    ----------
    document : result document
    """
    swing = document["swing"]
    rows = [["noise", *(f"{s:.1f}" for s in swing["com_to_test_mass_um"]["sigma"])]]
    words = {
        "beta_x": "β_x",
        "beta_y": "β_y",
        "ratio_x": "J_x/(M l)",
        "ratio_y": "J_y/(M l)",
        "k_y": "k_y of the ground",
    }
    rows += [[words[name], *(f"{abs(v):.1f}" for v in shift)] for name, shift in swing["budget_um"].items()]
    rows.append(["total", *(f"{s:.1f}" for s in swing["com_to_test_mass_um"]["sigma_total"])])
    caption = "Error budget of the offset, µm for one standard deviation of each cause."
    return table(caption, ["cause", *AXES], rows, strong=len(rows) - 1)


def bias(document, published):
    """Table 6: bias beside the printed one.

    Parameters
    ----------
    document : result document; published : {section: records}
    """
    known = {r["labels"]["component"]: r for r in published.get("bias", ())}
    roll = document["roll"]
    rows = []
    for index, axis in enumerate(AXES):
        record = known.get(axis)
        printed = f"{record['value'][0]:.4e} ± {record['sigma'][0]:.1e}" if record else NONE
        value = roll["bias"]["value"][index]
        if value is None:
            sum_ = roll["constant_y"]
            own = f"not separable; b − a = {sum_['value']:.6e} ± {sum_['sigma']:.1e} ({sum_['sigma_total']:.1e})"
        else:
            sigma, total = roll["bias"]["sigma"][index], roll["bias"]["sigma_total"][index]
            own = f"{value:.6e} ± {sigma:.1e} ({total:.1e}), {100 * sigma / abs(value):.4f} %"
        rows.append([axis, printed, own])
    caption = "Bias b of f = b + k V (Table 6), m s⁻²: value ± error with scale factors held (total error)."
    return table(caption, ["axis", "printed", "this event"], rows, words=(0, 2))


def bias_budget(document):
    """Parts of the error of the bias.

    Parameters
    ----------
    document : result document
    """
    parts = document["roll"]["budget"]
    words = {
        "statistical_sigma": "scatter of the segments",
        "offset_sigma": "error of the offset (Ω² p)",
        "factor_sigma": "error of the scale factor (swing, M, l, J), times b",
        "wander": "slow wander, not an error of the mean",
        "offset_effect": "bias if the offset term were dropped, minus the bias",
    }
    rows = [[words[name], *(f"{v:.1e}" for v in values)] for name, values in parts.items()]
    return table("Error budget of the bias, m s⁻².", ["part", *AXES], rows)
