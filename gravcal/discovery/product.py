"""What a search delivers: its numbers in one document, residuals and adequacy, and the reading that shows most."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np
import xarray as xr

from gravcal.discovery import DISCOVERY
from gravcal.discovery.attribution import beside_calibration
from gravcal.discovery.problem import baseline_of
from gravcal.discovery.rounds import Choice, Finding, Result
from gravcal.estimation.records import Observations


def nothing() -> xr.Dataset:
    """Product of a record without manoeuvre."""
    values = {name: [] for name, stated in DISCOVERY.items() if not stated.get("optional")}
    return _dataset(values, numbers=json.dumps({"status": "no_manoeuvre"}), channels="", blocks="")


def _dataset(values, **attrs):
    """Dataset with the variables of the schema that have values."""
    made = {}
    for name in (name for name in DISCOVERY if name in values):
        stated = DISCOVERY[name]
        labels = {label: stated[label] for label in ("units", "long_name") if label in stated}
        made[name] = (stated["dims"].split(), np.asarray(values[name], dtype=stated.get("dtype", "f8")), labels)
    return xr.Dataset(made, attrs={"time_scale": "GPS"} | attrs)


def dataset(
    result: Result, numbers: dict, channels: Sequence[str], reading: Mapping, places: Sequence[Shown], periods: Iterable
) -> xr.Dataset:
    """Product of a search: residuals, adequacy, numbers of `summary`, readings of `variables` at `places`."""
    blocks, before, after = result.problem.blocks, result.before, result.after
    rows = before.rows
    names = list(dict.fromkeys([*channels, *(str(c) for b in blocks for c in b.channel)]))
    place = {name: k for k, name in enumerate(names)}
    labels = {b.label: k for k, b in enumerate(blocks)}
    values = {
        "time_row": np.concatenate([b.time for b in blocks]),
        "channel": np.concatenate([[place[str(c)] for c in b.channel] for b in blocks]),
        "component": np.concatenate([b.axis for b in blocks]),
        "block": np.concatenate([np.full(b.time.size, k) for k, b in enumerate(blocks)]),
        "observed": np.concatenate([b.observed for b in blocks]),
        "residual_before": np.concatenate(before.rest),
        "residual_after": np.concatenate(after.rest),
        "test_block": [labels[r["block"]] for r in rows],
        "test_channel": [place[r["channel"]] for r in rows],
        "test_band": [r["band"] for r in rows],
        "power_before": [r["ratio"] for r in rows],
        "power_after": [r["ratio"] for r in after.rows],
        "p_band_before": [r["p"] for r in rows],
        "p_band_after": [r["p"] for r in after.rows],
    }
    plain = json.loads(json.dumps(numbers, default=lambda one: one.item()), parse_constant=lambda _: None)
    text = json.dumps(plain, allow_nan=False, sort_keys=True)
    words = {"numbers": text, "channels": " ".join(names), "blocks": ", ".join(labels)}
    where = [asdict(one) | {"block": blocks[one.block].label} for one in places]
    words |= {"shown": json.dumps(where), "periods": json.dumps(list(periods))}
    return _dataset(values | reading, **words)


def summary(result: Result, choice: Choice, observed: Observations) -> dict:
    """Numbers of a discovery as plain lists and floats, NaN where not determined, in the unit that is reported."""
    rows = {}
    for trial in result.first:
        one = {"cause": trial.cause, "form": trial.form, "chi2": trial.gain, "parameters": trial.dof}
        rows.setdefault(trial.cause, one | {"significance": trial.significance})
    return {
        "adequate_before": result.before.adequate(choice.level),
        "adequate_after": result.after.adequate(choice.level),
        "p_before": result.before.p,
        "p_after": result.after.p,
        "p_quiet_before": result.before.quiet,
        "p_quiet_after": result.after.quiet,
        "level": choice.level,
        "outliers": result.outliers,
        "findings": [_finding(one, choice, k, result.adopted) for k, one in enumerate(result.findings)],
        "indistinguishable_from_calibration": beside_calibration(
            result.problem, baseline_of(result.problem, ()), observed.scale
        ),
        "unexplained": _unexplained(result, choice),
        "calibration_change": _change(result, observed),
        "gain": _gain(result),
        "tried": list(rows.values()),
    }


def _finding(found: Finding, choice, position, adopted):
    values = zip(found.names, found.value.tolist(), found.sigma.tolist(), found.units, strict=True)
    parameters = {n: {"value": v, "sigma": s, "unit": u} for n, v, s, u in values}
    if np.isfinite(found.at):
        name, unit = ("time", "s") if "time" in found.form else ("frequency", "Hz")
        parameters[name] = {"value": found.at, "sigma": found.at_sigma, "unit": unit}
    return {
        "cause": found.cause,
        "form": found.form,
        "tied_with": [*found.tied, *(one["cause"] for one in found.imitators)],
        "adopted": adopted[position] if adopted else True,
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


def _change(result, observed):
    """Parameters of the calibration before and after, in their reported unit."""
    scale, start, count = observed.scale, observed.start, observed.scale.size
    (before, after), (old, new) = ([part[:count] for part in both] for both in (result.shared, result.sigma))
    extra = (result.covariance[1] - result.covariance[0])[:count, :count]
    return {
        "names": list(observed.parameters),
        "unit": observed.unit,
        "before": (scale * (start + before)).tolist(),
        "sigma_before": (scale * old).tolist(),
        "after": (scale * (start + after)).tolist(),
        "sigma_after": (scale * new).tolist(),
        "variant": "joint fit",
        "covariance_of_findings": (np.outer(scale, scale) * extra).tolist(),
        "change": (scale * (after - before)).tolist(),
        "change_in_old_sigma": ((after - before) / np.where(old > 0, old, np.inf)).tolist(),
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


#: Rows of a channel and block below which they are no curve.
CURVE = 60
#: Chi-square that a finding has to gain there to be seen at all.
CLEAR = 10.0


@dataclass(frozen=True)
class Shown:
    """Where a finding is shown."""

    finding: int  #: its number, -1 where none was named
    channel: str
    block: int  #: number
    axis: int


def clearest(
    result: Result, channels: Sequence[str], level: float, without: Sequence, acts: Sequence = ()
) -> list[Shown]:
    """For each finding the channel, block and axis whose rows it helps most; none where it helps no curve.

    `without` are, for each finding, the residuals (n,) that the extended model without it leaves of each block; `acts`
    says whether it acts there. Where nothing was named and the baseline is not adequate, the place of the least likely
    band.
    """
    found = []
    for number, rest in enumerate(without):
        drops = {}
        for k, block in enumerate(result.problem.blocks):
            drop = rest[k] ** 2 - result.after.rest[k] ** 2
            drop = drop if not acts or acts[number][k] else np.zeros_like(drop)
            for channel in (c for c in channels if np.sum(block.channel == c) >= CURVE):
                size = np.bincount(block.axis, np.where(block.channel == channel, drop, 0.0))
                drops[size.sum(), channel, k] = int(size.argmax())
        gain, channel, k = max(drops, default=(0.0, "", 0))
        found += [Shown(number, channel, k, drops[gain, channel, k])] if gain >= CLEAR else []
    if without or result.before.p >= level:
        return found
    labels = {b.label: k for k, b in enumerate(result.problem.blocks)}
    for row in sorted(result.before.rows, key=lambda r: r["p"]):
        k = labels[row["block"]]
        here = result.problem.blocks[k].channel == row["channel"]
        if row["channel"] in channels and here.sum() >= CURVE:
            size = np.bincount(result.problem.blocks[k].axis, np.where(here, result.before.rest[k] ** 2, 0.0))
            return [Shown(-1, row["channel"], k, int(size.argmax()))]
    return []


def variables(
    result: Result, places: Sequence[Shown], reading_of: Callable, without: Sequence, contiguous: bool = False
) -> dict[str, np.ndarray]:
    """Variables of the product by channel for what is shown, one finding after the other, less the mean measured.

    `reading_of` gives, of a channel, the number of a block and rows (n, 3), the time (m,) s, the reading (m, a) that
    the observed rows are the difference to, and the rows (3, m, a) in its unit; of the rows of all blocks if
    `contiguous`.
    """
    made: dict[str, list[np.ndarray]] = {}
    observed = [block.observed for block in result.problem.blocks]
    for one in places:
        parts = observed, without[one.finding] if without else result.before.rest, result.after.rest
        rows = np.stack([np.concatenate(p if contiguous else [p[one.block]]) for p in parts], axis=1)
        time, model, (rest, before, after) = reading_of(one.channel, one.block, rows)
        measured = model + rest
        measured -= np.nanmean(measured, axis=0)
        after = after if without else np.full_like(after, np.nan)
        series = {"time": time, "finding": np.full(time.size, one.finding), "measured": measured}
        series |= {"simulated": measured - before, "extended": measured - after}
        for name, values in series.items():
            made.setdefault(f"{one.channel}_{name}", []).append(values)
    return {name: np.concatenate(parts) for name, parts in made.items()}
