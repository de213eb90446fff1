"""Fingerprint of the code a stage runs: the syntax trees reached by import, without comments, docstrings, layout.

The stage's body is taken with what it names in its own module; of the packages it imports, the modules that define
what it uses; from there on every import, module by module, wherever it stands. Only the project's own code counts
(``SCOPE``). ``lazy("gravcal.x")`` and ``import_module("gravcal.x")`` with a literal name count as imports.

Data files count by their bytes: those below the folder of a module, or below a package of ``DATA`` that it imports,
whose name ends like a text of that module (``"IGRF13.shc"``, or ``f"{name}.toml"`` for every table), and files of the
same folder that such a file names, as a template names another.
"""

import ast
import functools
import hashlib
import importlib.metadata
import importlib.util
import inspect
import sys
from pathlib import Path

from gravcal.errors import ProductError
from gravcal.store import memory, syntax

SCOPE = ("gravcal", "tasks")
DATA = ("astropy_iers_data",)  # installed packages whose files are data
_files = {}  # source or data file -> its status when it was first looked at
_modules = {}  # name of a module -> (digest, names it imports, ends of file names), for the life of the process
_bodies = {}  # "module:function" -> its parts and their files, for the life of the process
_remembered = {}


def of(body, also=()):
    """Digests of the code that a stage runs.

    Parameters
    ----------
    body : function, the stage's own
    also : sequence of str, modules that the body reaches in a way no import statement shows

    Returns
    -------
    parts : dict, "module" or "module:function" -> digest of its syntax tree, "package/file" -> digest of its bytes
    """
    name = f"{body.__module__}:{body.__name__}"
    if name not in _bodies:
        parts = _parts(body, also)
        paths = [Path(inspect.getsourcefile(body)), *(_file_of(part) for part in parts if ":" not in part)]
        _bodies[name] = parts, paths
        _keep_remembered()
    parts, paths = _bodies[name]
    for path in paths:
        _check_unchanged(path, _files[path])
    return parts


def _parts(body, also):
    """Digests of a body and of every module and data file it reaches, by name."""
    scope = (*SCOPE, body.__module__.partition(".")[0])
    part, wanted, named = _body_part(body, scope)
    parts = {f"{body.__module__}:{body.__name__}": part} | _data_parts(body.__module__, wanted, named)
    waiting = [*wanted, *also]
    while waiting:
        target = waiting.pop()
        name = _module_of(target) if _top(target) in scope else None
        if name is None or name in parts:
            continue
        parts[name], imported, named = _module(name)
        parts |= _data_parts(name, imported, named)
        waiting += imported
    return dict(sorted(parts.items()))


def _data_parts(module, imported, named):
    """Digests of the data files that a module names, and of those that they name.

    Parameters
    ----------
    module : str
    imported : targets that it imports
    named : ends of file names among its texts
    """
    folders = {_top(module): _path(module).parent} | {
        top: _top_folder(top) for top in map(_top, imported) if top in DATA
    }
    found, waiting = {}, []
    for top, folder in folders.items() if named and _top_folder(_top(module)).is_dir() else ():
        waiting += [(top, file) for file in _data_below(folder) if file.name.endswith(tuple(named))]
    while waiting:
        top, file = waiting.pop()
        name = f"{top}/{file.relative_to(_top_folder(top)).as_posix()}"
        if name not in found:
            found[name], beside = _data_file(file)
            waiting += [(top, other) for other in beside]
    return found


def _file_of(part):
    """File of a part: of a module, or of a data file."""
    top, _, rest = part.partition("/")
    return _top_folder(top) / rest if rest else _path(part)


@functools.cache
def _data_below(folder):
    """Data files below a folder: all that are no code."""
    files = (path for path in sorted(folder.rglob("*")) if path.suffix not in (".py", ".pyc", ".pyi"))
    return [path for path in files if path.is_file() and "__pycache__" not in path.parts]


@functools.cache
def _data_file(path):
    """Digest of a data file, and the files beside it that it names."""
    content = _source(path)
    others = [other for other in _data_below(path.parent) if other.parent == path.parent and other != path]
    return hashlib.sha256(content).hexdigest()[:32], [other for other in others if other.name.encode() in content]


def total(parts):
    """One digest for all parts."""
    return hashlib.sha256("".join(f"{name}={value};" for name, value in sorted(parts.items())).encode()).hexdigest()


@functools.cache
def versions():
    """Versions of what computes; recorded with a product, not part of its key."""
    names = ("gravcal", "numpy", "scipy", "numba", "xarray", "netCDF4")
    found = {name: importlib.metadata.version(name) for name in names}
    return found | {"python": sys.version.partition(" ")[0]}


def forget():
    """Look at the files again, as a new process would."""
    for known in (_files, _modules, _bodies):
        known.clear()
    for cached in (_tree, _path, _top_folder, _data_below, _data_file):
        cached.cache_clear()


def _module(name):
    """Digest, imports and ends of file names of one module."""
    if name not in _modules:
        _modules[name] = _analysed(_path(name), name)
    return _modules[name]


def _source(path):
    """Bytes of a source file, whose status is noted."""
    _files.setdefault(path, _status(path))
    return path.read_bytes()


def _status(path):
    """Size and time of change of a file."""
    try:
        found = path.stat()
    except FileNotFoundError:
        return None
    return found.st_size, found.st_mtime_ns


def _check_unchanged(path, status):
    """Refuse to go on when a source file changed under the running process."""
    if _status(path) != status:
        raise ProductError(
            f"{path}: the code, or data that it reads, changed while this process was running, so a product "
            f"could bear the label of code that did not make it. Start gravcal again.",
            path=str(path),
        )


def _analysed(path, name):
    """Digest of the tree, imports and ends of file names of a source file, remembered by its content."""
    source = _source(path)
    known = _known_trees()
    label = f"{name}-{sys.version_info[1]}-{hashlib.sha256(source).hexdigest()[:40]}"
    if label not in known:
        tree = ast.parse(source)
        package = name if path.name == "__init__.py" else name.rpartition(".")[0]
        known[label] = [syntax.tree_digest(tree), sorted(set(syntax.imports(tree, package))), syntax.file_names(tree)]
        _remembered["new"] = True
    return known[label]


def _known_trees():
    """Trees seen by earlier processes."""
    if "trees" not in _remembered:
        _remembered["trees"] = memory.recall("modules") or {}
    return _remembered["trees"]


def _keep_remembered():
    """Write newly seen trees for later processes."""
    if _remembered.pop("new", False):
        memory.remember("modules", _remembered["trees"])


def _module_of(target):
    """Module that holds a target: for "a.b:c" a.b.c if that is one, otherwise a.b; None if there is no such file."""
    module, _, name = target.partition(":")
    if name and _path(f"{module}.{name}"):
        return f"{module}.{name}"
    return module if _path(module) else None


def _top(target):
    """Name of the top-level package of a target."""
    return target.partition(":")[0].partition(".")[0]


@functools.cache
def _tree(path):
    """Syntax tree of a file."""
    return ast.parse(_source(path))


@functools.cache
def _path(name):
    """Source file of a module, found without importing anything; None if there is none."""
    top, _, rest = name.partition(".")
    folder = _top_folder(top)
    if folder is None:
        return None
    stem = folder.joinpath(*rest.split(".")) if rest else folder
    candidates = (stem / "__init__.py", stem.with_name(f"{stem.name}.py"))
    return next((path for path in candidates if path.is_file()), None)


@functools.cache
def _top_folder(top):
    """Folder of a top-level package (for a single module: its file without the ending), or None."""
    loaded = sys.modules.get(top)
    origin = getattr(loaded, "__file__", None)
    if origin is None:
        try:
            found = importlib.util.find_spec(top)
        except (ImportError, ValueError):
            return None
        origin = found.origin if found and found.has_location else None
    if origin is None:
        return None
    path = Path(origin)
    return path.parent if path.name == "__init__.py" else path.with_suffix("")


def _body_part(body, scope):
    """Digest of a body with what it names of its module; the targets and the ends of file names that these use."""
    path = Path(inspect.getsourcefile(body))
    tree = _tree(path)
    package = body.__module__ if path.name == "__init__.py" else body.__module__.rpartition(".")[0]
    local, imported = syntax.definitions(tree, package)
    if body.__qualname__ != body.__name__:
        local[body.__name__] = syntax.definition_of(body, tree)
    texts, targets, named, waiting, seen = [], set(), set(), [body.__name__], set()
    while waiting:
        name = waiting.pop()
        if name in seen:
            continue
        seen.add(name)
        node = local[name]
        texts.append(f"{name}={syntax.text(syntax.undecorated(node))}")
        uses = list(syntax.uses(node))
        targets |= {_narrowed(imported[first], rest, scope) for first, rest in uses if first in imported}
        targets |= set(syntax.imports(node, package))
        named |= set(syntax.file_names(node))
        waiting += [first for first, _ in uses if first in local]
    return hashlib.sha256("\n".join(sorted(texts)).encode()).hexdigest()[:32], sorted(targets), named


def _narrowed(target, attribute, scope):
    """Target of "x.attribute", x an imported package: the module its __init__ takes the attribute from, if any."""
    name = _module_of(target) if attribute and _top(target) in scope else None
    if name is None or _path(name).name != "__init__.py":
        return target
    _, imported = syntax.definitions(_tree(_path(name)), name)
    if attribute in imported:
        return imported[attribute]
    return f"{name}:{attribute}"
