"""Keys: SHA-256 of all that a product depends on: event, kind, variant, version, settings, inputs and code.

The code is the fingerprint of a stage, as docs/architecture.md says: syntax trees, without comments, docstrings and
layout, of the project's own code that is reached by import (``SCOPE``), and the bytes of the data files that it names.
"""

import ast
import dataclasses
import fnmatch
import functools
import hashlib
import importlib.metadata
import importlib.util
import inspect
import json
import math
import re
import sys
from pathlib import Path

from gravcal.errors import CatalogError, ProductError, refuse
from gravcal.io import archive
from gravcal.store import location

MISSIONS = dict.fromkeys("ABXCDY", "grace") | {"T": "taiji", "S": "demo"}
SCOPE = ("gravcal", "tasks")
DATA = ("astropy_iers_data",)  # installed packages whose files are data
FILE_NAME = re.compile(r"\*?([\w-]*(\.[\w-]+)+)")
DOCUMENTED = (ast.Module, ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
IMPORTERS = ("lazy", "import_module")
SILENT = ("kind", "ctx", "type_comment")  # the place of a name says whether it is read or set; the rest is layout
_files = {}  # source or data file -> its status when it was first looked at
_bodies = {}  # ("module:function", other modules) -> its parts and their files, for the life of the process
_trees = {}  # "name-version-digest of source": [digest, imports, file names] of modules, kept for later processes


def key(recipe):
    """SHA-256 of a recipe, dict of plain values as `canonical` returns them; 64 hexadecimal digits."""
    return hashlib.sha256(text(recipe).encode()).hexdigest()


def text(plain):
    """Canonical JSON text of plain values: names sorted, no blanks; refuses NaN and infinity (ValueError)."""
    return json.dumps(plain, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)


def canonical(value, where):
    """Plain value of a setting: None, bool, int, float (-0.0 becomes 0.0), str, or lists and mappings of them.

    ``where`` stands in the message for NaN, infinity, or a type with no such form.
    """
    if value is None or isinstance(value, (bool, str)):
        return value
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {str(name): canonical(item, f"{where}.{name}") for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [canonical(item, f"{where}[{index}]") for index, item in enumerate(value)]
    if hasattr(value, "tolist"):
        return canonical(value.tolist(), where)
    if hasattr(value, "isoformat"):
        return value.isoformat()
    if isinstance(value, int):
        return int(value)
    if isinstance(value, float) and math.isfinite(value):
        return float(value) + 0.0
    shown, expected = f"{value!r} ({type(value).__name__})", "a finite number, text, or lists and mappings of them"
    return refuse(where, shown, expected, "Files enter a stage as inputs, not as settings.", CatalogError)


def typed(value, annotation, where):
    """Setting in the type that its stage states (float, int, str or bool): 1 becomes 1.0, so both share a key."""
    name = getattr(annotation, "__name__", annotation)
    if name == "float" and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    expected = {"float": float, "int": int, "str": str, "bool": bool}.get(name)
    if expected is not None and type(value) is not expected:
        refuse(where, f"{value!r} ({type(value).__name__})", name, "Correct it.", CatalogError)
    return value


def is_file(item):
    """True if an input is a Level-1 file: it has a path, a product and a satellite, and is no product of the store."""
    return not hasattr(item, "kind") and all(hasattr(item, name) for name in ("path", "product", "satellite"))


def check_inputs(stage, inputs, kinds):
    """Raise unless products and Level-1 files are of the kinds a stage reads; the last kind holds for all that follow.

    Kinds: "a|b" for either, "*.solve" for any calibration's, "file" for a Level-1 file.
    """
    for number, item in enumerate(inputs):
        wanted = kinds[min(number, len(kinds) - 1)] if kinds else "no input"
        kind = "file" if is_file(item) else getattr(item, "kind", None)
        if kind is None:
            form = type(item).__name__
            raise TypeError(f"{stage}: input {number + 1} is a {form}, expected a product or Level-1 file")
        if not any(fnmatch.fnmatchcase(kind, one) for one in wanted.split("|")):
            refuse(f"{stage}, input {number + 1}", kind, wanted, "Pass the product of that stage.")


def event_of(stage, inputs):
    """Name of the one event of the inputs; of a Level-1 file "mission-satellite-date"."""
    files = [item for item in inputs if is_file(item)]
    events = {item.event for item in inputs if not is_file(item)}
    events |= {f"{MISSIONS.get(one.satellite, 'unknown')}-{one.satellite.lower()}-{one.date}" for one in files}
    if len(events) != 1:
        names = ", ".join(sorted(events)) or "none"
        refuse(stage, f"inputs of the events {names}", "one event", "Give event=...", CatalogError)
    return events.pop()


def labelled(item):
    """Dict of one input for the recipe: names, and "digest" of its content, None if it is not made yet."""
    if not is_file(item):
        return {"event": item.event, "kind": item.kind, "variant": item.variant, "digest": item.digest}
    entry = {"file": item.name, "product": item.product, "satellite": item.satellite, "date": str(item.date)}
    return entry | {"release": str(item.release), "digest": digest_of(item)}


def traced(item):
    """Place of one input for the record: {"key"} of a product, or {"path", "member"} of a file."""
    return {"path": str(item.path.absolute()), "member": item.member} if is_file(item) else {"key": item.key}


def digest_of(item):
    """SHA-256 (64 hexadecimal digits) of a LevelOneFile; refused if it cannot be read."""
    try:
        return archive.file_digest(item.path, item.member)
    except (OSError, KeyError, EOFError) as error:
        where = f"{item.path}:{item.member}" if item.member else str(item.path)
        return refuse(where, f"what cannot be read ({error})", "a Level-1 file", "Fetch the file again.")


def fingerprint(body, also=()):
    """{"module" or "module:function": digest of the code that a stage's body runs, "package/file": of data it reads}.

    ``also``: modules that the body of the stage reaches in a way no import statement shows.
    """
    name = f"{body.__module__}:{body.__name__}", *also
    if name not in _bodies:
        if not _trees:
            _trees.update(location.recall("modules") or {})
        known, scope = len(_trees), (*SCOPE, _top(body.__module__))
        part, wanted, endings = _body_part(body, scope)
        parts, waiting = {name[0]: part} | _data_parts(body.__module__, (*wanted,), (*endings,)), [*wanted, *also]
        while waiting:
            target = waiting.pop()
            module = _module_of(target) if _top(target) in scope else None
            if module is not None and module not in parts:
                parts[module], imported, endings = _module(module)
                parts |= _data_parts(module, (*imported,), (*endings,))
                waiting += imported
        parts = dict(sorted(parts.items()))
        if len(_trees) > known:
            location.remember("modules", _trees)
        files = (part.partition("/") for part in parts if ":" not in part)
        paths = [Path(inspect.getsourcefile(body)), *(top_folder(t) / f if f else _path(t) for t, _, f in files)]
        _bodies[name] = parts, [(path, _files[path]) for path in paths]
    parts, looked_at = _bodies[name]
    for path, status in looked_at:
        if _status(path) != status:
            message = "the code, or data that it reads, changed while this process was running"
            raise ProductError(f"{path}: {message}, and not what made a product. Start gravcal again.", path=str(path))
    return parts


def total(parts):
    """One SHA-256 for all parts {name: digest}, in hexadecimal digits."""
    return hashlib.sha256("".join(f"{name}={value};" for name, value in sorted(parts.items())).encode()).hexdigest()


@functools.cache
def versions():
    """{package or "python": version}, recorded with a product, not part of its key."""
    names = ("gravcal", "numpy", "scipy", "numba", "xarray", "netCDF4")
    return {name: importlib.metadata.version(name) for name in names} | {"python": sys.version.partition(" ")[0]}


def _body_part(body, scope):
    """(digest of a body and all that it names in its module, [import target "a.b:c"], {end of a file name})."""
    path = Path(inspect.getsourcefile(body))
    tree = _tree(path)
    package = body.__module__ if path.name == "__init__.py" else body.__module__.rpartition(".")[0]
    local, imported = _definitions(tree, package)
    if body.__qualname__ != body.__name__:  # defined inside another function
        line = body.__code__.co_firstlineno
        nodes = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and node.name == body.__name__]
        local[body.__name__] = min(nodes, key=lambda node: abs(node.lineno - line))
    texts, targets, endings, waiting = {}, set(), set(), [body.__name__]
    while waiting:
        if (name := waiting.pop()) in texts:
            continue
        node = local[name]
        if isinstance(node, ast.FunctionDef):  # version and kinds of a stage are in the label already
            node = ast.FunctionDef(node.name, node.args, node.body, [], node.returns, None)
        texts[name] = _tree_text(node)
        targets |= set(_imports(node, package))
        endings |= set(_file_names(node))
        attributes = {id(part.value): part.attr for part in ast.walk(node) if isinstance(part, ast.Attribute)}
        for part in (part for part in ast.walk(node) if isinstance(part, ast.Name)):  # with what is taken from it
            first, attribute = part.id, attributes.get(id(part), "")
            if first in local:
                waiting.append(first)
            if first in imported:  # of a package: the module that its __init__ takes the attribute from
                target = imported[first]
                module = _module_of(target) if attribute and _top(target) in scope else None
                if module and _path(module).name == "__init__.py":
                    exported = _definitions(_tree(_path(module)), module)[1]
                    target = exported.get(attribute, f"{module}:{attribute}")
                targets.add(target)
    content = "\n".join(f"{name}={text}" for name, text in sorted(texts.items()))
    return hashlib.sha256(content.encode()).hexdigest()[:32], sorted(targets), endings


@functools.cache
def _data_parts(module, imported, endings):
    """{"package/file": digest} of data files with names that end like ``endings``, and of files named in these."""
    folders = {_top(module): _path(module).parent}
    folders |= {top: top_folder(top) for top in map(_top, imported) if top in DATA}
    parts, waiting = {}, []
    for top, folder in folders.items() if endings and top_folder(_top(module)).is_dir() else ():
        waiting += [(top, file) for file in _data_below(folder) if file.name.endswith(tuple(endings))]
    while waiting:
        top, file = waiting.pop()
        name = f"{top}/{file.relative_to(top_folder(top)).as_posix()}"
        if name not in parts:
            parts[name], neighbours = _data_file(file)
            waiting += [(top, other) for other in neighbours]
    return parts


@functools.cache
def _data_below(folder):
    """[Path] of all files below a folder but Python code, sorted."""
    files = (path for path in sorted(folder.rglob("*")) if path.suffix not in (".py", ".pyc", ".pyi"))
    return [path for path in files if path.is_file() and "__pycache__" not in path.parts]


@functools.cache
def _data_file(path):
    """(digest of a data file, [Path] of the files of its folder whose names it contains)."""
    content = _source(path)
    others = [other for other in _data_below(path.parent) if other.parent == path.parent and other != path]
    return hashlib.sha256(content).hexdigest()[:32], [other for other in others if other.name.encode() in content]


@functools.cache
def _module(name):
    """[digest, [import target], [end of a file name]] of a module, cached by the content of its file."""
    source = _source(path := _path(name))
    label = f"{name}-{sys.version_info[1]}-{hashlib.sha256(source).hexdigest()[:40]}"
    if label not in _trees:
        tree = ast.parse(source)
        package = name if path.name == "__init__.py" else name.rpartition(".")[0]
        digest = hashlib.sha256(_tree_text(tree).encode()).hexdigest()[:32]
        _trees[label] = [digest, sorted(set(_imports(tree, package))), _file_names(tree)]
    return _trees[label]


def _source(path):  # bytes of a file; its status at the first read goes to `_files`
    _files.setdefault(path, _status(path))
    return path.read_bytes()


def _status(path):  # (size, time of change in ns) of a file, None without
    try:
        return (status := path.stat()).st_size, status.st_mtime_ns
    except FileNotFoundError:
        return None


@functools.cache
def _tree(path):  # ast.Module of a source file
    return _parsed(_source(path))


_parsed = functools.cache(ast.parse)  # by content


@functools.cache
def _module_of(target):
    """Module that holds a target: for "a.b:c" a.b.c if that is one, otherwise a.b; None if there is no such file."""
    module, _, name = target.partition(":")
    if name and _path(f"{module}.{name}"):
        return f"{module}.{name}"
    return module if _path(module) else None


def _top(target):  # top-level package of "a.b:c": "a"
    return target.partition(":")[0].partition(".")[0]


@functools.cache
def _path(name):
    """Source file of a module, found without importing anything; None if there is none."""
    top, _, rest = name.partition(".")
    folder = top_folder(top)
    if folder is None:
        return None
    stem = folder.joinpath(*rest.split(".")) if rest else folder
    candidates = (stem / "__init__.py", stem.with_name(f"{stem.name}.py"))
    return next((path for path in candidates if path.is_file()), None)


@functools.cache
def top_folder(top):
    """Folder of a top-level package (for a single module: its file without the ending), or None."""
    origin = getattr(sys.modules.get(top), "__file__", None)
    if origin is None:
        try:
            spec = importlib.util.find_spec(top)
        except (ImportError, ValueError):
            return None
        origin = spec.origin if spec and spec.has_location else None
    path = Path(origin) if origin else None
    return path and (path.parent if path.name == "__init__.py" else path.with_suffix(""))


def _tree_text(node):
    """Text of a syntax tree without docstrings, positions and empty fields; the same in every version of Python."""
    kind = type(node)
    if kind is list:
        return "[" + ",".join([_tree_text(item) for item in node]) + "]"
    if not isinstance(node, ast.AST):
        return repr(node)
    parts = [kind.__name__]
    for name in node._fields:
        value = getattr(node, name, None)
        if value is None or value == [] or name in SILENT:
            continue
        statement = getattr(value[0], "value", None) if name == "body" and kind in DOCUMENTED else None
        if isinstance(statement, ast.Constant) and isinstance(value[0], ast.Expr) and isinstance(statement.value, str):
            value = value[1:]
        parts.append(f"{name}={_tree_text(value)}")
    return "(" + " ".join(parts) + ")"


def _imports(tree, package):  # ["a.b" or "a.b:c"] imported anywhere in a tree
    return [target for node in ast.walk(tree) for _, target in _bindings(node, package)]


def _file_names(tree):
    """[end of a file name] among the strings of a tree: "page.html", and ".toml" of "*.toml" or f"{name}.toml"."""
    texts = [node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    return sorted({match[1] for text in texts if (match := FILE_NAME.fullmatch(text))})


def _bindings(node, package):
    """Pairs of bound name and import target of one node; lazy("a.b") and import_module("a.b") have no bound name."""
    if isinstance(node, ast.Import):
        return [(alias.asname or alias.name.partition(".")[0], alias.name) for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        module = (
            importlib.util.resolve_name("." * node.level + (node.module or ""), package) if node.level else node.module
        )
        return [(alias.asname or alias.name, f"{module}:{alias.name}") for alias in node.names]
    named = node.args[0] if isinstance(node, ast.Call) and node.args else None
    is_import = (
        isinstance(named, ast.Constant) and getattr(node.func, "attr", getattr(node.func, "id", "")) in IMPORTERS
    )
    return [("", str(named.value))] if is_import else []


def _definitions(tree, package):
    """({name: node} that the top level of a module defines, {name: target} that it imports)."""
    local, imported = {}, {}
    for node in tree.body:
        imported |= dict(_bindings(node, package))
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and _bindings(node.value, package):
            imported[node.targets[0].id] = _bindings(node.value, package)[0][1]
        elif isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            local[node.name] = node
        elif isinstance(node, (ast.Assign, ast.AnnAssign)):
            names = (part for part in ast.walk(node) if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Store))
            local |= {part.id: node for part in names}
    return local, imported
