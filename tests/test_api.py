"""The front door is what the API page says."""

import re
from pathlib import Path

import pytest

import transferkit

PAGE = Path(__file__).parents[1] / "docs/api.md"
DOCUMENTED = re.findall(r"(?m)^\.\. auto\w+:: ([\w.]+)", PAGE.read_text())


@pytest.mark.parametrize("name", DOCUMENTED)
def test_everything_that_is_documented_is_importable_from_transferkit_itself(name):
    package, _, attribute = name.rpartition(".")
    assert package == "transferkit"
    assert getattr(transferkit, attribute).__name__ == attribute


def test_everything_public_is_documented():
    assert sorted(DOCUMENTED) == [f"transferkit.{name}" for name in dir(transferkit)]


def test_no_other_name_is_there():
    with pytest.raises(AttributeError, match="module 'transferkit' has no attribute 'rap'"):
        transferkit.rap  # noqa: B018
