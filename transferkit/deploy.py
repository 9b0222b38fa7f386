"""Trained policies out of the house: as recordings, and as ONNX files."""

from __future__ import annotations

import hashlib
import json
import logging
from pathlib import Path

import torch
from torch import Tensor, nn

from transferkit.envs import derive_spec
from transferkit.errors import ConfigError, RunDirectoryError, TransferkitError
from transferkit.nn import Value
from transferkit.policy import Policy, wrap
from transferkit.policy.health import play
from transferkit.record.format import Names
from transferkit.record.play import Subject
from transferkit.run.directory import POLICY, RECORD, read_json
from transferkit.trained import load_policy, load_value
from transferkit.versions import versions
from transferkit.zoo.artifact import load_core

PARITY_ROWS = 1000
"""Random observations on which an exported file is compared with torch."""


def load_subject(name: str, *, env: str | None = None, member: int | None = None, values: bool = True) -> Subject:
    """A finished run's policy, or a core: on its own source, or wrapped onto another environment without training.

    Args:
        name: a run directory, or a core's id or folder.
        env: the environment to play in; by default the run's, or the core's source.
        member: of a core; by default the first.
        values: also what the critics think, where there are any; a warning where they cannot be rebuilt.

    Raises:
        ConfigError: a run is asked for in another environment than its own, or with a member.
        UnknownNameError: neither a run nor a core has this name.
    """
    if (Path(name) / RECORD).exists():
        if member is not None:
            raise ConfigError(f"run {name} has no members; leave out --member")
        return _run_subject(Path(name), env, values=values)
    member = member or 0
    core = load_core(name)
    home = core.spec.env_id
    about = {"core": core.id, "core_digest": core.digest, "member": member}
    if env is None or env == home:
        value = core.critic(member).value if "critic" in core.ensembles else None
        return Subject(core.policy(member), home, value, about=about)
    return Subject(wrap(core, env, member=member), env, about=about)


def _run_subject(run: Path, env: str | None, *, values: bool) -> Subject:
    record = read_json(run / RECORD)["config"]
    if env not in (None, record["env"]):
        raise ConfigError(f"run {run} was trained in {record['env']} and cannot play {env}; leave out --env")
    policy = load_policy(run)
    digest = hashlib.sha256((run / POLICY).read_bytes()).hexdigest()
    about = {name: record[name] for name in ("algo", "preset", "core", "core_digest", "member", "seed")}
    clip = record["ppo"]["clip_actions"]
    value = _value(run, policy) if values else None
    return Subject(policy, record["env"], value, clip, {"run": str(run), "policy_sha256": digest, "training": about})


def _value(run: Path, policy: Policy) -> Value | None:
    try:
        return load_value(run, policy)
    except TransferkitError as error:
        logging.getLogger("transferkit").warning("values are not recorded: %s", error)
        return None


class Deployed(nn.Module):
    """Raw observations `(B, obs_dim)` to controls `(B, act_dim)` in the actuators' own units."""

    centre: Tensor
    half_range: Tensor

    def __init__(self, policy: Policy, low: Tensor, high: Tensor) -> None:
        super().__init__()
        self.policy = policy
        self.register_buffer("centre", (low + high) / 2)
        self.register_buffer("half_range", (high - low) / 2)

    def forward(self, observation: Tensor) -> Tensor:
        """The deterministic action, clipped and scaled."""
        return self.centre + self.half_range * self.policy(observation)[0].clamp(-1.0, 1.0)


def export_onnx(subject: Subject, path: Path) -> float:
    """Write normaliser, adapters, core and scaling as one ONNX file, with the names of what goes in and out.

    Returns the largest difference to torch over 1,000 random observations.

    Raises:
        ConfigError: the file exists, or ONNX is not installed.
        RunDirectoryError: the exported file does not act as the policy does.
    """
    if path.exists():
        raise ConfigError(f"{path} exists; pass another --out FILE.onnx")
    try:
        import onnx  # noqa: PLC0415 - the extra `onnx`
        import onnxruntime  # type: ignore[import-untyped] # noqa: PLC0415
        import onnxscript  # noqa: F401, PLC0415 - what torch exports through
    except ImportError as error:
        raise ConfigError(f"export needs {error.name}, which is not installed; pip install 'transferkit[onnx]'") from None
    spec = derive_spec(subject.env)
    names = Names.of(spec)
    bounds = [torch.tensor([getattr(actuator, end) for actuator in spec.action]) for end in ("low", "high")]
    deployed = Deployed(subject.policy, *bounds).eval()
    observation = _random_observations(subject.env)
    batch = torch.export.Dim("batch")
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)  # it warns that torchvision is not there
    program = torch.onnx.export(
        deployed,
        (observation[:2],),
        dynamo=True,
        external_data=False,
        verbose=False,
        input_names=["observation"],
        output_names=["action"],
        dynamic_shapes=({0: batch},),
    )
    assert program is not None
    model = program.model_proto
    about = {
        "env": spec.env_id,
        "observation_names": json.dumps(names.observation),
        "action_names": json.dumps(names.action),
        "action_low": json.dumps(bounds[0].tolist()),
        "action_high": json.dumps(bounds[1].tolist()),
        "time_step": json.dumps(spec.time_step),
        "versions": json.dumps(versions()),
        "source": json.dumps(subject.about),
    }
    onnx.helper.set_model_props(model, about)
    data = model.SerializeToString()
    session = onnxruntime.InferenceSession(data, providers=["CPUExecutionProvider"])
    with torch.no_grad():
        expected = deployed(observation)
    answer = torch.from_numpy(session.run(["action"], {"observation": observation.numpy()})[0])
    difference = float((answer - expected).abs().max())
    if not difference <= 1e-3 * float(deployed.half_range.max()):
        raise RunDirectoryError(f"the exported policy differs from torch by {difference:.2g}; nothing is written, report it")
    path.write_bytes(data)
    return difference


def _random_observations(env_id: str) -> Tensor:
    """As random play meets them, and their multiples."""
    seen = torch.from_numpy(play(env_id, PARITY_ROWS, 0))
    return seen * torch.linspace(0.1, 3.0, len(seen)).unsqueeze(-1)
