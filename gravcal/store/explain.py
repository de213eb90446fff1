"""Why a product has to be made: its recipe beside that of the newest product of the same name and configuration.

What an experiment never made is compared with the operational product.
"""

import os

from gravcal.store import fingerprint, store

ABSENT = "(absent)"
REMAKE = "GRAVCAL_REMAKE_VERSIONS"  # "1": products that other versions of these made are made again
NUMERICAL = ("numpy", "scipy", "numba")


def why(recipe, modules):
    """Reasons, the most telling first.

    Parameters
    ----------
    recipe : dict, of the product wanted; an input whose digest is None is not known yet
    modules : dict, part of the code -> digest

    Returns
    -------
    reasons : list of str, such as "lowpass_hz: 0.5 -> 0.7", "input com_offset.align changed", "never made"
    """
    stage = ".".join(part for part in (recipe["kind"], recipe["variant"]) if part)
    record = store.newest_record(recipe["event"], stage)
    if record is None:
        return ["never made"]
    return compared(record, {"recipe": recipe, "modules": modules}, otherwise=())


def other_versions(ref):
    """Numerical libraries of which another version made a product, as text: "made by numpy 2.1.0, here 2.2.1".

    Parameters
    ----------
    ref : ProductRef that was found
    """
    made, here = (store.read_record(ref.folder) or {}).get("versions", {}), fingerprint.versions()
    other = [
        f"{name} {made[name]}, here {here[name]}" for name in NUMERICAL if made.get(name, here[name]) != here[name]
    ]
    return [f"made by {one}" for one in other]


def remakes_versions():
    """Whether products that other versions made are to be made again."""
    return os.environ.get(REMAKE, "0") not in ("", "0")


def compared(old_record, new_record, otherwise=("event or variant",)):
    """What differs between two products of one stage.

    Parameters
    ----------
    old_record, new_record : dict, records of the products
    otherwise : reasons given where none is found

    Returns
    -------
    reasons : list of str, such as "lowpass_hz: 0.5 -> 0.7"
    """
    old, new = old_record["recipe"], new_record["recipe"]
    reasons = list(_differences(old["settings"], new["settings"], ""))
    if old["version"] != new["version"]:
        reasons.append(f"version {old['version']} -> {new['version']}")
    stated = [recipe.get("origin", ABSENT) or "as files say" for recipe in (old, new)]
    if stated[0] != stated[1]:
        reasons.append(f"origin: {stated[0]} -> {stated[1]}")
    reasons += _input_reasons(old["inputs"], new["inputs"])
    return reasons + changed(old_record, new_record) or list(otherwise)


def _differences(old, new, name):
    """Settings that differ, named to the depth where they do."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in sorted(set(old) | set(new)):
            yield from _differences(old.get(key, ABSENT), new.get(key, ABSENT), f"{name}.{key}" if name else key)
    elif old != new or type(old) is not type(new):
        yield f"{name}: {_short(old)} -> {_short(new)}"


def _input_reasons(old, new):
    """Inputs that differ in content, by name."""
    before = {_input_name(item): item for item in old}
    after = {_input_name(item): item for item in new}
    reasons = [f"input {name} added" for name in after if name not in before]
    reasons += [f"input {name} removed" for name in before if name not in after]
    for name, item in after.items():
        if name in before and item["digest"] is not None and item["digest"] != before[name]["digest"]:
            reasons.append(f"input file {name} changed" if "file" in item else f"input {name} changed")
    return reasons


def _input_name(item):
    """Name of an input: file, or kind and variant."""
    return item.get("file") or ".".join(part for part in (item["kind"], item["variant"]) if part)


def changed(old_record, new_record):
    """Parts of the code, and data files that it reads, that changed, came or went between two records, as reasons."""
    if old_record["recipe"]["code"] == new_record["recipe"]["code"]:
        return []
    old, new = old_record["modules"], new_record["modules"]
    names = sorted(name for name in set(old) | set(new) if old.get(name) != new.get(name)) or ["(unknown)"]
    parts = {"code": [name for name in names if "/" not in name], "data": [name for name in names if "/" in name]}
    return [f"{what} changed: {', '.join(own)}" for what, own in parts.items() if own]


def _short(value):
    """A value on one line."""
    text = str(value)
    return text if len(text) <= 60 else text[:57] + "..."
