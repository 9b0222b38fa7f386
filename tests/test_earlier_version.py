"""A run that version 0.1 began goes on under this one: its record and its checkpoint are written here as it wrote them."""

import json
from dataclasses import asdict

import pytest

from tests.config.records import old_record
from tests.runs import assert_same_run, interrupt_at
from transferkit import load_policy, run_training
from transferkit.config import TrainConfig, with_settings
from transferkit.errors import InterruptedRunError, RunDirectoryError
from transferkit.files import write_json
from transferkit.run import load_state, save_state
from transferkit.subject import evaluate_subject, load_subject

IDP = "InvertedDoublePendulum-v5"
CASES = {
    "ppo": {"ppo.epochs": 2, "ppo.gamma": 0.98, "network.hidden": [32], "env_config.clip_actions": False},
    "dyna-ddpg": {"network.hidden": [16, 16], "dyna.updates_per_step": 1, "dyna.batch_size": 32, "model.members": 2},
    "dyna-ppo": {"network.hidden": [16], "model.updates": 20, "model.hidden": [16], "dyna_ppo.updates": 1},
}
NAMES = {"ppo": "algorithm", "dyna-ddpg": "agent", "dyna-ppo": "learner"}
"""Of a trainer's state in a checkpoint, beside that of the environments."""

BESIDE = ("policy", "core_digest")
"""What a record held besides the configuration."""


def old_configuration(new):
    """A configuration of today in the form of version 0.1."""
    preset, network, model, wrap = new["preset"].rpartition("-v")[0], new["network"], new["model"], new["wrap"]
    own = {"dyna": network} if new["algo"] == "dyna-ddpg" else {"ppo": network}
    moved = {
        "ppo": own.get("ppo", {}) | new["ppo"] | new["env_config"],
        "dyna": own.get("dyna", {})
        | {f"model_{name}": value for name, value in model.items()}
        | {f"ppo_{name}": value for name, value in new["dyna_ppo"].items()}
        | {name: model[name] for name in ("predict", "normalize_targets")}
        | {f"wrap_{name}": wrap[name] for name in ("critic", "dynamics")}
        | new["dyna"],
        "wrap": wrap,
    }
    record = old_record(preset)
    sections = {name: {key: moved[name].get(key, old) for key, old in record[name].items()} for name in moved}
    return {name: new[name] for name in (*record, *BESIDE)} | sections | {"preset": preset}


def into_old_layout(run):
    """Rewrite the record of a run, and its checkpoint if it was stopped, as version 0.1 wrote them."""
    record = json.loads((run / "run.json").read_text())
    old = old_configuration(record["config"])
    architecture = old["policy"].get("architecture", {})
    if architecture.get("initialization") == "paper":
        architecture["initialization"] = "orthogonal"  # that the log-std had a head said the rest
    write_json(run / "run.json", {**record, "config": old})
    if (run / "checkpoint.safetensors").exists():
        state = load_state(run / "checkpoint.safetensors")
        state["trainer"] = {NAMES[old["algo"]]: state["trainer"], "envs": state.pop("envs")}
        save_state(run / "checkpoint.safetensors", state)
    return old


@pytest.mark.parametrize("algo", CASES)
def test_a_run_of_the_default_in_the_old_form_is_the_record_that_was_written(algo):
    record = old_record("default", algo=algo) | dict.fromkeys(BESIDE)
    budget = {name: record[name] for name in ("steps", "eval_episodes", "eval_every", "checkpoint_seconds")}
    preset = "default-v2" if algo == "ppo" else "default-v1"
    today = asdict(TrainConfig(record["env"], algo=algo, preset=preset, **budget)) | dict.fromkeys(BESIDE)
    old = old_configuration(json.loads(json.dumps(today)))
    if algo == "dyna-ppo":  # it replaced PPO's schedule by KL divergence without a word
        old["ppo"] |= {name: record["ppo"][name] for name in ("rollout", "schedule", "critic_learning_rate")}
    assert old == record


@pytest.mark.parametrize("algo", CASES)
def test_its_interrupted_run_goes_on_to_the_bit(tmp_path, algo):
    preset = "default-v2" if algo == "ppo" else "default-v1"
    config = TrainConfig(IDP, algo=algo, preset=preset, steps=600, eval_episodes=2, eval_every=250, checkpoint_seconds=0.0)
    config = with_settings(config, CASES[algo])
    run_training(config, out=tmp_path / "whole")
    with pytest.raises(InterruptedRunError):
        run_training(config, out=tmp_path / "cut", report=interrupt_at(300))
    old = into_old_layout(tmp_path / "cut")
    with pytest.raises(RunDirectoryError, match="seed is 0 there and 1 here"):
        run_training(TrainConfig.from_json({**old, "seed": 1}), out=tmp_path / "cut", resume=True)
    run_training(config, out=tmp_path / "cut", resume=True)
    assert_same_run(tmp_path / "whole", tmp_path / "cut")


def test_its_paper_run_around_a_core_goes_on_to_the_bit(tmp_path):
    config = TrainConfig(IDP, core="inverted-pendulum-v1", preset="paper", episodes=12, eval_episodes=1, checkpoint_seconds=0.0)
    run_training(config, out=tmp_path / "whole")
    with pytest.raises(InterruptedRunError):
        run_training(config, out=tmp_path / "cut", report=interrupt_at(30))
    into_old_layout(tmp_path / "cut")
    run_training(config, out=tmp_path / "cut", resume=True)
    assert_same_run(tmp_path / "whole", tmp_path / "cut")


def test_its_finished_run_is_what_it_was(tmp_path):
    config = TrainConfig(IDP, preset="paper", episodes=3, eval_episodes=1)
    result = run_training(config, out=tmp_path / "run")
    old = into_old_layout(tmp_path / "run")
    assert old["policy"]["architecture"]["initialization"] == "orthogonal"
    assert run_training(config, out=tmp_path / "run", resume=True) == result
    assert evaluate_subject(load_subject(str(tmp_path / "run")), episodes=1).mean == result.eval_return_mean
    assert load_policy(tmp_path / "run").network.architecture.std == "head"
