"""Compiled updates give what the same functions give without compiling."""

import subprocess
import sys
from dataclasses import replace

import pytest
import torch

from tests.runs import interrupt_at
from tests.trainers.dyna.test_agent import TINY, drawn, make_agent
from transferkit import wrap
from transferkit.config import TrainConfig, with_settings
from transferkit.errors import ConfigError, InterruptedRunError
from transferkit.nn import Architecture
from transferkit.policy.base import ScratchPolicy
from transferkit.run import load_state, read_record
from transferkit.streams import Streams
from transferkit.trainers.compilation import is_compiled
from transferkit.training import run_training

SETTINGS = {"network.hidden": [16, 16], "dyna.batch_size": 32, "dyna.updates_per_step": 2}
RUN = with_settings(TrainConfig("InvertedDoublePendulum-v5", algo="dyna-ddpg", steps=120, eval_episodes=1), SETTINGS)


def learnt(policy, spec, *, compiles, thaw):
    """Everything that three steps of learning change; with `thaw` the core begins to learn before the last one."""
    config = replace(TINY, updates_per_step=4, critics=3, drawn_critics=2, unit_norm=True, normalize_reward=True)
    agent = make_agent(policy, spec, config, compiles=compiles)
    generator = Streams(0).torch("transitions")
    for _ in range(20):
        agent.buffer.add(drawn(generator))
    for k in range(3):
        agent.set_progress(0.4 if thaw and k == 2 else 0.0, 0.0)
        agent.learn()
    return {f"{name}.{key}": value for name, tensors in agent.state()["modules"].items() for key, value in tensors.items()}


@pytest.mark.parametrize("with_core", [False, True])
def test_compiled_and_eager_updates_differ_by_rounding_alone(pendulum_spec, untrained_core, with_core):
    def policy():
        if with_core:
            return wrap(untrained_core, "InvertedPendulum-v5", freeze={"core": 0.3})
        return ScratchPolicy.create(
            Architecture(4, 1, (16, 16), "relu"), Streams(0).torch("policy"), init_std=1.0, normalize=True
        )

    eager, compiled = (learnt(policy(), pendulum_spec, compiles=compiles, thaw=with_core) for compiles in (False, True))
    for name, value in eager.items():
        torch.testing.assert_close(compiled[name], value, rtol=1e-3, atol=1e-5, msg=lambda text, name=name: f"{name}: {text}")


def test_a_compiled_run_goes_on_to_the_same_bits_and_its_record_says_so(tmp_path, monkeypatch):
    config = replace(RUN, compile="on", checkpoint_seconds=0.0)
    run_training(config, out=tmp_path / "whole")
    with pytest.raises(InterruptedRunError):
        run_training(config, out=tmp_path / "cut", report=interrupt_at(100))
    run_training(replace(config, compile="auto"), out=tmp_path / "cut", resume=True)
    whole, cut = (load_state(tmp_path / name / "policy.safetensors")["weights"] for name in ("whole", "cut"))
    assert all(torch.equal(whole[key], cut[key]) for key in whole)
    assert read_record(tmp_path / "cut")["compiled"] is True
    monkeypatch.setenv("CXX", "no-such-compiler")  # which a finished run does not need
    assert run_training(config, out=tmp_path / "cut", resume=True).steps == 120
    with pytest.raises(ConfigError, match="differs from the run's record: its updates are compiled"):
        run_training(replace(config, compile="off", steps=200), out=tmp_path / "cut", resume=True)


def test_without_a_compiler_a_long_run_says_once_that_it_is_eager_and_on_is_refused(tmp_path, caplog, monkeypatch):
    monkeypatch.setenv("CXX", "no-such-compiler")
    monkeypatch.setattr("transferkit.trainers.compilation.LEAST_UPDATES", 100)
    run_training(RUN, out=tmp_path / "run")
    assert "compiled" not in read_record(tmp_path / "run")
    assert [record.message for record in caplog.records if "compiled" in record.message] == [
        "updates are not compiled, which would be faster: there is no C++ compiler; "
        "install g++, or name another compiler in CXX"
    ]
    with pytest.raises(ConfigError, match=r"the updates cannot be compiled: there is no C\+\+ compiler"):
        run_training(replace(RUN, compile="on"), out=tmp_path / "other")
    assert not (tmp_path / "other").exists()


def test_a_compiler_that_fails_is_named_in_one_line(monkeypatch, tmp_path):
    broken = tmp_path / "g++"
    broken.write_text("#!/bin/sh\necho no such luck >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setenv("CXX", str(broken))
    monkeypatch.setenv("TORCHINDUCTOR_CACHE_DIR", str(tmp_path / "cache"))
    script = "from transferkit.nn.compiled import cannot_compile; print(cannot_compile())"
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert len(found.stdout.splitlines()) == 1
    assert found.stdout.strip() != "None"


@pytest.mark.parametrize(
    ("algo", "budget", "pays"),
    [
        ("dyna-ddpg", {"steps": 20_000}, True),
        ("dyna-ddpg", {"steps": 8_000}, False),  # ten updates after each action, which lasts four steps
        ("dyna-ddpg", {"steps": 8_000, "core": "hopper-v1"}, False),  # three after each step
        ("dyna-ddpg", {"steps": 8_000, "core": "hopper-v1", "preset": "default-v2"}, True),  # ten
        ("dyna-ddpg", {"steps": 9, "device": "cuda"}, True),  # captured, which costs nothing
        ("ppo", {"steps": 1_000_000, "device": "cuda"}, False),
        ("dyna-ddpg", {"seconds": 60}, False),
        ("ppo", {"steps": 1_000_000}, True),
        ("ppo", {"episodes": 200}, False),  # two poles fall after ten steps, and the quickstart must not wait
    ],
)
def test_a_budget_pays_for_compiling_or_does_not(algo, budget, pays, monkeypatch):
    monkeypatch.setattr("transferkit.trainers.compilation.cannot_compile", lambda: None)
    assert is_compiled(TrainConfig("Hopper-v5", algo=algo, **budget), lambda: 1000, lambda: 0.008) == pays
