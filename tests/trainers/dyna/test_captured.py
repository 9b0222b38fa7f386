"""Updates that are replayed as CUDA graphs give what the same functions give, to the bit; needs a CUDA device."""

from dataclasses import replace

import pytest
import torch

from tests.runs import interrupt_at
from transferkit.config import TrainConfig, with_settings
from transferkit.errors import InterruptedRunError
from transferkit.run import load_state, read_record
from transferkit.training import run_training

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="there is no CUDA device")

SETTINGS = {"network.hidden": [16, 16], "dyna.batch_size": 32, "dyna.updates_per_step": 4, "dyna.model_share": 0.2}
RUN = TrainConfig(
    "InvertedDoublePendulum-v5", algo="dyna-ddpg", steps=400, eval_episodes=1, device="cuda", checkpoint_seconds=0.0
)
CORE = {"wrap.freeze": {"core": 0.3}}


def weights(run):
    return load_state(run / "policy.safetensors")["weights"]


@pytest.mark.parametrize("core", [None, "inverted-pendulum-v1"])
def test_captured_eager_and_resumed_runs_are_the_same_to_the_bit(tmp_path, core):
    config = with_settings(replace(RUN, core=core), SETTINGS | (CORE if core else {}))
    run_training(config, out=tmp_path / "captured")
    run_training(replace(config, compile="off"), out=tmp_path / "eager")
    with pytest.raises(InterruptedRunError):
        run_training(config, out=tmp_path / "cut", report=interrupt_at(250))
    run_training(config, out=tmp_path / "cut", resume=True)
    captured, eager, cut = (weights(tmp_path / name) for name in ("captured", "eager", "cut"))
    assert all(torch.equal(captured[key], eager[key]) and torch.equal(captured[key], cut[key]) for key in captured)
    assert read_record(tmp_path / "captured")["compiled"] is True


@pytest.mark.parametrize("algo", ["ppo", "dyna-ppo"])
def test_the_other_trainers_run_on_a_cuda_device(tmp_path, algo):
    assert run_training(TrainConfig(RUN.env, algo=algo, steps=600, eval_episodes=1, device="cuda"), out=tmp_path).steps == 600
