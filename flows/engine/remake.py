"""Make a product again from the raw files its record names, in a store of its own, and compare."""

import contextlib
import os
import tempfile
from pathlib import Path

from flows import engine
from gravcal.errors import refuse
from gravcal.io import archive
from gravcal.store import history, keys, location, store


def remake(entry):
    """Product made anew, every stage compared with what the store holds."""
    stages = []
    engine.single_threaded()
    with tempfile.TemporaryDirectory(prefix="gravcal-rebuild-") as folder:
        original = location.folder()
        with other_store(folder), engine.one_thread():
            made = _make(entry.ref.key, original, stages, {})
    return {"product": entry.ref.name, "equal": made.digest == entry.record["digest"], "stages": stages}


def _make(key, original, stages, done):
    """Make one product and, before, all it needs."""
    if key in done:
        return done[key]
    folder = original / "objects" / key[:2] / key
    record = store.read_record(folder)
    if record is None:
        refuse(f"product {key[:12]}", f"that its record is no longer in {original}", "it", "Run its event again.")
    items = [
        _raw_file(part, label) if "path" in part else _make(part["key"], original, stages, done)
        for part, label in store.inputs(record)
    ]
    recipe = record["recipe"]
    settings = dict(recipe["settings"]) | {"event": recipe["event"], "variant": recipe["variant"]}
    done[key] = history.stage_of(record)(*items, **settings)
    stages.append(_compared(record, done[key]))
    return done[key]


def _compared(record, made):
    """Verdict on one stage."""
    equal = made.digest == record["digest"]
    anew = store.read_record(made.folder)
    old, new = record["recipe"], anew["recipe"]
    changed = history.changed(record, anew)
    if old["version"] != new["version"]:
        changed.append(f"version {old['version']} -> {new['version']}")
    return {"stage": made.stage, "verdict": "equal" if equal else "different", "why": "; ".join(changed)}


def _raw_file(part, label):
    """Level-1 file of a record, with the content it had."""
    path = Path(part["path"])
    where = f"{path}:{part['member']}" if part["member"] else str(path)
    if not path.is_file():
        refuse(where, "that the raw file is not there any more", "it", "Put it back to make the product again.")
    names = ("product", "satellite", "date", "release")
    file = archive.LevelOneFile(path, part["member"], *(label[name] for name in names))
    found = keys.labelled(file)["digest"]
    if found != label["digest"]:
        remedy = "The raw file changed; run its event again."
        refuse(where, f"SHA-256 {found[:12]}", f"{label['digest'][:12]}, from which the product was made", remedy)
    return file


@contextlib.contextmanager
def other_store(folder):
    """Let everything inside use another store."""
    before = os.environ.get("GRAVCAL_PRODUCTS")
    os.environ["GRAVCAL_PRODUCTS"] = folder
    try:
        yield
    finally:
        if before is None:
            del os.environ["GRAVCAL_PRODUCTS"]
        else:
            os.environ["GRAVCAL_PRODUCTS"] = before
