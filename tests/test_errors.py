import pickle

import pytest

from transferkit import errors
from transferkit.cli.wording import worded
from transferkit.errors import ConfigError, SettingError, TransferkitError, UnknownNameError, did_you_mean

LETTERS = tuple("abcdefghijklm")


@pytest.mark.parametrize(
    ("error", "in_python", "as_flags"),
    [
        pytest.param(TransferkitError("it broke"), "it broke", "it broke", id="a sentence"),
        pytest.param(
            ConfigError("ending of x.doc", value=".doc", allowed=".png"),
            "ending of x.doc='.doc' must be .png",
            "ending of x.doc='.doc' must be .png",
            id="a value",
        ),
        pytest.param(
            ConfigError("runs/a is in use", remedy="continue it with {resume=True}, or choose another {out}"),
            "runs/a is in use; continue it with resume=True, or choose another out",
            "runs/a is in use; continue it with --resume, or choose another --out",
            id="options in the remedy",
        ),
        pytest.param(
            SettingError("dyna.batch_size", value=0, allowed="at least 1", remedy="or set {dyna.mix_batches=False}"),
            "dyna.batch_size=0 must be at least 1; or set dyna.mix_batches=False",
            "--dyna.batch-size=0 must be at least 1; or set --dyna.no-mix-batches",
            id="a setting",
        ),
        pytest.param(
            ConfigError("no recordings", remedy="use {algo=dyna-ddpg}", topic="cores"),
            "no recordings; use algo=dyna-ddpg",
            "no recordings; use --algo dyna-ddpg; `transferkit zoo list` lists the cores",
            id="a topic",
        ),
        pytest.param(
            UnknownNameError("core", "pendulun-v1", ("pendulum-v1", "walker-v1"), topic="cores"),
            "unknown core 'pendulun-v1'; did you mean pendulum-v1?",
            "unknown core 'pendulun-v1'; did you mean pendulum-v1? `transferkit zoo list` lists the cores",
            id="a near name",
        ),
        pytest.param(
            UnknownNameError("part", "zzz", ("core", "log_std")),
            "unknown part 'zzz'; known are core, log_std",
            "unknown part 'zzz'; known are core, log_std",
            id="few names",
        ),
        pytest.param(
            UnknownNameError("letter", "zzz", LETTERS), "unknown letter 'zzz'", "unknown letter 'zzz'", id="many names"
        ),
    ],
)
def test_python_and_the_command_line_word_the_same_fields(error, in_python, as_flags):
    assert str(error) == in_python
    assert worded(error) == as_flags


def test_an_error_of_the_system_is_shown_as_it_is():
    assert worded(OSError("no space")) == "no space"


@pytest.mark.parametrize(
    "error",
    [
        SettingError("ppo.gamma", value=2.0, allowed="at least 0 and at most 1", remedy="lower it"),
        UnknownNameError("core", "x", ("y", "z"), topic="cores"),
        TransferkitError("plain"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_an_error_crosses_processes_with_all_its_fields(error):
    there = pickle.loads(pickle.dumps(error))
    assert type(there) is type(error)
    assert vars(there) == vars(error)
    assert str(there) == str(error)
    assert repr(there.value) == repr(error.value)


def test_every_error_is_one_of_ours():
    kinds = [kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, Exception)]
    assert len(kinds) > 12
    assert all(issubclass(kind, TransferkitError) for kind in kinds)


def test_at_most_three_near_names_are_asked_for():
    assert did_you_mean("hopper", ["hopper1", "hopper2", "hopper3", "hopper4"]).count("hopper") == 3
    assert did_you_mean("hopper", ["walker"]) == ""
