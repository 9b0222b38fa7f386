"""An imported core acts as the library that wrote its file, on 1,000 observations, and its critics value alike."""

import functools
import importlib.util
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import torch
from torch import nn

from tests.interop import writers
from transferkit import Subject, export_onnx
from transferkit.envs import derive_spec, make_env
from transferkit.errors import ConfigError
from transferkit.interop import Given, read_core
from transferkit.interop.onnx_graph import read_graph
from transferkit.nn import Architecture
from transferkit.policy.base import ScratchPolicy
from transferkit.reading import FormatError
from transferkit.streams import Streams

ENV = "InvertedPendulum-v5"  # bounds of -3 to 3


@functools.cache
def low_high(env):
    made = gymnasium.make(env)
    return made.action_space.low, made.action_space.high


def core_of(path, env=ENV, **given):
    return read_core(Path(path), derive_spec(env), Given(**given), "x")[0]


def difference(core, expected, env=ENV, spread=2.0):
    observation = writers.observations(core.spec.obs_dim, spread)
    own = make_env(env).scaled(core.policy().act(observation))
    return np.abs(own - np.clip(expected(observation), *low_high(env))).max()


def critic_difference(core, expected, scale=1.0):
    observation = torch.from_numpy(writers.observations(core.spec.obs_dim))
    action = torch.from_numpy(np.random.default_rng(1).uniform(-1, 1, (1000, core.spec.act_dim)).astype(np.float32))
    with torch.no_grad():
        theirs = torch.stack([q.squeeze(-1) for q in expected(observation, action * scale)])
        return float((core.critic()(observation, action) - theirs).abs().max())


@pytest.mark.parametrize("algo", ["PPO", "A2C", "SAC", "TD3", "DDPG"])
@pytest.mark.parametrize("clip", [None, 10.0, 3.0])
def test_stable_baselines3(tmp_path, algo, clip):
    venv = None if clip is None else writers.normalized(ENV, clip_obs=clip, epsilon=1e-5 if clip == 3 else 1e-8)
    model = writers.sb3_model(algo, ENV, venv)
    model.save(tmp_path / "m.zip")
    if venv is not None:
        venv.save(tmp_path / "stats.pkl")
    normalize = (lambda o: o) if venv is None else venv.normalize_obs
    core = core_of(tmp_path / "m.zip", stats="none" if venv is None else tmp_path / "stats.pkl")
    assert difference(core, lambda o: model.predict(normalize(o), deterministic=True)[0]) <= 1e-5
    if algo in ("PPO", "A2C"):
        theirs = model.policy.log_std.detach() - np.log(3.0)
        assert torch.allclose(core.components["policy"]["log_std"][0], theirs)
    else:
        values = lambda o, a: model.critic(torch.from_numpy(normalize(o.numpy()).astype(np.float32)), a)  # noqa: E731
        assert critic_difference(core, values) <= 1e-5


def test_stable_baselines3_says_its_activation_and_layers(tmp_path):
    model = writers.sb3_model("PPO", "Hopper-v5", policy_kwargs={"activation_fn": nn.ELU, "net_arch": [8, 24]})
    model.save(tmp_path / "m.zip")
    core = core_of(tmp_path / "m.zip", "Hopper-v5", stats="none")
    assert (core.architecture.activation, tuple(core.architecture.hidden)) == ("elu", (8, 24))
    assert difference(core, lambda o: model.predict(o, deterministic=True)[0], "Hopper-v5") <= 1e-5


def test_other_bounds_than_the_environment_has_are_asked_about(tmp_path):
    rescaled = gymnasium.wrappers.RescaleAction(gymnasium.make(ENV), np.float32(-1), np.float32(1))
    model = writers.sb3_model("PPO", rescaled)
    model.save(tmp_path / "m.zip")
    with pytest.raises(ConfigError, match=r"the file's actions go from -1 to 1, those of InvertedPendulum-v5 from \[-3.0\]"):
        core_of(tmp_path / "m.zip", stats="none")
    core = core_of(tmp_path / "m.zip", stats="none", action_scale="bounds")
    assert difference(core, lambda o: 3 * model.predict(o, deterministic=True)[0]) <= 1e-5


@pytest.mark.parametrize("layout", [2, 3, 4, 5])
def test_rsl_rl(tmp_path, layout):
    actor, act = writers.rsl_rl_actor(4, 1)
    state = actor.state_dict()
    std, rest = state["distribution.std_param"], {name: value for name, value in state.items() if "distribution" not in name}
    mlp = {name.replace("mlp.", "actor."): value for name, value in rest.items() if name.startswith("mlp.")}
    norm = {name.removeprefix("obs_normalizer."): value for name, value in rest.items() if name.startswith("obs_")}
    saved = {
        2: {"model_state_dict": {**mlp, "std": std}, "obs_norm_state_dict": norm},
        3: {"model_state_dict": {**mlp, "std": std, **{f"actor_obs_normalizer.{n}": v for n, v in norm.items()}}},
        4: {"actor_state_dict": {**rest, "std": std}},
        5: {"actor_state_dict": state},
    }[layout]
    optimizer = torch.optim.Adam(actor.parameters()).state_dict()
    torch.save({**saved, "optimizer_state_dict": optimizer, "iter": 3, "infos": None}, tmp_path / "model_3.pt")
    core = core_of(tmp_path / "model_3.pt", activation="elu", action_scale=0.5)
    assert difference(core, lambda o: 0.5 * act(o)) <= 1e-5
    assert "normalizer" in core.components
    assert torch.allclose(core.components["policy"]["log_std"][0].exp(), torch.tensor(0.5 * 0.5 / 3))


def test_cleanrl_ppo(tmp_path):
    agent = writers.CleanRLPPO(4, 1)
    torch.save(agent.state_dict(), tmp_path / "ppo.cleanrl_model")
    mean, var = np.array([0.1, -0.2, 0, 1]), np.array([1, 0.5, 2, 4.0])
    np.savez(tmp_path / "stats.npz", mean=mean, var=var)

    def act(observation):
        normal = np.clip((observation - mean) / np.sqrt(var + 1e-8), -10, 10).astype(np.float32)
        return agent.actor_mean(torch.from_numpy(normal)).detach().numpy()

    assert difference(core_of(tmp_path / "ppo.cleanrl_model", stats=tmp_path / "stats.npz"), act, spread=20.0) <= 1e-5


@pytest.mark.parametrize("gaussian", [True, False], ids=["SAC", "TD3"])
def test_cleanrl_with_critics(tmp_path, gaussian):
    env = gymnasium.make(ENV)
    actor, critics = writers.CleanRLActor(env, gaussian=gaussian), [writers.CleanRLCritic(env) for _ in range(2)]
    torch.save((actor.state_dict(), *(critic.state_dict() for critic in critics)), tmp_path / "m.cleanrl_model")
    core = core_of(tmp_path / "m.cleanrl_model")
    assert difference(core, lambda o: actor(torch.from_numpy(o)).detach().numpy()) <= 1e-5
    assert critic_difference(core, lambda o, a: [critic(o, a) for critic in critics], 3.0) <= 1e-5


@pytest.mark.parametrize("activation", [nn.ReLU(), nn.ELU(), nn.SiLU(), nn.Tanh()], ids=lambda a: type(a).__name__)
@pytest.mark.parametrize("end", [None, nn.Tanh()], ids=["plain", "tanh"])
def test_onnx(tmp_path, activation, end):
    pytest.importorskip("onnx")
    module = writers.Front(4, 1, activation, end)
    writers.write_onnx(module, 4, tmp_path / "m.onnx")
    core = core_of(tmp_path / "m.onnx", action_scale="bounds")
    assert core.architecture.squash == (end is not None)
    assert difference(core, lambda o: 3 * module(torch.from_numpy(o)).detach().numpy()) <= 1e-5


class Deterministic(nn.Module):
    """A policy of Stable-Baselines3 as its documentation exports it."""

    def __init__(self, policy):
        super().__init__()
        self.policy = policy

    def forward(self, observation):
        return self.policy(observation, deterministic=True)


def test_a_graph_that_runs_in_a_circle_is_refused():
    onnx = pytest.importorskip("onnx")
    value = lambda name: onnx.helper.make_tensor_value_info(name, 1, [1, 4])  # noqa: E731
    nodes = [onnx.helper.make_node("Identity", [a], [b]) for a, b in (("a", "b"), ("b", "a"))]
    model = onnx.helper.make_model(onnx.helper.make_graph(nodes, "circle", [value("x")], [value("a")]))
    with pytest.raises(FormatError, match="not a chain of at most 1000 operations"):
        read_graph(model.SerializeToString())


def test_onnx_of_rsl_rl(tmp_path):
    pytest.importorskip("onnx")
    actor, act = writers.rsl_rl_actor(4, 1)
    writers.write_onnx(actor.as_onnx(verbose=False), 4, tmp_path / "m.onnx")
    core = core_of(tmp_path / "m.onnx", action_scale=1.0)
    assert difference(core, act) <= 1e-5
    assert "normalizer" in core.components


@pytest.mark.parametrize("algo", ["PPO", "SAC"])
def test_onnx_of_stable_baselines3(tmp_path, algo):
    pytest.importorskip("onnx")
    model = writers.sb3_model(algo, ENV)
    module = Deterministic(model.policy if algo == "PPO" else model.policy.actor)
    writers.write_onnx(module, 4, tmp_path / "m.onnx")
    core = core_of(tmp_path / "m.onnx", action_scale=1.0 if algo == "PPO" else "bounds")
    assert difference(core, lambda o: model.predict(o, deterministic=True)[0]) <= 1e-5


@pytest.mark.parametrize("squash", [False, True])
def test_onnx_of_our_own_export(tmp_path, squash):
    pytest.importorskip("onnxscript")
    architecture = Architecture(4, 1, (16, 16), "gelu", squash=squash)
    policy = ScratchPolicy.create(architecture, Streams(0).torch("x"), init_std=0.5, normalize=True)
    policy.update_normalizer(torch.from_numpy(writers.observations(4)))
    export_onnx(Subject(policy, ENV), tmp_path / "m.onnx")
    observation = writers.observations(4)
    core = core_of(tmp_path / "m.onnx")  # it says what its outputs are
    assert np.abs(core.policy().act(observation) - policy.act(observation)).max() <= 1e-5


@pytest.mark.parametrize("kind", ["PPO", "SAC", "TD3"])
def test_a_zip_of_sbx_without_sbx(tmp_path, kind):
    """A pickle of the same classes, which is read as data."""
    actor = writers.dense(4, 16, 8, 1)
    if kind == "SAC":
        actor["Dense_3"] = writers.dense(8, 1, seed=1)["Dense_0"]
    elif kind == "PPO":
        actor["log_std"] = np.full(1, -0.5)
    path = writers.sbx_zip(tmp_path / "m.zip", {"actor": actor})
    core = core_of(path, stats="none", **({"action_scale": 1.0} if kind == "PPO" else {}))
    act = torch.tanh if kind == "PPO" else torch.relu

    def original(observation):
        x = torch.from_numpy(observation).double()
        for k in range(3):
            x = x @ torch.from_numpy(actor[f"Dense_{k}"]["kernel"]) + torch.from_numpy(actor[f"Dense_{k}"]["bias"])
            x = act(x) if k < 2 else x
        return (x if kind == "PPO" else 3 * torch.tanh(x)).numpy()

    assert difference(core, original) <= 1e-5
    custom = writers.sbx_zip(
        tmp_path / "n.zip", {"actor": actor}, policy_kwargs={"activation_fn": "<PjitFunction of <function silu at 0x7f>>"}
    )
    assert core_of(custom, stats="none", **({"action_scale": 1.0} if kind == "PPO" else {})).architecture.activation == "silu"


@pytest.mark.skipif(importlib.util.find_spec("sbx") is None, reason="sbx is in the bench extra")
@pytest.mark.parametrize("algo", ["PPO", "SAC", "TD3", "DDPG"])
def test_sbx(tmp_path, algo):
    import flax
    import sbx

    few = (
        {"n_steps": 32, "batch_size": 32} if algo == "PPO" else {"learning_starts": 10, "policy_kwargs": {"net_arch": [16, 16]}}
    )
    model = getattr(sbx, algo)("MlpPolicy", ENV, seed=0, **few).learn(40)
    state = {"actor": model.policy.actor_state.params}
    if algo != "PPO":
        state["qf"] = model.policy.qf_state.params
    (tmp_path / "m.msgpack").write_bytes(flax.serialization.to_bytes(state))
    activation = "tanh" if algo == "PPO" else "relu"
    model.save(tmp_path / "m.zip")
    for core in (
        core_of(tmp_path / "m.msgpack", stats="none", activation=activation),
        core_of(tmp_path / "m.zip", stats="none"),
    ):
        assert difference(core, lambda o: model.predict(o, deterministic=True)[0]) <= 1e-5
    if algo != "PPO":
        qf = model.policy.qf_state
        values = lambda o, a: torch.from_numpy(np.array(qf.apply_fn(qf.params, o.numpy(), a.numpy())))  # noqa: E731
        assert critic_difference(core, values) <= 1e-5
