import os

import pytest

import transferkit.renderer as module
from transferkit.attempt import Attempt
from transferkit.errors import EnvironmentContractError
from transferkit.renderer import choose_renderer, find_renderer


@pytest.fixture
def working(monkeypatch):
    """Says which renderers work and what the user has set; returns those that were tried."""

    def pretend(renderers, chosen):
        tried = []

        def attempt(code, renderer):
            tried.append(renderer)
            return Attempt("", "" if renderer in renderers else "broken")

        module._renders.cache_clear()
        monkeypatch.setattr(module, "attempt", attempt)
        monkeypatch.delenv("MUJOCO_GL", raising=False)
        if chosen is not None:
            monkeypatch.setenv("MUJOCO_GL", chosen)
        return tried

    yield pretend
    module._renders.cache_clear()


@pytest.mark.parametrize(
    ("chosen", "found", "tried"),
    [
        ("osmesa", "osmesa", ["osmesa"]),
        (" EGL", "egl", ["egl"]),
        ("glfw", "egl", ["glfw", "egl"]),
        ("nonsense", "egl", ["glfw", "egl"]),
        ("disable", "egl", ["glfw", "egl"]),
        (None, "egl", ["glfw", "egl"]),
    ],
)
def test_the_users_renderer_comes_first(working, chosen, found, tried):
    attempts = working({"egl", "osmesa"}, chosen)
    assert find_renderer() == found
    assert attempts == tried
    choose_renderer()
    assert os.environ["MUJOCO_GL"] == found


def test_none_is_one_line(working):
    assert working((), "nonsense") == []
    with pytest.raises(EnvironmentContractError, match="nothing can be rendered here; install a GL driver"):
        choose_renderer()
