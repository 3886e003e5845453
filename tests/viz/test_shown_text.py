"""Titles, names and labels of users in pictures: letter by letter, without a warning (each warning is an error here)."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from flashtemp.__main__ import main
from flashtemp.viz import theme
from flashtemp.viz.literal_text import UNKNOWN_LETTER, replace_unprintable
from flashtemp.viz.measurement.residual_plots import draw_residuals

ODD = (
    "a $x^2$ b",
    r"$\frac{",
    r"$\undefined{$",
    "50 $ and 60 $ of {",
    "温度 🔥 été",
    "a\0b\x1b[31m",
    "\ud800",
    "\u202ea",
    r"\alpha_{",
)


@pytest.mark.parametrize("text", ODD, ids=ascii)
def test_any_text_can_be_drawn_anywhere_in_a_picture(text, tmp_path):
    @theme.styled
    def draw() -> Figure:
        fig = theme.make_figure(text, text, 4.0, 3.0)
        left, right = fig.subplots(1, 2)
        left.plot([1, 2], [1e-3, 1e3], label=text)
        left.set(yscale="log", title=text, xlabel=text, ylabel=text)
        left.legend(title=text)
        left.annotate(text, (1, 1))
        right.set_xticks([0, 1], [text, "b"])
        return fig

    fig = draw()
    theme.save_figure(fig, tmp_path / "a.png")
    shown = {t.get_text().replace(r"\$", "$") for t in fig.axes[0].texts}
    assert len(shown) == 1
    assert all(c in (given, UNKNOWN_LETTER) for c, given in zip(shown.pop(), text, strict=True))
    numbers = [t.get_text() for t in fig.axes[0].yaxis.get_ticklabels()]
    assert any("10^" in n and r"\$" not in n for n in numbers)  # powers of ten stay mathematics


def test_letters_are_kept_and_control_characters_marked():
    assert replace_unprintable("µ°C – é\n2") == "µ°C – é\n2"
    assert replace_unprintable("a\x00\x9b\ud800") == "a" + 3 * UNKNOWN_LETTER


def test_mathematics_of_users_is_no_mathematics(tmp_path):
    @theme.styled
    def draw() -> Figure:
        fig = theme.make_figure("$a$", "", 4.0, 3.0)
        fig.subplots().set_title("$a$ and $b$")
        return fig

    fig = draw()
    fig.canvas.draw()
    text = fig.axes[0].title if fig.axes[0].title.get_text() else fig.axes[0]._left_title
    assert text._preprocess_math(text.get_text()) == ("$a$ and $b$", False)


def test_a_title_with_control_characters_is_refused_before_anything_is_computed(tmp_path, capsys):
    (tmp_path / "case.toml").write_text('title = "a\\u0000b"\n', encoding="utf-8")
    assert main(["run", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert "title: 'a\\x00b' contains a control character; leave it out" in capsys.readouterr().err


@pytest.mark.parametrize("x", [[0.1, 0.1, 0.1], [0.1], [0.1, 0.2]])
def test_frames_of_one_moment_are_drawn_without_a_warning(x, tmp_path):
    @theme.styled
    def draw() -> Figure:
        fig = theme.make_figure("", "", 4.0, 3.0)
        draw_residuals(fig.subplots(), np.array(x), np.zeros(len(x)), np.ones(len(x)))
        return fig

    fig = draw()
    theme.save_figure(fig, tmp_path / "a.png")
    low, high = fig.axes[0].get_xlim()
    assert low < min(x) <= max(x) < high
