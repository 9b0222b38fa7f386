import resource

import pytest

from transferkit.errors import RunDirectoryError
from transferkit.files import read_json, write_atomically, write_json


def test_json_makes_the_round_trip_and_leaves_no_other_file(tmp_path):
    data = {"a": [1, 2.5, None], "ä": True}
    write_json(tmp_path / "x.json", data)
    assert read_json(tmp_path / "x.json", dict) == data
    assert [path.name for path in tmp_path.iterdir()] == ["x.json"]


def test_nan_is_not_written_and_what_was_there_stays(tmp_path):
    write_json(tmp_path / "x.json", {"a": 1})
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(tmp_path / "x.json", {"a": float("nan")})
    assert read_json(tmp_path / "x.json", dict) == {"a": 1}


def test_a_missing_file_and_a_damaged_one_are_told_apart(tmp_path):
    with pytest.raises(RunDirectoryError, match=r"holds no run\.json; name the directory of a training run"):
        read_json(tmp_path / "run.json", dict)
    (tmp_path / "run.json").write_text('{"config": {"env"')
    with pytest.raises(RunDirectoryError, match=r"run\.json is damaged .*; train again into another out"):
        read_json(tmp_path / "run.json", dict)


def test_a_full_disk_leaves_the_old_file(tmp_path):
    path = tmp_path / "file"
    write_atomically(path, b"old")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, hard))
    try:
        with pytest.raises(RunDirectoryError, match=r"cannot write .*file: File too large; .*intact; .*with resume=True"):
            write_atomically(path, bytes(1000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert [p.name for p in tmp_path.iterdir()] == ["file"]
    assert path.read_bytes() == b"old"
