import subprocess
import sys

import pytest

from tests.cli.commands import refusal

CORE = "inverted-pendulum-v1"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        pytest.param(
            "trian", "unknown command 'trian'; did you mean train or pretrain? `transferkit --help` lists", id="command"
        ),
        pytest.param("zoo show inverted-pendulun-v1", "did you mean inverted-pendulum-v1", id="core to show"),
        pytest.param("zoo verify", "name one, or use --all", id="nothing to verify"),
        pytest.param("envs show Hoper-v5", "did you mean Hopper-v5", id="environment to show"),
        pytest.param(
            "train --env CartPole-v1 --steps 10", "Discrete(2) must be a flat and bounded Box; `transferkit envs", id="space"
        ),
        pytest.param("train --env Hopper-v5", "no budget given; give --episodes, --steps or --seconds", id="no budget"),
        pytest.param(
            "train --env Hopper-v5 --steps many", "--steps='many' must be a whole number; `--help`", id="not a number"
        ),
        pytest.param("train --env Hopper-v5 --stepz 9", "unknown flag '--stepz'; did you mean --steps", id="flag"),
        pytest.param(
            "train --env Hopper-v5 --ppo.gama 0.9", "unknown flag '--ppo.gama'; did you mean --ppo.gamma", id="setting"
        ),
        pytest.param("train --steps 9", "missing --env", id="no environment"),
        pytest.param("train --env Hopper-v5 --steps 0", "--steps=0 must be at least 1", id="no steps"),
        pytest.param("train --env Hopper-v5 --episodes -3", "--episodes=-3 must be at least 1", id="negative episodes"),
        pytest.param("train --env Hopper-v5 --steps 9 --preset papr", "did you mean paper or paper-v1", id="preset"),
        pytest.param("train --env Hopper-v5 --steps 9 --algo pop", "must be ppo or dyna-ddpg or dyna-ppo", id="trainer"),
        pytest.param(
            "train --env Hopper-v5 --steps 9 --ppo.gamma 2", "--ppo.gamma=2.0 must be at least 0 and at most 1", id="range"
        ),
        pytest.param("train --env Hopper-v5 --steps 9 --device cuda:77", "use --device cpu", id="device"),
        pytest.param("train --env Hopper-v5 --steps 9 --core nope", "; `transferkit zoo list` lists the cores", id="core"),
        pytest.param(f"train --env Hopper-v5 --steps 9 --core {CORE} --wrap.freeze cor 1", "did you mean core?", id="part"),
        pytest.param(f"train --env Hopper-v5 --steps 9 --core {CORE} --member 9", "--member=9 must be 0 to 4", id="member"),
        pytest.param("eval /nonexistent", "unknown run or core '/nonexistent'", id="run"),
    ],
)
def test_mistakes_get_one_line_and_write_nothing(capsys, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert message in refusal(capsys, *arguments.split())
    assert list(tmp_path.iterdir()) == []


def python(*code):
    return subprocess.run([sys.executable, *code], capture_output=True, text=True, check=True)


def test_warnings_are_plain_words_after_dm_control_has_set_up_its_log():
    show = "from transferkit.cli.main import main; main('envs show dm_control/cartpole-balance-v0 --json'.split())"
    assert python("-c", f"{show}; import logging; logging.getLogger('transferkit').warning('of note')").stderr == "of note\n"


def test_a_closed_pipe_is_no_error():
    process = subprocess.Popen([sys.executable, "-m", "transferkit", "zoo", "list"], stdout=-1, stderr=-1, text=True)
    process.stdout.close()
    process.stdout = None
    assert process.communicate()[1] == ""


def test_import_and_listing_load_nothing_heavy():
    heavy = "{'torch', 'rsl_rl', 'mujoco', 'dm_control', 'gymnasium'} & set(sys.modules)"
    assert python("-c", f"import sys, transferkit; print({heavy})").stdout.strip() == "set()"
    listing = f"import sys; from transferkit.cli.main import main; main(['zoo', 'list']); print({heavy})"
    assert python("-c", listing).stdout.strip().endswith("set()")
