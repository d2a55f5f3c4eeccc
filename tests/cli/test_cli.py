"""The command line: help for all, one sentence and status 1 for a fault, no traceback for a
person.
"""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from trexton import __version__
from trexton.base.plugins import addresses, resolve
from trexton.cli import main as cli

VERBS = addresses("commands", cli.COMMANDS)


@pytest.mark.parametrize("name", sorted(VERBS))
def test_every_command_has_help_and_does_what_the_table_says(name, capsys):
    with pytest.raises(SystemExit) as stopped:
        cli.main([name, "--help"])
    assert stopped.value.code == 0
    text = capsys.readouterr().out
    assert f"usage: trexton {name}" in text and "--quiet" in text
    module = resolve("commands", name, cli.COMMANDS)
    assert callable(module.run) and callable(module.add_arguments)


def test_the_overview_lists_every_command(capsys):
    with pytest.raises(SystemExit):
        cli.main(["--help"])
    text = capsys.readouterr().out
    assert all(name in text for name in VERBS)


@pytest.mark.parametrize("words", [[], ["fly-me-home"], ["check"], ["data"], ["run", "x"]])
def test_wrong_usage_is_status_2(words, capsys):
    with pytest.raises(SystemExit) as stopped:
        cli.main(words)
    assert stopped.value.code == 2 and "usage:" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["run", "NOWHERE", "--out", "OUT"], "no such folder"),
        (["train", "NOWHERE", "-o", "OUT/map.npz"], "no such folder"),
        (["data", "fetch", "atlantis"], "no public data set is named 'atlantis'"),
        (["run", "FLIGHT", "--out", "OUT", "--set", "colour=red"], "has a parameter 'colour'"),
        (
            ["run", "FLIGHT", "--out", "OUT", "--only", "astrology"],
            "no experiment is named 'astrology'",
        ),
    ],
)
def test_a_fault_is_one_sentence_and_status_1(words, message, tmp_path, flight_folder, capsys):
    places = {"NOWHERE": tmp_path / "nowhere", "OUT": tmp_path / "out", "FLIGHT": flight_folder}
    for name, path in places.items():
        words = [word.replace(name, str(path)) for word in words]
    assert cli.main(words) == 1
    error = capsys.readouterr().err
    assert error.startswith(f"trexton {words[0]}: ") and message in error
    assert error.count("\n") == 1 and "Traceback" not in error
    assert not (tmp_path / "out").exists(), "something was half-written"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["onboard", "m", "--land", "2,2", "--radius", "1", "--land=3,3"], "--land: given twice"),
        (["onboard", "m", "--camera=a", "--camera", "b"], "--camera: given twice, 'a' and 'b'"),
        (["train", "f", "-o", "a", "--output", "a"], "-o/--output: given twice"),
        (["data", "fetch", "x", "--out", "a", "--out", "b"], "--out: given twice"),
    ],
)
def test_an_option_that_comes_twice_is_wrong_usage(words, told, capsys):
    with pytest.raises(SystemExit, match="2"):
        cli.main(words)
    assert told in capsys.readouterr().err


def test_check_says_usable_or_not(flight_folder, capsys):
    assert cli.main(["check", str(flight_folder)]) == 0
    assert "40 (1 to 40)" in capsys.readouterr().out
    (flight_folder / "histograms.csv").write_text("frame,t0\n1,1\n")
    assert cli.main(["check", str(flight_folder)]) == 1
    assert "histograms.csv, row 3" in capsys.readouterr().out


def run(
    words: list[str],
    code: str = "from trexton.cli.main import main; raise SystemExit(main())",
    **options,
):
    command = [sys.executable, "-c", f"import sys; sys.argv[0] = 'trexton'; {code}", *words]
    return subprocess.run(command, capture_output=True, text=True, **options)


def test_version_and_help_load_none_of_the_heavy_packages():
    heavy = "'numpy', 'cv2', 'numba', 'pandas', 'matplotlib', 'scipy', 'papermill'"
    code = (
        "from trexton.cli.main import main\n"
        "try: main(['--help'])\nexcept SystemExit: pass\n"
        f"loaded = [name for name in ({heavy}) if name in sys.modules]\n"
        "raise SystemExit(f'loaded: {loaded}' if loaded else 0)"
    )
    command = [sys.executable, "-c", f"import sys\n{code}"]
    assert subprocess.run(command, capture_output=True, text=True).returncode == 0
    shown = run(["--version"])
    assert shown.stdout == f"trexton {__version__}\n"


def test_an_interrupt_and_a_closed_pipe_leave_no_traceback(flight_folder):
    code = (
        "from trexton.cli import main as cli\nimport trexton.cli.check as check\n"
        "def stop(path): raise KeyboardInterrupt\ncheck.check_flight = stop\nraise "
        "SystemExit(cli.main())"
    )
    interrupted = run(["check", str(flight_folder)], code)
    assert (interrupted.returncode, interrupted.stderr) == (130, "trexton check: interrupted\n")
    reader, writer = os.pipe()
    os.close(reader)
    process = subprocess.run(
        [sys.executable, "-m", "trexton", "check", str(flight_folder)],
        stdout=writer,
        stderr=subprocess.PIPE,
        text=True,
    )
    os.close(writer)
    assert "Traceback" not in process.stderr


@pytest.mark.parametrize("words", ["methods", "check nowhere", "--version"])
def test_a_closed_output_is_a_sentence(words):
    command = f"{sys.executable} -m trexton {words} >&-"
    done = subprocess.run(command, shell=True, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 1 and done.stderr.count("\n") == 1
    assert "standard output is closed" in done.stderr
    silent = subprocess.run(f"{command} 2>&-", shell=True, capture_output=True)
    assert silent.returncode == 1
    spoken = subprocess.run(f"{sys.executable} -m trexton nonsense 2>&-", shell=True)
    assert spoken.returncode == 2


def test_methods_lists_parts_with_what_they_read_and_their_options(capsys):
    assert cli.main(["methods", "field"]) == 0
    said = capsys.readouterr().out
    assert "method field: motion=singer" in said and "recovery" not in said
    assert "reads motion (LinearMotion), measurement (Field), odometry" in said
    assert "agility=2.0 (float > 0): accelerations" in said
    assert cli.main(["methods", "motion=trexton.localization.motion:RandomWalk"]) == 0
    assert "sigma=None (float or None > 0)" in capsys.readouterr().out
    assert cli.main(["methods", "magic"]) == 1
    assert "choose one of paper" in capsys.readouterr().err
