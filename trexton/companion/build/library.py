"""The page on the library, from its source: public names, signatures, first sentences."""

from __future__ import annotations

import ast
import re
from importlib.util import find_spec
from pathlib import Path

__all__ = ["MODULES", "describe_module"]

# In the order of the method, then what surrounds it.
MODULES = (
    "trexton.flights.flight",
    "trexton.flights.folder",
    "trexton.flights.registry",
    "trexton.vision.images",
    "trexton.vision.camera",
    "trexton.vision.textons",
    "trexton.vision.histograms",
    "trexton.localization.neighbors",
    "trexton.localization.methods",
    "trexton.localization.roles",
    "trexton.localization.base",
    "trexton.localization.distances",
    "trexton.localization.motion",
    "trexton.localization.measurement",
    "trexton.localization.filters",
    "trexton.localization.resampling",
    "trexton.localization.estimation",
    "trexton.localization.recovery",
    "trexton.localization.view",
    "trexton.flights.aiding",
    "trexton.localization.observation",
    "trexton.localization.estimate",
    "trexton.localization.texton_map",
    "trexton.localization.localizer",
    "trexton.localization.landing",
    "trexton.evaluation.suitability",
    "trexton.registration.homography",
    "trexton.registration.mosaic",
    "trexton.evaluation.metrics",
    "trexton.base.records",
    "trexton.simulator.simulator",
    "trexton.simulator.recording",
    "trexton.simulator.floor",
    "trexton.simulator.effects",
)
_WIDTH = 84


def describe_module(name: str) -> str:
    """Markdown on one module: what it is for, what it offers. Empty if there is none."""
    try:
        spec = find_spec(name)
    except ModuleNotFoundError:
        spec = None
    if spec is None or spec.origin is None:
        return ""
    tree = ast.parse(Path(spec.origin).read_text(encoding="utf-8"))
    parts = [f"## {name}", _prose(ast.get_docstring(tree))]
    return "\n\n".join(parts + _describe_names(tree, _public_names(tree))) + "\n"


def _describe_names(tree: ast.Module, public: set[str]) -> list[str]:
    """The public names of a module: its own, and those it hands on from others of the package."""
    parts = []
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and node.name in public:
            parts.append(_entry(node.name + _signature(node), ast.get_docstring(node)))
        elif isinstance(node, ast.ClassDef) and node.name in public:
            parts.append(_describe_class(node))
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("trexton."):
            handed_on = {each.name for each in node.names} & public
            origin = find_spec(str(node.module))
            if handed_on and origin is not None and origin.origin is not None:
                source = Path(origin.origin).read_text(encoding="utf-8")
                parts += _describe_names(ast.parse(source), handed_on)
    return parts


def _public_names(tree: ast.Module) -> set[str]:
    for node in tree.body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__":
            return set(ast.literal_eval(node.value))
    return {
        node.name
        for node in tree.body
        if isinstance(node, (ast.ClassDef, ast.FunctionDef)) and node.name[0] != "_"
    }


def _describe_class(node: ast.ClassDef) -> str:
    methods = [item for item in node.body if isinstance(item, ast.FunctionDef)]
    made = next((_signature(method) for method in methods if method.name == "__init__"), None)
    if made is None:
        fields = [item for item in node.body if isinstance(item, ast.AnnAssign)]
        made = f"({', '.join(ast.unparse(field) for field in fields)})" if fields else ""
    rows = [
        f"- `.{method.name}{'' if _is_property(method) else _signature(method)}`: "
        + _first_sentence(ast.get_docstring(method))
        for method in methods
        if not method.name.startswith("_") and ast.get_docstring(method)
    ]
    return _entry(node.name + made, ast.get_docstring(node)) + (
        "\n\n" + "\n".join(rows) if rows else ""
    )


def _is_property(method: ast.FunctionDef) -> bool:
    return any("property" in ast.unparse(decorator) for decorator in method.decorator_list)


def _signature(node: ast.FunctionDef) -> str:
    arguments = re.sub(r"^(self|cls)(, |$)", "", ast.unparse(node.args))
    return f"({arguments})" + (
        f" -> {ast.unparse(node.returns)}"
        if node.returns and ast.unparse(node.returns) != "None"
        else ""
    )


def _entry(signature: str, docstring: str | None) -> str:
    return f"```python\n{_wrapped(signature)}\n```\n\n{_first_sentence(docstring)}"


def _wrapped(signature: str) -> str:
    """A long signature with one argument a line."""
    if len(signature) <= _WIDTH:
        return signature
    depth, pieces = 0, [""]
    for character in signature:
        depth -= character in ")]}"
        if depth == 0 and character == ")":
            pieces[-1] += ","
            pieces.append("")
        pieces[-1] += character
        if (depth == 1 and character == ",") or (depth == 0 and character == "("):
            pieces.append("")
        depth += character in "([{"
    first, *inner, last = (piece.strip() for piece in pieces)
    return "\n".join([first, *(f"    {piece}" for piece in inner), last])


def _first_sentence(docstring: str | None) -> str:
    return _escaped(" ".join((docstring or "").split("\n\n")[0].split()))


def _prose(docstring: str | None) -> str:
    """The paragraphs of a module's docstring, without lists and tables."""
    paragraphs = [
        part for part in (docstring or "").split("\n\n") if not part.startswith((" ", "-", "*"))
    ]
    return "\n\n".join(_escaped(" ".join(part.split())) for part in paragraphs[:2])


def _escaped(text: str) -> str:
    """What Markdown would take for markup, made harmless; code in backticks stays as it is."""
    pieces = re.split(r"(``.*?``|`.*?`)", text)
    return "".join(
        piece if piece.startswith("`") else re.sub(r"([*_$<>{}\[\]|])", r"\\\1", piece)
        for piece in pieces
    )
