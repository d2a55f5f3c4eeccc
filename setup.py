"""The wheel carries what a run needs besides the code: notebooks, the paper's numbers, a book.

The repository keeps each of them in one place; building copies them to ``trexton/_shipped``.
"""

from pathlib import Path
from shutil import copytree, ignore_patterns, rmtree

from setuptools import setup
from setuptools.command.build_py import build_py

SHIPPED = ("notebooks", "data", "book")
LEFT = ("_build", "cache", "flights", "reference", "*.ipynb", ".ipynb_checkpoints")


class BuildWithData(build_py):
    """Build the package, then put the data beside it."""

    def run(self):
        super().run()
        if not self.editable_mode:
            for name in SHIPPED:
                place = Path(self.build_lib) / "trexton" / "_shipped" / name
                rmtree(place, ignore_errors=True)
                copytree(Path(__file__).parent / name, place, ignore=ignore_patterns(*LEFT))


setup(cmdclass={"build_py": BuildWithData})
