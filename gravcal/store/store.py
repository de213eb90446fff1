"""The store of products: found by key, made at most once, never half.

    objects/ab/<key>/product.nc, meta.json     one product with its record and the files that belong to it
    latest/<event>/<stage>                     readable link to the newest product of that name
    latest/<event>/as/<NAME>/<stage>           the same of the experiment of that name
    tmp/  locks/  quarantine/  memo/           being written; who computes; set aside; what is cheap to remember

A product is written aside and published by one rename of its folder. When it counts: docs/architecture.md. What fails
is moved to ``quarantine`` and made again. No link is followed but those of ``latest``, and these only as far as they
lead to a product of this store.
"""

import contextlib
import datetime
import errno
import fcntl
import functools
import hashlib
import json
import os
import platform
import re
import shutil
import uuid
from dataclasses import dataclass
from pathlib import Path

from gravcal.store import keys, location, product, schemas

KEY = re.compile(r"[0-9a-f]{64}")
SEAL = b', "sha256_of_record": "'
SHOWN = 60  # characters of a wrong value that a message shows
LABEL_BYTES = 64  # of a key or digest as text


@dataclass(frozen=True)
class ProductRef:
    """One product: ``key`` names all it depends on, ``digest`` its content; None where a plan cannot know them."""

    event: str
    kind: str
    variant: str = ""
    key: str | None = None
    digest: str | None = None
    path: Path | None = None

    @property
    def stage(self) -> str:
        """Kind and variant, as the readable link is called: ``com_offset.solve.mtq``."""
        return f"{self.kind}.{self.variant}" if self.variant else self.kind

    @property
    def name(self) -> str:
        """Event and stage, as people say it: ``grace-c-2020-02-01/com_offset.solve.mtq``."""
        return f"{self.event}/{self.stage}"

    @property
    def folder(self) -> Path | None:
        """Folder with ``product.nc``, ``meta.json`` and the files that belong to it, such as ``report.html``."""
        return self.path.parent if self.path else None


def folder_of(key):
    """Path of the folder of the product with this key, whether it exists or not."""
    return location.folder() / "objects" / key[:2] / key


def find(key):
    """ProductRef of the product with this key, or None; a folder that contradicts its record goes to quarantine."""
    folder = folder_of(key)
    record, reason = believed(folder)
    if record:
        reason = doubt(folder, record)
    if reason:
        if os.path.lexists(folder):  # also a link that leads nowhere
            set_aside(folder, reason)
        return None
    return reference(record, folder)


def load(ref):
    """Dataset of a product, verified; None if it is damaged, which moves it to quarantine.

    Its arrays cannot be changed; provenance attributes are left out.
    """
    record, reason = believed(ref.folder)
    image = _verified_bytes(ref.folder, record) if record else None
    if image is None:
        set_aside(ref.folder, reason or "bytes differ from the record")
        return None
    dataset = product.from_bytes(image)
    dataset.attrs = product.without_provenance(dataset.attrs)
    for variable in dataset.variables.values():
        variable.values.flags.writeable = False
    return dataset


def put(key, recipe, made, facts):
    """ProductRef of a product written from made, (checked Dataset, {file name: str or bytes}), or of one there before.

    The key is that of the recipe; facts join the record: modules, inputs, stage, seconds. ProductError where the disk
    is full or the store not writable, which is then as before.
    """
    dataset, files = made
    digest, aside = product.digest(dataset), location.new_aside()
    labels = product.provenance(recipe, key, digest, keys.versions()["gravcal"])
    contents = {name: text.encode() if isinstance(text, str) else text for name, text in files.items()}
    try:
        location.prepare()
        aside.mkdir()
        product.write(dataset.assign_attrs(labels), aside / "product.nc")
        for name, text in contents.items():
            (aside / Path(name).name).write_bytes(text)
        image = (aside / "product.nc").read_bytes()
        record = {
            "key": key,
            "digest": digest,
            "sha256": hashlib.sha256(image).hexdigest(),
            "bytes": len(image),
            "mtime_ns": (aside / "product.nc").stat().st_mtime_ns,
            "labels_at": [image.find(text.encode()) for text in (key, digest)],
            "files": {name: hashlib.sha256(text).hexdigest() for name, text in contents.items()},
            "made": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            "machine": platform.node(),
            "recipe": recipe,
        }
        (aside / "meta.json").write_bytes(sealed(record | facts))
        return publish(aside, key)
    except OSError as error:
        shutil.rmtree(aside, ignore_errors=True)
        raise location.unwritable(error, f"{recipe['event']}/{recipe['kind']}") from error


def publish(aside, key):
    """ProductRef after renaming the finished folder ``aside`` to its place; a valid product already there stays."""
    folder = folder_of(key)
    if os.path.lexists(folder.parent) and not folder.parent.is_dir():
        set_aside(folder.parent, "no folder")
    folder.parent.mkdir(parents=True, exist_ok=True)
    try:
        aside.rename(folder)
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR):
            raise
    ref = find(key)
    if aside.exists() and ref is None:
        return publish(aside, key)
    shutil.rmtree(aside, ignore_errors=True)
    return ref


def point(ref):
    """Make the readable link of a product's name lead to it (ref); a read-only store keeps the old link."""
    link = location.links(ref.event) / ref.stage
    target = os.path.relpath(ref.folder, link.parent)
    with contextlib.suppress(OSError):
        if link.is_symlink() and str(link.readlink()) == target:
            return
        link.parent.mkdir(parents=True, exist_ok=True)
        aside = link.with_name(f".{link.name}.{uuid.uuid4().hex[:8]}")
        aside.symlink_to(target)
        aside.replace(link)


def linked(link):
    """Folder of the product that a link below ``latest`` leads to; None where it is not one that `point` makes."""
    try:
        target = str(link.readlink())
    except (OSError, ValueError):
        return None
    folder = folder_of(Path(target).name)
    return folder if KEY.fullmatch(folder.name) and target == os.path.relpath(folder, link.parent) else None


def links(pattern="*/*"):
    """Readable links below ``latest`` with the folders they lead to, list of (Path, Path); no foreign ones."""
    pairs = [(link, linked(link)) for link in sorted((location.folder() / "latest").glob(pattern))]
    return [(link, folder) for link, folder in pairs if folder]


def newest_record(event, stage):
    """Record of the newest product of a name in the configuration that is running, else in the operational one."""
    for name in (None, location.OPERATIONAL):
        folder = linked(location.links(event, name) / stage)
        record = read_record(folder) if folder else None
        if record is not None:
            return record
    return None


@contextlib.contextmanager
def lock(key):
    """Context with an exclusive lock on a key: others that make the same product wait; released if the process dies."""
    try:
        location.prepare()
        path = location.folder() / "locks" / key
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    except OSError as error:
        raise location.unwritable(error, key[:12]) from error
    try:
        with contextlib.suppress(OSError):  # a file system without locks: the rename still protects
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
        path.unlink(missing_ok=True)
    finally:
        os.close(descriptor)


def sealed(record):
    """JSON (bytes) of a record of plain values with its SHA-256 as the last entry."""
    text = json.dumps(record, allow_nan=False).encode()
    return text[:-1] + SEAL + hashlib.sha256(text).hexdigest().encode() + b'"}'


def believed(folder):
    """(record, None) of a product folder, whose name is the key, or (None, reason); the dict is shared."""
    parts = (folder.parent, folder, folder / "meta.json", folder / "product.nc")
    link = next((path for path in parts if path.is_symlink()), None)
    if link:
        return None, f"{link.name} is a link, which is not followed"
    try:
        image = (folder / "meta.json").read_bytes()
    except OSError:
        return None, "no readable record"
    return _believed(image, folder.name)


@functools.lru_cache(maxsize=512)  # of 10 kB each: found, then asked how it was made
def _believed(image, key):
    """(record, None) from the bytes of meta.json of the product with this key, or (None, reason)."""
    body, separator, checksum = image.rpartition(SEAL)
    if not separator:
        return None, "the record has no checksum: written by an earlier gravcal, or by others"
    if checksum != hashlib.sha256(body + b"}").hexdigest().encode() + b'"}':
        return None, "the record is not as it was written (its checksum differs)"
    try:
        record = json.loads(body + b"}")
        for error in schemas.validator("_record").iter_errors(record):
            where = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in error.instance_path)
            return None, f"record{where}: {error.message[:SHOWN]}"
        if ["file" in one for one in record["recipe"]["inputs"]] != ["path" in one for one in record["from"]]:
            return None, "the record names other inputs than places where they were"
        if keys.key(record["recipe"]) != record["key"]:
            return None, "the key in the record is not that of its recipe (settings, inputs, code, event)"
    except (ValueError, OverflowError, RecursionError) as error:
        return None, f"the record cannot be read ({type(error).__name__})"
    if record["key"] != key:
        return None, f"the record names another key, {record['key']}"
    return record, None


def read_record(folder):
    """Record (dict) of a product folder, None if there is no valid one."""
    return believed(folder)[0]


def ancestry(*keys):
    """{key: record, None if gone} of products and all that they were made of, breadth first from these keys."""
    records, waiting = {}, list(keys)
    while waiting:
        key = waiting.pop(0)
        if key not in records:
            records[key] = read_record(folder_of(key))
            waiting += [part["key"] for part in (records[key] or {"from": []})["from"] if part.get("key")]
    return records


def inputs(record):
    """Iterator of (place as of `keys.traced`, label as of `keys.labelled`) of each input of a product's record."""
    return zip(record["from"], record["recipe"]["inputs"], strict=True)


def reference(record, folder):
    """ProductRef from a record and its folder."""
    recipe = record["recipe"]
    return ProductRef(
        recipe["event"], recipe["kind"], recipe["variant"], record["key"], record["digest"], folder / "product.nc"
    )


def set_aside(folder, reason):
    """Move a product folder to quarantine with its reason in a text file; one already gone is no error.

    Of a folder that is reached through a link, the link itself is moved and its target is left alone.
    """
    if KEY.fullmatch(folder.name) and folder.parent.is_symlink():
        folder = folder.parent
    target = location.folder() / "quarantine" / f"{folder.name}-{uuid.uuid4().hex[:8]}"
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        folder.rename(target)
    except FileNotFoundError:
        return
    except OSError as error:
        raise location.unwritable(error, f"{folder.name[:12]} ({reason})") from error
    with contextlib.suppress(OSError):
        is_folder = target.is_dir() and not target.is_symlink()
        note = target / "why.txt" if is_folder else target.with_name(f"{target.name}.txt")
        note.write_text(reason + "\n")


def doubt(folder, record):
    """Reason why a folder contradicts its record, or None; product.nc is hashed only if its time of change differs."""
    try:
        with (folder / "product.nc").open("rb") as file:
            status = os.fstat(file.fileno())
            if status.st_size != record["bytes"]:
                return f"product.nc has {status.st_size} bytes, the record says {record['bytes']}"
            if not _bears_labels(record, lambda place: os.pread(file.fileno(), LABEL_BYTES, place)):
                return "product.nc does not bear the key and digest of the record: it is another product"
    except OSError:
        return "product.nc is missing"
    if status.st_mtime_ns != record["mtime_ns"] and _verified_bytes(folder, record) is None:
        return "bytes differ from the record"
    for name, digest in record["files"].items():  # they are read without another check
        if (folder / name).is_symlink():
            return f"{name} is a link, which is not followed"
        try:
            image = (folder / name).read_bytes()
        except OSError:
            return f"{name} is missing"
        if hashlib.sha256(image).hexdigest() != digest:
            return f"bytes of {name} differ from the record"
    return None


def _bears_labels(record, read):
    """True if ``read(offset)`` at the two recorded offsets of a product file gives its key and digest."""
    places, labels = record["labels_at"], [record["key"].encode(), record["digest"].encode()]
    return len(places) == 2 and all(0 <= place < record["bytes"] for place in places) and [*map(read, places)] == labels


def _verified_bytes(folder, record):
    """Bytes of the product file if their SHA-256 is the recorded one, otherwise None."""
    try:
        image = (folder / "product.nc").read_bytes()
    except OSError:
        return None
    is_whole = hashlib.sha256(image).hexdigest() == record["sha256"]
    return image if is_whole and _bears_labels(record, lambda place: image[place : place + LABEL_BYTES]) else None
