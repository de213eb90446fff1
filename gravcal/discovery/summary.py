"""A search in plain numbers: the part of the result document that all calibrations have in common."""

from __future__ import annotations

import numpy as np

from gravcal.discovery import rounds, unobservable
from gravcal.discovery.rounds import Choice, Finding, Result


def summary(result: Result, choice: Choice, names: list[str], unit: str, scale: float, start: np.ndarray) -> dict:
    """Numbers of a discovery.

    Parameters
    ----------
    result : Result
    choice : Choice
    names : of the shared parameters; unit : of the numbers that are reported
    scale : factor to that unit
    start : (s,) values of the shared parameters that the residuals were formed with

    Returns
    -------
    numbers : plain lists and floats, NaN where not determined
    """
    return {
        "adequate_before": bool(result.before.p >= choice.level),
        "adequate_after": bool(result.after.p >= choice.level),
        "p_before": result.before.p,
        "p_after": result.after.p,
        "level": choice.level,
        "findings": [_finding(f, choice) for f in result.findings],
        "indistinguishable_from_calibration": unobservable.beside_calibration(
            result.problem, rounds.baseline_of(result.problem, ()), np.full(len(names), scale)
        ),
        "unexplained": _unexplained(result, choice),
        "calibration_change": _change(result, names, unit, scale, start),
        "gain": _gain(result),
        "tried": _tried(result),
    }


def _finding(found: Finding, choice):
    values = zip(found.names, found.value.tolist(), found.sigma.tolist(), found.units, strict=True)
    parameters = {n: {"value": v, "sigma": s, "unit": u} for n, v, s, u in values}
    if np.isfinite(found.at):
        name, unit = ("time", "s") if "time" in found.form else ("frequency", "Hz")
        parameters[name] = {"value": found.at, "sigma": found.at_sigma, "unit": unit}
    return {
        "cause": found.cause,
        "form": found.form,
        "tied_with": [*found.tied, *(one["cause"] for one in found.imitators)],
        "in_catalogue": not found.cause.startswith("unknown:"),
        "parameters": parameters,
        "significance": found.significance,
        "level": choice.level,
        "heldout": found.kind,
        "heldout_gain": {"chi2": found.heldout, "in_sample_chi2": found.gain, "parameters": found.dof},
        "separation": found.separation,
        "imitators": found.imitators,
    }


def _unexplained(result, choice):
    """What is left where the extended model is not adequate: worst bands, lines and steps."""
    if result.after.p >= choice.level:
        return {}
    rows = sorted(result.after.rows, key=lambda r: r["p"])[:5]
    scans = []
    for one in result.after.scans:
        best = int(np.argmax(one.gain[:, 0] - one.dof))
        name = "frequency_hz" if one.kind == "line" else "time"
        scans.append({"kind": one.kind, "channel": one.channel, name: float(one.at[best])})
        scans[-1] |= {"chi2": float(one.gain[best, 0]), "parameters": int(one.dof[best])}
    return {"p": result.after.p, "bands": rows, "scans": scans}


def _change(result, names, unit, scale, start):
    """Shared parameters before and after, in their reported unit."""
    (before, after), (old, new) = result.shared, result.sigma
    change = scale * (after - before)
    return {
        "names": names,
        "unit": unit,
        "before": (scale * (start + before)).tolist(),
        "sigma_before": (scale * old).tolist(),
        "after": (scale * (start + after)).tolist(),
        "sigma_after": (scale * new).tolist(),
        "variant": "joint fit",
        "covariance_of_findings": (scale**2 * (result.covariance[1] - result.covariance[0])).tolist(),
        "change": change.tolist(),
        "change_in_old_sigma": (change / np.where(old > 0, scale * old, np.inf)).tolist(),
    }


def _gain(result):
    """Chi-square, likelihood and criterion before and after, rms of the whitened residuals by channel."""
    (before, after), count = result.chi2, result.problem.samples.sum()
    more = result.baseline.size - (result.problem.shared.stop - result.problem.shared.start)
    return {
        "chi2_before": before,
        "chi2_after": after,
        "dof_before": result.dof,
        "dof_after": result.dof - more,
        "heldout_chi2": float(sum(f.heldout for f in result.findings)),
        "log_likelihood_before": -before / 2,
        "log_likelihood_after": -after / 2,
        "bic_change": after - before + more * float(np.log(max(count, 1))),
        "rms_before": _rms(result.problem.blocks, result.before.rest),
        "rms_after": _rms(result.problem.blocks, result.after.rest),
    }


def _rms(blocks, rest):
    """Rms of the whitened residual of each channel over the rows that carry weight; one is the noise."""
    found = {}
    for channel in dict.fromkeys(str(c) for b in blocks for c in b.channel):
        values = np.concatenate([r[b.channel == channel] for b, r in zip(blocks, rest, strict=True)])
        values = values[values != 0]
        found[channel] = float(np.sqrt(np.mean(values**2))) if values.size else np.nan
    return found


def _tried(result):
    """Best trial of each cause in the first round."""
    rows = {}
    for trial in result.first:
        one = {"cause": trial.cause, "form": trial.form, "chi2": trial.gain, "parameters": trial.dof}
        rows.setdefault(trial.cause, one | {"significance": trial.significance})
    return list(rows.values())
