"""Syntax trees: their text without docstrings and layout, what they import, define and use."""

import ast
import hashlib
import re

DOCUMENTED = (ast.Module, ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
SILENT = ("kind", "ctx", "type_comment")  # the place of a name says whether it is read or set; the rest is layout

FILE_NAME = re.compile(r"\*?([\w-]*(\.[\w-]+)+)")


def tree_digest(node):
    """Digest of a syntax tree without docstrings, positions and empty fields.

    Parameters
    ----------
    node : ast.AST

    Returns
    -------
    digest : str, 32 hexadecimal digits
    """
    return hashlib.sha256(text(node).encode()).hexdigest()[:32]


def text(node):
    """Nested text of a tree; the same in every version of Python that has the syntax."""
    kind = type(node)
    if kind is list:
        return "[" + ",".join([text(item) for item in node]) + "]"
    if not isinstance(node, ast.AST):
        return repr(node)
    written = [kind.__name__]
    for name in node._fields:
        value = getattr(node, name, None)
        if value is None or value == [] or name in SILENT:
            continue
        if name == "body" and kind in DOCUMENTED:
            value = _without_docstring(value)
        written.append(f"{name}={text(value)}")
    return "(" + " ".join(written) + ")"


def _without_docstring(body):
    """Statements after the docstring, if there is one."""
    first = body[0] if body else None
    is_text = (
        isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant) and isinstance(first.value.value, str)
    )
    return body[1:] if is_text else body


def imports(tree, package):
    """Names that a tree imports: "a.b" for a module, "a.b:c" for c from a.b."""
    for node in ast.walk(tree):
        for _, target in bindings(node, package):
            yield target


def file_names(tree):
    """Ends of file names among the texts of a tree: "page.html", and ".toml" of "*.toml" or f"{name}.toml"."""
    texts = [node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    return sorted({found[1] for text in texts if (found := FILE_NAME.fullmatch(text))})


def bindings(node, package):
    """Pairs of bound name and import target of one node; lazy("a.b") and import_module("a.b") have no bound name."""
    if isinstance(node, ast.Import):
        return [(alias.asname or alias.name.partition(".")[0], alias.name) for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        parents = package.split(".")
        base = parents[: len(parents) - node.level + 1] if node.level else []
        module = ".".join([*base, *([node.module] if node.module else [])])
        return [(alias.asname or alias.name, f"{module}:{alias.name}") for alias in node.names]
    is_call = isinstance(node, ast.Call) and getattr(node.func, "attr", getattr(node.func, "id", "")) in (
        "lazy",
        "import_module",
    )
    if is_call and node.args and isinstance(node.args[0], ast.Constant):
        return [("", str(node.args[0].value))]
    return []


def definitions(tree, package):
    """What the top level of a module defines (name -> node) and imports (name -> target)."""
    local, imported = {}, {}
    for node in tree.body:
        imported |= dict(bindings(node, package))
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and bindings(node.value, package):
            imported[node.targets[0].id] = bindings(node.value, package)[0][1]
            continue
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            local[node.name] = node
        elif isinstance(node, (ast.Assign, ast.AnnAssign)):
            names = [
                part.id for part in ast.walk(node) if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Store)
            ]
            local |= dict.fromkeys(names, node)
    return local, imported


def definition_of(body, tree):
    """Node of a function, also of one defined inside another."""
    line = body.__code__.co_firstlineno
    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and node.name == body.__name__]
    return min(nodes, key=lambda node: abs(node.lineno - line))


def undecorated(node):
    """A function without its decorators and annotations of stages: version and kinds are in the label already."""
    if isinstance(node, ast.FunctionDef):
        return ast.FunctionDef(node.name, node.args, node.body, [], node.returns, None)
    return node


def uses(node):
    """Names that a tree reads, each with the attribute taken from it, if any; decorators apart."""
    inner = {id(part.value) for part in ast.walk(node) if isinstance(part, ast.Attribute)}
    skipped = {id(part) for top in getattr(node, "decorator_list", []) for part in ast.walk(top)}
    for part in ast.walk(node):
        if id(part) in skipped:
            continue
        if isinstance(part, ast.Attribute) and isinstance(part.value, ast.Name):
            yield part.value.id, part.attr
        elif isinstance(part, ast.Name) and id(part) not in inner:
            yield part.id, ""
