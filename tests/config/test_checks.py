import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
import pytest

from transferkit.config import ModelConfig, NetworkConfig
from transferkit.config.checks import AT_LEAST_ONE, Items, Range, check, check_value
from transferkit.errors import SettingError


@pytest.mark.parametrize(
    ("allowed", "inside", "outside", "words"),
    [
        pytest.param(Range(1), (1, 1.5, 10**400), (0, 0.999, math.inf, math.nan), "at least 1", id="a lower end"),
        pytest.param(Range(0, open_low=True), (1e-9, 5), (0, -1), "above 0", id="an open lower end"),
        pytest.param(Range(high=2), (2, -1e9), (2.1, -math.inf), "at most 2", id="an upper end"),
        pytest.param(Range(0, 1), (0, 0.5, 1), (-0.1, 1.1), "at least 0 and at most 1", id="both ends"),
        pytest.param(Range(0, 1, open_high=True), (0, 0.99), (1, 2), "at least 0 and below 1", id="an open upper end"),
        pytest.param(Range(1, 10**6), (10**6,), (10**6 + 1,), "at least 1 and at most 1,000,000", id="a large end"),
    ],
)
def test_a_range_holds_finite_numbers_up_to_its_ends_and_says_so(allowed, inside, outside, words):
    assert [number in allowed for number in (*inside, *outside)] == [True] * len(inside) + [False] * len(outside)
    assert str(allowed) == words


@dataclass(frozen=True)
class Sample:
    whole: int = 1
    number: float = 1.0
    flag: bool = True
    text: str = ""
    count: Annotated[int, Range(1)] = 1
    perhaps: Annotated[float, Range(0)] | None = None
    choice: Literal["adam", "sgd"] = "adam"
    several: tuple[Annotated[int, Range(1)], ...] = (1,)
    layers: Annotated[tuple[int, ...], Items(2)] = (1,)
    table: Mapping[str, float] = field(default_factory=dict)
    other: object = None
    """Not checked: it has no type of a setting."""


@pytest.mark.parametrize(
    "fits",
    [
        {"number": 1},
        {"perhaps": None},
        {"perhaps": 0},
        {"several": ()},
        {"several": (1, 2)},
        {"table": {"a": 1}},
        {"other": []},
    ],
    ids=str,
)
def test_what_fits_its_annotation_passes(fits):
    check(Sample(**fits))


@pytest.mark.parametrize(
    ("name", "value", "wanted"),
    [
        ("whole", 1.0, "a whole number"),
        ("whole", True, "a whole number"),
        ("number", "1", "a number"),
        ("number", False, "a number"),
        ("flag", 1, "true or false"),
        ("text", None, "a string"),
        ("count", 0, "at least 1"),
        ("count", "many", "a whole number"),
        ("perhaps", -0.5, "at least 0"),
        ("perhaps", float("nan"), "a finite number"),
        ("number", math.inf, "a finite number"),
        ("count", 10**400, "at most 9,223,372,036,854,775,807"),
        ("layers", (), "at least one number and at most 2"),
        ("layers", (1, 2, 3), "at least one number and at most 2"),
        ("choice", "adm", "adam or sgd; did you mean adam?"),
        ("choice", 3, "adam or sgd"),
        ("several", [1], "a list, each item a whole number"),
        ("several", (0,), "a list, each item at least 1"),
        ("table", None, "a table of names and values"),
    ],
    ids=lambda value: str(value)[:20],
)
def test_what_does_not_fit_names_the_setting_the_value_and_what_is_allowed(name, value, wanted):
    with pytest.raises(SettingError) as caught:
        check(Sample(**{name: value}), "part")
    error = caught.value
    assert (error.what, error.value, error.allowed) == (f"part.{name}", pytest.approx(value, nan_ok=True), wanted)


def test_numbers_of_numpy_become_pythons():
    sample = Sample(count=np.int64(3), number=np.float32(0.5), flag=np.bool_(True))
    check(sample)
    found = (sample.count, sample.number, sample.flag)
    assert (found, [*map(type, found)]) == ((3, 0.5, True), [int, float, bool])
    check(listed := Sample(several=(np.int64(1), 2)))
    assert [*map(type, listed.several)] == [int, int]
    check_value("episodes", np.int64(2), Annotated[int, AT_LEAST_ONE])
    with pytest.raises(SettingError, match="must be a whole number"):
        check(Sample(count=np.array([1, 2])))


@pytest.mark.parametrize("kind", [NetworkConfig, ModelConfig])
def test_networks_need_a_hidden_layer(kind):
    with pytest.raises(SettingError, match=r"hidden=\(\) must be at least one number"):
        kind(hidden=())
