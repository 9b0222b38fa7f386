"""Files as other libraries write them, each with what its policy does."""

import base64
import itertools
import json
import pickle
import sys
import types
import zipfile
from unittest import mock

import gymnasium
import numpy as np
import torch
from torch import nn


def sb3_model(algo, env, venv=None, **kwargs):
    """A model of Stable-Baselines3 after a few steps."""
    import stable_baselines3 as sb3

    on_policy = {"PPO": {"n_steps": 32, "batch_size": 32}, "A2C": {}}
    more = on_policy.get(algo, {"learning_starts": 10, "policy_kwargs": {"net_arch": [16, 16]}})
    model = getattr(sb3, algo)("MlpPolicy", venv or env, device="cpu", seed=0, **{**more, **kwargs})
    return model.learn(40)


def normalized(env, **kwargs):
    """An environment in Stable-Baselines3's VecNormalize."""
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    return VecNormalize(DummyVecEnv([lambda: gymnasium.make(env)]), **kwargs)


def rsl_rl_actor(obs_dim, act_dim, activation="elu"):
    """An actor of rsl_rl 5 with statistics, and its output."""
    from rsl_rl.models import MLPModel
    from tensordict import TensorDict

    example = TensorDict({"policy": torch.zeros(1, obs_dim)}, [1])
    gaussian = {"class_name": "GaussianDistribution", "init_std": 0.5}
    torch.manual_seed(0)
    actor = MLPModel(example, {"actor": ["policy"]}, "actor", act_dim, [32, 16], activation, True, gaussian)
    actor.obs_normalizer.update(torch.randn(500, obs_dim) * 3 + 1)
    actor.eval()
    return actor, lambda obs: actor(TensorDict({"policy": torch.from_numpy(obs)}, [len(obs)])).detach().numpy()


class CleanRLPPO(nn.Module):
    """The agent of CleanRL's ppo_continuous_action.py."""

    def __init__(self, obs_dim, act_dim):
        super().__init__()
        sizes = (obs_dim, 64), (64, 64)
        bodies = [[layer for a, b in sizes for layer in (nn.Linear(a, b), nn.Tanh())] for _ in range(2)]
        self.critic = nn.Sequential(*bodies[0], nn.Linear(64, 1))
        self.actor_mean = nn.Sequential(*bodies[1], nn.Linear(64, act_dim))
        self.actor_logstd = nn.Parameter(torch.zeros(1, act_dim))


class CleanRLActor(nn.Module):
    """The actor of CleanRL's td3_continuous_action.py, or of its sac_continuous_action.py."""

    def __init__(self, env, *, gaussian):
        super().__init__()
        space = env.action_space
        self.fc1, self.fc2 = nn.Linear(env.observation_space.shape[0], 256), nn.Linear(256, 256)
        self.head = "fc_mean" if gaussian else "fc_mu"
        setattr(self, self.head, nn.Linear(256, space.shape[0]))
        if gaussian:
            self.fc_logstd = nn.Linear(256, space.shape[0])
        self.register_buffer("action_scale", torch.tensor((space.high - space.low) / 2.0, dtype=torch.float32))
        self.register_buffer("action_bias", torch.tensor((space.high + space.low) / 2.0, dtype=torch.float32))

    def forward(self, x):
        x = torch.relu(self.fc2(torch.relu(self.fc1(x))))
        return torch.tanh(getattr(self, self.head)(x)) * self.action_scale + self.action_bias


class CleanRLCritic(nn.Module):
    """The Q network of CleanRL's TD3 and SAC."""

    def __init__(self, env):
        super().__init__()
        inputs = env.observation_space.shape[0] + env.action_space.shape[0]
        self.fc1, self.fc2, self.fc3 = nn.Linear(inputs, 256), nn.Linear(256, 256), nn.Linear(256, 1)

    def forward(self, x, a):
        return self.fc3(torch.relu(self.fc2(torch.relu(self.fc1(torch.cat([x, a], 1))))))


class Front(nn.Module):
    """An MLP behind its own statistics, as deployers export it."""

    def __init__(self, obs_dim, act_dim, activation, end=None):
        super().__init__()
        self.register_buffer("mean", torch.linspace(-1, 1, obs_dim))
        self.register_buffer("std", torch.linspace(0.5, 2, obs_dim))
        layers = [nn.Linear(obs_dim, 24), activation, nn.Linear(24, 16), activation, nn.Linear(16, act_dim)]
        self.mlp = nn.Sequential(*layers, *([end] if end else []))

    def forward(self, x):
        return self.mlp(torch.clamp((x - self.mean) / self.std, -5, 5))


def write_onnx(module, obs_dim, path):
    """Write a module as ONNX, with torch's exporter."""
    torch.onnx.export(
        module.eval(), (torch.zeros(1, obs_dim),), str(path), input_names=["obs"], output_names=["action"], dynamo=False
    )


def observations(dim, spread=2.0):
    """1,000 observations."""
    return np.random.default_rng(0).normal(0, spread, (1000, dim)).astype(np.float32)


class JaxArray:
    """An array as jax pickles it: by a function of jax, with numpy's state."""

    def __init__(self, value):
        self.value = np.asarray(value, np.float32)

    def __reduce__(self):
        make, arguments, state = self.value.__reduce__()
        return sys.modules["jax._src.array"]._reconstruct_array, (make, arguments, state, {"weak_type": False})


def sbx_zip(path, params, *, policy_kwargs=None, planted=None):
    """A zip as SBX saves it: nested tables of arrays, by `actor` and `qf`, in a pickle of classes that are not here."""
    names = {"jax._src.array": "_reconstruct_array", "flax.training.train_state": "TrainState", "sbx.sac.policies": "SACPolicy"}
    modules = {name: types.ModuleType(name) for name in ("jax", "jax._src", "flax", "flax.training", "sbx", "sbx.sac", *names)}
    for module, name in names.items():
        made = type(name, (), {"__module__": module, "__qualname__": name})
        setattr(modules[module], name, made)
    with mock.patch.dict(sys.modules, modules):
        policy = modules["sbx.sac.policies"].SACPolicy()
        for name, tree in params.items():
            state = modules["flax.training.train_state"].TrainState()
            state.params, state.apply_fn = {"params": _jax(tree)}, planted
            setattr(policy, f"{name}_state", state)
        blob = base64.b64encode(pickle.dumps(policy)).decode()
    data = {
        "policy_kwargs": policy_kwargs,
        "num_timesteps": 40,
        "use_sde": False,
        "action_space": {":type:": "<class 'gymnasium.spaces.box.Box'>", "low": "[-3.]", "high": "[3.]"},
        "policy": {":type:": "<class 'sbx.sac.policies.SACPolicy'>", ":serialized:": blob},
    }
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("data", json.dumps(data))
        archive.writestr("_stable_baselines3_version", "2.9.2")
    return path


def _jax(tree):
    return {key: _jax(value) for key, value in tree.items()} if isinstance(tree, dict) else JaxArray(tree)


def dense(*widths, seed=0):
    """Layers of flax by name, with small random weights."""
    rng = np.random.default_rng(seed)
    named = enumerate(itertools.pairwise(widths))
    return {f"Dense_{k}": {"kernel": rng.normal(size=pair) / 2, "bias": rng.normal(size=pair[1])} for k, pair in named}
