import errno
import os
import resource

import pytest

from transferkit.errors import ConfigError, RunDirectoryError
from transferkit.files import check_folder, check_new, new_file, read_json, user_folder, write_atomically, write_json, writing
from transferkit.zoo.remote.roots import pulled_folders


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


def test_a_file_is_whole_or_not_there(tmp_path):
    out = tmp_path / "x.onnx"

    def write(data, error):
        with new_file(out, "out") as temporary:
            temporary.write_bytes(data)
            if error is not None:
                raise error

    with pytest.raises(ConfigError, match=r"cannot write .*x\.onnx: No space left on device; choose another out"):
        write(b"half", OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))
    with pytest.raises(KeyboardInterrupt):
        write(b"half", KeyboardInterrupt())
    assert not list(tmp_path.iterdir())
    write(b"whole", None)
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"whole"]


def test_a_new_file_has_its_ending_and_a_folder_no_file_in_its_way(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match=r"ending of .*x\.txt='.txt' must be \.mp4; choose another video"):
        check_new(tmp_path / "x.txt", "video", ".mp4")
    with pytest.raises(ConfigError, match=r"file is not a folder; choose another out"):
        check_folder(tmp_path / "file/deep/er", "out")
    check_folder(tmp_path / "deep/er", "out")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_what_no_folder_can_be_is_refused_before_any_work(tmp_path):
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(ConfigError, match="loop is not a folder; choose another out"):
        check_folder(tmp_path / "loop", "out")
    with pytest.raises(RunDirectoryError, match=r"File name too long; .*; choose another name"), writing(tmp_path):
        (tmp_path / ("x" * 300)).mkdir()


def test_a_user_without_a_home_is_told_what_to_set(monkeypatch):
    def homeless():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr("pathlib.Path.home", homeless)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    with pytest.raises(ConfigError, match="no home folder; set XDG_CACHE_HOME or HOME"):
        user_folder("XDG_CACHE_HOME", ".cache")
    assert pulled_folders() == []
