import pytest

from transferkit.env_id import EnvId
from transferkit.envs import id_from_file, make_env
from transferkit.errors import ConfigError, EnvironmentContractError


@pytest.mark.parametrize(
    ("text", "kwargs", "variation"),
    [
        ("Ant-v5", {}, {}),
        ("Ant-v5?frame_skip=10&x=true&y=[0.2,1.0]", {"frame_skip": 10, "x": True, "y": [0.2, 1.0]}, {}),
        ("m:Ant-v0?xml_file=./a%20b%26c.xml", {"xml_file": "./a b&c.xml"}, {}),
        ("A-v0?word=\"5\"", {"word": "5"}, {}),
        ("A-v0?k=1&vary.mass=[0.7,1.3]&vary.length.thigh=0.8", {"k": 1}, {"mass": [0.7, 1.3], "length.thigh": 0.8}),
    ],
)  # fmt: skip
def test_it_comes_apart_and_together_again(text, kwargs, variation):
    read = EnvId.read(text)
    assert (read.kwargs, read.variation) == (kwargs, variation)
    assert str(read) == text


def test_a_question_mark_alone_asks_for_nothing():
    assert EnvId.read("A-v0?") == EnvId("A-v0")


def test_a_range_may_be_written_with_dots():
    assert EnvId.read("A-v0?vary.mass=0.7..1.3").variation == {"mass": [0.7, 1.3]}
    assert EnvId.read("A-v0?file=../a.xml").kwargs == {"file": "../a.xml"}
    assert str(EnvId.read("A-v0?k=1").with_arguments(["k=2", "j=x"], ["mass=2"])) == "A-v0?k=2&j=x&vary.mass=2"


@pytest.mark.parametrize("text", ["A-v0?k", "A-v0?=1", "A-v0?k=", "A-v0?k=1&k=2", "A-v0?&"])
def test_what_is_no_argument_is_one_line(text):
    with pytest.raises(ConfigError):
        EnvId.read(text)


@pytest.mark.parametrize(
    ("env", "message"),
    [
        ("evil:Ant-v5?frame_skip=2", "runs the module evil"),
        ("<Mine>", "was <Mine>, which no id makes again; name one"),
        ("Ant-v5?frame_skip=1000000000", "frame_skip of .*=1000000000 must be 1 to 1000"),
    ],
)
def test_an_environment_that_a_file_names_runs_nothing_and_does_not_hang(env, message):
    with pytest.raises(EnvironmentContractError, match=message):
        id_from_file(env, "a file")


@pytest.mark.parametrize(
    ("env", "message"),
    [
        ("Ant-v5?xml_file=/dev/zero", "must be a regular file"),
        ("Ant-v5?frameskip=2", "unexpected keyword argument 'frameskip'"),
        ("dm_control/cartpole-balance-v0?colour=2", "unexpected keyword argument 'colour'"),
    ],
)
def test_arguments_that_an_environment_does_not_take_are_one_line(env, message):
    with pytest.raises(EnvironmentContractError, match=message) as error:
        make_env(env)
    assert "\n" not in str(error.value)
