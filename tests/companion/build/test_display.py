"""How long a run will take is said before it, and how much is left after each step."""

from __future__ import annotations

from trexton.companion.build import display
from trexton.companion.build.display import Display, Outcome


def test_the_time_left_follows_how_long_the_others_took(monkeypatch, capsys):
    now = [0.0]
    monkeypatch.setattr(display.time, "monotonic", lambda: now[0])
    shown = Display({"hall/a": 60.0, "hall/b": 120.0, "hall/c": 300.0}, jobs=2)
    assert "3 notebooks: about 4 minutes if none" in capsys.readouterr().err
    now[0] = 60.0  # two at once, and it took twice as long as thought
    shown.finished(Outcome("hall", "a", "ran", (), 60.0))
    assert "about 7 minutes left" in capsys.readouterr().err
    shown.finished(Outcome("hall", "b", "reused"))
    shown.finished(Outcome("hall", "c", "failed"))
    assert "left" not in capsys.readouterr().err  # nothing is
