"""Products of the store: list, find one, verify all, pin, and remove those that nothing refers to."""

import contextlib
import fnmatch
import hashlib
import math
import re
import shutil
import time
from dataclasses import dataclass
from pathlib import Path

from gravcal.errors import refuse
from gravcal.store import configurations, location, product, store

LABELS = ("gravcal_key", "gravcal_digest", "gravcal_recipe")
YOUNG_S = 3600.0  # a product younger than this may belong to a run that has not yet linked it


@dataclass(frozen=True)
class Entry:
    """One product of the store with its record, and the configurations whose readable link leads to it."""

    ref: store.ProductRef
    record: dict
    configurations: tuple[str, ...] = ()

    @property
    def newest(self):
        """True if the readable link of the operational configuration leads to it."""
        return location.OPERATIONAL in self.configurations


def entries(event=None, kind=None, newest_only=True, configuration=None, record_of=store.read_record):
    """[Entry] of the store by event, time and stage: of an event, a kind or stage, the links of a configuration.

    ``newest_only`` leaves out those that no readable link leads to; ``record_of`` reads the record of a folder.
    """
    links, every = linked(), []
    for folder in folders():
        names = tuple(sorted(links.get(folder.name, ())))
        if newest_only and not names or configuration is not None and configuration not in names:
            continue
        record = record_of(folder)
        if record is None:
            continue
        ref = store.reference(record, folder)
        if event in (None, ref.event) and kind in (None, ref.kind, ref.stage):
            every.append(Entry(ref, record, names))
    return sorted(every, key=lambda entry: (entry.ref.event, entry.record["made"], entry.ref.stage))


def folders():
    """Folders (Path) of all products, complete or not, sorted."""
    shelves = (path for path in (location.folder() / "objects").glob("*") if not path.is_symlink())
    return sorted(path for shelf in shelves for path in shelf.glob("*") if store.KEY.fullmatch(path.name))


def linked():
    """Configurations whose readable links lead to a product, by key: {key: {"operational", NAME}}."""
    by_key, latest = {}, location.folder() / "latest"
    for link, folder in (*store.links("*/*"), *store.links("*/as/*/*")):
        name = location.OPERATIONAL if link.parent.parent == latest else link.parent.name
        by_key.setdefault(folder.name, set()).add(name)
    return by_key


def resolve(text):
    """Entry by key, beginning of a key or of its content's digest (as reports print it), ``event/stage``, or path.

    Of products with the same content the one that a readable link leads to is meant.
    """
    everything = entries(newest_only=False)
    path = Path(text).resolve()  # of the folder, of a readable link to it, or of a file in it
    objects = (location.folder() / "objects").resolve()
    keys = {one.name for one in (path, path.parent) if one.parent.parent == objects}
    chosen = [entry for entry in everything if entry.ref.folder.name in keys]
    folder = store.linked(location.folder() / "latest" / text)  # EVENT/STAGE, or EVENT/as/NAME/STAGE
    if not chosen and folder:
        chosen = [entry for entry in everything if entry.ref.key == folder.name]
    if not chosen and re.fullmatch(r"[0-9a-f]{4,64}", text):
        chosen = [entry for entry in everything if entry.ref.key.startswith(text)]
        same_content = [entry for entry in everything if entry.ref.digest.startswith(text)]
        chosen = chosen or [entry for entry in same_content if entry.newest] or same_content
    if len(chosen) == 1:
        return chosen[0]
    remedy = "Give EVENT/STAGE, more digits of the key, or a path, as gravcal products list shows them."
    return refuse(f"product {text!r} in {location.folder()}", len(chosen), "one", remedy)


def content(entry):
    """Dataset of an Entry, verified; refused if damaged."""
    dataset = store.load(entry.ref)
    if dataset is None:
        refuse(f"{entry.ref.name} ({entry.ref.path})", "it damaged, and set aside", "a product", "Run its event again.")
    return dataset


def tree(event: str, configuration: str | None = None):
    """Products of the last run of an event (by default operational) as an xarray.DataTree, one node a stage."""
    import xarray as xr

    newest = entries(event=event, configuration=configuration or location.OPERATIONAL)
    if not newest:
        remedy = "Run its event, or set GRAVCAL_PRODUCTS; `gravcal products` lists what is there."
        refuse(event, f"no product in {location.folder()}", "those of a run", remedy)
    datasets = {}
    for entry in newest:
        dataset = store.load(entry.ref)
        if dataset is not None:
            labels = {"event": event, "stage": entry.ref.stage, "key": entry.ref.key}
            datasets[entry.ref.stage.replace(".", "/")] = dataset.assign_attrs(labels)
    return xr.DataTree.from_dict(datasets, name=event)


def verify():
    """Problems of all products, (folder, text) each: record, bytes and content are compared; nothing is moved."""
    problems = [(folder, problem) for folder in folders() for problem in _problems(folder)]
    links = [path for path in (location.folder() / "latest").rglob("*") if path.is_symlink() and not store.linked(path)]
    links += [path for path in (location.folder() / "objects").glob("*") if path.is_symlink()]
    return problems + [(path, "a link that leads to no product of this store; it is not followed") for path in links]


def _problems(folder):  # list of texts: record, bytes and content of a product folder compared
    record, reason = store.believed(folder)
    reason = reason or store.doubt(folder, record)
    if reason:
        return [reason]
    made_of = zip(record["from"], record["recipe"]["inputs"], strict=True)
    for place, label in ((store.folder_of(part["key"]), label) for part, label in made_of if "key" in part):
        below = store.read_record(place)
        if below and below["digest"] != label["digest"] and not store.doubt(place, below):
            return ["the record names another product than one that it was made of"]
    image = (folder / "product.nc").read_bytes()
    if hashlib.sha256(image).hexdigest() != record["sha256"]:
        return ["bytes of product.nc differ from the record"]
    content = product.from_bytes(image)
    own = product.provenance(record["recipe"], record["key"], record["digest"], "")
    wrong = [name for name in LABELS if content.attrs.get(name) != own[name]]
    differs = ["content differs from its digest"] if product.digest(content) != record["digest"] else []
    return [f"{name} in product.nc differs from the record" for name in wrong] + differs


def prune(keep_s=None, remove=False, quota=None, configuration=None):
    """[(path, bytes)] unused: products that no link or pin needs, directly or as input; quarantine, locks and drafts.

    Younger ones than `keep_s`, by default an hour, stay. Of a store with more bytes than its quota the oldest go first,
    none younger than an hour. With a pattern `configuration` links of experiments whose names fit, which nobody has
    promoted and which are older, go with their records and what only they need, and nothing else. Without `remove` all
    are only named.
    """
    keep_s = (YOUNG_S if quota is None else math.inf) if keep_s is None else keep_s
    latest, dropped = location.folder() / "latest", []
    if configuration:
        links = [link for link in latest.glob("*/as/*/*") if link.is_symlink()]
        young = {link.parent.name for link in links if _age_s(link) <= keep_s}
        records = {path: path.stem for path in (location.folder() / "configurations").glob("*/[!.]*.json")}
        names = fnmatch.filter({*records.values()} - configurations.promoted(), configuration)
        dropped = [link for link in links if link.parent.name in names and _age_s(link) > keep_s]
        dropped += [one for one, name in records.items() if name in {*names} - young and _age_s(one) > keep_s]
    roots = {link for link in (*latest.glob("*/*"), *latest.glob("*/as/*/*"), *_pins().glob("*")) if link.is_symlink()}
    needed = store.ancestry(*(link.readlink().name for link in roots - set(dropped)))
    own = store.ancestry(*(link.readlink().name for link in dropped if link.is_symlink()))
    unused = [one for one in folders() if one.name not in needed and (one.name in own or not configuration)]
    for name in () if configuration else ("quarantine", "locks", "tmp"):  # the last two: of processes that were killed
        unused += sorted((location.folder() / name).glob("*"))
    to_remove, bytes_left = [(link, 0) for link in dropped], size() if quota is not None else 0
    for age, path in sorted(((_age_s(path), path) for path in unused), reverse=True):
        keep = max(keep_s, YOUNG_S) if path.parent.name == "tmp" else keep_s  # a run may be writing it
        if age > keep or (quota is not None and bytes_left > quota and age > YOUNG_S):
            to_remove.append((path, _size(path)))
            bytes_left -= to_remove[-1][1]
    for path, _ in to_remove if remove else []:
        if path.is_symlink() or not path.is_dir():
            path.unlink(missing_ok=True)
            continue
        aside = location.new_aside()  # renamed first, so that a product is gone at once
        try:
            location.prepare()
            path.rename(aside)
        except FileNotFoundError:
            continue
        except OSError as error:
            raise location.unwritable(error, path.name[:12]) from error
        shutil.rmtree(aside, ignore_errors=True)
    return to_remove


def said(gone, removed, quota_gb=None):
    """Text: what `prune` removed, [(path, bytes)], or would remove, and how much stays."""
    freed = sum(count for _, count in gone)
    bytes_left = size() - (0 if removed else freed)
    verb = "removed" if removed else "would be removed (--remove does it)"
    text = f"{len(gone)} entries, {freed / 1e6:.1f} MB {verb}; {bytes_left / 1e9:.3f} GB stay"
    if quota_gb is not None and bytes_left > quota_gb * 1e9:
        text += f", more than the quota of {quota_gb:g} GB: delivered, pinned, or of the last hour"
    return text


def size():
    """Bytes of the products of the store and of its quarantine."""
    return sum(_size(location.folder() / name) for name in ("objects", "quarantine"))


def pin(entry):
    """Pin the product of an Entry: `prune` keeps it and all that it was made of."""
    link = _pins() / entry.ref.key
    try:
        link.parent.mkdir(parents=True, exist_ok=True)
        link.unlink(missing_ok=True)
        link.symlink_to(Path("..") / "objects" / entry.ref.key[:2] / entry.ref.key)
    except OSError as error:
        raise location.unwritable(error, f"pin of {entry.ref.name}") from error


def unpin(entry):
    """Remove the pin of an Entry; True if it was pinned."""
    link = _pins() / entry.ref.key
    was_pinned = link.is_symlink()
    link.unlink(missing_ok=True)
    return was_pinned


def _pins():  # folder of links to pinned products
    return location.folder() / "pins"


def _age_s(path):
    """Seconds since a path was modified: -1 if it is gone, negative if it is dated in the future."""
    try:
        return time.time() - path.lstat().st_mtime
    except OSError:
        return -1.0


def _size(path):
    """Total bytes below a folder, or of a file; 0 if it is gone."""
    total = 0
    for one in path.rglob("*") if path.is_dir() and not path.is_symlink() else [path]:
        with contextlib.suppress(OSError):
            total += one.stat().st_size if one.is_file() else 0
    return total
