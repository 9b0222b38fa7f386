import sys

import pytest

from transferkit.errors import ConfigError
from transferkit.extras import import_extra


def test_what_cannot_be_imported_is_said_with_what_installs_it(monkeypatch):
    assert import_extra("json", "onnx", "a test") is sys.modules["json"]
    monkeypatch.setitem(sys.modules, "minari", None)
    message = r"a dataset needs minari, which cannot be imported \(.*\); pip install 'transferkit\[minari\]'"
    with pytest.raises(ConfigError, match=message):
        import_extra("minari", "minari", "a dataset")
