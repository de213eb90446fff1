"""The rounds: name the best cause, check it on held-out data, add it, begin again."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from gravcal.discovery import adequacy, attribution, scan
from gravcal.discovery.blocks import Block, Candidate, reduce

#: What a parameter costs when causes with different numbers of parameters are compared (Akaike).
COST = 2.0


@dataclass(frozen=True)
class Choice:
    """Settings of a search.

    Attributes
    ----------
    level : family-wise level
    tie : expected chi-square below which two causes are tied
    rounds : at most
    step_cause : slug of a step; tone_causes : {channel: slug}
    """

    level: float
    tie: float
    rounds: int
    step_cause: str
    tone_causes: dict[str, str]


@dataclass(frozen=True)
class Finding:
    """One accepted cause.

    Attributes
    ----------
    cause, form, tied : name, shape, causes that fit as well
    names, units, value, sigma : parameters
    gain, dof, log_p : of the likelihood ratio
    significance : probability corrected for everything that was tried
    heldout : chi-square gained on data left out; kind : "manoeuvres" or "blocks"
    """

    cause: str
    form: str
    tied: list[str]
    names: list[str]
    units: list[str]
    value: np.ndarray
    sigma: np.ndarray
    gain: float
    dof: int
    log_p: float
    significance: float
    heldout: float
    kind: str


@dataclass(frozen=True)
class Result:
    """What a search found.

    Attributes
    ----------
    findings : list of Finding
    before, after : rows of adequacy; p_before, p_after : corrected probabilities over adequacy and candidates
    chi2_before, chi2_after, dof : of all blocks
    shared_before, shared_after, sigma_before, sigma_after : (p,) corrections of the shared parameters
    lost : candidates that the baseline hides, with the share of their size that is left
    """

    findings: list[Finding]
    before: list[dict]
    after: list[dict]
    p_before: float
    p_after: float
    chi2: tuple[float, float]
    dof: int
    shared: tuple[np.ndarray, np.ndarray]
    sigma: tuple[np.ndarray, np.ndarray]
    lost: dict[str, float] = field(default_factory=dict)


def search(blocks: list[Block], candidates: list[Candidate], choice: Choice, rng) -> Result:
    """All rounds.

    Parameters
    ----------
    blocks : list of Block
    candidates : list of Candidate
    choice : Choice
    rng : source of randomness, for the distribution of the adequacy under noise
    """
    findings, first = [], None
    accepted = np.zeros(0, dtype=int)
    for _ in range(choice.rounds + 1):
        reduced = reduce(blocks, candidates)
        state = _state(blocks, reduced, accepted, rng)
        tests = _tests(blocks, candidates, reduced, accepted, state, choice)
        first = first or (state, tests)
        found = _best(tests, choice) if len(findings) < choice.rounds else None
        if found is None:
            break
        found, blocks, accepted = _accepted(found, blocks, candidates, reduced, accepted, state)
        findings.append(found)
    return _result(findings, first, (state, tests))


def _state(blocks, reduced, accepted, rng):
    """Baseline of a round: shared and accepted columns, projected Gram matrix, residuals, adequacy."""
    baseline = np.concatenate([np.arange(reduced.shared.start, reduced.shared.stop), accepted])
    total = reduced.gram.sum(axis=0)
    gram = attribution.projected(total, baseline)
    cleaned = scan.residuals(blocks)
    value, covariance = _solution(total, baseline)
    width = reduced.shared.stop - reduced.shared.start
    rows = adequacy.table(blocks, cleaned, rng)
    sigma = np.sqrt(np.diag(covariance))[:width]
    dof = int(reduced.samples.sum() - baseline.size)
    shared = {"value": value[:width], "sigma": sigma, "chi2": float(gram[0, 0]), "dof": dof}
    return shared | {"baseline": baseline, "gram": gram, "cleaned": cleaned, "adequacy": rows}


def _solution(total, baseline):
    from gravcal.methods.estimation import stable_inverse

    inverse = stable_inverse(total[np.ix_(baseline, baseline)])
    return inverse @ total[baseline, 0], inverse


def _tests(blocks, candidates, reduced, accepted, state, choice):
    """Everything that is tried in a round, as dicts with log_p, gain, dof, and how many tests there are."""
    rows = []
    for k, (candidate, place) in enumerate(zip(candidates, reduced.places, strict=True)):
        if place.start in accepted:
            continue
        ratio = attribution.ratio(state["gram"], place, reduced.size)
        if ratio.dof:
            held = attribution.held_out(reduced.gram, state["baseline"], place) if ratio.log_p < -8 else 0.0
            rows.append({"kind": "candidate", "index": k, "ratio": ratio, "cause": candidate.cause, "heldout": held})
    listed = [{"kind": r["kind"], **_flat(r)} for r in rows]
    steps = scan.steps(blocks, state["cleaned"])
    for log_p, block, epoch, gain in steps[:1]:
        one = {"kind": "step", "block": block, "epoch": epoch, "cause": choice.step_cause}
        listed.append(one | {"log_p": log_p, "gain": gain, "dof": 3, "heldout": gain})
    count = len(listed) + len(steps)
    for channel in choice.tone_causes:
        found = scan.lines(blocks, state["cleaned"], channel)
        count += len(found)
        for log_p, frequency, gain, dof in found[:1]:
            one = {"kind": "tone", "channel": channel, "frequency": frequency, "cause": choice.tone_causes[channel]}
            listed.append(one | {"log_p": log_p, "gain": gain, "dof": dof, "heldout": gain})
    tied = {"candidates": candidates, "reduced": reduced, "state": state}
    return {"rows": listed, "count": count, **tied}


def _flat(row):
    ratio = row["ratio"]
    same = {k: row[k] for k in ("index", "cause", "heldout", "ratio")}
    return same | {"log_p": ratio.log_p, "gain": ratio.gain, "dof": ratio.dof}


def _corrected(log_p, count):
    """Sidak: probability that the smallest of `count` is as small by chance."""
    return float(-np.expm1(count * np.log1p(-min(np.exp(log_p), 1 - 1e-16))))


def _best(tests, choice):
    """Winner of a round with the causes tied with it, None if nothing passes."""
    passing = [r for r in tests["rows"] if _corrected(r["log_p"], tests["count"]) < choice.level and r["heldout"] > 0]
    if not passing:
        return None
    score = lambda r: r["gain"] - COST * r["dof"]  # noqa: E731
    listed = [r for r in passing if not r["cause"].startswith("unknown:")]
    best = max(passing, key=score)
    if listed and score(max(listed, key=score)) > score(best) - choice.tie:
        best = max(listed, key=score)
    tied = _tied(best, tests, choice) if best["kind"] == "candidate" else []
    return best | {"tied": tied, "significance": _corrected(best["log_p"], tests["count"])}


def _tied(best, tests, choice):
    """Other listed causes whose refit leaves less than the tie limit of expected chi-square."""
    reduced, gram = tests["reduced"], tests["state"]["gram"]
    true, value = reduced.places[best["index"]], best["ratio"].value
    tied = []
    for row in tests["rows"]:
        if row["kind"] != "candidate" or row["cause"] == best["cause"] or row["cause"].startswith("unknown:"):
            continue
        other = reduced.places[row["index"]]
        expected = attribution.misfit(gram, true, value, other, reduced.size)
        noise = max(best["dof"] - row["dof"], 0)
        if expected - noise < choice.tie:
            tied.append(row["cause"])
    return sorted(set(tied))


def _accepted(best, blocks, candidates, reduced, accepted, state):  # noqa: ARG001 - state is for figures
    """Finding, blocks and indices with the winner in the baseline."""
    common = {k: best[k] for k in ("cause", "gain", "dof", "log_p", "significance", "heldout")}
    if best["kind"] == "candidate":
        candidate = candidates[best["index"]]
        ratio = best["ratio"]
        numbers = {"value": ratio.value, "sigma": np.sqrt(np.diag(ratio.covariance))}
        named = {"names": candidate.names, "units": candidate.units, "form": candidate.form}
        finding = Finding(**common, **named, **numbers, tied=best["tied"], kind="manoeuvres")
        blocks = [
            b if c is None else replace(b, shared=np.concatenate([b.shared, c], axis=1))
            for b, c in zip(blocks, candidate.columns, strict=True)
        ]
        blocks = _same_width(blocks)
        return finding, blocks, accepted
    return _local(best, blocks, common), _with_local(best, blocks), accepted


def _same_width(blocks):
    """Shared columns padded with zeros where a cause does not act."""
    width = max(b.shared.shape[1] for b in blocks)
    pad = lambda b: np.pad(b.shared, ((0, 0), (0, width - b.shared.shape[1])))  # noqa: E731
    return [replace(b, shared=pad(b)) for b in blocks]


def _local(best, blocks, common):
    if best["kind"] == "tone":
        value = np.array([best["frequency"]])
        return Finding(
            **common, form=f"{best['channel']} reading", tied=[], names=["frequency"], units=["Hz"], value=value,
            sigma=np.zeros(1), kind="blocks",
        )  # fmt: skip
    block = blocks[best["block"]]
    value, sigma = _step_size(block, best["epoch"])
    names, units = ["x", "y", "z", "time"], ["m s-2"] * 3 + ["s"]
    value, sigma = np.append(value, best["epoch"]), np.append(sigma, 3.0)
    return Finding(
        **common, form=block.label, tied=[], names=names, units=units, value=value, sigma=sigma, kind="blocks"
    )


def _step_size(block, epoch):
    from gravcal.methods.estimation import stable_inverse, without

    clean = without(np.concatenate([block.own, block.shared], axis=1), block.local[epoch])
    inverse = stable_inverse(clean.T @ clean)
    return inverse @ clean.T @ block.observed, np.sqrt(np.diag(inverse))


def _with_local(best, blocks):
    """Blocks with a step or a tone among their own columns."""
    changed = list(blocks)
    for i, block in enumerate(blocks):
        if best["kind"] == "tone":
            columns = scan.sine_columns(block, best["channel"], best["frequency"])
        elif i == best["block"]:
            columns = block.local[best["epoch"]]
        else:
            continue
        changed[i] = replace(block, own=np.concatenate([block.own, columns], axis=1))
    return changed


def _result(findings, first, last):
    """Numbers before and after."""
    (state, tests), (end, remaining) = first, last
    width = len(state["value"])
    return Result(
        findings=findings,
        before=state["adequacy"],
        after=end["adequacy"],
        p_before=_overall(state, tests),
        p_after=_overall(end, remaining),
        chi2=(state["chi2"], end["chi2"]),
        dof=state["dof"],
        shared=(state["value"], end["value"][:width]),
        sigma=(state["sigma"], end["sigma"][:width]),
        lost=_lost(tests),
    )


def _overall(state, tests):
    """Corrected minimum over the adequacy rows and over everything tried."""
    smallest = _corrected(min(r["log_p"] for r in tests["rows"]), tests["count"])
    p = min(adequacy.smallest(state["adequacy"]), smallest)
    return float(1 - (1 - p) ** 2)


def _lost(tests):
    """Largest share of its size that each listed cause keeps beside the baseline, where that is little."""
    reduced, gram, shares = tests["reduced"], tests["state"]["gram"], {}
    for candidate, place in zip(tests["candidates"], reduced.places, strict=True):
        size = reduced.size[place]
        if candidate.listed and np.any(size > 0):
            left = np.sqrt(np.clip(np.diag(gram)[place], 0, None))
            shares[candidate.cause] = float(np.max(left / np.where(size > 0, size, np.inf)))
    return {k: v for k, v in shares.items() if v < 0.02}
