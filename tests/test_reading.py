"""What a file has in place of a listed value is answered with the list, wherever it stands."""

import time
from dataclasses import dataclass
from typing import Literal

import pytest

from transferkit.reading import FormatError, parse_yaml, typed

Colour = Literal["red", "blue"]


@dataclass(frozen=True)
class Picture:
    """A value of every kind that readers declare."""

    colour: Colour | None = None
    more: tuple[Colour, ...] = ()
    pair: tuple[int, Colour] = (0, "red")
    size: float = 0.0
    switch: bool = False
    named: dict[str, list[Colour]] | None = None
    keyed: dict[Colour, int] | None = None


@pytest.mark.parametrize("given", [{"colour": "r"}, {"more": ["red", "r"]}, {"pair": [1, "r"]}, {"named": {"a.b]": ["r"]}}])
def test_a_word_that_is_not_listed_is_answered_with_those_that_are(given):
    with pytest.raises(FormatError, match=r"'r'.*; known are blue, red$"):
        typed(given, Picture)


STRANGE = ["colour: !!bool maybe", "keyed: !!int ''", "keyed: !!float ''", "keyed: !!timestamp x"]
"""Tags that a file gives its values by force."""


@pytest.mark.parametrize("text", ["", "? [a, b]\n: 1", "{{a: 1}: 2}", "- 1", "colour: red\ncolour: blue", *STRANGE])
def test_a_file_of_another_shape_is_one_line(text):
    with pytest.raises(FormatError) as error:
        parse_yaml(text.encode(), Picture)
    assert "\n" not in str(error.value)


def test_what_else_is_wrong_is_said_without_a_list():
    for given in ({"colour": 1}, {"keyed": {"r": 1}}, {"more": "red"}):
        with pytest.raises(FormatError) as error:
            typed(given, Picture)
        assert "known are" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("pair: [010, red]", 10),
        ("size: 1e3", 1000.0),
        ("size: -.5E-1", -0.05),
        ("size: 3", 3.0),
        ("switch: True", True),
        ("pair: [1:30, red]", None),
        ("pair: [0x10, red]", None),
        ("size: 1_000", None),
        ("switch: on", None),
    ],
)
def test_numbers_and_switches_are_what_they_look_like(text, value):
    """As in YAML 1.2; what only 1.1 takes for a number or a switch is refused."""
    if value is None:
        with pytest.raises(FormatError, match="Expected"):
            parse_yaml(text.encode(), Picture)
    else:
        found = parse_yaml(text.encode(), Picture)
        assert value in (found.pair[0], found.size, found.switch)


@pytest.mark.parametrize("text", ["[" * 100_000, "{a: " * 50_000, "- " * 50_000, "? " * 50_000])
def test_deep_yaml_is_refused_at_once(text):
    begin = time.process_time()
    with pytest.raises(FormatError, match="nested too deeply"):
        parse_yaml(text.encode(), dict)
    assert time.process_time() - begin < 2.0  # PyYAML alone takes minutes
