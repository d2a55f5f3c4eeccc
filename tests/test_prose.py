"""What prose shows is run: Python as it stands, commands through the parser."""

from __future__ import annotations

import re
import shlex
import shutil
from functools import partial
from itertools import islice, pairwise
from time import perf_counter
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import yaml
from conftest import ROOT

import trexton
from trexton.base.plugins import addresses
from trexton.cli.main import COMMANDS, build_parser
from trexton.companion.experiments.homography import HomographyLocalizer
from trexton.companion.experiments.registry import EXPERIMENTS, LEDGER
from trexton.companion.experiments.similarity import heat_map, local_losses
from trexton.companion.wording import template_environment
from trexton.flights.aiding import Aiding
from trexton.localization.estimate import Estimate
from trexton.localization.landing import LandingZone, TouchdownZone
from trexton.localization.observation import Observation
from trexton.registration.mosaic import stitch
from trexton.simulator.floor import Floor, Light
from trexton.simulator.recording import record_flight
from trexton.simulator.simulator import Simulator
from trexton.vision.camera import Camera
from trexton.vision.histograms import sampled_histogram
from trexton.vision.textons import draw_patches

PAGES = [
    ROOT / "README.md",
    *sorted((ROOT / "book").glob("*.md")),
    *sorted((ROOT / "notebooks").glob("*.md")),
]


def blocks(page, language):
    """The text of every code block of a language, directives (``{code-cell}``) not among them."""
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(), re.M | re.S)


PYTHON = [
    pytest.param(text, id=f"{page.stem}-{number}")
    for page in PAGES
    for number, text in enumerate(blocks(page, "python"))
]


@pytest.fixture(scope="module")
def names(tmp_path_factory):
    """What a reader of any page has: small flights in their usual places, a map, imports. All is
    seen by a camera of a quarter of the pixels.
    """
    folder = tmp_path_factory.mktemp("clone")
    hall = cv2.resize(Floor.painted().picture.image, (960, 960), interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(folder / "hall.png"), hall)
    floor = Floor.from_file(folder / "hall.png", 5.0)
    camera = Camera(width=320, height=240, focal=260.0)
    flight = record_flight(
        folder / "data" / "flights" / "sim-survey",
        frames=32,
        every=4,
        floor=floor,
        camera=camera,
    )
    flights = folder / "data" / "flights"
    shutil.copytree(flights / "sim-survey", flights / "sim-waypoints")
    texton_map = trexton.train_map(flight, n_textons=8, rng=np.random.default_rng(0))
    localizer = trexton.Localizer(
        texton_map, samples=100, particles=50, rng=np.random.default_rng(0)
    )
    image = flight.image(3)
    localizer.step(image)
    center = np.array([2.5, 2.5])
    return {
        "folder": folder,
        "np": np,
        "islice": islice,
        "perf_counter": perf_counter,
        **{name: getattr(trexton, name) for name in trexton.__all__ if not name.startswith("_")},
        "draw_patches": draw_patches,
        "stitch": stitch,
        "sampled_histogram": sampled_histogram,
        "local_losses": local_losses,
        "heat_map": heat_map,
        "HomographyLocalizer": HomographyLocalizer,
        "LandingZone": LandingZone,
        "TouchdownZone": TouchdownZone,
        "Simulator": partial(Simulator, camera=camera),
        "Light": Light,
        "Observation": Observation,
        "Aiding": Aiding,
        "flight": flight,
        "train": flight,
        "test": flight,
        "texton_map": texton_map,
        "floor": floor,
        "roll": 0.0,
        "pitch": 0.0,
        "yaw": 0.0,
        "image": image,
        "frame": image,
        "camera": [image, flight.image(4)],
        "mosaic": SimpleNamespace(map=flight.floor),
        "center": center,
        "simulator": Simulator(floor, camera=camera, start=center, rng=np.random.default_rng(0)),
        "aiding": None,
        "plan": SimpleNamespace(goal=lambda position: center),
    }


@pytest.mark.parametrize("code", PYTHON)
def test_python_runs_as_printed(code, names, monkeypatch):
    monkeypatch.chdir(names["folder"])
    rng = np.random.default_rng(1)
    localizer = trexton.Localizer(names["texton_map"], samples=100, particles=50, rng=rng)
    localizer.step(names["image"])
    if "localizer.locate" in code:
        localizer = HomographyLocalizer(names["flight"].floor)
    if "TouchdownZone" in code:  # whose map would know a velocity: it stands over the zone
        there = Estimate(names["center"], 0.01 * np.eye(2), False)
        localizer = SimpleNamespace(step=lambda image, aiding=None: there)
    complete = code.startswith(
        "import numpy"
    )  # from its first line on: as copied, with nothing else
    exec(
        compile(code, "page", "exec"),
        {} if complete else names | {"rng": rng, "localizer": localizer},
    )


def commands(page):
    """Every ``trexton`` command line of a page: of shell blocks, and code within sentences."""
    text = re.sub(r"{%.*?%}", "", page.read_text())
    lines = [
        line.partition(" #")[0]
        for block in re.findall(r"^```(?:bash|sh|console)\n(.*?)^```", text, re.M | re.S)
        for line in block.replace("\\\n", " ").splitlines()
    ]
    prose = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)
    lines += [" ".join(code.split()) for code in re.findall(r"`(trexton [^`]+)`", prose)]
    return [line.strip() for line in lines if line.strip().startswith("trexton ")]


COMMAND_LINES = sorted({line for page in PAGES for line in commands(page)})


@pytest.mark.parametrize("line", COMMAND_LINES)
def test_commands_are_ones_that_the_program_takes(line, capsys):
    words = shlex.split(line)[1:]
    assert words[0] in addresses("commands", COMMANDS) or words[0].startswith("-"), line
    if words[1:] or words[0] in ("book", "bench"):
        try:
            build_parser(words[0]).parse_args(words)
        except SystemExit as stop:
            assert stop.code == 0, f"{line}: {capsys.readouterr().err.splitlines()[-1]}"


def test_make_is_asked_only_for_what_it_knows():
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.M))
    for page in PAGES:
        for name in re.findall(r"`(?:[A-Z_]+=\S+ )?make ([a-z-]+)[^`]*`", page.read_text()):
            assert name in targets, f"{page.name}: make {name}"


def test_templates_of_the_notebooks_are_well_formed_and_their_claims_are_not_typed():
    environment = template_environment()
    for name in EXPERIMENTS.keys() - {LEDGER}:
        text = (ROOT / "notebooks" / f"{name}.md").read_text()
        for template in re.findall(r'page\.say\(r"""\n(.*?)"""', text, re.S):
            environment.parse(template)
        assert text.count("page.say(") == len(re.findall(r'page\.say\(r"""\n.*?"""', text, re.S))


def test_the_pages_of_the_book_link_to_pages_that_exist():
    toc = yaml.safe_load((ROOT / "book" / "_toc.yml").read_text())
    chapters = [chapter for part in toc["parts"] for chapter in part["chapters"]]
    known = {page.stem for page in PAGES} | set(EXPERIMENTS) | {each["file"] for each in chapters}
    for page in PAGES:
        for target in re.findall(r"see\(\"([\w/-]+\w)\"", page.read_text()):
            assert target.rpartition("/")[2] in known, f"{page.name}: {target}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_no_sentence_is_joined_to_the_next_by_a_template(page):
    """Templates drop the line's end after a tag (`trim_blocks`), unless it ends in ``+%}``."""
    lines = page.read_text().splitlines()
    joined = [
        line
        for line, following in pairwise(lines)
        if line.endswith("%}") and not line.endswith("+%}")
        if re.sub(r"{%.*?%}", "", line).strip() and re.match(r"[^\W_]", following)
    ]
    assert not joined
