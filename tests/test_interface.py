"""The declared interface: which names, and what each takes. Whoever changes it renews interface.txt
(``python tests/test_interface.py``) and says so in the CHANGELOG.
"""

from __future__ import annotations

import importlib
import inspect
import re
from pathlib import Path

from conftest import ROOT

import trexton

FROZEN = Path(__file__).parent / "interface.txt"


def lines() -> list[str]:
    """A line for each public name: what it is called with, and its public methods."""
    found = []
    for name in trexton.__all__:
        thing = getattr(trexton, name)
        if not callable(thing):
            continue
        found.append(f"{name}{_signature(thing)}")
        if inspect.isclass(thing):
            methods = inspect.getmembers(thing, lambda each: callable(each) or is_property(each))
            found += [
                f"    {each}{_signature(value) if callable(value) else ''}"
                for each, value in methods
                if not each.startswith("_")
            ]
    return found


def is_property(value: object) -> bool:
    return isinstance(value, property)


def _signature(thing: object) -> str:
    try:
        return str(inspect.signature(thing)).replace("'", "")
    except ValueError:  # an exception
        return ""


def test_it_is_what_was_declared():
    assert lines() == FROZEN.read_text().splitlines()


def test_there_are_at_most_forty_names_each_with_a_docstring():
    assert len(trexton.__all__) <= 40 and len(set(trexton.__all__)) == len(trexton.__all__)
    for name in trexton.__all__[1:]:
        assert (inspect.getdoc(getattr(trexton, name)) or "").strip(), name


def test_the_glossary_names_places_that_are_there():
    page = (ROOT / "book" / "glossary.md").read_text().partition("## In the code")[2]
    places = re.findall(r"`(trexton[\w.]+)`", page)
    assert len(places) > 60
    for place in places:
        assert found(place), place


def found(place: str) -> bool:
    """Whether a dotted name is a module, or something in one."""
    module, names = place, []
    while module:
        try:
            thing = importlib.import_module(module)
            break
        except ModuleNotFoundError:
            module, _, name = module.rpartition(".")
            names.insert(0, name)
    for name in names:
        if not hasattr(thing, name):
            return name in getattr(thing, "__dataclass_fields__", {})
        thing = getattr(thing, name)
    return bool(module)


if __name__ == "__main__":
    FROZEN.write_text("\n".join(lines()) + "\n")
