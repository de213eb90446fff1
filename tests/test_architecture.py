"""The rules of the house that a machine can check: imports point down, every calibration has its files, sizes."""

import ast
from functools import cache
from pathlib import Path

import pytest

from gravcal.data.catalog_events import CALIBRATIONS

ROOT = Path(__file__).parent.parent
BELOW = {
    "gravcal.physics": set(),
    "gravcal.methods": {"gravcal.physics"},
    "gravcal.effects": {"gravcal.methods", "gravcal.physics"},
    "gravcal.calibrations": {"gravcal.effects", "gravcal.methods", "gravcal.physics"},
    "gravcal.discovery": {"gravcal.calibrations", "gravcal.effects", "gravcal.methods", "gravcal.physics"},
    "gravcal.simulation": {"gravcal.effects", "gravcal.methods", "gravcal.physics"},
    "gravcal.data": {"gravcal.physics"},
    "gravcal.report": {"gravcal.calibrations", "gravcal.data", "gravcal.methods", "gravcal.physics"},
    "gravcal.browse": {"gravcal.data", "gravcal.methods", "gravcal.physics"},
}
EVERYWHERE = {"gravcal.errors"}
ABOVE = {"tasks": {"tasks", "gravcal"}, "flows": {"flows", "tasks", "gravcal", "catalog"}}
PREFECT = ("flows", "tasks")
XARRAY = ("gravcal.calibrations", "gravcal.data", "gravcal.discovery", "gravcal.report", "gravcal.simulation", "tasks")
OURS = ("gravcal", "tasks", "flows", "catalog")


def modules():
    """Names and paths of all modules that the wheel ships."""
    paths = [path for top in ("gravcal", "tasks", "flows") for path in sorted((ROOT / top).rglob("*.py"))]
    return {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in paths}


@cache
def tree(path):
    """Syntax tree of a file."""
    return ast.parse(path.read_text())


def imports(path):
    """Full names that a file imports, at any depth; relative ones made absolute; lazy("...") counts."""
    package = path.relative_to(ROOT).parent.parts
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) + 1 - node.level]) if node.level else ""
            module = ".".join(part for part in (base, node.module) if part)
            yield from (f"{module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "lazy" and node.args:
            yield node.args[0].value


def layer(name):
    """Layer of a module: its top package, and inside gravcal the next one."""
    parts = name.removesuffix(".__init__").split(".")
    return ".".join(parts[:2]) if parts[0] == "gravcal" else parts[0]


@pytest.mark.parametrize("name", modules())
def test_imports_point_down(name):
    """Contract: flows -> tasks -> discovery -> calibrations -> effects -> methods -> physics, and tasks -> data."""
    own = layer(name)
    found = {imported for imported in imports(modules()[name]) if imported.split(".")[0] in OURS}
    if own in ABOVE:
        wrong = {imported for imported in found if imported.split(".")[0] not in ABOVE[own]}
    elif own in ("gravcal", "gravcal.errors", "gravcal.__init__"):
        wrong = found
    else:
        allowed = BELOW[own] | EVERYWHERE | {own}
        wrong = {imported for imported in found if layer(imported) not in allowed and imported != "gravcal.__version__"}
    assert not wrong


@pytest.mark.parametrize("name", modules())
def test_libraries_stay_in_their_layers(name):
    """Contract: Prefect is known to flows and tasks only, xarray to those that hold datasets."""
    tops = {imported.split(".")[0] for imported in imports(modules()[name])}
    assert "prefect" not in tops or layer(name) in PREFECT
    assert "xarray" not in tops or layer(name) in XARRAY


@pytest.mark.parametrize("name", [name for name in modules() if name.startswith("gravcal.calibrations.")])
def test_a_calibration_imports_no_other(name):
    """Contract: what two calibrations share moves right."""
    own = name.split(".")[2]
    others = {imported.split(".")[2] for imported in imports(modules()[name]) if layer(imported) == layer(name)}
    assert not (others - {own}) & set(CALIBRATIONS)


@pytest.mark.parametrize("name", [name for name in CALIBRATIONS if (ROOT / "flows" / f"{name}.py").exists()])
def test_every_calibration_has_its_files(name):
    """Contract: one name for science, stages, flow, parameters and tests."""
    science = ROOT / "gravcal" / "calibrations"
    assert (science / f"{name}.py").exists() or (science / name / "__init__.py").exists()
    assert (ROOT / "tasks" / f"{name}.py").exists()
    assert (ROOT / "catalog" / "parameters" / f"{name}.toml").exists()
    tests = ROOT / "tests" / "calibrations"
    assert [*tests.glob(f"test_{name}*.py"), *(tests / name).glob("test_*.py")]


@pytest.mark.parametrize("name", modules())
def test_a_module_can_be_read_in_one_sitting(name):
    """Contract: modules stay under 300 lines, bodies of functions at 30 lines and arguments at five or as settings."""
    path = modules()[name]
    assert len(path.read_text().splitlines()) <= 300
    long = [node.name for node in ast.walk(tree(path)) if isinstance(node, ast.FunctionDef) and body_lines(node) > 30]
    assert not long


def body_lines(node):
    """Lines of a function after its docstring."""
    first = node.body[0]
    is_text = (
        isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant) and isinstance(first.value.value, str)
    )
    body = node.body[1:] if is_text else node.body
    return node.end_lineno - body[0].lineno + 1 if body else 0
