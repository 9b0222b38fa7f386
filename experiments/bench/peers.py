"""Other libraries' learners at our settings, each as a call that does a fixed amount of work.

stable-baselines3 and rsl_rl are installed with the rest. SBX and mbrl-lib are compared with if they are there.
"""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import io
import os
from collections.abc import Callable
from types import ModuleType
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
import rsl_rl.runners
import stable_baselines3
import torch
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.logger import Logger
from tensordict import TensorDict
from torch import Tensor

from transferkit.envs import VectorEnv, make_env
from transferkit.streams import Streams

if TYPE_CHECKING:
    from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

Call = Callable[[], object]


HOW_TO_GET = {
    "sbx": 'pip install -e ".[bench]"',
    "mbrl": "pip install --no-deps mbrl hydra-core omegaconf antlr4-python3-runtime==4.9.3",
}


def optional(name: str) -> ModuleType | None:
    """Import a module that need not be there, or say how to get it; JAX on one thread."""
    os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1")
    package = name.partition(".")[0]
    if importlib.util.find_spec(package):
        return importlib.import_module(name)
    print(f"{package} is not installed, and is left out: {HOW_TO_GET[package]}", flush=True)
    return None


def td3_updates(env: str, width: int, batch: int, updates: int) -> Call:
    """stable-baselines3's TD3: its updates alone, on made-up transitions."""
    model = _td3(stable_baselines3, env, width, batch, updates)
    model.set_logger(Logger(None, []))
    assert model.replay_buffer is not None
    rng, (obs, act) = np.random.default_rng(0), (model.observation_space.shape, model.action_space.shape)
    for _ in range(2000):
        observation, following = rng.normal(size=(2, 1, *(obs or ()))).astype(np.float32)
        action = rng.uniform(-1, 1, (1, *(act or ()))).astype(np.float32)
        model.replay_buffer.add(observation, following, action, rng.normal(size=1), np.zeros(1), [{}])
    return lambda: model.train(gradient_steps=updates, batch_size=batch)


def td3_steps(library: ModuleType, env: str, width: int, batch: int, updates: int, steps: int, **policy: object) -> Call:
    """Environment steps of a library's TD3, each with acting, physics and updates."""
    model = _td3(library, env, width, batch, updates, **policy)
    model.learn(500)
    return lambda: model.learn(steps, reset_num_timesteps=False)


def _td3(library: ModuleType, env: str, width: int, batch: int, updates: int, **policy: object) -> OffPolicyAlgorithm:
    options = {"train_freq": 1, "gradient_steps": updates, "learning_starts": 300, "policy_delay": 2, "batch_size": batch}
    layers = {"net_arch": [width, width], **policy}
    return library.TD3("MlpPolicy", gymnasium.make(env), **options, policy_kwargs=layers)


def ppo_steps(
    library: ModuleType, env: str, num_envs: int, rollout: int, epochs: int, batch: int, width: int, steps: int
) -> Call:
    """Environment steps of a library's PPO."""
    arch: Any = [width, width] if library.__name__ == "sbx" else {"pi": [width, width], "vf": [width, width]}
    settings = {"n_steps": rollout // num_envs, "batch_size": batch, "n_epochs": epochs, "policy_kwargs": {"net_arch": arch}}
    model = library.PPO("MlpPolicy", make_vec_env(env, num_envs), **settings, device="cpu")
    return lambda: model.learn(steps, reset_num_timesteps=False)


def rsl_rl_steps(env: str, num_envs: int, rollout: int, epochs: int, batch: int, width: int, steps: int) -> Call:
    """Environment steps of rsl_rl's own runner, networks and optimiser on our environments."""
    model = {"class_name": "MLPModel", "hidden_dims": [width, width], "activation": "tanh", "obs_normalization": False}
    gaussian = {"class_name": "GaussianDistribution", "init_std": 1.0}
    algorithm = {"class_name": "PPO", "num_learning_epochs": epochs, "num_mini_batches": rollout // batch}
    algorithm |= {"learning_rate": 3e-4, "schedule": "fixed", "desired_kl": None, "entropy_coef": 0.0}
    config = {
        "algorithm": algorithm,
        "actor": {**model, "distribution_cfg": gaussian},
        "critic": model,
        "obs_groups": {"actor": ["policy"], "critic": ["policy"]},
        "num_steps_per_env": rollout // num_envs,
        "save_interval": 10**9,
        "multi_gpu": None,
    }
    with contextlib.redirect_stdout(io.StringIO()):
        runner = rsl_rl.runners.OnPolicyRunner(_RslRlEnvs(env, num_envs), config)  # pyright: ignore[reportArgumentType]

    def call() -> None:
        with contextlib.redirect_stdout(io.StringIO()):
            runner.learn(steps // rollout)

    return call


class _RslRlEnvs:
    """Our environments as rsl_rl steps them."""

    def __init__(self, env: str, num_envs: int) -> None:
        self.num_envs, self.device, self.cfg, self.max_episode_length = num_envs, "cpu", {}, 1000
        made = [make_env(env) for _ in range(num_envs)]
        self.num_actions = int(np.prod(made[0].action_space.shape or ()))
        self._envs = VectorEnv(made, lambda *k: Streams(0).integer("environment", *k), overrun_steps=0)
        self._observation = self._envs.reset()

    def get_observations(self) -> TensorDict:
        """Observations in the group `policy`."""
        return TensorDict({"policy": torch.from_numpy(self._observation)}, [self.num_envs])

    def step(self, actions: Tensor) -> tuple[TensorDict, Tensor, Tensor, dict[str, Tensor]]:
        """Step them all."""
        step = self._envs.step(actions.clamp(-1.0, 1.0).numpy())
        self._observation = step.observation
        ended = torch.from_numpy(step.done)
        return self.get_observations(), torch.from_numpy(step.reward), ended, {"time_outs": torch.from_numpy(step.truncated)}
